"""Numbers shared by shaders and Python: the values of `#constant NAME`."""

from __future__ import annotations

import numpy as np

from splatgl.splat import (
    clipping,
    colormaps,
    culling,
    footprint,
    mask_field,
    motion,
    motion_blur,
    preintegration,
    sheets,
    splats,
    technique,
)

# splats per row of the placed textures, and groups of four entries per row of the tile list
ABREAST, LISTED = 1024, 2048
# ends of cells of the classification table along its rows
TABLE_ROW = 128
# invocations per work group
LANES = 8
# pieces of matter of a page, of which the last names the next page
PAGE = 8
# cursor of a terminated tile
NOWHERE = 0xFFFFFFFF

CONSTANTS: dict[str, float | np.uint32] = {
    "ABREAST": np.uint32(ABREAST),
    "ABSENT": sheets.ABSENT,
    "AHEAD": motion.AHEAD,
    "BLOCK": np.uint32(culling.BLOCK),
    "CELLS": preintegration.CELLS,
    "COLOR_SCALE": splats.COLOR_SCALE,
    "COLUMNS": technique.COLUMNS,
    "DENSE": motion_blur.DENSE,
    "DENSEST": motion_blur.DENSEST,
    "FACE": clipping.FACE,
    "FAR": motion.FAR,
    "FIRST_ORDER": footprint.FIRST_ORDER,
    "GRAZING": footprint.GRAZING,
    "FLUSH": clipping.FLUSH,
    "GRAZING_RAY": clipping.GRAZING,
    "HALF_LINE_REACH": culling.HALF_LINE_REACH,
    "HAS_PLACE": culling.HAS_PLACE,
    "KNOWN": colormaps.KNOWN,
    "LANES": LANES,
    "LARGEST_DEPTH": footprint.LARGEST_DEPTH,
    "LEAST": motion_blur.LEAST,
    "LEAST_MASS": sheets.LEAST_MASS,
    "EDGE": sheets.EDGE,
    "AMID": sheets.AMID,
    "CENTERED": sheets.CENTERED[0],
    "WHOLLY": sheets.CENTERED[1],
    "LISTED": np.uint32(LISTED),
    "MAP_ENTRIES": colormaps.ENTRIES,
    "MASK_EDGE": mask_field.EDGE,
    "MASK_ONE": float(mask_field.ONE),
    "MASK_ZERO": float(mask_field.ZERO),
    "MASK_SURE": mask_field.SURE,
    "MOST_CLIPS": clipping.MOST_CLIPS,
    "MOST_DOUBLINGS": technique.MOST_DOUBLINGS,
    "NEAREST": motion.NEAREST,
    "NOWHERE": np.uint32(NOWHERE),
    "ONSET": footprint.ONSET,
    "PAGE": PAGE,
    "PIXEL_MARGIN": culling.PIXEL_MARGIN,
    "RIM_GROWTH": footprint.RIM_GROWTH,
    "RIM_START": footprint.RIM_START,
    "ROWS": technique.ROWS,
    "RUN_OCTAVES": splats.OCTAVES,
    "SHORT": motion_blur.SHORT,
    "TABLE_ROW": TABLE_ROW,
    "WEIGHTS": preintegration.WEIGHTS,
}


def glsl(name: str) -> str:
    """The constant as a GLSL literal; KeyError for an unknown name."""
    value = CONSTANTS[name]
    return f"{value}u" if isinstance(value, np.uint32) else repr(value)

"""Parameters of the tile technique: number of depth batches, and evaluation of opacity.

A tile has one column of pixels per SIMD lane of a software renderer.
"""

from __future__ import annotations

import numpy as np

from splatgl.splat.extraction.splats import Splats
from splatgl.splat.kernel.kernels import Kernel
from splatgl.splat.plan.occlusion_policy import solid
from splatgl.splat.view.screen_bounds import ScreenBounds
from splatgl.splat.view.view import View

# pixels along a tile's sides: tiles.glsl's COLUMNS and ROWS
COLUMNS, ROWS = 8, 8
# most pixels per band: the cursors, one per tile and run of splats, take as much memory as the pixels' colours
MOST_PIXELS = 2**24
# solid volumes of more than MANY splats are drawn in BATCHES depth batches
MANY, BATCHES = 1_000_000, 6
# within sheets, which take longer, and of which the open ones are kept between batches
MANY_IN_SHEETS, SHEET_BATCHES = 200_000, 3
# most splats placed at a time: one texel each in three to seven textures
MOST = 2**20
# most halvings of an optical depth before its polynomial: an opacity over 1 − 2⁻³² counts as 1
MOST_DOUBLINGS = 5
# gain of a slanted footprint over a frontal one, with a margin
SLANTED = 1.5


def depth_batches(splats: Splats, view: View, bounds: ScreenBounds, sheets: bool) -> int:
    """Number of depth batches: most splats of solid volumes lie behind terminated tiles. sheets: whether they add up
    within sheets.
    """
    many, batches = (MANY_IN_SHEETS, SHEET_BATCHES) if sheets else (MANY, BATCHES)
    return batches if len(splats) >= many and solid(splats, view, bounds) else 1


def exp_doublings(splats: Splats, shape: Kernel, attenuation: str) -> int:
    """Number of halvings that bring the largest depth, in powers of two, to at most 1, the polynomial's domain."""
    if attenuation == "opacity":
        # the unstretched splat's depth, at any slant
        return MOST_DOUBLINGS
    longest = float(np.linalg.norm(splats.grid.world_from_index / splats.grid.mean_spacing, ord=2))
    deepest = splats.deepest * float(shape.footprint(np.zeros(()))) * longest * SLANTED / np.log(2.0)
    return int(np.clip(np.ceil(np.log2(max(deepest, 1e-30))), 0, MOST_DOUBLINGS))

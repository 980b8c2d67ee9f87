"""The stress suite: named extreme cases, each with a known exact result and an error bound.

A registry with one entry per case. `run_case` runs one, the command `splatgl stress` all.
"""

from __future__ import annotations

import time

import numpy as np

from splatgl.reference.renderer import Renderer
from splatgl.studies.stress import attenuation, cameras, grids, images, optics
from splatgl.studies.stress.case import Bench, Case, Result, raised

CASES: dict[str, Case] = {
    case.name: case
    for cases in (
        cameras.EYE_CASES,
        optics.OPTICS_CASES,
        optics.PILE_CASES,
        cameras.LENS_CASES,
        images.PICTURE_CASES,
        grids.SAMPLE_CASES,
        grids.SPACE_CASES,
        attenuation.WALL_CASES,
        attenuation.EDGE_CASES,
        optics.FOG_CASES,
        attenuation.STIFF_CASES,
        images.CLASS_CASES,
        images.METHOD_CASES,
    )
    for case in cases
}


def run_case(case: Case, renderer: Renderer) -> Result:
    """Runs a case; an exception counts as a violated bound, and the other cases continue."""
    bench = Bench(renderer)
    started = time.perf_counter()
    try:
        # many cases overflow on purpose: only the image counts
        with np.errstate(all="ignore"):
            checks = tuple(case.run(bench))
    except Exception as error:
        checks = (raised(error),)
    return Result(case, checks, bench.pictures, bench.bad_pixels, time.perf_counter() - started)

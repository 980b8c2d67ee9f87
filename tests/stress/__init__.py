"""The stress suite: named extreme cases, each with a known exact result and an error bound.

`CASES` holds all cases. `run_case` runs one, the command `splatgl stress` all.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

from tests.stress import attenuation, cameras, grids, images, optics
from tests.stress.case import Bench, Case, Result, exception_check

if TYPE_CHECKING:
    from splatgl.gl.renderer import Renderer

CASES: dict[str, Case] = {
    case.name: case
    for group in (
        cameras.EYE,
        optics.OPACITY,
        optics.PILES,
        cameras.LENSES,
        images.IMAGES,
        grids.SAMPLES,
        grids.SPACE,
        attenuation.WALLS,
        attenuation.EDGES,
        optics.FOG,
        attenuation.STIFF,
        images.CLASSES,
        images.METHODS,
    )
    for case in group
}


def run_case(case: Case, renderer: Renderer) -> Result:
    """Runs a case; an exception counts as a violated bound, so that the other cases continue."""
    bench = Bench(renderer)
    started = time.perf_counter()
    try:
        # many cases overflow on purpose: only the image counts
        with np.errstate(all="ignore"):
            checks = tuple(case.run(bench))
    except Exception as error:
        checks = (exception_check(error),)
    return Result(case, checks, bench.pictures, bench.bad_pixels, time.perf_counter() - started)

"""The stress suite: named cases at the extremes, each with an answer known in advance and a bound.

A registry: one entry a case. Run one by `run_case`, all by the command `splatgl stress`.
"""

from __future__ import annotations

import time

import numpy as np

from splatgl.truth.drawing import Renderer
from splatgl.truth.stress import edge, eye, fog, lens, methods, optics, pictures, piles, samples, space, stiff, walls
from splatgl.truth.stress.bench import Bench
from splatgl.truth.stress.case import Case, Result, raised

MODULES = (eye, optics, piles, lens, pictures, samples, space, walls, edge, fog, stiff, methods)
CASES: dict[str, Case] = {case.name: case for module in MODULES for case in module.CASES}


def run_case(case: Case, renderer: Renderer) -> Result:
    """Draws one case and measures it; a case that raises is one whose bound is broken, and the rest can go on."""
    bench = Bench(renderer)
    started = time.perf_counter()
    try:
        # overflow is what many cases are about: what counts is the picture
        with np.errstate(all="ignore"):
            checks = tuple(case.run(bench))
    except Exception as error:
        checks = (raised(error),)
    return Result(case, checks, bench.pictures, bench.bad_pixels, time.perf_counter() - started)

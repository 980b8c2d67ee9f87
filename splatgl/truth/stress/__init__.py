"""The stress suite: named extreme cases, each with a known exact result and an error bound.

A registry with one entry per case. `run_case` runs one, the command `splatgl stress` all.
"""

from __future__ import annotations

import time

import numpy as np

from splatgl.reference.renderer import Renderer
from splatgl.truth.stress import (
    classes,
    edge,
    eye,
    fog,
    lens,
    methods,
    optics,
    pictures,
    piles,
    samples,
    space,
    stiff,
    walls,
)
from splatgl.truth.stress.bench import Bench
from splatgl.truth.stress.case import Case, Result, raised

MODULES = (eye, optics, piles, lens, pictures, samples, space, walls, edge, fog, stiff, classes, methods)
CASES: dict[str, Case] = {case.name: case for module in MODULES for case in module.CASES}


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

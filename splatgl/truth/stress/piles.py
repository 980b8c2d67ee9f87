"""Very many splats on one pixel: float32 accumulation error, and occlusion by an opaque splat."""

from __future__ import annotations

import numpy as np

from splatgl.truth.stress.bench import Bench
from splatgl.truth.stress.case import Case, Check, check
from splatgl.truth.stress.scenes import dots, parallel, peak

MILLION = 10**6
FAINT = 1e-7
# 1 − (1 − 1e−7)^1e6 to 16 digits
MILLION_FAINT = 0.0951625864882278
# Each 'over' rounds the sum by at most half a unit in its last place. Below 0.125 that is 2⁻²⁸; earlier
# sums are smaller, with half of that on average.
FAINT_BOUND = MILLION * 2.0**-28
# a sum of 0.1 in an X-ray: the same unit
FAINT_SUM_BOUND = MILLION * 2.0**-28
PILE = 10**5
# a fortieth of an 8-bit level; the rounding errors could sum up to 3e−3 if all had the same sign
PILE_BOUND = 1e-4


def million_faint(bench: Bench) -> list[Check]:
    """Checks α of a million splats of opacity 1e−7 in either order, and their X-ray sum."""
    points = np.zeros((MILLION, 3))
    splats = dots(points, -np.log1p(-FAINT) / peak())
    camera = parallel(1.0, (1, 1))
    paper = bench.paper(splats, camera)[0, 0, 3]
    half = bench.draw(splats, camera, target="rgba16f")[0, 0, 3]
    checks = [check("back to front", bench.draw(splats, camera)[0, 0, 3], MILLION_FAINT, FAINT_BOUND, paper)]
    found = bench.draw(splats, camera, order="front-to-back")[0, 0, 3]
    checks.append(check("front to back", found, MILLION_FAINT, FAINT_BOUND, half))
    summed = bench.draw(splats, camera, blend="xray")[0, 0, 3]
    old = bench.paper(splats, camera, blend="xray")[0, 0, 3]
    checks.append(check("X-ray sum", summed, -MILLION * np.log1p(-FAINT), FAINT_SUM_BOUND, old))
    return checks


def pile(bench: Bench) -> list[Check]:
    """Checks 100 000 random splats on one pixel against the float64 reference, and their X-ray sum."""
    rng = np.random.default_rng(5)
    tau = rng.exponential(3.0 / PILE, PILE)
    # some are dense
    tau[rng.integers(0, PILE, 5)] = 0.3
    splats = dots(
        np.stack([np.zeros(PILE), np.zeros(PILE), rng.uniform(0, 200, PILE)], axis=1),
        tau / peak(),
        rng.uniform(0.0, 1.0, (PILE, 3)),
    )
    camera = parallel(1.0, (1, 1))
    right, paper = bench.truth(splats, camera), bench.paper(splats, camera)
    checks = []
    for order in ("back-to-front", "front-to-back"):
        drawn = bench.draw(splats, camera, order=order)
        checks.append(check(order.replace("-", " "), drawn, right, PILE_BOUND, paper))
    depth = tau.sum()
    found = bench.draw(splats, camera, blend="xray")[0, 0, 3]
    checks.append(check("X-ray sum", found, depth, PILE_BOUND * 4, bench.paper(splats, camera, blend="xray")[0, 0, 3]))
    return checks


def hidden(bench: Bench) -> list[Check]:
    """Checks that an opaque red splat hides a million splats behind it, in either order."""
    rng = np.random.default_rng(6)
    places = np.zeros((MILLION + 1, 3))
    places[1:, 2] = rng.uniform(4.0, 500.0, MILLION)
    colors = np.concatenate([[(1.0, 0.0, 0.0)], rng.uniform(0.0, 1.0, (MILLION, 3))])
    # τ = 60: e⁻⁶⁰ is negligible
    splats = dots(places, np.concatenate([[60.0], rng.uniform(0.0, 1e-3, MILLION)]) / peak(), colors)
    camera = parallel(1.0, (1, 1))
    paper = bench.paper(splats, camera)[0, 0]
    right = (1.0, 0.0, 0.0, 1.0)
    checks = []
    for order in ("back-to-front", "front-to-back"):
        drawn = bench.draw(splats, camera, order=order)[0, 0]
        checks.append(check(order.replace("-", " "), drawn, right, 1e-6, paper))
    return checks


CASES = (
    Case(
        "million-faint",
        "a million splats of opacity 1e−7 on one pixel: float32 'over' rounds each",
        "one pixel; the bound is half a unit in the last place a splat. 8 bits and half float see nothing",
        "30-digit arithmetic: 1 − (1 − 1e−7)^1e6",
        million_faint,
    ),
    Case(
        "pixel-pile",
        "100 000 splats of random depth and colour on one pixel",
        "one pixel, Σ τ = 4.5; the bound is a fortieth of an 8-bit level",
        "float64 reference with compensated sums",
        pile,
    ),
    Case(
        "hidden-million",
        "a million splats behind an opaque one",
        "one pixel; the opaque splat is red",
        "red",
        hidden,
    ),
)

"""Opacity and optical depth at the ends of their range, alone and combined on a ray."""

from __future__ import annotations

import numpy as np

from splatgl.data.volume import Volume
from splatgl.splat.transfer import OPAQUE
from splatgl.truth.stress.bench import Bench, voxels
from splatgl.truth.stress.case import Case, Check, check
from splatgl.truth.stress.scenes import alpha, dots, middle, parallel, peak, transfer

# float32 sums and products: some roundings of 6e−8
ROUNDING = 1e-6
# transmitted light: two of float32's smallest steps below 1
LIGHT = 2.0**-23
# opacities, including 1; a voxel of 1 is read as the next smaller opacity
OPACITIES = (1e-8, 1e-7, 1e-4, 0.5, 1 - 1e-4, 1 - 1e-7, 1.0)
# (opacity per length 1, thickness): 1 − (1 − a)^s, to 16 digits
CORRECTIONS = (
    (0.5, 0.001, 6.929070095474781e-4),
    (0.999, 0.0625, 0.350618368),
    (1e-8, 0.001, 1.000000005e-11),
)
# optical depths of one ray
DEPTHS = tuple(10.0**n for n in range(-12, 5))


def opacities(bench: Bench) -> list[Check]:
    """Checks OPACITIES of one voxel against 1 − (1 − a)^F(0), and the transmitted light."""
    found, right, paper = [], [], []
    camera = parallel(1.0, (1, 1))
    for opacity in OPACITIES:
        splats = voxels(Volume(np.ones((1, 1, 1), np.uint8)), transfer(((0.0, 0.0), (1.0, opacity)), 1.0))
        found.append(bench.draw(splats, camera)[0, 0, 3])
        paper.append(bench.paper(splats, camera)[0, 0, 3])
        right.append(-np.expm1(np.log1p(-min(opacity, OPAQUE)) * peak()))
    return [
        check("opacity", found, right, ROUNDING, paper, relative=True),
        check("what is left of light", 1 - np.array(found), 1 - np.array(right), LIGHT, 1 - np.array(paper)),
    ]


def corrections(bench: Bench) -> list[Check]:
    """Checks opacities per another length against CORRECTIONS, along with float32's pow and the paper's image."""
    found, right, formula, pixels = [], [], [], []
    for opacity, thickness, known in CORRECTIONS:
        # a voxel that is `thickness` wide, and what its middle holds: 1 − (1 − a)^s with s = thickness · F(0)
        splats = voxels(
            Volume(np.ones((1, 1, 1), np.uint8), (thickness / peak(),) * 3),
            transfer(((0.0, 0.0), (1.0, opacity)), 1.0),
        )
        camera = parallel(thickness / 10, (1, 1), before=-10 * thickness)
        found.append(bench.draw(splats, camera)[0, 0, 3])
        pixels.append(bench.paper(splats, camera)[0, 0, 3])
        right.append(known)
        one = np.float32(1)
        formula.append(one - np.power(one - np.float32(opacity), np.float32(thickness)))
    return [
        check("against 1 − (1 − a)ˢ", found, right, ROUNDING, formula, relative=True),
        check("and in 8 bits", found, right, ROUNDING, pixels, relative=True),
    ]


def depth_range(bench: Bench) -> list[Check]:
    """Checks 'over' of optical depths from 1e−12 to 1e4, side by side and behind one another."""
    tau = np.array(DEPTHS)
    count = len(tau)
    # side by side, five voxels apart: each alone
    row = dots(np.stack([5.0 * np.arange(count), np.zeros(count), np.zeros(count)], axis=1), tau / peak())
    camera = parallel(5.0 / 5, (5 * count, 1), (2.5 * (count - 1), 0.0))
    alone = alpha(bench.draw(row, camera))[0, 2::5]
    paper = alpha(bench.paper(row, camera))[0, 2::5]
    right = -np.expm1(-tau)

    # one behind the other on a ray, the faintest nearest, and reversed
    checks = [check("side by side", alone, right, 2 * ROUNDING, paper, relative=True)]
    colors = np.random.default_rng(7).uniform(0.2, 1.0, (count, 3))
    for name, order in (("faintest first", np.arange(count)), ("densest first", np.arange(count)[::-1])):
        places = np.zeros((count, 3))
        places[order, 2] = 4.0 * np.arange(count)
        splats = dots(places, tau / peak(), colors)
        seen = np.exp(-np.concatenate([[0.0], np.cumsum(tau[order])[:-1]])) * -np.expm1(-tau[order])
        answer = np.append(seen @ colors[order], -np.expm1(-tau.sum()))
        view = parallel(1.0, (1, 1))
        drawn, old = bench.draw(splats, view)[0, 0], bench.paper(splats, view)[0, 0]
        checks.append(check(name, drawn, answer, 2 * ROUNDING, old))
    return checks


def xray_range(bench: Bench) -> list[Check]:
    """Sums with terms over sixteen decades: each term above the sum's last digit must contribute."""
    tau = np.array(DEPTHS)
    splats = dots(np.stack([np.zeros(len(tau)), np.zeros(len(tau)), 4.0 * np.arange(len(tau))], axis=1), tau / peak())
    camera = parallel(1.0, (1, 1))
    found = middle(bench.draw(splats, camera, blend="xray"))
    paper = middle(bench.paper(splats, camera, blend="xray"))
    return [check("Σ τ", found, np.full(4, tau.sum()), ROUNDING, paper, relative=True)]


CASES = (
    Case(
        "opacity-extremes",
        "opacities 1e−8, 1e−7, 0.5, 1 − 1e−7 and 1",
        "one voxel in one pixel; 1 is read as 1 − 2⁻²⁴",
        "closed form: 1 − (1 − a)^F(0)",
        opacities,
    ),
    Case(
        "opacity-correction",
        "opacity stated for another length: 1 − pow(1 − a, s) loses what is below 1e−7",
        "a = 0.5, s = 0.001; a = 0.999, s = 0.0625; a = 1e−8, s = 0.001; the paper's: pow in float32",
        "30-digit arithmetic",
        corrections,
    ),
    Case(
        "depth-range",
        "optical depths from 1e−12 to 1e4 in one ray",
        "17 splats side by side, and behind one another, faintest or densest first, each of its own colour",
        "closed form: Σ Π exp(−τ) (1 − exp(−τ)) c",
        depth_range,
    ),
    Case(
        "xray-range",
        "an X-ray sum of terms from 1e−12 to 1e4",
        "the same 17 splats behind one another",
        "closed form: Σ τ",
        xray_range,
    ),
)

"""Presets of CT, MR and diffusion images, under the names that 3D Slicer's users know; the numbers are our own.

Those of CT are in Hounsfield units. Other values are taken for a CT whose classes lie where tissues do: see `adapted`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from splatgl.splat.classification.looks import RAMP, SOLID, Look, Preset, cut_of
from splatgl.splat.classification.statistics import Statistics
from splatgl.splat.classification.transfer import Nodes

# Hounsfield units of air, its border to tissue, soft tissue, its border to bone, bone, and the densest
LANDMARKS = (-1000.0, -400.0, 40.0, 180.0, 600.0, 1500.0)
# of an object with two classes of values only
TWO = (-1000.0, -400.0, 600.0, 1500.0)
# percentile of the densest
DENSEST = 99.9
Build = Callable[[Statistics, int | None], Look]


def adapted(look: Look) -> Build:
    """Builds a CT's look for other values: its Hounsfield units lie where the classes of the values are."""

    def build(stats: Statistics, rung: int | None) -> Look:
        units, values = _landmarks(stats)

        def place(unit: float) -> float:
            return float(np.interp(unit, units, values))

        points = tuple((place(unit), opacity) for unit, opacity in look.points)
        low, high = (place(unit) for unit in look.window or (look.points[0][0], look.points[-1][0]))
        return Look(points, (low, high) if low < high else None)

    return build


def _landmarks(stats: Statistics) -> tuple[tuple[float, ...], np.ndarray]:
    """Hounsfield units, and the values that stand for them, neither of which fall."""
    first, top = stats.cuts[0], stats.percentile(DENSEST)
    if len(stats.cuts) < 2:
        return TWO, np.maximum.accumulate([first.below, first.value, first.above, top])
    second = stats.cuts[1]
    places = [first.below, first.value, second.below, second.value, second.above, top]
    return LANDMARKS, np.maximum.accumulate(places)


def _percentiles(*nodes: tuple[float, float], window: tuple[float, float]) -> Build:
    """A look with nodes at percentiles."""

    def build(stats: Statistics, rung: int | None) -> Look:
        points = tuple((stats.percentile(percent), opacity) for percent, opacity in nodes)
        low, high = (stats.percentile(percent) for percent in window)
        return Look(points, (low, high) if low < high else None)

    return build


def _mr(stats: Statistics, rung: int | None) -> Look:
    """Faint outer layers, denser with the value: skin and skull do not hide what is within."""
    low, high = cut_of(stats, rung).ramp(RAMP)
    top = max(high, stats.percentile(DENSEST))
    points = ((low, 0.0), (high, 0.12), (high / 2 + top / 2, 0.35), (top, 0.6))
    return Look(points, (min(low, stats.percentile(1.0)), top))


def _fraction(stats: Statistics, rung: int | None) -> Look:
    """Of anisotropies from 0 to 1; of other values, as shares of the largest."""
    top = 1.0 if stats.values[0] >= 0 and 0.3 < stats.values[-1] <= 1 else max(stats.percentile(DENSEST), 0.0)
    low = 0.0 if top > 0 else float(stats.values[0])
    points = tuple((low + share * (top - low), opacity) for share, opacity in ((0.15, 0), (0.35, 0.15), (0.8, 0.9)))
    return Look(points, (low, top) if low < top else None)


def _ct(name: str, about: str, colormap: str, window: tuple[float, float], *points: tuple[float, float]) -> Preset:
    nodes: Nodes = points
    look = Look(nodes, window)
    return Preset(name, about, colormap, adapted(look), hounsfield=look)


MEDICAL = (
    _ct(
        *("ct-aaa", "the aorta and its branches with contrast, and bone", "vessels", (100.0, 900.0)),
        *((140.0, 0.0), (190.0, 0.35), (320.0, 0.8), (900.0, 0.95)),
    ),
    _ct(
        *("ct-air", "where air ends: skin, airways and lungs from within", "airways", (-950.0, -400.0)),
        *((-900.0, 0.0), (-700.0, 0.25), (-550.0, 0.25), (-450.0, 0.0)),
    ),
    _ct(
        *("ct-bones", "bone alone, its surface hard", "bone", (-700.0, 700.0)),
        *((230.0, 0.0), (280.0, 0.95), (1500.0, SOLID)),
    ),
    _ct(
        *("ct-cardiac", "heart and great vessels with contrast, through faint muscle", "heart", (-50.0, 500.0)),
        *((20.0, 0.0), (90.0, 0.04), (150.0, 0.12), (230.0, 0.6), (500.0, 0.9)),
    ),
    _ct(
        *("ct-chest-contrast", "vessels and bone through skin and muscle", "chest", (-200.0, 700.0)),
        *((-150.0, 0.0), (-60.0, 0.03), (60.0, 0.06), (130.0, 0.15), (220.0, 0.7), (700.0, 0.95)),
    ),
    _ct(
        *("ct-coronary-arteries", "thin vessels with contrast, and calcium white", "coronary", (120.0, 700.0)),
        *((180.0, 0.0), (260.0, 0.85), (700.0, SOLID)),
    ),
    _ct(
        *("ct-lung", "lungs: their tissue faint, vessels and airways in it", "lungs", (-950.0, 100.0)),
        *((-950.0, 0.0), (-800.0, 0.02), (-600.0, 0.12), (-300.0, 0.3), (-100.0, 0.1), (0.0, 0.0)),
    ),
    _ct(
        *("ct-muscle", "muscle and organs, without fat and bone", "muscle", (-60.0, 180.0)),
        *((-10.0, 0.0), (40.0, 0.5), (110.0, 0.6), (180.0, 0.05), (250.0, 0.0)),
    ),
    _ct(
        *("ct-fat", "fat alone, under the skin and around organs", "fat", (-180.0, 0.0)),
        *((-160.0, 0.0), (-115.0, 0.5), (-75.0, 0.5), (-20.0, 0.0)),
    ),
    _ct(
        *("ct-liver-vasculature", "vessels with contrast in a faint liver", "liver", (60.0, 350.0)),
        *((70.0, 0.0), (100.0, 0.05), (140.0, 0.08), (190.0, 0.7), (350.0, 0.9)),
    ),
    Preset("mr-default", "faint outside, denser with the value", "ivory", _mr, 0),
    Preset(
        *("mr-angio", "the brightest two percent: vessels of an angiogram", "fire"),
        _percentiles((97.5, 0.0), (99.3, 0.7), (100.0, 0.95), window=(85.0, 99.9)),
    ),
    Preset(
        *("mr-t2-brain", "fluid and white matter, the upper half of the values above air", "bone"),
        _percentiles((75.0, 0.0), (88.0, 0.15), (97.0, 0.5), (99.9, 0.85), window=(0.0, 97.0)),
    ),
    Preset("dti-fa", "anisotropy of diffusion, from 0 to 1", "spectrum", _fraction, shading=False),
    Preset(
        *("mip", "the largest value along each ray"),
        *("gray", _percentiles((1.0, 0.0), (99.95, SOLID), window=(1.0, 99.95))),
        shading=False,
        blend="mip",
    ),
)

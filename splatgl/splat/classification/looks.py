"""What presets are made of: opacity nodes and windows of colours, from a volume's statistics."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from splatgl.splat.classification.ground import Ground
from splatgl.splat.classification.statistics import Cut, Statistics
from splatgl.splat.classification.transfer import Nodes

# opacities of a surface just above its cut, of the brightest matter, and of single-valued objects
SURFACE, CORE, SOLID = 0.8, 0.95, 0.99
# opacity of the largest values of a field, per mean spacing
FIELD = 0.5
# position of a surface's value in its colour map
SURFACE_TONE = 0.6
# extent of a surface's ramp, as a share of the way from its cut to the two class means
RAMP = 0.3
# percentiles of a sparse volume's non-background values: the dimmest visible, and the brightest
DIM, BRIGHT = 1.0, 70.0


@dataclass(frozen=True)
class Look:
    """A preset's result for one volume: opacity nodes and the colour map's window. tone: the place in the colour map at
    which the window begins.
    """

    points: Nodes
    window: tuple[float, float] | None = None
    tone: float = 0.0


@dataclass(frozen=True)
class Preset:
    """A named look. hounsfield: the look of a CT in HU. rung: index of the ramp's cut; None: the object's own.

    blend: what it is drawn with where nothing else is asked for; None: as any.
    """

    name: str
    about: str
    colormap: str
    build: Callable[[Statistics, int | None], Look]
    rung: int | None = None
    hounsfield: Look | None = None
    shading: bool = True
    blend: str | None = None


def surface(stats: Statistics, rung: int | None) -> Look:
    """A ramp over a cut: transparent below, a surface above, denser towards the brightest."""
    low, high = cut_of(stats, rung).ramp(RAMP)
    top = max(high, stats.percentile(99.9))
    # its colours begin where they are light
    return Look(((low, 0.0), (high, SURFACE), (top, CORE)), (low, top) if low < top else None, SURFACE_TONE)


def soft(stats: Statistics, rung: int | None) -> Look:
    """A long ramp from the cut to the brightest: semi-transparent."""
    low = cut_of(stats, rung).ramp(RAMP)[0]
    top = max(low, stats.percentile(99.9))
    return Look(((low, 0.0), (top, SURFACE)))


def glow(stats: Statistics, rung: int | None) -> Look:
    """A ramp from half the dimmest value above the background, or above its noise, to the BRIGHT percentile."""
    lowest = float(stats.values[0])
    low = lowest if stats.sparse else cut_of(stats, rung).ramp(RAMP)[0]
    dim, high = np.percentile(stats.values[stats.values > low], [DIM, BRIGHT])
    low = lowest + (float(dim) - lowest) / 2 if stats.sparse else low
    low, high = low if stats.ground is None else max(low, stats.ground.cut), max(low, float(high))
    return Look(((low, 0.0), *_above_noise(stats.ground, low, high), (high, SURFACE)))


def _above_noise(ground: Ground | None, low: float, high: float) -> Nodes:
    """A node a standard deviation above the noise, from where the ramp is what it would be without: it starts at the
    background's level.
    """
    if ground is None or not low < low + ground.noise < high:
        return ()
    value = low + ground.noise
    return ((value, SURFACE * (value - ground.level) / (high - ground.level)),)


def solid(stats: Statistics, rung: int | None) -> Look:
    """Everything above the lowest value, opaque."""
    lowest, highest = float(stats.values[0]), float(stats.values[-1])
    step = lowest + (float(stats.values[stats.values > lowest][0]) - lowest) / 2
    return Look(((step, 0.0), (step, SOLID)), (lowest, highest))


def field(stats: Statistics, rung: int | None) -> Look:
    """A long ramp, clear below the median: semi-transparent. The colours span all values but the largest few."""
    low, clear, high = (stats.percentile(percent) for percent in (0.0, 50.0, 99.9))
    return Look(((clear, 0.0), (high, FIELD)), (low, high) if low < high else None)


def cut_of(stats: Statistics, rung: int | None) -> Cut:
    """The threshold of a rung, or of the whole object."""
    return stats.cuts[min(stats.whole if rung is None else rung, len(stats.cuts) - 1)]

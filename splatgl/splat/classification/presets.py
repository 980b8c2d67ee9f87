"""Ready-made transfer functions: presets by name, and an automatic choice from the data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from splatgl.data.errors import expected
from splatgl.data.volume import Volume
from splatgl.splat.classification.ground import Ground
from splatgl.splat.classification.statistics import Cut, Statistics, few_values, statistics
from splatgl.splat.classification.transfer import Nodes, Transfer

# opacities of a surface just above its cut, of the brightest matter, and of single-valued objects
SURFACE, CORE, SOLID = 0.8, 0.95, 0.99
# position of a surface's value in its colour map
SURFACE_TONE = 0.6
# extent of a surface's ramp, as a share of the way from its cut to the two class means
RAMP = 0.3
# percentiles of a sparse volume's non-background values: the dimmest visible, and the brightest
DIM, BRIGHT = 1.0, 70.0
# Hounsfield units: air is −1000, water 0, bone from about 200; scanners pad down to −4096 at most
AIR, PADDING = (-1100.0, -800.0), -4096.0
BONE_FROM = 300.0
# smallest shares of a CT's values that are air, and bone
AIR_SHARE, BONE_SHARE = 0.02, 0.003


@dataclass(frozen=True)
class Look:
    """A preset's result for one volume: opacity nodes and the colour map's window."""

    points: Nodes
    window: tuple[float, float] | None = None


@dataclass(frozen=True)
class Preset:
    """A named look. hounsfield: the look of a CT in HU. rung: index of the ramp's cut; None: the object's own."""

    name: str
    about: str
    colormap: str
    build: Callable[[Statistics, int | None], Look]
    rung: int | None = None
    hounsfield: Look | None = None
    shading: bool = True


def _surface(stats: Statistics, rung: int | None) -> Look:
    """A ramp over a cut: transparent below, a surface above, denser towards the brightest."""
    low, high = _cut(stats, rung).ramp(RAMP)
    top = max(high, stats.percentile(99.9))
    return Look(((low, 0.0), (high, SURFACE), (top, CORE)), _lit(low, top))


def _soft(stats: Statistics, rung: int | None) -> Look:
    """A long ramp from the cut to the brightest: semi-transparent."""
    low = _cut(stats, rung).ramp(RAMP)[0]
    top = max(low, stats.percentile(99.9))
    return Look(((low, 0.0), (top, SURFACE)))


def _glow(stats: Statistics, rung: int | None) -> Look:
    """A ramp from half the dimmest value above the background, or above its noise, to the BRIGHT percentile."""
    lowest = float(stats.values[0])
    low = lowest if stats.sparse else _cut(stats, rung).ramp(RAMP)[0]
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


def _solid(stats: Statistics, rung: int | None) -> Look:
    """Everything above the lowest value, opaque."""
    lowest, highest = float(stats.values[0]), float(stats.values[-1])
    step = lowest + (float(stats.values[stats.values > lowest][0]) - lowest) / 2
    return Look(((step, 0.0), (step, SOLID)), (lowest, highest))


def _lit(low: float, high: float) -> tuple[float, float] | None:
    """A window that puts the surface value `low` at SURFACE_TONE of the colour map, so that it isn't dark."""
    bottom = low - (high - low) * SURFACE_TONE / (1.0 - SURFACE_TONE)
    return (bottom, high) if bottom < high else None


def _cut(stats: Statistics, rung: int | None) -> Cut:
    return stats.cuts[min(stats.whole if rung is None else rung, len(stats.cuts) - 1)]


BONE_HU = Look(((150.0, 0.0), (350.0, SURFACE), (1200.0, CORE)), (-600.0, 1200.0))
SOFT_HU = Look(((-350.0, 0.0), (-50.0, 0.5), (300.0, SURFACE), (1200.0, CORE)), (-700.0, 400.0))
PRESETS = {
    preset.name: preset
    for preset in (
        Preset("ct-bone", "bone and metal of a CT", "ivory", _surface, 1, BONE_HU),
        Preset("ct-soft", "skin and soft tissue of a CT", "flesh", _surface, 0, SOFT_HU),
        Preset("mri", "the whole object, its inside showing through", "gray", _soft, 0),
        Preset("microscopy", "bright structures on a dark ground", "glow", _glow, shading=False),
        Preset("terrain", "everything above the lowest value, opaque", "terrain", _solid),
        Preset("surface", "the object's surface", "ivory", _surface),
    )
}


def preset(name: str, volume: Volume) -> Transfer:
    """The preset's Transfer for this volume's values. Raises InputError for an unknown name."""
    if name not in PRESETS:
        raise expected("preset", f"one of {', '.join(PRESETS)}", repr(name))
    return _built(PRESETS[name], statistics(volume))


def default_transfer(volume: Volume) -> Transfer:
    """The volume's own hints if any; the rest chosen from its values to show the object."""
    hints = volume.hints
    if hints.points is not None:
        chosen = Transfer(hints.points)
    elif hints.preset is not None:
        chosen = preset(hints.preset, volume)
    elif hints.window is not None:
        chosen = Transfer(((hints.window[0], 0.0), (hints.window[1], SURFACE)))
    else:
        chosen = _from_values(volume)
    given = {name: getattr(hints, name) for name in ("window", "unit", "colormap", "shading")}
    return replace(chosen, **{name: value for name, value in given.items() if value is not None})


def _from_values(volume: Volume) -> Transfer:
    stats = statistics(volume)
    whole = volume.samples.dtype.kind in "bui" and stats.ground is None
    if whole and not stats.constant and few_values(stats.values):
        return replace(_built(PRESETS["terrain"], stats), colormap="ivory" if _two(stats) else "viridis")
    if stats.sparse:
        return _built(PRESETS["microscopy"], stats)
    if _is_hounsfield(stats):
        return _built(PRESETS["ct-bone" if stats.share_above(BONE_FROM) >= BONE_SHARE else "ct-soft"], stats)
    return _built(PRESETS["surface"], stats)


def _built(chosen: Preset, stats: Statistics) -> Transfer:
    if stats.constant:
        value = float(stats.values[0]) if len(stats.values) else 0.0
        look = Look(((value, SOLID if len(stats.values) else 0.0),))
    elif chosen.hounsfield and _is_hounsfield(stats):
        look = chosen.hounsfield
    else:
        look = chosen.build(stats, chosen.rung)
    return Transfer(look.points, chosen.colormap, look.window, shading=chosen.shading)


def _is_hounsfield(stats: Statistics) -> bool:
    """True for CT-like values: air near −1000, matter above 0, nothing below the scanners' padding."""
    air = stats.share_above(AIR[0]) - stats.share_above(AIR[1])
    return stats.values[0] >= PADDING and air >= AIR_SHARE and stats.share_above(-200.0) >= AIR_SHARE


def _two(stats: Statistics) -> bool:
    return len(np.unique(stats.values)) == 2

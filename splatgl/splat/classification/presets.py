"""Ready-made transfer functions: presets by name, and an automatic choice from the data."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches

import numpy as np

from splatgl.data.errors import expected
from splatgl.data.volume import Volume
from splatgl.splat.classification.labels import labels_of, shown_labels
from splatgl.splat.classification.statistics import Cut, Statistics, statistics
from splatgl.splat.classification.transfer import Nodes, Transfer

# opacities of a surface just above its cut, of the brightest matter, and of single-valued objects
SURFACE, CORE, SOLID = 0.8, 0.95, 0.99
# opacity of a field's largest values
MIST = 0.4
# floats of more different values, in a file without anatomy, are computed: no camera or scanner tells so many apart
COMPUTED = 1 << 16
# second over first differences of neighbours below which a field is smooth: simulations 0.1 to 1.1, scanners 1.2 to 2
# and more, noise 3
SMOOTH = 1.15
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
# integer volumes with at most this many different values are labels
LABELS = 32


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
    """A ramp from half the dimmest value above the background to the BRIGHT percentile."""
    lowest = float(stats.values[0])
    low = lowest if stats.sparse else _cut(stats, rung).ramp(RAMP)[0]
    dim, high = np.percentile(stats.values[stats.values > low], [DIM, BRIGHT])
    low = lowest + (float(dim) - lowest) / 2 if stats.sparse else low
    return Look(((low, 0.0), (max(low, float(high)), SURFACE)))


def _solid(stats: Statistics, rung: int | None) -> Look:
    """Everything above the lowest value, opaque."""
    lowest, highest = float(stats.values[0]), float(stats.values[-1])
    step = lowest + (float(stats.values[stats.values > lowest][0]) - lowest) / 2
    return Look(((step, 0.0), (step, SOLID)), (lowest, highest))


def _field(stats: Statistics, rung: int | None) -> Look:
    """A ramp from the median to the brightest, semi-transparent; colours over all of the range."""
    low, high = stats.percentile(50), stats.percentile(99.9)
    return Look(((low, 0.0), (max(low, high), MIST)), (float(stats.values[0]), float(stats.values[-1])))


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
        Preset("field", "a field of a simulation, its larger values as mist", "viridis", _field, shading=False),
        Preset("surface", "the object's surface", "ivory", _surface),
    )
}


def preset(name: str, volume: Volume) -> Transfer:
    """The preset's Transfer for this volume's values; names in any case. Raises InputError for an unknown name."""
    if name.lower() not in PRESETS:
        near = get_close_matches(name.lower(), PRESETS, n=1)
        raise expected("preset", f"one of {', '.join(PRESETS)}", repr(name), f"did you mean {near[0]}?" if near else "")
    return _built(PRESETS[name.lower()], statistics(volume))


def default_transfer(volume: Volume) -> Transfer:
    """The volume's own hints if any; the rest chosen from its values to show the object; labels in their colours."""
    if volume.labels is not None:
        return label_transfer(volume)
    hints = volume.hints
    if hints.points is not None:
        chosen = Transfer(hints.points)
    elif hints.preset is not None:
        chosen = preset(hints.preset, volume)
    elif hints.window is not None:
        chosen = Transfer(((hints.window[0], 0.0), (hints.window[1], SURFACE)))
    else:
        chosen = _from_values(volume)
    if hints.color is not None:
        # a channel: its colour, as bright as it is opaque
        return replace(chosen, colormap=hints.color, unit=hints.unit, shading=False)
    given = {name: getattr(hints, name) for name in ("window", "unit", "colormap", "shading")}
    return replace(chosen, **{name: value for name, value in given.items() if value is not None})


def label_transfer(volume: Volume, only: Sequence[tuple[int, float]] | None = None) -> Transfer:
    """The Transfer of a segmentation. only: numbers of the labels that are shown, and factors of their opacities.
    Raises InputError for samples that are no labels, and for other numbers.
    """
    shown = shown_labels(labels_of(volume), only)
    numbers = [number for number, _, _ in shown] or [0]
    return Transfer(((min(numbers), 0.0), (max(numbers), SOLID)), labels=shown)


def _from_values(volume: Volume) -> Transfer:
    stats = statistics(volume)
    if volume.samples.dtype.kind in "bui" and not stats.constant and len(np.unique(stats.values)) <= LABELS:
        if not _two(stats):
            return label_transfer(volume)
        return replace(_built(PRESETS["terrain"], stats), colormap="ivory")
    if stats.sparse:
        return _built(PRESETS["microscopy"], stats)
    if _is_hounsfield(stats):
        return _built(PRESETS["ct-bone" if stats.share_above(BONE_FROM) >= BONE_SHARE else "ct-soft"], stats)
    if _is_computed(volume, stats):
        return _built(PRESETS["field"], stats)
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


def _is_computed(volume: Volume, stats: Statistics) -> bool:
    """True for a simulation's fields: smooth floats without anatomy, more than a scanner tells apart."""
    if volume.samples.dtype.kind != "f" or volume.frame is not None or len(np.unique(stats.values)) <= COMPUTED:
        return False
    middle = np.asarray(volume.samples[volume.shape[0] // 2], np.float64)
    middle = np.where(np.isfinite(middle), middle, stats.values[0])
    slope, bend = np.abs(middle[:, 2:] - middle[:, :-2]) / 2, np.abs(np.diff(middle, 2, axis=1))
    some = slope + bend > 0
    return bool(some.any()) and float(np.median(bend[some])) < SMOOTH * float(np.median(slope[some]))


def _two(stats: Statistics) -> bool:
    return len(np.unique(stats.values)) == 2

"""Ready-made transfer functions: presets by name, and an automatic choice from the data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from difflib import get_close_matches

import numpy as np

from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.readers.common import FIELD, is_field
from splatgl.splat.classification.flatness import LABELS, MASK, kind_of
from splatgl.splat.classification.labels import labels_of, shown_labels
from splatgl.splat.classification.looks import CORE, SOLID, SURFACE, Look, Preset, field, glow, soft, solid, surface
from splatgl.splat.classification.medical import MEDICAL
from splatgl.splat.classification.statistics import Statistics, sorted_percentile, statistics
from splatgl.splat.classification.transfer import Transfer

# Hounsfield units: air is −1000, water 0, bone from about 200; scanners pad down to −4096 at most
AIR, PADDING = (-1100.0, -800.0), -4096.0
BONE_FROM = 300.0
# smallest shares of a CT's values that are air, and bone
AIR_SHARE, BONE_SHARE = 0.02, 0.003
# units of length of scanners and microscopes, which see objects
OF_OBJECTS = ("mm", "um", "µm", "nm", "Å")
# computed values are nearly all different, of MANY every so many
MANY, EVERY, DIFFERENT = 4096, 16, 0.5
# second over first differences of neighbours below which a field is smooth: simulations 0.1 to 1.1, scanners 1.2 to 2
# and more, noise 3
SMOOTH = 1.15
# largest ratio of values on a logarithmic scale: values classified after reconstruction are told apart in 2⁻¹⁴ of it
MOST_RATIO = 1e4

BONE_HU = Look(((150.0, 0.0), (350.0, SURFACE), (1200.0, CORE)), (-600.0, 1200.0))
SOFT_HU = Look(((-350.0, 0.0), (-50.0, 0.5), (300.0, SURFACE), (1200.0, CORE)), (-700.0, 400.0))
PRESETS = {
    preset.name: preset
    for preset in (
        Preset("ct-bone", "bone and metal of a CT", "ivory", surface, 1, BONE_HU),
        Preset("ct-soft", "skin and soft tissue of a CT", "flesh", surface, 0, SOFT_HU),
        Preset("mri", "the whole object, its inside showing through", "gray", soft, 0),
        Preset("microscopy", "bright structures on a dark ground", "glow", glow, shading=False),
        Preset("terrain", "everything above the lowest value, opaque", "terrain", solid),
        Preset("surface", "the object's surface", "ivory", surface),
        Preset(FIELD, "a field of a simulation, its larger values denser", "viridis", field, shading=False),
        *MEDICAL,
    )
}
# other names, in lower case
ALIASES = {"ct-soft-tissue": "ct-soft", "mr-mip": "mip", "ct-mip": "mip"}
# as many near names are told of an unknown one
NEAR = 4


def preset(name: str, volume: Volume) -> Transfer:
    """The preset's Transfer for this volume's values. Raises InputError for an unknown name."""
    chosen = preset_named(name)
    return _built(chosen, statistics(volume))


def is_preset(name: str) -> bool:
    """Whether there is a preset of that name."""
    return _key(name) in PRESETS


def _key(name: str) -> str:
    lower = name.lower().replace("_", "-").replace(" ", "-")
    return ALIASES.get(lower, lower)


def preset_named(name: str) -> Preset:
    """The preset of a name, in any case. Raises InputError for an unknown name, which tells near ones."""
    lower = _key(str(name))
    found = PRESETS.get(lower)
    if found is None:
        known = [*PRESETS, *ALIASES]
        near = list(dict.fromkeys([each for each in known if lower and lower in each]))
        near += [each for each in get_close_matches(lower, known, NEAR) if each not in near]
        raise expected("preset", f"one of {', '.join(near or PRESETS)}", repr(name), "splatgl presets lists all")
    return found


def logarithmic(base: Transfer, volume: Volume) -> Transfer:
    """The colours of a transfer function over the logarithms of a volume's positive values, the larger ones denser.

    Raises InputError for a volume without positive values.
    """
    values = statistics(volume).values
    values = values[values > 0]
    if len(values) == 0:
        raise expected("scale", "positive values, for their logarithms", f"none in {volume.name or 'the volume'}")
    low, clear, high = (sorted_percentile(values, percent) for percent in (0.0, 50.0, 99.99))
    low = max(low, high / MOST_RATIO)
    points = ((max(low, clear), 0.0), (high, SURFACE))
    return replace(base, points=points, window=(low, high) if low < high else None, scale="log")


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


def is_microscopy(volume: Volume) -> bool:
    """Whether its values are those of bright structures on a dark ground."""
    chosen = volume.hints.preset or _chosen(volume, statistics(volume))
    return chosen == "microscopy"


def label_transfer(volume: Volume, only: Sequence[tuple[int, float]] | None = None) -> Transfer:
    """The Transfer of a segmentation. only: numbers of the labels that are shown, and factors of their opacities.
    Raises InputError for samples that are no labels, and for other numbers.
    """
    shown = shown_labels(labels_of(volume), only)
    numbers = [number for number, _, _ in shown] or [0]
    return Transfer(((min(numbers), 0.0), (max(numbers), SOLID)), labels=shown)


def _from_values(volume: Volume) -> Transfer:
    kind = volume.hints.values or kind_of(volume)[0]
    stats = statistics(volume)
    several = len(np.unique(stats.values)) > 2
    # a picture's colours are no names, however few they are
    if (kind == LABELS or (kind == MASK and several)) and volume.color is None:
        return label_transfer(volume)
    if kind == MASK and not stats.constant:
        return replace(_built(PRESETS["terrain"], stats), colormap="ivory")
    return _built(PRESETS[_chosen(volume, stats)], stats)


def _chosen(volume: Volume, stats: Statistics) -> str:
    """The name of the preset that shows what the values tell of."""
    computed = _is_computed(volume, stats)
    if computed and is_field(volume.name):
        return FIELD
    if stats.sparse:
        return "microscopy"
    if _is_hounsfield(stats):
        return "ct-bone" if stats.share_above(BONE_FROM) >= BONE_SHARE else "ct-soft"
    return FIELD if computed and _is_smooth(volume, float(stats.values[0])) else "surface"


def _is_computed(volume: Volume, stats: Statistics) -> bool:
    """Whether the values above the lowest are nearly all different, in a file without anatomy: no scanner's are,
    which are whole numbers in any type.
    """
    if volume.frame is not None or volume.unit in OF_OBJECTS or stats.constant:
        return False
    if (stats.values == np.rint(stats.values)).all():
        return False
    above = stats.values[np.searchsorted(stats.values, stats.values[0], side="right") :]
    some = above[:: EVERY if len(above) > MANY else 1]
    return len(some) > 1 and bool(np.count_nonzero(np.diff(some)) >= DIFFERENT * (len(some) - 1))


def _is_smooth(volume: Volume, empty: float) -> bool:
    """Whether neighbours in the middle plane differ as a simulation's. empty: stands for values that aren't finite."""
    middle = np.asarray(volume.samples[volume.shape[0] // 2], np.float64)
    middle = np.where(np.isfinite(middle), middle, empty)
    with np.errstate(over="ignore", invalid="ignore"):
        slope, bend = np.abs(middle[:, 2:] - middle[:, :-2]) / 2, np.abs(np.diff(middle, 2, axis=1))
    some = slope + bend > 0
    return bool(some.any()) and float(np.median(bend[some])) < SMOOTH * float(np.median(slope[some]))


def _built(chosen: Preset, stats: Statistics) -> Transfer:
    if stats.constant:
        value = float(stats.values[0]) if len(stats.values) else 0.0
        look = Look(((value, SOLID if len(stats.values) else 0.0),))
    elif chosen.hounsfield and _is_hounsfield(stats):
        look = chosen.hounsfield
    else:
        look = chosen.build(stats, chosen.rung)
    colors = f"{chosen.colormap}[{look.tone:g}:]" if look.tone else chosen.colormap
    return Transfer(look.points, colors, look.window, shading=chosen.shading)


def _is_hounsfield(stats: Statistics) -> bool:
    """True for CT-like values: air near −1000, matter above 0, nothing below the scanners' padding."""
    air = stats.share_above(AIR[0]) - stats.share_above(AIR[1])
    return stats.values[0] >= PADDING and air >= AIR_SHARE and stats.share_above(-200.0) >= AIR_SHARE

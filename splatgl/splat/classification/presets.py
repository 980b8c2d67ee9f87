"""Ready-made transfer functions: presets by name, and an automatic choice from the data."""

from __future__ import annotations

from dataclasses import replace
from difflib import get_close_matches

import numpy as np

from splatgl.data.errors import expected
from splatgl.data.quantities import FIELD, is_field
from splatgl.data.volume import Volume
from splatgl.splat.classification.looks import CORE, SOLID, SURFACE, Look, Preset, field, glow, soft, solid, surface
from splatgl.splat.classification.medical import MEDICAL
from splatgl.splat.classification.statistics import Statistics, few_values, sorted_percentile, statistics
from splatgl.splat.classification.transfer import Transfer

__all__ = ["BONE_HU", "PRESETS", "SOLID", "default_transfer", "is_microscopy", "logarithmic", "preset", "preset_named"]

# Hounsfield units: air is −1000, water 0, bone from about 200; scanners pad down to −4096 at most
AIR, PADDING = (-1100.0, -800.0), -4096.0
BONE_FROM = 300.0
# smallest shares of a CT's values that are air, and bone
AIR_SHARE, BONE_SHARE = 0.02, 0.003
# units of length of scanners and microscopes, which see objects
OF_OBJECTS = ("mm", "um", "µm", "nm", "Å")
# computed values are nearly all different, of MANY every so many; they have no two classes so far apart, as a share of
# their variance
MANY, EVERY, DIFFERENT, APART = 4096, 16, 0.5, 0.68
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


def preset_named(name: str) -> Preset:
    """The preset of a name, in any case. Raises InputError for an unknown name, which tells near ones."""
    lower = str(name).lower().replace("_", "-").replace(" ", "-")
    found = PRESETS.get(ALIASES.get(lower, lower))
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


def is_microscopy(volume: Volume) -> bool:
    """Whether its values are those of bright structures on a dark ground."""
    chosen = volume.hints.preset or _chosen(volume, statistics(volume))
    return chosen == "microscopy"


def _from_values(volume: Volume) -> Transfer:
    stats = statistics(volume)
    if _is_labels(volume, stats):
        return replace(_built(PRESETS["terrain"], stats), colormap="ivory" if _two(stats) else "viridis")
    return _built(PRESETS[_chosen(volume, stats)], stats)


def _chosen(volume: Volume, stats: Statistics) -> str:
    """The name of the preset that shows what the values tell of."""
    computed = _may_be_field(volume) and not stats.constant and _is_computed(stats)
    if computed and is_field(volume.name):
        return FIELD
    if stats.sparse:
        return "microscopy"
    if _is_hounsfield(stats):
        return "ct-bone" if stats.share_above(BONE_FROM) >= BONE_SHARE else "ct-soft"
    return FIELD if computed and _is_one_class(stats) else "surface"


def _is_labels(volume: Volume, stats: Statistics) -> bool:
    whole = volume.samples.dtype.kind in "bui" and stats.ground is None
    return whole and not stats.constant and few_values(stats.values)


def _may_be_field(volume: Volume) -> bool:
    return volume.samples.dtype.kind == "f" and volume.frame is None and volume.unit not in OF_OBJECTS


def _is_computed(stats: Statistics) -> bool:
    """Whether the values above the lowest are nearly all different, as no scanner's are."""
    above = stats.values[np.searchsorted(stats.values, stats.values[0], side="right") :]
    some = above[:: EVERY if len(above) > MANY else 1]
    return len(some) > 1 and bool(np.count_nonzero(np.diff(some)) >= DIFFERENT * (len(some) - 1))


def _is_one_class(stats: Statistics) -> bool:
    """Whether values above and below the first cut are no further apart than those of one class."""
    cut, above = stats.cuts[0], stats.share_above(stats.cuts[0].value)
    # squares that float64 holds
    largest = max(abs(float(stats.values[0])), abs(float(stats.values[-1])))
    apart = cut.above / largest - cut.below / largest
    return above * (1 - above) * apart**2 < APART * float((stats.values[::EVERY] / largest).var())


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

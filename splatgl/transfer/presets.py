"""Transfer functions by name, and the default for a volume.

Presets of CT are in Hounsfield units. For other values, their classes take the places of the tissues; see `adapt_look`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np

from splatgl.coercion import public
from splatgl.data.fills import distinct
from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.options import read_pairs
from splatgl.readers.common import FIELD, is_field
from splatgl.transfer.colormaps import base_name, labels_of, select_labels
from splatgl.transfer.label_detection import LABELS, MASK, kind_of
from splatgl.transfer.statistics import (
    NOISY,
    ClassThreshold,
    NoiseBackground,
    Statistics,
    background_of,
    is_constant,
    sorted_percentile,
    statistics,
    values_of_planes,
)
from splatgl.transfer.transfer import Nodes, Transfer

if TYPE_CHECKING:
    from splatgl.splat.settings import Blend, Settings

# opacities of a surface just above its cut, of the brightest values, and of single-valued objects
SURFACE, CORE, SOLID = 0.8, 0.95, 0.99
# opacity of the largest values of a field, per mean spacing
FIELD_OPACITY = 0.5
# position of a surface's value in its colour map
SURFACE_TONE = 0.6
# extent of a surface's ramp, as a share of the distance from its cut to the two class means
RAMP = 0.3
# percentiles of a sparse volume's foreground: the dimmest visible value, and the brightest
DIM, BRIGHT = 1.0, 99.0


@dataclass(frozen=True)
class PresetCurve:
    """Opacity nodes and colour window of a preset for one volume. tone: place in the colour map where the window
    begins.
    """

    points: Nodes
    window: tuple[float, float] | None = None
    tone: float = 0.0


@dataclass(frozen=True)
class Preset:
    """A named transfer function. hounsfield: the look of a CT in HU. rung: index of the ramp's cut; None: the cut
    between object and surroundings. blend: default blend mode; None: the settings' default.
    """

    name: str
    about: str
    colormap: str
    build: Callable[[Statistics, int | None], PresetCurve]
    rung: int | None = None
    hounsfield: PresetCurve | None = None
    shading: bool = True
    blend: Blend | None = None


def surface(stats: Statistics, rung: int | None) -> PresetCurve:
    """A ramp over a cut: transparent below, a surface above, denser towards the brightest."""
    low, high = cut_of(stats, rung).ramp(RAMP)
    top = max(high, stats.percentile(99.9))
    # the window begins at a light colour
    return PresetCurve(((low, 0.0), (high, SURFACE), (top, CORE)), (low, top) if low < top else None, SURFACE_TONE)


def soft(stats: Statistics, rung: int | None) -> PresetCurve:
    """A long ramp from the cut to the brightest: semi-transparent."""
    low = cut_of(stats, rung).ramp(RAMP)[0]
    top = max(low, stats.percentile(99.9))
    return PresetCurve(((low, 0.0), (top, SURFACE)))


def glow(stats: Statistics, rung: int | None) -> PresetCurve:
    """A ramp from half the dimmest value above the background, or above its noise, to the BRIGHT percentile."""
    ground, lowest = stats.ground or stats.noise, float(stats.values[0])
    low = lowest if stats.sparse else cut_of(stats, rung).ramp(RAMP)[0]
    if ground is not None:
        low = ground.cut
    dim, high = np.percentile(stats.values[stats.values > low], [DIM, BRIGHT])
    if stats.sparse:
        low = max(lowest + (float(dim) - lowest) / 2, low)
    high = max(low, float(high))
    return PresetCurve(((low, 0.0), *_above_noise(ground, low, high), (high, SURFACE)))


def _above_noise(ground: NoiseBackground | None, low: float, high: float) -> Nodes:
    """A node one standard deviation above the cut, on the line from the background's level to the ramp's end."""
    if ground is None or not low < low + ground.noise < high:
        return ()
    value = low + ground.noise
    return ((value, SURFACE * (value - ground.level) / (high - ground.level)),)


def solid(stats: Statistics, rung: int | None) -> PresetCurve:
    """An opaque step above the lowest value."""
    lowest, highest = float(stats.values[0]), float(stats.values[-1])
    step = lowest + (float(stats.values[stats.values > lowest][0]) - lowest) / 2
    return PresetCurve(((step, 0.0), (step, SOLID)), (lowest, highest))


def cut_of(stats: Statistics, rung: int | None) -> ClassThreshold:
    """The cut of a rung; None: the cut between object and surroundings."""
    return stats.cuts[min(stats.whole if rung is None else rung, len(stats.cuts) - 1)]


# Hounsfield units of air, its border to tissue, soft tissue, its border to bone, bone, and the densest matter
LANDMARKS = (-1000.0, -400.0, 40.0, 180.0, 600.0, 1500.0)
# the same for an object with only two classes of values
TWO = (-1000.0, -400.0, 600.0, 1500.0)
# percentile of the densest matter
DENSEST = 99.9
Build = Callable[[Statistics, int | None], PresetCurve]


def adapt_look(look: PresetCurve) -> Build:
    """Returns a builder that maps a CT preset to other values: their classes replace the tissues."""

    def build(stats: Statistics, rung: int | None) -> PresetCurve:
        units, values = _landmarks(stats)

        def place(unit: float) -> float:
            return float(np.interp(unit, units, values))

        points = tuple((place(unit), opacity) for unit, opacity in look.points)
        low, high = (place(unit) for unit in look.window or (look.points[0][0], look.points[-1][0]))
        return PresetCurve(points, (low, high) if low < high else None)

    return build


def _landmarks(stats: Statistics) -> tuple[tuple[float, ...], np.ndarray]:
    """Hounsfield units and the corresponding values, both in ascending order."""
    first, top = stats.cuts[0], stats.percentile(DENSEST)
    if len(stats.cuts) < 2:
        return TWO, np.maximum.accumulate([first.below, first.value, first.above, top])
    second = stats.cuts[1]
    places = [first.below, first.value, second.below, second.value, second.above, top]
    return LANDMARKS, np.maximum.accumulate(places)


def _percentiles(*nodes: tuple[float, float], window: tuple[float, float]) -> Build:
    """Returns a builder with nodes at percentiles of the values."""

    def build(stats: Statistics, rung: int | None) -> PresetCurve:
        points = tuple((stats.percentile(percent), opacity) for percent, opacity in nodes)
        low, high = (stats.percentile(percent) for percent in window)
        return PresetCurve(points, (low, high) if low < high else None)

    return build


# a long, semi-transparent ramp from the median up, whose colours span all values except the largest few
FIELD_CURVE = _percentiles((50.0, 0.0), (DENSEST, FIELD_OPACITY), window=(0.0, DENSEST))


def _maxima(stats: Statistics, rung: int | None) -> PresetCurve:
    """A ramp from the dimmest values, or from above the noise of the background, to the brightest."""
    high = stats.percentile(99.95)
    low = _clear_of_noise(stats, stats.percentile(1.0), high)
    return PresetCurve(((low, 0.0), (high, SOLID)), (low, high) if low < high else None)


def _clear_of_noise(stats: Statistics, low: float, high: float) -> float:
    """The low end of a window of maxima to `high`: at least a standard deviation above the cut of the noise, of which
    a ray has many samples.
    """
    least = low if stats.noise is None else stats.noise.cut + stats.noise.noise
    return max(low, least) if least < high else low


def _mr(stats: Statistics, rung: int | None) -> PresetCurve:
    """Opacity grows with the value from faint outer layers, so that skin and skull do not hide the inside."""
    low, high = cut_of(stats, rung).ramp(RAMP)
    top = max(high, stats.percentile(DENSEST))
    points = ((low, 0.0), (high, 0.12), (high / 2 + top / 2, 0.35), (top, 0.6))
    return PresetCurve(points, (min(low, stats.percentile(1.0)), top))


def _fraction(stats: Statistics, rung: int | None) -> PresetCurve:
    """A ramp over anisotropies from 0 to 1; other values are scaled to their largest."""
    top = 1.0 if stats.values[0] >= 0 and 0.3 < stats.values[-1] <= 1 else max(stats.percentile(DENSEST), 0.0)
    low = 0.0 if top > 0 else float(stats.values[0])
    points = tuple((low + share * (top - low), opacity) for share, opacity in ((0.15, 0), (0.35, 0.15), (0.8, 0.9)))
    return PresetCurve(points, (low, top) if low < top else None)


# looks of CT: name, colour map, window and opacities at Hounsfield units, and what they show
CT = """
ct-aaa vessels 100,900 140:0,190:.35,320:.8,900:.95 the aorta and its branches with contrast, and bone
ct-air airways -950,-400 -900:0,-700:.25,-550:.25,-450:0 where air ends: skin, airways and lungs from within
ct-bones bone -700,700 230:0,280:.95,1500:.99 bone alone, its surface hard
ct-cardiac heart -50,500 20:0,90:.04,150:.12,230:.6,500:.9 heart and great vessels with contrast, through faint muscle
ct-chest-contrast chest -200,700 -150:0,-60:.03,60:.06,130:.15,220:.7,700:.95 vessels and bone through skin and muscle
ct-coronary-arteries coronary 120,700 180:0,260:.85,700:.99 thin vessels with contrast, and calcium white
ct-lung lungs -950,100 -950:0,-800:.02,-600:.12,-300:.3,-100:.1,0:0 lungs: their tissue faint, vessels and airways in it
ct-skin flesh -700,100 -400:0,-200:.95,1500:.99 skin alone, its surface hard
ct-muscle muscle -60,180 -10:0,40:.5,110:.6,180:.05,250:0 muscle and organs, without fat and bone
ct-fat fat -180,0 -160:0,-115:.5,-75:.5,-20:0 fat alone, under the skin and around organs
ct-liver-vasculature liver 60,350 70:0,100:.05,140:.08,190:.7,350:.9 vessels with contrast in a faint liver
"""


def _ct(row: str) -> Preset:
    name, colormap, window, opacities, about = row.split(maxsplit=4)
    low, high = map(float, window.split(","))
    look = PresetCurve(read_pairs(opacities), (low, high))
    return Preset(name, about, colormap, adapt_look(look), hounsfield=look)


MEDICAL = (
    *map(_ct, CT.strip().splitlines()),
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
    Preset("mip", "the largest value along each ray", "gray", _maxima, shading=False, blend="mip"),
)


# Hounsfield units: air is −1000, water 0, bone from about 200; scanners pad down to −4096 at most
AIR, PADDING = (-1100.0, -800.0), -4096.0
BONE_FROM = 300.0
# smallest shares of a CT's values that are air, and bone
AIR_SHARE, BONE_SHARE = 0.02, 0.003
# units of length of scanners and microscopes
OF_OBJECTS = ("mm", "um", "nm", "Å")
# share of distinct values in computed data; of more than MANY values only every EVERY-th is compared
MANY, EVERY, DIFFERENT = 4096, 16, 0.5
# second over first differences of neighbours below which a field is smooth: simulations 0.1 to 1.1, scanners 1.2 to 2
# and more, noise 3
SMOOTH = 1.15
# largest ratio of values on a logarithmic scale: the classification table resolves 2⁻¹⁴ of it
MOST_RATIO = 1e4

BONE_HU = PresetCurve(((150.0, 0.0), (350.0, SURFACE), (1200.0, CORE)), (-600.0, 1200.0))
SOFT_HU = PresetCurve(((-350.0, 0.0), (-50.0, 0.5), (300.0, SURFACE), (1200.0, CORE)), (-700.0, 400.0))
PRESETS = {
    preset.name: preset
    for preset in (
        Preset("ct-bone", "bone and metal of a CT", "ivory", surface, 1, BONE_HU),
        Preset("ct-soft", "skin and soft tissue of a CT", "flesh", surface, 0, SOFT_HU),
        Preset("mri", "the whole object, its inside showing through", "gray", soft, 0),
        Preset("microscopy", "bright structures on a dark ground", "glow", glow, shading=False),
        Preset("terrain", "everything above the lowest value, opaque", "terrain", solid),
        Preset("surface", "the object's surface", "ivory", surface),
        Preset(FIELD, "a field of a simulation, its larger values denser", "viridis", FIELD_CURVE, shading=False),
        *MEDICAL,
    )
}
# groups of presets, by the first parts of their names
GROUPS = {"CT": ("ct",), "MR": ("mr", "mri", "dti"), "Microscopy": ("microscopy", "mip"), "General": ()}
# other names, in lower case
ALIASES = {
    **{"ct-soft-tissue": "ct-soft", "mr-mip": "mip", "ct-mip": "mip"},
    **{"bone": "ct-bone", "fat": "ct-fat", "lung": "ct-lung", "muscle": "ct-muscle", "skin": "ct-skin"},
    "vessels": "ct-aaa",
}
# maximum number of similar names in the message for an unknown one
NEAR = 4


def presets() -> dict[str, str]:
    """Returns descriptions of all presets, by name."""
    return {name: preset.about for name, preset in PRESETS.items()}


def grouped_presets() -> dict[str, list[str]]:
    """Names of the presets by group."""
    group_of = {part: title for title, parts in GROUPS.items() for part in parts}
    groups: dict[str, list[str]] = {title: [] for title in GROUPS}
    for name in PRESETS:
        groups[group_of.get(name.partition("-")[0], "General")].append(name)
    return groups


@public
def preset(name: str, volume: Volume | Any) -> Transfer:
    """Transfer function of a preset for a volume's values. Raises InputError for an unknown name."""
    chosen = preset_named(name)
    return build_transfer(chosen, statistics(volume), volume)


def is_preset(name: str) -> bool:
    """Whether there is a preset of that name."""
    return _key(name) in PRESETS


def _key(name: str) -> str:
    lower = name.lower().replace("_", "-").replace(" ", "-")
    return ALIASES.get(lower, lower)


def preset_named(name: str) -> Preset:
    """The preset of a name, ignoring case. Raises InputError with similar names for an unknown one."""
    lower = _key(str(name))
    chosen = PRESETS.get(lower)
    if chosen is None:
        known = [*PRESETS, *ALIASES]
        near = list(dict.fromkeys([known_name for known_name in known if lower and lower in known_name]))
        near += [known_name for known_name in get_close_matches(lower, known, NEAR) if known_name not in near]
        raise expected("preset", f"one of {', '.join(near or PRESETS)}", repr(name), "splatgl presets lists all")
    return chosen


def logarithmic_transfer(base: Transfer, volume: Volume) -> Transfer:
    """The transfer function on a logarithmic scale over a volume's positive values; opacity grows with the value.

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


@public
def default_transfer(volume: Volume | Any) -> Transfer:
    """Default transfer function: from the volume's hints, else from its values; of labels, from their colours."""
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
        chosen = _transfer_from_values(volume)
    if hints.color is not None:
        # a channel: one colour, as bright as it is opaque
        chosen = chosen.inverted() if hints.inverted else chosen
        return replace(chosen, colormap=hints.color, unit=hints.unit, shading=False)
    hinted = {name: getattr(hints, name) for name in ("window", "unit", "colormap", "shading")}
    return replace(chosen, **{name: value for name, value in hinted.items() if value is not None})


def projection_transfer(base: Transfer, volume: Volume) -> Transfer:
    """The transfer function of maxima along rays for a volume whose own is `base`: a ramp over the window, in grey for
    surfaces, else in its colours. Volumes in colours of their own and segments keep `base`.
    """
    if base.labels or volume.color is not None:
        return base
    if base.shading:
        return preset("mip", volume)
    low, high = base.window or (base.points[0][0], base.points[-1][0])
    low = low if volume.hints.window else _clear_of_noise(statistics(volume), low, high)
    return over_window(base, low, high)


def over_window(base: Transfer, low: float, high: float) -> Transfer:
    """The transfer function with colours and a ramp of opacities over a window."""
    return replace(base, points=((low, 0.0), (high, SOLID)), window=(low, high)) if low < high else base


# voxels from which noise that is drawn costs more than a moment
DENSE = 1 << 20


def noise_note(volume: Volume, window: Sequence[float]) -> str:
    """A note on a window that begins in the noise of a large volume's background; "" if it does not."""
    if volume.count < DENSE or volume.labels is not None or volume.color is not None:
        return ""
    values, low = values_of_planes(volume), window[0]
    ground = background_of(values, NOISY)
    if ground is None or low >= ground.cut:
        return ""
    share = np.count_nonzero((values > low) & (values <= ground.cut)) / len(values)
    noise = f"the noise ({ground.level:.3g} ± {ground.noise:.2g}, {100 * share:.0f} % of the voxels)"
    note = f"{volume.name or 'the volume'}: the window begins at {low:g}, within {noise}; "
    return f"{note}one from {ground.cut:.3g} on leaves it out, and is drawn faster" if share >= NOISY else ""


# Hounsfield units that are a level by custom, of lungs, and of tissue with contrast up to bone
LEVELS = ((-700.0, -400.0), (20.0, 700.0))


def window_question(volume: Volume, window: Sequence[float]) -> str:
    """A note on a window that customs of CT write as level and width, such as 40,400; "" if it is none.

    A level of air or of fat is not one of theirs, and a width is at least twice as large as the level's size.
    """
    low, high = window
    is_custom = any(least <= low <= most for least, most in LEVELS) and high >= 2 * abs(low)
    # by the file or by their distribution
    is_ct = is_custom and (volume.value_unit == "HU" or (not volume.value_unit and _is_hounsfield(statistics(volume))))
    if not is_ct:
        return ""
    return (
        f"--window {low:g},{high:g} spans {low:g} to {high:g} HU; if they are level and width, "
        f"--level-width {low:g},{high:g} spans {low - high / 2:g} to {low + high / 2:g}"
    )


# Hounsfield units of slices, level 40 and width 400; percentiles of other values
SLICE_HU, SLICE_PERCENTILES = (-160.0, 240.0), (1.0, 99.5)
# of volumes: the default transfer function, and the window of slices, None for a single value
_slice_defaults: WeakKeyDictionary[Volume, tuple[Transfer, tuple[float, float] | None]] = WeakKeyDictionary()


def slice_colors(volume: Volume, transfer: Transfer) -> Transfer:
    """The transfer function in whose colours slices of a layer are drawn: its own; the default map of shaded surfaces
    is grey there, and their default window soft tissue of a CT, or nearly all values. Raises InputError for a volume
    without values.
    """
    if transfer.labels or volume.labels is not None or volume.color is not None:
        return transfer
    default, usual = slice_defaults(volume)
    if not default.shading or volume.hints.colormap or usual is None:
        return transfer
    # a window that is given has the whole map of surfaces
    is_usual = base_name(transfer.colormap) == base_name(default.colormap)
    colors = "gray" if is_usual else base_name(transfer.colormap)
    is_default = transfer.window == default.window and volume.hints.window is None
    return replace(transfer, colormap=colors, window=usual if is_default else transfer.window)


def slice_defaults(volume: Volume) -> tuple[Transfer, tuple[float, float] | None]:
    """The default transfer function of a volume, or of its series, and the window of its slices, None of one value.
    Raises InputError for a volume without values.
    """
    if volume.hints.slices is not None:
        return volume.hints.slices
    if volume not in _slice_defaults:
        stats = statistics(volume)
        if not len(stats.values):
            raise expected(volume.name or "slice", "finite samples", "none")
        low, high = SLICE_HU if _is_hounsfield(stats) else [stats.percentile(percent) for percent in SLICE_PERCENTILES]
        ends = (low, high) if low < high else (float(stats.values[0]), float(stats.values[-1]))
        _slice_defaults[volume] = default_transfer(volume), None if stats.constant else ends
    return _slice_defaults[volume]


def is_microscopy(volume: Volume) -> bool:
    """Whether the values look like bright structures on a dark background."""
    chosen = volume.hints.preset or _choose_preset(volume, statistics(volume))
    return chosen == "microscopy"


def label_transfer(volume: Volume, only: Sequence[tuple[int, float]] | None = None, is_part: bool = False) -> Transfer:
    """Transfer function of a segmentation. only: (number, opacity factor) of the labels to show; None: all. is_part:
    whether other volumes have labels, too: clear without any of `only`. Raises InputError for samples that are no
    labels, and for unknown numbers, unless it is a part.
    """
    labels = labels_of(volume)
    if is_part and only:
        numbers = {label.number for label in labels}
        only = [pair for pair in only if pair[0] in numbers]
        if not only:
            return label_transfer(volume).weakened(0.0)
    shown = select_labels(labels, only)
    return Transfer(() if shown else ((0.0, 0.0),), labels=shown)


def _transfer_from_values(volume: Volume) -> Transfer:
    kind = volume.hints.values or kind_of(volume)[0]
    stats = statistics(volume)
    several = len(distinct(stats.values)) > 2
    if volume.color is not None and kind in (LABELS, MASK) and not stats.constant:
        # few colours: the values, their brightness, are no labels, and only black is background
        return Transfer(((0.0, 0.0), (float(stats.values[stats.values > 0][0]), SOLID)))
    if kind == LABELS or (kind == MASK and several):
        return label_transfer(volume)
    if kind == MASK and not stats.constant:
        return replace(build_transfer(PRESETS["terrain"], stats, volume), colormap="ivory")
    return build_transfer(PRESETS[_choose_preset(volume, stats)], stats, volume)


def _choose_preset(volume: Volume, stats: Statistics) -> str:
    computed = _is_computed(volume, stats)
    if computed and is_field(volume.name):
        return FIELD
    if stats.sparse:
        return "microscopy"
    if _is_hounsfield(stats):
        return "ct-bone" if stats.share_above(BONE_FROM) >= BONE_SHARE else "ct-soft"
    return FIELD if computed and _is_smooth(volume, float(stats.values[0])) else "surface"


def _is_computed(volume: Volume, stats: Statistics) -> bool:
    """Whether nearly all values above the lowest are distinct, in a file without anatomy. Scanners, in contrast, store
    whole numbers in any type.
    """
    if volume.frame is not None or volume.unit in OF_OBJECTS or stats.constant:
        return False
    if (stats.values == np.rint(stats.values)).all():
        return False
    above = stats.values[np.searchsorted(stats.values, stats.values[0], side="right") :]
    some = above[:: EVERY if len(above) > MANY else 1]
    return len(some) > 1 and bool(np.count_nonzero(np.diff(some)) >= DIFFERENT * (len(some) - 1))


def _is_smooth(volume: Volume, empty: float) -> bool:
    """Whether the middle plane is as smooth as a simulation. empty: replaces values that are not finite."""
    middle = np.asarray(volume.samples[volume.shape[0] // 2], np.float64)
    middle = np.where(np.isfinite(middle), middle, empty)
    with np.errstate(over="ignore", invalid="ignore"):
        slope, bend = np.abs(middle[:, 2:] - middle[:, :-2]) / 2, np.abs(np.diff(middle, 2, axis=1))
    some = slope + bend > 0
    return bool(some.any()) and float(np.median(bend[some])) < SMOOTH * float(np.median(slope[some]))


# optical depth of a constant volume along its shortest side, so that its edges are seen
FOG = 1.5


def with_preset_blend(settings: Settings, name: str) -> Settings:
    """The settings with the blend of a preset, unless they specify one."""
    blend = preset_named(name).blend
    return settings if blend is None or "blend" in settings.given else replace(settings, blend=blend)


CONSTANT = "constant: all samples are"


def constant_note(volume: Volume) -> str:
    """A note on a volume of one value, whose picture shows its box; "" for others, and for points and colours."""
    level = volume.coarser[-1] if volume.coarser else volume
    if volume.points is not None or volume.color is not None or len(volume.channels) > 1:
        return ""
    plane = np.asarray(level.samples[level.shape[0] // 2])
    values = plane[np.isfinite(plane)] if plane.dtype.kind == "f" else plane
    if values.size and not is_constant(float(values.min()), float(values.max())):
        return ""
    stats = statistics(volume)
    is_seen = len(stats.values) > 0 and stats.constant
    return f"{CONSTANT} {stats.values[0]:g}, so that nothing is visible but the box" if is_seen else ""


def build_transfer(chosen: Preset, stats: Statistics, volume: Volume) -> Transfer:
    """Transfer function of a preset for a volume with these statistics of its values."""
    if stats.constant:
        value = float(stats.values[0]) if len(stats.values) else 0.0
        opacity = SOLID if chosen.blend else float(np.clip(-np.expm1(-FOG / volume.shortest), 0.01, SOLID))
        look = PresetCurve(((value, opacity if len(stats.values) else 0.0),))
    elif chosen.hounsfield and _is_hounsfield(stats):
        look = chosen.hounsfield
    else:
        look = chosen.build(stats, chosen.rung)
    colors = f"{chosen.colormap}[{look.tone:g}:]" if look.tone else chosen.colormap
    return Transfer(look.points, colors, look.window, shading=chosen.shading)


def _is_hounsfield(stats: Statistics) -> bool:
    """Whether values look like a CT's: air near −1000, matter above 0, nothing below the scanners' padding."""
    air = stats.share_above(AIR[0]) - stats.share_above(AIR[1])
    return stats.values[0] >= PADDING and air >= AIR_SHARE and stats.share_above(-200.0) >= AIR_SHARE

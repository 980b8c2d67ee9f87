"""`TransferChoice`: options of a transfer function that are not its fields, and the meaning of its table's keys."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.data.color import srgb_of_name
from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.options import HelpGroup, ValueKind, checked, declared, no_effect, option
from splatgl.transfer.colormaps import base_name
from splatgl.transfer.label_detection import AMOUNTS, LABELS
from splatgl.transfer.presets import default_transfer, noise_note, preset, window_question
from splatgl.transfer.regions import check_iso, check_regions, move_image
from splatgl.transfer.statistics import statistics
from splatgl.transfer.transfer import Transfer
from splatgl.transfer.transfer_nodes import color_map, curve_of, load_transfer, read_color_points

if TYPE_CHECKING:
    from splatgl.scene.scene_file import SceneFile
    from splatgl.splat.settings import Settings

# keys of a transfer function for channels: pairs of a channel and a colour, a window, or a look
CHANNEL_KEYS = ("color_of", "window_of", "look_of")
# keys of a transfer function that labels do not have
AMOUNT_KEYS = frozenset(
    ("points", "curve", "colormap", "colors", "window", "level_width", "scale", "gradient", "iso", "regions", "file")
)
# keys of the colours of amounts, and of the segments of a segmentation
COLOR_KEYS = ("colormap", "colors", "window", "level_width")
LABEL_KEYS = ("only_labels", "name_of", "names")
# keys of the names of segments
NAME_KEYS = ("name_of", "names")
# keys that clouds of points take, too
OF_POINTS = ("points", "shading")
# keys that state opacities
STATED = frozenset(("preset", "file", "points", "curve", "regions", "only_labels"))
# keys of the look that a preset or a file states
LOOK_KEYS = ("points", "curve", *COLOR_KEYS, "scale", "shading")
# keys that options replace
REPLACES: dict[str, tuple[str, ...]] = {
    **{"curve": ("points",), "points": ("curve",), "colormap": ("colors",)},
    **{"colors": ("colormap", "window", "level_width"), "window": ("level_width",), "level_width": ("window",)},
    "preset": ("file", *LOOK_KEYS),
    "file": ("preset", "unit", *LOOK_KEYS),
}
# number of a label
LABEL = ValueKind.whole(-(2**63), 2**63)


@dataclass(frozen=True)
class SeriesLook:
    """Transfer functions, without the scene's opacity, that the steps of a series share. transfer: None: the steps are
    segmentations, in the colours of their numbers. channels: of each, if there are several. slices: as of
    `slice_defaults`. steps: of whose values they are, of each channel one.
    """

    transfer: Transfer | None
    channels: tuple[Transfer, ...] = ()
    slices: tuple[Transfer, tuple[float, float] | None] | None = None
    steps: tuple[int, ...] = ()

    def marked(self, volume: Volume) -> Volume:
        """The volume as labels or amounts, as the series is, unless its file says which."""
        if volume.labels is not None or volume.hints.values or volume.channels:
            return volume
        if self.transfer is not None:
            return replace(volume, hints=replace(volume.hints, values=AMOUNTS))
        whole = volume.rounded()
        return volume if whole is None else whole.of_values(LABELS)


def read_channel_color(text: str) -> tuple[str, str]:
    """Returns the channel and #rrggbb of CHANNEL=COLOR. Raises ValueError for other text."""
    name, _, color = text.rpartition("=")
    if not name:
        raise ValueError
    return name, "#{:02x}{:02x}{:02x}".format(*srgb_of_name(color))


def read_channel_window(text: str) -> tuple[str, tuple[float, float]]:
    """Returns the channel and window of CHANNEL=LOW,HIGH. Raises ValueError for other text."""
    name, _, window = text.rpartition("=")
    if not name:
        raise ValueError
    low, high = ValueKind.interval().check(ValueKind.interval().read(window))
    return name, (low, high)


def read_channel_look(text: str) -> tuple[str, str]:
    """Returns the channel and look of CHANNEL=LOOK. Raises ValueError for other text."""
    name, _, look = text.rpartition("=")
    if not (name and look):
        raise ValueError
    return name, look


def read_label_name(text: str) -> tuple[int, str]:
    """Returns the number and name of NUMBER=NAME. Raises ValueError for other text."""
    number, _, name = text.partition("=")
    if not name.strip():
        raise ValueError
    return int(number), name.strip()


def read_labels(text: str) -> tuple[tuple[int, float], ...]:
    """Returns labels and opacity factors from N or N:A, separated by commas; () for "all". Raises ValueError."""
    pairs = [part.partition(":") for part in text.split(",")] if text != "all" else []
    return tuple((int(number), float(factor or 1)) for number, _, factor in pairs)


def several(value: Any) -> tuple[Any, ...]:
    """Returns one value or several as a tuple, () for ""."""
    if isinstance(value, list | tuple):
        return tuple(value)
    return () if isinstance(value, str) and not value else (value,)


def _labels(value: Any) -> tuple[tuple[int, float], ...]:
    """Returns labels and opacity factors of text, numbers, pairs or a mapping of them. Raises ValueError otherwise."""
    if isinstance(value, str):
        return read_labels(value)
    pairs = value.items() if isinstance(value, Mapping) else value
    rows = [pair if isinstance(pair, list | tuple) else (pair, 1.0) for pair in pairs]
    return tuple((LABEL.check(number), float(factor)) for number, factor in rows)


def _pairs_kind(
    this: str, read: Callable[[str], Any], metavar: str, hint: str, write: Callable[[Any], str] = str
) -> ValueKind:
    """Returns the kind of what `read` takes from each NAME=TEXT, of texts, pairs or a mapping.

    write: the text of a value.
    """

    def check(value: Any) -> tuple[Any, ...]:
        pairs = value.items() if isinstance(value, Mapping) else several(value)
        return tuple(read(pair if isinstance(pair, str) else f"{pair[0]}={write(pair[1])}") for pair in pairs)

    return ValueKind(this, check, read, metavar, hint=hint)


# level and width of radiologists' windows, Hounsfield units
CT_WINDOWS = {
    **{"abdomen": (50.0, 400.0), "bone": (400.0, 1800.0), "brain": (40.0, 80.0), "liver": (30.0, 150.0)},
    **{"lung": (-600.0, 1500.0), "mediastinum": (50.0, 350.0), "stroke": (40.0, 40.0)},
}


def _level_width(value: Any) -> tuple[float, float]:
    pair = ValueKind.numbers(2, "")
    named = CT_WINDOWS.get(value.lower()) if isinstance(value, str) else None
    level, width = named or (pair.read(value) if isinstance(value, str) else pair.check(value))
    if not (np.isfinite(level) and 0 < width < np.inf):
        raise ValueError
    return level, width


def _file_name(value: Any) -> str:
    if not isinstance(value, str | Path):
        raise ValueError
    return str(value)


_option = partial(option, group=HelpGroup.TRANSFER)


@dataclass(frozen=True)
class TransferChoice:
    """Options of a transfer function that are not its fields."""

    preset: str = _option(
        "", ValueKind.instance("a name", str), "ct-bone, mr-angio, mip, …: splatgl presets lists all", level="basic"
    )
    curve: str = _option(
        "",
        ValueKind.instance("a shape and its values", str, metavar="SHAPE[:VALUES[:A]]"),
        "opacity by a shape: ramp:60,120, band:50%,90%:0.4, tent. Or step, sigmoid, gate; VALUES: values or "
        "percentiles (default: from the object to the 99.9th); A: highest opacity (default 0.8)",
    )
    colors: str = _option(
        "",
        replace(
            ValueKind.instance("colours at values", str, list, tuple, metavar="V:COLOUR,…"), hint="str | Sequence[Any]"
        ),
        "colours at values or percentiles, such as 60:red,95%:#ffd0a0, between which they are mixed",
    )
    level_width: tuple[float, float] | None = _option(
        None,
        ValueKind(
            f"a level and a width above 0, as two numbers, or {', '.join(CT_WINDOWS)}",
            _level_width,
            _level_width,
            "LEVEL,WIDTH|NAME",
            hint="Numbers | str",
        ),
        "middle and width of the values that the colours span, as radiologists write --window; of a CT also bone, "
        "brain, lung, abdomen, …",
    )
    file: str = _option(
        "",
        ValueKind.instance("a file", str, metavar="FILE"),
        "a saved transfer function: .toml, 3D Slicer's .vp, or ParaView's .json",
        flag="--transfer",
    )
    only_labels: tuple[tuple[int, float], ...] = _option(
        (),
        ValueKind(
            "labels N or N:A",
            _labels,
            read_labels,
            "N[:A],N…",
            written="labels N or N:A, separated by commas, or all",
            hint="str | Sequence[int | tuple[int, float]] | Mapping[int, float]",
        ),
        "labels of a segmentation to show, or all. A: a factor of their opacity",
    )
    name_of: tuple[tuple[int, str], ...] = _option(
        (),
        _pairs_kind("a whole number and a name", read_label_name, "NUMBER=NAME", "Mapping[int, str] | Sequence[str]"),
        "name of a segment, instead of the file's, by the number of its voxels (repeatable)",
        repeat=True,
    )
    names: str = _option(
        "",
        ValueKind("a file", _file_name, str, "FILE", hint="str"),
        "names and colours of segments from a table: FreeSurfer's, ITK-SNAP's, 3D Slicer's .ctbl, CSV or TSV",
    )
    color_of: tuple[tuple[str, str], ...] = _option(
        (),
        _pairs_kind(
            "a colour #rrggbb, #rgb or of a name in CSS",
            read_channel_color,
            "CHANNEL=COLOR",
            "Mapping[str, str] | Sequence[str]",
        ),
        "colour of a channel, #rrggbb or a CSS name (repeatable)",
        repeat=True,
    )
    window_of: tuple[tuple[str, tuple[float, float]], ...] = _option(
        (),
        _pairs_kind(
            "LOW below HIGH",
            read_channel_window,
            "CHANNEL=LOW,HIGH",
            "Mapping[str, Numbers] | Sequence[str]",
            lambda window: ",".join(map(repr, map(float, window))),
        ),
        "values of a channel that its colours span, from clear to opaque (repeatable)",
        repeat=True,
    )
    look_of: tuple[tuple[str, str], ...] = _option(
        (),
        _pairs_kind("a preset or a colour map", read_channel_look, "CHANNEL=LOOK", "Mapping[str, str] | Sequence[str]"),
        "preset or colour map of a channel (repeatable)",
        repeat=True,
    )


def reject_both(keys: Mapping[str, Any]) -> None:
    """Raises InputError for keys of a transfer function that say the same thing twice."""
    for name in ("curve", "colors"):
        others = [other for other in REPLACES[name] if other in keys]
        if keys.get(name) and others:
            raise expected("transfer", f"{name} or {others[0]}", "both", "leave one of them out")


def read_nodes(keys: Mapping[str, Any], volume: Volume, scale: str) -> dict[str, Any]:
    """Returns keys of a transfer function with the points of `curve`, and colour map and window of `colors`."""
    reject_both(keys)
    rest = dict(keys)
    curve, colors = rest.pop("curve", ""), rest.pop("colors", "")
    if not (curve or colors):
        return rest
    stats = statistics(volume)
    if curve:
        rest["points"] = curve_of(curve, stats, scale)
    if colors:
        rest["colormap"], window = color_map(read_color_points(colors, stats), scale)
        rest |= {"window": window} if window else {}
    return rest


def with_window(keys: dict[str, Any]) -> dict[str, Any]:
    """Returns the keys of a transfer function with a window in place of level and width."""
    if keys.get("level_width") is None:
        return {name: value for name, value in keys.items() if name != "level_width"}
    if "window" in keys:
        raise expected("level_width", "either it or window", "both")
    level, width = checked(declared(TransferChoice)["level_width"].kind, "level_width", keys["level_width"])
    rest = {name: value for name, value in keys.items() if name != "level_width"}
    return {**rest, "window": (level - width / 2, level + width / 2)}


def default_colors(keys: Mapping[str, Any], volume: Volume) -> dict[str, Any]:
    """Returns colours, window and shading of the default for a volume, unless all keys of colours are given."""
    if {"colormap", "window"} <= keys.keys() or "labels" in keys:
        return {}
    base = default_transfer(volume)
    if base.labels:
        return {}
    colors = base_name(base.colormap) if "window" in keys else base.colormap
    window = base.color_range
    spans = window[0] < window[1] and keys.get("scale") != "log" and "colormap" not in keys
    return {"colormap": colors, "shading": base.shading, **({"window": window} if spans else {})}


def base_transfer(name: str | None, keys: dict[str, Any], volume: Volume) -> Transfer:
    """Returns the transfer function that keys change: a preset, that of a file, which is taken out of the keys, that of
    regions without points, or the default.
    """
    file = keys.pop("file", None)
    if file and name:
        raise expected("transfer", "a preset or a file", "both", "leave one of them out")
    if file:
        return load_transfer(file, sum(volume.spacing) / 3)
    if name is None and keys.get("regions") and "curve" not in keys:
        return Transfer(regions=keys["regions"])
    return preset(name, volume) if name else default_transfer(volume)


def notes_on_looks(keys: Mapping[str, Any], volume: Volume, settings: Settings, of_scene: Sequence[str]) -> list[str]:
    """Returns notes on keys of a transfer function that do not change a volume's look. of_scene: names of further
    options of voxels that are given. Raises InputError for both beside a cloud of points.
    """
    named = [name for name, value in keys.items() if value not in (None, "", (), [])]
    # all fields are those of one transfer function, in which each is stated
    stated = [] if declared(Transfer).keys() <= keys.keys() else named
    if volume.points is not None:
        for name in [*(name for name in stated if name not in OF_POINTS), *of_scene]:
            fix = "points have colours of their own, and the opacity of the value 1"
            raise expected(name, "a volume of voxels", f"{len(volume.points):,} points", fix)
    notes = []
    if volume.color is not None:
        of_amounts = COLOR_KEYS[:2] if settings.join == "max" else COLOR_KEYS
        notes += no_effect([name for name in of_amounts if name in stated], "the volume has colours of its own")
    if len(volume.channels) > 1:
        of_one = [name for name in COLOR_KEYS[:2] if name in stated]
        notes += no_effect(of_one, "each channel has its colour; see color_of")
    return notes


def place_files(keys: Mapping[str, Any], place: Callable[[str], str]) -> dict[str, Any]:
    """Returns keys of a transfer function with `place` applied to its files and to the images of regions."""
    moved = {**keys, **{name: place(str(keys[name])) for name in ("file", "names") if keys.get(name)}}
    if "regions" in keys:
        moved["regions"] = [move_image(region, place) for region in keys["regions"]]
    return moved


def plain_values(keys: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the keys that have a value, as TOML holds it: regions as text."""
    texts = {"regions": [str(region) for region in check_regions(keys["regions"])]} if keys.get("regions") else {}
    return {name: value for name, value in {**keys, **texts}.items() if value is not None}


# factor of the opacities of a volume with lines or arrows; optical depth of the most opaque values along the shortest
# side of one with labels
FAINT, THROUGH = 0.15, 1.5
FAINTLY = "rendered faintly, so that labels in it are visible; --points, --curve or --preset set its opacities"


def is_backdrop(scene: SceneFile, volume: Volume) -> bool:
    """Whether `--labels` are seen through the first volume, whose opacities no option states."""
    has_labels = any("only_labels" in layer.transfer and layer.visible for layer in scene.layers)
    is_stated = scene.threshold > 0 or scene.transfer.keys() & {*STATED, "iso"}
    is_dense = volume.labels is None and volume.points is None and len(volume.channels) < 2
    return has_labels and is_dense and not is_stated and scene.settings.hides


def seen_through(volume: Volume, transfer: Transfer) -> float:
    """Returns the factor of a volume's opacities that makes labels in it visible."""
    most = max((opacity for _, opacity in transfer.points), default=0.0)
    spacing = np.linalg.norm(volume.world_from_index, axis=0)
    wanted = float(-np.expm1(-THROUGH * transfer.length(volume) / (spacing * volume.shape[::-1]).min()))
    return wanted / most if wanted < most else 1.0


def faint_share(scene: SceneFile, volume: Volume, transfer: Transfer) -> float:
    """Returns the factor of the first volume's opacities by which lines and labels in it are seen, if options do not
    state them. transfer: without the factor.
    """
    if scene.vectors.has_lines and not scene.transfer.keys() & {*STATED, "iso"}:
        return FAINT
    return seen_through(volume, transfer) if is_backdrop(scene, volume) else 1.0


def transfer_notes(keys: Mapping[str, Any], volume: Volume) -> tuple[str, ...]:
    """Returns notes on a window that may be meant as level and width, on windows that begin in the noise, and on
    iso-surfaces at values that no sample of a volume in memory passes; none on keys that the transfer function refuses.
    """
    notes = list[str]()
    stated, own = keys.get("window"), dict(keys.get("window_of", ()))
    for part in volume.channels if len(volume.channels) > 1 else (volume,):
        # a look states opacities of its own
        of_file = None if keys.keys() & {*STATED, "level_width", "colors"} else part.hints.window
        with suppress(TypeError, ValueError):
            note = noise_note(part, ValueKind.interval().check(own.get(part.name, stated) or of_file))
            notes += [note] * bool(note)
    with suppress(TypeError, ValueError):
        question = window_question(volume, ValueKind.interval().check(keys.get("window")))
        notes += [question] * bool(question)
    with suppress(TypeError, ValueError):
        values = [surface.value for surface in check_iso(keys.get("iso") or ())]
        ends = volume.value_range if values else None
        beyond = ", ".join(f"{value:g}" for value in values if ends and not ends[0] <= value <= ends[1])
        if beyond and ends is not None:
            named, unit = volume.quantity or volume.name or "the volume", f" {volume.value_unit}".rstrip()
            notes.append(f"no surface at {beyond}: {named} has values from {ends[0]:g} to {ends[1]:g}{unit}")
    return tuple(notes)

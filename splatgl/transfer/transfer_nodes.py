"""Nodes of transfer functions: opacity curves by shape, such as `band:50%,90%:0.4`, colour points, and files.

VTK, which both draw with, takes gradients per mean spacing and colours as displayed.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.coercion import public
from splatgl.data.color import srgb_of_name
from splatgl.data.volume import Volume
from splatgl.errors import InputError, expected
from splatgl.options import nearest
from splatgl.transfer.colormaps import colormap_name, control_colors
from splatgl.transfer.presets import RAMP, SURFACE, cut_of
from splatgl.transfer.regions import Region
from splatgl.transfer.statistics import Statistics, statistics
from splatgl.transfer.transfer import Nodes, Transfer

# places of a sigmoid's nodes: its lines are within 0.003 of it
SMOOTH = np.linspace(0.0, 1.0, 17)
# (place, share of the highest opacity) of each shape's nodes; places from 0 at its first value to 1 at its last
SHAPES: dict[str, tuple[tuple[float, float], ...]] = {
    "step": ((0.0, 0.0), (0.0, 1.0)),
    "ramp": ((0.0, 0.0), (1.0, 1.0)),
    "sigmoid": tuple(zip(SMOOTH.tolist(), (SMOOTH**2 * (3 - 2 * SMOOTH)).tolist(), strict=True)),
    "gate": ((0.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, 0.0)),
    "band": ((0.0, 0.0), (0.25, 1.0), (0.75, 1.0), (1.0, 0.0)),
    "tent": ((0.0, 0.0), (0.5, 1.0), (1.0, 0.0)),
}
FORM = f"SHAPE[:VALUES[:OPACITY]] with a shape of {', '.join(SHAPES)}, such as ramp:60,120 or band:50%,90%:0.4"
# percentile at which shapes without values end
TOP = 99.9

# (value, "#rrggbb")
ColorPoints = Sequence[tuple[float, str]]


def read_value(what: str, text: str, stats: Statistics | None) -> float:
    """A number, or P%, a percentile of a volume's values. Raises InputError for other text, and for a percentile
    without statistics.
    """
    digits = text.strip()
    try:
        number = float(digits.removesuffix("%"))
    except ValueError:
        number = np.nan
    if not np.isfinite(number):
        raise expected(what, "values, or percentiles such as 90%", repr(text[:80]))
    if not digits.endswith("%"):
        return number
    if not 0 <= number <= 100:
        raise expected(what, "percentiles from 0% to 100%", text)
    if stats is None:
        raise expected(what, "values, or a volume whose percentiles are meant", f"{number:g}%")
    if not len(stats.values):
        raise expected(what, "values, as the volume has none", f"{number:g}%")
    return stats.percentile(number)


@public
def opacity_curve(text: str, volume: Volume | Any | None = None, scale: str = "linear") -> Nodes:
    """Nodes (value, opacity) of a curve `SHAPE[:VALUES[:OPACITY]]`, for `Transfer(points=…)`.

    SHAPE: step (opaque from a value on), ramp, sigmoid (a ramp with smooth ends), gate (opaque from the first value to
    below the second), band (the same with slopes over a quarter at each side), tent. VALUES: one for step, else two,
    with `%` percentiles as presets take them: without the background of sparse volumes; without values, from where the
    volume's object begins to the 99.9th percentile. OPACITY: the highest, per reference length (0.8). scale: "log"
    places nodes by logarithms. Raises InputError.

    ```python
    volume = sg.scenes.ball(12)
    transfer = sg.Transfer(sg.opacity_curve("band:20%,90%:0.5", volume), "hot")
    ```
    """
    return curve_of(text, None if volume is None else statistics(volume), scale)


def curve_of(text: Any, stats: Statistics | None, scale: str = "linear") -> Nodes:
    """As `opacity_curve`, with the statistics of a volume's values."""
    if not isinstance(text, str):
        raise expected("curve", FORM, repr(text)[:80])
    name, *rest = (part.strip() for part in text.split(":"))
    if name not in SHAPES or len(rest) > 2:
        fix = nearest(name, SHAPES) if name not in SHAPES else ""
        raise expected("curve", FORM, repr(text[:80]), fix)
    opacity = _opacity(rest[1]) if len(rest) > 1 else SURFACE
    low, high = _ends(name, rest[0], stats) if rest and rest[0] else _default_ends(name, stats)
    if scale == "log" and not low > 0:
        raise expected("curve", "values above 0 on a logarithmic scale", f"{low:g}")
    return shape_nodes(name, (low, high), opacity, scale)


def _opacity(text: str) -> float:
    try:
        opacity = float(text)
    except ValueError:
        opacity = np.nan
    if not 0 <= opacity <= 1:
        raise expected("curve", "an opacity from 0 to 1 behind the values", repr(text[:80]))
    return opacity


def _ends(name: str, text: str, stats: Statistics | None) -> tuple[float, float]:
    """The first and last value of a shape; equal for a step."""
    parts = text.split(",")
    count = 1 if name == "step" else 2
    if len(parts) != count:
        raise expected("curve", f"{'one value' if count == 1 else 'two values'} for {name}", repr(text[:80]))
    low, high = (read_value("curve", part, stats) for part in (parts[0], parts[-1]))
    if count == 2 and not low < high:
        of = f", which are {low:g} and {high:g}" if "%" in text else ""
        raise expected("curve", f"the lower value of {name} first, and another one", f"{text}{of}")
    return low, high


def _default_ends(name: str, stats: Statistics | None) -> tuple[float, float]:
    """From the begin of the object to the brightest values; for a step the cut between object and surroundings."""
    if stats is None or stats.constant:
        got = "none" if stats is None else "a volume of one value"
        raise expected("curve", f"values, or a volume of several, for {name}", got, f"such as {name}:60,120")
    cut, top = cut_of(stats, None), stats.percentile(TOP)
    low = cut.value if name == "step" else cut.ramp(RAMP)[0]
    return low, low if name == "step" else max(top, float(np.nextafter(low, np.inf)))


def shape_nodes(name: str, ends: tuple[float, float], opacity: float, scale: str = "linear") -> Nodes:
    """Nodes of a shape between two values."""
    low, high = ends
    places = [place for place, _ in SHAPES[name]]
    values = low * (high / low) ** np.array(places) if scale == "log" else low + np.array(places) * (high - low)
    return tuple((float(value), share * opacity) for value, (_, share) in zip(values, SHAPES[name], strict=True))


def shape_of(transfer: Transfer) -> str | None:
    """Name of the shape of the opacities; None for others."""
    points = transfer.points
    ends, opacity = (points[0][0], points[-1][0]), max(share for _, share in points)
    fits = (name for name in SHAPES if shape_nodes(name, ends, opacity, transfer.scale) == points)
    return next(fits, None)


def color_points(transfer: Transfer) -> ColorPoints:
    """Values and colours of the control colours of the map, over the values that it spans."""
    low, high = transfer.color_range
    places, codes = control_colors(transfer.colormap)
    values = low * (high / low) ** places if transfer.logarithmic else low + places * (high - low)
    return tuple(zip(values.tolist(), codes, strict=True))


def with_color_points(transfer: Transfer, points: ColorPoints) -> Transfer:
    """The transfer function with colours at values, interpolated in sRGB; one alone applies to all values."""
    colormap, window = color_map(points, transfer.scale)
    return replace(transfer, colormap=colormap, window=window or transfer.color_range)


def color_map(points: ColorPoints, scale: str = "linear") -> tuple[str, tuple[float, float] | None]:
    """The colour map of colours at ascending values, and the window that it spans; None for a single value."""
    values = np.array([value for value, _ in points], np.float64)
    low, high = float(values[0]), float(values[-1])
    if not low < high:
        return points[-1][1], None
    if scale == "log" and not low > 0:
        raise expected("colors", "values above 0 on a logarithmic scale", f"{low:g}")
    places = np.log(values / low) / np.log(high / low) if scale == "log" else (values - low) / (high - low)
    colors = [list(bytes.fromhex(code[1:])) for _, code in points]
    return colormap_name(places, np.array(colors) / 255), (low, high)


def color_code(what: str, color: Any) -> str:
    """#rrggbb of a name, or of sRGB (r, g, b) from 0 to 1. Raises InputError for others."""
    try:
        if isinstance(color, str):
            return "#{:02x}{:02x}{:02x}".format(*srgb_of_name(color.strip()))
        rgb = np.asarray(color, dtype=np.float64)
        if rgb.shape != (3,) or not ((rgb >= 0) & (rgb <= 1)).all():
            raise ValueError
        return "#" + bytes(np.rint(rgb * 255).astype(np.uint8)).hex()
    except (TypeError, ValueError):
        is_name = isinstance(color, str)
        this = "#rgb, #rrggbb or a CSS name such as red" if is_name else "a name, or sRGB (r, g, b) from 0 to 1"
        raise expected(what, this, repr(color)[:80]) from None


def read_color_points(colors: Any, stats: Statistics | None) -> ColorPoints:
    """Colour points of text VALUE:COLOUR,… or of (value, colour) pairs; values may be P%. Raises InputError."""
    form = "VALUE:COLOUR,…, such as 60:red,120:#ffd0a0"
    pairs = [tuple(part.split(":")) for part in colors.split(",")] if isinstance(colors, str) else colors
    points = []
    for pair in pairs if isinstance(pairs, Sequence) else ():
        match pair:
            case [str() | int() | float() as value, name]:
                points.append((read_value("colors", str(value), stats), color_code("colors", name)))
            case _:
                raise expected("colors", form, repr(colors)[:80])
    if not points:
        raise expected("colors", form, repr(colors)[:80])
    values = [value for value, _ in points]
    if values != sorted(values):
        raise expected("colors", "values that never fall", ", ".join(f"{value:g}" for value in values))
    return tuple(points)


SUFFIXES = (".toml", ".vp", ".json")
# lines of a .vp file: interpolation, shading, four of light, opacity, gradient opacity, colours; and numbers of the
# nodes of the last three
LINES, SHADING, FUNCTIONS = 9, 1, {6: 2, 7: 2, 8: 4}
# numbers of a node of an opacity function and of colours, and of a box: x, y, width, height, red, green, blue, alpha
NODE, COLOR, BOX = 4, 4, 8
# VTK's reference length of opacities, world units
UNIT = 1.0


def load_transfer(path: str | Path, spacing: float) -> Transfer:
    """The transfer function in a file. spacing: mean spacing of the volume, world units. Raises InputError naming the
    file.
    """
    path = Path(path)
    read = {".vp": _read_slicer, ".json": _read_paraview}.get(path.suffix.lower())
    if read is None:
        return Transfer.load(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: expected a transfer function, got {error}") from error
    try:
        return read(text, spacing)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        form = "a volume property of 3D Slicer" if read is _read_slicer else "a transfer function of ParaView"
        raise expected(path, form, " ".join(f"{type(error).__name__} {error}".split())[:120]) from error


def _read_slicer(text: str, spacing: float) -> Transfer:
    """Transfer function of a .vp file's text: a number of numbers, and the numbers, in each line of a function."""
    lines = [line.partition("=>")[0].split() for line in text.splitlines() if line.strip()]
    if len(lines) < LINES:
        raise expected("volume property", f"{LINES} lines", len(lines))
    opacity, gradient, colors = (_numbers(lines[number], step) for number, step in FUNCTIONS.items())
    window, name = _colors(colors)
    weights = _nodes(gradient / (spacing, 1.0))
    return Transfer(
        _nodes(opacity),
        name,
        window,
        unit=UNIT,
        gradient=() if (gradient[:, 1] == 1).all() else weights,
        shading=lines[SHADING] == ["1"],
    )


def _numbers(words: list[str], step: int) -> np.ndarray:
    """[N, step]: the numbers of a line, whose first one counts the others. Raises InputError."""
    count, numbers = int(words[0]), np.array(words[1:], np.float64)
    if count != len(numbers) or count % step or not count or not np.isfinite(numbers).all():
        raise expected("volume property", f"a line of {count} finite numbers, {step} for each node", len(numbers))
    return numbers.reshape(-1, step)


def _read_paraview(text: str, spacing: float) -> Transfer:
    """Transfer function of the first preset of a .json file: `Points`, `RGBPoints`, and `Boxes` over gradients."""
    content = json.loads(text)
    preset = content[0] if isinstance(content, list) else content
    points, colors, boxes = (
        _table(preset, name, step) for name, step in (("Points", NODE), ("RGBPoints", COLOR), ("Boxes", BOX))
    )
    regions = [_region(box, spacing) for box in boxes]
    if not len(points) and not regions:
        raise expected("transfer function", "Points or Boxes", ", ".join(map(str, preset)) or "nothing")
    window, name = _colors(colors) if len(colors) else (None, "gray")
    return Transfer(_nodes(points[:, :2]) if len(points) else (), name, window, regions=regions)


def _table(preset: Any, name: str, step: int) -> np.ndarray:
    """[N, step]: the numbers of a key; none without it. Raises InputError."""
    numbers = np.array(preset.get(name) or (), np.float64)
    if numbers.ndim != 1 or len(numbers) % step or not np.isfinite(numbers).all():
        raise expected(name, f"finite numbers, {step} for each node", numbers.shape)
    return numbers.reshape(-1, step)


def _region(box: Sequence[float], spacing: float) -> Region:
    """The Gaussian that ParaView draws in a box."""
    x, y, width, height, *rgb, alpha = map(float, box)
    color = "#{:02x}{:02x}{:02x}".format(*(round(255 * min(max(part, 0.0), 1.0)) for part in rgb))
    gradients = (max(y, 0.0) / spacing, (y + height) / spacing)
    return Region("gaussian", (x, x + width), gradients, color, min(max(alpha, 0.0), 1.0))


def _nodes(rows: np.ndarray) -> Nodes:
    """Nodes of ascending values [N, 2], with opacities from 0 to 1."""
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    return tuple((float(value), float(np.clip(share, 0.0, 1.0))) for value, share in rows)


def _colors(rows: np.ndarray) -> tuple[tuple[float, float] | None, str]:
    """Window and colour map through values and sRGB colours [N, 4]; no window for a single value."""
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    low, high = float(rows[0, 0]), float(rows[-1, 0])
    places = (rows[:, 0] - low) / (high - low) if low < high else np.zeros(1)
    name = colormap_name(places, rows[: len(places), 1:])
    return ((low, high) if low < high else None), name

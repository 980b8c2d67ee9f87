"""Transfer functions in files: TOML, 3D Slicer's volume properties (.vp), and ParaView's presets and boxes (.json).

VTK, which both draw with, takes gradients per mean spacing and colours as displayed.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.errors import InputError, expected
from splatgl.transfer.colormaps import colormap_name
from splatgl.transfer.regions import Region
from splatgl.transfer.transfer import Nodes, Transfer

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

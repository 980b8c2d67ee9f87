"""`Transfer`: maps sample value and gradient to linear colour, opacity per length, extinction.  [M98 §2]"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from splatgl.errors import InputError, expected
from splatgl.fileio import load_table, parse_table, write_file
from splatgl.splat.colormaps import checked_labels, colormap, label_color, label_opacity

# given as any sequence of pairs, stored as tuples
Nodes = Sequence[Sequence[float]]

# opacity 1 would be an infinite extinction; one step of float32 below it is opaque in any picture
OPAQUE = 1.0 - 2.0**-24
# what opacity and colour may be linear in: values or their logarithms; and nodes of a decade of the latter
SCALES, A_DECADE = ("linear", "log"), 16


@dataclass(frozen=True)
class Transfer:
    """t = F(∇, ρ) = opacity(ρ) · weight(|∇|), and the colour of ρ.

    points: (value, opacity) nodes, linear between them and constant outside; opacity in [0, 1] per
    `unit` world lengths (None: the volume's mean spacing). A repeated value is a step, and a value
    exactly there takes the upper side. gradient: (|∇|, weight) nodes in values per world length,
    weights in [0, 1]; none means no influence. colormap spans `window` (None: first to last point).
    labels: (number, "#rrggbb", opacity) of each label that is shown, of samples that number segments: their opacities
    and colours, instead of those of points and colormap; numbers between them and others are clear.
    scale: "linear" or "log", whether opacity and colour are linear in values or in their logarithms; points and window
    of "log" are above 0. Lists are accepted too. Raises InputError for invalid values.
    """

    points: Nodes
    colormap: str = "gray"
    window: Sequence[float] | None = None
    unit: float | None = None
    gradient: Nodes = ()
    shading: bool = True
    labels: Sequence[tuple[int, str, float]] = ()
    scale: str = "linear"

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", _nodes("transfer points", "opacity", self.points))
        if not self.points:
            raise expected("transfer points", "at least one (value, opacity) pair", "none")
        object.__setattr__(self, "gradient", _nodes("transfer gradient", "weight", self.gradient))
        object.__setattr__(self, "window", None if self.window is None else _window(self.window))
        object.__setattr__(self, "unit", None if self.unit is None else _unit(self.unit))
        if not isinstance(self.shading, bool):
            raise expected("transfer shading", "true or false", repr(self.shading))
        if not isinstance(self.colormap, str):
            raise expected("transfer colormap", "a name", repr(self.colormap))
        colormap(self.colormap)
        object.__setattr__(self, "labels", checked_labels(self.labels))
        if self.scale not in SCALES:
            raise expected("transfer scale", " or ".join(SCALES), repr(self.scale))
        lowest = min(self.points[0][0], *(self.window or ()), self.points[-1][0])
        if self.logarithmic and not lowest > 0:
            raise expected("transfer points and window", "values above 0 on a logarithmic scale", lowest)

    @property
    def logarithmic(self) -> bool:
        """Whether opacity and colour are linear in logarithms of values."""
        return self.scale == "log"

    @property
    def bends(self) -> np.ndarray:
        """Values, ascending, between which opacity and colour are linear, or on a logarithmic scale nearly so."""
        ends = np.array([value for value, _ in self.points])
        if not self.logarithmic:
            return ends
        low, high = min(ends[0], *(self.window or ends[:1])), max(ends[-1], *(self.window or ends[:1]))
        count = int(np.ceil(np.log10(high / low) * A_DECADE)) + 1
        return np.union1d(ends, np.geomspace(low, high, max(count, 2)))

    def weakened(self, factor: float) -> Transfer:
        """The same with opacities times a factor from 0 to 1."""
        if factor == 1:
            return self
        points = tuple((value, opacity * factor) for value, opacity in self.points)
        labels = tuple((number, color, opacity * factor) for number, color, opacity in self.labels)
        return replace(self, points=points, labels=labels)

    def opacity(self, values: ArrayLike) -> np.ndarray:
        """F's value part, float64, the shape of values: opacity per `unit`; 0 where a value is not finite."""
        if self.labels:
            return label_opacity(self.labels, np.asarray(values))
        if not self.logarithmic:
            return _piecewise(self.points, values)
        nodes = [(float(np.log(value)), opacity) for value, opacity in self.points]
        return _piecewise(nodes, _log(values, self.points[0][0]))

    def weight(self, magnitude: ArrayLike) -> np.ndarray:
        """F's gradient part, float64 in [0, 1]; 1 everywhere if the transfer ignores gradients."""
        if not self.gradient:
            return np.ones(np.shape(magnitude))
        return _piecewise(self.gradient, magnitude)

    def color(self, values: ArrayLike) -> np.ndarray:
        """Linear RGB, float64 [..., 3]; linear interpolation of the map's entries, clamped outside."""
        if self.labels:
            return label_color(self.labels, np.asarray(values))
        low, high = self.window or (self.points[0][0], self.points[-1][0])
        v = np.nan_to_num(np.asarray(values, dtype=np.float64), nan=low)
        if self.logarithmic:
            low, high, v = float(np.log(low)), float(np.log(high)), _log(v, low)
        # a window of zero width is a step: low end below it, high end from it on
        k = _scale(low, high)
        span = high * k - low * k
        place = (np.clip(v, low, high) * k - low * k) / span if span > 0 else (v >= low).astype(np.float64)
        table = colormap(self.colormap)
        at = place * (len(table) - 1)
        below = np.minimum(at.astype(np.intp), len(table) - 2)
        part = (at - below)[..., None]
        return np.asarray(table[below] * (1.0 - part) + table[below + 1] * part)

    @staticmethod
    def extinction(opacity: ArrayLike, unit: float) -> np.ndarray:
        """Extinction per world length of an opacity per `unit` world lengths; 1 is read as 1 − 2⁻²⁴."""
        return np.asarray(-np.log1p(-np.minimum(np.asarray(opacity, dtype=np.float64), OPAQUE)) / unit)

    def to_toml(self) -> str:
        """TOML text that `from_toml` reads back to an equal Transfer."""
        pairs = {"points": self.points, "gradient": self.gradient}
        lines = [f"{name} = {_toml_pairs(nodes)}" for name, nodes in pairs.items() if nodes]
        lines.append(f'colormap = "{_toml_escaped(self.colormap)}"')
        if self.window is not None:
            lines.append(f"window = [{self.window[0]!r}, {self.window[1]!r}]")
        if self.unit is not None:
            lines.append(f"unit = {self.unit!r}")
        lines.append(f"shading = {str(self.shading).lower()}")
        if self.labels:
            named = [f'[{number}, "{color}", {opacity!r}]' for number, color, opacity in self.labels]
            lines.append(f"labels = [{', '.join(named)}]")
        if self.logarithmic:
            lines.append(f'scale = "{self.scale}"')
        return "\n".join(lines) + "\n"

    @classmethod
    def from_toml(cls, text: str) -> Transfer:
        """A Transfer from TOML with the fields as keys. Raises InputError for bad TOML and unknown keys."""
        return cls.from_table(parse_table(text, "transfer function: expected TOML"))

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> Transfer:
        """A Transfer from the keys and values of a TOML table. Raises InputError for unknown keys."""
        known = [field.name for field in fields(cls)]
        for key in table:
            if key not in known:
                raise expected("transfer function", f"keys {', '.join(known)}", repr(key))
        if "points" not in table:
            raise expected("transfer function", "the key points", ", ".join(table) or "nothing", "points = [[v, a], …]")
        return cls(**table)

    def save(self, path: str | Path) -> None:
        """Writes TOML; an old file is replaced whole or not at all. Raises InputError naming the file."""
        write_file(Path(path), self.to_toml().encode())

    @classmethod
    def load(cls, path: str | Path) -> Transfer:
        """A Transfer from a TOML file. Raises InputError naming the file."""
        table = load_table(Path(path), "a transfer function")
        try:
            return cls.from_table(table)
        except InputError as error:
            raise InputError(f"{path}: {error}") from error


def _log(values: ArrayLike, least: float) -> np.ndarray:
    """Logarithms of values; of those below `least`, its own."""
    return np.asarray(np.log(np.maximum(np.asarray(values, dtype=np.float64), least)))


def _scale(low: float, high: float) -> float:
    """½ if high − low would overflow, else 1: halves of denormals would underflow."""
    return 1.0 if np.isfinite(np.float64(high) / 2 - np.float64(low) / 2) and high / 2 - low / 2 < 8e307 else 0.5


def _piecewise(nodes: Nodes, values: ArrayLike) -> np.ndarray:
    """Linear between the nodes, constant outside, upper side at a step, 0 where not finite."""
    x, y = np.array(nodes, dtype=np.float64).T
    v = np.asarray(values, dtype=np.float64)
    after = np.searchsorted(x, v, side="right")
    low, high = np.maximum(after - 1, 0), np.minimum(after, len(x) - 1)
    k = _scale(x[0], x[-1])
    width = x[high] * k - x[low] * k
    with np.errstate(invalid="ignore"):
        part = np.where(width > 0, (v * k - x[low] * k) / np.where(width > 0, width, 1.0), 0.0)
    return np.where(np.isfinite(v), y[low] + (y[high] - y[low]) * part, 0.0)


def _nodes(what: str, second: str, pairs: Any) -> Nodes:
    """Checked pairs of floats: finite, first numbers ascending (ties allowed), second ones in [0, 1]."""
    try:
        array = np.array(list(pairs) or np.zeros((0, 2)), dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise expected(what, f"(value, {second}) pairs of numbers", repr(pairs)) from error
    if array.ndim != 2 or array.shape[1] != 2:
        raise expected(what, f"(value, {second}) pairs", f"shape {array.shape}")
    if not np.isfinite(array).all():
        raise expected(what, "finite numbers", pairs)
    if ((array[:, 1] < 0) | (array[:, 1] > 1)).any():
        raise expected(what, f"{second} from 0 to 1", pairs)
    if (np.diff(array[:, 0]) < 0).any():
        raise expected(what, "values that never fall", pairs, "sort the pairs by value")
    return tuple((float(value), float(share)) for value, share in array)


def _window(window: Any) -> tuple[float, float]:
    try:
        low, high = (float(bound) for bound in window)
    except (TypeError, ValueError) as error:
        raise expected("transfer window", "two numbers (low, high)", repr(window)) from error
    if not (np.isfinite(low) and np.isfinite(high) and low < high):
        raise expected("transfer window", "finite low < high", (low, high))
    return low, high


def _unit(unit: Any) -> float:
    try:
        length = float(unit)
    except (TypeError, ValueError) as error:
        raise expected("transfer unit", "a length in world units", repr(unit)) from error
    if not (np.isfinite(length) and length > 0):
        raise expected("transfer unit", "a positive, finite length", length)
    return length


def _toml_pairs(nodes: Nodes) -> str:
    return "[" + ", ".join(f"[{value!r}, {share!r}]" for value, share in nodes) + "]"


def _toml_escaped(text: str) -> str:
    return text.replace("\\", "\\\\").replace('"', '\\"')

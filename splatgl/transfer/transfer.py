"""`Transfer`: maps sample value and gradient to linear colour, opacity per length, extinction.  [M98 §2]"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from splatgl.coercion import public
from splatgl.data.color import linear_from_srgb, srgb_of_name
from splatgl.data.volume import PER_EXTENT, Volume
from splatgl.errors import InputError, expected
from splatgl.fileio import load_table, parse_table, toml_value, write_file
from splatgl.options import (
    HelpGroup,
    ValueKind,
    check_options,
    declared,
    non_default,
    option,
    read_pairs,
    reject_unknown,
)
from splatgl.transfer.colormaps import (
    SOLID,
    check_labels,
    colormap,
    colormap_name,
    interpolate_map,
    label_color,
    label_opacity,
)
from splatgl.transfer.regions import (
    FORM,
    REGION_FORM,
    Region,
    check_iso,
    check_regions,
    extinction_of,
    matter_at,
    read_iso,
)

# sequences of pairs, stored as tuples
Nodes = Sequence[Sequence[float]]

# what opacity and colour may be linear in: values or their logarithms; and nodes of a decade of the latter
SCALES, A_DECADE = ("linear", "log"), 16
# the length that a volume's box gives, see `Lengths`
EXTENT = "extent"
_LENGTH = ValueKind.number(low=0, above=True)


def _nodes(what: str, second: str, pairs: Any) -> Nodes:
    """Checked pairs of floats: finite, first numbers ascending (ties allowed), second numbers in [0, 1]."""
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


def _hull(regions: Sequence[Region], labels: Sequence[tuple[int, str, float]]) -> Nodes:
    """Points over the values of regions, transparent, or over the numbers of labels. Raises InputError for neither."""
    ends = [value for region in regions for value in region.values if np.isfinite(value)]
    ends = [float(number) for number, _, _ in labels] or ends or [0.0, 1.0] * bool(regions)
    if not ends:
        raise expected("transfer points", "at least one (value, opacity) pair, regions or labels", "none")
    return ((min(ends), 0.0), (max(ends), SOLID if labels else 0.0))


def _colormap(name: Any) -> str:
    """The name of a map, also of sRGB colours [N, 3] from 0 to 1, or of whole numbers from 0 to 255."""
    if not isinstance(name, str):
        colors = np.asarray(name)
        rgb = colors / (255 if colors.dtype.kind in "iu" else 1)
        if rgb.ndim != 2 or len(rgb) < 2 or rgb.shape[1] != 3 or not ((rgb >= 0) & (rgb <= 1)).all():
            raise ValueError
        name = colormap_name(np.linspace(0, 1, len(rgb)), rgb)
    colormap(name)
    return str(name)


_option = partial(option, group=HelpGroup.TRANSFER)


@public
@dataclass(frozen=True)
class Transfer:
    """t = F(∇, ρ) = opacity(ρ) · weight(|∇|), and the colour of ρ.

    points: (value, opacity) nodes, linear between them and constant outside; opacity in [0, 1] per
    `unit` world lengths (None: the volume's mean spacing; "extent": the cube root of its box's volume, by 100). A
    repeated value is a step, and a value exactly there takes the upper side. gradient: (|∇|, weight) nodes in values
    per world length, weights in [0, 1]; none means no influence. regions: further matter in the plane of value and
    gradient magnitude, as Region or text; extinctions add. With regions or labels, points may be left out. colormap
    spans `window` (None: first to last point).
    labels: (number, "#rrggbb", opacity) of each visible label, for samples that number segments; other numbers are
    clear. Points and colormap are then ignored.
    iso: surfaces where the field passes a value, each (value, "#rrggbb" or "", opacity), see `Iso`.
    scale: "linear" or "log", whether opacity and colour are linear in values or in their logarithms; points and window
    of "log" are above 0. Lists are accepted too. Raises InputError for invalid values.

    ```python
    bone = sg.Transfer([(300, 0.0), (700, 0.8)], "ivory", window=(300, 1500))
    bone.save("bone.toml")
    ```
    """

    points: Nodes = _option(
        (),
        ValueKind(
            "pairs", partial(_nodes, "transfer points", "opacity"), read_pairs, "V:A,V:A…", hint="Sequence[Numbers]"
        ),
        "opacity A at value V, linear between",
        level="basic",
    )
    colormap: str = _option(
        "gray",
        ValueKind(
            "a name, or sRGB colours [N, 3]", _colormap, str, "NAME", hint="str | Sequence[Numbers] | np.ndarray"
        ),
        "gray, bone, hot, viridis, …. Or any map of cmap or Matplotlib",
        level="basic",
    )
    window: Sequence[float] | None = _option(None, ValueKind.interval(), "values that the colours span", level="basic")
    unit: float | Literal["extent"] | None = _option(
        None,
        ValueKind(
            f"a positive, finite length in world units, or {EXTENT}",
            lambda value: value if isinstance(value, str) and value == EXTENT else _LENGTH.check(value),
            lambda text: text if text == EXTENT else float(text),
            f"L|{EXTENT}",
            hint='float | Literal["extent"]',
        ),
        "world length that opacities refer to (default: mean spacing). extent: cube root of the box's volume / "
        f"{PER_EXTENT}, whatever the sampling",
    )
    gradient: Nodes = _option(
        (),
        ValueKind(
            "pairs", partial(_nodes, "transfer gradient", "weight"), read_pairs, "G:W,G:W…", hint="Sequence[Numbers]"
        ),
        "factor W of the opacity at gradient G, linear between",
    )
    shading: bool = option(True, ValueKind.flag())
    labels: Sequence[tuple[int, str, float]] = option((), ValueKind("labels", check_labels))
    scale: str = _option(
        "linear",
        replace(ValueKind.choice(SCALES), metavar=""),
        "opacities and colours over logarithms of values",
        flag="--log",
        bare="log",
    )
    iso: Sequence[Any] = _option(
        (),
        ValueKind(
            f"{FORM}, or several",
            check_iso,
            read_iso,
            FORM,
            written=f"{FORM}, such as 300:red:0.5",
            hint="float | str | Sequence[Any]",
        ),
        "draw the surface at a value. Without --points or --preset only surfaces; repeatable",
        level="basic",
        repeat=True,
    )
    regions: Sequence[Any] = _option(
        (),
        ValueKind("regions", check_regions, Region.parse, "REGION", written=REGION_FORM, hint="Sequence[Any]"),
        "density in a box, triangle, gaussian or image over values and gradients: " + REGION_FORM + " (repeatable)",
        flag="--region",
        repeat=True,
    )

    def __post_init__(self) -> None:
        check_options(self, "transfer ")
        if self.regions and self.labels:
            raise expected("regions", "values with gradients", "labels")
        if not self.points:
            object.__setattr__(self, "points", _hull(self.regions, self.labels))
        lowest = min(self.points[0][0], *(self.window or ()), self.points[-1][0])
        if self.logarithmic and not lowest > 0:
            raise expected("transfer points and window", "values above 0 on a logarithmic scale", lowest)

    @property
    def fields(self) -> dict[str, Any]:
        """Values by the names of the fields."""
        return {name: getattr(self, name) for name in declared(self)}

    @property
    def color_range(self) -> tuple[float, float]:
        """Values that the colours span: the window, or from the first to the last point."""
        low, high = self.window or (self.points[0][0], self.points[-1][0])
        return low, high

    @property
    def needs_gradients(self) -> bool:
        """Whether opacity is looked up by gradients."""
        return bool(self.gradient or self.regions)

    @property
    def varies_by_gradient(self) -> bool:
        """Whether opacity differs between gradients: not with equal weights, nor regions of all gradients."""
        return len({weight for _, weight in self.gradient}) > 1 or any(not each.is_endless for each in self.regions)

    @property
    def is_clear(self) -> bool:
        """Whether only its iso-surfaces can be seen."""
        return not (self.labels or self.regions or any(opacity for _, opacity in self.points))

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
        iso = tuple(surface._replace(opacity=surface.opacity * factor) for surface in self.iso)
        regions = tuple(region.weakened(factor) for region in self.regions)
        return replace(self, points=points, labels=labels, iso=iso, regions=regions)

    def inverted(self) -> Transfer:
        """The same with inverted opacity, as in a negative."""
        most = max(opacity for _, opacity in self.points)
        return replace(self, points=tuple((value, most - opacity) for value, opacity in self.points))

    def length(self, volume: Volume) -> float:
        """World length that opacities refer to in a volume, a part or level of it."""
        if isinstance(self.unit, float):
            return self.unit
        return volume.lengths.spacing if self.unit is None else volume.lengths.extent

    def on(self, volume: Volume) -> Transfer:
        """The same with its length in a volume as a number."""
        return self if isinstance(self.unit, float) else replace(self, unit=self.length(volume))

    def rescaled(self, length: float) -> Transfer:
        """The same where lengths are `length` times these numbers."""
        if length == 1:
            return self
        gradient = tuple((magnitude / length, weight) for magnitude, weight in self.gradient)
        regions = tuple(region.rescaled(length) for region in self.regions)
        unit = self.unit * length if isinstance(self.unit, float) else self.unit
        return replace(self, unit=unit, gradient=gradient, regions=regions)

    def surface_matter(self) -> np.ndarray:
        """[n, 4]: emission and optical depth of the iso-surfaces."""
        opacity = np.array([surface.opacity for surface in self.iso])
        colors = [
            linear_from_srgb(np.array(srgb_of_name(surface.color)) / 255)
            if surface.color
            else self.color(surface.value)
            for surface in self.iso
        ]
        depth = self.extinction(opacity, 1.0)[:, None]
        return np.concatenate([np.reshape(colors, (-1, 3)) * depth, depth], axis=1)

    def opacity(self, values: ArrayLike) -> np.ndarray:
        """F's value part, float64, the shape of values: opacity per `unit`; 0 where a value is not finite."""
        if self.labels:
            return label_opacity(self.labels, np.asarray(values))
        if not self.logarithmic:
            return _piecewise(self.points, values)
        nodes = [(float(np.log(value)), opacity) for value, opacity in self.points]
        return _piecewise(nodes, _log(values, self.points[0][0]))

    def largest_opacity(self, values: ArrayLike) -> np.ndarray:
        """float64, the shape of values: at least the opacity per `unit` at any gradient."""
        most, v = self.opacity(values), np.asarray(values)
        for region in self.regions:
            low, high = region.values
            most = np.where(
                (v >= np.float64(low)) & (v <= np.float64(high)), 1 - (1 - most) * (1 - region.densest), most
            )
        return most

    def classify(self, values: ArrayLike, magnitude: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Opacity per `unit` [N], and linear RGB [N, 3], at values [N] with gradient magnitudes [N]."""
        opacity, color = self.opacity(values) * self.weight(magnitude), self.color(values)
        if not self.regions:
            return opacity, color
        matter, own = matter_at(self.regions, values, magnitude), extinction_of(opacity)
        total = matter[:, 3] + own
        emission = matter[:, :3] + own[:, None] * color
        share = np.where(total > 0, total, 1.0)[:, None]
        return np.where(matter[:, 3] > 0, -np.expm1(-total), opacity), np.where(
            total[:, None] > 0, emission / share, color
        )

    def weight(self, magnitude: ArrayLike) -> np.ndarray:
        """F's gradient part, float64 in [0, 1]; 1 everywhere if the transfer ignores gradients."""
        if not self.gradient:
            return np.ones(np.shape(magnitude))
        return _piecewise(self.gradient, magnitude)

    def color(self, values: ArrayLike) -> np.ndarray:
        """Linear RGB, float64 [..., 3]; linear interpolation of the map's entries, clamped outside."""
        if self.labels:
            return label_color(self.labels, np.asarray(values))
        low, high = self.color_range
        v = np.nan_to_num(np.asarray(values, dtype=np.float64), nan=low)
        if self.logarithmic:
            low, high, v = float(np.log(low)), float(np.log(high)), _log(v, low)
        # a window of zero width is a step: low end below it, high end from it on
        k = _scale(low, high)
        span = high * k - low * k
        place = (np.clip(v, low, high) * k - low * k) / span if span > 0 else (v >= low).astype(np.float64)
        return interpolate_map(colormap(self.colormap), place)

    @staticmethod
    def extinction(opacity: ArrayLike, unit: float) -> np.ndarray:
        """Extinction per world length of an opacity per `unit` world lengths; 1 is read as 1 − 2⁻²⁴."""
        return extinction_of(opacity) / unit

    def to_toml(self) -> str:
        """TOML text that `from_toml` reads back to an equal Transfer."""
        always, changed = ("points", "colormap", "shading"), non_default(self)
        names = dict.fromkeys(("points", "gradient", *declared(self)))
        values = {name: getattr(self, name) for name in names if name in always or name in changed}
        if self.regions:
            values["regions"] = [str(region) for region in self.regions]
        return "".join(f"{name} = {toml_value(name, value)}\n" for name, value in values.items())

    @classmethod
    def from_toml(cls, text: str) -> Transfer:
        """A Transfer from TOML with the fields as keys. Raises InputError for bad TOML and unknown keys."""
        return cls.from_table(parse_table(text, "transfer function: expected TOML"))

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> Transfer:
        """A Transfer from the keys and values of a TOML table. Raises InputError for unknown keys."""
        reject_unknown("transfer function", table, declared(cls))
        if not table.keys() & {"points", "regions", "labels"}:
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
    """Logarithms of values, which are at least `least`."""
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

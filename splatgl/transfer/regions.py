"""Regions of density in the plane of value and gradient magnitude (2-D transfer functions), and iso-surfaces.

Between two places of a ray, value and gradient magnitude are taken as linear: a straight line in the plane. A region's
matter there is its mean over the part of the line inside it, whose ends follow from the signs of linear functions, so
that no region is missed, however narrow. The mean is exact for boxes and, at constant gradient, for triangles; GAUSS
points on either half of the part give it for the others.

Twin of shaders/regions.glsl.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from splatgl.coercion import public
from splatgl.data.color import linear_from_srgb, srgb_of_name
from splatgl.errors import InputError, expected
from splatgl.options import is_number

# most iso-surfaces of a volume: shaders keep an array of them
MOST_ISO = 8
# by this share of the range of values a surface lies above its value, so that even matter of exactly this value is
# below it, whatever its last digits are
ABOVE = 2.0**-20
# thickness of a surface among the matter of other layers, in sheets
THIN = 1e-4
FORM = "VALUE[:COLOUR[:OPACITY]]"


class Iso(NamedTuple):
    """A surface at a value. color: "#rrggbb"; "": the transfer function's colour of the value. opacity: from 0 to 1, of
    each crossing.
    """

    value: float
    color: str = ""
    opacity: float = 1.0


def read_iso(text: str) -> Iso:
    """The surface of VALUE[:COLOUR[:OPACITY]]; an empty colour is the transfer function's. Raises ValueError."""
    value, _, rest = text.partition(":")
    color, _, opacity = rest.partition(":")
    return _checked((float(value), color, float(opacity or 1.0)))


def check_iso(value: Any) -> tuple[Iso, ...]:
    """The surfaces, ascending, of a value, a text, (value, colour, opacity), or a sequence of these. Raises ValueError
    or TypeError for anything else, and InputError for too many or equal ones.
    """
    one = isinstance(value, str) or is_number(value)
    one = one or (len(value) > 1 and is_number(value[0]) and isinstance(value[1], str))
    surfaces = sorted(_checked(surface) for surface in ([value] if one else value))
    if len(surfaces) > MOST_ISO:
        raise expected("iso", f"at most {MOST_ISO} surfaces", len(surfaces))
    for first, second in pairwise(surfaces):
        if first.value == second.value:
            raise expected("iso", "surfaces of different values", f"{first.value:g} twice")
    return tuple(surfaces)


def _checked(surface: Any) -> Iso:
    if isinstance(surface, str):
        return read_iso(surface)
    value, color, opacity = Iso(surface) if is_number(surface) else Iso(*surface)
    if not (is_number(value) and math.isfinite(value) and is_number(opacity) and 0 <= opacity <= 1):
        raise ValueError
    return Iso(float(value), "#{:02x}{:02x}{:02x}".format(*srgb_of_name(color)) if color else "", float(opacity))


def crossed_depth(values: np.ndarray, depths: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Optical depths [N] of the surfaces, of `values` [n] and `depths` [n], between values `first` and `last` [N]."""
    crossed = (first[:, None] > values) != (last[:, None] > values)
    return np.asarray((crossed * depths).sum(axis=1))


def spline_crossings(q: np.ndarray) -> np.ndarray:
    """Places [2, N], ascending, from 0 to 1, where q₀(1−u)² + 2q₁u(1−u) + q₂u², of q [3, N], passes 0; infinite if
    there are none. Float64 twin of `crossings` in iso_surfaces.glsl.
    """
    begins, ends = q[0] > 0, q[2] > 0
    q0, q1, q2 = np.where(begins, q, -q)
    root = np.sqrt(np.maximum(q1 * q1 - q0 * q2, 0.0))
    tiny = 1e-30
    with np.errstate(divide="ignore", invalid="ignore"):
        once = np.where(q1 >= 0, (q1 + root + tiny) / (q1 + root - q2 + tiny), q0 / (q0 + root - q1))
        first, second = q0 / (q0 - q1 + root), (root - q1) / (root - q1 + q2)
    is_once, is_twice = begins != ends, (begins == ends) & (q1 < 0) & (root > 0)
    return np.stack([np.select([is_once, is_twice], [once, first], np.inf), np.where(is_twice, second, np.inf)])


# opacity 1 would be an infinite extinction; one step of float32 below it is opaque in any picture
OPAQUE = 1.0 - 2.0**-24

# shapes of regions, as numbers of the shader
SHAPES = ("box", "triangle", "gaussian", "image")
# most regions of a transfer function, and most pixels of an image's sides
MOST_REGIONS, MOST_SIDE = 16, 1024
# standard deviation of a Gaussian over half its box: ParaView's
DEVIATION = 0.6
# Gauss–Legendre points and weights on [0, 1] of either half of a line
GAUSS = ((0.5 - np.sqrt(0.15), 5 / 18), (0.5, 4 / 9), (0.5 + np.sqrt(0.15), 5 / 18))
# largest error of a mean by these, as a share of a region's extinction: of a Gaussian's whole diagonal, and of a
# triangle whose gradient doubles along the line
GAUSS_ERROR = 1e-3
# stands for no limit of values or gradients: differences of two are finite in float64
ENDLESS = 2.0**1020
# colour and opacity of a region that states none
COLOR, OPACITY = "#ffffff", 0.5
REGION_FORM = "SHAPE:VALUE,VALUE,GRADIENT,GRADIENT[:COLOR[:OPACITY]]"


@public
@dataclass(frozen=True)
class Region:
    """Density in part of the plane of values and gradient magnitudes, in values per world length.

    shape: "box": the whole rectangle; "triangle": its point lies in the middle of the values at the lowest gradient,
    its base at the highest one; extinction falls linearly from the middle to the sides [Levoy 1988]; "gaussian":
    extinction falls from the middle of the rectangle; "image": `color` is the path of a picture over the rectangle,
    each of whose pixels is a box; its lowest row has the lowest gradient. color: "#rrggbb" or a name in CSS. opacity:
    per reference length, from 0 to 1; of an image a factor of its alpha. Only boxes may be endless. Raises InputError
    for others.
    """

    shape: str
    values: Sequence[float]
    gradients: Sequence[float]
    color: str = COLOR
    opacity: float = OPACITY

    def __post_init__(self) -> None:
        if self.shape not in SHAPES:
            raise expected("region", f"{', '.join(SHAPES[:-1])} or {SHAPES[-1]}", repr(self.shape))
        for name in ("values", "gradients"):
            object.__setattr__(self, name, self._limits(name, getattr(self, name)))
        if self.gradients[0] < 0:
            raise expected("region", "gradients of at least 0", self.gradients[0])
        opacity = self.opacity
        if not (isinstance(opacity, int | float | np.number) and 0 <= opacity <= 1):
            raise expected("region", "an opacity from 0 to 1", repr(opacity))
        object.__setattr__(self, "opacity", float(opacity))
        if self.is_image:
            self.table  # noqa: B018 — the picture is read
        else:
            object.__setattr__(self, "color", _color(self.color))

    def _limits(self, name: str, limits: Any) -> tuple[float, float]:
        """Two ascending numbers of the region; infinite only for boxes."""
        try:
            low, high = map(float, limits)
        except (TypeError, ValueError) as error:
            raise expected(f"region's {name}", "two numbers, low and high", repr(limits)) from error
        if not low < high:
            raise expected(f"region's {name}", "low < high", f"{low:g}, {high:g}")
        if self.shape != "box" and not np.isfinite([low, high]).all():
            raise expected(f"region's {name}", f"finite numbers for a {self.shape}", f"{low:g}, {high:g}")
        return low, high

    @property
    def is_image(self) -> bool:
        """Whether the region is a picture."""
        return self.shape == "image"

    @property
    def is_endless(self) -> bool:
        """Whether the region is a box of all gradients."""
        return self.shape == "box" and tuple(self.gradients) == (0.0, np.inf)

    @property
    def kind(self) -> int:
        """Number of the shape in shaders."""
        return SHAPES.index(self.shape)

    def __str__(self) -> str:
        numbers = ",".join(f"{float(number):.9g}" for number in (*self.values, *self.gradients))
        return f"{self.shape}:{numbers}:{self.color}:{self.opacity:.9g}"

    @classmethod
    def parse(cls, text: str) -> Region:
        """A region from text of REGION_FORM. Raises InputError."""
        shape, numbers, color, opacity = _split(text)
        try:
            limits = [float(number) for number in numbers.split(",")]
            share = float(opacity or (1.0 if shape == "image" else OPACITY))
        except ValueError:
            limits, share = [], 0.0
        if len(limits) != 4:
            raise expected("region", REGION_FORM, repr(text), "such as box:300,700,50,400:#ffcc88:0.3")
        return cls(shape, limits[:2], limits[2:], color or COLOR, share)

    @classmethod
    def of(cls, value: Any) -> Region:
        """A region, or one from text. Raises InputError."""
        if isinstance(value, cls):
            return value
        if not isinstance(value, str):
            raise expected("region", f"text {REGION_FORM}, or a Region", type(value).__name__)
        return cls.parse(value)

    def weakened(self, factor: float) -> Region:
        """The same with its opacity times a factor."""
        return replace(self, opacity=self.opacity * factor)

    def rescaled(self, length: float) -> Region:
        """The same where lengths are `length` times these numbers."""
        return replace(self, gradients=tuple(gradient / length for gradient in self.gradients))

    def recolored(self, code: Callable[[str], str]) -> Region:
        """The same with another colour, which `code` makes of "#rrggbb"; images keep theirs."""
        return self if self.is_image else replace(self, color=code(self.color))

    @property
    def extinction(self) -> float:
        """Largest extinction per reference length, in its middle; of an image, of its densest pixel."""
        return float(self.table[..., 3].max() if self.is_image else extinction_of(self.opacity))

    @property
    def densest(self) -> float:
        """Largest opacity."""
        return float(-np.expm1(-self.extinction))

    @cached_property
    def matter(self) -> np.ndarray:
        """[4]: emission and extinction per reference length in its middle; of an image 1."""
        if self.is_image:
            return np.ones(4)
        rgb = linear_from_srgb(np.array(srgb_of_name(self.color)) / 255)
        return np.append(rgb, 1.0) * self.extinction

    @cached_property
    def table(self) -> np.ndarray:
        """[rows, columns, 4]: emission and extinction of an image's pixels, lowest gradients first."""
        pixels = _read_picture(self.color)
        extinction = extinction_of(pixels[..., 3:] / 255 * self.opacity)
        rgb = linear_from_srgb(pixels[..., :3] / 255)
        return np.concatenate([rgb * extinction, extinction], axis=2)[::-1]

    @cached_property
    def below(self) -> np.ndarray:
        """[rows, columns + 1, 4]: integrals of an image's rows up to the ends of its pixels, in pixels."""
        return np.pad(np.cumsum(self.table, axis=1), ((0, 0), (1, 0), (0, 0)))

    def mean(self, first: np.ndarray, last: np.ndarray) -> np.ndarray:
        """[N, 4]: mean emission and extinction over straight lines from `first` to `last`, values and gradients [2, N];
        of a point, there.
        """
        begin, end = self._inside(first, last)
        if self.is_image:
            return self._image_mean(first, last, begin, end)
        share = np.maximum(end - begin, 0.0)
        if self.shape != "box":
            share = share * self._profile(first, last, begin, end)
        return np.asarray(share[:, None] * self.matter)

    def _inside(self, first: np.ndarray, last: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Ends [N] of the lines' part inside, as shares of the lines; the first above the last where there is none."""
        begin, end = np.zeros(first.shape[1]), np.ones(first.shape[1])
        for before, behind in zip(self._depths(first), self._depths(last), strict=True):
            apart = before - behind
            at = before / np.where(apart == 0, 1.0, apart)
            begin = np.where(before < 0, np.where(behind < 0, 2.0, np.maximum(begin, at)), begin)
            end = np.where((behind < 0) & (before >= 0), np.minimum(end, at), end)
        return begin, end

    def _depths(self, at: np.ndarray) -> tuple[np.ndarray, ...]:
        """Linear functions of places [2, N] that are negative outside: beyond the four sides."""
        (low, high), (least, most) = np.clip([self.values, self.gradients], -ENDLESS, ENDLESS)
        value, size = at
        if self.shape == "triangle":
            narrower = (high - low) / 2 * (most - size) / (most - least)
            low, high = low + narrower, high - narrower
        return value - low, high - value, size - least, most - size

    def _profile(self, first: np.ndarray, last: np.ndarray, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
        """Mean [N] of the profile over the part of the lines inside."""
        x0, x1 = self._across(first[0]), self._across(last[0])
        y0, y1 = self._along(first[1]), self._along(last[1])
        # either side of the middle
        apart = x0 - x1
        middle = np.clip(x0 / np.where(apart == 0, 1.0, apart), begin, np.maximum(begin, end))
        if self.shape == "gaussian":
            middle = (begin + end) / 2
        total = np.zeros(len(begin))
        for low, high in ((begin, middle), (middle, end)):
            for place, weight in GAUSS:
                at = low + (high - low) * place
                total += weight * (high - low) * self._density(x0 + (x1 - x0) * at, y0 + (y1 - y0) * at)
        length = end - begin
        at_point = self._density(x0 + (x1 - x0) * begin, y0 + (y1 - y0) * begin)
        return np.where(length > 0, total / np.where(length > 0, length, 1.0), at_point)

    def _across(self, value: np.ndarray) -> np.ndarray:
        """Values from −1 to 1 over the region."""
        low, high = self.values
        return (value - (low + high) / 2) / ((high - low) / 2)

    def _along(self, size: np.ndarray) -> np.ndarray:
        """Gradients from 0 to 1 over the region."""
        low, high = self.gradients
        return (size - low) / (high - low)

    def _density(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        if self.shape == "gaussian":
            return np.asarray(np.exp(-(x**2 + (2 * y - 1) ** 2) / (2 * DEVIATION**2)))
        return np.maximum(1 - np.abs(x) / np.maximum(y, 1e-12), 0.0)

    def _image_mean(self, first: np.ndarray, last: np.ndarray, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
        """[N, 4]: mean of an image's matter along its row in the middle of the part of the lines inside."""
        rows, columns = self.table.shape[:2]
        middle = (begin + end) / 2
        row = self._along(first[1] + (last[1] - first[1]) * middle) * rows
        row = np.clip(np.floor(row), 0, rows - 1).astype(np.int64)
        places = [(self._across(first[0] + (last[0] - first[0]) * at) + 1) / 2 * columns for at in (begin, end)]
        cells = [np.clip(np.floor(place), 0, columns - 1).astype(np.int64) for place in places]
        until = [
            self.below[row, cell] + (place - cell)[:, None] * self.table[row, cell]
            for place, cell in zip(places, cells, strict=True)
        ]
        apart = np.where(cells[0] == cells[1], 1.0, places[1] - places[0])[:, None]
        mean = np.where((cells[0] == cells[1])[:, None], self.table[row, cells[0]], (until[1] - until[0]) / apart)
        return np.asarray(np.maximum(end - begin, 0.0)[:, None] * np.maximum(mean, 0.0))


def extinction_of(opacity: ArrayLike) -> np.ndarray:
    """Extinction per reference length of opacities; 1 is read as 1 − 2⁻²⁴."""
    return np.asarray(-np.log1p(-np.minimum(np.asarray(opacity, dtype=np.float64), OPAQUE)))


def _split(text: str) -> tuple[str, str, str, str]:
    """Shape, numbers, colour or path, and opacity in a region's text; "" for what is missing."""
    shape, _, rest = text.partition(":")
    numbers, _, look = rest.partition(":")
    color, _, opacity = look.rpartition(":")
    try:
        float(opacity)
    except ValueError:
        # a path may have colons
        color, opacity = look, ""
    return shape, numbers, color, opacity


def check_regions(values: Any) -> tuple[Region, ...]:
    """Regions of regions and texts, at most MOST_REGIONS and one image. Raises InputError."""
    regions = tuple(map(Region.of, (values,) if isinstance(values, str | Region) else values))
    if len(regions) > MOST_REGIONS:
        raise expected("regions", f"at most {MOST_REGIONS}", len(regions))
    if sum(region.is_image for region in regions) > 1:
        raise expected("regions", "at most one image", "several", "paint them into one picture")
    return regions


def move_image(region: Region | str, move: Callable[[str], str]) -> Region | str:
    """A region, or its text, with `move` applied to the path of its image."""
    if isinstance(region, Region):
        return replace(region, color=move(region.color)) if region.is_image else region
    shape, numbers, path, opacity = _split(str(region))
    return ":".join([shape, numbers, move(path), *filter(None, [opacity])]) if shape == "image" else region


def describe_regions(regions: Sequence[Region]) -> str:
    """Sentence on regions and the error of their means."""
    shapes = {shape: sum(region.shape == shape for region in regions) for shape in SHAPES}
    near = f"within {GAUSS_ERROR:.1%} of its extinction"
    error = {"box": "exact", "triangle": near, "gaussian": near, "image": "exact along a row of pixels"}
    counted = ", ".join(f"{count} × {shape} ({error[shape]})" for shape, count in shapes.items() if count)
    return f"regions over value and gradient, both linear between two places of a ray: {counted}"


def mean_matter(regions: Sequence[Region], first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """[N, 4]: emission and extinction per reference length of all regions over straight lines from `first` to `last`,
    values and gradients [2, N].
    """
    total = np.zeros((first.shape[1], 4))
    for region in regions:
        total += region.mean(first, last)
    return total


def matter_at(regions: Sequence[Region], values: ArrayLike, sizes: ArrayLike) -> np.ndarray:
    """[N, 4]: emission and extinction per reference length at values [N] with gradient magnitudes [N]; 0 for NaN."""
    at = np.stack([np.asarray(values, np.float64), np.asarray(sizes, np.float64)])
    known = np.asarray(np.isfinite(at).all(axis=0))
    at = np.where(known, at, 0.0)
    return mean_matter(regions, at, at) * known[:, None]


def _color(name: Any) -> str:
    """A colour as #rrggbb. Raises InputError for others."""
    try:
        return "#{:02x}{:02x}{:02x}".format(*srgb_of_name(str(name)))
    except ValueError as error:
        raise expected("region's color", "#rrggbb or a name in CSS", repr(name)) from error


def _read_picture(path: str) -> np.ndarray:
    """uint8 [rows, columns, 4]: sRGB and alpha of a picture. Raises InputError for what is none."""
    from PIL import Image

    try:
        with Image.open(Path(path)) as picture:
            if max(picture.size) > MOST_SIDE:
                raise expected(f"region {path}", f"at most {MOST_SIDE} pixels a side", max(picture.size))
            return np.asarray(picture.convert("RGBA"))
    except (OSError, SyntaxError) as error:
        raise InputError(f"region {path}: expected a picture with alpha, got {error}") from error

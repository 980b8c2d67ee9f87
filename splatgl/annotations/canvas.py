"""Canvas for antialiased lines and text with halos; the subject, view and rows of annotations."""

from __future__ import annotations

import unicodedata
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np

from splatgl.annotations.text import MICRO, load_font, plain, write_line
from splatgl.data.affine import METRES, unit_name
from splatgl.data.color import Color
from splatgl.data.figure import HALO_ALPHA, AreaMark, Halo, LinesMark, Mark, PatchMark, TextMark, move_mark
from splatgl.data.mesh import Mesh, unroll_ranges
from splatgl.data.volume import AxisCoordinate, Triple, Volume
from splatgl.errors import error_prefix, expected
from splatgl.geometry.camera import Camera
from splatgl.options import ValueKind, check_options, declared, option, reject_unknown
from splatgl.transfer.colormaps import control_colors
from splatgl.transfer.transfer import Transfer

# font height as a fraction of the smaller side, and its minimum in pixels
FONT_SHARE, LEAST_FONT = 0.026, 11
# subpixels along each axis of a line's pixel
FINE = 4
# unit of the lengths of a grid without one, whose steps are 1
VOXELS = "voxels"
# height of the font on paper, in points of 1/72 inch
PAPER_FONT = 8.0
BLACK, WHITE = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)
# share of a direction's largest component from which it counts
ALONG = 1e-6
# linear light halfway between black and white to the eye
MIDDLE = 0.18
# largest light and opacity of an empty pixel
EMPTY = 2e-3

Point: TypeAlias = Sequence[float] | np.ndarray


@dataclass(frozen=True)
class Rect:
    """Pixels left ≤ x < right, top ≤ y < bottom."""

    left: int
    top: int
    right: int
    bottom: int

    def meets(self, other: Rect) -> bool:
        """Whether both share a pixel."""
        across = self.left < other.right and other.left < self.right
        return across and self.top < other.bottom and other.top < self.bottom


# changed pixels: a rectangle, a rectangle with the only patch on it, or indices of pixels
Touched: TypeAlias = Rect | np.ndarray | tuple[Rect, np.ndarray]


@dataclass(frozen=True, eq=False)
class Canvas:
    """pixels: float32 [H, W, 4], linear, premultiplied. ink: colour of text and lines. picture [H, W, 4]: the image
    below, or None; ground: linear RGB of its empty pixels. taken: reserved places. notes: reasons for omissions.
    touched: changed pixels. scratch: buffer for lines. font: its height in pixels; 0: by the size of the image.
    marks: what was drawn, for PDF and SVG; None: not recorded.
    """

    pixels: np.ndarray
    ink: Color
    picture: np.ndarray | None = None
    ground: Color | None = None
    taken: list[Rect] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    touched: list[Touched] = field(default_factory=list)
    scratch: list[np.ndarray] = field(default_factory=list, repr=False)
    font: int = 0
    marks: list[Mark] | None = None

    @classmethod
    def over(cls, pixels: np.ndarray, ground: Color | None, dpi: float | None = None) -> Canvas:
        """Empty canvas for an image, with black or white ink, as is legible at its edges over `ground` or white.

        dpi: of an image on paper, whose letters are PAPER_FONT high.
        """
        font = 0 if dpi is None else max(1, round(PAPER_FONT / 72 * dpi))
        edges = np.concatenate([pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]])
        light = edges[:, :3] + (1 - edges[:, 3:]) * np.asarray(ground or WHITE, np.float32)
        return cls(np.zeros_like(pixels, dtype=np.float32), ink_on(light), pixels, ground, font=font, marks=[])

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        return self.pixels.shape[1], self.pixels.shape[0]

    @property
    def halo(self) -> Color:
        """Colour of halos: black for white ink, else white."""
        return BLACK if self.ink == WHITE else WHITE

    @property
    def em(self) -> int:
        """Height of the font in pixels."""
        return self.font or max(LEAST_FONT, round(FONT_SHARE * min(self.size)))

    @property
    def pad(self) -> int:
        """Distance from the image's edges and between annotations, pixels."""
        return round(0.7 * self.em)

    @property
    def edge(self) -> int:
        """Width of a halo, pixels."""
        return max(1, round(self.em / 12))

    @property
    def stroke(self) -> float:
        """Width of a line, pixels."""
        return max(1.25, self.em / 10)

    def free(self, rect: Rect) -> bool:
        """Whether a rectangle is within the image and free."""
        width, height = self.size
        inside = rect.left >= 0 and rect.top >= 0 and rect.right <= width and rect.bottom <= height
        return inside and not any(rect.meets(other) for other in self.taken)

    def covered(self, rect: Rect) -> int:
        """Number of pixels of the image there that are not empty; 0 without an image."""
        if self.picture is None:
            return 0
        part = self.picture[max(rect.top, 0) : rect.bottom, max(rect.left, 0) : rect.right]
        if self.ground is not None:
            over = part[..., :3] + (1 - part[..., 3:]) * np.asarray(self.ground, np.float32)
            return int((np.abs(over - np.asarray(self.ground, np.float32)) > EMPTY).any(axis=-1).sum())
        return int((part[..., 3] > EMPTY).sum())

    def reserve(self, places: Sequence[Rect], name: str) -> Rect | None:
        """Reserves a free rectangle, preferably where the image is empty; None, with a note, if none is free."""
        free = [place for place in places if self.free(place)]
        reserved = next((place for place in free if not self.covered(place)), free[0] if free else None)
        if reserved is not None:
            self.taken.append(reserved)
        else:
            self.notes.append(f"no room for the {name} in {self.size[0]}×{self.size[1]} pixels")
        return reserved

    def text_size(self, text: str) -> tuple[int, int]:
        """Width and height of a line of text with its halo."""
        return text_size(text, self.em, self.edge)

    def write(self, text: str, corners: Iterable[tuple[int, int]], name: str, color: Color | None = None) -> None:
        """Draws a line of text at the first free corner, left and top, as `reserve` chooses; a note if none is free."""
        wide, tall = self.text_size(text)
        rect = self.reserve([Rect(left, top, left + wide, top + tall) for left, top in corners], name)
        if rect is not None:
            self.text(text, rect.left, rect.top, color)

    def mark(self, mark: Mark) -> None:
        """Records a drawn rectangle."""
        if self.marks is not None:
            self.marks.append(mark)

    def text(self, text: str, left: int, top: int, color: Color | None = None) -> None:
        """Draws a line of text with its halo; (left, top): corner of its `text_size`."""
        corner = float(left + self.edge), float(top + baseline(self.em, self.edge))
        self.mark(TextMark(text, corner, self.em, color or self.ink, Halo(self.halo, self.edge)))
        self.paste(_text_patch(text, self.em, self.edge, color or self.ink, self.halo), (left, top))

    def lines(self, paths: Sequence[Sequence[Point]], color: Color | None = None) -> None:
        """Draws antialiased lines with halos through points (x, y); the centre of pixel (0, 0) is (½, ½)."""
        arrays = [np.asarray(path, np.float64) for path in paths]
        parts = [np.concatenate([path[:-1], path[1:]], axis=1) for path in arrays if len(path) > 1]
        if parts:
            self.segments(np.concatenate(parts), color)

    def segments(
        self, segments: np.ndarray, color: Color | None = None, alpha: float = 1.0, width: float | None = None
    ) -> None:
        """Draws antialiased segments [S, 4], (x, y, x, y), with halos. width: None: `stroke`."""
        half = (self.stroke if width is None else width) / 2
        self.mark(LinesMark(segments, 2 * half, color or self.ink, alpha, Halo(self.halo, self.edge)))
        if not self.scratch:
            self.scratch.append(np.full(self.size[0] * self.size[1], np.inf, np.float32))
        number = pixels_near(segments, half + self.edge + 0.5, self.size, self.scratch[0])
        apart = self.scratch[0][number]
        self.scratch[0][number] = np.inf
        flat = self.pixels.reshape(-1, 4)
        drawn = flat[number]
        halves = ((half + self.edge, self.halo, HALO_ALPHA * alpha / 2), (half, color or self.ink, alpha))
        for reach, paint, share in halves:
            cover = (np.clip(reach + 0.5 - apart, 0, 1) * share)[:, None]
            drawn = drawn * (1 - cover) + cover * np.array([*paint, 1.0], np.float32)
        flat[number] = drawn
        self.touched.append(number)

    def polygon(self, points: np.ndarray, color: Color) -> None:
        """Fills a polygon [N, 2]."""
        self.mark(AreaMark(points, color))
        low = np.maximum(np.floor(points.min(axis=0) - 1), 0).astype(int)
        high = np.minimum(np.ceil(points.max(axis=0) + 1), self.size).astype(int)
        if (high <= low).any():
            return
        mask, pen = _canvas(*((high - low) * FINE).tolist())
        # Pillow's coordinates are centres of pixels
        pen.polygon([tuple(point) for point in ((points - low) * FINE - 0.5).tolist()], fill=255)
        cover = np.asarray(mask, np.float32).reshape(high[1] - low[1], FINE, high[0] - low[0], FINE).mean(axis=(1, 3))
        self._blend(cover / 255, color, (int(low[0]), int(low[1])))

    def bar(self, left: float, right: float, top: int, bottom: int, color: Color | None = None) -> None:
        """Draws a horizontal bar with a halo, its ends exact to fractions of a pixel."""
        edge = self.edge
        for grow, paint, share in ((edge, self.halo, HALO_ALPHA), (0, color or self.ink, 1.0)):
            start = int(np.floor(left - grow))
            cell = np.arange(start, int(np.ceil(right + grow)))
            cover = np.clip(np.minimum(cell + 1, right + grow) - np.maximum(cell, left - grow), 0, 1)
            rows = np.ones((bottom - top + 2 * grow, 1))
            self._blend((rows * cover * share).astype(np.float32), paint, (start, top - grow))
            corners = [(left, top), (right, top), (right, bottom), (left, bottom)]
            outwards = np.array([(-grow, -grow), (grow, -grow), (grow, grow), (-grow, grow)])
            self.mark(AreaMark(np.array(corners) + outwards, paint, share))

    def blend_mask(self, mask: np.ndarray, color: Color | np.ndarray, at: tuple[int, int]) -> None:
        """Draws linear RGB, one or [h, w, 3], over the canvas by a coverage mask [h, w]; at: (x, y) of its corner."""
        self.mark(PatchMark(self._blend(mask, color, at), at))

    def _blend(self, mask: np.ndarray, color: Color | np.ndarray, at: tuple[int, int]) -> np.ndarray:
        """Pastes what `blend_mask` draws, and returns it: [h, w, 4], linear, premultiplied."""
        paint = np.broadcast_to(np.asarray(color, np.float32), (*mask.shape, 3))
        patch = np.concatenate([paint * mask[..., None], mask[..., None]], axis=-1)
        self.paste(patch, at)
        return patch

    def add(self, part: Canvas, at: tuple[int, int]) -> None:
        """Draws a smaller canvas over this one; at: (x, y) of its corner."""
        self.paste(part.pixels, at)
        if self.marks is not None:
            self.marks.extend(move_mark(mark, *at) for mark in part.marks or ())

    def clear(self, rect: Rect) -> None:
        """Clears a rectangle."""
        self.pixels[rect.top : rect.bottom, rect.left : rect.right] = 0

    def paste(self, patch: np.ndarray, at: tuple[int, int]) -> None:
        """Draws a premultiplied patch [h, w, 4] over the canvas; at: (x, y) of its corner."""
        (width, height), (x, y) = self.size, at
        left, top = max(x, 0), max(y, 0)
        right, bottom = min(x + patch.shape[1], width), min(y + patch.shape[0], height)
        if left < right and top < bottom:
            inner = patch[top - y : bottom - y, left - x : right - x]
            under = self.pixels[top:bottom, left:right]
            alone = inner.shape == patch.shape and not under[..., 3].any()
            if alone:
                under[:] = patch
            else:
                under *= 1 - inner[..., 3:]
                under += inner
            rect = Rect(left, top, right, bottom)
            self.touched.append((rect, patch) if alone else rect)


def ink_on(light: np.ndarray) -> Color:
    """Black or white, whichever is legible on linear RGB [..., 3]."""
    return WHITE if float(light.mean()) < MIDDLE else BLACK


@lru_cache(maxsize=1024)
def text_size(text: str, em: int, edge: int) -> tuple[int, int]:
    """Width and height of a line of text with its halo; em: font height."""
    length = load_font(em).getlength(readable(text).replace(MICRO, "u"))
    return int(np.ceil(length)) + 2 * edge, em + 2 * edge + 2


@lru_cache(maxsize=256)
def _text_patch(text: str, em: int, edge: int, ink: Color, halo: Color) -> np.ndarray:
    """Line of text with its halo [h, w, 4], linear, premultiplied."""
    width, height = text_size(text, em, edge)
    at = (edge, baseline(em, edge))
    patch: np.ndarray = np.zeros((height, width, 4), np.float32)
    for stroke, paint, share in ((edge, halo, HALO_ALPHA), (0, ink, 1.0)):
        mask, _ = _canvas(width, height)
        write_line(mask, at, readable(text), em, stroke)
        cover = np.asarray(mask, np.float32)[..., None] / 255 * share
        patch = patch * (1 - cover) + cover * np.array([*paint, 1.0], np.float32)
    return patch


def baseline(em: int, edge: int) -> int:
    """Distance of the baseline, the same for all text, from the top of a line with its halo."""
    return edge + round(0.8 * em)


def readable(text: str) -> str:
    """Text in characters that `write_line` draws: without accents, other missing characters as question marks."""
    return MICRO.join(map(_in_font, text.replace("μ", MICRO).split(MICRO)))


def _in_font(text: str) -> str:
    spelled = unicodedata.normalize("NFKD", plain(text.replace("Å", "A")))
    letters = "".join(letter for letter in spelled if not unicodedata.combining(letter))
    return "".join(letter if " " <= letter <= "~" or letter in "°·" else "?" for letter in letters)


def _canvas(width: int, height: int) -> tuple[Any, Any]:
    from PIL import Image, ImageDraw

    mask = Image.new("L", (width, height))
    return mask, ImageDraw.Draw(mask)


def pixels_near(segments: np.ndarray, reach: float, size: tuple[int, int], scratch: np.ndarray) -> np.ndarray:
    """Indices [N] of pixels whose centres are within `reach` pixels of segments [S, 4], (x, y, x, y).

    scratch [H · W]: infinite; receives the distances at these indices. A pixel equally near to two is listed twice.
    """
    width, height = size
    inside = clip_segments(segments, (-reach, -reach, width + reach, height + reach))
    if not len(inside):
        return np.zeros(0, np.intp)
    start, along = inside[:, :2], inside[:, 2:] - inside[:, :2]
    length = np.hypot(along[:, 0], along[:, 1])
    # a dot has any direction
    unit = np.where(length[:, None] > 0, along / np.where(length > 0, length, 1.0)[:, None], [1.0, 0.0])
    # steps along the major axis of a segment; at each step, as many pixels across as any segment needs
    steep = np.abs(along[:, 1]) > np.abs(along[:, 0])
    ends = np.sort(np.where(steep[:, None], inside[:, [1, 3]], inside[:, [0, 2]]), axis=1)
    first = np.floor(ends[:, 0] - reach).astype(np.intp)
    owner, major = unroll_ranges(first, np.floor(ends[:, 1] + reach).astype(np.intp) + 1)
    # swap the axes of steep segments, so that all steps run along the first; lines continue past their ends
    swap = np.where(steep[:, None], np.array([1, 0]), np.array([0, 1]))
    run, rise = (np.take_along_axis(unit, swap[:, n : n + 1], 1)[:, 0] for n in (0, 1))
    at, beside = (np.take_along_axis(start, swap[:, n : n + 1], 1)[:, 0] for n in (0, 1))
    slope = rise / np.where(run == 0, 1.0, run)
    wide = int(np.ceil(2 * reach * np.sqrt(2))) + 2
    ahead = major + 0.5 - at[owner]
    minor = np.floor(beside[owner] + slope[owner] * ahead - wide / 2).astype(np.intp)
    across = minor + 0.5 - beside[owner]
    # both distances are linear in the pixels across
    run, rise = run[owner].astype(np.float32), rise[owner].astype(np.float32)
    pixels = np.arange(wide, dtype=np.float32)
    place = (ahead * run + across * rise).astype(np.float32)[:, None] + pixels * rise[:, None]
    off = (across * run - ahead * rise).astype(np.float32)[:, None] + pixels * run[:, None]
    beyond = np.maximum(np.maximum(-place, place - length[owner, None].astype(np.float32)), 0)
    apart = np.hypot(off, beyond)
    most = np.where(steep, width, height)[owner, None]
    column = minor[:, None] + np.arange(wide)
    lies = (major >= 0) & (major < np.where(steep, height, width)[owner])
    is_near = (apart <= reach) & (column >= 0) & (column < most) & lies[:, None]
    stride = np.where(steep, width, 1)[owner], np.where(steep, 1, width)[owner]
    number = ((major * stride[0])[:, None] + column * stride[1][:, None])[is_near]
    apart = apart[is_near]
    np.minimum.at(scratch, number, apart)
    # keep a pixel where it is nearest
    return np.asarray(number[scratch[number] == apart])


def clip_segments(segments: np.ndarray, box: tuple[float, float, float, float]) -> np.ndarray:
    """Parts [M, 4] of segments [S, 4] within a box (left, top, right, bottom); Liang and Barsky 1984."""
    start, along = segments[:, :2], segments[:, 2:] - segments[:, :2]
    enter, leave = np.zeros(len(segments)), np.ones(len(segments))
    meets = np.ones(len(segments), bool)
    for axis in (0, 1):
        still = along[:, axis] == 0
        step = np.where(still, 1.0, along[:, axis])
        ends = np.sort((np.array([box[axis], box[axis + 2]]) - start[:, axis, None]) / step[:, None], axis=1)
        enter = np.where(still, enter, np.maximum(enter, ends[:, 0]))
        leave = np.where(still, leave, np.minimum(leave, ends[:, 1]))
        meets &= ~still | ((start[:, axis] >= box[axis]) & (start[:, axis] <= box[axis + 2]))
    meets &= enter <= leave
    parts = np.concatenate([start + along * enter[:, None], start + along * leave[:, None]], axis=1)
    return np.asarray(parts[meets])


def split_into_dashes(segments: np.ndarray, dash: float, gap: float) -> np.ndarray:
    """Dashes [D, 4] of segments [S, 4], from their first points on; the last dash may be shorter."""
    length = np.hypot(*(segments[:, 2:] - segments[:, :2]).T)
    count = np.ceil(length / (dash + gap)).astype(np.intp)
    owner, number = unroll_ranges(np.zeros_like(count), count)
    from_ = number * (dash + gap)
    to = np.minimum(from_ + dash, length[owner])
    start = segments[owner, :2]
    unit = (segments[owner, 2:] - start) / np.where(length > 0, length, 1.0)[owner, None]
    return np.concatenate([start + unit * from_[:, None], start + unit * to[:, None]], axis=1)


def _points(value: Any) -> tuple[Triple, ...]:
    points = tuple(ValueKind.numbers(3, "X,Y,Z").check(point) for point in value)
    if len(points) not in (2, 3):
        raise ValueError
    return points


@dataclass(frozen=True)
class ColorScale:
    """A colour map, the values at its ends, and the name of the quantity."""

    colormap: str
    low: float
    high: float
    label: str

    @classmethod
    def of(cls, meshes: Sequence[Mesh]) -> tuple[ColorScale, ...]:
        """Distinct scales of the visible meshes with values."""
        visible = [mesh for mesh in meshes if mesh.mapped and mesh.opacity > 0]
        return tuple(dict.fromkeys(cls(mesh.colormap, *mesh.ranged, mesh.quantity or mesh.name) for mesh in visible))


@dataclass(frozen=True)
class Measure:
    """The distance between two points, or the angle at the second of three; points: world units."""

    points: tuple[Triple, ...] = option(
        (), ValueKind("two points, or three for an angle, of three finite numbers each", _points)
    )
    name: str = option("", ValueKind.instance("a text", str))

    def __post_init__(self) -> None:
        check_options(self)

    @classmethod
    def of(cls, value: Any) -> Measure:
        """The measure of a Measure, of points, or of text. Raises ValueError for others."""
        if isinstance(value, str):
            return cls.read(value)
        return value if isinstance(value, Measure) else cls(_points(value))

    @classmethod
    def read(cls, text: str) -> Measure:
        """The measure of [NAME=]X,Y,Z:X,Y,Z[:X,Y,Z]. Raises ValueError for other text."""
        name, _, points = text.rpartition("=")
        return cls(_points([ValueKind.numbers(3, "").read(point) for point in points.split(":")]), name.strip())

    @classmethod
    def of_table(cls, what: str, table: Any) -> Measure:
        """The entry of a table of a scene file. Raises InputError for unknown keys and bad values."""
        if not isinstance(table, Mapping) or "points" not in table:
            raise expected(what, "a table with the key points", repr(table)[:80])
        reject_unknown(what, table, declared(cls))
        with error_prefix(what):
            return cls(**table)


def legend_of(layers: Sequence[tuple[Volume, Transfer]]) -> tuple[tuple[str, str], ...]:
    """Names and colours of the segments of layers, and of layers of amounts if there are several."""
    rows = []
    for volume, transfer in layers:
        names = {label.number: label.name for label in volume.labels or ()}
        if transfer.labels:
            rows += [(names.get(n) or f"label {n}", color) for n, color, opacity in transfer.labels if opacity > 0]
        elif len(layers) > 1 and volume.color is None:
            rows.append((volume.name or f"layer {len(rows) + 1}", control_colors(transfer.colormap)[1][-1]))
    return tuple(rows)


@dataclass(frozen=True, eq=False)
class AnnotatedSubject:
    """Volume described by annotations. corners [8, 3]: of the box, world units; center [3]. colored: whether voxels
    have colours. value_name: title of a colour bar, the quantity (else the volume's name) and its unit. scales: of
    meshes. empty: whether voxels show nothing, as below a lone mesh. measures: distances and angles. axes: the file's
    coordinates, as of a volume. legend: names and colours "#rrggbb" of segments, and of several channels or layers.
    """

    corners: np.ndarray
    center: np.ndarray
    unit: str
    name: str
    frame: str | None
    colored: bool
    value_name: str = ""
    scales: tuple[ColorScale, ...] = ()
    empty: bool = False
    measures: tuple[Measure, ...] = ()
    axes: tuple[AxisCoordinate, ...] = ()
    legend: tuple[tuple[str, str], ...] = ()

    @classmethod
    def of(
        cls, volume: Volume, valued: Volume | None = None, layers: Sequence[tuple[Volume, Transfer]] = ()
    ) -> AnnotatedSubject:
        """The subject of a volume. valued: another one, whose values the colour bar shows. layers: the visible ones."""
        of_bar = valued or volume
        colored = of_bar.color is not None
        title = ", ".join(filter(None, (of_bar.quantity or of_bar.name, of_bar.value_unit)))
        # without a unit, a grid of steps of 1 has the lengths of its voxels
        is_grid = volume.points is None and set(volume.spacing) == {1.0} and not volume.axes
        center, unit = volume.center, volume.unit or VOXELS * is_grid
        legend = legend_of(layers)
        place = volume.corners, center, unit, volume.name, volume.frame
        return cls(*place, colored, title, axes=volume.axes, legend=legend)

    def lengths(self, direction: np.ndarray) -> tuple[float, str] | None:
        """Length in a unit per world length along a direction [3], and that unit; None along axes of several units."""
        along = np.abs(direction) > ALONG * float(np.abs(direction).max())
        scales = {(abs(axis.slope), axis.unit) for axis, is_along in zip(self.axes, along, strict=False) if is_along}
        # lengths are converted to the unit of the world
        if all(unit_name(unit) in METRES for unit in (self.unit, *(unit for _, unit in scales))):
            return 1.0, self.unit
        return (1.0, self.unit) if not scales else scales.pop() if len(scales) == 1 else None


@dataclass(frozen=True, eq=False)
class AnnotationView:
    """Inputs of an annotation's functions. blend: of the image. pixels: the image, for a colour bar of sums, and
    their scale; None in live views. text: given after the name and "=".
    """

    subject: AnnotatedSubject
    transfer: Transfer
    camera: Camera
    blend: str = ""
    pixels: np.ndarray | None = None
    scale: float = 1.0
    text: str = ""


Draw = Callable[[Canvas, AnnotationView], None]


@dataclass(frozen=True)
class Annotation:
    """A row of `annotate.ANNOTATIONS`. title: in the help of its key; about: its tooltip in the window.

    rank: annotations of lower rank take their places first. key: toggles it in the window. default: whether the window
    shows it at first. needs_frame: whether it needs patient directions; needs_values: whether it needs values without
    colours. example: of its text, "" if it takes none. lines: functions that draw lines below all annotations, and
    behind the image. room: size of the box that a view is fitted to, over the size of the volume. check: raises
    InputError for a text that it does not take.
    """

    name: str
    title: str
    about: str
    draw: Draw
    rank: int
    key: str = ""
    default: bool = False
    needs_frame: bool = False
    needs_values: bool = False
    example: str = ""
    needs_text: bool = False
    lines: tuple[Draw, Draw] | None = None
    room: float = 1.0
    check: Callable[[str], object] | None = None

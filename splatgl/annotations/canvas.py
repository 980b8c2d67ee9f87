"""Antialiased lines and text with halos, and the `Subject` that annotations describe."""

from __future__ import annotations

import unicodedata
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

from splatgl.annotations.text import plain
from splatgl.data.mesh import Mesh
from splatgl.data.volume import Volume
from splatgl.splat.camera import Camera
from splatgl.splat.transfer import Transfer

# font height as a fraction of the smaller side, and its least, in pixels
FONT_SHARE, LEAST_FONT = 0.026, 11
# subpixels along each axis of a line's pixel
FINE = 4
HALO_ALPHA = 0.7
BLACK, WHITE = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)
# linear light that looks as far from black as from white
MIDDLE = 0.18
# light and opacity of a pixel that shows nothing
EMPTY = 2e-3

Color = tuple[float, float, float]
Point = Sequence[float] | np.ndarray


@dataclass(frozen=True)
class Rect:
    """Pixels left ≤ x < right, top ≤ y < bottom."""

    left: int
    top: int
    right: int
    bottom: int

    def meets(self, other: Rect) -> bool:
        """Whether both have a pixel in common."""
        across = self.left < other.right and other.left < self.right
        return across and self.top < other.bottom and other.top < self.bottom

    def moved(self, x: int, y: int) -> Rect:
        """It, that many pixels further right and down."""
        return Rect(self.left + x, self.top + y, self.right + x, self.bottom + y)


# pixels that are drawn on: a rectangle, with the patch that alone lies there, or their numbers
Touched = Rect | np.ndarray | tuple[Rect, np.ndarray]


@dataclass(frozen=True, eq=False)
class Canvas:
    """pixels: float32 [H, W, 4], linear, premultiplied. ink: of text and lines; picture: what it lies on, [H, W, 4], or
    None; ground: linear RGB of that where it is empty. taken: reserved places; notes: what is left out, and why;
    touched: what is drawn on. scratch: of lines, made with the first. font: its height, 0: as suits the picture.
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

    @classmethod
    def over(cls, pixels: np.ndarray, ground: Color | None) -> Canvas:
        """An empty layer for a picture; its ink is black or white, whichever reads at the picture's edges.

        Transparency counts as `ground`, or else as white.
        """
        edges = np.concatenate([pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]])
        seen = edges[:, :3] + (1 - edges[:, 3:]) * np.asarray(ground or WHITE, np.float32)
        return cls(np.zeros_like(pixels, dtype=np.float32), ink_on(seen), pixels, ground)

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        return self.pixels.shape[1], self.pixels.shape[0]

    @property
    def halo(self) -> Color:
        """The contrary of the ink."""
        return BLACK if self.ink == WHITE else WHITE

    @property
    def em(self) -> int:
        """Height of the font in pixels."""
        return self.font or max(LEAST_FONT, round(FONT_SHARE * min(self.size)))

    @property
    def pad(self) -> int:
        """Distance from the picture's edges and between annotations."""
        return round(0.7 * self.em)

    @property
    def edge(self) -> int:
        """Width of a halo."""
        return max(1, round(self.em / 12))

    @property
    def stroke(self) -> float:
        """Width of a line."""
        return max(1.25, self.em / 10)

    def free(self, rect: Rect) -> bool:
        """Whether a place is within the picture, and not taken."""
        width, height = self.size
        inside = rect.left >= 0 and rect.top >= 0 and rect.right <= width and rect.bottom <= height
        return inside and not any(rect.meets(other) for other in self.taken)

    def empty(self, rect: Rect) -> bool:
        """Whether the picture shows nothing there; True if it is not known."""
        if self.picture is None:
            return True
        part = self.picture[max(rect.top, 0) : rect.bottom, max(rect.left, 0) : rect.right]
        if self.ground is not None:
            over = part[..., :3] + (1 - part[..., 3:]) * np.asarray(self.ground, np.float32)
            return bool((np.abs(over - np.asarray(self.ground, np.float32)) <= EMPTY).all())
        return bool((part[..., 3] <= EMPTY).all())

    def place(self, places: Sequence[Rect], what: str) -> Rect | None:
        """Takes the first place that is free, of those where the picture is empty if there are any; None, with a note
        about `what`, if none is free.
        """
        free = [each for each in places if self.free(each)]
        found = next((each for each in free if self.empty(each)), free[0] if free else None)
        if found is not None:
            self.taken.append(found)
        else:
            self.notes.append(f"no room for the {what} in {self.size[0]}×{self.size[1]} pixels")
        return found

    def text_size(self, text: str) -> tuple[int, int]:
        """Width and height of a line of text with its halo."""
        return text_size(text, self.em, self.edge)

    def text(self, text: str, left: int, top: int, color: Color | None = None) -> None:
        """A line of text with its halo; (left, top): of the place that `text_size` tells."""
        self.lay(_written(text, self.em, self.edge, color or self.ink, self.halo), (left, top))

    def lines(self, paths: Sequence[Sequence[Point]], color: Color | None = None, alpha: float = 1.0) -> None:
        """Antialiased lines through points (x, y), the centre of pixel (0, 0) at (½, ½), with a halo."""
        every = [np.asarray(path, np.float64) for path in paths]
        parts = [np.concatenate([path[:-1], path[1:]], axis=1) for path in every if len(path) > 1]
        if parts:
            self.segments(np.concatenate(parts), color, alpha)

    def segments(
        self, segments: np.ndarray, color: Color | None = None, alpha: float = 1.0, width: float | None = None
    ) -> None:
        """Antialiased lines [S, 4], (x, y, x, y), with a halo; None: of the stroke's width."""
        half = (self.stroke if width is None else width) / 2
        if not self.scratch:
            self.scratch.append(np.full(self.size[0] * self.size[1], np.inf, np.float32))
        number = near(segments, half + self.edge + 0.5, self.size, self.scratch[0])
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
        """A filled polygon [N, 2]."""
        low = np.maximum(np.floor(points.min(axis=0) - 1), 0).astype(int)
        high = np.minimum(np.ceil(points.max(axis=0) + 1), self.size).astype(int)
        if (high <= low).any():
            return
        mask, pen = _canvas(*((high - low) * FINE).tolist())
        # Pillow's coordinates are of pixels' centres
        pen.polygon([tuple(point) for point in ((points - low) * FINE - 0.5).tolist()], fill=255)
        cover = np.asarray(mask, np.float32).reshape(high[1] - low[1], FINE, high[0] - low[0], FINE).mean(axis=(1, 3))
        self.stamp(cover / 255, color, (int(low[0]), int(low[1])))

    def bar(self, left: float, right: float, top: int, bottom: int) -> None:
        """A horizontal bar from `left` to `right`, its ends exact to fractions of a pixel, with a halo."""
        edge = self.edge
        for grow, paint, share in ((edge, self.halo, HALO_ALPHA), (0, self.ink, 1.0)):
            start = int(np.floor(left - grow))
            cell = np.arange(start, int(np.ceil(right + grow)))
            cover = np.clip(np.minimum(cell + 1, right + grow) - np.maximum(cell, left - grow), 0, 1)
            rows = np.ones((bottom - top + 2 * grow, 1))
            self.stamp((rows * cover * share).astype(np.float32), paint, (start, top - grow))

    def stamp(self, mask: np.ndarray, color: Color | np.ndarray, at: tuple[int, int]) -> None:
        """Colour (linear RGB, or [h, w, 3]) 'over' the layer where `mask` [h, w] covers it; (x, y) of its corner."""
        paint = np.broadcast_to(np.asarray(color, np.float32), (*mask.shape, 3))
        self.lay(np.concatenate([paint * mask[..., None], mask[..., None]], axis=-1), at)

    def clear(self, rect: Rect) -> None:
        """Takes away what is drawn there."""
        self.pixels[rect.top : rect.bottom, rect.left : rect.right] = 0

    def lay(self, patch: np.ndarray, at: tuple[int, int]) -> None:
        """A premultiplied patch [h, w, 4] 'over' the layer; (x, y) of its corner."""
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


def ink_on(seen: np.ndarray) -> Color:
    """Black or white, whichever reads on linear RGB [..., 3]."""
    return WHITE if float(seen.mean()) < MIDDLE else BLACK


@lru_cache(maxsize=1024)
def text_size(text: str, em: int, edge: int) -> tuple[int, int]:
    """Width and height of a line of text of that font height with its halo."""
    return int(np.ceil(_font(em).getlength(readable(text)))) + 2 * edge, em + 2 * edge + 2


@lru_cache(maxsize=256)
def _written(text: str, em: int, edge: int, ink: Color, halo: Color) -> np.ndarray:
    """A line of text and its halo, linear and premultiplied, [h, w, 4]."""
    width, height = text_size(text, em, edge)
    found: np.ndarray = np.zeros((height, width, 4), np.float32)
    for stroke, paint, share in ((edge, halo, HALO_ALPHA), (0, ink, 1.0)):
        mask, pen = _canvas(width, height)
        # the baseline is the same for all text
        at = (edge, edge + round(0.8 * em))
        pen.text(at, readable(text), font=_font(em), fill=255, stroke_width=stroke, anchor="ls")
        cover = np.asarray(mask, np.float32)[..., None] / 255 * share
        found = found * (1 - cover) + cover * np.array([*paint, 1.0], np.float32)
    return found


def readable(text: str) -> str:
    """Text in characters that the font has: accents are dropped, and what it lacks becomes a question mark."""
    spelled = unicodedata.normalize("NFKD", plain(text.replace("Å", "A").replace("μ", "u")))
    kept = "".join(letter for letter in spelled if not unicodedata.combining(letter))
    return "".join(letter if " " <= letter <= "~" or letter in "°·" else "?" for letter in kept)


def _canvas(width: int, height: int) -> tuple[Any, Any]:
    from PIL import Image, ImageDraw

    mask = Image.new("L", (width, height))
    return mask, ImageDraw.Draw(mask)


@lru_cache(maxsize=8)
def _font(height: int) -> Any:
    from PIL import ImageFont

    return ImageFont.load_default(height)


def near(segments: np.ndarray, reach: float, size: tuple[int, int], scratch: np.ndarray) -> np.ndarray:
    """Numbers [N] of pixels whose centres are within `reach` pixels of segments [S, 4], (x, y, x, y).

    scratch [H · W]: infinite; there, at these numbers, the distances are written. What is as near to two is told twice.
    """
    width, height = size
    inside = clipped(segments, (-reach, -reach, width + reach, height + reach))
    if not len(inside):
        return np.zeros(0, np.intp)
    start, along = inside[:, :2], inside[:, 2:] - inside[:, :2]
    length = np.hypot(along[:, 0], along[:, 1])
    # a dot has any direction
    unit = np.where(length[:, None] > 0, along / np.where(length > 0, length, 1.0)[:, None], [1.0, 0.0])
    # steps along the axis that a segment runs along most, and, at each, as many pixels across as any needs
    steep = np.abs(along[:, 1]) > np.abs(along[:, 0])
    ends = np.sort(np.where(steep[:, None], inside[:, [1, 3]], inside[:, [0, 2]]), axis=1)
    first = np.floor(ends[:, 0] - reach).astype(np.intp)
    steps = np.floor(ends[:, 1] + reach).astype(np.intp) - first + 1
    owner = np.repeat(np.arange(len(inside)), steps)
    major = np.arange(len(owner)) - np.repeat(np.cumsum(steps) - steps - first, steps)
    # each segment as if its steps ran along the first of two axes; past its ends the line goes on
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
    kept = (apart <= reach) & (column >= 0) & (column < most) & lies[:, None]
    stride = np.where(steep, width, 1)[owner], np.where(steep, 1, width)[owner]
    number = ((major * stride[0])[:, None] + column * stride[1][:, None])[kept]
    apart = apart[kept]
    np.minimum.at(scratch, number, apart)
    # each pixel once, as a rule: where it is nearest
    return np.asarray(number[scratch[number] == apart])


def clipped(segments: np.ndarray, box: tuple[float, float, float, float]) -> np.ndarray:
    """The parts [M, 4] of segments [S, 4] within a box (left, top, right, bottom); Liang and Barsky 1984."""
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
    found = np.concatenate([start + along * enter[:, None], start + along * leave[:, None]], axis=1)
    return np.asarray(found[meets])


def dashes(segments: np.ndarray, dash: float, gap: float) -> np.ndarray:
    """Segments [S, 4] as dashes [D, 4] of one length, from the first point on; the last one may be shorter."""
    length = np.hypot(*(segments[:, 2:] - segments[:, :2]).T)
    count = np.ceil(length / (dash + gap)).astype(np.intp)
    owner = np.repeat(np.arange(len(segments)), count)
    from_ = (np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)) * (dash + gap)
    to = np.minimum(from_ + dash, length[owner])
    start = segments[owner, :2]
    unit = (segments[owner, 2:] - start) / np.where(length > 0, length, 1.0)[owner, None]
    return np.concatenate([start + unit * from_[:, None], start + unit * to[:, None]], axis=1)


@dataclass(frozen=True)
class Scale:
    """A colour map and the values at its ends, and what they are of."""

    colormap: str
    low: float
    high: float
    label: str

    @classmethod
    def of(cls, meshes: Sequence[Mesh]) -> tuple[Scale, ...]:
        """Those of meshes whose values are seen, each once."""
        shown = [each for each in meshes if each.mapped and each.opacity > 0]
        return tuple(dict.fromkeys(cls(each.colormap, *each.ranged, each.quantity or each.name) for each in shown))


@dataclass(frozen=True, eq=False)
class Subject:
    """corners [8, 3]: of the box, world units; center [3]. colored: whether voxels have their own colours.

    value_unit: name of the values' unit. scales: of meshes. empty: whether voxels show nothing, as those that a mesh
    alone stands on.
    """

    corners: np.ndarray
    center: np.ndarray
    unit: str
    name: str
    frame: str | None
    colored: bool
    value_unit: str = ""
    scales: tuple[Scale, ...] = ()
    empty: bool = False

    @classmethod
    def of(cls, volume: Volume) -> Subject:
        """That of a volume."""
        colored = volume.color is not None
        return cls(volume.corners, volume.center, volume.unit, volume.name, volume.frame, colored, volume.value_unit)

    @property
    def value_name(self) -> str:
        """What a colour bar is called: the volume's name, and the unit of its values."""
        return f"{self.name}, {self.value_unit}" if self.name and self.value_unit else self.name or self.value_unit


@dataclass(frozen=True, eq=False)
class View:
    """Inputs of an annotation's functions. blend: of the image. pixels: the image, for a colour bar of sums, and their
    scale; None in live views. text: given after the name and "=".
    """

    subject: Subject
    transfer: Transfer
    camera: Camera
    blend: str = ""
    pixels: np.ndarray | None = None
    scale: float = 1.0
    text: str = ""


Draw = Callable[[Canvas, View], None]


@dataclass(frozen=True)
class Annotation:
    """A row of `annotate.ANNOTATIONS`. title: in the help of its key; about: its tooltip in the window.

    rank: annotations of lower rank take their places first. key: toggles it in the window. default: whether the window
    shows it at first. needs_frame: whether it needs patient directions; needs_values: whether it needs values without
    colours. example: of its text, "" if it takes none. draw_below: draws lines below all annotations; draw_behind:
    lines behind the image. room: size of the box that a view is fitted to, over the size of the volume.
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
    draw_below: Draw | None = None
    draw_behind: Draw | None = None
    room: float = 1.0

"""A layer over a picture: antialiased text and lines with a halo, in linear premultiplied light, in reserved places."""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

from splatgl.app.viewer.overlay import plain

# font height as a fraction of the smaller side, and its least, in pixels
FONT_SHARE, LEAST_FONT = 0.026, 11
# subpixels along each axis of a line's pixel
FINE = 4
HALO_ALPHA = 0.7
BLACK, WHITE = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)
# linear light that looks as far from black as from white
MIDDLE = 0.18

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


@dataclass(frozen=True, eq=False)
class Layer:
    """pixels: float32 [H, W, 4], linear, premultiplied. ink: of text and lines; taken: reserved places; notes: what
    is left out, and why.
    """

    pixels: np.ndarray
    ink: Color
    taken: list[Rect] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @classmethod
    def over(cls, pixels: np.ndarray, ground: Color | None) -> Layer:
        """An empty layer for a picture; its ink is black or white, whichever reads at the picture's edges.

        Transparency counts as `ground`, or else as white.
        """
        seen = pixels[..., :3] + (1 - pixels[..., 3:]) * np.asarray(ground or WHITE, np.float32)
        edge = np.concatenate([seen[0], seen[-1], seen[:, 0], seen[:, -1]])
        ink = WHITE if float(edge.mean()) < MIDDLE else BLACK
        return cls(np.zeros_like(pixels, dtype=np.float32), ink)

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
        return max(LEAST_FONT, round(FONT_SHARE * min(self.size)))

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

    def reserve(self, rect: Rect, what: str = "") -> bool:
        """Takes a place; False, with a note about `what`, if it is not free or not within the picture."""
        width, height = self.size
        inside = rect.left >= 0 and rect.top >= 0 and rect.right <= width and rect.bottom <= height
        free = inside and not any(rect.meets(other) for other in self.taken)
        if free:
            self.taken.append(rect)
        elif what:
            self.notes.append(f"no room for the {what} in {width}×{height} pixels")
        return free

    def text_size(self, text: str) -> tuple[int, int]:
        """Width and height of a line of text with its halo."""
        return int(np.ceil(_font(self.em).getlength(readable(text)))) + 2 * self.edge, self.em + 2 * self.edge + 2

    def text(self, text: str, left: int, top: int, color: Color | None = None) -> None:
        """A line of text with its halo; (left, top): of the place that `text_size` tells."""
        width, height = self.text_size(text)
        for stroke, paint, share in ((self.edge, self.halo, HALO_ALPHA), (0, color or self.ink, 1.0)):
            mask, pen = _canvas(width, height)
            # the baseline is the same for all text
            at = (self.edge, self.edge + round(0.8 * self.em))
            pen.text(at, readable(text), font=_font(self.em), fill=255, stroke_width=stroke, anchor="ls")
            self.stamp(np.asarray(mask, np.float32) / 255 * share, paint, (left, top))

    def lines(self, paths: Sequence[Sequence[Point]], color: Color | None = None, alpha: float = 1.0) -> None:
        """Antialiased lines through points (x, y), the centre of pixel (0, 0) at (½, ½), with a halo."""
        for width, paint, share in (
            (self.stroke + 2 * self.edge, self.halo, HALO_ALPHA * alpha / 2),
            (self.stroke, color or self.ink, alpha),
        ):
            self._shape([np.asarray(path, np.float64) for path in paths], width, paint, share)

    def polygon(self, points: np.ndarray, color: Color) -> None:
        """A filled polygon [N, 2]."""
        self._shape([points], 0.0, color, 1.0)

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
        (width, height), (x, y) = self.size, at
        rows = slice(max(y, 0), max(min(y + mask.shape[0], height), 0))
        columns = slice(max(x, 0), max(min(x + mask.shape[1], width), 0))
        if rows.start >= rows.stop or columns.start >= columns.stop:
            return
        inner = (slice(rows.start - y, rows.stop - y), slice(columns.start - x, columns.stop - x))
        share = mask[inner][..., None]
        paint = np.asarray(color, np.float32)
        paint = paint[inner] if paint.ndim == 3 else np.broadcast_to(paint, (*share.shape[:2], 3))
        self.pixels[rows, columns] *= 1 - share
        self.pixels[rows, columns] += share * np.concatenate([paint, np.ones_like(share)], axis=-1)

    def _shape(self, paths: list[np.ndarray], width: float, color: Color, alpha: float) -> None:
        """Lines of a width, or a filled polygon if it is 0."""
        every = np.concatenate(paths)
        low = np.maximum(np.floor(every.min(axis=0) - width - 1), 0).astype(int)
        high = np.minimum(np.ceil(every.max(axis=0) + width + 1), self.size).astype(int)
        if (high <= low).any():
            return
        mask, pen = _canvas(*((high - low) * FINE).tolist())
        for path in paths:
            # Pillow's coordinates are of pixels' centres
            points = [tuple(point) for point in ((path - low) * FINE - 0.5).tolist()]
            if width:
                pen.line(points, fill=255, width=max(1, round(width * FINE)), joint="curve")
            else:
                pen.polygon(points, fill=255)
        cover = np.asarray(mask, np.float32).reshape(high[1] - low[1], FINE, high[0] - low[0], FINE).mean(axis=(1, 3))
        self.stamp(cover / 255 * alpha, color, (int(low[0]), int(low[1])))


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

"""`Figure`: a picture under text, lines and areas, written as PDF or SVG by Matplotlib."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeAlias

import numpy as np

from splatgl.data.color import Color, srgb_from_linear
from splatgl.errors import import_extra

# endings of pages, and the dots per inch of a picture that states none: pixels of CSS
VECTOR, SCREEN_DPI = (".svg", ".pdf"), 96.0
POINTS = 72.0
# opacity of halos
HALO_ALPHA = 0.7


@dataclass(frozen=True)
class Halo:
    """A halo: linear RGB, and its width in pixels."""

    color: Color
    width: float


@dataclass(frozen=True, eq=False)
class TextMark:
    """A line of text from a point on its baseline (x, y), pixels; size: height of the font in pixels."""

    text: str
    at: tuple[float, float]
    size: float
    color: Color
    halo: Halo


@dataclass(frozen=True, eq=False)
class LinesMark:
    """Segments [S, 4], (x, y, x, y), pixels; width in pixels."""

    segments: np.ndarray
    width: float
    color: Color
    alpha: float
    halo: Halo


@dataclass(frozen=True, eq=False)
class AreaMark:
    """A filled polygon [N, 2], pixels."""

    points: np.ndarray
    color: Color
    alpha: float = 1.0


@dataclass(frozen=True, eq=False)
class PatchMark:
    """A small picture, float32 [h, w, 4], linear and premultiplied; at: (x, y) of its corner."""

    pixels: np.ndarray
    at: tuple[float, float]


Mark: TypeAlias = TextMark | LinesMark | AreaMark | PatchMark


def move_mark(mark: Mark, x: float, y: float) -> Mark:
    """A mark, that many pixels farther right and down."""
    if isinstance(mark, LinesMark):
        return replace(mark, segments=mark.segments + np.array([x, y, x, y]))
    if isinstance(mark, AreaMark):
        return replace(mark, points=mark.points + np.array([x, y]))
    return replace(mark, at=(mark.at[0] + x, mark.at[1] + y))


@dataclass(frozen=True, eq=False)
class Figure:
    """A picture [H, W, 4], linear and premultiplied, between the marks below and over it, on linear RGB or nothing."""

    pixels: np.ndarray
    under: Sequence[Mark] = ()
    over: Sequence[Mark] = ()
    ground: Color | None = None

    def encoded(self, suffix: str, info: Mapping[str, object], dpi: float | None) -> bytes:
        """The bytes of a .pdf or .svg: the picture's pixels, text as text, and lines as lines.

        info: the provenance. dpi: pixels of an inch. Raises InputError without Matplotlib.
        """
        library = vector_library()
        page = Page(self.pixels.shape[1], self.pixels.shape[0], dpi or SCREEN_DPI)
        about = json.dumps(dict(info), ensure_ascii=True)
        with library.rc_context(SETTINGS):
            page.begin(self.ground)
            for mark in (*self.under, PatchMark(self.pixels, (0, 0)), *self.over):
                page.draw(mark)
            return page.encoded(suffix, about)


# text stays text; the names of the fonts are those of a page, as pictures have the first
SETTINGS = {"svg.fonttype": "none", "pdf.fonttype": 42, "svg.hashsalt": "splatgl"}
FONTS = ("Aileron", "DejaVu Sans")


def vector_library() -> Any:
    """Matplotlib. Raises InputError if it is missing."""
    return import_extra("matplotlib", "PDF and SVG", "matplotlib", "plots")


@lru_cache(maxsize=1)
def _add_font() -> None:
    """Makes Pillow's built-in font known to Matplotlib, so that pages have the letters of pictures."""
    from matplotlib.font_manager import fontManager
    from PIL import ImageFont

    font: Any = ImageFont.load_default(20)
    folder = TemporaryDirectory(prefix="splatgl-font-")
    _folders.append(folder)
    path = Path(folder.name) / "Aileron.ttf"
    path.write_bytes(font.font_bytes)
    fontManager.addfont(path)


# fonts are read when pages are written, until the process ends
_folders: list[TemporaryDirectory[str]] = []


class Page:
    """A page of Matplotlib in pixels of the picture, row 0 on top."""

    def __init__(self, width: int, height: int, dpi: float) -> None:
        from matplotlib.figure import Figure as Drawing

        _add_font()
        self.dpi, self.size = dpi, (width, height)
        self.drawing = Drawing(figsize=(width / dpi, height / dpi), dpi=dpi)
        self.axes = self.drawing.add_axes((0.0, 0.0, 1.0, 1.0))
        self.axes.set_axis_off()
        self.axes.set(xlim=(0, width), ylim=(height, 0), autoscale_on=False)
        self.rank = 0

    def begin(self, ground: Color | None) -> None:
        """Fills the page, or leaves it transparent."""
        self.drawing.patch.set_visible(ground is not None)
        if ground is not None:
            self.drawing.patch.set_facecolor(_srgb(ground))

    def draw(self, mark: Mark) -> None:
        """Draws a mark over the earlier ones."""
        self.rank += 2
        if isinstance(mark, TextMark):
            self._text(mark)
        elif isinstance(mark, LinesMark):
            self._lines(mark)
        elif isinstance(mark, AreaMark):
            from matplotlib.patches import Polygon

            color = _srgb(mark.color)
            self.axes.add_patch(Polygon(mark.points, color=color, alpha=mark.alpha, lw=0, zorder=self.rank))
        else:
            self._patch(mark)

    def _points(self, pixels: float) -> float:
        return pixels * POINTS / self.dpi

    def _text(self, mark: TextMark) -> None:
        from matplotlib.patheffects import Stroke

        stroke = Stroke(linewidth=self._points(2 * mark.halo.width), foreground=_srgb(mark.halo.color))
        style: dict[str, Any] = {"fontsize": self._points(mark.size), "family": FONTS, "parse_math": False}
        halo = {"alpha": HALO_ALPHA, "path_effects": [stroke], "zorder": self.rank - 1}
        for more in (halo, {"color": _srgb(mark.color), "zorder": self.rank}):
            self.axes.text(*mark.at, mark.text, va="baseline", ha="left", **style, **more)

    def _lines(self, mark: LinesMark) -> None:
        from matplotlib.collections import LineCollection

        ends = mark.segments.reshape(-1, 2, 2)
        halo = mark.width + 2 * mark.halo.width, mark.halo.color, HALO_ALPHA * mark.alpha / 2, self.rank - 1
        for width, color, alpha, rank in (halo, (mark.width, mark.color, mark.alpha, self.rank)):
            style = {"colors": [_srgb(color)], "alpha": alpha, "capstyle": "round", "zorder": rank}
            self.axes.add_collection(LineCollection(list(ends), linewidths=self._points(width), **style))

    def _patch(self, mark: PatchMark) -> None:
        (x, y), (high, wide) = mark.at, mark.pixels.shape[:2]
        alpha = mark.pixels[..., 3:].clip(0, 1)
        color = np.divide(mark.pixels[..., :3], alpha, out=np.zeros_like(mark.pixels[..., :3]), where=alpha > 0)
        straight = np.concatenate([srgb_from_linear(color.clip(0, 1)), alpha], axis=2)
        samples = np.rint(straight * 255).astype(np.uint8)
        place = (x, x + wide, y + high, y)
        self.axes.imshow(samples, extent=place, interpolation="none", aspect="auto", zorder=self.rank)
        self.axes.set(xlim=(0, self.size[0]), ylim=(self.size[1], 0))

    def encoded(self, suffix: str, about: str) -> bytes:
        """The bytes of the page; about: text that it holds."""
        buffer = io.BytesIO()
        if suffix == ".svg":
            metadata: dict[str, Any] = {"Creator": "splatgl", "Description": about, "Date": None}
        else:
            metadata = {"Creator": "splatgl", "Subject": about, "CreationDate": None}
        self.drawing.savefig(buffer, format=suffix[1:], dpi=self.dpi, metadata=metadata)
        # SVG names fonts, of which Helvetica and Arial have nearly the widths of the first
        named = ", ".join(f"'{name}'" for name in FONTS).encode()
        return buffer.getvalue().replace(named, b"Aileron, Helvetica, Arial, 'DejaVu Sans', sans-serif")


def _srgb(color: Color) -> Color:
    red, green, blue = srgb_from_linear(np.asarray(color, np.float64)).tolist()
    return red, green, blue

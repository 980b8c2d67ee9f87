"""Text and lines over the image, in Pillow's built-in font; redrawn only after changes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

# sRGB with alpha: text, its outline, its background; messages, and lines
TEXT, EDGE, PAPER = (235, 235, 235, 255), (0, 0, 0, 255), (0, 0, 0, 190)
NOTE, LINE = (255, 214, 90, 255), (255, 214, 90, 255)
# heights in pixels at a content scale of 1
FONT, PADDING = 13, 6
# line spacing in font heights
LEADING = 1.3
# replacements for characters missing from Pillow's built-in font, which has little beyond ASCII
PLAIN = str.maketrans(
    {
        **{"×": "x", "²": "^2", "³": "^3", "½": "1/2", "≥": ">=", "≤": "<=", "→": "->", "′": "'", "–": "-", "—": "-"},
        **{"τ": "tau", "σ": "sigma", "ρ": "rho", "∇": "grad", "µ": "u", "Σ": "sum", "−": "-", "√": "sqrt", "…": "..."},
    }
)


@dataclass(frozen=True)
class Text:
    """Lines of text at "top left", "bottom left" or "middle"; tabs separate columns.

    note: in the message colour. paper: on a background rectangle.
    """

    lines: tuple[str, ...]
    corner: str = "top left"
    note: bool = False
    paper: bool = False


@dataclass(frozen=True)
class Overlay:
    """Overlay of an image of `size` pixels; equal overlays look the same. scale: the display's content scale."""

    size: tuple[int, int]
    scale: float = 1.0
    texts: tuple[Text, ...] = ()
    polygon: tuple[tuple[float, float], ...] = ()


def drawn(overlay: Overlay) -> np.ndarray:
    """uint8 [H, W, 4], sRGB with straight alpha."""
    from PIL import Image, ImageDraw

    picture = Image.new("RGBA", overlay.size, (0, 0, 0, 0))
    pen = ImageDraw.Draw(picture)
    if len(overlay.polygon) > 2:
        pen.line([*overlay.polygon, overlay.polygon[0]], fill=LINE, width=max(1, round(overlay.scale)))
    for text in overlay.texts:
        _write(picture, text, overlay)
    return np.asarray(picture)


def plain(text: str) -> str:
    """Text with characters missing from the font replaced."""
    return text.translate(PLAIN)


def _write(picture: Any, text: Text, overlay: Overlay) -> None:
    from PIL import Image, ImageDraw, ImageFilter

    font, pad = _font(round(FONT * overlay.scale)), round(PADDING * overlay.scale)
    rows = [[plain(cell) for cell in line.split("\t")] for line in text.lines]
    # column widths come from rows with several cells; a single cell spans all columns
    tabbed = [row for row in rows if len(row) > 1]
    ends = [0.0]
    for column in range(max(map(len, tabbed), default=0)):
        ends.append(ends[-1] + 2 * pad + max(font.getlength(row[column]) for row in tabbed if column < len(row)))
    widest = max([ends[-1] - 2 * pad, *(font.getlength(row[0]) for row in rows if len(row) == 1)])
    step = round(FONT * LEADING * overlay.scale)
    width, height = int(widest) + 2 * pad, step * len(rows) + 2 * pad
    left, top = _corner(text.corner, overlay.size, (width, height), pad)
    # the glyphs, with a black outline
    letters = Image.new("L", (width, height))
    pen = ImageDraw.Draw(letters)
    for number, row in enumerate(rows):
        for column, cell in enumerate(row):
            pen.text((pad + ends[column], pad + number * step), cell, font=font, fill=255)
    if text.paper:
        picture.paste(PAPER, (left, top, left + width, top + height))
    picture.paste(EDGE, (left, top), letters.filter(ImageFilter.MaxFilter(2 * round(overlay.scale) + 1)))
    picture.paste(NOTE if text.note else TEXT, (left, top), letters)


def _corner(corner: str, size: tuple[int, int], box: tuple[int, int], pad: int) -> tuple[int, int]:
    right, bottom = size[0] - box[0] - pad, size[1] - box[1] - pad
    if corner == "middle":
        return max(0, (size[0] - box[0]) // 2), max(0, (size[1] - box[1]) // 2)
    return right if "right" in corner else pad, bottom if "bottom" in corner else pad


@lru_cache(maxsize=8)
def _font(height: int) -> Any:
    from PIL import ImageFont

    return ImageFont.load_default(height)

"""Text blocks, drawn by Pillow."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise, product
from typing import Any, NamedTuple

import numpy as np

Box = tuple[float, float, float, float]
Color = tuple[int, int, int, int]


@lru_cache(maxsize=64)
def label(lines: tuple[str, ...], scale: float = 1.0, light: bool = False) -> np.ndarray:
    """uint8 [h, w, 4], sRGB, straight alpha: a text as those of an overlay; equal texts are one array."""
    from PIL import Image

    block = _block(lines, FONT * scale, 1)
    picture = Image.new("RGBA", block.size)
    _write(picture, block, (0, 0, *block.size), INKS[light][0], INKS[light][2])
    return np.asarray(picture)


def place_label(place: tuple[float, float], size: tuple[int, int], window: tuple[int, int], gap: float) -> Box:
    """Left, top, right, bottom of a label of `size` next to a position, on the side where the window has room."""
    corner = []
    for at, long, room in zip(place, size, window, strict=True):
        start = at + gap if at + gap + long <= room else at - gap - long
        corner.append(float(np.clip(round(start), 0, max(room - long, 0))))
    return corner[0], corner[1], corner[0] + size[0], corner[1] + size[1]


Path = tuple[tuple[float, float], ...]

# sRGB with alpha: text, messages and their background, over dark and over light pictures; lines and their outline
INKS = (
    ((235, 235, 235, 255), (255, 214, 90, 255), (0, 0, 0, 175)),
    ((25, 25, 25, 255), (122, 70, 0, 255), (255, 255, 255, 205)),
)
EDGE, LINE = (0, 0, 0, 160), (255, 214, 90, 255)
# heights in pixels at a content scale of 1
FONT, PADDING = 13, 6
# lines before a heading, and font heights to try for a text that has to fit
GAP = 0.5
SHARES = (1.0, 0.9, 0.8, 0.7, 0.6)
CORNERS = ("top left", "bottom left", "middle")
# line spacing in font heights
LEADING = 1.3
# replacements for characters missing from Pillow's built-in font, which has little beyond ASCII
PLAIN = str.maketrans(
    {
        **{"×": "x", "²": "^2", "³": "^3", "½": "1/2", "≥": ">=", "≤": "<=", "→": "->", "′": "'", "–": "-", "—": "-"},
        **{"τ": "tau", "σ": "sigma", "ρ": "rho", "∇": "grad", "µ": "u", "Σ": "sum", "−": "-", "√": "sqrt", "…": "..."},
    }
)
# the sign of 10⁻⁶, which the font lacks too: a u with the stem of a p below the baseline
MICRO = "µ"


@dataclass(frozen=True)
class Text:
    """Lines of text at one of CORNERS; tabs separate columns. note: in the colour of messages. fit: with as many
    columns and as small as needed to fit into the image. above: pixels that another text takes above it.
    """

    lines: tuple[str, ...]
    corner: str = "top left"
    note: bool = False
    fit: bool = False
    above: int = 0


@dataclass(frozen=True)
class Overlay:
    """Overlay of an image of `size` pixels; equal overlays look the same. scale: the display's content scale.
    paths: lines through points [x, y] in pixels; a path that ends where it begins is closed. light: whether the
    background of the image is.
    """

    size: tuple[int, int]
    scale: float = 1.0
    texts: tuple[Text, ...] = ()
    paths: tuple[Path, ...] = ()
    light: bool = False


def draw_overlay(overlay: Overlay) -> np.ndarray:
    """uint8 [H, W, 4], sRGB with straight alpha."""
    from PIL import Image, ImageDraw

    picture = Image.new("RGBA", overlay.size, (0, 0, 0, 0))
    pen = ImageDraw.Draw(picture)
    for path in overlay.paths:
        for color, width in ((EDGE, 3), (LINE, 1)):
            pen.line(list(path), fill=color, width=max(1, round(width * overlay.scale)))
    inks = INKS[overlay.light]
    for text in overlay.texts:
        block = _fit_block(text, overlay.size, overlay.scale)
        _write(picture, block, text_box(text, overlay.size, overlay.scale), inks[text.note], inks[2])
    return np.asarray(picture)


def plain(text: str) -> str:
    """Text with characters missing from the font replaced."""
    return legible(text.translate(PLAIN))


def write_line(mask: Any, at: tuple[int, int], text: str, height: int, stroke: int = 0) -> None:
    """Writes a line on a mask of Pillow, mode L; at: the first point on its baseline; height: of the font, pixels.
    stroke: width of an outline that is filled, too.
    """
    from PIL import Image, ImageDraw

    font, spelled = load_font(height), text.replace(MICRO, "u")
    style: dict[str, Any] = {"font": font, "fill": 255, "stroke_width": stroke, "anchor": "ls"}
    ImageDraw.Draw(mask).text(at, spelled, **style)
    for place in (n for n, letter in enumerate(text) if letter == MICRO):
        below, left = Image.new("L", mask.size), at[0] + font.getlength(spelled[:place])
        starts = {letter: font.getbbox(letter, anchor="ls") for letter in "upl"}
        left += starts["u"][0] - starts["p"][0]
        ImageDraw.Draw(below).text((left, at[1]), "p", **style)
        # the stem alone, which is as wide as that of an l, from the round corner of the u on
        right = round(left + starts["p"][0] + starts["l"][2] - starts["l"][0]) + stroke
        box = (0, at[1] - height // 6, right, mask.size[1])
        mask.paste(255, box[:2], below.crop(box))


def legible(text: str) -> str:
    """Text that can be encoded: file names may hold invalid bytes."""
    return text.encode(errors="replace").decode()


def text_box(text: Text, size: tuple[int, int], scale: float) -> tuple[int, int, int, int]:
    """Left, top, right, bottom of a text in an image of `size`, pixels."""
    block = _fit_block(text, size, scale)
    width, height = block.size
    left = top = block.pad
    if text.corner == "middle":
        left, top = max(0, (size[0] - width) // 2), max(0, (size[1] - height) // 2)
    elif "bottom" in text.corner:
        top = size[1] - height - block.pad
    else:
        # over the other text where there is no room below it
        top = max(min(top + text.above, size[1] - height - block.pad), top)
    return left, top, left + width, top + height


class TextBlock(NamedTuple):
    """A text layout: cells with their positions, font height, margin and size, pixels."""

    cells: tuple[tuple[str, float, int], ...]
    height: int
    pad: int
    size: tuple[int, int]


def _write(picture: Any, block: TextBlock, box: tuple[int, int, int, int], ink: Color, paper: Color) -> None:
    picture.paste(paper, box)
    for cell, x, y in block.cells:
        picture.paste(ink, (box[0] + round(x), box[1] + y), _letters(cell, block.height))


def _fit_block(text: Text, size: tuple[int, int], scale: float) -> TextBlock:
    """The text in one column, or, if it has to fit, in as many columns and as small as needed."""
    if not text.fit:
        return _block(text.lines, FONT * scale, 1)
    # groups stand apart where letters of that height leave room
    forms = product(SHARES, (GAP, 0.0), (1, 2, 3))
    blocks = (_block(text.lines, FONT * scale * share, count, gap) for share, gap, count in forms)
    fitting = (block for block in blocks if block.size[0] <= size[0] and block.size[1] <= size[1])
    return next(fitting, _block(text.lines, FONT * scale * SHARES[-1], 3))


@lru_cache(maxsize=32)
def _block(lines: tuple[str, ...], height: float, count: int, gap: float = 0.0) -> TextBlock:
    """Lines in columns of equal length; tabs separate cells within a column. gap: lines before a heading."""
    font, pad = load_font(round(height)), max(1, round(PADDING * height / FONT))
    step, columns = round(height * LEADING), _columns(lines, count)
    cells: list[tuple[str, float, int]] = []
    right, bottom = 0.0, 0
    for part in columns:
        rows = [[plain(cell) for cell in line.split("\t")] for line in part]
        # column widths come from rows with several cells; a single cell spans all columns
        # columns of lines are farther apart than their cells
        tabbed, ends = [row for row in rows if len(row) > 1], [right + (2 * pad if right else pad)]
        for column in range(max(map(len, tabbed), default=0)):
            widest = max(font.getlength(row[column]) for row in tabbed if column < len(row))
            ends.append(ends[-1] + 2 * pad + widest)
        y = pad
        for number, row in enumerate(rows):
            y += round(gap * step) if number and _is_heading(part[number]) else 0
            cells += [(cell, ends[column], y) for column, cell in enumerate(row) if cell]
            y += step
        alone = [ends[0] + font.getlength(row[0]) + pad for row in rows if len(row) == 1]
        right, bottom = max([ends[-1] - pad, *alone]), max(bottom, y + pad)
    return TextBlock(tuple(cells), round(height), pad, (int(right) + 1, bottom))


def _is_heading(line: str) -> bool:
    """Whether a line's second cell is empty."""
    return line.endswith("\t")


def _columns(lines: tuple[str, ...], count: int) -> list[tuple[str, ...]]:
    """Lines in columns of about equal length, which begin with headings, if there are enough of them."""
    headings = [number for number, line in enumerate(lines) if number and _is_heading(line)]
    ends = [len(lines) * number // count for number in range(count + 1)]
    if len(headings) >= count:
        ends[1:-1] = [min(headings, key=lambda heading: abs(heading - end)) for end in ends[1:-1]]
    return [lines[first:last] for first, last in pairwise(ends) if first < last]


@lru_cache(maxsize=512)
def _letters(line: str, height: int) -> Any:
    """Coverage of a line's glyphs."""
    from PIL import Image, ImageDraw

    font = load_font(height)
    letters = Image.new("L", (int(font.getlength(line)) + 2, round(height * LEADING)))
    ImageDraw.Draw(letters).text((0, 0), line, font=font, fill=255)
    return letters


@lru_cache(maxsize=8)
def load_font(height: int) -> Any:
    """Pillow's built-in font."""
    from PIL import ImageFont

    return ImageFont.load_default(height)

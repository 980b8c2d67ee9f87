"""Images side by side on one sheet, unscaled, each with its letter and a caption."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from splatgl.annotations.text import load_font
from splatgl.data.color import srgb_from_linear

# sizes in sheet pixels: gap between panels, outer margin, text height, and room for the caption below a panel
GAP, MARGIN, TEXT, ROOM = 12, 10, 15, 26
WHITE, INK = (255, 255, 255), (0, 0, 0)
# width of the white edge around black lines, in pixels
EDGE = 1


@dataclass(frozen=True, eq=False)
class Panel:
    """A panel: uint8 [H, W, 3] sRGB as placed on the sheet, and its caption."""

    shown: np.ndarray
    words: str

    @classmethod
    def of(cls, pixels: np.ndarray, words: str, times: int = 1, line: np.ndarray | None = None) -> Panel:
        """From opaque linear pixels [H, W, 3 or 4], enlarged by times × times; line: enlarged pixels drawn black."""
        shown = np.rint(srgb_from_linear(np.clip(pixels[..., :3], 0.0, 1.0)) * 255).astype(np.uint8)
        shown = np.repeat(np.repeat(shown, times, axis=0), times, axis=1)
        if line is not None:
            wide = np.pad(line, EDGE)
            around = np.zeros_like(line)
            for y in range(2 * EDGE + 1):
                for x in range(2 * EDGE + 1):
                    around |= wide[y : y + line.shape[0], x : x + line.shape[1]]
            shown[around] = WHITE
            shown[line] = INK
        return cls(shown, words)


def sheet(rows: Sequence[Sequence[Panel]]) -> np.ndarray:
    """uint8 [H, W, 3]: rows of panels, lettered (a), (b), … in reading order."""
    from PIL import Image, ImageDraw

    width = max(sum(p.shown.shape[1] + GAP for p in row) - GAP for row in rows) + 2 * MARGIN
    height = sum(max(p.shown.shape[0] for p in row) + ROOM + GAP for row in rows) - GAP + 2 * MARGIN
    page = Image.new("RGB", (width, height), WHITE)
    pen, font = ImageDraw.Draw(page), load_font(TEXT)
    letters = iter("abcdefghijklmnop")
    top = MARGIN
    for row in rows:
        tall = max(p.shown.shape[0] for p in row)
        left = MARGIN
        for panel in row:
            page.paste(Image.fromarray(panel.shown), (left, top))
            middle = left + panel.shown.shape[1] / 2
            if panel.words:
                words = f"({next(letters)}) {panel.words}"
                pen.text((middle, top + tall + ROOM / 2), words, INK, font=font, anchor="mm")
            left += panel.shown.shape[1] + GAP
        top += tall + ROOM + GAP
    return np.asarray(page)


def encoded(page: np.ndarray, about: str, maker: str) -> bytes:
    """A PNG with its description in the metadata."""
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    buffer, info = io.BytesIO(), PngInfo()
    info.add_itxt("Description", about)
    info.add_text("Software", maker)
    Image.fromarray(page).save(buffer, "PNG", pnginfo=info)
    return buffer.getvalue()

"""Short texts as small pictures: a value beside the cursor, the length of a line."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from splatgl.app.viewer.overlay import plain

# sRGB with straight alpha, and pixels at a content scale of 1
INK, PAPER = (255, 255, 255, 255), (0, 0, 0, 185)
HEIGHT, PAD, LEADING = 13, 5, 1.35

Box = tuple[float, float, float, float]


@lru_cache(maxsize=64)
def label(lines: tuple[str, ...], scale: float = 1.0) -> np.ndarray:
    """uint8 [h, w, 4], sRGB, straight alpha; equal texts are one array."""
    from PIL import Image, ImageDraw, ImageFont

    height, pad = round(HEIGHT * scale), round(PAD * scale)
    font, step = ImageFont.load_default(height), round(height * LEADING)
    told = [plain(line) for line in lines]
    wide = int(np.ceil(max(map(font.getlength, told), default=0.0))) + 2 * pad
    picture = Image.new("RGBA", (wide, step * len(told) + 2 * pad), PAPER)
    pen = ImageDraw.Draw(picture)
    for number, line in enumerate(told):
        pen.text((pad, pad + number * step), line, font=font, fill=INK)
    return np.asarray(picture)


def beside(place: tuple[float, float], size: tuple[int, int], window: tuple[int, int], gap: float) -> Box:
    """Left, top, right, bottom of a label of `size` beside a place, on the side where the window has room."""
    found = []
    for at, long, room in zip(place, size, window, strict=True):
        start = at + gap if at + gap + long <= room else at - gap - long
        found.append(float(np.clip(round(start), 0, max(room - long, 0))))
    return found[0], found[1], found[0] + size[0], found[1] + size[1]

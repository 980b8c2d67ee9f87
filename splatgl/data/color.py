"""sRGB and linear light, both ways, exactly as IEC 61966-2-1 states them; colours by name."""

from __future__ import annotations

import re
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

# the curve is linear below these encoded and linear values, a power function above
ENCODED_KNEE, LINEAR_KNEE = 0.04045, 0.0031308
SLOPE, OFFSET, EXPONENT = 12.92, 0.055, 2.4
# weights of red, green and blue in luma
LUMA = np.array([0.2126, 0.7152, 0.0722])


def linear_from_srgb(encoded: ArrayLike) -> np.ndarray:
    """Linear light, float64, of sRGB values in [0, 1], any shape; negatives follow the straight line."""
    s = np.asarray(encoded, dtype=np.float64)
    curved = ((np.maximum(s, ENCODED_KNEE) + OFFSET) / (1 + OFFSET)) ** EXPONENT
    return np.where(s <= ENCODED_KNEE, s / SLOPE, curved)


def srgb_from_linear(linear: ArrayLike) -> np.ndarray:
    """Values in sRGB, float64, of linear light in [0, 1], any shape; negatives follow the straight line."""
    c = np.asarray(linear, dtype=np.float64)
    curved = (1 + OFFSET) * np.maximum(c, LINEAR_KNEE) ** (1 / EXPONENT) - OFFSET
    return np.where(c <= LINEAR_KNEE, c * SLOPE, curved)


# largest error of `light_of_display` over that of values and alpha: the slopes of α f(v/α) are f′ and f − f′ v/α, at
# most f′(1) and f′(1) − 1
STEEPEST = 2 * EXPONENT / (1 + OFFSET) - 1


def light_of_display(pixels: np.ndarray) -> np.ndarray:
    """Linear premultiplied pixels [..., 4] of display values, sRGB times alpha, in the type of those."""
    alpha = np.maximum(pixels[..., 3:], 0)
    straight = np.divide(pixels[..., :3], alpha, out=np.zeros_like(pixels[..., :3]), where=alpha > 0)
    light = linear_from_srgb(np.minimum(straight, 1)) * alpha
    return np.concatenate([light, pixels[..., 3:]], axis=-1).astype(pixels.dtype)


# bits of a float32 below those by which `srgb_bytes` looks up: fewer than two bytes begin between two entries; and
# numbers looked up at a time, whose places stay in the cache
BELOW, AT_ONCE = 15, 1 << 15


@lru_cache(maxsize=1)
def _byte_tables() -> tuple[np.ndarray, np.ndarray]:
    """For each place of a float32 in [0, 1] >> BELOW: the byte of the first float there, and where the next begins."""
    low, high = np.zeros(255, np.uint32), np.full(255, np.float32(1.0).view(np.uint32))
    byte = np.arange(1, 256)
    while (low < high).any():
        middle = (low + high) // 2
        reached = np.rint(srgb_from_linear(middle.view(np.float32)) * 255) >= byte
        low, high = np.where(reached, low, middle + 1), np.where(reached, middle, high)
    first = np.arange((int(np.float32(1.0).view(np.uint32)) >> BELOW) + 1, dtype=np.uint32) << np.uint32(BELOW)
    base = np.searchsorted(high, first, side="right")
    return base.astype(np.uint8), np.append(high.view(np.float32), np.float32(np.inf))[base]


def srgb_bytes(linear: np.ndarray) -> np.ndarray:
    """rint(255 · srgb_from_linear), uint8, of linear light, float32 in [0, 1]; looked up, in a tenth of the time."""
    (base, following), flat = _byte_tables(), np.ascontiguousarray(linear + np.float32(0)).ravel()
    result = np.empty(flat.size, np.uint8)
    for first in range(0, flat.size, AT_ONCE):
        part = flat[first : first + AT_ONCE]
        place = part.view(np.uint32) >> np.uint32(BELOW)
        byte, end = base.take(place, mode="clip"), following.take(place, mode="clip")
        np.add(byte, part >= end, out=result[first : first + AT_ONCE])
    return result.reshape(linear.shape)


def luma(color: np.ndarray) -> np.ndarray:
    """The luma, uint8 [D, H, W], of sRGB colours, uint8 [D, H, W, 3] (ITU-R BT.709), or of [D, H, W, 4] times alpha,
    so that transparent voxels are; alpha that is 0 everywhere was never set.
    """
    result = np.empty(color.shape[:-1], np.uint8)
    has_alpha = color.shape[-1] == 4 and bool(color[..., 3].any())
    for plane, source in zip(result, color, strict=True):
        bright = source[..., :3] @ LUMA
        np.rint(bright * (source[..., 3] / np.float32(255)) if has_alpha else bright, out=plane, casting="unsafe")
    return result


# colours of channels whose file states none, in the order in which they are given away
CHANNEL_COLORS = {
    **{"blue": "#4a7dff", "green": "#3ddc5a", "red": "#ff4b4b", "yellow": "#ffd23d"},
    **{"cyan": "#38e1e1", "magenta": "#ff5adf", "orange": "#ff9a3d", "gray": "#c9c9c9"},
}
# dyes, proteins and modes of light by the colour in which they are usually shown
_DYES = {
    "blue": "dapi hoechst bfp ebfp ebfp2 nucblue pacificblue violet",
    "cyan": "cfp ecfp cerulean mcerulean turquoise mturquoise mturquoise2 mtfp1",
    "green": "gfp egfp sfgfp mgfp fitc fluorescein cy2 mneongreen neongreen mclover calcein gcamp oregongreen",
    "yellow": "yfp eyfp venus mvenus citrine mcitrine ypet",
    "orange": "cy3 cy35 mko mko2 morange tmrm",
    "red": "mcherry cherry rfp mrfp tagrfp mruby mscarlet dsred tdtomato tomato tritc rhodamine texasred "
    "propidiumiodide mkate mkate2 mapple",
    "magenta": "cy5 cy55 cy7 irfp mirfp farred draq5 infrared purple",
    "gray": "brightfield bf dic phase phasecontrast transmitted transmittedlight tpmt grey white reflection",
}
DYES = {name: color for color, names in _DYES.items() for name in (color, *names.split())}
# families of dyes, which an excitation follows, and the longest excitation, nm, of each colour
FAMILIES = ("alexa", "alexafluor", "af", "atto", "cf", "dylight", "jf", "janeliafluor", "laser")
EXCITATIONS = ((440, "blue"), (475, "cyan"), (530, "green"), (560, "orange"), (620, "red"), (800, "magenta"))


def color_of_dye(name: str) -> str | None:
    """Colour "#rrggbb" of a channel by its name: a dye or protein, its excitation in nm, or a colour; else None."""
    apart = re.sub(r"(?<=[a-z])(?=[A-Z][a-z])", " ", re.sub(r"(?<=\d)\.(?=\d)", "", name))
    words = re.findall("[a-z0-9]+", apart.lower())
    # names of two words first, such as far red
    for word in (*map("".join, pairwise(words)), *words, "".join(words)):
        if word in DYES:
            return CHANNEL_COLORS[DYES[word]]
    dye = re.search(r"([a-z]*)([3-7]\d\d)(?!\d)", "".join(words))
    if dye is None or not (dye[1] in ("", "a") or dye[1].endswith(FAMILIES)):
        return None
    return CHANNEL_COLORS[next(color for longest, color in EXCITATIONS if int(dye[2]) <= longest)]


Color = tuple[float, float, float]
# backgrounds that are no colours, and how messages list all of them
AUTO, CLEAR = "auto", "transparent"
BACKGROUNDS = "auto, transparent, #rgb, #rrggbb or a CSS name such as black"
MOST_LETTERS = 40


def srgb_of_name(text: str) -> tuple[int, int, int]:
    """sRGB from 0 to 255 of #rgb, #rrggbb or a CSS name. Raises ValueError for other text."""
    from PIL import ImageColor

    # alpha is refused
    rgb: tuple[int, ...] = ImageColor.getrgb(text[:MOST_LETTERS])
    red, green, blue = rgb
    return red, green, blue


def read_background(text: str) -> Color | str:
    """AUTO, CLEAR, or linear RGB of #rgb, #rrggbb or a CSS name. Raises ValueError for other text."""
    if text in (AUTO, CLEAR):
        return text
    red, green, blue = linear_from_srgb(np.array(srgb_of_name(text)) / 255)
    return float(red), float(green), float(blue)

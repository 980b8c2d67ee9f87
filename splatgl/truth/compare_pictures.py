"""Pictures of a difference: both as shown on a screen, the difference as heat, and the part around it enlarged."""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass

import numpy as np

from splatgl.data.image import Image
from splatgl.truth.compare import Comparison

# pixels along the longer side of a picture in a report, and of the enlarged part around the difference
LARGEST, DETAIL = 1024, 64
# pixels around a small difference that are shown with it
MARGIN = 6
# heat, sRGB: no difference is black, the largest is a pale yellow; lightness rises evenly in between
HEAT = np.array([(0, 0, 0), (60, 15, 110), (165, 35, 105), (245, 105, 45), (253, 190, 70), (252, 255, 200)], np.float32)


@dataclass(frozen=True)
class Box:
    """A part of a picture in pixels; right and bottom beyond."""

    left: int
    top: int
    right: int
    bottom: int

    def of(self, pixels: np.ndarray) -> np.ndarray:
        return pixels[self.top : self.bottom, self.left : self.right]


def shown(image: Image, peak: float = 1.0) -> np.ndarray:
    """The picture as a screen shows it: sRGB, straight alpha, uint8 [H, W, 4]; X-rays relative to their peak."""
    pixels = shrunk(image.pixels, np.mean)
    return np.rint(Image(pixels / np.float32(peak)).straight() * 255).astype(np.uint8)


def largest(actual: Image, right: Image, mask: np.ndarray | None = None) -> np.ndarray:
    """The largest |difference| over the channels, float32 [H, W]; 0 where `mask` is False."""
    difference = np.abs(actual.pixels - right.pixels).max(axis=-1).astype(np.float32)
    return difference if mask is None else np.where(mask, difference, np.float32(0))


def heat(difference: np.ndarray) -> np.ndarray:
    """The difference as colours that reach from 0 to its maximum, sRGB uint8 [H, W, 3]."""
    place = difference / (float(difference.max()) or 1.0) * (len(HEAT) - 1)
    low = np.minimum(place.astype(int), len(HEAT) - 2)
    part = (place - low)[..., None]
    return np.rint(HEAT[low] * (1 - part) + HEAT[low + 1] * part).astype(np.uint8)


def shrunk(pixels: np.ndarray, choose: object) -> np.ndarray:
    """At most LARGEST along the longer side: k×k pixels become one, by np.mean, or by np.max so that none is lost."""
    height, width = pixels.shape[:2]
    k = -(-max(height, width) // LARGEST)
    if k == 1:
        return pixels
    padded = np.pad(pixels, [(0, -height % k), (0, -width % k), *[(0, 0)] * (pixels.ndim - 2)], mode="edge")
    blocks = padded.reshape(padded.shape[0] // k, k, padded.shape[1] // k, k, *pixels.shape[2:])
    if choose is np.max:
        return np.asarray(blocks.max(axis=(1, 3)))
    return np.asarray(blocks.mean(axis=(1, 3), dtype=np.float32))


def detail(found: Comparison, shape: tuple[int, ...]) -> Box:
    """What to enlarge: the box of the difference if it is small, else a part around the worst pixel."""
    height, width = shape[:2]
    left, top, right, bottom = found.box or (0, 0, width, height)
    if max(right - left, bottom - top) + 2 * MARGIN > DETAIL:
        column, row = found.where
        left, right, top, bottom = column, column + 1, row, row + 1
        grow = (DETAIL - 1) // 2
    else:
        grow = MARGIN
    return Box(max(left - grow, 0), max(top - grow, 0), min(right + grow, width), min(bottom + grow, height))


def png(samples: np.ndarray) -> bytes:
    """A PNG file of uint8 [H, W, 3 or 4]."""
    from PIL import Image as Pillow

    buffer = io.BytesIO()
    Pillow.fromarray(samples).save(buffer, "PNG", compress_level=6)
    return buffer.getvalue()


def data_uri(samples: np.ndarray) -> str:
    """A PNG that stands in a page itself."""
    return "data:image/png;base64," + base64.b64encode(png(samples)).decode("ascii")

"""Images of a difference: both inputs as displayed, the difference as a heat map, and an enlarged detail."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from splatgl.data.image import Image
from splatgl.truth.compare import BAND_ROWS, Comparison
from splatgl.truth.quantization import over_channels

# pixels along the longer side of an image in a report, and of the enlarged detail
LARGEST, DETAIL = 1024, 64
# margin in pixels around a small difference
MARGIN = 6
# heat map, sRGB: no difference is black, the largest pale yellow; lightness increases evenly
HEAT = np.array([(0, 0, 0), (60, 15, 110), (165, 35, 105), (245, 105, 45), (253, 190, 70), (252, 255, 200)])
# heat map shades: more than an 8-bit screen can show
SHADES = 1024
# zlib level: images of noise compress slowly, without gain at higher levels
COMPRESSION = 4


@dataclass(frozen=True)
class Box:
    """A rectangle of an image in pixels; right and bottom are exclusive."""

    left: int
    top: int
    right: int
    bottom: int

    def of(self, pixels: np.ndarray) -> np.ndarray:
        """This rectangle of pixels [H, W, ...], as a view."""
        return pixels[self.top : self.bottom, self.left : self.right]


def shown(image: Image, peak: float = 1.0) -> np.ndarray:
    """The image for display: sRGB, straight alpha, uint8 [H, W, 4]; X-rays relative to their peak."""
    pixels = shrunk(image.pixels, np.mean)
    return np.rint(Image(pixels / np.float32(peak)).straight() * 255).astype(np.uint8)


def largest(actual: Image, right: Image, mask: np.ndarray | None = None) -> np.ndarray:
    """Maximum |difference| over the channels, float32 [H, W]; 0 where `mask` is False."""
    a, b = actual.pixels, right.pixels
    worst = np.empty(a.shape[:2], np.float32)
    with np.errstate(over="ignore"):
        for top in range(0, len(a), BAND_ROWS):
            band = slice(top, top + BAND_ROWS)
            over_channels(np.subtract(a[band], b[band], dtype=np.float32), worst[band])
    # clamp overflow to the largest float32
    np.minimum(worst, np.finfo(np.float32).max, out=worst)
    return worst if mask is None else np.where(mask, worst, np.float32(0))


def heat(difference: np.ndarray) -> np.ndarray:
    """Heat map of the difference from 0 to its maximum, sRGB uint8 [H, W, 3]."""
    at = np.linspace(0, len(HEAT) - 1, SHADES)
    shades = np.stack([np.interp(at, np.arange(len(HEAT)), channel) for channel in HEAT.T], axis=-1)
    # any difference is brighter than black
    place = np.ceil(difference / (difference.max() or np.float32(1)) * np.float32(SHADES - 1)).astype(np.uint16)
    return np.take(np.rint(shades).astype(np.uint8), place, axis=0, mode="clip")


def shrunk(pixels: np.ndarray, choose: Callable[..., np.ndarray]) -> np.ndarray:
    """Downsamples to at most LARGEST along the longer side: k×k blocks by np.mean, or by np.max to keep every peak."""
    height, width = pixels.shape[:2]
    k = -(-max(height, width) // LARGEST)
    if k == 1:
        return pixels
    padded = np.pad(pixels, [(0, -height % k), (0, -width % k), *[(0, 0)] * (pixels.ndim - 2)], mode="edge")
    # rows first: reducing whole rows is fast and leaves 1/k of the data
    rows = choose(padded.reshape(-1, k, *padded.shape[1:]), axis=1)
    return choose(rows.reshape(len(rows), -1, k, *pixels.shape[2:]), axis=2)


def detail(found: Comparison, shape: tuple[int, ...]) -> Box:
    """The region to enlarge: the box of the difference if small, else a region around the worst pixel."""
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
    Pillow.fromarray(samples).save(buffer, "PNG", compress_level=COMPRESSION)
    return buffer.getvalue()


def data_uri(samples: np.ndarray) -> str:
    """A PNG as a data URI."""
    return "data:image/png;base64," + base64.b64encode(png(samples)).decode("ascii")

"""Samples of picture files in sRGB and upright, by their colour profile, gamma, primaries and orientation tag."""

from __future__ import annotations

import io
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from PIL import ImageCms
from PIL.Image import Image as PillowImage

from splatgl.data.color import linear_from_srgb, srgb_from_linear
from splatgl.errors import import_extra

# EXIF 2.32 §4.6.4: the tag of the orientation, and its values that turn rows into columns, and reverse them
ORIENTATION, TURNED, ROWS_REVERSED, COLUMNS_REVERSED = 0x0112, (5, 6, 7, 8), (3, 4, 7, 8), (2, 3, 6, 7)
# modes of Pillow by the colour space of an ICC profile, and the mode that holds the colours alone
SPACES = {
    "RGB ": (("RGB", "RGBA", "P", "PA"), "RGB"),
    "GRAY": (("1", "L", "LA", "I;16"), "L"),
    "CMYK": (("CMYK",), "CMYK"),
}
# flag of lcms2 against tables of 33 colours a side, which are off by several levels
EXACT = 0x100
# gamma that programs write for sRGB, and its tolerance; white, red, green and blue of sRGB (IEC 61966-2-1)
SRGB_GAMMA, LIKE_SRGB = 1 / 2.2, 0.005
SRGB_PRIMARIES = (0.3127, 0.329, 0.64, 0.33, 0.3, 0.6, 0.15, 0.06)


def displayed_samples(picture: PillowImage, deep: np.ndarray | None = None) -> np.ndarray:
    """Straight sRGB samples, uint8 or uint16 [H, W, 4], of an image of Pillow as a browser shows it. deep: its uint16
    samples, where Pillow reads 8 bits of them. A profile that cannot be read counts as sRGB. Raises ValueError for
    samples of 32 bits.
    """
    if deep is None and picture.mode in ("I", "F"):
        raise ValueError("expected samples of 8 or 16 bits, got 32")
    if deep is None and picture.mode.startswith("I;16"):
        gray = np.asarray(picture).astype(np.uint16)
        deep = np.stack([gray, gray, gray, np.full_like(gray, np.iinfo(np.uint16).max)], axis=-1)
    samples = np.asarray(picture if picture.mode == "RGBA" else picture.convert("RGBA")) if deep is None else deep
    info, colors = picture.info, None
    if info.get("icc_profile"):
        colors = _by_profile(picture, samples, info["icc_profile"], deep is not None)
    elif "gamma" in info and "srgb" not in info:
        colors = _by_gamma(samples[..., :3], float(info["gamma"]), info.get("chromaticity", SRGB_PRIMARIES))
    if colors is not None:
        samples = np.concatenate([colors, samples[..., 3:]], axis=-1)
    return _upright(samples, picture)


def _upright(samples: np.ndarray, picture: PillowImage) -> np.ndarray:
    try:
        orientation = picture.getexif().get(ORIENTATION, 1)
    except (OSError, ValueError, SyntaxError, KeyError, struct.error):
        # of Pillow, for damaged tags
        return samples
    if orientation in TURNED:
        samples = samples.swapaxes(0, 1)
    samples = samples[::-1] if orientation in ROWS_REVERSED else samples
    return np.ascontiguousarray(samples[:, ::-1] if orientation in COLUMNS_REVERSED else samples)


def _by_profile(picture: PillowImage, samples: np.ndarray, profile: bytes, is_deep: bool) -> np.ndarray | None:
    """sRGB colours [H, W, 3] by an ICC profile; None if it cannot be used."""
    srgb: Any = ImageCms.createProfile("sRGB")
    try:
        source = ImageCms.ImageCmsProfile(io.BytesIO(profile))
        modes, mode = SPACES.get(source.profile.xcolor_space, ((), ""))
        if picture.mode not in modes:
            return None
        if not is_deep:
            return np.asarray(ImageCms.profileToProfile(picture.convert(mode), source, srgb, outputMode="RGB"))
        imagecodecs = import_extra("imagecodecs", "16-bit PNG", "imagecodecs", "readers")
        space, values = ("gray", samples[..., 0]) if mode == "L" else ("rgb", samples[..., :3])
        options = {"colorspace": space, "outcolorspace": "rgb", "flags": EXACT}
        target = ImageCms.ImageCmsProfile(srgb).tobytes()
        return np.asarray(imagecodecs.cms_transform(np.ascontiguousarray(values), profile, target, **options))
    except (ImageCms.PyCMSError, OSError, ValueError, RuntimeError):
        return None


def _by_gamma(colors: np.ndarray, gamma: float, chromaticity: Sequence[float]) -> np.ndarray | None:
    """sRGB colours [H, W, 3] by a PNG's gAMA and cHRM; None for those of sRGB (PNG specification §11.3.2)."""
    x, y = np.reshape(chromaticity, (4, 2)).T
    is_curve, is_gamut = abs(gamma - SRGB_GAMMA) < LIKE_SRGB, np.allclose(chromaticity, SRGB_PRIMARIES, atol=LIKE_SRGB)
    is_triangle = y.min() > 0 and abs(np.linalg.det([np.ones(3), x[1:], y[1:]])) > LIKE_SRGB
    if gamma <= 0 or not is_triangle or (is_curve and is_gamut):
        return None
    top = np.iinfo(colors.dtype).max
    light = linear_from_srgb(colors / top) if is_curve else (colors / top) ** (1 / gamma)
    if not is_gamut:
        light = light @ np.linalg.solve(_xyz_of_primaries(SRGB_PRIMARIES), _xyz_of_primaries(chromaticity)).T
    return np.rint(top * srgb_from_linear(np.clip(light, 0, 1))).astype(colors.dtype)


def _xyz_of_primaries(chromaticity: Sequence[float]) -> np.ndarray:
    """XYZ over that of white, 3×3, of red, green and blue. chromaticity: x and y of white, red, green and blue."""
    x, y = np.reshape(chromaticity, (4, 2)).T
    columns = np.array([x / y, np.ones(4), (1 - x - y) / y])
    primaries = columns[:, 1:] / columns[:, :1]
    return primaries * np.linalg.solve(primaries, np.ones(3))

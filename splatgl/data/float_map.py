"""Maps of one number a pixel, such as depths: as floats in NPY, TIFF and EXR, or as a grey picture in PNG."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from splatgl.data.color import linear_from_srgb
from splatgl.data.image import KEYWORD, Image
from splatgl.data.picture_files import EXR, TIFF, exr_library, need, tiff_library
from splatgl.errors import expected
from splatgl.fileio import write_whole

# endings of the files that are written
MAPS = (".npy", *TIFF, *EXR, ".png")
# grey of the farthest depth, sRGB; the nearest is white
FARTHEST = 0.15


def save_map(values: np.ndarray, path: str | Path, info: Mapping[str, object] | None = None) -> None:
    """Writes numbers [H, W], row 0 on top, NaN where there is none: float32 in .npy, .tif and .exr (channel Z).

    .png: grey, the least white, the greatest dark, clear where there is none; both are in the file's text. Raises
    InputError for another ending, a missing library, and a file that cannot be written.
    """
    name = Path(path)
    ending, told = name.suffix.lower(), dict(info or {})
    if ending not in MAPS:
        raise expected(name, f"a name that ends in {' or '.join(MAPS)}", repr(name.suffix))
    need(ending)
    if ending == ".png":
        write_whole(name, _grey(values, told).encoded(name, bits=16))
        return
    found, buffer = np.ascontiguousarray(values, np.float32), io.BytesIO()
    if ending == ".npy":
        np.save(buffer, found)
    elif ending in TIFF:
        told_ = json.dumps(told, ensure_ascii=True)
        tiff_library().imwrite(buffer, found, compression="zlib", description=told_, metadata=None)
    else:
        library = exr_library()
        header = {"compression": library.ZIP_COMPRESSION, "type": library.scanlineimage, KEYWORD: json.dumps(told)}
        library.File(header, {"Z": found}).write(buffer)
    write_whole(name, buffer.getvalue())


def _grey(values: np.ndarray, info: dict[str, object]) -> Image:
    known = np.isfinite(values)
    low, high = (float(values[known].min()), float(values[known].max())) if known.any() else (0.0, 1.0)
    share = (np.where(known, values, low) - low) / (high - low or 1.0)
    light = np.where(known, linear_from_srgb(1 - share * (1 - FARTHEST)), 0.0)[..., None]
    pixels = np.concatenate([light, light, light, known[..., None]], axis=-1).astype(np.float32)
    return Image(pixels, {**info, "white": low, "darkest": high})

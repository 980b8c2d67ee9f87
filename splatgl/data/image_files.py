"""Pictures in TIFF, OpenEXR and JPEG: linear premultiplied float32 in the first two, 8 bits of sRGB in the last."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.data.figure import VECTOR, vector_library
from splatgl.errors import InputError, expected, import_extra, one_line

# the EXR attribute that holds the provenance as JSON; in TIFF it is the ImageDescription
KEYWORD = "splatgl"
TIFF, EXR, JPEG = (".tif", ".tiff"), (".exr",), (".jpg", ".jpeg")
QUALITY = 95

Info = Mapping[str, object]


def require_library(suffix: str) -> None:
    """Raises InputError, before any work, if the library of a suffix is missing."""
    if suffix in TIFF:
        tiff_library()
    elif suffix in EXR:
        exr_library()
    elif suffix in VECTOR:
        vector_library()


def density(info: Info) -> float | None:
    """The dots per inch that the provenance states."""
    dpi = info.get("dpi")
    return float(dpi) if isinstance(dpi, int | float) else None


def reproducible(info: Info) -> dict[str, object]:
    """The provenance as files hold it, equal in all runs: without times, and without the comparison of as many pixels
    as a time allows.
    """
    kept = {name: value for name, value in info.items() if name != "seconds"}
    for name, value in kept.items():
        if isinstance(value, dict) and "seconds" in value:
            kept[name] = "of as many pixels as a time allows: not stored" if name == "checked" else reproducible(value)
    return kept


def encode_tiff(pixels: np.ndarray, info: Info) -> bytes:
    """float32 [H, W], or RGBA [H, W, 4] with associated alpha, deflated; the provenance is the ImageDescription."""
    buffer, description = io.BytesIO(), json.dumps(dict(info), ensure_ascii=True)
    kind: dict[str, Any] = {"photometric": "rgb", "extrasamples": ["assocalpha"]} if pixels.ndim == 3 else {}
    kind |= {"resolution": (dpi, dpi), "resolutionunit": "INCH"} if (dpi := density(info)) else {}
    values = pixels.astype(np.float32)
    tiff_library().imwrite(buffer, values, compression="zlib", description=description, metadata=None, **kind)
    return buffer.getvalue()


def encode_exr(pixels: np.ndarray, info: Info) -> bytes:
    """float32 [H, W] as channel Z, or RGBA [H, W, 4], linear and premultiplied, compressed without loss."""
    library, text, buffer = exr_library(), json.dumps(dict(info), ensure_ascii=True), io.BytesIO()
    header = {"compression": library.ZIP_COMPRESSION, "type": library.scanlineimage, KEYWORD: text}
    channels = {"RGBA" if pixels.ndim == 3 else "Z": np.ascontiguousarray(pixels, np.float32)}
    library.File(header, channels).write(buffer)
    return buffer.getvalue()


def encode_jpeg(samples: np.ndarray, info: Info) -> bytes:
    """JPEG of opaque sRGB samples, uint8 [H, W, 4]; the provenance is the comment."""
    from PIL import Image as Pillow

    buffer = io.BytesIO()
    about: dict[str, Any] = {"comment": json.dumps(dict(info), ensure_ascii=True)}
    about |= {"dpi": (dpi, dpi)} if (dpi := density(info)) else {}
    try:
        Pillow.fromarray(samples[..., :3]).save(buffer, "JPEG", quality=QUALITY, subsampling=0, **about)
    except OSError as error:
        height, width, _ = samples.shape
        raise expected("JPEG", "at most 65500 pixels a side", f"{width}×{height}", "save as .png") from error
    return buffer.getvalue()


def load_tiff(source: Path) -> tuple[np.ndarray, dict[str, object]] | None:
    """Pixels float32 [H, W, 4] and provenance of a TIFF of splatgl, with associated alpha; None for other files, and
    without tifffile.
    """
    try:
        library = tiff_library()
    except InputError:
        return None
    with _picture_errors(source), library.TiffFile(source) as tiff:
        page = tiff.pages[0]
        is_rgba = page.dtype == np.float32 and page.shape[2:] == (4,) and tuple(page.extrasamples) == (1,)
        return (page.asarray(), provenance(page.description)) if is_rgba else None


def load_exr(source: Path) -> tuple[np.ndarray, dict[str, object]]:
    """Pixels float32 [H, W, 4] and the provenance of an EXR with the channels RGB or RGBA."""
    library = exr_library()
    with _picture_errors(source):
        part = library.File(str(source)).parts[0]
        channels = {name: channel.pixels for name, channel in part.channels.items()}
        text = str(part.header.get(KEYWORD, ""))
    if "RGBA" not in channels and "RGB" not in channels:
        raise expected(source, "the channels RGBA or RGB", ", ".join(channels) or "none")
    pixels = np.asarray(channels.get("RGBA", channels.get("RGB")), np.float32)
    if pixels.shape[2] == 3:
        pixels = np.concatenate([pixels, np.ones_like(pixels[..., :1])], axis=-1)
    return pixels, provenance(text)


@contextmanager
def _picture_errors(source: Path) -> Iterator[None]:
    """Converts any exception of a library into InputError."""
    try:
        yield
    except Exception as error:
        raise InputError(f"{source}: cannot be read as a picture: {one_line(error)}") from error


def provenance(text: str) -> dict[str, object]:
    """The provenance in JSON text; empty for other text."""
    try:
        table = json.loads(text or "{}")
    except ValueError:
        return {}
    return table if isinstance(table, dict) else {}


def tiff_library() -> Any:
    """tifffile. Raises InputError if it is missing."""
    return import_extra("tifffile", "TIFF pictures", "tifffile", "readers")


def exr_library() -> Any:
    """OpenEXR. Raises InputError if it is missing."""
    return import_extra("OpenEXR", "EXR pictures", "OpenEXR", "exr")

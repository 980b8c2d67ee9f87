"""Reads pairs of images for comparison, with a common mode, precision and scale; and pairs of folders."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from tokenize import TokenError

import numpy as np

from splatgl.data.image import PNG_SIGNATURE, Image
from splatgl.data.image_files import EXR, TIFF, holds_floats
from splatgl.errors import InputError, expected

SUFFIXES = (".png", ".npy")
# colour type in a PNG's header (PNG specification §11.2.2) and its name; a palette is RGB, or RGBA with tRNS
COLOR_TYPES = {0: "gray", 2: "RGB", 3: "RGB", 4: "gray with alpha", 6: "RGBA"}
# size of a PNG's signature and header, and the offsets of depth and colour type
HEADER_BYTES, DEPTH_AT, TYPE_AT = 26, 24, 25


@dataclass(frozen=True)
class Picture:
    """An image and its storage format. mode: None matches any. bits: per sample, 8 or 16; None for floats."""

    name: str
    image: Image
    mode: str | None = None
    bits: int | None = None


def read(path: str | Path) -> Picture:
    """Reads a PNG, NPY, EXR, TIFF or JPEG file. Raises InputError for missing, truncated and invalid files."""
    source = Path(path)
    image = _loaded(source)
    suffix = source.suffix.lower()
    if suffix in (".npy", *EXR) or (suffix in TIFF and holds_floats(source)):
        return Picture(str(path), image)
    with open(source, "rb") as file:
        header = file.read(HEADER_BYTES)
    if header[: len(PNG_SIGNATURE)] != PNG_SIGNATURE:
        return Picture(str(path), image, None, 8)
    mode = COLOR_TYPES.get(header[TYPE_AT], "RGB")
    if header[TYPE_AT] == 3 and float(image.pixels[..., 3].min()) < 1:
        mode = "RGBA"
    return Picture(str(path), image, mode, 16 if header[DEPTH_AT] == 16 else 8)


def _loaded(source: Path) -> Image:
    """The image; the exceptions that NumPy and Pillow raise for two kinds of faults become InputError."""
    from PIL.Image import DecompressionBombError

    try:
        return Image.load(source)
    except (DecompressionBombError, TokenError) as error:
        raise InputError(f"{source}: cannot be read as a picture: {error}") from error


def alike(actual: Picture, right: Picture, any_mode: bool = False) -> tuple[Image, Image]:
    """Both images made comparable: the finer rounded to the coarser's bits, X-rays restored to sums.

    Raises InputError for different modes, such as RGB and RGBA, unless any_mode; and for NaN before rounding.
    """
    if not any_mode and actual.mode and right.mode and actual.mode != right.mode:
        fix = "save both alike, or compare what they look like with --any-mode"
        raise expected(actual.name, f"the mode of {right.name}, {right.mode}", actual.mode, fix)
    bits = min((picture.bits for picture in (actual, right) if picture.bits), default=None)
    # a float file does not record that it holds sums: the other one may
    xray = any(picture.image.info.get("blend") == "xray" for picture in (actual, right))
    first, second = (_sums(_rounded(picture, bits, xray)) for picture in (actual, right))
    return first, second


def _rounded(picture: Picture, bits: int | None, xray: bool) -> Image:
    image = picture.image
    if xray:
        image = replace(image, info={**image.info, "blend": "xray"})
    if bits is None or picture.bits == bits:
        return image
    if not np.isfinite(image.pixels).all():
        row, column = np.argwhere(~np.isfinite(image.pixels).all(axis=-1))[0]
        got = f"{image.pixels[row, column].tolist()} at column {column}, row {row}"
        raise expected(picture.name, "finite numbers", got)
    return image.rounded(bits)


def _sums(image: Image) -> Image:
    """An X-ray from a PNG, normalized to its maximum, restored to its original scale."""
    scale = image.info.get("scale")
    if image.info.get("blend") != "xray" or not isinstance(scale, (int, float)) or not scale > 0:
        return image
    return Image(image.pixels / np.float32(scale), {key: v for key, v in image.info.items() if key != "scale"})


def read_mask(path: str | Path) -> np.ndarray:
    """The mask of pixels to compare, bool [H, W]: where an image over black is lighter than black."""
    return np.asarray(read(path).image.pixels[..., :3].max(axis=-1) > 0)


def pairs(actual: Path, right: Path) -> list[tuple[str, Path, Path]]:
    """(name, actual, right) of one pair of files, or of every PNG and NPY in two folders, by their relative path.

    A file in only one folder is listed too: reading it fails. Raises InputError for a file against a folder,
    and for a folder without images.
    """
    for path in (actual, right):
        if not path.exists():
            raise expected(path, "a picture or a folder of pictures", "no such file")
    if actual.is_dir() != right.is_dir():
        folder, file = (actual, right) if actual.is_dir() else (right, actual)
        raise expected(file, f"a folder like {folder}", "a file", "give two files or two folders")
    if not actual.is_dir():
        return [(str(actual), actual, right)]
    found = {folder: _names(folder) for folder in (actual, right)}
    for folder, names in found.items():
        if not names:
            raise expected(folder, f"pictures ({', '.join(SUFFIXES)})", "none")
    return [(name, actual / name, right / name) for name in sorted({*found[actual], *found[right]})]


def _names(folder: Path) -> list[str]:
    files = (path for path in folder.rglob("*") if path.suffix.lower() in SUFFIXES and path.is_file())
    return [path.relative_to(folder).as_posix() for path in files]

"""Reads pictures for comparison: files, folders, bytes, arrays and images of other libraries."""

from __future__ import annotations

from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from tokenize import TokenError

import numpy as np
from PIL.Image import Image as PillowImage

from splatgl.comparison.compare import check_finite
from splatgl.data.image import PNG_SIGNATURE, Image
from splatgl.data.image_files import EXR, TIFF, is_float_tiff
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
    from PIL.Image import DecompressionBombError

    source = Path(path)
    try:
        image = Image.load(source)
    except (DecompressionBombError, TokenError) as error:
        # of Pillow and NumPy, for damaged files
        raise InputError(f"{source}: cannot be read as a picture: {error}") from error
    suffix = source.suffix.lower()
    if suffix in (".npy", *EXR) or (suffix in TIFF and is_float_tiff(source)):
        return Picture(str(path), image)
    with open(source, "rb") as file:
        header = file.read(HEADER_BYTES)
    if header[: len(PNG_SIGNATURE)] != PNG_SIGNATURE:
        return Picture(str(path), image, None, 8)
    mode = COLOR_TYPES.get(header[TYPE_AT], "RGB")
    if header[TYPE_AT] == 3 and float(image.pixels[..., 3].min()) < 1:
        mode = "RGBA"
    return Picture(str(path), image, mode, 16 if header[DEPTH_AT] == 16 else 8)


def match_formats(actual: Picture, right: Picture, any_mode: bool = False) -> tuple[Image, Image]:
    """Makes two images comparable: rounds the finer one to the bits of the other, and restores X-rays to sums.

    Raises InputError for different modes, such as RGB and RGBA, unless any_mode; and for NaN before rounding.
    """
    if not any_mode and actual.mode and right.mode and actual.mode != right.mode:
        fix = "save both alike, or compare what they look like with --any-mode"
        raise expected(actual.name, f"the mode of {right.name}, {right.mode}", actual.mode, fix)
    bits = min((picture.bits for picture in (actual, right) if picture.bits), default=None)
    # a float file does not record that it holds sums: the other one may
    xray = any(picture.image.info.get("blend") == "xray" for picture in (actual, right))
    first, second = (_match_format(picture, bits, xray) for picture in (actual, right))
    return first, second


def _match_format(picture: Picture, bits: int | None, xray: bool) -> Image:
    image = picture.image
    if xray:
        image = replace(image, info={**image.info, "blend": "xray"})
    if bits is not None and picture.bits != bits:
        check_finite(picture.name, image.pixels)
        image = image.rounded(bits)
    # an X-ray in a PNG is normalized to its maximum
    scale = image.info.get("scale")
    if not xray or not isinstance(scale, (int, float)) or not scale > 0:
        return image
    return Image(image.pixels / np.float32(scale), {key: v for key, v in image.info.items() if key != "scale"})


def read_mask(path: str | Path) -> np.ndarray:
    """The mask of pixels to compare, bool [H, W]: where an image over black is lighter than black."""
    return np.asarray(read(path).image.pixels[..., :3].max(axis=-1) > 0)


def find_pairs(actual: Path, right: Path) -> list[tuple[str, Path, Path]]:
    """(name, actual, right) of one pair of files, or of every PNG and NPY in two folders, by relative path.

    A file in only one folder is listed too: reading it fails. Raises InputError for a file against a folder, and for a
    folder without images.
    """
    for path in (actual, right):
        if not path.exists():
            raise expected(path, "a picture or a folder of pictures", "no such file")
    if actual.is_dir() != right.is_dir():
        folder, file = (actual, right) if actual.is_dir() else (right, actual)
        raise expected(file, f"a folder like {folder}", "a file", "give two files or two folders")
    if not actual.is_dir():
        return [(str(actual), actual, right)]
    names: set[str] = set()
    for folder in (actual, right):
        files = [path for path in folder.rglob("*") if path.suffix.lower() in SUFFIXES and path.is_file()]
        if not files:
            raise expected(folder, f"pictures ({', '.join(SUFFIXES)})", "none")
        names |= {path.relative_to(folder).as_posix() for path in files}
    return [(name, actual / name, right / name) for name in sorted(names)]


def as_image(value: Image | np.ndarray | PillowImage | bytes | str | Path) -> Image:
    """Converts any accepted input to an Image. Raises InputError for other input."""
    if isinstance(value, Image):
        return value
    if isinstance(value, (str, Path)):
        return read(value).image
    if isinstance(value, PillowImage):
        value = _encode_pillow(value)
    if isinstance(value, (bytes, bytearray, memoryview)):
        return _decode_bytes(bytes(value))
    samples = np.asarray(value)
    shape_ok = samples.ndim == 3 and samples.shape[2] in (3, 4)
    if samples.dtype == np.uint8 and shape_ok:
        return Image.from_samples(samples)
    if samples.dtype.kind == "f" and shape_ok and samples.shape[2] == 4:
        return Image(samples.astype(np.float32))
    got = f"{samples.dtype} {samples.shape}" if samples.dtype != object else type(value).__name__
    fix = "colour with float samples needs its alpha: premultiplied, linear, [H, W, 4]" if shape_ok else ""
    raise expected("image", "an Image, a file, its bytes, uint8 [H, W, 3 or 4] or float [H, W, 4]", got, fix)


def _encode_pillow(image: PillowImage) -> bytes:
    """The bytes of a PNG of Pillow's image. Raises InputError for modes that PNG lacks."""
    file = BytesIO()
    try:
        image.save(file, "PNG")
    except OSError as error:
        raise expected("image", "a mode of PNG", image.mode, "convert it to RGB or RGBA") from error
    return file.getvalue()


def _decode_bytes(content: bytes) -> Image:
    """The image of a PNG's or JPEG's bytes. Raises InputError for others."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "image"
        path.write_bytes(content)
        try:
            return read(path).image
        except InputError as error:
            raise InputError(str(error).replace(str(path), f"image of {len(content)} bytes")) from error

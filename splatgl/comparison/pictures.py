"""Reads pictures for comparison: files, folders, bytes, arrays and images of other libraries."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from inspect import isawaitable
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from tokenize import TokenError
from typing import Any

import numpy as np
from PIL import Image as Pillow
from PIL import ImageSequence
from PIL.Image import DecompressionBombError
from PIL.Image import Image as PillowImage

from splatgl.data.color_management import displayed_samples
from splatgl.data.image import PNG_SIGNATURE, Image
from splatgl.errors import InputError, expected, import_extra
from splatgl.fileio import require_file

# endings of files that may hold several pictures: by Pillow, and by av
ANIMATED, MOVIES = (".gif", ".webp", ".apng", ".png", ".tif", ".tiff"), (".mp4", ".mov", ".mkv", ".webm", ".avi")
# endings of pictures in folders
SUFFIXES = (*ANIMATED, ".npy", ".exr", ".jpg", ".jpeg", ".bmp", ".svg", ".pdf", *MOVIES)
# the beginning of the text that stands for a file which Git LFS has not fetched
LFS = b"version https://git-lfs"
# pixels an inch of a PDF's page
PAGE_DPI = 144
# the beginning of a text in SVG, and bytes that are searched for it
SVG_TEXT = re.compile(r"\ufeff?\s*(<\?xml[^>]*>\s*)?(<!--.*?-->\s*)*(<!DOCTYPE svg[^>]*>\s*)?<svg\b", re.DOTALL)
MOST_HEAD = 4096
# a PNG's last chunk (PNG specification §11.2.5)
PNG_END = b"\0\0\0\0IEND\xaeB`\x82"

# colour type in a PNG's header (PNG specification §11.2.2) and its name; a palette is RGB, or RGBA with tRNS
COLOR_TYPES = {0: "gray", 2: "RGB", 3: "RGB", 4: "gray with alpha", 6: "RGBA"}


# size of a PNG's signature and header, and the offset of the colour type
HEADER_BYTES, TYPE_AT = 26, 25


@dataclass(frozen=True)
class Picture:
    """An image and its colour type in a file. mode: None matches any."""

    name: str
    image: Image
    mode: str | None = None


def read(path: str | Path) -> Picture:
    """Reads a PNG, NPY, EXR, TIFF or JPEG file. Raises InputError for missing, truncated and invalid files."""
    try:
        image = Image.load(path)
    except (DecompressionBombError, TokenError) as error:
        # of Pillow and NumPy, for damaged files
        raise InputError(f"{path}: cannot be read as a picture: {error}") from error
    if image.bits is None:
        # of floats
        return Picture(str(path), image)
    with open(path, "rb") as file:
        header = file.read(HEADER_BYTES)
    if header[: len(PNG_SIGNATURE)] != PNG_SIGNATURE:
        return Picture(str(path), image)
    mode = COLOR_TYPES.get(header[TYPE_AT], "RGB")
    # a palette, or colours of which one is transparent (tRNS)
    if "alpha" not in mode and mode != "RGBA" and float(image.pixels[..., 3].min()) < 1:
        mode = "gray with alpha" if mode == "gray" else "RGBA"
    return Picture(str(path), image, mode)


def match_formats(actual: Picture, right: Picture, any_mode: bool = False) -> tuple[Image, Image]:
    """Makes two pictures comparable, see `match_images`.

    Raises InputError for different modes, such as RGB and RGBA, unless any_mode; and for NaN before rounding.
    """
    if not any_mode and actual.mode and right.mode and actual.mode != right.mode:
        fix = "save both alike, or compare what they look like with --any-mode"
        raise expected(actual.name, f"the mode of {right.name}, {right.mode}", actual.mode, fix)
    return match_images(actual.image, right.image, (actual.name, right.name))


def match_images(actual: Image, right: Image, names: tuple[str, str]) -> tuple[Image, Image]:
    """Two comparable images: the finer one rounded to the bits of the other, X-rays as sums. names: for messages."""
    bits = min((image.bits for image in (actual, right) if image.bits), default=None)
    # a float file does not record that it holds sums: the other one may
    xray = any(image.info.get("blend") == "xray" for image in (actual, right))
    first, second = (_match_image(*pair, bits, xray) for pair in zip((actual, right), names, strict=True))
    return first, second


def _match_image(image: Image, name: str, bits: int | None, xray: bool) -> Image:
    if xray and image.info.get("blend") != "xray":
        image = replace(image, info={**image.info, "blend": "xray"})
    if bits is not None and image.bits != bits:
        check_finite(name, image.pixels)
        image = image.rounded(bits)
    # an X-ray in a PNG is normalized to its maximum
    scale = image.info.get("scale")
    if not xray or not isinstance(scale, (int, float)) or not scale > 0:
        return image
    info = {key: value for key, value in image.info.items() if key != "scale"}
    return replace(image, pixels=image.pixels / np.float32(scale), info=info)


def check_finite(what: str, pixels: np.ndarray) -> None:
    """Raises InputError, which names the first pixel, for NaN and infinity in pixels [H, W, 4]."""
    bad = np.argwhere(~np.isfinite(pixels).all(axis=-1))
    if len(bad):
        row, column = bad[0]
        got = f"{pixels[row, column].tolist()} at column {column}, row {row} of {len(bad)} such"
        raise expected(what, "finite numbers", got)


def read_mask(path: str | Path) -> np.ndarray:
    """The mask of pixels to compare, bool [H, W]: where an image over black is lighter than black."""
    return np.asarray(read(path).image.pixels[..., :3].max(axis=-1) > 0)


def find_pairs(actual: Path, right: Path) -> list[tuple[str, Path, Path]]:
    """(name, actual, right) of one pair of files, or of every picture in two folders, by relative path.

    A file in only one folder is listed too. Raises InputError for a file against a folder, and for a folder without
    pictures.
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
            raise expected(folder, "pictures (.png, .npy, .jpg, .gif, .pdf, …)", "none")
        names |= {path.relative_to(folder).as_posix() for path in files}
    return [(name, actual / name, right / name) for name in sorted(names)]


def read_size(path: Path) -> tuple[int, int] | None:
    """Width and height of a PNG from its header; None for other files, and for a PNG that is cut."""
    with path.open("rb") as file:
        header = file.read(HEADER_BYTES)
        if len(header) < HEADER_BYTES or header[: len(PNG_SIGNATURE)] != PNG_SIGNATURE:
            return None
        file.seek(-len(PNG_END), os.SEEK_END)
        if file.read() != PNG_END:
            return None
    return int.from_bytes(header[16:20]), int.from_bytes(header[20:24])


def frames(path: Path) -> Iterator[Picture]:
    """The pictures of a file: one, the pages of a PDF or TIFF, or the frames of an animation or movie.

    Raises InputError for what cannot be read, and for a missing extra.
    """
    ending = path.suffix.lower()
    require_file(path)
    with path.open("rb") as file:
        if file.read(len(LFS)) == LFS:
            raise expected(path, "a picture", "a pointer of Git LFS", "fetch the file with: git lfs pull")
    if ending in MOVIES:
        yield from _numbered(path, _movie_frames(path))
    elif ending == ".pdf":
        yield from _numbered(path, _pdf_pages(path))
    elif ending == ".svg":
        cairosvg = import_extra("cairosvg", f"{path}: SVG", "cairosvg", "documents")
        try:
            content = cairosvg.svg2png(url=str(path))
        # of cairosvg and of its parsers, for damaged files
        except Exception as error:
            raise InputError(f"{path}: cannot be read as a picture: {error}") from error
        yield replace(_decode_bytes(content), name=str(path))
    elif ending in ANIMATED and (animation := _open_animation(path)):
        with animation:
            pages = (displayed_samples(frame) for frame in ImageSequence.Iterator(animation))
            yield from _numbered(path, pages)
    else:
        yield read(path)


def _numbered(path: Path, frames: Iterator[np.ndarray]) -> Iterator[Picture]:
    number = 0
    try:
        for number, samples in enumerate(frames, 1):
            name = str(path) if number == 1 else f"{path} [{number}]"
            yield Picture(name, Image.from_samples(samples))
    except (OSError, ValueError, EOFError, SyntaxError) as error:
        raise InputError(f"{path}: cannot be read after {number} pictures: {error}") from error
    if not number:
        raise expected(path, "at least one picture", "none")


def _open_animation(path: Path) -> Any:
    """Pillow's image of a file with several frames; None for one of a single frame, or for no picture."""
    try:
        animation = Pillow.open(path)
    except (OSError, ValueError, SyntaxError, DecompressionBombError):
        return None
    if getattr(animation, "n_frames", 1) > 1:
        return animation
    animation.close()
    return None


def _movie_frames(path: Path) -> Iterator[np.ndarray]:
    av = import_extra("av", f"{path}: movies", "av", "video")
    with av.open(str(path)) as movie:
        if not movie.streams.video:
            raise expected(path, "a movie", "no pictures")
        for frame in movie.decode(video=0):
            yield frame.to_ndarray(format="rgb24")


def _pdf_pages(path: Path) -> Iterator[np.ndarray]:
    pdfium = import_extra("pypdfium2", f"{path}: PDF", "pypdfium2", "documents")
    try:
        document = pdfium.PdfDocument(path)
    except pdfium.PdfiumError as error:
        raise InputError(f"{path}: cannot be read as a PDF: {error}") from error
    for page in document:
        yield np.asarray(page.render(scale=PAGE_DPI / 72).to_pil().convert("RGB"))


def as_images(value: Any) -> Iterator[Image]:
    """The images of any accepted input, see `as_image`; several of a file with pages or frames."""
    if isinstance(value, str | Path):
        yield from (picture.image for picture in frames(Path(value)))
    else:
        yield as_image(value)


def as_image(value: Any, what: str = "image") -> Image:
    """The image of an Image, a file of one picture, the bytes of a PNG or JPEG, samples (uint8 or uint16 sRGB, grey,
    with alpha, RGB or RGBA; bool), linear premultiplied floats [H, W, 4], text of an SVG, or an object that draws
    itself: an image of Pillow, a figure or axes of Matplotlib, a figure of Plotly, a viewer of napari, a plotter of
    PyVista, a page or an element of Playwright or Selenium. what: for messages. Raises InputError for others.
    """
    if isinstance(value, Image):
        return value
    if isinstance(value, str) and SVG_TEXT.match(value):
        value = value.encode()
    if isinstance(value, str | Path):
        first, *more = frames(Path(value))
        if more:
            raise expected(value, "one picture", f"{1 + len(more)} pages or frames", "splatgl compare takes them all")
        return first.image
    drawn = _draw(value)
    if isinstance(drawn, (bytes, bytearray, memoryview)):
        return _decode_bytes(bytes(drawn)).image
    samples = np.asarray(drawn)
    if samples.dtype == bool:
        samples = samples.astype(np.uint8) * np.uint8(255)
    is_samples = samples.dtype in (np.uint8, np.uint16)
    if is_samples and samples.ndim == 2:
        samples = samples[..., None]
    shape_ok = samples.ndim == 3 and samples.shape[2] in (1, 2, 3, 4) and samples.size > 0
    if is_samples and shape_ok:
        gray = np.repeat(samples[..., :1], 3, axis=-1)
        color = samples[..., :3] if samples.shape[2] > 2 else gray
        alpha = samples[..., -1:] if samples.shape[2] in (2, 4) else samples[..., :0]
        return Image.from_samples(np.concatenate([color, alpha], axis=-1))
    if samples.dtype.kind == "f" and shape_ok and samples.shape[2] == 4:
        return Image(samples.astype(np.float32))
    got = f"{samples.dtype} {samples.shape}" if samples.dtype != object else type(value).__name__
    is_float = samples.dtype.kind == "f" and samples.ndim in (2, 3)
    fix = "floats need colour and alpha: premultiplied, linear, [H, W, 4]" if is_float else ""
    this = "an Image, a file, its bytes, a figure, uint8 [H, W] or [H, W, 3 or 4], or float [H, W, 4]"
    raise expected(what, this, got, fix)


def image_of(value: Any, _: Any) -> Image:
    """`as_image`, for arguments of public functions."""
    return as_image(value)


def _draw(value: Any) -> Any:
    """The bytes or samples of an object that draws itself; other values as they are."""
    if isinstance(value, Pillow.Image):
        return _encode_pillow(value)
    file = BytesIO()
    # axes of Matplotlib
    value = value.figure if hasattr(getattr(value, "figure", None), "savefig") else value
    if hasattr(value, "savefig"):
        value.savefig(file, format="png")
    elif hasattr(value, "to_image"):
        try:
            return value.to_image(format="png")
        # of Plotly's exporter, which needs a browser
        except (ValueError, RuntimeError) as error:
            raise InputError(f"image: Plotly cannot draw {type(value).__name__}: {error}") from error
    elif type(value).__module__.startswith("napari"):
        return value.screenshot(canvas_only=True, flash=False)
    elif hasattr(value, "get_screenshot_as_png"):
        return value.get_screenshot_as_png()
    elif hasattr(value, "screenshot_as_png"):
        return value.screenshot_as_png
    elif hasattr(value, "screenshot"):
        shown = value.screenshot()
        if isawaitable(shown):
            raise expected("image", "a picture", "one to wait for", "give the bytes of await page.screenshot()")
        return shown
    elif hasattr(value, "_repr_png_"):
        return value._repr_png_()
    return file.getvalue() or value


def _encode_pillow(image: PillowImage) -> bytes:
    """The bytes of a PNG of Pillow's image. Raises InputError for modes that PNG lacks."""
    file = BytesIO()
    try:
        image.save(file, "PNG")
    except OSError as error:
        raise expected("image", "a mode of PNG", image.mode, "convert it to RGB or RGBA") from error
    return file.getvalue()


def _decode_bytes(content: bytes) -> Picture:
    """The picture of the bytes of a PNG, JPEG or SVG. Raises InputError for others."""
    with TemporaryDirectory() as folder:
        is_svg = SVG_TEXT.match(content[:MOST_HEAD].decode("utf-8", "replace"))
        path = Path(folder) / ("image.svg" if is_svg else "image")
        path.write_bytes(content)
        try:
            return next(frames(path))
        except InputError as error:
            raise InputError(str(error).replace(str(path), f"image of {len(content)} bytes")) from error

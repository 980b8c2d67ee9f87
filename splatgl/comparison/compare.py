"""Compares two images: reads them, matches their formats and computes all metrics."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path
from tokenize import TokenError

import numpy as np

from splatgl.comparison.metrics import count_unmatched, exceeds_threshold, flip, over_channels, ssim
from splatgl.data.image import PNG_SIGNATURE, Image
from splatgl.data.image_files import EXR, TIFF, is_float_tiff
from splatgl.errors import InputError, expected

# number of 8-bit levels
LEVELS = 255.0
# rows per band: at 4096 columns a band of float64 differences is 2 MB and fits in the cache
BAND_ROWS = 16
NAMES = ("first picture", "second picture")


@dataclass(frozen=True)
class Comparison:
    """Differences a − b over all four channels, linear premultiplied.

    maximum and rmse: of |a − b|. peak: full scale: 1, or for X-rays b's largest Σ τ.
    psnr: peak over rmse in decibels, infinite for equal images. share_over: fraction of pixels whose largest
    difference exceeds threshold·peak; for None, one step of 8-bit samples (`steps`). sum_error: (Σa − Σb)/Σ|b|;
    0 for equal sums. where: (column, row) of the maximum. box: (left, top, right, bottom) of the pixels over the
    threshold, right and bottom exclusive; or None.
    bias: signed mean of a − b in the channel in which it is largest. share_unmatched: fraction of pixels over the
    threshold that no neighbour explains, so that edges moved by a pixel do not count (`metrics.count_unmatched`).
    ssim, flip: see `metrics`, None if not requested. pixels: number of compared pixels.
    """

    maximum: float
    rmse: float
    psnr: float
    share_over: float
    sum_error: float
    where: tuple[int, int]
    box: tuple[int, int, int, int] | None
    peak: float = 1.0
    threshold: float | None = 1 / LEVELS
    bias: float = 0.0
    share_unmatched: float = 0.0
    ssim: float | None = None
    flip: float | None = None
    pixels: int = 0

    def __str__(self) -> str:
        column, row = self.where
        return (
            f"maximum {self.maximum:.6g} at column {column}, row {row}; rmse {self.rmse:.6g}; psnr {self.psnr:.2f} dB; "
            f"{100 * self.share_over:.3g} % of pixels over {self.over}; sum off by {self.sum_error:.3g}"
        )

    @property
    def over(self) -> str:
        """The threshold for a differing pixel, as text."""
        return "one 8-bit step" if self.threshold is None else f"{self.peak * self.threshold:.4g}"


# differences of finite numbers may overflow: they count as infinite
@np.errstate(over="ignore", invalid="ignore")
def compare(
    a: Image,
    b: Image,
    threshold: float | None = 1 / LEVELS,
    extra: Collection[str] = (),
    names: tuple[str, str] = NAMES,
    mask: np.ndarray | None = None,
) -> Comparison:
    """Compares the image `a` with the reference `b`.

    threshold: minimum difference of a differing pixel, as a fraction of the peak; None: more than 8-bit rounding can
    explain. extra: "ssim" and "flip", which are slower. names: of both, for messages. mask: bool [H, W], the pixels
    to compare; the others count as empty in both. Raises InputError for different sizes, NaN and infinity, and if
    `flip` is requested but not installed.
    """
    first, second = _pixels(names[0], a), _pixels(names[1], b)
    if first.shape != second.shape:
        what = "pictures" if names == NAMES else names[0]
        raise expected(what, f"one size, {_format_size(second)}", _format_size(first), "draw both at the same size")
    if mask is not None:
        _check_mask(mask, first)
        first, second = apply_mask(first, mask), apply_mask(second, mask)
    worst, sums, squares, weight = _differences(first, second)
    if not np.isfinite(squares):
        _check_finite(names[0], first)
        _check_finite(names[1], second)
    peak = (float(second[..., 3].max()) or 1.0) if b.info.get("blend") == "xray" else 1.0
    count = first.shape[0] * first.shape[1] if mask is None else int(np.count_nonzero(mask))
    rmse = float(np.sqrt(squares / (4 * count)))
    over = exceeds_threshold(first, second, worst, threshold, peak)
    row, column = np.unravel_index(int(worst.argmax()), over.shape)
    bias, off = sums / count, float(sums.sum())
    return Comparison(
        maximum=float(worst[row, column]),
        rmse=rmse,
        psnr=20 * (math.log10(peak) - math.log10(rmse)) if rmse > 0 else math.inf,
        share_over=int(np.count_nonzero(over)) / count,
        sum_error=off / weight if weight > 0 else math.copysign(math.inf, off) if off else 0.0,
        where=(int(column), int(row)),
        box=_box(over),
        peak=peak,
        threshold=threshold,
        bias=float(bias[np.abs(bias).argmax()]),
        share_unmatched=count_unmatched(first, second, over, threshold, peak) / count,
        ssim=ssim(first, second, peak, mask) if "ssim" in extra else None,
        flip=flip(first, second, peak, mask) if "flip" in extra else None,
        pixels=count,
    )


def apply_mask(pixels: np.ndarray, mask: np.ndarray | None) -> np.ndarray:
    """The image with zeros where `mask` is False."""
    return pixels if mask is None else np.where(mask[..., None], pixels, np.float32(0))


def _format_size(pixels: np.ndarray) -> str:
    return f"{pixels.shape[1]}×{pixels.shape[0]}"


def _check_mask(mask: np.ndarray, pixels: np.ndarray) -> None:
    if mask.shape != pixels.shape[:2]:
        raise expected(
            "mask", f"the pictures' size, {_format_size(pixels)}", _format_size(mask) if mask.ndim == 2 else mask.shape
        )
    if not mask.any():
        raise expected("mask", "at least one light pixel, which counts", "none")


def _pixels(what: str, image: Image) -> np.ndarray:
    pixels = np.asarray(image.pixels)
    if pixels.ndim != 3 or pixels.shape[2] != 4 or not pixels.size:
        raise expected(what, "pixels [H, W, 4]", f"shape {pixels.shape}")
    return pixels


def _differences(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray, float, float]:
    """(largest |a − b| over the channels [H, W], Σ(a − b) of each channel, Σ(a − b)², Σ|b|), in one pass over bands.

    Differences have the images' precision, their sums are float64.
    """
    worst = np.empty(a.shape[:2], np.result_type(a, b, np.float32))
    columns, squares, weight = np.zeros(a.shape[1] * 4), 0.0, 0.0
    for top in range(0, len(a), BAND_ROWS):
        band = slice(top, top + BAND_ROWS)
        # numpy sums pairwise: float32 is accurate enough within one band
        weight += float(np.abs(b[band]).sum())
        d = np.subtract(a[band], b[band], dtype=worst.dtype)
        exact = d.astype(np.float64).reshape(len(d), -1)
        columns += exact.sum(axis=0)
        squares += float(np.einsum("ij,ij->", exact, exact))
        over_channels(d, worst[band])
    return worst, columns.reshape(-1, 4).sum(axis=0), squares, weight


def _check_finite(what: str, pixels: np.ndarray) -> None:
    bad = np.argwhere(~np.isfinite(pixels).all(axis=-1))
    if len(bad):
        row, column = bad[0]
        got = f"{pixels[row, column].tolist()} at column {column}, row {row} of {len(bad)} such"
        raise expected(what, "finite numbers", got)


def _box(over: np.ndarray) -> tuple[int, int, int, int] | None:
    if not over.any():
        return None
    rows, columns = np.flatnonzero(over.any(axis=1)), np.flatnonzero(over.any(axis=0))
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1


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
        _check_finite(picture.name, image.pixels)
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

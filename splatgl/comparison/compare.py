"""Compares two images: computes all metrics of their differences."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from splatgl.coercion import public
from splatgl.comparison.metrics import (
    count_unmatched,
    densest_share,
    exceeds_threshold,
    flip,
    largest_level,
    over_channels,
    ssim,
)
from splatgl.comparison.pictures import as_image, check_finite, match_images
from splatgl.data.image import Image
from splatgl.errors import expected

# number of 8-bit levels
LEVELS = 255.0
# rows per band: at 4096 columns a band of float64 differences is 2 MB and fits in the cache
BAND_ROWS = 16
# metrics that are computed on request
EXTRA = ("ssim", "flip", "levels", "density")
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
    ssim, flip: see `metrics`, None if not requested. levels: largest difference of 8-bit samples, sRGB and straight
    alpha. density: largest share of pixels over the threshold in one place (see `metrics`). Both are None if not
    requested. pixels: number of compared pixels.
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
    levels: float | None = None
    density: float | None = None

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
@public
def compare(
    a: Any,
    b: Any,
    threshold: float | None = 1 / LEVELS,
    extra: Collection[str] = (),
    names: tuple[str, str] = NAMES,
    mask: np.ndarray | None = None,
) -> Comparison:
    """Compares the image `a` with the reference `b`, after rounding the finer one to the bits of the other.

    a, b: an Image, a file, an array, or anything else that `pictures.as_image` takes. threshold: minimum difference of
    a differing pixel, as a fraction of the peak; None: more than 8-bit rounding can explain. extra: names of EXTRA,
    which are slower. names: of both, for messages. mask: bool [H, W], the pixels to compare; the others count as empty
    in both. Raises InputError for different sizes, NaN and infinity, and if `flip` is requested but not installed.

    ```python
    new, old = (sg.render(sg.scenes.ball(12), zoom=zoom, size=64) for zoom in (1.0, 1.1))
    found = sg.compare(new, old)
    print(found.rmse, found.share_over, found.box)
    ```
    """
    a, b = match_images(as_image(a, names[0]), as_image(b, names[1]), names)
    first, second = _pixels(names[0], a), _pixels(names[1], b)
    if first.shape != second.shape:
        what = "pictures" if names == NAMES else names[0]
        raise expected(what, f"one size, {format_size(second)}", format_size(first), "draw both at the same size")
    if mask is not None:
        _check_mask(mask, first)
        first, second = apply_mask(first, mask), apply_mask(second, mask)
    worst, sums, squares, weight = _differences(first, second)
    if not np.isfinite(squares):
        check_finite(names[0], first)
        check_finite(names[1], second)
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
        levels=largest_level(first, second, peak) if "levels" in extra else None,
        density=densest_share(over) if "density" in extra else None,
    )


def equal_comparison(pixels: int, threshold: float | None, extra: Collection[str] = ()) -> Comparison:
    """The comparison of two equal images, without reading them."""
    nothing = {name: 1.0 if name == "ssim" else 0.0 for name in extra}
    return Comparison(0.0, 0.0, math.inf, 0.0, 0.0, (0, 0), None, threshold=threshold, pixels=pixels, **nothing)


# where pictures of other sizes are laid over each other: their left and upper edges, or their centres
ALIGNMENTS = ("corner", "center")


def unite_sizes(
    actual: Image, right: Image, mask: np.ndarray | None, align: str
) -> tuple[Image, Image, np.ndarray | None]:
    """Images of different sizes on one canvas of the larger width and height, and the pixels that both have.

    mask: [H, W] of `right`, as is returned for images of one size; only its pixels count. align: one of ALIGNMENTS.
    """
    shapes = np.array([image.pixels.shape[:2] for image in (actual, right)])
    canvas_shape = shapes.max(axis=0)
    if mask is not None:
        _check_mask(mask, right.pixels)
    if (shapes == canvas_shape).all():
        return actual, right, mask
    starts = (canvas_shape - shapes) // 2 if align == "center" else np.zeros_like(shapes)
    canvases, shared = [], np.ones(tuple(canvas_shape), bool)
    for image, (top, left), (height, width) in zip((actual, right), starts, shapes, strict=True):
        place = slice(top, top + height), slice(left, left + width)
        canvas, covered = np.zeros((*canvas_shape, 4), image.pixels.dtype), np.zeros(tuple(canvas_shape), bool)
        canvas[place] = image.pixels
        covered[place] = True if image is actual or mask is None else mask
        canvases.append(replace(image, pixels=canvas))
        shared &= covered
    return canvases[0], canvases[1], shared


def apply_mask(pixels: np.ndarray, mask: np.ndarray | None) -> np.ndarray:
    """The image with zeros where `mask` is False."""
    return pixels if mask is None else np.where(mask[..., None], pixels, np.float32(0))


def format_size(pixels: np.ndarray) -> str:
    """The size of pixels [H, W, …] as width×height."""
    return f"{pixels.shape[1]}×{pixels.shape[0]}"


def _check_mask(mask: np.ndarray, pixels: np.ndarray) -> None:
    if mask.shape != pixels.shape[:2]:
        raise expected(
            "mask", f"the pictures' size, {format_size(pixels)}", format_size(mask) if mask.ndim == 2 else mask.shape
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


def _box(over: np.ndarray) -> tuple[int, int, int, int] | None:
    if not over.any():
        return None
    rows, columns = np.flatnonzero(over.any(axis=1)), np.flatnonzero(over.any(axis=0))
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1

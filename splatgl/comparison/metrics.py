"""Compares two images: metrics of their differences, such as SSIM, FLIP, unmatched pixels and steps of 8 bits."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from splatgl.coercion import public
from splatgl.comparison.pictures import as_image, check_finite, match_images
from splatgl.data.color import srgb_from_linear
from splatgl.data.image import Image, bounding_box
from splatgl.errors import expected, import_extra

# Wang et al., "Image quality assessment: from error visibility to structural similarity", 2004, Eq. 13: K1 and K2;
# the window of 7×7 with equal weights and the sample covariance are scikit-image's defaults
SSIM_K1, SSIM_K2, SSIM_WINDOW = 0.01, 0.03, 7
# rows per band, so that intermediates stay in the cache
BAND_ROWS = 32


def ssim(a: ArrayLike, b: ArrayLike, peak: float = 1.0, mask: np.ndarray | None = None) -> float:
    """Mean structural similarity of [H, W, C] arrays, window 7×7, mean over the channels; 1 for equal images.

    Equals scikit-image's structural_similarity(channel_axis=-1, data_range=peak). mask: bool [H, W]; only
    windows with a pixel of it count. Raises InputError for an image smaller than the window.
    """
    first, second = np.asarray(a), np.asarray(b)
    height, width = first.shape[:2]
    if min(height, width) < SSIM_WINDOW:
        raise expected("ssim", f"a picture of at least {SSIM_WINDOW}×{SSIM_WINDOW} pixels", f"{width}×{height}")
    total, windows = 0.0, 0
    # in bands of windows: intermediates stay in the cache
    for top in range(0, height - SSIM_WINDOW + 1, BAND_ROWS):
        rows = slice(top, top + BAND_ROWS + SSIM_WINDOW - 1)
        maps = [_ssim_map(first[rows, :, c], second[rows, :, c], peak) for c in range(first.shape[2])]
        counts = np.ones(maps[0].shape, bool) if mask is None else _window_mean(mask[rows].astype(np.float64)) > 0
        total += sum(float(values.sum(where=counts)) for values in maps)
        windows += len(maps) * int(np.count_nonzero(counts))
    return total / windows


def _ssim_map(a: np.ndarray, b: np.ndarray, peak: float) -> np.ndarray:
    """SSIM of every whole window of one channel."""
    x, y = a.astype(np.float64), b.astype(np.float64)
    count = SSIM_WINDOW**2
    sample = count / (count - 1)
    mean_x, mean_y = _window_mean(x), _window_mean(y)
    var_x = sample * (_window_mean(x * x) - mean_x * mean_x)
    var_y = sample * (_window_mean(y * y) - mean_y * mean_y)
    covariance = sample * (_window_mean(x * y) - mean_x * mean_y)
    c1, c2 = (SSIM_K1 * peak) ** 2, (SSIM_K2 * peak) ** 2
    likeness = (2 * mean_x * mean_y + c1) * (2 * covariance + c2)
    return likeness / ((mean_x**2 + mean_y**2 + c1) * (var_x + var_y + c2))


def _window_mean(x: np.ndarray) -> np.ndarray:
    """Means over all whole windows, [H − 6, W − 6]: sums over columns, then over rows."""
    n = SSIM_WINDOW
    rows, columns = x.shape[0] - n + 1, x.shape[1] - n + 1
    down = x[:rows].copy()
    for i in range(1, n):
        down += x[i : i + rows]
    across = down[:, :columns].copy()
    for i in range(1, n):
        across += down[:, i : i + columns]
    return across / n**2


def flip(a: ArrayLike, b: ArrayLike, peak: float = 1.0, mask: np.ndarray | None = None) -> float:
    """Mean FLIP error in [0, 1] of `a` against `b`, linear premultiplied [H, W, 4], at flip-evaluator's distance.

    Andersson et al., "FLIP: a difference evaluator for alternating images", 2020. Transparent images are compared
    over black and over white; the larger counts. mask: bool [H, W], the pixels whose errors count. Raises InputError
    if flip-evaluator is not installed.
    """
    flip_evaluator = require_flip()
    first, second = np.asarray(a, np.float32) / np.float32(peak), np.asarray(b, np.float32) / np.float32(peak)
    opaque = min(first[..., 3].min(), second[..., 3].min()) >= 1
    means = []
    for ground in (0,) if opaque else (0, 1):
        shown = [np.clip(p[..., :3] + (1 - p[..., 3:]) * np.float32(ground), 0, 1) for p in (second, first)]
        errors, mean, _ = flip_evaluator.evaluate(*shown, "LDR", inputsRGB=False, applyMagma=False)
        means.append(mean if mask is None else errors[..., 0][mask].mean(dtype=np.float64))
    return float(max(means))


def require_flip() -> Any:
    """flip-evaluator's module. Raises InputError if it is not installed."""
    return import_extra("flip_evaluator", "flip", "flip-evaluator", "compare")


def count_unmatched(
    a: np.ndarray, b: np.ndarray, over: np.ndarray, threshold: float | None = None, peak: float = 1.0
) -> int:
    """Number of `over` pixels that no neighbour explains.

    A pixel is explained if all channels of `a` lie within the range of `b` in the 3×3 neighbourhood, and `b` within the
    range of `a`, up to the threshold: an edge moved by a pixel or less is explained, a wrong pixel or a missing line is
    not. a, b: [H, W, 4]; over: bool [H, W].
    """
    count = 0
    for top in range(0, len(a), BAND_ROWS):
        bottom = min(top + BAND_ROWS, len(a))
        touched = np.flatnonzero(over[top:bottom].any(axis=0))
        if touched.size:
            left, right = int(touched[0]), int(touched[-1]) + 1
            # the tile with a margin of one pixel, clipped to the image
            rows, columns = slice(max(top - 1, 0), bottom + 1), slice(max(left - 1, 0), right + 1)
            around = a[rows, columns], b[rows, columns]
            outside = _outside(*around, threshold, peak) | _outside(*around[::-1], threshold, peak)
            inner = outside[top - rows.start : bottom - rows.start, left - columns.start : right - columns.start]
            count += int(np.count_nonzero(inner & over[top:bottom, left:right]))
    return count


def _outside(x: np.ndarray, y: np.ndarray, threshold: float | None, peak: float) -> np.ndarray:
    """bool [H, W]: whether x is outside the range of y in the 3×3 neighbourhood."""
    nearest = np.clip(x, _spread(y, np.minimum), _spread(y, np.maximum))
    worst = np.empty(x.shape[:2], x.dtype)
    over_channels(x - nearest, worst)
    return exceeds_threshold(x, nearest, worst, threshold, peak)


def _spread(x: np.ndarray, choose: np.ufunc) -> np.ndarray:
    """Minimum or maximum of each pixel and its up to 8 neighbours."""
    down = x.copy()
    choose(down[1:], x[:-1], out=down[1:])
    choose(down[:-1], x[1:], out=down[:-1])
    across = down.copy()
    choose(across[:, 1:], down[:, :-1], out=across[:, 1:])
    choose(across[:, :-1], down[:, 1:], out=across[:, :-1])
    return across


# tolerance on a step: products of two roundings, and floats before rounding
SLACK = 1.1
# Linear light l rises by 2.275 l^(7/12) per unit of sRGB (IEC 61966-2-1; the slope of its power part), bounded by
# √l for l ≤ 1, and by 1/12.92 in the linear part of the darks.
STEP = SLACK * 2.275 / 255
DARK_STEP = SLACK / 12.92 / 255
ALPHA_STEP = SLACK / 255
# minimum alpha for division of colours
NOTHING = 1e-6
# rows per band
STEP_BAND_ROWS = 16
# smallest alpha that 8-bit samples do not round to 0, in levels
HALF_LEVEL = 0.5
# pixels of a window of 7×7, and of a line
WINDOW, LINE = SSIM_WINDOW**2, 2 * SSIM_WINDOW**2
# slopes of lines from level to 45°: a line of LINE pixels keeps within one pixel of the nearest
SLOPES = 24
# differing pixels whose lines and groups are counted, in a second: 0.5 % of 5000²
MOST_POINTS = 2**17


def over_channels(d: np.ndarray, out: np.ndarray) -> None:
    """Maximum |d| over the four channels into `out`; overwrites d. 20 times as fast as .max(axis=-1)."""
    np.abs(d, out=d)
    np.maximum(d[..., 0], d[..., 1], out=out)
    for channel in (2, 3):
        np.maximum(out, d[..., channel], out=out)


def exceeds_threshold(
    a: np.ndarray, b: np.ndarray, worst: np.ndarray, threshold: float | None, peak: float
) -> np.ndarray:
    """bool [H, W]: whether `worst`, the largest |a − b| of a pixel, exceeds threshold·peak; None: an 8-bit step."""
    if threshold is not None:
        return worst > threshold * peak
    over = worst > DARK_STEP * peak
    for top in range(0, len(over), STEP_BAND_ROWS):
        band = slice(top, top + STEP_BAND_ROWS)
        if over[band].any():
            scaled = (a[band], b[band]) if peak == 1 else (a[band] / peak, b[band] / peak)
            over[band] &= _unit_steps(*scaled) > 1
    return over


def _unit_steps(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """[H, W]: the difference of each pixel in steps of 8-bit samples times SLACK, for images of full scale 1.

    A colour is α l: a step of sRGB changes it by α dl, at most the step times √(α l · α); a step of alpha by l dα.
    """
    off, most = np.abs(a - b), np.clip(np.maximum(a, b), 0, 1)
    alpha, off_alpha = most[..., 3].copy(), off[..., 3].copy()
    share = off_alpha / np.maximum(np.minimum(a[..., 3], b[..., 3]), NOTHING)
    steps = off_alpha / np.float32(ALPHA_STEP)
    # per channel: numpy is slow over an axis of three
    for channel in range(3):
        color = most[..., channel]
        step = np.sqrt(color * alpha)
        step *= np.float32(STEP)
        np.maximum(step, np.float32(DARK_STEP), out=step)
        rest = off[..., channel] - np.minimum(color * share, off_alpha)
        np.maximum(steps, rest / step, out=steps)
    return np.asarray(steps)


def largest_level(a: np.ndarray, b: np.ndarray, peak: float) -> float:
    """The largest difference of 8-bit samples, sRGB and straight alpha, of pixels [H, W, 4]. Finer images have
    fractions of levels.

    Colours count where both pixels have an alpha of half a level or more, and differences that rounding explains
    (`exceeds_threshold`) in translucent ones as at most one level.
    """
    most = 0.0
    for top in range(0, len(a), STEP_BAND_ROWS):
        band = slice(top, top + STEP_BAND_ROWS)
        differs = (a[band] != b[band]).any(axis=-1)
        if differs.any():
            x, y = (pixels[band][differs] / np.float32(peak) for pixels in (a, b))
            straight, other = (255 * Image(pixels).straight() for pixels in (x, y))
            off = np.abs(straight - other)
            off[..., :3] *= np.minimum(straight[..., 3:], other[..., 3:]) >= HALF_LEVEL
            levels = off.max(axis=-1)
            is_literal = (_unit_steps(x, y) > 1) | (np.minimum(straight[..., 3], other[..., 3]) == 255)
            most = max(most, float(np.where(is_literal, levels, np.minimum(levels, 1)).max()))
    # samples of 8 bits that float32 holds are whole again
    return round(most, 3)


# neighbours of a pixel: rows and columns
AROUND = [(down, across) for down in (-1, 0, 1) for across in (-1, 0, 1) if (down, across) != (0, 0)]


def densest_share(over: np.ndarray) -> float:
    """The largest share of `over` pixels, bool [H, W], in one place: in a window of 7×7, on a line in any direction, or
    of those that touch each other, as a share of a window. 1 for an area, 1/49 for single pixels. More than MOST_POINTS
    pixels are counted in windows alone.
    """
    rows, columns = np.nonzero(over)
    if not rows.size:
        return 0.0
    part = over[rows[0] : rows[-1] + 1, columns.min() : columns.max() + 1]
    count = round(WINDOW * float(_window_mean(np.pad(part, SSIM_WINDOW - 1).astype(np.float32)).max()))
    if count == WINDOW or rows.size > MOST_POINTS:
        return count / WINDOW
    on_lines = max(_densest_line(columns, rows), _densest_line(rows, columns)) / LINE
    places = zip(rows.tolist(), columns.tolist(), strict=True)
    return max(min(max(count, *map(len, connected_groups(places))), WINDOW) / WINDOW, on_lines)


def _densest_line(along: np.ndarray, across: np.ndarray) -> int:
    """The largest number of pixels, whole coordinates [N], on a part of LINE pixels of a line that rises by at most 45°
    over the axis `along`.
    """
    most, stride = 0, int(along.max()) + LINE
    for slope in range(-SLOPES, SLOPES + 1):
        lines = across - np.rint(along * (slope / SLOPES)).astype(np.int64)
        places = np.sort(lines * stride + along)
        most = max(most, int((np.searchsorted(places, places + LINE) - np.arange(places.size)).max()))
    return most


def connected_groups(places: Iterable[tuple[int, int]]) -> Iterator[list[tuple[int, int]]]:
    """Yields the groups of places (row, column) that touch each other by edges or corners."""
    rest = dict.fromkeys(places)
    while rest:
        group = [rest.popitem()[0]]
        # grows while it is read
        for row, column in group:
            near = [place for down, across in AROUND if (place := (row + down, column + across)) in rest]
            for place in near:
                del rest[place]
            group += near
        yield group


# equal neighbours of a pixel in an even area, at least
EVEN = 3


def find_antialiased(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """bool [H, W]: pixels that only smooth an edge, in `a` or in `b`, linear premultiplied [H, W, 4] of one size.

    Vyšniauskas, "Measuring perceived color difference using YIQ NTSC transmission color space", 2009: such a pixel lies
    between a darker and a lighter neighbour, equals at most two, and the darkest or the lightest neighbour is part of
    an even area in both images.
    """
    levels = [_gray_levels(pixels) for pixels in (a, b)]
    even = np.logical_and(*(_count_equal(gray) >= EVEN for gray in levels))
    return np.logical_or(*(_smooths_edge(gray, even) for gray in levels))


def _gray_levels(pixels: np.ndarray) -> np.ndarray:
    """Brightness over white, int16 [H, W]: 8-bit sRGB levels."""
    light = pixels[..., :3] @ np.array((0.2126, 0.7152, 0.0722), np.float32) + (1 - pixels[..., 3])
    return np.rint(255 * srgb_from_linear(np.clip(light, 0, 1))).astype(np.int16)


def _shifted(values: np.ndarray) -> Iterator[np.ndarray]:
    """Each neighbour's values; those at the border are repeated."""
    padded = np.pad(values, 1, mode="edge")
    height, width = values.shape
    for down, across in AROUND:
        yield padded[1 + down : 1 + down + height, 1 + across : 1 + across + width]


def _count_equal(gray: np.ndarray) -> np.ndarray:
    return np.sum([near == gray for near in _shifted(gray)], axis=0)


def _smooths_edge(gray: np.ndarray, even: np.ndarray) -> np.ndarray:
    """bool [H, W]: whether a pixel is between a darker and a lighter one, of which one is `even`."""
    least, most = np.zeros_like(gray), np.zeros_like(gray)
    least_even, most_even = np.zeros(gray.shape, bool), np.zeros(gray.shape, bool)
    for near, near_even in zip(_shifted(gray), _shifted(even), strict=True):
        off = near - gray
        least_even = np.where(off < least, near_even, least_even)
        most_even = np.where(off > most, near_even, most_even)
        np.minimum(least, off, out=least)
        np.maximum(most, off, out=most)
    return (least < 0) & (most > 0) & (_count_equal(gray) < EVEN) & (least_even | most_even)


# number of 8-bit levels
LEVELS = 255.0
# rows per band: at 4096 columns a band of float64 differences is 2 MB and fits in the cache
DIFFERENCE_ROWS = 16
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
        box=bounding_box(over) if over.any() else None,
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
    for top in range(0, len(a), DIFFERENCE_ROWS):
        band = slice(top, top + DIFFERENCE_ROWS)
        # numpy sums pairwise: float32 is accurate enough within one band
        weight += float(np.abs(b[band]).sum())
        d = np.subtract(a[band], b[band], dtype=worst.dtype)
        exact = d.astype(np.float64).reshape(len(d), -1)
        columns += exact.sum(axis=0)
        squares += float(np.einsum("ij,ij->", exact, exact))
        over_channels(d, worst[band])
    return worst, columns.reshape(-1, 4).sum(axis=0), squares, weight

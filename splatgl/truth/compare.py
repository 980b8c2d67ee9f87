"""How far one picture is from another: maximum, root mean square, PSNR, where, and in how many pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from splatgl.data.errors import expected
from splatgl.data.image import Image

# one level of an 8-bit picture
LEVELS = 255.0


@dataclass(frozen=True)
class Comparison:
    """Differences a − b over all four channels, linear premultiplied.

    maximum and rmse: of |a − b|. peak: what counts as full scale: 1, or for X-rays b's largest Σ τ.
    psnr: peak over rmse in decibels, infinite for equal pictures. share_over: of the pixels whose largest
    difference is over peak/255. sum_error: (Σa − Σb)/Σ|b|; 0 for equal sums. where: (column, row) of the
    maximum. box: (left, top, right, bottom) of the pixels over peak/255, right and bottom beyond; or None.
    """

    maximum: float
    rmse: float
    psnr: float
    share_over: float
    sum_error: float
    where: tuple[int, int]
    box: tuple[int, int, int, int] | None
    peak: float = 1.0

    def __str__(self) -> str:
        column, row = self.where
        return (
            f"maximum {self.maximum:.6g} at column {column}, row {row}; rmse {self.rmse:.6g}; psnr {self.psnr:.2f} dB; "
            f"{100 * self.share_over:.3g} % of pixels over {self.peak / LEVELS:.4g}; sum off by {self.sum_error:.3g}"
        )


def compare(a: Image, b: Image) -> Comparison:
    """The picture `a` against `b`, which is taken for right. Raises InputError for other sizes, NaN and infinity."""
    first, second = _checked("first picture", a), _checked("second picture", b)
    if first.shape != second.shape:
        sizes = [f"{pixels.shape[1]}×{pixels.shape[0]}" for pixels in (second, first)]
        raise expected("pictures", f"one size, {sizes[0]}", sizes[1], "draw both at the same size")
    peak = 1.0
    if b.info.get("blend") == "xray":
        peak = float(second[..., 3].max()) or 1.0
    difference = np.abs(first - second)
    rmse = float(np.sqrt(np.mean(difference * difference)))
    worst = difference.max(axis=-1)
    row, column = np.unravel_index(int(worst.argmax()), worst.shape)
    over = worst > peak / LEVELS
    return Comparison(
        maximum=float(worst.max()),
        rmse=rmse,
        psnr=float(20 * np.log10(peak / rmse)) if rmse > 0 else float("inf"),
        share_over=float(over.mean()),
        sum_error=_sum_error(first, second),
        where=(int(column), int(row)),
        box=_box(over),
        peak=peak,
    )


def _checked(what: str, image: Image) -> np.ndarray:
    """The pixels in float64."""
    pixels = np.asarray(image.pixels, dtype=np.float64)
    if pixels.ndim != 3 or pixels.shape[2] != 4 or not pixels.size:
        raise expected(what, "pixels [H, W, 4]", f"shape {pixels.shape}")
    bad = ~np.isfinite(pixels).all(axis=-1)
    if bad.any():
        row, column = np.argwhere(bad)[0]
        raise expected(
            what, "finite numbers", f"{pixels[row, column].tolist()} at column {column}, row {row} of {bad.sum()} such"
        )
    return pixels


def _sum_error(a: np.ndarray, b: np.ndarray) -> float:
    off, scale = float(a.sum() - b.sum()), float(np.abs(b).sum())
    if off == 0:
        return 0.0
    return off / scale if scale > 0 else float(np.copysign(np.inf, off))


def _box(over: np.ndarray) -> tuple[int, int, int, int] | None:
    if not over.any():
        return None
    rows, columns = np.flatnonzero(over.any(axis=1)), np.flatnonzero(over.any(axis=0))
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1

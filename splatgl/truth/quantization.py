"""Which pixels differ: by more than a threshold, or by more than one step of 8-bit samples, sRGB and alpha."""

from __future__ import annotations

import numpy as np

# what a step may be more than itself: products of two roundings, and floats before they are rounded
SLACK = 1.1
# Linear light l rises by 2.275 l^(7/12) a unit of sRGB (IEC 61966-2-1; the slope of its power part), which √l bounds
# for l ≤ 1, and by 1/12.92 in the darks, where it is a straight line.
STEP = SLACK * 2.275 / 255
DARK_STEP = SLACK / 12.92 / 255
ALPHA_STEP = SLACK / 255
# an alpha that no colour can be divided by
NOTHING = 1e-6
# rows that are worked on together
BAND_ROWS = 16


def over_channels(d: np.ndarray, out: np.ndarray) -> None:
    """The largest |d| over the four channels into `out`; changes d. 20 times as fast as .max(axis=-1)."""
    np.abs(d, out=d)
    np.maximum(d[..., 0], d[..., 1], out=out)
    for channel in (2, 3):
        np.maximum(out, d[..., channel], out=out)


def differ(a: np.ndarray, b: np.ndarray, worst: np.ndarray, threshold: float | None, peak: float) -> np.ndarray:
    """Where `worst`, the largest |a − b| of a pixel, is over threshold·peak; None: over a step. bool [H, W]."""
    return over_a_step(a, b, worst, peak) if threshold is None else worst > threshold * peak


def over_a_step(a: np.ndarray, b: np.ndarray, worst: np.ndarray, peak: float) -> np.ndarray:
    """Where a and b, linear premultiplied [H, W, 4], differ by more than one step of 8-bit samples, bool [H, W].

    worst: [H, W], the largest |a − b| over the channels. peak: what counts as 1.
    """
    over = worst > DARK_STEP * peak
    for top in range(0, len(over), BAND_ROWS):
        band = slice(top, top + BAND_ROWS)
        if over[band].any():
            scaled = (a[band], b[band]) if peak == 1 else (a[band] / peak, b[band] / peak)
            over[band] &= _more_than_a_step(*scaled)
    return over


def _more_than_a_step(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The same for pictures whose full scale is 1.

    A colour is α l: it changes by α dl for a step of its sRGB, at most the step times √(α l · α), and by l dα.
    """
    off, most = np.abs(a - b), np.clip(np.maximum(a, b), 0, 1)
    alpha, off_alpha = most[..., 3].copy(), off[..., 3].copy()
    share = off_alpha / np.maximum(np.minimum(a[..., 3], b[..., 3]), NOTHING)
    over = off_alpha > ALPHA_STEP
    # a channel at a time: numpy is slow over an axis of three
    for channel in range(3):
        color = most[..., channel]
        step = np.sqrt(color * alpha)
        step *= np.float32(STEP)
        np.maximum(step, np.float32(DARK_STEP), out=step)
        step += np.minimum(color * share, off_alpha)
        over |= off[..., channel] > step
    return np.asarray(over)

"""Blending, and means of samples over pixels, in float64.

An unfinished image stores optical depth (a compensated sum) and premultiplied colour.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from splatgl.data.color import light_of_display
from splatgl.planning.resolve import END_CORRECTION, Appearance, Resolved
from splatgl.splat.settings import COMBINE
from splatgl.transfer.transfer import Transfer

# largest opacity below 1: limits the paper's attenuation of an opaque splat that is widened by rounding only
ALMOST_ONE = 1.0 - 2.0**-53


@dataclass(frozen=True, eq=False)
class CompensatedSum:
    """A compensated sum (Neumaier 1974) of arrays."""

    total: np.ndarray
    lost: np.ndarray

    @classmethod
    def zeros(cls, shape: tuple[int, ...]) -> CompensatedSum:
        """An empty sum of that shape."""
        return cls(np.zeros(shape), np.zeros(shape))

    def add(self, where: np.ndarray, term: np.ndarray) -> None:
        """Adds `term` to the distinct entries `where`."""
        old = self.total[where]
        new = old + term
        self.lost[where] += np.where(np.abs(old) >= np.abs(term), (old - new) + term, (term - new) + old)
        self.total[where] = new

    @property
    def value(self) -> np.ndarray:
        """The total including the compensation."""
        return np.asarray(self.total + self.lost)


@dataclass(frozen=True, eq=False)
class Accumulator:
    """Accumulators of pixels [n]: sum or maximum of alpha, and of colour [n, 3]."""

    depth: CompensatedSum
    color: CompensatedSum

    @classmethod
    def empty(cls, pixels: int) -> Accumulator:
        """An empty band of that many pixels."""
        return cls(CompensatedSum.zeros((pixels,)), CompensatedSum.zeros((pixels, 3)))


def blend_opacity(depth: np.ndarray, coverage: np.ndarray) -> np.ndarray:
    """Opacity of optical depths: the paper's attenuation scales opacity, not depth.  [M98 Eq. 6]"""
    return np.asarray(-np.expm1(-depth / coverage) * coverage)


def add_over(band: Accumulator, pixel: np.ndarray, depth: np.ndarray, color: np.ndarray, coverage: np.ndarray) -> None:
    """'Over', front to back: colour is weighted by the transmittance in front of it; optical depths add."""
    order, start, where = _group_by_pixel(pixel)
    depth, coverage, color = depth[order], coverage[order], color[order]
    opacity = blend_opacity(depth, coverage)
    depth = np.where(coverage < 1, -np.log1p(-np.minimum(opacity, ALMOST_ONE)), depth)
    before = _depth_before(depth, start)
    length = np.diff(np.append(start, len(depth)))
    visible = np.exp(-(np.repeat(band.depth.value[where], length) + before)) * opacity
    band.color.add(where, np.add.reduceat(color * visible[:, None], start, axis=0))
    band.depth.add(where, np.add.reduceat(depth, start))


def add_sum(band: Accumulator, pixel: np.ndarray, depth: np.ndarray, color: np.ndarray, coverage: np.ndarray) -> None:
    """The sum of optical depth and of depth · colour."""
    order, start, where = _group_by_pixel(pixel)
    depth = depth[order]
    band.color.add(where, np.add.reduceat(color[order] * depth[:, None], start, axis=0))
    band.depth.add(where, np.add.reduceat(depth, start))


def add_max(band: Accumulator, pixel: np.ndarray, depth: np.ndarray, color: np.ndarray, coverage: np.ndarray) -> None:
    """The maximum of opacity and, by channel, of opacity · colour."""
    order, start, where = _group_by_pixel(pixel)
    opacity = depth[order]
    color = np.maximum.reduceat(color[order] * opacity[:, None], start, axis=0)
    band.color.total[where] = np.maximum(band.color.total[where], color)
    band.depth.total[where] = np.maximum(band.depth.total[where], np.maximum.reduceat(opacity, start))


# each adds pairs of splat and pixel, front to back: pixel int [P]; depth [P]: optical depth, or opacity; color [P, 3];
# coverage [P]: 1 where opacity is not attenuated
ADD: dict[str, Callable[..., None]] = {"over": add_over, "sum": add_sum, "max": add_max}


def pixels(band: Accumulator, appearance: Appearance) -> np.ndarray:
    """float64 [n, 4], premultiplied."""
    alpha = -np.expm1(-band.depth.value) if appearance.hides else band.depth.value
    return np.concatenate([band.color.value, alpha[:, None]], axis=1)


def join_values(light: np.ndarray, value: np.ndarray, length: np.ndarray, join: str) -> np.ndarray:
    """Joins values [P] over `length` [P] ≥ 0 to rays `light` [P, 4], whose first columns are value and length so far.

    join: max, min, or mean, whose value is the sum by length. Values without length change nothing.
    """
    before = light[:, 0]
    if join == "mean":
        combined = before + value * length
    else:
        combined = np.where(light[:, 1] > 0, COMBINE[join](before, value), value)
    result = light.copy()
    result[:, 0], result[:, 1] = np.where(length > 0, combined, before), light[:, 1] + length
    return result


def join_attenuated(light: np.ndarray, shares: np.ndarray, length: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Joins parts of rays [P] to rays `light` [P, 4]: attenuated maximum, length, 0, and optical depth so far.

    shares [3, P]: of the window, from 0 to 1, at a part's begin, middle and end, between which they are parabolas.
    length [P]: parts without any change nothing. depth [P]: optical depth of a part whose shares are 1.
    """
    whole = np.array([1, 4, 1]) @ shares / 6
    half = np.clip(np.array([5, 8, -1]) @ shares / 24, 0.0, whole)
    seen = (shares * np.exp(-light[:, 3] - depth * np.stack([np.zeros_like(half), half, whole]))).max(axis=0)
    joined = [np.maximum(light[:, 0], seen), light[:, 1] + length, light[:, 2], light[:, 3] + depth * whole]
    return np.where(length[:, None] > 0, np.stack(joined, axis=1), light)


def joined_value(light: np.ndarray, join: str) -> np.ndarray:
    """Values [P] of rays [P, 4]; NaN for rays without values."""
    length = np.where(light[:, 1] > 0, light[:, 1], np.nan)
    return np.asarray(light[:, 0] / length if join == "mean" else np.where(length > 0, light[:, 0], np.nan))


def classify_values(transfer: Transfer, value: np.ndarray) -> np.ndarray:
    """[P, 4]: colour · opacity, and opacity over the reference length, of values [P]; 0 for NaN."""
    opacity = np.asarray(transfer.opacity(value))[:, None]
    return np.concatenate([transfer.color(value) * opacity, opacity], axis=1)


def over_background(drawn: np.ndarray, resolved: Resolved) -> np.ndarray:
    """Pictures [..., 4] over the background of the settings, in linear light; sums have no background."""
    behind = resolved.behind
    if behind is not None:
        drawn = np.asarray(drawn + (1 - drawn[..., 3:]) * np.array([*behind, 1.0]))
    return light_of_display(drawn) if resolved.display else drawn


def _group_by_pixel(pixel: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stable sort of pairs by pixel; the start of each pixel's pairs; and its pixel index."""
    # numpy uses radix sort for 16-bit integers
    small = pixel.astype(np.uint16) if pixel.max(initial=0) < 1 << 16 else pixel
    order = np.argsort(small, kind="stable")
    ordered = pixel[order]
    start = np.flatnonzero(np.diff(ordered, prepend=-1))
    return order, start, ordered[start]


def _depth_before(depth: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Exclusive prefix sum of the depths within each pixel."""
    # each pixel's first entry subtracts the previous pixel's sum, so that the running sum stays small
    totals = np.add.reduceat(depth, start)
    steps = np.zeros(len(depth) + 1)
    steps[1:] = depth
    steps[start[1:]] -= totals[:-1]
    running = np.cumsum(steps[:-1])
    length = np.diff(np.append(start, len(depth)))
    return np.maximum(running - np.repeat(running[start], length), 0.0)


def pixel_means(samples: np.ndarray, k: int) -> np.ndarray:
    """float64 [H, W, C]: pixels of samples [H k, W k, C]; samples beyond the picture repeat those at its edge.

    Along an axis (Σ f_j + (f_k − f_{k−1} − f_0 + f_{−1})/24)/k. All weights are positive, so that no mean leaves the
    range of the samples. Exact for cubics. Twin of `shaders/resolve.frag`.
    """
    for axis in (0, 1):
        rows = np.moveaxis(samples, axis, 0)
        inner = rows.reshape(-1, k, *rows.shape[1:])
        before = np.concatenate([inner[:1, 0], inner[:-1, -1]])
        after = np.concatenate([inner[1:, 0], inner[-1:, -1]])
        total = inner.sum(axis=1) + END_CORRECTION * (after - inner[:, -1] - inner[:, 0] + before)
        samples = np.moveaxis(total / k, 0, axis)
    return samples


def mean_weights(k: int) -> np.ndarray:
    """[k + 2]: weights of a pixel's samples along an axis, and of one more on each side, in `pixel_means`."""
    weights = np.pad(np.ones(k), 1)
    np.add.at(weights, [0, 1, k, k + 1], END_CORRECTION * np.array([1, -1, -1, 1]))
    return weights / k

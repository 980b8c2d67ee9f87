"""From which depths on antialiasing widens voxels: chosen so that float32 and float64 agree on every splat.

The model jumps by O(1/z_k) where a voxel begins to be widened, so that a plane of voxels at that very depth would be
widened in one precision and not in the other. The depth is moved on, by next to nothing, to where no splat is nearer to
it than float32 can tell.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from splatgl.splat.extraction.splats import Splats
from splatgl.splat.view.slab import between
from splatgl.splat.view.view import View

# a depth is a sum of four products of float32: that of no splat is off by more last digits of the largest of them
DIGITS = 8.0
ULP = 2.0**-24
# how far the depth is moved on at most, as a share of itself
FURTHEST = 0.02


class Widening(NamedTuple):
    """beyond: the depths, mean spacings, from which on σ_1 and σ_2 are widened; ∞ where they never are.

    unsure: what a splat may jump by, as a share of itself, where splats are everywhere; 0 where no splat is near.
    """

    beyond: tuple[float, float]
    unsure: float = 0.0


def widening(splats: Splats, view: View) -> Widening:
    """Of a perspective view with antialiasing; `view.beyond` is None."""
    first, second = view.widened_beyond
    if not (view.antialias and view.perspective and len(splats)):
        return Widening((first, second))
    narrow, sure = _clear(splats, view, second)
    if first - second <= FURTHEST * second:
        return Widening((narrow, narrow), 0.0 if sure else _jump(view, second))
    wide, sure_too = _clear(splats, view, first)
    return Widening((wide, narrow), 0.0 if sure and sure_too else _jump(view, second))


def _clear(splats: Splats, view: View, depth: float) -> tuple[float, bool]:
    """The first depth from there on that no splat is near, and whether there is one."""
    low, high = splats.index_bounds
    reach = np.abs(view.eye_from_index[2]) @ np.maximum(np.abs(low - view.eye_index), np.abs(high - view.eye_index))
    margin = DIGITS * ULP * float(reach + depth)
    furthest = max(FURTHEST * depth, 4 * margin)
    near = np.sort(between(splats, view, depth - margin, depth + furthest)[2])
    # ends of the gaps: the first begins before `depth`
    begins = np.concatenate([[depth - margin], near])
    gaps = np.append(near, depth + furthest) - begins
    wide = np.flatnonzero(gaps >= 2 * margin)
    if len(wide):
        return max(float(begins[wide[0]]) + margin, depth), True
    widest = int(np.argmax(gaps))
    return float(begins[widest] + gaps[widest] / 2), False


def _jump(view: View, depth: float) -> float:
    """By how much of itself a splat changes where it begins to be widened: to first order, or by all of it."""
    at_a_pixel = depth <= float(view.widths[1]) / view.pitch * (1 + FURTHEST)
    return min(view.reach * view.kernel.radius / depth, 1.0) if at_a_pixel else 1.0

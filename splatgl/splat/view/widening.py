"""Depths from which antialiasing widens voxels, chosen so that float32 and float64 agree on every splat.

The model jumps by O(1/z_k) at the depth where widening begins, so that a plane of voxels at exactly that depth would be
widened in one precision and not in the other. The depth is increased slightly, into a gap between splats wider than
float32's error.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from splatgl.splat.extraction.splats import Splats
from splatgl.splat.view.slab import between
from splatgl.splat.view.view import View

# a depth is a sum of four float32 products: its error is at most this many ULPs of the largest
DIGITS = 8.0
ULP = 2.0**-24
# largest increase of the depth, relative
FURTHEST = 0.02


class Widening(NamedTuple):
    """beyond: depths, mean spacings, from which σ_1 and σ_2 are widened; ∞ for never.

    unsure: relative jump of a splat if there is no gap; 0 if no splat is near.
    """

    beyond: tuple[float, float]
    unsure: float = 0.0


def widening(splats: Splats, view: View) -> Widening:
    """The widening depths of a view whose `beyond` is None; moved only in perspective views with antialiasing."""
    first, second = view.widened_beyond
    if not (view.antialias and view.perspective and len(splats)):
        return Widening((first, second))
    narrow, sure = _clear(splats, view, second)
    if first - second <= FURTHEST * second:
        return Widening((narrow, narrow), 0.0 if sure else _jump(view, second))
    wide, sure_too = _clear(splats, view, first)
    return Widening((wide, narrow), 0.0 if sure and sure_too else _jump(view, second))


def _clear(splats: Splats, view: View, depth: float) -> tuple[float, bool]:
    """The first depth ≥ `depth` with no splat near, and whether there is one; else the middle of the widest gap."""
    low, high = splats.index_bounds
    reach = np.abs(view.eye_from_index[2]) @ np.maximum(np.abs(low - view.eye_index), np.abs(high - view.eye_index))
    margin = DIGITS * ULP * float(reach + depth)
    furthest = max(FURTHEST * depth, 4 * margin)
    near = np.sort(between(splats, view, depth - margin, depth + furthest)[2])
    # starts of the gaps; the first is before `depth`
    begins = np.concatenate([[depth - margin], near])
    gaps = np.append(near, depth + furthest) - begins
    wide = np.flatnonzero(gaps >= 2 * margin)
    if len(wide):
        return max(float(begins[wide[0]]) + margin, depth), True
    widest = int(np.argmax(gaps))
    return float(begins[widest] + gaps[widest] / 2), False


def _jump(view: View, depth: float) -> float:
    """Relative change of a splat where widening begins: the first-order term, else 1."""
    at_a_pixel = depth <= float(view.widths[1]) / view.pitch * (1 + FURTHEST)
    return min(view.reach * view.kernel.radius / depth, 1.0) if at_a_pixel else 1.0

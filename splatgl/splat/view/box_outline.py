"""Which tiles of pixels look past a box: no ray of theirs meets it."""

from __future__ import annotations

from itertools import combinations, product

import numpy as np

from splatgl.splat.view.screen_bounds import Window
from splatgl.splat.view.view import View

# pixels around the outline, for rounding
MARGIN = 1.0


def beside_box(view: View, shape: tuple[int, int, int], window: Window, side: tuple[int, int]) -> np.ndarray:
    """bool [tiles]: whether a tile lies beside the outline of the box of `shape` voxels (x, y, z) with their cells.

    Tiles of `side` pixels (x, y) cover the window row by row. None does if the eye's plane is not in front of the box.
    """
    across, down = (-(-size // pixels) for size, pixels in zip((window.width, window.height), side, strict=True))
    ends = [(-0.5, size - 0.5) for size in shape]
    corners = view.voxels(np.array(list(product(*ends))))
    if view.perspective and corners[2].min() <= view.depth_reach:
        return np.zeros(across * down, bool)
    depth = corners[2] if view.perspective else np.ones(8)
    places = (corners[:2] / depth).T / view.pitch + np.array(view.size) / 2
    # centres of tiles, and half of what their pixels' centres span
    half = (np.array(side) - 1) / 2
    x = window.x + np.arange(across) * side[0] + side[0] / 2
    y = window.y + np.arange(down) * side[1] + side[1] / 2
    found = np.zeros((down, across), bool)
    for a, b in combinations(places, 2):
        along = b - a
        length = float(np.hypot(*along))
        if length < 1e-6:
            continue
        normal = np.array([along[1], -along[0]]) / length
        apart = (places - a) @ normal
        # an edge of the outline has all corners on one side
        for sign in (1.0, -1.0):
            if (sign * apart).max() <= 1e-6:
                reach = sign * ((x - a[0]) * normal[0] + (y[:, None] - a[1]) * normal[1]) - np.abs(normal) @ half
                found |= reach > MARGIN
    return found.ravel()

"""Fields on cells, linear between their centres: the twin of `shaders/trilinear.glsl`."""

from __future__ import annotations

import numpy as np


def trilinear(field: np.ndarray, place: np.ndarray) -> np.ndarray:
    """[P, n]: a field [Z, Y, X, n] at places [P, 3] (x, y, z) in cells, as at its edges beyond them."""
    last = np.array(field.shape[2::-1]) - 1
    inside = np.clip(place, 0, last)
    low = np.minimum(inside.astype(np.int64), np.maximum(last - 1, 0))
    part = inside - low
    found = np.zeros((len(place), field.shape[3]))
    for corner in np.ndindex(2, 2, 2):
        x, y, z = np.minimum(low + np.array(corner), last).T
        share = np.where(corner, part, 1 - part).prod(axis=1)
        found += share[:, None] * field[z, y, x].astype(np.float64)
    return found

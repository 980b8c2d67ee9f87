"""Checks of the positions, colours and extinctions that `Splats.from_points` takes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from splatgl.data.volume import LEAST_LENGTH, MOST_LENGTH, MOST_OBLONG
from splatgl.errors import expected


def checked_points(points: object, colors: object, extinctions: object) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points and colours [N, 3] and extinctions [N], float64. InputError for other shapes and negative numbers."""
    p, c, e = (np.asarray(array, dtype=np.float64) for array in (points, colors, extinctions))
    if p.ndim != 2 or p.shape[1] != 3:
        raise expected("points", "shape [N, 3]", p.shape)
    if c.shape != p.shape:
        raise expected("colors", f"shape {p.shape}", c.shape)
    if e.shape != (len(p),):
        raise expected("extinctions", f"shape {(len(p),)}", e.shape)
    if (c < 0).any() or (e < 0).any():
        raise expected("colors and extinctions", "numbers of at least 0", min(c.min(), e.min()))
    return p, c, e


def checked_spacing(spacing: float | Sequence[float]) -> np.ndarray:
    """Spacing [3]: positive, within the lengths and proportions that float32 resolves; else InputError."""
    scale = np.asarray(spacing, dtype=np.float64)
    if scale.shape not in ((), (3,)) or not ((scale >= LEAST_LENGTH) & (scale <= MOST_LENGTH)).all():
        within = f"from {LEAST_LENGTH:g} to {MOST_LENGTH:g}"
        raise expected("spacing", f"a positive number or three (x, y, z), {within}", spacing)
    if scale.max() > MOST_OBLONG * scale.min():
        raise expected("spacing", f"three numbers (x, y, z) within a factor of {MOST_OBLONG:g}", spacing)
    return np.broadcast_to(scale, (3,))

"""Integrations with napari, VTK and PyVista, and the functions that the importers share."""

from __future__ import annotations

from itertools import product

import numpy as np

from splatgl.splat.clipping import Plane
from splatgl.splat.colormaps import colormap_name
from splatgl.splat.transfer import Nodes


def plane_through(point: np.ndarray, normal: np.ndarray) -> Plane:
    """The clipping plane through a point, world units, that keeps the side that the normal points to."""
    x, y, z = (normal / np.linalg.norm(normal)).tolist()
    return x, y, z, float(point @ (x, y, z))


def opacity_nodes(values: np.ndarray, opacities: np.ndarray) -> Nodes:
    """Nodes of a transfer function: ascending values [N], opacities [N]."""
    return tuple(zip(values.tolist(), opacities.tolist(), strict=True))


def color_nodes(values: np.ndarray, colors: np.ndarray) -> tuple[tuple[float, float] | None, str]:
    """Window and colour map through sRGB colours [N, 3] of ascending values [N]; no window for a single value."""
    low, high = float(values[0]), float(values[-1])
    if not low < high:
        return None, colormap_name(np.zeros(1), colors[:1])
    return (low, high), colormap_name((values - low) / (high - low), np.clip(colors, 0.0, 1.0))


def sample_plane(
    samples: np.ndarray, rows: np.ndarray, columns: np.ndarray, is_linear: bool, repeats: bool = False
) -> np.ndarray:
    """Samples [N, M, …] at fractional indices [P, …] along the first two axes, linear in between or the nearest; beyond
    the ends the last ones, or the samples again if they repeat.
    """

    def take(rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        sized = zip((rows, columns), samples.shape, strict=False)
        row, column = ((at % size if repeats else np.clip(at, 0, size - 1)).astype(np.intp) for at, size in sized)
        return np.asarray(samples[row, column])

    if not is_linear:
        return take(np.floor(rows + 0.5), np.floor(columns + 0.5))
    total = np.zeros((*rows.shape, *samples.shape[2:]))
    for down, right in product((0, 1), repeat=2):
        weight = np.abs(1 - down - rows % 1) * np.abs(1 - right - columns % 1)
        part = take(np.floor(rows) + down, np.floor(columns) + right)
        total += part * weight.reshape(weight.shape + (1,) * (samples.ndim - 2))
    return total

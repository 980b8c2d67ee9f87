"""Integrations with napari, VTK and PyVista, and the functions that the importers share."""

from __future__ import annotations

import numpy as np

from splatgl.geometry.clipping import Plane
from splatgl.transfer.colormaps import colormap_name
from splatgl.transfer.transfer import Nodes


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

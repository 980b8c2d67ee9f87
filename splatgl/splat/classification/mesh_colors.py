"""Colours of meshes whose vertices have values: a colour map over their range, looked up at every point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from splatgl.data.color import srgb_from_linear
from splatgl.data.mesh import Mesh
from splatgl.splat.classification.colormap import ENTRIES, colormap

# places of values in a map are from 0 to 1; those beyond are kept up to the first number, and NaN is the second, below
# the third even near other corners
FURTHEST, UNKNOWN, KNOWN = 1e4, -1e12, -1e5


def places_of(mesh: Mesh) -> np.ndarray:
    """Places [N] of vertices' values in their map, 0 to 1 within its window; UNKNOWN where there is none."""
    assert mesh.values is not None
    low, high = mesh.ranged
    place = np.clip((mesh.values - low) / (high - low), -FURTHEST, FURTHEST)
    return np.where(np.isnan(place), UNKNOWN, place)


def tables_of(meshes: Sequence[Mesh]) -> np.ndarray:
    """float32 [R, ENTRIES, 3]: linear RGB of the maps of those meshes that have values; one row without any."""
    found = [colormap(mesh.colormap) for mesh in meshes if mesh.mapped]
    return np.array(found or [np.zeros((ENTRIES, 3))], np.float32)


def painted(mesh: Mesh) -> Mesh:
    """A mesh with the colours of its values at its vertices, for what does not look them up between."""
    if not mesh.mapped:
        return mesh
    every = replace(mesh, faces=np.arange(len(mesh.vertices))[:, None] * np.ones(3, np.int64), corner_normals=None)
    linear = colors_at(every, np.arange(len(mesh.vertices)), np.broadcast_to([1.0, 0.0, 0.0], (len(mesh.vertices), 3)))
    colors = np.rint(srgb_from_linear(linear) * 255).astype(np.uint8)
    return replace(mesh, colors=colors, values=None)


def colors_at(mesh: Mesh, triangle: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Linear RGB [P, 3] at points of triangles [P], by the shares [P, 3] of their corners."""
    if not mesh.mapped:
        return np.asarray((mesh.shades[triangle] * share[..., None]).sum(axis=1))
    place = (places_of(mesh)[mesh.faces[triangle]] * share).sum(axis=1)
    return mapped_color(colormap(mesh.colormap), place, np.asarray(mesh.color))


def mapped_color(table: np.ndarray, place: np.ndarray, plain: np.ndarray) -> np.ndarray:
    """Linear RGB [P, 3] at places [P] of a map; `plain` where there is no value. Twin of `shaders/mesh_maps.glsl`."""
    at = np.clip(place, 0.0, 1.0) * (ENTRIES - 1)
    low = np.minimum(at.astype(np.int64), ENTRIES - 2)
    found = table[low] + (table[low + 1] - table[low]) * (at - low)[:, None]
    return np.where((place < KNOWN)[:, None], plain, found)

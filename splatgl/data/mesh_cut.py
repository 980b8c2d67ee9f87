"""Meshes cut by planes: triangles that a plane crosses end at it, with what their corners have, linear between."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from splatgl.data.color import linear_from_srgb, srgb_from_linear
from splatgl.data.mesh import Mesh


def cut(mesh: Mesh, planes: Sequence[Sequence[float]]) -> Mesh:
    """What lies where n · x ≥ d of all planes (n_x, n_y, n_z, d), open where it is cut; as it is, if that is all."""
    rows = np.asarray(planes, np.float64).reshape(-1, 4)
    if not len(mesh) or (mesh.vertices @ rows[:, :3].T >= rows[:, 3]).all():
        return mesh
    # of each corner: place, normal, linear colour, value
    parts = [mesh.vertices[mesh.faces], mesh.normals]
    if mesh.colors is not None:
        parts.append(linear_from_srgb(mesh.colors / 255.0)[mesh.faces])
    if mesh.values is not None:
        parts.append(mesh.values[mesh.faces][..., None])
    corners = np.concatenate(parts, axis=2)
    for *normal, place in rows:
        corners = _behind(corners, corners[..., :3] @ np.array(normal) - place)
    normals = corners[..., 3:6]
    size = np.linalg.norm(normals, axis=2, keepdims=True)
    flat = corners.reshape(-1, corners.shape[2])
    colors = None
    if mesh.colors is not None:
        colors = np.rint(srgb_from_linear(np.clip(flat[:, 6:9], 0, 1)) * 255).astype(np.uint8)
    return replace(
        mesh,
        vertices=flat[:, :3],
        faces=np.arange(len(flat)).reshape(-1, 3),
        colors=colors,
        values=None if mesh.values is None else flat[:, -1],
        window=mesh.ranged if mesh.mapped else mesh.window,
        corner_normals=normals / np.where(size > 0, size, 1.0),
    )


def _behind(corners: np.ndarray, beyond: np.ndarray) -> np.ndarray:
    """Triangles [M, 3, K] of the parts of others where `beyond` [M, 3], linear between corners, is at least 0."""
    inside = beyond >= 0
    count = inside.sum(axis=1)
    whole = corners[count == 3]
    # one corner inside: a triangle; one outside: two; turned so that this corner is the first
    tips, stumps = (_turned(corners, beyond, count == n, inside if n == 1 else ~inside) for n in (1, 2))
    (a, *_), (ab, ac) = tips
    (_, e, f), (de, df) = stumps
    found = [whole, np.stack([a, ab, ac], axis=1), np.stack([de, e, f], axis=1), np.stack([de, f, df], axis=1)]
    return np.concatenate(found)


def _turned(
    corners: np.ndarray, beyond: np.ndarray, some: np.ndarray, first: np.ndarray
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Of some triangles: their corners [m, K], from the one that is `first` on; and where the plane crosses the sides
    from it to the next and to the last.
    """
    numbers = np.flatnonzero(some)
    start = first[numbers].argmax(axis=1)
    order = (start[:, None] + np.arange(3)) % 3
    three = [corners[numbers, order[:, n]] for n in range(3)]
    at = [beyond[numbers, order[:, n]] for n in range(3)]
    crossed = []
    for n in (1, 2):
        share = (at[0] / (at[0] - at[n]))[:, None]
        crossed.append(three[0] + (three[n] - three[0]) * share)
    return three, crossed

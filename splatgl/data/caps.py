"""Caps: the parts of planes that lie inside meshes, as triangles.

A point of the plane lies inside if a ray within the plane crosses the mesh an odd number of times: what lies inside an
inner surface is outside. The plane is divided into strips between the corners of the outline where it cuts the mesh,
and the inner parts of the strips into triangles that share their corners, without gaps.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from splatgl.data.mesh import Mesh
from splatgl.errors import expected

# n_x, n_y, n_z, d: keeps n · x ≥ d, world units; n is a unit vector
Plane = tuple[float, float, float, float]
# lengths within an outline, as shares of its size, that are only rounding
ROUNDING = 1e-9


def cap_meshes(mesh: Mesh, planes: Sequence[Plane]) -> list[tuple[Plane, Mesh]]:
    """The caps that close what planes leave of a mesh, each with its plane. Raises InputError as `cap_mesh`."""
    distinct = list(dict.fromkeys(planes))
    caps = [(plane, cap_mesh(mesh, plane).cut([other for other in distinct if other != plane])) for plane in distinct]
    return [(plane, cap) for plane, cap in caps if len(cap)]


def cap_mesh(mesh: Mesh, plane: Plane) -> Mesh:
    """The part of a plane inside a mesh, in the mesh's plain colour.

    Raises InputError for a mesh that is open where the plane cuts it.
    """
    normal, place = np.array(plane[:3], np.float64), float(plane[3])
    right = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    axes = np.array([right, np.cross(normal, right)]) / np.linalg.norm(right)
    corners, faces = fill_outline(_outline(mesh, normal, place) @ axes.T)
    return Mesh(
        corners @ axes + place * normal,
        faces,
        mesh.color,
        mesh.opacity,
        name=f"cap of {mesh.name}",
        frame=mesh.frame,
        corner_normals=np.broadcast_to(normal, (len(faces), 3, 3)),
    )


def _outline(mesh: Mesh, normal: np.ndarray, place: float) -> np.ndarray:
    """Lines [S, 2, 3] in which the plane cuts the triangles of a mesh."""
    # sums of the same three products are the same wherever they stand in an array
    inside = ((mesh.vertices * normal).sum(axis=1) >= place)[mesh.faces]
    cut = mesh.faces[inside.any(axis=1) & ~inside.all(axis=1)]
    # files without shared vertices repeat their places
    places, number = np.unique(mesh.vertices[cut].reshape(-1, 3), axis=0, return_inverse=True)
    beyond = (places * normal).sum(axis=1) - place
    sides = np.sort(number.reshape(-1, 3)[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
    sides = sides[(beyond[sides] >= 0).sum(axis=1) == 1]
    _, count = np.unique(sides, axis=0, return_counts=True)
    if (count % 2).any():
        this = "meshes that are closed where planes cut them"
        raise expected("caps", this, f"{mesh.name or 'a mesh'}, which is open", "close its holes, or leave caps out")
    ends, along = places[sides], beyond[sides]
    share = along[:, 0] / (along[:, 0] - along[:, 1])
    return np.asarray(ends[:, 0] + (ends[:, 1] - ends[:, 0]) * share[:, None]).reshape(-1, 2, 3)


class Strips(NamedTuple):
    """Parts of lines between neighbouring rows, by strip and from left to right. number [N]: of the strip; low, high
    [N]: x on its lower and upper row.
    """

    number: np.ndarray
    low: np.ndarray
    high: np.ndarray


def fill_outline(lines: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners [N, 2] and faces [M, 3] of the area inside closed lines [S, 2, 2]: (x, y) of both ends."""
    downwards = lines[:, 0, 1] > lines[:, 1, 1]
    lines = np.where(downwards[:, None, None], lines[:, ::-1], lines)
    lines = lines[lines[:, 0, 1] < lines[:, 1, 1]]
    slack = ROUNDING * float(np.ptp(lines, axis=(0, 1)).max(initial=0.0)) if len(lines) else 0.0
    rows = np.unique(lines[..., 1])
    strips = _strips(lines, rows)
    while len(crossed := _crossings(strips, rows, slack)):
        rows = np.union1d(rows, crossed)
        strips = _strips(lines, rows)
    # ends of the inner parts, by left and right, lower and upper
    left, right = (np.stack([strips.low[n::2], strips.high[n::2]]) for n in (0, 1))
    row = strips.number[::2] + np.array([[0], [1]])
    points, number = np.unique(
        np.stack([np.stack([row, row]), np.stack([left, right])], axis=-1).reshape(-1, 2), axis=0, return_inverse=True
    )
    (low_left, high_left), (low_right, high_right) = number.reshape(2, 2, -1)
    # sides between neighbouring points of a row: what they belong to, and their first points
    below, start = _ranges(low_left, np.maximum(low_left, low_right))
    above, end = _ranges(high_left, np.maximum(high_left, high_right))
    faces = [np.stack([start, start + 1, high_left[below]], axis=1), np.stack([end + 1, end, low_right[above]], axis=1)]
    return np.stack([points[:, 1], rows[points[:, 0].astype(int)]], axis=1), np.concatenate(faces)


def _strips(lines: np.ndarray, rows: np.ndarray) -> Strips:
    """The parts of upward lines [S, 2, 2] between rows [R], among which are those of all ends."""
    first, last = (np.searchsorted(rows, lines[:, end, 1]) for end in (0, 1))
    line, strip = _ranges(first, last)
    (x, y), (end_x, end_y) = (lines[line, end].T for end in (0, 1))
    low, high = (
        np.where(at == y, x, np.where(at == end_y, end_x, x + (end_x - x) * ((at - y) / (end_y - y))))
        for at in (rows[strip], rows[strip + 1])
    )
    order = np.lexsort((low + high, strip))
    return Strips(strip[order], low[order], high[order])


def _crossings(strips: Strips, rows: np.ndarray, slack: float) -> np.ndarray:
    """Further rows, where neighbouring lines of a strip cross by more than `slack`."""
    below, above = np.diff(strips.low), np.diff(strips.high)
    some = np.flatnonzero((np.diff(strips.number) == 0) & (np.minimum(below, above) < -slack))
    strip, share = strips.number[some], below[some] / (below[some] - above[some])
    at = rows[strip] + (rows[strip + 1] - rows[strip]) * share
    return np.asarray(at[(at > rows[strip]) & (at < rows[strip + 1])])


def _ranges(first: np.ndarray, last: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The whole numbers from `first` to below `last` [N], and of each the index of its range."""
    count = last - first
    owner = np.repeat(np.arange(len(count)), count)
    return owner, np.arange(len(owner)) - np.repeat(np.cumsum(count) - count - first, count)

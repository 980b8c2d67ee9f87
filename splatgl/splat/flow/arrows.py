"""Arrows of a volume's vectors, spread evenly, as long as they are fast."""

from __future__ import annotations

import numpy as np

from splatgl.data.mesh import Mesh
from splatgl.data.volume import Volume
from splatgl.splat.flow.streamlines import COLORMAP, checked
from splatgl.splat.flow.vectors import VectorField, colors_of, slowest

# an arrow of length 1: where its head begins, the radii of shaft and head, and sides of both
HEAD, SHAFT, WIDE, SIDES = 0.6, 0.05, 0.14, 10
# length of the longest, in mean distances between arrows
LENGTH = 2.0
COUNT = 400


def arrows(
    volume: Volume,
    count: int = COUNT,
    length: float | None = None,
    colormap: str = COLORMAP,
    least: float | None = None,
    opacity: float = 1.0,
) -> Mesh:
    """Arrows at up to `count` voxels faster than `least`, spread evenly, as long as they are fast, in the middle of
    which these lie, coloured by speed from 0 to the greatest.

    length: of the greatest speed (of 99.9 % of the voxels), world units; None: twice the mean distance between
    arrows. least: None: a tenth of that speed. Raises InputError for a volume without vectors.
    """
    field = VectorField.of(volume)
    slow = slowest(field, least)
    index = field.spread(checked(count), slow)
    vectors = field.at(index)[0]
    speed = np.linalg.norm(vectors, axis=1)
    if length is None:
        room = (field.speed > slow).sum() * abs(float(np.linalg.det(field.world_from_index)))
        length = LENGTH * float(room / max(len(index), 1)) ** (1 / 3)
    vertices, faces = _arrow()
    axes = _axes(vectors / np.where(speed > 0, speed, 1.0)[:, None]) * (speed / field.greatest * length)[:, None, None]
    placed = field.world(index)[:, None] + vertices @ axes
    offsets = np.arange(len(index))[:, None, None] * len(vertices)
    colors = np.repeat(colors_of(speed, field.greatest, colormap), len(vertices), axis=0)
    shown = colors if len(colors) else None
    every = (faces + offsets).reshape(-1, 3)
    return Mesh(placed.reshape(-1, 3), every, opacity=opacity, colors=shown, name="arrows", frame=volume.frame)


def _axes(along: np.ndarray) -> np.ndarray:
    """Unit vectors [N, 3, 3], the first along unit vectors [N, 3], the others at right angles to them."""
    helper = np.eye(3)[np.abs(along).argmin(axis=1)] if len(along) else along
    side = np.cross(along, helper)
    side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-300)
    return np.stack([along, side, np.cross(along, side)], axis=1)


def _arrow() -> tuple[np.ndarray, np.ndarray]:
    """Vertices [N, 3] and faces [M, 3] of an arrow along x from −½ to ½, closed."""
    turn = 2 * np.pi * np.arange(SIDES) / SIDES
    circle = np.stack([np.zeros(SIDES), np.cos(turn), np.sin(turn)], axis=1)
    place = np.array([1.0, 0.0, 0.0])
    rings = [circle * SHAFT, circle * SHAFT + HEAD * place, circle * WIDE + HEAD * place]
    vertices = np.concatenate([*rings, [place * 0.0, place]]) - place / 2
    here, then = np.arange(SIDES), (np.arange(SIDES) + 1) % SIDES
    tail, tip = np.full(SIDES, 3 * SIDES), np.full(SIDES, 3 * SIDES + 1)
    faces = [np.stack([tail, then, here], axis=1), np.stack([here + 2 * SIDES, then + 2 * SIDES, tip], axis=1)]
    for first in (0, SIDES):
        a, b = here + first, then + first
        faces += [np.stack([a, b, b + SIDES], axis=1), np.stack([a, b + SIDES, a + SIDES], axis=1)]
    return vertices, np.concatenate(faces)

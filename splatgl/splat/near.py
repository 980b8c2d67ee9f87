"""Where the nearest splats are too large for sprites: which planes of the lattice are drawn as quads, which not.

A ray of the picture goes on by r planes while it goes one step deep, so that a plane Δ planes ahead of the eye is
no nearer than Δ/r of the fastest ray, and one behind the eye by more than a kernel is not seen at all.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from splatgl.splat.camera import Camera
from splatgl.splat.motion import Exposure
from splatgl.splat.order import Order
from splatgl.splat.rows import Splats
from splatgl.splat.sprites import CLEARANCE, Reach, reach

# planes are told apart only where every ray goes on by this many at least, a step deep
SLOWEST = 0.05
# a point is off its cell's middle by this much along an axis
OFF_CELL = 0.5
# planes behind the eye that may be seen, and ahead that are near in any case, in radii of the kernel
BEHIND, AHEAD = 2.0, 4.0
# rounds that look for the depth at which sprites are small enough, each by this much deeper or more
ROUNDS, DEEPER = 20, 1.1
# the eye is near where a kernel is nearer than this many radii: √1.1, as shaders/exact.glsl has it, and some
NEAR_RADII = 1.06
# quads for all are as good where fewer splats than this share can be sprites
WORTH = 0.1


@dataclass(frozen=True)
class Near:
    """Planes less than `planes` ahead of the eye, along the order's axis towards `way` (±1), are drawn as quads.

    reach: of the sprites behind them. eye: along that axis, in planes.
    """

    order: Order
    way: int
    eye: float
    planes: float
    behind: float
    reach: Reach


@dataclass(frozen=True)
class Run:
    """Splats [begin, end) of the order, nearest first, and whether they are quads."""

    begin: int
    end: int
    quads: bool


def near(splats: Splats, camera: Camera, order: Order, radius: float, limit: float) -> Near | None:
    """How to part the splats so that no sprite is larger than `limit` pixels; None if that is not worth it.

    radius: the kernel's, in voxels. camera: perspective, of the samples drawn.
    """
    spacing = splats.grid.mean_spacing
    # planes that a ray goes on by in a mean spacing of depth: in the middle of the picture, and more or less at a slope
    axes = np.linalg.inv(splats.grid.world_from_index)[order.axis] @ camera.eye_from_world.T * spacing
    middle, slope = float(axes[2]), np.abs(axes[:2])
    edge = camera.extent / 2 * np.array([camera.size[0] / camera.size[1], 1.0])
    if abs(middle) - slope @ edge < SLOWEST:
        return None

    # the depth from which on sprites are small enough, and all around the picture ahead
    deep = radius * float(np.linalg.norm(camera.eye_from_world[2] @ splats.grid.world_from_index)) / spacing
    nearest = float(camera.eye_from_points(splats.corners)[:, 2].min()) / spacing
    depth = max(CLEARANCE * deep * DEEPER, nearest)
    for _ in range(ROUNDS):
        covered = reach(splats, camera, radius, depth)
        sides = float(slope @ (edge + covered.pad * camera.extent / camera.size[1]))
        too_large = (2 * covered.largest + 1) / limit
        if too_large <= 1 and abs(middle) - sides > SLOWEST:
            break
        depth *= float(np.clip(too_large, DEEPER, 2.0))
    else:
        return None
    way = 1 if middle > 0 else -1
    planes = max(depth * (abs(middle) + sides), AHEAD * radius) + OFF_CELL
    eye = float(splats.grid.index_from_world(camera.eye)[order.axis])
    found = Near(order, way, eye, planes, BEHIND * radius + OFF_CELL, covered)
    sprites = sum(run.end - run.begin for run in runs(splats, found) if not run.quads)
    return found if sprites > WORTH * len(splats) else None


def runs(splats: Splats, chosen: Near) -> list[Run]:
    """What is drawn, nearest first; what cannot be seen is left out."""
    lattice = splats.lattice(chosen.order.axis)
    cell = chosen.order.cell[chosen.order.axis]
    towards = int(np.searchsorted(lattice.plane, cell, side="right"))
    # planes up to the eye's come first, downwards; then those beyond it, upwards
    sequence = np.concatenate([np.arange(towards)[::-1], np.arange(towards, len(lattice.plane))])
    start = lattice.row_start[lattice.plane_start]
    ends = np.cumsum(np.diff(start)[sequence])
    offset = (lattice.plane[sequence] - chosen.eye) * chosen.way
    kind = np.where(offset >= chosen.planes, 0, np.where(offset >= -chosen.behind, 1, 2))
    changes = np.flatnonzero(np.diff(kind)) + 1
    bounds = [0, *changes.tolist(), len(kind)]
    before = np.concatenate([[0], ends])
    return [
        Run(int(before[first]), int(before[last]), bool(kind[first] == 1))
        for first, last in pairwise(bounds)
        if kind[first] != 2
    ]


def widened(covered: Reach, chosen: Near | None) -> Reach:
    """What the picture's sprites need, and the window of all splats."""
    return replace(chosen.reach, window=covered.window) if chosen else covered


def eye_is_near(splats: Splats, camera: Camera, radius: float, exposure: Exposure | None) -> bool:
    """Whether the eye may lie inside a kernel: within NEAR_RADII of the box of all centres, wherever they flow."""
    low, high = splats.index_bounds
    eye = splats.grid.index_from_world(camera.eye)
    near = NEAR_RADII * radius
    if exposure is not None and exposure.flow is not None and len(splats):
        near += float(np.linalg.norm(exposure.drift(splats), axis=1).max())
    return bool(np.linalg.norm(eye - np.clip(eye, low, high)) < near)

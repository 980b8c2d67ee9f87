"""`Scissors`: removes or keeps the part inside an outline in a picture, extruded along its rays.

It is a mask of volumes on any grid. Its value falls linearly across a face, from 1 to 0 within RAMP voxels, so that
linear interpolation between voxel centres passes one half exactly at the face, at any angle.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.coercion import public
from splatgl.data.affine import World
from splatgl.data.volume import Places, with_parts
from splatgl.errors import expected
from splatgl.options import reject_unknown

if TYPE_CHECKING:
    from splatgl.data.volume import Volume
    from splatgl.geometry.camera import Camera

FORM = "x,y x,y x,y …: fractions of the picture's width and height, with :keep to keep the inside"
KEEP = ":keep"
# corners of an outline; shares of the picture's sides up to which they lie around it
LEAST_CORNERS, MOST_CORNERS, AROUND = 3, 1000, 10.0
# width of the ramp across a face, in voxels
RAMP = 2.0
# cells along the longer side of the map of distances to the outline
CELLS = 512
# keys of a table of a scene file
VIEW = ("eye", "look_at", "up", "fov", "height", "aspect")


@public
@dataclass(frozen=True, eq=False)
class Scissors:
    """outline: corners (x, y), as shares of the picture's width and height from its upper left corner; or text.

    keep: whether what lies under it is kept, instead of removed. camera: of the picture that it is drawn in; None: that
    of the scene. frame, unit: of the camera's world, as of volumes. Raises InputError for an outline without an area.

    ```python
    ball = sg.scenes.ball(12)
    camera = sg.Camera.orbit(ball, 30, 20, size=(64, 64))
    cut = ball.masked(sg.Scissors("0.5,0 1,0 1,0.5 0.5,0.5", camera=camera))
    sg.render(cut, camera=camera).save("cut.png")
    ```
    """

    outline: Any
    keep: bool = False
    camera: Camera | None = None
    frame: str | None = None
    unit: str = ""
    notes: tuple[str, ...] = ()
    name = "scissors"

    def __post_init__(self) -> None:
        given = self.outline
        if isinstance(given, str):
            object.__setattr__(self, "keep", self.keep or self.outline.endswith(KEEP))
            object.__setattr__(self, "outline", [corner.split(",") for corner in given.removesuffix(KEEP).split()])
        corners = np.array(_numbers(self.outline), np.float64)
        fine = corners.ndim == 2 and corners.shape[1] == 2 and LEAST_CORNERS <= len(corners) <= MOST_CORNERS
        if not fine or not (np.abs(corners) <= AROUND).all() or not np.ptp(corners, axis=0).min() > 0:
            raise expected("scissors", FORM, repr(given)[:80])
        object.__setattr__(self, "outline", tuple((float(x), float(y)) for x, y in corners))

    @classmethod
    def of(cls, given: Any) -> Scissors:
        """Scissors of a text, of corners, or of a table of a scene file with its view, by the names in VIEW."""
        if isinstance(given, Scissors) or not isinstance(given, Mapping):
            return given if isinstance(given, Scissors) else cls(given)
        reject_unknown("scissors", given, ("outline", "keep", *VIEW))
        view = {name: given[name] for name in VIEW if name in given}
        outline, keep = given.get("outline", ""), given.get("keep", False)
        if not view:
            return cls(outline, keep)
        missing = [name for name in ("eye", "look_at", "up") if name not in view]
        if missing or ("fov" in view) == ("height" in view):
            raise expected("scissors", "eye, look_at, up, and fov or height, of their view", ", ".join(view))
        from splatgl.geometry.camera import Camera

        # the width and height of a picture again, whose ratio this is
        size = Fraction(view.pop("aspect", 1.0)).limit_denominator(MOST_SIDE).as_integer_ratio()
        make = Camera.look_at if "fov" in view else Camera.orthographic
        names = {"look_at": "target"}
        return cls(outline, keep, make(size=size, **{names.get(name, name): value for name, value in view.items()}))

    @property
    def table(self) -> dict[str, Any]:
        """The keys of a scene file."""
        plain = {"outline": self.text, **({"keep": True} if self.keep else {})}
        if self.camera is None:
            return plain
        camera = self.camera
        fov = float(np.degrees(2 * np.arctan(camera.extent / 2)))
        place = {"eye": camera.eye, "look_at": camera.eye + camera.forward, "up": -camera.eye_from_world[1]}
        field = {"fov": fov} if camera.perspective else {"height": camera.extent}
        points = {name: value.tolist() for name, value in place.items()}
        return {**plain, **points, **field, "aspect": camera.size[0] / camera.size[1]}

    @property
    def text(self) -> str:
        """The corners as `--scissors` takes them."""
        return " ".join(f"{x:.6g},{y:.6g}" for x, y in self.outline)

    def seen_by(self, camera: Camera, world: World) -> Scissors:
        """The scissors with a camera, and frame and unit of its world: those of the scene, where they have none."""
        frame, unit = World.shared((World(self.frame, self.unit), world))
        return replace(self, camera=self.camera or camera, frame=frame, unit=unit)

    def keeps(self, volume: Volume, low: Places, high: Places) -> np.ndarray:
        """bool: whether each voxel low ≤ (z, y, x) < high of a volume is kept."""
        return self.shares(volume, low, high) >= 128

    def shares(self, volume: Volume, low: Places, high: Places) -> np.ndarray:
        """uint8: the mask of voxels, from 0 to 255; half of it at faces."""
        shape = tuple(b - a for a, b in zip(low, high, strict=True))
        result = np.empty(shape, np.uint8)
        y, x = (axis.ravel() for axis in np.meshgrid(*map(np.arange, low[1:], high[1:]), indexing="ij"))
        for z in range(low[0], high[0]):
            places = np.stack([x, y, np.full(x.shape, z)], axis=1)
            inside = self._depth_inside(places @ volume.world_from_index.T + volume.origin, volume)
            share = 0.5 + (inside if self.keep else -inside) / RAMP
            result[z - low[0]] = np.rint(np.clip(share, 0, 1) * 255).reshape(shape[1:])
        return result

    def _depth_inside(self, points: np.ndarray, volume: Volume) -> np.ndarray:
        """[N]: distance of world points [N, 3] from the faces, in voxels along the face's normal; below 0 outside."""
        assert self.camera is not None, "scissors without a view"
        camera, factors = self.camera, volume.world.factors(World(self.frame, self.unit))
        x, y, depth = camera.eye_from_points(points * factors).T
        ahead = depth > 0
        scale = 1.0 / np.where(ahead, depth, 1.0) if camera.perspective else np.ones(len(depth))
        # in heights of the picture, from its middle
        distance, slope = self._map.at(x * scale / camera.extent, y * scale / camera.extent)
        # the distance's gradient in the world, across the ray
        right, down, forward = camera.eye_from_world
        across = slope[:, :1] * right + slope[:, 1:] * down
        if camera.perspective:
            across = across - ((slope[:, 0] * x + slope[:, 1] * y) * scale)[:, None] * forward
        steps = np.linalg.norm(across * factors @ volume.world_from_index, axis=1)
        return np.where(ahead, distance * camera.extent / (scale * np.maximum(steps, 1e-30)), -RAMP)

    @cached_property
    def _map(self) -> DistanceMap:
        assert self.camera is not None
        aspect = self.camera.size[0] / self.camera.size[1]
        return DistanceMap.of((np.array(self.outline) - 0.5) * [aspect, 1.0])


def cut_volume(volume: Volume, scissors: Sequence[Scissors]) -> Volume:
    """The volume that scissors leave, instead of those that cut it before. Raises InputError if they leave nothing."""

    def without(part: Volume) -> Volume:
        return replace(part, masks=tuple(mask for mask in part.masks if not isinstance(mask, Scissors)))

    cut = with_parts(without(volume), without)
    for each in scissors:
        cut = cut.masked(each)
    return cut


# largest side of a picture whose view a scene file holds, pixels
MOST_SIDE = 1 << 14


@dataclass(frozen=True, eq=False)
class DistanceMap:
    """Distances to an outline at points of a grid, in heights of the picture, above 0 inside. low [2]: of the first
    point; step: between two.
    """

    low: np.ndarray
    step: float
    distance: np.ndarray

    @classmethod
    def of(cls, corners: np.ndarray) -> DistanceMap:
        """The map around an outline of corners [N, 2]."""
        low, high = corners.min(axis=0), corners.max(axis=0)
        step = float((high - low).max()) / (CELLS - 8)
        low = low - 4 * step
        columns, rows = np.ceil((high - low) / step).astype(int) + 5
        y, x = np.meshgrid(low[1] + np.arange(rows) * step, low[0] + np.arange(columns) * step, indexing="ij")
        nearest, inside = np.full(x.shape, np.inf), np.zeros(x.shape, bool)
        for (ax, ay), (bx, by) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            along, length = ((x - ax) * (bx - ax) + (y - ay) * (by - ay)), (bx - ax) ** 2 + (by - ay) ** 2
            share = np.clip(along / max(length, 1e-30), 0, 1)
            nearest = np.minimum(nearest, np.hypot(x - ax - share * (bx - ax), y - ay - share * (by - ay)))
            if ay != by:
                inside ^= ((ay > y) != (by > y)) & (x < ax + (y - ay) * (bx - ax) / (by - ay))
        return cls(low, step, np.where(inside, nearest, -nearest))

    def at(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distances [N] of points, and their gradients [N, 2]; beyond the map those of its rim."""
        places = [(x - self.low[0]) / self.step, (y - self.low[1]) / self.step]
        height, width = self.distance.shape
        column, row = (np.clip(place, 0, size - 1.001) for place, size in zip(places, (width, height), strict=True))
        i, j = column.astype(int), row.astype(int)
        u, v = column - i, row - j
        a, b = self.distance[j, i], self.distance[j, i + 1]
        c, d = self.distance[j + 1, i], self.distance[j + 1, i + 1]
        distance = (a * (1 - u) + b * u) * (1 - v) + (c * (1 - u) + d * u) * v
        beyond = np.hypot(places[0] - column, places[1] - row) * self.step
        slope = np.stack([(b - a) * (1 - v) + (d - c) * v, (c - a) * (1 - u) + (d - b) * u], axis=1) / self.step
        return distance - beyond, slope


def _numbers(outline: Any) -> list[Any]:
    """Corners [N][2]; none for anything else."""
    corners = outline.tolist() if isinstance(outline, np.ndarray) else outline
    try:
        return [(float(x), float(y)) for x, y in corners]
    except (TypeError, ValueError):
        return []

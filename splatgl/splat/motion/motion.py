"""`Motion`: scene motion per frame, and the path of each splat while the shutter is open.

Times are in frames: 0 is the current frame, −1 the previous one. With a shutter of 180° the exposure lasts
from −½ to 0, and a moving splat is blurred along that part of its path.  [M98 §5]
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.splat.extraction.records import as_points
from splatgl.splat.extraction.splats import Splats
from splatgl.splat.plan.settings import FULL_SHUTTER
from splatgl.splat.view.camera import Camera
from splatgl.splat.view.rigid import Rigid
from splatgl.splat.view.view import eye_from_index

# a splat nearer to the eye's plane than this, in mean spacings, has no projection
NEAREST = 1e-2
# shaders: kernels nearer to the eye's plane than AHEAD of their reaches are drawn still; beyond FAR reaches all rays
# that meet a kernel are parallel within 7 %
AHEAD, FAR = 1.1, 16.0


@dataclass(frozen=True, eq=False)
class Motion:
    """Scene motion per frame; all parts are optional and combine.

    spin [3]: the volume turns by |spin| degrees a frame about the axis `spin` through `center` [3] (world),
    counter-clockwise seen from its tip. velocity [3]: it moves, in world units a frame.
    flow [N, 3]: each splat's own velocity, in world units a frame, in the order of the records.
    camera: the previous frame's camera; interpolated by the shortest screw motion.
    Raises InputError for other shapes and numbers that are not finite.
    """

    spin: np.ndarray = field(default_factory=lambda: np.zeros(3))
    center: np.ndarray = field(default_factory=lambda: np.zeros(3))
    velocity: np.ndarray = field(default_factory=lambda: np.zeros(3))
    flow: np.ndarray | None = None
    camera: Camera | None = None

    def __post_init__(self) -> None:
        for name in ("spin", "center", "velocity"):
            object.__setattr__(self, name, _triple(name, getattr(self, name)))
        if self.flow is not None:
            flow = np.asarray(self.flow, dtype=np.float64)
            if flow.ndim != 2 or flow.shape[1] != 3 or not np.isfinite(flow).all():
                raise expected("flow", "finite velocities [N, 3]", f"{flow.dtype} {flow.shape}")
            object.__setattr__(self, "flow", flow)

    @property
    def still(self) -> bool:
        """True if nothing moves."""
        moving = self.spin.any() or self.velocity.any() or (self.flow is not None and self.flow.any())
        return not moving and self.camera is None

    def view(self, camera: Camera, at: float) -> Camera:
        """The camera relative to the volume at time `at`, if `camera` is that of the frame.

        It includes the volume's motion: with the light at the eye, a rotating volume and an orbiting camera
        give the same pictures.
        """
        if at == 0 or not (self.camera or self.spin.any() or self.velocity.any()):
            return camera
        place = Rigid(camera.eye_from_world, camera.eye_from_world @ -camera.eye)
        extent = camera.extent
        if self.camera is not None:
            # eye_from_world at that time, by the screw from the previous camera
            before = Rigid(self.camera.eye_from_world, self.camera.eye_from_world @ -self.camera.eye)
            place = before.after(place.inverse()).part(-at).after(place)
            extent = camera.extent * (self.camera.extent / camera.extent) ** -at
        volume = Rigid.about(np.radians(self.spin) * at, self.center)
        place = place.after(Rigid(volume.rotation, volume.shift + self.velocity * at))
        return replace(camera, eye=-place.rotation.T @ place.shift, eye_from_world=place.rotation, extent=extent)

    def moved(self, splats: Splats, at: float) -> Splats:
        """The splats moved by their flow to that time; they keep their cells, and thus their order."""
        if self.flow is None or at == 0:
            return splats
        records = as_points(splats.records)
        records["position"] += at * _in_cells(splats, self.flow)
        return splats.in_cells(records)


@dataclass(frozen=True, eq=False)
class Streaks:
    """The paths of N splats across the view while the shutter is open, as straight lines.

    camera: in the middle of the exposure. middle [3, N]: the path's middle, eye axes, in mean spacings.
    step [2, N]: from its beginning to its end, across the view at that depth.
    """

    camera: Camera
    middle: np.ndarray
    step: np.ndarray

    @property
    def length(self) -> np.ndarray:
        """[N]: the paths' lengths, mean spacings."""
        return np.hypot(*self.step)

    def pixels(self, spacing: float) -> np.ndarray:
        """[N]: the paths' lengths in pixels; spacing: the grid's mean spacing."""
        return self.length * spacing / self.camera.pixel_pitch(np.maximum(self.middle[2], NEAREST) * spacing)


@dataclass(frozen=True, eq=False)
class Exposure:
    """Motion during one exposure: the cameras at shutter open, in the middle and at shutter close.

    frames: duration of the exposure in frames. flow: as in Motion, None without flow.
    """

    first: Camera
    middle: Camera
    last: Camera
    frames: float
    flow: np.ndarray | None

    @classmethod
    def of(cls, camera: Camera, shutter: float, motion: Motion | None) -> Exposure | None:
        """The exposure; None for a still: no motion, or a closed shutter."""
        frames = exposure(shutter)
        if motion is None or motion.still or frames == 0:
            return None
        flow = motion.flow if motion.flow is not None and motion.flow.any() else None
        return cls(motion.view(camera, -frames), motion.view(camera, -frames / 2), camera, frames, flow)

    def bend(self, splats: Splats) -> float:
        """Largest deviation of the path of a corner of the splats' box from its straight streak, in pixels; ∞ if one
        crosses the eye's plane.
        """
        places = []
        for camera in (self.first, self.middle, self.last):
            eye = camera.eye_from_points(splats.corners)
            if camera.perspective and not eye[:, 2].min() > 0:
                return float(np.inf)
            flat = eye[:, :2] / eye[:, 2:] if camera.perspective else eye[:, :2]
            places.append(flat * (camera.size[1] / camera.extent))
        # two thirds of the sagitta, as a streak is centred on the mean position
        away = (places[0] - 2 * places[1] + places[2]) / 3
        return float(np.linalg.norm(away, axis=1).max())

    def drift(self, splats: Splats) -> np.ndarray:
        """float64 [N, 3]: each splat's flow in half of the exposure, in grid steps."""
        assert self.flow is not None
        return _in_cells(splats, self.flow) * (self.frames / 2)


def exposure(shutter: float) -> float:
    """Exposure in frames of a shutter angle in degrees. InputError outside of 0 … 360."""
    if not 0 <= shutter <= FULL_SHUTTER:
        raise expected("shutter", "an angle from 0 to 360 degrees", shutter)
    return float(shutter) / FULL_SHUTTER


def streaks(splats: Splats, camera: Camera, motion: Motion, shutter: float) -> Streaks:
    """The splats' paths during an exposure of that shutter angle, which ends at the frame's time.

    Streaks are straight approximations of curved paths: parallel to the chord from start to end, centred on the
    mean position. For a splat that crosses the eye's plane it is the tangent in the middle.
    """
    length = exposure(shutter)
    times = (-length, -length / 2, 0.0)
    views = [motion.view(camera, at) for at in times]
    middle = views[1]
    first, mean, last = (
        eye_point(splats, view, motion.flow, at, middle.extent) for view, at in zip(views, times, strict=True)
    )
    shift, step = streak_of(mean, first, last, camera.perspective)
    mean[:2] += shift
    return Streaks(middle, mean, step)


def streak_of(
    mean: np.ndarray, first: np.ndarray, last: np.ndarray, perspective: bool
) -> tuple[np.ndarray, np.ndarray]:
    """From the paths' middles in time to their mean positions, and from their starts to their ends; [2, N] each.

    mean, first, last [3, N]: the splats in the middle of the exposure and at its ends. Simpson's rule for the mean.
    """
    if not perspective:
        return ((first[:2] - mean[:2]) + (last[:2] - mean[:2])) / 6, last[:2] - first[:2]
    ahead = np.minimum(np.minimum(first[2], mean[2]), last[2]) > NEAREST
    slope = [points[:2] / np.where(ahead, points[2], 1.0) for points in (first, mean, last)]
    # 0 to the last bit for still splats
    shift = np.where(ahead, ((slope[0] - slope[1]) + (slope[2] - slope[1])) / 6 * mean[2], 0.0)
    depth = np.where(mean[2] > NEAREST, mean[2], 1.0)
    tangent = np.where(mean[2] > NEAREST, (last - first)[:2] - mean[:2] / depth * (last - first)[2], 0.0)
    return shift, np.where(ahead, (slope[2] - slope[0]) * mean[2], tangent)


def flow_of(splats: Splats, volume: Volume, scale: float = 1.0) -> np.ndarray:
    """float64 [N, 3]: the volume's vectors at the cells of splats extracted from it, times `scale` frames a unit
    of time; world axes. A vector that is not finite is 0.

    Raises InputError for a volume without vectors and for splats of another grid.
    """
    if volume.vectors is None:
        raise expected(volume.name or "volume", "vectors, such as a velocity at each voxel", "none")
    same = np.allclose(splats.grid.world_from_index, volume.world_from_index)
    if not (same and np.allclose(splats.grid.origin, volume.origin)):
        raise expected("splats", f"the grid of {volume.name or 'the volume'}", "another one", "extract them from it")
    cells = np.rint(splats.positions).astype(np.intp)
    if len(cells) and (cells.min() < 0 or (cells.max(axis=0) >= np.array(volume.shape[::-1])).any()):
        raise expected("splats", "cells of the volume", "some outside", "extract them from it")
    x, y, z = cells.T
    vectors = np.asarray(volume.vectors[z, y, x], dtype=np.float64)
    return np.asarray(np.where(np.isfinite(vectors).all(axis=1, keepdims=True), vectors, 0.0) * scale)


def eye_point(splats: Splats, view: Camera, flow: np.ndarray | None, at: float, extent: float) -> np.ndarray:
    """[3, N] in the eye axes of that time, mean spacings; x and y scaled to a camera of that extent."""
    grid = splats.grid
    offset = splats.positions.astype(np.float64) - grid.index_from_world(view.eye)
    if flow is not None:
        offset += at * _in_cells(splats, flow)
    points = eye_from_index(grid, view) @ offset.T
    points[:2] *= extent / view.extent
    return np.asarray(points)


def _in_cells(splats: Splats, flow: np.ndarray) -> np.ndarray:
    """World velocities [N, 3] of all splats in grid steps. InputError for another number of splats."""
    if flow.shape != (len(splats), 3):
        raise expected("flow", f"velocities of {len(splats)} splats", flow.shape)
    return np.asarray(flow @ np.linalg.inv(splats.grid.world_from_index).T)


def _triple(name: str, value: Sequence[float] | np.ndarray) -> np.ndarray:
    numbers = np.asarray(value, dtype=np.float64)
    if numbers.shape != (3,) or not np.isfinite(numbers).all():
        raise expected(name, "three finite numbers (x, y, z)", value)
    return numbers

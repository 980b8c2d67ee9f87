"""`Motion` during the exposure: rigid transforms, flows, and subframes.

Times are in frames: 0 is the current frame, −1 the previous one. With a shutter of 180° the exposure lasts
from −½ to 0, and a moving splat is blurred along that part of its path.  [M98 §5]
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from splatgl.coercion import public
from splatgl.data.image import Image
from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.geometry.camera import Camera, cross_matrix
from splatgl.geometry.view import eye_from_index
from splatgl.splat.settings import FULL_SHUTTER, Settings
from splatgl.splat.splats import Splats, as_points

# a splat nearer to the eye's plane than this, in mean spacings, has no projection
NEAREST = 1e-2
# shaders: kernels nearer to the eye's plane than AHEAD of their reaches are drawn still; beyond FAR reaches all rays
# that meet a kernel are parallel within 7 %
AHEAD, FAR = 1.1, 16.0


@public
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
        """Camera relative to the volume at time `at`; camera: of the frame.

        It includes the volume's motion: with the light at the eye, a rotating volume and an orbiting camera
        give the same pictures.
        """
        if at == 0 or not (self.camera or self.spin.any() or self.velocity.any()):
            return camera
        place = RigidTransform(camera.eye_from_world, camera.eye_from_world @ -camera.eye)
        extent = camera.extent
        if self.camera is not None:
            # eye_from_world at that time, by the screw from the previous camera
            before = RigidTransform(self.camera.eye_from_world, self.camera.eye_from_world @ -self.camera.eye)
            place = before.after(place.inverse()).part(-at).after(place)
            extent = camera.extent * (self.camera.extent / camera.extent) ** -at
        volume = RigidTransform.about(np.radians(self.spin) * at, self.center)
        place = place.after(RigidTransform(volume.rotation, volume.shift + self.velocity * at))
        return replace(camera, eye=-place.rotation.T @ place.shift, eye_from_world=place.rotation, extent=extent)

    def move(self, splats: Splats, at: float) -> Splats:
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
        frames = shutter / FULL_SHUTTER
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


def streaks(splats: Splats, camera: Camera, motion: Motion, shutter: float) -> Streaks:
    """Paths of splats during an exposure of a shutter angle that ends at the frame's time.

    Streaks are straight approximations of curved paths: parallel to the chord from start to end, centred on the
    mean position. A splat that crosses the eye's plane gets the tangent in the middle.
    """
    length = shutter / FULL_SHUTTER
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
    """Offsets from the paths' middles in time to their mean positions, and from their starts to their ends; [2, N].

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
    """Positions [3, N] at time `at`, in the axes of the camera `view`, mean spacings; x, y scaled to `extent`."""
    grid = splats.grid
    offset = splats.positions.astype(np.float64) - grid.index_from_world(view.eye)
    if flow is not None:
        offset += at * _in_cells(splats, flow)
    points = eye_from_index(grid, view) @ offset.T
    points[:2] *= extent / view.extent
    return np.asarray(points)


def _in_cells(splats: Splats, flow: np.ndarray) -> np.ndarray:
    """World velocities [N, 3] of all splats in grid steps. InputError for another number of splats, and for hollow
    ones, whose interior they might open.
    """
    if splats.skipped_interior:
        raise expected("flow", "all splats", "those without hidden interiors", 'extract with classification="post"')
    if flow.shape != (len(splats), 3):
        raise expected("flow", f"velocities of {len(splats)} splats", flow.shape)
    return np.asarray(flow @ np.linalg.inv(splats.grid.world_from_index).T)


def _triple(name: str, value: Sequence[float] | np.ndarray) -> np.ndarray:
    numbers = np.asarray(value, dtype=np.float64)
    if numbers.shape != (3,) or not np.isfinite(numbers).all():
        raise expected(name, "three finite numbers (x, y, z)", value)
    return numbers


# a draw function of splats, camera and settings: Renderer.render, which also takes a motion, or reference.render
Draw = Callable[..., Image]


# maximum motion of visible splats between two moments, pixels: a footprint is three wide
STEP = 1.5
# maximum number of moments, and of splats whose paths are sampled
MOST, PROBED = 64, 4096
# fraction of the paths that must stay within STEP
KEPT = 0.99


class Supersampling:
    """Temporal supersampling of any `Draw`; itself a `Draw`. blurred: each image has motion blur over its part of the
    exposure, and `draw` takes a motion, too: curved paths become polygons, and occlusion follows the order at each
    time.
    """

    def __init__(
        self, draw: Draw, motion: Motion, shutter: float = 180.0, count: int = 256, blurred: bool = False
    ) -> None:
        if count < 1:
            raise expected("count", "at least one moment", count)
        self.draw, self.motion, self.count, self.blurred = draw, motion, count, blurred
        self.exposure = shutter / FULL_SHUTTER

    def __call__(self, splats: Splats, camera: Camera, settings: Settings) -> Image:
        """The mean of the moments' images, with the last image's info. If all have error bounds, their mean is the
        bound of the mean image.
        """
        total: np.ndarray | None = None
        bounds: list[float] = []
        for part in range(self.count):
            image = self._part(splats, camera, settings, part)
            pixels = image.pixels.astype(np.float64)
            total = pixels if total is None else total + pixels
            bound = image.info.get("error_bound")
            bounds += [bound] if isinstance(bound, float) else []
        assert total is not None
        mean = total / self.count
        info = {**image.info, "moments": self.count, "shutter": self.exposure * FULL_SHUTTER}
        if "error_bound" in info:
            error = sum(bounds) / self.count if len(bounds) == self.count else None
            allowed = settings.tolerance * max(settings.brightest(mean), 1e-30)
            info |= {"error_bound": error, "tolerance_met": None if error is None else error <= allowed}
        return Image(mean, info)

    def _part(self, splats: Splats, camera: Camera, settings: Settings, part: int) -> Image:
        """The image at the middle of a part of the exposure, or blurred over the part."""
        flow = self.motion.flow
        first, middle, last = (-self.exposure * (part + side) / self.count for side in (1, 0.5, 0))
        at = last if self.blurred else middle
        # scenes, which have no flow, stay as they are
        moved, view = splats if flow is None else self.motion.move(splats, at), self.motion.view(camera, at)
        if not self.blurred:
            return self.draw(moved, view, settings)
        # treated as a separate frame with the shutter always open; its camera includes the volume's motion
        blur = Motion(camera=self.motion.view(camera, first), flow=None if flow is None else flow * (last - first))
        return self.draw(moved, view, settings.replace(shutter=FULL_SHUTTER), blur)


def count_moments(splats: Splats, camera: Camera, motion: Motion, shutter: float) -> int:
    """Number of subframes for which footprints hide the steps: at most STEP pixels for the fastest visible splats; 1 if
    nothing visible moves.
    """
    stride = max(len(splats) // PROBED, 1)
    flow = None if motion.flow is None else motion.flow[::stride]
    paths = streaks(replace(splats, records=splats.records[::stride]), camera, replace(motion, flow=flow), shutter)
    spacing = splats.grid.mean_spacing
    # splats within the image at any time on their paths
    depth = np.where(paths.middle[2] > 0, paths.middle[2], np.inf) if camera.perspective else 1 / spacing
    middle, half_step = np.abs(paths.middle[:2] / depth), np.abs(paths.step / depth) / 2
    edge = np.array([[camera.size[0] / camera.size[1]], [1.0]]) * paths.camera.extent / 2
    visible = (middle <= edge + half_step).all(axis=0) & (paths.middle[2] > 0)
    if not visible.any():
        return 1
    longest = float(np.quantile(paths.pixels(spacing)[visible], KEPT))
    return min(int(np.ceil(longest / STEP)) + 1, MOST)


# angles below this, in radians, use Taylor series
SMALL = 1e-4


@dataclass(frozen=True, eq=False)
class RigidTransform:
    """x → rotation @ x + shift."""

    rotation: np.ndarray
    shift: np.ndarray

    @classmethod
    def about(cls, turn: np.ndarray, center: np.ndarray) -> RigidTransform:
        """A turn by |turn| radians about the axis `turn` through `center`, counter-clockwise seen from its tip."""
        q = rotation(turn)
        return cls(q, center - q @ center)

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Points [..., 3] moved."""
        return np.asarray(points @ self.rotation.T + self.shift)

    def after(self, first: RigidTransform) -> RigidTransform:
        """The composition: `first`, then this motion."""
        return RigidTransform(self.rotation @ first.rotation, self.rotation @ first.shift + self.shift)

    def inverse(self) -> RigidTransform:
        """The inverse motion."""
        return RigidTransform(self.rotation.T, -self.rotation.T @ self.shift)

    def part(self, share: float) -> RigidTransform:
        """A fraction of the motion, as a screw about and along one axis at constant speed.

        0 is the identity, 1 this motion. Half a turn or more goes the shorter way.
        """
        turn = rotation_vector(self.rotation)
        pace = np.linalg.solve(_swept_matrix(turn), self.shift)
        return RigidTransform(rotation(share * turn), _swept_matrix(share * turn) @ (share * pace))


def rotation(turn: np.ndarray) -> np.ndarray:
    """[3, 3]: the rotation by |turn| radians about `turn` (Rodrigues' formula)."""
    first, second, _ = _weights(turn)
    k = cross_matrix(turn)
    return np.asarray(np.eye(3) + first * k + second * k @ k)


def rotation_vector(matrix: np.ndarray) -> np.ndarray:
    """[3]: the axis times the angle in radians, at most π, of a rotation [3, 3]."""
    skew = np.array([matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]]) / 2
    sine, cosine = float(np.linalg.norm(skew)), (float(np.trace(matrix)) - 1) / 2
    angle = float(np.arctan2(sine, cosine))
    if cosine > -0.5:
        return np.asarray(skew * (angle / sine if sine > 0 else 1.0))
    # near half a turn the axis follows from the symmetric part: Q + Qᵀ = 2 cos·1 + 2 (1 − cos) n nᵀ
    squares = (matrix + matrix.T) / 2 - cosine * np.eye(3)
    axis = squares[:, int(np.argmax(np.diag(squares)))]
    axis = axis / np.linalg.norm(axis)
    return np.asarray(axis * angle * (-1.0 if axis @ skew < 0 else 1.0))


def _swept_matrix(turn: np.ndarray) -> np.ndarray:
    """∫₀¹ rotation(s turn) ds: the displacement at unit velocity in a rotating frame."""
    _, second, third = _weights(turn)
    k = cross_matrix(turn)
    return np.asarray(np.eye(3) + second * k + third * k @ k)


def _weights(turn: np.ndarray) -> tuple[float, float, float]:
    """Returns sin θ/θ, (1 − cos θ)/θ² and (θ − sin θ)/θ³, θ = |turn|."""
    angle = float(np.linalg.norm(turn))
    if angle < SMALL:
        return 1 - angle**2 / 6, 0.5 - angle**2 / 24, 1 / 6 - angle**2 / 120
    # (1 − cos θ)/θ² from the half angle, without cancellation
    return np.sin(angle) / angle, 2 * (np.sin(angle / 2) / angle) ** 2, (angle - np.sin(angle)) / angle**3

"""Camera tracks of an animation: a rotating volume, or keyframes.

    ease = "smooth"                 # or "linear"
    path = "straight"               # or "orbit"
    [[keyframe]]
    frame = 0
    azimuth = 0                     # any number of a scene's [camera]: azimuth, elevation, zoom, fov,
    elevation = 20                  # eye, look_at, up, height
    [[keyframe]]
    frame = 120
    azimuth = 360

Each key is interpolated independently between its keyframes, and constant before and after them; along an orbit, eye,
look_at and up are joined to a rotation about look_at and a distance from it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from splatgl.data.volume import Volume
from splatgl.errors import InputError, expected
from splatgl.fileio import load_table
from splatgl.geometry.camera import Bounded, Camera, cross_matrix, quaternion_of
from splatgl.options import checked, declared, names_of
from splatgl.scene.view import ViewOptions
from splatgl.splat.motion import Motion

EASES, PATHS = ("smooth", "linear"), ("straight", "orbit")
# camera keys that are not interpolated
FIXED = ("size", "orthographic", "view", "width", "fit")
# keys interpolated geometrically
RATIOS = ("zoom", "height", "distance")
# keys that turn a camera which is fitted to its subject
TURNING = ("azimuth", "elevation", "up")
# keys that an orbit joins
ORBIT = ("eye", "look_at", "up")
# slices along the axis, and points around it, that approximate the swept volume
SLICES, AROUND = 32, 48
# cameras that are kept: those of two frames, and the next
LATEST = 3


class CameraTrack(Protocol):
    """The cameras of an animation."""

    def camera(self, frame: float) -> Camera:
        """The camera of a frame, including the volume's own motion."""
        ...

    def motion(self, frame: int) -> Motion:
        """Camera motion from the previous frame to this one."""
        ...


@dataclass(frozen=True)
class TurntableTrack:
    """A volume that rotates by `motion.spin` per frame; `base` is the camera of frame 0."""

    base: Camera
    turn: Motion

    def camera(self, frame: float) -> Camera:
        """The base camera relative to the volume after `frame` frames of rotation; fractions count."""
        return self.turn.view(self.base, float(frame))

    def motion(self, frame: int) -> Motion:
        """The rotation per frame, the same for every frame."""
        return self.turn


@dataclass(frozen=True)
class Keyframes:
    """Interpolated views. keys: name → frames [K] ascending and values [K, n]; of an orbit, distance [K, 1] and
    rotation [K, 4], unit quaternions, in place of eye and up.
    """

    keys: Mapping[str, tuple[np.ndarray, np.ndarray]]
    smooth: bool
    view: ViewOptions
    volume: Volume
    subject: Bounded
    latest: dict[float, Camera] = field(default_factory=dict, init=False, repr=False, compare=False)

    def camera(self, frame: float) -> Camera:
        """The camera at `frame`, interpolated between keyframes; RATIOS are interpolated logarithmically."""
        if frame not in self.latest:
            self.latest[frame] = self._camera(frame)
            # a frame's motion starts from the one before it
            while len(self.latest) > LATEST:
                del self.latest[next(iter(self.latest))]
        return self.latest[frame]

    def _camera(self, frame: float) -> Camera:
        values: dict[str, Any] = {}
        for name, (frames, points) in self.keys.items():
            logs = np.log(points) if name in RATIOS else points
            at = between(frames, logs, float(frame), self.smooth)
            at = np.exp(at) if name in RATIOS else at
            values[name] = float(at[0]) if len(at) == 1 else tuple(at.tolist())
        if "rotation" in values:
            axes = _axes_of(np.array(values.pop("rotation")))
            eye, up = np.array(values["look_at"]) - values.pop("distance") * axes[2], -axes[1]
            values |= {"eye": tuple(eye.tolist()), "up": tuple(up.tolist())}
        return self.view.changed(**values).camera(self.volume, self.subject)

    def motion(self, frame: int) -> Motion:
        """The motion from the previous frame's camera; none in frame 0."""
        return Motion(camera=self.camera(frame - 1)) if frame > 0 else Motion()

    @property
    def last(self) -> int:
        """Number of the last keyframe."""
        return int(max(frames[-1] for frames, _ in self.keys.values()))


def turning(
    view: ViewOptions, volume: Volume, subject: Bounded, degrees: float, axis: np.ndarray | None = None
) -> TurntableTrack:
    """A rotation by `degrees` per frame about the volume's centre, counter-clockwise seen from `axis`' tip (up)."""
    up = axis if axis is not None else np.array(view.upward(volume.hints), dtype=np.float64)
    length = float(np.linalg.norm(up))
    if not 0 < length < np.inf:
        raise expected("axis", "a direction", up.tolist())
    subject = view.framed(volume, subject)
    swept = RotationHull.of(subject, up / length) if degrees else subject
    center = (subject.corners.min(axis=0) + subject.corners.max(axis=0)) / 2
    return TurntableTrack(view.camera(volume, swept), Motion(spin=up / length * degrees, center=center))


def keyframes(source: str | Mapping[str, Any], view: ViewOptions, volume: Volume, subject: Bounded) -> Keyframes:
    """The track in a TOML file, or in its table. Raises InputError for an invalid one."""
    path, table = (source, load_table(Path(source), "keyframes")) if isinstance(source, str) else ("keyframes", source)
    unknown = set(table) - {"ease", "path", "keyframe"}
    if unknown:
        raise expected(path, "keys ease, path, keyframe", ", ".join(sorted(unknown)))
    ease, shape, rows = table.get("ease", EASES[0]), table.get("path", PATHS[0]), table.get("keyframe", [])
    for name, value, known in (("ease", ease, EASES), ("path", shape, PATHS)):
        if value not in known:
            raise expected(f"{path}: {name}", " or ".join(known), repr(value)[:80])
    if not isinstance(rows, list | tuple) or not rows or not all(isinstance(row, Mapping) for row in rows):
        raise expected(path, "at least one [[keyframe]]", repr(rows)[:80])
    places: dict[str, list[tuple[int, Any]]] = {}
    for number, row in enumerate(rows):
        what = f"{path}: keyframe {number + 1}"
        frame = row.get("frame")
        if not isinstance(frame, int) or isinstance(frame, bool) or frame < 0:
            raise expected(what, "frame, a whole number of at least 0", repr(frame)[:80])
        for name, value in _row(what, row).items():
            if places.setdefault(name, [])[-1:] and places[name][-1][0] >= frame:
                raise expected(what, f"a frame after {places[name][-1][0]}", frame, "put keyframes in order")
            places[name].append((frame, value))
    if not places:
        raise expected(path, "keyframes that say where the camera is", "none")
    keys = {n: (np.array([f for f, _ in p], float), np.array([v for _, v in p])) for n, p in places.items()}
    keys = _joined(path, keys) if shape == "orbit" else keys
    up, subject = np.array(view.upward(volume.hints), dtype=np.float64), view.framed(volume, subject)
    if any(np.ptp(keys[name][1], axis=0).any() for name in TURNING if name in keys):
        subject = RotationHull.of(subject, up / np.linalg.norm(up))
    track = Keyframes(keys, ease == "smooth", view, volume, subject)
    _check(path, track)
    return track


def _row(what: str, row: Mapping[str, Any]) -> dict[str, list[float]]:
    """The keys of one keyframe, each a list of numbers."""
    known = sorted(set(names_of(ViewOptions)) - set(FIXED))
    unknown = set(row) - set(known) - {"frame"}
    if unknown:
        raise expected(what, f"keys frame, {', '.join(known)}", ", ".join(sorted(unknown)))
    values = {}
    for name in set(row) - {"frame"}:
        value = checked(declared(ViewOptions)[name].kind, f"{what}: {name}", row[name])
        values[name] = list(value) if isinstance(value, tuple) else [value]
        if name in RATIOS and values[name][0] <= 0:
            raise expected(f"{what}: {name}", "a positive number", value)
    return values


def _joined(path: str, keys: dict[str, tuple[np.ndarray, np.ndarray]]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """The keys of an orbit. Raises InputError unless eye, look_at and up are in the same keyframes."""
    frames = [keys[name][0].tolist() if name in keys else [] for name in ORBIT]
    if not frames[0] == frames[1] == frames[2]:
        raise expected(f"{path}: path orbit", "eye, look_at and up together", "some without the others")
    eyes, targets, ups = (keys[name][1].astype(np.float64) for name in ORBIT)
    distance = np.linalg.norm(targets - eyes, axis=1, keepdims=True)
    across = np.cross(targets - eyes, ups)
    width = np.linalg.norm(across, axis=1, keepdims=True)
    if not (distance > 0).all() or not (width > 0).all():
        raise expected(f"{path}: path orbit", "eyes away from look_at, and up across", "the same point or direction")
    forward, right = (targets - eyes) / distance, across / width
    turns = [quaternion_of(np.array(axes)) for axes in zip(right, np.cross(forward, right), forward, strict=True)]
    for number in range(1, len(turns)):
        # the nearer of both quaternions of a rotation
        turns[number] *= 1.0 if float(turns[number - 1] @ turns[number]) >= 0 else -1.0
    at, rest = keys["eye"][0], {name: value for name, value in keys.items() if name not in ORBIT}
    return {**rest, "look_at": (at, targets), "distance": (at, distance), "rotation": (at, np.array(turns))}


def _axes_of(quaternion: np.ndarray) -> np.ndarray:
    """The rotation [3, 3] of a quaternion (x, y, z, w) of any length."""
    *vector, w = quaternion / np.linalg.norm(quaternion)
    cross = cross_matrix(vector)
    return np.asarray(np.eye(3) + 2 * w * cross + 2 * cross @ cross)


def _check(path: str, track: Keyframes) -> None:
    """Checks that every frame has a valid camera, before the first is rendered."""
    for frame in range(track.last + 1):
        try:
            track.camera(frame)
        except InputError as error:
            raise InputError(f"{path}: frame {frame}: {error}") from error


def between(frames: np.ndarray, points: np.ndarray, at: float, smooth: bool) -> np.ndarray:
    """Interpolates points [K, n] at ascending frames [K]: linearly, or by Catmull–Rom cubics, whose slope at each point
    is that of its neighbours' chord. Constant beyond the ends.
    """
    at = float(np.clip(at, frames[0], frames[-1]))
    k = int(np.clip(np.searchsorted(frames, at, "right") - 1, 0, max(len(frames) - 2, 0)))
    if len(frames) == 1:
        return np.asarray(points[0], dtype=np.float64)
    step = frames[k + 1] - frames[k]
    t = (at - frames[k]) / step
    rise = points[k + 1] - points[k]
    if not smooth:
        return np.asarray(points[k] + t * rise)
    slopes = []
    for i in (k, k + 1):
        low, high = max(i - 1, 0), min(i + 1, len(frames) - 1)
        slopes.append((points[high] - points[low]) / (frames[high] - frames[low]) * step)
    bend, twist = 3 * rise - 2 * slopes[0] - slopes[1], slopes[0] + slopes[1] - 2 * rise
    return np.asarray(points[k] + t * (slopes[0] + t * (bend + t * twist)))


@dataclass(frozen=True, eq=False)
class RotationHull:
    """Hull of a subject rotated about its middle: a camera fitted to it keeps its distance during the rotation."""

    corners: np.ndarray
    outline: np.ndarray
    frame: str | None = None

    @classmethod
    def of(cls, subject: Bounded, axis: np.ndarray) -> RotationHull:
        """axis: unit vector."""
        center = (subject.corners.min(axis=0) + subject.corners.max(axis=0)) / 2
        local = subject.outline - center
        height = local @ axis
        out = np.linalg.norm(local - height[:, None] * axis, axis=1)
        # the farthest point of each slice, at both of the slice's ends
        edges = np.linspace(height.min(), height.max(), SLICES + 1)
        slice_ = np.clip(np.searchsorted(edges, height, "right") - 1, 0, SLICES - 1)
        furthest = np.zeros(SLICES)
        np.maximum.at(furthest, slice_, out)
        side = np.eye(3)[int(np.argmin(np.abs(axis)))]
        first = np.cross(axis, side)
        first /= np.linalg.norm(first)
        angle = np.arange(AROUND) / AROUND * 2 * np.pi
        ring = np.outer(np.cos(angle), first) + np.outer(np.sin(angle), np.cross(axis, first))
        radii, heights = np.repeat(furthest, 2), np.stack([edges[:-1], edges[1:]], axis=1).ravel()
        points = center + radii[:, None, None] * ring + heights[:, None, None] * axis
        return cls(subject.corners, points.reshape(-1, 3), getattr(subject, "frame", None))

"""Camera tracks of an animation: a rotating volume, or keyframes.

    ease = "smooth"                 # or "linear"
    [[keyframe]]
    frame = 0
    azimuth = 0                     # any number of a scene's [camera]: azimuth, elevation, zoom, fov,
    elevation = 20                  # eye, look_at, up, height
    [[keyframe]]
    frame = 120
    azimuth = 360

Each key is interpolated independently between its keyframes, and constant before and after them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from splatgl.data.volume import Volume
from splatgl.errors import InputError, expected
from splatgl.fileio import load_table
from splatgl.options import checked, declared, names_of
from splatgl.scene.view import ViewOptions
from splatgl.splat.camera import Bounded, Camera
from splatgl.splat.motion import Motion

EASES = ("smooth", "linear")
# camera keys that are not interpolated
FIXED = ("size", "orthographic")
# keys interpolated geometrically
RATIOS = ("zoom", "height")
# slices along the axis, and points around it, that approximate the swept volume
SLICES, AROUND = 32, 48


class Track(Protocol):
    """The cameras of an animation."""

    def camera(self, frame: float) -> Camera:
        """The camera of a frame, including the volume's own motion."""
        ...

    def motion(self, frame: int) -> Motion:
        """Camera motion from the previous frame to this one."""
        ...


@dataclass(frozen=True)
class Turning:
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
    """Interpolated views. keys: name → frames [K] ascending and values [K, 1 or 3]."""

    keys: Mapping[str, tuple[np.ndarray, np.ndarray]]
    smooth: bool
    view: ViewOptions
    volume: Volume
    subject: Bounded

    def camera(self, frame: float) -> Camera:
        """The camera at `frame`, interpolated between keyframes; RATIOS are interpolated logarithmically."""
        values: dict[str, Any] = {}
        for name, (frames, points) in self.keys.items():
            logs = np.log(points) if name in RATIOS else points
            at = between(frames, logs, float(frame), self.smooth)
            at = np.exp(at) if name in RATIOS else at
            values[name] = tuple(at.tolist()) if len(at) == 3 else float(at[0])
        return replace(self.view, **values).camera(self.volume, self.subject)

    def motion(self, frame: int) -> Motion:
        """The motion from the previous frame's camera; none in frame 0."""
        return Motion(camera=self.camera(frame - 1)) if frame > 0 else Motion()

    @property
    def last(self) -> int:
        """Number of the last keyframe."""
        return int(max(frames[-1] for frames, _ in self.keys.values()))


def turning(
    view: ViewOptions, volume: Volume, subject: Bounded, degrees: float, axis: np.ndarray | None = None
) -> Turning:
    """A rotation by `degrees` per frame about the volume's centre, counter-clockwise seen from `axis`' tip (up)."""
    up = axis if axis is not None else np.array(view.up or volume.hints.up or (0.0, 0.0, 1.0), dtype=np.float64)
    length = float(np.linalg.norm(up))
    if not 0 < length < np.inf:
        raise expected("axis", "a direction", up.tolist())
    swept = Swept.of(subject, up / length) if degrees else subject
    center = (subject.corners.min(axis=0) + subject.corners.max(axis=0)) / 2
    return Turning(view.camera(volume, swept), Motion(spin=up / length * degrees, center=center))


def keyframes(path: Path, view: ViewOptions, volume: Volume, subject: Bounded) -> Keyframes:
    """The track in a TOML file. Raises InputError for an invalid file."""
    table = load_table(path, "keyframes")
    unknown = set(table) - {"ease", "keyframe"}
    if unknown:
        raise expected(path, "keys ease, keyframe", ", ".join(sorted(unknown)))
    ease, rows = table.get("ease", EASES[0]), table.get("keyframe", [])
    if ease not in EASES:
        raise expected(f"{path}: ease", " or ".join(EASES), repr(ease)[:80])
    if not isinstance(rows, list) or not rows or not all(isinstance(row, dict) for row in rows):
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
    up = np.array(view.up or volume.hints.up or (0.0, 0.0, 1.0), dtype=np.float64)
    swept = Swept.of(subject, up / np.linalg.norm(up))
    track = Keyframes(keys, ease == "smooth", view, volume, swept)
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


def _check(path: Path, track: Keyframes) -> None:
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
class Swept:
    """Hull of a subject rotated about its middle: a camera fitted to it keeps its distance during the rotation."""

    corners: np.ndarray
    outline: np.ndarray
    frame: str | None = None

    @classmethod
    def of(cls, subject: Bounded, axis: np.ndarray) -> Swept:
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

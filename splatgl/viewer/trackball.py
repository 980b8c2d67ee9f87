"""Tools of the mouse: their events, and drags that turn, move and zoom the camera.

Cursor positions are in image pixels, (0, 0) at the upper left corner.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, Protocol

import numpy as np

from splatgl.data.volume import Triple
from splatgl.geometry.camera import Camera, cross_matrix
from splatgl.scene.view import ViewOptions

if TYPE_CHECKING:
    from splatgl.viewer.document import Document
    from splatgl.viewer.state import State


# pixels, (0, 0) at the upper left corner
Place = tuple[float, float]
MouseEvent = Literal["press", "move", "release", "wheel"]


# width of the panel, the least of the picture beside it, and that of windows in which the panel is open at first, at a
# content scale of 1
PANEL, BESIDE, ROOMY = 330.0, 310.0, 800.0


def docked_width(window: tuple[int, int], scale: float) -> int:
    """Pixels of the docked panel; 0 in narrow windows, where the panel covers the picture."""
    return round(PANEL * scale) if window[0] >= (PANEL + BESIDE) * scale else 0


def fits_panel(window: tuple[int, int], scale: float) -> bool:
    """Whether a window opens with its panel; in narrower ones the panel is opened when it is wanted."""
    return window[0] >= ROOMY * scale


@dataclass(frozen=True)
class Viewport:
    """The part of the window next to its docked panel. size: pixels, at least 1; scale: of its text; time: monotonic,
    in seconds.
    """

    size: tuple[int, int]
    scale: float = 1.0
    time: float = 0.0


@dataclass(frozen=True)
class Pointer:
    """A mouse event. button: "left", "middle" or "right" where one is pressed or released; modifiers: keys that are
    down; notches: of the wheel, upwards positive.
    """

    place: Place
    button: str = ""
    modifiers: tuple[str, ...] = ()
    notches: float = 0.0


class Tool(Protocol):
    """Handles mouse events. Each method returns the new state, or None to leave the event to the next tool."""

    def press(self, state: State, document: Document, view: Viewport, pointer: Pointer) -> State | None:
        """A button is pressed."""
        return None

    def move(self, state: State, document: Document, view: Viewport, pointer: Pointer) -> State | None:
        """The cursor moves."""
        return None

    def release(self, state: State, document: Document, view: Viewport, pointer: Pointer) -> State | None:
        """A button is released; every tool gets this event, whatever the others return."""
        return None

    def wheel(self, state: State, document: Document, view: Viewport, pointer: Pointer) -> State | None:
        """The wheel turns."""
        return None


# maximum seconds and pixels between the presses of a double click
DOUBLE, APART = 0.35, 5.0


@dataclass(frozen=True, eq=False)
class Drag:
    """A drag: its operation and its start. up: of a turntable, world; None: of a trackball."""

    kind: str
    start: Place
    pose: Pose
    up: np.ndarray | None = None

    def to(self, place: Place) -> Pose:
        """The pose for a cursor position; depends only on it and the start, not on the path."""
        if self.kind == "rotate" and self.up is not None:
            return self.pose.swept(self.start, place, self.up)
        if self.kind == "rotate":
            return self.pose.rotated(self.start, place)
        if self.kind == "roll":
            return self.pose.rolled(self.start, place)
        if self.kind == "pan":
            return self.pose.panned(self.start, place)
        return self.pose.zoomed(self.start, DRAG ** (self.start[1] - place[1]))


@dataclass(frozen=True, eq=False)
class Mouse:
    """The current drag, if any, and the time and position of the last press."""

    drag: Drag | None = None
    pressed: tuple[float, Place] = (-1e9, (0.0, 0.0))

    def press(self, button: str, modifiers: Collection[str], place: Place, pose: Pose, now: float) -> Mouse:
        """State after a button press; with several buttons down, the first one keeps the drag."""
        kind = {"left": "rotate", "middle": "pan", "right": "zoom"}.get(button)
        if button == "left" and "shift" in modifiers:
            kind = "pan"
        elif button == "left" and "ctrl" in modifiers:
            kind = "roll"
        if kind is None or self.drag is not None:
            return self
        return Mouse(Drag(kind, place, pose), (now, place) if button == "left" else self.pressed)

    def doubles(self, button: str, place: Place, now: float) -> bool:
        """Whether a press now completes a double click."""
        when, where = self.pressed
        near = abs(place[0] - where[0]) < APART and abs(place[1] - where[1]) < APART
        return button == "left" and now - when < DOUBLE and near

    def release(self) -> Mouse:
        """State after a button release: no drag; the last press is kept for double clicks."""
        return Mouse(None, self.pressed)


def zoom_by_wheel(pose: Pose, place: Place, notches: float) -> Pose:
    """The pose after wheel rotation by `notches`; upwards zooms in."""
    return pose.zoomed(place, NOTCH**notches)


def up_direction(document: Document) -> np.ndarray:
    """The scene's up direction."""
    up = np.asarray(document.scene.view.upward(document.volume.hints), dtype=np.float64)
    return np.asarray(up / np.linalg.norm(up))


# minimum pivot depth as a fraction of the scene's radius, so that zooming can pass through the pivot
NEAREST = 0.05
# minimum distance of an orthographic eye in scene radii: matter behind the eye plane is not drawn
STAND_OFF = 2.0
# height of a picture, of that of the points that it is fitted to
FILL = 1.2
# trackball radius, in halves of the image's shorter side
BALL = 0.9
# degrees of a turntable per shorter side of the image, and its highest elevation
SWEEP, POLE = 180.0, 89.9
# zoom factor per notch of the wheel, and per pixel of an upward drag
NOTCH, DRAG = 0.85, 0.994
# bounds of the visible extent, in scene radii
CLOSEST, FARTHEST = 1e-4, 1e3


@dataclass(frozen=True, eq=False)
class Pose:
    """camera; pivot [3], world; fov, degrees, kept while the view is orthographic; reach, the scene's radius."""

    camera: Camera
    pivot: np.ndarray
    fov: float
    reach: float

    @property
    def depth(self) -> float:
        """Depth of the pivot, world units, at least NEAREST × the scene's radius."""
        return max(float(self.camera.eye_from_points(self.pivot)[2]), NEAREST * self.reach)

    @property
    def pitch(self) -> float:
        """World size of a pixel at the pivot."""
        return float(self.camera.pixel_pitch(self.depth))

    def view(self) -> ViewOptions:
        """The view in scene-file form."""
        camera = self.camera
        target, up = camera.eye + camera.forward * self.depth, -camera.eye_from_world[1]
        placed = ViewOptions(
            camera.size, eye=_triple(camera.eye), look_at=_triple(target), up=_triple(up), fov=self.fov
        )
        return placed if camera.perspective else replace(placed, orthographic=True, height=camera.extent)

    def resized(self, size: tuple[int, int]) -> Pose:
        """The pose for an image of `size` (width, height) in pixels."""
        return replace(self, camera=self.camera.resized(size))

    def about(self, point: np.ndarray) -> Pose:
        """The view with another pivot."""
        return replace(self, pivot=np.asarray(point, dtype=np.float64))

    def fitted(self, corners: np.ndarray) -> Pose:
        """The view in the same direction that shows points [N, 3], and turns about the middle of their box."""
        camera, middle = self.camera, (corners.min(axis=0) + corners.max(axis=0)) / 2
        local = (corners - middle) @ camera.eye_from_world.T
        # half of the height that each point needs at its own depth
        half = FILL * np.abs(local[:, :2] * (camera.size[1] / camera.size[0], 1.0)).max(axis=1)
        if camera.perspective:
            distance = float((2 * half / camera.extent - local[:, 2]).max())
            fitted = replace(camera, eye=middle - camera.forward * distance)
        else:
            eye = middle - camera.forward * self.depth
            fitted = replace(camera, eye=eye, extent=2 * float(half.max()))
        return replace(self, camera=fitted).about(middle)

    def rotated(self, start: Place, stop: Place) -> Pose:
        """Trackball rotation for a cursor move from start to stop."""
        a, b = _on_ball(self.camera.size, start), _on_ball(self.camera.size, stop)
        # rotation by twice the angle from a to b: reversible and independent of the path [Shoemake 1992]
        return self._turned(rotation(np.cross(a, b), 2.0 * float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))))

    def rolled(self, start: Place, stop: Place) -> Pose:
        """Rotation about the line of sight by the angle between two positions, seen from the image centre."""
        middle = np.array(self.camera.size) / 2
        angles = [np.arctan2(*(np.array(place) - middle)[::-1]) for place in (start, stop)]
        return self._turned(rotation(np.array([0.0, 0.0, 1.0]), float(angles[1] - angles[0])))

    def spun(self, degrees: float, up: np.ndarray) -> Pose:
        """Rotation about the world's `up` through the pivot: counter-clockwise seen from above."""
        return self._turned(rotation(self.camera.eye_from_world @ up, float(np.radians(degrees))))

    def lifted(self, degrees: float) -> Pose:
        """Rotation about the picture's horizontal through the pivot: the eye rises."""
        return self._turned(rotation(np.array([1.0, 0.0, 0.0]), float(np.radians(degrees))))

    def tipped(self, degrees: float) -> Pose:
        """Rotation of the picture about the line of sight, clockwise."""
        return self._turned(rotation(np.array([0.0, 0.0, 1.0]), float(np.radians(degrees))))

    def swept(self, start: Place, stop: Place, up: np.ndarray) -> Pose:
        """Turntable rotation for a cursor move: across about `up`, along it up to the poles."""
        across, along = (np.array(stop) - np.array(start)) * SWEEP / min(self.camera.size)
        now = float(np.degrees(np.arcsin(np.clip(-self.camera.forward @ up, -1.0, 1.0))))
        lift = float(np.clip(now + along, -POLE, POLE)) - now
        return self.lifted(lift).spun(-float(across), up)

    def panned(self, start: Place, stop: Place) -> Pose:
        """Translation in the image plane; points at the pivot's depth follow the cursor."""
        step = (np.array(start) - np.array(stop)) * self.pitch
        return self._moved(self.camera.eye + step @ self.camera.eye_from_world[:2])

    def zoomed(self, at: Place, factor: float) -> Pose:
        """Zoom by a factor, closer below 1; the point under the cursor at the pivot's depth stays fixed."""
        camera = self.camera
        shown = camera.extent * (self.depth if camera.perspective else 1.0)
        factor = float(np.clip(factor, CLOSEST * self.reach / shown, FARTHEST * self.reach / shown))
        across = (np.array(at) - np.array(camera.size) / 2) * self.pitch
        if camera.perspective:
            target = camera.eye + np.array([*across, self.depth]) @ camera.eye_from_world
            return self._moved(target + (camera.eye - target) * factor)
        eye = camera.eye + across @ camera.eye_from_world[:2] * (1.0 - factor)
        return replace(self, camera=Camera(eye, camera.eye_from_world, camera.size, camera.extent * factor, False))

    def switched(self) -> Pose:
        """Toggles perspective and orthographic projection; sizes at the pivot's depth are kept."""
        camera, extent = self.camera, 2.0 * float(np.tan(np.radians(self.fov) / 2))
        height = camera.extent * (self.depth if camera.perspective else 1.0)
        depth = max(self.depth, STAND_OFF * self.reach) if camera.perspective else height / extent
        eye = camera.eye + camera.forward * (self.depth - depth)
        shown = height if camera.perspective else extent
        return replace(self, camera=Camera(eye, camera.eye_from_world, camera.size, shown, not camera.perspective))

    def _turned(self, rotation: np.ndarray) -> Pose:
        """Applies a rotation in eye axes to the scene about the pivot."""
        camera = self.camera
        # project onto the nearest rotation, so that rounding errors do not accumulate over thousands of moves
        left, _, right = np.linalg.svd(rotation @ camera.eye_from_world)
        axes = left @ right
        eye = self.pivot - camera.eye_from_points(self.pivot) @ axes
        return replace(self, camera=replace(camera, eye=eye, eye_from_world=axes))

    def _moved(self, eye: np.ndarray) -> Pose:
        return replace(self, camera=replace(self.camera, eye=eye))


def _on_ball(size: tuple[int, int], place: Place) -> np.ndarray:
    """Unit vector in eye axes (forward is away) of the trackball point under the cursor; outside it, of its rim."""
    radius = BALL * min(size) / 2
    x, y = (np.array(place) - np.array(size) / 2) / radius
    square = x * x + y * y
    point = np.array([x, y, -np.sqrt(1.0 - square)]) if square < 1.0 else np.array([x, y, 0.0])
    return np.asarray(point / np.linalg.norm(point))


def rotation(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rotation [3, 3] by an angle in radians about an axis of any length; identity for a zero axis.  [Rodrigues]"""
    length = float(np.linalg.norm(axis))
    if not length > 0.0:
        return np.eye(3)
    cross = cross_matrix(axis / length)
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross)


def _triple(point: np.ndarray) -> Triple:
    return float(point[0]), float(point[1]), float(point[2])


# near depth of lines in perspective, in heights of the picture at depth 1
NEAR = 1e-6


def project(camera: Camera, points: np.ndarray) -> np.ndarray:
    """Pixels [N, 2] of world points [N, 3]; NaN behind a perspective eye."""
    eye = camera.eye_from_points(points)
    depth = np.where(eye[:, 2] > 0, eye[:, 2], np.nan) if camera.perspective else np.ones(len(eye))
    pitch = camera.extent / camera.size[1]
    return np.asarray(eye[:, :2] / (depth * pitch)[:, None] + np.array(camera.size) / 2)


def pixel_ray(camera: Camera, place: Place) -> tuple[np.ndarray, np.ndarray]:
    """Start [3] and unit direction [3], world, of the ray through a position in pixels."""
    across = (np.array(place) - np.array(camera.size) / 2) * camera.extent / camera.size[1]
    if camera.perspective:
        direction = np.array([*across, 1.0]) @ camera.eye_from_world
        return camera.eye, np.asarray(direction / np.linalg.norm(direction))
    return camera.eye + across @ camera.eye_from_world[:2], camera.forward


def project_segment(camera: Camera, start: np.ndarray, stop: np.ndarray) -> tuple[Place, Place] | None:
    """Pixels of the ends of the part of a line in front of the eye; None if there is none."""
    ends = np.array([start, stop], np.float64)
    depth = camera.eye_from_points(ends)[:, 2]
    if camera.perspective:
        least = NEAR * max(float(np.abs(depth).max()), 1e-300)
        if depth.max() <= least:
            return None
        if depth.min() < least:
            behind = int(depth.argmin())
            share = (least - depth[behind]) / (depth[1 - behind] - depth[behind])
            # slightly further, despite rounding
            ends[behind] += (ends[1 - behind] - ends[behind]) * min(1.0, share * (1 + 1e-9) + 1e-12)
    pixels = project(camera, ends)
    if not np.isfinite(pixels).all():
        return None
    return (float(pixels[0, 0]), float(pixels[0, 1])), (float(pixels[1, 0]), float(pixels[1, 1]))


def nearest_on_line(camera: Camera, place: Place, point: np.ndarray, axis: np.ndarray) -> float | None:
    """The t at which point + t · axis (a unit vector) is nearest to the ray through a pixel; None for a line seen end
    on.
    """
    start, direction = pixel_ray(camera, place)
    cosine = float(direction @ axis)
    square = 1.0 - cosine * cosine
    if square < 1e-6:
        return None
    apart = start - point
    return float((apart @ axis - cosine * (apart @ direction)) / square)

"""Handles of the clip box and of clip planes, and scissors that follow a drag."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from splatgl.data.volume import Volume
from splatgl.errors import InputError
from splatgl.geometry.camera import Camera
from splatgl.geometry.clipping import Plane, clip_corners
from splatgl.geometry.scissors import MOST_CORNERS, Scissors
from splatgl.geometry.slices import polygon_around
from splatgl.geometry.view import perpendicular_axes
from splatgl.gl.screen import LineColor, Stroke
from splatgl.scene.meshes import is_mesh
from splatgl.viewer.state import MOST_PLANES, ClipState, Lasso, box_planes
from splatgl.viewer.trackball import Place, Pointer, Tool, Viewport, nearest_on_line, pixel_ray, project

if TYPE_CHECKING:
    from splatgl.viewer.document import Document
    from splatgl.viewer.state import State


TOO_MANY_PLANES = f"there are {MOST_PLANES} planes already: remove one"


def leaves_nothing(planes: Sequence[Plane], document: Document) -> bool:
    """Whether planes clip the whole first volume."""
    return bool(planes) and not len(clip_corners(planes, document.volume.corners))


def set_cuts(state: State, document: Document, cuts: ClipState) -> State:
    """The state with other cuts; cuts that would leave nothing only set a message."""
    if cuts == state.cuts:
        return state
    planes = replace(cuts, active=True).clip(document.volume)
    if leaves_nothing(planes, document):
        return replace(state, message="this would cut everything off")
    clip = planes if cuts.active else ()
    # a scene's own planes stay as they are until they are changed
    same = (cuts.sides, cuts.planes, cuts.active) == (state.cuts.sides, state.cuts.planes, state.cuts.active)
    return replace(state, cuts=cuts, settings=state.settings if same else state.settings.replace(clip=clip))


# largest distance between cursor and handle, pixels at a content scale of 1
NEAR = 12.0
# pixels by which the foot of an arrow is preferred to a tip over it
COVERED = 3.0
# length of a plane's arrow, in the volume's largest side
ARROW = 0.2


@dataclass(frozen=True, eq=False)
class Handle:
    """A dot that moves a cut. point [3]: world; axis [3]: unit vector of its motion. what: "side" of the box, with axis
    and end; "plane" with its number; "tilt", the tip of the plane's arrow.
    """

    what: str
    point: np.ndarray
    axis: np.ndarray
    number: int
    end: int = 0


@dataclass(frozen=True, eq=False)
class HandleDrag:
    """Drag of a handle. start: place of the press; cuts: at that time."""

    handle: Handle
    start: Place
    cuts: ClipState

    def to(self, volume: Volume, camera: Camera, place: Place) -> ClipState:
        """The cuts for a cursor position, whatever the path to it."""
        handle = self.handle
        if handle.what == "tilt":
            return self._tilted(volume, camera, place)
        step = _moved(camera, handle, self.start, place)
        if handle.what == "plane":
            plane = self.cuts.planes[handle.number]
            return self.cuts.with_plane(handle.number, (*plane[:3], plane[3] + step))
        size = volume.shape[2 - handle.number]
        along = np.linalg.norm(volume.world_from_index[:, handle.number]) * size
        share = self.cuts.sides[handle.number][handle.end] + step / float(along)
        # whole voxels
        return self.cuts.with_side(handle.number, handle.end, round(share * size) / size)

    def _tilted(self, volume: Volume, camera: Camera, place: Place) -> ClipState:
        """The cuts with the tip of the arrow under the cursor, on the same side of the sphere around its foot."""
        plane = self.cuts.planes[self.handle.number]
        foot = plane_middle(self.cuts, volume, self.handle.number)
        normal = direction_on_sphere(
            camera, place, foot, arrow_length(volume), behind=float(np.array(plane[:3]) @ camera.forward) > 0
        )
        return self.cuts.with_plane(self.handle.number, (*normal, float(normal @ foot)))


def handles(cuts: ClipState, volume: Volume) -> list[Handle]:
    """The handles of the box and of all planes."""
    dots = [Handle("side", *_side_middle(cuts, volume, axis, end), axis, end) for axis in range(3) for end in range(2)]
    for number, plane in enumerate(cuts.planes):
        foot, normal = plane_middle(cuts, volume, number), np.array(plane[:3])
        dots.append(Handle("plane", foot, normal, number))
        dots.append(Handle("tilt", foot + arrow_length(volume) * normal, normal, number))
    return dots


def handle_at(dots: list[Handle], camera: Camera, place: Place, scale: float = 1.0) -> Handle | None:
    """The handle nearest to the cursor within NEAR; of an arrow seen end on, its foot."""
    if not dots:
        return None
    distance = np.linalg.norm(project(camera, np.array([dot.point for dot in dots])) - np.array(place), axis=1)
    distance = np.where(np.isfinite(distance), distance, np.inf)
    distance += np.where([dot.what == "tilt" for dot in dots], COVERED * scale, 0.0)
    best = int(distance.argmin())
    return dots[best] if distance[best] <= NEAR * scale else None


def arrow_length(volume: Volume) -> float:
    """World length of a plane's arrow."""
    corners = volume.corners
    return ARROW * float((corners.max(axis=0) - corners.min(axis=0)).max())


def outline(cuts: ClipState, volume: Volume, plane: Plane) -> np.ndarray:
    """The polygon [N, 3] where a plane cuts the box, in order; N = 0 where the plane misses it."""
    normal = np.array(plane[:3])
    both = [plane, (*(-normal).tolist(), -plane[3]), *box_planes(cuts.sides, volume)]
    axes = np.stack(perpendicular_axes(normal))
    return np.asarray(polygon_around(clip_corners(both, volume.corners) @ axes.T) @ axes + plane[3] * normal)


def plane_middle(cuts: ClipState, volume: Volume, number: int) -> np.ndarray:
    """The foot [3] of a plane's arrow: the middle of its polygon, else the point nearest to the middle of the box."""
    plane = cuts.planes[number]
    points = outline(cuts, volume, plane)
    if len(points):
        return np.asarray((points.min(axis=0) + points.max(axis=0)) / 2)
    normal, middle = np.array(plane[:3]), volume.corners.mean(axis=0)
    return np.asarray(middle + (plane[3] - normal @ middle) * normal)


def box_edges(cuts: ClipState, volume: Volume) -> list[tuple[np.ndarray, np.ndarray]]:
    """The twelve edges of the kept box, world."""
    corners = _corners(cuts, volume)
    return [(corners[i], corners[i | 1 << axis]) for axis in range(3) for i in range(8) if not i >> axis & 1]


def direction_on_sphere(camera: Camera, place: Place, middle: np.ndarray, radius: float, behind: bool) -> np.ndarray:
    """Unit vector [3] from the middle of a sphere to its point under a pixel: the far point if `behind`; for pixels
    beside the sphere, the nearest point of its rim.
    """
    start, direction = pixel_ray(camera, place)
    along = float((middle - start) @ direction)
    nearest = start + along * direction - middle
    square = radius**2 - float(nearest @ nearest)
    if square <= 0:
        return np.asarray(nearest / np.linalg.norm(nearest))
    point = nearest + (1 if behind else -1) * np.sqrt(square) * direction
    return np.asarray(point / np.linalg.norm(point))


def _moved(camera: Camera, handle: Handle, start: Place, place: Place) -> float:
    """World length by which a drag moves a handle along its axis."""
    ends = [nearest_on_line(camera, pixel, handle.point, handle.axis) for pixel in (start, place)]
    if ends[0] is not None and ends[1] is not None:
        return ends[1] - ends[0]
    # an axis seen end on: upwards is away from the eye
    depth = float(camera.eye_from_points(handle.point)[2])
    towards = 1.0 if float(handle.axis @ camera.forward) > 0 else -1.0
    return towards * (start[1] - place[1]) * float(camera.pixel_pitch(depth))


def _side_middle(cuts: ClipState, volume: Volume, axis: int, end: int) -> tuple[np.ndarray, np.ndarray]:
    """Middle [3] of a face of the kept box, and the unit vector [3] along the axis of the grid."""
    corners = _corners(cuts, volume)
    along = volume.world_from_index[:, axis]
    face = [corners[i] for i in range(8) if i >> axis & 1 == end]
    return np.mean(face, axis=0), np.asarray(along / np.linalg.norm(along))


def _corners(cuts: ClipState, volume: Volume) -> np.ndarray:
    """Corners [8, 3] of the kept box, world, in the order of `Volume.corners`."""
    corners = volume.corners
    sides = corners[[1, 2, 4]] - corners[0]
    shares = np.array([[cuts.sides[axis][i >> axis & 1] for axis in range(3)] for i in range(8)])
    return np.asarray(corners[0] + shares @ sides)


class ClipTool(Tool):
    """Drags the handles of the clip box and of clip planes."""

    def __init__(self) -> None:
        self.drag: HandleDrag | None = None

    def press(self, state: State, document: Document, view: Viewport, pointer: Pointer) -> State | None:
        """Takes the handle under the cursor."""
        if pointer.button != "left" or pointer.modifiers or not state.cuts.shown or document.is_loading:
            return None
        handle = handle_at(handles(state.cuts, document.volume), state.pose.camera, pointer.place, view.scale)
        self.drag = None if handle is None else HandleDrag(handle, pointer.place, replace(state.cuts, active=True))
        return None if handle is None else state

    def move(self, state: State, document: Document, view: Viewport, pointer: Pointer) -> State | None:
        """Drags the handle; cuts that would remove everything are rejected with a message."""
        if self.drag is None:
            return None
        cuts = self.drag.to(document.volume, state.pose.camera, pointer.place)
        return set_cuts(replace(state, message=""), document, cuts)

    def release(self, state: State, document: Document, view: Viewport, pointer: Pointer) -> State | None:
        """Lets the handle go."""
        self.drag = self.drag if pointer.button != "left" else None
        return None


# distance between two corners of an outline, pixels at a content scale of 1; the line's colour, sRGB, and width
APART, COLOR, LINE = 3.0, (1.0, 0.35, 0.3, 1.0), 2.0
HOW = "draw a lasso around the part to remove", "draw a lasso around the part to keep"
BAD = "draw around a part of the volume, not all of it"
NO_VOLUME = "scissors cut volumes, not meshes"


def start_lasso(keep: bool) -> Callable[[State, Document], State]:
    """A command after which a drag draws an outline, or no longer does. keep: the part inside it."""

    def start(state: State, document: Document) -> State:
        if state.lasso.active and state.lasso.keep == keep:
            return replace(state, lasso=Lasso())
        if all(is_mesh(layer.scene.volume) for layer in document.layers):
            return replace(state, message=NO_VOLUME)
        return replace(state, lasso=Lasso(active=True, keep=keep), message=HOW[keep])

    return start


def cut_along(state: State, document: Document) -> State:
    """The state whose layers are cut along the outline of the lasso; only a message if that leaves nothing."""
    camera, first = state.pose.camera, document.layers[0]
    try:
        outline = np.array(state.lasso.points).reshape(-1, 2) / camera.size
        scissors = Scissors(outline, state.lasso.keep, camera, *document.volume.world)
        # of few voxels, whatever the size of the volume
        replace(first, volumes=first.volumes[-1:]).within(document.world, (*first.scissors, scissors))
    except InputError:
        return replace(state, lasso=replace(state.lasso, points=()), message=BAD)
    styles = tuple(replace(style, scissors=(*style.scissors, scissors)) for style in state.styles)
    return replace(state, styles=styles, lasso=Lasso(), message="cut; ctrl+z brings it back")


def lasso_strokes(lasso: Lasso, scale: float) -> list[Stroke]:
    """The outline that is drawn, pixels."""
    color: LineColor = COLOR
    return [Stroke(*ends, color, LINE * scale) for ends in pairwise(lasso.points)]


class LassoTool(Tool):
    """Draws an outline by a drag, once a command has asked for one."""

    def press(self, state: State, document: Document, view: Viewport, pointer: Pointer) -> State | None:
        """Begins an outline."""
        if not state.lasso.active or pointer.button != "left" or pointer.modifiers or document.is_loading:
            return None
        return replace(state, lasso=replace(state.lasso, points=(pointer.place,)))

    def move(self, state: State, document: Document, view: Viewport, pointer: Pointer) -> State | None:
        """Draws it on."""
        points = state.lasso.points
        if not points:
            return None
        if np.hypot(*np.subtract(pointer.place, points[-1])) < APART * view.scale or len(points) >= MOST_CORNERS:
            return state
        return replace(state, lasso=replace(state.lasso, points=(*points, pointer.place)))

    def release(self, state: State, document: Document, view: Viewport, pointer: Pointer) -> State | None:
        """Cuts along it."""
        return cut_along(state, document) if pointer.button == "left" and state.lasso.points else None

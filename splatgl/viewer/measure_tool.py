"""Value under the cursor, distances between points, and the centre of rotation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from splatgl.annotations.canvas import AnnotatedSubject, Measure
from splatgl.annotations.world_lines import measure_text
from splatgl.errors import InputError
from splatgl.geometry.camera import Camera
from splatgl.geometry.clipping import Clip, Plane
from splatgl.geometry.view import eye_from_index
from splatgl.planning.scene import Scene
from splatgl.reference.depth_pick import Picked, pick
from splatgl.splat.splats import Splats
from splatgl.viewer.adaptive_quality import STRIDES
from splatgl.viewer.document import Document
from splatgl.viewer.jobs import JobKind, Jobs
from splatgl.viewer.segments import value_text
from splatgl.viewer.state import State
from splatgl.viewer.trackball import Place, Pointer, Tool, Viewport

FIRST_POINT = "click on the first point; a drag turns the view"
CORNER, NEXT_POINT = "click on the corner of the angle", "click on the last point"


def under_cursor(state: State, document: Document, place: Place) -> Picked | None:
    """The sample or mesh visible at a pixel; None if there is none, or the volume is not in memory."""
    pixel = (int(np.floor(place[0])), int(np.floor(place[1])))
    width, height = state.pose.camera.size
    if document.is_loading or not (0 <= pixel[0] < width and 0 <= pixel[1] < height):
        return None
    scene = _scene(document, state)
    return None if scene is None else _picked(scene, state, pixel)


def _scene(document: Document, state: State) -> Scene | None:
    """The scene that is picked in; None if planes, as of the file before, leave nothing of it."""
    try:
        return document.scene_at(1, state.settings.clip)
    except InputError:
        return None


def _picked(scene: Scene, state: State, pixel: tuple[int, int]) -> Picked | None:
    try:
        return pick(scene, state.pose.camera, pixel, settings=state.settings.replace(clip=()))
    except InputError:
        return None


class Readout:
    """Value, position and label under the cursor, which a thread picks: one pixel at a time, the latest one next.
    lines, point: the latest text and the world point [3] that it is of, none where nothing is seen.
    """

    def __init__(self, jobs: Jobs) -> None:
        self.jobs = jobs
        self.lines: tuple[str, ...] = ()
        self.point: np.ndarray | None = None
        # what the lines are of, or will be
        self.key: tuple[object, ...] = ()

    def look(self, state: State, document: Document, cursor: Place | None) -> None:
        """Picks what is under the cursor, once for each pixel and picture; None: nothing is."""
        pixel = None if cursor is None else (int(np.floor(cursor[0])), int(np.floor(cursor[1])))
        size = state.pose.camera.size
        if pixel is None or not (0 <= pixel[0] < size[0] and 0 <= pixel[1] < size[1]) or 1 not in document.extracted:
            self.key, self.lines, self.point = (), (), None
            return
        key = pixel, state.pose, state.settings, document
        if key == self.key or self.jobs.busy:
            return
        self.key, scene = key, _scene(document, state)
        if scene is not None:
            self.jobs.submit(JobKind.PICK, "picking", lambda: (key, _picked(scene, state, pixel)))

    def collect(self, document: Document) -> bool:
        """Takes what was picked; whether there was anything."""
        news = self.jobs.collect()
        for done in news:
            if done.error is not None:
                raise done.error
            key, found = done.value
            if key == self.key:
                self.lines = () if found is None else describe_pick(found, document)
                self.point = None if found is None else np.array(found.place)
        return bool(news)


def describe_pick(pick: Picked | None, document: Document) -> tuple[str, ...]:
    """Lines of text with value, position and index."""
    if pick is None:
        return (_nothing(document),)
    unit = document.volume.unit
    # zeros have no sign
    place = ", ".join(f"{number + 0.0:.4g}" for number in pick.place)
    if pick.mesh is not None:
        return (pick.name or "mesh", f"at {place}{' ' + unit if unit else ''}")
    volume = document.drawn_layers[pick.layer].volume
    # the box reaches half a voxel further
    index = np.clip(np.rint(pick.index), 0, np.array(volume.shape[::-1]) - 1).astype(int).tolist()
    style = [style for style in document.styles if style.is_shown][pick.layer]
    name = style.title or (pick.name if len(document.drawn_layers) > 1 else "")
    value = value_text(style, volume, pick.value, index)
    return (
        f"{name or 'value'}: {value}",
        f"at {place}{' ' + unit if unit else ''}",
        f"voxel {', '.join(map(str, index))}",
    )


def _nothing(document: Document) -> str:
    """Returns the message where nothing is picked: clouds of points are seen, but have no values in space."""
    is_cloud = any(layer.volume.points is not None for layer in document.drawn_layers)
    return "points: no value or position here" if is_cloud else "nothing here"


def add_ruler_point(state: State, document: Document, place: Place) -> State:
    """The state with one more point of the ruler, or the measure that it completes."""
    pick = under_cursor(state, document, place)
    if pick is None:
        return replace(state, message=f"{_nothing(document)} to measure from")
    ruler = replace(state.ruler, points=(*state.ruler.points, pick.place))
    if ruler.missing > 0:
        return replace(state, ruler=ruler, message=NEXT_POINT if ruler.missing == 1 or not ruler.angle else CORNER)
    measure = Measure(ruler.points)
    text = f"{'angle' if ruler.angle else 'distance'} {measure_text(measure, AnnotatedSubject.of(document.volume))}"
    state = replace(state, ruler=replace(ruler, points=()), message=text)
    return state.with_measures((*state.measures, measure))


# largest distance of splats from the ray, voxels; the optical depth at which the ray ends
WITHIN = 1.0
ENOUGH = 0.7


def set_pivot(state: State, document: Document, place: tuple[float, float]) -> State:
    """The state with the visible point at a pixel as its centre of rotation, if there is any."""
    if document.is_layered:
        pick = under_cursor(state, document, place)
        point = None if pick is None else np.array(pick.place)
    else:
        point = find_matter(document.layers[0].at(STRIDES[1]), state.pose.camera, place, state.settings.clip)
    if point is None:
        return replace(state, message="nothing here to turn about")
    return replace(state, pose=state.pose.about(point), message="turns about this point")


def find_matter(
    splats: Splats, camera: Camera, place: tuple[float, float], cuts: tuple[Plane, ...] = ()
) -> np.ndarray | None:
    """World point [3] of the volume at a pixel, clipped by planes; None if there is none.

    The point is at optical depth ENOUGH (half of the light is absorbed), or, in fainter matter, at its middle.
    """
    # the ray in the splats' grid, and distances of splats from it, mean spacings
    pitch = camera.extent / camera.size[1]
    across = (np.array(place) - np.array(camera.size) / 2) * pitch
    direction = np.array([*across, 1.0]) if camera.perspective else np.array([0.0, 0.0, 1.0])
    start = np.zeros(3) if camera.perspective else np.array([*across, 0.0])
    scale = splats.grid.mean_spacing
    axes = eye_from_index(splats.grid, camera).astype(np.float32)
    origin = (camera.eye_from_points(splats.grid.origin) - start) / scale
    unit = direction / np.linalg.norm(direction)
    points = splats.positions @ axes.T + origin.astype(np.float32)
    along = points @ unit.astype(np.float32)
    near = np.flatnonzero((along > 0) & ((points * points).sum(axis=1) - along * along < WITHIN**2))
    clip = Clip.of(cuts, splats.grid)
    near = near if clip is None else near[clip.keeps(splats.positions[near])]
    depth = splats.depths_of(near).astype(np.float64)
    if not depth.any():
        return None

    # front to back, accumulating optical depth
    order = np.argsort(along[near])
    near, total = near[order], np.cumsum(depth[order])
    met = near[int(np.searchsorted(total, min(ENOUGH, total[-1] / 2)))]
    return np.asarray((start + unit * float(along[met]) * scale) @ camera.eye_from_world + camera.eye)


# pixels within which a press and its release are a click
CLICK = 4.0


class MeasureTool(Tool):
    """Picks the points of a distance by clicks; drags are left to the other tools."""

    def __init__(self) -> None:
        self.pressed: Place | None = None

    def press(self, state: State, document: Document, view: Viewport, pointer: Pointer) -> State | None:
        """Notes where a click begins."""
        self.pressed = pointer.place if pointer.button == "left" and not pointer.modifiers else None
        return None

    def release(self, state: State, document: Document, view: Viewport, pointer: Pointer) -> State | None:
        """Picks a point, if the cursor was not moved meanwhile."""
        if pointer.button != "left":
            return None
        start, self.pressed = self.pressed, None
        if not state.ruler.active or start is None:
            return None
        (x, y), (u, v) = start, pointer.place
        return add_ruler_point(state, document, pointer.place) if max(abs(x - u), abs(y - v)) < CLICK else None

"""Three linked slices next to the picture, also turned and as planes in it, and their commands."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from splatgl.annotations.canvas import clip_segments
from splatgl.annotations.text import label
from splatgl.annotations.world_lines import letters
from splatgl.data.volume import Volume
from splatgl.errors import InputError
from splatgl.geometry.camera import Camera
from splatgl.geometry.slices import ANATOMY, SlicePainter, SlicePlane, world_axes
from splatgl.gl.screen import LineColor, ScreenMarks, Sprite, Stroke
from splatgl.viewer.jobs import JobKind, Jobs
from splatgl.viewer.segments import value_text
from splatgl.viewer.slice_planes import (
    STRAIGHT,
    Turn,
    layer_looks,
    layer_painter,
    middle,
    normals,
    planes,
    turned,
    with_slices,
    with_turn,
)
from splatgl.viewer.state import Slices
from splatgl.viewer.trackball import Mouse, Place, Pointer, Tool, Viewport, project, project_segment

if TYPE_CHECKING:
    from splatgl.viewer.document import Document
    from splatgl.viewer.state import State


Box = tuple[float, float, float, float]

# share of a window's width that the slices take at most
WIDEST = 0.5
# and that a large one takes
LARGE = 0.62
# pixels around a slice in its pane, in which the letters of directions stand, at a content scale of 1
MARGIN = 18.0


@dataclass(frozen=True, eq=False)
class Pane:
    """A slice in the window. axis: of the grid, that it is of; room: of the pane; box: of the slice; left, top, right,
    bottom, pixels.
    """

    axis: int
    plane: SlicePlane
    room: Box
    box: Box

    def holds(self, place: tuple[float, float]) -> bool:
        """Whether a pixel is inside the pane."""
        return self.room[0] <= place[0] < self.room[2] and self.room[1] <= place[1] < self.room[3]

    @property
    def pitch(self) -> float:
        """Side of a pixel, world units."""
        low, high = self.plane.box
        return float((high[0] - low[0]) / (self.box[2] - self.box[0]))

    def pixels(self, painter: SlicePainter) -> np.ndarray:
        """Pixels uint8 [H, W, 4] of the slice, clear outside the volumes: the voxels of the only layer, at most about
        two per pixel along each side, if the plane contains their middles; else the window's pixels.
        """
        low, high = self.plane.box
        sides = np.subtract(self.box[2:], self.box[:2])
        start, size = low, np.maximum(np.rint(sides), 1)
        pitch = (high - low) / size
        if len(painter.layers) == 1:
            voxel = 1 / painter.density(self.plane)
            count = np.rint((high - low) / voxel)
            step = np.maximum(count // (2 * sides), 1)
            first, wide = low + (1 - step) / 2 * voxel, (step * voxel).tolist()
            across, down = np.ceil(count / step).astype(int).tolist()
            raster = self.plane.raster(painter.layers[0].volume, first, wide, (across, down))
            if raster.is_whole:
                return painter.screen(self.plane, first, (wide[0], wide[1]), (across, down))
        return painter.screen(self.plane, start, (pitch[0], pitch[1]), (int(size[0]), int(size[1])))

    def point(self, place: tuple[float, float]) -> np.ndarray:
        """World point [3] at a pixel."""
        along = self.plane.box[0] + (np.array(place) - self.box[:2]) * self.pitch
        return np.asarray(self.plane.point + along[0] * self.plane.right + along[1] * self.plane.down)

    def pixel(self, point: np.ndarray) -> tuple[float, float]:
        """Pixel of a world point [3], seen along the normal."""
        away = point - self.plane.point
        x, y = (np.array([away @ self.plane.right, away @ self.plane.down]) - self.plane.box[0]) / self.pitch
        return float(x + self.box[0]), float(y + self.box[1])


def column_width(window: tuple[int, int], slices: Slices) -> int:
    """Width of the slices in the window, pixels."""
    high, share = (window[1] / 3, WIDEST) if slices.large is None else (window[1], LARGE)
    return int(min(high, window[0] * share)) if slices.shown else 0


def slice_up(document: Document) -> np.ndarray:
    """Up in the slices of a scene."""
    return np.asarray(document.scene.view.slice_up(document.volume.hints), dtype=np.float64)


def panes(
    slices: Slices, volume: Volume, up: np.ndarray, window: tuple[int, int], scale: float = 1.0
) -> tuple[Pane, ...]:
    """Panes of the slices across z, y and x of the world, downwards, or of the large one, at the right of the window.
    up: of the scene.
    """
    wide, across = column_width(window, replace(slices, shown=True)), planes(slices, volume, up)
    axes = [axis for axis in across_axes(volume) if slices.large in (None, axis)]
    made, step = [], window[1] / len(axes)
    for number, axis in enumerate(axes):
        room = float(window[0] - wide), number * step, float(window[0]), (number + 1) * step
        low, high = across[axis].box
        made.append(Pane(axis, across[axis], room, _fit_box(room, (high - low).tolist(), MARGIN * scale)))
    return tuple(made)


def across_axes(volume: Volume) -> list[int]:
    """Axes of the grid across which the slices lie, from the first pane to the last."""
    return [world_axes(volume).index(normal) for normal in (2, 1, 0)]


def next_large(slices: Slices, volume: Volume) -> Slices:
    """The slices with the next one large: across z, y, then x; then all three."""
    order = [None, *across_axes(volume)]
    return replace(slices, shown=True, large=order[(order.index(slices.large) + 1) % 4] if slices.shown else order[1])


def _fit_box(room: Box, sides: Sequence[float], margin: float) -> Box:
    """The largest centred box of these proportions in a room."""
    wide, high = room[2] - room[0] - 2 * margin, room[3] - room[1] - 2 * margin
    factor = min(max(wide, 1.0) / sides[0], max(high, 1.0) / sides[1])
    width, height = max(sides[0] * factor, 1.0), max(sides[1] * factor, 1.0)
    left, top = (room[0] + room[2] - width) / 2, (room[1] + room[3] - height) / 2
    return left, top, left + width, top + height


# sRGB of the slices across x, y and z of the grid, and of the background
LINES: tuple[LineColor, ...] = ((1.0, 0.42, 0.36, 0.9), (0.45, 0.86, 0.42, 0.9), (0.45, 0.62, 1.0, 0.9))
BACKGROUND = np.array([[[18, 18, 20, 255]]], np.uint8)
# most samples of a plane of one of several layers that is drawn at once
QUICK = 1 << 20
# longest wait of a saved picture for slices, seconds
LONGEST = 20.0
# pixels at a content scale of 1: of lines, between labels and edges, of the dots that turn slices, around these, and of
# a letter
LINE, GAP, DOT, NEAR, LETTER = 1.0, 2.0, 8.0, 9.0, 7.0
# from where to where the lines of a crosshair go, and their sRGB
CROSSHAIR = 4.0, 12.0
CURSOR: LineColor = (1.0, 0.85, 0.3, 1.0)
# distance of these dots from the common point, as a share of the shorter side of a pane
REACH = 0.3

Key = tuple[object, ...]


class SliceTool(Tool):
    """Slices next to the picture: their latest pixels, and the drag that moves them."""

    def __init__(self, wake: Callable[[], None]) -> None:
        self.jobs = Jobs(wake)
        # by axis: key and pixels of the latest slice, and keys of slices that are being read
        self.drawn: dict[int, tuple[Key, np.ndarray]] = {}
        self.waiting: dict[int, Key] = {}
        # keys and reasons of slices that cannot be read: not tried again until slices are hidden
        self.failed: dict[int, tuple[Key, str]] = {}
        self.dragged: int | None = None
        # of the drag that turns the others about a pane's normal: the pane, and angle and rotation before it
        self.turning: tuple[Pane, float, Turn] | None = None
        # time and place of the latest press
        self.mouse = Mouse()

    def panes(self, state: State, document: Document, view: Viewport) -> tuple[Pane, ...]:
        """The visible slices."""
        if not state.slices.shown or document.is_loading:
            return ()
        return panes(state.slices, document.volume, slice_up(document), view.size, view.scale)

    def _pane(self, state: State, document: Document, view: Viewport, place: Place) -> Pane | None:
        return next((pane for pane in self.panes(state, document, view) if pane.holds(place)), None)

    def press(self, state: State, document: Document, view: Viewport, pointer: Pointer) -> State | None:
        """Moves the other two slices to the cursor; takes a dot that turns them. A double click shows the slice large,
        or all three again.
        """
        pane = self._pane(state, document, view, pointer.place)
        if pane is None or pointer.button != "left":
            return None if pane is None else state
        dots = [dot for _, dot in turn_dots(pane, state.slices, document.volume)]
        if min(np.hypot(*np.subtract(dot, pointer.place)) for dot in dots) <= NEAR * view.scale:
            self.turning = pane, _angle(pane, pointer.place), state.slices.turn
            return state
        is_double = self.mouse.doubles(pointer.button, pointer.place, view.time)
        self.mouse = Mouse(None, (-np.inf if is_double else view.time, pointer.place))
        if is_double:
            large = pane.axis if state.slices.large is None else None
            return replace(state, slices=replace(state.slices, large=large))
        self.dragged = pane.axis
        return _link_slices(state, document, pane, pointer.place)

    def move(self, state: State, document: Document, view: Viewport, pointer: Pointer) -> State | None:
        """Drags the other two slices, or turns them."""
        if self.turning is not None:
            # whatever the path of the cursor
            pane, angle, before = self.turning
            turn = turned(before, pane.plane.normal, _angle(pane, pointer.place) - angle)
            return with_slices(state, with_turn(state.slices, turn, document.volume), document.volume)
        if self.dragged is None:
            return None
        found = next((pane for pane in self.panes(state, document, view) if pane.axis == self.dragged), None)
        return state if found is None else _link_slices(state, document, found, pointer.place)

    def release(self, state: State, document: Document, view: Viewport, pointer: Pointer) -> State | None:
        """Ends the drag."""
        self.dragged = self.turning = None
        return None

    def wheel(self, state: State, document: Document, view: Viewport, pointer: Pointer) -> State | None:
        """Moves the slice under the cursor by voxels."""
        pane = self._pane(state, document, view, pointer.place)
        if pane is None or not pointer.notches:
            return None if pane is None else state
        steps = round(pointer.notches) or int(np.sign(pointer.notches))
        return with_slices(state, move_slice(state.slices, pane.axis, steps, document.volume), document.volume)

    def collect(self) -> list[str] | None:
        """Takes slices that a thread has read; returns the messages of failures, None if nothing was read."""
        results = self.jobs.collect()
        notes = []
        for result in results:
            if result.error is not None:
                notes.append(f"a slice cannot be read: {result.error}")
                self.failed.update({axis: (key, notes[-1]) for axis, key in self.waiting.items()})
            else:
                axis, key, pixels = result.value
                self.drawn[axis] = key, pixels
                self.failed.pop(axis, None)
        if results:
            self.waiting.clear()
        return notes if results else None

    def marks(
        self,
        state: State,
        document: Document,
        view: Viewport,
        cursor: Place | None = None,
        seen: np.ndarray | None = None,
    ) -> ScreenMarks:
        """The slices with their lines and letters, and the values at the cursor, or at their common point; nothing
        while they are hidden. seen: world point [3] under the cursor in the picture, for the linked crosshair.
        """
        visible = self.panes(state, document, view)
        if not visible:
            self.drawn.clear()
            self.failed.clear()
            return ScreenMarks()
        scale, volume = view.scale, document.volume
        left = visible[0].room[0]
        sprites = [Sprite(BACKGROUND, (left, 0.0, float(view.size[0]), float(view.size[1])))]
        strokes, labels = list[Stroke](), list[Sprite]()
        looks = layer_looks(document.pool, state.styles)
        is_only = len(looks) == 1 and looks[0].volume is volume
        painter = layer_painter(looks, state.slices.colored, is_only, document.scene.label_fill)
        for pane in visible:
            pixels = self._pixels(pane, state.slices, painter, volume)
            if pixels is not None:
                sprites.append(Sprite(pixels, pane.box, smooth=state.slices.turn == STRAIGHT))
            labels += _labels(pane, state.slices, volume, scale)
            strokes += _cross(pane, state.slices, volume, scale)
        pointed = next((pane for pane in visible if cursor is not None and pane.holds(cursor)), None)
        point = None if pointed is None or cursor is None else pointed.point(cursor)
        if state.slices.linked:
            strokes += _crosshairs(seen if point is None else point, visible, pointed, state.pose.camera, scale)
        values = slice_values(state, document, int((view.size[0] - left) / LETTER / scale), point)
        if point is not None and values:
            values = (*values, f"at {', '.join(f'{each:.4g}' for each in point)} {volume.unit}".rstrip())
        if values:
            corner = left + GAP * scale, view.size[1] - GAP * scale
            shown_values = _label_at(values, corner, (0.0, 1.0), scale)
            labels = [*(_beside(letter, shown_values, GAP * scale) for letter in labels), shown_values]
        return ScreenMarks(tuple(sprites), tuple(strokes), tuple(labels))

    def complete_marks(self, state: State, document: Document, view: Viewport) -> ScreenMarks:
        """The marks once all slices are read. Raises InputError for slices that cannot be read within LONGEST."""
        marks, end = self.marks(state, document, view), time.monotonic() + LONGEST
        while self.waiting and self.jobs.wait(max(end - time.monotonic(), 0.0)):
            # one after the other
            self.collect()
            marks = self.marks(state, document, view)
        if self.waiting or self.failed:
            why = next((why for _, why in self.failed.values()), f"slices: not read within {LONGEST:.0f} s")
            raise InputError(f"{why}; hide the slices to save the picture alone")
        return marks

    def _pixels(self, pane: Pane, slices: Slices, painter: SlicePainter, volume: Volume) -> np.ndarray | None:
        """Pixels of a slice of all visible layers; where samples are read in parts, or planes of several layers are
        large, the previous ones until a thread has made them.
        """
        index = slices.index(volume)[pane.axis]
        place = index if slices.turn == STRAIGHT else (slices.turn, slices.place)
        key: Key = (volume, place, painter, pane.box)
        known = self.drawn.get(pane.axis)
        if known is not None and known[0] == key:
            self.failed.pop(pane.axis, None)
        elif _are_quick(painter):
            self.drawn[pane.axis] = key, pane.pixels(painter)
        elif pane.axis in self.failed and self.failed[pane.axis][0] == key:
            return None
        elif not self.waiting:
            self.waiting[pane.axis] = key
            self.jobs.submit(JobKind.SLICE, "reading a slice", lambda: (pane.axis, key, pane.pixels(painter)))
        latest = self.drawn.get(pane.axis)
        return None if latest is None else latest[1]


def _are_quick(painter: SlicePainter) -> bool:
    """Whether a slice takes no longer than a frame."""
    volumes = [layer.volume for layer in painter.layers]
    is_small = len(volumes) < 2 or all(each.count / min(each.shape) <= QUICK for each in volumes)
    return is_small and all(isinstance(each.samples, np.ndarray) for each in volumes)


def slice_values(state: State, document: Document, most: int, point: np.ndarray | None = None) -> tuple[str, ...]:
    """Value of each visible layer at a world point [3], by default the slices' common one, after its name, which is
    shortened to `most` letters in all, if there are several.
    """
    pool, texts = document.pool, list[str]()
    point = middle(state.slices, document.volume) if point is None else point
    shown = [style for style in state.styles if style.is_shown and style.number in pool] or state.styles[:1]
    for style in shown:
        layer, part = pool[style.number], pool[style.number].volume
        place = np.rint(np.linalg.solve(part.world_from_index, point - np.asarray(part.origin))).astype(int)
        is_inside = (place >= 0).all() and (place < part.shape[::-1]).all()
        if is_inside and isinstance(part.samples, np.ndarray):
            text = value_text(style, part, part.samples[tuple(place[::-1])], place.tolist())
            name, room = style.title or layer.name, most - len(text) - 2
            name = name if len(name) <= room else f"{name[: max(room - 1, 1)]}…"
            texts.append(text if len(shown) < 2 else f"{name}: {text}")
    return tuple(texts)


def _angle(pane: Pane, place: Place) -> float:
    """Angle of a pixel around the common point, degrees, from the right to below."""
    x, y = np.subtract(place, pane.pixel(pane.plane.point))
    return float(np.degrees(np.arctan2(y, x)))


def turn_dots(pane: Pane, slices: Slices, volume: Volume) -> list[tuple[int, Place]]:
    """The pixels of a pane that a drag turns the other slices by, with the axes of these."""
    across, here = normals(slices, volume), np.array(pane.pixel(pane.plane.point))
    reach = REACH * min(pane.room[2] - pane.room[0], pane.room[3] - pane.room[1])
    dots = []
    for other in (axis for axis in range(3) if axis != pane.axis):
        along = np.cross(across[pane.axis], across[other])
        step = np.array([along @ pane.plane.right, along @ pane.plane.down])
        step *= reach / np.linalg.norm(step)
        dots += [(other, tuple((here + sign * step).tolist())) for sign in (-1, 1)]
    return dots


def move_slice(slices: Slices, axis: int, steps: int, volume: Volume) -> Slices:
    """The slices with the one across an axis of the grid moved by voxels; along its normal if they are turned."""
    if slices.turn == STRAIGHT:
        return slices.moved(axis, steps, volume)
    point = middle(slices, volume) + steps * volume.spacing[axis] * normals(slices, volume)[axis]
    return slices.through(point, volume)


def _link_slices(state: State, document: Document, pane: Pane, place: Place) -> State:
    """The state with the other two slices at a place in a pane."""
    return with_slices(state, state.slices.through(pane.point(place), document.volume), document.volume)


def _cross(pane: Pane, slices: Slices, volume: Volume, scale: float) -> list[Stroke]:
    """Lines where the two other slices cut a slice, with the dots that turn them, and its outline."""
    thin, corners = LINE * scale, [pane.pixel(point) for point in pane.plane.corners]
    ends = zip(corners, [*corners[1:], corners[0]], strict=True)
    strokes = [Stroke(start, stop, LINES[pane.axis], thin, 0.0) for start, stop in ends]
    dots = turn_dots(pane, slices, volume)
    for (other, first), (_, second) in zip(dots[::2], dots[1::2], strict=True):
        for start, stop in clip_segments(_long(first, second, pane.room), pane.box).reshape(-1, 2, 2).tolist():
            strokes.append(Stroke(tuple(start), tuple(stop), LINES[other], thin, 0.0))
        strokes += [Stroke(dot, dot, LINES[other], DOT * scale, scale) for dot in (first, second)]
    return strokes


def _crosshairs(
    point: np.ndarray | None, visible: Sequence[Pane], pointed: Pane | None, camera: Camera, scale: float
) -> list[Stroke]:
    """Marks of a world point [3] in all slices but the one that the cursor is in, and in the picture."""
    if point is None:
        return []
    places = [(pane.pixel(point), pane.room) for pane in visible if pane is not pointed]
    if pointed is not None:
        x, y = project(camera, point[None])[0].tolist()
        places.append(((x, y), (0.0, 0.0, float(camera.size[0]), float(camera.size[1]))))
    inner, outer = (reach * scale for reach in CROSSHAIR)
    return [
        Stroke((x + a * inner, y + b * inner), (x + a * outer, y + b * outer), CURSOR, 2 * LINE * scale, scale)
        for (x, y), (left, top, right, bottom) in places
        if left < x < right and top < y < bottom
        for a, b in ((1, 0), (-1, 0), (0, 1), (0, -1))
    ]


def _long(first: Place, second: Place, room: Box) -> np.ndarray:
    """The segment [1, 4] through two pixels, continued beyond a room."""
    a, b = np.array(first), np.array(second)
    far = (b - a) / np.linalg.norm(b - a) * (room[2] - room[0] + room[3] - room[1])
    return np.concatenate([a - far, b + far])[None]


def _labels(pane: Pane, slices: Slices, volume: Volume, scale: float) -> list[Sprite]:
    """Name and number of a slice, and letters of directions at its edges."""
    name = ANATOMY[world_axes(volume)[pane.axis]] if volume.frame else "xyz"[pane.axis]
    name = f"{name} {slices.index(volume)[pane.axis]}" if slices.turn == STRAIGHT else f"{name} turned"
    left, top, right, bottom = pane.room
    gap, middle = GAP * scale, ((left + right) / 2, (top + bottom) / 2)
    title = _label_at(name, (left + gap, top + gap), (0.0, 0.0), scale)
    labels = [title]
    for side, towards in enumerate((pane.plane.right, pane.plane.down)):
        for sign in (-1, 1):
            text = _direction(volume.frame, sign * towards)
            if text:
                edge = ((left + gap, right - gap), (top + gap, bottom - gap))[side][sign > 0]
                share = (sign + 1) / 2
                if side == 0:
                    labels.append(_label_at(text, (edge, middle[1]), (share, 0.5), scale))
                else:
                    # beside the title in a narrow pane
                    wide = label((text,), scale).shape[1]
                    x = max(middle[0], title.place[2] + gap + wide / 2) if sign < 0 else middle[0]
                    labels.append(_label_at(text, (x, edge), (0.5, share), scale))
    return labels


def _beside(letter: Sprite, text: Sprite, gap: float) -> Sprite:
    """A label, right of a text that would cover it."""
    left, top, right, bottom = letter.place
    covers = text.place[0] < right and left < text.place[2] and text.place[1] < bottom and top < text.place[3]
    shift = text.place[2] + gap - left if covers else 0.0
    return replace(letter, place=(left + shift, top, right + shift, bottom))


def _direction(frame: str | None, towards: np.ndarray) -> str:
    """Letters of a direction of a patient, or the name of the world axis that points there."""
    if frame:
        return letters(frame, towards)
    axis = int(np.argmax(np.abs(towards)))
    return "xyz"[axis] if towards[axis] > 0 else ""


def _label_at(text: str | tuple[str, ...], place: Place, anchor: Place, scale: float) -> Sprite:
    """A label of a line, or several, at a place. anchor: the point of the label there, in shares of its size."""
    pixels = label((text,) if isinstance(text, str) else text, scale)
    high, wide = pixels.shape[:2]
    left, top = round(place[0] - anchor[0] * wide), round(place[1] - anchor[1] * high)
    return Sprite(pixels, (left, top, left + wide, top + high))


def slice_outlines(slices: Slices, volume: Volume, camera: Camera, scale: float) -> list[Stroke]:
    """Edges of the slices in the 3-D picture."""
    if not slices.shown:
        return []
    strokes = []
    for axis, plane in enumerate(planes(slices, volume, np.array([0.0, 0.0, 1.0]))):
        points = plane.corners
        for start, stop in zip(points, np.roll(points, -1, axis=0), strict=True):
            ends = project_segment(camera, start, stop)
            if ends is not None:
                strokes.append(Stroke(*ends, LINES[axis], LINE * scale, scale))
    return strokes


def clip_strokes(strokes: tuple[Stroke, ...], edge: float) -> tuple[Stroke, ...]:
    """The strokes left of an edge, pixels; clips those across it."""
    clipped = []
    for stroke in strokes:
        (x, y), (u, v) = sorted((stroke.start, stroke.stop))
        if u <= edge:
            clipped.append(stroke)
        elif x < edge:
            share = (edge - x) / (u - x)
            clipped.append(replace(stroke, start=(x, y), stop=(edge, y + share * (v - y))))
    return tuple(clipped)

"""Marks over the window's picture: annotations, and the lines of tools."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from splatgl.annotations.annotate import LEAST_SIDE, LiveOverlay, with_time
from splatgl.annotations.canvas import BLACK, WHITE, Measure, Scale, Subject
from splatgl.annotations.text import label, place_label
from splatgl.data.color import Color
from splatgl.data.mesh import Mesh
from splatgl.data.volume import Volume
from splatgl.geometry.camera import Camera
from splatgl.gl.screen import LineColor, Marks, Sprite, Stroke
from splatgl.scene.meshes import is_mesh
from splatgl.transfer.transfer import Transfer
from splatgl.viewer.clip_tool import box_edges, handles, outline
from splatgl.viewer.lasso_tool import lasso_strokes
from splatgl.viewer.measure_tool import describe_pick, under_cursor
from splatgl.viewer.slice_views import clip_strokes, slice_outlines
from splatgl.viewer.state import Cuts, Ruler
from splatgl.viewer.tool import Place, View
from splatgl.viewer.trackball import project, project_segment

if TYPE_CHECKING:
    from splatgl.viewer.document import Document
    from splatgl.viewer.state import State


# background of checks, linear light
GREY = 0.075
# widest gap of empty rows or columns within a sprite, pixels
GAP = 16


@dataclass(frozen=True, eq=False)
class AnnotationInputs:
    """Inputs of annotations. transfer: of `valued`, whose values the colour bar shows. blend: of the picture; ground:
    its background, linear RGB; measures, meshes: of the scene. empty: whether only meshes are drawn.
    """

    names: tuple[str, ...]
    volume: Volume
    transfer: Transfer
    camera: Camera
    blend: str
    ground: Color
    measures: tuple[Measure, ...] = ()
    valued: Volume | None = None
    meshes: tuple[Mesh, ...] = ()
    empty: bool = False


class Legend:
    """Sprites of the annotations, drawn again only when their inputs change."""

    def __init__(self) -> None:
        self.overlay = LiveOverlay()
        self.key: tuple[object, ...] = ()
        self.latest: tuple[Sprite, ...] = ()

    def sprites(self, scenery: AnnotationInputs) -> tuple[Sprite, ...]:
        """The sprites for a picture of the camera's size; none if it is too small."""
        camera = scenery.camera
        if not scenery.names or min(camera.size) < LEAST_SIDE:
            return ()
        view = camera.eye.tobytes(), camera.eye_from_world.tobytes(), camera.extent, camera.perspective
        look = scenery.names, scenery.volume, scenery.transfer, scenery.blend, scenery.ground, camera.size, *view
        key: tuple[object, ...] = *look, *scenery.measures, scenery.valued, *scenery.meshes
        if key != self.key:
            subject = Subject.of(scenery.volume, scenery.valued)
            scales = Scale.of(scenery.meshes)
            subject = replace(subject, measures=scenery.measures, scales=scales, empty=scenery.empty)
            inputs = scenery.transfer, camera, scenery.names, scenery.ground, scenery.blend
            self.key, self.latest = key, crop_sprites(self.overlay.draw(subject, *inputs))
        return self.latest


def crop_sprites(pixels: np.ndarray) -> tuple[Sprite, ...]:
    """Sprites of the visible parts of a picture uint8 [H, W, 4]."""
    sprites = []
    for top, bottom in _spans(np.asarray(pixels[..., 3].any(axis=1))):
        for left, right in _spans(np.asarray(pixels[top:bottom, :, 3].any(axis=0))):
            sprites.append(Sprite(pixels[top:bottom, left:right].copy(), (left, top, right, bottom)))
    return tuple(sprites)


def _spans(full: np.ndarray) -> list[tuple[int, int]]:
    """Starts and ends of runs of True, joined across gaps of up to GAP."""
    places = np.flatnonzero(full)
    if not len(places):
        return []
    ends = np.flatnonzero(np.diff(places) > GAP)
    starts = [places[0], *places[ends + 1]]
    return [(int(a), int(b) + 1) for a, b in zip(starts, [*places[ends], places[-1]], strict=True)]


def background_of(state: State) -> Color:
    """The background of the picture, linear RGB."""
    if state.settings.ground is not None:
        return state.settings.ground
    return {"white": WHITE, "checks": (GREY, GREY, GREY)}.get(state.ground, BLACK)


# sRGB of the box, of planes, and of inactive cuts
BOX: LineColor = (0.36, 0.72, 1.0, 0.9)
PLANES: tuple[LineColor, ...] = ((1.0, 0.62, 0.2, 0.95), (0.45, 0.9, 0.45, 0.95), (0.95, 0.5, 0.85, 0.95))
RULER: LineColor = (1.0, 0.85, 0.3, 1.0)
RESTING: LineColor = (0.7, 0.7, 0.7, 0.7)
# pixels at a content scale of 1
LINE, DOT, TIP = 1.5, 11.0, 8.0


class Overlays:
    """Marks over the picture; keeps annotations from one frame to the next."""

    def __init__(self) -> None:
        self.legend = Legend()

    def marks(
        self, state: State, document: Document, view: View, cursor: Place | None, slices: Marks, edge: float
    ) -> Marks:
        """All marks: annotations that end left of `edge`, pixels, from where on the panel lies over the picture;
        handles, ruler, the value under the cursor (None: hidden), and those of slices.
        """
        camera, scale = state.pose.camera, view.scale
        legend = self.legend.sprites(annotation_inputs(state, document))
        legend = tuple(sprite for sprite in legend if sprite.place[2] <= edge)
        strokes = [*handle_strokes(state.cuts, document.volume, camera, scale), *lasso_strokes(state.lasso, scale)]
        lines, labels = ruler_marks(state.ruler, camera, scale), list[Sprite]()
        if state.probe and cursor is not None:
            labels += _value_label(state, document, cursor, scale)
        if not slices:
            return Marks(legend, (*strokes, *lines), tuple(labels))
        lines += slice_outlines(state.slices, document.volume, camera, scale)
        visible = clip_strokes((*strokes, *lines), camera.size[0])
        return Marks((*legend, *slices.sprites), (*visible, *slices.strokes), (*labels, *slices.labels))


def annotation_inputs(state: State, document: Document) -> AnnotationInputs:
    """Inputs of the annotations of a picture, whose colour bar is that of the first visible layer."""
    number = next((n for n, style in enumerate(state.styles) if style.is_shown), 0)
    inputs = state.styles[number].transfer, state.pose.camera, state.settings.blend, background_of(state)
    # a document that loads anew may have fewer layers
    of_bar = document.layers[min(number, len(document.layers) - 1)].volume, document.meshes
    empty = is_mesh(document.scene.volume)
    names = with_time(state.annotate, document.volume, state.time)
    return AnnotationInputs(names, document.volume, *inputs, state.measures, *of_bar, empty)


def ruler_marks(ruler: Ruler, camera: Camera, scale: float) -> list[Stroke]:
    """Dots at the points that are picked, and lines between them."""
    points = np.array(ruler.points).reshape(-1, 3)
    dots = [(float(x), float(y)) for x, y in project(camera, points) if np.isfinite(x)]
    strokes = _lines(camera, list(pairwise(points)), RULER, LINE * scale)
    return [*strokes, *(Stroke(dot, dot, RULER, TIP * scale, scale) for dot in dots)]


def _value_label(state: State, document: Document, cursor: Place, scale: float) -> list[Sprite]:
    """The label of the value under the cursor."""
    size = state.pose.camera.size
    if not (0 <= cursor[0] < size[0] and 0 <= cursor[1] < size[1]):
        return []
    text = label(describe_pick(under_cursor(state, document, cursor), document), scale)
    return [Sprite(text, place_label(cursor, (text.shape[1], text.shape[0]), size, 1.5 * DOT * scale))]


def handle_strokes(cuts: Cuts, volume: Volume, camera: Camera, scale: float) -> list[Stroke]:
    """Lines and handles of the clip box and planes, pixels; none while they are hidden."""
    if not cuts.shown:
        return []
    box = BOX if cuts.active else RESTING
    strokes = _lines(camera, box_edges(cuts, volume), box, LINE * scale)
    for number, plane in enumerate(cuts.planes):
        points = outline(cuts, volume, plane)
        rim = list(zip(points, np.roll(points, -1, axis=0), strict=True)) if len(points) else []
        strokes += _lines(camera, rim, plane_color(cuts, number), LINE * scale)
    feet = {}
    for handle in handles(cuts, volume):
        color = box if handle.what == "side" else plane_color(cuts, handle.number)
        if handle.what == "plane":
            feet[handle.number] = handle.point
        elif handle.what == "tilt":
            strokes += _lines(camera, [(feet[handle.number], handle.point)], color, LINE * scale)
        (place,) = project(camera, handle.point[None])
        if np.isfinite(place).all():
            at = float(place[0]), float(place[1])
            strokes.append(Stroke(at, at, color, (TIP if handle.what == "tilt" else DOT) * scale, scale))
    return strokes


def plane_color(cuts: Cuts, number: int) -> LineColor:
    """Colour of a plane and its handles."""
    return PLANES[number % len(PLANES)] if cuts.active else RESTING


def _lines(camera: Camera, ends: list[tuple[np.ndarray, np.ndarray]], color: LineColor, width: float) -> list[Stroke]:
    segments = [project_segment(camera, start, stop) for start, stop in ends]
    return [Stroke(*each, color, width) for each in segments if each is not None]

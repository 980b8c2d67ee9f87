"""Edges of the volume's box, with ticks and numbers along three outer edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from splatgl.annotations.canvas import (
    Annotation,
    AnnotationView,
    Canvas,
    Rect,
    Subject,
    clip_segments,
    split_into_dashes,
)
from splatgl.annotations.scale_bar import in_digits, ticks
from splatgl.data.volume import Axis
from splatgl.geometry.camera import Camera

# ends of the edges along grid x, y and z as indices of corners; corner 4z + 2y + x
EDGES = tuple(tuple((n, n + step) for n in range(8) if not n & step) for step in (1, 2, 4))
# width of lines and length of ticks, in font heights; dashes and the gaps between them
WIDTH, TICK, DASH, GAP = 0.06, 0.45, 0.5, 0.4
ALPHA, BEHIND = 0.9, 0.6
# most ticks of an edge, and font heights from one to the next
MOST_TICKS, APART = 6, 2.6
# depths below this share of the box's size are behind the eye
NEAREST = 1e-4
# a grid axis this close to a world axis has its letter and coordinates
ALONG = 1e-6
# of two outer edges, the one farther in this direction is numbered: down, and slightly left
TOWARDS = np.array([-0.6, 1.0])


@dataclass(frozen=True, eq=False)
class Edge:
    """Edge of the box from corner to corner; outer: is on the outline; hidden: lies behind the box."""

    axis: int
    corners: tuple[int, int]
    outer: bool
    hidden: bool


def edges(corners: np.ndarray, camera: Camera) -> list[Edge]:
    """The twelve edges of a parallelepiped with corners [8, 3], world units."""
    sides = [corners[1 << axis] - corners[0] for axis in range(3)]
    middle = corners.mean(axis=0)
    facing = {}
    for axis in range(3):
        normal = np.cross(sides[axis - 2], sides[axis - 1])
        for end in (0, 1):
            place = middle + (end - 0.5) * sides[axis]
            outward = normal * np.sign(normal @ (place - middle))
            to_eye = camera.eye - place if camera.perspective else -camera.forward
            facing[axis, end] = float(outward @ to_eye) > 1e-9 * float(np.linalg.norm(outward) * np.abs(to_eye).max())
    result = []
    for axis, pairs in enumerate(EDGES):
        for first, second in pairs:
            faces = [facing[other, first >> other & 1] for other in range(3) if other != axis]
            result.append(Edge(axis, (first, second), faces[0] != faces[1], not any(faces)))
    return result


def project_points(points: np.ndarray, camera: Camera) -> np.ndarray:
    """Pixel places [N, 2] of world points [N, 3] in front of the eye."""
    eye_points = camera.eye_from_points(points)
    scale = np.asarray(camera.pixel_pitch(eye_points[:, 2]))[:, None]
    return np.asarray(eye_points[:, :2] / scale + np.array(camera.size) / 2)


def clip_to_front(ends: np.ndarray, camera: Camera) -> np.ndarray:
    """Parts [M, 2, 3] of segments [N, 2, 3] in front of the eye."""
    near = NEAREST * float(np.ptp(ends.reshape(-1, 3), axis=0).max())
    depth = camera.eye_from_points(ends)[..., 2]
    is_ahead = (depth > near).any(axis=1)
    ends, depth = ends[is_ahead], depth[is_ahead]
    step = np.where(depth[:, 0] == depth[:, 1], 1.0, depth[:, 1] - depth[:, 0])
    crossing = ends[:, 0] + (ends[:, 1] - ends[:, 0]) * ((near - depth[:, 0]) / step)[:, None]
    return np.where((depth > near)[..., None], ends, crossing[:, None])


def draw_behind(layer: Canvas, view: AnnotationView) -> None:
    """Draws the edges that lie behind the box, dashed."""
    subject, camera = view.subject, view.camera
    hidden = [edge for edge in edges(subject.corners, camera) if edge.hidden]
    em = layer.em
    # a close view would have many dashes beyond the image
    inside = clip_segments(_in_image(hidden, subject, camera), (-em, -em, layer.size[0] + em, layer.size[1] + em))
    dashes = split_into_dashes(inside, DASH * em, max(GAP * em, 2 * layer.edge + 2))
    layer.segments(dashes, alpha=BEHIND, width=_width(layer))


def draw_edges(layer: Canvas, view: AnnotationView) -> None:
    """Draws the other edges, with ticks along an outer edge of each axis."""
    subject, camera = view.subject, view.camera
    box = edges(subject.corners, camera)
    drawn = [_in_image([edge for edge in box if not edge.hidden], subject, camera)]
    for edge in select_numbered_edges(box, subject, camera):
        start = project_points(marks(subject, edge, camera, layer.em)[0], camera)
        out = outward_direction(edge, subject, camera) * TICK * layer.em
        drawn.append(np.concatenate([start, start + out], axis=1))
    layer.segments(np.concatenate(drawn), alpha=ALPHA, width=_width(layer))


def draw_numbers(layer: Canvas, view: AnnotationView) -> None:
    """Draws the numbers of the ticks, and the names of the axes."""
    subject, camera = view.subject, view.camera
    box = edges(subject.corners, camera)
    if not any(edge.outer for edge in box):
        layer.notes.append("no numbers of the box: the eye is in it")
    left_out = sum(_number(layer, subject, edge, camera) for edge in select_numbered_edges(box, subject, camera))
    if left_out:
        layer.notes.append(f"no room for {left_out} numbers of the box")


def _in_image(box: list[Edge], subject: Subject, camera: Camera) -> np.ndarray:
    """Parts of edges in front of the eye, in pixels [S, 4]."""
    ends = np.array([subject.corners[list(edge.corners)] for edge in box]).reshape(-1, 2, 3)
    ahead = clip_to_front(ends, camera) if len(ends) else ends
    return project_points(ahead.reshape(-1, 3), camera).reshape(-1, 4)


def _width(layer: Canvas) -> float:
    return max(1.0, WIDTH * layer.em)


def select_numbered_edges(box: list[Edge], subject: Subject, camera: Camera) -> list[Edge]:
    """An outer edge of each axis in front of the eye, if any: the lower one, or the one farther left."""
    depth = camera.eye_from_points(subject.corners)[:, 2]
    result = []
    for axis in range(3):
        outer = [edge for edge in box if edge.axis == axis and edge.outer]
        outer = [edge for edge in outer if (depth[list(edge.corners)] > 0).all() or not camera.perspective]
        if outer:
            result.append(max(outer, key=lambda edge: float(outward_direction(edge, subject, camera) @ TOWARDS)))
    return result


def outward_direction(edge: Edge, subject: Subject, camera: Camera) -> np.ndarray:
    """Unit vector [2] in the image, across an edge and away from the box."""
    a, b = project_points(subject.corners[list(edge.corners)], camera)
    along = (b - a) / (float(np.hypot(*(b - a))) or 1.0)
    across = np.array([-along[1], along[0]])
    depth = camera.eye_from_points(subject.corners)[:, 2]
    corners = project_points(subject.corners[depth > 0] if camera.perspective else subject.corners, camera)
    return across if float((corners - a).mean(axis=0) @ across) < 0 else -across


def marks(subject: Subject, edge: Edge, camera: Camera, em: int) -> tuple[np.ndarray, list[str], str]:
    """World places [N, 3] of an edge's ticks, their texts, and the name of the axis.

    Along a world axis the ticks are coordinates, those of the file if it has some, else lengths from the first corner
    along grid axis i, j or k.
    """
    first, second = subject.corners[list(edge.corners)]
    length = float(np.linalg.norm(second - first))
    unit = (second - first) / length
    world = int(np.abs(unit).argmax())
    straight = abs(unit[world]) > 1 - ALONG
    start, sign = (float(first[world]), float(np.sign(unit[world]))) if straight else (0.0, 1.0)
    known = subject.axes[world] if straight and subject.axes else Axis("xyz"[world], subject.unit)
    low, high = sorted(known.offset + known.slope * place for place in (start, start + sign * length))
    factor, name = in_digits(max(abs(low), abs(high)), known.unit)
    shown = np.hypot(*np.subtract(*project_points(np.array([first, second]), camera)))
    most = min(MOST_TICKS, int(shown / (APART * em)))
    values = ticks(low * factor, high * factor, most) if most > 1 else []
    along = (np.array(values).reshape(-1, 1) / factor - known.offset) / (known.slope or 1.0)
    places = first + unit * ((along - start) * sign)
    letter = known.name if straight else "ijk"[edge.axis]
    return places, [f"{value:.6g}" for value in values], f"{letter}, {name}" if name else letter


def _number(layer: Canvas, subject: Subject, edge: Edge, camera: Camera) -> int:
    """Draws an edge's numbers and name; returns how many have no room."""
    a, b = project_points(subject.corners[list(edge.corners)], camera)
    places, texts, name = marks(subject, edge, camera, layer.em)
    if not texts:
        return 1
    out = outward_direction(edge, subject, camera)
    start = TICK * layer.em + layer.edge
    missing, reach = 0, start
    for place, text in zip(project_points(places, camera), texts, strict=True):
        half = float(np.abs(out) @ layer.text_size(text)) / 2
        reach = max(reach, start + 2 * half)
        missing += not _write(layer, text, [place + out * (start + half)])
    half = float(np.abs(out) @ layer.text_size(name)) / 2
    middle = (a + b) / 2 + out * (reach + half)
    beside = [middle + (b - a) * shift for shift in (0.0, -0.15, 0.15, -0.3, 0.3)]
    # a long name goes beyond an end, the upper one first
    along = (b - a) / (float(np.hypot(*(b - a))) or 1.0)
    beyond = [end + sign * along * (start + layer.em) for end, sign in sorted(((a, -1), (b, 1)), key=lambda x: x[0][1])]
    return missing + (not _write(layer, name, [*beside, *beyond]))


def _write(layer: Canvas, text: str, middles: list[np.ndarray]) -> bool:
    """Writes a text centred on the first free place; returns whether one is free."""
    wide, tall = layer.text_size(text)
    for x, y in middles:
        left, top = round(float(x) - wide / 2), round(float(y) - tall / 2)
        rect = Rect(left, top, left + wide, top + tall)
        if layer.free(rect):
            layer.taken.append(rect)
            layer.text(text, left, top)
            return True
    return False


TITLE, ABOUT = "the volume's box, with numbers", "The volume's box with numbers along its edges."
LINES = draw_edges, draw_behind
ROWS = (Annotation("box", TITLE, ABOUT, draw_numbers, 6, "ctrl+j", lines=LINES, room=1.25),)

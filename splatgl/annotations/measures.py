"""Distances and angles between points of a scene."""

from __future__ import annotations

import numpy as np

from splatgl.annotations.bounding_box import clip_to_front, project_points
from splatgl.annotations.canvas import WHITE, Annotation, AnnotationView, Canvas, Measure, Subject
from splatgl.annotations.scale_bar import length_text

# linear RGB on dark and on light pictures
BRIGHT, DARK = (1.0, 0.694, 0.0732), (0.305, 0.0666, 0.0)
# diameters of dots, in widths of lines; the arc of an angle, as a share of its shorter side, and its number of segments
DOT, ARC, STEPS = 3.0, 0.3, 24


def measure_text(measure: Measure, subject: Subject) -> str:
    """The length in its unit, or the angle in degrees; after the name, if there is one. Along axes of several units the
    distances along each of them, and no angle.
    """
    points = np.array(measure.points)
    sides = points[1:] - points[:-1]
    lengths = [subject.lengths(side) for side in sides if side.any()]
    if any(each is None or each != lengths[0] for each in lengths):
        apart = [(axis, abs(axis.slope * side)) for axis, side in zip(subject.axes, sides[0], strict=True) if side]
        texts = [f"{axis.name} {length:.4g} {axis.unit}".rstrip() for axis, length in apart]
        value = ", ".join(texts) if len(points) == 2 else "no angle: axes have several units"
    elif len(points) == 2:
        factor, unit = lengths[0] if lengths and lengths[0] else (1.0, subject.unit)
        value = length_text(float(f"{factor * np.linalg.norm(sides[0]):.4g}"), unit)
    else:
        value = f"{_angle(points):.4g}°"
    return f"{measure.name}: {value}" if measure.name else value


def _angle(points: np.ndarray) -> float:
    """The angle in degrees at the second of three points [3, 3]."""
    a, b = points[0] - points[1], points[2] - points[1]
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


def draw(layer: Canvas, view: AnnotationView) -> None:
    """Draws the line, dots and value of each measure in front of the eye."""
    color = BRIGHT if layer.ink == WHITE else DARK
    for measure in view.subject.measures:
        points = np.array(measure.points)
        sides = clip_to_front(np.stack([points[:-1], points[1:]], axis=1), view.camera)
        if not len(sides):
            continue
        lines = project_points(sides.reshape(-1, 3), view.camera).reshape(-1, 4)
        layer.segments(np.concatenate([lines, _arc(points, view)]), color)
        depth = view.camera.eye_from_points(points)[:, 2]
        ahead = points[(depth > 0) | (not view.camera.perspective)]
        layer.segments(np.tile(project_points(ahead, view.camera), 2), color, width=DOT * layer.stroke)
        text = measure_text(measure, view.subject)
        middle = (lines[0, :2] + lines[0, 2:]) / 2 if len(points) == 2 else lines[0, 2:]
        layer.write(text, _corners_beside(layer, text, middle), f"measure {text}", color)


def _arc(points: np.ndarray, view: AnnotationView) -> np.ndarray:
    """The arc of an angle, pixels [S, 4]; none of a distance, and of sides that are parallel or behind the eye."""
    if len(points) == 2 or (view.camera.eye_from_points(points)[:, 2] <= 0).any():
        return np.zeros((0, 4))
    sides = points[[0, 2]] - points[1]
    lengths = np.linalg.norm(sides, axis=1)
    angle = np.radians(_angle(points))
    if not lengths.min() > 0 or not np.sin(angle) > 0:
        return np.zeros((0, 4))
    turns = np.linspace(0, angle, STEPS + 1)[:, None]
    first, last = sides / lengths[:, None]
    around = (np.sin(angle - turns) * first + np.sin(turns) * last) / np.sin(angle)
    places = project_points(points[1] + ARC * lengths.min() * around, view.camera)
    return np.concatenate([places[:-1], places[1:]], axis=1)


def _corners_beside(layer: Canvas, text: str, at: np.ndarray) -> list[tuple[int, int]]:
    """Upper left corners of a text around a place [2], best first."""
    (wide, tall), gap = layer.text_size(text), layer.pad
    x, y = np.rint(at).astype(int).tolist()
    corners = [(x + gap, y - tall - gap // 2), (x + gap, y + gap // 2), (x - gap - wide, y - tall - gap // 2)]
    corners += [(x - gap - wide, y + gap // 2), (x - wide // 2, y - tall - 2 * gap), (x - wide // 2, y + 2 * gap)]
    return corners


ABOUT = "The distances and angles of the scene."
ROWS = (Annotation("measures", "distances and angles", ABOUT, draw, 7),)

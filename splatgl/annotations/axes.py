"""Triad of axes, and letters of patient directions at the image's edges."""

from __future__ import annotations

import numpy as np

from splatgl.annotations.canvas import Annotation, AnnotationView, Canvas, Rect
from splatgl.data.color import Color

# colours of x, y, z, linear RGB, legible on black and on white
COLORS: tuple[Color, ...] = ((0.75, 0.04, 0.03), (0.02, 0.40, 0.04), (0.08, 0.22, 0.90))
# lengths of an axis and of its arrow head, in font heights
LONG, HEAD = 2.2, 0.55
# letters towards + and − of world x, y, z
LETTERS = {"LPS": ("LR", "PA", "SI"), "RAS": ("RL", "AP", "SI")}
# smallest component of a direction that adds a second letter: 20° off the first
OBLIQUE = 0.34
# iterations that move letters apart
ROUNDS = 20
# shifts of a letter along an edge of the image, as fractions of the edge, to try if its place is taken
SHIFTS = (0.0, -0.12, 0.12, -0.24, 0.24, -0.36, 0.36)


def letters(frame: str, direction: np.ndarray) -> str:
    """Letter of a world direction [3] in a frame; two for an oblique direction, the larger component first."""
    order = np.argsort(-np.abs(direction), kind="stable")[:2]
    axes = [axis for place, axis in enumerate(order) if place == 0 or abs(direction[axis]) > OBLIQUE]
    return "".join(LETTERS[frame][axis][0 if direction[axis] > 0 else 1] for axis in axes)


def draw_triad(layer: Canvas, view: AnnotationView) -> None:
    """Draws the triad at the lower left, the farthest axis first."""
    long, em = LONG * layer.em, layer.em
    half = int(np.ceil(long + 1.3 * em))
    (width, height), pad, side = layer.size, layer.pad, 2 * half
    starts = [(pad, height - pad - side), (width - pad - side, height - pad - side), (pad, pad)]
    place = layer.reserve([Rect(x, y, x + side, y + side) for x, y in starts], "axes")
    if place is None:
        return
    middle = np.array([place.left + half, place.top + half], np.float64)
    # of world x, y, z: right, down and away from the eye
    axes = view.camera.eye_from_world.T
    letters_at = middle + _apart(_ends(axes, em), em)
    for axis in np.argsort(-axes[:, 2], kind="stable"):
        along, color = axes[axis, :2], COLORS[axis]
        reach = float(np.linalg.norm(along))
        tip = middle + along * long
        if reach > 1e-6:
            unit = along / reach
            across = np.array([-unit[1], unit[0]])
            back = tip - unit * HEAD * em * min(1.0, reach * 2)
            layer.lines([[middle, back]], color)
            layer.polygon(np.array([tip, back + across * 0.25 * em, back - across * 0.25 * em]), color)
    for axis, color in enumerate(COLORS):
        corner = letters_at[axis] - np.array(layer.text_size("xyz"[axis])) / 2
        layer.text("xyz"[axis], round(corner[0]), round(corner[1]), color)


def _ends(axes: np.ndarray, em: int) -> np.ndarray:
    """Places [3, 2] of the axes' letters, from the triad's middle: past the tips, or beside an axis along the view."""
    reach = np.linalg.norm(axes[:, :2], axis=1)[:, None]
    unit = np.where(reach > 1e-6, axes[:, :2] / np.maximum(reach, 1e-12), np.array([0.7, -0.7]))
    return np.asarray(axes[:, :2] * LONG * em + unit * 0.7 * em)


def _apart(places: np.ndarray, em: int) -> np.ndarray:
    """Places [3, 2] moved to be a font height apart, no farther from the middle than the tips."""
    moved = places.copy()
    for _ in range(ROUNDS):
        for a, b in ((0, 1), (0, 2), (1, 2)):
            gap = moved[b] - moved[a]
            length = float(np.hypot(*gap))
            if length >= em:
                continue
            # the second of two letters on one spot goes sideways
            unit = gap / length if length > 1e-6 * em else np.array([0.8, 0.6])
            moved[a] -= unit * (em - length) / 2
            moved[b] += unit * (em - length) / 2
    most = (LONG + 0.7) * em
    return np.asarray(moved * np.minimum(1, most / np.maximum(np.linalg.norm(moved, axis=1), 1e-9))[:, None])


def draw_directions(layer: Canvas, view: AnnotationView) -> None:
    """Draws letters in the middle of the image's edges."""
    frame, camera = view.subject.frame, view.camera
    if frame is None:
        layer.notes.append("no directions: the file states no patient directions")
        return
    (width, height), pad = layer.size, layer.pad
    right, down = camera.eye_from_world[0], camera.eye_from_world[1]
    for x, y, direction in ((-1, 0, -right), (1, 0, right), (0, -1, -down), (0, 1, down)):
        text = letters(frame, direction)
        wide, tall = layer.text_size(text)
        left = (width - wide) // 2 if x == 0 else pad if x < 0 else width - pad - wide
        top = (height - tall) // 2 if y == 0 else pad if y < 0 else height - pad - tall
        # the letter at the right goes above the colour bar, not beside it, where it would cover the subject
        step = (0, -1) if x > 0 else (-x, -y)
        rect = _inwards(layer, Rect(left, top, left + wide, top + tall), step)
        shifts = [(round(share * width * abs(y)), round(share * height * abs(x))) for share in SHIFTS]
        layer.write(text, [(rect.left + x_by, rect.top + y_by) for x_by, y_by in shifts], f"direction {text}")


def _inwards(layer: Canvas, rect: Rect, step: tuple[int, int]) -> Rect:
    """The rectangle, moved past the places that it overlaps."""
    for other in [place for place in layer.taken if place.meets(rect)]:
        x = step[0] * ((other.right - rect.left if step[0] > 0 else rect.right - other.left) + layer.pad)
        y = step[1] * ((other.bottom - rect.top if step[1] > 0 else rect.bottom - other.top) + layer.pad)
        rect = rect.moved(x, y)
    return rect


ABOUT_AXES = "The directions of x, y and z, at the lower left."
ABOUT_LETTERS = "Letters of the patient's directions at the edges."
ROWS = (
    Annotation("axes", "axes", ABOUT_AXES, draw_triad, 4, "j", default=True),
    Annotation("directions", "directions", ABOUT_LETTERS, draw_directions, 5, "j", default=True, needs_frame=True),
)

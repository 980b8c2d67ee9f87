"""The triad of axes, and letters of patient directions at the picture's edges, as the camera sees them."""

from __future__ import annotations

import numpy as np

from splatgl.annotations.canvas import Annotation, Canvas, Color, Rect, View
from splatgl.splat.camera import Camera

# of x, y, z, linear RGB; they read on black and on white
COLORS: tuple[Color, ...] = ((0.75, 0.04, 0.03), (0.02, 0.40, 0.04), (0.08, 0.22, 0.90))
# length of an axis, in font heights, and of its head
LONG, HEAD = 2.2, 0.55
# letters towards + and − of world x, y, z
LETTERS = {"LPS": ("LR", "PA", "SI"), "RAS": ("RL", "AP", "SI")}
# a second letter is told from this component of the direction on: 20° off the first
OBLIQUE = 0.34
# how often letters that are too near are moved apart
ROUNDS = 20
# shifts of a letter along an edge of the picture, as fractions of it, that are tried where it would lie on something
SHIFTS = (0.0, -0.12, 0.12, -0.24, 0.24, -0.36, 0.36)


def directions(camera: Camera) -> np.ndarray:
    """World x, y, z in the picture, [3, 3]: right, down and away from the eye, each row of unit length."""
    return np.asarray(camera.eye_from_world.T)


def letters(frame: str, direction: np.ndarray) -> str:
    """One letter of a world direction [3] in a frame, or two where it is oblique, the larger component first."""
    order = np.argsort(-np.abs(direction), kind="stable")[:2]
    kept = [axis for place, axis in enumerate(order) if place == 0 or abs(direction[axis]) > OBLIQUE]
    return "".join(LETTERS[frame][axis][0 if direction[axis] > 0 else 1] for axis in kept)


def draw_triad(layer: Canvas, view: View) -> None:
    """Draws the triad at the lower left, the farthest axis first."""
    long, em = LONG * layer.em, layer.em
    half = int(np.ceil(long + 1.3 * em))
    (width, height), pad, side = layer.size, layer.pad, 2 * half
    starts = [(pad, height - pad - side), (width - pad - side, height - pad - side), (pad, pad)]
    place = layer.place([Rect(x, y, x + side, y + side) for x, y in starts], "axes")
    if place is None:
        return
    middle = np.array([place.left + half, place.top + half], np.float64)
    seen = directions(view.camera)
    letters_at = middle + _apart(_ends(seen, em), em)
    for axis in np.argsort(-seen[:, 2], kind="stable"):
        along, color = seen[axis, :2], COLORS[axis]
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


def _ends(seen: np.ndarray, em: int) -> np.ndarray:
    """Where the letters of axes [3, 3] are, [3, 2], from the triad's middle: past the tips, or beside one that points
    along the view.
    """
    reach = np.linalg.norm(seen[:, :2], axis=1)[:, None]
    unit = np.where(reach > 1e-6, seen[:, :2] / np.maximum(reach, 1e-12), np.array([0.7, -0.7]))
    return np.asarray(seen[:, :2] * LONG * em + unit * 0.7 * em)


def _apart(places: np.ndarray, em: int) -> np.ndarray:
    """Places [3, 2] moved until they are a font height apart, and not further from the middle than tips reach."""
    found = places.copy()
    for _ in range(ROUNDS):
        for a, b in ((0, 1), (0, 2), (1, 2)):
            gap = found[b] - found[a]
            length = float(np.hypot(*gap))
            if length >= em:
                continue
            # of two on one spot, the second goes sideways
            unit = gap / length if length > 1e-6 * em else np.array([0.8, 0.6])
            found[a] -= unit * (em - length) / 2
            found[b] += unit * (em - length) / 2
    most = (LONG + 0.7) * em
    return np.asarray(found * np.minimum(1, most / np.maximum(np.linalg.norm(found, axis=1), 1e-9))[:, None])


def draw_directions(layer: Canvas, view: View) -> None:
    """Draws letters in the middle of the image's edges."""
    frame, camera = view.subject.frame, view.camera
    if frame is None:
        layer.notes.append("no directions: the file does not say where the patient's are")
        return
    (width, height), pad = layer.size, layer.pad
    right, down = camera.eye_from_world[0], camera.eye_from_world[1]
    for x, y, direction in ((-1, 0, -right), (1, 0, right), (0, -1, -down), (0, 1, down)):
        text = letters(frame, direction)
        wide, tall = layer.text_size(text)
        left = (width - wide) // 2 if x == 0 else pad if x < 0 else width - pad - wide
        top = (height - tall) // 2 if y == 0 else pad if y < 0 else height - pad - tall
        # the letter at the right goes above the colour bar: beside it, it would lie over the subject
        step = (0, -1) if x > 0 else (-x, -y)
        rect = _inwards(layer, Rect(left, top, left + wide, top + tall), step)
        shifts = [(round(share * width * abs(y)), round(share * height * abs(x))) for share in SHIFTS]
        place = layer.place([rect.moved(*shift) for shift in shifts], f"direction {text}")
        if place is not None:
            layer.text(text, place.left, place.top)


def _inwards(layer: Canvas, rect: Rect, step: tuple[int, int]) -> Rect:
    """The rectangle, moved past what is in its way."""
    for other in [each for each in layer.taken if each.meets(rect)]:
        x = step[0] * ((other.right - rect.left if step[0] > 0 else rect.right - other.left) + layer.pad)
        y = step[1] * ((other.bottom - rect.top if step[1] > 0 else rect.bottom - other.top) + layer.pad)
        rect = Rect(rect.left + x, rect.top + y, rect.right + x, rect.bottom + y)
    return rect


ROWS = (
    Annotation(
        "axes",
        "axes",
        "The directions of x, y and z, at the lower left.",
        draw_triad,
        rank=4,
        key="j",
        default=True,
    ),
    Annotation(
        "directions",
        "patient directions",
        "Letters of the patient's directions at the edges.",
        draw_directions,
        rank=5,
        key="j",
        default=True,
        needs_frame=True,
    ),
)

"""Lines of the volume's world: its box with ticks, the triad of axes with directions, distances and angles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from splatgl.annotations.bars import in_digits, length_text, shorten_label, ticks
from splatgl.annotations.canvas import (
    WHITE,
    AnnotatedSubject,
    Annotation,
    AnnotationView,
    Canvas,
    Measure,
    Rect,
    clip_segments,
    split_into_dashes,
)
from splatgl.data.color import Color
from splatgl.data.volume import AxisCoordinate
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
    """Edge of the box from corner to corner; outer: is on the outline; hidden: is behind the box."""

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
    """Pixel positions [N, 2] of world points [N, 3] in front of the eye."""
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
    """Draws the edges behind the box, dashed."""
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


def _in_image(box: list[Edge], subject: AnnotatedSubject, camera: Camera) -> np.ndarray:
    """Parts of edges in front of the eye, in pixels [S, 4]."""
    ends = np.array([subject.corners[list(edge.corners)] for edge in box]).reshape(-1, 2, 3)
    ahead = clip_to_front(ends, camera) if len(ends) else ends
    return project_points(ahead.reshape(-1, 3), camera).reshape(-1, 4)


def _width(layer: Canvas) -> float:
    return max(1.0, WIDTH * layer.em)


def select_numbered_edges(box: list[Edge], subject: AnnotatedSubject, camera: Camera) -> list[Edge]:
    """An outer edge of each axis in front of the eye, if any: the lower one, or the one farther left."""
    depth = camera.eye_from_points(subject.corners)[:, 2]
    result = []
    for axis in range(3):
        outer = [edge for edge in box if edge.axis == axis and edge.outer]
        outer = [edge for edge in outer if (depth[list(edge.corners)] > 0).all() or not camera.perspective]
        if outer:
            result.append(max(outer, key=lambda edge: float(outward_direction(edge, subject, camera) @ TOWARDS)))
    return result


def outward_direction(edge: Edge, subject: AnnotatedSubject, camera: Camera) -> np.ndarray:
    """Unit vector [2] in the image, across an edge and away from the box."""
    a, b = project_points(subject.corners[list(edge.corners)], camera)
    along = (b - a) / (float(np.hypot(*(b - a))) or 1.0)
    across = np.array([-along[1], along[0]])
    depth = camera.eye_from_points(subject.corners)[:, 2]
    corners = project_points(subject.corners[depth > 0] if camera.perspective else subject.corners, camera)
    return across if float((corners - a).mean(axis=0) @ across) < 0 else -across


def marks(subject: AnnotatedSubject, edge: Edge, camera: Camera, em: int) -> tuple[np.ndarray, list[str], str]:
    """World positions [N, 3] of an edge's ticks, their texts, and the name of the axis.

    Along a world axis the ticks are coordinates, those of the file if it has some, else lengths from the first corner
    along grid axis i, j or k.
    """
    first, second = subject.corners[list(edge.corners)]
    length = float(np.linalg.norm(second - first))
    unit = (second - first) / length
    world = int(np.abs(unit).argmax())
    straight = abs(unit[world]) > 1 - ALONG
    start, sign = (float(first[world]), float(np.sign(unit[world]))) if straight else (0.0, 1.0)
    known = subject.axes[world] if straight and subject.axes else AxisCoordinate("xyz"[world], subject.unit)
    low, high = sorted(known.offset + known.slope * place for place in (start, start + sign * length))
    factor, name = in_digits(max(abs(low), abs(high)), known.unit)
    shown = np.hypot(*np.subtract(*project_points(np.array([first, second]), camera)))
    most = min(MOST_TICKS, int(shown / (APART * em)))
    values = ticks(low * factor, high * factor, most) if most > 1 else []
    along = (np.array(values).reshape(-1, 1) / factor - known.offset) / (known.slope or 1.0)
    places = first + unit * ((along - start) * sign)
    letter = known.name if straight else "ijk"[edge.axis]
    return places, [f"{value:.6g}" for value in values], f"{letter}, {name}" if name else letter


def _number(layer: Canvas, subject: AnnotatedSubject, edge: Edge, camera: Camera) -> int:
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


TITLE, ABOUT_BOX = "the volume's box, with numbers", "The volume's box with numbers along its edges."
LINES = draw_edges, draw_behind


# colours of x, y, z, linear RGB, legible on black and on white
COLORS: tuple[Color, ...] = ((0.75, 0.04, 0.03), (0.02, 0.40, 0.04), (0.08, 0.22, 0.90))
# lengths of an axis and of its arrow head, in font heights
LONG, HEAD = 2.2, 0.55
# most letters of the file's name of an axis
MOST_LETTERS = 9
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
    names = [shorten_label(axis.name, MOST_LETTERS) for axis in view.subject.axes] or [*"xyz"]
    sizes = np.array([layer.text_size(name) for name in names])
    # a name of one letter is as wide as high
    wide = max(1.0, (sizes[:, 0].max() - 2 * layer.edge) / em)
    half = int(np.ceil(long + 1.3 * em))
    across = int(np.ceil(long + 1.3 * em * wide))
    (width, height), pad = layer.size, layer.pad
    right, bottom = width - pad - 2 * across, height - pad - 2 * half
    starts = [(pad, bottom), (right, bottom), (pad, pad)]
    place = layer.reserve([Rect(x, y, x + 2 * across, y + 2 * half) for x, y in starts], "axes")
    if place is None:
        return
    middle = np.array([place.left + across, place.top + half], np.float64)
    # of world x, y, z: right, down and away from the eye
    axes = view.camera.eye_from_world.T
    letters_at = middle + _apart(_ends(axes, em, wide), em) * (wide, 1)
    for axis in np.argsort(-axes[:, 2], kind="stable"):
        along, color = axes[axis, :2], COLORS[axis]
        reach = float(np.linalg.norm(along))
        tip = middle + along * long
        if reach > 1e-6:
            unit = along / reach
            side = np.array([-unit[1], unit[0]]) * 0.25 * em
            back = tip - unit * HEAD * em * min(1.0, reach * 2)
            layer.lines([[middle, back]], color)
            layer.polygon(np.array([tip, back + side, back - side]), color)
    for name, size, at, color in zip(names, sizes, letters_at, COLORS, strict=True):
        left = min(max(round(at[0] - size[0] / 2), place.left), place.right - size[0])
        layer.text(name, left, round(at[1] - size[1] / 2), color)


def _ends(axes: np.ndarray, em: int, wide: float) -> np.ndarray:
    """Places [3, 2] of the axes' names, from the triad's middle: past the tips, or beside an axis along the view. wide:
    width of a name over its height, by which x is divided.
    """
    reach = np.linalg.norm(axes[:, :2], axis=1)[:, None]
    unit = np.where(reach > 1e-6, axes[:, :2] / np.maximum(reach, 1e-12), np.array([0.7, -0.7]))
    return np.asarray(axes[:, :2] / (wide, 1) * LONG * em + unit * 0.7 * em)


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
        rect = Rect(rect.left + x, rect.top + y, rect.right + x, rect.bottom + y)
    return rect


ABOUT_AXES = "The directions of x, y and z, at the lower left."
ABOUT_LETTERS = "Letters of the patient's directions at the edges."


# linear RGB on dark and on light pictures
BRIGHT, DARK = (1.0, 0.694, 0.0732), (0.305, 0.0666, 0.0)
# diameters of dots, in widths of lines; the arc of an angle, as a share of its shorter side, and its number of segments
DOT, ARC, STEPS = 3.0, 0.3, 24


def measure_text(measure: Measure, subject: AnnotatedSubject) -> str:
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


def draw_measures(layer: Canvas, view: AnnotationView) -> None:
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


ABOUT_MEASURES = "The distances and angles of the scene."
ROWS = (
    Annotation("box", TITLE, ABOUT_BOX, draw_numbers, 6, "ctrl+j", lines=LINES, room=1.25),
    Annotation("axes", "axes", ABOUT_AXES, draw_triad, 4, "j", default=True),
    Annotation("directions", "directions", ABOUT_LETTERS, draw_directions, 5, "j", default=True, needs_frame=True),
    Annotation("measures", "distances and angles", ABOUT_MEASURES, draw_measures, 7),
)

"""Scale bar, and round numbers for bars and ticks."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from splatgl.annotations.canvas import Annotation, AnnotationView, Canvas, Rect, Subject
from splatgl.data.affine import METRES, metres_in, unit_name
from splatgl.geometry.camera import Camera

# longest bar as a fraction of the image's width
WIDEST = 0.25
# units that a length is converted to, ascending
LADDER = ("nm", "um", "mm", "m", "km")
# a length keeps the file's unit from 1 to below this
MOST = 1000.0
PERSPECTIVE = "at the centre's depth"


class BarScale(NamedTuple):
    """pixels: the bar's length; label: the world length."""

    pixels: float
    label: str


def scale_of(subject: Subject, camera: Camera) -> BarScale | None:
    """Scale bar of a view; None if the volume's centre is behind a perspective eye, or across axes of several units."""
    depth = float(camera.eye_from_points(subject.center)[2])
    lengths = subject.lengths(camera.eye_from_world[0])
    if (camera.perspective and not depth > 0) or lengths is None:
        return None
    pitch = float(camera.pixel_pitch(depth)) * lengths[0]
    length = nice_below(WIDEST * camera.size[0] * pitch)
    return BarScale(length / pitch, length_text(length, lengths[1]))


def length_text(length: float, unit: str) -> str:
    """A length with its unit, converted to a unit with fewer digits."""
    metres = metres_in(unit)
    if metres is None or (length * (1 + 1e-9) >= 1 and length < MOST):
        return f"{length:g} {_sign_of(unit)}".strip()
    fitting = [name for name in LADDER if length * metres >= METRES[name] * (1 - 1e-9)] or [LADDER[0]]
    return f"{length * metres / METRES[fitting[-1]]:.6g} {_sign_of(fitting[-1])}"


def _sign_of(unit: str) -> str:
    """The sign of a unit of length; other units stay."""
    return {"um": "µm"}.get(name := unit_name(unit), name)


def in_digits(length: float, unit: str) -> tuple[float, str]:
    """Factor from a unit to one in which a length has few digits, and the name of that unit."""
    metres = metres_in(unit)
    if metres is None or 1 <= length < MOST * 10 or not length > 0:
        return 1.0, _sign_of(unit)
    fitting = [name for name in LADDER if length * metres >= METRES[name]] or [LADDER[0]]
    return metres / METRES[fitting[-1]], _sign_of(fitting[-1])


def draw(layer: Canvas, view: AnnotationView) -> None:
    """Draws the scale bar at the lower right, or further left where the image is empty."""
    scale = scale_of(view.subject, view.camera)
    if scale is None:
        behind = view.subject.lengths(view.camera.eye_from_world[0]) is not None
        why = "the centre of the volume is behind the eye" if behind else "across the picture axes have several units"
        layer.notes.append(f"no scale bar: {why}")
        return
    labels = [PERSPECTIVE, scale.label] if view.camera.perspective else [scale.label]
    sizes = [layer.text_size(label) for label in labels]
    thick, (width, height) = max(2, round(layer.em / 5)), layer.size
    wide = max(scale.pixels + 2 * layer.edge, *(size[0] for size in sizes))
    tall = sum(size[1] for size in sizes) + thick + 2 * layer.edge
    wide, bottom = int(np.ceil(wide)) + 1, height - layer.pad
    ends = [width - layer.pad, (width + wide) // 2, layer.pad + wide]
    rect = layer.reserve([Rect(end - wide, bottom - tall, end, bottom) for end in ends], "scale bar")
    if rect is None:
        return
    right, top = rect.right, rect.top
    end = right - layer.edge
    for label, size in zip(reversed(labels), reversed(sizes), strict=True):
        # the label is centred over the bar, or ends with it if it is wider
        center = end - scale.pixels / 2 - size[0] / 2
        layer.text(label, min(round(center), right - size[0]), top)
        top += size[1]
    layer.bar(end - scale.pixels, end, top + layer.edge, top + layer.edge + thick)


ABOUT = "A length at the depth of the volume's middle, at the lower right."
ROWS = (Annotation("scale", "scale bar", ABOUT, draw, 3, "j", default=True),)
STEPS = (1.0, 2.0, 5.0)


def nice_below(length: float) -> float:
    """Largest of 1, 2, 5 · 10ⁿ that is at most a positive `length`."""
    power = math.floor(math.log10(length))
    # rounding may miss a power of ten
    lengths = [step * 10.0**n for n in (power - 1, power, power + 1) for step in STEPS]
    return max(candidate for candidate in lengths if candidate <= length * (1 + 1e-12))


def ticks(low: float, high: float, most: int) -> list[float]:
    """At most `most` (≥ 2) multiples of a round number from low to high; none for an empty range."""
    if not (high > low and math.isfinite(high - low)):
        return []
    step = nice_below((high - low) / most)
    while math.floor(high / step + 1e-9) - math.ceil(low / step - 1e-9) + 1 > most:
        step = nice_below(step * 2.5 * (1 + 1e-9))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [float(np.float64(f"{n * step:.12g}")) for n in range(first, last + 1)]


def log_ticks(low: float, high: float, most: int) -> list[float]:
    """At most `most` of 1, 2, 5 · 10ⁿ from low > 0 to high; if there are more, of every or every n-th power of ten."""
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    for steps, stride in [(STEPS, 1), *(((1.0,), n) for n in range(1, last - first + 2))]:
        powers = [n for n in range(first, last + 1) if n % stride == 0]
        values = [float(f"{step:g}e{n}") for n in powers for step in steps]
        values = [value for value in values if low * (1 - 1e-9) <= value <= high * (1 + 1e-9)]
        if len(values) <= most:
            return values
    return []

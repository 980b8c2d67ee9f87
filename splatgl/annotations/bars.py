"""Scale bar with round numbers, and colour bar: colours over the window and a curve of opacity, or sums."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from splatgl.annotations.canvas import VOXELS, AnnotatedSubject, Annotation, AnnotationView, Canvas, ColorScale, Rect
from splatgl.data.affine import METRES, metres_in, unit_name
from splatgl.data.color import Color, read_background
from splatgl.errors import expected
from splatgl.geometry.camera import Camera
from splatgl.transfer.colormaps import colormap
from splatgl.transfer.transfer import Transfer

# longest bar as a fraction of the image's width
WIDEST = 0.25
# units that a length is converted to, ascending
LADDER = ("nm", "um", "mm", "m", "km")
# a length keeps the file's unit from 1 to below this
MOST = 1000.0
PERSPECTIVE = "at the centre's depth"
# name of a unit that the data does not state
UNSTATED = "units"


class ScaleBar(NamedTuple):
    """The stated parts of a scale bar. length: with a unit, or of the world without; None: a round one. corner: one of
    CORNERS. thickness: pixels. color: linear RGB.
    """

    length: float | None = None
    unit: str = ""
    corner: str = ""
    thickness: int | None = None
    color: Color | None = None

    @classmethod
    def parse(cls, text: str) -> ScaleBar:
        """The bar of LENGTH:CORNER:THICKNESS:COLOUR, in any order, such as 20um:bottom-left:4px:white. Raises
        InputError for other text.
        """
        found: dict[str, Any] = {}
        for part in filter(None, text.split(":")):
            length = re.fullmatch(r"(\d+\.?\d*|\.\d+) *(\D*)", part)
            if part in CORNERS:
                new: dict[str, Any] = {"corner": part}
            elif length and length[2] == "px" and float(length[1]) >= 1:
                new = {"thickness": round(float(length[1]))}
            elif length and length[2] != "px" and 0 < float(length[1]) < np.inf:
                new = {"length": float(length[1]), "unit": length[2]}
            else:
                try:
                    new = {"color": read_background(part)}
                except ValueError:
                    new = {}
            is_wrong = isinstance(new.get("color"), str) or (new.get("unit") and metres_in(new["unit"]) is None)
            if not new or is_wrong or found.keys() & new.keys():
                raise expected("annotate", f"scale={ABOUT_PARTS}", repr(f"scale={text}"))
            found |= new
        return cls(**found)

    def length_in(self, unit: str) -> float | None:
        """The stated length in a unit; None where none is stated, or the unit is no length."""
        ours, theirs = metres_in(self.unit), metres_in(unit)
        if self.length is None or not self.unit:
            return self.length
        return None if ours is None or theirs is None else self.length * ours / theirs


CORNERS = ("bottom-right", "bottom-left", "top-right", "top-left", "bottom")
ABOUT_PARTS = "LENGTH:CORNER:THICKNESS:COLOUR, such as 20um:bottom-left:4px:white; corners: " + ", ".join(CORNERS)


def scale_of(subject: AnnotatedSubject, camera: Camera, stated: ScaleBar | None = None) -> tuple[float, str] | None:
    """The length of a view's scale bar in pixels, and its label; None if the volume's centre is behind a perspective
    eye, or across axes of several units.
    """
    depth = float(camera.eye_from_points(subject.center)[2])
    lengths = subject.lengths(camera.eye_from_world[0])
    if (camera.perspective and not depth > 0) or lengths is None:
        return None
    pitch = float(camera.pixel_pitch(depth)) * lengths[0]
    length = (stated and stated.length_in(lengths[1])) or nice_below(WIDEST * camera.size[0] * pitch)
    return length / pitch, length_text(length, lengths[1] or UNSTATED)


def length_text(length: float, unit: str) -> str:
    """A length with its unit, converted to a unit with fewer digits."""
    metres = metres_in(unit)
    if metres is None or (length * (1 + 1e-9) >= 1 and length < MOST):
        return f"{length:g} {_sign_of(unit)}".strip()
    fitting = [name for name in LADDER if length * metres >= METRES[name] * (1 - 1e-9)] or [LADDER[0]]
    return f"{length * metres / METRES[fitting[-1]]:.6g} {_sign_of(fitting[-1])}"


def _sign_of(unit: str) -> str:
    """The sign of a unit of length; other units stay."""
    return {"um": "µm"}.get(name := unit if unit == VOXELS else unit_name(unit), name)


def in_digits(length: float, unit: str) -> tuple[float, str]:
    """Factor from a unit to one in which a length has few digits, and the name of that unit."""
    metres = metres_in(unit)
    if metres is None or 1 <= length < MOST * 10 or not length > 0:
        return 1.0, _sign_of(unit)
    fitting = [name for name in LADDER if length * metres >= METRES[name]] or [LADDER[0]]
    return metres / METRES[fitting[-1]], _sign_of(fitting[-1])


def draw_scale_bar(layer: Canvas, view: AnnotationView) -> None:
    """Draws the scale bar at the lower right, or further left where the image is empty, or in the stated corner."""
    stated = ScaleBar.parse(view.text)
    scale = scale_of(view.subject, view.camera, stated)
    if scale is None:
        behind = view.subject.lengths(view.camera.eye_from_world[0]) is not None
        why = "the centre of the volume is behind the eye" if behind else "across the picture axes have several units"
        layer.notes.append(f"no scale bar: {why}")
        return
    length = stated.length_in((view.subject.lengths(view.camera.eye_from_world[0]) or (0, ""))[1])
    if stated.length is not None and length is None:
        layer.notes.append(
            f"no scale bar of {stated.length:g} {stated.unit}: the data does not state its unit of length"
        )
        return
    # a window states it in a tooltip
    is_stated = view.camera.perspective and view.pixels is not None
    (pixels, label), labels = scale, [PERSPECTIVE] * is_stated
    labels.append(label)
    sizes = [layer.text_size(label) for label in labels]
    thick, (width, height) = stated.thickness or max(2, round(layer.em / 5)), layer.size
    wide = max(pixels + 2 * layer.edge, *(size[0] for size in sizes))
    tall = sum(size[1] for size in sizes) + thick + 2 * layer.edge
    wide, bottom = int(np.ceil(wide)) + 1, height - layer.pad
    ends = [width - layer.pad, (width + wide) // 2, layer.pad + wide]
    if stated.corner:
        ends = [ends[("right", "bottom", "left").index(stated.corner.rpartition("-")[2])]]
        bottom = layer.pad + tall if stated.corner.startswith("top") else bottom
    rect = layer.reserve([Rect(end - wide, bottom - tall, end, bottom) for end in ends], "scale bar")
    if rect is None:
        return
    right, top = rect.right, rect.top
    end = right - layer.edge
    for label, size in zip(reversed(labels), reversed(sizes), strict=True):
        # the label is centred over the bar, or ends with it if it is wider
        center = end - pixels / 2 - size[0] / 2
        layer.text(label, min(round(center), right - size[0]), top, stated.color)
        top += size[1]
    layer.bar(end - pixels, end, top + layer.edge, top + layer.edge + thick, stated.color)


ABOUT_SCALE = "A length at the depth of the volume's middle, at the lower right."
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


# the bar's height as a fraction of the image's shorter side; widths of the bar and the curve in font heights
TALL, WIDE, CURVE = 0.45, 0.9, 1.6
MOST_TICKS = 6
# letters of a title, and those where there is less room
MOST_LETTERS, FEW_LETTERS = 20, 10
# radius of what a volume fills in its first view, as a share of the image's shorter side
FILLED = 0.43
# height of the axes at the lower left, in font heights
AXES = 7.2
STATISTICS = {"mip": "maximum", "minip": "minimum", "mean": "mean"}


@dataclass(frozen=True, eq=False)
class ColorBar:
    """low, high: values at the ends. colors [N, 4]: linear RGB and coverage, straight, from high to low. opacity:
    of each row, or None. logarithmic: whether rows are even in the logarithm of the value.
    """

    low: float
    high: float
    colors: np.ndarray
    opacity: np.ndarray | None
    label: str
    logarithmic: bool = False

    def down(self, value: float) -> float:
        """Position of a value: 0 at the upper end, 1 at the lower end."""
        if self.logarithmic:
            return math.log(self.high / value) / math.log(self.high / self.low)
        return (self.high - value) / (self.high - self.low)

    def marks(self) -> list[float]:
        """Values written next to the bar."""
        return (log_ticks if self.logarithmic else ticks)(self.low, self.high, MOST_TICKS)


@lru_cache(maxsize=4)
def of_values(transfer: Transfer, name: str, blend: str, rows: int) -> ColorBar | None:
    """Bar of classified values, at the centres of `rows`; None for a window of a single value."""
    low, high = transfer.color_range
    if not (high > low and np.isfinite(high - low)):
        return None
    down = (np.arange(rows) + 0.5) / rows
    values = high * (low / high) ** down if transfer.logarithmic else high - down * (high - low)
    colors = np.concatenate([transfer.color(values), np.ones((rows, 1))], axis=-1)
    about = STATISTICS.get(blend, "")
    label = f"{about} of {name}" if about and name else about or name or "value"
    opacity = None if transfer.is_clear else transfer.opacity(values)
    return ColorBar(low, high, colors, opacity, label, transfer.logarithmic)


def of_scale(scale: ColorScale, rows: int) -> ColorBar:
    """Bar of a mesh's values."""
    down = (np.arange(rows) + 0.5) / rows
    table = colormap(scale.colormap)
    at = (1 - down) * (len(table) - 1)
    colors = np.stack([np.interp(at, np.arange(len(table)), channel) for channel in table.T] + [np.ones(rows)], axis=-1)
    return ColorBar(scale.low, scale.high, colors, None, scale.label or "value")


def of_sums(pixels: np.ndarray, scale: float, rows: int) -> ColorBar | None:
    """Bar of an X-ray image scaled by `scale`, in the image's mean colour; None for an empty image."""
    depth = float(pixels[..., 3].sum(dtype=np.float64))
    if not depth > 0:
        return None
    color = pixels[..., :3].sum(axis=(0, 1), dtype=np.float64) / depth
    share = 1 - (np.arange(rows) + 0.5) / rows
    colors = np.concatenate([np.broadcast_to(color, (rows, 3)), share[:, None]], axis=-1)
    return ColorBar(0.0, 1 / scale, colors, None, "optical depth")


def draw_color_bar(layer: Canvas, view: AnnotationView) -> None:
    """Draws the colour bars at the right, or at the left where the image is empty only there; with a shorter title, and
    without the curve of opacity, where there is less room.
    """
    for bar in _bars(layer, view):
        parts = dict[Rect, Canvas]()
        for most, has_curve in ((MOST_LETTERS, True), (FEW_LETTERS, True), (FEW_LETTERS, bool(view.text))):
            part = _draw_bar(bar, layer.em, layer.ink, bool(view.text), most, has_curve)
            (wide, tall), right = part.size, layer.size[0] - layer.pad - part.size[0]
            top = (layer.size[1] - len(bar.colors)) // 2 - layer.text_size("")[1] - layer.em // 2
            over_axes = layer.size[1] - 2 * layer.pad - AXES * layer.em - tall
            for left, high in (
                (right, top),
                (layer.pad, max(min(top, round(over_axes)), layer.pad)),
                (right, layer.pad),
            ):
                parts.setdefault(Rect(left, high, left + wide, high + tall), part)
        place = layer.reserve(sorted(parts, key=lambda rect: _covers(layer, rect)), "colour bar")
        if place is not None:
            layer.add(parts[place], (place.left, place.top))


def _covers(layer: Canvas, rect: Rect) -> float:
    """How much of the image a rectangle covers: non-empty pixels; without an image, the depth in pixels to which it
    lies in the disc that a whole volume fills.
    """
    if layer.picture is not None:
        return layer.covered(rect)
    x, y = (size / 2 for size in layer.size)
    near = max(rect.left - x, x - rect.right, 0), max(rect.top - y, y - rect.bottom, 0)
    return max(FILLED * min(layer.size) - math.hypot(*near), 0.0)


def check_color_bar(text: str) -> None:
    """Raises InputError for another text than opacity, which states the largest."""
    if text not in ("", "opacity"):
        raise expected("annotate", "colorbar, or colorbar=opacity to state the largest", f"colorbar={text}")


def _bars(layer: Canvas, view: AnnotationView) -> list[ColorBar]:
    """Colour bars of the volume and of meshes; adds a note if the volume has none."""
    subject, rows = view.subject, round(TALL * min(layer.size))
    of_meshes = [of_scale(scale, rows) for scale in subject.scales]
    if of_meshes and (subject.empty or view.transfer.is_clear):
        return of_meshes
    bar = bar_of(view, rows)
    if bar is None:
        owner = "segments" if view.transfer.labels else "voxels" if subject.colored else ""
        owner = owner or "surfaces" * view.transfer.is_clear
        why = f"the {owner} have colours of their own" if owner else "there is one value only"
        layer.notes.append(f"no colour bar: {why}" if view.pixels is not None else "no colour bar of this picture")
    return of_meshes if bar is None else [bar, *of_meshes]


def bar_of(view: AnnotationView, rows: int) -> ColorBar | None:
    """Colour bar of the volume; None for volumes with colours, segments, a single value, surfaces in colours of their
    own, and for sums in live views.
    """
    if view.subject.colored or view.transfer.labels:
        return None
    if view.blend.startswith("xray"):
        return None if view.pixels is None else of_sums(view.pixels, view.scale, rows)
    if view.transfer.is_clear and all(surface.color for surface in view.transfer.iso):
        return None
    return of_values(view.transfer, view.subject.value_name, view.blend, rows)


# most rows of a legend
MOST_ROWS = 24


def draw_legend(layer: Canvas, view: AnnotationView) -> None:
    """Draws names beside their colours, at the left or right, where the image is empty and no letter or axis is."""
    rows = view.subject.legend
    if not rows:
        layer.notes.append("no legend: there is one layer only, without segments")
        return
    shown = rows if len(rows) <= MOST_ROWS else rows[: MOST_ROWS - 1]
    texts = [shorten_label(name) for name, _ in shown] + [f"{len(rows) - len(shown)} more"] * (len(shown) < len(rows))
    sizes, gap = [layer.text_size(text) for text in texts], layer.em // 2
    wide, tall = layer.em + gap + max(size[0] for size in sizes), sum(size[1] for size in sizes)
    (width, height), pad = layer.size, layer.pad
    middles = [round(share * height - tall / 2) for share in (0.5, 0.25, 0.75)]
    ends = [(x, y) for x in (pad, width - pad - wide) for y in (pad, height - pad - tall, *middles)]
    place = layer.reserve([Rect(x, y, x + wide, y + tall) for x, y in ends], "legend")
    if place is None:
        return
    left, top = place.left, place.top
    for text, size, (_, code) in zip(texts, sizes, (*shown, ("", "")), strict=False):
        if code:
            color = read_background(code)
            assert not isinstance(color, str)
            inset = max((size[1] - layer.em) // 2, layer.edge)
            layer.bar(left + layer.edge, left + layer.em, top + inset, top + size[1] - inset, color)
        layer.text(text, left + layer.em + gap, top)
        top += size[1]


ABOUT_COLORS = "The colours and opacities of values."
ABOUT_LEGEND = "Names of channels, layers and segments in their colours."
ROWS = (
    Annotation(
        *("scale", "scale bar", ABOUT_SCALE, draw_scale_bar, 3, "j"), default=True, example="20um", check=ScaleBar.parse
    ),
    Annotation("legend", "legend", ABOUT_LEGEND, draw_legend, 6, "alt+j"),
    Annotation(
        *("colorbar", "colour bar", ABOUT_COLORS, draw_color_bar, 2, "shift+j"),
        needs_values=True,
        example="opacity",
        check=check_color_bar,
    ),
)


@lru_cache(maxsize=8)
def _draw_bar(bar: ColorBar, em: int, ink: Color, has_opacity: bool, most: int, has_curve: bool) -> Canvas:
    """Bar with numbers and curve; a row of the bar is a pixel high. has_opacity: whether the curve's end is written.
    most: letters of the title. has_curve: of opacity, if the bar has one.
    """
    sizes = Canvas(np.zeros((1, 1, 4), np.float32), ink, font=em)
    rows, edge, opacity = len(bar.colors), sizes.edge, bar.opacity if has_curve else None
    label = shorten_label(bar.label, most)
    marks = bar.marks()
    texts = [f"{mark:g}" for mark in marks]
    line = sizes.text_size(label)[1]
    beside = max((sizes.text_size(text)[0] for text in texts), default=0) + em // 2
    wide, curve = round(WIDE * em), round(CURVE * em) if opacity is not None else 0
    below = "" if opacity is None or not has_opacity else f"opacity to {opacity.max():.3g}"
    right = max(sizes.text_size(label)[0], sizes.text_size(below)[0], beside + wide + curve + 2 * edge)
    top, left = line + em // 2, right - beside - wide
    tall = top + rows + (em // 2 + line if below else line // 2 + edge)
    layer = Canvas(np.zeros((tall, right, 4), np.float32), ink, font=em, marks=[])
    a, b, c, d = left - 0.5, top - 0.5, left + wide + 0.5, top + rows + 0.5
    layer.lines([[(a, b), (c, b), (c, d), (a, d), (a, b)]])
    layer.clear(Rect(left, top, left + wide, top + rows))
    shape = (rows, wide)
    cover = np.broadcast_to(bar.colors[:, None, 3].astype(np.float32), shape)
    layer.blend_mask(cover, np.broadcast_to(bar.colors[:, None, :3], (*shape, 3)), (left, top))
    layer.text(label, right - layer.text_size(label)[0], 0)
    for mark, text in zip(marks, texts, strict=True):
        y = top + bar.down(mark) * rows
        layer.lines([[(left + wide, y), (left + wide + em / 3, y)]])
        layer.text(text, left + wide + em // 2, round(y) - line // 2)
    if opacity is not None:
        highest = float(opacity.max()) or 1.0
        x = left - 2 * edge - opacity / highest * (curve - 4 * edge)
        layer.lines([list(np.stack([x, top + np.arange(rows) + 0.5], axis=-1))])
        layer.text(below, right - layer.text_size(below)[0], top + rows + em // 2)
    return layer


def shorten_label(label: str, most: int = MOST_LETTERS) -> str:
    """A label of at most so many letters: the name is cut, its unit stays where it leaves room for half of them."""
    _, comma, unit = label.rpartition(", ")
    end = f"...{comma}{unit}" if comma and len(unit) < most // 2 - 5 + 1 else "..."
    return label if len(label) <= most else label[: most - len(end)] + end

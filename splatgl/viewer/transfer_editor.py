"""Editors of a transfer function by mouse: curve of opacity, bar of colours, list of iso-surfaces, and regions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from imgui_bundle import imgui, implot
from numpy.typing import ArrayLike

from splatgl.annotations.text import plain
from splatgl.data.color import srgb_from_linear, srgb_of_name
from splatgl.data.volume import Volume
from splatgl.splat.extract_values import gradients
from splatgl.transfer.presets import SURFACE
from splatgl.transfer.regions import ENDLESS, MOST_ISO, MOST_REGIONS, Iso, Region
from splatgl.transfer.statistics import Statistics, statistics
from splatgl.transfer.transfer import Nodes, Transfer
from splatgl.transfer.transfer_nodes import SHAPES, ColorPoints, color_points, shape_nodes, shape_of, with_color_points
from splatgl.viewer.panel_sections import label_left, pick_color, pick_opacity, show_tip

# number of colours in the strip; radius of a point at a content scale of 1, screen units
COLORS, COLOR_POINT = 64, 5.0
PICKER = "##color of a value"
COLOR_HINT = (
    "double click for a colour here; click a point to recolour it; drag moves, right click or ctrl+click removes"
)
# values with their opacities or colours, in order
Points = Sequence[Any]


def code_of(color: np.ndarray | list[float]) -> str:
    """#rrggbb of sRGB from 0 to 1."""
    return "#" + bytes(np.rint(255 * np.clip(color, 0.0, 1.0)).astype(np.uint8)).hex()


def move_point(points: Points, number: int, value: float, other: float | str) -> Points:
    """The points with one at another value, between its neighbours. other: its opacity or colour."""
    low = points[number - 1][0] if number else -np.inf
    high = points[number + 1][0] if number + 1 < len(points) else np.inf
    return (*points[:number], (float(np.clip(value, low, high)), other), *points[number + 1 :])


def add_point(points: Points, value: float, other: float | str) -> tuple[Points, int]:
    """The points with one more, and its number."""
    number = int(np.searchsorted([value for value, _ in points], value))
    return (*points[:number], (value, other), *points[number:]), number


def remove_point(points: Points, number: int) -> Points:
    """The points without one; the last one is never removed."""
    return points if len(points) == 1 else (*points[:number], *points[number + 1 :])


class ColorStrip:
    """Colour-bar editor; keeps its state between frames. span: values at its ends; room: its left end and width, screen
    units.
    """

    def __init__(self) -> None:
        self.span, self.room = (0.0, 1.0), (0.0, 1.0)
        # the drawn colours, and their key
        self.colored: object = None
        self.colors: list[imgui.ImVec4] = []
        # points as they were edited, and the transfer function that has them: text would round them in each frame
        self.made: Transfer | None = None
        self.points: ColorPoints = ()
        # the point whose colour is picked, and whether the held one was moved
        self.picked, self.moved = 0, False

    def draw(self, transfer: Transfer, span: tuple[float, float], room: tuple[float, float], high: float) -> Transfer:
        """The strip, so high; returns the edited transfer function."""
        self.span, self.room, top = span, room, imgui.get_cursor_screen_pos().y
        self._paint(transfer, top, high)
        points = self.points if transfer == self.made else color_points(transfer)
        edited = self._edit_points(points, top, high)
        imgui.set_cursor_screen_pos((room[0], top))
        imgui.invisible_button("##colors", (room[1], high))
        if imgui.is_item_hovered():
            value = self._pointed
            show_tip(f"{value:.4g}\n{COLOR_HINT}", True)
            if edited is points and imgui.is_mouse_double_clicked(imgui.MouseButton_.left):
                color = srgb_from_linear(np.clip(transfer.color(np.array(value)), 0.0, 1.0))
                edited, _ = add_point(points, value, code_of(color))
        edited = self._pick(edited)
        if edited is points:
            return transfer
        self.made, self.points = with_color_points(transfer, edited), edited
        return self.made

    @property
    def _pointed(self) -> float:
        """The value under the cursor."""
        share = np.clip((imgui.get_mouse_pos().x - self.room[0]) / self.room[1], 0.0, 1.0)
        return float(self.span[0] + share * (self.span[1] - self.span[0]))

    def _paint(self, transfer: Transfer, top: float, high: float) -> None:
        """Draws the colours."""
        if (transfer, self.span) != self.colored:
            values = self.span[0] + (np.arange(COLORS) + 0.5) / COLORS * (self.span[1] - self.span[0])
            colors = srgb_from_linear(np.clip(transfer.color(values), 0.0, 1.0))
            self.colors = [imgui.ImVec4(*(float(part) for part in (*rgb, 1.0))) for rgb in colors]
            self.colored = transfer, self.span
        pen, step = imgui.get_window_draw_list(), self.room[1] / COLORS
        for number, color in enumerate(self.colors):
            left = self.room[0] + number * step
            corners = imgui.ImVec2(left, top), imgui.ImVec2(left + step + 1, top + high)
            pen.add_rect_filled(*corners, int(imgui.get_color_u32(color)))

    def _edit_points(self, points: ColorPoints, top: float, high: float) -> ColorPoints:
        """The points after mouse input; draws those within the span."""
        radius, edited, (left, wide) = COLOR_POINT * imgui.get_style().font_scale_main, points, self.room
        for number, (value, code) in enumerate(points):
            place = left + (value - self.span[0]) / (self.span[1] - self.span[0]) * wide
            if not left <= place <= left + wide:
                continue
            imgui.set_cursor_screen_pos((place - radius, top))
            imgui.invisible_button(f"##color {number}", (2 * radius, high))
            self._mark(place, top + high / 2, radius, code)
            if edited is points:
                edited = self._edit_point(points, number)
        return edited

    def _edit_point(self, points: ColorPoints, number: int) -> ColorPoints:
        """The points after input to the last widget, one of them."""
        removes = imgui.is_item_clicked(imgui.MouseButton_.right)
        removes |= imgui.get_io().key_ctrl and imgui.is_item_clicked(imgui.MouseButton_.left)
        if removes:
            return remove_point(points, number)
        if imgui.is_item_activated():
            self.moved = False
        if imgui.is_item_active() and imgui.is_mouse_dragging(imgui.MouseButton_.left):
            self.moved = True
            return move_point(points, number, self._pointed, points[number][1])
        if imgui.is_item_deactivated() and not self.moved:
            self.picked = number
            imgui.open_popup(PICKER)
        if imgui.is_item_hovered():
            show_tip(f"{points[number][0]:.5g}: {points[number][1]}", True)
        return points

    def _mark(self, x: float, y: float, radius: float, code: str) -> None:
        pen = imgui.get_window_draw_list()
        rgb = [part / 255 for part in bytes.fromhex(code[1:])]
        for size, color in ((radius, (0.0, 0.0, 0.0)), (radius - 1, (1.0, 1.0, 1.0)), (radius - 2, tuple(rgb))):
            pen.add_circle_filled(imgui.ImVec2(x, y), size, int(imgui.get_color_u32(imgui.ImVec4(*color, 1.0))))

    def _pick(self, points: ColorPoints) -> ColorPoints:
        """The points after input to the picker of a colour and its value, if it is open."""
        if not imgui.begin_popup(PICKER):
            return points
        number = min(self.picked, len(points) - 1)
        rgb = [part / 255 for part in bytes.fromhex(points[number][1][1:])]
        changed, color = imgui.color_picker3("##color", rgb, imgui.ColorEditFlags_.no_side_preview)
        if changed:
            points = move_point(points, number, points[number][0], code_of(list(color)))
        step = (self.span[1] - self.span[0]) / (4 * COLORS)
        moved, value = imgui.drag_float("value", points[number][0], step, format="%.5g")
        points = move_point(points, number, value, points[number][1]) if moved else points
        if imgui.button("one more"):
            following = points[number + 1][0] if number + 1 < len(points) else self.span[1]
            points, _ = add_point(points, (points[number][0] + following) / 2, points[number][1])
        show_tip("Adds a point of this colour, halfway to the next one.")
        imgui.same_line()
        if imgui.button("remove"):
            points = remove_point(points, number)
            imgui.close_current_popup()
        imgui.end_popup()
        return points


# opacities up to this take about as much of the axis as each decade above
FINE = 0.01
# opacities with tick labels
TICKS = (0.0, 0.01, 0.03, 0.1, 0.3, 1.0)
# points of the drawn line between two nodes
SAMPLES = 16
BINS = 128
# pixels of a drag over the whole of an axis
STEPS = 300
# percentiles of the values for the initial range
ENDS = (0.0, 99.95)


def axis_from_opacity(opacity: ArrayLike) -> np.ndarray:
    """Opacity to height as a fraction of the axis: linear near zero, logarithmic above FINE."""
    return np.asarray(np.arcsinh(np.asarray(opacity, np.float64) / FINE) / np.arcsinh(1.0 / FINE))


def opacity_from_axis(height: float) -> float:
    """Inverse of `axis_from_opacity`: height fraction to opacity; 0 and 1 are exact."""
    return float(np.clip(np.sinh(height * np.arcsinh(1.0 / FINE)) * FINE, 0.0, 1.0)) if height < 1.0 else 1.0


def line(transfer: Transfer, low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
    """Values [n] and heights [n] of the curve from low to high: straight in opacity, constant beyond its ends."""
    nodes = transfer.points
    ends = ((min(low, nodes[0][0]), nodes[0][1]), *nodes, (max(high, nodes[-1][0]), nodes[-1][1]))
    share = np.linspace(0.0, 1.0, SAMPLES)[:, None]
    pieces = [np.array(start) * (1.0 - share) + np.array(stop) * share for start, stop in pairwise(ends)]
    values, opacities = np.concatenate(pieces).T
    if transfer.logarithmic:
        opacities = transfer.opacity(values)
    return np.ascontiguousarray(values), axis_from_opacity(opacities)


def value_range(stats: Statistics) -> tuple[float, float]:
    """Initial range of the axis of values."""
    if stats.constant:
        value = float(stats.values[0]) if len(stats.values) else 0.0
        return value - 0.5, value + 0.5
    low, high = (stats.percentile(end) for end in ENDS)
    return (low, high) if low < high else (float(stats.values[0]), float(stats.values[-1]))


def histogram(stats: Statistics, low: float, high: float, logarithmic: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Edges [n + 1] and heights [n] in [0, 1] of the values' counts between low and high.

    For integer values, every bin covers the same number of them. logarithmic: heights by the counts' logarithms.
    """
    edges = np.linspace(low, high, BINS + 1)
    if len(stats.values) and (stats.values[:: 1 + len(stats.values) // 1000] % 1 == 0).all():
        step = max(1.0, np.ceil((high - low) / BINS))
        edges = np.arange(np.floor(low), high + step, step)
    counts, _ = np.histogram(stats.values, edges)
    heights = np.log1p(counts) if logarithmic else counts
    return edges, np.asarray(heights / max(float(heights.max()), 1e-9))


# screen units at a content scale of 1: height of the plot, of the strip of colours below it, radius of a point
HEIGHT, STRIP, POINT = 165.0, 10.0, 5.0
BY_POINTS = "by points"
# share of the fields of a point that its number takes, as its opacity does
NUMBER = 0.29
# range of the axis of opacities, with room for points at its ends
ROOM = (-0.05, 1.05)
HISTOGRAM, LINE, NODE = (0.5, 0.5, 0.55, 0.6), (0.95, 0.6, 0.15, 1.0), (1.0, 0.7, 0.3, 1.0)
HINT = "drag a point; double click for a new one; right click or ctrl+click removes; the wheel zooms, a drag moves"


def plot_ends() -> tuple[float, float]:
    """Top and bottom of the plot that is drawn, with the numbers of its axis, screen units."""
    top = implot.get_plot_pos().y
    return top, top + implot.get_plot_size().y + imgui.get_text_line_height_with_spacing()


class CurveEditor:
    """Draws the opacity curve and keeps its range of values and its histogram."""

    def __init__(self) -> None:
        self.volume: object = None
        self.stats: Statistics | None = None
        self.logarithmic = True
        self.range = (0.0, 1.0)
        self.bars = (np.zeros(2), np.zeros(1))
        # whether to show the whole range in the next frame
        self.fits = True
        self.dragged: int | None = None
        self.strip = ColorStrip()
        # number of the point whose fields are shown
        self.point = 0
        # left, top, width and height of the plot, screen units
        self.box = (0.0, 0.0, 1.0, 1.0)

    def statistics_of(self, volume: Volume) -> Statistics:
        """Statistics of the displayed volume's values, computed once."""
        if self.stats is None or self.volume is not volume:
            self.volume, self.stats = volume, statistics(volume)
            self._whole()
        return self.stats

    def draw(self, transfer: Transfer, volume: Volume) -> Transfer:
        """The plot, its strip of colours and its switches; returns the edited transfer function."""
        stats, scale = self.statistics_of(volume), imgui.get_style().font_scale_main
        points = transfer.points
        quiet = implot.Flags_.canvas_only | implot.Flags_.no_frame
        # a mouse edits it; keys the fields below
        imgui.push_item_flag(imgui.ItemFlags_.no_nav, True)
        if implot.begin_plot("##curve", imgui.ImVec2(-1.0, HEIGHT * scale), quiet):
            self._axes(volume)
            self._histogram(stats)
            values, heights = line(transfer, *self.range)
            implot.plot_line("##line", values, heights, implot.Spec(line_color=LINE, line_weight=2.0 * scale))
            points = self._points(points, scale)
            place, size = implot.get_plot_pos(), implot.get_plot_size()
            self.box = place.x, place.y, size.x, size.y
            implot.end_plot()
        imgui.pop_item_flag()
        colored = self.strip.draw(transfer, self.range, (self.box[0], self.box[2]), STRIP * scale)
        points = self._fields(points)
        changed, self.logarithmic = imgui.checkbox("log counts", self.logarithmic)
        show_tip("Bars by the logarithm of how many voxels have a value, or by the number.")
        if changed:
            self._count(*self.range)
        imgui.same_line()
        if imgui.button("all values"):
            self._whole()
        imgui.same_line()
        colored = self._shape(colored)
        return colored if points == transfer.points else with_points(transfer, points)

    def _shape(self, transfer: Transfer) -> Transfer:
        """List of the shapes of the curve; a chosen one takes its place."""
        # what no shape describes may be a preset, which nobody edited
        current = shape_of(transfer) or BY_POINTS
        names = list(dict.fromkeys([current, *SHAPES]))
        imgui.set_next_item_width(-1.0)
        changed, index = imgui.combo("##shape", 0, names)
        show_tip("Shape of the opacities between the first and the last point (--curve).")
        highest = transfer.points[-1][0] if self.stats is None else value_range(self.stats)[1]
        return with_shape(transfer, names[index], highest) if changed and names[index] in SHAPES else transfer

    def _axes(self, volume: Volume) -> None:
        fixed = implot.AxisFlags_.no_highlight | implot.AxisFlags_.no_side_switch
        implot.setup_axis(implot.ImAxis_.x1, volume.value_unit or None, fixed)
        implot.setup_axis(implot.ImAxis_.y1, "opacity", fixed | implot.AxisFlags_.lock)
        kind = implot.Cond_.always if self.fits else implot.Cond_.once
        self.fits = False
        implot.setup_axis_limits(implot.ImAxis_.x1, *self.range, kind)
        implot.setup_axis_limits(implot.ImAxis_.y1, *ROOM, implot.Cond_.always)
        ticks = [float(each) for each in axis_from_opacity(TICKS)]
        implot.setup_axis_ticks(implot.ImAxis_.y1, ticks, [f"{each:g}" for each in TICKS])
        implot.setup_finish()

    def _histogram(self, stats: Statistics) -> None:
        limits = implot.get_plot_limits().x
        if (limits.min, limits.max) != self.range and limits.min < limits.max:
            self._count(limits.min, limits.max)
        edges, bars = self.bars
        grey = implot.Spec(line_color=HISTOGRAM, fill_color=HISTOGRAM, flags=implot.StairsFlags_.shaded)
        implot.plot_stairs("##values", edges, np.append(bars, bars[-1:]), grey)

    def _points(self, points: Nodes, scale: float) -> Nodes:
        """The nodes after mouse input."""
        at, ctrl = implot.get_plot_mouse_pos(), imgui.get_io().key_ctrl
        pointed, dragged = None, None
        low, high = self.range
        for number, (value, opacity) in enumerate(points):
            # points outside the axis cannot be dragged
            if not low <= value <= high and number != self.dragged:
                continue
            options = number, value, float(axis_from_opacity(opacity)), NODE, POINT * scale, 0, False, False, False
            moved, x, y, _, over, down = implot.drag_point(*options)
            pointed, dragged = (number if over else pointed), (number if down and not ctrl else dragged)
            if moved and not ctrl:
                points = move_point(points, number, x, opacity_from_axis(y))
        self.dragged = dragged
        self.point = self.point if dragged is None else dragged
        hovered = implot.is_plot_hovered() or pointed is not None
        removes = imgui.is_mouse_clicked(imgui.MouseButton_.right) or (
            ctrl and imgui.is_mouse_clicked(imgui.MouseButton_.left)
        )
        if removes and pointed is not None:
            return remove_point(points, pointed)
        if hovered and pointed is None and imgui.is_mouse_double_clicked(imgui.MouseButton_.left):
            return add_point(points, at.x, opacity_from_axis(at.y))[0]
        shown = dragged if dragged is not None else pointed
        if shown is not None:
            show_tip(f"{points[shown][0]:.5g}: {points[shown][1]:.4g}", True, plot_ends())
        elif hovered:
            show_tip(f"{at.x:.4g}: {opacity_from_axis(at.y):.3g}\n{HINT}", True, plot_ends())
        return points

    def _fields(self, points: Nodes) -> Nodes:
        """Which point, its value and opacity, which keys edit, too, and what adds or removes one; returns the edited
        points.
        """
        count, style = len(points), imgui.get_style()
        self.point = min(self.point, count - 1)
        name, gap = label_left("point"), style.item_inner_spacing.x
        signs = 2 * (imgui.calc_text_size("+").x + 2 * style.frame_padding.x + gap)
        room = imgui.get_content_region_avail().x - signs - 2 * gap
        imgui.set_next_item_width(NUMBER * room)
        _, chosen = imgui.slider_int(name, self.point + 1, 1, count, f"%d/{count}")
        self.point = min(max(chosen, 1), count) - 1
        value, opacity = points[self.point]
        imgui.same_line(0.0, gap)
        imgui.set_next_item_width((1 - 2 * NUMBER) * room)
        moved, value = imgui.drag_float("##value", value, (self.range[1] - self.range[0]) / STEPS, format="%.5g")
        show_tip("Value of this point: drag, or ctrl+click.")
        imgui.same_line(0.0, gap)
        imgui.set_next_item_width(NUMBER * room)
        raised, height = imgui.drag_float(
            "##height", float(axis_from_opacity(opacity)), 1 / STEPS, 0.0, 1.0, f"{opacity:.3g}"
        )
        show_tip("Opacity of this point: drag.")
        if moved or raised:
            points = move_point(points, self.point, value, opacity_from_axis(height) if raised else opacity)
        return self._number(points, gap)

    def _number(self, points: Nodes, gap: float) -> Nodes:
        """Buttons that add a point between this one and its neighbour, and remove it."""
        here = self.point
        imgui.same_line(0.0, gap)
        imgui.begin_disabled(len(points) < 2)
        if imgui.button("+"):
            ends = points[here : here + 2] if here + 1 < len(points) else points[here - 1 :]
            between = np.mean(ends, axis=0).tolist()
            points, self.point = add_point(points, *between)
        show_tip("Adds a point next to this one.")
        imgui.same_line(0.0, gap)
        points = remove_point(points, here) if imgui.button("-", (-1.0, 0.0)) else points
        show_tip("Removes this point.")
        imgui.end_disabled()
        return points

    def _whole(self) -> None:
        """Shows all values."""
        if self.stats is not None:
            self._count(*value_range(self.stats))
            self.fits = True

    def _count(self, low: float, high: float) -> None:
        if self.stats is not None and low < high:
            self.range = low, high
            self.bars = histogram(self.stats, low, high, self.logarithmic)


def with_points(transfer: Transfer, points: Nodes) -> Transfer:
    """Replaces the nodes; the colour window is kept, even if it followed the first and last node."""
    window = transfer.color_range
    return replace(transfer, points=points, window=window if window[0] < window[1] else None)


def with_shape(transfer: Transfer, name: str, highest: float) -> Transfer:
    """The transfer function with opacities of a shape from its first to its last point, as high as they were; a step is
    in their middle, and shapes in place of one end at the `highest` value.
    """
    first, last = transfer.points[0][0], transfer.points[-1][0]
    last = last if first < last else max(highest, float(np.nextafter(first, np.inf)))
    if name == "step":
        first = float(np.sqrt(first * last)) if transfer.logarithmic else first / 2 + last / 2
    opacity = max(share for _, share in transfer.points) or SURFACE
    return with_points(transfer, shape_nodes(name, (first, last), opacity, transfer.scale))


# share of the panel's width that the value of a surface takes
VALUE = 0.34
# least distance of two surfaces, as a share of the range
APART = 1e-4


def draw_iso(transfer: Transfer, low: float, high: float) -> Transfer:
    """The section's controls; returns the edited transfer function. low, high: range of the values."""
    surfaces = list(transfer.iso)
    for number in range(len(surfaces)):
        imgui.push_id(f"iso {number}")
        edited = _draw_surface(transfer, number, (low, high))
        imgui.pop_id()
        surfaces[number : number + 1] = [] if edited is None else [edited]
        if edited is None:
            break
    imgui.begin_disabled(len(surfaces) >= MOST_ISO)
    if imgui.button("add a surface"):
        surfaces.append(Iso(_free_value([surface.value for surface in surfaces], low, high)))
    imgui.end_disabled()
    show_tip("The surface where the values cross a number. The curve above renders the values around it.")
    return transfer if tuple(surfaces) == tuple(transfer.iso) else replace(transfer, iso=surfaces)


def _draw_surface(transfer: Transfer, number: int, limits: tuple[float, float]) -> Iso | None:
    """Value, opacity and colour of a surface, and a button that removes it; None if it is removed."""
    surface, room = transfer.iso[number], imgui.get_content_region_avail().x
    spread = limits[1] - limits[0]
    imgui.set_next_item_width(room * VALUE)
    changed, value = imgui.drag_float("##value", surface.value, spread / STEPS, format="%.5g")
    show_tip("The value of the surface (--iso): drag, or ctrl+click.")
    if changed:
        # surfaces keep their order
        before = [other.value + APART * spread for other in transfer.iso[:number]]
        behind = [other.value - APART * spread for other in transfer.iso[number + 1 :]]
        value = float(f"{value:.6g}")
        surface = surface._replace(value=min(max([value, *before]), *behind, np.inf))
    surface = surface._replace(opacity=pick_opacity(surface.opacity, room))
    color = pick_color(surface.color or transfer.color(surface.value))
    surface = surface if color is None else surface._replace(color=color)
    imgui.same_line()
    return None if imgui.small_button("remove") else surface


def _free_value(values: list[float], low: float, high: float) -> float:
    """The middle of the widest gap between values and the ends of the range."""
    ends = np.unique([low, *np.clip(values, low, high), high])
    widest = int(np.diff(ends).argmax())
    return float(f"{(ends[widest] + ends[widest + 1]) / 2:.6g}")


# most voxels that are counted, and planes read of volumes that are not in memory
MOST, PLANES = 2**20, 32
# percentile of the gradients at the upper end
STEEP = 99.95
# columns and rows of the histogram
REGION_BINS = (128, 64)
# shapes that are added by mouse, and colours of regions one after the other
REGION_SHAPES = ("box", "triangle", "gaussian")
REGION_COLORS = ("#e8b04a", "#4aa3e8", "#e8574a", "#6ecb63", "#b57be0", "#e88fc0")
# opacity of a new region, and the shares of the plot between which it lies
OPACITY, BETWEEN = 0.3, (0.35, 0.65)
REGION_HINT = "drag a region's middle, sides or corners; the wheel zooms, a drag elsewhere pans"


@dataclass(frozen=True, eq=False)
class JointHistogram:
    """counts [rows, columns] of voxels: rows by gradient magnitude, values per world length, columns by value.
    gradients: limits of the rows, from 0 on.
    """

    counts: np.ndarray
    values: tuple[float, float]
    gradients: tuple[float, float]

    @classmethod
    def of(cls, volume: Volume, values: tuple[float, float], bins: tuple[int, int]) -> JointHistogram:
        """Counts a volume's voxels, at most about MOST, between two values. bins: columns and rows."""
        value, size = _pairs(volume)
        within = size[(value >= values[0]) & (value <= values[1])]
        top = float(np.percentile(within, STEEP)) if len(within) else 0.0
        top = top if top > 0 else 1.0
        counts, _, _ = np.histogram2d(size, value, bins[::-1], ((0.0, top), values))
        return cls(counts, values, (0.0, top))

    @property
    def heights(self) -> np.ndarray:
        """Logarithms of the counts over the largest one, from 0 to 1."""
        logs = np.log1p(self.counts)
        return np.asarray(logs / max(float(logs.max()), 1e-9))


def _pairs(volume: Volume) -> tuple[np.ndarray, np.ndarray]:
    """Values [N] and gradient magnitudes [N] of voxels with neighbours all around; every so many voxels."""
    depth = volume.shape[0]
    first = max((depth - PLANES) // 2, 0)
    whole = isinstance(volume.samples, np.ndarray)
    samples = np.ascontiguousarray(volume.samples if whole else volume.samples[first : first + PLANES])
    inner = np.array(samples.shape) - 2
    step = max(int(np.ceil((max(inner.prod(), 1) / MOST) ** (1 / 3))), 1)
    z, y, x = (axis.ravel() for axis in np.meshgrid(*(np.arange(1, n + 1, step) for n in inner), indexing="ij"))
    slope = gradients(samples, x, y, z, 2) @ np.linalg.inv(volume.world_from_index)
    value, size = samples[z, y, x].astype(np.float64), np.linalg.norm(slope, axis=1)
    known = np.isfinite(value) & np.isfinite(size)
    return value[known], size[known]


def rounded(number: float) -> float:
    """The number with the digits that a copied command has, so that it draws the same picture."""
    return float(f"{number:.6g}")


def add_region(transfer: Transfer, shape: str, plot: JointHistogram) -> Transfer:
    """The transfer function with a region in the middle of the plot, in the next colour."""
    low, high = BETWEEN
    (least, most), top = plot.values, plot.gradients[1]
    values = (rounded(least + (most - least) * low), rounded(least + (most - least) * high))
    sizes = (0.0 if shape == "triangle" else rounded(top * low), rounded(top * high))
    color = REGION_COLORS[len(transfer.regions) % len(REGION_COLORS)]
    return replace(transfer, regions=[*transfer.regions, Region(shape, values, sizes, color, OPACITY)])


def change_region(transfer: Transfer, number: int, region: Region | None) -> Transfer:
    """The transfer function with another region at a place; None: with none there."""
    regions = list(transfer.regions)
    regions[number : number + 1] = [] if region is None else [region]
    return replace(transfer, regions=regions)


def move_region(region: Region, values: tuple[float, float], sizes: tuple[float, float]) -> Region:
    """The region between other limits; ends that are endless stay, and limits that leave no room change nothing."""
    old = (*region.values, *region.gradients)
    new = [was if np.isinf(was) else rounded(now) for was, now in zip(old, (*values, *sizes), strict=True)]
    new[2] = max(new[2], 0.0)
    if not (new[0] < new[1] and new[2] < new[3]):
        return region
    return replace(region, values=tuple(new[:2]), gradients=tuple(new[2:]))


def without_curve(transfer: Transfer) -> Transfer:
    """The transfer function of the regions alone."""
    return replace(transfer, points=[(value, 0.0) for value, _ in transfer.points])


class RegionEditor:
    """Draws the joint histogram with the regions, and keeps the histogram."""

    def __init__(self) -> None:
        self.volume: object = None
        self.plot: JointHistogram | None = None
        self.heights = np.zeros((1, 1))

    def histogram_of(self, volume: Volume, stats: Statistics) -> JointHistogram:
        """Joint histogram of the displayed volume, computed once."""
        if self.plot is None or self.volume is not volume:
            self.volume, self.plot = volume, JointHistogram.of(volume, value_range(stats), REGION_BINS)
            # the first row is drawn on top
            self.heights = np.ascontiguousarray(self.plot.heights[::-1])
        return self.plot

    def draw(self, transfer: Transfer, volume: Volume, stats: Statistics) -> Transfer:
        """The plot, its regions and their list; returns the edited transfer function."""
        plot, scale = self.histogram_of(volume, stats), imgui.get_style().font_scale_main
        quiet = implot.Flags_.canvas_only | implot.Flags_.no_frame
        implot.push_colormap(implot.Colormap_.greys)
        if implot.begin_plot("##regions", imgui.ImVec2(-1.0, HEIGHT * scale), quiet):
            transfer = self._regions(transfer, plot, volume)
            implot.end_plot()
        implot.pop_colormap()
        transfer = self._buttons(transfer, plot)
        for number, region in enumerate(transfer.regions):
            changed = self._row(number, region)
            if changed is not region:
                return change_region(transfer, number, changed)
        return transfer

    def _regions(self, transfer: Transfer, plot: JointHistogram, volume: Volume) -> Transfer:
        """The histogram and the regions, after mouse input."""
        fixed = implot.AxisFlags_.no_highlight | implot.AxisFlags_.no_side_switch
        implot.setup_axis(implot.ImAxis_.x1, volume.value_unit or None, fixed)
        implot.setup_axis(implot.ImAxis_.y1, "gradient", fixed)
        implot.setup_axis_limits(implot.ImAxis_.x1, *plot.values)
        implot.setup_axis_limits(implot.ImAxis_.y1, *plot.gradients)
        implot.setup_finish()
        low, high = (implot.Point(plot.values[end], plot.gradients[end]) for end in (0, 1))
        # white is the first of the greys: dense is bright, as regions have bright colours
        implot.plot_heatmap("##joint", self.heights, 1.0, 0.0, "", low, high)
        for number, region in enumerate(transfer.regions):
            moved = _drag(number, region, plot)
            transfer = transfer if moved is region else change_region(transfer, number, moved)
        if implot.is_plot_hovered():
            at = implot.get_plot_mouse_pos()
            show_tip(f"value {at.x:.4g}, gradient {at.y:.4g}\n{REGION_HINT}", True, plot_ends())
        return transfer

    def _buttons(self, transfer: Transfer, plot: JointHistogram) -> Transfer:
        """Buttons that add regions and clear the curve."""
        for shape in REGION_SHAPES if len(transfer.regions) < MOST_REGIONS else ():
            if imgui.button(f"+ {shape}"):
                return add_region(transfer, shape, plot)
            show_tip(f"One more region: a {shape}.")
            imgui.same_line()
        if any(opacity > 0 for _, opacity in transfer.points):
            if imgui.button("regions alone"):
                return without_curve(transfer)
            show_tip("Takes the opacity of the curve over values away.")
        else:
            imgui.new_line()
        return transfer

    def _row(self, number: int, region: Region) -> Region | None:
        """Colour, opacity and a button that removes a region; returns the edited one, None if it is removed."""
        imgui.push_id(f"region {number}")
        room = imgui.get_content_region_avail().x
        imgui.align_text_to_frame_padding()
        imgui.text(plain(region.shape))
        if not region.is_image:
            color = pick_color(region.color)
            region = replace(region, color=color) if color and color != region.color else region
        opacity = pick_opacity(region.opacity, room)
        region = replace(region, opacity=opacity) if opacity != region.opacity else region
        imgui.same_line()
        removed = imgui.button("remove")
        imgui.pop_id()
        return None if removed else region


def _drag(number: int, region: Region, plot: JointHistogram) -> Region:
    """A region after mouse input, and its outline."""
    ends = np.clip([*region.values, *region.gradients], -ENDLESS, ENDLESS)
    # endless sides are drawn at the ends of the plot
    limits = (*plot.values, *plot.gradients)
    low, high, least, most = (
        float(limit if abs(end) >= ENDLESS else end) for end, limit in zip(ends, limits, strict=True)
    )
    rgb = (1.0, 1.0, 1.0) if region.is_image else tuple(part / 255 for part in srgb_of_name(region.color))
    color = imgui.ImVec4(*rgb, 1.0)
    moved, x1, y1, x2, y2, *_ = implot.drag_rect(number, low, least, high, most, color, 0, False, False, False)
    if region.shape == "triangle":
        xs, ys = np.array([low, (low + high) / 2, high]), np.array([most, least, most])
        implot.plot_line(f"##{number}", xs, ys, implot.Spec(line_color=color, line_weight=2.0))
    return move_region(region, (min(x1, x2), max(x1, x2)), (min(y1, y2), max(y1, y2))) if moved else region

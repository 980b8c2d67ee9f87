"""The curve of opacity over the histogram, its edits by mouse, and the list of iso-surfaces."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from imgui_bundle import imgui, implot
from numpy.typing import ArrayLike

from splatgl.data.color import linear_from_srgb, srgb_of_name
from splatgl.data.volume import Volume
from splatgl.transfer.presets import SURFACE
from splatgl.transfer.regions import MOST_ISO, Iso
from splatgl.transfer.statistics import Statistics, statistics
from splatgl.transfer.transfer import Nodes, Transfer
from splatgl.transfer.transfer_nodes import SHAPES, shape_nodes, shape_of
from splatgl.viewer.color_strip import ColorStrip, add_point, move_point, remove_point
from splatgl.viewer.panel_sections import label_left, pick_color, pick_opacity
from splatgl.viewer.preset_gallery import EDITED

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


def rise(opacity: ArrayLike) -> np.ndarray:
    """Opacity to height as a fraction of the axis: linear near zero, logarithmic above FINE."""
    return np.asarray(np.arcsinh(np.asarray(opacity, np.float64) / FINE) / np.arcsinh(1.0 / FINE))


def fall(height: float) -> float:
    """Inverse of `rise`: height fraction to opacity; 0 and 1 are exact."""
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
    return np.ascontiguousarray(values), rise(opacities)


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
HEIGHT, STRIP, POINT = 190.0, 10.0, 5.0
# range of the axis of opacities, with room for points at its ends
ROOM = (-0.05, 1.05)
HISTOGRAM, LINE, NODE = (0.5, 0.5, 0.55, 0.6), (0.95, 0.6, 0.15, 1.0), (1.0, 0.7, 0.3, 1.0)
HINT = "drag a point; double click for a new one; right click or ctrl+click removes; the wheel zooms, a drag moves"


class PointFields:
    """Numbers of one point of the curve, which keys edit, too. number: of the point."""

    def __init__(self) -> None:
        self.number = 0

    def draw(self, points: Nodes, spread: tuple[float, float]) -> Nodes:
        """Which point, its value and opacity, and what adds or removes one; returns the edited points. spread: range of
        the axis of values.
        """
        count, style = len(points), imgui.get_style()
        self.number = min(self.number, count - 1)
        name, gap = label_left("point"), style.item_inner_spacing.x
        signs = 2 * (imgui.calc_text_size("+").x + 2 * style.frame_padding.x + gap)
        wide = (imgui.get_content_region_avail().x - signs - 2 * gap) / 3
        imgui.set_next_item_width(wide)
        _, chosen = imgui.slider_int(name, self.number + 1, 1, count, f"%d of {count}")
        self.number = min(max(chosen, 1), count) - 1
        value, opacity = points[self.number]
        imgui.same_line(0.0, gap)
        imgui.set_next_item_width(wide)
        moved, value = imgui.drag_float("##value", value, (spread[1] - spread[0]) / STEPS, format="%.5g")
        imgui.set_item_tooltip("Value of this point: drag, or ctrl+click.")
        imgui.same_line(0.0, gap)
        imgui.set_next_item_width(wide)
        raised, height = imgui.drag_float("##height", float(rise(opacity)), 1 / STEPS, 0.0, 1.0, f"{opacity:.3g}")
        imgui.set_item_tooltip("Opacity of this point: drag.")
        if moved or raised:
            points = move_point(points, self.number, value, fall(height) if raised else opacity)
        return self._count(points, gap)

    def _count(self, points: Nodes, gap: float) -> Nodes:
        """Buttons that add a point between this one and its neighbour, and remove it."""
        here = self.number
        imgui.same_line(0.0, gap)
        imgui.begin_disabled(len(points) < 2)
        if imgui.button("+"):
            ends = points[here : here + 2] if here + 1 < len(points) else points[here - 1 :]
            between = np.mean(ends, axis=0).tolist()
            points, self.number = add_point(points, *between)
        imgui.set_item_tooltip("One more point beside this one.")
        imgui.same_line(0.0, gap)
        points = remove_point(points, here) if imgui.button("-") else points
        imgui.set_item_tooltip("Removes this point.")
        imgui.end_disabled()
        return points


class Curve:
    """Draws the plot and holds its range of values and its histogram."""

    def __init__(self) -> None:
        self.volume: object = None
        self.stats: Statistics | None = None
        self.logarithmic = True
        self.range = (0.0, 1.0)
        self.bars = (np.zeros(2), np.zeros(1))
        # whether to show the whole range in the next frame
        self.fits = True
        self.held: int | None = None
        self.strip = ColorStrip()
        self.fields = PointFields()
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
        points = self.fields.draw(points, self.range)
        changed, self.logarithmic = imgui.checkbox("log counts", self.logarithmic)
        imgui.set_item_tooltip("Bars by the logarithm of how many voxels have a value, or by the number.")
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
        current = shape_of(transfer) or EDITED
        names = list(dict.fromkeys([current, *SHAPES]))
        imgui.set_next_item_width(-1.0)
        changed, index = imgui.combo("##shape", 0, names)
        imgui.set_item_tooltip("Shape of the opacities between the first and the last point (--curve).")
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
        ticks = [float(each) for each in rise(TICKS)]
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
        pointed, held = None, None
        low, high = self.range
        for number, (value, opacity) in enumerate(points):
            # points outside the axis cannot be dragged
            if not low <= value <= high and number != self.held:
                continue
            options = number, value, float(rise(opacity)), NODE, POINT * scale, 0, False, False, False
            moved, x, y, _, over, down = implot.drag_point(*options)
            pointed, held = (number if over else pointed), (number if down and not ctrl else held)
            if moved and not ctrl:
                points = move_point(points, number, x, fall(y))
        self.held = held
        self.fields.number = self.fields.number if held is None else held
        hovered = implot.is_plot_hovered() or pointed is not None
        removes = imgui.is_mouse_clicked(imgui.MouseButton_.right) or (
            ctrl and imgui.is_mouse_clicked(imgui.MouseButton_.left)
        )
        if removes and pointed is not None:
            return remove_point(points, pointed)
        if hovered and pointed is None and imgui.is_mouse_double_clicked(imgui.MouseButton_.left):
            return add_point(points, at.x, fall(at.y))[0]
        shown = held if held is not None else pointed
        if shown is not None:
            imgui.set_tooltip(f"{points[shown][0]:.5g}: {points[shown][1]:.4g}")
        elif hovered:
            imgui.set_tooltip(f"{at.x:.4g}: {fall(at.y):.3g}\n{HINT}")
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
    imgui.set_item_tooltip("Where the values pass a number. The curve above draws what lies around it.")
    return transfer if tuple(surfaces) == tuple(transfer.iso) else replace(transfer, iso=surfaces)


def _draw_surface(transfer: Transfer, number: int, limits: tuple[float, float]) -> Iso | None:
    """Value, opacity and colour of a surface, and a button that removes it; None if it is removed."""
    surface, room = transfer.iso[number], imgui.get_content_region_avail().x
    spread = limits[1] - limits[0]
    imgui.set_next_item_width(room * VALUE)
    changed, value = imgui.drag_float("##value", surface.value, spread / STEPS, format="%.5g")
    imgui.set_item_tooltip("The value whose surface is drawn (--iso): drag, or ctrl+click.")
    if changed:
        # surfaces keep their order
        before = [other.value + APART * spread for other in transfer.iso[:number]]
        behind = [other.value - APART * spread for other in transfer.iso[number + 1 :]]
        value = float(f"{value:.6g}")
        surface = surface._replace(value=min(max([value, *before]), *behind, np.inf))
    surface = surface._replace(opacity=pick_opacity(surface.opacity, room))
    shown = srgb_of_name(surface.color) if surface.color else None
    linear = transfer.color(surface.value) if shown is None else linear_from_srgb(np.array(shown) / 255)
    color = pick_color(tuple(map(float, linear)))
    surface = surface if color is None else surface._replace(color=color)
    imgui.same_line()
    return None if imgui.small_button("remove") else surface


def _free_value(values: list[float], low: float, high: float) -> float:
    """The middle of the widest gap between values and the ends of the range."""
    ends = np.unique([low, *np.clip(values, low, high), high])
    widest = int(np.diff(ends).argmax())
    return float(f"{(ends[widest] + ends[widest + 1]) / 2:.6g}")

"""Regions of the transfer function over the joint histogram of values and gradients, and their edits by mouse."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from imgui_bundle import imgui, implot

from splatgl.annotations.text import plain
from splatgl.data.color import linear_from_srgb, srgb_of_name
from splatgl.data.volume import Volume
from splatgl.splat.extract_values import gradients
from splatgl.transfer.regions import ENDLESS, MOST_REGIONS, Region
from splatgl.transfer.statistics import Statistics
from splatgl.transfer.transfer import Transfer
from splatgl.viewer.panel_sections import pick_color, pick_opacity
from splatgl.viewer.transfer_editor import HEIGHT, value_range

# most voxels that are counted, and planes read of volumes that are not in memory
MOST, PLANES = 2**20, 32
# percentile of the gradients at the upper end
STEEP = 99.95
# columns and rows of the histogram
BINS = (128, 64)
# shapes that are added by mouse, and colours of regions one after the other
SHAPES = ("box", "triangle", "gaussian")
COLORS = ("#e8b04a", "#4aa3e8", "#e8574a", "#6ecb63", "#b57be0", "#e88fc0")
# opacity of a new region, and the shares of the plot between which it lies
OPACITY, BETWEEN = 0.3, (0.35, 0.65)
HINT = "drag a region's middle, sides or corners; the wheel zooms, a drag beside them moves"


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
    color = COLORS[len(transfer.regions) % len(COLORS)]
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
    """Draws the joint histogram with the regions, and holds the histogram."""

    def __init__(self) -> None:
        self.volume: object = None
        self.plot: JointHistogram | None = None
        self.heights = np.zeros((1, 1))

    def histogram_of(self, volume: Volume, stats: Statistics) -> JointHistogram:
        """Joint histogram of the displayed volume, computed once."""
        if self.plot is None or self.volume is not volume:
            self.volume, self.plot = volume, JointHistogram.of(volume, value_range(stats), BINS)
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
            imgui.set_tooltip(f"value {at.x:.4g}, gradient {at.y:.4g}\n{HINT}")
        return transfer

    def _buttons(self, transfer: Transfer, plot: JointHistogram) -> Transfer:
        """Buttons that add regions and clear the curve."""
        for shape in SHAPES if len(transfer.regions) < MOST_REGIONS else ():
            if imgui.button(f"+ {shape}"):
                return add_region(transfer, shape, plot)
            imgui.set_item_tooltip(f"One more region: a {shape}.")
            imgui.same_line()
        if any(opacity > 0 for _, opacity in transfer.points):
            if imgui.button("regions alone"):
                return without_curve(transfer)
            imgui.set_item_tooltip("Takes the opacity of the curve over values away.")
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
            color = pick_color(tuple(linear_from_srgb(np.array(srgb_of_name(region.color)) / 255)))
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

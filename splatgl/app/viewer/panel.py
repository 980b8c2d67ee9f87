"""Control panel: transfer function over the values' histogram, settings, and frame info. Extra `gui`."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from imgui_bundle import imgui

from splatgl.app.viewer import curve, hud, panel_cuts, panel_view
from splatgl.app.viewer.content import Content
from splatgl.app.viewer.curve import Canvas
from splatgl.app.viewer.hud import Frame
from splatgl.app.viewer.overlay import plain
from splatgl.app.viewer.state import BLURS, HIGHEST, State, drawable
from splatgl.data.color import srgb_from_linear
from splatgl.splat.classification.colormap import CORE
from splatgl.splat.classification.presets import PRESETS, preset
from splatgl.splat.classification.statistics import Statistics, statistics
from splatgl.splat.classification.transfer import Nodes, Transfer
from splatgl.splat.plan.settings import choices

# screen units
WIDTH, HEIGHT, BAR, EDGE = 330.0, 150.0, 10.0, 6.0
MARGIN = 8.0
# factor on the displayed value range per notch of the wheel
ZOOM = 0.8
EXTINCTION = (0.01, 100.0)
# the paper's name of each setting, and its effect
ABOUT = {
    "blend": "Compositing over each other, X-ray sums, or the maximum along each ray.",
    "kernel": "The radial kernel that every voxel is blurred with.",
    "antialias": "paper: stretched to a pixel beyond z_k [Eq. 4], weakened by (z_k/z_v)^2 [Eq. 6]; auto: samples.",
    "align": "exact: the true line integral [row 1]; ray: perpendicular quads [row 4]; grid: aligned with the grid "
    "[row 5]; hybrid: ray up to z_s, then grid [4.2].",
    "attenuation": "What (z_k/z_v)^2 weakens beyond z_k: the opacity (the paper's), the optical depth, or by fill.",
    "compositing": "Every splat over the next, or sheets of equal distance, within which splats add up.",
    "classification": "pre: voxels are classified, then blurred; post: values and gradients are, then classified.",
    "footprint": "The footprint texture, or a finer table over the squared distance.",
    "target": "The frame buffer's numbers; the paper's has 8 bits.",
    "shading": "C = c (0.3 + 0.7 |n l|), a light at the eye.",
    "light": "At the eye, from above left on matte or glossy matter, or none that shades.",
    "order": "Read from the rows of splats, without a sort.",
    "technique": "How splats are drawn: quads, or gathered by tiles of pixels.",
    "motion": "Blur while the view is turned. moments: mean of pictures; exact: mean of the footprint along its "
    "path; energy: half discs and a rectangle with its energy kept; paper: Eq. 11.",
    "occlusion": "Pixels that next to nothing passes any more are closed to what lies behind.",
}


class Panel:
    """Draws the panel and holds its drag state."""

    def __init__(self) -> None:
        self.dragged: int | None = None
        self.place = (0.0, 0.0, 0.0, 0.0)
        # whether a list is open, and whether it is to close
        self.popup = self.closes = False
        self.stats: Statistics | None = None
        self.volume: object = None
        self.range = (0.0, 1.0)
        self.bars = (np.zeros(1), np.zeros(0))

    def draw(self, state: State, content: Content, frame: Frame | None, window: tuple[int, int]) -> State:
        """Draws one frame between ImGui's new_frame and render; returns the edited state."""
        wide = min(WIDTH * imgui.get_style().font_scale_main, window[0] - 2 * MARGIN)
        imgui.set_next_window_pos((window[0] - wide - MARGIN, MARGIN), imgui.Cond_.always)
        imgui.set_next_window_size_constraints((wide, 0.0), (wide, max(window[1] - 2 * MARGIN, 1.0)))
        imgui.set_next_window_bg_alpha(0.85)
        if self.closes:
            imgui.internal.close_popup_to_level(0, True)
            self.closes = False
        flags = imgui.WindowFlags_.no_saved_settings | imgui.WindowFlags_.no_move
        flags |= imgui.WindowFlags_.always_auto_resize
        shown, _ = imgui.begin("splatgl", None, flags)
        if shown:
            if state.times > 1:
                state = _time(state)
            opened = imgui.TreeNodeFlags_.default_open
            if imgui.collapsing_header("Transfer function", opened):
                state = self._transfer(state, content)
            if imgui.collapsing_header("View"):
                state = panel_view.draw(state, content)
            if imgui.collapsing_header("Cuts"):
                state = panel_cuts.draw(state, content)
            if imgui.collapsing_header("Settings"):
                state = _settings(state, content)
            if imgui.collapsing_header("Statistics"):
                self._statistics(state, content, frame)
        corner, size = imgui.get_window_pos(), imgui.get_window_size()
        self.place = (corner.x, corner.y, corner.x + size.x, corner.y + size.y)
        self.popup = imgui.is_popup_open("", imgui.PopupFlags_.any_popup)
        imgui.end()
        return state

    def covers(self, x: float, y: float) -> bool:
        """Whether a window position belongs to the panel; always true while a list is open."""
        left, top, right, bottom = self.place
        return self.popup or (left <= x < right and top <= y < bottom)

    def _known(self, content: Content) -> Statistics:
        """Statistics of the displayed volume's values, computed once."""
        if self.stats is None or self.volume is not content.volume:
            self.volume, self.stats = content.volume, statistics(content.volume)
            self._show(*curve.values_of(self.stats))
        return self.stats

    def _show(self, low: float, high: float) -> None:
        if self.stats is not None and low < high:
            self.range, self.bars = (low, high), curve.histogram(self.stats, low, high)

    def _transfer(self, state: State, content: Content) -> State:
        """The opacity curve and its controls."""
        stats = self._known(content)
        base = self._curve(state.transfer)
        base = _colors(base, stats)
        names = ["(preset)", *PRESETS]
        changed, chosen = imgui.combo("preset", 0, names)
        if changed and chosen:
            base = preset(names[chosen], content.volume)
        if base != state.transfer:
            state = replace(state, base=base, extinction=1.0)
        logarithmic = imgui.SliderFlags_.logarithmic
        changed, factor = imgui.slider_float("extinction", state.extinction, *EXTINCTION, "x%.3g", logarithmic)
        if changed:
            state = replace(state, extinction=float(f"{factor:.4g}"))
        changed, threshold = imgui.slider_float("threshold", state.threshold, 0.0, HIGHEST, "%.4f", logarithmic)
        if changed:
            state = replace(state, threshold=float(np.clip(f"{threshold:.4g}", 0.0, HIGHEST)))
        return state

    def _curve(self, transfer: Transfer) -> Transfer:
        """Canvas with histogram and nodes; returns the edited transfer function."""
        corner, room = imgui.get_cursor_screen_pos(), imgui.get_content_region_avail()
        tall = HEIGHT * imgui.get_style().font_scale_main
        wide, high = max(room.x, 4 * EDGE) - 2 * EDGE, tall - 2 * EDGE
        canvas = Canvas(corner.x + EDGE, corner.y + EDGE, wide, high, *self.range)
        imgui.invisible_button("curve", (max(room.x, 1.0), tall + BAR))
        hovered, active = imgui.is_item_hovered(), imgui.is_item_active()
        place = (imgui.get_io().mouse_pos.x, imgui.get_io().mouse_pos.y)
        points = self._dragged(transfer.points, canvas, place, hovered, active)
        self._zoomed(canvas, place, hovered)
        _draw_curve(canvas, self.bars, replace(transfer, points=points))
        if hovered and self.dragged is None:
            value, opacity = canvas.node(place)
            imgui.set_tooltip(f"{value:.4g}: {opacity:.3g}\ndrag a point; click for a new one; right click removes")
        elif self.dragged is not None:
            imgui.set_tooltip(f"{points[self.dragged][0]:.5g}: {points[self.dragged][1]:.4g}")
        return transfer if points == transfer.points else _with_points(transfer, points)

    def _dragged(self, points: Nodes, canvas: Canvas, place: tuple[float, float], hovered: bool, active: bool) -> Nodes:
        """The nodes after mouse input."""
        under = curve.nearest(points, canvas, place)
        if hovered and imgui.is_mouse_clicked(imgui.MouseButton_.right) and under is not None:
            return curve.removed(points, under)
        if hovered and imgui.is_mouse_clicked(imgui.MouseButton_.left):
            if under is None:
                points, under = curve.added(points, canvas.node(place))
            self.dragged = under
        held = self.dragged
        # the frame of the button release still has a valid position
        if not active:
            self.dragged = None
        return points if held is None or held >= len(points) else curve.moved(points, held, canvas.node(place))

    def _zoomed(self, canvas: Canvas, place: tuple[float, float], hovered: bool) -> None:
        notches = imgui.get_io().mouse_wheel
        if hovered and notches:
            wider = canvas.zoomed(place[0], ZOOM**notches)
            self._show(wider.low, wider.high)

    def _statistics(self, state: State, content: Content, frame: Frame | None) -> None:
        stats, volume = self._known(content), content.volume
        depth, height, width = volume.shape
        imgui.text(f"{width} x {height} x {depth} voxels, {volume.samples.dtype}")
        if len(stats.values):
            low, high = stats.values[0], stats.values[-1]
            imgui.text(f"values {low:.5g} to {high:.5g}, median {stats.percentile(50):.5g}")
        for line in hud.lines(state, content, frame, None)[1:]:
            imgui.text_wrapped(plain(line))


def _time(state: State) -> State:
    """The time points of a series or of a file."""
    changed, time = imgui.slider_int("time", state.time, 0, state.times - 1)
    if changed:
        state = replace(state, time=min(max(time, 0), state.times - 1), playing=False)
    imgui.same_line()
    changed, playing = imgui.checkbox("play", state.playing)
    return replace(state, playing=playing) if changed else state


def _settings(state: State, content: Content) -> State:
    """Controls of Settings, each with a description."""
    for name, about in ABOUT.items():
        allowed = BLURS if name == "motion" else choices()[name]
        chosen = state.blur if name == "motion" else getattr(state.settings, name)
        changed, index = imgui.combo(name, allowed.index(chosen), list(allowed))
        imgui.set_item_tooltip(plain(about))
        if name == "motion":
            state = replace(state, blur=allowed[index])
            continue
        settings = state.settings.but(**{name: allowed[index]})
        if changed and drawable(settings, state, content):
            state = replace(state, settings=settings)
    changed, level = imgui.slider_float(
        "tolerance", state.settings.tolerance * 255, 0.05, 16.0, "%.2f/255", imgui.SliderFlags_.logarithmic
    )
    imgui.set_item_tooltip("The largest difference from the float64 reference, linear light.")
    return replace(state, settings=state.settings.but(tolerance=level / 255)) if changed else state


def _colors(transfer: Transfer, stats: Statistics) -> Transfer:
    """Colour map and window."""
    names = list(dict.fromkeys([transfer.colormap, *CORE]))
    changed, index = imgui.combo("colours", 0, names)
    if changed:
        transfer = replace(transfer, colormap=names[index])
    low, high = transfer.window or (transfer.points[0][0], transfer.points[-1][0])
    spread = curve.values_of(stats)
    changed, low, high = imgui.drag_float_range2("window", low, high, (spread[1] - spread[0]) / 300, format="%.4g")
    imgui.set_item_tooltip("Values that the colours span: drag either end.")
    return replace(transfer, window=(low, high)) if changed and low < high else transfer


def _with_points(transfer: Transfer, points: Nodes) -> Transfer:
    """Replaces the nodes; the colour window is kept, even if it followed the first and last node."""
    window = transfer.window or (transfer.points[0][0], transfer.points[-1][0])
    return replace(transfer, points=points, window=window if window[0] < window[1] else None)


def _draw_curve(canvas: Canvas, bars: tuple[np.ndarray, np.ndarray], transfer: Transfer) -> None:
    pen = imgui.get_window_draw_list()
    right, bottom = canvas.left + canvas.width, canvas.top + canvas.height
    corner = (canvas.left - EDGE, canvas.top - EDGE)
    pen.push_clip_rect(corner, (right + EDGE, bottom + EDGE + BAR), True)
    pen.add_rect_filled(corner, (right + EDGE, bottom + EDGE), _color(0.08, 0.08, 0.08))
    edges, grey = [canvas.place(float(edge), 0.0)[0] for edge in bars[0]], _color(0.3, 0.3, 0.34)
    for left, stop, bar in zip(edges[:-1], edges[1:], bars[1], strict=True):
        pen.add_rect_filled((left, bottom - float(bar) * canvas.height), (stop, bottom), grey)
    # constant beyond the ends
    ends = ((canvas.low, transfer.points[0][1]), *transfer.points, (canvas.high, transfer.points[-1][1]))
    places = [canvas.place(*node) for node in ends]
    for start, end in pairwise(places):
        pen.add_line(start, end, _color(1.0, 0.8, 0.3), 2.0)
    for place in places[1:-1]:
        pen.add_circle_filled(place, 5.0, _color(1.0, 0.9, 0.6))
    _draw_bar(canvas, transfer)
    pen.pop_clip_rect()


def _draw_bar(canvas: Canvas, transfer: Transfer) -> None:
    """The colour of every value, below the curve."""
    pen, count = imgui.get_window_draw_list(), 64
    values = canvas.low + (np.arange(count) + 0.5) / count * (canvas.high - canvas.low)
    bottom, step = canvas.top + canvas.height + EDGE, canvas.width / count
    for number, rgb in enumerate(srgb_from_linear(np.clip(transfer.color(values), 0.0, 1.0))):
        left = canvas.left + number * step
        pen.add_rect_filled((left, bottom + 2), (left + step + 1, bottom + BAR), _color(*map(float, rgb)))


def _color(red: float, green: float, blue: float) -> int:
    return int(imgui.get_color_u32((red, green, blue, 1.0)))

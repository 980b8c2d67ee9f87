"""Control panel: transfer function over the values' histogram, settings, and frame info. Extra `gui`."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from imgui_bundle import imgui

from splatgl.annotations.text import plain
from splatgl.scene.meshes import is_mesh
from splatgl.splat.colormaps import CORE
from splatgl.splat.presets import PRESETS, preset
from splatgl.splat.settings import choices
from splatgl.splat.statistics import Statistics
from splatgl.splat.transfer import Transfer
from splatgl.viewer import hud, panel_sections, transfer_editor
from splatgl.viewer.commands import HIGHEST, Command, why_not, with_threshold
from splatgl.viewer.document import Document, LayerSplats
from splatgl.viewer.file_browser import Browser
from splatgl.viewer.hud import Frame
from splatgl.viewer.panel_sections import CommandWidgets
from splatgl.viewer.state import BLURS, State
from splatgl.viewer.transfer_editor import Curve

# screen units
WIDTH, MARGIN = 330.0, 8.0
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
    """Draws the panel and holds what outlasts a frame: the curve, the file browser, and open lists."""

    def __init__(self, commands: Iterable[Command]) -> None:
        self.curve, self.browser, self.widgets = Curve(), Browser(), CommandWidgets(commands)
        # recent files
        self.recent: tuple[str, ...] = ()
        self.place = (0.0, 0.0, 0.0, 0.0)
        # whether a list is open, and whether it is to close
        self.popup = self.closes = False

    def draw(self, state: State, document: Document, frame: Frame | None, window: tuple[int, int]) -> State:
        """Draws one frame between ImGui's new_frame and render; returns the edited state."""
        wide = min(WIDTH * imgui.get_style().font_scale_main, window[0] - 2 * MARGIN)
        imgui.set_next_window_pos((window[0] - wide - MARGIN, MARGIN), imgui.Cond_.always)
        imgui.set_next_window_size_constraints((wide, 0.0), (wide, max(window[1] - 2 * MARGIN, 1.0)))
        imgui.set_next_window_bg_alpha(0.85)
        # a click of the same moment may have closed it
        if self.closes and imgui.is_popup_open("", imgui.PopupFlags_.any_popup):
            imgui.internal.close_popup_to_level(0, True)
        self.closes = False
        flags = imgui.WindowFlags_.no_saved_settings | imgui.WindowFlags_.no_move
        flags |= imgui.WindowFlags_.always_auto_resize
        shown, _ = imgui.begin("splatgl", None, flags)
        if shown:
            if state.times > 1:
                state = _time(state)
            if imgui.collapsing_header("Files"):
                state = panel_sections.draw_files(state, document, self.widgets, self.recent)
            panel_sections.draw_file_options(state, document, self.widgets)
            opened = imgui.TreeNodeFlags_.default_open
            if document.is_layered and imgui.collapsing_header("Layers", opened):
                state = panel_sections.draw_layers(state, document)
            edited = document.layers[state.selected]
            name = f" of {plain(edited.name)}" if len(state.styles) > 1 else ""
            # a mesh alone has none
            if not is_mesh(edited.scene.volume) and imgui.collapsing_header(f"Transfer function{name}###curve", opened):
                state = self._transfer(state, edited)
            if imgui.collapsing_header("View"):
                state = panel_sections.draw_view(state, document, self.widgets)
            if imgui.collapsing_header("Slices"):
                state = panel_sections.draw_slices(state, document, self.widgets)
            if imgui.collapsing_header("Cuts"):
                state = panel_sections.draw_clipping(state, document, self.widgets)
            if imgui.collapsing_header("Settings"):
                state = _settings(state, document)
            if imgui.collapsing_header("Statistics"):
                self._statistics(state, document, frame)
        corner, size = imgui.get_window_pos(), imgui.get_window_size()
        self.place = (corner.x, corner.y, corner.x + size.x, corner.y + size.y)
        self.popup = imgui.is_popup_open("", imgui.PopupFlags_.any_popup)
        imgui.end()
        self.browser.draw(window)
        return state

    def covers(self, x: float, y: float) -> bool:
        """Whether a window position belongs to the panel; always true while a list is open."""
        left, top, right, bottom = self.place
        return self.popup or (left <= x < right and top <= y < bottom)

    def _transfer(self, state: State, layer: LayerSplats) -> State:
        """The opacity curve and its controls."""
        stats, style = self.curve.statistics_of(layer.volume), state.style
        base = _colors(self.curve.draw(style.stated, layer.volume), stats)
        names = ["(preset)", *PRESETS]
        changed, chosen = imgui.combo("preset", 0, names)
        if changed and chosen:
            base = preset(names[chosen], layer.volume)
        if base != style.stated:
            state = state.edit(base=base, extinction=1.0)
        logarithmic = imgui.SliderFlags_.logarithmic
        changed, factor = imgui.slider_float("extinction", state.style.extinction, *EXTINCTION, "x%.3g", logarithmic)
        if changed:
            state = state.edit(extinction=float(f"{factor:.4g}"))
        changed, threshold = imgui.slider_float("threshold", style.threshold, 0.0, HIGHEST, "%.4f", logarithmic)
        return with_threshold(state, min(max(threshold, 0.0), HIGHEST)) if changed else state

    def _statistics(self, state: State, document: Document, frame: Frame | None) -> None:
        volume = document.layers[state.selected].volume
        stats = self.curve.statistics_of(volume)
        depth, height, width = volume.shape
        imgui.text(f"{width} x {height} x {depth} voxels, {volume.samples.dtype}")
        if len(stats.values):
            low, high = stats.values[0], stats.values[-1]
            imgui.text(f"values {low:.5g} to {high:.5g}, median {stats.percentile(50):.5g}")
        for line in hud.lines(state, document, frame, None)[1:]:
            imgui.text_wrapped(plain(line))


def _time(state: State) -> State:
    """The time points of a series or of a file."""
    changed, time = imgui.slider_int("time", state.time, 0, state.times - 1)
    if changed:
        state = replace(state, time=min(max(time, 0), state.times - 1), playing=False)
    imgui.same_line()
    changed, playing = imgui.checkbox("play", state.playing)
    return replace(state, playing=playing) if changed else state


def _settings(state: State, document: Document) -> State:
    """Controls of Settings, each with a description."""
    for name, about in ABOUT.items():
        allowed = BLURS if name == "motion" else choices()[name]
        chosen = state.blur if name == "motion" else getattr(state.settings, name)
        changed, index = imgui.combo(name, allowed.index(chosen), list(allowed))
        imgui.set_item_tooltip(plain(about))
        if name == "motion":
            # an open section that changes nothing redraws nothing
            state = replace(state, blur=allowed[index]) if changed else state
            continue
        settings = state.settings.but(**{name: allowed[index]})
        if changed:
            why = why_not(settings, state, document)
            state = replace(state, message=why) if why else replace(state, settings=settings, message="")
        if name == "light":
            state = panel_sections.cues(state)
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
    spread = transfer_editor.values_of(stats)
    changed, low, high = imgui.drag_float_range2("window", low, high, (spread[1] - spread[0]) / 300, format="%.4g")
    imgui.set_item_tooltip("Values that the colours span: drag either end.")
    return replace(transfer, window=(low, high)) if changed and low < high else transfer

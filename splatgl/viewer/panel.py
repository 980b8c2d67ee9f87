"""Control panel: transfer function over the values' histogram, settings, and frame info. Extra `gui`."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from imgui_bundle import imgui

from splatgl.annotations.text import plain
from splatgl.options import declared
from splatgl.scene.meshes import is_mesh
from splatgl.splat.colormaps import CORE
from splatgl.splat.presets import PRESETS, preset
from splatgl.splat.settings import Settings
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
# settings with sliders from 0 to 1; those with choices have lists
STRENGTHS = ("ambient_occlusion", "shadows")


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
        # a click may have closed the list meanwhile
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
            for title, draw in panel_sections.SECTIONS.items():
                if imgui.collapsing_header(title):
                    state = draw(state, document, self.widgets)
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
        for line in hud.full_lines(state, document, frame, None)[1:]:
            imgui.text_wrapped(plain(line))


def _time(state: State) -> State:
    """Slider and switch of a time series."""
    changed, time = imgui.slider_int("time", state.time, 0, state.times - 1)
    if changed:
        state = replace(state, time=min(max(time, 0), state.times - 1), playing=False)
    imgui.same_line()
    changed, playing = imgui.checkbox("play", state.playing)
    return replace(state, playing=playing) if changed else state


def _settings(state: State, document: Document) -> State:
    """A widget for each setting with choices or a strength, described as on the command line."""
    for name, setting in declared(Settings).items():
        label, now = setting.label or name, getattr(state.settings, name)
        value: Any = None
        if name == "motion":
            changed, index = imgui.combo(label, BLURS.index(state.blur), list(BLURS))
            state = replace(state, blur=BLURS[index]) if changed else state
        elif setting.choices:
            changed, index = imgui.combo(label, setting.choices.index(now), list(setting.choices))
            value = setting.choices[index]
        elif name in STRENGTHS:
            changed, strength = imgui.slider_float(label, now, 0.0, 1.0, "%.2f")
            value = round(min(max(strength, 0.0), 1.0), 2)
        elif name == "tolerance":
            logarithmic = imgui.SliderFlags_.logarithmic
            changed, strength = imgui.slider_float(label, now * 255, 0.05, 16.0, "%.2f/255", logarithmic)
            value = strength / 255
        else:
            continue
        imgui.set_item_tooltip(plain(setting.help).replace("--", "") + ".")
        # an open section that changes nothing redraws nothing
        if changed and value is not None:
            settings = state.settings.but(**{name: value})
            why = why_not(settings, state, document) if setting.choices else ""
            state = replace(state, message=why) if why else replace(state, settings=settings, message="")
    return state


def _colors(transfer: Transfer, stats: Statistics) -> Transfer:
    """Colour map and window."""
    names = list(dict.fromkeys([transfer.colormap, *CORE]))
    changed, index = imgui.combo("colours", 0, names)
    if changed:
        transfer = replace(transfer, colormap=names[index])
    low, high = transfer.window or (transfer.points[0][0], transfer.points[-1][0])
    spread = transfer_editor.value_range(stats)
    changed, low, high = imgui.drag_float_range2("window", low, high, (spread[1] - spread[0]) / 300, format="%.4g")
    imgui.set_item_tooltip("Values that the colours span: drag either end.")
    return replace(transfer, window=(low, high)) if changed and low < high else transfer

"""Control panel: transfer function, settings, and frame info; its palette, questions and file dialog. Extra `gui`."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from dataclasses import replace
from difflib import get_close_matches
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from imgui_bundle import imgui

from splatgl.annotations.text import legible, plain
from splatgl.data.color import srgb_from_linear
from splatgl.errors import USER_ERRORS, error_text
from splatgl.options import declared
from splatgl.scene.meshes import is_mesh
from splatgl.splat.lighting import LightModel
from splatgl.splat.settings import Settings
from splatgl.transfer.colormaps import CORE, colormap
from splatgl.transfer.statistics import Statistics
from splatgl.transfer.transfer import Transfer
from splatgl.viewer import hud, panel_sections, transfer_editor
from splatgl.viewer.commands import (
    COMMANDS,
    HIGHEST,
    Command,
    CopyText,
    Question,
    curve_of,
    is_ticked,
    why_not,
    with_settings,
    with_threshold,
)
from splatgl.viewer.dialogs import SaveDialog, draw_start
from splatgl.viewer.document import Document
from splatgl.viewer.files import OPEN, SAVE, Recent, suffixes
from splatgl.viewer.hud import DisplayedFrame
from splatgl.viewer.layer_splats import LayerSplats
from splatgl.viewer.layers_panel import SegmentList, draw_layers
from splatgl.viewer.panel_sections import (
    CommandWidgets,
    begin_dialog,
    capitalized,
    draw_record,
    label_left,
    shorten,
    show_tip,
)
from splatgl.viewer.preset_gallery import EDITED, PresetGallery, TransferShift, with_gradient
from splatgl.viewer.saving import check_target
from splatgl.viewer.state import BLURS, State
from splatgl.viewer.trackball import PANEL
from splatgl.viewer.transfer_editor import CurveEditor, RegionEditor

# width of the palette in screen units at a content scale of 1, its distance from the top as a share of the height, and
# the most commands that it lists
WIDTH, TOP, MOST = 440.0, 0.1, 14
PALETTE, QUESTION = "###palette", "###question"


class Palette:
    """List of the commands that the typed words find. row: the one that Enter runs."""

    def __init__(self) -> None:
        self.opening = self.is_open = False
        self.typed, self.row = "", 0

    def open(self) -> None:
        """Shows all commands from the next frame on."""
        self.opening, self.typed, self.row = True, "", 0

    def draw(self, state: State, document: Document, widgets: CommandWidgets, room: tuple[int, int]) -> State:
        """Draws the list, if it is open; returns the state after the chosen command. room: width and height of the
        window, screen units.
        """
        if self.opening:
            imgui.open_popup(PALETTE)
            self.opening = False
        wide = min(WIDTH * imgui.get_style().font_scale_main, room[0] - 16.0)
        imgui.set_next_window_pos((room[0] / 2, room[1] * TOP), imgui.Cond_.always, (0.5, 0.0))
        imgui.set_next_window_size((wide, 0.0))
        self.is_open = imgui.begin_popup(PALETTE)
        if not self.is_open:
            return state
        if imgui.is_window_appearing():
            imgui.set_keyboard_focus_here()
        imgui.set_next_item_width(-1.0)
        before, flags = self.typed, imgui.InputTextFlags_.enter_returns_true
        entered, self.typed = imgui.input_text_with_hint("##typed", "what to do", self.typed, flags)
        found = find_commands(self.typed, widgets.commands.values())
        shown = found[:MOST]
        moves = imgui.is_key_pressed(imgui.Key.down_arrow) - imgui.is_key_pressed(imgui.Key.up_arrow)
        self.row = 0 if self.typed != before else min(max(self.row + moves, 0), max(len(shown) - 1, 0))
        chosen = shown[self.row] if entered and shown else None
        for number, command in enumerate(shown):
            imgui.begin_disabled(not widgets.is_enabled(command, state, document))
            if imgui.selectable(f"{capitalized(command.title)}##{command.id}", number == self.row)[0]:
                chosen = command
            imgui.end_disabled()
            keys = ", ".join([*["on"] * is_ticked(command, state), *command.keys])
            imgui.same_line(max(wide - imgui.calc_text_size(keys).x - 2 * imgui.get_style().window_padding.x, 0.0))
            imgui.text_disabled(keys)
        if not found:
            imgui.text_wrapped(f"No command has the words {plain(self.typed)}.{nearest_word(self.typed)}")
        elif len(found) > MOST:
            imgui.text_disabled(f"{len(found) - MOST} more: type another word")
        if chosen is not None and widgets.is_enabled(chosen, state, document):
            imgui.close_current_popup()
            state = widgets.run(chosen.id, state, document)
        imgui.end_popup()
        return state


# spellings that are searched as others
SPELLINGS = {"color": "colour", "gray": "grey", "center": "centre", "-": " "}
# share of letters that a word has in common with a misspelt one
NEAR = 0.7


def _spelled(text: str) -> str:
    """A text in lower case, and in one spelling."""
    for word, other in SPELLINGS.items():
        text = text.lower().replace(word, other)
    return text


def find_commands(text: str, commands: Iterable[Command]) -> list[Command]:
    """The commands that all words of a text find, in their titles or among their other words: first those whose titles
    have its words, then those whose titles begin with the text, then those with words that begin with its words.
    """
    typed = _spelled(text)
    ranked = []
    for command in commands:
        title, words = _spelled(command.title), _spelled(f"{command.id} {command.words} {command.menu}")
        if all(word in title or word in words for word in typed.split()):
            starts, starts_other = (
                all(any(each.startswith(word) for each in text.split()) for word in typed.split())
                for text in (title, words)
            )
            is_whole = {*typed.split()} <= {*re.findall(r"\w+", title)}
            rank = not is_whole, not title.startswith(typed), not starts, not (starts or starts_other)
            ranked.append((rank, command))
    return [command for _, command in sorted(ranked, key=lambda row: row[0])]


def nearest_word(text: str) -> str:
    """A question for a word that finds commands, if one is nearly the typed one; else ""."""
    # shorter ones are near to anything
    words = {word for each in COMMANDS for word in re.findall(r"\w{3,}", _spelled(f"{each.title} {each.words}"))}
    near = get_close_matches(_spelled(text), sorted(words), 1, NEAR)
    return f" Did you mean {near[0]}?" if near else ""


class Questions:
    """Shows questions one after another, each until it is answered, by Enter with the first answer, or closed by
    Escape.
    """

    def __init__(self) -> None:
        self.waiting: list[Question] = []
        self.is_open = False

    def ask(self, question: Question) -> None:
        """Shows a question from the next frame on, unless it waits already."""
        self.waiting += [question] * (question not in self.waiting)

    def draw(self, widgets: CommandWidgets, room: tuple[int, int]) -> None:
        """Draws the question, if one is asked; the answer becomes an effect. room: as of `Palette.draw`."""
        if self.is_open and not imgui.is_popup_open(QUESTION):
            # Escape closed it
            self.waiting, self.is_open = self.waiting[1:], False
        if not self.waiting:
            return
        question = self.waiting[0]
        if not self.is_open:
            imgui.open_popup(QUESTION)
            self.is_open = True
        if not begin_dialog(f"{question.title}{QUESTION}", room, WIDTH):
            return
        imgui.text_wrapped(plain(question.text))
        is_entered = imgui.is_key_pressed(imgui.Key.enter, repeat=False) and not imgui.is_window_appearing()
        # else it presses the button that has the keys
        is_entered &= not imgui.get_io().nav_visible
        # the answer of the enter key has another colour
        first = imgui.Col_.button if imgui.get_io().nav_visible else imgui.Col_.button_hovered
        imgui.push_style_color(imgui.Col_.button, imgui.get_style_color_vec4(first))
        for number, (text, effect) in enumerate(question.answers):
            is_chosen = imgui.button(text) or (is_entered and number == 0)
            if number == 0:
                imgui.pop_style_color()
            if is_chosen:
                # a text is copied before it is closed
                if not isinstance(effect, CopyText):
                    imgui.close_current_popup()
                    self.waiting, self.is_open = self.waiting[1:], False
                widgets.effects += [effect] if effect else []
            imgui.same_line()
        imgui.new_line()
        imgui.end_popup()


# largest size in screen units at a content scale of 1
SIZE = (520.0, 420.0)
NAME = "###browser"


class Browser:
    """List of the files of a folder. chosen: the chosen paths, until they are taken."""

    def __init__(self) -> None:
        self.kind, self.title, self.name, self.note = OPEN, "", "", ""
        self.folder = Path()
        self.typed = ""
        self.chosen: tuple[str, ...] = ()
        # whether to open the list in the next frame, and whether to show files of any type
        self.opening = self.all = False
        self.folders: list[str] = []
        self.files: list[str] = []

    def open(self, kind: str, title: str, folder: Path, name: str) -> None:
        """Shows a folder from the next frame on. name: the proposed file name."""
        self.kind, self.title, self.name, self.opening = kind, title, name, True
        self._go(folder)

    def take(self) -> tuple[str, ...]:
        """Returns the chosen paths, once."""
        chosen, self.chosen = self.chosen, ()
        return chosen

    def draw(self, window: tuple[int, int]) -> None:
        """Draws the list, if it is open. window: its size."""
        if self.opening:
            imgui.open_popup(NAME)
            self.opening = False
        if not begin_dialog(f"{self.title}{NAME}", window, *SIZE):
            return
        imgui.set_next_item_width(-1.0)
        entered, self.typed = imgui.input_text("##folder", self.typed, imgui.InputTextFlags_.enter_returns_true)
        if entered:
            self._go(Path(self.typed).expanduser())
        foot = imgui.get_frame_height_with_spacing() * 2.2
        if imgui.begin_child("##list", (0.0, -foot), imgui.ChildFlags_.borders):
            self._list()
        imgui.end_child()
        self._foot()
        imgui.end_popup()

    def _list(self) -> None:
        stays = imgui.SelectableFlags_.no_auto_close_popups
        twice = stays | imgui.SelectableFlags_.allow_double_click
        if self.note:
            imgui.text_wrapped(self.note)
        for name in ("..", *self.folders):
            if imgui.selectable(f"{legible(name)}/", False, stays)[0]:
                self._go(self.folder.parent if name == ".." else self.folder / name)
                return
        for name in self.files:
            if imgui.selectable(legible(name), name == self.name, twice)[0]:
                self.name = name
                if self.kind != SAVE and imgui.is_mouse_double_clicked(imgui.MouseButton_.left):
                    self._choose(name)

    def _foot(self) -> None:
        """The name and the buttons."""
        imgui.set_next_item_width(imgui.get_content_region_avail().x * 0.6)
        if self.kind == SAVE and imgui.is_window_appearing():
            # typed text replaces the name
            imgui.set_keyboard_focus_here()
        flags = imgui.InputTextFlags_.enter_returns_true | imgui.InputTextFlags_.auto_select_all
        shown = legible(self.name)
        entered, name = imgui.input_text("##name", shown, flags)
        self.name = self.name if name == shown else name
        imgui.same_line()
        changed, self.all = imgui.checkbox("all files", self.all)
        if changed:
            self._go(self.folder)
        there = bool(self.name) and os.path.exists(self.folder / self.name)
        word = self.kind if self.kind != SAVE else "replace it" if there else "save"
        # the enter key replaces no existing file
        if (imgui.button(word) or (entered and word != "replace it")) and self.name:
            self._choose(self.name)
        if self.kind != SAVE:
            imgui.same_line()
            if imgui.button("open this folder"):
                self._choose("")
            show_tip("DICOM slices, Zarr, numbered pictures.")
        imgui.same_line()
        if imgui.button("cancel"):
            imgui.close_current_popup()

    def _choose(self, name: str) -> None:
        path = self.folder / name
        if name and self.kind != SAVE and os.path.isdir(path):
            self._go(path)
            return
        if self.kind == SAVE:
            try:
                check_target(path)
            except USER_ERRORS as error:
                # the list stays, with the reason
                self.note = error_text(error)
                return
        self.chosen = (str(path),)
        imgui.close_current_popup()

    def _go(self, folder: Path) -> None:
        """Lists another folder; the list shows why a folder cannot be read."""
        self.folder, self.note = Path(os.path.abspath(folder)), ""
        self.typed, self.folders, self.files = legible(str(self.folder)), [], []
        try:
            with os.scandir(self.folder) as entries:
                names = sorted((not entry.is_dir(), entry.name) for entry in entries if entry.name[0] != ".")
        except OSError as error:
            self.note = f"{self.folder}: {error.strerror}"
            return
        known = suffixes()
        self.folders = [name for is_file, name in names if not is_file]
        self.files = [name for is_file, name in names if is_file and (self.all or name.lower().endswith(known))]


# distance of the panel from the edges of the picture that it lies over, screen units
MARGIN = 8.0
# width and height of the strip that opens the panel
STRIP = 24.0, 60.0
EXTINCTION = (0.01, 100.0)
# settings with sliders from 0 to 1; those with choices have lists
STRENGTHS = ("ambient_occlusion", "shadows")
LIGHT_SHARES = ("ambient", "diffuse", "specular")
SECTIONS = {**panel_sections.SECTIONS, "Record": draw_record}
# settings by section: what scientists look for first, then light, then accuracy and the paper's method
SETTINGS = {
    "Rendering": ("blend", "mip_attenuation", "motion", "tolerance"),
    "Light": ("shading", "light", *LIGHT_SHARES, *STRENGTHS),
}
SETTINGS["Advanced"] = tuple(
    name
    for name, setting in declared(Settings).items()
    if setting.choices and not any(name in names for names in SETTINGS.values())
)
# names of blend modes that users of other programs know
BLEND_NAMES = {
    "composite": "volume",
    "xray": "X-ray",
    "mip": "MIP",
    "attenuated-mip": "attenuated MIP",
    "minip": "minimum",
}
# highest attenuation of an attenuated MIP
MOST_ATTENUATION = 2.0


class Panel:
    """Draws the panel and keeps state between frames: the curve, the file browser, and open lists. has_strip: whether
    a strip at the right edge opens it.
    """

    def __init__(self, commands: Iterable[Command], has_strip: bool = True) -> None:
        self.has_strip = has_strip
        self.curve, self.regions, self.segments = CurveEditor(), RegionEditor(), SegmentList()
        self.browser, self.widgets = Browser(), CommandWidgets(commands)
        self.palette, self.questions, self.saving = Palette(), Questions(), SaveDialog()
        self.gallery, self.shift = PresetGallery(), TransferShift()
        self.recent = Recent()
        self.place = (0.0, 0.0, 0.0, 0.0)
        # title of the section that the next frame opens
        self.section = ""
        # whether a list is open, and how many are, one from the other, if the last one is to close
        self.popup, self.closes = False, 0
        # whether keys go through the widgets of what is open, and whether they are to begin in the panel
        self.takes_moves = self.focusing = False

    @property
    def is_opening(self) -> bool:
        """Whether the next frame opens a list or a dialog with a field, to which keys already belong."""
        return self.palette.opening or self.saving.opening

    def draw(
        self,
        state: State,
        document: Document,
        frame: DisplayedFrame | None,
        room: tuple[int, int],
        docked: bool = False,
    ) -> State:
        """Draws one frame between ImGui's new_frame and render; returns the edited state.

        room: width and height at whose right end the panel stands, screen units. docked: it is as high as the room,
        else it lies over the picture.
        """
        # a click, or ImGui, may have closed the list meanwhile
        if 0 < self.closes <= len(imgui.get_current_context().open_popup_stack):
            imgui.internal.close_popup_to_level(self.closes - 1, True)
        self.closes = 0
        if document.is_empty:
            state = draw_start(state, document, self.widgets, self.recent, room)
            self._end()
            self.browser.draw(room)
        elif state.panel:
            state = self._draw(state, document, frame, room, docked)
        elif self.has_strip:
            state = self._draw_strip(state, document, room)
        else:
            self.place = (0.0, 0.0, 0.0, 0.0)
        self.questions.draw(self.widgets, room)
        self.saving.draw(self.widgets, room)
        state = self.palette.draw(state, document, self.widgets, room)
        self.popup = imgui.is_popup_open("", imgui.PopupFlags_.any_popup)
        # the palette has arrows of its own
        self.takes_moves = self.popup and not self.palette.is_open
        return state

    def _draw(
        self, state: State, document: Document, frame: DisplayedFrame | None, room: tuple[int, int], docked: bool
    ) -> State:
        margin = 0.0 if docked else MARGIN
        wide = min(PANEL * imgui.get_style().font_scale_main, room[0] - 2 * margin)
        high = max(room[1] - 2 * margin, 1.0)
        imgui.set_next_window_pos((room[0] - wide - margin, margin), imgui.Cond_.always)
        imgui.set_next_window_size_constraints((wide, high if docked else 0.0), (wide, high))
        flags = imgui.WindowFlags_.no_saved_settings | imgui.WindowFlags_.no_move | imgui.WindowFlags_.no_resize
        flags |= imgui.WindowFlags_.no_title_bar if docked else imgui.WindowFlags_.always_auto_resize
        # round corners would leave holes at the window's edge
        imgui.push_style_var(imgui.StyleVar_.window_rounding, 0.0 if docked else imgui.get_style().window_rounding)
        shown, _ = imgui.begin("splatgl", None, flags | imgui.WindowFlags_.menu_bar)
        imgui.pop_style_var()
        if self.focusing:
            self.focusing = False
            imgui.set_window_focus()
            imgui.internal.nav_init_window(imgui.internal.get_current_window(), True)
            imgui.set_nav_cursor_visible(True)
        if shown:
            state = panel_sections.draw_menus(state, document, self.widgets)
        # nothing is known of a volume that is being opened
        if shown and not document.is_loading:
            if state.times > 1:
                state = _time(state, document, self.widgets)
            panel_sections.draw_file_options(state, document, self.widgets)
            if document.has_layers and self._header("Layers", is_open=True):
                state = draw_layers(state, document, self.widgets)
            state = self._looks(state, document)
            for title, draw in SECTIONS.items():
                if self._header(title):
                    state = draw(state, document, self.widgets)
            for title, names in SETTINGS.items():
                if self._header(title):
                    state = _settings(state, document, names)
                    if title == "Advanced":
                        for line in hud.full_lines(state, document, frame, None)[1:]:
                            imgui.text_wrapped(plain(line))
            if self._header("Files"):
                state = panel_sections.draw_files(state, document, self.widgets, self.recent.paths)
            if self._header("Statistics"):
                volume = document.pool.get(state.style.number, document.layers[0]).volume
                stats = self.curve.statistics_of(volume)
                imgui.text_wrapped(plain(hud.describe_volume(volume, stats, len(state.style.base.labels))))
                imgui.text_wrapped(plain(hud.describe_picture(document, frame)))
        self._end()
        self.browser.draw(room)
        return state

    def _end(self) -> None:
        """Ends the window, and notes where it is."""
        corner, size = imgui.get_window_pos(), imgui.get_window_size()
        self.place = (corner.x, corner.y, corner.x + size.x, corner.y + size.y)
        imgui.end()

    def _draw_strip(self, state: State, document: Document, room: tuple[int, int]) -> State:
        """A strip in the corner at the right, away from annotations; a click on it opens the panel."""
        wide, high = (side * imgui.get_style().font_scale_main for side in STRIP)
        imgui.set_next_window_pos((room[0] - wide, 0.0), imgui.Cond_.always)
        imgui.set_next_window_size((wide, high))
        for size in (imgui.StyleVar_.window_padding, imgui.StyleVar_.window_min_size):
            imgui.push_style_var(size, imgui.ImVec2(0.0, 0.0))
        imgui.begin("##strip", None, imgui.WindowFlags_.no_decoration | imgui.WindowFlags_.no_saved_settings)
        if imgui.button("<", (-1.0, -1.0)):
            state = self.widgets.run("panel", state, document)
        self.widgets.describe("panel")
        self._end()
        imgui.pop_style_var(2)
        return state

    def covers(self, x: float, y: float) -> bool:
        """Whether a window position belongs to the panel; always true while a list is open."""
        left, top, right, bottom = self.place
        return self.popup or (left <= x < right and top <= y < bottom)

    def _header(self, title: str, of: str = "", is_open: bool = False) -> bool:
        """The header of a section; whether it is open. of: the layer's name behind its title; is_open: at first."""
        is_wanted, self.section = self.section == title, "" if self.section == title else self.section
        if is_wanted:
            imgui.set_next_item_open(True)
        flags = imgui.TreeNodeFlags_.default_open if is_open else 0
        # a chosen row of a list has that colour
        imgui.push_style_color(imgui.Col_.header, imgui.ImVec4(0.0, 0.0, 0.0, 0.0))
        shown = imgui.collapsing_header(f"{title}{of}###{title}", flags)
        imgui.pop_style_color()
        if is_wanted:
            imgui.set_scroll_here_y(0.0)
        return shown

    def _looks(self, state: State, document: Document) -> State:
        """The sections on the look of the selected layer; a mesh alone has none."""
        # a layer that was just added may not be there yet
        layer = document.pool.get(state.style.number, document.layers[0])
        of = f" of {plain(state.style.title or layer.name)}" if len(state.styles) > 1 else ""
        if not is_mesh(layer.scene.volume) and self._header("Look", of, is_open=True):
            state = self._look(state, document, layer)
        if curve_of(state, document) is None:
            return state
        if self._header("Transfer function", of, is_open=True):
            state = self._curve(state, layer)
        if self._header("Iso-surfaces"):
            low, high = transfer_editor.value_range(self.curve.statistics_of(layer.volume))
            surfaces = transfer_editor.draw_iso(state.style.base, low, high)
            # the curve stays as it is
            state = state if surfaces is state.style.base else state.edit(base=surfaces)
        return state

    def _look(self, state: State, document: Document, layer: LayerSplats) -> State:
        """Preset, colour map and its window, or the list of segments; opacity and threshold."""
        style, logarithmic = state.style, imgui.SliderFlags_.logarithmic
        if style.base.labels:
            state = self.segments.draw(state, document, layer)
        else:
            stats = self.curve.statistics_of(layer.volume)
            base = self.gallery.draw(style.stated, layer.stored, stats)
            # a preset leaves the surfaces
            base = base if base.iso == style.stated.iso else replace(base, iso=style.stated.iso)
            # colours of a file stay
            imgui.begin_disabled(layer.volume.color is not None)
            base = _colors(base, stats)
            imgui.end_disabled()
            state = state if base == style.stated else state.edit(base=base, extinction=1.0)
        changed, factor = imgui.slider_float(
            label_left("opacity"), state.style.extinction, *EXTINCTION, "x %.3g", logarithmic
        )
        show_tip("Scales the opacities of the curve.")
        if changed:
            state = state.edit(extinction=float(f"{factor:.4g}"))
        if style.base.labels:
            return state
        changed, threshold = imgui.slider_float(
            label_left("threshold"), state.style.threshold, 0.0, HIGHEST, "%.4g", logarithmic
        )
        show_tip("Voxels up to this opacity are skipped (--threshold).")
        return with_threshold(state, min(max(threshold, 0.0), HIGHEST)) if changed else state

    def _curve(self, state: State, layer: LayerSplats) -> State:
        """The opacity curve over values, and over gradients."""
        stats, style = self.curve.statistics_of(layer.volume), state.style
        base = self._functions(style.stated, layer, stats)
        low, high = transfer_editor.value_range(stats)
        base = self.shift.draw(base, high - low)
        base = _gradient(base, (high - low) / float(np.mean(layer.stored.spacing)) / transfer_editor.STEPS)
        return state if base == style.stated else state.edit(base=base, extinction=1.0)

    def _functions(self, base: Transfer, layer: LayerSplats, stats: Statistics) -> Transfer:
        """Tabs of the curve over values, and of the regions over values and gradients."""
        if imgui.begin_tab_bar("##functions"):
            if imgui.begin_tab_item("value")[0]:
                base = self.curve.draw(base, layer.volume)
                imgui.end_tab_item()
            # colours of a file have no gradient
            if layer.volume.color is None and imgui.begin_tab_item("value × gradient")[0]:
                base = self.regions.draw(base, layer.stored, stats)
                imgui.end_tab_item()
            imgui.end_tab_bar()
        return base


# lowest and highest time points a second
PACES = (0.1, 60.0)


def _time(state: State, document: Document, widgets: CommandWidgets) -> State:
    """Slider of a time series, with the file's own times, and what plays it."""
    time = document.volume.time_text(state.time)
    form = f"%d of {state.times - 1}" + (f": {time}" if time != str(state.time) else "")
    changed, time = imgui.slider_int(label_left("time"), state.time, 0, state.times - 1, form)
    if changed:
        state = replace(state, time=min(max(time, 0), state.times - 1), playing=False)
    for name, label in (("earlier", "<"), ("play", "stop" if state.playing else "play"), ("later", ">")):
        state = widgets.button(name, f"{label}##{name}", state, document)
        imgui.same_line()
    _, repeats = imgui.checkbox("loop", state.repeats)
    imgui.same_line()
    imgui.set_next_item_width(-1.0)
    changed, pace = imgui.drag_float("##pace", state.pace, 0.05, *PACES, "%.3g a second")
    show_tip("Time points a second while it plays: drag, or ctrl+click. Slow pictures take longer.")
    pace = float(f"{min(max(pace, PACES[0]), PACES[1]):.3g}") if changed else state.pace
    return state if (repeats, pace) == (state.repeats, state.pace) else replace(state, repeats=repeats, pace=pace)


def _settings(state: State, document: Document, names: Iterable[str]) -> State:
    """A widget for each of the settings with choices or a strength, described as on the command line."""
    for name in names:
        if name == "mip_attenuation" and state.settings.join != "attenuated":
            continue
        setting, now = declared(Settings)[name], getattr(state.settings, name)
        label = label_left(setting.label or name.replace("_", " "))
        value: Any = None
        if name == "motion":
            changed, index = imgui.combo(label, BLURS.index(state.blur), list(BLURS))
            state = replace(state, blur=BLURS[index]) if changed else state
        elif setting.choices:
            texts = [BLEND_NAMES.get(choice, choice) for choice in setting.choices]
            changed, index = imgui.combo(label, setting.choices.index(now), texts)
            value = setting.choices[index]
        else:
            changed, value = _slide(name, state.settings, label)
        show_tip(plain(setting.help).replace("--", "") + ".")
        # an open section that changes nothing redraws nothing
        if changed and value is not None:
            settings = state.settings.replace(**{name: value})
            why = why_not(settings, state, document) if setting.choices else ""
            state = replace(state if why else with_settings(state, document, settings), message=why)
    return state


def _slide(name: str, settings: Settings, label: str) -> tuple[bool, float]:
    """Slider of a strength or of the tolerance: whether it was moved, and its value."""
    now, most, logarithmic = getattr(settings, name), 1.0, imgui.SliderFlags_.logarithmic
    if name == "tolerance":
        changed, value = imgui.slider_float(label, now * 255, 0.05, 16.0, "%.2f/255", logarithmic)
        return changed, value / 255
    if name == "mip_attenuation":
        changed, value = imgui.slider_float(label, now, 0.0, MOST_ATTENUATION, "%.3g", logarithmic)
        return changed, float(f"{max(value, 0.0):.3g}")
    if name in LIGHT_SHARES:
        now = getattr(LightModel.of(settings.light, strengths=settings.strengths), name)
        most = 1.0 - sum(getattr(settings, other) or 0.0 for other in LIGHT_SHARES if other != name)
    changed, value = imgui.slider_float(label, now, 0.0, most, "%.2f")
    return changed, min(max(round(value, 2), 0.0), most)


# share of a row of a colour map that its name takes, and parts of its strip
NAMED, PARTS = 0.42, 32


@lru_cache(maxsize=256)
def swatch_colors(name: str) -> tuple[int, ...]:
    """PARTS + 1 colours of a map, as ImGui packs them."""
    coded = srgb_from_linear(colormap(name)[np.linspace(0, len(colormap(name)) - 1, PARTS + 1).astype(int)])
    return tuple(int(imgui.get_color_u32(imgui.ImVec4(*map(float, rgb), 1.0))) for rgb in coded)


def _swatch(name: str) -> None:
    """Draws the name and the strip of a colour map over the last widget, beside the arrow of a list."""
    pen, style = imgui.get_window_draw_list(), imgui.get_style()
    low, high = imgui.get_item_rect_min(), imgui.get_item_rect_max()
    arrow = imgui.get_frame_height() if high.y - low.y >= imgui.get_frame_height() - 1 else style.frame_padding.x
    wide, inset = high.x - low.x - arrow, style.frame_padding.y
    text = shorten(EDITED if ":#" in name else name, wide * NAMED - 2 * style.frame_padding.x)
    middle = (low.y + high.y - imgui.get_text_line_height()) / 2
    pen.add_text(imgui.ImVec2(low.x + style.frame_padding.x, middle), int(imgui.get_color_u32(imgui.Col_.text)), text)
    left, step = low.x + NAMED * wide, (1 - NAMED) * wide / PARTS
    for number, (color, following) in enumerate(pairwise(swatch_colors(name))):
        start = imgui.ImVec2(left + number * step, low.y + inset)
        end = imgui.ImVec2(left + (number + 1) * step, high.y - inset)
        pen.add_rect_filled_multi_color(start, end, color, following, following, color)


def _colors(transfer: Transfer, stats: Statistics) -> Transfer:
    """Colour map and window."""
    label, before = label_left("colour map"), transfer.colormap
    if imgui.begin_combo(label, "", imgui.ComboFlags_.height_large):
        for name in dict.fromkeys([before, *CORE]):
            chosen = imgui.selectable(f"##{name}", name == transfer.colormap)[0]
            _swatch(name)
            transfer = replace(transfer, colormap=name) if chosen else transfer
        imgui.end_combo()
    _swatch(before)
    low, high = transfer.color_range
    spread = transfer_editor.value_range(stats)
    changed, low, high = imgui.drag_float_range2(
        label_left("window"), low, high, (spread[1] - spread[0]) / transfer_editor.STEPS, format="%.4g"
    )
    show_tip("Values that the colours span: drag either end.")
    return replace(transfer, window=(low, high)) if changed and low < high else transfer


def _gradient(transfer: Transfer, step: float) -> Transfer:
    """Gradients that the opacity begins and is whole at; two equal ones keep the gradient out of it. step: by which a
    pixel of a drag changes them.
    """
    nodes = transfer.gradient
    begin, end = (nodes[0][0], nodes[-1][0]) if nodes else (0.0, 0.0)
    changed, begin, end = imgui.drag_float_range2(label_left("gradient"), begin, end, step, 0.0, 0.0, "%.4g")
    show_tip("Values per length: less steep parts are clear up to the first, opaque from the second on.")
    return with_gradient(transfer, max(begin, 0.0), end) if changed else transfer

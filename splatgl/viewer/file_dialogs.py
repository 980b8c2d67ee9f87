"""File dialogs: the desktop's, or those of Dear ImGui."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from imgui_bundle import imgui

from splatgl.annotations.text import legible, plain
from splatgl.errors import missing_extra
from splatgl.readers import FORMATS
from splatgl.viewer.saving import as_seen, free, saved_as
from splatgl.viewer.state import State

if TYPE_CHECKING:
    from splatgl.viewer.viewer import Viewer


# programs by which a desktop of X or Wayland shows its dialog
HELPERS = ("zenity", "kdialog", "matedialog", "qarma")
OPEN, SAVE = "open", "save-as"
TITLES = {OPEN: "Open a volume or a scene", SAVE: "Save: .toml a scene, .png a picture, .npy its floats"}


def native() -> bool:
    """Whether the desktop has a dialog of its own."""
    return not sys.platform.startswith("linux") or any(map(shutil.which, HELPERS))


def suffixes() -> tuple[str, ...]:
    """Those of files that can be opened."""
    known = (suffix for form in FORMATS if "file" in form.kinds for suffix in form.suffixes)
    return tuple(dict.fromkeys((".toml", *known)))


class Dialogs:
    """A viewer's dialogs, of which one at a time is open. A desktop's is a process, which is polled."""

    def __init__(self, viewer: Viewer) -> None:
        self.viewer = viewer
        self.open: Any = None
        self.kind = ""

    def ask(self, kind: str) -> None:
        """Opens the dialog to open a file or to save one; says what is missing where there is none."""
        viewer = self.viewer
        if not find_spec("imgui_bundle"):
            viewer.say(str(missing_extra("the file dialog", "imgui-bundle", "gui")))
        elif self.open is None:
            self.kind = kind
            name = free(viewer.options.folder, "scene", ".toml").name if kind == SAVE else ""
            folder = (viewer.options.folder if kind == SAVE else self._folder()).resolve()
            if native():
                self.open = _native(kind, folder / name)
            else:
                viewer.show_panel().browser.open(kind, TITLES[kind], folder, name)

    def look(self) -> None:
        """Takes what was chosen, if anything was."""
        viewer, chosen = self.viewer, None
        if self.open is not None and self.open.ready(0):
            found, self.open = self.open.result(), None
            chosen = (found,) if isinstance(found, str) and found else tuple(found)
            viewer.refresh()
        elif viewer.panel is not None and viewer.panel.panel.browser.chosen:
            browser = viewer.panel.panel.browser
            chosen, browser.chosen = browser.chosen, ()
        if chosen:
            self._take(chosen)

    def close(self) -> None:
        """Ends the desktop's dialog, which would outlive the window."""
        if self.open is not None:
            self.open.kill()
            self.open = None

    def _take(self, paths: Sequence[str]) -> None:
        viewer = self.viewer
        if self.kind == OPEN:
            viewer.hands.drop(list(paths))
            return
        told = viewer.state, viewer.document, viewer.renderer.render, Path(paths[0])
        viewer.state, kept = saved_as(*told, partial(as_seen, viewer), viewer.files.times)
        if kept:
            viewer.history.keep(viewer.state)
        viewer.refresh()

    def _folder(self) -> Path:
        """That of what is shown."""
        shown = Path(self.viewer.document.scene.volume)
        return shown.parent if shown.exists() else Path()


def _native(kind: str, path: Path) -> Any:
    """The desktop's dialog: an object with ready, result and kill."""
    from imgui_bundle import portable_file_dialogs as dialogs

    if kind == SAVE:
        wanted = ["Scene", "*.toml", "Picture", "*.png", "Floats", "*.npy"]
        return dialogs.save_file(TITLES[kind], str(path), wanted)
    known = " ".join(f"*{suffix}" for suffix in suffixes())
    wanted = ["Volumes and scenes", known, "All files", "*"]
    # a folder ends with a slash, or its name would be taken for that of a file
    return dialogs.open_file(TITLES[kind], f"{path}/", wanted, dialogs.opt.multiselect)


def opened(state: Any, path: str) -> Any:
    """The state that asks its window to open a file."""
    return replace(state, asks=(*state.asks, f"{OPEN} {path}"))


# largest size in screen units at a content scale of 1, and what is left of the window around it
SIZE, MARGIN = (520.0, 420.0), 8.0
NAME = "###browser"


def draw(state: State, recent: Sequence[str]) -> State:
    """The section's controls; returns the state with what they ask for. recent: paths."""
    if imgui.button("open..."):
        state = replace(state, asks=(*state.asks, OPEN))
    imgui.set_item_tooltip("A volume or a scene; several files are a time series (ctrl+o).")
    imgui.same_line()
    if imgui.button("save as..."):
        state = replace(state, asks=(*state.asks, SAVE))
    imgui.set_item_tooltip("A scene, a picture or its floats, by the name's ending (ctrl+s).")
    for number, path in enumerate(recent):
        if imgui.selectable(f"{plain(Path(path).name)}##{number}", False)[0]:
            state = opened(state, path)
        imgui.set_item_tooltip(legible(path))
    if recent and imgui.small_button("forget these"):
        state = replace(state, asks=(*state.asks, "forget"))
    return state


class Browser:
    """A list of a folder's files. chosen: the paths that were chosen last, until they are taken."""

    def __init__(self) -> None:
        self.kind, self.title, self.name, self.said = OPEN, "", "", ""
        self.folder = Path()
        self.typed = ""
        self.chosen: tuple[str, ...] = ()
        # whether it is to be opened in the next frame, and whether files of any ending are listed
        self.opening = self.all = False
        self.folders: list[str] = []
        self.files: list[str] = []

    def open(self, kind: str, title: str, folder: Path, name: str) -> None:
        """Shows a folder from the next frame on. name: the one that is proposed."""
        self.kind, self.title, self.name, self.opening = kind, title, name, True
        self._go(folder)

    def draw(self, window: tuple[int, int]) -> None:
        """Draws it, if it is open, in a window of that size."""
        if self.opening:
            imgui.open_popup(NAME)
            self.opening = False
        scale = imgui.get_style().font_scale_main
        size = [min(each * scale, room - 2 * MARGIN) for each, room in zip(SIZE, window, strict=True)]
        imgui.set_next_window_pos((window[0] / 2, window[1] / 2), imgui.Cond_.always, (0.5, 0.5))
        imgui.set_next_window_size((size[0], size[1]))
        imgui.set_next_window_bg_alpha(0.98)
        fixed = imgui.WindowFlags_.no_saved_settings | imgui.WindowFlags_.no_resize | imgui.WindowFlags_.no_move
        shown, _ = imgui.begin_popup_modal(f"{self.title}{NAME}", None, fixed)
        if not shown:
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
        if self.said:
            imgui.text_wrapped(self.said)
        for name in ("..", *self.folders):
            if imgui.selectable(f"{legible(name)}/", False, stays)[0]:
                self._go(self.folder.parent if name == ".." else self.folder / name)
                return
        for name in self.files:
            if imgui.selectable(legible(name), name == self.name, twice)[0]:
                self.name = name
                if self.kind == OPEN and imgui.is_mouse_double_clicked(imgui.MouseButton_.left):
                    self._choose(name)

    def _foot(self) -> None:
        """The name and the buttons."""
        imgui.set_next_item_width(imgui.get_content_region_avail().x * 0.6)
        if self.kind == SAVE and imgui.is_window_appearing():
            # what is typed replaces the name
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
        word = "open" if self.kind == OPEN else "replace it" if there else "save"
        # a name that is entered replaces nothing unasked
        if (imgui.button(word) or (entered and word != "replace it")) and self.name:
            self._choose(self.name)
        if self.kind == OPEN:
            imgui.same_line()
            if imgui.button("open this folder"):
                self._choose("")
            imgui.set_item_tooltip("DICOM slices, Zarr, numbered pictures.")
        imgui.same_line()
        if imgui.button("cancel"):
            imgui.close_current_popup()

    def _choose(self, name: str) -> None:
        found = self.folder / name
        if name and self.kind == OPEN and os.path.isdir(found):
            self._go(found)
            return
        self.chosen = (str(found),)
        imgui.close_current_popup()

    def _go(self, folder: Path) -> None:
        """Lists another folder; one that cannot be read says why."""
        self.folder, self.said = Path(os.path.abspath(folder)), ""
        self.typed, self.folders, self.files = legible(str(self.folder)), [], []
        try:
            with os.scandir(self.folder) as entries:
                found = sorted((not each.is_dir(), each.name) for each in entries if each.name[0] != ".")
        except OSError as error:
            self.said = f"{self.folder}: {error.strerror}"
            return
        known = suffixes()
        self.folders = [name for is_file, name in found if not is_file]
        self.files = [name for is_file, name in found if is_file and (self.all or name.lower().endswith(known))]

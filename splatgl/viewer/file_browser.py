"""`Browser`: the file dialog of Dear ImGui, for desktops without one. Needs the extra `gui`."""

from __future__ import annotations

import os
from pathlib import Path

from imgui_bundle import imgui

from splatgl.annotations.text import legible
from splatgl.errors import USER_ERRORS, error_text
from splatgl.viewer.file_dialogs import OPEN, SAVE, suffixes
from splatgl.viewer.saving import check_target

# largest size in screen units at a content scale of 1, and the margin around it
SIZE, MARGIN = (520.0, 420.0), 8.0
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
        scale = imgui.get_style().font_scale_main
        size = [min(each * scale, room - 2 * MARGIN) for each, room in zip(SIZE, window, strict=True)]
        imgui.set_next_window_pos((window[0] / 2, window[1] / 2), imgui.Cond_.always, (0.5, 0.5))
        imgui.set_next_window_size((size[0], size[1]))
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
            imgui.set_item_tooltip("DICOM slices, Zarr, numbered pictures.")
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

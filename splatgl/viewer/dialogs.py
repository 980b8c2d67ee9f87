"""Files that an empty window offers, and the dialog that saves a picture or a scene. Extra `gui`."""

from __future__ import annotations

from pathlib import Path

from imgui_bundle import imgui

from splatgl.animation.animation import MOVIES
from splatgl.annotations.text import legible, plain
from splatgl.data.image import JPEG, SAVED, TIFF
from splatgl.errors import USER_ERRORS, error_text
from splatgl.scene.view import PRINT_DPI, ViewOptions
from splatgl.viewer.commands import Open, PictureOptions, Save, SaveAction, WindowRequest
from splatgl.viewer.document import Document
from splatgl.viewer.files import Recent
from splatgl.viewer.panel_sections import AROUND, CommandWidgets, begin_dialog, draw_menus, label_left, shorten
from splatgl.viewer.saving import check_target
from splatgl.viewer.state import State

# width in screen units at a content scale of 1, and what ImGui knows the dialog by
WIDTH, NAME = 400.0, "Save###save"
SCENE = ".toml"
FORMATS = (*(form for form in SAVED if form not in (JPEG[1], TIFF[1])), SCENE)
ON_SCREEN = "as on the screen"
SIZES = (ON_SCREEN, "pixels", "width on paper")
BACKGROUNDS = (ON_SCREEN, "transparent", "white", "black")


class SaveDialog:
    """Name, format, size, background and annotations of what is saved, which stay as long as the window."""

    def __init__(self) -> None:
        self.opening = False
        self.folder, self.name, self.form, self.note = Path(), "", FORMATS[0], ""
        # of SIZES and BACKGROUNDS
        self.by = self.background = 0
        self.screen = self.whole = self.pixels = (1, 1)
        self.width, self.dpi = "85mm", float(PRINT_DPI)
        self.has_annotations = True

    def open(self, proposed: Path, size: tuple[int, int], beside: int = 0) -> None:
        """Shows the dialog from the next frame on. proposed: another file; size: of the picture on the screen; beside:
        the width of the slices and of the pinned picture at its right.
        """
        self.folder, self.name, self.opening, self.note = proposed.parent.resolve(), proposed.stem, True, ""
        self.pixels = size if self.pixels == self.screen else self.pixels
        self.screen, self.whole = size, (size[0] + beside, size[1])

    @property
    def path(self) -> Path:
        """The file that is written: the name's own ending is the format, if it is one."""
        known = Path(self.name).suffix.lower() in (*SAVED, SCENE, *MOVIES)
        return self.folder / (self.name if known else f"{self.name}{self.form}")

    @property
    def options(self) -> PictureOptions:
        """The choices in which the picture differs from the screen."""
        sized = (PictureOptions(), PictureOptions(self.pixels), PictureOptions(None, self.width, self.dpi))[self.by]
        background = BACKGROUNDS[self.background] if self.background else ""
        return PictureOptions(sized.size, sized.width, sized.dpi, background, not self.has_annotations)

    def draw(self, widgets: CommandWidgets, room: tuple[int, int]) -> None:
        """Draws the dialog, if it is open; what is chosen becomes an effect. room: as of `Panel.draw`."""
        if self.opening:
            imgui.open_popup(NAME)
            self.opening = False
        if not begin_dialog(NAME, room, WIDTH):
            return
        is_entered = self._draw_fields()
        if self.note:
            imgui.text_wrapped(plain(self.note))
        exists = self.path.exists()
        # the enter key replaces no existing file
        if imgui.button("replace it" if exists else "save") or (is_entered and not exists):
            self._end(SaveAction.WRITE, widgets)
        imgui.same_line()
        if imgui.button("copy as command"):
            self._end(SaveAction.COPY, widgets)
        imgui.set_item_tooltip("Copies a scene file and the command that draws this picture.")
        imgui.same_line()
        if imgui.button("elsewhere..."):
            self._end(SaveAction.ASK, widgets)
        imgui.set_item_tooltip(f"Another folder than {legible(str(self.folder))}.")
        imgui.same_line()
        if imgui.button("cancel"):
            imgui.close_current_popup()
        imgui.end_popup()

    def _draw_fields(self) -> bool:
        """The fields; returns whether Enter was pressed in the name."""
        if imgui.is_window_appearing():
            # typed text replaces the name
            imgui.set_keyboard_focus_here()
        flags = imgui.InputTextFlags_.enter_returns_true | imgui.InputTextFlags_.auto_select_all
        entered, self.name = imgui.input_text(label_left("name"), self.name, flags)
        suffix = self.path.suffix.lower()
        if suffix in FORMATS:
            texts = [f"{form[1:]}: the scene" if form == SCENE else form[1:] for form in FORMATS]
            changed, number = imgui.combo(label_left("format"), FORMATS.index(suffix), texts)
            if changed:
                self.name, self.form = self.path.stem, FORMATS[number]
        _, self.by = imgui.combo(label_left("size"), self.by, list(SIZES))
        if SIZES[self.by] == "pixels":
            _, (width, height) = imgui.input_int2(label_left("pixels"), list(self.pixels))
            self.pixels = width, height
        elif self.by:
            _, self.width = imgui.input_text(label_left("width"), self.width)
            imgui.set_item_tooltip("A length such as 85mm, 8.5cm, 3.3in or 240pt.")
            _, self.dpi = imgui.input_float(label_left("dots per inch"), self.dpi, format="%.0f")
        label_left("")
        imgui.text_disabled(self._describe_size())
        _, self.background = imgui.combo(label_left("background"), self.background, list(BACKGROUNDS))
        _, self.has_annotations = imgui.checkbox(label_left("annotations"), self.has_annotations)
        return bool(entered)

    def _describe_size(self) -> str:
        """The pixels of the picture, or why there are none."""
        options = self.options
        if SIZES[self.by] == ON_SCREEN:
            return f"{self.whole[0]} × {self.whole[1]} pixels"
        try:
            view = ViewOptions(size=options.size or self.screen, width=options.width, dpi=options.dpi)
        except USER_ERRORS as error:
            return error_text(error)
        return f"{view.size[0]} × {view.size[1]} pixels"

    def _end(self, action: SaveAction, widgets: CommandWidgets) -> None:
        """Requests an action, unless the file cannot be written: then the dialog stays, with the reason."""
        try:
            ViewOptions(size=self.options.size or self.screen, width=self.options.width, dpi=self.options.dpi)
            path = check_target(self.path) if action is SaveAction.WRITE else self.path
        except USER_ERRORS as error:
            self.note = error_text(error)
            return
        widgets.effects.append(Save(str(path), self.options, action))
        imgui.close_current_popup()


HINT = "Drop a volume, a scene or a mesh here, or"
LAST = "the last scene, as it was left"


def draw_start(
    state: State, document: Document, widgets: CommandWidgets, recent: Recent, room: tuple[int, int]
) -> State:
    """Begins ImGui's window in the middle of an empty one, and draws the last scene and recent files; returns the state
    after a command. room: as of `Panel.draw`.
    """
    wide = min(WIDTH * imgui.get_style().font_scale_main, room[0] - 2 * AROUND)
    imgui.set_next_window_pos((room[0] / 2, room[1] / 2), imgui.Cond_.always, (0.5, 0.5))
    imgui.set_next_window_size_constraints((wide, 0.0), (wide, max(room[1] - 2 * AROUND, 1.0)))
    flags = imgui.WindowFlags_.no_saved_settings | imgui.WindowFlags_.no_move | imgui.WindowFlags_.no_title_bar
    imgui.begin("##start", None, flags | imgui.WindowFlags_.always_auto_resize | imgui.WindowFlags_.menu_bar)
    state = draw_menus(state, document, widgets)
    imgui.text_wrapped(HINT)
    state = widgets.button("open", "open files...", state, document)
    names = {path: Path(path).name for path in recent.paths}
    if recent.scene is not None:
        names = {str(recent.scene): LAST, **names}
    for number, (path, name) in enumerate(names.items()):
        if imgui.selectable(f"{shorten(plain(name), imgui.get_content_region_avail().x)}##{number}", False)[0]:
            widgets.effects.append(Open((path,)))
        imgui.set_item_tooltip(legible(path))
    if names and imgui.small_button("forget these"):
        widgets.effects.append(WindowRequest.FORGET_RECENT)
    return state

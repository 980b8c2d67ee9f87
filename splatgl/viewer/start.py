"""The list of an empty window: the last scene and recent files. Extra `gui`."""

from __future__ import annotations

from pathlib import Path

from imgui_bundle import imgui

from splatgl.annotations.text import legible, plain
from splatgl.viewer.commands import Open, WindowRequest
from splatgl.viewer.document import Document
from splatgl.viewer.files import Recent
from splatgl.viewer.panel_sections import CommandWidgets, draw_menus, shorten
from splatgl.viewer.state import State

# width in screen units at a content scale of 1, and the margin around it
WIDTH, AROUND = 380.0, 8.0
HINT = "Drop a volume, a scene or a mesh here, or"
LAST = "the last scene, as it was left"


def draw_start(
    state: State, document: Document, widgets: CommandWidgets, recent: Recent, room: tuple[int, int]
) -> State:
    """Begins ImGui's window in the middle of an empty one, and draws what can be opened; returns the state after a
    command. room: as of `Panel.draw`.
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

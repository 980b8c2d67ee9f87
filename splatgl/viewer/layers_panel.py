"""The panel's lists of layers and meshes, and of the segments of a layer. Extra `gui`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, TypeVar

from imgui_bundle import imgui

from splatgl.annotations.text import plain
from splatgl.data.mesh import OF_VOLUME, PLAIN
from splatgl.planning.scene import MOST_LAYERS
from splatgl.scene.meshes import MeshFile, is_mesh
from splatgl.splat.segment_surfaces import SMOOTHING
from splatgl.transfer.colormaps import colormap
from splatgl.viewer.document import Document
from splatgl.viewer.layer_splats import LayerSplats
from splatgl.viewer.panel_sections import (
    OPACITY,
    CommandWidgets,
    label_left,
    pick_color,
    pick_opacity,
    shorten,
    show_tip,
)
from splatgl.viewer.segments import (
    Segment,
    find_segments,
    list_segments,
    segment_corners,
    with_look,
    with_name,
    with_only,
    with_shown,
)
from splatgl.viewer.state import LayerStyle, State

# share of the panel's width that names take, and width of the menu of a row at a content scale of 1
NAME, MENU = 0.4, 220.0
UP, DOWN, REMOVE = "move up", "move down", "remove"
# whether planes clip a mesh, and its caps
CUTS = {
    "leave it whole": (False, ""),
    "open it": (True, ""),
    "close it in its colour": (True, PLAIN),
    "show the volume in it": (True, OF_VOLUME),
}
FIRST = "The first layer gives the picture its axes, grid and slices: it can be hidden, and stays first."

T = TypeVar("T", LayerStyle, MeshFile)


def draw_layers(state: State, document: Document, widgets: CommandWidgets) -> State:
    """The section's controls; returns the edited state."""
    before = state
    for number, style in enumerate(state.styles):
        layer = document.pool.get(style.number)
        # a mesh alone has an empty volume
        if layer is not None and not is_mesh(layer.scene.volume):
            imgui.push_id(number)
            state = _draw_layer(state, number, style, style.title or layer.name)
            imgui.pop_id()
    for number, file in enumerate(state.mesh_files):
        imgui.push_id(f"mesh {number}")
        state = _draw_mesh(state, document, number, file)
        imgui.pop_id()
    if sum(style.is_shown for style in state.styles) > MOST_LAYERS:
        return replace(before, message=f"a picture has {MOST_LAYERS} visible layers at most: hide another one first")
    return widgets.button("add-layer", "add...", state, document)


def moved(entries: Sequence[T], number: int, action: str) -> tuple[T, ...]:
    """The entries without one, or with one exchanged with its neighbour; as they are where it has none."""
    kept = list(entries)
    if action == REMOVE:
        del kept[number]
    else:
        other = number + (1 if action == DOWN else -1)
        if 0 <= other < len(kept):
            kept[number], kept[other] = kept[other], kept[number]
    return tuple(kept)


def move_layer(state: State, number: int, action: str) -> State:
    """The state with a layer moved or removed; the first one stays where it is."""
    if number == 0 or (number == 1 and action == UP):
        return replace(state, message=FIRST)
    styles = moved(state.styles, number, action)
    places = {style.number: place for place, style in enumerate(styles)}
    # the same layer stays selected, or the one above a removed one
    selected = places.get(state.style.number, number - 1)
    return replace(state, styles=styles, selected=selected, message="")


def _draw_layer(state: State, number: int, style: LayerStyle, name: str) -> State:
    """Visibility, name and opacity of a layer, its colour if it has a single one, and its menu."""
    _, visible = imgui.checkbox("##seen", style.visible)
    show_tip("Show or hide it.")
    imgui.same_line()
    room = imgui.get_content_region_avail().x
    imgui.align_text_to_frame_padding()
    shown = shorten(plain(name), room * NAME)
    if imgui.selectable(shown, state.selected == number, size=(room * NAME, 0.0))[0]:
        state = replace(state, selected=number)
    show_tip(f"{plain(name)}: a click selects it. Its curve or segments below, and keys, edit it.")
    edited = replace(style, visible=visible, opacity=pick_opacity(style.opacity, room))
    # for others, the colour map is chosen below
    if style.base.colormap.startswith("#"):
        color = pick_color(colormap(style.base.colormap)[-1])
        edited = edited if color is None else replace(edited, base=replace(style.base, colormap=color))
    edited, action = _draw_menu(edited, name, number > 0)
    state = state if edited == style else state.with_style(number, edited)
    return move_layer(state, number, action) if action else state


def _draw_mesh(state: State, document: Document, number: int, mesh: MeshFile) -> State:
    _, visible = imgui.checkbox("##seen", mesh.visible)
    show_tip("Show or hide it.")
    imgui.same_line()
    room, left = imgui.get_content_region_avail().x, imgui.get_cursor_pos_x()
    imgui.align_text_to_frame_padding()
    imgui.text(shorten(plain(mesh.name), room * NAME))
    show_tip(plain(mesh.name))
    opacity = pick_opacity(mesh.opacity, room, left + room * NAME + imgui.get_style().item_spacing.x)
    data = document.mesh(mesh)
    uniform = data is not None and data.colors is None and data.values is None
    linear = mesh.linear or (data.color if data is not None and uniform else None)
    # a mesh with colours of vertices or values shows grey until a colour is chosen
    color = pick_color((0.5, 0.5, 0.5) if linear is None else linear)
    edited = replace(mesh, visible=visible, opacity=opacity, color=mesh.color if color is None else color)
    edited, action = _draw_menu(edited, mesh.name, True)
    files = state.mesh_files
    if edited != mesh:
        files = (*files[:number], edited, *files[number + 1 :])
    files = moved(files, number, action) if action else files
    return state if files == state.mesh_files else replace(state, mesh_files=files)


def _draw_menu(entry: T, name: str, is_movable: bool) -> tuple[T, str]:
    """A button that opens the menu of a row. Returns the edited entry, and what is chosen besides; "" for nothing.
    is_movable: whether it can be moved and removed.
    """
    imgui.same_line()
    wide = imgui.calc_text_size("...").x + 2 * imgui.get_style().frame_padding.x
    imgui.set_cursor_pos_x(imgui.get_cursor_pos_x() + max(imgui.get_content_region_avail().x - wide, 0.0))
    if imgui.small_button("..."):
        imgui.open_popup("##menu")
    show_tip("Rename, move or remove it.")
    imgui.set_next_window_size((MENU * imgui.get_style().font_scale_main, 0.0))
    action = ""
    if imgui.begin_popup("##menu"):
        changed, typed = imgui.input_text_with_hint(label_left("name"), plain(name), entry.title)
        entry = replace(entry, title=typed) if changed else entry
        if isinstance(entry, MeshFile):
            cuts = [(entry.clip, entry.caps) == cut for cut in CUTS.values()]
            chosen, number = imgui.combo(label_left("cuts"), cuts.index(True), list(CUTS))
            changes: dict[str, Any] = dict(zip(("clip", "caps"), list(CUTS.values())[number], strict=True))
            entry = replace(entry, **changes) if chosen else entry
        imgui.begin_disabled(not is_movable)
        for choice in (UP, DOWN, REMOVE):
            if imgui.selectable(choice, False)[0]:
                action = choice
        imgui.end_disabled()
        if not is_movable:
            imgui.text_wrapped(FIRST)
        imgui.end_popup()
    return entry, action


# rows that are visible at a time, share of the slider of an opacity, and width of the field of a name, screen units
ROWS, SLIDER, SEGMENT_MENU = 10, 0.75, 240.0
ONLY = "only"


class SegmentList:
    """Draws the list. typed: words of the names, or the number, of the segments that are listed."""

    def __init__(self) -> None:
        self.typed = ""

    def draw(self, state: State, document: Document, layer: LayerSplats) -> State:
        """The list and its search; returns the edited state."""
        style = state.style
        listed = list_segments(tuple(style.base.labels), layer.volume.labels, style.names)
        segments = find_segments(self.typed, listed)
        imgui.set_next_item_width(-1.0)
        _, self.typed = imgui.input_text_with_hint("##find", "find by name or number", self.typed)
        which = "found" if self.typed.strip() else "all"
        for word in ("show", "hide"):
            if imgui.button(f"{word} {which}"):
                style = with_shown(style, [segment.number for segment in segments], word == "show")
            imgui.same_line()
        count = len(style.base.labels)
        imgui.align_text_to_frame_padding()
        imgui.text_disabled(f"{count - len(style.hidden):,} of {count:,} shown")
        high = imgui.get_frame_height_with_spacing() * min(max(len(segments), 1), ROWS)
        target = None
        if imgui.begin_child("##segments", (0.0, high)):
            if not segments:
                imgui.text_disabled("no segment has this name or number")
            clipper = imgui.ListClipper()
            clipper.begin(len(segments), imgui.get_frame_height_with_spacing())
            while clipper.step():
                for segment in segments[clipper.display_start : clipper.display_end]:
                    style, chosen = _row(style, segment)
                    target = segment if chosen else target
        imgui.end_child()
        changed, is_smooth = imgui.checkbox("smooth", style.surfaces is not None)
        imgui.set_item_tooltip("Smooth surfaces instead of voxels, in the blend volume.")
        style = replace(style, surfaces=SMOOTHING if is_smooth else None) if changed else style
        if style.surfaces is not None:
            imgui.same_line()
            imgui.set_next_item_width(-1.0)
            changed, strength = imgui.slider_float("##smoothing", style.surfaces, 0.0, 1.0, "%.2f")
            style = replace(style, surfaces=min(max(round(strength, 2), 0.0), 1.0)) if changed else style
        state = state if style is state.style else state.with_style(state.selected, style)
        return state if target is None else _show_whole(state, document, layer, target)


def _row(style: LayerStyle, segment: Segment) -> tuple[LayerStyle, bool]:
    """Widgets of a segment. Returns the edited style, and whether the view is to show the segment."""
    imgui.push_id(str(segment.number))
    number = segment.number
    room = imgui.get_content_region_avail().x
    changed, is_shown = imgui.checkbox("##seen", number not in style.hidden)
    show_tip("Show or hide it.")
    if changed:
        style = with_shown(style, [number], is_shown)
    color = pick_color(segment.color)
    imgui.same_line()
    imgui.align_text_to_frame_padding()
    wide = _name_width(room)
    clicked = imgui.selectable(shorten(plain(segment.name), wide), False, size=(wide, 0.0))[0]
    show_tip(
        f"{plain(segment.name)}, number {number}: a click centres it and fits the view to it, a right click renames it."
    )
    style = _rename(style, segment)
    opacity = pick_opacity(segment.opacity, room * SLIDER)
    if color is not None or opacity != segment.opacity:
        style = with_look(style, number, color or segment.color, opacity)
    imgui.same_line()
    if imgui.small_button(ONLY):
        style = with_only(style, number)
    show_tip("Shows it, and hides all others.")
    imgui.pop_id()
    return style, clicked


def _name_width(room: float) -> float:
    """Width of a name in a row, of which a tick, a colour, a slider and a button take the rest."""
    style = imgui.get_style()
    button = imgui.calc_text_size(ONLY).x + 2 * style.frame_padding.x
    return room - 2 * imgui.get_frame_height() - room * SLIDER * OPACITY - button - 4 * style.item_spacing.x


def _rename(style: LayerStyle, segment: Segment) -> LayerStyle:
    """Field of a segment's name, which a right click on the last widget opens. Returns the edited style."""
    imgui.set_next_window_size((SEGMENT_MENU * imgui.get_style().font_scale_main, 0.0))
    if not imgui.begin_popup_context_item("##rename"):
        return style
    if imgui.is_window_appearing():
        imgui.set_keyboard_focus_here()
    flags = imgui.InputTextFlags_.enter_returns_true | imgui.InputTextFlags_.auto_select_all
    entered, typed = imgui.input_text(label_left("name"), segment.name, flags)
    if entered or imgui.is_item_deactivated_after_edit():
        style = with_name(style, segment.number, typed)
    if entered:
        imgui.close_current_popup()
    imgui.end_popup()
    return style


def _show_whole(state: State, document: Document, layer: LayerSplats, segment: Segment) -> State:
    """The state with its view centred on a segment, and fitted to it."""
    corners = segment_corners(layer.volume, segment.number)
    if corners is None:
        return replace(state, message=f"no voxel of {layer.name} is {segment.name}")
    return replace(state, pose=state.pose.fitted(corners), message="")

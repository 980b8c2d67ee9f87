"""`SegmentList`: the panel's list of the segments of a layer. Extra `gui`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from imgui_bundle import imgui

from splatgl.annotations.text import plain
from splatgl.data.color import linear_from_srgb, srgb_of_name
from splatgl.viewer.document import Document
from splatgl.viewer.layer_splats import LayerSplats
from splatgl.viewer.panel_sections import OPACITY, label_left, pick_color, pick_opacity, shorten
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

# rows that are visible at a time, share of the slider of an opacity, and width of the field of a name, screen units
ROWS, SLIDER, MENU = 10, 0.75, 240.0
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
        state = state if style is state.style else state.with_style(state.selected, style)
        return state if target is None else _show_whole(state, document, layer, target)


def _row(style: LayerStyle, segment: Segment) -> tuple[LayerStyle, bool]:
    """Widgets of a segment. Returns the edited style, and whether the view is to show the segment."""
    imgui.push_id(str(segment.number))
    number = segment.number
    room = imgui.get_content_region_avail().x
    changed, is_shown = imgui.checkbox("##seen", number not in style.hidden)
    imgui.set_item_tooltip("Whether it is drawn.")
    if changed:
        style = with_shown(style, [number], is_shown)
    color = pick_color(tuple(map(float, linear_from_srgb(np.array(srgb_of_name(segment.color)) / 255))))
    imgui.same_line()
    imgui.align_text_to_frame_padding()
    wide = _name_width(room)
    clicked = imgui.selectable(shorten(plain(segment.name), wide), False, size=(wide, 0.0))[0]
    imgui.set_item_tooltip(
        f"{plain(segment.name)}, number {number}: a click centres it and fits the view to it, a right click renames it."
    )
    style = _rename(style, segment)
    opacity = pick_opacity(segment.opacity, room * SLIDER)
    if color is not None or opacity != segment.opacity:
        style = with_look(style, number, color or segment.color, opacity)
    imgui.same_line()
    if imgui.small_button(ONLY):
        style = with_only(style, number)
    imgui.set_item_tooltip("Shows it, and hides all others.")
    imgui.pop_id()
    return style, clicked


def _name_width(room: float) -> float:
    """Width of a name in a row, of which a tick, a colour, a slider and a button take the rest."""
    style = imgui.get_style()
    button = imgui.calc_text_size(ONLY).x + 2 * style.frame_padding.x
    return room - 2 * imgui.get_frame_height() - room * SLIDER * OPACITY - button - 4 * style.item_spacing.x


def _rename(style: LayerStyle, segment: Segment) -> LayerStyle:
    """Field of a segment's name, which a right click on the last widget opens. Returns the edited style."""
    imgui.set_next_window_size((MENU * imgui.get_style().font_scale_main, 0.0))
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

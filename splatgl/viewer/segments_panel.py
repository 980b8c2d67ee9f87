"""`SegmentList`: the panel's list of the segments of a layer. Extra `gui`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from imgui_bundle import imgui

from splatgl.annotations.text import plain
from splatgl.data.color import linear_from_srgb, srgb_of_name
from splatgl.viewer.document import Document, LayerSplats
from splatgl.viewer.panel_sections import pick_color, pick_opacity
from splatgl.viewer.segments import (
    Segment,
    find_segments,
    list_segments,
    segment_corners,
    with_look,
    with_only,
    with_shown,
)
from splatgl.viewer.state import LayerStyle, State

# rows that are visible at a time, and the share of the panel's width that names take
ROWS, NAME = 10, 0.4


class SegmentList:
    """Draws the list. typed: words of the names, or the number, of the segments that are listed."""

    def __init__(self) -> None:
        self.typed = ""

    def draw(self, state: State, document: Document, layer: LayerSplats) -> State:
        """The list and its search; returns the edited state."""
        style = state.style
        segments = find_segments(self.typed, list_segments(tuple(style.base.labels), layer.volume.labels))
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
    clicked = imgui.selectable(plain(segment.name), False, size=(room * NAME, 0.0))[0]
    imgui.set_item_tooltip(f"{plain(segment.name)}, number {number}: a click centres it, and fits the view to it.")
    opacity = pick_opacity(segment.opacity, room * 0.75)
    if color is not None or opacity != segment.opacity:
        style = with_look(style, number, color or segment.color, opacity)
    imgui.same_line()
    if imgui.small_button("only"):
        style = with_only(style, number)
    imgui.set_item_tooltip("Shows it, and hides all others.")
    imgui.pop_id()
    return style, clicked


def _show_whole(state: State, document: Document, layer: LayerSplats, segment: Segment) -> State:
    """The state with its view centred on a segment, and fitted to it."""
    corners = segment_corners(layer.volume.placed(document.volume.frame), segment.number)
    if corners is None:
        return replace(state, message=f"no voxel of {layer.name} is {segment.name}")
    return replace(state, pose=state.pose.fitted(corners), message="")

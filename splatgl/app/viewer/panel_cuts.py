"""The panel's controls of cuts: the box's sides in voxels, and planes. Extra `gui`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from imgui_bundle import imgui

from splatgl.app.viewer.content import Content
from splatgl.app.viewer.cutting import MOST_PLANES, Cuts, add_plane, cut
from splatgl.app.viewer.marking import plane_color
from splatgl.app.viewer.state import State
from splatgl.data.volume import Volume
from splatgl.splat.clipping import Plane


def draw(state: State, content: Content) -> State:
    """The section's controls; returns the edited state."""
    cuts, volume = state.cuts, content.volume
    _, shown = imgui.checkbox("handles", cuts.shown)
    imgui.set_item_tooltip("Dots in the view that move the box's sides and the planes (x).")
    imgui.same_line()
    _, active = imgui.checkbox("cut", cuts.active)
    imgui.set_item_tooltip("With and without the cuts (shift+x).")
    cuts = _box(replace(cuts, shown=shown, active=active), volume)
    cuts = _planes(cuts, volume)
    state = cut(state, content, cuts)
    if len(state.cuts.planes) < MOST_PLANES:
        state = _more(state, content)
    if state.cuts.any:
        imgui.same_line()
        if imgui.button("no cuts"):
            state = cut(state, content, Cuts(shown=state.cuts.shown))
    return state


def _box(cuts: Cuts, volume: Volume) -> Cuts:
    """Two ends of each side, in voxels as --crop counts them."""
    for axis, size in enumerate(volume.shape[::-1]):
        low, high = (round(share * size) for share in cuts.sides[axis])
        changed, begin, end = imgui.drag_int_range2(f"{'xyz'[axis]}##side", low, high, max(size / 400, 0.2), 0, size)
        imgui.set_item_tooltip(f"Voxels along {'xyz'[axis]} that the box keeps, as in --crop: drag, or ctrl+click.")
        if changed and begin < end:
            sides = list(cuts.sides)
            sides[axis] = max(begin, 0) / size, min(end, size) / size
            cuts = replace(cuts, sides=tuple(sides), active=True)
    return cuts


def _planes(cuts: Cuts, volume: Volume) -> Cuts:
    """Each plane's place along its normal, turning it round, and removing it."""
    corners, unit = volume.corners, volume.unit or "units"
    for number, plane in enumerate(cuts.planes):
        imgui.push_id(number)
        along = corners @ np.array(plane[:3])
        imgui.push_style_color(imgui.Col_.slider_grab, imgui.ImVec4(*plane_color(cuts, number)))
        imgui.set_next_item_width(imgui.get_content_region_avail().x * 0.55)
        ends = float(along.min()), float(along.max())
        changed, place = imgui.slider_float("##place", plane[3], *ends, f"%.4g {unit}")
        imgui.pop_style_color()
        imgui.set_item_tooltip("Normal {:.3g}, {:.3g}, {:.3g}: what lies beyond this place is kept.".format(*plane[:3]))
        if changed:
            cuts = replace(cuts.with_plane(number, (*plane[:3], place)), active=True)
        imgui.same_line()
        if imgui.button("turn round"):
            cuts = cuts.with_plane(number, [-each for each in plane])
        imgui.same_line()
        removed = imgui.button("remove")
        imgui.pop_id()
        if removed:
            return cuts.without(number)
    return cuts


def _more(state: State, content: Content) -> State:
    """Buttons that add a plane."""
    imgui.align_text_to_frame_padding()
    imgui.text("plane")
    normals: dict[str, Plane | None] = {"view": None, "x": (1, 0, 0, 0), "y": (0, 1, 0, 0), "z": (0, 0, 1, 0)}
    for name, normal in normals.items():
        imgui.same_line()
        if imgui.button(f"+ {name}"):
            state = add_plane(state, content, normal and normal[:3])
        towards = "that faces you (ctrl+x)" if normal is None else f"across world {name}"
        imgui.set_item_tooltip(f"One more plane {towards}.")
    return state

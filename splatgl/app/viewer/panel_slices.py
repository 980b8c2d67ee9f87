"""The panel's controls of the slices. Extra `gui`."""

from __future__ import annotations

from dataclasses import replace

from imgui_bundle import imgui

from splatgl.app.viewer.content import Content
from splatgl.app.viewer.state import State


def draw(state: State, content: Content) -> State:
    """The section's controls; returns the edited state."""
    slices, volume = state.slices, content.volume
    _, shown = imgui.checkbox("slices", slices.shown)
    imgui.set_item_tooltip("Three slices beside the picture (z): the wheel moves one, a click moves the others there.")
    imgui.same_line()
    _, colored = imgui.checkbox("colours of values", slices.colored)
    imgui.set_item_tooltip("As the transfer function colours values, else grey by its window (shift+z).")
    slices = replace(slices, shown=shown, colored=colored)
    if shown:
        index = list(slices.index(volume))
        for axis, size in enumerate(volume.shape[::-1]):
            changed, place = imgui.slider_int(f"{'xyz'[axis]}##slice", index[axis], 0, size - 1)
            if changed:
                index[axis] = place
                slices = slices.at(index, volume)
    return state if slices == state.slices else replace(state, slices=slices)

"""The panel's controls of the view: standard views, what is laid over it, and what is around it. Extra `gui`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from imgui_bundle import imgui

from splatgl.app.viewer.content import Content
from splatgl.app.viewer.legend import ground_of, toggled
from splatgl.app.viewer.measuring import Ruler
from splatgl.app.viewer.moves import ALONG, ANATOMY, name_of
from splatgl.app.viewer.state import State, acted
from splatgl.data.color import linear_from_srgb, srgb_from_linear
from splatgl.gl.screen import GROUNDS

# what is laid over the picture, and where it is
OVER = {
    "axes": "The directions of x, y and z, at the lower left (j).",
    "scale": "A length at the depth of the volume's middle, at the lower right (j).",
    "colorbar": "The colours and opacities of values (shift+j).",
    "box": "The volume's box with numbers along its edges (ctrl+j).",
    "directions": "Letters of the patient's directions at the edges.",
}


CUES = {
    "ambient_occlusion": (
        "ambient occl.",
        "Ambient occlusion: how much matter keeps ambient light off what is in or behind it; 0 is off.",
    ),
    "shadows": ("shadows", "How dark shadows are; a light at the eye is then above left; 0 is off."),
}


def draw(state: State, content: Content) -> State:
    """The section's controls; returns the edited state."""
    frame = content.volume.frame
    order = ("front", "back", "left", "right", "top", "bottom")
    names = {view: (ANATOMY if frame else ALONG)[view] for view in order}
    for view in _flow(list(names), 3 if frame else 6):
        if imgui.button(f"{names[view]}##view"):
            state = acted(state, view, content)
        imgui.set_item_tooltip(f"{name_of(view, frame)}, as {'3D Slicer' if frame else 'ParaView'} names it.")
    for number, (action, name, on) in enumerate(
        (
            ("projection", "orthographic", not state.pose.camera.perspective),
            ("turntable", "turntable", state.turntable),
            ("fullscreen", "fullscreen", state.fullscreen),
        )
    ):
        if number:
            imgui.same_line()
        if imgui.checkbox(name, on)[0]:
            state = acted(state, action, content)
    state = _over(state, content)
    return _ground(state)


def _over(state: State, content: Content) -> State:
    """What is laid over the picture."""
    shown = [name for name in OVER if name != "directions" or content.volume.frame]
    for name in _flow(shown, 4):
        if imgui.checkbox(name, name in state.annotate)[0]:
            state = replace(state, annotate=toggled(state.annotate, name))
        imgui.set_item_tooltip(OVER[name])
    if imgui.checkbox("value under the cursor", state.probe)[0]:
        state = replace(state, probe=not state.probe)
    imgui.same_line()
    changed, measuring = imgui.checkbox("distance", state.ruler.active or bool(state.ruler.points))
    imgui.set_item_tooltip("Click on two points of what is seen (e).")
    return replace(state, ruler=Ruler(active=measuring)) if changed else state


def cues(state: State) -> State:
    """What shows shape by the light that matter takes away; it takes a moment after every edit of a curve."""
    for name, (label, about) in CUES.items():
        changed, strength = imgui.slider_float(label, getattr(state.settings, name), 0.0, 1.0, "%.2f")
        imgui.set_item_tooltip(about)
        if changed:
            settings = state.settings.but(**{name: round(min(max(strength, 0.0), 1.0), 2)})
            state = replace(state, settings=settings)
    return state


def _ground(state: State) -> State:
    """What is behind the picture."""
    names = [*GROUNDS, "a colour"]
    own = state.settings.background is not None
    changed, chosen = imgui.combo("ground", len(GROUNDS) if own else GROUNDS.index(state.ground), names)
    if changed and chosen < len(GROUNDS):
        return replace(state, ground=GROUNDS[chosen], settings=state.settings.but(background=None))
    if changed:
        return replace(state, settings=state.settings.but(background=ground_of(state)))
    if own:
        coded = srgb_from_linear(np.array(state.settings.background))
        changed, color = imgui.color_edit3("colour", list(map(float, coded)))
        if changed:
            linear = linear_from_srgb(np.clip(np.array(color), 0.0, 1.0))
            return replace(state, settings=state.settings.but(background=tuple(map(float, linear))))
    return state


def _flow(names: Sequence[str], per_row: int) -> Iterator[str]:
    """The names, each with its widget on the line of the one before, but for every so many."""
    for number, name in enumerate(names):
        if number % per_row:
            imgui.same_line()
        yield name

"""The panel's list of layers, channels and meshes, and of what else a file holds. Extra `gui`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from imgui_bundle import imgui

from splatgl.annotations.text import plain
from splatgl.app.viewer.content import Content
from splatgl.app.viewer.parts import Look
from splatgl.app.viewer.state import State
from splatgl.data.color import srgb_from_linear
from splatgl.scene.meshes import MeshFile, is_mesh
from splatgl.splat.colormaps import colormap

# shares of the panel's width
NAME, OPACITY = 0.42, 0.26
# digits of a step of opacity
DIGITS = 3


def draw(state: State, content: Content) -> State:
    """The section's controls; returns the edited state."""
    for number, look in enumerate(state.looks[: len(content.names)]):
        # a mesh alone stands on a volume of nothing
        if not is_mesh(content.part(number).scene.volume):
            imgui.push_id(number)
            state = _layer(state, content, number, look)
            imgui.pop_id()
    for number, mesh in enumerate(state.meshes):
        imgui.push_id(f"mesh {number}")
        changed = _mesh(content, mesh)
        if changed != mesh:
            meshes = (*state.meshes[:number], changed, *state.meshes[number + 1 :])
            state = replace(state, meshes=meshes)
        imgui.pop_id()
    return state


def pick(state: State, content: Content) -> State:
    """Lists of a file's arrays and channels, which open what is picked."""
    for each in state.picks:
        now = each.number(content.scene.load)
        changed, chosen = imgui.combo(each.option, now, [plain(text) for text in each.texts])
        imgui.set_item_tooltip("What the file holds beside it: opens that, with the view and settings of this.")
        if changed and chosen != now:
            state = replace(state, picked=(each.option, each.found[chosen][0]))
    return state


def _layer(state: State, content: Content, number: int, look: Look) -> State:
    """Whether it is seen, its name, opacity, and colour where it is one."""
    _, visible = imgui.checkbox("##seen", look.visible)
    imgui.set_item_tooltip("Whether it is drawn.")
    imgui.same_line()
    room = imgui.get_content_region_avail().x
    if imgui.selectable(plain(content.names[number]), state.selected == number, size=(room * NAME, 0.0))[0]:
        state = state.selecting(number)
    imgui.set_item_tooltip("Select it: the transfer function below, and the keys, are those of what is selected.")
    opacity = _opacity(look.opacity, room)
    made = replace(look, visible=visible, opacity=opacity)
    # of others the colour map is chosen below
    if look.base.colormap.startswith("#"):
        color = _color(tuple(map(float, colormap(look.base.colormap)[-1])))
        made = made if color is None else replace(made, base=replace(look.base, colormap=color))
    return state if made == look else state.looking(number, made)


def _mesh(content: Content, mesh: MeshFile) -> MeshFile:
    _, visible = imgui.checkbox("##seen", mesh.visible)
    imgui.set_item_tooltip("Whether it is drawn.")
    imgui.same_line()
    room, left = imgui.get_content_region_avail().x, imgui.get_cursor_pos_x()
    imgui.text(plain(mesh.name))
    opacity = _opacity(mesh.opacity, room, left + room * NAME + imgui.get_style().item_spacing.x)
    found = content.mesh(mesh)
    own = found is not None and found.colors is None and found.values is None
    given = mesh.linear or (found.color if found is not None and own else None)
    # those of its vertices and values are many, until one is picked
    color = _color((0.5, 0.5, 0.5) if given is None else tuple(map(float, given)))
    return replace(mesh, visible=visible, opacity=opacity, color=mesh.color if color is None else color)


def _opacity(opacity: float, room: float, left: float = 0.0) -> float:
    imgui.same_line(left)
    imgui.set_next_item_width(room * OPACITY)
    changed, found = imgui.slider_float("##opacity", opacity, 0.0, 1.0, "%.2f")
    imgui.set_item_tooltip("A factor on its opacities.")
    return round(float(np.clip(found, 0.0, 1.0)), DIGITS) if changed else opacity


def _color(linear: tuple[float, ...]) -> str | None:
    """A colour's field; "#rrggbb" where another one is picked."""
    imgui.same_line()
    coded = list(map(float, srgb_from_linear(np.clip(np.array(linear), 0.0, 1.0))))
    flags = imgui.ColorEditFlags_.no_inputs | imgui.ColorEditFlags_.no_label
    changed, picked = imgui.color_edit3("colour", coded, flags)
    if not changed:
        return None
    return "#{:02x}{:02x}{:02x}".format(*(round(255 * min(max(part, 0.0), 1.0)) for part in picked))

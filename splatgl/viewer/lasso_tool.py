"""Scissors in the window: a drag draws an outline, and what lies under it is removed, or kept alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from splatgl.errors import InputError
from splatgl.geometry.scissors import MOST_CORNERS, Scissors
from splatgl.gl.screen import LineColor, Stroke
from splatgl.scene.meshes import is_mesh
from splatgl.viewer.state import Lasso
from splatgl.viewer.tool import Pointer, Tool, View

if TYPE_CHECKING:
    from splatgl.viewer.document import Document
    from splatgl.viewer.state import State

# distance between two corners of an outline, pixels at a content scale of 1; the line's colour, sRGB, and width
APART, COLOR, LINE = 3.0, (1.0, 0.35, 0.3, 1.0), 2.0
HOW = "draw around what to remove", "draw around what to keep"
BAD = "draw around a part of the volume, not all of it"
NO_VOLUME = "scissors cut volumes, not meshes"


def start_lasso(keep: bool) -> Callable[[State, Document], State]:
    """A command after which a drag draws an outline, or no longer does. keep: what lies under it."""

    def start(state: State, document: Document) -> State:
        if state.lasso.active and state.lasso.keep == keep:
            return replace(state, lasso=Lasso())
        if all(is_mesh(layer.scene.volume) for layer in document.layers):
            return replace(state, message=NO_VOLUME)
        return replace(state, lasso=Lasso(active=True, keep=keep), message=HOW[keep])

    return start


def cut_along(state: State, document: Document) -> State:
    """The state whose layers are cut along the outline of the lasso; only a message if that leaves nothing."""
    camera, first = state.pose.camera, document.layers[0]
    try:
        outline = np.array(state.lasso.points).reshape(-1, 2) / camera.size
        scissors = Scissors(outline, state.lasso.keep, camera, *document.volume.world)
        # of few voxels, whatever the size of the volume
        replace(first, volumes=first.volumes[-1:]).within(document.world, (*first.scissors, scissors))
    except InputError:
        return replace(state, lasso=replace(state.lasso, points=()), message=BAD)
    styles = tuple(replace(style, scissors=(*style.scissors, scissors)) for style in state.styles)
    return replace(state, styles=styles, lasso=Lasso(), message="cut; ctrl+z brings it back")


def lasso_strokes(lasso: Lasso, scale: float) -> list[Stroke]:
    """The outline that is drawn, pixels."""
    color: LineColor = COLOR
    return [Stroke(*ends, color, LINE * scale) for ends in pairwise(lasso.points)]


class LassoTool(Tool):
    """Draws an outline by a drag, once a command has asked for one."""

    def press(self, state: State, document: Document, view: View, pointer: Pointer) -> State | None:
        """Begins an outline."""
        if not state.lasso.active or pointer.button != "left" or pointer.modifiers or document.is_loading:
            return None
        return replace(state, lasso=replace(state.lasso, points=(pointer.place,)))

    def move(self, state: State, document: Document, view: View, pointer: Pointer) -> State | None:
        """Draws it on."""
        points = state.lasso.points
        if not points:
            return None
        if np.hypot(*np.subtract(pointer.place, points[-1])) < APART * view.scale or len(points) >= MOST_CORNERS:
            return state
        return replace(state, lasso=replace(state.lasso, points=(*points, pointer.place)))

    def release(self, state: State, document: Document, view: View, pointer: Pointer) -> State | None:
        """Cuts along it."""
        return cut_along(state, document) if pointer.button == "left" and state.lasso.points else None

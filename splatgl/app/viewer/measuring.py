"""The value under the cursor, and the distance between two picked points."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np

from splatgl.annotations.scale_bar import length_text
from splatgl.app.viewer.sight import Place
from splatgl.data.volume import Triple
from splatgl.errors import InputError
from splatgl.reference.pick import Picked, pick
from splatgl.splat.scene import Layer, Scene

if TYPE_CHECKING:
    from splatgl.app.viewer.content import Content
    from splatgl.app.viewer.state import State

# blends that show a largest value along the ray
LARGEST = ("mip",)
FIRST = "click on the first point; a drag turns the view"
SECOND = "click on the second point"


@dataclass(frozen=True)
class Ruler:
    """points: those picked, world units, at most two. active: whether clicks pick them."""

    points: tuple[Triple, ...] = ()
    active: bool = False

    @property
    def length(self) -> float | None:
        """World length between both points; None until there are two."""
        return float(np.linalg.norm(np.subtract(*self.points))) if len(self.points) == 2 else None

    def with_point(self, point: Triple) -> Ruler:
        """With one more point; after two it begins anew."""
        return replace(self, points=(*(self.points if len(self.points) < 2 else ()), point))


def under_cursor(state: State, content: Content, place: Place) -> Picked | None:
    """What is seen under a position in pixels; None where nothing is, or the volume is not in memory."""
    pixel = tuple(int(np.floor(each)) for each in place)
    width, height = state.pose.camera.size
    if content.waiting or not (0 <= pixel[0] < width and 0 <= pixel[1] < height):
        return None
    mode = "max" if state.settings.blend in LARGEST else "first"
    try:
        return pick(_scene(state, content), state.pose.camera, pixel, mode=mode)
    except InputError:
        return None


def told(found: Picked | None, content: Content) -> tuple[str, ...]:
    """Value, place and index in words."""
    if found is None:
        return ("nothing here",)
    unit = content.volume.unit
    place = ", ".join(f"{each:.4g}" for each in found.place)
    if found.mesh is not None:
        return (found.name or "mesh", f"at {place}{' ' + unit if unit else ''}")
    index = ", ".join(f"{each:.0f}" for each in found.index)
    return (
        f"{found.name or 'value'}: {found.value:.6g}",
        f"at {place}{' ' + unit if unit else ''}",
        f"voxel {index}",
    )


def clicked(state: State, content: Content, place: Place) -> State:
    """The state after a click while distances are measured."""
    found = under_cursor(state, content, place)
    if found is None:
        return replace(state, message="nothing here to measure from")
    ruler = state.ruler.with_point(found.place)
    length = distance(ruler, content)
    return replace(state, ruler=ruler, message=f"distance {length}" if length else SECOND)


def distance(ruler: Ruler, content: Content) -> str:
    """The length of the line in words; "" until there are two points."""
    length = ruler.length
    return "" if length is None else length_text(float(f"{length:.4g}"), content.volume.unit)


# what the latest values of a content were picked from, of these looks and cuts
_latest: WeakKeyDictionary[Content, tuple[tuple[object, ...], Scene]] = WeakKeyDictionary()


def _scene(state: State, content: Content) -> Scene:
    key, known = (state.looks, state.settings.clip), _latest.get(content)
    if known is None or known[0] != key:
        scene, _ = content.subject_at(1, state.settings)
        if not isinstance(scene, Scene):
            layer = Layer(content.volume, state.looks[0].transfer, threshold=state.threshold)
            scene = Scene([layer], state.settings.clip)
        known = _latest[content] = key, scene
    return known[1]


def _probe(state: State, content: Content) -> State:
    said = "" if state.probe else "the value under the cursor"
    return replace(state, probe=not state.probe, message=said)


def _measure(state: State, content: Content) -> State:
    if state.ruler.active:
        return replace(state, ruler=Ruler(state.ruler.points))
    if state.ruler.points:
        return replace(state, ruler=Ruler())
    return replace(state, ruler=Ruler(active=True), message=FIRST)


ACTIONS: dict[str, Any] = {"probe": _probe, "measure": _measure}

"""`Legend`: annotations in the window, as `render` lays them over a picture; drawn again only where they changed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.annotations.annotate import LEAST_SIDE
from splatgl.annotations.canvas import BLACK, WHITE, Color, Subject
from splatgl.annotations.live import LiveOverlay, usual
from splatgl.data.volume import Volume
from splatgl.gl.screen import Sprite
from splatgl.splat.camera import Camera
from splatgl.splat.transfer import Transfer

if TYPE_CHECKING:
    from splatgl.app.viewer.content import Content
    from splatgl.app.viewer.state import State

# of a ground of checks, linear light
GREY = 0.075
# pixels of empty rows or columns that are drawn with what is beside them
GAP = 16


@dataclass(frozen=True, eq=False)
class Scenery:
    """What annotations are drawn for. blend: of the picture; ground: behind it, linear RGB."""

    asked: tuple[str, ...]
    volume: Volume
    transfer: Transfer
    camera: Camera
    blend: str
    ground: Color


class Legend:
    """The latest sprites."""

    def __init__(self) -> None:
        self.overlay = LiveOverlay()
        self.key: tuple[object, ...] = ()
        self.latest: tuple[Sprite, ...] = ()
        self.subject: tuple[Volume | None, Subject | None] = (None, None)

    def sprites(self, scenery: Scenery) -> tuple[Sprite, ...]:
        """Those of a picture of the camera's size; none for one that is too small."""
        camera = scenery.camera
        if not scenery.asked or min(camera.size) < LEAST_SIDE:
            return ()
        seen = camera.eye.tobytes(), camera.eye_from_world.tobytes(), camera.extent, camera.perspective
        key = scenery.asked, scenery.volume, scenery.transfer, scenery.blend, scenery.ground, camera.size, *seen
        if key != self.key:
            subject = self._subject(scenery.volume)
            look = scenery.transfer, camera, scenery.asked, scenery.ground, scenery.blend
            self.key, self.latest = key, cropped(self.overlay.drawn(subject, *look))
        return self.latest

    def _subject(self, volume: Volume) -> Subject:
        if self.subject[1] is None or self.subject[0] is not volume:
            self.subject = volume, Subject.of(volume)
        found = self.subject[1]
        assert found is not None
        return found


def cropped(pixels: np.ndarray) -> tuple[Sprite, ...]:
    """What is not clear of a picture uint8 [H, W, 4], in bands, each as wide as what it shows."""
    found = []
    for top, bottom in _spans(np.asarray(pixels[..., 3].any(axis=1))):
        for left, right in _spans(np.asarray(pixels[top:bottom, :, 3].any(axis=0))):
            found.append(Sprite(pixels[top:bottom, left:right].copy(), (left, top, right, bottom)))
    return tuple(found)


def _spans(full: np.ndarray) -> list[tuple[int, int]]:
    """Beginnings and ends of what is full; gaps of less than GAP are part of it."""
    places = np.flatnonzero(full)
    if not len(places):
        return []
    ends = np.flatnonzero(np.diff(places) > GAP)
    starts = [places[0], *places[ends + 1]]
    return [(int(a), int(b) + 1) for a, b in zip(starts, [*places[ends], places[-1]], strict=True)]


def ground_of(state: State) -> Color:
    """What is behind the picture, linear RGB."""
    if state.settings.background is not None:
        return state.settings.background
    return {"white": WHITE, "checks": (GREY, GREY, GREY)}.get(state.ground, BLACK)


def usual_of(content: Content) -> tuple[str, ...]:
    """What a window shows of a content unless its scene asks for other annotations."""
    return content.scene.annotate or usual(Subject.of(content.volume))


def toggled(asked: tuple[str, ...], name: str) -> tuple[str, ...]:
    """With or without one of them."""
    return tuple(one for one in asked if one != name) if name in asked else (*asked, name)


def _usual(state: State, content: Content) -> State:
    names = usual(Subject.of(content.volume))
    rest = tuple(one for one in state.annotate if one not in names)
    return replace(state, annotate=rest if set(names) & set(state.annotate) else (*names, *rest))


def _color_bar(state: State, content: Content) -> State:
    said = "voxels have colours of their own: no colour bar" if content.volume.color is not None else ""
    return replace(state, annotate=toggled(state.annotate, "colorbar"), message=said)


def _box(state: State, content: Content) -> State:
    return replace(state, annotate=toggled(state.annotate, "box"))


ACTIONS: dict[str, Any] = {"annotations": _usual, "colorbar": _color_bar, "box": _box}

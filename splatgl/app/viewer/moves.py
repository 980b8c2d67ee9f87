"""The camera by keys, standard views by their names, and what is around the picture: light, ground, fullscreen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.app.viewer.pose import NOTCH, Pose
from splatgl.data.color import linear_from_srgb
from splatgl.gl.screen import GROUNDS
from splatgl.splat.camera import Camera
from splatgl.splat.settings import choices

if TYPE_CHECKING:
    from splatgl.app.viewer.content import Content
    from splatgl.app.viewer.state import State

Action = Callable[["State", "Content"], "State"]

# degrees per key press
TURN, ROLL = 10.0, 10.0
# azimuth and elevation of the standard views in degrees: the front is a scene's azimuth 0. A patient's right is that of
# 3D Slicer, at the viewer's left from the front.
VIEWS = {
    "isometric": (45.0, 35.264),
    "front": (0.0, 0.0),
    "back": (180.0, 0.0),
    "right": (90.0, 0.0),
    "left": (-90.0, 0.0),
    "top": (0.0, 90.0),
    "bottom": (0.0, -90.0),
}
# names by 3D Slicer, of data with anatomy, and by ParaView, which names the direction of the view, of others
ANATOMY = {"front": "Anterior", "back": "Posterior", "right": "Right", "left": "Left"}
ANATOMY |= {"top": "Superior", "bottom": "Inferior"}
ALONG = {"front": "+Y", "back": "-Y", "right": "-X", "left": "+X", "top": "-Z", "bottom": "+Z"}
# sRGB grounds of one's own that a key goes through after those of the screen
COLORS = {"grey": (0.5, 0.5, 0.5), "blue": (0.32, 0.34, 0.43)}


def name_of(view: str, frame: str | None) -> str:
    """What a standard view is called."""
    if view == "isometric":
        return "isometric"
    return f"{ANATOMY[view]} view" if frame else f"view along {ALONG[view]}"


def angles(view: str, frame: str | None) -> tuple[float, float]:
    """Azimuth and elevation of a standard view of data in a frame: LPS, RAS or None."""
    azimuth, elevation = VIEWS[view]
    # a patient's right is at the viewer's left
    if frame and view in ("left", "right"):
        azimuth = -azimuth
    return azimuth, elevation


def up_of(content: Content) -> np.ndarray:
    """The scene's up direction."""
    up = np.asarray(content.scene.view.up or content.volume.hints.up or (0.0, 0.0, 1.0), dtype=np.float64)
    return np.asarray(up / np.linalg.norm(up))


def view(name: str) -> Action:
    """The action that shows a standard view."""

    def look(state: State, content: Content) -> State:
        frame, pose, up = content.volume.frame, state.pose, up_of(content)
        camera = Camera.orbit(content.subject, *angles(name, frame), pose.fov, pose.camera.size, up=up)
        seen = replace(pose, camera=camera, pivot=content.middle)
        pose = seen if pose.camera.perspective else seen.switched()
        return replace(state, pose=pose, turning=False, message=name_of(name, frame))

    return look


def _moved(move: Callable[[Pose, np.ndarray], Pose]) -> Action:
    return lambda state, content: replace(state, pose=move(state.pose, up_of(content)), turning=False)


def _middle(pose: Pose) -> tuple[float, float]:
    return pose.camera.size[0] / 2, pose.camera.size[1] / 2


def _turntable(state: State, content: Content) -> State:
    said = "trackball: a drag turns about any axis" if state.turntable else "turntable: up stays up"
    return replace(state, turntable=not state.turntable, message=said)


def _ground(state: State, content: Content) -> State:
    own = state.settings.background
    names = (*GROUNDS, *COLORS)
    colors = {name: tuple(map(float, linear_from_srgb(np.array(rgb)))) for name, rgb in COLORS.items()}
    now = state.ground if own is None else next((name for name, rgb in colors.items() if rgb == own), names[-1])
    name = names[(names.index(now) + 1) % len(names)]
    background = colors.get(name)
    ground = state.ground if name in COLORS else name
    return replace(state, ground=ground, settings=state.settings.but(background=background), message=f"on {name}")


def _light(state: State, content: Content) -> State:
    allowed = choices()["light"]
    light = allowed[(allowed.index(state.settings.light) + 1) % len(allowed)]
    return replace(state, settings=state.settings.but(light=light), message=f"light {light}")


def _fullscreen(state: State, content: Content) -> State:
    return replace(state, fullscreen=not state.fullscreen)


ACTIONS: dict[str, Any] = {
    **{name: view(name) for name in VIEWS},
    "turn-left": _moved(lambda pose, up: pose.spun(-TURN, up)),
    "turn-right": _moved(lambda pose, up: pose.spun(TURN, up)),
    "turn-up": _moved(lambda pose, up: pose.lifted(TURN)),
    "turn-down": _moved(lambda pose, up: pose.lifted(-TURN)),
    "zoom-in": _moved(lambda pose, up: pose.zoomed(_middle(pose), NOTCH)),
    "zoom-out": _moved(lambda pose, up: pose.zoomed(_middle(pose), 1 / NOTCH)),
    "roll-left": _moved(lambda pose, up: pose.tipped(-ROLL)),
    "roll-right": _moved(lambda pose, up: pose.tipped(ROLL)),
    "turntable": _turntable,
    "ground": _ground,
    "light": _light,
    "fullscreen": _fullscreen,
}

"""All actions of the window: functions from one state to the next."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from splatgl.annotations.annotate import ANNOTATIONS, default_names
from splatgl.annotations.canvas import Annotation, Subject
from splatgl.data.color import linear_from_srgb
from splatgl.errors import InputError
from splatgl.gl.screen import GROUNDS
from splatgl.splat.camera import Camera
from splatgl.splat.clipping import Plane
from splatgl.splat.plan import plan
from splatgl.splat.settings import BLENDS, Settings, choices
from splatgl.viewer.adaptive_quality import STRIDES
from splatgl.viewer.clip_tool import FULL, cut
from splatgl.viewer.document import Document
from splatgl.viewer.measure_tool import FIRST
from splatgl.viewer.state import BLURS, COMPARE, HUDS, MOST_PLANES, Cuts, Ruler, State, _next
from splatgl.viewer.trackball import NOTCH, Pose, up_of


def facing(state: State, document: Document) -> Plane:
    """A plane through the middle of what is left that cuts off what is towards the eye, and looks at it."""
    forward, middle = state.pose.camera.forward, document.volume.corners.mean(axis=0)
    return (*map(float, forward), float(forward @ middle))  # type: ignore[return-value]


def add_plane(state: State, document: Document, normal: Sequence[float] | None = None) -> State:
    """With one more plane through the volume's middle. normal: towards what is kept; None: away from the eye."""
    cuts = state.cuts
    if len(cuts.planes) >= MOST_PLANES:
        return replace(state, message=FULL)
    plane = facing(state, document)
    if normal is not None:
        along = np.asarray(normal, np.float64)
        plane = (*map(float, along), float(along @ document.volume.corners.mean(axis=0)))  # type: ignore[assignment]
    return cut(state, document, replace(cuts.with_plane(len(cuts.planes), plane), active=True, shown=True))


def _handles(state: State, document: Document) -> State:
    cuts = replace(state.cuts, shown=not state.cuts.shown)
    said = "drag the dots to cut; shift+x: with and without the cuts" if cuts.shown else ""
    return replace(cut(state, document, cuts), message=said)


def _active(state: State, document: Document) -> State:
    if not state.cuts.any:
        return replace(state, message="nothing is cut: x shows the handles, ctrl+x makes a plane")
    cuts = replace(state.cuts, active=not state.cuts.active)
    return replace(cut(state, document, cuts), message=f"cuts {'on' if cuts.active else 'off'}")


def _plane(state: State, document: Document) -> State:
    found = add_plane(state, document)
    return (
        found if found.message else replace(found, message="drag its dot up or down; turn the view to reach its arrow")
    )


def _uncut(state: State, document: Document) -> State:
    if not state.cuts.any:
        return replace(state, message="nothing is cut")
    return replace(cut(state, document, Cuts(shown=state.cuts.shown)), message="nothing is cut any more")


CLIP_ACTIONS: dict[str, Any] = {"handles": _handles, "cuts": _active, "plane": _plane, "uncut": _uncut}


def toggled(asked: tuple[str, ...], name: str) -> tuple[str, ...]:
    """With or without one of them."""
    return tuple(one for one in asked if one != name) if name in asked else (*asked, name)


def _usual(state: State, document: Document) -> State:
    names = default_names(Subject.of(document.volume))
    rest = tuple(one for one in state.annotate if one not in names)
    return replace(state, annotate=rest if set(names) & set(state.annotate) else (*names, *rest))


def _annotation(row: Annotation, state: State, document: Document) -> State:
    """The state with an annotation switched on or off."""
    missing = row.needs_values and document.volume.color is not None
    said = f"voxels have colours of their own: no {row.title}" if missing else ""
    return replace(state, annotate=toggled(state.annotate, row.name), message=said)


ANNOTATION_ACTIONS: dict[str, Any] = {
    "annotations": _usual,
    **{row.name: partial(_annotation, row) for row in ANNOTATIONS.values() if row.key and not row.default},
}


def _probe(state: State, document: Document) -> State:
    said = "" if state.probe else "the value under the cursor"
    return replace(state, probe=not state.probe, message=said)


def _measure(state: State, document: Document) -> State:
    if state.ruler.active:
        return replace(state, ruler=Ruler(state.ruler.points))
    if state.ruler.points:
        return replace(state, ruler=Ruler())
    return replace(state, ruler=Ruler(active=True), message=FIRST)


MEASURE_ACTIONS: dict[str, Any] = {"probe": _probe, "measure": _measure}


Action = Callable[[State, Document], State]

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


def view(name: str) -> Action:
    """The action that shows a standard view."""

    def look(state: State, document: Document) -> State:
        frame, pose, up = document.volume.frame, state.pose, up_of(document)
        camera = Camera.orbit(document.subject, *angles(name, frame), pose.fov, pose.camera.size, up=up)
        seen = replace(pose, camera=camera, pivot=document.middle)
        pose = seen if pose.camera.perspective else seen.switched()
        return replace(state, pose=pose, turning=False, message=name_of(name, frame))

    return look


def _moved(move: Callable[[Pose, np.ndarray], Pose]) -> Action:
    return lambda state, document: replace(state, pose=move(state.pose, up_of(document)), turning=False)


def _middle(pose: Pose) -> tuple[float, float]:
    return pose.camera.size[0] / 2, pose.camera.size[1] / 2


def _turntable(state: State, document: Document) -> State:
    said = "trackball: a drag turns about any axis" if state.turntable else "turntable: up stays up"
    return replace(state, turntable=not state.turntable, message=said)


def _ground(state: State, document: Document) -> State:
    own = state.settings.background
    names = (*GROUNDS, *COLORS)
    colors = {name: tuple(map(float, linear_from_srgb(np.array(rgb)))) for name, rgb in COLORS.items()}
    now = state.ground if own is None else next((name for name, rgb in colors.items() if rgb == own), names[-1])
    name = names[(names.index(now) + 1) % len(names)]
    background = colors.get(name)
    ground = state.ground if name in COLORS else name
    return replace(state, ground=ground, settings=state.settings.but(background=background), message=f"on {name}")


def _light(state: State, document: Document) -> State:
    allowed = choices()["light"]
    light = allowed[(allowed.index(state.settings.light) + 1) % len(allowed)]
    return replace(state, settings=state.settings.but(light=light), message=f"light {light}")


def _fullscreen(state: State, document: Document) -> State:
    return replace(state, fullscreen=not state.fullscreen)


CAMERA_ACTIONS: dict[str, Any] = {
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


def _show(state: State, document: Document) -> State:
    return replace(state, slices=replace(state.slices, shown=not state.slices.shown))


def _color(state: State, document: Document) -> State:
    colored = not state.slices.colored
    said = "slices in the colours of values" if colored else "slices in grey, by the window of values"
    return replace(state, slices=replace(state.slices, colored=colored, shown=True), message=said)


SLICE_ACTIONS: dict[str, Any] = {"slices": _show, "slice-colors": _color}


# factors on extinction and threshold per key press; the lowest threshold above 0, and the highest
OPACITY_STEP, THRESHOLD_STEP = 1.25, 1.5
LOWEST, HIGHEST = 0.001, 0.99
ONE_TIME = "this is one point in time; drop several files for a series"
# settings cycled by a key, and their messages
CYCLES = {
    "blend": "",
    "antialias": "",
    "align": "",
    "attenuation": ", in composite, beyond z_k",
    "compositing": "",
    "classification": "",
}


def acted(state: State, action: str, document: Document) -> State:
    """The state after an action."""
    return ACTIONS[action](replace(state, message=""), document)


def _reset(state: State, document: Document) -> State:
    return replace(state, pose=document.home(state.pose.camera.size), turning=False)


def _projection(state: State, document: Document) -> State:
    pose = state.pose.switched()
    return replace(state, pose=pose, message="perspective" if pose.camera.perspective else "orthographic")


def _cycle(name: str) -> Action:
    def cycle(state: State, document: Document) -> State:
        allowed = choices()[name]
        chosen = getattr(state.settings, name)
        for _ in allowed:
            chosen = _next(allowed, chosen)
            settings = state.settings.but(**{name: chosen})
            if drawable(settings, state, document):
                break
        return replace(state, settings=settings, message=f"{name} {chosen}{CYCLES[name]}")

    return cycle


def _blur(state: State, document: Document) -> State:
    blur = _next(BLURS, state.blur)
    said = "motion blur off" if blur == "off" else f"motion blur {blur}: while the view is turned; a still has none"
    return replace(state, blur=blur, message=said)


def drawable(settings: Settings, state: State, document: Document) -> bool:
    """Whether these settings are valid for this volume as the state sees it."""
    return not refusal(settings, state, document)


def refusal(settings: Settings, state: State, document: Document) -> str:
    """Why these settings are not valid for this volume as the state sees it; "" if they are."""
    try:
        splats = document.followed(state.looks, state.meshes, settings).at(STRIDES[-1])
        chosen = plan(splats, state.pose.camera, settings.but(classification="auto"))
        document.check(settings, chosen.resolved)
    except InputError as error:
        return str(error)
    return ""


def _beyond(state: State, document: Document) -> State:
    camera, said = state.pose.camera, ""
    if not state.beyond:
        if not camera.perspective:
            said = "z_k: every voxel is as wide as any other in an orthographic view"
        elif (z_k := camera.z_k(min(document.volume.spacing))) > camera.eye_from_points(document.volume.corners)[
            :, 2
        ].max():
            said = f"z_k = {z_k:.4g}: all voxels are nearer, so that none is stretched; zoom out to see it"
    return replace(state, beyond=not state.beyond, message=said)


def _compare(state: State, document: Document) -> State:
    return replace(state, compare=_next(COMPARE, state.compare), turning=False)


def _opacity(factor: float) -> Action:
    def change(state: State, document: Document) -> State:
        extinction = state.extinction * factor
        # snap back to 1 despite rounding
        extinction = 1.0 if abs(extinction - 1.0) < 1e-9 else extinction
        return replace(state, extinction=extinction, message=f"extinction x{extinction:.3g}")

    return change


def _threshold(factor: float) -> Action:
    def change(state: State, document: Document) -> State:
        moved = max(state.threshold * factor, LOWEST) if factor > 1 else state.threshold * factor
        moved = 0.0 if moved < LOWEST * 0.999 else min(moved, HIGHEST)
        return thresholded(replace(state, message=f"threshold {moved:.4g}"), moved)

    return change


def thresholded(state: State, threshold: float) -> State:
    """With another threshold, to four digits; blends of one value have none."""
    if BLENDS[state.settings.blend].post_only and threshold > 0:
        return replace(state, message=f"no threshold: blend {state.settings.blend} takes the values of all voxels")
    return replace(state, threshold=float(f"{threshold:.4g}"))


def _toggle(name: str) -> Action:
    def toggle(state: State, document: Document) -> State:
        changes: dict[str, Any] = {name: not getattr(state, name)}
        return replace(state, **changes)

    return toggle


def _close(state: State, document: Document) -> State:
    if state.help:
        return replace(state, help=False)
    return replace(state, turning=False, playing=False, asks=(*state.asks, "cancel"))


def _time(step: int) -> Action:
    def go(state: State, document: Document) -> State:
        if state.times < 2:
            return replace(state, message=ONE_TIME)
        return replace(state, time=(state.time + step) % state.times, playing=False)

    return go


def _play(state: State, document: Document) -> State:
    return replace(state, playing=not state.playing) if state.times > 1 else replace(state, message=ONE_TIME)


def _ask(what: str) -> Action:
    return lambda state, document: replace(state, asks=(*state.asks, what))


ACTIONS: dict[str, Action] = {
    "reset": _reset,
    "projection": _projection,
    **{name: _cycle(name) for name in CYCLES},
    "motion": _blur,
    "beyond": _beyond,
    "compare": _compare,
    "opacity-down": _opacity(1 / OPACITY_STEP),
    "opacity-up": _opacity(OPACITY_STEP),
    "threshold-down": _threshold(1 / THRESHOLD_STEP),
    "threshold-up": _threshold(THRESHOLD_STEP),
    "turn": _toggle("turning"),
    "screenshot": _ask("screenshot"),
    "save": _ask("save"),
    "open": _ask("open"),
    "save-as": _ask("save-as"),
    "hud": lambda state, document: replace(state, hud=_next(HUDS, state.hud)),
    "undo": _ask("undo"),
    "redo": _ask("redo"),
    "close": _close,
    "earlier": _time(-1),
    "later": _time(1),
    "play": _play,
    "panel": _toggle("panel"),
    "help": _toggle("help"),
    "quit": _ask("quit"),
    **CAMERA_ACTIONS,
    **CLIP_ACTIONS,
    **ANNOTATION_ACTIONS,
    **MEASURE_ACTIONS,
    **SLICE_ACTIONS,
}

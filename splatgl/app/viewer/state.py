"""`State`: the viewer's complete state as one immutable value, and the effect of each bound action on it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from splatgl.app.viewer import cutting, legend, measuring, moves, slices
from splatgl.app.viewer.choices import Pick
from splatgl.app.viewer.content import Content
from splatgl.app.viewer.cutting import Cuts
from splatgl.app.viewer.measuring import Ruler
from splatgl.app.viewer.pacing import STRIDES
from splatgl.app.viewer.parts import Look
from splatgl.app.viewer.pose import Pose
from splatgl.app.viewer.slices import Slices
from splatgl.errors import InputError
from splatgl.scene.meshes import MeshFile
from splatgl.splat.motion_blur import MOTIONS
from splatgl.splat.plan import plan
from splatgl.splat.settings import BLENDS, Settings, choices
from splatgl.splat.transfer import Transfer

COMPARE = ("off", "split", "difference")
# what is said of the picture
HUDS = ("short", "full", "off")
# factors on extinction and threshold per key press; the lowest threshold above 0, and the highest
OPACITY_STEP, THRESHOLD_STEP = 1.25, 1.5
LOWEST, HIGHEST = 0.001, 0.99
# what of a look is that of the selected part, and edited
EDITED = ("base", "threshold", "extinction")
# motion blur modes of a rotating view
BLURS = ("off", "moments", *MOTIONS)
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


@dataclass(frozen=True, eq=False)
class State:
    """pose, settings: camera and rendering options. base: the transfer function; extinction: a factor on it.

    blur: motion blur while the view rotates. time: number of the time point of a series of `times`; playing: whether it
    goes on by itself. hud: of HUDS. asks: pending window actions ("screenshot", "save", "save-as", "undo", "redo",
    "open", "open PATH", "cancel", "forget", "quit"). message: shown until the next key. cuts: box and planes, which
    `settings` has too. annotate: what is laid over the picture, as of a scene. probe: whether the value under the
    cursor is told. ruler: what is measured. slices: those beside the picture. turntable: whether a drag turns about a
    fixed axis.

    parts: how the layers of a content of several are seen, of which `selected` is the one that base, threshold and
    extinction are of, and edit; none: one volume. meshes: those of the scene. picks: what else its file holds; picked:
    the option of one of them, and its value, to be opened.
    """

    pose: Pose
    settings: Settings
    base: Transfer
    threshold: float
    extinction: float = 1.0
    turning: bool = False
    blur: str = "off"
    beyond: bool = False
    compare: str = "off"
    hud: str = "short"
    help: bool = False
    panel: bool = False
    ground: str = "black"
    time: int = 0
    times: int = 0
    playing: bool = False
    message: str = ""
    asks: tuple[str, ...] = field(default=())
    cuts: Cuts = field(default_factory=Cuts)
    annotate: tuple[str, ...] = ()
    parts: tuple[Look, ...] = ()
    selected: int = 0
    meshes: tuple[MeshFile, ...] = ()
    picks: tuple[Pick, ...] = ()
    picked: tuple[str, str] | None = None
    turntable: bool = False
    fullscreen: bool = False
    probe: bool = False
    ruler: Ruler = field(default_factory=Ruler)
    slices: Slices = field(default_factory=Slices)

    @classmethod
    def of(cls, content: Content, size: tuple[int, int]) -> State:
        """Initial state of a content: its home view at `size` pixels, its settings and transfer function."""
        settings = content.scene.settings
        cuts = Cuts.of(settings.clip, content.volume)
        annotate = legend.usual_of(content)
        looks = content.looks
        found = cls(content.home(size), settings, looks[0].base, looks[0].threshold, cuts=cuts, annotate=annotate)
        return replace(found, parts=looks if content.surfaces or len(looks) > 1 else (), meshes=content.surfaces)

    @property
    def moving(self) -> Settings:
        """The settings while the view is turned."""
        return self.settings.but(motion=self.blur)

    @property
    def transfer(self) -> Transfer:
        """The transfer function of what is selected: node extinctions times the factor."""
        return Look(self.base, self.threshold, self.extinction).given

    @property
    def looks(self) -> tuple[Look, ...]:
        """How each part is seen; of one volume, that one."""
        if not self.parts:
            return (Look(self.base, self.threshold, self.extinction),)
        own = {name: getattr(self, name) for name in EDITED}
        return _put(self.parts, self.selected, replace(self.parts[self.selected], **own))

    def looking(self, number: int, look: Look) -> State:
        """With another look of a part."""
        found = replace(self, parts=_put(self.looks, number, look))
        return found if number != self.selected else replace(found, **{name: getattr(look, name) for name in EDITED})

    def selecting(self, number: int) -> State:
        """With another part selected, whose transfer function is edited."""
        return replace(self, parts=self.looks, selected=number).looking(number, self.looks[number])

    def based_on(self, content: Content) -> State:
        """With the transfer functions of a content that is read again, none of which was edited."""
        looks = content.looks
        if len(looks) != len(self.looks):
            return replace(self, parts=looks, selected=0).looking(0, looks[0])
        if not self.parts:
            return replace(self, base=looks[0].base)
        bases = zip(self.looks, looks, strict=True)
        found = replace(self, parts=tuple(replace(mine, base=other.base) for mine, other in bases))
        return replace(found, base=looks[self.selected].base)

    def joined(self, meshes: Sequence[MeshFile], message: str) -> State:
        """With these meshes in the picture."""
        return replace(self, parts=self.looks, meshes=tuple(meshes), message=message)

    def opened(self, content: Content) -> State:
        """State for another content with its own view and settings; display options are kept."""
        fresh = State.of(content, self.pose.camera.size)
        kept = ("hud", "help", "panel", "ground", "turning", "blur", "turntable", "fullscreen", "probe")
        beside = replace(self.slices, place=fresh.slices.place)
        return replace(fresh, slices=beside, **{name: getattr(self, name) for name in kept})


def _put(parts: tuple[Look, ...], number: int, look: Look) -> tuple[Look, ...]:
    return (*parts[:number], look, *parts[number + 1 :])


Action = Callable[[State, Content], State]


def acted(state: State, action: str, content: Content) -> State:
    """The state after an action."""
    return ACTIONS[action](replace(state, message=""), content)


def _reset(state: State, content: Content) -> State:
    return replace(state, pose=content.home(state.pose.camera.size), turning=False)


def _projection(state: State, content: Content) -> State:
    pose = state.pose.switched()
    return replace(state, pose=pose, message="perspective" if pose.camera.perspective else "orthographic")


def _cycle(name: str) -> Action:
    def cycle(state: State, content: Content) -> State:
        allowed = choices()[name]
        chosen = getattr(state.settings, name)
        for _ in allowed:
            chosen = _next(allowed, chosen)
            settings = state.settings.but(**{name: chosen})
            if drawable(settings, state, content):
                break
        return replace(state, settings=settings, message=f"{name} {chosen}{CYCLES[name]}")

    return cycle


def _blur(state: State, content: Content) -> State:
    blur = _next(BLURS, state.blur)
    said = "motion blur off" if blur == "off" else f"motion blur {blur}: while the view is turned; a still has none"
    return replace(state, blur=blur, message=said)


def drawable(settings: Settings, state: State, content: Content) -> bool:
    """Whether these settings are valid for this volume as the state sees it."""
    return not refusal(settings, state, content)


def refusal(settings: Settings, state: State, content: Content) -> str:
    """Why these settings are not valid for this volume as the state sees it; "" if they are."""
    try:
        splats = content.followed(state.looks, state.meshes, settings).at(STRIDES[-1])
        chosen = plan(splats, state.pose.camera, settings.but(classification="auto"))
        content.check(settings, chosen.resolved)
    except InputError as error:
        return str(error)
    return ""


def _beyond(state: State, content: Content) -> State:
    camera, said = state.pose.camera, ""
    if not state.beyond:
        if not camera.perspective:
            said = "z_k: every voxel is as wide as any other in an orthographic view"
        elif (z_k := camera.z_k(min(content.volume.spacing))) > camera.eye_from_points(content.volume.corners)[
            :, 2
        ].max():
            said = f"z_k = {z_k:.4g}: all voxels are nearer, so that none is stretched; zoom out to see it"
    return replace(state, beyond=not state.beyond, message=said)


def _compare(state: State, content: Content) -> State:
    return replace(state, compare=_next(COMPARE, state.compare), turning=False)


def _opacity(factor: float) -> Action:
    def change(state: State, content: Content) -> State:
        extinction = state.extinction * factor
        # snap back to 1 despite rounding
        extinction = 1.0 if abs(extinction - 1.0) < 1e-9 else extinction
        return replace(state, extinction=extinction, message=f"extinction x{extinction:.3g}")

    return change


def _threshold(factor: float) -> Action:
    def change(state: State, content: Content) -> State:
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
    def toggle(state: State, content: Content) -> State:
        changes: dict[str, Any] = {name: not getattr(state, name)}
        return replace(state, **changes)

    return toggle


def _close(state: State, content: Content) -> State:
    if state.help:
        return replace(state, help=False)
    return replace(state, turning=False, playing=False, asks=(*state.asks, "cancel"))


def _time(step: int) -> Action:
    def go(state: State, content: Content) -> State:
        if state.times < 2:
            return replace(state, message=ONE_TIME)
        return replace(state, time=(state.time + step) % state.times, playing=False)

    return go


def _play(state: State, content: Content) -> State:
    return replace(state, playing=not state.playing) if state.times > 1 else replace(state, message=ONE_TIME)


def _ask(what: str) -> Action:
    return lambda state, content: replace(state, asks=(*state.asks, what))


def _next(values: tuple[str, ...], value: str) -> str:
    return values[(values.index(value) + 1) % len(values)]


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
    "hud": lambda state, content: replace(state, hud=_next(HUDS, state.hud)),
    "undo": _ask("undo"),
    "redo": _ask("redo"),
    "close": _close,
    "earlier": _time(-1),
    "later": _time(1),
    "play": _play,
    "panel": _toggle("panel"),
    "help": _toggle("help"),
    "quit": _ask("quit"),
    **moves.ACTIONS,
    **cutting.ACTIONS,
    **legend.ACTIONS,
    **measuring.ACTIONS,
    **slices.ACTIONS,
}

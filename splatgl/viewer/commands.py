"""COMMANDS: the commands of keys, help and panel. A command returns the next state, and may request an effect."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum, auto
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.annotations.annotate import ANNOTATIONS, default_names, text_of
from splatgl.annotations.canvas import AnnotatedSubject, Annotation
from splatgl.data.color import AUTO, linear_from_srgb
from splatgl.data.volume import Volume
from splatgl.errors import InputError
from splatgl.geometry.clipping import Plane
from splatgl.gl.screen import GROUNDS
from splatgl.planning.scene import channel_opacity, plan_scene
from splatgl.scene.meshes import is_mesh
from splatgl.scene.open_scene import on_background
from splatgl.scene.view import ALONG, along, angles
from splatgl.splat.settings import Settings, choices
from splatgl.transfer.colormaps import CORE
from splatgl.transfer.presets import PRESETS, build_transfer, grouped_presets
from splatgl.transfer.statistics import statistics
from splatgl.viewer.adaptive_quality import STRIDES
from splatgl.viewer.clip_tool import TOO_MANY_PLANES, set_cuts, start_lasso
from splatgl.viewer.document import Document
from splatgl.viewer.files import grouped
from splatgl.viewer.layer_splats import LayerSplats
from splatgl.viewer.measure_tool import FIRST_POINT
from splatgl.viewer.movie_track import Preview, stop_preview
from splatgl.viewer.segments import with_shown
from splatgl.viewer.slice_planes import STRAIGHT, normals, turned, with_slices, with_turn
from splatgl.viewer.slice_views import next_large
from splatgl.viewer.state import BLURS, COMPARE, HUDS, MOST_PLANES, THEMES, ClipState, Lasso, PinnedView, Ruler, State
from splatgl.viewer.trackball import NOTCH, Pose, up_direction


class WindowRequest(Enum):
    """Effects without values."""

    SAVE_PICTURE = auto()
    SAVE_SCENE = auto()
    SAVE_AS = auto()
    UNDO = auto()
    REDO = auto()
    CANCEL = auto()
    QUIT = auto()
    PALETTE = auto()
    FOCUS = auto()
    FORGET_RECENT = auto()
    RECORD = auto()
    RECORD_AS = auto()
    CANCEL_RECORDING = auto()
    COPY_MOVIE = auto()


class Copy(Enum):
    """Copies what reproduces the picture to the clipboard."""

    COMMAND = "command"
    PYTHON = "Python"
    SCENE = "scene"


@dataclass(frozen=True)
class CopyText:
    """Copies a text to the clipboard."""

    text: str


@dataclass(frozen=True)
class PictureOptions:
    """The choices in which a saved picture differs from the screen. size: pixels; width, dpi: on paper, as of a scene;
    background: "": the screen's; is_plain: whether annotations are left out.
    """

    size: tuple[int, int] | None = None
    width: str | None = None
    dpi: float | None = None
    background: str = ""
    is_plain: bool = False


AS_SHOWN = PictureOptions()


class SaveAction(Enum):
    """The use of a file that the dialog names: it is written, a command that writes it is copied, or another
    place is asked for.
    """

    WRITE = auto()
    COPY = auto()
    ASK = auto()


@dataclass(frozen=True)
class Save:
    """Saves a scene, a picture or a movie, by the ending of its path."""

    path: str
    options: PictureOptions = AS_SHOWN
    action: SaveAction = SaveAction.WRITE


@dataclass(frozen=True)
class Open:
    """Opens files; without paths, the dialog that asks for them. adds: to the picture, as layers and meshes."""

    paths: tuple[str, ...] = ()
    adds: bool = False


@dataclass(frozen=True)
class OpenOption:
    """Opens another array or channel of the file: an option of `load` and its value."""

    option: str
    value: str


@dataclass(frozen=True)
class ShowSection:
    """Opens a section of the panel."""

    title: str


@dataclass(frozen=True)
class LeaveDocument:
    """Opens what the window asked about, None: closes it, although edits are not saved. saves: the scene before."""

    opens: Open | OpenOption | None = None
    saves: bool = False


Effect = WindowRequest | Copy | CopyText | Save | Open | OpenOption | ShowSection | LeaveDocument
Run = Callable[[State, Document], State | tuple[State, Effect]]


@dataclass(frozen=True)
class Command:
    """id: its name in key files; title: its help text; keys: the default ones; row: the help's text for commands alike
    that share a row of it; submenu: the list in its menu that it is in; words: others that find it; menu: of MENUS;
    group: number of its part of the menu.
    """

    id: str
    title: str
    keys: tuple[str, ...]
    run: Run
    row: str = ""
    submenu: str = ""
    words: str = ""
    menu: str = ""
    group: int = 0

    def __call__(self, state: State, document: Document) -> tuple[State, tuple[Effect, ...]]:
        """The next state, and what the window has to do; nothing but a message without the file that it needs."""
        if document.is_empty and self.id not in WITHOUT_FILE:
            return replace(state, message=NO_FILE), ()
        result = self.run(replace(state, message=""), document)
        return (result[0], result[1:]) if isinstance(result, tuple) else (result, ())


# in an empty window, and the commands that need no file
NO_FILE = "no file is open: drop one, or press ctrl+o"
WITHOUT_FILE = {"open", "add-layer", "quit", "theme", "fullscreen", "palette", "help", "close"}


def _request(effect: Effect) -> Run:
    return lambda state, document: (state, effect)


def _rotate(name: str, values: Sequence[Any] = (False, True)) -> Run:
    def rotate(state: State, document: Document) -> State:
        changes: dict[str, Any] = {name: _next(values, getattr(state, name))}
        return replace(state, **changes)

    return rotate


def _next(values: Sequence[Any], value: str) -> Any:
    return values[(values.index(value) + 1) % len(values)]


# --- camera -----------------------------------------------------------------------------------------------------------

# degrees per key press
TURN, ROLL, SLICE_TURN = 10.0, 10.0, 5.0
# names by 3D Slicer for data with anatomy, and by ParaView, which names the direction of the view, for others
ANATOMY = {"front": "Anterior", "back": "Posterior", "right": "Right", "left": "Left"}
ANATOMY |= {"top": "Superior", "bottom": "Inferior"}


def name_of(view: str, volume: Volume) -> str:
    """The name of a standard view of a volume."""
    if view == "isometric":
        return "isometric"
    return f"{ANATOMY[view]} view" if volume.frame else f"view along {along(view, volume).upper()}"


def _view(name: str) -> Run:
    def show(state: State, document: Document) -> State:
        pose, hints = state.pose, document.volume.hints
        view = replace(document.scene.view.changed(view=name), size=pose.camera.size, width=None, zoom=None)
        subject, is_parallel = view.framed(document.volume, document.subject), not pose.camera.perspective
        camera = view.orbit_camera(subject, angles(name, document.volume), hints, pose.fov, is_parallel)
        turned = replace(pose, camera=camera, pivot=document.middle)
        pose = turned if pose.camera.perspective else turned.switched()
        return replace(state, pose=pose, turning=False, message=name_of(name, document.volume))

    return show


def _move(move: Callable[[Pose, np.ndarray], Pose]) -> Run:
    return lambda state, document: replace(state, pose=move(state.pose, up_direction(document)), turning=False)


def _zoom(factor: float) -> Run:
    return _move(lambda pose, up: pose.zoomed((pose.camera.size[0] / 2, pose.camera.size[1] / 2), factor))


def _reset(state: State, document: Document) -> State:
    return replace(state, pose=document.home(state.pose.camera.size), turning=False)


def _projection(state: State, document: Document) -> State:
    pose = state.pose.switched()
    return replace(state, pose=pose, message="perspective" if pose.camera.perspective else "orthographic")


def _turntable(state: State, document: Document) -> State:
    message = "trackball: a drag turns about any axis" if state.turntable else "turntable: up stays up"
    return replace(state, turntable=not state.turntable, message=message)


# --- settings ---------------------------------------------------------------------------------------------------------

# factors on extinction and threshold per key press; the lowest threshold above 0, and the highest
OPACITY_STEP, THRESHOLD_STEP = 1.25, 1.5
LOWEST, HIGHEST = 0.001, 0.99
# sRGB backgrounds that a key goes through after those of the screen
COLORS = {"grey": (0.5, 0.5, 0.5), "blue": (0.32, 0.34, 0.43)}


def why_not(settings: Settings, state: State, document: Document) -> str:
    """The reason why the document cannot be drawn with these settings; "" if it can."""
    try:
        shown = document.with_styles(state.styles, state.mesh_files, settings)
        subject, drawn_with = shown.subject_at(STRIDES[-1], settings.replace(classification="auto"))
        plan_scene(subject, state.pose.camera, drawn_with)
    except InputError as error:
        return str(error)
    return ""


def _cycle(name: str, note: str = "") -> Run:
    """Chooses the next value of a setting that the document can be drawn with."""

    def cycle(state: State, document: Document) -> State:
        allowed, value = choices()[name], getattr(state.settings, name)
        for _ in allowed:
            value = _next(allowed, value)
            change: dict[str, Any] = {name: value}
            settings = state.settings.replace(**change)
            if not why_not(settings, state, document):
                break
        return replace(with_settings(state, document, settings), message=f"{name} {value}{note}")

    return cycle


def with_settings(state: State, document: Document, settings: Settings) -> State:
    """The state with other settings; the ramps of channels reach the opacity that they have in the blend, and the
    default background of the blend follows it.
    """
    first, usual = state.styles[0].base, list[Settings]()
    for look in (state.settings, settings):
        scene = replace(document.scene, settings=look.replace(background=AUTO))
        usual.append(on_background(scene, document.volume, first).settings)
    if settings.background == state.settings.background == usual[0].background:
        settings = settings.replace(background=usual[1].background)
    styles = []
    for layer, style in zip(document.layers, state.styles, strict=False):
        now, then = (channel_opacity(layer.volume, look) for look in (state.settings, settings))
        most = max(opacity for _, opacity in style.base.points)
        is_ramp = "channel" in layer.scene.load and not style.base.shading and abs(most - now) < 1e-6
        points = tuple((value, opacity * then / now) for value, opacity in style.base.points)
        styles.append(replace(style, base=replace(style.base, points=points)) if is_ramp and then != now else style)
    return replace(state, settings=settings, styles=(*styles, *state.styles[len(styles) :]))


def _choose(name: str, value: str) -> Run:
    """Chooses a value of a setting, if the document can be drawn with it."""

    def choose(state: State, document: Document) -> State:
        change: dict[str, Any] = {name: value}
        settings = state.settings.replace(**change)
        why = why_not(settings, state, document)
        return replace(state if why else with_settings(state, document, settings), message=why or f"{name} {value}")

    return choose


def curve_of(state: State, document: Document) -> LayerSplats | None:
    """The selected layer, if it has a curve of opacity: neither segments, nor a mesh alone."""
    layer = document.pool.get(state.style.number)
    return None if layer is None or state.style.base.labels or is_mesh(layer.scene.volume) else layer


NO_CURVE = "the selected layer has no curve of opacity"


def _preset(name: str) -> Run:
    def choose(state: State, document: Document) -> State:
        layer = curve_of(state, document)
        if layer is None:
            return replace(state, message=NO_CURVE)
        base = build_transfer(PRESETS[name], statistics(layer.volume), layer.stored)
        # surfaces stay
        base = replace(base, iso=state.style.stated.iso)
        return replace(state.edit(base=base, extinction=1.0), message=f"preset {name}: {PRESETS[name].about}")

    return choose


def _color_map(name: str) -> Run:
    def choose(state: State, document: Document) -> State:
        if curve_of(state, document) is None:
            return replace(state, message=NO_CURVE)
        return replace(state.edit(base=replace(state.style.base, colormap=name)), message=f"colour map {name}")

    return choose


def _light(state: State, document: Document) -> State:
    light = _next(choices()["light"], state.settings.light)
    return replace(state, settings=state.settings.replace(light=light), message=f"light {light}")


def _blur(state: State, document: Document) -> State:
    blur = _next(BLURS, state.blur)
    note = "" if blur == "off" else ": only in motion"
    return replace(state, blur=blur, message=f"motion blur {blur}{note}")


def _show_zk(state: State, document: Document) -> State:
    camera, message = state.pose.camera, ""
    if not state.show_zk and not camera.perspective:
        message = "z_k: every voxel is as wide as any other in an orthographic view"
    elif not state.show_zk:
        z_k = camera.z_k(min(document.volume.spacing) / state.settings.filter_width)
        if z_k > camera.eye_from_points(document.volume.corners)[:, 2].max():
            message = f"z_k = {z_k:.4g}: all voxels are nearer, so that none is stretched; zoom out to see it"
    return replace(state, show_zk=not state.show_zk, message=message)


def _opacity(factor: float) -> Run:
    def change(state: State, document: Document) -> State:
        extinction = state.style.extinction * factor
        # snap back to 1 despite rounding
        extinction = 1.0 if abs(extinction - 1.0) < 1e-9 else extinction
        return replace(state.edit(extinction=extinction), message=f"extinction x{extinction:.3g}")

    return change


def _threshold(factor: float) -> Run:
    def change(state: State, document: Document) -> State:
        threshold = state.style.threshold * factor
        threshold = max(threshold, LOWEST) if factor > 1 else threshold
        threshold = 0.0 if threshold < LOWEST * 0.999 else min(threshold, HIGHEST)
        return with_threshold(
            replace(state, message=f"threshold {threshold:.4g}: voxels up to this opacity are skipped"), threshold
        )

    return change


def with_threshold(state: State, threshold: float) -> State:
    """The state with another threshold, to four digits; blends of one value have none."""
    if state.settings.needs_values and threshold > 0:
        return replace(state, message="no threshold: this blend takes the values of all voxels")
    return state.edit(threshold=float(f"{threshold:.4g}"))


def _ground(state: State, document: Document) -> State:
    color, names, known = state.settings.ground, (*GROUNDS, *COLORS), _background_colors()
    now = state.ground if color is None else next((name for name, rgb in known.items() if rgb == color), names[-1])
    name = _next(names, now)
    return replace(with_ground(state, name), message=f"on {name}")


def _background_colors() -> dict[str, tuple[float, ...]]:
    """The colours of backgrounds, linear RGB, by their names."""
    colors = {name: tuple(map(float, linear_from_srgb(np.array(rgb)))) for name, rgb in COLORS.items()}
    return {"black": (0.0, 0.0, 0.0), "white": (1.0, 1.0, 1.0), **colors}


def with_ground(state: State, name: str) -> State:
    """The state on another background, of GROUNDS or COLORS, which saved pictures have, too; checks stand for none.
    Sums have none.
    """
    background = None if state.settings.is_sum else _background_colors().get(name)
    ground = state.ground if name in COLORS else name
    return replace(state, ground=ground, settings=state.settings.replace(background=background))


def _segments(are_shown: bool) -> Run:
    def show(state: State, document: Document) -> State:
        # those of the selected layer, else of all layers
        layers = [number for number, style in enumerate(state.styles) if style.base.labels]
        if not layers:
            return replace(state, message="no segments: no layer is a segmentation")
        for layer in [state.selected] if state.selected in layers else layers:
            style = state.styles[layer]
            numbers = [number for number, _, _ in style.base.labels]
            state = state.with_style(layer, with_shown(style, numbers, are_shown))
        return state

    return show


# --- clipping, annotations, measures, slices --------------------------------------------------------------------------


def add_plane(state: State, document: Document, normal: Sequence[float] | None = None) -> State:
    """The state with one more clip plane through the middle of the volume. normal: towards the kept side; None: away
    from the eye.
    """
    cuts = state.cuts
    if len(cuts.planes) >= MOST_PLANES:
        return replace(state, message=TOO_MANY_PLANES)
    along = state.pose.camera.forward if normal is None else np.asarray(normal, np.float64)
    plane: Plane = (*map(float, along), float(along @ document.volume.corners.mean(axis=0)))  # type: ignore[assignment]
    return set_cuts(state, document, replace(cuts.with_plane(len(cuts.planes), plane), active=True, shown=True))


def _handles(state: State, document: Document) -> State:
    cuts = replace(state.cuts, shown=not state.cuts.shown)
    message = "drag the handles to cut; shift+x toggles clipping" if cuts.shown else ""
    return replace(set_cuts(state, document, cuts), message=message)


def _cuts(state: State, document: Document) -> State:
    if not state.cuts.any:
        return replace(state, message="nothing is cut: x shows the handles, ctrl+x makes a plane")
    cuts = replace(state.cuts, active=not state.cuts.active)
    return replace(set_cuts(state, document, cuts), message=f"cuts {'on' if cuts.active else 'off'}")


def _plane(state: State, document: Document) -> State:
    added = add_plane(state, document)
    return replace(added, message=added.message or "drag its dot up or down; turn the view to reach its arrow")


def _uncut(state: State, document: Document) -> State:
    if not (state.cuts.any or state.styles[0].scissors):
        return replace(state, message="nothing is cut")
    state = replace(state, styles=tuple(replace(style, scissors=()) for style in state.styles))
    return replace(set_cuts(state, document, ClipState(shown=state.cuts.shown)), message="nothing is cut any more")


def toggle_name(names: tuple[str, ...], name: str) -> tuple[str, ...]:
    """The annotations without one of a name, with or without a text, or with it if it is missing."""
    others = tuple(other for other in names if text_of((other,), name) is None)
    return others if len(others) < len(names) else (*names, name)


def _annotation(row: Annotation) -> Run:
    def toggle(state: State, document: Document) -> State:
        missing = row.needs_values and document.volume.color is not None
        message = f"voxels have colours of their own: no {row.title}" if missing else ""
        return replace(state, annotate=toggle_name(state.annotate, row.name), message=message)

    return toggle


def _annotations(state: State, document: Document) -> State:
    names = default_names(AnnotatedSubject.of(document.volume))
    rest = tuple(name for name in state.annotate if name.partition("=")[0] not in names)
    return replace(state, annotate=rest if len(rest) < len(state.annotate) else (*names, *rest))


def _probe(state: State, document: Document) -> State:
    return replace(state, probe=not state.probe, message="" if state.probe else "the value under the cursor")


def _measure(is_angle: bool) -> Run:
    """Clicks measure, or no longer do."""

    def measure(state: State, document: Document) -> State:
        if state.ruler.active and state.ruler.angle == is_angle:
            return replace(state, ruler=Ruler())
        return replace(state, ruler=Ruler(active=True, angle=is_angle), message=FIRST_POINT)

    return measure


def _slices(state: State, document: Document) -> State:
    return replace(state, slices=replace(state.slices, shown=not state.slices.shown))


def _slice_colors(state: State, document: Document) -> State:
    colored = not state.slices.colored
    message = "slices in the colours of values" if colored else "slices in grey, by the window of values"
    return replace(state, slices=replace(state.slices, colored=colored, shown=True), message=message)


def _crosshair(state: State, document: Document) -> State:
    slices = replace(state.slices, linked=not (state.slices.shown and state.slices.linked), shown=True)
    return replace(state, slices=slices, message=f"linked crosshair {'on' if slices.linked else 'off'}")


def _slices_in_space(state: State, document: Document) -> State:
    if state.slice_planes:
        return replace(state, slices=replace(state.slices, in_space=False), slice_planes=())
    if document.volume.points is not None or is_mesh(document.scene.volume):
        return replace(state, message="no slices: there are no voxels")
    if not state.settings.hides:
        return replace(state, message="slices are shown in blend composite only")
    return with_slices(state, replace(state.slices, in_space=True), document.volume)


def _large_slice(state: State, document: Document) -> State:
    return replace(state, slices=next_large(state.slices, document.volume))


def _turn_slices(axis: int, degrees: float) -> Run:
    def turn(state: State, document: Document) -> State:
        slices, about = state.slices, normals(state.slices, document.volume)[axis]
        made = with_turn(slices, turned(slices.turn, about, degrees), document.volume)
        return with_slices(state, replace(made, shown=True), document.volume)

    return turn


def _straighten(state: State, document: Document) -> State:
    index = state.slices.index(document.volume)
    return with_slices(state, replace(state.slices, turn=STRAIGHT).at(index, document.volume), document.volume)


# --- time and window --------------------------------------------------------------------------------------------------

ONE_TIME = "this is one point in time; drop several files for a series"


def _time(step: int) -> Run:
    def go(state: State, document: Document) -> State:
        if state.times < 2:
            return replace(state, message=ONE_TIME)
        return replace(state, time=(state.time + step) % state.times, playing=False)

    return go


def _play(state: State, document: Document) -> State:
    if state.times < 2:
        return replace(state, message=ONE_TIME)
    # at its end, a series begins again
    ended = not state.playing and not state.repeats and state.time == state.times - 1
    return replace(state, playing=not state.playing, time=0 if ended else state.time)


def _keyframe(state: State, document: Document) -> State:
    try:
        movie = stop_preview(state).movie.with_keyframe(state.pose)
    except InputError as error:
        return replace(state, message=str(error))
    return replace(state, movie=movie, message=f"keyframe {len(movie.keyframes)} at {movie.keyframes[-1].time:g} s")


def _preview(state: State, document: Document) -> State:
    if state.preview is not None:
        return stop_preview(state)
    try:
        return replace(state, preview=Preview.of(state, document), turning=False)
    except InputError as error:
        return replace(state, message=str(error))


def _compare(state: State, document: Document) -> State:
    return replace(state, compare=_next(COMPARE, state.compare), turning=False)


def _pin(state: State, document: Document) -> State:
    if state.pinned is not None:
        return replace(state, pinned=None)
    if not document.is_complete:
        return replace(state, message="this picture is still being refined: pin it then")
    message = "this picture stays at the right: edit it, open another file or go to another time at the left"
    return replace(state, pinned=PinnedView(document, state.settings), compare="off", turning=False, message=message)


def _close(state: State, document: Document) -> State | tuple[State, Effect]:
    if state.help:
        return replace(state, help=False)
    if state.fullscreen:
        return replace(state, fullscreen=False)
    return replace(stop_preview(state), turning=False, playing=False, lasso=Lasso()), WindowRequest.CANCEL


VIEW_KEYS = {"front": "1", "back": "ctrl+1", "right": "3", "left": "ctrl+3", "top": "7", "bottom": "ctrl+7"}
LASSO, OVER = "lasso: remove, or keep", "axes and scale, colour bar, box"
SLICE_LOOKS, SLICE_TURNS = "slice large; in colours; crosshair; as planes", "turn slices about x, y, z; shift: back"
FRONTS, BACKS = "view from the front, right, top", "view from the back, left, bottom"
ROTATE, ROLLS, KEEPS = ("turn the view", "Rotate"), "roll to the left, right", "keep more, fewer voxels"
# what the message of the command adds
BEYOND = ", in composite, beyond z_k"


def _view_command(view: str, key: str) -> Command:
    name = "" if ANATOMY[view].lower() == view else f", {ANATOMY[view]}"
    row = BACKS if "ctrl" in key else FRONTS
    return Command(view, f"view from the {view}{name}, along {ALONG[view].upper()}", (key,), _view(view), row)


# sections of the panel, and other words that find them
SECTIONS = {
    "Look": "threshold appearance display properties volume contrast brightness window level width range gamma auto "
    "hounsfield gallery segments rename",
    "Transfer function": "histogram curve opacity gradient mapping scalar points editor",
    "Layers": "channels list tree pipeline outliner visibility merge rename delete mask",
    "Iso-surfaces": "contour isosurface isovalue marching cubes model",
    "Light": "lighting shading shadows ambient occlusion diffuse specular shininess material",
    "Rendering": "quality samples tolerance depth blending mode",
    "Advanced": "performance sampling antialiasing interpolation diagnostics",
    "View": "background colour annotations display",
    "Slices": "axial coronal sagittal mpr reformat",
    "Clipping": "crop roi box plane flip invert",
    "Measures": "ruler markups distance angle",
    "Record": "movie animation video export fps",
    "Files": "recent history dataset folder",
    "Statistics": "information metadata header dimensions spacing units mean",
}


def _section(title: str) -> Command:
    name = f"section-{title.lower().replace(' ', '-')}"
    return Command(name, f"panel: {title.lower()}", (), _request(ShowSection(title)), submenu="Panel section")


def _blend(name: str) -> Command:
    return Command(f"blend-{name}", f"blend: {name}", (), _choose("blend", name), submenu="Blend")


# the window's menus, in parts with lines between them, and the groups of its help
MENUS: dict[str, tuple[tuple[Command, ...], ...]] = {
    "File": (
        (
            Command("open", "open files...", ("ctrl+o",), _request(Open())),
            Command("add-layer", "add a volume, segmentation or mesh...", ("ctrl+shift+o",), _request(Open(adds=True))),
        ),
        (
            Command("save-as", "save the scene or the picture as...", ("ctrl+s",), _request(WindowRequest.SAVE_AS)),
            Command("screenshot", "save image (PNG)", ("s", "f12"), _request(WindowRequest.SAVE_PICTURE)),
            Command("save", "save the floats (NPY) and the scene", ("shift+s",), _request(WindowRequest.SAVE_SCENE)),
        ),
        (
            Command("copy-command", "copy as command", (), _request(Copy.COMMAND)),
            Command("copy-python", "copy as Python", (), _request(Copy.PYTHON)),
            Command("copy-scene", "copy as scene file", (), _request(Copy.SCENE)),
        ),
        (Command("quit", "quit", ("q", "ctrl+q"), _request(WindowRequest.QUIT)),),
    ),
    "Edit": (
        (
            Command("undo", "undo", ("ctrl+z",), _request(WindowRequest.UNDO)),
            Command("redo", "redo", ("ctrl+shift+z", "ctrl+y"), _request(WindowRequest.REDO)),
        ),
        (
            Command("handles", "crop box and clip handles", ("x",), _handles),
            Command("plane", "clip plane that faces the camera", ("ctrl+x",), _plane),
            Command("scissors", "lasso: remove inside", ("ctrl+shift+x",), start_lasso(keep=False), LASSO),
            Command("scissors-keep", "lasso: keep inside", ("alt+x",), start_lasso(keep=True), LASSO),
            Command("cuts", "clipping on or off", ("shift+x",), _cuts),
            Command("uncut", "remove crop box and all cuts", ("delete",), _uncut),
        ),
        (
            Command("segments-show", "show all segments", (), _segments(True)),
            Command("segments-hide", "hide all segments", (), _segments(False)),
        ),
    ),
    "View": (
        (
            Command("reset", "reset view", ("r", "home"), _reset),
            Command("isometric", "isometric view", ("v", "9"), _view("isometric")),
            *(_view_command(view, key) for view, key in VIEW_KEYS.items()),
            Command("projection", "perspective or orthographic", ("p", "5"), _projection),
        ),
        (
            Command("zoom-in", "zoom in", ("+", "="), _zoom(NOTCH), "zoom in, out"),
            Command("zoom-out", "zoom out", ("-",), _zoom(1 / NOTCH), "zoom in, out"),
            Command(
                "turn-left", "turn the view to the left", ("left",), _move(lambda p, up: p.spun(-TURN, up)), *ROTATE
            ),
            Command(
                "turn-right", "turn the view to the right", ("right",), _move(lambda p, up: p.spun(TURN, up)), *ROTATE
            ),
            Command("turn-up", "move the camera up", ("up",), _move(lambda p, up: p.lifted(TURN)), *ROTATE),
            Command("turn-down", "move the camera down", ("down",), _move(lambda p, up: p.lifted(-TURN)), *ROTATE),
            Command(
                "roll-left", "roll to the left", ("page_up",), _move(lambda p, up: p.tipped(-ROLL)), ROLLS, "Rotate"
            ),
            Command(
                "roll-right", "roll to the right", ("page_down",), _move(lambda p, up: p.tipped(ROLL)), ROLLS, "Rotate"
            ),
            Command("turn", "rotate automatically, or stop", ("space",), _rotate("turning")),
            Command("turntable", "turntable or trackball rotation", ("u",), _turntable),
        ),
        (
            Command("pin", "compare side by side", ("ctrl+d",), _pin),
            Command("ground", "next background", ("n",), _ground),
            Command("hud", "frame information: short, full, or off", ("i",), _rotate("hud", HUDS)),
        ),
        (
            Command("panel", "panel", ("tab",), _rotate("panel")),
            *map(_section, SECTIONS),
            Command("focus", "keyboard focus: panel or picture", ("f6",), _request(WindowRequest.FOCUS)),
            Command("theme", "theme: dark or light", (), _rotate("theme", THEMES)),
            Command("fullscreen", "fullscreen", ("f11", "f"), _rotate("fullscreen")),
        ),
    ),
    "Picture": (
        (
            *map(_blend, choices()["blend"]),
            *(
                Command(f"preset-{name}", f"preset: {name}", (), _preset(name), submenu=f"Preset: {title}")
                for title, names in grouped_presets().items()
                for name in names
            ),
            *(
                Command(f"colormap-{name}", f"colour map: {name}", (), _color_map(name), submenu="Colour map")
                for name in CORE
            ),
            Command("blend", "next blend mode", ("b",), _cycle("blend")),
            Command("light", "next light: head, matte, glossy, flat", ("l",), _light),
        ),
        (
            Command("opacity-down", "less opaque", ("[",), _opacity(1 / OPACITY_STEP), "less, more opaque"),
            Command("opacity-up", "more opaque", ("]",), _opacity(OPACITY_STEP), "less, more opaque"),
            Command("threshold-down", "threshold lower: more voxels", (",",), _threshold(1 / THRESHOLD_STEP), KEEPS),
            Command("threshold-up", "threshold higher: fewer voxels", (".",), _threshold(THRESHOLD_STEP), KEEPS),
        ),
        (
            Command("annotations", "axes, scale bar and patient directions", ("j",), _annotations, OVER),
            *(
                Command(row.name, row.title, (row.key,), _annotation(row), OVER)
                for row in ANNOTATIONS.values()
                if row.key and not row.default
            ),
        ),
        (
            Command("compare", "float64 reference, or the difference to it", ("d",), _compare),
            Command("motion", "next motion blur, while turning", ("m",), _blur),
            Command("classification", "classify before reconstruction, or after", ("c",), _cycle("classification")),
            Command("compositing", "composite splats, or sheets of them", ("o",), _cycle("compositing")),
            Command("antialias", "next kind of antialiasing", ("a",), _cycle("antialias")),
            Command("align", "next alignment of the splats", ("g",), _cycle("align")),
            Command("attenuation", "next form of attenuation beyond z_k", ("w",), _cycle("attenuation", BEYOND)),
            Command("beyond", "the z_k plane, and splats beyond it", ("k",), _show_zk),
        ),
    ),
    "Tools": (
        (
            Command("probe", "value at the cursor", ("y",), _probe),
            Command("measure", "measure distance between two points", ("e",), _measure(is_angle=False)),
            Command("angle", "measure angle between three points", (), _measure(is_angle=True)),
        ),
        (
            Command("slices", "slices: the wheel and clicks move them", ("z",), _slices),
            Command("large-slice", "one large slice, the next one, or all three", ("h",), _large_slice, SLICE_LOOKS),
            Command("slice-colors", "slices in grey or in colours", ("shift+z",), _slice_colors, SLICE_LOOKS),
            Command("linked-crosshair", "linked crosshair in all slices", ("shift+y",), _crosshair, SLICE_LOOKS),
            Command("slices-in-space", "slices as planes in the picture", ("alt+z",), _slices_in_space, SLICE_LOOKS),
            *(
                Command(
                    f"turn-slices-{way}{name}",
                    f"turn slices {way[:-1]}{' ' * bool(way)}about {name}",
                    (f"alt+{key}{n + 1}",),
                    _turn_slices(n, turn),
                    SLICE_TURNS,
                    "Turn slices",
                )
                for way, key, turn in (("", "", SLICE_TURN), ("back-", "shift+", -SLICE_TURN))
                for n, name in enumerate("xyz")
            ),
            Command("straighten-slices", "slices along the axes again", ("alt+0",), _straighten, submenu="Turn slices"),
        ),
        (
            Command("play", "play a time series, or stop", ("enter",), _play),
            Command("earlier", "the time point before", ("<",), _time(-1), "the time point before, after"),
            Command("later", "the next time point", (">",), _time(1), "the time point before, after"),
        ),
        (
            Command("record", "record the movie", (), _request(WindowRequest.RECORD)),
            Command("record-as", "record the movie as...", (), _request(WindowRequest.RECORD_AS)),
            Command("keyframe", "add the view to the movie's keyframes", (), _keyframe),
            Command("preview", "preview the movie, or stop", (), _preview),
            Command("cancel-recording", "cancel the recording", (), _request(WindowRequest.CANCEL_RECORDING)),
            Command("copy-movie", "copy the movie as a command", (), _request(WindowRequest.COPY_MOVIE)),
        ),
    ),
    "Help": (
        (
            Command("palette", "find a command", ("ctrl+p",), _request(WindowRequest.PALETTE)),
            Command("help", "help: all keys", ("?", "f1"), _rotate("help")),
            Command("close", "close the open panel, or cancel", ("escape",), _close),
        ),
    ),
}
# words of ParaView, 3D Slicer, napari and Fiji that find commands, beside those of their titles
WORDS = {
    "open": "load import drop file data volume dataset recent stack dicom",
    "add-layer": "layer overlay mesh model label labels segmentation merge load import",
    "save-as": "export write picture image figure tiff svg pdf dpi resolution width publish state session project",
    "screenshot": "export picture capture snapshot write",
    "save": "export state project write",
    "copy-command": "clipboard script macro shell console reproduce",
    "copy-python": "clipboard script macro code trace reproduce",
    "copy-scene": "clipboard state toml",
    "quit": "exit close",
    "undo": "back revert",
    "redo": "again forward",
    "handles": "roi cropping region bounds widget cut trim",
    "plane": "clipping cutaway section cut oblique",
    "scissors": "cut erase crop polygon delete sculpt mask draw",
    "scissors-keep": "cut crop polygon isolate mask draw",
    "cuts": "crop toggle",
    "uncut": "reset clear delete uncrop whole",
    "segments-show": "labels visibility structures",
    "segments-hide": "labels visibility structures",
    "reset": "home fit centre camera recenter all frame",
    "isometric": "camera 3d oblique",
    "front": "coronal camera",
    "back": "coronal camera",
    "left": "sagittal side camera",
    "right": "sagittal side camera",
    "top": "axial transverse camera",
    "bottom": "axial transverse camera",
    "projection": "parallel ortho camera 3d",
    "zoom-in": "nearer closer dolly magnify",
    "zoom-out": "farther dolly",
    "turn": "spin orbit animate rock",
    "turntable": "orbit interaction style",
    "pin": "split link layout dual linked views",
    "ground": "white black colour",
    "hud": "info text status renderer gpu",
    "panel": "sidebar dock hide show properties inspector",
    "theme": "appearance preferences settings options dark mode",
    "fullscreen": "maximize full screen",
    "blend": "blending mip maximum minimum mean average projection x-ray volume rendering mode",
    "blend-composite": "alpha volume rendering ray casting dvr",
    "blend-xray": "x-ray sum drr radiograph",
    "blend-mip": "maximum intensity projection",
    "blend-attenuated-mip": "maximum intensity projection",
    "blend-minip": "minimum intensity projection",
    "blend-mean": "average intensity projection",
    "light": "lighting shading shade headlight",
    "opacity-down": "opacity transparency transparent alpha",
    "opacity-up": "opacity transparency solid alpha",
    "annotations": "scale bar orientation marker triad letters overlay calibration",
    "colorbar": "legend scalar lut",
    "legend": "names key",
    "box": "bounding outline cube grid",
    "compare": "accuracy error check",
    "motion": "streaks",
    "antialias": "quality smooth supersampling",
    "probe": "picker pixel intensity inspect coordinates crosshair position hover",
    "measure": "ruler length line markups caliper",
    "angle": "protractor markups",
    "slices": "mpr orthogonal views axial coronal sagittal four-up crosshair 2d",
    "linked-crosshair": "cursor link position synchronize locator",
    "large-slice": "maximize 2d axial coronal sagittal single view layout",
    "slices-in-space": "reslice orthoplanes 3d",
    "play": "animation frames time loop 4d",
    "earlier": "previous frame back",
    "later": "frame forward",
    "keyframe": "animation camera path",
    "preview": "animation",
    "record": "video animation export mp4",
    "record-as": "video animation export mp4 gif",
    "palette": "search command menu",
    "help": "shortcuts hotkeys manual documentation about pan mouse",
    "close": "dismiss stop",
}
WORDS |= {f"colormap-{name}": "lut lookup table grayscale" for name in CORE}
WORDS |= {f"section-{title.lower().replace(' ', '-')}": words for title, words in SECTIONS.items()}
COMMANDS = tuple(
    replace(command, menu=menu, group=number, words=f"{command.submenu} {WORDS.get(command.id, '')}")
    for menu, groups in MENUS.items()
    for number, commands in enumerate(groups)
    for command in commands
)


def _is(name: str, value: str) -> Callable[[State], bool]:
    return lambda state: bool(attrgetter(name)(state) == value)


def _is_annotated(name: str) -> Callable[[State], bool]:
    return lambda state: text_of(state.annotate, name) is not None


# whether the switch of a command is on, or the choice that it makes is made
TICKS: dict[str, Callable[[State], bool]] = {
    **{name: attrgetter(name) for name in ("panel", "turntable", "fullscreen", "probe", "help")},
    **{f"blend-{name}": _is("settings.blend", name) for name in choices()["blend"]},
    **{f"colormap-{name}": _is("style.base.colormap", name) for name in CORE},
    **{name: _is_annotated(name) for name in ANNOTATIONS},
    "annotations": lambda state: any(row.default and _is_annotated(row.name)(state) for row in ANNOTATIONS.values()),
    "handles": lambda state: state.cuts.shown,
    "large-slice": lambda state: state.slices.shown and state.slices.large is not None,
    "cuts": lambda state: state.cuts.any and state.cuts.active,
    "turn": lambda state: state.turning,
    "pin": lambda state: state.pinned is not None,
    "compare": lambda state: state.compare != "off",
    "beyond": lambda state: state.show_zk,
    "measure": lambda state: state.ruler.active and not state.ruler.angle,
    "angle": lambda state: state.ruler.active and state.ruler.angle,
    "slices": lambda state: state.slices.shown,
    "slice-colors": lambda state: state.slices.colored,
    "linked-crosshair": lambda state: state.slices.shown and state.slices.linked,
    "slices-in-space": lambda state: bool(state.slice_planes),
    "play": lambda state: state.playing,
    "preview": lambda state: state.preview is not None,
}
# whether a command, or those whose names begin with a word, do something; all others always do
ENABLED: dict[str, Callable[[State, Document], bool]] = {
    "preset": lambda state, document: curve_of(state, document) is not None,
    "colormap": lambda state, document: (layer := curve_of(state, document)) is not None and layer.volume.color is None,
    "legend": lambda state, document: len(state.styles) > 1 or bool(state.style.base.labels),
    "segments": lambda state, document: any(style.base.labels for style in state.styles),
    "threshold": lambda state, document: not state.settings.needs_values,
    "cuts": lambda state, document: state.cuts.any,
    "uncut": lambda state, document: state.cuts.any or bool(state.styles[0].scissors),
    "plane": lambda state, document: len(state.cuts.planes) < MOST_PLANES,
    "colorbar": lambda state, document: document.volume.color is None,
    "straighten": lambda state, document: state.slices.turn != STRAIGHT,
    **dict.fromkeys(("play", "earlier", "later"), lambda state, document: state.times > 1),
}


def is_ticked(command: Command, state: State) -> bool:
    """Whether the switch of a command is on; False for commands without one."""
    return command.id in TICKS and bool(TICKS[command.id](state))


def is_enabled(command: Command, state: State, document: Document) -> bool:
    """Whether a command does something in a state."""
    if document.is_empty:
        return command.id in WITHOUT_FILE
    rule = ENABLED.get(command.id) or ENABLED.get(command.id.partition("-")[0])
    return rule is None or rule(state, document)


MOUSE = (
    ("left drag", "turn"),
    ("shift, ctrl+left drag", "pan, roll"),
    ("wheel, right drag", "zoom to the cursor"),
    ("double click", "turn about that point"),
    ("drop a file", "open it, add it, or play a series"),
)


# names of dropped files that a question lists
LISTED = 3


@dataclass(frozen=True)
class Question:
    """A question or a message. answers: what each button asks the window for; None: nothing."""

    title: str
    text: str
    answers: tuple[tuple[str, Effect | None], ...]


# asked before a window with unsaved edits closes
UNSAVED = Question(
    "Edits are not saved",
    "Save the changes as a scene before the window closes?",
    (("save and quit", LeaveDocument(saves=True)), ("discard", LeaveDocument()), ("cancel", None)),
)


def ask_to_leave(opens: Open | OpenOption) -> Question:
    """The question before other files replace a document with unsaved edits."""
    answers = (*_leaving(opens, "open"), ("cancel", None))
    return Question(UNSAVED.title, "Save the changes as a scene before another file is opened?", answers)


def ask_for_files(paths: Sequence[str], is_edited: bool = False) -> Question:
    """The question what to do with dropped files. is_edited: whether opening them loses edits."""
    several, more = len(paths) > 1, len(paths) - LISTED
    is_series = len(grouped(paths)[0]) > 1
    names = ", ".join(Path(path).name for path in paths[:LISTED]) + f" and {more} more" * (more > 0)
    opens, verb = Open(tuple(paths)), "play" if is_series else "open"
    answers: tuple[tuple[str, Effect | None], ...] = ((f"{verb} as series" if is_series else verb, opens),)
    if is_edited:
        names += ". Edits are not saved."
        answers = _leaving(opens, verb)
    answers += (("add as layers" if several else "add as layer", Open(tuple(paths), adds=True)), ("cancel", None))
    return Question(f"What to do with {'these files' if several else 'this file'}?", names, answers)


def _leaving(opens: Open | OpenOption, verb: str) -> tuple[tuple[str, Effect | None], ...]:
    """The answers that open files although edits are not saved yet."""
    return (
        (f"save and {verb}", LeaveDocument(opens, saves=True)),
        (f"{verb} without saving", LeaveDocument(opens)),
    )


def tell_error(message: str) -> Question:
    """An error message, visible until it is closed."""
    return Question("This did not work", message, (("close", None), ("copy", CopyText(message))))

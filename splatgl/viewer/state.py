"""`State`: everything that the window shows, as one immutable value, and its undo history."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.annotations.annotate import default_names
from splatgl.annotations.canvas import AnnotatedSubject, Measure
from splatgl.data.volume import Triple, Volume
from splatgl.geometry.clipping import MOST_CLIPS, Plane, check_planes, index_plane
from splatgl.geometry.scissors import Scissors
from splatgl.scene.meshes import MeshFile
from splatgl.splat.motion_blur import MOTIONS
from splatgl.splat.settings import Motions, Settings
from splatgl.transfer.regions import OPAQUE
from splatgl.transfer.transfer import Transfer
from splatgl.viewer.movie_track import Movie, Preview
from splatgl.viewer.slice_planes import STRAIGHT, Turn, shares, slices_of
from splatgl.viewer.trackball import Pose

if TYPE_CHECKING:
    from splatgl.viewer.document import Document


@dataclass(frozen=True)
class FileOption:
    """An option of `load`, and its possible values, each with a description."""

    option: str
    values: tuple[tuple[str, str], ...]

    @property
    def texts(self) -> list[str]:
        """One line per value: the value and its description."""
        return [f"{value}  {words}".rstrip() for value, words in self.values]

    def selected(self, reading: Mapping[str, Any]) -> int:
        """Index of the value in the options of a file; 0 if they do not name it."""
        value = str(reading.get(self.option, self.values[0][0]))
        return next((index for index, texts in enumerate(self.values) if value in texts), 0)


WHOLE = ((0.0, 1.0),) * 3
# most planes beside the six of the box
MOST_PLANES = MOST_CLIPS - 6
# shares of the box: of sides that nearly coincide, and of the smallest box
SAME, LEAST = 1e-9, 1e-3

Sides = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class ClipState:
    """Clip box and clip planes. sides: of the box, as shares of the volume's along x, y and z. planes: (n_x, n_y, n_z,
    d), world units, which keep n · x ≥ d. active: whether they clip. shown: whether their handles are visible.
    """

    sides: Sides = WHOLE
    planes: tuple[Plane, ...] = ()
    active: bool = True
    shown: bool = False

    @classmethod
    def from_planes(cls, clip: Sequence[Plane], volume: Volume) -> ClipState:
        """The cuts of planes; planes along a side of the volume's box become its box."""
        sides, others = [list(side) for side in WHOLE], []
        for plane in clip:
            side = _side(plane, volume)
            if side is None:
                others.append(plane)
                continue
            axis, end, share = side
            sides[axis][end] = min(sides[axis][1], share) if end else max(sides[axis][0], share)
        if any(low >= high for low, high in sides):
            return cls(planes=tuple(clip))
        return cls(tuple((low, high) for low, high in sides), tuple(others))

    @property
    def any(self) -> bool:
        """Whether there is a plane, or a box smaller than the volume's."""
        return self.sides != WHOLE or bool(self.planes)

    def clip(self, volume: Volume) -> tuple[Plane, ...]:
        """The planes for `Settings.clip`; none while the cuts are inactive."""
        return check_planes([*self.planes, *box_planes(self.sides, volume)]) if self.active else ()

    def with_side(self, axis: int, end: int, share: float) -> ClipState:
        """The cuts with one side of the box moved; the box keeps at least LEAST."""
        low, high = self.sides[axis]
        side = (low, max(min(share, 1.0), low + LEAST)) if end else (min(max(share, 0.0), high - LEAST), high)
        return replace(self, sides=(*self.sides[:axis], side, *self.sides[axis + 1 :]))

    def with_plane(self, number: int, plane: Sequence[float]) -> ClipState:
        """The cuts with one plane changed; the number after the last adds one."""
        (unit,) = check_planes([tuple(map(float, plane))])
        return replace(self, planes=(*self.planes[:number], unit, *self.planes[number + 1 :]))

    def without(self, number: int) -> ClipState:
        """The cuts without a plane."""
        return replace(self, planes=(*self.planes[:number], *self.planes[number + 1 :]))


def box_planes(sides: Sides, volume: Volume) -> list[Plane]:
    """The planes along those sides of a box that differ from the volume's."""
    sizes = volume.shape[::-1]
    return [
        index_plane(volume, axis, -1 if end else 1, sides[axis][end] * sizes[axis] - 0.5)
        for axis in range(3)
        for end in range(2)
        if sides[axis][end] != WHOLE[axis][end]
    ]


def _side(plane: Plane, volume: Volume) -> tuple[int, int, float] | None:
    """Axis, end and share of the side of the box that a plane is parallel to; None for other planes."""
    g = np.array(plane[:3]) @ volume.world_from_index
    axis = int(np.abs(g).argmax())
    along = np.delete(g, axis)
    if np.abs(along).max() > SAME * abs(g[axis]):
        return None
    place = (plane[3] - float(np.array(plane[:3]) @ np.asarray(volume.origin))) / float(g[axis])
    share = (place + 0.5) / volume.shape[2 - axis]
    return (axis, int(g[axis] < 0), share) if -SAME <= share <= 1 + SAME else None


@dataclass(frozen=True)
class Ruler:
    """points: picked for the next measure, world units. active: whether clicks pick points. angle: whether angles are
    measured, else distances.
    """

    points: tuple[Triple, ...] = ()
    active: bool = False
    angle: bool = False

    @property
    def missing(self) -> int:
        """Number of points to pick."""
        return (3 if self.angle else 2) - len(self.points)


@dataclass(frozen=True)
class Lasso:
    """points: of the outline being drawn, pixels. active: whether a drag draws one. keep: the part inside it."""

    points: tuple[tuple[float, float], ...] = ()
    active: bool = False
    keep: bool = False


@dataclass(frozen=True)
class LayerStyle:
    """Appearance of a layer. base: transfer function; extinction: a factor on it; opacity: a factor on its opacities.
    threshold: as of `extract`. hidden: numbers of segments that are not drawn. number: of the layer in its document,
    negative for layers that were added. title: its name in lists; "": the layer's. names: of segments, by their
    numbers, instead of the file's. scissors: that cut it, those of the whole scene. surfaces: smoothing of the surfaces
    of segments, as of a layer; None: voxels.
    """

    base: Transfer
    threshold: float = 0.0
    extinction: float = 1.0
    opacity: float = 1.0
    visible: bool = True
    hidden: frozenset[int] = frozenset()
    number: int = 0
    title: str = ""
    names: tuple[tuple[int, str], ...] = ()
    scissors: tuple[Scissors, ...] = ()
    surfaces: float | None = None

    @property
    def is_shown(self) -> bool:
        """Whether the layer can be seen."""
        return self.visible and self.opacity > 0

    @cached_property
    def stated(self) -> Transfer:
        """The transfer function with the extinction, as a saved scene states it; hidden segments have opacity 0."""
        factor = self.extinction
        if factor == 1.0 and not self.hidden:
            return self.base
        points = tuple((value, scale_opacity(opacity, factor)) for value, opacity in self.base.points)
        labels = tuple(
            (number, color, 0.0 if number in self.hidden else scale_opacity(opacity, factor))
            for number, color, opacity in self.base.labels
        )
        regions = [replace(region, opacity=scale_opacity(region.opacity, factor)) for region in self.base.regions]
        return replace(self.base, points=points, labels=labels, regions=regions)

    @cached_property
    def transfer(self) -> Transfer:
        """The transfer function for the renderer: `stated` times the opacity."""
        return self.stated.weakened(self.opacity)

    @property
    def table(self) -> dict[str, Any]:
        """The transfer function as a table of a scene file."""
        stated = self.stated
        table = {f.name: getattr(stated, f.name) for f in fields(Transfer) if getattr(stated, f.name) is not None}
        return {**table, "name_of": self.names} if self.names else table


def stated_transfers(styles: Sequence[LayerStyle]) -> dict[int, Transfer]:
    """Transfer functions of the layers of a file, by their numbers, without those of added layers."""
    return {style.number: style.stated for style in styles if style.number >= 0}


def scale_opacity(opacity: float, factor: float) -> float:
    """The opacity for `factor` times the extinction; 1 stays 1."""
    return opacity if factor == 1 or opacity >= OPAQUE else float(-np.expm1(factor * np.log1p(-opacity)))


@dataclass(frozen=True)
class Slices:
    """Three slices next to the picture. colored: by the transfer function, else grey by its window. place: the point
    that all three contain, as shares of the volume's box along x, y and z. turn: rotation by which they lie oblique.
    in_space: whether planes in the picture follow them. large: axis of the grid of the only one that is shown, as large
    as the window permits. linked: whether a crosshair marks what is under the cursor in the others and in the picture.
    """

    shown: bool = False
    colored: bool = False
    place: Triple = (0.5, 0.5, 0.5)
    turn: Turn = STRAIGHT
    in_space: bool = False
    large: int | None = None
    linked: bool = True

    def index(self, volume: Volume) -> tuple[int, int, int]:
        """The voxel (x, y, z) that all three contain."""
        sizes = volume.shape[::-1]
        x, y, z = (min(int(share * size), size - 1) for share, size in zip(self.place, sizes, strict=True))
        return x, y, z

    def at(self, index: Sequence[float], volume: Volume) -> Slices:
        """The slices through the voxel nearest to an index (x, y, z)."""
        sizes = volume.shape[::-1]
        x, y, z = ((min(max(round(i), 0), size - 1) + 0.5) / size for i, size in zip(index, sizes, strict=True))
        return replace(self, place=(x, y, z))

    def moved(self, axis: int, steps: int, volume: Volume) -> Slices:
        """The slices with the one across an axis moved by voxels."""
        index: list[float] = [*self.index(volume)]
        index[axis] += steps
        return self.at(index, volume)

    def through(self, point: np.ndarray, volume: Volume) -> Slices:
        """The slices through a world point [3], or the middle of its voxel unless they are turned."""
        index = np.linalg.solve(volume.world_from_index, point - np.asarray(volume.origin))
        return self.at(index.tolist(), volume) if self.turn == STRAIGHT else replace(self, place=shares(index, volume))


# fields of slices that do not depend on the volume
SLICE_LOOKS = ("shown", "colored", "linked")
# the annotation of distances and angles
MEASURES = "measures"
COMPARE = ("off", "split", "difference")
# amounts of text over the picture
HUDS = ("short", "full", "off")
# colours of the panel
THEMES = ("dark", "light")
# motion blur modes of a rotating view
BLURS: tuple[Motions, ...] = ("off", "moments", *MOTIONS)


@dataclass(frozen=True, eq=False)
class PinnedView:
    """A pinned document and its settings, shown next to the edited one."""

    document: Document
    settings: Settings

    @property
    def still(self) -> Settings:
        """The settings of its sharp picture."""
        return self.settings.replace(motion="off", classification="auto")

    @property
    def name(self) -> str:
        """Text over its picture."""
        return f"pinned: {self.document.volume.name or self.document.scene.volume}"


@dataclass(frozen=True, eq=False)
class State:
    """pose, settings: camera and rendering options.

    styles: appearance of each layer; selected: the layer that the keys and the panel edit. mesh_files: meshes of the
    scene. cuts: box and planes, which `settings` has too. annotate: annotations of the picture, as of a scene. blur:
    motion blur while the view rotates. show_zk: the plane at z_k. hud: of HUDS. message: shown until the next key.
    time: number of the time point of a series of `times`; playing: whether it advances by itself, by `pace` time points
    a second, and `repeats`. turntable: whether a drag turns about a fixed axis. probe: whether the value under the
    cursor is shown. ruler: measures points; measures: of the scene. lasso: draws scissors. slices: beside the
    picture; slice_planes: in it. file_options: arrays and channels that the file offers. theme: of THEMES. movie: what
    is recorded; preview: plays it. pinned: is drawn at the right, from the same place.
    """

    pose: Pose
    settings: Settings
    styles: tuple[LayerStyle, ...]
    selected: int = 0
    mesh_files: tuple[MeshFile, ...] = ()
    cuts: ClipState = field(default_factory=ClipState)
    annotate: tuple[str, ...] = ()
    turning: bool = False
    blur: Motions = "off"
    show_zk: bool = False
    compare: str = "off"
    hud: str = "short"
    help: bool = False
    panel: bool = False
    ground: str = "black"
    time: int = 0
    times: int = 0
    playing: bool = False
    pace: float = 10.0
    repeats: bool = True
    message: str = ""
    turntable: bool = False
    fullscreen: bool = False
    probe: bool = False
    ruler: Ruler = field(default_factory=Ruler)
    lasso: Lasso = Lasso()
    slices: Slices = field(default_factory=Slices)
    file_options: tuple[FileOption, ...] = ()
    theme: str = THEMES[0]
    pinned: PinnedView | None = None
    movie: Movie = field(default_factory=Movie)
    measures: tuple[Measure, ...] = ()
    slice_planes: tuple[str, ...] = ()
    preview: Preview | None = None

    @classmethod
    def of(cls, document: Document, size: tuple[int, int]) -> State:
        """Initial state of a document: its home view at `size` pixels, its settings and transfer functions."""
        scene, volume = document.scene, document.volume
        return cls(
            document.home(size),
            scene.settings,
            document.styles,
            mesh_files=document.mesh_files,
            cuts=ClipState.from_planes(scene.settings.clip, volume),
            annotate=scene.annotate or default_names(AnnotatedSubject.of(volume)),
            slices=slices_of(Slices(), scene.slice_planes, volume),
            slice_planes=scene.slice_planes,
            movie=Movie.of(scene.animation, volume),
            measures=scene.measures,
        )

    @property
    def gliding(self) -> bool:
        """Whether the view moves by itself."""
        return self.turning or self.preview is not None

    @property
    def beside(self) -> PinnedView | None:
        """Returns the pinned view, unless the reference replaces it."""
        return self.pinned if self.compare == "off" else None

    @property
    def moving(self) -> Settings:
        """The settings while the view turns."""
        return self.settings.replace(motion=self.blur)

    @property
    def style(self) -> LayerStyle:
        """The style of the selected layer."""
        return self.styles[self.selected]

    def with_measures(self, measures: tuple[Measure, ...]) -> State:
        """The state with other measures, which the picture shows."""
        names = tuple(name for name in self.annotate if name != MEASURES)
        return replace(self, measures=measures, annotate=(*names, *[MEASURES] * bool(measures)))

    def edit(self, **changes: Any) -> State:
        """The state with changed fields of the style of the selected layer."""
        return self.with_style(self.selected, replace(self.style, **changes))

    def with_style(self, number: int, style: LayerStyle) -> State:
        """The state with another style of a layer."""
        return replace(self, styles=(*self.styles[:number], style, *self.styles[number + 1 :]))

    def with_bases(self, document: Document, has_same_layers: bool) -> State:
        """The state with the transfer functions of a document that is read again; other edits are kept."""
        if not has_same_layers:
            added = tuple(style for style in self.styles if style.number < 0)
            return replace(self, styles=(*document.styles, *added), selected=0)
        bases = {style.number: style.base for style in document.styles}
        styles = tuple(replace(style, base=bases.get(style.number, style.base)) for style in self.styles)
        return replace(self, styles=styles)

    def opened(self, document: Document) -> State:
        """State for another document with its own view and settings; display options are kept."""
        return self.kept_in(State.of(document, self.pose.camera.size))

    def kept_in(self, other: State) -> State:
        """The state of another document with the display options of this one."""
        window = ("hud", "help", "panel", "ground", "fullscreen", "probe", "theme", "pinned")
        kept = ("pace", "repeats", "turning", "blur", "turntable", *window)
        slices = replace(other.slices, **{name: getattr(self.slices, name) for name in SLICE_LOOKS})
        pose = other.pose.resized(self.pose.camera.size)
        return replace(other, pose=pose, slices=slices, **{name: getattr(self, name) for name in kept})


def played(state: State) -> State:
    """The state with the next time point; a series that does not repeat stops at its last."""
    if state.time + 1 < state.times or state.repeats:
        return replace(state, time=(state.time + 1) % max(state.times, 1))
    return replace(state, playing=False)


def changed_fields(a: State, b: State) -> set[str]:
    """The names of the fields in which two states differ."""
    return {field.name for field in fields(State) if getattr(a, field.name) != getattr(b, field.name)}


# fields that an undo keeps: open parts of the window, and what plays
PASSING = {"message", "help", "hud", "panel", "fullscreen", "probe", "theme", "slices", "lasso", "file_options"}
PASSING |= {"turning", "time", "times", "playing", "pace", "repeats", "preview", "pinned"}
# fields that a saved scene holds and a closed window loses; a view is easily restored
EDITS = {"settings", "styles", "mesh_files", "annotate", "movie", "measures", "slice_planes"}
# largest number of steps
MAX_STEPS = 200


def _as_step(state: State) -> State:
    """The state without documents that an undo leaves alone: they would live as long as the step."""
    return replace(state, pinned=None, preview=None)


def _resized(state: State, before: Pose, pose: Pose) -> State:
    return replace(state, pose=pose) if state.pose is before else state


class History:
    """Undo history of states. One step holds all changes between two moments of rest."""

    def __init__(self, state: State) -> None:
        self.past: list[State] = []
        self.future: list[State] = []
        self.now = self.saved = _as_step(state)

    def note(self, state: State) -> None:
        """Records a state at rest, if it differs from the last one."""
        if self.has_changes(state):
            self.past = [*self.past[-MAX_STEPS + 1 :], self.now]
            self.future, self.now = [], _as_step(state)

    def has_changes(self, state: State) -> bool:
        """Whether a state differs from the last one by more than undo leaves alone."""
        return bool(changed_fields(state, self.now) - PASSING) or state.slices.turn != self.now.slices.turn

    def undo(self, state: State) -> State:
        """The state before; the same one if there is none."""
        self.note(state)
        if not self.past:
            return replace(state, message="nothing to undo")
        self.future.append(self.now)
        return self._at(self.past.pop(), state, "undone")

    def redo(self, state: State) -> State:
        """The state that was undone last; the same one if there is none."""
        self.note(state)
        if not self.future:
            return replace(state, message="nothing to redo")
        self.past.append(self.now)
        return self._at(self.future.pop(), state, "redone")

    def _at(self, step: State, state: State, message: str) -> State:
        kept = {name: getattr(state, name) for name in PASSING}
        if step.slice_planes != state.slice_planes or step.slices.turn != state.slices.turn:
            looks = {name: getattr(state.slices, name) for name in (*SLICE_LOOKS, "large")}
            kept["slices"] = replace(step.slices, **looks)
        shown = replace(step, **{**kept, "message": message, "pose": step.pose.resized(state.pose.camera.size)})
        self.now = _as_step(shown)
        return shown

    def resize(self, before: Pose, pose: Pose) -> None:
        """Changes the size of a view in all its states, which is not a step."""
        self.past = [_resized(step, before, pose) for step in self.past]
        self.future = [_resized(step, before, pose) for step in self.future]
        self.now = _resized(self.now, before, pose)

    def resume(self, state: State) -> None:
        """Goes on from the latest state in other display options and another size, which is not a step."""
        self.now = _as_step(state)

    def forget(self, state: State) -> None:
        """Drops all steps: layers or channels of other files cannot be restored."""
        self.past, self.future, self.now = [], [], _as_step(state)

    def mark_saved(self, state: State) -> None:
        """Records that the edits of a state are saved."""
        self.saved = _as_step(state)

    def has_unsaved_edits(self, state: State) -> bool:
        """Whether closing the window would lose edits."""
        return bool(changed_fields(state, self.saved) & EDITS)

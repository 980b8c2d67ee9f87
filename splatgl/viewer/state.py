"""`State`: everything that the window shows, as one immutable value, and its undo history."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.annotations.annotate import default_names
from splatgl.annotations.canvas import Subject
from splatgl.data.volume import Triple, Volume
from splatgl.scene.meshes import MeshFile
from splatgl.splat.clipping import MOST_CLIPS, Plane, index_plane, planes
from splatgl.splat.motion_blur import MOTIONS
from splatgl.splat.settings import Settings
from splatgl.splat.transfer import OPAQUE, Transfer
from splatgl.viewer.trackball import Pose

if TYPE_CHECKING:
    from splatgl.viewer.document import Document


@dataclass(frozen=True)
class FileOption:
    """An option of `load`, and what it may be: values, each with a few words."""

    option: str
    found: tuple[tuple[str, str], ...]

    @property
    def texts(self) -> list[str]:
        """Values and words, in a line each."""
        return [f"{value}  {words}".rstrip() for value, words in self.found]

    def number(self, reading: Mapping[str, Any]) -> int:
        """Which of them is read; of channels none stands for all."""
        asked = str(reading.get(self.option, self.found[0][0]))
        return next((n for n, (value, words) in enumerate(self.found) if asked in (value, words)), 0)


WHOLE = ((0.0, 1.0),) * 3
# most planes beside the six of the box
MOST_PLANES = MOST_CLIPS - 6
# shares of the box: of its sides that nearly coincide, and of what a box keeps at least
SAME, LEAST = 1e-9, 1e-3

Sides = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Cuts:
    """sides: what the box keeps of the volume's, as shares along its x, y and z. planes: (n_x, n_y, n_z, d), world
    units; kept is n · x ≥ d. active: whether they cut. shown: whether their handles are.
    """

    sides: Sides = WHOLE
    planes: tuple[Plane, ...] = ()
    active: bool = True
    shown: bool = False

    @classmethod
    def of(cls, clip: Sequence[Plane], volume: Volume) -> Cuts:
        """The cuts of planes, of which those along a side of the volume's box are its box."""
        sides, others = [list(each) for each in WHOLE], []
        for plane in clip:
            found = _side(plane, volume)
            if found is None:
                others.append(plane)
                continue
            axis, end, share = found
            sides[axis][end] = min(sides[axis][1], share) if end else max(sides[axis][0], share)
        if any(low >= high for low, high in sides):
            return cls(planes=tuple(clip))
        return cls(tuple((low, high) for low, high in sides), tuple(others))

    @property
    def any(self) -> bool:
        """Whether anything is cut off while they are active."""
        return self.sides != WHOLE or bool(self.planes)

    def clip(self, volume: Volume) -> tuple[Plane, ...]:
        """The planes that cut, as of `Settings`."""
        return planes([*self.planes, *box_planes(self.sides, volume)]) if self.active else ()

    def with_side(self, axis: int, end: int, share: float) -> Cuts:
        """With one side of the box moved, which keeps LEAST of it at least."""
        low, high = self.sides[axis]
        moved = (
            (low, float(np.clip(share, low + LEAST, 1.0))) if end else (float(np.clip(share, 0.0, high - LEAST)), high)
        )
        return replace(self, sides=tuple(moved if number == axis else each for number, each in enumerate(self.sides)))

    def with_plane(self, number: int, plane: Sequence[float]) -> Cuts:
        """With one plane changed; the number after the last adds one."""
        (found,) = planes([tuple(map(float, plane))])
        return replace(self, planes=(*self.planes[:number], found, *self.planes[number + 1 :]))

    def without(self, number: int) -> Cuts:
        """Without a plane."""
        return replace(self, planes=(*self.planes[:number], *self.planes[number + 1 :]))


def box_planes(sides: Sides, volume: Volume) -> list[Plane]:
    """The planes at the sides of a box that are not the volume's own."""
    found = []
    for axis, (each, size) in enumerate(zip(sides, volume.shape[::-1], strict=True)):
        for end, whole in enumerate((0.0, 1.0)):
            if each[end] != whole:
                found.append(index_plane(volume, axis, -1 if end else 1, each[end] * size - 0.5))
    return found


def _side(plane: Plane, volume: Volume) -> tuple[int, int, float] | None:
    """Axis, end and share of the box's side that a plane is; None for others."""
    g = np.array(plane[:3]) @ volume.world_from_index
    axis = int(np.abs(g).argmax())
    along = np.delete(g, axis)
    if np.abs(along).max() > SAME * abs(g[axis]):
        return None
    place = (plane[3] - float(np.array(plane[:3]) @ np.asarray(volume.origin))) / float(g[axis])
    share = (place + 0.5) / volume.shape[2 - axis]
    return (axis, int(g[axis] < 0), share) if -SAME <= share <= 1 + SAME else None


# what an undo does not bring back: what is open on the screen, and what is asked for
PASSING = (
    "message",
    "asks",
    "help",
    "hud",
    "panel",
    "turning",
    "time",
    "times",
    "playing",
    "fullscreen",
    "probe",
    "slices",
    "picks",
    "picked",
)
# what a saved scene holds and a closed window loses; a view is soon found again
EDITS = ("settings", "looks", "meshes", "annotate")
# largest number of steps
MOST = 200


class History:
    """The states to go back and forward to. One step is all that happens between two moments of rest."""

    def __init__(self, state: State) -> None:
        self.past: list[State] = []
        self.future: list[State] = []
        self.now = self.saved = state

    def note(self, state: State) -> None:
        """Records a state at rest, if it differs from the last one."""
        if not _same(state, self.now):
            self.past = [*self.past[-MOST + 1 :], self.now]
            self.future, self.now = [], state

    def undone(self, state: State) -> State:
        """The state before; the same one where there is none."""
        self.note(state)
        if not self.past:
            return replace(state, message="nothing to undo")
        self.future.append(self.now)
        return self._at(self.past.pop(), state, "undone")

    def redone(self, state: State) -> State:
        """The state that was undone last; the same one where there is none."""
        self.note(state)
        if not self.future:
            return replace(state, message="nothing to redo")
        self.past.append(self.now)
        return self._at(self.future.pop(), state, "redone")

    def fitted(self, before: Pose, pose: Pose) -> None:
        """Takes another size of the window as no step."""
        if self.now.pose is before:
            self.now = replace(self.now, pose=pose)

    def begin(self, state: State) -> None:
        """Forgets everything: the state is that of another document."""
        self.forget(state)
        self.saved = state

    def forget(self, state: State) -> None:
        """Forgets the steps: those of other layers or channels cannot be taken back."""
        self.past, self.future, self.now = [], [], state

    def keep(self, state: State) -> None:
        """Notes that the state's edits are saved."""
        self.saved = state

    def unsaved(self, state: State) -> bool:
        """Whether edits would be lost."""
        return any(getattr(state, name) != getattr(self.saved, name) for name in EDITS)

    def _at(self, found: State, state: State, said: str) -> State:
        shown = {name: getattr(state, name) for name in PASSING}
        pose = found.pose.resized(state.pose.camera.size)
        self.now = replace(found, **{**shown, "message": said, "pose": pose})
        return self.now


def _same(a: State, b: State) -> bool:
    names = (name for name in State.__dataclass_fields__ if name not in PASSING)
    return all(getattr(a, name) == getattr(b, name) for name in names)


def default_annotations(document: Document) -> tuple[str, ...]:
    """Annotations of the scene, else the window's default ones."""
    return document.scene.annotate or default_names(Subject.of(document.volume))


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


@dataclass(frozen=True)
class LayerStyle:
    """base: a transfer function; extinction: a factor on it; opacity: a factor on its opacities. threshold: as of
    `extract`.
    """

    base: Transfer
    threshold: float = 0.0
    extinction: float = 1.0
    opacity: float = 1.0
    visible: bool = True

    @property
    def given(self) -> Transfer:
        """The transfer function with the extinction in it, as a saved scene states it."""
        if self.extinction == 1.0:
            return self.base
        return replace(self.base, points=tuple((v, stronger(a, self.extinction)) for v, a in self.base.points))

    @property
    def transfer(self) -> Transfer:
        """The transfer function that is drawn."""
        return self.given.weakened(self.opacity)

    @property
    def table(self) -> dict[str, Any]:
        """The transfer function as a scene file has it."""
        given = self.given
        return {f.name: getattr(given, f.name) for f in fields(Transfer) if getattr(given, f.name) is not None}

    def of_unit(self, unit: float) -> LayerStyle:
        """With opacities of that length, where none is stated."""
        return self if self.base.unit is not None else replace(self, base=replace(self.base, unit=unit))


def stronger(opacity: float, factor: float) -> float:
    """The opacity for `factor` times the extinction; 1 stays 1."""
    return opacity if opacity >= OPAQUE else float(-np.expm1(factor * np.log1p(-opacity)))


@dataclass(frozen=True)
class Slices:
    """shown: whether they are. colored: in the transfer function's colours, else grey by its window. place: the point
    that all three go through, as shares of the volume's box along x, y and z.
    """

    shown: bool = False
    colored: bool = False
    place: Triple = (0.5, 0.5, 0.5)

    def index(self, volume: Volume) -> tuple[int, int, int]:
        """The voxel (x, y, z) that all three go through."""
        sizes = volume.shape[::-1]
        x, y, z = (min(int(share * size), size - 1) for share, size in zip(self.place, sizes, strict=True))
        return x, y, z

    def at(self, index: Sequence[float], volume: Volume) -> Slices:
        """Through the voxel at an index (x, y, z), or the nearest one that there is."""
        sizes = volume.shape[::-1]
        x, y, z = ((min(max(round(each), 0), size - 1) + 0.5) / size for each, size in zip(index, sizes, strict=True))
        return replace(self, place=(x, y, z))

    def moved(self, axis: int, steps: int, volume: Volume) -> Slices:
        """With the slice across an axis moved by so many voxels."""
        index: list[float] = [*self.index(volume)]
        index[axis] += steps
        return self.at(index, volume)

    def through(self, point: np.ndarray, volume: Volume) -> Slices:
        """Through a world point [3]."""
        return self.at(np.linalg.solve(volume.world_from_index, point - np.asarray(volume.origin)).tolist(), volume)


COMPARE = ("off", "split", "difference")
# what is said of the picture
HUDS = ("short", "full", "off")
# what of a look is that of the selected part, and edited
EDITED = ("base", "threshold", "extinction")
# motion blur modes of a rotating view
BLURS = ("off", "moments", *MOTIONS)


@dataclass(frozen=True, eq=False)
class State:
    """pose, settings: camera and rendering options. base: the transfer function; extinction: a factor on it.

    blur: motion blur while the view rotates. time: number of the time point of a series of `times`; playing: whether it
    goes on by itself. hud: of HUDS. asks: pending window actions ("screenshot", "save", "save-as", "undo", "redo",
    "open", "open PATH", "cancel", "forget", "quit"). message: shown until the next key. cuts: box and planes, which
    `settings` has too. annotate: what is laid over the picture, as of a scene. probe: whether the value under the
    cursor is told. ruler: what is measured. slices: those beside the picture. turntable: whether a drag turns about a
    fixed axis.

    parts: how the layers of a document of several are seen, of which `selected` is the one that base, threshold and
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
    parts: tuple[LayerStyle, ...] = ()
    selected: int = 0
    meshes: tuple[MeshFile, ...] = ()
    picks: tuple[FileOption, ...] = ()
    picked: tuple[str, str] | None = None
    turntable: bool = False
    fullscreen: bool = False
    probe: bool = False
    ruler: Ruler = field(default_factory=Ruler)
    slices: Slices = field(default_factory=Slices)

    @classmethod
    def of(cls, document: Document, size: tuple[int, int]) -> State:
        """Initial state of a document: its home view at `size` pixels, its settings and transfer function."""
        settings = document.scene.settings
        cuts = Cuts.of(settings.clip, document.volume)
        annotate = default_annotations(document)
        looks = document.looks
        found = cls(document.home(size), settings, looks[0].base, looks[0].threshold, cuts=cuts, annotate=annotate)
        return replace(found, parts=looks if document.surfaces or len(looks) > 1 else (), meshes=document.surfaces)

    @property
    def moving(self) -> Settings:
        """The settings while the view is turned."""
        return self.settings.but(motion=self.blur)

    @property
    def transfer(self) -> Transfer:
        """The transfer function of what is selected: node extinctions times the factor."""
        return LayerStyle(self.base, self.threshold, self.extinction).given

    @property
    def looks(self) -> tuple[LayerStyle, ...]:
        """How each part is seen; of one volume, that one."""
        if not self.parts:
            return (LayerStyle(self.base, self.threshold, self.extinction),)
        own = {name: getattr(self, name) for name in EDITED}
        return _put(self.parts, self.selected, replace(self.parts[self.selected], **own))

    def looking(self, number: int, look: LayerStyle) -> State:
        """With another look of a part."""
        found = replace(self, parts=_put(self.looks, number, look))
        return found if number != self.selected else replace(found, **{name: getattr(look, name) for name in EDITED})

    def selecting(self, number: int) -> State:
        """With another part selected, whose transfer function is edited."""
        return replace(self, parts=self.looks, selected=number).looking(number, self.looks[number])

    def based_on(self, document: Document) -> State:
        """With the transfer functions of a document that is read again, none of which was edited."""
        looks = document.looks
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

    def opened(self, document: Document) -> State:
        """State for another document with its own view and settings; display options are kept."""
        fresh = State.of(document, self.pose.camera.size)
        kept = ("hud", "help", "panel", "ground", "turning", "blur", "turntable", "fullscreen", "probe")
        beside = replace(self.slices, place=fresh.slices.place)
        return replace(fresh, slices=beside, **{name: getattr(self, name) for name in kept})


def _put(parts: tuple[LayerStyle, ...], number: int, look: LayerStyle) -> tuple[LayerStyle, ...]:
    return (*parts[:number], look, *parts[number + 1 :])


def _next(values: tuple[str, ...], value: str) -> str:
    return values[(values.index(value) + 1) % len(values)]

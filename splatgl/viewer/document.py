"""The open scene, with its splats at each stride."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from splatgl.data.mesh import Mesh
from splatgl.data.volume import Volume, halve_volume
from splatgl.errors import expected
from splatgl.scene.draw import is_layered, of_channels, tell
from splatgl.scene.meshes import MeshFile, surfaces_of
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.view import FOV, ViewOptions
from splatgl.splat.camera import Bounded, Camera
from splatgl.splat.clipping import Plane
from splatgl.splat.culling import skinned
from splatgl.splat.extract import Progress, extract, only_pre
from splatgl.splat.grid import Grid
from splatgl.splat.opaque_bounds import Opaque
from splatgl.splat.resolve import Resolved, extraction_kind, why_per_splat
from splatgl.splat.scene import MOST_LAYERS, Layer, check_layer
from splatgl.splat.scene import Scene as Layers
from splatgl.splat.settings import BLENDS, Settings
from splatgl.splat.splats import MOST_KEPT, Splats
from splatgl.splat.transfer import Transfer
from splatgl.viewer.adaptive_quality import STRIDES
from splatgl.viewer.stand_in import StandIn, choose_stand_in
from splatgl.viewer.state import LayerStyle
from splatgl.viewer.trackball import Pose

# volumes with fewer voxels are not downsampled
SMALL = 1 << 15
# number of splats that can be processed within a millisecond
FEW = 200_000


@dataclass(frozen=True, eq=False)
class Document:
    """volumes: one for each of STRIDES, finest first. Splats are extracted on demand.

    portion: what of the scene's volume they are.
    kind: classification and kernel that splats are extracted for. before: `counts` of the document that
    this one replaces. beside: documents that differ in kind alone, by `after`. waiting: whether nothing is read yet.
    """

    scene: SceneFile
    volumes: tuple[Volume, ...]
    transfer: Transfer
    threshold: float
    kind: tuple[str, str] = ("pre", "")
    before: tuple[int, ...] = (0,) * len(STRIDES)
    made: dict[int, Splats] = field(default_factory=dict)
    skins: dict[int, Splats] = field(default_factory=dict)
    beside: dict[bool, Document] = field(default_factory=dict)
    portion: StandIn | None = None
    waiting: bool = False

    def __post_init__(self) -> None:
        self.beside[self.after] = self

    @classmethod
    def nothing(cls, scene: SceneFile) -> Document:
        """What there is of a scene before it is read."""
        volume = Volume(np.zeros((2, 2, 2), np.uint8), name=Path(scene.volume).name)
        bare = replace(
            scene, view=ViewOptions(), settings=Settings(), transfer={}, layers=(), meshes=(), crop="", clip=None
        )
        found = cls(bare, (volume,) * len(STRIDES), Transfer([(0, 0.0), (1, 0.5)]), 0.0, waiting=True)
        for stride in STRIDES:
            found.skin(stride)
        return found

    @classmethod
    def open(cls, scene: SceneFile, quiet: bool = False) -> Document:
        """Reads the volume, or a stand-in, and extracts the splats of all strides; InputError as the readers raise.

        quiet: whether notes on the files are not printed.
        """
        smooth = [each.surfaces for each in (scene, *scene.layers) if each.surfaces is not None]
        if smooth:
            fix = "splatgl render draws them"
            raise expected("surfaces", "none in the window, which draws voxels", f"{smooth[0]:g}", fix)
        volume = scene.open()
        several = is_layered(scene, volume)
        tell(volume, quiet, channels=several, times=True)
        if several:
            return Together.opened(scene, volume, quiet)
        return cls.of_volume(scene.cut(volume), volume, scene.transfer_for(volume))

    @classmethod
    def of_volume(cls, scene: SceneFile, volume: Volume, transfer: Transfer) -> Document:
        """Of a volume that is read, or of a stand-in."""
        shown = choose_stand_in(volume, transfer, scene.settings)
        if shown.told or shown.finer:
            # opacities stay those of the finest voxels
            transfer = replace(transfer, unit=transfer.unit or _spacing(volume))
        return cls._of(scene, shown, transfer)

    def finer(self) -> Document:
        """The document of the portion that replaces this one's, which is read now."""
        assert self.portion and self.portion.finer
        return self._of(self.scene, self.portion.finer(), self.transfer)

    @classmethod
    def _of(cls, scene: SceneFile, shown: StandIn, transfer: Transfer) -> Document:
        volume = shown.volume
        volumes = [volume]
        for _ in STRIDES[1:]:
            last = volumes[-1]
            less = halve_volume(last, bool(transfer.labels)) if last.count > SMALL and not last.coarser else last
            half = next(iter(last.coarser), less)
            volumes.append(half)
        before = tuple(each.count for each in volumes)
        document = cls(scene, tuple(volumes), transfer, scene.threshold, before=before, portion=shown)
        document = document.classified(scene.settings)
        document.skin(STRIDES[-1])
        return document

    @property
    def looks(self) -> tuple[LayerStyle, ...]:
        """How each part of the document is seen; of one volume, that one."""
        return (LayerStyle(self.transfer, self.threshold),)

    @property
    def surfaces(self) -> tuple[MeshFile, ...]:
        """The meshes of a scene beside its volumes."""
        return ()

    @property
    def channels(self) -> list[Document]:
        """The parts that are channels of one volume."""
        return [self]

    @property
    def names(self) -> tuple[str, ...]:
        """A name of each part."""
        return (self.volume.name or self.scene.volume,)

    @property
    def drawing(self) -> list[Document]:
        """The parts whose splats are drawn."""
        return [self]

    def mesh(self, file: MeshFile) -> Mesh | None:
        """What is read of a mesh; None if it is not."""
        return None

    def part(self, number: int) -> Document:
        """One part of the document."""
        return self

    @property
    def counts(self) -> tuple[int, ...]:
        """Number of visible splats at each of STRIDES, estimated where none are extracted yet."""
        found: list[int] = []
        for stride, before in zip(STRIDES, self.before, strict=True):
            known = len(self.skins[stride]) if stride in self.skins else min([before, *found[-1:]])
            found.append(known)
        return tuple(found)

    @property
    def extracted(self) -> tuple[int, ...]:
        """The strides whose splats are extracted, finest first."""
        return tuple(sorted(self.skins))

    @property
    def complete(self) -> bool:
        """Whether all splats that are to be drawn are extracted."""
        return set(self.extracted) >= set(STRIDES[self.heavy :])

    def voxels(self, stride: int) -> int:
        """Number of voxels at a stride."""
        return self.volumes[STRIDES.index(stride)].count

    @property
    def volume(self) -> Volume:
        """The full-resolution volume."""
        return self.volumes[0]

    @property
    def spacing(self) -> float:
        """The finest volume's mean spacing, world units: the default unit length of opacities."""
        return _spacing(self.volume)

    @property
    def whole(self) -> bool:
        """Whether the finest splats are extracted."""
        return 1 in self.skins

    @property
    def heavy(self) -> bool:
        """Whether the finest splats would exceed MOST_KEPT, estimated from stride 2."""
        return not self.whole and 2 in self.made and 8 * len(self.made[2]) > MOST_KEPT

    @property
    def finest(self) -> Splats:
        """The finest splats extracted so far; the coarsest if there are none."""
        return self.made[min(self.made)] if self.made else self.at(STRIDES[-1])

    @property
    def sample(self) -> Splats:
        """The finest extracted splats with at most FEW elements, cheap enough to process every frame."""
        few = [stride for stride in sorted(self.made) if len(self.made[stride]) <= FEW]
        return self.made[few[0]] if few else self.at(STRIDES[-1])

    @property
    def subject(self) -> Bounded:
        """The object that a default view is fitted to."""
        return self._opaque if self.after else self.finest if len(self.finest) else self.volume

    @cached_property
    def _opaque(self) -> Opaque:
        return Opaque(self.volume, self.transfer)

    def at(self, stride: int, progress: Progress | None = None) -> Splats:
        """The splats at a stride; opacities are per the finest volume's spacing at every stride. progress: as of
        `extract`, if they are not extracted yet.
        """
        if stride > 1 and self.volumes[STRIDES.index(stride)] is self.volume:
            return self.at(1, progress)
        if stride not in self.made:
            volume, (how, kernel) = self.volumes[STRIDES.index(stride)], self.kind
            transfer = self._at(stride, self.transfer)
            # what is drawn in motion alone leaves out what hardly shows
            how = "post-lean" if how == "post" and stride > 1 else how
            asked = {"progress": progress, "classification": how, "kernel": kernel}
            self.made[stride] = extract(volume, transfer, self.threshold, **asked)  # type: ignore[arg-type]
        return self.made[stride]

    def _at(self, stride: int, transfer: Transfer) -> Transfer:
        """The transfer function at a stride."""
        return transfer if stride == 1 else replace(transfer, unit=transfer.unit or self.spacing)

    def skin(self, stride: int, progress: Progress | None = None) -> Splats:
        """The splats at a stride without those hidden from every side."""
        if stride not in self.skins:
            same = stride > 1 and self.volumes[STRIDES.index(stride)] is self.volume
            self.skins[stride] = self.skin(1, progress) if same else skinned(self.at(stride, progress))
        return self.skins[stride]

    def extract(self, stride: int, progress: Progress | None = None) -> None:
        """Extracts the splats at a stride, all and those that are not hidden."""
        self.skin(stride, progress)

    @property
    def after(self) -> bool:
        """Whether splats are classified after reconstruction."""
        return self.kind[0] != "pre"

    @property
    def fresh(self) -> bool:
        """Whether extraction with the transfer function would give the finest splats."""
        post = self.at(1).post if self.whole else None
        return self.whole and (post is None or post.fresh)

    def followed(
        self, looks: Sequence[LayerStyle], surfaces: Sequence[MeshFile], settings: Settings, moving: bool = False
    ) -> Document:
        """The document as its parts are to be seen; this one if it is."""
        return self.following(looks[0].transfer, looks[0].threshold, settings, moving)

    def subject_at(self, stride: int, settings: Settings) -> tuple[Splats | Layers, Settings]:
        """What a renderer draws at a stride, with these settings."""
        return self.at(stride), settings

    def check(self, settings: Settings, resolved: Resolved) -> None:
        """InputError for settings that this document is not drawn with."""

    def anew(self) -> Document:
        """The same without any splats: those that are there may be of values extracted for another transfer."""
        return replace(self, made={}, skins={}, beside={})

    def following(self, transfer: Transfer, threshold: float, settings: Settings, moving: bool = False) -> Document:
        """The document of these values, as a picture with these settings takes it; this one if it is."""
        same = (transfer, threshold) == (self.transfer, self.threshold)
        return (self if same else self.changed(transfer, threshold)).classified(settings, moving)

    def changed(self, transfer: Transfer, threshold: float) -> Document:
        """A copy with another transfer function, and of the splats those whose values serve it too."""
        after = self.beside.get(True, self)
        made = {
            stride: splats.classified_after(splats.post.recolored(self._at(stride, transfer)))
            for stride, splats in after.made.copy().items()
            if splats.post is not None and splats.post.holds(transfer)
        }
        kept = (after.kind, self.counts, made, made.copy())
        return Document(self.scene, self.volumes, transfer, threshold, *kept, portion=self.portion)

    def classified(self, settings: Settings, moving: bool = False) -> Document:
        """The document as a picture with these settings takes it; others of the same transfer function are kept.

        moving: whether the picture is motion-blurred.
        """
        # pre where it is all that volume or settings allow
        asked = settings.but(classification="auto") if settings.classification == "post" else settings
        why = only_pre(self.volume, self.transfer, self.threshold)
        found = extraction_kind(asked, moving, why, self.volume.count)
        if found == self.kind:
            # values that are kept for other transfer functions are not this one's
            return replace(self, made={}, skins={}, beside={}) if why and self.after and self.made else self
        after = found[0] != "pre"
        if why and after:
            # nor of values that cannot be extracted: that is told once they are asked for
            return replace(self, kind=found, before=self.counts, made={}, skins={}, beside={})
        other = self.beside.get(after)
        if other is None or other.kind != found:
            other = replace(self, kind=found, before=self.counts, made={}, skins={})
        return other

    def only_before(self, settings: Settings, moving: bool) -> str | None:
        """What takes splats that are classified before reconstruction; None if these settings don't."""
        return only_pre(self.volume, self.transfer, self.threshold) or why_per_splat(settings, moving)

    def home(self, size: tuple[int, int]) -> Pose:
        """The scene's initial view, with its pivot at the scene's middle."""
        camera = replace(self.scene.view, size=size).camera(self.volume, self.subject)
        fov = self.scene.view.fov or self.volume.hints.fov or _fov(camera)
        return Pose(camera, self.middle, float(fov), self.reach)

    @property
    def middle(self) -> np.ndarray:
        """Centre of the bounding box of all splats, world coordinates."""
        corners = self.subject.corners
        return np.asarray((corners.min(axis=0) + corners.max(axis=0)) / 2)

    @cached_property
    def reach(self) -> float:
        """Radius of the volume's bounding box, world units."""
        corners = self.volume.corners
        return float(np.linalg.norm(corners - corners.mean(axis=0), axis=1).max())


def _spacing(volume: Volume) -> float:
    """Mean spacing, world units."""
    return Grid(volume.world_from_index, np.asarray(volume.origin)).mean_spacing


def _fov(camera: Camera) -> float:
    """Field of view in degrees; FOV for an orthographic camera."""
    return float(np.degrees(2 * np.arctan(camera.extent / 2))) if camera.perspective else FOV


def source_key(surface: MeshFile) -> MeshFile:
    """What is read of a mesh, whatever its look."""
    return replace(surface, color="", opacity=1.0, visible=True)


def read_meshes(surfaces: Sequence[MeshFile]) -> dict[MeshFile, Mesh]:
    """The meshes, by `bare`. Raises InputError as `MeshFile.open`."""
    return {each: each.open() for each in dict.fromkeys(map(source_key, surfaces))}


def styled_meshes(surfaces: Sequence[MeshFile], found: Mapping[MeshFile, Mesh]) -> tuple[Mesh, ...]:
    """Those that are to be seen, in their colours and opacities, as `MeshFile.open` reads them."""
    shown = [each for each in surfaces if each.visible and source_key(each) in found]
    return tuple(_looking(each, found[source_key(each)]) for each in shown)


def _looking(surface: MeshFile, mesh: Mesh) -> Mesh:
    made = surface.dressed(mesh)
    # which take as long as a frame, and do not depend on colours
    vars(made)["normals"] = mesh.normals
    return made


# pictures' layers that are kept: those of each stride, and with the cuts before
MOST_DRAWN = 2 * len(STRIDES)


@dataclass(frozen=True, eq=False)
class Drawn(Layers):
    """Layers whose splats are extracted elsewhere."""

    take: Callable[[], tuple[Splats, ...]] = tuple

    def splats(self, settings: Settings) -> tuple[Splats, ...]:
        """Those that are there, whatever the settings."""
        return self.take()

    def __len__(self) -> int:
        """The number of splats."""
        return sum(map(len, self.take()))


@dataclass(frozen=True, eq=False)
class Together(Document):
    """The document of the first part, and all parts, with their names.

    seen: how each part is; cuts: planes of its own, None: the scene's. surfaces: the meshes of the scene; read: what is
    read of them; always: others that are always seen, such as lines. drawn: what was drawn last.
    """

    parts: tuple[Document, ...] = ()
    names: tuple[str, ...] = ()
    seen: tuple[LayerStyle, ...] = ()
    cuts: tuple[tuple[Plane, ...] | None, ...] = ()
    surfaces: tuple[MeshFile, ...] = ()
    read: Mapping[MeshFile, Mesh] = field(default_factory=dict)
    always: tuple[Mesh, ...] = ()
    drawn: dict[object, Drawn] = field(default_factory=dict)

    @classmethod
    def of(cls, parts: Sequence[Document], seen: Sequence[LayerStyle], more: Together | None = None) -> Together:
        """Of these parts, with meshes and cuts of `more`. Raises InputError for too many that are to be seen."""
        shown = sum(each.visible and each.opacity > 0 for each in seen)
        if shown > MOST_LAYERS:
            raise expected("layers", f"at most {MOST_LAYERS} that are visible", shown, "hide some: visible = false")
        first = parts[0]
        own = {name: getattr(first, name) for name in ("scene", "volumes", "transfer", "threshold", "kind", "before")}
        own["names"] = tuple(part.volume.name or part.scene.volume for part in parts)
        coming = next((each.portion for each in parts if each.portion and each.portion.finer), first.portion)
        found = cls(**own, made=first.made, skins=first.skins, portion=coming, parts=tuple(parts), seen=tuple(seen))
        if more is None:
            return replace(found, cuts=(None,) * len(parts), beside={}, drawn={})
        kept = {name: getattr(more, name) for name in ("names", "cuts", "surfaces", "read", "always", "scene")}
        return replace(found, **kept, beside={}, drawn={})

    @classmethod
    def opened(cls, scene: SceneFile, volume: Volume, quiet: bool = False) -> Together:
        """Of a scene whose volume is read; reads all others, with notes on them unless `quiet`. Raises InputError as
        their readers.
        """
        scene = scene.cut(volume)
        sources: list[tuple[SceneFile, Volume, tuple[Plane, ...] | None]] = [(scene, volume, None)]
        names: list[str] = []
        documents: list[Document] = []
        looks: list[LayerStyle] = []
        cuts: list[tuple[Plane, ...] | None] = []
        for layer in scene.layers:
            other = (replace(layer, mask=scene.mask) if layer.mask is None else layer).open()
            tell(other, quiet, channels=True, times=True, layer=layer.volume)
            own = None if layer.clip is None and not layer.crop else layer.cut(other).settings.clip
            sources.append((layer, other, own))
        for source, each, own in sources:
            for name, document, look in _channels(source, each, scene.settings):
                names.append(name)
                documents.append(document)
                looks.append(look)
                cuts.append(own)
        surfaces, always = tuple(surfaces_of(scene)), tuple(scene.vectors.meshes(volume))
        made = replace(cls.of(documents, looks), scene=scene, names=tuple(names), cuts=tuple(cuts), beside={}, drawn={})
        return replace(made, surfaces=surfaces, read=read_meshes(surfaces), always=always, beside={}, drawn={})

    @classmethod
    def with_meshes(cls, document: Document, found: Mapping[MeshFile, Mesh]) -> Together:
        """A document, and what is read of meshes, which are seen where a state names them."""
        base = document if isinstance(document, Together) else cls.of([document], document.looks)
        return replace(base, read={**base.read, **found}, drawn={}, beside={})

    @property
    def looks(self) -> tuple[LayerStyle, ...]:
        """How each part is seen."""
        return self.seen

    @property
    def shown(self) -> list[Document]:
        """The parts that are to be seen."""
        return [part for part, look in zip(self.parts, self.seen, strict=True) if look.visible and look.opacity > 0]

    def part(self, number: int) -> Document:
        """One part."""
        return self.parts[number]

    def mesh(self, file: MeshFile) -> Mesh | None:
        """What is read of a mesh; None if it is not."""
        return self.read.get(source_key(file))

    @property
    def channels(self) -> list[Document]:
        """The parts of the first volume."""
        found = [part for part in self.parts if part.scene.volume == self.scene.volume and "channel" in part.scene.load]
        return found or [self.parts[0]]

    # --- what the window asks of any document -----------------------------------------------------------------------

    @property
    def drawing(self) -> list[Document]:
        """Those whose splats are drawn; the first also where nothing is seen but meshes."""
        return self.shown or [self.parts[0]]

    @property
    def finest(self) -> Splats:
        """Those of the first part that is drawn."""
        return self.drawing[0].finest

    @property
    def sample(self) -> Splats:
        """Those of the first part that is drawn."""
        return self.drawing[0].sample

    def at(self, stride: int, progress: Progress | None = None) -> Splats:
        """Those of the first part that is drawn."""
        return self.drawing[0].at(stride, progress)

    @property
    def counts(self) -> tuple[int, ...]:
        """Number of splats at each of STRIDES, of all that is seen."""
        return tuple(map(sum, zip(*(part.counts for part in self.drawing), strict=True)))

    @property
    def extracted(self) -> tuple[int, ...]:
        """The strides of which the splats of all that is seen are extracted."""
        common = set.intersection(*(set(part.extracted) for part in self.drawing))
        return tuple(sorted(common))

    @property
    def whole(self) -> bool:
        """Whether the finest splats are extracted."""
        return 1 in self.extracted

    @property
    def heavy(self) -> bool:
        """Whether the finest splats of a part are too many."""
        return any(part.heavy for part in self.drawing)

    @property
    def fresh(self) -> bool:
        """Whether extraction would give the same splats."""
        return all(part.fresh for part in self.drawing)

    def voxels(self, stride: int) -> int:
        """Number of voxels at a stride, of all that is seen."""
        return sum(part.voxels(stride) for part in self.drawing)

    def extract(self, stride: int, progress: Progress | None = None) -> None:
        """Extracts the splats at a stride of all that is seen."""
        for part in self.drawing:
            part.extract(stride, progress)

    def followed(
        self, looks: Sequence[LayerStyle], surfaces: Sequence[MeshFile], settings: Settings, moving: bool = False
    ) -> Document:
        """The document of these looks and meshes; this one if it is."""
        # the parts of a scene that was changed on disk may be others
        looks = (*looks, *self.seen[len(looks) :])[: len(self.parts)]
        asked = settings.but(motion="off")
        every = zip(self.parts, looks, strict=True)
        parts = [part.following(look.transfer, look.threshold, asked) for part, look in every]
        same = all(a is b for a, b in zip(parts, self.parts, strict=True))
        if same and looks == self.seen and tuple(surfaces) == self.surfaces:
            return self
        return replace(Together.of(parts, looks, self), surfaces=tuple(surfaces), beside={}, drawn={})

    def following(self, transfer: object, threshold: float, settings: Settings, moving: bool = False) -> Document:
        """The document as a picture with these settings takes it, and as its parts are seen."""
        return self.followed(self.seen, self.surfaces, settings)

    def classified(self, settings: Settings, moving: bool = False) -> Document:
        """As a picture with these settings takes it; blurred ones are means of sharp ones."""
        return self.followed(self.seen, self.surfaces, settings)

    def finer(self) -> Document:
        """The same with the finer portion of the first part that has one, which is read now."""
        number = next(n for n, part in enumerate(self.parts) if part.portion and part.portion.finer)
        parts = [part.finer() if n == number else part for n, part in enumerate(self.parts)]
        return Together.of(parts, self.seen, self)

    def anew(self) -> Document:
        """The same, of which splats that extraction would not give are left out."""
        parts = [part if part.fresh else part.anew() for part in self.parts]
        return replace(Together.of(parts, self.seen, self), beside={}, drawn={})

    def check(self, settings: Settings, resolved: Resolved) -> None:
        """InputError for settings that layers, or meshes, are not drawn with."""
        check_layer(resolved, self.names[0])
        if self.surfaces and not BLENDS[settings.blend].ordered:
            raise expected("meshes", "blend composite", settings.blend)

    # --- the picture ------------------------------------------------------------------------------------------------

    @cached_property
    def meshes(self) -> tuple[Mesh, ...]:
        """Those that are to be seen, in their colours."""
        return (*styled_meshes(self.surfaces, self.read), *self.always)

    def subject_at(self, stride: int, settings: Settings) -> tuple[Splats | Layers, Settings]:
        """The layers and meshes, which the planes of the settings cut."""
        return self.layers(stride, settings.clip), settings.but(clip=())

    def layers(self, stride: int, clip: Sequence[Plane]) -> Drawn:
        """What the renderer draws at a stride, cut by planes; `splatgl render` draws the same at stride 1."""
        key = stride, tuple(clip)
        if key not in self.drawn:
            self._forget()
            self.drawn[key] = self._layers(stride, clip)
        return self.drawn[key]

    def _layers(self, stride: int, clip: Sequence[Plane]) -> Drawn:
        number = STRIDES.index(stride)
        shown = [n for n, part in enumerate(self.parts) if any(part is each for each in self.shown)]
        if not shown:
            first = self.parts[0]
            clear = Layer(first.volumes[number], first.transfer.weakened(0.0), clip=self.cuts[0])
            return Drawn([clear], clip, self.meshes, take=lambda: (_none(first.at(stride)),))
        parts, volumes = [self.parts[n] for n in shown], [self.parts[n].volumes[number] for n in shown]
        layers = [
            Layer(volume, part.transfer, threshold=part.threshold, clip=self.cuts[n])
            for volume, part, n in zip(volumes, parts, shown, strict=True)
        ]
        return Drawn(layers, clip, self.meshes, take=lambda: tuple(part.at(stride) for part in parts))

    def _forget(self) -> None:
        while len(self.drawn) >= MOST_DRAWN:
            del self.drawn[next(iter(self.drawn))]

    @property
    def subject(self) -> Bounded:
        """What a default view is fitted to: layers and meshes that are to be seen, cut or not."""
        return self.layers(1, ())

    @cached_property
    def reach(self) -> float:
        """Radius of a ball around all, world units."""
        boxes = [part.volume.corners for part in self.parts]
        points = np.concatenate([*boxes, *(each.vertices for each in self.meshes)])
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        return float(np.linalg.norm(points - middle, axis=1).max())


def _none(splats: Splats) -> Splats:
    return splats.part(np.zeros(len(splats), bool))


def _channels(source: SceneFile, volume: Volume, settings: Settings) -> list[tuple[str, Document, LayerStyle]]:
    """Name, document and look of each channel of a source, or of the one that there is."""
    plain = replace(source, opacity=1.0)
    found = []
    for number, layer in enumerate(of_channels(plain, volume, plain.transfer_for(volume))):
        scene = replace(source, settings=settings, layers=(), meshes=())
        if len(volume.channels) > 1:
            scene = replace(scene, load={**source.load, "channel": _token(source.load.get("channel"), number)})
        look = LayerStyle(layer.seen, source.threshold, 1.0, source.opacity, source.visible)
        # the first has what is known of the file: its view and time points
        samples = layer.volume if number else replace(volume, channels=())
        document = Document.of_volume(scene, samples, look.transfer)
        unit = document.transfer.unit
        name = layer.volume.name or source.volume
        found.append((name, document, look if unit is None else look.of_unit(unit)))
    return found


def _token(asked: object, number: int) -> int | str:
    """How the option `channel` picks one of those that it picked."""
    if asked in (None, "all"):
        return number
    token = str(asked).split(",")[number].strip()
    return int(token) if token.isdecimal() else token

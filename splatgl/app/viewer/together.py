"""`Together`: a content of several layers or channels, and meshes, which are drawn in one picture."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from splatgl.app.viewer.content import Content
from splatgl.app.viewer.pacing import STRIDES
from splatgl.app.viewer.parts import Look, bare, dressed, read
from splatgl.data.mesh import Mesh
from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.scene.draw import of_channels, tell
from splatgl.scene.meshes import MeshFile, surfaces_of
from splatgl.scene.scene_file import Scene
from splatgl.splat.camera import Bounded
from splatgl.splat.clipping import Plane
from splatgl.splat.extract import Progress
from splatgl.splat.resolve import Resolved
from splatgl.splat.scene import MOST_LAYERS, Layer, check_layer
from splatgl.splat.scene import Scene as Layers
from splatgl.splat.settings import BLENDS, Settings
from splatgl.splat.splats import Splats

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
class Together(Content):
    """The content of the first part, and all parts, with their names.

    seen: how each part is; cuts: planes of its own, None: the scene's. surfaces: the meshes of the scene; read: what is
    read of them; always: others that are always seen, such as lines. drawn: what was drawn last.
    """

    parts: tuple[Content, ...] = ()
    names: tuple[str, ...] = ()
    seen: tuple[Look, ...] = ()
    cuts: tuple[tuple[Plane, ...] | None, ...] = ()
    surfaces: tuple[MeshFile, ...] = ()
    read: Mapping[MeshFile, Mesh] = field(default_factory=dict)
    always: tuple[Mesh, ...] = ()
    drawn: dict[object, Drawn] = field(default_factory=dict)

    @classmethod
    def of(cls, parts: Sequence[Content], seen: Sequence[Look], more: Together | None = None) -> Together:
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
    def opened(cls, scene: Scene, volume: Volume, quiet: bool = False) -> Together:
        """Of a scene whose volume is read; reads all others, with notes on them unless `quiet`. Raises InputError as
        their readers.
        """
        scene = scene.cut(volume)
        sources: list[tuple[Scene, Volume, tuple[Plane, ...] | None]] = [(scene, volume, None)]
        names: list[str] = []
        contents: list[Content] = []
        looks: list[Look] = []
        cuts: list[tuple[Plane, ...] | None] = []
        for layer in scene.layers:
            other = (replace(layer, mask=scene.mask) if layer.mask is None else layer).open()
            tell(other, quiet, channels=True, times=True, layer=layer.volume)
            own = None if layer.clip is None and not layer.crop else layer.cut(other).settings.clip
            sources.append((layer, other, own))
        for source, each, own in sources:
            for name, content, look in _channels(source, each, scene.settings):
                names.append(name)
                contents.append(content)
                looks.append(look)
                cuts.append(own)
        surfaces, always = tuple(surfaces_of(scene)), tuple(scene.vectors.meshes(volume))
        made = replace(cls.of(contents, looks), scene=scene, names=tuple(names), cuts=tuple(cuts), beside={}, drawn={})
        return replace(made, surfaces=surfaces, read=read(surfaces), always=always, beside={}, drawn={})

    @classmethod
    def with_meshes(cls, content: Content, found: Mapping[MeshFile, Mesh]) -> Together:
        """A content, and what is read of meshes, which are seen where a state names them."""
        base = content if isinstance(content, Together) else cls.of([content], content.looks)
        return replace(base, read={**base.read, **found}, drawn={}, beside={})

    @property
    def looks(self) -> tuple[Look, ...]:
        """How each part is seen."""
        return self.seen

    @property
    def shown(self) -> list[Content]:
        """The parts that are to be seen."""
        return [part for part, look in zip(self.parts, self.seen, strict=True) if look.visible and look.opacity > 0]

    def part(self, number: int) -> Content:
        """One part."""
        return self.parts[number]

    def mesh(self, file: MeshFile) -> Mesh | None:
        """What is read of a mesh; None if it is not."""
        return self.read.get(bare(file))

    @property
    def channels(self) -> list[Content]:
        """The parts of the first volume."""
        found = [part for part in self.parts if part.scene.volume == self.scene.volume and "channel" in part.scene.load]
        return found or [self.parts[0]]

    # --- what the window asks of any content -----------------------------------------------------------------------

    @property
    def drawing(self) -> list[Content]:
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
        self, looks: Sequence[Look], surfaces: Sequence[MeshFile], settings: Settings, moving: bool = False
    ) -> Content:
        """The content of these looks and meshes; this one if it is."""
        # the parts of a scene that was changed on disk may be others
        looks = (*looks, *self.seen[len(looks) :])[: len(self.parts)]
        asked = settings.but(motion="off")
        every = zip(self.parts, looks, strict=True)
        parts = [part.following(look.transfer, look.threshold, asked) for part, look in every]
        same = all(a is b for a, b in zip(parts, self.parts, strict=True))
        if same and looks == self.seen and tuple(surfaces) == self.surfaces:
            return self
        return replace(Together.of(parts, looks, self), surfaces=tuple(surfaces), beside={}, drawn={})

    def following(self, transfer: object, threshold: float, settings: Settings, moving: bool = False) -> Content:
        """The content as a picture with these settings takes it, and as its parts are seen."""
        return self.followed(self.seen, self.surfaces, settings)

    def classified(self, settings: Settings, moving: bool = False) -> Content:
        """As a picture with these settings takes it; blurred ones are means of sharp ones."""
        return self.followed(self.seen, self.surfaces, settings)

    def finer(self) -> Content:
        """The same with the finer portion of the first part that has one, which is read now."""
        number = next(n for n, part in enumerate(self.parts) if part.portion and part.portion.finer)
        parts = [part.finer() if n == number else part for n, part in enumerate(self.parts)]
        return Together.of(parts, self.seen, self)

    def anew(self) -> Content:
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
        return (*dressed(self.surfaces, self.read), *self.always)

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


def _channels(source: Scene, volume: Volume, settings: Settings) -> list[tuple[str, Content, Look]]:
    """Name, content and look of each channel of a source, or of the one that there is."""
    plain = replace(source, opacity=1.0)
    found = []
    for number, layer in enumerate(of_channels(plain, volume, plain.transfer_for(volume))):
        scene = replace(source, settings=settings, layers=(), meshes=())
        if len(volume.channels) > 1:
            scene = replace(scene, load={**source.load, "channel": _token(source.load.get("channel"), number)})
        look = Look(layer.seen, source.threshold, 1.0, source.opacity, source.visible)
        # the first has what is known of the file: its view and time points
        samples = layer.volume if number else replace(volume, channels=())
        content = Content.of_volume(scene, samples, look.transfer)
        unit = content.transfer.unit
        name = layer.volume.name or source.volume
        found.append((name, content, look if unit is None else look.of_unit(unit)))
    return found


def _token(asked: object, number: int) -> int | str:
    """How the option `channel` picks one of those that it picked."""
    if asked in (None, "all"):
        return number
    token = str(asked).split(",")[number].strip()
    return int(token) if token.isdecimal() else token

"""`Document`: the open scene, and the splats of each layer at each stride.

A single volume is a document of one layer. Splats are extracted on demand. Documents and layers are immutable:
other styles or settings make copies, which share the splats that still hold.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from splatgl.data.mesh import Mesh
from splatgl.data.volume import Volume, halve_volume
from splatgl.errors import expected
from splatgl.scene.meshes import MeshFile, read_meshes, source_key, styled_mesh, surfaces_of
from splatgl.scene.open_scene import apply_scissors, channel_layers, is_layered, print_notes
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.view import FOV, ViewOptions
from splatgl.splat.camera import Bounded, Camera
from splatgl.splat.clipping import Plane
from splatgl.splat.culling import visible_shell
from splatgl.splat.extract import Progress, extract, why_only_pre
from splatgl.splat.grid import Grid
from splatgl.splat.opaque_bounds import Opaque
from splatgl.splat.resolve import Resolved, extraction_kind, why_per_splat
from splatgl.splat.scene import MOST_LAYERS, Layer, Scene, check_layer
from splatgl.splat.scissors import Scissors, cut_volume
from splatgl.splat.settings import BLENDS, Settings
from splatgl.splat.slices import Slice, parse_slices
from splatgl.splat.splats import MOST_KEPT, Splats
from splatgl.splat.transfer import Transfer
from splatgl.viewer.adaptive_quality import STRIDES
from splatgl.viewer.movie_track import Movie
from splatgl.viewer.oblique import slice_meshes
from splatgl.viewer.segments import style_with_segments
from splatgl.viewer.slice_pixels import layer_looks
from splatgl.viewer.stand_in import StandIn, choose_stand_in
from splatgl.viewer.state import LayerStyle
from splatgl.viewer.trackball import Pose

# volumes with fewer voxels are not downsampled
SMALL = 1 << 15
# number of splats that can be processed within a millisecond
FEW = 200_000
# scenes for the renderer that a document keeps: one per stride, before and after an edit of the clipping planes
MOST_SCENES = 2 * len(STRIDES)


@dataclass(frozen=True, eq=False)
class LayerSplats:
    """Volume of a layer at each of STRIDES, finest first, and its splats.

    scene: options of this layer alone. clip: planes of the layer; None: the scene's. stand_in: the part of the volume
    that is shown. kind: classification and kernel of the splats. estimates: `counts` of the layer that this one
    replaces. made: splats by stride; shells: splats without the hidden ones. variants: layers of the same transfer
    function, by `is_post_classified`.
    """

    name: str
    scene: SceneFile
    volumes: tuple[Volume, ...]
    transfer: Transfer
    threshold: float = 0.0
    clip: tuple[Plane, ...] | None = None
    stand_in: StandIn | None = None
    kind: tuple[str, str] = ("pre", "")
    estimates: tuple[int, ...] = (0,) * len(STRIDES)
    made: dict[int, Splats] = field(default_factory=dict)
    shells: dict[int, Splats] = field(default_factory=dict)
    variants: dict[bool, LayerSplats] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.variants[self.is_post_classified] = self

    @classmethod
    def of_volume(
        cls, name: str, scene: SceneFile, volume: Volume, transfer: Transfer, clip: tuple[Plane, ...] | None = None
    ) -> LayerSplats:
        """Layer of a volume that is read, or of its first stand-in, with the splats of the coarsest stride."""
        shown = choose_stand_in(volume, transfer, scene.settings)
        if shown.note or shown.finer:
            # opacities refer to the finest voxels
            transfer = replace(transfer, unit=transfer.unit or _spacing(volume))
        return cls(name, scene, (), transfer, scene.threshold, clip).with_stand_in(shown)

    def with_stand_in(self, shown: StandIn) -> LayerSplats:
        """The layer with the voxels of a stand-in, and the splats of the coarsest stride."""
        volumes = [shown.volume]
        for _ in STRIDES[1:]:
            last = volumes[-1]
            less = halve_volume(last, bool(self.transfer.labels)) if last.count > SMALL and not last.coarser else last
            volumes.append(next(iter(last.coarser), less))
        estimates = tuple(volume.count for volume in volumes)
        layer = LayerSplats(
            *(self.name, self.scene, tuple(volumes), self.transfer, self.threshold, self.clip, shown),
            estimates=estimates,
        ).for_settings(self.scene.settings)
        layer.shell(STRIDES[-1])
        return layer

    @property
    def volume(self) -> Volume:
        """The volume at full resolution."""
        return self.volumes[0]

    @property
    def has_finer(self) -> bool:
        """Whether finer voxels can be read."""
        return self.stand_in is not None and self.stand_in.finer is not None

    @property
    def counts(self) -> tuple[int, ...]:
        """Number of visible splats at each of STRIDES, estimated where none are extracted yet."""
        counts: list[int] = []
        for stride, estimate in zip(STRIDES, self.estimates, strict=True):
            known = len(self.shells[stride]) if stride in self.shells else min([estimate, *counts[-1:]])
            counts.append(known)
        return tuple(counts)

    @property
    def extracted(self) -> tuple[int, ...]:
        """The strides whose splats are extracted, finest first."""
        return tuple(sorted(self.shells))

    @property
    def exceeds_budget(self) -> bool:
        """Whether the finest splats would exceed MOST_KEPT, estimated from stride 2."""
        return 1 not in self.shells and 2 in self.made and 8 * len(self.made[2]) > MOST_KEPT

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
        """The object that the default view of the layer alone is fitted to."""
        return self._opaque if self.is_post_classified else self.finest if len(self.finest) else self.volume

    @cached_property
    def _opaque(self) -> Opaque:
        return Opaque(self.volume, self.transfer)

    def at(self, stride: int, progress: Progress | None = None) -> Splats:
        """The splats at a stride; opacities are per the finest volume's spacing at every stride. progress: as of
        `extract`, if they are not extracted yet.
        """
        volume = self.volumes[STRIDES.index(stride)]
        if stride > 1 and volume is self.volume:
            return self.at(1, progress)
        if stride not in self.made:
            how, kernel = self.kind
            # previews drop nearly transparent splats
            how = "post-lean" if how == "post" and stride > 1 else how
            options = {"progress": progress, "classification": how, "kernel": kernel}
            transfer = self._transfer_at(stride, self.transfer)
            self.made[stride] = extract(volume, transfer, self.threshold, **options)  # type: ignore[arg-type]
        return self.made[stride]

    def _transfer_at(self, stride: int, transfer: Transfer) -> Transfer:
        return transfer if stride == 1 else replace(transfer, unit=transfer.unit or _spacing(self.volume))

    def shell(self, stride: int, progress: Progress | None = None) -> Splats:
        """The splats at a stride without those hidden from every side."""
        if stride not in self.shells:
            same = stride > 1 and self.volumes[STRIDES.index(stride)] is self.volume
            self.shells[stride] = self.shell(1, progress) if same else visible_shell(self.at(stride, progress))
        return self.shells[stride]

    @property
    def is_post_classified(self) -> bool:
        """Whether splats are classified after reconstruction."""
        return self.kind[0] != "pre"

    @property
    def is_current(self) -> bool:
        """Whether extraction with the transfer function would give the finest splats."""
        post = self.at(1).post if 1 in self.shells else None
        return 1 in self.shells and (post is None or post.is_current)

    def without_splats(self) -> LayerSplats:
        """The layer without any splats: they may hold values extracted for another transfer function."""
        return replace(self, made={}, shells={}, variants={})

    def with_transfer(self, transfer: Transfer, threshold: float) -> LayerSplats:
        """A copy with another transfer function, which keeps the splats whose values serve both."""
        post = self.variants.get(True, self)
        made = {
            stride: splats.with_classifier(splats.post.with_transfer(self._transfer_at(stride, transfer)))
            for stride, splats in post.made.copy().items()
            if splats.post is not None and splats.holds(transfer)
        }
        layer = replace(self, transfer=transfer, threshold=threshold, kind=post.kind, estimates=self.counts)
        return replace(layer, made=made, shells=made.copy(), variants={})

    def for_style(self, style: LayerStyle, settings: Settings, moving: bool = False) -> LayerSplats:
        """The layer in a style, with splats of the kind that the settings take; this one if nothing changes."""
        same = (style.transfer, style.threshold) == (self.transfer, self.threshold)
        layer = self.cut_by(style.scissors)
        return (layer if same else layer.with_transfer(style.transfer, style.threshold)).for_settings(settings, moving)

    @property
    def scissors(self) -> tuple[Scissors, ...]:
        """The scissors that cut the volume."""
        return tuple(mask for mask in self.volume.masks if isinstance(mask, Scissors))

    def cut_by(self, scissors: tuple[Scissors, ...]) -> LayerSplats:
        """The layer, without splats, that scissors leave, instead of those before."""
        cut = {id(each): cut_volume(each, scissors) for each in self.volumes if scissors != self.scissors}
        return replace(self.without_splats(), volumes=tuple(cut[id(each)] for each in self.volumes)) if cut else self

    def for_settings(self, settings: Settings, moving: bool = False) -> LayerSplats:
        """The layer with splats of the kind that the settings take; those of the other kind are kept in `variants`.

        moving: whether the picture is motion-blurred.
        """
        # pre where volume or settings allow nothing else
        requested = settings.but(classification="auto") if settings.classification == "post" else settings
        why = why_only_pre(self.volume, self.transfer, self.threshold)
        kind = extraction_kind(requested, moving, why, self.volume.count)
        if kind == self.kind:
            # values kept for other transfer functions do not hold here
            return self.without_splats() if why and self.is_post_classified and self.made else self
        is_post = kind[0] != "pre"
        if why and is_post:
            # cannot be extracted; the error is raised on use
            return replace(self.without_splats(), kind=kind, estimates=self.counts, variants={})
        other = self.variants.get(is_post)
        if other is None or other.kind != kind:
            other = replace(self, kind=kind, estimates=self.counts, made={}, shells={})
        return other

    def why_pre_classified(self, settings: Settings, moving: bool) -> str | None:
        """The reason why splats are classified before reconstruction; None if the settings allow either."""
        return why_only_pre(self.volume, self.transfer, self.threshold) or why_per_splat(settings, moving)


@dataclass(frozen=True, eq=False)
class ExtractedScene(Scene):
    """Scene whose splats are extracted elsewhere, whatever the settings."""

    take: Callable[[], tuple[Splats, ...]] = tuple

    def splats(self, settings: Settings) -> tuple[Splats, ...]:
        """The splats of each visible layer; ignores the settings."""
        return self.take()

    def __len__(self) -> int:
        """The number of splats."""
        return sum(map(len, self.take()))


@dataclass(frozen=True, eq=False)
class Document:
    """The open scene. layers: at least one; styles: of each layer. others: layers that no style names, by number.

    mesh_files: meshes of the scene; read: the data of meshes, by `source_key`; lines: meshes of vectors, always shown.
    slice_planes: as of a scene. is_loading: whether nothing is read yet. Raises InputError for more than MOST_LAYERS
    visible layers.
    """

    scene: SceneFile
    layers: tuple[LayerSplats, ...]
    styles: tuple[LayerStyle, ...]
    mesh_files: tuple[MeshFile, ...] = ()
    read: Mapping[MeshFile, Mesh] = field(default_factory=dict)
    lines: tuple[Mesh, ...] = ()
    slice_planes: tuple[str, ...] = ()
    others: Mapping[int, LayerSplats] = field(default_factory=dict)
    is_loading: bool = False
    scenes: dict[object, ExtractedScene] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        count = sum(style.is_shown for style in self.styles)
        if count > MOST_LAYERS:
            raise expected("layers", f"at most {MOST_LAYERS} that are visible", count, "hide some: visible = false")

    @classmethod
    def placeholder(cls, scene: SceneFile) -> Document:
        """Placeholder document while a file loads."""
        volume = Volume(np.zeros((2, 2, 2), np.uint8), name=Path(scene.volume).name)
        plain = replace(scene, view=ViewOptions(), settings=Settings(), transfer={}, layers=(), meshes=())
        plain = replace(plain, slice_planes=(), crop="", clip=None)
        transfer = Transfer([(0, 0.0), (1, 0.5)])
        layer = LayerSplats(volume.name, plain, (volume,) * len(STRIDES), transfer)
        for stride in STRIDES:
            layer.shell(stride)
        return cls(plain, (layer,), (LayerStyle(transfer),), is_loading=True)

    @classmethod
    def open(cls, scene: SceneFile, quiet: bool = False) -> Document:
        """Reads all volumes, or stand-ins, and meshes, and extracts the coarsest splats. Raises InputError as their
        readers, and for surfaces. quiet: whether notes on the files are not printed.
        """
        smooth = [source.surfaces for source in (scene, *scene.layers) if source.surfaces is not None]
        if smooth:
            fix = "splatgl render draws them"
            raise expected("surfaces", "none in the window, which draws voxels", f"{smooth[0]:g}", fix)
        volume = scene.open()
        print_notes(volume, quiet, has_times=True)
        scene, volume = apply_scissors(scene, volume)
        scene = scene.cut(volume)
        # refuses a bad one
        Movie.of(scene.animation, volume)
        pairs = _channels(scene, volume, scene.settings, None, folds_opacity=not is_layered(scene, volume))
        for source in scene.layers:
            pairs += read_layer(source, scene, quiet)
        layers = tuple(layer for layer, _ in pairs)
        styles = tuple(replace(style, number=number) for number, (_, style) in enumerate(pairs))
        files = tuple(surfaces_of(scene))
        lines, planes = tuple(scene.vectors.meshes(volume)), scene.slice_planes
        parse_slices([Slice(text).place for text in planes], volume)
        return cls(scene, layers, styles, files, read_meshes(files), lines, planes)

    # --- layers -----------------------------------------------------------------------------------------------------

    @property
    def volume(self) -> Volume:
        """The full-resolution volume of the first layer."""
        return self.layers[0].volume

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the layers."""
        return tuple(style.title or layer.name for layer, style in zip(self.layers, self.styles, strict=True))

    @property
    def pool(self) -> dict[int, LayerSplats]:
        """All layers, also those that were removed, by the numbers that styles name."""
        return {**self.others, **dict(zip((style.number for style in self.styles), self.layers, strict=True))}

    @property
    def file_numbers(self) -> set[int]:
        """The numbers of the layers that the scene file has."""
        return {number for number in self.pool if number >= 0}

    def with_layers(self, layers: Sequence[LayerSplats]) -> tuple[Document, list[int]]:
        """The document with more layers, which are drawn once styles name their numbers; and these numbers."""
        start = min(0, *self.pool)
        added = {start - 1 - place: layer for place, layer in enumerate(layers)}
        return replace(self, others={**self.others, **added}), list(added)

    def with_additions(self, shown: Document) -> Document:
        """The document, which is read anew, with the layers and meshes that were added to the visible one."""
        added = {number: layer for number, layer in shown.pool.items() if number < 0}
        return replace(self, others={**added, **self.others}).with_meshes({**shown.read, **self.read})

    @property
    def is_layered(self) -> bool:
        """Whether the picture is composited from layers and meshes, without an error bound."""
        has_meshes = bool(self.mesh_files or self.lines or self.slice_planes)
        return len(self.layers) > 1 or has_meshes or not self.styles[0].is_shown

    @property
    def drawn_layers(self) -> tuple[LayerSplats, ...]:
        """The visible layers; the first layer where only meshes are visible."""
        return self._visible or self.layers[:1]

    @property
    def _visible(self) -> tuple[LayerSplats, ...]:
        return tuple(layer for layer, style in zip(self.layers, self.styles, strict=True) if style.is_shown)

    @property
    def channels(self) -> tuple[LayerSplats, ...]:
        """The layers that are channels of the first volume."""
        source = self.scene.volume
        channels = (layer for layer in self.layers if layer.scene.volume == source and "channel" in layer.scene.load)
        return tuple(channels) or self.layers[:1]

    @property
    def stand_in(self) -> StandIn | None:
        """The first stand-in that finer voxels will replace; that of the first layer where there is none."""
        return next((layer.stand_in for layer in self.layers if layer.has_finer), self.layers[0].stand_in)

    @property
    def has_finer(self) -> bool:
        """Whether finer voxels of a layer can be read."""
        return any(layer.has_finer for layer in self.layers)

    def refined(self) -> Document:
        """Reads the finer voxels of the first layer that has any, and returns the document with them."""
        number = next(n for n, layer in enumerate(self.layers) if layer.has_finer)
        shown = self.layers[number].stand_in
        assert shown and shown.finer
        layer = self.layers[number].with_stand_in(shown.finer()).cut_by(self.layers[number].scissors)
        return replace(self, layers=(*self.layers[:number], layer, *self.layers[number + 1 :]))

    def mesh(self, file: MeshFile) -> Mesh | None:
        """The data of a mesh; None if it is not read."""
        return self.read.get(source_key(file))

    def with_meshes(self, read: Mapping[MeshFile, Mesh]) -> Document:
        """The document with the data of more meshes, which are visible once `mesh_files` names them."""
        return replace(self, read={**self.read, **read})

    # --- splats -----------------------------------------------------------------------------------------------------

    @property
    def counts(self) -> tuple[int, ...]:
        """Number of splats at each of STRIDES, of all visible layers."""
        return tuple(map(sum, zip(*(layer.counts for layer in self.drawn_layers), strict=True)))

    @property
    def extracted(self) -> tuple[int, ...]:
        """The strides at which the splats of all visible layers are extracted."""
        return tuple(sorted(set.intersection(*(set(layer.extracted) for layer in self.drawn_layers))))

    @property
    def has_full_resolution(self) -> bool:
        """Whether the finest splats are extracted."""
        return 1 in self.extracted

    @property
    def exceeds_budget(self) -> bool:
        """Whether a layer has too many splats at full resolution."""
        return any(layer.exceeds_budget for layer in self.drawn_layers)

    @property
    def is_complete(self) -> bool:
        """Whether all splats that can be drawn are extracted."""
        return set(self.extracted) >= set(STRIDES[self.exceeds_budget :])

    def extract(self, stride: int, progress: Callable[[LayerSplats], Progress] | None = None) -> None:
        """Extracts the splats of all visible layers at a stride. progress: of a layer, called before its extraction."""
        for layer in self.drawn_layers:
            layer.shell(stride, progress and progress(layer))

    def with_styles(
        self, styles: Sequence[LayerStyle], mesh_files: Sequence[MeshFile], settings: Settings, moving: bool = False
    ) -> Document:
        """The document in these styles, with splats of the kind that the settings take; this one if nothing changes.

        moving: whether the picture is motion-blurred.
        """
        pool = self.pool
        # a scene that changed on disk may have other layers
        styles = tuple(style for style in styles if style.number in pool) or self.styles
        layers, named = tuple(pool[style.number] for style in styles), {style.number for style in styles}
        others = {number: layer for number, layer in pool.items() if number not in named}
        shown = replace(self, layers=layers, styles=styles, others=others, mesh_files=tuple(mesh_files))
        if shown.is_layered:
            # blurred pictures of layers are means of sharp ones
            settings, moving = settings.but(motion="off"), False
        layers = tuple(layer.for_style(style, settings, moving) for layer, style in zip(layers, styles, strict=True))
        if (layers, styles, shown.mesh_files) == (self.layers, self.styles, self.mesh_files):
            return self
        return replace(shown, layers=layers)

    def for_settings(self, settings: Settings, moving: bool = False) -> Document:
        """The document with splats of the kind that the settings take. moving: as above."""
        return self.with_styles(self.styles, self.mesh_files, settings, moving)

    def with_current_splats(self) -> Document:
        """The document without splats that extraction would not give."""
        layers = tuple(layer if layer.is_current else layer.without_splats() for layer in self.layers)
        return self if layers == self.layers else replace(self, layers=layers)

    def check(self, settings: Settings, resolved: Resolved) -> None:
        """Raises InputError for settings that layers, or meshes, are not drawn with."""
        if self.is_layered:
            check_layer(resolved, self.names[0])
        if (self.mesh_files or self.slice_planes) and not BLENDS[settings.blend].ordered:
            raise expected("meshes", "blend composite", settings.blend)

    # --- the picture ------------------------------------------------------------------------------------------------

    @cached_property
    def meshes(self) -> tuple[Mesh, ...]:
        """The visible meshes in their colours and opacities, as `MeshFile.open` reads them."""
        visible = [file for file in self.mesh_files if file.visible and source_key(file) in self.read]
        styled = (styled_mesh(file, self.read[source_key(file)]) for file in visible)
        return (*styled, *self.lines, *slice_meshes(layer_looks(self.pool, self.styles), self.slice_planes))

    def with_planes(self, slice_planes: Sequence[str]) -> Document:
        """The document with these slices in space; this one if it has them."""
        planes = tuple(slice_planes)
        return self if planes == self.slice_planes else replace(self, slice_planes=planes)

    def subject_at(self, stride: int, settings: Settings) -> tuple[Splats | Scene, Settings]:
        """The input of a renderer at a stride: the splats of a single volume, else layers and meshes, which the planes
        of the settings clip.
        """
        if not self.is_layered:
            return self.layers[0].at(stride), settings
        return self.scene_at(stride, settings.clip), settings.but(clip=())

    def scene_at(self, stride: int, clip: Sequence[Plane]) -> ExtractedScene:
        """Scene for the renderer at a stride, clipped by planes; `splatgl render` draws the same at stride 1."""
        key = stride, tuple(clip)
        if key not in self.scenes:
            while len(self.scenes) >= MOST_SCENES:
                del self.scenes[next(iter(self.scenes))]
            number, layers = STRIDES.index(stride), self._visible
            if layers:
                parts = [
                    Layer(layer.volumes[number], layer.transfer, threshold=layer.threshold, clip=layer.clip)
                    for layer in layers
                ]
                made = ExtractedScene(parts, clip, self.meshes, take=lambda: tuple(each.at(stride) for each in layers))
            else:
                first = self.layers[0]
                clear = Layer(first.volumes[number], first.transfer.weakened(0.0), clip=first.clip)
                made = ExtractedScene([clear], clip, self.meshes, take=lambda: (_no_splats(first.at(stride)),))
            self.scenes[key] = made
        return self.scenes[key]

    @property
    def subject(self) -> Bounded:
        """The object that a default view is fitted to: visible layers and meshes, unclipped."""
        return self.scene_at(1, ()) if self.is_layered else self.layers[0].subject

    def home(self, size: tuple[int, int]) -> Pose:
        """The scene's initial view, with its pivot in the middle of the scene."""
        camera = replace(self.scene.view, size=size, width=None).camera(self.volume, self.subject)
        fov = self.scene.view.fov or self.volume.hints.fov or _fov(camera)
        return Pose(camera, self.middle, float(fov), self.reach)

    @property
    def middle(self) -> np.ndarray:
        """Centre [3] of the bounding box of the visible scene, world coordinates."""
        corners = self.subject.corners
        return np.asarray((corners.min(axis=0) + corners.max(axis=0)) / 2)

    @cached_property
    def reach(self) -> float:
        """Radius of a ball around all layers and meshes, world units."""
        corners = [layer.volume.corners for layer in self.layers]
        points = np.concatenate([*corners, *(mesh.vertices for mesh in self.meshes)])
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        return float(np.linalg.norm(points - middle, axis=1).max())


def _spacing(volume: Volume) -> float:
    """Mean spacing, world units: the default unit length of opacities."""
    return Grid(volume.world_from_index, np.asarray(volume.origin)).mean_spacing


def _fov(camera: Camera) -> float:
    """Field of view in degrees; FOV for an orthographic camera."""
    return float(np.degrees(2 * np.arctan(camera.extent / 2))) if camera.perspective else FOV


def _no_splats(splats: Splats) -> Splats:
    return splats.part(np.zeros(len(splats), bool))


def read_layer(source: SceneFile, scene: SceneFile, quiet: bool = False) -> list[tuple[LayerSplats, LayerStyle]]:
    """Layers and styles of a file that is laid over a scene, one for each channel. Raises InputError as its reader."""
    volume = cut_volume((replace(source, mask=scene.mask) if source.mask is None else source).open(), scene.scissors)
    print_notes(volume, quiet, has_times=True, layer=source.volume)
    clip = None if source.clip is None and not source.crop else source.cut(volume).settings.clip
    return _channels(source, volume, scene.settings, clip)


def _channels(
    source: SceneFile, volume: Volume, settings: Settings, clip: tuple[Plane, ...] | None, folds_opacity: bool = False
) -> list[tuple[LayerSplats, LayerStyle]]:
    """Layer and style of each channel of a source. folds_opacity: into the transfer function."""
    plain = source if folds_opacity else replace(source, opacity=1.0)
    pairs = []
    for number, channel in enumerate(channel_layers(plain, volume, plain.transfer_for(volume))):
        scene = replace(source, settings=settings, layers=(), meshes=())
        samples = channel.volume
        if len(volume.channels) > 1:
            scene = replace(scene, load={**source.load, "channel": _channel(source.load.get("channel"), number)})
            # the first has what is known of the file: its view and time points
            samples = samples if number else replace(volume, channels=(), labels=samples.labels)
        name = source.title * (len(volume.channels) < 2) or channel.volume.name or source.volume
        opacity = 1.0 if folds_opacity else source.opacity
        style = LayerStyle(channel.seen, source.threshold, 1.0, opacity, source.visible)
        style = style_with_segments(style, channel.volume, source.transfer)
        for part in channel.parts():
            shown = samples if part is channel else part.volume
            planes = clip if part.clip is None else ()
            layer = LayerSplats.of_volume(name, scene, shown, style.stated, planes)
            pairs.append((layer, replace(style.with_unit(layer.transfer.unit), scissors=layer.scissors)))
    return pairs


def _channel(option: object, number: int) -> int | str:
    """Value of the option `channel` that chooses one of the channels that it chose."""
    if option in (None, "all"):
        return number
    token = str(option).split(",")[number].strip()
    return int(token) if token.isdecimal() else token

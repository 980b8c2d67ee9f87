"""`Document`: the open scene, and the splats of each layer at each stride.

A single volume is a document of one layer. Splats are extracted on demand. Documents and layers are immutable:
other styles or settings make copies, which share the splats that still hold.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from splatgl.data.affine import World
from splatgl.data.color import AUTO
from splatgl.data.mesh import Mesh
from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.geometry.camera import Bounded
from splatgl.geometry.clipping import Plane
from splatgl.geometry.slices import Slice, parse_slices
from splatgl.planning.scene import MOST_LAYERS, Layer, Scene
from splatgl.scene.meshes import MeshFile, read_meshes, source_key, styled_mesh, surfaces_of
from splatgl.scene.open_scene import LayerSource, OpenScene, on_background, with_surfaces
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.view import FOV, ViewOptions
from splatgl.splat.extract import Progress
from splatgl.splat.settings import Settings
from splatgl.splat.splats import Splats
from splatgl.transfer.transfer import Transfer
from splatgl.viewer.adaptive_quality import STRIDES, StandIn
from splatgl.viewer.layer_splats import LayerSplats
from splatgl.viewer.movie_track import Movie
from splatgl.viewer.segments import style_with_segments
from splatgl.viewer.slice_planes import layer_looks, slice_meshes
from splatgl.viewer.state import LayerStyle
from splatgl.viewer.trackball import Pose

# scenes for the renderer that a document keeps: one per stride, before and after an edit of the clipping planes
MOST_SCENES = 2 * len(STRIDES)


@dataclass(frozen=True, eq=False)
class Document:
    """The open scene. pool: layers, also those that were removed, by number; styles: name at least one, in their order.

    mesh_files: meshes of the scene; read: the data of meshes, by `source_key`; lines: meshes of vectors, always shown.
    slice_planes: as of a scene. is_loading: whether nothing is read yet. Raises InputError for more than MOST_LAYERS
    visible layers.
    """

    scene: SceneFile
    pool: Mapping[int, LayerSplats]
    styles: tuple[LayerStyle, ...]
    mesh_files: tuple[MeshFile, ...] = ()
    read: Mapping[MeshFile, Mesh] = field(default_factory=dict)
    lines: tuple[Mesh, ...] = ()
    slice_planes: tuple[str, ...] = ()
    is_loading: bool = False
    scenes: dict[object, Scene] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        count = sum(style.is_shown for style in self.styles)
        if count > MOST_LAYERS:
            raise expected("layers", f"at most {MOST_LAYERS} that are visible", count, "hide some: visible = false")

    @classmethod
    def placeholder(cls, scene: SceneFile) -> Document:
        """Placeholder document while a file loads."""
        volume = Volume(np.zeros((2, 2, 2), np.uint8), name=Path(scene.volume).name)
        plain = replace(
            scene, view=ViewOptions(), settings=Settings(background=None), transfer={}, layers=(), meshes=()
        )
        plain = replace(plain, slice_planes=(), crop="", clip=None)
        transfer = Transfer([(0, 0.0), (1, 0.5)])
        layer = LayerSplats(volume.name, plain, Layer(volume, transfer), (volume,) * len(STRIDES))
        for stride in STRIDES:
            layer.shell(stride)
        return cls(plain, {0: layer}, (LayerStyle(transfer),), is_loading=True)

    @classmethod
    def open(cls, scene: SceneFile, quiet: bool = False) -> Document:
        """Reads all volumes, or stand-ins, and meshes, and extracts the coarsest splats. Raises InputError as their
        readers. quiet: whether notes on the files are not printed.
        """
        if scene.slices:
            fix = "splatgl render draws it; --slice-plane shows it in space"
            raise expected("slice", "none in the window, which draws in space", scene.slices[0], fix)
        opened = OpenScene.read(scene, quiet, is_live=True)
        scene, volume = opened.file, opened.volume
        # refuses a bad one
        Movie.of(scene.animation, volume)
        sources = opened.read_layers()
        if scene.surfaces is not None:
            made = iter(with_surfaces([layer for source in sources for layer in source.layers], scene))
            sources = [source._replace(layers=[next(made) for _ in source.layers]) for source in sources]
        pairs = [pair for source in sources for pair in styled_layers(source, scene.settings)]
        layers = dict(enumerate(layer for layer, _ in pairs))
        styles = tuple(replace(style, number=number) for number, (_, style) in enumerate(pairs))
        files = tuple(surfaces_of(scene))
        lines, planes = tuple(scene.vectors.meshes(volume)), scene.slice_planes
        parse_slices([Slice(text).place for text in planes], volume)
        document = cls(scene, layers, styles, files, read_meshes(files), lines, planes).for_settings(scene.settings)
        # only now, as in stills: what a file or a mask lacks is said before what a blend does not draw
        document.extract(STRIDES[-1])
        return document

    @property
    def is_empty(self) -> bool:
        """Whether no file was named: the window waits for one."""
        return self.is_loading and not self.scene.volume

    # --- layers -----------------------------------------------------------------------------------------------------

    @cached_property
    def layers(self) -> tuple[LayerSplats, ...]:
        """The layers that styles name, in their order."""
        return tuple(self.pool[style.number] for style in self.styles)

    @property
    def volume(self) -> Volume:
        """The full-resolution volume of the first layer."""
        return self.layers[0].volume

    @property
    def world(self) -> World:
        """Frame and unit of all layers: of the file of the first one, or of the first visible one that states it."""
        return World.shared((self.layers[0].world, *(layer.world for layer in self.drawn_layers)))

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the layers."""
        return tuple(style.title or layer.name for layer, style in zip(self.layers, self.styles, strict=True))

    @property
    def file_numbers(self) -> set[int]:
        """The numbers of the layers that the scene file has."""
        return {number for number in self.pool if number >= 0}

    def with_layers(self, layers: Sequence[LayerSplats]) -> tuple[Document, list[int]]:
        """The document with more layers, which are drawn once styles name their numbers; and these numbers."""
        start = min(0, *self.pool)
        added = {start - 1 - place: layer for place, layer in enumerate(layers)}
        return replace(self, pool={**self.pool, **added}), list(added)

    def with_additions(self, shown: Document) -> Document:
        """The document, which is read anew, with the layers and meshes that were added to the visible one."""
        added = {number: layer for number, layer in shown.pool.items() if number < 0}
        return replace(self, pool={**added, **self.pool}).with_meshes({**shown.read, **self.read})

    @property
    def is_layered(self) -> bool:
        """Whether the picture is composited from layers and meshes, without an error bound."""
        return self.has_layers or self.styles[0].surfaces is not None

    @property
    def has_layers(self) -> bool:
        """Whether there is more than a single visible layer: others, meshes or slices."""
        has_meshes = bool(self.mesh_files or self.lines or self.slice_planes)
        return len(self.layers) > 1 or has_meshes or not self.styles[0].is_shown

    @property
    def drawn_layers(self) -> tuple[LayerSplats, ...]:
        """The visible layers; the first layer where only meshes are visible."""
        return tuple(self.pool[style.number] for style in self.styles if style.is_shown) or self.layers[:1]

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
        number = next(style.number for style in self.styles if self.pool[style.number].has_finer)
        old, shown = self.pool[number], self.pool[number].stand_in
        assert shown and shown.finer
        layer = old.with_stand_in(shown.finer()).within(old.volume.world, old.scissors)
        layer.shell(STRIDES[-1])
        return replace(self, pool={**self.pool, number: layer})

    def is_described_as(self, other: Document) -> bool:
        """Whether the scene files of both say the same, but for the background, which may follow the values."""
        plain = [each.scene.settings.replace(background=AUTO) for each in (self, other)]
        pairs = zip((self, other), plain, strict=True)
        first, second = (replace(each.scene, scissors=(), look=None, settings=settings) for each, settings in pairs)
        cuts, others = ([cut.table for cut in each.scene.scissors] for each in (self, other))
        return first == second and cuts == others

    @property
    def bytes(self) -> int:
        """Memory of the samples of all layers."""
        volumes = (volume for layer in self.pool.values() for volume in layer.volumes)
        arrays = {id(volume.samples): volume.samples for volume in volumes}.values()
        return sum(array.nbytes for array in arrays if type(array) is np.ndarray)

    def coarse(self) -> Document:
        """The document with the coarsest splats alone, which is kept while another one is shown."""
        return replace(self, pool={number: layer.coarse() for number, layer in self.pool.items()})

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
    def exceeds_budget(self) -> bool:
        """Whether a layer has too many splats at full resolution."""
        return any(layer.exceeds_budget for layer in self.drawn_layers)

    @property
    def is_complete(self) -> bool:
        """Whether all splats that can be drawn are extracted."""
        return set(self.extracted) >= set(STRIDES[self.exceeds_budget :])

    def extract(
        self,
        stride: int,
        progress: Callable[[LayerSplats], Progress] | None = None,
        extracted: Callable[[LayerSplats], None] | None = None,
    ) -> None:
        """Extracts the splats of all visible layers at a stride. progress: of a layer, called before its extraction;
        extracted: called after it.
        """
        for layer in self.drawn_layers:
            layer.shell(stride, progress and progress(layer))
            if extracted:
                extracted(layer)

    def with_styles(
        self, styles: Sequence[LayerStyle], mesh_files: Sequence[MeshFile], settings: Settings, moving: bool = False
    ) -> Document:
        """The document in these styles, with splats of the kind that the settings take; this one if nothing changes.

        moving: whether the picture is motion-blurred.
        """
        # a scene that changed on disk may have other layers
        styles = tuple(style for style in styles if style.number in self.pool) or self.styles
        shown = replace(self, styles=styles, mesh_files=tuple(mesh_files))
        if shown.is_layered:
            # blurred pictures of layers are means of sharp ones
            settings, moving = settings.replace(motion="off"), False
        pool = dict(self.pool)
        for style in styles:
            layer = pool[style.number].within(shown.world, style.scissors)
            pool[style.number] = layer.for_style(style, settings, moving)
        same = (pool, styles, shown.mesh_files) == (self.pool, self.styles, self.mesh_files)
        return self if same else replace(shown, pool=pool)

    def with_settings(self, scene: SceneFile) -> Document:
        """The document with the settings of a scene, which differs in them alone, and with its planes."""
        settings = on_background(scene.cut(self.volume), self.volume, self.styles[0].base).settings
        return replace(self, scene=replace(self.scene, settings=settings)).for_settings(settings)

    def for_settings(self, settings: Settings, moving: bool = False) -> Document:
        """The document with splats of the kind that the settings take. moving: as above."""
        return self.with_styles(self.styles, self.mesh_files, settings, moving)

    def with_current_splats(self) -> Document:
        """The document without splats that extraction would not give."""
        stale = {number: layer for number, layer in self.pool.items() if not layer.is_current}
        return replace(self, pool={**self.pool, **{number: layer.without_splats() for number, layer in stale.items()}})

    # --- the picture ------------------------------------------------------------------------------------------------

    @cached_property
    def meshes(self) -> tuple[Mesh, ...]:
        """The visible meshes and slices in space, unclipped, in the frame of the layers."""
        visible = [file for file in self.mesh_files if file.visible and source_key(file) in self.read]
        styled = [styled_mesh(file, self.read[source_key(file)]) for file in visible]
        slices = slice_meshes(layer_looks(self.pool, self.styles), self.slice_planes)
        return tuple(Scene(self._shown_at(1), meshes=[*styled, *self.lines, *slices]).meshes)

    def with_planes(self, slice_planes: Sequence[str]) -> Document:
        """The document with these slices in space; this one if it has them."""
        planes = tuple(slice_planes)
        return self if planes == self.slice_planes else replace(self, slice_planes=planes)

    def subject_at(
        self, stride: int, settings: Settings, eye: np.ndarray | None = None
    ) -> tuple[Splats | Scene, Settings]:
        """The input of a renderer at a stride: the splats of a single volume, else layers and meshes, which the planes
        of the settings clip. eye: from which splats inside a volume may be left out.
        """
        if not self.is_layered:
            layer = self.layers[0]
            return layer.at(stride) if eye is None else layer.seen_from(eye, stride, settings), settings
        return self.scene_at(stride, settings.clip), settings.replace(clip=())

    def scene_at(self, stride: int, clip: Sequence[Plane]) -> Scene:
        """Scene for the renderer at a stride, clipped by planes; `splatgl render` draws the same at stride 1."""
        surfaces = [layer.meshes for layer in self.drawn_layers]
        key = stride, tuple(clip), tuple(meshes is None for meshes in surfaces)
        if key not in self.scenes:
            while len(self.scenes) >= MOST_SCENES:
                del self.scenes[next(iter(self.scenes))]
            made = [mesh for meshes in surfaces for mesh in meshes or ()]
            self.scenes[key] = Scene(self._shown_at(stride), clip, [*self.meshes, *made])
        return self.scenes[key]

    def _shown_at(self, stride: int) -> list[Layer]:
        layers = [layer.layer_at(stride) for layer in self.drawn_layers]
        if any(style.is_shown for style in self.styles):
            return layers
        clear = partial(self.layers[0].none_at, stride)
        return [replace(layers[0], only_slices=True, opacity=1.0, held=clear)]

    @property
    def subject(self) -> Bounded:
        """The object that a default view is fitted to: visible layers and meshes, unclipped."""
        return self.scene_at(1, ()) if self.is_layered else self.layers[0].subject(self.scene.view.fit)

    def home(self, size: tuple[int, int]) -> Pose:
        """The scene's initial view, with its pivot in the middle of the scene."""
        camera = replace(self.scene.view, size=size, width=None).camera(self.volume, self.subject)
        seen = float(np.degrees(2 * np.arctan(camera.extent / 2))) if camera.perspective else FOV
        fov = self.scene.view.fov or self.volume.hints.fov or seen
        return Pose(camera, self.middle, float(fov), self.reach)

    @property
    def middle(self) -> np.ndarray:
        """Centre [3] of the bounding box of what default views are fitted to, world coordinates."""
        corners = self.scene.view.framed(self.volume, self.subject).corners
        return np.asarray((corners.min(axis=0) + corners.max(axis=0)) / 2)

    @cached_property
    def reach(self) -> float:
        """Radius of a ball around all layers and meshes, world units."""
        corners = [layer.volume.corners for layer in self.layers]
        points = np.concatenate([*corners, *(mesh.vertices for mesh in self.meshes)])
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        return float(np.linalg.norm(points - middle, axis=1).max())


def named_layers(layers: Sequence[LayerSplats], styles: Sequence[LayerStyle]) -> list[tuple[Volume, Transfer]]:
    """Volumes of the visible layers, by the names that a saved scene gives them, and their transfer functions."""
    return [
        (replace(layer.volume, name=style.title or layer.scene.title or layer.volume.name), style.transfer)
        for layer, style in zip(layers, styles, strict=False)
        if style.is_shown
    ]


def styled_layers(source: LayerSource, settings: Settings) -> list[tuple[LayerSplats, LayerStyle]]:
    """The layers of a source, and their styles. settings: of the scene."""
    pairs, (file, volume, layers) = [], source
    for number, layer in enumerate(layers):
        scene, samples = replace(file, settings=settings, layers=(), meshes=()), layer.volume
        if len(volume.channels) > 1:
            # read alone, a channel has the file's name
            channel = _channel(file.load.get("channel"), number)
            scene = replace(scene, load={**file.load, "channel": channel}, title=samples.name)
        name = file.title * (len(volume.channels) < 2) or samples.name or file.volume
        assert layer.transfer is not None
        style = LayerStyle(layer.transfer, layer.threshold, 1.0, layer.opacity, file.visible, surfaces=layer.surfaces)
        style = style_with_segments(style, samples, file.transfer)
        # the first has what is known of the file: its view and time points
        if number == 0 < len(volume.channels) - 1:
            samples = replace(volume, channels=(), labels=samples.labels)
        # a style says whether it is visible
        for part in replace(layer, volume=samples, transfer=style.stated, visible=True).parts():
            shown = LayerSplats.of_layer(name, scene, part)
            pairs.append((shown, replace(style, scissors=shown.scissors)))
    return pairs


def _channel(option: object, number: int) -> int | str:
    """Value of the option `channel` that chooses one of the channels that it chose."""
    if option in (None, "all"):
        return number
    token = str(option).split(",")[number].strip()
    return int(token) if token.isdecimal() else token

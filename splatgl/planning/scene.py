"""`Scene`: layers and meshes of one picture, and what arguments of public functions become.

Extinctions and emissions of overlapping layers add up at every depth of a ray.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.coercion import is_scene, public
from splatgl.data.affine import METRES, World
from splatgl.data.color import CHANNEL_COLORS, color_of_dye
from splatgl.data.mask import parse_mask
from splatgl.data.mesh import OF_VOLUME, Mesh, cap_meshes
from splatgl.data.volume import Volume
from splatgl.errors import InputError, error_prefix, expected
from splatgl.geometry.camera import Camera, FittedPoints
from splatgl.geometry.clipping import ClipUnits, Plane, change_planes, parse_planes
from splatgl.geometry.grid import Grid
from splatgl.geometry.slices import Slice, SliceLayer, SlicePainter, parse_slices
from splatgl.options import LIMITED, reject_unknown
from splatgl.planning.bricks import Bricks
from splatgl.planning.culling import OpaqueBounds, clip_behind_eye
from splatgl.planning.plan import Plan, ResolvedLayer, plan_layer, unused_settings
from splatgl.planning.resolve import (
    blur_form,
    check_blur_supported,
    extract_for_settings,
    samples_per_pixel,
)
from splatgl.planning.technique import TileSupport
from splatgl.readers import load_source
from splatgl.splat.extract import extract
from splatgl.splat.motion import Motion, count_moments
from splatgl.splat.segment_surfaces import check_strength, smooth_surfaces
from splatgl.splat.settings import Settings
from splatgl.splat.splats import Splats
from splatgl.transfer.presets import (
    SOLID,
    SURFACE,
    default_transfer,
    is_preset,
    preset,
    projection_transfer,
    slice_colors,
)
from splatgl.transfer.transfer import Transfer
from splatgl.transfer.transfer_nodes import SUFFIXES, load_transfer

# optical depth of the brightest values of a channel along the volume's shortest side, so that matter behind shows
# through; and the least opacity of a voxel
THROUGH, LEAST = 6.0, 0.01


def channel_colors(channels: Sequence[Volume]) -> list[str]:
    """Colours "#rrggbb" of channels: of the file, else of the dye of that name, else others in turn."""
    known = [channel.hints.color or color_of_dye(channel.name) for channel in channels]
    palette = list(CHANNEL_COLORS.values())
    free = [color for color in palette if color not in known]
    turns = (palette[n % len(palette)] for n in range(len(known)))
    colors = list[str]()
    for color, turn in zip(known, turns, strict=True):
        given = color or (turn if turn in free or not free else free[0])
        free = [other for other in free if other != given]
        colors.append(given)
    return colors


def channel_opacity(volume: Volume, settings: Settings) -> float:
    """Opacity of the brightest values of a channel: SOLID where a pixel shows one value of its ray."""
    through = float(np.clip(-np.expm1(-THROUGH / volume.shortest), LEAST, SURFACE))
    return SOLID if settings.shows_value else through


def channel_transfers(
    volume: Volume,
    colors: Mapping[str, str],
    windows: Mapping[str, tuple[float, float]],
    bases: Sequence[Transfer] | None = None,
    settings: Settings | None = None,
    looks: Mapping[str, str] | None = None,
) -> list[Transfer]:
    """Transfer functions of a volume's channels: unshaded ramps over a window in a colour.

    colors, windows: by name or number of the channel, instead of those of the file. bases: transfer function of each
    channel, whose ramps channels without a window have; None: the preset microscopy. settings: where a pixel shows one
    value of its ray, ramps reach SOLID, else matter behind shows through. looks: presets, which keep their shading, or
    colour maps, by channels. Raises InputError for an unknown channel.
    """
    names, looks = [channel.name for channel in volume.channels], looks or {}
    for name in (*colors, *windows, *looks):
        if name not in names and name not in map(str, range(len(names))):
            raise expected("channel", f"one of {', '.join(names)}", repr(name))
    full = channel_opacity(volume, settings or Settings())
    transfers, usual = [], channel_colors(volume.channels)
    for number, channel in enumerate(volume.channels):
        keys = (channel.name, str(number))
        color = next((colors[key] for key in keys if key in colors), None)
        window = next((windows[key] for key in keys if key in windows), None)
        look = next((looks[key] for key in keys if key in looks), "")
        own = preset(look, channel) if is_preset(look) else bases[number] if bases is not None else None
        if window is None and own is None:
            window = channel.hints.window
        ramp = own or preset("microscopy", channel)
        if own is None and window is None and settings is not None and settings.join == "max":
            ramp = projection_transfer(ramp, channel)
        elif own is None:
            ramp = replace(ramp, points=tuple((value, opacity * full / SURFACE) for value, opacity in ramp.points))
        if window is not None:
            ramp = Transfer(((window[0], 0.0), (window[1], full)), unit=ramp.unit)
        if channel.hints.inverted and own is None:
            ramp = ramp.inverted()
        colormap = color or (look if look and not is_preset(look) else usual[number])
        transfers.append(replace(ramp, colormap=colormap, window=None, shading=ramp.shading and is_preset(look)))
    return transfers


# most layers of a picture: the shader keeps a state for each
MOST_LAYERS = 8


@public
@dataclass(frozen=True, eq=False)
class Layer:
    """A volume and its appearance. transfer: None: the default one. opacity: factor from 0 to 1 of the transfer
    function's opacities. threshold: as of `extract`. clip: conditions on the volume's box, or planes; None: the planes
    of the scene. surfaces: smoothing of a segmentation's surfaces, as of `surfaces`; None: boxes of voxels. uncut: part
    that planes leave whole: labels of the volume, a number or several, or "3,7"; or what `Volume.masked` accepts.
    only_slices: whether slices and caps alone show it. held: returns its splats, if they are extracted elsewhere.
    """

    volume: Volume | Any
    transfer: Transfer | Any | None = None
    opacity: float = 1.0
    visible: bool = True
    threshold: float = 0.0
    clip: str | Sequence[Any] | None = None
    surfaces: float | None = None
    uncut: Any = None
    only_slices: bool = False
    held: Callable[[], Splats] | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.opacity <= 1:
            raise expected("opacity", "a factor from 0 to 1", self.opacity)
        object.__setattr__(self, "transfer", self.transfer or default_transfer(self.volume))
        if self.surfaces is not None:
            object.__setattr__(self, "surfaces", check_strength(self.surfaces))

    def placed(self, frame: str | None = None, unit: str = "") -> Layer:
        """The layer with its volume, clipping planes, and lengths of its transfer function, in another frame and unit
        of length, as of `Volume.placed`.
        """
        change = self.volume.world.change(frame, unit)
        if change is None:
            return self
        assert self.transfer is not None
        clip = self.clip
        if clip is not None:
            clip = change_planes(parse_planes(clip, ClipUnits.of([self.volume])), change)
        transfer = self.transfer.rescaled(change.length)
        return replace(self, volume=self.volume.placed(frame, unit), transfer=transfer, clip=clip, held=None)

    def parts(self) -> list[Layer]:
        """The part that planes leave whole, and the rest; the layer alone if they cut all of it."""
        if self.uncut is None:
            return [self]
        with error_prefix("uncut"):
            return self._cut_parts()

    def _cut_parts(self) -> list[Layer]:
        whole, labels, outside = replace(self.volume, masks=()), list[int](), False
        mask = self.uncut
        if isinstance(mask, str):
            file, numbers, outside = parse_mask(mask)
            labels, mask = (list(numbers), whole) if not file else ([], mask)
        elif isinstance(mask, int | np.integer) or (isinstance(mask, list | tuple) and mask):
            labels, mask = [int(number) for number in np.atleast_1d(mask)], whole
        outside = outside and mask is whole
        kept, rest = (self.volume.masked(mask, labels, beyond) for beyond in (outside, not outside))
        whole = replace(self, uncut=None, held=None)
        return [replace(whole, volume=kept, clip=()), replace(whole, volume=rest)]

    @property
    def seen(self) -> Transfer:
        """The transfer function with the layer's opacity; clear if surfaces or slices alone are drawn."""
        return self.faded.weakened(0.0) if self.surfaces is not None or self.only_slices else self.faded

    @property
    def faded(self) -> Transfer:
        """The transfer function with the layer's opacity."""
        assert self.transfer is not None
        return self.transfer.weakened(self.opacity)


@public
@dataclass(frozen=True, eq=False)
class Scene:
    """Layers and meshes of one picture, in any order. layers: or volumes, with default transfer functions. clip:
    conditions such as "x>0.3" on the box around the visible layers, or planes as of Settings; they clip meshes that are
    `clipped`. Layers and meshes are transformed to the frame, LPS or RAS, and the unit of length of the first layer
    that states one. Surfaces of segmentations are added to the meshes; notes: their distance from the voxels, and
    layers that lie elsewhere and state no unit. slices: planes that show the values of the layers, added to the meshes,
    too. Raises InputError for no visible layer or too many, for planes that leave nothing, for slices beside the first
    layer, and as `surfaces`.
    """

    layers: Sequence[Layer | Volume | Any]
    clip: str | Sequence[Any] = ()
    meshes: Sequence[Mesh] = ()
    slices: Sequence[Slice | str] = ()
    made: dict[Settings, tuple[Splats, ...]] = field(default_factory=dict, repr=False)
    # of each visible layer
    planes: tuple[tuple[Plane, ...], ...] = field(default=(), init=False, repr=False)
    # meshes before they are clipped, and planes that clip those that are `clipped`; and slices
    whole: tuple[tuple[Mesh, tuple[Plane, ...]], ...] = field(default=(), init=False, repr=False)
    sliced: tuple[Mesh, ...] = field(default=(), init=False, repr=False)
    notes: tuple[str, ...] = field(default=(), init=False, repr=False)

    def __post_init__(self) -> None:
        layers = tuple(Layer(layer) if isinstance(layer, Volume) else layer for layer in self.layers)
        object.__setattr__(self, "layers", layers)
        world = self.world
        object.__setattr__(self, "layers", tuple(part for layer in layers for part in layer.placed(*world).parts()))
        if not 1 <= len(self.shown) <= MOST_LAYERS:
            raise expected("layers", f"1 to {MOST_LAYERS} that are visible", len(self.shown))
        planes = parse_planes(self.clip, ClipUnits.of(layer.volume for layer in self.shown)) if len(self.clip) else ()
        own = [parse_planes(x.clip, ClipUnits.of([x.volume])) if x.clip is not None else planes for x in self.shown]
        object.__setattr__(self, "planes", tuple(own))
        meshes = [mesh.placed(*world) for mesh in self.meshes]
        surfaces, notes = self._segment_surfaces()
        object.__setattr__(self, "whole", (*((mesh, planes) for mesh in meshes), *surfaces))
        object.__setattr__(self, "sliced", tuple(self._slice_meshes()))
        object.__setattr__(self, "meshes", self._clipped_meshes(()))
        object.__setattr__(self, "notes", (*notes, *self._unit_notes()))

    @classmethod
    def of(cls, x: Any) -> Scene:
        """The visible volumes and meshes of a PyVista plotter, or of a window or renderer of VTK.

        Volumes on regular grids keep transfer functions, clipping planes and shading; meshes keep colours, lines become
        tubes and points balls. Camera.of and Settings.of read the view, and blend, light and background. Raises
        InputError if there is no volume, and for unsupported properties.
        """
        from splatgl.integrations.vtk.scene import scene_of

        return scene_of(x)

    def to_pyvista(self, camera: Camera | None = None, settings: Settings | None = None, **options: Any) -> Any:
        """A pyvista.Plotter of the same layers and meshes, view, blend, planes, light and background.

        camera: None: from the front, right and above. options: of the plotter, such as off_screen. Raises InputError
        for blends that VTK does not have, and without PyVista.
        """
        from splatgl.integrations.vtk.scene import plotter_of

        return plotter_of(self, camera, settings, options)

    @property
    def frame(self) -> str | None:
        """The frame of all layers and meshes: LPS, RAS or None."""
        return self.world.frame

    @property
    def world(self) -> World:
        """Frame and unit of all layers and meshes: of the first layer, also where it is hidden, or of the first visible
        layer or mesh that states one.
        """
        volumes = (layer.volume for layer in (*self.layers[:1], *self.shown) if isinstance(layer, Layer))
        return World.shared((*(volume.world for volume in volumes), *(mesh.world for mesh in self.meshes)))

    def _unit_notes(self) -> list[str]:
        """Notes on visible layers without a unit of length that meet no layer whose unit is known."""
        boxes = [(layer.volume, ClipUnits.of([layer.volume])) for layer in self.shown]
        known = [box for volume, box in boxes if volume.unit in METRES]
        lost = [
            volume.name or "a layer"
            for volume, box in boxes
            if known and volume.unit not in METRES and not any(box.meets(other) for other in known)
        ]
        unit = self.world.unit
        return [f"{name} states no unit of length, is taken as in {unit}, and meets no other layer" for name in lost]

    def _segment_surfaces(self) -> tuple[list[tuple[Mesh, tuple[Plane, ...]]], list[str]]:
        surfaces, notes = list[tuple[Mesh, tuple[Plane, ...]]](), list[str]()
        for layer, planes in zip(self.shown, self.planes, strict=True):
            if layer.surfaces is not None:
                segments, off = smooth_surfaces(layer.volume, layer.faded, layer.surfaces, closed=False)
                surfaces += [(replace(mesh, clipped=True), planes) for mesh in segments]
                count = f"{len(segments)} segment{'s' * (len(segments) != 1)}"
                scene_notes = f"{count} drawn as smoothed surfaces ({layer.surfaces:g})"
                notes.append(
                    f"{layer.volume.name or 'labels'}: {scene_notes}, up to {off:.2g} voxels off the faces of voxels"
                )
        return surfaces, notes

    def painter(self, what: str) -> SlicePainter:
        """The colours of a slice or caps, as `what` says. Raises InputError for clouds of points."""
        self.require_voxels(what)
        looks = [(x, x.transfer) for x in self.shown if x.transfer is not None]
        return SlicePainter([SliceLayer(x.volume, slice_colors(x.volume, look), x.opacity) for x, look in looks])

    def _slice_meshes(self) -> list[Mesh]:
        if not self.slices:
            return []
        meshes, painter = list[Mesh](), self.painter("slice")
        for item in self.slices:
            one = item if isinstance(item, Slice) else Slice(item)
            meshes += [painter.mesh(plane, one.opacity) for plane in parse_slices(one.place, self.shown[0].volume)]
        return meshes

    def surfaces(self, settings: Settings) -> tuple[Mesh, ...]:
        """The meshes; those that are `clipped` are clipped by the planes of the settings, too."""
        return self._clipped_meshes(settings.clip) if settings.clip else tuple(self.meshes)

    def _clipped_meshes(self, clip: tuple[Plane, ...]) -> tuple[Mesh, ...]:
        """The meshes, their caps, and slices. clip: further planes."""
        meshes = list[Mesh]()
        for mesh, planes in self.whole:
            both = (*planes, *clip) if mesh.clipped else ()
            meshes.append(mesh.cut(both) if both else mesh)
            for plane, cap in cap_meshes(mesh, both) if mesh.caps else ():
                meshes += self.painter("caps").cap(cap, plane) if mesh.caps == OF_VOLUME else [cap]
        return (*meshes, *self.sliced)

    @property
    def shown(self) -> tuple[Layer, ...]:
        """The visible layers."""
        return tuple(layer for layer in self.layers if isinstance(layer, Layer) and layer.visible and layer.opacity > 0)

    def require_voxels(self, what: str) -> None:
        """Raises InputError for visible clouds of points, whose volumes have no voxels. what: that needs voxels."""
        for layer in self.shown:
            if layer.volume.points is not None:
                raise expected(what, "a volume of voxels", f"{len(layer.volume.points):,} points")

    def splats(self, settings: Settings) -> tuple[Splats, ...]:
        """The splats of each visible layer for pictures with these settings; extracted once."""
        # extraction depends on these settings
        key = Settings(
            blend=settings.blend,
            kernel=settings.kernel,
            classification=settings.classification,
            compositing=settings.compositing,
        )
        if key not in self.made:
            self.made[key] = tuple(
                layer.held() if layer.held else extract_for_settings(layer.volume, layer.seen, key, layer.threshold)
                for layer in self.shown
            )
        return self.made[key]

    def drawn(self, settings: Settings) -> list[tuple[Splats, Settings]]:
        """Splats, and settings with clipping planes, of visible layers that are not empty; at least of the first."""
        clipped = [replace(settings, clip=(*settings.clip, *planes)) if planes else settings for planes in self.planes]
        layers = list(zip(self.splats(settings), clipped, strict=True))
        return [layer for layer in layers if len(layer[0])] or layers[:1]

    @property
    def corners(self) -> np.ndarray:
        """Corners [N, 3], world units, of the boxes of opaque samples, and vertices of meshes."""
        return np.concatenate([*(box.corners for box in self._subjects), *self._mesh_places])

    @property
    def outline(self) -> np.ndarray:
        """Points [N, 3], world units, whose hull contains the opaque samples and the meshes."""
        return np.concatenate([*(box.outline for box in self._subjects), *self._mesh_places])

    @property
    def is_lit(self) -> bool:
        """Whether the first layer is shaded by default."""
        first = self.layers[0]
        return isinstance(first, Layer) and first.faded.shading

    @property
    def _mesh_places(self) -> list[np.ndarray]:
        """Vertices of meshes before they are clipped, as planes do not move a view, and of slices."""
        return [mesh.vertices for mesh in (*(mesh for mesh, _ in self.whole), *self.sliced)]

    @property
    def full_extent(self) -> FittedPoints:
        """The boxes of the volumes of visible layers, and the meshes, which default views are fitted to."""
        boxes = (box.volume.corners for box in self._subjects)
        return FittedPoints(np.concatenate([*boxes, *self._mesh_places]), self.frame)

    @property
    def robust(self) -> FittedPoints:
        """The visible part, without samples that are alone."""
        boxes = (box.robust.outline for box in self._subjects)
        return FittedPoints(np.concatenate([*boxes, *self._mesh_places]), self.frame)

    @cached_property
    def _subjects(self) -> list[OpaqueBounds]:
        # voxels also where surfaces are drawn: both have the same view
        # the box of meshes alone has no matter: where there is another volume, the meshes themselves count
        solid = [x for x in self.shown if any(opacity for _, opacity in x.volume.hints.points or ((0.0, 1.0),))]
        return [OpaqueBounds(x.volume, x.seen if x.only_slices else x.faded) for x in solid or self.shown]


@dataclass(frozen=True, eq=False)
class ResolvedScene:
    """Layers and meshes of a picture, with resolved settings. layers: none of a volume in bricks. settings: as they
    were given.
    """

    layers: tuple[ResolvedLayer, ...]
    camera: Camera
    settings: Settings
    meshes: tuple[Mesh, ...] = ()
    bricks: Bricks | None = None

    @property
    def is_single(self) -> bool:
        """Whether the picture shows a single layer and no mesh: only then an error bound is known."""
        return len(self.layers) < 2 and not self.meshes

    @property
    def is_joined(self) -> bool:
        """Whether layers are drawn apart, and their pictures joined."""
        return not self.is_single and not self.settings.hides


@dataclass(frozen=True, eq=False)
class ScenePlan:
    """Plans of the layers of a picture. resolved: without the choices for OpenGL, for the float64 reference.
    scene_notes: on the meshes. is_moving: whether its motion is known. seconds: that planning, and extraction, took.
    """

    layers: tuple[Plan, ...]
    resolved: ResolvedScene
    scene_notes: tuple[str, ...] = ()
    is_moving: bool = False
    seconds: float = 0.0

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the meshes, on what limits change, and on settings without effect."""
        limited = dict.fromkeys(note for plan in self.layers for note in plan.notes if note.endswith(LIMITED))
        unused = unused_settings(self.layers, self.resolved.settings, bool(self.resolved.meshes), self.is_moving)
        return (*self.scene_notes, *limited, *unused)

    @property
    def notes_in_motion(self) -> tuple[str, ...]:
        """`notes`, but for those on settings of motion blur, which have an effect once something moves."""
        return replace(self, is_moving=True).notes

    @property
    def first(self) -> Plan:
        """The plan of the first layer; all layers have the same size, samples and blend."""
        return self.layers[0]

    def explain(self) -> str:
        """Text that describes each plan, under the name of its layer if there are several."""
        if self.resolved.is_single:
            return self.first.explain()
        return "\n".join(f"{plan.splats.name}:\n{plan.explain()}" for plan in self.layers)


def plan_scene(
    subject: Splats | Scene,
    camera: Camera,
    settings: Settings,
    motion: Motion | None = None,
    tiles: TileSupport = False,
) -> ScenePlan:
    """Plans a picture of splats, or of the visible layers of a scene. motion, tiles: as of `plan`.

    Raises InputError as `resolve_scene`.
    """
    started = time.perf_counter()
    scene = resolve_scene(subject, camera, settings, motion)
    plans = tuple(plan_layer(layer, tiles) for layer in scene.layers)
    scene_notes = () if scene.is_single else subject.notes
    return ScenePlan(plans, scene, scene_notes, motion is not None, time.perf_counter() - started)


def resolve_scene(
    subject: Splats | Scene, camera: Camera, settings: Settings, motion: Motion | None = None
) -> ResolvedScene:
    """Resolves the settings of splats, or of the visible layers of a scene. motion: as of `plan`.

    Raises InputError for settings that several layers or meshes do not support: compositing splat by splat, streaks and
    flows; and with meshes, blends other than composite.
    """
    layers, meshes = subject.drawn(settings), subject.surfaces(settings)
    if len(layers) == 1 and not meshes:
        ((splats, look),) = layers
        return ResolvedScene((ResolvedLayer.of(splats, camera, look, motion),), camera, settings)
    changes: dict[str, Any] = {}
    if motion is not None and not motion.still:
        check_blur_supported("of layers", settings, motion.flow is not None)
        changes = {"motion": "off", "moments": count_layer_moments(layers, camera, settings, motion)}
    if meshes:
        settings.require_composite("meshes")
    if not settings.hides:
        changes["background"] = None
    layers = common_samples(layers, camera, settings)
    shown = [ResolvedLayer.of(splats, camera, replace(look, **changes), motion) for splats, look in layers]
    return ResolvedScene(_composited(shown) if settings.hides else tuple(shown), camera, settings, meshes)


def _composited(layers: Sequence[ResolvedLayer]) -> tuple[ResolvedLayer, ...]:
    """Layers that composite together, each in the shadow of all. Raises InputError for layers that are drawn splat by
    splat.
    """
    for layer in layers:
        resolved, name = layer.resolved, layer.splats.name or "without a name"
        if resolved.sheets is None and not resolved.boxes:
            why = next(
                (note for note in resolved.notes if note.startswith("sheets")), "compositing splats was asked for"
            )
            raise InputError(f"layer {name}: layers composite in sheets, not splat by splat; {why}")
        if resolved.display:
            raise expected("target rgba8", "a single layer, without meshes", "more of them")
    casters = tuple((layer.front, layer.settings.clip) for layer in layers)
    allowed, together = min(layer.resolved.allowed for layer in layers), []
    for layer in layers:
        cues = layer.resolved.cues
        shared = None if cues is None else replace(cues, casters=casters)
        together.append(replace(layer, resolved=replace(layer.resolved, allowed=allowed, cues=shared)))
    return tuple(together)


def count_layer_moments(
    layers: Sequence[tuple[Splats, Settings]], camera: Camera, settings: Settings, motion: Motion
) -> int:
    """Number of pictures whose mean a moving picture of layers is: that of the fastest one; 1: a sharp picture."""
    if settings.moments is not None:
        return settings.moments
    if settings.motion == "off" or settings.shutter == 0:
        return 1
    return max(count_moments(splats, camera, motion, settings.shutter) for splats, _ in layers)


def moments_per_frame(subject: Splats | Scene, camera: Camera, settings: Settings, motion: Motion) -> int:
    """Number of pictures whose mean a moving picture is; 0: a sharp picture of splats, or streaks."""
    if isinstance(subject, Scene):
        return count_layer_moments(subject.drawn(settings), camera, settings, motion)
    is_mean = settings.shutter > 0 and blur_form(subject, settings) == "moments"
    return count_moments(subject, camera, motion, settings.shutter) if is_mean else 0


def common_samples(
    layers: Sequence[tuple[Splats, Settings]], camera: Camera, settings: Settings
) -> list[tuple[Splats, Settings]]:
    """Layers that composite together, with the same samples a pixel: the most that a layer needs."""
    if settings.antialias != "auto" or len(layers) < 2 or not settings.hides:
        return list(layers)
    fronts = [(clip_behind_eye(splats, camera), look) for splats, look in layers]
    samples = {samples_per_pixel(front, camera, look) for front, look in fronts}
    if len(samples) == 1:
        return list(layers)
    return [(splats, replace(look, antialias="supersample", samples=max(samples))) for splats, look in layers]


def join_pictures(pictures: Sequence[np.ndarray], settings: Settings) -> np.ndarray:
    """Joins pictures [H, W, 4] of layers, without backgrounds, in blends without an order: sums add up; in other blends
    light adds up and transmittances multiply.
    """
    added = np.sum(pictures, axis=0)
    if settings.is_sum:
        return np.asarray(added)
    clear = np.prod([1.0 - picture[..., 3] for picture in pictures], axis=0)
    added[..., 3] = 1.0 - clear
    if settings.ground is not None:
        added = added + clear[..., None] * np.array([*settings.ground, 1.0], added.dtype)
    return np.asarray(added)


Others = Mapping[str, Any]


def volume_of(x: Any, _: Others | None = None) -> Volume:
    """The volume of a file, an address, a built-in scene, an array, or an image of another library."""
    if isinstance(x, str | Path):
        return load_source(str(x))
    if x is None or isinstance(x, Mapping | Camera | Transfer | Settings | Scene | Splats):
        raise TypeError
    return Volume.of(x)


def scene_of(x: Any, _: Others) -> Scene:
    """The scene of a plotter."""
    if not is_scene(x):
        raise TypeError
    return Scene.of(x)


def splats_of(x: Any, _: Others) -> Splats:
    """The splats of a volume with its default transfer function."""
    volume = x if isinstance(x, Volume) else volume_of(x)
    return extract(volume, default_transfer(volume))


def bounded_of(x: Any, _: Others) -> Any:
    """Something with corners, or a volume."""
    return x if hasattr(x, "corners") else volume_of(x)


def transfer_of(x: Any, others: Others) -> Transfer:
    """The transfer function of a preset's name or of a file, for the volume among the other arguments; or of fields."""
    if isinstance(x, Mapping):
        reject_unknown("transfer", map(str, x), Transfer.__dataclass_fields__, "names of Transfer's fields")
        return Transfer(**x)
    if not isinstance(x, str | Path):
        raise TypeError
    volume = next((value for value in others.values() if isinstance(value, Volume)), None)
    if str(x).endswith(SUFFIXES):
        return load_transfer(str(x), Grid.of(volume).mean_spacing if volume else 1.0)
    if volume is None:
        raise expected("transfer", "a Transfer or its file, as a preset needs a volume", repr(x))
    return preset(str(x), volume)


def camera_of(x: Any, _: Others) -> Camera:
    """The camera of VTK, PyVista or a plotter."""
    if not any(hasattr(x, name) for name in ("GetFocalPoint", "GetRenderers", "renderer", "camera")):
        raise TypeError
    return Camera.of(x)


def settings_of(x: Any, _: Others) -> Settings:
    """The settings of a mapping of fields."""
    if not isinstance(x, Mapping):
        raise TypeError
    return Settings().replace(**x)

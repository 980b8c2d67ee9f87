"""`Scene` and `Layer`: several volumes and meshes in one picture.

Where layers overlap, extinctions and emissions add up: the order is right at every depth of every ray.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from splatgl.data.mesh import Mesh
from splatgl.data.volume import Volume
from splatgl.errors import InputError, expected
from splatgl.splat.camera import Camera
from splatgl.splat.clipping import Box, Plane, parse_planes
from splatgl.splat.culling import clip_behind_eye
from splatgl.splat.motion import Motion, count_moments
from splatgl.splat.opaque_bounds import Opaque
from splatgl.splat.plan import Plan, plan
from splatgl.splat.presets import SURFACE, default_transfer, preset
from splatgl.splat.resolve import Resolved, blur_form, check_blur_supported, extract_for_settings
from splatgl.splat.segment_surfaces import check_strength, smooth_surfaces
from splatgl.splat.settings import BLENDS, Settings
from splatgl.splat.splats import Splats
from splatgl.splat.transfer import Transfer

# optical depth through the volume's thinnest side of a channel at its brightest: what lies behind shows through; and
# the least opacity of a voxel
THROUGH, LEAST = 6.0, 0.01
# of channels whose file states no colour
PALETTE = ("#4a7dff", "#3ddc5a", "#ff4b4b", "#ffd23d", "#38e1e1", "#ff5adf", "#ff9a3d", "#c9c9c9")


def channel_transfers(
    volume: Volume, colors: Mapping[str, str], windows: Mapping[str, tuple[float, float]], base: Transfer | None = None
) -> list[Transfer]:
    """The transfer function of each of a volume's channels: a ramp over its window in its colour, unshaded.

    colors, windows: by the names or numbers of channels, instead of the file's. base: whose ramp all have that are
    given no window. A channel without any window has the preset microscopy's. Raises InputError for a channel that
    there is not.
    """
    names = [each.name for each in volume.channels]
    for name in (*colors, *windows):
        if name not in names and name not in map(str, range(len(names))):
            raise expected("channel", f"one of {', '.join(names)}", repr(name))
    full = float(np.clip(-np.expm1(-THROUGH / min(volume.shape)), LEAST, SURFACE))
    found = []
    for number, channel in enumerate(volume.channels):
        keys = (channel.name, str(number))
        color = next((colors[key] for key in keys if key in colors), None)
        color = color or channel.hints.color or PALETTE[number % len(PALETTE)]
        window = next((windows[key] for key in keys if key in windows), None)
        if window is None and base is None:
            window = channel.hints.window
        ramp = base or preset("microscopy", channel).weakened(full / SURFACE)
        if window is not None:
            ramp = Transfer(((window[0], 0.0), (window[1], full)), unit=ramp.unit)
        found.append(replace(ramp, colormap=color, window=None, shading=False))
    return found


# most layers of a picture: what a shader keeps of each beside the others
MOST_LAYERS = 8


@dataclass(frozen=True, eq=False)
class Layer:
    """A volume and how it is seen. transfer: None: the default one of its values. opacity: factor from 0 to 1 of the
    transfer function's opacities. threshold: as of `extract`. clip: conditions of its own box, or planes, that cut it
    instead of the scene's; None: those. surfaces: how smooth the surfaces are that are drawn of a segmentation, as of
    `surfaces`; None: the boxes of its voxels.
    """

    volume: Volume
    transfer: Transfer | None = None
    opacity: float = 1.0
    visible: bool = True
    threshold: float = 0.0
    clip: str | Sequence[Any] | None = None
    surfaces: float | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.opacity <= 1:
            raise expected("opacity", "a factor from 0 to 1", self.opacity)
        transfer = self.transfer or default_transfer(self.volume)
        object.__setattr__(self, "transfer", transfer.weakened(self.opacity))
        if self.surfaces is not None:
            object.__setattr__(self, "surfaces", check_strength(self.surfaces))

    def placed(self, frame: str | None) -> Layer:
        """The layer with its volume, and the planes that cut it, in another frame."""
        volume = self.volume.placed(frame)
        if volume is self.volume:
            return self
        # its opacity is in its transfer function already
        made = copy(self)
        object.__setattr__(made, "volume", volume)
        if self.clip is not None:
            own = parse_planes(self.clip, Box.of([self.volume]))
            object.__setattr__(made, "clip", tuple((-x, -y, z, d) for x, y, z, d in own))
        return made

    @property
    def seen(self) -> Transfer:
        """The transfer function of its voxels, with the layer's opacity in it; clear where surfaces are drawn."""
        assert self.transfer is not None
        return self.transfer if self.surfaces is None else self.transfer.weakened(0.0)


@dataclass(frozen=True, eq=False)
class Scene:
    """Layers of one picture, in any order; volumes stand for layers by default. clip: conditions such as "x>0.3" of the
    box around the visible layers, or planes as of Settings. meshes: triangles, in the same world. Layers and meshes in
    another frame, LPS or RAS, than the first layer are turned into its own; planes cut those that are `clipped`.
    Surfaces of segmentations are added to the meshes, cut as their layer; notes: how far they lie off its voxels.
    Raises InputError for too many layers, for none that is visible, for planes that leave nothing, and as `surfaces`.
    """

    layers: Sequence[Layer | Volume]
    clip: str | Sequence[Any] = ()
    meshes: Sequence[Mesh] = ()
    made: dict[Settings, tuple[Splats, ...]] = field(default_factory=dict, repr=False)
    planes: tuple[tuple[Plane, ...], ...] = field(default=(), init=False, repr=False)
    notes: tuple[str, ...] = field(default=(), init=False, repr=False)

    def __post_init__(self) -> None:
        layers = tuple(Layer(each) if isinstance(each, Volume) else each for each in self.layers)
        first = _frame(layers)
        object.__setattr__(self, "layers", tuple(each.placed(first) for each in layers))
        if not 1 <= len(self.shown) <= MOST_LAYERS:
            raise expected("layers", f"1 to {MOST_LAYERS} that are visible", len(self.shown))
        object.__setattr__(self, "planes", self._planes())
        placed = tuple(each.placed(first) for each in self.meshes)
        found = tuple(each.cut(self._around) if each.clipped and self._around else each for each in placed)
        made, notes = self._segments()
        object.__setattr__(self, "meshes", (*found, *made))
        object.__setattr__(self, "notes", notes)

    @classmethod
    def of(cls, x: Any) -> Scene:
        """The visible volumes and meshes of a PyVista plotter, or of a window or renderer of VTK, where these are.

        Volumes of even grids have their transfer functions, clipping planes and shading; meshes their colours, lines as
        tubes and points as balls. Camera.of and Settings.of have the view, and blend, light and background. Raises
        InputError where there is no volume, and for what has no like here.
        """
        from splatgl.integrations.vtk.scene import scene_of

        return scene_of(x)

    def to_pyvista(self, camera: Camera | None = None, settings: Settings | None = None, **options: Any) -> Any:
        """A pyvista.Plotter of the same layers and meshes, view, blend, planes, light and background.

        camera: None: from the front, to the right and above. options: of the plotter, such as off_screen. Raises
        InputError for blends that VTK has not, and without PyVista.
        """
        from splatgl.integrations.vtk.pyvista import plotter_of

        return plotter_of(self, camera, settings, options)

    @property
    def frame(self) -> str | None:
        """LPS, RAS or None: that of all layers and meshes."""
        return _frame(self.layers)

    def _planes(self) -> tuple[tuple[Plane, ...], ...]:
        """Those that cut each visible layer."""
        around = self._around
        return tuple(
            around if each.clip is None else parse_planes(each.clip, Box.of([each.volume])) for each in self.shown
        )

    def _segments(self) -> tuple[list[Mesh], tuple[str, ...]]:
        """The surfaces of layers that are drawn so, and a note on each layer."""
        found: list[Mesh] = []
        notes: list[str] = []
        for layer, planes in zip(self.shown, self.planes, strict=True):
            if layer.surfaces is not None:
                made, off = smooth_surfaces(layer.volume, layer.transfer, layer.surfaces, closed=False)
                found += [replace(each.cut(planes), clipped=True) for each in made]
                told = f"{len(made)} segment{'s' * (len(made) != 1)} drawn as smoothed surfaces ({layer.surfaces:g})"
                notes.append(f"{layer.volume.name or 'labels'}: {told}, up to {off:.2g} voxels off the faces of voxels")
        return found, tuple(notes)

    @property
    def _around(self) -> tuple[Plane, ...]:
        """The planes of all that has none of its own."""
        return parse_planes(self.clip, Box.of(each.volume for each in self.shown)) if self.clip else ()

    def surfaces(self, settings: Settings) -> tuple[Mesh, ...]:
        """The meshes, cut by the planes of settings, too, if they are to be."""
        return tuple(each.cut(settings.clip) if each.clipped and settings.clip else each for each in self.meshes)

    @property
    def shown(self) -> tuple[Layer, ...]:
        """The visible layers."""
        return tuple(each for each in self.layers if isinstance(each, Layer) and each.visible and each.opacity > 0)

    def splats(self, settings: Settings) -> tuple[Splats, ...]:
        """The splats of each visible layer for pictures with these settings; extracted once."""
        # what they depend on
        key = Settings().but(
            blend=settings.blend,
            kernel=settings.kernel,
            classification=settings.classification,
            compositing=settings.compositing,
        )
        if key not in self.made:
            self.made[key] = tuple(
                extract_for_settings(each.volume, each.seen, key, each.threshold) for each in self.shown
            )
        return self.made[key]

    def drawn(self, settings: Settings) -> list[tuple[Splats, Settings]]:
        """The splats of each visible layer that has any, or of the first, and the settings with its planes."""
        settled = [settings.but(clip=(*settings.clip, *own)) if own else settings for own in self.planes]
        every = list(zip(self.splats(settings), settled, strict=True))
        return [each for each in every if len(each[0])] or every[:1]

    def moments(self, camera: Camera, settings: Settings, motion: Motion) -> int:
        """How many pictures a moving one is the mean of: as many as the fastest layer takes; 1 for a sharp one."""
        if settings.moments is not None:
            return settings.moments
        if settings.motion == "off" or settings.shutter == 0:
            return 1
        return max(count_moments(each, camera, motion, settings.shutter) for each, _ in self.drawn(settings))

    @property
    def corners(self) -> np.ndarray:
        """Corners [N, 3], world units, of the boxes of opaque samples."""
        return np.concatenate([*(each.corners for each in self._subjects), *(each.vertices for each in self.meshes)])

    @property
    def outline(self) -> np.ndarray:
        """Points [N, 3], world units, whose hull contains the opaque samples."""
        return np.concatenate([*(each.outline for each in self._subjects), *(each.vertices for each in self.meshes)])

    @property
    def _subjects(self) -> list[Opaque]:
        # of the voxels also where surfaces are drawn: the view of both is the same
        return [Opaque(each.volume, each.transfer or each.seen) for each in self.shown]


@dataclass(frozen=True, eq=False)
class ScenePlan:
    """The plans of the layers of a picture, and its meshes. notes: on the meshes. background: of the picture."""

    layers: tuple[Plan, ...]
    meshes: tuple[Mesh, ...] = ()
    notes: tuple[str, ...] = ()
    background: tuple[float, float, float] | None = None

    @property
    def is_single(self) -> bool:
        """Whether one layer is drawn and no mesh: its error bound can be known."""
        return len(self.layers) == 1 and not self.meshes

    @property
    def first(self) -> Plan:
        """The plan of the first layer, whose size, samples and blend are those of all."""
        return self.layers[0]

    def explain(self) -> str:
        """A description of each plan, under the names of layers if there are several or meshes."""
        if self.is_single:
            return self.first.explain()
        return "\n".join(f"{each.splats.name}:\n{each.explain()}" for each in self.layers)


def plan_scene(
    subject: Splats | Scene,
    camera: Camera,
    settings: Settings,
    motion: Motion | None = None,
    tiles: bool | None = False,
) -> ScenePlan:
    """The plan of a picture of splats, or of the visible layers of a scene. motion, tiles: as of `plan`.

    Raises InputError for settings that layers or meshes are not drawn with: what composites splat by splat, streaks
    and flows; and for meshes, blends other than composite.
    """
    if not isinstance(subject, Scene):
        return ScenePlan((plan(subject, camera, settings, motion, tiles),))
    layers, meshes = subject.drawn(settings), subject.surfaces(settings)
    if len(layers) == 1 and not meshes:
        return ScenePlan((plan(layers[0][0], camera, layers[0][1], motion, tiles),))
    changes: dict[str, Any] = {}
    if motion is not None and not motion.still:
        check_blur_supported("of layers", settings, motion.flow is not None)
        changes = {"motion": "off", "moments": subject.moments(camera, settings, motion)}
    is_ordered = BLENDS[settings.blend].ordered
    if not is_ordered:
        if meshes:
            raise expected("meshes", "blend composite", settings.blend)
        changes["background"] = None
    layers = common_samples(layers, camera, settings)
    plans = tuple(plan(splats, camera, own.but(**changes), motion, tiles) for splats, own in layers)
    if is_ordered:
        for each in plans:
            check_layer(each.resolved, each.splats.name)
        lit = with_shared_casters([each.resolved for each in plans], [(each.splats, each.settings) for each in plans])
        plans = tuple(replace(each, resolved=resolved) for each, resolved in zip(plans, lit, strict=True))
    return ScenePlan(plans, meshes, subject.notes, settings.background)


def moments_per_frame(subject: Splats | Scene, camera: Camera, settings: Settings, motion: Motion) -> int:
    """Number of pictures whose mean a moving one is; 0 for a sharp picture of splats, and for streaks."""
    if isinstance(subject, Scene):
        return subject.moments(camera, settings, motion)
    is_mean = settings.shutter > 0 and blur_form(subject, settings) == "moments"
    return count_moments(subject, camera, motion, settings.shutter) if is_mean else 0


def common_samples(
    layers: Sequence[tuple[Splats, Settings]], camera: Camera, settings: Settings
) -> list[tuple[Splats, Settings]]:
    """The layers with the samples a pixel that the one which needs the most takes, if they composite together."""
    if settings.antialias != "auto" or len(layers) < 2 or not BLENDS[settings.blend].ordered:
        return list(layers)
    samples = max(Resolved.of(clip_behind_eye(splats, camera), camera, own).samples for splats, own in layers)
    return [(splats, own.but(antialias="supersample", samples=samples)) for splats, own in layers]


def with_shared_casters(resolved: Sequence[Resolved], layers: Sequence[tuple[Splats, Settings]]) -> list[Resolved]:
    """Resolved settings of layers, of which all together keep ambient light and light off each."""
    casters = tuple((splats, own.clip) for splats, own in layers)
    return [each if each.cues is None else replace(each, cues=replace(each.cues, casters=casters)) for each in resolved]


def check_layer(resolved: Resolved, name: str) -> None:
    """InputError for a layer that composites splat by splat: its order beside other layers is not known."""
    if resolved.look.blend.ordered and resolved.sheets is None and not resolved.boxes:
        why = f"; {resolved.notes[-1]}" if resolved.notes else ""
        raise InputError(f"layer {name or 'without a name'}: layers composite in sheets, not splat by splat{why}")


def join_pictures(pictures: Sequence[np.ndarray], settings: Settings) -> np.ndarray:
    """[H, W, 4]: pictures of layers, on nothing, in blends without an order: sums add up; of others light adds up, and
    what passes multiplies.
    """
    blend = BLENDS[settings.blend]
    added = np.sum(pictures, axis=0)
    if blend.unbounded:
        return np.asarray(added)
    clear = np.prod([1.0 - each[..., 3] for each in pictures], axis=0)
    added[..., 3] = 1.0 - clear
    if settings.background is not None:
        added = added + clear[..., None] * np.array([*settings.background, 1.0], added.dtype)
    return np.asarray(added)


def _frame(layers: Iterable[Layer | Volume]) -> str | None:
    """That of the first of those to be seen which has one."""
    known = (each.volume.frame for each in layers if isinstance(each, Layer) and each.visible and each.opacity > 0)
    return next((frame for frame in known if frame), None)

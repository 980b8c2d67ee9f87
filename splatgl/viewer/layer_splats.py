"""`LayerSplats`: a layer of a document, and its splats at each stride, which are extracted on demand."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from splatgl.data.affine import World
from splatgl.data.mesh import Mesh
from splatgl.data.volume import Volume, halve_volume
from splatgl.geometry.camera import Bounded
from splatgl.geometry.clipping import ClipUnits, parse_planes
from splatgl.geometry.scissors import Scissors, cut_volume
from splatgl.planning.culling import OpaqueBounds, eye_is_outside, visible_shell
from splatgl.planning.resolve import extraction_kind, why_per_splat
from splatgl.planning.scene import Layer
from splatgl.scene.open_scene import SMALL
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.view import FIT_OF_0_3
from splatgl.splat.extract import Progress, extract, why_only_pre
from splatgl.splat.segment_surfaces import smooth_surfaces
from splatgl.splat.settings import Settings
from splatgl.splat.splats import MOST_KEPT, Splats
from splatgl.transfer.colormaps import SOLID
from splatgl.transfer.transfer import Transfer
from splatgl.viewer.adaptive_quality import STRIDES, StandIn, choose_stand_in
from splatgl.viewer.state import LayerStyle

# number of splats that can be processed within a millisecond
FEW = 200_000
# sets of surfaces that a layer keeps
MOST_NETS = 3
# classification and kernel
Kind = tuple[str, str]


@dataclass(frozen=True, eq=False)
class LayerSplats:
    """Volume of a layer at each of STRIDES, finest first, and its splats.

    scene: options of this layer alone. own: the layer in the frame and unit of its file; volumes are in the document's.
    stand_in: the part of the volume that is shown. kind: of the splats. estimates: `counts` of the layer that this one
    replaces. cache: splats of each kind, all and (True) without the hidden ones, by stride. Layers of one cache differ
    in their kind alone. nets: surfaces of segments that are made, by what they depend on, of this layer in all looks.
    """

    name: str
    scene: SceneFile
    own: Layer
    volumes: tuple[Volume, ...]
    stand_in: StandIn | None = None
    kind: Kind = ("pre", "")
    estimates: tuple[int, ...] = (0,) * len(STRIDES)
    cache: dict[tuple[Kind, bool], dict[int, Splats]] = field(default_factory=dict, repr=False)
    nets: dict[object, dict[int, Mesh]] = field(default_factory=dict, repr=False)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, LayerSplats) and self.cache is other.cache and self.kind == other.kind

    def __hash__(self) -> int:
        return hash((id(self.cache), self.kind))

    @classmethod
    def of_layer(cls, name: str, scene: SceneFile, layer: Layer) -> LayerSplats:
        """The voxels of a layer, or their first stand-in, without splats."""
        return cls(name, scene, layer, ()).with_stand_in(choose_stand_in(layer.volume, layer.faded, scene.settings))

    def with_stand_in(self, shown: StandIn) -> LayerSplats:
        """The layer with the voxels of a stand-in, without splats."""
        volumes = [shown.volume]
        for _ in STRIDES[1:]:
            last = volumes[-1]
            less = halve_volume(last, bool(self.transfer.labels)) if last.count > SMALL and not last.coarser else last
            volumes.append(next(iter(last.coarser), less))
        estimates = tuple(volume.count for volume in volumes)
        fresh = replace(self.without_splats(), volumes=tuple(volumes), stand_in=shown, estimates=estimates)
        return fresh.for_settings(self.scene.settings)

    @property
    def volume(self) -> Volume:
        """The volume at full resolution."""
        return self.volumes[0]

    @property
    def world(self) -> World:
        """Frame and unit of its file."""
        return self.own.volume.world

    @cached_property
    def transfer(self) -> Transfer:
        """The transfer function with the opacity of the layer."""
        return self.own.faded

    @cached_property
    def stored(self) -> Volume:
        """The volume in the world of its file, which transfer functions refer to."""
        return self.volume.placed(*self.world)

    @property
    def has_finer(self) -> bool:
        """Whether finer voxels can be read."""
        return self.stand_in is not None and self.stand_in.finer is not None

    @property
    def counts(self) -> tuple[int, ...]:
        """Number of visible splats at each of STRIDES, estimated where none are extracted yet."""
        counts: list[int] = []
        for stride, estimate in zip(STRIDES, self.estimates, strict=True):
            counts.append(len(self.shells[stride]) if stride in self.shells else min([estimate, *counts[-1:]]))
        return tuple(counts)

    @property
    def by_stride(self) -> dict[int, Splats]:
        """The splats that are extracted, by stride."""
        return self.cache.setdefault((self.kind, False), {})

    @property
    def shells(self) -> dict[int, Splats]:
        """The splats without the hidden ones, by stride."""
        return self.cache.setdefault((self.kind, True), {})

    @property
    def extracted(self) -> tuple[int, ...]:
        """The strides whose splats are extracted, finest first."""
        return tuple(sorted(self.shells))

    @property
    def exceeds_budget(self) -> bool:
        """Whether the finest splats would exceed MOST_KEPT, estimated from stride 2."""
        return 1 not in self.shells and 2 in self.by_stride and 8 * len(self.by_stride[2]) > MOST_KEPT

    @property
    def finest(self) -> Splats:
        """The finest splats extracted so far; the coarsest if there are none."""
        return self.by_stride[min(self.by_stride)] if self.by_stride else self.at(STRIDES[-1])

    @property
    def sample(self) -> Splats:
        """The finest extracted splats with at most FEW elements, cheap enough to process every frame."""
        few = [stride for stride in sorted(self.by_stride) if len(self.by_stride[stride]) <= FEW]
        return self.by_stride[few[0]] if few else self.at(STRIDES[-1])

    def subject(self, fit: str) -> Bounded:
        """The object that the default view of the layer alone is fitted to, as `OpenScene.fitted`."""
        if self.is_post_classified or fit != FIT_OF_0_3:
            return self._opaque
        return self.finest if len(self.finest) else self.volume

    @cached_property
    def _opaque(self) -> OpaqueBounds:
        return OpaqueBounds(self.volume, self.look)

    @cached_property
    def drawn(self) -> Layer:
        """The layer of a scene in the document's frame and unit of length."""
        return replace(self.own, volume=self.stored).placed(*self.volume.world)

    @cached_property
    def look(self) -> Transfer:
        """The transfer function with the opacity of the layer, in the document's unit of length."""
        return self.drawn.faded

    def at(self, stride: int, progress: Progress | None = None) -> Splats:
        """The splats at a stride; opacities are per the finest volume's spacing at every stride. progress: as of
        `extract`, if they are not extracted yet.
        """
        volume = self.volumes[STRIDES.index(stride)]
        if stride > 1 and volume is self.volume:
            return self.at(1, progress)
        if stride not in self.by_stride:
            how, kernel = self.kind
            # previews drop nearly transparent splats
            how = "post-lean" if how == "post" and stride > 1 else how
            self.by_stride[stride] = extract(volume, self.look, self.own.threshold, None, progress, how, kernel)
        return self.by_stride[stride]

    def layer_at(self, stride: int) -> Layer:
        """The layer of a scene, with the splats at a stride; none where surfaces are drawn instead."""
        held = partial(self.at if self.meshes is None else self.none_at, stride)
        return replace(self.drawn, volume=self.volumes[STRIDES.index(stride)], held=held, surfaces=None)

    @property
    def _net_key(self) -> object:
        """The causes of the shape of surfaces: voxels, strength, and the visible segments, the most opaque first."""
        shown = sorted((label for label in self.look.labels if label[2] > 0), key=lambda label: -label[2])
        return self.volume, self.own.surfaces, tuple(number for number, *_ in shown)

    def make_surfaces(self) -> None:
        """Makes the smooth surfaces of segments, if they are drawn and not made yet."""
        if self.own.surfaces is None or self._net_key in self.nets:
            return
        # the latest alone are kept
        for key in list(self.nets)[: 1 - MOST_NETS]:
            self.nets.pop(key, None)
        # without names of the file, each is named by its number
        plain = replace(self.volume, labels=None)
        made, _ = smooth_surfaces(plain, self.look, self.own.surfaces, closed=False)
        self.nets[self._net_key] = {int(mesh.name): mesh for mesh in made}

    @property
    def meshes(self) -> tuple[Mesh, ...] | None:
        """The smooth surfaces of segments; None while they are not made, and where voxels are drawn."""
        if self.own.surfaces is None or (made := self.nets.get(self._net_key)) is None:
            return None
        shown = [(made[label[0]], label) for label in self.look.labels if label[0] in made]
        styled = [
            replace(mesh, color=color, opacity=min(opacity / SOLID, 1.0), clipped=True)
            for mesh, (_, color, opacity) in shown
        ]
        if self.drawn.clip is None:
            return tuple(styled)
        planes = parse_planes(self.drawn.clip, ClipUnits.of([self.volume]))
        return tuple(replace(mesh, clipped=False).cut(planes) if planes else mesh for mesh in styled)

    def none_at(self, stride: int) -> Splats:
        """None of the splats at a stride."""
        splats = self.at(stride)
        return splats.part(np.zeros(len(splats), bool))

    def shell(self, stride: int, progress: Progress | None = None) -> Splats:
        """The splats at a stride without those hidden from every side."""
        if stride not in self.shells:
            if stride == 1:
                # before the splats, whose picture is the finest
                self.make_surfaces()
            same = stride > 1 and self.volumes[STRIDES.index(stride)] is self.volume
            self.shells[stride] = self.shell(1, progress) if same else visible_shell(self.at(stride, progress))
        return self.shells[stride]

    def seen_from(self, eye: np.ndarray, stride: int, settings: Settings) -> Splats:
        """The splats at a stride, without hidden ones if an eye [3] is outside, and planes do not expose the inside."""
        if not settings.hides or settings.clip:
            return self.at(stride)
        shell = self.shell(stride)
        return shell if eye_is_outside(shell, eye) else self.at(stride)

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
        return replace(self, cache={})

    def with_own(self, own: Layer) -> LayerSplats:
        """A copy with another look, which keeps the splats whose values serve both."""
        kind = next((kind for kind, _ in self.cache.copy() if kind[0] != "pre"), self.kind)
        edited = replace(self, own=own, kind=kind, estimates=self.counts)
        look = edited.look.on(self.volume)
        made = {
            stride: splats.with_classifier(splats.post.with_transfer(look))
            for stride, splats in edited.by_stride.copy().items()
            if splats.post is not None and splats.holds(edited.transfer)
        }
        return replace(edited, cache={(kind, False): made, (kind, True): made.copy()})

    def coarse(self) -> LayerSplats:
        """The layer with the splats of the coarsest stride alone."""
        cache = {key: {n: made[n] for n in made.keys() & STRIDES[-1:]} for key, made in self.cache.copy().items()}
        return replace(self, cache=cache)

    def for_style(self, style: LayerStyle, settings: Settings, moving: bool = False) -> LayerSplats:
        """The layer in a style, with splats of the kind that the settings take; this one if nothing changes."""
        own = self.own
        look = style.stated, style.opacity, style.threshold, style.surfaces
        if look == (own.transfer, own.opacity, own.threshold, own.surfaces):
            return self.for_settings(settings, moving)
        own = replace(own, transfer=look[0], opacity=look[1], threshold=look[2], surfaces=look[3])
        return self.with_own(own).for_settings(settings, moving)

    @property
    def scissors(self) -> tuple[Scissors, ...]:
        """The scissors that cut the volume."""
        return tuple(mask for mask in self.volume.masks if isinstance(mask, Scissors))

    def within(self, world: World, scissors: tuple[Scissors, ...]) -> LayerSplats:
        """The layer, without splats, in another frame and unit, and that other scissors leave; this one if it is so."""
        made = {id(each): each.placed(*world) for each in self.volumes}
        if scissors != self.scissors:
            made = {key: cut_volume(each, scissors) for key, each in made.items()}
        volumes = tuple(made[id(each)] for each in self.volumes)
        return self if volumes == self.volumes else replace(self.without_splats(), volumes=volumes)

    def for_settings(self, settings: Settings, moving: bool = False) -> LayerSplats:
        """The layer with splats of the kind that the settings take; those of the other classification are kept.

        moving: whether the picture is motion-blurred.
        """
        # pre where volume or settings allow nothing else
        requested = settings.replace(classification="auto") if settings.classification == "post" else settings
        why = why_only_pre(self.volume, self.transfer, self.own.threshold)
        kind = extraction_kind(requested, moving, why, self.volume.count)
        if kind == self.kind:
            # values kept for other transfer functions do not hold here
            return self.without_splats() if why and self.is_post_classified and self.by_stride else self
        is_post, entries = kind[0] != "pre", self.cache.copy()
        # what cannot be extracted raises its error on use
        kept = {k: v for k, v in entries.items() if k[0] == kind or (k[0][0] != "pre") != is_post}
        cache = {} if why and is_post else self.cache if len(kept) == len(entries) else kept
        return replace(self, kind=kind, estimates=self.counts, cache=cache)

    def why_pre_classified(self, settings: Settings, moving: bool) -> str | None:
        """The reason why splats are classified before reconstruction; None if the settings allow either."""
        return why_only_pre(self.volume, self.transfer, self.own.threshold) or why_per_splat(settings, moving)

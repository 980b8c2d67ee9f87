"""`Content`: a scene's volume at every stride, and the splats extracted with its transfer function and settings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from splatgl.app.viewer.pacing import STRIDES
from splatgl.app.viewer.parts import Look
from splatgl.app.viewer.portion import Portion, portion
from splatgl.app.viewer.pose import Pose
from splatgl.data.mesh import Mesh
from splatgl.data.volume import Volume, coarser
from splatgl.errors import expected
from splatgl.scene.draw import is_layered, tell
from splatgl.scene.meshes import MeshFile
from splatgl.scene.scene_file import Scene
from splatgl.scene.view import FOV, View
from splatgl.splat.camera import Bounded, Camera
from splatgl.splat.culling import skinned
from splatgl.splat.extract import Progress, extract, only_pre
from splatgl.splat.grid import Grid
from splatgl.splat.opaque_bounds import Opaque
from splatgl.splat.resolve import Resolved, kind, one_by_one
from splatgl.splat.scene import Scene as Layers
from splatgl.splat.settings import Settings
from splatgl.splat.splats import MOST_KEPT, Splats
from splatgl.splat.transfer import Transfer

# volumes with fewer voxels are not downsampled
SMALL = 1 << 15
# number of splats that can be processed within a millisecond
FEW = 200_000


@dataclass(frozen=True, eq=False)
class Content:
    """volumes: one for each of STRIDES, finest first. Splats are extracted on demand.

    portion: what of the scene's volume they are.
    kind: classification and kernel that splats are extracted for. before: `counts` of the content that
    this one replaces. beside: contents that differ in kind alone, by `after`. waiting: whether nothing is read yet.
    """

    scene: Scene
    volumes: tuple[Volume, ...]
    transfer: Transfer
    threshold: float
    kind: tuple[str, str] = ("pre", "")
    before: tuple[int, ...] = (0,) * len(STRIDES)
    made: dict[int, Splats] = field(default_factory=dict)
    skins: dict[int, Splats] = field(default_factory=dict)
    beside: dict[bool, Content] = field(default_factory=dict)
    portion: Portion | None = None
    waiting: bool = False

    def __post_init__(self) -> None:
        self.beside[self.after] = self

    @classmethod
    def nothing(cls, scene: Scene) -> Content:
        """What there is of a scene before it is read."""
        volume = Volume(np.zeros((2, 2, 2), np.uint8), name=Path(scene.volume).name)
        bare = replace(scene, view=View(), settings=Settings(), transfer={}, layers=(), meshes=(), crop="", clip=None)
        found = cls(bare, (volume,) * len(STRIDES), Transfer([(0, 0.0), (1, 0.5)]), 0.0, waiting=True)
        for stride in STRIDES:
            found.skin(stride)
        return found

    @classmethod
    def open(cls, scene: Scene, quiet: bool = False) -> Content:
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
            from splatgl.app.viewer.together import Together

            return Together.opened(scene, volume, quiet)
        return cls.of_volume(scene.cut(volume), volume, scene.transfer_for(volume))

    @classmethod
    def of_volume(cls, scene: Scene, volume: Volume, transfer: Transfer) -> Content:
        """Of a volume that is read, or of a stand-in."""
        shown = portion(volume, transfer, scene.settings)
        if shown.told or shown.finer:
            # opacities stay those of the finest voxels
            transfer = replace(transfer, unit=transfer.unit or _spacing(volume))
        return cls._of(scene, shown, transfer)

    def finer(self) -> Content:
        """The content of the portion that replaces this one's, which is read now."""
        assert self.portion and self.portion.finer
        return self._of(self.scene, self.portion.finer(), self.transfer)

    @classmethod
    def _of(cls, scene: Scene, shown: Portion, transfer: Transfer) -> Content:
        volume = shown.volume
        volumes = [volume]
        for _ in STRIDES[1:]:
            last = volumes[-1]
            less = coarser(last, bool(transfer.labels)) if last.count > SMALL and not last.coarser else last
            half = next(iter(last.coarser), less)
            volumes.append(half)
        before = tuple(each.count for each in volumes)
        content = cls(scene, tuple(volumes), transfer, scene.threshold, before=before, portion=shown)
        content = content.classified(scene.settings)
        content.skin(STRIDES[-1])
        return content

    @property
    def looks(self) -> tuple[Look, ...]:
        """How each part of the content is seen; of one volume, that one."""
        return (Look(self.transfer, self.threshold),)

    @property
    def surfaces(self) -> tuple[MeshFile, ...]:
        """The meshes of a scene beside its volumes."""
        return ()

    @property
    def channels(self) -> list[Content]:
        """The parts that are channels of one volume."""
        return [self]

    @property
    def names(self) -> tuple[str, ...]:
        """A name of each part."""
        return (self.volume.name or self.scene.volume,)

    @property
    def drawing(self) -> list[Content]:
        """The parts whose splats are drawn."""
        return [self]

    def mesh(self, file: MeshFile) -> Mesh | None:
        """What is read of a mesh; None if it is not."""
        return None

    def part(self, number: int) -> Content:
        """One part of the content."""
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
        self, looks: Sequence[Look], surfaces: Sequence[MeshFile], settings: Settings, moving: bool = False
    ) -> Content:
        """The content as its parts are to be seen; this one if it is."""
        return self.following(looks[0].transfer, looks[0].threshold, settings, moving)

    def subject_at(self, stride: int, settings: Settings) -> tuple[Splats | Layers, Settings]:
        """What a renderer draws at a stride, with these settings."""
        return self.at(stride), settings

    def check(self, settings: Settings, resolved: Resolved) -> None:
        """InputError for settings that this content is not drawn with."""

    def anew(self) -> Content:
        """The same without any splats: those that are there may be of values extracted for another transfer."""
        return replace(self, made={}, skins={}, beside={})

    def following(self, transfer: Transfer, threshold: float, settings: Settings, moving: bool = False) -> Content:
        """The content of these values, as a picture with these settings takes it; this one if it is."""
        same = (transfer, threshold) == (self.transfer, self.threshold)
        return (self if same else self.changed(transfer, threshold)).classified(settings, moving)

    def changed(self, transfer: Transfer, threshold: float) -> Content:
        """A copy with another transfer function, and of the splats those whose values serve it too."""
        after = self.beside.get(True, self)
        made = {
            stride: splats.classified_after(splats.post.recolored(self._at(stride, transfer)))
            for stride, splats in after.made.copy().items()
            if splats.post is not None and splats.post.holds(transfer)
        }
        kept = (after.kind, self.counts, made, made.copy())
        return Content(self.scene, self.volumes, transfer, threshold, *kept, portion=self.portion)

    def classified(self, settings: Settings, moving: bool = False) -> Content:
        """The content as a picture with these settings takes it; others of the same transfer function are kept.

        moving: whether the picture is motion-blurred.
        """
        # pre where it is all that volume or settings allow
        asked = settings.but(classification="auto") if settings.classification == "post" else settings
        why = only_pre(self.volume, self.transfer, self.threshold)
        found = kind(asked, moving, why, self.volume.count)
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
        return only_pre(self.volume, self.transfer, self.threshold) or one_by_one(settings, moving)

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

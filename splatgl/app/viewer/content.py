"""`Content`: a scene's volume at every stride, and the splats extracted with its transfer function."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from splatgl.app.scene import FOV, Scene
from splatgl.app.viewer.pacing import STRIDES
from splatgl.app.viewer.pose import Pose
from splatgl.app.viewer.skin import skinned
from splatgl.data.coarse import coarser
from splatgl.data.volume import Volume
from splatgl.splat.classification.transfer import Transfer
from splatgl.splat.extraction.extract import extract
from splatgl.splat.extraction.splats import Grid, Splats
from splatgl.splat.view.camera import Bounded, Camera

# volumes with fewer voxels are not downsampled
SMALL = 1 << 15
# maximum number of splats extracted while a transfer function is edited: 3 GB with all derived data
MOST = 20_000_000
# number of splats that can be processed within a millisecond
FEW = 200_000


@dataclass(frozen=True, eq=False)
class Content:
    """volumes: one for each of STRIDES, finest first. Splats are extracted on demand.

    counts: number of visible splats at each of STRIDES, or the number under the previous transfer function.
    """

    scene: Scene
    volumes: tuple[Volume, ...]
    transfer: Transfer
    threshold: float
    counts: tuple[int, ...] = (0,) * len(STRIDES)
    made: dict[int, Splats] = field(default_factory=dict)
    skins: dict[int, Splats] = field(default_factory=dict)

    @classmethod
    def open(cls, scene: Scene) -> Content:
        """Reads the volume and extracts the splats of all strides. Raises InputError as the readers do."""
        volume = scene.open()
        volumes = [volume]
        for _ in STRIDES[1:]:
            last = volumes[-1]
            volumes.append(coarser(last) if last.samples.size > SMALL else last)
        content = cls(scene, tuple(volumes), scene.transfer_for(volume), scene.threshold)
        return replace(content, counts=tuple(len(content.skin(stride)) for stride in STRIDES))

    @property
    def volume(self) -> Volume:
        """The full-resolution volume."""
        return self.volumes[0]

    @property
    def spacing(self) -> float:
        """The finest volume's mean spacing, world units: the default unit length of opacities."""
        return Grid(self.volume.world_from_index, np.asarray(self.volume.origin)).mean_spacing

    @property
    def whole(self) -> bool:
        """Whether the finest splats are extracted."""
        return 1 in self.skins

    @property
    def heavy(self) -> bool:
        """Whether the finest splats would exceed MOST, estimated from stride 2."""
        return not self.whole and 8 * len(self.at(2)) > MOST

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
        return self.finest if len(self.finest) else self.volume

    def at(self, stride: int) -> Splats:
        """The splats at a stride; opacities are per the finest volume's spacing at every stride."""
        if stride > 1 and self.volumes[STRIDES.index(stride)] is self.volume:
            return self.at(1)
        if stride not in self.made:
            volume, transfer = self.volumes[STRIDES.index(stride)], self.transfer
            if stride > 1:
                transfer = replace(transfer, unit=transfer.unit or self.spacing)
            self.made[stride] = extract(volume, transfer, self.threshold)
        return self.made[stride]

    def skin(self, stride: int) -> Splats:
        """The splats at a stride without those hidden from every side."""
        if stride > 1 and self.volumes[STRIDES.index(stride)] is self.volume:
            return self.skin(1)
        if stride not in self.skins:
            self.skins[stride] = skinned(self.at(stride))
        return self.skins[stride]

    def changed(self, transfer: Transfer, threshold: float) -> Content:
        """A copy with another transfer function and no splats extracted yet."""
        counts = tuple(len(self.skins[s]) if s in self.skins else n for s, n in zip(STRIDES, self.counts, strict=True))
        return Content(self.scene, self.volumes, transfer, threshold, counts)

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


def _fov(camera: Camera) -> float:
    """Field of view in degrees; FOV for an orthographic camera."""
    return float(np.degrees(2 * np.arctan(camera.extent / 2))) if camera.perspective else FOV

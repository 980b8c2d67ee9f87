"""Input of a report: a scene with its camera, whose splats can be reduced; and the level of effort."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from splatgl.data.volume import Volume
from splatgl.splat.classification.transfer import Transfer
from splatgl.splat.extraction.splats import Splats
from splatgl.splat.plan.resolve import depth_range
from splatgl.splat.plan.settings import Settings
from splatgl.splat.view.camera import Camera
from splatgl.truth.report.methods import Method

# (threshold, number of 2× downsamplings) → splats
Build = Callable[[float, int], Splats]


@dataclass(frozen=True)
class Level:
    """Level of effort.

    size: pixels of an image's longer side. rounds: timings per method. splats: approximate maximum, beyond which
    the volume is downsampled; None: never. samples: of the sampled truth, along an axis of a pixel. rays, steps: of
    the ray integral, along an axis of a pixel and for each voxel. all_methods: those that are not quick, too.
    """

    name: str
    size: int
    rounds: int
    splats: int | None
    samples: int
    rays: int
    steps: int
    all_methods: bool


LEVELS = {
    "quick": Level("quick", 64, 5, 30_000, 16, 2, 2, False),
    "normal": Level("normal", 128, 7, 200_000, 16, 4, 2, True),
    "full": Level("full", 256, 11, None, 16, 4, 4, True),
}


@dataclass(frozen=True, eq=False)
class Subject:
    """A scene with its camera. note: its modifications, for the reader. content: input of peers, for volumes."""

    name: str
    camera: Camera
    settings: Settings
    build: Build
    note: str = ""
    content: tuple[Volume, Transfer] | None = None
    kept: dict[tuple[float, int], Splats] = field(default_factory=dict)

    def splats(self, threshold: float = 0.0, coarse: int = 0) -> Splats:
        """The splats above that threshold, of voxels downsampled that often; cached."""
        key = (threshold, coarse)
        if key not in self.kept:
            made = self.build(threshold, coarse)
            # a threshold that removes nothing changes nothing
            same = threshold > 0 and len(made) == len(self.splats(0.0, coarse))
            self.kept[key] = self.splats(0.0, coarse) if same else made
        return self.kept[key]

    def drawn(self, method: Method) -> tuple[Splats, Settings]:
        """Splats and settings of `method`. Raises InputError for what the scene does not allow."""
        settings = method.settings(self.settings, depth_range(self.splats(), self.camera))
        return self.splats(method.threshold, method.coarse), settings

    def mark(self) -> str:
        """Identifier of the scene: 16 hexadecimal digits of its splats and its camera."""
        splats, camera = self.splats(), self.camera
        found = hashlib.sha256(np.ascontiguousarray(splats.records).tobytes())
        for part in (splats.grid.world_from_index, splats.grid.origin, camera.eye, camera.eye_from_world):
            found.update(np.ascontiguousarray(part, dtype=np.float64).tobytes())
        found.update(repr((camera.size, camera.extent, camera.perspective, self.settings)).encode())
        return found.hexdigest()[:16]

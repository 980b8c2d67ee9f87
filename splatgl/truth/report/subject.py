"""Input of a report: a scene with its camera, whose splats can be reduced; and the level of effort."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from splatgl.data.scenes import Formula
from splatgl.data.volume import Volume
from splatgl.errors import InputError, expected
from splatgl.splat.camera import Camera
from splatgl.splat.extract import POST_KERNEL
from splatgl.splat.resolve import depth_range, kind
from splatgl.splat.settings import Settings
from splatgl.splat.splats import Splats
from splatgl.splat.transfer import Transfer
from splatgl.truth.report.methods import Method

# (threshold, number of 2× downsamplings, kernel of values that are classified after reconstruction, else "") → splats
Build = Callable[[float, int, str], Splats]


@dataclass(frozen=True)
class Level:
    """Level of effort.

    size: pixels of an image's longer side. rounds: timings per method. splats: approximate maximum, beyond which
    the volume is downsampled; None: never. samples: of the sampled truth, along an axis of a pixel. rays, steps: of
    the integrals along rays, along an axis of a pixel and for each voxel. all_methods: those that are not quick, too.
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
    """A scene with its camera. note: its modifications, for the reader. content: of peers and the field, for volumes.

    formula: of which the volume is samples, None if unknown. seconds: that extraction took, by the splats' `id`.
    """

    name: str
    camera: Camera
    settings: Settings
    build: Build
    note: str = ""
    content: tuple[Volume, Transfer] | None = None
    formula: Formula | None = None
    kept: dict[tuple[float, int, str], Splats] = field(default_factory=dict)
    seconds: dict[int, float] = field(default_factory=dict)

    def splats(self, threshold: float = 0.0, coarse: int = 0, post: str = "") -> Splats:
        """The splats above that threshold, of voxels downsampled that often; cached.

        post: kernel of values that are classified after reconstruction. Raises InputError as `extract`.
        """
        key = (threshold, coarse, post)
        if key not in self.kept:
            started = time.perf_counter()
            made = self.build(threshold, coarse, post)
            seconds = time.perf_counter() - started
            # a threshold that removes nothing changes nothing
            same = threshold > 0 and len(made) == len(self.splats(0.0, coarse))
            self.kept[key] = self.splats(0.0, coarse) if same else made
            self.seconds.setdefault(id(self.kept[key]), seconds)
        return self.kept[key]

    @property
    def no_field(self) -> str:
        """Why it is not a field that is classified by value; empty if it is."""
        if self.settings.blend != "composite":
            return str(expected("field", "blend composite", self.settings.blend))
        return self.only_pre

    @property
    def only_pre(self) -> str:
        """Why its values can't be classified after reconstruction; empty if they can."""
        try:
            if self.content is None:
                raise expected("field", "a volume", "splats alone")
            self.splats(post=POST_KERNEL)
        except InputError as error:
            return str(error)
        return ""

    def drawn(self, method: Method) -> tuple[Splats, Settings]:
        """Splats and settings of `method`. Raises InputError for what the scene does not allow."""
        settings = method.settings(self.settings, depth_range(self.splats(), self.camera))
        why = self.only_pre if settings.classification == "auto" else None
        kernel = kind(settings, moving=False, why=why, voxels=0)[1]
        return self.splats(method.threshold, method.coarse, kernel), settings

    def mark(self) -> str:
        """Identifier of the scene: 16 hexadecimal digits of its splats and its camera."""
        splats, camera = self.splats(), self.camera
        found = hashlib.sha256(np.ascontiguousarray(splats.records).tobytes())
        for part in (splats.grid.world_from_index, splats.grid.origin, camera.eye, camera.eye_from_world):
            found.update(np.ascontiguousarray(part, dtype=np.float64).tobytes())
        found.update(repr((camera.size, camera.extent, camera.perspective, self.settings)).encode())
        return found.hexdigest()[:16]

"""References of a scene, drawn once and cached."""

from __future__ import annotations

import hashlib
import io
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl import reference
from splatgl.data.image import Image
from splatgl.data.scenes import Formula
from splatgl.data.volume import Volume
from splatgl.errors import InputError, expected
from splatgl.fileio import write_file
from splatgl.reference.blend import pixel_means
from splatgl.reference.field import Field, field_integral
from splatgl.reference.ray_integral import ray_integral
from splatgl.splat.camera import Camera
from splatgl.splat.extract import POST_KERNEL
from splatgl.splat.resolve import depth_range, extraction_kind
from splatgl.splat.settings import Settings
from splatgl.splat.splats import Splats
from splatgl.splat.transfer import Transfer
from splatgl.studies.accuracy.methods import TRUTHS, Method

if TYPE_CHECKING:
    from splatgl.gl.renderer import Renderer

# (threshold, number of 2× downsamplings, kernel of values that are classified after reconstruction, else "") → splats
Build = Callable[[float, int, str], Splats]


@dataclass(frozen=True)
class Level:
    """Level of effort.

    size: pixels of an image's longer side. rounds: timings per method. splats: approximate maximum, beyond which
    the volume is downsampled; None: never. samples: of the sampled truth, per axis of a pixel. rays, steps: of
    integrals along rays, per axis of a pixel and per voxel. all_methods: whether it includes slow methods.
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
    """A scene with its camera. note: its modifications. content: volume and transfer function, for peers and the field.

    formula: sampled by the volume, None if unknown. cache: extracted splats. seconds: of extraction, by `id` of splats.
    """

    name: str
    camera: Camera
    settings: Settings
    build: Build
    note: str = ""
    content: tuple[Volume, Transfer] | None = None
    formula: Formula | None = None
    cache: dict[tuple[float, int, str], Splats] = field(default_factory=dict)
    seconds: dict[int, float] = field(default_factory=dict)

    def splats(self, threshold: float = 0.0, coarse: int = 0, post: str = "") -> Splats:
        """Splats above a threshold, of voxels downsampled `coarse` times; cached.

        post: kernel for classification after reconstruction, "" for before. Raises InputError as `extract`.
        """
        key = (threshold, coarse, post)
        if key not in self.cache:
            started = time.perf_counter()
            splats = self.build(threshold, coarse, post)
            seconds = time.perf_counter() - started
            # a threshold that removes nothing changes nothing
            same = threshold > 0 and len(splats) == len(self.splats(0.0, coarse))
            self.cache[key] = self.splats(0.0, coarse) if same else splats
            self.seconds.setdefault(id(self.cache[key]), seconds)
        return self.cache[key]

    @property
    def no_field(self) -> str:
        """Reason why the scene has no field classified by value; empty if it has one."""
        if self.settings.blend != "composite":
            return str(expected("field", "blend composite", self.settings.blend))
        return self.only_pre

    @property
    def only_pre(self) -> str:
        """Reason why values cannot be classified after reconstruction; empty if they can."""
        try:
            if self.content is None:
                raise expected("field", "a volume", "splats alone")
            self.splats(post=POST_KERNEL)
        except InputError as error:
            return str(error)
        return ""

    def inputs(self, method: Method) -> tuple[Splats, Settings]:
        """Splats and settings of a method. Raises InputError if the scene does not allow it."""
        settings = method.settings(self.settings, depth_range(self.splats(), self.camera))
        why = self.only_pre if settings.classification == "auto" else None
        kernel = extraction_kind(settings, moving=False, why=why, voxels=0)[1]
        return self.splats(method.threshold, method.coarse, kernel), settings

    def mark(self) -> str:
        """Identifier of the scene: 16 hexadecimal digits of a hash of splats and camera."""
        splats, camera = self.splats(), self.camera
        digest = hashlib.sha256(np.ascontiguousarray(splats.records).tobytes())
        for part in (splats.grid.world_from_index, splats.grid.origin, camera.eye, camera.eye_from_world):
            digest.update(np.ascontiguousarray(part, dtype=np.float64).tobytes())
        digest.update(repr((camera.size, camera.extent, camera.perspective, self.settings)).encode())
        return digest.hexdigest()[:16]


# settings of all splat truths, and of the reference alone
OPTICS = ("blend", "kernel", "shading", "background")
FILTERS = ("antialias", "samples", "attenuation")
# settings of the field, which has its own kernel
FIELD = ("blend", "shading", "background")
# tolerance of the sampled truth: nothing is omitted
TIGHT = 1e-9
# maximum samples of a reference: more would take minutes
MOST_SAMPLES = {"quick": 1 << 17, "normal": 1 << 19, "full": 1 << 21}

# key, kind and settings of a truth
Request = tuple[str, str, Settings]


class Truths:
    """Truths of one scene. folder: of cached files, or None."""

    def __init__(self, renderer: Renderer, subject: Subject, level: Level, folder: Path | None = None) -> None:
        self.renderer, self.subject, self.level, self.folder = renderer, subject, level, folder
        self.cache: dict[str, np.ndarray] = {}
        self.mark = subject.mark()

    def get(self, truth: str, settings: Settings) -> Image:
        """Truth of an image with those settings, float64 [H, W, 4].

        Raises InputError if there is none, or if it would take too long.
        """
        return Image(self.compute(*self.request(truth, settings)), {"blend": settings.blend})

    def request(self, truth: str, settings: Settings) -> Request:
        """Key, kind and settings of the truth of an image with those settings. Raises InputError as `get`."""
        if truth not in TRUTHS:
            raise expected("truth", " or ".join(TRUTHS), repr(truth))
        names = FIELD if truth == "field" else OPTICS + (FILTERS if truth == "reference" else ())
        values = {name: getattr(settings, name) for name in names}
        if settings.mixes_display:
            if truth != "reference":
                raise expected(f"truth {truth}", "a picture that mixes linear light", "one of display values")
            values["target"] = settings.target
        if truth == "reference":
            if settings.antialias != "supersample":
                values["samples"] = 1
            if settings.antialias == "auto":
                values["tolerance"] = settings.tolerance
            self._check(values)
            key = f"reference {values}"
        else:
            if truth in ("integral", "field") and settings.blend != "composite":
                raise expected("ray integral", "blend composite", settings.blend)
            if truth == "field" and self.subject.no_field:
                raise InputError(self.subject.no_field)
            key = f"{truth} {self.level.samples} {self.level.rays} {self.level.steps} {values}"
        return key, truth, Settings.like("0.1", **values)

    def _check(self, values: dict[str, Any]) -> None:
        width, height = self.subject.camera.size
        samples = width * height * values["samples"] ** 2
        if samples > MOST_SAMPLES[self.level.name]:
            raise expected(
                "float64 reference",
                f"at most {MOST_SAMPLES[self.level.name]:,} samples at this level",
                f"{samples:,}",
                "more would take too long: use --full or a smaller --size",
            )

    def compute(self, key: str, truth: str, settings: Settings) -> np.ndarray:
        """The truth of a `request`: cached, from the folder, or drawn."""
        if key not in self.cache:
            path = self.path(key)
            pixels = _read(path, (*self.subject.camera.size[::-1], 4)) if path else None
            if pixels is None:
                pixels = self._draw(truth, settings)
                self.write(key, pixels)
            self.cache[key] = pixels
        return self.cache[key]

    def path(self, key: str) -> Path | None:
        """File of a truth in the folder; None without a folder."""
        name = hashlib.sha256(f"{self.mark} {key}".encode()).hexdigest()[:16]
        return self.folder / f"{name}.npy" if self.folder else None

    def write(self, key: str, pixels: np.ndarray) -> None:
        """Writes a truth into the folder, if there is one."""
        path = self.path(key)
        if path is not None:
            buffer = io.BytesIO()
            np.save(buffer, pixels)
            write_file(path, buffer.getvalue())

    def _draw(self, truth: str, settings: Settings) -> np.ndarray:
        if truth == "field":
            return self._field(settings)
        splats, camera = self.subject.splats(), self.subject.camera
        if truth == "reference":
            return reference.render(splats, camera, settings).pixels
        if truth == "sampled":
            return self._sampled(settings, self.level.samples)
        # splatting's own error varies less than the image: measured at fewer samples and added
        rays = self.level.rays
        integral = ray_integral(splats, camera, settings, self.level.steps, rays).pixels
        sampled = self.get("sampled", settings).pixels
        return np.asarray(sampled + integral - self._sampled(settings, rays))

    def _field(self, settings: Settings) -> np.ndarray:
        """The field of the scene's formula, else of its samples."""
        assert self.subject.content is not None
        volume, transfer = self.subject.content
        if settings.shading != "auto":
            transfer = replace(transfer, shading=settings.shading == "on")
        (width, height), rays = self.subject.camera.size, self.level.rays
        fine = self.subject.camera.resized((width * rays, height * rays))
        field: Field | str = POST_KERNEL
        if self.subject.formula is not None:
            field = on_grid(self.subject.formula, volume)
        drawn = field_integral(volume, transfer, fine, field, self.level.steps)
        pixels = pixel_means(drawn.pixels, rays)
        if settings.ground is None:
            return pixels
        return np.asarray(pixels + (1 - pixels[..., 3:]) * np.array([*settings.ground, 1.0]))

    def _sampled(self, settings: Settings, samples: int) -> np.ndarray:
        exact = settings.but(
            antialias="supersample" if samples > 1 else "off",
            samples=samples,
            align="exact",
            tolerance=TIGHT,
            occlusion="off",
        )
        return self.renderer.render(self.subject.splats(), self.subject.camera, exact).pixels.astype(np.float64)


def on_grid(formula: Formula, volume: Volume) -> Field:
    """The formula as a function of grid positions."""
    world, origin = volume.world_from_index, np.asarray(volume.origin)[:, None]
    return lambda places: formula(world @ places + origin)


def _read(path: Path, shape: tuple[int, ...]) -> np.ndarray | None:
    """A cached truth, float64; None if missing or invalid."""
    try:
        pixels = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError):
        return None
    valid = isinstance(pixels, np.ndarray) and pixels.shape == shape and pixels.dtype == np.float64
    return pixels if valid else None

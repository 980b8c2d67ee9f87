"""Measures the error and the time of each method on a scene, against up to four truths."""

from __future__ import annotations

import math
import random
import statistics
import time
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl import reference
from splatgl.comparison.metrics import compare
from splatgl.data.image import Image
from splatgl.data.scenes import FORMULAS, Formula
from splatgl.data.volume import Volume, halve_volume
from splatgl.errors import InputError, expected
from splatgl.geometry.camera import Camera
from splatgl.planning.resolve import depth_range, extraction_kind
from splatgl.planning.scene import resolve_scene
from splatgl.reference.blend import pixel_means
from splatgl.reference.field import Field, field_integral, kept_field_integral, ray_integral_at
from splatgl.reference.renderer import render_pixels
from splatgl.report.methods import DEFAULT, TRUTHS, Method, axis_of, methods
from splatgl.scene.scene_file import SceneFile
from splatgl.splat.extract import POST_KERNEL, extract
from splatgl.splat.settings import Settings
from splatgl.splat.splats import Splats
from splatgl.transfer.transfer import Transfer

if TYPE_CHECKING:
    from splatgl.gl.renderer import Renderer

# progress callback, called once per step with its description
Tick = Callable[[str], None]


@dataclass(frozen=True)
class EffortLevel:
    """Level of effort.

    size: pixels of an image's longer side. rounds: timings per method. splats: approximate maximum, beyond which
    the volume is downsampled; None: never. samples: of the sampled truth, per axis of a pixel. rays, steps: of
    integrals along rays, per axis of a pixel and per voxel. most: samples of the reference, as more take minutes.
    all_methods: whether it includes slow methods. pixels: random ones that show matter, at which errors are measured;
    None: all. seconds: of a scene's measurements, after which further pictures and rounds are left out. names: its
    methods; (): all.
    """

    name: str
    size: int
    rounds: int
    splats: int | None
    samples: int
    rays: int
    steps: int
    most: int
    all_methods: bool
    pixels: int | None = None
    seconds: float = math.inf
    names: tuple[str, ...] = ()

    def methods(self, only: Sequence[str] = ()) -> list[Method]:
        """The methods that it measures. only: names of methods or axes, all if empty."""
        known = methods()
        if only:
            return [m for m in known.values() if m.name in only or axis_of(m.name).name in only]
        names = self.names or [name for name, method in known.items() if method.quick or self.all_methods]
        return [known[name] for name in names]


WHOLE = (
    *("default", "exact", "preview 1/2", "paper 1998", "no antialiasing", "2×2", "post b-spline", "sheets 3"),
    *("preview 1/4", "threshold 0.1"),
)
LEVELS = {
    "quick": EffortLevel("quick", 64, 5, 30_000, 16, 2, 2, 1 << 17, False),
    "normal": EffortLevel("normal", 128, 7, 200_000, 16, 4, 2, 1 << 19, True),
    "full": EffortLevel("full", 256, 11, None, 16, 4, 4, 1 << 21, True),
    # of the user's own data, at its full resolution
    "whole": EffortLevel("whole", 256, 5, None, 8, 3, 2, 1 << 19, True, 100, 30.0, WHOLE),
}


@dataclass(frozen=True, eq=False)
class ReportSubject:
    """A scene with its camera. note: its modifications. content: volume and transfer function, for the field; None:
    splats alone. build: (threshold, number of 2× downsamplings, kernel of values that are classified after
    reconstruction, else "") → splats. formula: sampled by the volume, None if unknown. cache: extracted splats.
    seconds: of extraction, by `id` of splats.
    """

    name: str
    camera: Camera
    settings: Settings
    build: Callable[[float, int, str], Splats]
    note: str = ""
    content: tuple[Volume, Transfer] | None = None
    formula: Formula | None = None
    cache: dict[tuple[float, int, str], Splats] = field(default_factory=dict)
    seconds: dict[int, float] = field(default_factory=dict)

    @classmethod
    def open(cls, source: str, level: EffortLevel) -> ReportSubject:
        """The scene of a source, downsampled to at most the level's number of splats. Raises InputError as `extract`,
        and for a scene without voxels.
        """
        scene = SceneFile.from_toml(Path(source)) if source.endswith(".toml") else SceneFile(source)
        scene.require_one_volume()
        volume = scene.open()
        transfer, scene = scene.transfer_for(volume), scene.cut(volume)
        splats = extract(volume, transfer, scene.threshold, classification="pre")
        if not len(splats):
            fix = "give a scene.toml with a transfer function"
            raise expected(source, "voxels that are not transparent", "none", fix)
        scale = level.size / max(scene.view.size)
        width, height = (max(1, round(side * scale)) for side in scene.view.size)
        camera = replace(scene.view, size=(width, height)).camera(volume, splats)
        formula = FORMULAS.get(scene.volume) if not scene.load else None
        halvings = 0
        # averaged voxels would not be samples of the formula
        while formula is None and level.splats is not None and len(splats) > level.splats and min(volume.shape) > 1:
            joint = halve_volume(volume, bool(transfer.labels))
            fewer = extract(joint, transfer, scene.threshold, classification="pre")
            # thin structures may vanish when averaged with empty voxels
            if not len(fewer):
                break
            volume, splats, halvings = joint, fewer, halvings + 1
        note = f"voxels joined {2**halvings}×{2**halvings}×{2**halvings}" if halvings else ""

        def build(threshold: float, coarse: int, post: str) -> Splats:
            part, least, how = volume, max(threshold, scene.threshold), "post" if post else "pre"
            for _ in range(coarse):
                part = halve_volume(part, bool(transfer.labels))
            return extract(part, transfer, least, classification=how, kernel=post)

        name = Path(source).name.split(".")[0]
        return cls(name, camera, scene.settings, build, note, (volume, transfer), formula)

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
        if not self.settings.hides:
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

    def draw(self, renderer: Renderer, method: Method) -> Image:
        """The picture of a method. Raises InputError if the scene does not allow it."""
        splats, settings = self.inputs(method)
        if method.row:
            return reference.render(splats, self.camera, settings, method.row)
        return renderer.render(splats, self.camera, settings)


# settings of all splat truths, and of the reference alone
OPTICS = ("blend", "kernel", "shading", "background")
FILTERS = ("antialias", "samples", "attenuation")
# settings of the field, which has its own kernel
FIELD = ("blend", "shading", "background")
# tolerance of the sampled truth: nothing is omitted
TIGHT = 1e-9


class Truths:
    """Truths of one scene, each drawn once."""

    def __init__(self, renderer: Renderer, subject: ReportSubject, level: EffortLevel) -> None:
        self.renderer, self.subject, self.level = renderer, subject, level
        self.cache: dict[tuple[str, Settings], np.ndarray] = {}

    @cached_property
    def places(self) -> np.ndarray:
        """Indices [N] of the pixels with truths, all of them, or random ones that show matter."""
        if self.level.pixels is None:
            return np.arange(np.prod(self.subject.camera.size))
        shown = self.subject.draw(self.renderer, methods()[DEFAULT]).pixels.reshape(-1, 4)
        values, counts = np.unique(shown, axis=0, return_counts=True)
        # the background is the most frequent pixel
        matter = np.flatnonzero((shown != values[counts.argmax()]).any(axis=1))
        random = np.random.default_rng(SEED)
        return np.sort(random.choice(matter, min(self.level.pixels, len(matter)), replace=False))

    def errors(self, image: Image, truth: str, settings: Settings) -> dict[str, float]:
        """Errors of a picture against a truth of those settings, as of `errors`. Raises InputError as `get`."""
        right = self.get(truth, settings)
        if self.level.pixels is None:
            return errors(image, right)
        return errors(replace(image, pixels=image.pixels.reshape(1, -1, 4)[:, self.places]), right)

    def get(self, truth: str, settings: Settings) -> Image:
        """Truth of an image with those settings, float64 [H, W, 4], or [1, N, 4] at some pixels.

        Raises InputError if there is none, or if it would take too long.
        """
        key = truth, self._settings(truth, settings)
        if key not in self.cache:
            self.cache[key] = self._draw(*key)
        return Image(self.cache[key], {"blend": settings.blend})

    def _settings(self, truth: str, settings: Settings) -> Settings:
        """Settings on which the truth depends. Raises InputError as `get`."""
        if truth not in TRUTHS:
            raise expected("truth", " or ".join(TRUTHS), repr(truth))
        names = FIELD if truth == "field" else OPTICS + (FILTERS if truth == "reference" else ())
        values: dict[str, Any] = {name: getattr(settings, name) for name in names}
        if settings.mixes_display:
            if truth != "reference":
                raise expected(f"truth {truth}", "a picture that mixes linear light", "one of display values")
            values["target"] = settings.target
        if truth == "reference":
            if settings.antialias != "supersample":
                values["samples"] = 1
            if settings.antialias == "auto":
                values["tolerance"] = settings.tolerance
            width, height = self.subject.camera.size
            samples, most = (self.level.pixels or width * height) * values["samples"] ** 2, self.level.most
            if samples > most:
                fix = "more would take too long: use --full or a smaller --size"
                raise expected("float64 reference", f"at most {most:,} samples at this level", f"{samples:,}", fix)
        elif truth in ("integral", "field"):
            settings.require_composite("ray integral")
        if truth == "field" and self.subject.no_field:
            raise InputError(self.subject.no_field)
        return Settings.like("0.1", **values)

    def _draw(self, truth: str, settings: Settings) -> np.ndarray:
        if truth == "field":
            return self._field(settings)
        splats, camera = self.subject.splats(), self.subject.camera
        if truth == "reference":
            return self._reference(settings)
        if truth == "sampled":
            return self._sampled(settings, self.level.samples)
        # splatting's own error varies less than the image: measured at fewer samples and added
        rays = self.level.rays
        integral = ray_integral_at(splats, camera, self.places, settings, self.level.steps, rays)
        sampled = self.get("sampled", settings).pixels
        return np.asarray(sampled + integral.reshape(sampled.shape) - self._sampled(settings, rays))

    def _reference(self, settings: Settings) -> np.ndarray:
        """The float64 reference of a picture with those settings."""
        splats, camera = self.subject.splats(), self.subject.camera
        if self.level.pixels is None:
            return reference.render(splats, camera, settings).pixels
        return render_pixels(resolve_scene(splats, camera, settings), self.places)[None]

    def _field(self, settings: Settings) -> np.ndarray:
        """The field of the scene's formula, else of its samples; drawn once for all backgrounds."""
        if settings.ground is not None:
            pixels = self.get("field", settings.replace(background=None)).pixels
            return np.asarray(pixels + (1 - pixels[..., 3:]) * np.array([*settings.ground, 1.0]))
        if self.level.pixels is not None and self.subject.formula is None:
            splats = self.subject.splats(post=POST_KERNEL)
            after = Settings(**{name: getattr(settings, name) for name in FIELD})
            return kept_field_integral(splats, self.subject.camera, self.places, self.level.rays, after)[None]
        assert self.subject.content is not None
        volume, transfer = self.subject.content
        if settings.shading != "auto":
            transfer = replace(transfer, shading=settings.shading == "on")
        (width, height), rays = self.subject.camera.size, self.level.rays
        fine = self.subject.camera.resized((width * rays, height * rays))
        field: Field | str = POST_KERNEL
        if (formula := self.subject.formula) is not None:
            world, origin = volume.world_from_index, np.asarray(volume.origin)[:, None]

            def field(places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
                return formula(world @ places + origin)

        drawn = field_integral(volume, transfer, fine, field, self.level.steps)
        return pixel_means(drawn.pixels, rays)

    def _sampled(self, settings: Settings, samples: int) -> np.ndarray:
        exact = settings.replace(
            antialias="supersample" if samples > 1 else "off",
            samples=samples,
            align="exact",
            tolerance=TIGHT,
            occlusion="off",
        )
        if self.level.pixels is not None:
            return self._reference(exact)
        return self.renderer.render(self.subject.splats(), self.subject.camera, exact).pixels.astype(np.float64)


@dataclass(frozen=True)
class Timing:
    """Seconds per frame of all rounds, float64 [N]."""

    rounds: tuple[float, ...]

    @property
    def median(self) -> float:
        """The median of all rounds."""
        return statistics.median(self.rounds)

    def over(self, other: Timing) -> Timing:
        """Ratio to the other's time, by round: load on the machine slows both in the same round."""
        return Timing(tuple(mine / theirs for mine, theirs in zip(self.rounds, other.rounds, strict=False)))


@dataclass(frozen=True)
class Point:
    """A method in the diagram of error against time."""

    name: str
    error: float
    time: Timing


def front(points: Sequence[Point]) -> list[Point]:
    """Pareto front, fastest first: points that are more accurate than all that are as fast or faster."""
    found: list[Point] = []
    for point in sorted(points, key=lambda p: (p.time.median, p.error)):
        if not found or point.error < found[-1].error:
            found.append(point)
    return found


@dataclass
class ResultRow:
    """One method on one scene. same_as: method of an equal picture. omitted: why it was not drawn. missing: why it has
    no error, by truth. errors: by truth and name, as of `errors`. bound: on the error of drawing. extraction: seconds.
    """

    method: str
    same_as: str = ""
    omitted: str = ""
    timing: Timing | None = None
    errors: dict[str, dict[str, float]] = field(default_factory=dict)
    missing: dict[str, str] = field(default_factory=dict)
    bound: float | None = None
    tolerance: float | None = None
    splats: int = 0
    extraction: float = 0.0

    def error(self, truth: str, name: str = "rmse") -> float | None:
        """Error of that name against that truth; None if not measured."""
        return self.errors.get(truth, {}).get(name)


@dataclass(frozen=True)
class SceneResults:
    """Rows of a scene, in the order of the registry."""

    subject: ReportSubject
    rows: list[ResultRow] = field(default_factory=list)

    def row(self, method: str) -> ResultRow | None:
        """Row of a method; None if there is none."""
        return next((row for row in self.rows if row.method == method), None)

    def point(self, method: str, truth: str) -> Point | None:
        """Error and time of a method; None if not measured."""
        row = self.row(method)
        error = row.error(truth) if row else None
        return Point(method, error, row.timing) if row and row.timing and error is not None else None

    def points(self, truth: str) -> list[Point]:
        """Methods with time and finite error, without those whose image is the same as another's."""
        found = (self.point(row.method, truth) for row in self.rows if not row.same_as)
        return [point for point in found if point is not None and np.isfinite(point.error)]

    def rivals(self, truth: str) -> list[Point]:
        """Points that compete for the front of that truth."""
        return [point for point in self.points(truth) if axis_of(point.name).competes(truth)]

    @property
    def truths(self) -> list[str]:
        """Truths with errors of any method."""
        return [truth for truth in TRUTHS if any(truth in row.errors for row in self.rows)]

    @property
    def deciding_truth(self) -> str:
        """The truth that includes most errors, of those that the default is measured against; "" for none."""
        return next((truth for truth in reversed(self.truths) if self.point(DEFAULT, truth) is not None), "")


def errors(image: Image, truth: Image) -> dict[str, float]:
    """Errors of `image` against `truth`, both [H, W, 4], by name. Raises InputError as `compare`.

    rmse: of the differences, over the root mean square of the truth. maximum: of any channel, relative to an X-ray's
    peak. share_over: of pixels off by more than 1/255. energy: (Σ − Σ_truth)/Σ_truth over all channels.
    """
    comparison, right = compare(image, truth), np.asarray(truth.pixels, np.float64)
    scale = float(np.sqrt((right * right).mean()))
    return {
        "rmse": comparison.rmse / scale if scale else comparison.rmse,
        "maximum": comparison.maximum / comparison.peak,
        "share_over": comparison.share_over,
        "energy": comparison.sum_error,
    }


# seed of the random order, fixed for all runs
SEED = 1998
# seconds in total after which a method is timed no more than LEAST_ROUNDS times
LONGEST, LEAST_ROUNDS = 20.0, 3
# a turn has as many frames as fit into TURN seconds, from 1 to FRAMES
TURN, FRAMES = 0.04, 5


class Sweep:
    """Draws, compares and times methods on a scene. results: what is measured so far."""

    def __init__(self, truths: Truths) -> None:
        self.truths, self.subject, self.renderer = truths, truths.subject, truths.renderer
        self.results = SceneResults(self.subject)
        self.plans: dict[tuple[Hashable, str, int], str] = {}
        self.started = time.perf_counter()

    @property
    def is_late(self) -> bool:
        """Whether the level's seconds are over."""
        return time.perf_counter() - self.started > self.truths.level.seconds

    def pictures(self, requested: Sequence[Method], tick: Tick) -> None:
        """Draws each method once, and measures its errors."""
        for method in requested:
            tick(f"{self.subject.name}: {method.name}")
            row = ResultRow(method.name)
            try:
                if self.is_late:
                    raise InputError(f"the {self.truths.level.seconds:g} seconds were over; --full measures all")
                self._picture(method, row)
            except InputError as error:
                row.omitted = str(error)
            self.results.rows.append(row)

    def _picture(self, method: Method, row: ResultRow) -> None:
        """Fills the row of a method. Raises InputError if the scene does not allow it."""
        splats, settings = self.subject.inputs(method)
        plan = self.renderer.plan(splats, self.subject.camera, settings)
        if not len(splats):
            raise InputError("no splat is left")
        # equal plans give equal images
        first = self.plans.setdefault((plan.key, method.row, id(splats)), method.name)
        row.same_as = "" if first == method.name else first
        if method.row:
            # refuses pictures that would take too long
            self.truths.get("reference", settings)
        image = self.subject.draw(self.renderer, method)
        row.splats, row.extraction = len(splats), self.subject.seconds[id(splats)]
        row.bound, row.tolerance = image.info.get("error_bound"), settings.tolerance  # type: ignore[assignment]
        for truth in axis_of(method.name).measured:
            # the scene says that it has no field
            if truth == "field" and self.subject.no_field:
                continue
            # few pixels are compared with the picture's own splats and with the field
            if self.truths.level.pixels and truth in ("sampled", "integral") and not self.subject.no_field:
                continue
            # an image classified after reconstruction has no truth of splats
            if truth != "field" and image.info.get("classification") == "post":
                continue
            try:
                row.errors[truth] = self.truths.errors(image, truth, settings)
            except InputError as error:
                row.missing[truth] = str(error)

    def times(self, rounds: int, tick: Tick) -> None:
        """Times every method with a distinct image once per round, in random order, of a turn after a warm-up frame.

        Load on the machine thus affects all methods alike, and they can be compared round by round.
        """
        named = methods()
        shown = [row.method for row in self.results.rows if not row.same_as and not row.omitted]
        drawn = [name for name in shown if not named[name].row]
        distinct: dict[str, list[float]] = {name: [] for name in drawn}
        shuffled = random.Random(SEED)
        try:
            for turn in range(rounds):
                for name in shuffled.sample(drawn, len(drawn)):
                    tick(f"{self.subject.name}: timing")
                    if turn and self.is_late:
                        return
                    if sum(distinct[name]) <= LONGEST or turn < LEAST_ROUNDS:
                        distinct[name].append(self.turn(named[name]))
        finally:
            for row in self.results.rows:
                seconds = distinct.get(row.same_as or row.method)
                row.timing = Timing(tuple(seconds)) if seconds else None

    def turn(self, method: Method) -> float:
        """Seconds per frame after a warm-up frame: median of a turn."""
        self.frame(method)
        first = self.frame(method)
        count = min(FRAMES, int(TURN / first))
        # an odd number, so that the median is a measured time
        return statistics.median([first, *(self.frame(method) for _ in range(2 * ((count - 1) // 2)))])

    def frame(self, method: Method) -> float:
        """Seconds of a frame with its pixels read back."""
        splats, settings = self.subject.inputs(method)
        started = time.perf_counter()
        self.renderer.render(splats, self.subject.camera, settings, verify_bound=False)
        return time.perf_counter() - started

"""Draws a scene: chooses the level of detail and bricks, compares with float64, and adds annotations."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain
from math import isfinite
from typing import TYPE_CHECKING, Any
from uuid import uuid4

import numpy as np

from splatgl.annotations.annotate import annotated, check_time, omission_notes, on_ground
from splatgl.annotations.canvas import AnnotationView
from splatgl.data.image import Image
from splatgl.errors import InputError, expected
from splatgl.fileio import budget, format_bytes, parse_bytes
from splatgl.opengl import OpenGL
from splatgl.options import LIMITED, HelpGroup, ValueKind, check_options, declared, no_effect, option
from splatgl.scene.open_scene import PATIENCE, OpenScene, channel_layers, print_lines, provenance_of
from splatgl.scene.slice_sheet import draw_slices
from splatgl.splat.settings import Settings

if TYPE_CHECKING:
    from distributed import Client

    from splatgl.distributed.workers import Drawing
    from splatgl.geometry.camera import Camera
    from splatgl.gl.renderer import Renderer
    from splatgl.planning.scene import Scene
    from splatgl.splat.splats import Splats


def read_amount(text: str) -> int | float:
    """The number of pixels, or seconds, a float, of a text such as 160 or 0.5s. Raises ValueError for others."""
    amount = float(text[:-1]) if text.endswith("s") else int(text)
    if not (isfinite(amount) and amount >= 0):
        raise ValueError
    return amount


_accuracy = partial(option, group=HelpGroup.ACCURACY)
_speed = partial(option, group=HelpGroup.SPEED)
_workers = partial(option, group=HelpGroup.WORKERS)


def bytes_kind(least: int, such_as: str) -> ValueKind:
    """A number of bytes, or a size in text."""
    return ValueKind(
        "a number of bytes",
        lambda value: parse_bytes(value) if isinstance(value, str) else ValueKind.whole(least).check(value),
        parse_bytes,
        "SIZE",
        written=f"a number of bytes, such as {such_as}",
        hint="int | str",
    )


@dataclass(frozen=True)
class DrawOptions:
    """Drawing options of one process. is_shared: use the shared renderer. held: one that stays open. early: the
    renderer that `open_early` opens, None where that fails. memory: bytes.
    """

    opengl: OpenGL = OpenGL()
    is_shared: bool = False
    held: Renderer | None = None
    early: Future[Renderer | None] | None = None
    memory: int | None = _speed(
        None,
        bytes_kind(0, "4GiB or 500MB"),
        "draw volumes that need more memory in bricks, such as 4GiB (default: half of the free memory)",
    )
    check: int | float | None = _accuracy(
        None,
        ValueKind(
            "a number of pixels, or seconds such as 0.5s",
            lambda value: read_amount(str(value) + "s" * isinstance(value, float)),
            read_amount,
            "PIXELS|SECONDSs",
            written="a number of pixels, or seconds such as 0.5s",
            hint="int | float | str",
        ),
        "verify this number of random pixels against float64, or for a time such as 0.5s (0: none; default: 60, of "
        "large volumes 10, with --field or without a bound)",
    )
    check_field: bool = _accuracy(
        False,
        ValueKind.flag(),
        "also compare some pixels with the volume rendering integral",
        flag="--field",
        bare=True,
    )
    explain: bool = _accuracy(False, ValueKind.flag(), "print what is rendered, what is skipped, and why", bare=True)
    savings: bool = _speed(False, ValueKind.flag(), "also measure the time saved by each skipped step", bare=True)

    def __post_init__(self) -> None:
        check_options(self)

    def renderer(self) -> AbstractContextManager[Renderer]:
        """The renderer for one picture."""
        if self.held is not None:
            return nullcontext(self.held)
        from splatgl.gl.renderer import open_renderer, shared_renderer

        early = self.early.result() if self.early else None
        return shared_renderer() if self.is_shared else early or open_renderer(self.opengl)

    @contextmanager
    def open_early(self) -> Iterator[DrawOptions]:
        """These options, whose renderer a thread opens meanwhile, where a context may change its thread: of EGL."""
        if self.is_shared or self.held or not self.opengl.may_be_egl:
            yield self
            return

        def opened() -> Renderer | None:
            from splatgl.gl.backends import switch_to
            from splatgl.gl.renderer import open_renderer

            try:
                return open_renderer(replace(self.opengl, backend="egl"))
            except InputError:
                # `renderer` tries again, also other backends, and tells why none opens
                return None
            finally:
                switch_to(None)

        with ThreadPoolExecutor(1) as pool:
            early = pool.submit(opened)
            try:
                yield replace(self, early=early)
            finally:
                if early.exception() is None and (renderer := early.result()):
                    renderer.close()

    def check_supported(self, kind: str, need: str, got: str, fix: str = "") -> None:
        """Raises InputError for options that a kind of picture does not support. need: the kind that does."""
        for name in UNSUPPORTED[kind]:
            if getattr(self, name):
                raise expected(declared(DrawOptions)[name].flag or f"--{name}", need, got, fix)


_whole = ValueKind.whole(0)
_DEVICES = ValueKind(
    "whole numbers",
    lambda value: tuple(map(_whole.check, value)),
    lambda text: tuple(_whole.check(int(part)) for part in text.split(",")),
    "N,…",
    hint="Sequence[int]",
)


@dataclass(frozen=True)
class WorkerOptions:
    """Processes that draw, of this machine or of a scheduler of Dask."""

    workers: int | None = _workers(None, ValueKind.whole(1, 1024), "draw in N processes of this machine")
    scheduler: str | None = _workers(
        None,
        ValueKind.instance("an address", str, metavar="ADDRESS"),
        "draw with the workers of a Dask scheduler, tcp://…:8786",
    )
    devices: Sequence[int] = _workers((), _DEVICES, "EGL devices of the workers, in turn")
    opengl: OpenGL = OpenGL()

    def __post_init__(self) -> None:
        check_options(self, "--")
        if self.workers is not None and self.scheduler is not None:
            raise expected("--workers", "either it or --scheduler", "both")
        if self.devices and self.opengl.device is not None:
            raise expected("--devices", "either it or --device", "both")
        if self.devices and not self.are_used:
            raise expected("--devices", "--workers or --scheduler with it", "neither")

    @property
    def are_used(self) -> bool:
        """Whether workers draw."""
        return self.workers is not None or self.scheduler is not None

    @property
    def drawing(self) -> Drawing:
        """OpenGL options of the workers."""
        from splatgl.distributed.workers import Drawing

        return Drawing(**vars(self.opengl), devices=tuple(self.devices))

    def connected(self, tell: Callable[[str], None] | None = print) -> AbstractContextManager[Client]:
        """A client of the workers; tell: as of `distributed.connected`."""
        from splatgl.distributed.workers import connected

        return connected(self.workers, self.scheduler, tell)


# options that pictures in bricks and on workers do not support
UNSUPPORTED = {
    "bricks": ("check_field", "savings"),
    "workers": ("check_field", "savings", "explain"),
}


@dataclass(frozen=True, eq=False)
class SubjectView:
    """Splats or layers without a file, with the camera and settings of their picture. info: further provenance. notes:
    beside those of the renderer, of which only notes on limits and on `typed` options stay, None: all.
    """

    subject: Splats | Scene
    camera: Camera
    settings: Settings
    info: Mapping[str, object] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    typed: Collection[str] | None = None

    def finished(self, image: Image) -> Image:
        """The picture with its provenance and notes."""
        info = {**image.info, **self.info}
        if self.typed is not None:
            typed = {*self.typed}
            kept = [
                note
                for note in image.notes
                if note.endswith(LIMITED) or typed.intersection(note.partition(":")[0].split(", "))
            ]
            info["notes"] = (*self.notes, *kept)
        return replace(image, info=info)


def draw(scene: OpenScene | SubjectView, how: DrawOptions) -> Image:
    """Draws a scene in this process, with its provenance and annotations."""
    if isinstance(scene, SubjectView):
        return scene.finished(_picture(scene, how))
    check_time(scene.names)
    if scene.file.slices:
        return finish(*draw_slices(scene), scene)
    scene.check()
    level, info, notes = scene, dict[str, object](), list[str]()
    if scene.is_single and scene.volume.coarser:
        level, info = _choose_level(scene, how)
    image = _picture(level, how)
    if not _shows(image):
        # a step of a series may be empty
        if scene.file.look is None:
            raise level.nothing_visible()
        notes.append(f"the picture is empty: {level.nothing_visible()}")
    is_whole = scene.is_single and "bricks" not in image.info
    if how.memory is not None and is_whole and (scene.file.threshold or level.splats.post is None):
        why = "bricks need values classified after reconstruction, without a threshold"
        notes += no_effect(["memory"], why)
    return finish(replace(image, info={**image.info, **info}).with_notes(notes), None, scene)


def draw_on_workers(scene: OpenScene, how: DrawOptions, by: WorkerOptions) -> Image:
    """As `draw`, in parts on workers of Dask. Raises InputError for scenes that workers do not draw."""
    from splatgl.distributed.render import WorkerJob, draw_parts
    from splatgl.splat.kernels import require_built_in

    how.check_supported("workers", "a picture rendered by this process", "--workers or --scheduler")
    file, settings, this = scene.file, scene.settings, "none, with --workers or --scheduler"
    require_built_in(settings.kernel)
    # refuses options of channels beside a single one
    count = len(channel_layers(file, scene.volume, scene.transfer))
    file.require_one_volume(this, "")
    unsupported = {
        "--ambient-occlusion": settings.ambient_occlusion,
        "--shadows": settings.shadows,
        "--threshold": file.threshold,
        "channels": count if count > 1 else 0,
        "visible": "" if file.visible else "false",
    }
    for name, value in unsupported.items():
        if value:
            raise expected(name, this, value, "--channel picks one" if name == "channels" else "")
    opened = file.with_absolute_paths().open
    job = WorkerJob(uuid4().hex, opened, scene.transfer, settings, by.drawing, scene.camera, how.memory)
    with by.connected(None if scene.is_quiet else print) as client, progress_bar("part", scene.is_quiet) as progress:
        image = draw_parts(client, job, None, progress, how.check)
    if not _shows(image):
        raise scene.nothing_visible()
    return finish(image, None, scene)


def finish(image: Image, view: AnnotationView | None, scene: OpenScene) -> Image:
    """Adds the provenance and the annotations of its scene to a picture; prints the notes on it, and why annotations
    are left out. view: that annotations show, None: the scene's.
    """
    told = scene.scene.notes if not scene.is_single else ()
    notes = [note for note in image.notes if note not in told]
    about = provenance_of(scene.file, scene.transfer, scene.transfer.length(scene.volume))
    image = replace(image, info={**image.info, **about, **scene.file.view.paper}).with_notes(scene.volume.notes)
    if scene.file.annotate:
        view = view or AnnotationView(scene.annotated_subject, scene.legend[1], scene.camera)
        color = scene.file.settings.ground
        image = on_ground(annotated(image, view.subject, view.transfer, view.camera, scene.names, color), color)
        notes += omission_notes(image)
    print_lines(notes, scene.is_quiet)
    return image


def _choose_level(scene: OpenScene, how: DrawOptions) -> tuple[OpenScene, dict[str, object]]:
    """Chooses the level of a multiscale volume; returns the scene of that level, and its provenance."""
    from splatgl.gl.large_volumes import choose_level, coarsest_fine_level

    camera, arguments = scene.camera, (scene.volume, scene.transfer, scene.camera, scene.settings)
    if coarsest_fine_level(scene.volume, camera) == 0:
        level = choose_level(*arguments)
    else:
        with how.renderer() as renderer:
            level = choose_level(*arguments, renderer)
        if not scene.is_quiet:
            print(level)
    return replace(scene, volume=level.volume, fixed_camera=camera), level.info


def _drawn_in_bricks(scene: OpenScene, how: DrawOptions) -> Image | None:
    """Draws brick by brick a picture that needs more than --memory, or more splats than one pass holds; None for
    others. Layers of a blend without an order are drawn apart, and their pictures joined.
    """
    from splatgl.planning.bricks import excess_need

    camera, most, parts = scene.camera, budget(), scene.parts
    needs = (excess_need(bricks, bricks.samples(camera, settings), most) for bricks, settings in parts)
    need = next(filter(None, needs), None)
    if need is None:
        return None
    fix = "give more --memory, or a part of the volume"
    how.check_supported("bricks", f"a picture that fits into {format_bytes(most)}", format_bytes(need.bytes), fix)
    images = []
    with how.renderer() as renderer, progress_bar("brick", scene.is_quiet) as progress:
        for whole, settings in parts:
            # refuses what bricks cannot draw, before memory that is too little for it
            plan = renderer.plan_bricks(whole, camera, settings)
            bricks, bands = whole.fitted(camera, settings, most)
            if not scene.is_quiet:
                reason = f"{need}, together more than {format_bytes(most)}"
                if need.bytes <= most:
                    reason = f"up to about {need.most:,} splats exceed the limit of one pass"
                name = f"{whole.volume.name}: " * (len(parts) > 1)
                print(f"{name}{reason}: drawn in {len(bricks.low):,} bricks, nearest first")
            images.append(renderer.draw_bricks(bricks, camera, plan, progress, bands=bands))
    return images[0] if len(images) < 2 else _join(images, [bricks.volume.name for bricks, _ in parts], scene.settings)


def _join(images: Sequence[Image], names: Sequence[str], settings: Settings) -> Image:
    """The picture of layers that are drawn in bricks, each apart. settings: of all."""
    from splatgl.planning.scene import join_pictures

    pixels, plans = join_pictures([image.pixels for image in images], settings), [image.plan for image in images]
    infos: list[Mapping[str, Any]] = [image.info for image in images]
    info = {**infos[0], "scene": " + ".join(names), "layers": list(names)}
    info["background"] = None if settings.ground is None else list(settings.ground)
    for name in ("splats", "bricks", "seconds", "unmasked"):
        info[name] = sum(each[name] for each in infos)
    drawn = tuple(chain.from_iterable(plan.resolved.bricks for plan in plans))
    resolved = replace(plans[0].resolved, settings=settings, bricks=drawn)
    plan = replace(plans[0], layers=tuple(plan.first for plan in plans), resolved=resolved)
    return Image(pixels, info, drawn=pixels, plan=plan)


def _picture(scene: OpenScene | SubjectView, how: DrawOptions) -> Image:
    """The picture of a scene without annotations, compared with float64 as --check and --field ask, without them on
    demand, with --check 0 never; prints the output of --explain and --savings.
    """
    from splatgl.gl.renderer import measure_savings
    from splatgl.planning.scene import plan_scene
    from splatgl.reference.check import check_input, compare

    image, limits = None, tuple[str, ...]()
    if isinstance(scene, OpenScene):
        image = _drawn_in_bricks(scene, how)
        scene = scene if scene.parts else scene.within_limits()
        limits = scene.limits
    if image is None:
        with how.open_early() as opening:
            # while OpenGL opens
            subject = scene.subject
            with opening.renderer() as renderer:
                plan = plan_scene(subject, scene.camera, scene.settings, tiles=renderer.tiles)
                # before work on a picture that cannot be compared or measured
                if how.check_field:
                    check_input(plan.resolved, how.check, how.check_field)
                if how.savings and not plan.resolved.is_single:
                    raise expected("--savings", "a picture of one volume", "layers or meshes")
                image = renderer.draw(plan).with_notes(limits)
                if how.savings:
                    print("\n".join(measure_savings(renderer, plan.first)))
    if how.explain:
        print(image.plan.explain())
    if not _shows(image):
        return image
    if how.check == 0 and not how.check_field:
        image = replace(image, drawn=None)
    elif how.check is not None or how.check_field:
        image = compare(image, how.check, how.check_field)
    if how.explain:
        image = image.with_accuracy()
        print(f"{replace(image, drawn=None).accuracy}, against the float64 reference of the same splats")
    return image


def _shows(image: Image) -> bool:
    """Whether there are splats or meshes in a picture."""
    return bool(image.info["splats"] or image.info.get("triangles"))


def depths_of(scene: OpenScene | SubjectView, at: float | str | None) -> np.ndarray:
    """Depths float64 [H, W] of a scene. at: share of absorbed light, max or min; None: ½, or the value of the blend.
    Raises InputError for splats.
    """
    from splatgl.planning.scene import Scene
    from splatgl.reference.depth_pick import depths

    if isinstance(scene, SubjectView):
        subject, settings = scene.subject, scene.settings
    else:
        # the planes of the settings are the scene's
        subject, settings = scene.scene, replace(scene.file.settings, clip=())
    if not isinstance(subject, Scene):
        raise expected("depths", "a volume, an array, a file or a scene", "splats")
    return depths(subject, scene.camera, at, settings)


# seconds between two lines of progress, and the share that is done or the seconds after which there is another
LINES_APART, SHARE, MOST_APART = 10.0, 0.1, 60.0


@contextmanager
def progress_bar(unit: str, is_quiet: bool, alike: bool = False) -> Iterator[Callable[[int, int], None]]:
    """A function that takes the number of units done and of all, and prints to stderr how many are done: by a bar
    on a terminal if tqdm is installed, else by lines. alike: units follow each other and take as long as the first,
    whose time is printed if all take longer than PATIENCE.
    """
    if is_quiet:
        yield lambda done, total: None
        return
    with terminal_bar(desc="drawing", unit=unit, delay=PATIENCE) as bar:
        lines = ProgressLines(unit, alike)

        def show(done: int, total: int) -> None:
            print_lines(lines.after(done, total, bar is None))
            if bar is not None:
                bar.total = total
                bar.update(done - bar.n)

        yield show


def terminal_bar(is_quiet: bool = False, **options: Any) -> AbstractContextManager[Any]:
    """A bar of tqdm with these options; a context of None without tqdm, and if stderr is no terminal."""
    if is_quiet or not (sys.stderr and sys.stderr.isatty()):
        return nullcontext()
    try:
        from tqdm import tqdm
    except ImportError:
        return nullcontext()
    return tqdm(**options, leave=False)


class ProgressLines:
    """Text on the progress of units, which begin now. alike: as of `progress_bar`. clock: seconds."""

    def __init__(self, unit: str, alike: bool, clock: Callable[[], float] = time.monotonic) -> None:
        self.unit, self.alike, self.clock = unit, alike, clock
        self.begun = self.latest = clock()
        self.done = 0

    def after(self, done: int, total: int, is_logged: bool) -> list[str]:
        """The lines to print once `done` units of `total` are done. is_logged: whether there is no bar."""
        now = self.clock()
        passed, lines = now - self.begun, list[str]()
        if self.alike and done == 1 < total and passed * total > PATIENCE:
            # with programs that were compiled for it
            most = duration(passed * total)
            lines.append(f"the first {self.unit} took {passed:.1f} s: {total} take up to about {most}")
            self.latest = now
        apart = now - self.latest
        is_due = (done - self.done) >= SHARE * total or apart >= MOST_APART
        if is_logged and 1 < done < total and apart >= LINES_APART and is_due:
            left = duration(passed / done * (total - done))
            lines.append(f"{done} of {total} {self.unit}s drawn, about {left} left")
            self.latest, self.done = now, done
        return lines


def duration(seconds: float) -> str:
    """A length of time in words, such as "40 s" or "2 h 05 min"."""
    minutes = round(seconds / 60)
    if seconds < 100:
        return f"{max(seconds, 1):.0f} s"
    return f"{minutes} min" if minutes < 100 else f"{minutes // 60} h {minutes % 60:02d} min"

"""`Animation`: frames of a turntable, of keyframes or of a time series, drawn here or on workers of Dask."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby
from operator import index
from pathlib import Path
from string import Formatter
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.animation.camera_track import CameraTrack, TurntableTrack, keyframes, turning
from splatgl.animation.movie import finish_behind, open_series, read_ahead
from splatgl.annotations.annotate import annotated, check_time, on_ground
from splatgl.annotations.canvas import AnnotatedSubject
from splatgl.data.image import KEYWORD, Image, provenance
from splatgl.distributed.workers import Drawing, keep_latest, renderer, spread
from splatgl.errors import expected
from splatgl.fileio import budget, check_output, format_bytes, shorten_name
from splatgl.geometry.camera import Bounded, Camera
from splatgl.geometry.grid import Grid
from splatgl.options import HelpGroup, ValueKind, check_options, non_default, option
from splatgl.planning.bricks import Bricks, excess_bricks, required_bricks
from splatgl.planning.culling import order_for
from splatgl.planning.resolve import has_streaks
from splatgl.planning.scene import Scene, moments_per_frame
from splatgl.scene.open_scene import SMALL, OpenScene, print_lines, provenance_of, without_background
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.view import FIT_ALL, FIT_OF_0_3
from splatgl.splat.motion import Motion, flow_of
from splatgl.splat.settings import Settings
from splatgl.splat.splats import Splats
from splatgl.transfer.transfer import Transfer

if TYPE_CHECKING:
    from distributed import Client

    from splatgl.geometry.clipping import Plane
    from splatgl.gl.renderer import Renderer


FULL_TURN = 360.0
# default number of frames per turn
FRAMES = 120
# probe cameras for the maximum of X-ray sums
PROBES = 6
# relative difference in scale of two frames that is not reported
ALIKE = 0.005
# frames sampled to determine the sort axes
LOOKS = 64


# most degrees or time units per frame; beyond it sines lose all precision
MAX_PACE = 1e9
MAX_FRAMES = 1_000_000


def _read_span(text: str) -> tuple[int, int]:
    first, _, last = text.partition("-")
    if not (first.isdecimal() and (last or first).isdecimal() and int(first) <= int(last or first)):
        raise ValueError
    return int(first), int(last or first)


def _check_span(value: Any) -> tuple[int, int]:
    first, last = map(index, value)
    if not 0 <= first <= last:
        raise ValueError
    return first, last


_option = partial(option, group=HelpGroup.ANIMATION)
_COUNT = ValueKind.whole(1, MAX_FRAMES)
_pace = partial(ValueKind.number, f"a number from {-MAX_PACE:g} to {MAX_PACE:g}", -MAX_PACE, MAX_PACE)


@dataclass(frozen=True)
class Timeline:
    """Options of an animation: its frames, and the motion of the camera and the volume."""

    frames: int | None = _option(None, _COUNT, f"number of frames of the whole animation (default {FRAMES})")
    only: tuple[int, int] | None = _option(
        None,
        ValueKind("two frames", _check_span, _read_span, "A-B", written="A-B, such as 10-19", hint="tuple[int, int]"),
        "draw only frames A to B, counted from 0",
    )
    turntable: float | None = _option(
        None, _pace(metavar="DEG"), f"total angle of a camera that orbits the volume (default {FULL_TURN:g})"
    )
    spin: float | None = _option(None, _pace(metavar="DEG"), "rotation of the volume per frame")
    axis: tuple[float, float, float] | None = _option(
        None, ValueKind.numbers(3, "X,Y,Z"), "axis of rotation through the centre (default: up)"
    )
    keyframes: str | Mapping[str, Any] | None = _option(
        None,
        replace(
            ValueKind.instance("the name of a file", str, Mapping, metavar="FILE.toml"), hint="str | Mapping[str, Any]"
        ),
        "views of some frames; the frames between are interpolated",
    )
    hold: int = _option(1, _COUNT, "frames for each volume of a series (default 1)")
    flow: float | None = _option(
        None, _pace(metavar="F"), "motion blur along the vectors of the volume, F times their length per frame"
    )
    draft: bool = _option(
        False,
        ValueKind.flag(),
        "draw faster. One sample a pixel, to a tolerance of 8/255; voxels narrower than a pixel are averaged over "
        "2×2×2",
        bare=True,
    )

    def __post_init__(self) -> None:
        check_options(self)
        given = [f"--{name}" for name in ("turntable", "spin", "keyframes") if getattr(self, name) is not None]
        if len(given) > 1:
            raise expected("animate", "one of --turntable, --spin and --keyframes", " and ".join(given))

    def degrees(self, count: int, series: bool) -> float:
        """Rotation of the volume per frame in degrees; --turntable rotates it the other way."""
        if self.spin is not None:
            return self.spin
        if self.turntable is None and series:
            return 0.0
        return -(FULL_TURN if self.turntable is None else self.turntable) / count


@dataclass(frozen=True, eq=False)
class Animation:
    """Frames of one volume or of a series. job: the volumes, and how they are drawn. mark: a digest of sources,
    rendering options and cameras. numbers: the frames to render, of `count`; each volume is shown for `hold` frames.
    only: the subject of a single volume.
    """

    job: FrameJob
    mark: str
    track: CameraTrack
    count: int
    numbers: range
    hold: int = 1
    only: FrameSubject | None = None

    @classmethod
    def of(
        cls, scenes: list[SceneFile], timeline: Timeline, time: float | str | slice | None, bits: int, is_quiet: bool
    ) -> Animation:
        """The animation of scenes, whose view is that of the first volume. time: as of `time_points`."""
        if len(scenes) > 1 and isinstance(time, slice):
            raise expected("--time", "one time point of each file", "several", "animate one file, or name one point")
        names, flow = scenes[0].annotate, timeline.flow
        if scenes[0].slices:
            raise expected("--slice", "none in movies", scenes[0].slices[0], "--slice-plane shows it in space")
        scenes, scene = open_series(scenes, time, is_quiet)
        settings, view = _sharp_unless_asked(scene.file.settings, timeline), scene.file.view
        settings = settings.draft if timeline.draft else settings
        if flow is not None and settings.motion == "off" and settings.moments is None:
            raise expected("--flow", "--motion or --moments with it, which blur", "motion off", "add --motion exact")
        # a turn is fitted to the part that a still is fitted to
        part, view, series = view.part, replace(view, part=None), len(scenes) if len(scenes) > 1 else 0
        same: dict[str, Any] = {"settings": settings, "view": view, "scissors": scene.file.scissors}
        same |= {"world": scene.volume.world, "clip": None, "crop": "", "annotate": ()}
        # opacities of all volumes refer to one length
        transfer = scene.transfer.on(scene.volume)
        unit = {"unit": transfer.unit} if series and scene.volume.points is None else {}
        scenes = [replace(x, **same).with_transfer(unit) for x in scenes]
        moving = settings.shutter > 0
        scene = replace(scene, file=scenes[0], transfer=transfer, is_quiet=is_quiet, is_moving=moving)
        bands = _bands(scene, flow) if scene.is_single else 0
        if len(scenes) == 1:
            check_time(names)
        # what is visible at one time is not at others; version 0.3 fitted layers of a series to its first step
        is_whole = series and (scene.is_single or view.fit != FIT_OF_0_3)
        fitted = part or (replace(view, fit=FIT_ALL).framed(scene.volume, scene.fitted) if is_whole else scene.fitted)
        track, count = _track(scene, fitted, timeline, series)
        halvings = _halvings(scene, track, count) if timeline.draft and flow is None else 0
        scene = replace(scene, halvings=halvings) if halvings else scene
        only = None if bands or (series and scene.is_single) else _subject(scene, flow, bool(series))
        first, last = timeline.only or (0, count - 1)
        if last >= count:
            raise expected("--only", f"frames from 0 to {count - 1}", f"{first}-{last}")
        times = tuple(map(scene.volume.time_text, range(scene.volume.times))) if scene.volume.times > 1 else ()
        over = FrameAnnotations(names, scene.annotated_subject, scene.legend[1], times) if names else None
        draft = halvings if timeline.draft else None
        job, only = FrameJob(scenes, settings, flow, bits, bands, over, draft=draft), None if series else only
        mark = _mark_of(job, transfer, track, count, timeline.hold)
        if only is not None and flow is None and isinstance(track, TurntableTrack):
            steady = settings.moments or _steady(only, settings, track, count)
            job = replace(job, settings=replace(settings, moments=steady))
        return cls(job, mark, track, count, range(first, last + 1), timeline.hold, only)

    def shown(self, frame: int) -> int:
        """Index of the volume shown in a frame; a series repeats."""
        return frame // self.hold % len(self.job.scenes)

    def drawn_here(
        self, renderer: Renderer, frames: FrameFiles, todo: Sequence[int], explain: bool
    ) -> Iterator[tuple[int, bytes, list[str]]]:
        """Yields the number, file and notes of frames; the next volume is read meanwhile. explain: prints the first
        one's plan.
        """
        job, only = self.job, self.only
        read = job.subject if only is None or job.flow is not None else lambda _: only
        if self.job.settings.is_sum:
            job = replace(job, top=job.brightest(renderer, self.probes, read))
        groups = [(number, list(group)) for number, group in groupby(todo, self.shown)]
        subjects = read_ahead(read, [number for number, _ in groups])
        self._sort(todo)
        views = (
            (subject, self.view(n)) for (_, group), (_, subject) in zip(groups, subjects, strict=True) for n in group
        )
        return finish_behind(
            job.frame(renderer, frames, subject, view, explain and view.frame == todo[0]) for subject, view in views
        )

    def drawn_on_workers(
        self, client: Client, frames: FrameFiles, todo: Sequence[int], drawing: Drawing
    ) -> Iterator[tuple[int, bytes, list[str]]]:
        """Yields the number, file and notes of frames that workers draw, which open the files."""
        job = replace(self.job, scenes=[scene.with_absolute_paths() for scene in self.job.scenes])
        if self.job.settings.is_sum:
            ((_, top),) = spread(client, _brightest, [("the brightest frame", (job, drawing, self.probes))])
            job = replace(job, top=top)
        items = ((f"frame {n}", (job, drawing, frames, self.view(n))) for n in todo)
        return (frame for _, frame in spread(client, _frame, items))

    def view(self, frame: int) -> FrameView:
        """The number, volume, camera and motion of a frame."""
        return FrameView(frame, self.shown(frame), self.track.camera(frame), self.track.motion(frame))

    @property
    def probes(self) -> list[tuple[int, Camera]]:
        """Volumes and cameras that represent all frames, whichever frames are rendered now."""
        cameras = [self.track.camera(n) for n in np.linspace(0, self.count - 1, PROBES)]
        last = len(self.job.scenes)
        return [(n, camera) for n in sorted({0, last // 2, last - 1}) for camera in cameras]

    def _sort(self, todo: Sequence[int]) -> None:
        """Sorts the splats of a single volume along all axes that frames need: memory use does not grow later."""
        splats = self.only.content if self.only is not None else None
        if not isinstance(splats, Splats) or not self.job.settings.hides:
            return
        some = todo[:: max(len(todo) // LOOKS, 1)]
        for axis in {order_for(splats, self.track.camera(n)).axis for n in some}:
            splats.lattice(axis)


def _steady(only: FrameSubject, settings: Settings, track: TurntableTrack, count: int) -> int | None:
    """Number of moments per frame of a rotation: that of the fastest frame."""
    assert not isinstance(only.content, Bricks)
    cameras = [track.camera(n) for n in np.linspace(0, count - 1, LOOKS)]
    return max(moments_per_frame(only.content, camera, settings, track.turn) for camera in cameras) or None


def _mark_of(job: FrameJob, transfer: Transfer, track: CameraTrack, count: int, hold: int) -> str:
    """Digest of sources, rendering options and cameras, which identifies the frames of an animation. transfer: of its
    first volume.
    """
    first, paths = job.scenes[0], [Path(file.volume) for file in job.scenes]
    sizes = [path.stat().st_size if path.is_file() else 0 for path in paths]
    files = [(file.volume, size, file.load) for file, size in zip(job.scenes, sizes, strict=True)]
    cameras = [track.camera(n) for n in {0, count // 2, count - 1}]
    views = [(c.eye.tolist(), c.eye_from_world.tolist(), c.size, c.extent, c.perspective) for c in cameras]
    surfaces = () if first.surfaces is None else (first.surfaces,)
    added = *first.layers, *first.meshes, *non_default(first.vectors).items(), *surfaces, *first.slice_planes
    drawn = first.settings, first.threshold, transfer.to_toml(), first.look, *added, *(first.mask or ())
    names = job.annotations.names if job.annotations else ()
    parts = files, drawn, views, count, hold, job.flow, job.bits, *names
    return hashlib.sha256("\n".join(map(repr, parts)).encode()).hexdigest()[:DIGITS]


def _sharp_unless_asked(settings: Settings, timeline: Timeline) -> Settings:
    """The settings of frames: motion auto blurs along a flow, or if moments or another shutter are asked for."""
    asked = timeline.flow is not None or {"moments", "shutter"} & set(settings.given)
    return settings if settings.motion != "auto" or asked else settings.replace(motion="off")


def _subject(scene: OpenScene, flow: float | None, is_step: bool) -> FrameSubject:
    """The subject of frames of one volume. Raises InputError if nothing is visible, unless it is a step of a series."""
    if not scene.is_single:
        if flow is not None:
            raise expected("--flow", "a scene of one volume", "layers, channels or meshes")
        scene = scene.within_limits()
        print_lines(scene.limits, scene.is_quiet)
    if not (is_step or scene.has_matter):
        raise scene.nothing_visible()
    return FrameSubject(scene.subject, scene.settings.clip, scene.transfer)


def _halvings(scene: OpenScene, track: CameraTrack, count: int) -> int:
    """How often the voxels of a draft are halved: until they are wider than a pixel in the middle of every frame, or
    few.
    """
    volume, cameras = scene.volume, [track.camera(n) for n in np.linspace(0, count - 1, PROBES)]
    depths = [max(float(camera.eye_from_points(volume.center)[2]), 0.0) for camera in cameras]
    pixel = min(float(camera.pixel_pitch(depth)) for camera, depth in zip(cameras, depths, strict=True))
    voxel, halvings = Grid.of(volume).smallest_spacing, 0
    while volume.points is None and voxel * 2**halvings <= pixel and volume.count > SMALL * 8**halvings:
        halvings += 1
    return halvings


def _track(scene: OpenScene, subject: Bounded, timeline: Timeline, series: int) -> tuple[CameraTrack, int]:
    """The camera track, and the number of frames. series: number of volumes, if there are several."""
    view, volume = scene.file.view, scene.volume
    count = timeline.frames or (series * timeline.hold if series else FRAMES)
    if timeline.keyframes:
        track = keyframes(timeline.keyframes, view, volume, subject)
        if not scene.is_quiet:
            _tell_size(track.camera(0), replace(track, subject=subject).camera(0), subject, series > 1)
        return track, timeline.frames or track.last + 1
    axis = None if timeline.axis is None else np.array(timeline.axis)
    turns = turning(view, volume, subject, timeline.degrees(count, series > 1), axis)
    if not scene.is_quiet:
        still = view.camera(volume, scene.fitted if series else subject)
        _tell_size(turns.camera(0), still, subject, series > 1)
    return turns, count


def _tell_size(camera: Camera, still: Camera, subject: Bounded, series: bool) -> None:
    """Prints the scale of frame 0 if it differs from that of `render`, and the reason."""
    there, here = (view.pixel_pitch(view.eye_from_points(subject.corners)[:, 2].mean()) for view in (still, camera))
    ratio = float(there) / float(here) if here > 0 else 1.0
    if abs(ratio - 1) > ALIKE:
        whole = "the whole of each volume of the series" if series else "the whole turn"
        note = f"the camera fits {whole}: frame 0 is {ratio:.3g} times as large as the picture of render"
        print_lines([f"{note}; --zoom changes it"])


def _bands(scene: OpenScene, flow: float | None) -> int:
    """Number of bands of rows for a volume that is drawn in bricks, as it does not fit into memory; 0: it fits.

    Raises InputError for motion blur that needs all splats at once.
    """
    file, most = scene.file, budget()
    excess = excess_bricks(scene.volume, scene.transfer, file.settings, file.view.size, file.threshold)
    if excess is None or most <= 0:
        return 0
    bricks, need = excess
    if flow is not None or has_streaks(file.settings):
        if need.bytes <= most:
            return 0
        fix = "leave the flow and the motion out, or choose a coarser --level"
        raise expected(file.volume, f"a volume that fits into {format_bytes(most)}", format_bytes(need.bytes), fix)
    return need.fitted(bricks, most)[1]


# factor of the brightest pixel of some X-rays, for brighter frames between them
HEADROOM = 1.05


@dataclass(frozen=True, eq=False)
class FrameSubject:
    """The subject of frames of one volume: splats, layers, or a volume in bricks. clip: planes of the settings; layers
    have their own planes. transfer: of the first layer. flow: velocities of splats.
    """

    content: Splats | Scene | Bricks
    clip: tuple[Plane, ...]
    transfer: Transfer
    flow: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class FrameView:
    """Number, volume and camera of a frame, and its motion since the previous frame."""

    frame: int
    volume: int
    camera: Camera
    motion: Motion


@dataclass(frozen=True, eq=False)
class FrameAnnotations:
    """Annotations of all frames. names, subject, transfer: as of `annotated`. times: of the file's time points."""

    names: tuple[str, ...]
    subject: AnnotatedSubject
    transfer: Transfer
    times: tuple[str, ...]

    def at(self, point: int | str) -> tuple[str, ...]:
        """The annotations of a frame of a time point, by its number or its time."""
        time = f"time={self.times[point] if isinstance(point, int) and point < len(self.times) else point}"
        return tuple(time if name == "time" else name for name in self.names)


@dataclass(frozen=True, eq=False)
class FrameJob:
    """Data that all frames share, without splats: each process extracts them. scenes: one for each volume, in the look
    of the series. settings: with the moments of all frames. flow: displacement along vectors per frame, for motion blur
    alone. bands: number of bands of rows of volumes that are drawn in bricks; 0: whole. top: common scale of X-rays.
    draft: how often its voxels are halved; None: no draft.
    """

    scenes: list[SceneFile]
    settings: Settings
    flow: float | None = None
    bits: int = 8
    bands: int = 0
    annotations: FrameAnnotations | None = None
    top: float | None = None
    draft: int | None = None

    def subject(self, number: int) -> FrameSubject:
        """Reads the subject of frames of one volume."""
        file = self.scenes[number]
        opened = OpenScene.of(file, file.open())
        volume, transfer = opened.volume, opened.transfer.on(opened.volume)
        if self.bands:
            return FrameSubject(required_bricks(volume, transfer, self.settings), self.settings.clip, transfer)
        scene = replace(opened, transfer=transfer, is_moving=file.settings.shutter > 0, halvings=self.draft or 0)
        flow = flow_of(scene.splats, volume, self.flow) if self.flow is not None and scene.is_single else None
        return FrameSubject(scene.subject, scene.settings.clip, transfer, flow)

    def _render(
        self,
        renderer: Renderer,
        subject: FrameSubject,
        camera: Camera,
        settings: Settings,
        motion: Motion | None = None,
    ) -> Image:
        """The picture of a frame, with motion blur as the settings say."""
        if isinstance(subject.content, Bricks):
            from splatgl.gl.large_volumes import render_moving_bricks

            return render_moving_bricks(renderer, subject.content, camera, settings, motion, self.bands)
        settings = replace(settings, clip=subject.clip)
        return renderer.render(subject.content, camera, settings, motion, verify_bound=self.draft is None)

    def frame(
        self, renderer: Renderer, frames: FrameFiles, subject: FrameSubject, view: FrameView, explain: bool
    ) -> Callable[[], tuple[int, bytes, list[str]]]:
        """Draws a frame. Returns a function for any thread that returns its number, its file, and notes on settings
        that do not change it. explain: prints its plan.
        """
        over, content = self.annotations, subject.content
        settings = without_background(self.settings, over.names if over else ())
        motion = view.motion if subject.flow is None else view.motion and replace(view.motion, flow=subject.flow)
        image = self._render(renderer, subject, view.camera, settings, motion)
        if explain:
            print(image.plan.explain())
        # those on its layers are printed where they are read; the parts of a picture in bricks do not know what moves
        is_whole, told = not isinstance(content, Bricks), getattr(content, "notes", ())
        notes = [note for note in image.notes if is_whole and note not in told]
        # the plan would keep the splats of a series
        drawn = Image(image.pixels, image.info)
        encode = partial(self._encoded, frames, subject.transfer, view, drawn)
        return lambda: (view.frame, encode(), notes)

    def _encoded(self, frames: FrameFiles, transfer: Transfer, view: FrameView, image: Image) -> bytes:
        """The file of a frame, with its annotations and provenance. image: as it was drawn."""
        over, ground = self.annotations, self.settings.ground
        if self.top is not None and frames.path(view.frame).suffix.lower() == ".png":
            image = scale_xray(image, self.top)
        scene = self.scenes[view.volume]
        about = provenance_of(scene, transfer, transfer.unit)
        about |= {"voxels_averaged": 8**self.draft} if self.draft else {}
        image = Image(image.pixels, {**image.info, **about})
        if over is not None:
            names = over.at(scene.load.get("time", view.volume))
            image = on_ground(annotated(image, over.subject, over.transfer, view.camera, names, ground, True), ground)
        return frames.encoded(view.frame, image, self.bits)

    def brightest(
        self, renderer: Renderer, probes: Sequence[tuple[int, Camera]], read: Callable[[int], FrameSubject]
    ) -> float:
        """Common scale of all X-ray frames, from still pictures of probes. read: returns a volume's subject."""
        top, still, latest = 0.0, self.scenes[0].settings, -1
        for number, camera in probes:
            if number != latest:
                subject, latest = read(number), number
            top = max(top, float(self._render(renderer, subject, camera, still).pixels.max()))
        return top * HEADROOM or 1.0


def scale_xray(image: Image, top: float) -> Image:
    """Scales an X-ray for display, so that saving does not normalize it by its maximum."""
    info = {**image.info, "blend": "xray over scale", "scale": 1 / top}
    if isinstance(error := info.get("error_bound"), float):
        info["error_bound"] = error / top
    return Image(image.pixels / np.float32(top), info)


MOVIES = (".mp4", ".webm", ".gif")
PICTURES = (".png", ".npy")
# hexadecimal digits of the digest that identifies an animation
DIGITS = 16
# format of a frame number: with or without a number of digits
DIGITED = re.compile("(0?[1-9][0-9]?)?d?")


@dataclass(frozen=True)
class FrameFiles:
    """Output paths. template: a path with {frame}; mark: the animation's digest, stored in each PNG's text.

    movie: the movie file to write, or None.
    """

    template: str
    mark: str
    movie: Path | None = None

    @classmethod
    def at(cls, output: str, mark: str) -> FrameFiles:
        """Paths for an --output: a template, or the name of a movie, whose frames are stored in a folder next to it.

        Raises InputError for other names, and if frames cannot be written. The first frame creates the folder.
        """
        path = Path(output)
        if path.suffix.lower() in MOVIES:
            check_output(path, MOVIES)
            folder = path.with_name(f"{shorten_name(path.name)}.frames")
            frames = cls(str(folder / "{frame:06d}.png"), mark, path)
        else:
            _check_template(output)
            folder = path.parent
            frames = cls(output, mark)
        if "{" in str(folder):
            raise expected(output, "{ } in the file's name alone", "some in a folder's or a movie's name")
        check_output(frames.path(0), PICTURES)
        return frames

    def path(self, frame: int) -> Path:
        """The file of frame number `frame`."""
        return Path(self.template.format(frame=frame))

    def encoded(self, frame: int, image: Image, bits: int) -> bytes:
        """The frame's file, with the animation's mark."""
        info = {**image.info, "frame": frame, "animation": self.mark}
        return Image(image.pixels, info).encoded(self.path(frame), bits)

    def done(self, frame: int) -> bool:
        """Whether the frame exists. Raises InputError for a frame of another animation."""
        path = self.path(frame)
        if not path.exists():
            return False
        if not self.is_own(path):
            raise expected(path, "a frame of this animation", "another picture", "leave out --resume to draw over it")
        return True

    def is_own(self, path: Path) -> bool:
        """Whether a file that exists is a frame of this animation, as far as it can be known."""
        return path.suffix.lower() == ".npy" or _mark(path) == self.mark

    def sweep(self, numbers: Sequence[int]) -> None:
        """Removes temporary files of these frames that a killed run left."""
        names = {f".{shorten_name(self.path(n).name)}" for n in numbers}
        # a temporary file is named .<frame file>.<random letters>
        for path in self.path(0).parent.glob(".*"):
            if path.name.rpartition(".")[0] in names and path.is_file():
                path.unlink(missing_ok=True)

    def clear(self, numbers: Sequence[int]) -> None:
        """Removes these frames after writing the movie, and their folder if it is empty."""
        for n in numbers:
            self.path(n).unlink(missing_ok=True)
        folder = self.path(0).parent
        if not any(folder.iterdir()):
            folder.rmdir()


def _check_template(text: str) -> None:
    """Raises InputError for a template that does not name each frame uniquely."""
    try:
        fields = [tuple(rest) for _, *rest in Formatter().parse(text) if rest[0] is not None]
    except ValueError:
        fields = []
    if not fields or any(name != "frame" or form or not DIGITED.fullmatch(spec or "") for name, spec, form in fields):
        fix = "such as frames/{frame:04d}.png, or a name that ends in .mp4, .webm or .gif"
        raise expected(text, "a name with {frame} in it", "another", fix)


def _mark(path: Path) -> object:
    """The mark in a PNG's text; None if there is none."""
    from PIL import Image as Pillow

    try:
        with Pillow.open(path) as picture:
            return provenance(getattr(picture, "text", {}).get(KEYWORD, "")).get("animation")
    except (OSError, ValueError, SyntaxError):
        return None


def _frame(job: FrameJob, drawing: Drawing, frames: FrameFiles, view: FrameView) -> tuple[int, bytes, list[str]]:
    """On a worker: a frame's number, its file and notes."""
    subject = keep_latest((frames.mark, view.volume), lambda: job.subject(view.volume))
    return job.frame(renderer(drawing), frames, subject, view, explain=False)()


def _brightest(job: FrameJob, drawing: Drawing, probes: list[tuple[int, Camera]]) -> float:
    """On a worker: the common scale of X-ray frames."""
    return job.brightest(renderer(drawing), probes, job.subject)

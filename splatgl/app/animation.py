"""An animation: its volumes, camera track and frames, and rendering them in sequence."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.annotations.canvas import Scale, Subject
from splatgl.app.frame_work import FrameView, Matter, Over, Work
from splatgl.app.frames import Frames, mark_of
from splatgl.app.series import read_ahead, time_points, volumes
from splatgl.app.track import Track, Turning, keyframes, turning
from splatgl.errors import expected
from splatgl.fileio import budget, size_of
from splatgl.scene.draw import PATIENCE, check_fits, is_layered, layered, nothing, of_movie, room, tell
from splatgl.scene.meshes import is_mesh
from splatgl.scene.scene_file import Scene
from splatgl.scene.view import backed
from splatgl.splat.bricks import bricks_of, fits
from splatgl.splat.camera import Bounded, Camera
from splatgl.splat.motion import moments
from splatgl.splat.opaque_bounds import Opaque
from splatgl.splat.ordering import order_for
from splatgl.splat.resolve import blur, streaked
from splatgl.splat.scene import Scene as Layers
from splatgl.splat.settings import BLENDS
from splatgl.splat.splats import Splats
from splatgl.splat.transfer import Transfer

if TYPE_CHECKING:
    from splatgl.data.volume import Volume
    from splatgl.gl.renderer import Renderer

FULL_TURN = 360.0
# default number of frames per turn
FRAMES = 120
# probe cameras for the maximum of X-ray sums
PROBES = 6
# share by which a frame may show things larger than another without a word
ALIKE = 0.005
# frames sampled to determine the sort axes
LOOKS = 64


@dataclass(frozen=True, eq=False)
class Animation:
    """scenes: one per volume, with a common transfer function. numbers: the frames to render, of `count`; each volume
    of a series is shown for `hold` frames. flow: displacement of splats along the volume's vectors per frame, for
    motion blur only. only: what frames of a single volume show. bands: of rows, in which volumes are drawn in bricks;
    0: whole.
    """

    scenes: list[Scene]
    transfer: Transfer
    track: Track
    count: int
    numbers: range
    hold: int = 1
    flow: float | None = None
    bits: int = 8
    only: Splats | Layers | None = None
    bands: int = 0
    over: Over | None = None

    @classmethod
    def of(cls, scene: Scene, args: argparse.Namespace) -> Animation:
        """The animation of a scene and of the files in `args.more`. Reads the first volume, whose transfer function and
        placement apply to all.
        """
        scenes = volumes(scene, args.more)
        if len(scenes) > 1 and isinstance(args.time, slice):
            raise expected("--time", "one time point of each file", "several", "animate one file, or name one point")
        scene = scenes[0]
        volume = scene.open()
        if len(scenes) == 1:
            scenes = time_points(scene, volume, args.time)
            if scenes[0] is not scene:
                scene = scenes[0]
                volume = replace(scene.open(), notes=())
        tell(volume, args.quiet, channels=is_layered(scene, volume))
        transfer, cut = scene.transfer_for(volume), scene.cut(volume)
        settings = backed(args, cut, transfer, Path(args.output)).settings
        scenes = [replace(each, settings=settings, view=cut.view, clip=None, crop="") for each in scenes]
        scene = scenes[0]
        series = len(scenes) > 1
        joined = is_layered(scene, volume)
        bands = 0 if joined else _bands(volume, transfer, scene, args.flow)
        only = None if bands or (series and not joined) else _matter(scene, volume, transfer, args)
        values = bands or (isinstance(only, Splats) and only.post is not None)
        subject: Bounded = Opaque(volume, transfer) if values else only or volume
        scales = Scale.of(only.meshes) if isinstance(only, Layers) else ()
        only = None if series else only
        asked = of_movie(args.annotate, scenes)
        subject = room(volume) if "box" in asked else subject
        count = args.frames or (len(scenes) * args.hold if series else FRAMES)
        if args.keyframes:
            found = keyframes(Path(args.keyframes), scene.view, volume, subject)
            track: Track = found
            count = args.frames or found.last + 1
        else:
            axis = None if args.axis is None else np.array(args.axis)
            track = turning(scene.view, volume, subject, _degrees(args, count, series), axis)
            if not args.quiet:
                still = scene.view.camera(volume, Opaque(volume, transfer) if series and not joined else subject)
                _tell_size(track.camera(0), still, subject, series)
        first, last = args.only or (0, count - 1)
        if last >= count:
            raise expected("--only", f"frames from 0 to {count - 1}", f"{first}-{last}")
        numbers = range(first, last + 1)
        told = replace(Subject.of(volume), scales=scales, empty=is_mesh(scene.volume))
        over = Over(asked, told, volume.time_step) if asked else None
        settings = scene.settings
        if args.flow is not None and settings.motion == "off" and settings.moments is None:
            raise expected("--flow", "--motion or --moments beside it, which blur", "motion off", "add --motion exact")
        return cls(scenes, transfer, track, count, numbers, args.hold, args.flow, args.bits, only, bands, over)

    def shown(self, frame: int) -> int:
        """Index of the volume shown in a frame; a series repeats."""
        return frame // self.hold % len(self.scenes)

    @property
    def mark(self) -> str:
        """Digest that identifies the animation's frames: sources, rendering options and cameras."""
        sizes = [Path(s.volume).stat().st_size if Path(s.volume).is_file() else 0 for s in self.scenes]
        files = [(s.volume, size, s.load) for s, size in zip(self.scenes, sizes, strict=True)]
        cameras = [self.track.camera(n) for n in {0, self.count // 2, self.count - 1}]
        views = [(c.eye.tolist(), c.eye_from_world.tolist(), c.size, c.extent, c.perspective) for c in cameras]
        first = self.scenes[0]
        drawn = (
            first.settings,
            first.threshold,
            self.transfer.to_toml(),
            *first.layers,
            *first.meshes,
            *first.vectors.told.items(),
            *([] if first.surfaces is None else [first.surfaces]),
            *(first.mask or ()),
        )
        told = self.over.names if self.over else ()
        return mark_of(files, drawn, views, self.count, self.hold, self.flow, self.bits, *told)

    def draw(self, renderer: Renderer, frames: Frames, todo: Sequence[int], quiet: bool) -> None:
        """Renders and saves the frames; the next volume of a series is read in parallel."""
        work = self.work(frames)
        read = partial(self._read, work)
        if self.unbounded:
            work = replace(work, top=work.brightest(renderer, self.probes, read))
        groups = [(number, list(group)) for number, group in groupby(todo, self.shown)]
        self._sort(todo)
        with bar(len(todo), quiet) as progress:
            for (_, group), (_, matter) in zip(groups, read_ahead(read, [number for number, _ in groups]), strict=True):
                for n in group:
                    frames.write(n, work.frame(renderer, matter, self.view(n)))
                    progress.update()

    def work(self, frames: Frames) -> Work:
        """What all frames have in common, but for the scale of X-ray frames."""
        settings = self.scenes[0].settings
        settings = settings.but(moments=settings.moments or self.steady)
        return Work(
            self.scenes, self.transfer, settings, frames, self.flow, self.bits, bands=self.bands, over=self.over
        )

    def view(self, frame: int) -> FrameView:
        """Where a frame is seen from."""
        return FrameView(frame, self.shown(frame), self.track.camera(frame), self.track.motion(frame))

    @property
    def unbounded(self) -> bool:
        """Whether frames are sums, which share a scale."""
        return BLENDS[self.scenes[0].settings.blend].unbounded

    @property
    def probes(self) -> list[tuple[int, Camera]]:
        """Volumes and cameras that stand for all frames, independent of which are rendered now."""
        cameras = [self.track.camera(n) for n in np.linspace(0, self.count - 1, PROBES)]
        return [(n, each) for n in sorted({0, len(self.scenes) // 2, len(self.scenes) - 1}) for each in cameras]

    def _sort(self, todo: Sequence[int]) -> None:
        """Sorts a single volume's splats along every axis needed by any frame, before the first frame, so that memory
        use does not grow afterwards.
        """
        if not isinstance(self.only, Splats) or not BLENDS[self.scenes[0].settings.blend].ordered:
            return
        some = todo[:: max(len(todo) // LOOKS, 1)]
        for axis in {order_for(self.only, self.track.camera(n)).axis for n in some}:
            self.only.lattice(axis)

    def _read(self, work: Work, number: int) -> Matter:
        """The splats of one volume, and their velocities."""
        return (self.only, None) if self.only is not None and self.flow is None else work.matter(number)

    @property
    def steady(self) -> int | None:
        """Moments per frame of a rotation: those of the fastest frame. None where more than the angle changes, and for
        other kinds of motion blur.
        """
        settings = self.scenes[0].settings
        if self.only is None or self.flow is not None or not isinstance(self.track, Turning):
            return None
        turn, cameras = self.track.turn, [self.track.camera(n) for n in np.linspace(0, self.count - 1, LOOKS)]
        if isinstance(self.only, Layers):
            return max(self.only.moments(camera, settings, turn) for camera in cameras)
        if blur(self.only, settings) != "moments" or settings.shutter == 0:
            return None
        return max(moments(self.only, camera, turn, settings.shutter) for camera in cameras)


def _matter(scene: Scene, volume: Volume, transfer: Transfer, args: argparse.Namespace) -> Splats | Layers:
    """What frames of one volume show. InputError where that is nothing."""
    if not is_layered(scene, volume):
        only = scene.splats(volume, transfer, moving=scene.settings.shutter > 0)
        if not len(only):
            raise nothing(scene, volume)
        return only
    if args.flow is not None:
        raise expected("--flow", "a scene of one volume", "layers, channels or meshes")
    drawn = layered(scene, volume, transfer, args.quiet)
    check_fits(scene, drawn)
    if not (drawn.meshes or any(map(len, drawn.splats(scene.settings)))):
        raise nothing(scene, volume)
    return drawn


def _tell_size(camera: Camera, still: Camera, subject: Bounded, series: bool) -> None:
    """Prints how large frame 0 shows things if `render` shows them larger or smaller, and why."""
    there, here = (one.pixel_pitch(one.eye_from_points(subject.corners)[:, 2].mean()) for one in (still, camera))
    ratio = float(there) / float(here) if here > 0 else 1.0
    if abs(ratio - 1) > ALIKE:
        whole = "the whole of each volume of the series" if series else "the whole turn"
        told = f"the camera fits {whole}: frame 0 shows all {ratio:.3g} times as large as render does"
        print(f"splatgl: {told}; --zoom changes it", file=sys.stderr)


def _degrees(args: argparse.Namespace, count: int, series: bool) -> float:
    """Rotation of the volume per frame in degrees; an orbiting camera is a volume that rotates the other way."""
    if args.spin is not None:
        return float(args.spin)
    if args.turntable is None and series:
        return 0.0
    return -float(args.turntable if args.turntable is not None else FULL_TURN) / count


class NoBar:
    """A progress bar that is not shown."""

    def update(self) -> None:
        """Does nothing."""


def bar(total: int, quiet: bool) -> Any:
    """Progress bar over frames with remaining time, if tqdm is installed and stderr is a terminal."""
    if quiet or not sys.stderr.isatty():
        return nullcontext(NoBar())
    try:
        from tqdm import tqdm
    except ImportError:
        return nullcontext(NoBar())
    return tqdm(total=total, desc="drawing", unit="frame", delay=PATIENCE, leave=False)


def _bands(volume: Volume, transfer: Transfer, scene: Scene, flow: float | None) -> int:
    """In how many bands of rows a volume is drawn in bricks that does not fit into memory; 0: it does. InputError for
    what takes all splats at once.
    """
    bricks = None if scene.threshold else bricks_of(volume, transfer, scene.settings)
    most = budget()
    wanted = fits(bricks, scene.view.size, most) if bricks and most > 0 else None
    if wanted is None:
        return 0
    if flow is not None or streaked(scene.settings):
        if wanted.bytes <= most:
            return 0
        fix = "leave the flow and the motion out, or choose a coarser --level"
        raise expected(scene.volume, f"a volume that fits into {size_of(most)}", size_of(wanted.bytes), fix)
    return wanted.bands(most)

"""An animation: the volumes, the camera's track and the frames; and drawing them one after the other."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.app.frames import Frames, mark_of
from splatgl.app.options import scene_from
from splatgl.app.render import PATIENCE, nothing, origin
from splatgl.app.scene import Scene
from splatgl.app.series import read_ahead, volumes
from splatgl.app.track import Track, Turning, keyframes, turning
from splatgl.data.errors import expected
from splatgl.data.image import Image
from splatgl.data.volume import Volume
from splatgl.gl.renderer import Renderer
from splatgl.splat.classification.transfer import Transfer
from splatgl.splat.extraction.extract import extract
from splatgl.splat.extraction.order import order_for
from splatgl.splat.extraction.splats import Splats
from splatgl.splat.motion.blur import MOTIONS
from splatgl.splat.motion.motion import flow_of
from splatgl.splat.plan.blend_mode import BLENDS
from splatgl.splat.plan.settings import Settings
from splatgl.truth.temporal import Moments, Shorter, moments

FULL_TURN = 360.0
# frames of one turn if nothing else is asked for
FRAMES = 120
# cameras from which a volume is drawn to find how bright X-ray sums get, and what is left above them
PROBES, HEADROOM = 6, 1.05

# frames that are looked at to know the axes
LOOKS = 64

# splats, and the velocities of each where they flow
Matter = tuple[Splats, np.ndarray | None]


@dataclass(frozen=True, eq=False)
class Animation:
    """scenes: one a volume, read with one transfer function. numbers: the frames wanted, of `count`; a volume of a
    series is shown for `hold` of them. streaked: each picture is blurred, as the settings say, over its part of the
    exposure. moments: how many pictures a frame is the mean of, None: as many as it takes.
    flow: by how much splats move along the volume's vectors a frame, for blur alone.
    """

    scenes: list[Scene]
    transfer: Transfer
    track: Track
    count: int
    numbers: range
    hold: int = 1
    streaked: bool = True
    moments: int | None = 1
    flow: float | None = None
    bits: int = 8
    only: Splats | None = None

    @classmethod
    def of(cls, args: argparse.Namespace) -> Animation:
        """Reads the first volume: its transfer function and its place are the whole series'."""
        scenes = volumes(scene_from(args), args.more)
        scene = scenes[0]
        volume = scene.open()
        transfer = scene.transfer_for(volume)
        series = len(scenes) > 1
        only = None if series else _splats(scene, volume, transfer)
        subject = only or volume
        count = args.frames or (len(scenes) * args.hold if series else FRAMES)
        if args.keyframes:
            found = keyframes(Path(args.keyframes), scene.view, volume, subject)
            track: Track = found
            count = args.frames or found.last + 1
        else:
            axis = None if args.axis is None else np.array(args.axis)
            track = turning(scene.view, volume, subject, _degrees(args, count, series), axis)
        first, last = args.only or (0, count - 1)
        if last >= count:
            raise expected("--only", f"frames from 0 to {count - 1}", f"{first}-{last}")
        numbers = range(first, last + 1)
        if args.flow is not None and args.moments is None and scene.settings.motion == "off":
            raise expected("--flow", "--motion or --moments beside it, which blur", "motion off", "add --motion exact")
        asked = (args.hold, *_blur(args, scene.settings), args.flow, args.bits)
        return cls(scenes, transfer, track, count, numbers, *asked, only)

    def shown(self, frame: int) -> int:
        """The number of the volume that a frame shows; a series begins anew when it is through."""
        return frame // self.hold % len(self.scenes)

    @property
    def mark(self) -> str:
        """What tells these frames from another animation's: sources, how they are drawn, and from where."""
        files = [(s.volume, Path(s.volume).stat().st_size if Path(s.volume).is_file() else 0) for s in self.scenes]
        cameras = [self.track.camera(n) for n in {0, self.count // 2, self.count - 1}]
        views = [(c.eye.tolist(), c.eye_from_world.tolist(), c.size, c.extent, c.perspective) for c in cameras]
        blur = (self.streaked, self.moments, self.flow)
        drawn = (self.scenes[0].settings, self.scenes[0].threshold, self.scenes[0].load, self.transfer.to_toml())
        return mark_of(files, drawn, views, self.count, self.hold, blur, self.bits)

    def draw(self, renderer: Renderer, frames: Frames, todo: Sequence[int], quiet: bool) -> None:
        """Draws and saves frame after frame; of a series, the next volume is read meanwhile."""
        settings = self.scenes[0].settings
        ground = settings.background if BLENDS[settings.blend].unbounded else None
        groups = [(number, list(group)) for number, group in groupby(todo, self.shown)]
        top = self._brightest(renderer) if BLENDS[settings.blend].unbounded else None
        self._sort(todo)
        with _bar(len(todo), quiet) as bar:
            for (number, group), (_, (splats, flow)) in zip(groups, self._matter(groups), strict=True):
                about = origin(self.scenes[number], self.transfer)
                for n in group:
                    image = self._frame(renderer, splats, flow, n)
                    if top is not None and frames.path(n).suffix.lower() == ".png":
                        image = scaled(image, top)
                    frames.save(n, Image(image.pixels, {**image.info, **about}), self.bits, ground)
                    if bar is not None:
                        bar.update()

    def _sort(self, todo: Sequence[int]) -> None:
        """Sorts a single volume's splats along every axis that frames will look along, before any is drawn: what
        memory an animation takes, it has taken with its first frame.
        """
        if self.only is None or not BLENDS[self.scenes[0].settings.blend].ordered:
            return
        some = todo[:: max(len(todo) // LOOKS, 1)]
        for axis in {order_for(self.only, self.track.camera(n)).axis for n in some}:
            self.only.lattice(axis)

    def _matter(self, groups: Sequence[tuple[int, list[int]]]) -> Iterator[tuple[int, Matter]]:
        return read_ahead(self._read, [number for number, _ in groups])

    def _read(self, number: int) -> Matter:
        """The splats of one volume, and their velocities."""
        if self.only is not None and self.flow is None:
            return self.only, None
        scene = self.scenes[number]
        volume = scene.open()
        splats = extract(volume, self.transfer, scene.threshold)
        return splats, None if self.flow is None else flow_of(splats, volume, self.flow)

    def _frame(self, renderer: Renderer, splats: Splats, flow: np.ndarray | None, frame: int) -> Image:
        """One frame's picture, blurred by streaks, by the mean of its moments, or by both."""
        camera, settings = self.track.camera(frame), self.scenes[0].settings
        motion = self.track.motion(frame)
        motion = replace(motion, flow=flow) if flow is not None else motion
        if self.moments == 1 or motion.still or settings.shutter == 0:
            return renderer.render(splats, camera, settings, motion)
        count = self.moments or self._steady or moments(splats, camera, motion, settings.shutter)
        kind = Shorter if self.streaked else Moments
        image = kind(renderer.render, motion, settings.shutter, count)(splats, camera, settings)
        return Image(image.pixels.astype(np.float32), image.info)

    @cached_property
    def _steady(self) -> int | None:
        """The moments of every frame of a turn: those of the fastest. None where more than the angle changes."""
        if self.only is None or self.flow is not None or not isinstance(self.track, Turning):
            return None
        shutter, turn = self.scenes[0].settings.shutter, self.track.turn
        cameras = [self.track.camera(n) for n in np.linspace(0, self.count - 1, LOOKS)]
        return max(moments(self.only, camera, turn, shutter) for camera in cameras)

    def _brightest(self, renderer: Renderer) -> float:
        """What X-ray pictures are scaled by, the same for all frames whichever of them are drawn now."""
        cameras = [self.track.camera(n) for n in np.linspace(0, self.count - 1, PROBES)]
        top = 0.0
        for number in sorted({0, len(self.scenes) // 2, len(self.scenes) - 1}):
            splats, _ = self._read(number)
            for camera in cameras:
                top = max(top, float(renderer.render(splats, camera, self.scenes[0].settings).pixels.max()))
        return top * HEADROOM or 1.0


def scaled(image: Image, top: float) -> Image:
    """An X-ray as it is to be seen, so that saving does not scale it by its own maximum."""
    info = {**image.info, "blend": "xray over scale", "scale": 1 / top}
    if isinstance(error := info.get("error_bound"), float):
        info["error_bound"] = error / top
    return Image(image.pixels / np.float32(top), info)


def _splats(scene: Scene, volume: Volume, transfer: Transfer) -> Splats:
    splats = extract(volume, transfer, scene.threshold)
    if not len(splats):
        raise nothing(scene, volume)
    return splats


def _blur(args: argparse.Namespace, settings: Settings) -> tuple[bool, int | None]:
    """Whether frames are streaked, and the mean of how many pictures they are. Streaks are right for sums; where matter
    hides matter the mean of stills is nearer in the same time, and a maximum has no streaks.
    """
    chosen = args.motion is not None or settings.motion != MOTIONS[0] or BLENDS[settings.blend].unbounded
    streaked = chosen and settings.motion != "off" and BLENDS[settings.blend].join != "max"
    if args.moments is not None:
        return streaked, args.moments
    return streaked, 1 if streaked or settings.motion == "off" else None


def _degrees(args: argparse.Namespace, count: int, series: bool) -> float:
    """How far the volume turns each frame; a camera that goes around is a volume that turns the other way."""
    if args.spin is not None:
        return float(args.spin)
    if args.turntable is None and series:
        return 0.0
    return -float(args.turntable if args.turntable is not None else FULL_TURN) / count


def _bar(total: int, quiet: bool) -> Any:
    """A bar over frames with the time left, where tqdm is installed and someone is watching."""
    if quiet or not sys.stderr.isatty():
        return nullcontext()
    try:
        from tqdm import tqdm
    except ImportError:
        return nullcontext()
    return tqdm(total=total, desc="drawing", unit="frame", delay=PATIENCE, leave=False)

"""Draws frames, or parts of one picture, on workers of Dask, and joins parts."""

from __future__ import annotations

import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.coercion import public
from splatgl.data.image import Image, bounding_box
from splatgl.data.volume import Volume
from splatgl.distributed.workers import Drawing, addresses, call, keep_latest, outcome, renderer, spread
from splatgl.errors import InputError, expected
from splatgl.fileio import budget, call_within, parse_bytes
from splatgl.geometry.camera import Camera
from splatgl.planning.bricks import Bricks, Shell, estimate_need, required_bricks
from splatgl.planning.resolve import extract_for_settings
from splatgl.readers import load
from splatgl.splat.motion import Motion
from splatgl.splat.settings import COMBINE, Settings
from splatgl.transfer.transfer import Transfer

if TYPE_CHECKING:
    from distributed import Client

    from splatgl.planning.plan import Plan
    from splatgl.splat.splats import Splats


@dataclass(frozen=True, eq=False)
class WorkerJob:
    """A picture of a volume that workers open. key: identifies the volume in their cache. memory: of a worker, bytes;
    None: half of the free. level: of a multiscale volume.
    """

    key: str
    open: Callable[[], Volume]
    transfer: Transfer
    settings: Settings
    drawing: Drawing
    camera: Camera
    memory: int | None = None
    level: int = 0


@public
def render_frames(
    source: str | Path,
    transfer: Transfer,
    cameras: Sequence[Camera],
    client: Client,
    settings: Settings | None = None,
    motions: Sequence[Motion] | None = None,
    drawing: Drawing | None = None,
) -> Iterator[tuple[int, Image]]:
    """Yields (n, image of camera n) as they are done. Each worker opens the file, and extracts its splats once.

    motions: of the scene since the previous frame, for each camera. drawing: OpenGL options of workers. Raises
    InputError for a file that workers cannot read or draw, and, after all other frames, for a frame of which three
    workers died.
    """
    shared = uuid.uuid4().hex, _opening(source), transfer, settings or Settings(), drawing or Drawing()
    moved = motions if motions is not None else [None] * len(cameras)
    views = enumerate(zip(cameras, moved, strict=True))
    items = ((f"frame {n}", (WorkerJob(*shared, camera), n, motion)) for n, (camera, motion) in views)
    for _, frame in spread(client, _frame, items):
        yield frame


def _opening(source: str | Path) -> Callable[[], Volume]:
    """A function that reads a volume, also in processes in other folders."""
    return partial(load, Path(source).resolve() if Path(source).exists() else source)


def _frame(job: WorkerJob, number: int, motion: Motion | None) -> tuple[int, Image]:
    """Draws one picture, on a worker."""

    def extracted() -> Splats:
        return extract_for_settings(job.open(), job.transfer, job.settings, moving=motion is not None)

    return number, renderer(job.drawing).render(keep_latest(job.key, extracted), job.camera, job.settings, motion)


@dataclass(frozen=True, eq=False)
class PicturePart:
    """Window of samples, float32 [h, w, 4], at x, y of a picture of `size` (width, height) that is empty elsewhere.

    splats: whose first sheet is in the part.
    """

    pixels: np.ndarray
    x: int
    y: int
    size: tuple[int, int]
    splats: int

    @classmethod
    def of(cls, pixels: np.ndarray, splats: int) -> PicturePart:
        """The window around samples that are not empty."""
        height, width, _ = pixels.shape
        some = (pixels != 0).any(axis=-1)
        if not some.any():
            return cls(pixels[:0, :0], 0, 0, (width, height), splats)
        left, top, right, bottom = bounding_box(some)
        return cls(np.ascontiguousarray(pixels[top:bottom, left:right]), left, top, (width, height), splats)

    def within(self, x: int, y: int, width: int, height: int) -> np.ndarray:
        """The samples of a larger window."""
        samples = np.zeros((height, width, 4), np.float32)
        h, w, _ = self.pixels.shape
        samples[self.y - y : self.y - y + h, self.x - x : self.x - x + w] = self.pixels
        return samples

    @property
    def whole(self) -> np.ndarray:
        """The samples of the whole picture."""
        return self.within(0, 0, *self.size)


def join_parts(how: str, near: PicturePart, far: PicturePart) -> PicturePart:
    """Joins two parts. how: `join` of a blend."""
    splats = near.splats + far.splats
    if not near.pixels.size or not far.pixels.size:
        part = near if near.pixels.size else far
        return PicturePart(part.pixels, part.x, part.y, part.size, splats)
    left, top = min(near.x, far.x), min(near.y, far.y)
    right = max(part.x + part.pixels.shape[1] for part in (near, far))
    bottom = max(part.y + part.pixels.shape[0] for part in (near, far))
    box = left, top, right - left, bottom - top
    return PicturePart(join_samples(how, near.within(*box), far.within(*box)), left, top, near.size, splats)


def join_samples(how: str, near: np.ndarray, far: np.ndarray) -> np.ndarray:
    """Joins samples [h, w, 4] of two parts.

    over, sum: light, premultiplied. max, min, mean: a value, its sum by length if mean, and the length. attenuated: the
    attenuated maximum, the length, and as alpha the optical depth.
    """
    if how == "over":
        return near + (1 - near[..., 3:]) * far
    if how == "sum":
        return near + far
    front, back = near[..., 0], far[..., 0]
    if how == "attenuated":
        back = back * np.exp(-near[..., 3])
    value = np.where(near[..., 1] <= 0, back, np.where(far[..., 1] <= 0, front, COMBINE[how](front, back)))
    return np.stack([value, near[..., 1] + far[..., 1], np.zeros_like(value), near[..., 3] + far[..., 3]], axis=-1)


@public
def over(near: Image | Any, far: Image | Any) -> Image:
    """Composites `near` over `far`, both linear and premultiplied; keeps the info of `near`.

    Raises InputError for images of different sizes.
    """
    if near.pixels.shape != far.pixels.shape:
        raise expected("far", f"an image of {near.pixels.shape[1]}×{near.pixels.shape[0]}", far.pixels.shape[1::-1])
    return Image(join_samples("over", near.pixels, far.pixels), near.info)


# parts for each worker; hidden parts are done early
PARTS = 2

Progress = Callable[[int, int], None]


@public
def render_slabs(
    source: Volume | str | Path,
    transfer: Transfer | Any,
    camera: Camera | Any,
    settings: Settings | Any | None = None,
    memory: int | str | None = None,
    progress: Progress | None = None,
    client: Client | None = None,
) -> Image:
    """The picture of a volume, or of a file, of any size, at the level of `choose_level`: `info["level"]`.

    If extracting and drawing all splats is estimated to take more than `memory` (bytes, or "4GiB"; default: half of
    what is available), they are extracted brick by brick, nearest first, and drawn at once: `info["bricks"]` is their
    number, 0 if the volume was drawn whole. client: a Dask client, whose workers draw parts of the picture; they open
    the file themselves, a Volume is sent to them. progress: called with the bricks, or with a client the parts, that
    are done, and their number. Raises InputError for pictures in bricks that take voxels classified before.
    """
    memory = parse_bytes(memory) if isinstance(memory, str) else memory
    if client is None:
        from splatgl.gl.large_volumes import render_slabs as alone

        return alone(source, transfer, camera, settings, memory, progress)
    volume = None
    if isinstance(source, Volume):
        if not isinstance(source.samples, np.ndarray):
            raise expected("source", "a path that workers open, or samples in memory", "a store", "give its path")
        volume, opened = client.scatter(source, broadcast=True), _none
    else:
        opened = _opening(source)
    job = WorkerJob(uuid.uuid4().hex, opened, transfer, settings or Settings(), Drawing(), camera, memory)
    return draw_parts(client, job, volume, progress)


def _none() -> Volume:
    raise InputError("the volume was sent to the workers")


def draw_parts(
    client: Client, job: WorkerJob, volume: Any = None, progress: Progress | None = None, check: int | float | None = 0
) -> Image:
    """Draws the picture of a job. volume: a future, if it is sent to workers. check: as of `check_bricks`."""
    from distributed import as_completed

    started, submit = time.perf_counter(), partial(client.submit, call, call_within, job.memory, pure=False)
    futures = []
    try:
        futures.append(submit(_level, job, volume))
        number, info = outcome(futures[-1], "the picture")
        job = replace(job, level=number)
        futures.append(submit(_shells, job, volume, PARTS * max(len(addresses(client)), 1)))
        how, shells = outcome(futures[-1], "the picture")
        parts = [submit(_part, job, volume, shell) for shell in shells]
        names = {part.key: f"part {n} of {len(parts)}" for n, part in enumerate(parts, 1)}
        futures += parts
        # as a tree, so that no worker holds many
        joined = parts
        while len(joined) > 1:
            pairs = [submit(join_parts, how, *joined[n : n + 2]) for n in range(0, len(joined) - 1, 2)]
            joined = pairs + joined[2 * len(pairs) :]
            futures += pairs
        for done, part in enumerate(as_completed(parts, loop=client.loop), 1):
            outcome(part, names[part.key])
            if progress:
                progress(done, len(parts))
        futures.append(submit(_finished, job, volume, joined[0], check))
        image: Image = outcome(futures[-1], "the picture")
    finally:
        client.cancel(futures)
    info |= {"parts": len(shells), "seconds": round(time.perf_counter() - started, 6)}
    return replace(image, info={**image.info, **info})


def _level(job: WorkerJob, sent: Volume | None) -> tuple[int, dict[str, object]]:
    """Chooses the level, on a worker; returns its number and provenance."""
    from splatgl.gl.large_volumes import choose_level

    level = choose_level(_volume(job, sent), job.transfer, job.camera, job.settings, renderer(job.drawing))
    return level.number, level.info


def _shells(job: WorkerJob, sent: Volume | None, count: int) -> tuple[str, list[Shell]]:
    """Plans the parts, on a worker; returns the `join` of the blend, and their shells."""
    bricks, chosen = _planned(job, sent)
    assert chosen.resolved.sheets is not None
    return chosen.program.appearance.join, bricks.shells(chosen.resolved.sheets, chosen.view, count)


def _part(job: WorkerJob, sent: Volume | None, shell: Shell) -> PicturePart:
    """Draws a part of the picture, on a worker."""
    bricks, chosen = _planned(job, sent)
    assert chosen.resolved.sheets is not None
    most = budget()
    bricks, bands = estimate_need(bricks, bricks.samples(job.camera, job.settings), most).fitted(bricks, most)
    some = bricks.within(chosen.resolved.sheets, chosen.view, shell)
    pixels = renderer(job.drawing).render_part(some, job.camera, job.settings, bands)
    return PicturePart.of(pixels, sum(some.found.values()))


def _finished(job: WorkerJob, sent: Volume | None, part: PicturePart, check: int | float | None) -> Image:
    """The picture of joined parts, on a worker."""
    from splatgl.reference.check import check_bricks

    bricks, _ = _planned(job, sent)
    image = renderer(job.drawing).render_joined(bricks, job.camera, job.settings, part.whole, part.splats)
    return check_bricks(image, bricks, job.camera, job.settings, check) if part.splats else image


def _planned(job: WorkerJob, sent: Volume | None) -> tuple[Bricks, Plan]:
    """The volume in bricks, and the plan of the picture. Raises InputError for settings that need other splats."""
    from splatgl.gl.large_volumes import single_level

    def make() -> tuple[Bricks, Plan]:
        volume = single_level(_volume(job, sent), job.level)
        bricks = required_bricks(volume, job.transfer, job.settings)
        return bricks, renderer(job.drawing).plan_bricks(bricks, job.camera, job.settings)

    return keep_latest((job.key, job.level), make)


def _volume(job: WorkerJob, sent: Volume | None) -> Volume:
    return job.open() if sent is None else sent

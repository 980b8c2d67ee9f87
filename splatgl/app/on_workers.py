"""`--workers` and `--scheduler`: frames of an animation drawn by workers of Dask."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from splatgl.app.animation import Animation, bar
from splatgl.app.frame_work import FrameView, Work
from splatgl.app.frames import Frames
from splatgl.distributed.worker import Drawing, kept, renderer
from splatgl.splat.camera import Camera

if TYPE_CHECKING:
    from distributed import Client


def draw_frames(
    client: Client, animation: Animation, frames: Frames, todo: Sequence[int], drawing: Drawing, quiet: bool
) -> None:
    """Draws frames on workers, each of which opens the files itself, and writes them here, whole."""
    from splatgl.distributed.cluster import spread

    work = animation.work(frames)
    work = replace(work, scenes=[scene.anywhere() for scene in work.scenes])
    if animation.unbounded:
        ((_, top),) = spread(client, _brightest, [("the brightest frame", (work, drawing, animation.probes))])
        work = replace(work, top=top)
    items = ((f"frame {n}", (work, drawing, animation.view(n))) for n in todo)
    with bar(len(todo), quiet) as progress:
        for _, (frame, data) in spread(client, _frame, items):
            frames.write(frame, data)
            progress.update()


def _frame(work: Work, drawing: Drawing, view: FrameView) -> tuple[int, bytes]:
    """On a worker: a frame's number and file."""
    matter = kept((work.frames.mark, view.volume), lambda: work.matter(view.volume))
    return view.frame, work.frame(renderer(drawing), matter, view)


def _brightest(work: Work, drawing: Drawing, probes: list[tuple[int, Camera]]) -> float:
    """On a worker: the common scale of X-ray frames."""
    return work.brightest(renderer(drawing), probes, work.matter)

"""Pictures of volumes within a budget of memory: at once if they fit, else brick by brick, nearest first."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

from splatgl.data.image import Image
from splatgl.data.readers import load
from splatgl.data.volume import Volume
from splatgl.gl.levels import level_for
from splatgl.gl.renderer import Renderer
from splatgl.splat.bricks.estimate import budget
from splatgl.splat.bricks.within import bricks_of, fits
from splatgl.splat.classification.transfer import Transfer
from splatgl.splat.plan.settings import Settings
from splatgl.splat.plan.suited import extracted
from splatgl.splat.view.camera import Camera

# given how many bricks are done, and their number
Progress = Callable[[int, int], None]


def render_slabs(
    source: Volume | str | Path,
    transfer: Transfer,
    camera: Camera,
    settings: Settings | None = None,
    memory: int | None = None,
    progress: Progress | None = None,
    renderer: Renderer | None = None,
) -> Image:
    """`splatgl.distributed.slabs.render_slabs` without workers; renderer: one that is open."""
    settings = settings or Settings()
    volume = source if isinstance(source, Volume) else load(source)
    most = budget() if memory is None else memory
    with nullcontext(renderer) if renderer else Renderer() as drawing:
        level = level_for(volume, transfer, camera, settings, drawing)
        bricks = bricks_of(level.volume, level.transfer, settings)
        many = fits(bricks, camera.size, most) if bricks else None
        told = {**level.info, "bricks": 0}
        if bricks is None or many is None:
            image = drawing.render(extracted(level.volume, level.transfer, settings), camera, settings)
            return Image(image.pixels, {**image.info, **told})
        image = drawing.render_bricks(bricks, camera, settings, progress, bands=many.bands(most))
        return Image(image.pixels, {**told, **image.info})

"""Pictures of volumes within a budget of memory: at once if they fit, else brick by brick, nearest first."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import numpy as np

from splatgl.data.image import Image
from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.fileio import budget
from splatgl.gl.levels import level_for
from splatgl.gl.renderer import Renderer
from splatgl.readers import load
from splatgl.splat.bricks import Bricks, bricks_of, fits
from splatgl.splat.camera import Camera
from splatgl.splat.motion import Moments, Motion
from splatgl.splat.plan import Blurred
from splatgl.splat.resolve import extracted, streaked
from splatgl.splat.settings import Settings
from splatgl.splat.splats import Splats
from splatgl.splat.transfer import Transfer

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


def moving_bricks(
    renderer: Renderer, bricks: Bricks, camera: Camera, settings: Settings, motion: Motion, bands: int = 1
) -> Image:
    """A volume in bricks while the camera, or all of it, moves: the mean of its moments, as `Renderer.render` of moving
    splats. Raises InputError for streaks and for a flow.
    """
    if streaked(settings):
        raise expected("motion in bricks", "the mean of moments", f"motion {settings.motion}")
    if motion.flow is not None:
        raise expected("motion in bricks", "a camera or a volume that moves", "a flow")
    still = settings.but(motion="off", moments=None)

    def draw(_: Splats, view: Camera, asked: Settings) -> Image:
        return renderer.render_bricks(bricks, view, asked, bands=bands)

    blurred = Blurred.of(bricks.probes, camera, settings, motion, [])
    if not blurred.moments:
        return draw(bricks.probes, camera, still)
    mean = Moments(draw, motion, settings.shutter, blurred.moments)(bricks.probes, camera, still)
    return Image(mean.pixels.astype(np.float32), {**mean.info, "motion": "moments"})

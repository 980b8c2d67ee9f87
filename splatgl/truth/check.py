"""Rows of an image compared with the float64 reference: its error where no bound is known."""

from __future__ import annotations

import numpy as np

from splatgl.data.errors import expected
from splatgl.data.image import Image
from splatgl.splat.extraction.splats import Splats
from splatgl.splat.plan.settings import Settings
from splatgl.splat.view.camera import Camera
from splatgl.truth.reference import render_rows


def check(image: Image, splats: Splats, camera: Camera, settings: Settings | None = None, rows: int = 2) -> Image:
    """The image of `Renderer.render` with `info["checked"]`: its rows, and the largest and the mean error in them.

    rows: as many rows of pixels, spread over what is in the image, are drawn in float64; of an empty one, none.
    Raises InputError for fewer than none, and for more than the image has.
    """
    height = image.pixels.shape[0]
    if not 0 <= rows <= height:
        raise expected("--check", f"0 to {height} rows", rows)
    some = np.flatnonzero(image.pixels[..., 3].max(axis=1) > 0)
    if rows == 0 or not len(some):
        return image
    chosen = np.unique(some[((np.arange(rows) + 0.5) / rows * len(some)).astype(int)])
    off = image.pixels[chosen] - render_rows(splats, camera, settings or Settings(), chosen.tolist())
    checked = {"rows": chosen.tolist(), "largest": float(np.abs(off).max()), "rmse": float(np.sqrt((off**2).mean()))}
    return Image(image.pixels, {**image.info, "checked": checked})

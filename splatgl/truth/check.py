"""Rows of an image compared with the float64 reference: its error where no bound is known."""

from __future__ import annotations

import numpy as np

from splatgl.data.errors import expected
from splatgl.data.image import Image
from splatgl.splat.extraction.splats import Splats
from splatgl.splat.plan.blend_mode import BLENDS
from splatgl.splat.plan.settings import Settings
from splatgl.splat.plan.suited import suited
from splatgl.splat.view.camera import Camera
from splatgl.truth.field import kept_field_integral
from splatgl.truth.reference import render_rows

# most pixels marched through the field, and rays along the sides of one that is antialiased
FIELD_PIXELS, FIELD_SAMPLES = 64, 4


def check(
    image: Image,
    splats: Splats,
    camera: Camera,
    settings: Settings | None = None,
    rows: int = 2,
    field: bool = False,
) -> Image:
    """The image of `Renderer.render` with `info["checked"]`: its rows, and the largest and the mean error in them.

    rows: as many rows of pixels, spread over what is in the image, are drawn in float64; of an empty one, none.
    field: also compares pixels of these rows with the field that the picture stands for, values reconstructed and
    classified at every point of their rays: `info["checked"]["field"]`; only if classified after reconstruction, and
    not of the blend xray. Raises InputError for fewer rows than none, and for more than the image has.
    """
    height, width = image.pixels.shape[:2]
    settings = settings or Settings()
    if not 0 <= rows <= height:
        raise expected("--check", f"0 to {height} rows", rows)
    some = np.flatnonzero(image.pixels[..., 3].max(axis=1) > 0)
    if rows == 0 or not len(some):
        return image
    chosen = np.unique(some[((np.arange(rows) + 0.5) / rows * len(some)).astype(int)])
    off = image.pixels[chosen] - render_rows(splats, camera, settings, chosen.tolist())
    checked: dict[str, object] = {"rows": chosen.tolist(), **_errors(off)}
    if field:
        drawn = suited(splats, settings, moving=False)
        if drawn.post is None or BLENDS[settings.blend].unbounded:
            raise expected("field", "values classified after reconstruction, by another blend than xray", "others")
        shown = np.argwhere(image.pixels[chosen, :, 3] > 0)
        row, column = shown[np.linspace(0, len(shown) - 1, min(FIELD_PIXELS, len(shown))).astype(int)].T
        samples = 1 if settings.antialias == "off" else FIELD_SAMPLES
        right = kept_field_integral(drawn, camera, chosen[row] * width + column, samples, settings.blend)
        checked["field"] = {"pixels": len(row), **_errors(image.pixels[chosen[row], column] - right)}
    return Image(image.pixels, {**image.info, "checked": checked})


def _errors(off: np.ndarray) -> dict[str, float]:
    return {"largest": float(np.abs(off).max()), "rmse": float(np.sqrt((off**2).mean()))}

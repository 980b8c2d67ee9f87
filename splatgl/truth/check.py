"""Rows of an image compared with the float64 reference: its error where no bound is known."""

from __future__ import annotations

import numpy as np

from splatgl.data.errors import expected
from splatgl.data.image import Image
from splatgl.splat.extraction.splats import Splats
from splatgl.splat.plan.settings import Settings
from splatgl.splat.plan.suited import classified_before, suited
from splatgl.splat.view.camera import Camera
from splatgl.truth.field import FIELD_BLENDS, kept_field_integral
from splatgl.truth.reference import render_rows

# rows, unless their number is given
CHECKED = 2
# most pixels marched through the field, and rays along the sides of one that is antialiased
FIELD_PIXELS, FIELD_SAMPLES = 64, 4


def check(
    image: Image,
    splats: Splats,
    camera: Camera,
    settings: Settings | None = None,
    rows: int | None = None,
    field: bool = False,
) -> Image:
    """The image of `Renderer.render` with `info["checked"]`: its rows, and the largest and the mean error in them.

    rows: as many rows of pixels, spread over what is in the image, are drawn in float64 (CHECKED, or all if it has
    fewer); of an empty one, none.
    field: also compares pixels of these rows with the field that the picture stands for, values reconstructed and
    classified at every point of their rays: `info["checked"]["field"]`. Raises InputError as `refuse`.
    """
    settings = settings or Settings()
    refuse(splats, camera, settings, rows, field)
    count = min(CHECKED, camera.size[1]) if rows is None else rows
    some = np.flatnonzero(image.pixels[..., 3].max(axis=1) > 0)
    if count == 0 or not len(some):
        return image
    chosen = np.unique(some[((np.arange(count) + 0.5) / count * len(some)).astype(int)])
    off = image.pixels[chosen] - render_rows(splats, camera, settings, chosen.tolist())
    checked: dict[str, object] = {"rows": chosen.tolist(), **_errors(off)}
    if field:
        drawn = suited(splats, settings, moving=False)
        shown = np.argwhere(image.pixels[chosen, :, 3] > 0)
        row, column = shown[np.linspace(0, len(shown) - 1, min(FIELD_PIXELS, len(shown))).astype(int)].T
        samples = 1 if settings.antialias == "off" else FIELD_SAMPLES
        right = kept_field_integral(drawn, camera, chosen[row] * camera.size[0] + column, samples, settings.blend)
        checked["field"] = {"pixels": len(row), **_errors(image.pixels[chosen[row], column] - right)}
    return Image(image.pixels, {**image.info, "checked": checked})


def refuse(splats: Splats, camera: Camera, settings: Settings, rows: int | None, field: bool) -> None:
    """InputError, before any drawing, for what `check` can't compare: fewer rows than none, more than the picture has,
    and a field of no rows, of voxels classified before, or of a blend that sums.
    """
    least, height = int(field), camera.size[1]
    if rows is not None and not least <= rows <= height:
        raise expected("--check", f"{least} to {height} rows" + " with --field" * field, rows)
    if not field:
        return
    if settings.blend not in FIELD_BLENDS:
        raise expected("blend of --field", " or ".join(FIELD_BLENDS), settings.blend)
    why = classified_before(splats, settings, moving=False)
    if why:
        raise expected("--field", "values classified after reconstruction", f"voxels classified before ({why})")


def _errors(off: np.ndarray) -> dict[str, float]:
    return {"largest": float(np.abs(off).max()), "rmse": float(np.sqrt((off**2).mean()))}

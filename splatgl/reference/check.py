"""Parts of an image compared with the float64 reference: its error where no bound is known."""

from __future__ import annotations

import numpy as np

from splatgl.data.image import Image
from splatgl.errors import expected
from splatgl.reference.field import kept_field_integral
from splatgl.reference.renderer import render_windows, render_windows_of
from splatgl.splat.bricks import Bricks
from splatgl.splat.camera import Camera
from splatgl.splat.culling import Window
from splatgl.splat.resolve import classified_before, select_splats
from splatgl.splat.scene import Scene
from splatgl.splat.settings import BLENDS, Settings
from splatgl.splat.splats import Splats

# a pixel that differs by less from the background shows nothing else
UNSEEN = 1e-6
# squares of pixels, unless a number of rows is given, and the pixels of their sides
SQUARES, SIDE = 10, 4
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
    """The image of `Renderer.render` with `info["checked"]`: what was compared, the largest and the mean error there.

    SQUARES of SIDE pixels, spread over what is in the image, are drawn in float64; of an empty one, none. rows: as
    many rows of pixels instead.
    field: also compares some of these pixels with the field that the picture stands for, values reconstructed and
    classified at every point of their rays: `info["checked"]["field"]`. Raises InputError as `refuse`.
    """
    settings = settings or Settings()
    refuse(splats, camera, settings, rows, field)
    seen = _seen(image.pixels, settings)
    if rows == 0 or not seen.any():
        return image
    windows = _squares(seen) if rows is None else _rows(seen, rows)
    checked = _compared(image, windows, render_windows(splats, camera, settings, windows))
    if field:
        inside = np.zeros_like(seen)
        for w in windows:
            inside[w.y : w.y + w.height, w.x : w.x + w.width] = True
        shown = np.flatnonzero(seen & inside)
        pixels = shown[np.linspace(0, len(shown) - 1, min(FIELD_PIXELS, len(shown))).astype(int)]
        drawn = select_splats(splats, settings, moving=False)
        samples = 1 if settings.antialias == "off" else FIELD_SAMPLES
        far = image.pixels.reshape(-1, 4)[pixels] - kept_field_integral(drawn, camera, pixels, samples, settings)
        checked["field"] = {"pixels": len(pixels), **_errors(far)}
    return Image(image.pixels, {**image.info, "checked": checked})


def check_bricks(image: Image, bricks: Bricks, camera: Camera, settings: Settings | None = None) -> Image:
    """The image of `Renderer.render_bricks` with `info["checked"]`, as `check` compares squares."""
    settings = settings or Settings()
    seen = _seen(image.pixels, settings)
    if not seen.any():
        return image
    windows = _squares(seen)
    checked = _compared(image, windows, render_windows_of(bricks, camera, settings, windows))
    return Image(image.pixels, {**image.info, "checked": checked})


def check_layers(
    image: Image, scene: Scene, camera: Camera, settings: Settings | None = None, rows: int | None = None
) -> Image:
    """The image of a scene of layers with `info["checked"]`, as `check` compares squares or rows."""
    settings = settings or Settings()
    if rows is not None and not 0 <= rows <= camera.size[1]:
        raise expected("--check", f"0 to {camera.size[1]} rows", rows)
    seen = _seen(image.pixels, settings)
    if rows == 0 or not seen.any():
        return image
    windows = _squares(seen) if rows is None else _rows(seen, rows)
    checked = _compared(image, windows, render_windows(scene, camera, settings, windows))
    return Image(image.pixels, {**image.info, "checked": checked})


def _compared(image: Image, windows: list[Window], right: list[np.ndarray]) -> dict[str, object]:
    """What was compared with the right pixels of windows of the image, and the errors."""
    parts = [image.pixels[w.y : w.y + w.height, w.x : w.x + w.width] for w in windows]
    off = np.concatenate([(part - each).reshape(-1, 4) for part, each in zip(parts, right, strict=True)])
    return {"windows": [w.box for w in windows], "pixels": len(off), **_errors(off)}


def refuse(splats: Splats, camera: Camera, settings: Settings, rows: int | None, field: bool) -> None:
    """InputError, before any drawing, for what `check` can't compare: fewer rows than none, more than the picture has,
    and a field of no rows, or of voxels classified before.
    """
    least, height = int(field), camera.size[1]
    if rows is not None and not least <= rows <= height:
        raise expected("--check", f"{least} to {height} rows" + " with --field" * field, rows)
    if not field:
        return
    why = classified_before(splats, settings, moving=False)
    if why:
        raise expected("--field", "values classified after reconstruction", f"voxels classified before ({why})")


def _seen(pixels: np.ndarray, settings: Settings) -> np.ndarray:
    """bool [H, W]: where something lies before the background."""
    if settings.background is None or BLENDS[settings.blend].unbounded:
        return np.asarray(pixels[..., 3] > 0)
    return np.asarray((np.abs(pixels[..., :3] - np.array(settings.background)) > UNSEEN).any(axis=-1))


def _rows(seen: np.ndarray, count: int) -> list[Window]:
    """Rows of pixels, spread over those in which something is seen."""
    rows = _spread(np.flatnonzero(seen.any(axis=1)), count)
    return [Window(0, row, seen.shape[1], 1) for row in rows.tolist()]


def _squares(seen: np.ndarray) -> list[Window]:
    """Squares of a grid, spread over those in which something is seen; cut off at the picture's edges."""
    height, width = seen.shape
    padded = np.pad(seen, ((0, -height % SIDE), (0, -width % SIDE)))
    down, across = padded.shape[0] // SIDE, padded.shape[1] // SIDE
    cells = _spread(np.argwhere(padded.reshape(down, SIDE, across, SIDE).any(axis=(1, 3))) * SIDE, SQUARES)
    return [Window(x, y, min(SIDE, width - x), min(SIDE, height - y)) for y, x in cells.tolist()]


def _spread(found: np.ndarray, count: int) -> np.ndarray:
    """So many of them at equal steps; all, if there are fewer."""
    return found[np.unique(((np.arange(count) + 0.5) / count * len(found)).astype(int))]


def _errors(off: np.ndarray) -> dict[str, float]:
    return {"largest": float(np.abs(off).max()), "rmse": float(np.sqrt((off**2).mean()))}

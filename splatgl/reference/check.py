"""Compares parts of an image with the float64 reference: measures the error where no bound is known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from splatgl.data.image import Image
from splatgl.errors import expected
from splatgl.reference.field import kept_field_integral
from splatgl.reference.renderer import render_windows, render_windows_of
from splatgl.splat.bricks import Bricks
from splatgl.splat.camera import Camera
from splatgl.splat.culling import Window
from splatgl.splat.grid import distinct
from splatgl.splat.resolve import select_splats, why_classified_before
from splatgl.splat.scene import Scene
from splatgl.splat.settings import BLENDS, Settings
from splatgl.splat.splats import Splats

# a pixel that differs by less from the background counts as background
UNSEEN = 1e-6
# number of squares of pixels, and pixels along their sides
SQUARES, SIDE = 10, 4
# maximum number of pixels marched through the field, and rays along the sides of an antialiased pixel
FIELD_PIXELS, FIELD_SAMPLES = 64, 4


def check(
    image: Image,
    splats: Splats | Scene,
    camera: Camera,
    settings: Settings | None = None,
    rows: int | None = None,
    field: bool = False,
) -> Image:
    """Adds `info["checked"]` to an image of `Renderer.render`: the compared windows, the largest and the mean error.

    Draws SQUARES squares of SIDE pixels in float64, distributed over the non-empty pixels. rows: number of rows of
    pixels to compare instead. field: also compares some of these pixels with the exact integral of the field, whose
    values are reconstructed and classified at every point of a ray: `info["checked"]["field"]`. Raises InputError as
    `check_input`.
    """
    settings = settings or Settings()
    check_input(splats, camera, settings, rows, field)
    image, windows, checked = _compared(
        image, settings, rows, lambda windows: render_windows(splats, camera, settings, windows)
    )
    if field and windows:
        ((layer, look),) = splats.drawn(settings)
        inside = np.zeros(image.pixels.shape[:2], bool)
        for w in windows:
            inside[w.y : w.y + w.height, w.x : w.x + w.width] = True
        shown = np.flatnonzero(_is_visible(image.pixels, settings) & inside)
        pixels = shown[np.linspace(0, len(shown) - 1, min(FIELD_PIXELS, len(shown))).astype(int)]
        drawn = select_splats(layer, look, False, camera)
        samples = 1 if settings.antialias == "off" else FIELD_SAMPLES
        far = image.pixels.reshape(-1, 4)[pixels] - kept_field_integral(drawn, camera, pixels, samples, look)
        checked["field"] = {"pixels": len(pixels), **_errors(far)}
    return image


def check_bricks(image: Image, bricks: Bricks, camera: Camera, settings: Settings | None = None) -> Image:
    """Like `check`, for squares of an image of `Renderer.render_bricks`."""
    settings = settings or Settings()
    return _compared(image, settings, None, lambda windows: render_windows_of(bricks, camera, settings, windows))[0]


def _compared(
    image: Image, settings: Settings, rows: int | None, draw: Callable[[list[Window]], list[np.ndarray]]
) -> tuple[Image, list[Window], dict[str, object]]:
    """The image with `info["checked"]`, the compared windows, and `checked`; the same image if there are none.

    draw: returns the exact pixels of windows.
    """
    visible = _is_visible(image.pixels, settings)
    if rows == 0 or not visible.any():
        return image, [], {}
    windows = _squares(visible) if rows is None else _rows(visible, rows)
    parts = [image.pixels[w.y : w.y + w.height, w.x : w.x + w.width] for w in windows]
    off = np.concatenate([(part - exact).reshape(-1, 4) for part, exact in zip(parts, draw(windows), strict=True)])
    checked: dict[str, object] = {"windows": [w.box for w in windows], "pixels": len(off), **_errors(off)}
    return Image(image.pixels, {**image.info, "checked": checked}), windows, checked


def check_input(splats: Splats | Scene, camera: Camera, settings: Settings, rows: int | None, field: bool) -> None:
    """Raises InputError, before any drawing, for input that `check` cannot compare: a number of rows that the picture
    does not have, and a field of no rows, or of voxels classified before reconstruction.
    """
    least, height = int(field), camera.size[1]
    if rows is not None and not least <= rows <= height:
        raise expected("--check", f"{least} to {height} rows" + " with --field" * field, rows)
    if not field:
        return
    (layer, settings), *others = splats.drawn(settings)
    if others or splats.surfaces(settings):
        raise expected("--field", "a picture of one volume", "layers or meshes")
    selected = select_splats(layer, settings, False, camera)
    why = why_classified_before(layer.source, selected, settings, moving=False)
    if why:
        raise expected("--field", "values classified after reconstruction", f"voxels classified before ({why})")


def _is_visible(pixels: np.ndarray, settings: Settings) -> np.ndarray:
    """bool [H, W]: which pixels show more than the background."""
    if settings.background is None or BLENDS[settings.blend].unbounded:
        return np.asarray(pixels[..., 3] > 0)
    off = [np.abs(pixels[..., n] - np.float64(color)) > UNSEEN for n, color in enumerate(settings.background)]
    return np.asarray(off[0] | off[1] | off[2])


def _rows(visible: np.ndarray, count: int) -> list[Window]:
    """Rows of pixels, evenly distributed over the non-empty rows."""
    rows = _spread_evenly(np.flatnonzero(visible.any(axis=1)), count)
    return [Window(0, row, visible.shape[1], 1) for row in rows.tolist()]


def _squares(visible: np.ndarray) -> list[Window]:
    """Squares of a grid, evenly distributed over the non-empty ones; clipped to the picture."""
    height, width = visible.shape
    padded = np.pad(visible, ((0, -height % SIDE), (0, -width % SIDE)))
    down, across = padded.shape[0] // SIDE, padded.shape[1] // SIDE
    cells = _spread_evenly(np.argwhere(padded.reshape(down, SIDE, across, SIDE).any(axis=(1, 3))) * SIDE, SQUARES)
    return [Window(x, y, min(SIDE, width - x), min(SIDE, height - y)) for y, x in cells.tolist()]


def _spread_evenly(places: np.ndarray, count: int) -> np.ndarray:
    """At most `count` of the places, at equal steps."""
    return places[distinct(((np.arange(count) + 0.5) / count * len(places)).astype(int))]


def _errors(off: np.ndarray) -> dict[str, float]:
    return {"largest": float(np.abs(off).max()), "rmse": float(np.sqrt((off**2).mean()))}

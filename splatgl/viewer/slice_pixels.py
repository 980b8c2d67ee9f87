"""Pixels of slices: the samples of a volume in a pane, in grey or in colours, and several layers blended."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.data.color import srgb_from_linear
from splatgl.data.volume import Volume
from splatgl.scene.meshes import is_mesh
from splatgl.splat.resample import sample_raster
from splatgl.splat.scene import Layer, Scene
from splatgl.splat.slice_images import Painter
from splatgl.splat.transfer import Transfer

if TYPE_CHECKING:
    from splatgl.viewer.layer_splats import LayerSplats
    from splatgl.viewer.oblique import TurnedPane
    from splatgl.viewer.slice_views import Pane
    from splatgl.viewer.state import LayerStyle

# entries of the colour table
COLORS = 4096


def read_slice(array: Any, pane: Pane, index: int) -> np.ndarray:
    """The samples or colours [rows, columns, …] of a slice as its pane shows them; reads only the slice."""
    cut: list[Any] = [slice(None)] * 3
    cut[2 - pane.axis] = index
    pixels = np.asarray(array[tuple(cut)])
    # rows are along the later axis of the grid
    if pane.down < pane.across:
        pixels = pixels.swapaxes(0, 1)
    pixels = pixels[:, ::-1] if pane.back[0] else pixels
    return pixels[::-1] if pane.back[1] else pixels


def thin_out(pixels: np.ndarray, pane: Pane) -> np.ndarray:
    """Every n-th sample of a slice: at most about two per pixel along each side."""
    sides = pane.box[3] - pane.box[1], pane.box[2] - pane.box[0]
    steps = [max(1, int(size / (2 * side))) for size, side in zip(pixels.shape, sides, strict=False)]
    return pixels[:: steps[0], :: steps[1]]


def window_of(transfer: Transfer) -> tuple[float, float]:
    """The values from black to white."""
    low, high = transfer.color_range
    return (low, high) if low < high else (low - 0.5, low + 0.5)


def grey_pixels(values: np.ndarray, window: tuple[float, float], logarithmic: bool = False) -> np.ndarray:
    """Grey pixels uint8 [H, W, 4] by a window, or by logarithms; NaN is black."""
    low, high = window
    with np.errstate(all="ignore"):
        if logarithmic:
            values, low, high = np.log(np.maximum(values, low)), float(np.log(low)), float(np.log(high))
        shade = (values.astype(np.float32) - np.float32(low)) * np.float32(255.0 / (high - low))
    pixels = np.full((*values.shape, 4), 255, np.uint8)
    pixels[..., :3] = np.clip(np.nan_to_num(shade, nan=0.0), 0.0, 255.0).astype(np.uint8)[..., None]
    return pixels


def colored_pixels(values: np.ndarray, transfer: Transfer) -> np.ndarray:
    """Pixels uint8 [H, W, 4] in the colours of the transfer function; hidden segments are black."""
    if transfer.labels:
        linear = transfer.color(values) * (transfer.opacity(values) > 0)[..., None]
    elif transfer.logarithmic:
        linear = transfer.color(values)
    else:
        low, high = window_of(transfer)
        with np.errstate(all="ignore"):
            place = (values.astype(np.float64) - low) * ((COLORS - 1) / (high - low))
        entries = np.clip(np.nan_to_num(place, nan=0.0), 0, COLORS - 1).astype(np.intp)
        table = srgb_from_linear(np.clip(transfer.color(np.linspace(low, high, COLORS)), 0.0, 1.0))
        return _opaque(np.rint(table * 255).astype(np.uint8)[entries])
    return _opaque(np.rint(srgb_from_linear(np.clip(linear, 0.0, 1.0)) * 255).astype(np.uint8))


def _opaque(rgb: np.ndarray) -> np.ndarray:
    pixels = np.full((*rgb.shape[:2], 4), 255, np.uint8)
    pixels[..., :3] = rgb
    return pixels


def turned_pixels(
    volume: Volume, shown: TurnedPane, look: Transfer | tuple[float, float], logarithmic: bool
) -> np.ndarray:
    """Pixels uint8 [H, W, 4] of a turned slice, clear beside the volume."""
    nearest = isinstance(look, Transfer) and bool(look.labels)
    values, known = sample_raster(volume, shown.plane.raster(volume, *shown.grid), nearest)
    if volume.color is not None:
        pixels = _opaque(np.rint(np.clip(values, 0, 1) * 255).astype(np.uint8))
    elif isinstance(look, tuple):
        pixels = grey_pixels(values, look, logarithmic)
    else:
        pixels = colored_pixels(values, look)
    pixels[~known] = 0
    return pixels


# volume, transfer function and opacity of a visible layer
Look = tuple[Volume, Transfer, float]


def layer_looks(pool: Mapping[int, LayerSplats], styles: Sequence[LayerStyle]) -> tuple[Look, ...]:
    """Returns the layers that slices show: those in visible styles with voxels; the first if there are none. pool:
    layers by the numbers that styles name.
    """
    pairs = [(pool[style.number], style) for style in styles if style.number in pool]
    seen = [
        (layer, style)
        for layer, style in pairs
        if style.is_shown and layer.volume.points is None and not is_mesh(layer.scene.volume)
    ]
    return tuple((layer.volume, style.stated, style.opacity) for layer, style in seen or pairs[:1])


@lru_cache(maxsize=2)
def layer_painter(layers: tuple[Look, ...], colored: bool) -> Painter:
    """The painter of slices of layers, as of `splatgl render --slice`. colored: else the first is grey, by its window,
    unless the layers add up.
    """
    painter = Scene([Layer(*look) for look in layers]).painter("slice")
    first = painter.layers[0]
    if colored or first.nearest or all(layer.glows for layer in painter.layers):
        return painter
    return Painter([first._replace(transfer=replace(first.transfer, colormap="gray")), *painter.layers[1:]])


def painted_pixels(painter: Painter, shown: TurnedPane) -> np.ndarray:
    """Pixels uint8 [H, W, 4] of a slice of several layers, clear beside all of them."""
    light = painter.pixels(shown.plane, *shown.grid)
    light[..., :3] = srgb_from_linear(np.clip(light[..., :3], 0.0, 1.0))
    return np.rint(light * 255).astype(np.uint8)

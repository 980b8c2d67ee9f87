"""Layers in the slices of the window: those that are visible, and how slices paint them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

from splatgl.geometry.slices import Painted, Painter
from splatgl.scene.meshes import is_mesh
from splatgl.transfer.presets import slice_colors

if TYPE_CHECKING:
    from splatgl.viewer.layer_splats import LayerSplats
    from splatgl.viewer.state import LayerStyle


def layer_looks(pool: Mapping[int, LayerSplats], styles: Sequence[LayerStyle]) -> tuple[Painted, ...]:
    """Returns the layers that slices show: those in visible styles with voxels; the first if there are none. pool:
    layers by the numbers that styles name.
    """
    pairs = [(pool[style.number], style) for style in styles if style.number in pool]
    seen = [
        (layer, style)
        for layer, style in pairs
        if style.is_shown and layer.volume.points is None and not is_mesh(layer.scene.volume)
    ]
    return tuple(Painted(layer.volume, style.stated, style.opacity) for layer, style in seen or pairs[:1])


@lru_cache(maxsize=2)
def layer_painter(layers: tuple[Painted, ...], colored: bool, only: bool = False) -> Painter:
    """The painter of slices of layers, as of `splatgl render --slice`. colored: else the first is grey, by its window,
    unless it has segments or the layers add up. only: whether it is the scene's first layer alone, by its own window.
    """
    if not only:
        layers = tuple(layer._replace(transfer=slice_colors(layer.volume, layer.transfer)) for layer in layers)
    first, adds = layers[0], not only and all(layer.glows for layer in layers)
    if not (colored or first.nearest or adds):
        layers = first._replace(transfer=replace(first.transfer, colormap="gray")), *layers[1:]
    return Painter(layers)

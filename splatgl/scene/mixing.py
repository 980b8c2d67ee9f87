"""Pictures that mix display values, sRGB, as VTK and napari do, instead of linear light.

Colours are replaced by those whose linear light is the number of the display value; the picture of these, mixed as
usual, then is of display values.
"""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np

from splatgl.data.color import Color, linear_from_srgb, srgb_from_linear
from splatgl.data.image import Image
from splatgl.data.mesh import Mesh
from splatgl.errors import expected
from splatgl.options import Kind, Option
from splatgl.splat.colormaps import ENTRIES, colormap, colormap_name
from splatgl.splat.scene import Layer, Scene
from splatgl.splat.settings import BLENDS, Settings
from splatgl.splat.transfer import Transfer

LINEAR, DISPLAY = "linear", "display"
MIXING = Option(Kind.choice((LINEAR, DISPLAY)), "what colours are mixed in: linear light, or display values as in VTK")

# sRGB samples of 8 bits whose linear light is the display value of each sample
_SAMPLES = np.rint(255 * srgb_from_linear(np.arange(256) / 255)).astype(np.uint8)


def display_scene(scene: Scene) -> Scene:
    """The scene in the colours whose linear light is their display value."""
    changed = copy(scene)
    object.__setattr__(changed, "layers", tuple(_layer(layer) for layer in scene.shown))
    changed.place_meshes([(_mesh(mesh), planes) for mesh, planes in scene.whole])
    object.__setattr__(changed, "made", {})
    return changed


def display_settings(settings: Settings) -> Settings:
    """The settings without background, which is mixed in afterwards. Raises InputError for sums."""
    if BLENDS[settings.blend].unbounded:
        raise expected("mixing", "linear for sums of optical depth", DISPLAY)
    return settings.but(background=None)


def display_image(image: Image, background: Color | None) -> Image:
    """The picture of display values, drawn without background, in linear light over a background."""
    alpha = np.clip(image.pixels[..., 3:], 0.0, 1.0).astype(np.float64)
    values = np.clip(image.pixels[..., :3], 0.0, 1.0)
    if background is None:
        straight = np.divide(values, alpha, out=np.zeros_like(values, np.float64), where=alpha > 0)
        light = linear_from_srgb(np.clip(straight, 0.0, 1.0)) * alpha
    else:
        light = linear_from_srgb(np.clip(values + (1 - alpha) * srgb_from_linear(np.array(background)), 0.0, 1.0))
        alpha = np.ones_like(alpha)
    info: dict[str, Any] = {**image.info, "mixing": DISPLAY}
    if background is not None:
        info["background"] = list(background)
    return Image(np.concatenate([light, alpha], axis=2).astype(np.float32), info)


def _layer(layer: Layer) -> Layer:
    # a constructor would apply the opacity again
    changed, volume = copy(layer), layer.volume
    if volume.color is not None:
        object.__setattr__(changed, "volume", replace(volume, color=_SAMPLES[np.asarray(volume.color[:])]))
    assert layer.transfer is not None
    object.__setattr__(changed, "transfer", _transfer(layer.transfer))
    return changed


def _transfer(transfer: Transfer) -> Transfer:
    if transfer.labels:
        labels = [(number, _code(srgb), opacity) for number, srgb, opacity in transfer.labels]
        return replace(transfer, labels=labels)
    regions = [region.recolored(_code) for region in transfer.regions]
    return replace(transfer, colormap=_map(transfer.colormap), regions=regions)


def _map(name: str) -> str:
    return colormap_name(np.linspace(0.0, 1.0, ENTRIES), srgb_from_linear(srgb_from_linear(colormap(name))))


def _code(srgb: str) -> str:
    return "#{:02x}{:02x}{:02x}".format(*_SAMPLES[list(bytes.fromhex(srgb[1:]))].tolist())


def _mesh(mesh: Mesh) -> Mesh:
    name = _map(mesh.colormap) if mesh.mapped else mesh.colormap
    colors = None if mesh.colors is None else _SAMPLES[mesh.colors]
    return replace(mesh, color=srgb_from_linear(np.asarray(mesh.color)).tolist(), colors=colors, colormap=name)

"""The panel of napari: draws the viewer's visible image and label layers as a scene, from its camera.

Layers keep their transforms, colours, contrast limits, opacity, order and clipping planes. They are mixed by depth, as
layers of any scene; `info["notes"]` lists what the picture leaves out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.data.arrays import volume_of_level
from splatgl.data.image import Image
from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.geometry.camera import Camera
from splatgl.gl.renderer import shared_renderer
from splatgl.integrations import color_nodes, opacity_nodes, plane_through
from splatgl.planning.scene import LEAST, THROUGH, Layer, Scene
from splatgl.splat.settings import Blend, Settings
from splatgl.transfer.colormaps import SOLID, colormap_name, labels_of
from splatgl.transfer.presets import SURFACE
from splatgl.transfer.transfer import Transfer

if TYPE_CHECKING:
    from splatgl.geometry.clipping import Plane

# largest level of a multiscale layer that is drawn, voxels
MOST_VOXELS = 2**26
# control colours of a layer's colour map
COLORS = 64
# voxels from the position of a napari clipping plane back to the plane, along each axis
HALF = 0.5
# start of parallel rays before the camera's centre, in diagonals of the layers' box
BEFORE = 4.0
# smaller perspective angles count as parallel, degrees
LEAST_PERSPECTIVE = 0.01
# an image layer's `rendering` in 3-D → blend; others are drawn by composite
RENDERINGS: dict[str, Blend] = {
    "translucent": "composite",
    "mip": "mip",
    "attenuated_mip": "attenuated-mip",
    "minip": "minip",
    "average": "mean",
}
KINDS = ("Image", "Labels")


def picture(viewer: Any, blend: Blend | None = None, size: tuple[int, int] | None = None) -> Image:
    """Image of the visible image and label layers of a viewer, on black. blend: None: that of the lowest image layer's
    rendering, of labels composite. size: (width, height) in pixels; None: the canvas' size.

    Raises InputError without a layer to draw, for other blends, and if other than the last three axes are displayed.
    """
    layers = visible_layers(viewer)
    images = [layer for layer in layers if kind_of(layer) == "Image"]
    used = blend or RENDERINGS.get(rendering_of(images[0]) if images else "", "composite")
    settings = Settings(blend=used, background=(0.0, 0.0, 0.0))
    scene = Scene([_layer(layer, viewer, settings) for layer in layers])
    camera, mirrored = camera_of(viewer, scene.corners, size)
    if settings.join == "attenuated":
        settings = settings.replace(mip_attenuation=float(getattr(images[0], "attenuation", 0.05)))
    with shared_renderer() as renderer:
        image = renderer.render(scene, camera, settings)
    notes = (*left_out(viewer, layers, used), *image.notes)
    return Image(image.pixels[:, ::-1].copy() if mirrored else image.pixels, {**image.info, "notes": notes})


def visible_layers(viewer: Any) -> list[Any]:
    """Visible image and label layers of three or more axes, from below. Raises InputError without any."""
    layers = [layer for layer in viewer.layers if layer.visible and kind_of(layer) in KINDS and layer.ndim > 2]
    if not layers:
        raise expected("layers", "a visible Image or Labels layer of three or more axes", "none", "show one")
    return layers


def kind_of(layer: Any) -> str:
    """The kind of a layer: Image, Labels, Points, …"""
    return type(layer).__name__


def rendering_of(layer: Any) -> str:
    """How napari renders a layer in 3-D."""
    rendering = getattr(layer, "rendering", "")
    return str(getattr(rendering, "value", rendering))


def left_out(viewer: Any, layers: Sequence[Any], blend: str) -> Iterator[str]:
    """Notes on everything that napari shows and the picture does not."""
    for layer in viewer.layers:
        if layer.visible and layer not in layers:
            yield f"not rendered: {layer.name}, a {kind_of(layer)} layer of {layer.ndim} axes"
    if viewer.dims.ndisplay == 2:
        yield "all voxels are rendered; the 2-D view shows a slice"
    for layer in layers:
        rendering = rendering_of(layer)
        if kind_of(layer) == "Image" and RENDERINGS.get(rendering) != blend:
            yield f"{layer.name}: rendered as {blend}, not as {rendering}"
        if str(getattr(layer, "depiction", "volume")) == "plane":
            yield f"{layer.name}: rendered as a volume, not as a plane"
    if len(layers) > 1:
        yield "layers are composited by depth, not blended as images"


def _layer(layer: Any, viewer: Any, settings: Settings) -> Layer:
    volume = volume_of(layer, viewer)
    transfer = _labels(layer, volume) if kind_of(layer) == "Labels" else _transfer(layer, volume, settings)
    planes = _clip_planes(layer, volume, displayed_axes(viewer))
    return Layer(volume, transfer, float(layer.opacity), clip=planes or None)


def volume_of(layer: Any, viewer: Any) -> Volume:
    """The volume of a layer at the sliders, of the finest level of up to MOST_VOXELS voxels. Colours are as dense as
    they are bright, or by their alpha.
    """
    lead = layer.ndim - 3
    point = np.asarray(viewer.dims.point, float)[-layer.ndim :]
    levels = list(layer.data) if layer.multiscale else [layer.data]
    index = np.rint(np.asarray(layer.world_to_data(point), float))[:lead].astype(int)
    index = np.clip(index, 0, np.array(levels[0].shape[:lead], int) - 1)
    # levels may be coarser along the axes of sliders, too
    data = [level[tuple(index * level.shape[:lead] // levels[0].shape[:lead])] for level in levels]
    chosen = np.asarray(next((x for x in data if np.prod(x.shape[:3], dtype=float) <= MOST_VOXELS), data[-1]))
    place = partial(volume_of_level, layer, index, data[0].shape[:3])
    if not getattr(layer, "rgb", False):
        return place(chosen, labels=() if kind_of(layer) == "Labels" else None)
    full = float(np.iinfo(chosen.dtype).max) if chosen.dtype.kind == "u" else 1.0
    color = np.rint(255 * np.clip(chosen / full, 0.0, 1.0)).astype(np.uint8)
    samples = color[..., 3] if color.shape[-1] == 4 else color.max(axis=-1)
    return place(samples, color=np.ascontiguousarray(color[..., :3]))


def _transfer(layer: Any, volume: Volume, settings: Settings) -> Transfer:
    """Transfer function of an image layer over its contrast limits, in its colours."""
    if volume.color is not None:
        low, high, colors = 0.0, 255.0, np.repeat(np.linspace(0.0, 1.0, COLORS)[:, None], 3, axis=1)
    else:
        low, high = (float(limit) for limit in layer.contrast_limits)
        shares = np.linspace(0.0, 1.0, COLORS) ** float(layer.gamma)
        colors = np.clip(np.asarray(layer.colormap.map(shares), float)[:, :3], 0.0, 1.0)
    opacities = np.ones(2)
    if not settings.shows_value:
        opacities[:] = 0.0, np.clip(-np.expm1(-THROUGH / volume.shortest), LEAST, SURFACE)
    window, colormap = color_nodes(np.linspace(low, high, COLORS), colors)
    if volume.color is not None and settings.hides:
        # bright voxels are solid, and dim ones hide little
        nodes = opacity_nodes(np.linspace(low, high, COLORS), np.minimum(colors[:, 0] ** 2, SOLID))
        return Transfer(nodes, colormap, window, unit=volume.lengths.spacing, shading=False)
    return Transfer(opacity_nodes(np.array([low, high]), opacities), colormap, window, shading=False)


def _labels(layer: Any, volume: Volume) -> Transfer:
    """Transfer function of labels: solid, in the layer's colours."""
    labels: list[tuple[int, str, float]] = []
    for label in labels_of(replace(volume, labels=())):
        *rgb, alpha = np.asarray(layer.get_color(label.number), float).ravel().tolist()
        code = colormap_name(np.zeros(1), np.array([rgb])).partition(":")[2]
        labels.append((label.number, code, SOLID * float(alpha)))
    numbers = [number for number, _, _ in labels] or [0]
    is_lit = rendering_of(layer) != "translucent"
    return Transfer(((min(numbers), 0.0), (max(numbers), SOLID)), shading=is_lit, labels=labels)


def _clip_planes(layer: Any, volume: Volume, axes: list[int]) -> tuple[Plane, ...]:
    """World clipping planes of the layer. napari keeps the side that the normals point to; it takes positions for the
    world's, of voxels that it draws half a voxel farther along each axis.
    """
    found = []
    for plane in getattr(layer, "experimental_clipping_planes", ()):
        if plane.enabled:
            normal, place = _world(plane.normal, axes), _world(plane.position, axes)
            found.append(plane_through(place - volume.world_from_index @ np.full(3, HALF), normal))
    return tuple(found)


def camera_of(viewer: Any, corners: np.ndarray, size: tuple[int, int] | None = None) -> tuple[Camera, bool]:
    """The viewer's camera, and whether the image is mirrored, as left-handed axes of napari require.

    corners [N, 3]: world (x, y, z), of the scene that parallel rays start before. size: pixels; None: the canvas'.
    """
    scene, canvas = getattr(viewer, "scene", None), getattr(viewer, "canvas", None)
    camera, axes = viewer.camera if scene is None else scene.camera, displayed_axes(viewer)
    high, wide = canvas.size if canvas is not None else viewer._canvas_size
    width, rows = size or (max(1, round(wide)), max(1, round(high)))
    directions = getattr(camera, "orientation", ("towards", "down", "right"))
    orientation = [str(getattr(each, "value", each)) for each in directions]
    center, ahead, up = list(camera.center), camera.view_direction, camera.up_direction
    if viewer.dims.ndisplay == 2:
        # along the slider's axis; the depth of its plane does not matter to parallel rays
        middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
        center = [middle[::-1][axes[0]], *center[-2:]]
        ahead = (1.0 if orientation[0] == "away" else -1.0, 0, 0)
        up = (0, -1.0 if orientation[1] == "down" else 1.0, 0)
    focus, ahead, up = (_world(vector, axes) for vector in (center, ahead, up))
    reversals = sum(a != b for a, b in zip(orientation, ("away", "down", "right"), strict=True))
    mirrored = (np.linalg.det(np.eye(3)[axes]) < 0) != (reversals % 2 == 1)
    height = float(high) / float(camera.zoom)
    fov = float(camera.perspective) if viewer.dims.ndisplay == 3 else 0.0
    if fov >= LEAST_PERSPECTIVE:
        away = height / (2 * np.tan(np.radians(fov) / 2))
        return Camera.look_at(focus - ahead * away, focus, up, fov, (width, rows)), mirrored
    reach = BEFORE * float(np.linalg.norm(np.ptp(corners, axis=0)))
    reach += float(np.linalg.norm(corners - focus, axis=1).max())
    return Camera.orthographic(focus - ahead * reach, focus, up, height, (width, rows)), mirrored


def displayed_axes(viewer: Any) -> list[int]:
    """The displayed order of the last three axes, 0 to 2; in 2-D the slider's axis is first."""
    shown = [int(axis) for axis in viewer.dims.order[-3:]]
    axes = [axis - (int(viewer.dims.ndim) - 3) for axis in shown]
    if sorted(axes) != [0, 1, 2]:
        raise expected("view", "the last three axes", f"axes {tuple(shown)}", "reset the order of the axes")
    return axes


def _world(value: Sequence[float], axes: list[int]) -> np.ndarray:
    """World (x, y, z) of a vector along the displayed axes."""
    vector = np.zeros(3)
    vector[axes] = np.asarray(value, float)
    return vector[::-1]

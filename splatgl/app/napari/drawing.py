"""The picture of a napari viewer's visible layers, from its camera, as splatgl draws them; nothing here needs Qt.

A layer's colour map, contrast limits, gamma and opacity are kept. Blends that composite are clear at the low contrast
limit, and denser towards the high one; in the others a layer's opacity is the same for all values, as in napari.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.app.kept import kept_renderer
from splatgl.data.errors import expected
from splatgl.data.image import Image
from splatgl.data.volume import Volume
from splatgl.splat.classification.colormap import of_colors
from splatgl.splat.classification.labels import SOLID, labels_of
from splatgl.splat.classification.looks import SURFACE
from splatgl.splat.classification.transfer import Transfer
from splatgl.splat.layers.channels import LEAST, THROUGH
from splatgl.splat.layers.layers import Layer, Scene
from splatgl.splat.plan.blend_mode import BLENDS
from splatgl.splat.plan.settings import Settings
from splatgl.splat.view.camera import Camera

if TYPE_CHECKING:
    from collections.abc import Sequence

# control colours of a layer's colour map
COLORS = 64
# voxels of the finest level of a multiscale layer that is drawn
MOST_VOXELS = 2**26
# parallel rays begin this many radii of the layers' extent before the camera's centre
BEFORE = 4.0
# perspectives below are parallel, degrees
LEAST_PERSPECTIVE = 0.01
BLACK = (0.0, 0.0, 0.0)
# a layer's `rendering` in 3-D → blend
RENDERINGS = {"mip": "mip", "attenuated_mip": "mip", "minip": "minip", "average": "mean", "additive": "xray"}


def picture(viewer: Any, blend: str | None = None, size: tuple[int, int] | None = None) -> Image:
    """The picture of the visible layers, on black. blend: None: what napari draws all of them by, else composite.
    size: (width, height) in pixels; None: of the canvas.

    Raises InputError if there is nothing to draw, or if other than the last three axes are displayed.
    """
    layers = seen(viewer)
    if blend is None:
        ways = {RENDERINGS.get(str(getattr(each, "rendering", "")), "composite") for each in layers}
        blend = ways.pop() if len(ways) == 1 else "composite"
    scene = scene_of(viewer, layers, blend)
    camera, mirrored = camera_of(viewer, scene.corners, size)
    with kept_renderer() as renderer:
        image = renderer.render(scene, camera, Settings(blend=blend, background=BLACK))
    return Image(image.pixels[:, ::-1].copy(), image.info) if mirrored else image


def told(image: Image) -> str:
    """What was drawn, in a line."""
    info, (height, width, _) = image.info, image.pixels.shape
    by = str(info["renderer"]).partition(" (")[0]
    return f"{width}×{height} pixels, {info['blend']} of {info['splats']:,} splats, {info['seconds']:.2f} s by {by}"


def seen(viewer: Any) -> list[Any]:
    """The visible layers that can be drawn. Raises InputError if there are none."""
    kinds = ("Image", "Labels")
    found = [each for each in viewer.layers if each.visible and type(each).__name__ in kinds and each.ndim >= 3]
    if not found:
        raise expected("layers", "a visible Image or Labels layer of three or more axes", "none", "show one")
    return found


def scene_of(viewer: Any, layers: Sequence[Any], blend: str) -> Scene:
    """The layers at the viewer's time, as `blend` shows them."""
    if blend not in BLENDS:
        raise expected("blend", f"one of {', '.join(BLENDS)}", repr(blend))
    made = []
    for each in layers:
        volume = _volume(each, viewer)
        look = _labels(each, volume) if type(each).__name__ == "Labels" else _look(each, volume, blend)
        made.append(Layer(volume, look))
    return Scene(made)


def _volume(layer: Any, viewer: Any) -> Volume:
    """The volume of a layer, where the viewer's slider stands."""
    if layer.ndim == 3:
        volume = Volume.of(layer)
    else:
        point = np.asarray(viewer.dims.point)[-layer.ndim :]
        at = round(float(np.asarray(layer.world_to_data(point))[0]))
        first = layer.data[0] if layer.multiscale else layer.data
        volume = Volume.of(layer, array=min(max(at, 0), first.shape[0] - 1))
    return next((each for each in (volume, *volume.coarser) if each.count <= MOST_VOXELS), volume)


def _look(layer: Any, volume: Volume, blend: str) -> Transfer:
    """The transfer function of an image layer."""
    low, high = (float(limit) for limit in layer.contrast_limits)
    places = np.linspace(0.0, 1.0, COLORS)
    colors = np.asarray(layer.colormap.map(places ** float(layer.gamma)))[:, :3]
    full = float(layer.opacity)
    if BLENDS[blend].ordered or BLENDS[blend].unbounded:
        full *= float(np.clip(-np.expm1(-THROUGH / min(volume.shape)), LEAST, SURFACE))
        points = ((low, 0.0), (high, full))
    else:
        points = ((low, full), (high, full))
    return Transfer(points, of_colors(places, colors), (low, high), shading=False)


def _labels(layer: Any, volume: Volume) -> Transfer:
    """The transfer function of labels: solid, in the layer's colours."""
    shown: list[tuple[int, str, float]] = []
    for label in labels_of(replace(volume, labels=())):
        *rgb, alpha = np.asarray(layer.get_color(label.number), float).ravel().tolist()
        code = of_colors(np.zeros(1), np.array([rgb])).partition(":")[2]
        shown.append((label.number, code, SOLID * float(alpha) * float(layer.opacity)))
    numbers = [number for number, _, _ in shown] or [0]
    return Transfer(((min(numbers), 0.0), (max(numbers), SOLID)), labels=shown)


def camera_of(viewer: Any, corners: np.ndarray, size: tuple[int, int] | None = None) -> tuple[Camera, bool]:
    """The viewer's camera, and whether its picture is mirrored: napari can be set to left-handed axes.

    corners [N, 3]: world (x, y, z), of what the rays of a parallel view must not miss. size: (width, height) of the
    picture; None: of the canvas.
    """
    camera, axes = viewer.camera, _displayed(viewer)
    center, ahead, up = list(camera.center), camera.view_direction, camera.up_direction
    if viewer.dims.ndisplay == 2:
        # seen along the axis of the slider; where its plane is does not matter to parallel rays
        middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
        center = [middle[::-1][axes[0]], *center[-2:]]
        depth, vertical, _ = _orientation(camera)
        ahead, up = (1.0 if depth == "away" else -1.0, 0, 0), (0, -1.0 if vertical == "down" else 1.0, 0)
    focus, ahead, up = (_world(each, axes) for each in (center, ahead, up))
    usual = ("away", "down", "right")
    turned = sum(each != other for each, other in zip(_orientation(camera), usual, strict=True))
    mirrored = (np.linalg.det(np.eye(3)[axes]) < 0) != (turned % 2 == 1)
    wide, high = _canvas(viewer)
    height = high / float(camera.zoom)
    width, rows = size or (round(wide), round(high))
    fov = float(camera.perspective) if viewer.dims.ndisplay == 3 else 0.0
    if fov >= LEAST_PERSPECTIVE:
        away = height / (2 * np.tan(np.radians(fov) / 2))
        return Camera.look_at(focus - ahead * away, focus, up, fov, (width, rows)), mirrored
    reach = BEFORE * float(np.linalg.norm(np.ptp(corners, axis=0)))
    reach += float(np.linalg.norm(corners - focus, axis=1).max())
    return Camera.orthographic(focus - ahead * reach, focus, up, height, (width, rows)), mirrored


def _canvas(viewer: Any) -> tuple[float, float]:
    """(width, height) of the canvas, in the pixels that the zoom counts."""
    canvas = getattr(viewer, "canvas", None)
    high, wide = canvas.size if canvas is not None else viewer._canvas_size
    return float(wide), float(high)


def _displayed(viewer: Any) -> list[int]:
    """The displayed axes of the last three, as numbers from 0 to 2; in 2-D the one that the view runs along first."""
    count = viewer.dims.ndim
    axes = [axis - (count - 3) for axis in viewer.dims.order[-3:]]
    if sorted(axes) != [0, 1, 2]:
        raise expected("view", "the last three axes", f"axes {viewer.dims.order[-3:]}", "reset the order of the axes")
    return axes


def _world(value: Sequence[float], axes: list[int]) -> np.ndarray:
    """World (x, y, z) of a vector along the displayed axes."""
    found = np.zeros(3)
    found[axes] = np.asarray(value, float)
    return found[::-1]


def _orientation(camera: Any) -> tuple[str, ...]:
    """Where the axes of depth, down and right point; versions before 0.6 know one way."""
    told = getattr(camera, "orientation", ("towards", "down", "right"))
    return tuple(str(getattr(each, "value", each)) for each in told)

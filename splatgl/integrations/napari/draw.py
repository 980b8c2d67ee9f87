"""Images of a napari viewer's visible layers from its camera; needs no Qt.

As in napari, each layer has an image in sRGB, which is drawn over the layers below by its opacity and blending; a 2-D
view shows slices. Opaque surfaces, and all layers in one blend, are mixed by depth. Colour maps, contrast limits,
gamma, clipping planes and planes of depiction are respected; `info["notes"]` lists the differences.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.data.color import linear_from_srgb
from splatgl.data.image import Image
from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.integrations import color_nodes, opacity_nodes, plane_through
from splatgl.scene.draw import DrawOptions, draw_subject
from splatgl.splat.camera import Camera
from splatgl.splat.clipping import Plane
from splatgl.splat.colormaps import SOLID, colormap_name, labels_of
from splatgl.splat.presets import SURFACE
from splatgl.splat.scene import LEAST, THROUGH, Layer, Scene
from splatgl.splat.settings import BLENDS, Blend, Settings
from splatgl.splat.transfer import Transfer

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence


# control colours of a layer's colour map
COLORS = 64
# share of the contrast limits below which napari ignores values of a maximum, and above which values of a minimum
CUTOFF = 1e-3
# voxels from the position of a napari clipping plane back to the plane, along each axis
HALF = 0.5
# thickness of a drawn plane of depiction, voxels
THIN = 0.02
# distance between samples of napari's rays, voxels
STEP = 0.8
# largest level of a multiscale layer that is drawn, voxels
MOST_VOXELS = 2**26
# start of parallel rays before the camera's centre, in diagonals of the layers' box
BEFORE = 4.0
# smaller perspective angles count as parallel, degrees
LEAST_PERSPECTIVE = 0.01
BLACK = (0.0, 0.0, 0.0)
# an image layer's `rendering` in 3-D → blend of its image; others: composite
RENDERINGS: dict[str, Blend] = {"mip": "mip", "attenuated_mip": "mip", "minip": "minip", "average": "mean"}
# functions that join samples across a plane
ACROSS = {"mip": np.maximum, "attenuated_mip": np.maximum, "minip": np.minimum, "average": np.add}
# another rendering
ADDITIVE = "additive"
# blendings that keep pixels without values in the contrast limits, and blendings that mix surfaces by depth
CUT, BY_DEPTH = ("translucent", "translucent_no_depth"), ("translucent", "opaque")
# attributes of a viewer, and of a layer, that may be visible but are not drawn
VIEWER_EXTRAS = {"scale_bar": "scale bar", "axes": "axes", "text_overlay": "text"}
LAYER_EXTRAS = {"bounding_box": "bounding box", "colorbar": "colour bar", "name_overlay": "name"}


@dataclass(frozen=True, eq=False)
class LayerImage:
    """Image of a layer: sRGB [H, W, 3] from 0 to 1, not premultiplied, and alpha [H, W]."""

    rgb: np.ndarray
    alpha: np.ndarray

    @classmethod
    def of(cls, pixels: np.ndarray) -> LayerImage:
        """Image from linear, premultiplied pixels [H, W, 4]."""
        straight = Image(pixels).straight()
        return cls(straight[..., :3], straight[..., 3])

    def over(self, ground: np.ndarray, blending: str, opacity: float, is_first: bool) -> np.ndarray:
        """The layer [H, W, 3] over the layers below, by napari's blending; the first layer has none below."""
        alpha, drawn = (self.alpha * opacity)[..., None], (self.alpha > 0)[..., None]
        if blending == "minimum":
            return np.where(drawn, self.rgb if is_first else np.minimum(self.rgb, ground), ground)
        if blending == "additive":
            return np.where(drawn, np.minimum(self.rgb * alpha + (0 if is_first else ground), 1), ground)
        if blending == "multiplicative" and not is_first:
            return np.where(drawn, self.rgb * ground, ground)
        if blending == "opaque" and not is_first:
            alpha = self.alpha[..., None]
        return self.rgb * alpha + ground * (1 - alpha)


def picture(viewer: Any, blend: Blend | None = None, size: tuple[int, int] | None = None) -> Image:
    """Image of the visible layers on the canvas' colour. blend: None: each layer as in napari, in 2-D its slice; else
    all voxels in that blend, on black. size: (width, height) in pixels; None: the canvas' size.

    Raises InputError without a layer to draw, and for volumes if other than the last three axes are displayed.
    """
    is_flat = viewer.dims.ndisplay == 2 and blend is None
    layers = visible_layers(viewer, 2 if is_flat else 3)
    notes = tuple(_list_differences(viewer, layers, blend))
    if blend is not None:
        image = _draw(viewer, scene_of(viewer, layers, blend), blend, size, BLACK)
        return Image(image.pixels, {**image.info, "notes": notes})
    width, height = size or _pixels(viewer)
    ground, infos = np.broadcast_to(_ground(viewer), (height, width, 3)), list[dict[str, Any]]()
    for number, group in enumerate([[layer] for layer in layers] if is_flat else _groups(layers)):
        drawn, info = (_slice(group[0], viewer, size), []) if is_flat else _draw_group(viewer, group, size)
        infos += info
        if drawn is not None:
            ground = drawn.over(ground, group[0].blending, float(group[0].opacity), number == 0)
    pixels = np.dstack([linear_from_srgb(ground), np.ones((height, width))]).astype(np.float32)
    # slices have no info
    blends = ", ".join(dict.fromkeys(str(info["blend"]) for info in infos)) or "slices"
    counts = {key: sum(info[key] for info in infos) for key in ("splats", "seconds") if infos}
    return Image(pixels, {**(infos[0] if infos else {}), **counts, "blend": blends, "notes": notes})


def summary(image: Image) -> str:
    """Summary line of an image, and a line for each of its notes."""
    info, (height, width, _) = image.info, image.pixels.shape
    line = f"{width}×{height} pixels, {info['blend']}"
    if "renderer" in info:
        by = str(info["renderer"]).partition(" (")[0]
        line += f" of {info['splats']:,} splats, {info['seconds']:.2f} s by {by}"
    return "\n".join([line, *info.get("notes", ())])  # type: ignore[misc]


def _groups(layers: Sequence[Any]) -> list[list[Any]]:
    """Layers by common image, from below: consecutive opaque surfaces are ordered by depth."""
    groups: list[list[Any]] = []
    for layer in layers:
        if groups and _is_surface(layer) and _is_surface(groups[-1][-1]):
            groups[-1].append(layer)
        else:
            groups.append([layer])
    return groups


def _is_surface(layer: Any) -> bool:
    is_solid = _is_labels(layer) or layer.rendering == "iso"
    return bool(is_solid and layer.opacity == 1 and layer.blending in BY_DEPTH)


def _draw_group(
    viewer: Any, group: Sequence[Any], size: tuple[int, int] | None
) -> tuple[LayerImage, list[dict[str, Any]]]:
    """Image of layers without their opacity, and its info."""
    rendering = str(getattr(group[0], "rendering", ""))
    if rendering == ADDITIVE:
        return _draw_additive(viewer, group[0], size)
    layers = []
    for layer in group:
        volume = _across_plane(layer, _volume(layer, viewer), viewer)
        transfer = _labels(layer, volume) if _is_labels(layer) else _layer_transfer(layer, volume)
        layers.append(Layer(volume, transfer, clip=_clip_planes(layer, volume, viewer)))
    image = _draw(viewer, Scene(layers), RENDERINGS.get(rendering, "composite"), size)
    return LayerImage.of(image.pixels), [dict(image.info)]


def _draw_additive(viewer: Any, layer: Any, size: tuple[int, int] | None) -> tuple[LayerImage, list[dict[str, Any]]]:
    """napari's additive rendering, channel by channel: 1 − Π (1 − colour of a sample)."""
    volume = _volume(layer, viewer)
    values, colors = _palette(layer)
    step = STEP * float(np.mean(volume.spacing))
    images, infos = dict[bytes, np.ndarray](), list[dict[str, Any]]()
    channels = [np.minimum(channel, SOLID) for channel in colors[:, :3].T]
    for shares in {channel.tobytes(): channel for channel in channels}.values():
        transfer = Transfer(opacity_nodes(values, shares), unit=step, shading=False)
        image = _draw(
            viewer, Scene([Layer(volume, transfer, clip=_clip_planes(layer, volume, viewer))]), "composite", size
        )
        images[shares.tobytes()] = image.pixels[..., 3]
        infos.append({**image.info, "blend": ADDITIVE})
    rgb = np.dstack([images[channel.tobytes()] for channel in channels])
    return LayerImage(rgb, np.ones(rgb.shape[:2])), infos


def _draw(
    viewer: Any,
    scene: Scene,
    blend: Blend,
    size: tuple[int, int] | None,
    background: tuple[float, float, float] | None = None,
) -> Image:
    """Draws the scene from the viewer's camera."""
    camera, mirrored = camera_of(viewer, scene.corners, size)
    settings = Settings(blend=blend, background=background)
    image = draw_subject(scene, camera, settings, DrawOptions(is_shared=True, check=0))
    return Image(image.pixels[:, ::-1].copy(), image.info) if mirrored else image


def visible_layers(viewer: Any, axes: int = 3) -> list[Any]:
    """Visible layers that can be drawn, with at least that many axes. Raises InputError without any."""
    layers = [layer for layer in viewer.layers if layer.visible and _is_drawable(layer, axes)]
    if not layers:
        least = {2: "two", 3: "three"}[axes]
        raise expected("layers", f"a visible Image or Labels layer of {least} or more axes", "none", "show one")
    return layers


def _is_drawable(layer: Any, axes: int) -> bool:
    is_field = type(layer).__name__ in ("Image", "Labels") and layer.ndim >= axes
    return is_field and not (axes == 3 and getattr(layer, "rgb", False))


def _is_labels(layer: Any) -> bool:
    return type(layer).__name__ == "Labels"


def _list_differences(viewer: Any, layers: Sequence[Any], blend: str | None) -> Iterator[str]:
    """A line for each thing that napari shows and the image does not."""
    is_flat = viewer.dims.ndisplay == 2
    for layer in viewer.layers:
        if layer.visible and layer not in layers:
            kind = "colours (rgb)" if getattr(layer, "rgb", False) else f"a {type(layer).__name__} layer"
            yield f"not drawn: {layer.name}, {kind}"
    yield from (f"not drawn: {name}" for name in _visible(viewer, VIEWER_EXTRAS))
    if getattr(getattr(viewer, "grid", None), "enabled", False):
        yield "not drawn: the grid, its layers are in one place"
    for layer in layers:
        yield from (f"not drawn: {layer.name}'s {name}" for name in _visible(layer, LAYER_EXTRAS))
        lines = _flat_differences(layer, viewer) if is_flat and blend is None else _solid_differences(layer, blend)
        yield from (f"{layer.name}: {line}" for line in lines)
    if is_flat and blend is not None:
        yield "all voxels are drawn: the 2-D view shows a slice"
    is_mixed = any(layer.blending in BY_DEPTH and not _is_surface(layer) for layer in layers)
    if blend is None and not is_flat and len(layers) > 1 and is_mixed:
        yield "layers that are not opaque surfaces are drawn over each other in their order, not by depth"


def _visible(holder: Any, names: dict[str, str]) -> Iterator[str]:
    for attribute, name in names.items():
        if getattr(getattr(holder, attribute, None), "visible", False):
            yield name


def _solid_differences(layer: Any, blend: str | None) -> Iterator[str]:
    """Differences of a layer in 3-D."""
    rendering = str(getattr(layer, "rendering", ""))
    if blend is None and rendering == "attenuated_mip":
        yield "drawn without its attenuation, as mip"
    is_plane = str(getattr(layer, "depiction", "volume")) == "plane"
    if is_plane and (blend is not None or rendering not in ACROSS):
        yield f"its plane is drawn thin, without its thickness of {float(layer.plane.thickness):g} voxels"
    if blend is None and rendering == "iso":
        yield "drawn at its threshold, lit by splatgl's light"
    if blend is None and rendering == "translucent" and not _is_labels(layer) and (_palette(layer)[1][:, 3] == 1).all():
        yield "its colour map is opaque, so that napari shows the faces of its box: drawn denser for larger values"
    if str(getattr(layer, "interpolation3d", "linear")) == "nearest" and not _is_labels(layer):
        yield "drawn between voxels, not by the nearest"


def _flat_differences(layer: Any, viewer: Any) -> Iterator[str]:
    """Differences of a layer in 2-D."""
    interpolation = str(getattr(layer, "interpolation2d", "nearest"))
    if interpolation not in ("nearest", "linear", "bilinear") and not _is_labels(layer):
        yield f"interpolated linearly, not by {interpolation}"
    if int(getattr(layer, "contour", 0)):
        yield "its labels are filled, not outlined"
    margins = (*getattr(viewer.dims, "margin_left", ()), *getattr(viewer.dims, "margin_right", ()))
    if str(getattr(layer, "projection_mode", "none")) != "none" and any(margins):
        yield f"one slice is drawn, not the {layer.projection_mode} of several"


def _ground(viewer: Any) -> np.ndarray:
    """sRGB [3] of the canvas, by the viewer's theme."""
    theme = getattr(viewer, "theme", None)
    if theme is None:
        return np.zeros(3)
    from napari.utils.theme import get_theme

    return np.array(get_theme(theme).canvas.as_rgb_tuple()[:3], float) / 255


def _clip_planes(layer: Any, volume: Volume, viewer: Any) -> tuple[Plane, ...] | None:
    """World clipping planes of the layer, and both sides of its plane of depiction; None if it has none.

    napari keeps the side that the normals point to. Positions of clipping planes are in the world, of voxels drawn half
    a voxel farther along each axis; positions of the plane of depiction are in voxels.
    """
    axes, planes = _displayed_axes(viewer), list[Plane]()
    for plane in getattr(layer, "experimental_clipping_planes", ()):
        if plane.enabled:
            normal, place = _world(plane.normal, axes), _world(plane.position, axes)
            planes.append(plane_through(place - volume.world_from_index @ np.full(3, HALF), normal))
    if str(getattr(layer, "depiction", "volume")) == "plane":
        place = volume.world_from_index @ _world(layer.plane.position, axes) + np.array(volume.origin)
        # 1 / |normal| along the normal is a voxel
        normal = np.linalg.inv(volume.world_from_index).T @ _world(layer.plane.normal, axes)
        half = THIN / 2 * normal / float(normal @ normal)
        planes += [plane_through(place - half, normal), plane_through(place + half, -normal)]
    return tuple(planes) or None


def _across_plane(layer: Any, volume: Volume, viewer: Any) -> Volume:
    """The volume of a plane of depiction: samples joined across the plane as in napari."""
    join = ACROSS.get(str(getattr(layer, "rendering", "")))
    if str(getattr(layer, "depiction", "volume")) != "plane" or join is None:
        return volume
    count = max(int(float(layer.plane.thickness) / STEP + 0.5), 1)
    normal = _world(layer.plane.normal, _displayed_axes(viewer))[::-1]
    normal = normal / np.linalg.norm(normal)
    samples = np.asarray(volume.samples[:]).astype(np.float32)
    joined = _shift(samples, normal * (-count / 2))
    for number in range(1, count):
        joined = join(joined, _shift(samples, normal * (number - count / 2)))
    return replace(volume, samples=joined / count if join is np.add else joined)


def _shift(samples: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Samples [D, H, W] interpolated linearly that many voxels farther along each axis; ends repeat."""
    for axis, (step, count) in enumerate(zip(by.tolist(), samples.shape, strict=True)):
        first = np.arange(count) + int(np.floor(step))
        near, far = (samples.take(np.clip(first + side, 0, count - 1), axis) for side in (0, 1))
        samples = near + np.float32(step % 1.0) * (far - near)
    return samples


def scene_of(viewer: Any, layers: Sequence[Any], blend: str) -> Scene:
    """Scene of the layers at the viewer's time, in a blend."""
    if blend not in BLENDS:
        raise expected("blend", f"one of {', '.join(BLENDS)}", repr(blend))
    scene = []
    for layer in layers:
        volume = _volume(layer, viewer)
        transfer = _labels(layer, volume) if _is_labels(layer) else _blend_transfer(layer, volume, blend)
        scene.append(Layer(volume, transfer, float(layer.opacity), clip=_clip_planes(layer, volume, viewer)))
    return Scene(scene)


def _volume(layer: Any, viewer: Any) -> Volume:
    """Volume of a layer at the viewer's slider."""
    if layer.ndim == 3:
        volume = Volume.of(layer)
    else:
        point = np.asarray(viewer.dims.point)[-layer.ndim :]
        at = round(float(np.asarray(layer.world_to_data(point))[0]))
        volume = Volume.of(layer, array=min(max(at, 0), _finest(layer).shape[0] - 1))
    return next((level for level in (volume, *volume.coarser) if level.count <= MOST_VOXELS), volume)


def _palette(layer: Any) -> tuple[np.ndarray, np.ndarray]:
    """Values [COLORS] over an image layer's contrast limits, their sRGB colours and alpha [COLORS, 4]."""
    low, high = (float(limit) for limit in layer.contrast_limits)
    places = np.linspace(0.0, 1.0, COLORS)
    colors = np.asarray(layer.colormap.map(places ** float(layer.gamma)), float)
    alpha = colors[:, 3:] if colors.shape[1] > 3 else np.ones((COLORS, 1))
    return low + places * (high - low), np.clip(np.hstack([colors[:, :3], alpha]), 0.0, 1.0)


def _blend_transfer(layer: Any, volume: Volume, blend: str) -> Transfer:
    """Transfer function of an image layer in a blend, without its opacity."""
    values, colors = _palette(layer)
    opacities = np.ones(2)
    if BLENDS[blend].ordered or BLENDS[blend].unbounded:
        opacities[:] = 0.0, np.clip(-np.expm1(-THROUGH / min(volume.shape)), LEAST, SURFACE)
    window, colormap = color_nodes(values, colors[:, :3])
    return Transfer(opacity_nodes(values[[0, -1]], opacities), colormap, window, shading=False)


def _layer_transfer(layer: Any, volume: Volume) -> Transfer:
    """Transfer function of an image layer by napari's rendering, without its opacity."""
    rendering = str(layer.rendering)
    blend = RENDERINGS.get(rendering, "composite")
    transfer = _blend_transfer(layer, volume, blend)
    values, colors = _palette(layer)
    low, high = float(values[0]), float(values[-1])
    margin = CUTOFF * (high - low)
    if rendering == "iso":
        threshold = float(layer.iso_threshold)
        return replace(transfer, points=((threshold, 0.0), (threshold, SOLID)), shading=True)
    if rendering == "translucent" and (colors[:, 3] < 1).any():
        shares = np.minimum(colors[:, 3], SOLID)
        step = STEP * float(np.mean(volume.spacing))
        return replace(transfer, points=opacity_nodes(values, shares), unit=step)
    if blend == "mip" and layer.blending in CUT:
        return replace(transfer, points=((low + margin, 0.0), (low + margin, 1.0)))
    if blend == "minip" and layer.blending in CUT:
        return replace(transfer, points=((high - margin, 1.0), (high - margin, 0.0)))
    return transfer


def _labels(layer: Any, volume: Volume) -> Transfer:
    """Transfer function of labels: solid, in the layer's colours."""
    labels: list[tuple[int, str, float]] = []
    for label in labels_of(replace(volume, labels=())):
        *rgb, alpha = np.asarray(layer.get_color(label.number), float).ravel().tolist()
        code = colormap_name(np.zeros(1), np.array([rgb])).partition(":")[2]
        labels.append((label.number, code, SOLID * float(alpha)))
    numbers = [number for number, _, _ in labels] or [0]
    is_lit = str(getattr(layer, "rendering", "")) != "translucent"
    return Transfer(((min(numbers), 0.0), (max(numbers), SOLID)), shading=is_lit, labels=labels)


def _slice(layer: Any, viewer: Any, size: tuple[int, int] | None) -> LayerImage | None:
    """Slice of a layer at the viewer's sliders, in a 2-D view; None outside of the layer."""
    down, across = (axis - (viewer.dims.ndim - layer.ndim) for axis in viewer.dims.order[-2:])
    if min(down, across) < 0:
        raise expected("view", f"axes that {layer.name} has", "others", "reset the order of the axes")
    point = np.asarray(viewer.dims.point, float)[-layer.ndim :].copy()
    index = np.rint(np.asarray(layer.world_to_data(point), float))
    rows, columns = _screen(viewer, size)
    places = []
    for row, column in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)):
        point[[down, across]] = row, column
        places.append(np.asarray(layer.world_to_data(point), float))
    start, *steps = places
    by_row, by_column = (step - start for step in steps)
    at = {k: start[k] + rows[:, None] * by_row[k] + columns * by_column[k] for k in (down, across)}
    data = layer.data[int(getattr(layer, "data_level", 0))] if layer.multiscale else layer.data
    scale = np.array(data.shape[: layer.ndim]) / np.array(_finest(layer).shape[: layer.ndim])
    selection: list[Any] = [slice(None)] * layer.ndim
    for k in set(range(layer.ndim)) - set(at):
        selection[k] = int(np.rint((index[k] + 0.5) * scale[k] - 0.5))
        if not 0 <= selection[k] < data.shape[k]:
            return None
    samples = np.asarray(data[tuple(selection)])
    is_linear = not _is_labels(layer) and str(getattr(layer, "interpolation2d", "nearest")) != "nearest"
    first, second = ((at[k] + 0.5) * scale[k] - 0.5 for k in sorted(at))
    values, inside = _sample(samples, first, second, is_linear)
    rgba = _colorize(layer, values)
    return LayerImage(rgba[..., :3], np.where(inside, rgba[..., 3], 0.0))


def _screen(viewer: Any, size: tuple[int, int] | None) -> tuple[np.ndarray, np.ndarray]:
    """World places of a 2-D view's rows and columns along the two displayed axes."""
    camera, (width, height) = viewer.camera, size or _pixels(viewer)
    step = _canvas(viewer)[1] / height / float(camera.zoom)
    _, vertical, horizontal = _orientation(camera)
    middle = np.asarray(camera.center, float)[-2:]
    rows = (np.arange(height) + 0.5 - height / 2) * (step if vertical == "down" else -step) + middle[0]
    columns = (np.arange(width) + 0.5 - width / 2) * (step if horizontal == "right" else -step) + middle[1]
    return rows, columns


def _finest(layer: Any) -> Any:
    return layer.data[0] if layer.multiscale else layer.data


def _sample(
    samples: np.ndarray, first: np.ndarray, second: np.ndarray, is_linear: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Nearest or linear samples [N, M, …] at places [H, W] along two axes, and whether each place is inside."""
    inside = np.ones(first.shape, bool)
    for at, count in zip((first, second), samples.shape, strict=False):
        inside &= (at >= -0.5) & (at < count - 0.5)
    if not is_linear:
        return samples[_nearest(first, samples.shape[0]), _nearest(second, samples.shape[1])], inside
    total = np.zeros((*first.shape, *samples.shape[2:]))
    for far_first in (0, 1):
        for far_second in (0, 1):
            weight = np.abs(1 - far_first - first % 1) * np.abs(1 - far_second - second % 1)
            row, column = np.floor(first) + far_first, np.floor(second) + far_second
            part = samples[_nearest(row, samples.shape[0]), _nearest(column, samples.shape[1])].astype(float)
            total += part * weight.reshape(weight.shape + (1,) * (part.ndim - 2))
    return total, inside


def _nearest(at: np.ndarray, count: int) -> np.ndarray:
    return np.clip(np.floor(at + 0.5), 0, count - 1).astype(np.intp)


def _colorize(layer: Any, values: np.ndarray) -> np.ndarray:
    """sRGB and alpha [H, W, 4] of values by the layer's colours; NaN is transparent."""
    if _is_labels(layer):
        numbers, places = np.unique(values, return_inverse=True)
        rows = [np.zeros(4) if color is None else np.ravel(color) for color in map(layer.get_color, numbers.tolist())]
        return np.array(rows, float)[places.reshape(values.shape)]
    if getattr(layer, "rgb", False):
        full = float(np.iinfo(layer.dtype).max) if np.dtype(layer.dtype).kind == "u" else 1.0
        colors = np.clip(values / full, 0.0, 1.0)
        return colors if colors.shape[-1] == 4 else np.dstack([colors, np.ones(colors.shape[:2])])
    low, high = (float(limit) for limit in layer.contrast_limits)
    shares = np.clip((np.nan_to_num(values.astype(float), nan=low) - low) / (high - low), 0, 1) ** float(layer.gamma)
    colors = np.asarray(layer.colormap.map(shares.ravel()), float).reshape(*values.shape, -1)
    if colors.shape[-1] == 3:
        colors = np.dstack([colors, np.ones(values.shape)])
    colors[~np.isfinite(values), 3] = 0.0
    return np.clip(colors, 0.0, 1.0)


def camera_of(viewer: Any, corners: np.ndarray, size: tuple[int, int] | None = None) -> tuple[Camera, bool]:
    """The viewer's camera, and whether the image is mirrored, as left-handed axes of napari require.

    corners [N, 3]: world (x, y, z), of the scene that parallel rays start before. size: (width, height); None: the
    canvas' size.
    """
    camera, axes = viewer.camera, _displayed_axes(viewer)
    center, ahead, up = list(camera.center), camera.view_direction, camera.up_direction
    if viewer.dims.ndisplay == 2:
        # along the slider's axis; the depth of its plane does not matter to parallel rays
        middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
        center = [middle[::-1][axes[0]], *center[-2:]]
        depth, vertical, _ = _orientation(camera)
        ahead, up = (1.0 if depth == "away" else -1.0, 0, 0), (0, -1.0 if vertical == "down" else 1.0, 0)
    focus, ahead, up = (_world(vector, axes) for vector in (center, ahead, up))
    reversals = sum(a != b for a, b in zip(_orientation(camera), ("away", "down", "right"), strict=True))
    mirrored = (np.linalg.det(np.eye(3)[axes]) < 0) != (reversals % 2 == 1)
    height = _canvas(viewer)[1] / float(camera.zoom)
    width, rows = size or _pixels(viewer)
    fov = float(camera.perspective) if viewer.dims.ndisplay == 3 else 0.0
    if fov >= LEAST_PERSPECTIVE:
        away = height / (2 * np.tan(np.radians(fov) / 2))
        return Camera.look_at(focus - ahead * away, focus, up, fov, (width, rows)), mirrored
    reach = BEFORE * float(np.linalg.norm(np.ptp(corners, axis=0)))
    reach += float(np.linalg.norm(corners - focus, axis=1).max())
    return Camera.orthographic(focus - ahead * reach, focus, up, height, (width, rows)), mirrored


def _canvas(viewer: Any) -> tuple[float, float]:
    """(width, height) of the canvas in the pixels of its zoom."""
    canvas = getattr(viewer, "canvas", None)
    high, wide = canvas.size if canvas is not None else viewer._canvas_size
    return float(wide), float(high)


def _pixels(viewer: Any) -> tuple[int, int]:
    wide, high = _canvas(viewer)
    return round(wide), round(high)


def _displayed_axes(viewer: Any) -> list[int]:
    """The displayed order of the last three axes, 0 to 2; in 2-D the slider's axis is first."""
    count = viewer.dims.ndim
    axes = [axis - (count - 3) for axis in viewer.dims.order[-3:]]
    if sorted(axes) != [0, 1, 2]:
        raise expected("view", "the last three axes", f"axes {viewer.dims.order[-3:]}", "reset the order of the axes")
    return axes


def _world(value: Sequence[float], axes: list[int]) -> np.ndarray:
    """World (x, y, z) of a vector along the displayed axes."""
    vector = np.zeros(3)
    vector[axes] = np.asarray(value, float)
    return vector[::-1]


def _orientation(camera: Any) -> tuple[str, ...]:
    """Directions of the axes of depth, down and right; versions before 0.6 have one."""
    directions = getattr(camera, "orientation", ("towards", "down", "right"))
    return tuple(str(getattr(direction, "value", direction)) for direction in directions)

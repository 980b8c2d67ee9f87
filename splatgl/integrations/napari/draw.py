"""The picture of a napari viewer's visible layers, from its camera, as splatgl draws them; nothing here needs Qt.

As napari shows them, each layer has a picture of its own, in sRGB, which is laid over those below by its opacity and
its blending; a 2-D view shows slices. Opaque surfaces, and all layers in one blend, are mixed by depth. Colour maps,
contrast limits, gamma, clipping planes and planes of depiction are kept; `info["notes"]` lists what is not.
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
from splatgl.scene.shared_renderer import shared_renderer
from splatgl.splat.camera import Camera
from splatgl.splat.clipping import Plane
from splatgl.splat.colormaps import SOLID, colormap_name, labels_of
from splatgl.splat.presets import SURFACE
from splatgl.splat.scene import LEAST, THROUGH, Layer, Scene
from splatgl.splat.settings import BLENDS, Settings
from splatgl.splat.transfer import Transfer

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence


# control colours of a layer's colour map
COLORS = 64
# share of the contrast limits below which napari leaves values of a maximum out, as above which those of a minimum
CUTOFF = 1e-3
# voxels by which napari's clipping planes lie before their positions, along each axis
HALF = 0.5
# voxels of the thickness in which a plane of depiction is drawn
THIN = 0.02
# voxels from one sample of napari's rays to the next
STEP = 0.8
# voxels of the finest level of a multiscale layer that is drawn
MOST_VOXELS = 2**26
# parallel rays begin this many radii of the layers' extent before the camera's centre
BEFORE = 4.0
# perspectives below are parallel, degrees
LEAST_PERSPECTIVE = 0.01
BLACK = (0.0, 0.0, 0.0)
# an image layer's `rendering` in 3-D → blend of its picture; of the others composite
RENDERINGS = {"mip": "mip", "attenuated_mip": "mip", "minip": "minip", "average": "mean"}
# what joins samples across a plane
ACROSS = {"mip": np.maximum, "attenuated_mip": np.maximum, "minip": np.minimum, "average": np.add}
# another rendering
ADDITIVE = "additive"
# blendings that leave what no value of the contrast limits is in as it is, and those that mix surfaces by depth
CUT, BY_DEPTH = ("translucent", "translucent_no_depth"), ("translucent", "opaque")
# what a viewer, and a layer, may show beside: attributes that are visible or not
BESIDE = {"scale_bar": "scale bar", "axes": "axes", "text_overlay": "text"}
AROUND = {"bounding_box": "bounding box", "colorbar": "colour bar", "name_overlay": "name"}


@dataclass(frozen=True, eq=False)
class Shown:
    """A picture as a display shows it: sRGB [H, W, 3], not premultiplied, from 0 to 1, and alpha [H, W]."""

    rgb: np.ndarray
    alpha: np.ndarray

    @classmethod
    def of(cls, pixels: np.ndarray) -> Shown:
        """Of linear premultiplied pixels [H, W, 4]."""
        straight = Image(pixels).straight()
        return cls(straight[..., :3], straight[..., 3])

    def over(self, ground: np.ndarray, blending: str, opacity: float, is_first: bool) -> np.ndarray:
        """The picture [H, W, 3] over those below, by napari's functions of blending; the first has none below."""
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


def picture(viewer: Any, blend: str | None = None, size: tuple[int, int] | None = None) -> Image:
    """The picture of the visible layers, on the canvas' colour. blend: None: as napari shows each, in 2-D its slice;
    else of all their voxels by that one, on black. size: (width, height) in pixels; None: of the canvas.

    Raises InputError if there is nothing to draw, and for volumes if other than the last three axes are displayed.
    """
    is_flat = viewer.dims.ndisplay == 2 and blend is None
    layers = seen(viewer, 2 if is_flat else 3)
    notes = tuple(_left_out(viewer, layers, blend))
    if blend is not None:
        image = _drawn(viewer, scene_of(viewer, layers, blend), blend, size, BLACK)
        return Image(image.pixels, {**image.info, "notes": notes})
    width, height = size or _pixels(viewer)
    ground, infos = np.broadcast_to(_ground(viewer), (height, width, 3)), list[dict[str, Any]]()
    for number, group in enumerate([[each] for each in layers] if is_flat else _groups(layers)):
        shown, told = (_slice(group[0], viewer, size), []) if is_flat else _alone(viewer, group, size)
        infos += told
        if shown is not None:
            ground = shown.over(ground, group[0].blending, float(group[0].opacity), number == 0)
    pixels = np.dstack([linear_from_srgb(ground), np.ones((height, width))]).astype(np.float32)
    return Image(pixels, {**_joined(infos), "notes": notes})


def _joined(infos: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """What was drawn for several pictures; none were for slices."""
    if not infos:
        return {"blend": "slices"}
    counts = {key: sum(each[key] for each in infos) for key in ("splats", "seconds")}
    return {**infos[0], **counts, "blend": ", ".join(dict.fromkeys(str(each["blend"]) for each in infos))}


def told(image: Image) -> str:
    """What was drawn, in a line, and in another each note on what was not."""
    info, (height, width, _) = image.info, image.pixels.shape
    line = f"{width}×{height} pixels, {info['blend']}"
    if "renderer" in info:
        by = str(info["renderer"]).partition(" (")[0]
        line += f" of {info['splats']:,} splats, {info['seconds']:.2f} s by {by}"
    return "\n".join([line, *info.get("notes", ())])  # type: ignore[misc]


def _groups(layers: Sequence[Any]) -> list[list[Any]]:
    """The layers, from below, that have a picture in common: opaque surfaces after each other, which depth orders."""
    groups: list[list[Any]] = []
    for each in layers:
        if groups and all(_is_surface(one) for one in (each, groups[-1][-1])):
            groups[-1].append(each)
        else:
            groups.append([each])
    return groups


def _is_surface(layer: Any) -> bool:
    is_solid = type(layer).__name__ == "Labels" or layer.rendering == "iso"
    return bool(is_solid and layer.opacity == 1 and layer.blending in BY_DEPTH)


def _alone(viewer: Any, group: Sequence[Any], size: tuple[int, int] | None) -> tuple[Shown, list[dict[str, Any]]]:
    """The picture of layers without their opacity, and the info of what was drawn for it."""
    way = str(getattr(group[0], "rendering", ""))
    if way == ADDITIVE:
        return _added(viewer, group[0], size)
    blend = RENDERINGS.get(way, "composite")
    volumes = [_across_plane(each, _volume(each, viewer), viewer) for each in group]
    made = [
        Layer(
            volume,
            _labels(each, volume) if _is_labels(each) else _seen_alone(each, volume),
            clip=_cuts(each, volume, viewer),
        )
        for each, volume in zip(group, volumes, strict=True)
    ]
    image = _drawn(viewer, Scene(made), blend, size)
    return Shown.of(image.pixels), [dict(image.info)]


def _added(viewer: Any, layer: Any, size: tuple[int, int] | None) -> tuple[Shown, list[dict[str, Any]]]:
    """napari's additive rendering, each channel by itself: 1 less the product of 1 less each sample's colour."""
    volume = _volume(layer, viewer)
    values, colors = _palette(layer)
    step = STEP * float(np.mean(volume.spacing))
    found, told = dict[bytes, np.ndarray](), list[dict[str, Any]]()
    channels = [np.minimum(channel, SOLID) for channel in colors[:, :3].T]
    for shares in {channel.tobytes(): channel for channel in channels}.values():
        look = Transfer(opacity_nodes(values, shares), unit=step, shading=False)
        image = _drawn(viewer, Scene([Layer(volume, look, clip=_cuts(layer, volume, viewer))]), "composite", size)
        found[shares.tobytes()] = image.pixels[..., 3]
        told.append({**image.info, "blend": ADDITIVE})
    rgb = np.dstack([found[channel.tobytes()] for channel in channels])
    return Shown(rgb, np.ones(rgb.shape[:2])), told


def _drawn(
    viewer: Any,
    scene: Scene,
    blend: str,
    size: tuple[int, int] | None,
    background: tuple[float, float, float] | None = None,
) -> Image:
    """The scene from the viewer's camera."""
    camera, mirrored = camera_of(viewer, scene.corners, size)
    with shared_renderer() as renderer:
        image = renderer.render(scene, camera, Settings(blend=blend, background=background))
    return Image(image.pixels[:, ::-1].copy(), image.info) if mirrored else image


def seen(viewer: Any, axes: int = 3) -> list[Any]:
    """The visible layers that can be drawn, of at least that many axes. Raises InputError if there are none."""
    found = [each for each in viewer.layers if each.visible and _is_drawn(each, axes)]
    if not found:
        least = {2: "two", 3: "three"}[axes]
        raise expected("layers", f"a visible Image or Labels layer of {least} or more axes", "none", "show one")
    return found


def _is_drawn(layer: Any, axes: int) -> bool:
    is_field = type(layer).__name__ in ("Image", "Labels") and layer.ndim >= axes
    return is_field and not (axes == 3 and getattr(layer, "rgb", False))


def _is_labels(layer: Any) -> bool:
    return type(layer).__name__ == "Labels"


def _left_out(viewer: Any, layers: Sequence[Any], blend: str | None) -> Iterator[str]:
    """A line for each thing that napari shows and the picture does not."""
    is_flat = viewer.dims.ndisplay == 2
    for each in viewer.layers:
        if each.visible and each not in layers:
            kind = "colours (rgb)" if getattr(each, "rgb", False) else f"a {type(each).__name__} layer"
            yield f"not drawn: {each.name}, {kind}"
    yield from (f"not drawn: {name}" for name in _visible(viewer, BESIDE))
    if getattr(getattr(viewer, "grid", None), "enabled", False):
        yield "not drawn: the grid, its layers are in one place"
    for each in layers:
        yield from (f"not drawn: {each.name}'s {name}" for name in _visible(each, AROUND))
        told = _flat_left_out(each, viewer) if is_flat and blend is None else _solid_left_out(each, blend)
        yield from (f"{each.name}: {line}" for line in told)
    if is_flat and blend is not None:
        yield "all voxels are drawn: the 2-D view shows a slice"
    flat = [each for each in layers if each.blending in BY_DEPTH and not _is_surface(each)]
    if blend is None and not is_flat and len(layers) > 1 and flat:
        yield "layers that are not opaque surfaces are laid over each other in their order, not by depth"


def _visible(holder: Any, names: dict[str, str]) -> Iterator[str]:
    for name, told in names.items():
        if getattr(getattr(holder, name, None), "visible", False):
            yield told


def _solid_left_out(layer: Any, blend: str | None) -> Iterator[str]:
    """Of a layer in 3-D."""
    way = str(getattr(layer, "rendering", ""))
    if blend is None and way == "attenuated_mip":
        yield "drawn without its attenuation, as mip"
    is_plane = str(getattr(layer, "depiction", "volume")) == "plane"
    if is_plane and (blend is not None or way not in ACROSS):
        yield f"its plane is drawn thin, without its thickness of {float(layer.plane.thickness):g} voxels"
    if blend is None and way == "iso":
        yield "the threshold is kept, and lit by splatgl's light"
    if blend is None and way == "translucent" and not _is_labels(layer) and (_palette(layer)[1][:, 3] == 1).all():
        yield "its colour map is opaque, so that napari shows the faces of its box: drawn denser for larger values"
    if str(getattr(layer, "interpolation3d", "linear")) == "nearest" and not _is_labels(layer):
        yield "drawn between voxels, not by the nearest"


def _flat_left_out(layer: Any, viewer: Any) -> Iterator[str]:
    """Of a layer in 2-D."""
    way = str(getattr(layer, "interpolation2d", "nearest"))
    if way not in ("nearest", "linear", "bilinear") and not _is_labels(layer):
        yield f"interpolated linearly, not by {way}"
    if int(getattr(layer, "contour", 0)):
        yield "its labels are filled, not outlined"
    if str(getattr(layer, "projection_mode", "none")) != "none" and any(map(any, _margins(viewer))):
        yield f"one slice is drawn, not the {layer.projection_mode} of several"


def _margins(viewer: Any) -> tuple[Sequence[float], ...]:
    return getattr(viewer.dims, "margin_left", ()), getattr(viewer.dims, "margin_right", ())


def _ground(viewer: Any) -> np.ndarray:
    """sRGB [3] of the canvas, which the viewer's theme has."""
    theme = getattr(viewer, "theme", None)
    if theme is None:
        return np.zeros(3)
    from napari.utils.theme import get_theme

    return np.array(get_theme(theme).canvas.as_rgb_tuple()[:3], float) / 255


def _cuts(layer: Any, volume: Volume, viewer: Any) -> tuple[Plane, ...] | None:
    """The layer's clipping planes, and both sides of the plane that it is depicted by, in the world; None: none.

    napari keeps what the normals point to. It takes the places of clipping planes for places in the world, and draws
    voxels as if these lay half a voxel further along each axis; those of the plane of depiction are the voxels' own.
    """
    axes, found = _displayed(viewer), list[Plane]()
    for plane in getattr(layer, "experimental_clipping_planes", ()):
        if plane.enabled:
            normal, place = _world(plane.normal, axes), _world(plane.position, axes)
            found.append(plane_through(place - volume.world_from_index @ np.full(3, HALF), normal))
    if str(getattr(layer, "depiction", "volume")) == "plane":
        place = volume.world_from_index @ _world(layer.plane.position, axes) + np.array(volume.origin)
        # a length of 1 / |normal| along it is a voxel
        normal = np.linalg.inv(volume.world_from_index).T @ _world(layer.plane.normal, axes)
        half = THIN / 2 * normal / float(normal @ normal)
        found += [plane_through(place - half, normal), plane_through(place + half, -normal)]
    return tuple(found) or None


def _across_plane(layer: Any, volume: Volume, viewer: Any) -> Volume:
    """A volume for its thin plane of depiction: at each voxel what napari makes of the samples across the plane."""
    join = ACROSS.get(str(getattr(layer, "rendering", "")))
    if str(getattr(layer, "depiction", "volume")) != "plane" or join is None:
        return volume
    count = max(int(float(layer.plane.thickness) / STEP + 0.5), 1)
    normal = _world(layer.plane.normal, _displayed(viewer))[::-1]
    normal = normal / np.linalg.norm(normal)
    samples = np.asarray(volume.samples[:]).astype(np.float32)
    found = _shifted(samples, normal * (-count / 2))
    for number in range(1, count):
        found = join(found, _shifted(samples, normal * (number - count / 2)))
    return replace(volume, samples=found / count if join is np.add else found)


def _shifted(samples: np.ndarray, by: np.ndarray) -> np.ndarray:
    """The linear interpolation of samples [D, H, W] as many voxels further, along each axis; ends go on."""
    for axis, (step, count) in enumerate(zip(by.tolist(), samples.shape, strict=True)):
        first = np.arange(count) + int(np.floor(step))
        near, far = (samples.take(np.clip(first + side, 0, count - 1), axis) for side in (0, 1))
        samples = near + np.float32(step % 1.0) * (far - near)
    return samples


def scene_of(viewer: Any, layers: Sequence[Any], blend: str) -> Scene:
    """The layers at the viewer's time, as `blend` shows them."""
    if blend not in BLENDS:
        raise expected("blend", f"one of {', '.join(BLENDS)}", repr(blend))
    made = []
    for each in layers:
        volume = _volume(each, viewer)
        opacity = float(each.opacity)
        look = _labels(each, volume) if _is_labels(each) else _look(each, volume, blend)
        made.append(Layer(volume, look, opacity, clip=_cuts(each, volume, viewer)))
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


def _palette(layer: Any) -> tuple[np.ndarray, np.ndarray]:
    """Values [COLORS] of an image layer's contrast limits, and their sRGB colours and alpha [COLORS, 4]."""
    low, high = (float(limit) for limit in layer.contrast_limits)
    places = np.linspace(0.0, 1.0, COLORS)
    colors = np.asarray(layer.colormap.map(places ** float(layer.gamma)), float)
    alpha = colors[:, 3:] if colors.shape[1] > 3 else np.ones((COLORS, 1))
    return low + places * (high - low), np.clip(np.hstack([colors[:, :3], alpha]), 0.0, 1.0)


def _look(layer: Any, volume: Volume, blend: str) -> Transfer:
    """The transfer function of an image layer in a blend, without its opacity."""
    values, colors = _palette(layer)
    opacities = np.ones(2)
    if BLENDS[blend].ordered or BLENDS[blend].unbounded:
        opacities[:] = 0.0, np.clip(-np.expm1(-THROUGH / min(volume.shape)), LEAST, SURFACE)
    window, colormap = color_nodes(values, colors[:, :3])
    return Transfer(opacity_nodes(values[[0, -1]], opacities), colormap, window, shading=False)


def _seen_alone(layer: Any, volume: Volume) -> Transfer:
    """The transfer function of an image layer as napari's rendering shows it, without its opacity."""
    way = str(layer.rendering)
    blend = RENDERINGS.get(way, "composite")
    look = _look(layer, volume, blend)
    values, colors = _palette(layer)
    low, high = float(values[0]), float(values[-1])
    cut = CUTOFF * (high - low)
    if way == "iso":
        threshold = float(layer.iso_threshold)
        return replace(look, points=((threshold, 0.0), (threshold, SOLID)), shading=True)
    if way == "translucent" and (colors[:, 3] < 1).any():
        shares = np.minimum(colors[:, 3], SOLID)
        step = STEP * float(np.mean(volume.spacing))
        return replace(look, points=opacity_nodes(values, shares), unit=step)
    if blend == "mip" and layer.blending in CUT:
        return replace(look, points=((low + cut, 0.0), (low + cut, 1.0)))
    if blend == "minip" and layer.blending in CUT:
        return replace(look, points=((high - cut, 1.0), (high - cut, 0.0)))
    return look


def _labels(layer: Any, volume: Volume) -> Transfer:
    """The transfer function of labels: solid, in the layer's colours."""
    shown: list[tuple[int, str, float]] = []
    for label in labels_of(replace(volume, labels=())):
        *rgb, alpha = np.asarray(layer.get_color(label.number), float).ravel().tolist()
        code = colormap_name(np.zeros(1), np.array([rgb])).partition(":")[2]
        shown.append((label.number, code, SOLID * float(alpha)))
    numbers = [number for number, _, _ in shown] or [0]
    is_lit = str(getattr(layer, "rendering", "")) != "translucent"
    return Transfer(((min(numbers), 0.0), (max(numbers), SOLID)), shading=is_lit, labels=shown)


def _slice(layer: Any, viewer: Any, size: tuple[int, int] | None) -> Shown | None:
    """The slice of a layer where the viewer's sliders stand, as a 2-D view shows it; None: they stand outside."""
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
    data = _level(layer)
    scale = np.array(data.shape[: layer.ndim]) / np.array(_finest(layer).shape[: layer.ndim])
    hidden = [k for k in range(layer.ndim) if k not in at]
    cut: list[Any] = [slice(None)] * layer.ndim
    for k in hidden:
        cut[k] = int(np.rint((index[k] + 0.5) * scale[k] - 0.5))
        if not 0 <= cut[k] < data.shape[k]:
            return None
    samples = np.asarray(data[tuple(cut)])
    is_linear = not _is_labels(layer) and str(getattr(layer, "interpolation2d", "nearest")) != "nearest"
    first, second = ((at[k] + 0.5) * scale[k] - 0.5 for k in sorted(at))
    values, inside = _sampled(samples, first, second, is_linear)
    rgba = _painted(layer, values)
    return Shown(rgba[..., :3], np.where(inside, rgba[..., 3], 0.0))


def _screen(viewer: Any, size: tuple[int, int] | None) -> tuple[np.ndarray, np.ndarray]:
    """World places of a 2-D view's rows and columns, along the two displayed axes."""
    camera, (width, height) = viewer.camera, size or _pixels(viewer)
    step = _canvas(viewer)[1] / height / float(camera.zoom)
    _, vertical, horizontal = _orientation(camera)
    middle = np.asarray(camera.center, float)[-2:]
    rows = (np.arange(height) + 0.5 - height / 2) * (step if vertical == "down" else -step) + middle[0]
    columns = (np.arange(width) + 0.5 - width / 2) * (step if horizontal == "right" else -step) + middle[1]
    return rows, columns


def _finest(layer: Any) -> Any:
    return layer.data[0] if layer.multiscale else layer.data


def _level(layer: Any) -> Any:
    """The data of a layer, at the level that napari shows."""
    return layer.data[int(getattr(layer, "data_level", 0))] if layer.multiscale else layer.data


def _sampled(
    samples: np.ndarray, first: np.ndarray, second: np.ndarray, is_linear: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Samples [N, M, …] at places [H, W] along two axes, the nearest or linear ones, and which places are inside."""
    inside = np.ones(first.shape, bool)
    for at, count in zip((first, second), samples.shape, strict=False):
        inside &= (at >= -0.5) & (at < count - 0.5)
    if not is_linear:
        return samples[_nearest(first, samples.shape[0]), _nearest(second, samples.shape[1])], inside
    found = np.zeros((*first.shape, *samples.shape[2:]))
    for far_first in (0, 1):
        for far_second in (0, 1):
            weight = np.abs(1 - far_first - first % 1) * np.abs(1 - far_second - second % 1)
            row, column = np.floor(first) + far_first, np.floor(second) + far_second
            part = samples[_nearest(row, samples.shape[0]), _nearest(column, samples.shape[1])].astype(float)
            found += part * weight.reshape(weight.shape + (1,) * (part.ndim - 2))
    return found, inside


def _nearest(at: np.ndarray, count: int) -> np.ndarray:
    return np.clip(np.floor(at + 0.5), 0, count - 1).astype(np.intp)


def _painted(layer: Any, values: np.ndarray) -> np.ndarray:
    """sRGB and alpha [H, W, 4] of values, as the layer shows them; what is not a number is clear."""
    if _is_labels(layer):
        numbers, places = np.unique(values, return_inverse=True)
        rows = [np.zeros(4) if color is None else np.ravel(color) for color in map(layer.get_color, numbers.tolist())]
        return np.array(rows, float)[places.reshape(values.shape)]
    if getattr(layer, "rgb", False):
        full = float(np.iinfo(layer.dtype).max) if np.dtype(layer.dtype).kind == "u" else 1.0
        found = np.clip(values / full, 0.0, 1.0)
        return found if found.shape[-1] == 4 else np.dstack([found, np.ones(found.shape[:2])])
    low, high = (float(limit) for limit in layer.contrast_limits)
    shares = np.clip((np.nan_to_num(values.astype(float), nan=low) - low) / (high - low), 0, 1) ** float(layer.gamma)
    colors = np.asarray(layer.colormap.map(shares.ravel()), float).reshape(*values.shape, -1)
    if colors.shape[-1] == 3:
        colors = np.dstack([colors, np.ones(values.shape)])
    colors[~np.isfinite(values), 3] = 0.0
    return np.clip(colors, 0.0, 1.0)


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
    """(width, height) of the canvas, in the pixels that the zoom counts."""
    canvas = getattr(viewer, "canvas", None)
    high, wide = canvas.size if canvas is not None else viewer._canvas_size
    return float(wide), float(high)


def _pixels(viewer: Any) -> tuple[int, int]:
    wide, high = _canvas(viewer)
    return round(wide), round(high)


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

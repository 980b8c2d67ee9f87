"""Images of a napari viewer's visible layers from its camera; needs no Qt.

As in napari, each layer has an image in sRGB, which is drawn over the layers below by its opacity and blending; a 2-D
view shows slices. Opaque surfaces, and all layers in one blend, are mixed by depth. Colour maps, contrast limits,
gamma, clipping planes and planes of depiction are respected; `info["notes"]` lists the differences.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.annotations.annotate import annotated, omission_notes
from splatgl.data.arrays import of_napari
from splatgl.data.color import linear_from_srgb
from splatgl.data.halving import halve_volume
from splatgl.data.image import Image
from splatgl.data.volume import ArrayOptions, Volume
from splatgl.errors import expected
from splatgl.integrations import color_nodes, opacity_nodes, plane_through, sample_plane
from splatgl.integrations.napari.snapshot import ENTRIES, FIELDS, ColorTable, LayerSnapshot, Look, Snapshot, take
from splatgl.scene.meshes import stage
from splatgl.scene.shared_renderer import shared_renderer
from splatgl.splat.camera import Camera
from splatgl.splat.clipping import Plane
from splatgl.splat.colormaps import SOLID, colormap_name, labels_of
from splatgl.splat.presets import SURFACE, preset
from splatgl.splat.scene import LEAST, THROUGH, Layer, Scene
from splatgl.splat.settings import BLENDS, Blend, Settings
from splatgl.splat.transfer import Transfer

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence


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
# start of parallel rays before the camera's centre, in diagonals of the layers' box
BEFORE = 4.0
# smaller perspective angles count as parallel, degrees
LEAST_PERSPECTIVE = 0.01
BLACK = (0.0, 0.0, 0.0)
# tolerance of a preview
PREVIEW = 8 / 255
GRAY = ColorTable("gray", np.repeat(np.linspace(0.0, 1.0, ENTRIES)[:, None], 3, axis=1))
# an image layer's `rendering` in 3-D → blend of its image; others: composite
RENDERINGS: dict[str, Blend] = {"mip": "mip", "attenuated_mip": "attenuated-mip", "minip": "minip", "average": "mean"}
# functions that join samples across a plane
ACROSS = {"mip": np.maximum, "attenuated_mip": np.maximum, "minip": np.minimum, "average": np.add}
# another rendering
ADDITIVE = "additive"
# blendings that keep pixels without values in the contrast limits, and blendings that mix surfaces by depth
CUT, BY_DEPTH = ("translucent", "translucent_no_depth"), ("translucent", "opaque")


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
    """Image of the visible layers of a viewer on the canvas' colour. blend: None: each layer as in napari, in 2-D its
    slice; else all voxels in that blend, on black. size: (width, height) in pixels; None: the canvas' size.

    Raises InputError without a layer to draw, and for volumes if other than the last three axes are displayed.
    """
    snapshot = take(viewer)
    snapshot.look = Look(blend, size)
    return draw_snapshot(snapshot)


def draw_snapshot(viewer: Snapshot, interrupted: Callable[[], bool] | None = None) -> Image:
    """Image of a snapshot in its look; see `picture`. interrupted: asked between layers and while one is drawn; True
    raises Interrupted.
    """
    blend = viewer.look.blend
    if blend is not None and blend not in BLENDS:
        raise expected("blend", f"one of {', '.join(BLENDS)}", repr(blend))
    is_flat = viewer.dims.ndisplay == 2 and blend is None and not viewer.look.preset
    layers = visible_layers(viewer, 2 if is_flat else 3)
    notes = tuple(_list_differences(viewer, layers, blend))
    if blend is not None:
        scene = viewer.scene(layers, partial(scene_of, viewer, layers, blend))
        image = _draw(viewer, scene, blend, interrupted, BLACK, layers[0].attenuation)
        return _annotate(viewer, layers, Image(image.pixels, {**image.info, "notes": (*notes, *image.notes)}))
    width, height = viewer.size
    ground, infos = np.broadcast_to(viewer.ground, (height, width, 3)), list[dict[str, Any]]()
    for number, group in enumerate([[layer] for layer in layers] if is_flat else _groups(layers)):
        drawn, info = (_slice(group[0], viewer), []) if is_flat else _draw_group(viewer, group, interrupted)
        infos += info
        if drawn is not None:
            ground = drawn.over(ground, group[0].blending, group[0].opacity, number == 0)
    pixels = np.dstack([linear_from_srgb(ground), np.ones((height, width))]).astype(np.float32)
    # slices have no info
    blends = ", ".join(dict.fromkeys(str(info["blend"]) for info in infos)) or "slices"
    counts = {key: sum(info[key] for info in infos) for key in ("splats", "seconds") if infos}
    # an option without effect on one layer may have one on others
    unused = (
        [note for note in infos[0].get("notes", ()) if all(note in info.get("notes", ()) for info in infos)]
        if infos
        else []
    )
    image = Image(pixels, {**(infos[0] if infos else {}), **counts, "blend": blends, "notes": (*notes, *unused)})
    return image if is_flat else _annotate(viewer, layers, image)


def _annotate(viewer: Snapshot, layers: Sequence[LayerSnapshot], image: Image) -> Image:
    """The image under the annotations of its look, which describe the first layer of voxels."""
    first = next((layer for layer in layers if layer.kind != "Mesh"), None)
    if not viewer.look.annotate or first is None:
        return image
    volume = _volume(first, viewer)
    transfer = _transfer(first, volume, viewer)
    camera, mirrored = camera_of(viewer, volume.corners)
    if mirrored:
        camera = replace(camera, eye_from_world=np.diag([-1.0, 1.0, 1.0]) @ camera.eye_from_world)
    written = annotated(image, volume, transfer, camera, viewer.look.annotate)
    notes: Any = image.info["notes"]
    return Image(written.pixels, {**written.info, "notes": (*notes, *omission_notes(written))})


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


def _is_surface(layer: LayerSnapshot) -> bool:
    if layer.kind == "Mesh":
        return layer.blending in BY_DEPTH
    return (layer.kind == "Labels" or layer.rendering == "iso") and layer.opacity == 1 and layer.blending in BY_DEPTH


def _draw_group(
    viewer: Snapshot, group: Sequence[LayerSnapshot], interrupted: Callable[[], bool] | None
) -> tuple[LayerImage, list[dict[str, Any]]]:
    """Image of layers without their opacity, and its info."""
    rendering, preset = group[0].rendering, viewer.look.preset
    if rendering == ADDITIVE and not preset:
        return _draw_additive(viewer, group[0], interrupted)
    if all(layer.kind == "Mesh" and not layer.meshes for layer in group):
        return LayerImage.of(np.zeros((*viewer.size[::-1], 4), np.float32)), []
    scene = viewer.scene(group, partial(scene_of, viewer, group))
    blend: Blend = "composite" if preset or group[0].kind != "Image" else RENDERINGS.get(rendering, "composite")
    image = _draw(viewer, scene, blend, interrupted, attenuation=group[0].attenuation)
    return LayerImage.of(image.pixels), [dict(image.info)]


def _draw_additive(
    viewer: Snapshot, layer: LayerSnapshot, interrupted: Callable[[], bool] | None
) -> tuple[LayerImage, list[dict[str, Any]]]:
    """napari's additive rendering, channel by channel: 1 − Π (1 − colour of a sample)."""
    volume = _volume(layer, viewer)
    values, colors = _palette(layer)
    step, planes = STEP * volume.lengths.spacing, _clip_planes(layer, volume, viewer)
    images, infos = dict[bytes, np.ndarray](), list[dict[str, Any]]()
    channels = [np.minimum(channel, SOLID) for channel in colors[:, :3].T]
    for shares in {channel.tobytes(): channel for channel in channels}.values():
        transfer = Transfer(opacity_nodes(values, shares), unit=step, shading=False)
        image = _draw(viewer, Scene([Layer(volume, transfer, clip=planes)]), "composite", interrupted)
        images[shares.tobytes()] = image.pixels[..., 3]
        infos.append({**image.info, "blend": ADDITIVE})
    rgb = np.dstack([images[channel.tobytes()] for channel in channels])
    return LayerImage(rgb, np.ones(rgb.shape[:2])), infos


def _draw(
    viewer: Snapshot,
    scene: Scene,
    blend: Blend,
    interrupted: Callable[[], bool] | None,
    background: tuple[float, float, float] | None = None,
    attenuation: float = 0.0,
) -> Image:
    """Draws the scene from the viewer's camera. attenuation: of an attenuated MIP."""
    camera, mirrored = camera_of(viewer, scene.corners)
    settings = Settings(blend=blend, background=background, light=viewer.look.light)
    if blend == "attenuated-mip":
        settings = settings.but(mip_attenuation=attenuation)
    if viewer.look.scale < 1:
        settings = settings.but(tolerance=PREVIEW)
    with shared_renderer() as renderer:
        image = renderer.render(scene, camera, settings, interrupted=interrupted)
    return Image(image.pixels[:, ::-1].copy(), image.info) if mirrored else image


def visible_layers(viewer: Snapshot, axes: int = 3) -> list[LayerSnapshot]:
    """Visible layers that can be drawn, with at least that many axes. Raises InputError without any."""
    kinds = FIELDS if axes == 2 else (*FIELDS, "Mesh")
    layers = [layer for layer in viewer.layers if layer.visible and layer.kind in kinds and layer.ndim >= axes]
    if not layers:
        least = {2: "two", 3: "three"}[axes]
        raise expected("layers", f"a visible Image, Labels or other layer of {least} or more axes", "none", "show one")
    return layers


def _list_differences(viewer: Snapshot, layers: Sequence[LayerSnapshot], blend: str | None) -> Iterator[str]:
    """A line for each thing that napari shows and the image does not."""
    is_flat = viewer.dims.ndisplay == 2
    solid = blend is None or BLENDS[blend].ordered
    for layer in viewer.layers:
        if layer.visible and (layer not in layers or (layer.kind == "Mesh" and not solid)):
            kind = "points or surfaces" if layer.kind == "Mesh" else f"a {layer.kind} layer"
            yield f"not drawn: {layer.name}, {kind}" + (f" of {layer.ndim} axes" if layer.kind in FIELDS else "")
    yield from (f"not drawn: {name}" for name in viewer.extras)
    if viewer.is_grid:
        yield "not drawn: the grid, its layers are in one place"
    for layer in layers:
        yield from (f"not drawn: {layer.name}'s {name}" for name in layer.extras)
        if layer.kind == "Mesh":
            lines: Iterator[str] = iter(layer.notes)
        else:
            lines = _flat_differences(layer, viewer) if is_flat and blend is None else _solid_differences(layer, blend)
        yield from (f"{layer.name}: {line}" for line in lines)
    if is_flat and blend is not None:
        yield "all voxels are drawn: the 2-D view shows a slice"
    is_mixed = any(layer.blending in BY_DEPTH and not _is_surface(layer) for layer in layers)
    if blend is None and not is_flat and len(layers) > 1 and is_mixed:
        yield "layers that are not opaque surfaces are drawn over each other in their order, not by depth"


def _solid_differences(layer: LayerSnapshot, blend: str | None) -> Iterator[str]:
    """Differences of a layer in 3-D."""
    rendering = layer.rendering
    if blend is None and rendering == "attenuated_mip" and layer.contrast_limits[0] != 0:
        yield "values above its lower contrast limit are attenuated, in napari all of a value"
    is_plane = layer.depiction == "plane"
    if is_plane and (blend is not None or rendering not in ACROSS):
        yield f"its plane is drawn thin, without its thickness of {float(layer.plane.thickness):g} voxels"
    if blend is None and rendering == "iso":
        yield "drawn at its threshold, lit by splatgl's light"
    is_image = layer.kind != "Labels"
    if blend is None and rendering == "translucent" and is_image and (_palette(layer)[1][:, 3] == 1).all():
        yield "its colour map is opaque, so that napari shows the faces of its box: drawn denser for larger values"
    if layer.interpolation3d == "nearest" and is_image:
        yield "drawn between voxels, not by the nearest"


def _flat_differences(layer: LayerSnapshot, viewer: Snapshot) -> Iterator[str]:
    """Differences of a layer in 2-D."""
    interpolation = layer.interpolation2d
    if interpolation not in ("nearest", "linear", "bilinear") and layer.kind != "Labels":
        yield f"interpolated linearly, not by {interpolation}"
    if layer.contour:
        yield "its labels are filled, not outlined"
    if layer.projection_mode != "none" and any(viewer.dims.margins):
        yield f"one slice is drawn, not the {layer.projection_mode} of several"


def _clip_planes(layer: LayerSnapshot, volume: Volume, viewer: Snapshot) -> tuple[Plane, ...] | None:
    """World clipping planes of the layer, and both sides of its plane of depiction; None if it has none.

    napari keeps the side that the normals point to. Positions of clipping planes are in the world, of voxels drawn half
    a voxel farther along each axis; positions of the plane of depiction are in voxels.
    """
    axes, planes = _displayed_axes(viewer), list[Plane]()
    for plane in layer.experimental_clipping_planes:
        if plane.enabled:
            normal, place = _world(plane.normal, axes), _world(plane.position, axes)
            planes.append(plane_through(place - volume.world_from_index @ np.full(3, HALF), normal))
    if layer.depiction == "plane":
        place = volume.world_from_index @ _world(layer.plane.position, axes) + np.array(volume.origin)
        # 1 / |normal| along the normal is a voxel
        normal = np.linalg.inv(volume.world_from_index).T @ _world(layer.plane.normal, axes)
        half = THIN / 2 * normal / float(normal @ normal)
        planes += [plane_through(place - half, normal), plane_through(place + half, -normal)]
    return tuple(planes) or None


def _across_plane(layer: LayerSnapshot, volume: Volume, viewer: Snapshot) -> Volume:
    """The volume of a plane of depiction: samples joined across the plane as in napari."""
    join = ACROSS.get(layer.rendering)
    if layer.depiction != "plane" or join is None:
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


def scene_of(viewer: Snapshot, layers: Sequence[LayerSnapshot], blend: str | None = None) -> Scene:
    """Scene of the layers at the viewer's sliders: in a blend, meshes only in one that is ordered by depth; None: as
    napari renders them, without their opacity.
    """
    is_solid = blend is None or BLENDS[blend].ordered
    scene, meshes = [], [mesh for layer in layers for mesh in layer.meshes if is_solid]
    for layer in layers:
        if layer.kind != "Mesh":
            volume, opacity = _volume(layer, viewer), 1.0 if blend is None else layer.opacity
            volume = _across_plane(layer, volume, viewer) if blend is None else volume
            transfer = _transfer(layer, volume, viewer, blend)
            scene.append(Layer(volume, transfer, opacity, clip=_clip_planes(layer, volume, viewer)))
    if not scene and not meshes:
        raise expected("layers", f"voxels, which {blend} draws", "none", "choose composite")
    return Scene(scene or [stage(meshes)], meshes=meshes)


def _volume(layer: LayerSnapshot, viewer: Snapshot) -> Volume:
    """Volume of a layer, of coarser voxels in a preview. Colours are as dense as they are bright, or by their alpha."""
    if layer.rgb:
        rgb = np.asarray(layer.data)
        rgb = rgb if rgb.dtype == np.uint8 else np.rint(255 * _shares(rgb)).astype(np.uint8)
        bright = rgb[..., 3] if rgb.shape[-1] == 4 else rgb.max(axis=-1)
        gray = replace(layer, data=bright, rgb=False, contrast_limits=(0.0, 255.0), colormap=GRAY)
        volume = replace(of_napari(gray, ArrayOptions()), color=np.ascontiguousarray(rgb[..., :3]))
    else:
        volume = of_napari(layer, ArrayOptions())
    for _ in range(viewer.look.stride.bit_length() - 1):
        volume = halve_volume(volume)
    return volume


def _shares(samples: np.ndarray) -> np.ndarray:
    """Colours from 0 to 1."""
    full = float(np.iinfo(samples.dtype).max) if samples.dtype.kind == "u" else 1.0
    return np.asarray(np.clip(samples / full, 0.0, 1.0))


def _palette(layer: LayerSnapshot) -> tuple[np.ndarray, np.ndarray]:
    """Values [COLORS] over an image layer's contrast limits, their sRGB colours and alpha [COLORS, 4]."""
    if layer.rgb:
        return np.linspace(0.0, 255.0, COLORS), np.repeat(np.linspace(0.0, 1.0, COLORS)[:, None], 4, axis=1)
    low, high = (float(limit) for limit in layer.contrast_limits)
    assert layer.colormap is not None
    places = np.linspace(0.0, 1.0, COLORS)
    colors = np.asarray(layer.colormap.map(places ** float(layer.gamma)), float)
    alpha = colors[:, 3:] if colors.shape[1] > 3 else np.ones((COLORS, 1))
    return low + places * (high - low), np.clip(np.hstack([colors[:, :3], alpha]), 0.0, 1.0)


def _blend_transfer(layer: LayerSnapshot, volume: Volume, blend: str) -> Transfer:
    """Transfer function of an image layer in a blend, without its opacity."""
    values, colors = _palette(layer)
    opacities = np.ones(2)
    if BLENDS[blend].ordered or BLENDS[blend].unbounded:
        opacities[:] = 0.0, np.clip(-np.expm1(-THROUGH / volume.shortest), LEAST, SURFACE)
    if blend == "attenuated-mip":
        # napari's maximum is brighter by this factor
        brighter = np.minimum(np.linspace(0.0, 1.0, COLORS) * np.exp(layer.attenuation), 1.0) * (COLORS - 1)
        colors = np.stack([np.interp(brighter, np.arange(COLORS), channel) for channel in colors.T], axis=1)
    window, colormap = (None, "gray") if layer.rgb else color_nodes(values, colors[:, :3])
    return Transfer(opacity_nodes(values[[0, -1]], opacities), colormap, window, shading=False)


def _transfer(layer: LayerSnapshot, volume: Volume, viewer: Snapshot, common: str | None = None) -> Transfer:
    """Transfer function of labels, or of an image layer by the look's preset, a common blend or napari's rendering,
    without its opacity.
    """
    if layer.kind == "Labels":
        return _labels(layer, volume)
    if viewer.look.preset:
        return preset(viewer.look.preset, volume)
    if common is not None:
        return _blend_transfer(layer, volume, common)
    rendering = layer.rendering
    blend = RENDERINGS.get(rendering, "composite")
    transfer = _blend_transfer(layer, volume, blend)
    values, colors = _palette(layer)
    if layer.rgb and blend == "composite":
        # bright voxels are solid, and dim ones hide little; alpha is that of a voxel
        shares = np.minimum(colors[:, 3] if layer.data.shape[-1] == 4 else colors[:, 3] ** 2, SOLID)
        return replace(transfer, points=opacity_nodes(values, shares), unit=volume.lengths.spacing)
    low, high = float(values[0]), float(values[-1])
    margin = CUTOFF * (high - low)
    if rendering == "iso":
        threshold = float(layer.iso_threshold)
        return replace(transfer, points=((threshold, 0.0), (threshold, SOLID)), shading=True)
    if rendering == "translucent" and (colors[:, 3] < 1).any():
        shares = np.minimum(colors[:, 3], SOLID)
        step = STEP * volume.lengths.spacing
        return replace(transfer, points=opacity_nodes(values, shares), unit=step)
    if blend in ("mip", "attenuated-mip") and layer.blending in CUT:
        return replace(transfer, points=((low + margin, 0.0), (low + margin, 1.0)))
    if blend == "minip" and layer.blending in CUT:
        return replace(transfer, points=((high - margin, 1.0), (high - margin, 0.0)))
    return transfer


def _labels(layer: LayerSnapshot, volume: Volume) -> Transfer:
    """Transfer function of labels: solid, in the layer's colours."""
    labels: list[tuple[int, str, float]] = []
    for label in labels_of(replace(volume, labels=())):
        *rgb, alpha = np.asarray(layer.get_color(label.number), float).ravel().tolist()
        code = colormap_name(np.zeros(1), np.array([rgb])).partition(":")[2]
        labels.append((label.number, code, SOLID * float(alpha)))
    numbers = [number for number, _, _ in labels] or [0]
    is_lit = layer.rendering != "translucent"
    return Transfer(((min(numbers), 0.0), (max(numbers), SOLID)), shading=is_lit, labels=labels)


def _slice(layer: LayerSnapshot, viewer: Snapshot) -> LayerImage | None:
    """Slice of a layer at the viewer's sliders, in a 2-D view; None outside of the layer."""
    down, across = (axis - (viewer.dims.ndim - layer.ndim) for axis in viewer.dims.order[-2:])
    if min(down, across) < 0:
        raise expected("view", f"axes that {layer.name} has", "others", "reset the order of the axes")
    point = np.asarray(viewer.dims.point, float)[-layer.ndim :].copy()
    index = layer.world_to_data(point)
    rows, columns = _screen(viewer)
    places = []
    for row, column in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)):
        point[[down, across]] = row, column
        places.append(layer.world_to_data(point))
    start, *steps = places
    by_row, by_column = (step - start for step in steps)
    at = {k: start[k] + rows[:, None] * by_row[k] + columns * by_column[k] for k in (down, across)}
    selection: list[Any] = [slice(None)] * layer.ndim
    for k in set(range(layer.ndim)) - set(at):
        selection[k] = int(np.rint(index[k]))
        if not 0 <= selection[k] < layer.data.shape[k]:
            return None
    samples = np.asarray(layer.data[tuple(selection)])
    is_linear = layer.kind != "Labels" and layer.interpolation2d != "nearest"
    first, second = (at[k] for k in sorted(at))
    inside = np.ones(first.shape, bool)
    for place, count in zip((first, second), samples.shape, strict=False):
        inside &= (place >= -0.5) & (place < count - 0.5)
    rgba = _colorize(layer, sample_plane(samples, first, second, is_linear))
    return LayerImage(rgba[..., :3], np.where(inside, rgba[..., 3], 0.0))


def _screen(viewer: Snapshot) -> tuple[np.ndarray, np.ndarray]:
    """World places of a 2-D view's rows and columns along the two displayed axes."""
    camera, (width, height) = viewer.camera, viewer.size
    step = viewer.canvas.size[0] / height / camera.zoom
    _, vertical, horizontal = camera.orientation
    middle = np.asarray(camera.center, float)[-2:]
    rows = (np.arange(height) + 0.5 - height / 2) * (step if vertical == "down" else -step) + middle[0]
    columns = (np.arange(width) + 0.5 - width / 2) * (step if horizontal == "right" else -step) + middle[1]
    return rows, columns


def _colorize(layer: LayerSnapshot, values: np.ndarray) -> np.ndarray:
    """sRGB and alpha [H, W, 4] of values by the layer's colours; NaN is transparent."""
    if layer.kind == "Labels":
        numbers, places = np.unique(values, return_inverse=True)
        rows = [layer.get_color(number) for number in numbers.tolist()]
        return np.array(rows, float)[places.reshape(values.shape)]
    if layer.rgb:
        full = float(np.iinfo(layer.dtype).max) if layer.dtype.kind == "u" else 1.0
        colors = np.clip(values / full, 0.0, 1.0)
        return colors if colors.shape[-1] == 4 else np.dstack([colors, np.ones(colors.shape[:2])])
    low, high = (float(limit) for limit in layer.contrast_limits)
    shares = np.clip((np.nan_to_num(values.astype(float), nan=low) - low) / (high - low), 0, 1) ** float(layer.gamma)
    assert layer.colormap is not None
    colors = layer.colormap.map(shares)
    if colors.shape[-1] == 3:
        colors = np.dstack([colors, np.ones(values.shape)])
    colors[~np.isfinite(values), 3] = 0.0
    return np.clip(colors, 0.0, 1.0)


def camera_of(viewer: Snapshot, corners: np.ndarray) -> tuple[Camera, bool]:
    """The viewer's camera, and whether the image is mirrored, as left-handed axes of napari require.

    corners [N, 3]: world (x, y, z), of the scene that parallel rays start before.
    """
    camera, axes = viewer.camera, _displayed_axes(viewer)
    center, ahead, up = list(camera.center), camera.view_direction, camera.up_direction
    if viewer.dims.ndisplay == 2:
        # along the slider's axis; the depth of its plane does not matter to parallel rays
        middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
        center = [middle[::-1][axes[0]], *center[-2:]]
        depth, vertical, _ = camera.orientation
        ahead, up = (1.0 if depth == "away" else -1.0, 0, 0), (0, -1.0 if vertical == "down" else 1.0, 0)
    focus, ahead, up = (_world(vector, axes) for vector in (center, ahead, up))
    reversals = sum(a != b for a, b in zip(camera.orientation, ("away", "down", "right"), strict=True))
    mirrored = (np.linalg.det(np.eye(3)[axes]) < 0) != (reversals % 2 == 1)
    height = viewer.canvas.size[0] / camera.zoom
    width, rows = viewer.size
    fov = float(camera.perspective) if viewer.dims.ndisplay == 3 else 0.0
    if fov >= LEAST_PERSPECTIVE:
        away = height / (2 * np.tan(np.radians(fov) / 2))
        return Camera.look_at(focus - ahead * away, focus, up, fov, (width, rows)), mirrored
    reach = BEFORE * float(np.linalg.norm(np.ptp(corners, axis=0)))
    reach += float(np.linalg.norm(corners - focus, axis=1).max())
    return Camera.orthographic(focus - ahead * reach, focus, up, height, (width, rows)), mirrored


def _displayed_axes(viewer: Snapshot) -> list[int]:
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

"""Plotters of VTK and PyVista: their scenes, and plotters of scenes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from splatgl.data.affine import spacing_and_direction
from splatgl.data.color import linear_from_srgb, srgb_from_linear
from splatgl.data.mesh import Mesh
from splatgl.data.volume import ArrayOptions, Volume, triple
from splatgl.errors import expected
from splatgl.geometry.camera import Camera
from splatgl.geometry.clipping import Plane
from splatgl.integrations import opacity_nodes
from splatgl.integrations.vtk.image_data import (
    image_data,
    import_pyvista,
    poly_data,
    select_array,
    volumes_from_components,
)
from splatgl.integrations.vtk.meshes import meshes_of, texture_differences
from splatgl.integrations.vtk.properties import clip_planes, matrix_of, property_of, transfer_of, vtk_plane
from splatgl.planning.scene import Layer, Scene
from splatgl.scene.meshes import stage
from splatgl.scene.open_scene import with_background
from splatgl.splat.lighting import LightModel
from splatgl.splat.settings import BLENDS, Blend, Settings
from splatgl.transfer.colormaps import paint_vertices
from splatgl.transfer.transfer import Transfer
from splatgl.writers.surface import iso_mesh

# VTK's light types: at the eye, and positioned in camera axes
AT_EYE, OF_CAMERA = 1, 2
# VTK's nearest interpolation, and physically based shading
NEAREST, PHYSICAL = 0, 3
# default range of averaged values
UNBOUNDED = (float(np.finfo(np.float32).min), float(np.finfo(np.float32).max))
# classes of props that are drawn over pictures
# classes of props without a counterpart here
KINDS = {
    **dict.fromkeys(("vtkTextActor3D", "vtkBillboardTextActor3D", "vtkTextActor", "vtkCornerAnnotation"), "a text"),
    "vtkScalarBarActor": "a scalar bar",
    **dict.fromkeys(("vtkCubeAxesActor", "vtkAxesActor", "vtkAxisActor2D"), "axes"),
    "vtkLegendBoxActor": "a legend",
    "vtkImageSlice": "an image",
    "vtkActor2D": "labels",
}
# largest angle of a light that counts as at the eye, degrees
NEAR_EYE = 1.0


def renderer_of(x: Any) -> Any:
    """Active vtkRenderer of a plotter, or of a window: the one clicked last, else the first that shows anything. Raises
    InputError for other objects.
    """
    renderer = getattr(x, "renderer", x)
    if hasattr(renderer, "GetRenderers"):
        renderers = items(renderer.GetRenderers())
        style = renderer.GetInteractor() and renderer.GetInteractor().GetInteractorStyle()
        clicked = style.GetCurrentRenderer() if hasattr(style, "GetCurrentRenderer") else None
        shown = [other for other in renderers if other.GetViewProps().GetNumberOfItems()]
        renderer = clicked if clicked in renderers else (shown or renderers or [x])[0]
    if not hasattr(renderer, "GetVolumes"):
        raise expected("scene", "a plotter of PyVista, or a window or renderer of VTK", f"a {type(x).__name__}")
    return renderer


def scene_of(x: Any) -> Scene:
    """Scene of the visible volumes and meshes; see `Scene.of`."""
    renderer, camera = renderer_of(x), Camera.of(x)
    layers = [layer for prop in _volumes(renderer) for layer in layers_of(prop)]
    actors = [actor for actor in items(renderer.GetActors()) if actor.GetVisibility()]
    meshes = [mesh for actor in actors for mesh in meshes_of(actor, camera) if len(mesh) and mesh.opacity > 0]
    if not layers and not meshes:
        raise expected("plotter", "a visible volume or mesh", "none", "add one: plotter.add_volume(…)")
    return Scene(layers or [stage(meshes)], meshes=meshes)


def settings_of(x: Any) -> Settings:
    """Settings of blend, background and light; see `Settings.of`."""
    renderer = renderer_of(x)
    volumes = _volumes(renderer)
    blends = {blend_of(prop.GetMapper()) for prop in volumes}
    if len(blends) > 1:
        raise expected("plotter", "volumes of one blend mode", " and ".join(sorted(blends)))
    sides = [renderer.GetBackground()] + [renderer.GetBackground2()] * bool(renderer.GetGradientBackground())
    ground = linear_from_srgb(np.clip(np.mean(sides, axis=0), 0.0, 1.0)).tolist()
    return Settings(blend=blends.pop() if blends else "composite", background=ground).replace(**_light(renderer))


def list_differences(x: Any) -> Iterator[str]:
    """Notes on everything that a plotter shows, but not its scene and settings."""
    renderer = renderer_of(x)
    visible = [prop for prop in items(renderer.GetViewProps()) if prop.GetVisibility()]
    kinds = [name for prop in visible for name in _prop_differences(prop)]
    for name in dict.fromkeys(kinds):
        yield f"not rendered: {name}" + (f", {kinds.count(name)} times" if kinds.count(name) > 1 else "")
    mappers = [prop.GetMapper() for prop in _volumes(renderer)]
    if any(mapper.GetBlendMode() == ADDITIVE for mapper in mappers) and any(renderer.GetBackground()):
        yield "the background is seen through sums, not black behind the volume's box"
    if any(mapper.GetInputDataObject(0, 0).IsA("vtkRectilinearGrid") for mapper in mappers):
        yield "uneven grids are resampled to even ones"
    lights = _lights(renderer)
    if len(lights) > 1:
        yield f"lit by the brightest of {len(lights)} lights"
    strengths = _strengths(renderer)
    if len(strengths) > 1:
        yield "all surfaces reflect as much ambient, diffuse and specular light as the first"
    if strengths and _within_one(strengths[0]) != strengths[0]:
        yield "ambient, diffuse and specular light of surfaces are limited to a sum of 1"
    if strengths:
        yield "lit in linear light, brighter at grazing angles"
    if renderer.GetGradientBackground():
        yield "the background is the mean of its gradient"
    if renderer.GetTexturedBackground() or renderer.GetBackgroundTexture() is not None:
        yield "not rendered: the background's texture"
    if renderer.GetPass() is not None:
        yield "not rendered: effects of render passes"
    window = renderer.GetRenderWindow()
    # PyVista adds an empty renderer for its background
    others = [] if window is None else [other for other in items(window.GetRenderers()) if other is not renderer]
    if any(other.GetViewProps().GetNumberOfItems() for other in others):
        yield "not rendered: other renderers of the window"


def _prop_differences(prop: Any) -> Iterator[str]:
    """Names of a visible prop, or of its parts, that are not drawn."""
    if prop.IsA("vtkVolume"):
        if prop.GetProperty().GetInterpolationType() == NEAREST:
            yield "steps between voxels (nearest interpolation)"
        low, high = getattr(prop.GetMapper(), "GetAverageIPScalarRange", lambda: UNBOUNDED)()
        if prop.GetMapper() is not None and blend_of(prop.GetMapper()) == "mean" and (low, high) != UNBOUNDED:
            yield "the range of values that are averaged"
    elif prop.IsA("vtkActor") and hasattr(prop.GetMapper(), "GetLookupTable"):
        # polygons, lines and points
        yield from texture_differences(prop)
        if prop.GetProperty().GetInterpolation() == PHYSICAL:
            yield "physically based shading"
    else:
        words = KINDS.get(next((kind for kind in KINDS if prop.IsA(kind)), ""))
        yield words or f"a {prop.GetClassName().removeprefix('vtk')}"


def _volumes(renderer: Any) -> list[Any]:
    return [prop for prop in items(renderer.GetVolumes()) if prop.GetVisibility() and prop.GetMapper() is not None]


def _lights(renderer: Any) -> list[Any]:
    return [light for light in items(renderer.GetLights()) if light.GetSwitch() and light.GetIntensity() > 0]


def items(collection: Any) -> list[Any]:
    """Items of a collection of VTK."""
    return [collection.GetItemAsObject(number) for number in range(collection.GetNumberOfItems())]


def _light(renderer: Any) -> dict[str, Any]:
    """Settings of the brightest light and of the strengths of surfaces; glossy if one of these is."""
    lights, strengths = _lights(renderer), _strengths(renderer)
    if not lights:
        return {}
    shares = dict(zip(("ambient", "diffuse", "specular"), _within_one(strengths[0]), strict=True)) if strengths else {}
    shining = any(specular > 0 for _, _, specular in strengths)
    side, above = _place(max(lights, key=lambda light: light.GetIntensity()), Camera.of(renderer))
    if max(abs(side), abs(above)) < NEAR_EYE:
        return {**shares, **({"light": "glossy", "light_from": (0.0, 0.0)} if shining else {})}
    return {**shares, "light": "glossy" if shining else "matte", "light_from": (side, above)}


def _strengths(renderer: Any) -> list[tuple[float, float, float]]:
    """The ambient, diffuse and specular light of visible surfaces under all lights as one of at most 1, each once."""
    props = [prop.GetProperty() for prop in _volumes(renderer) if prop.GetProperty().GetShade()]
    props += [actor.GetProperty() for actor in items(renderer.GetActors()) if actor.GetVisibility()]
    power = min(sum(light.GetIntensity() for light in _lights(renderer)), 1.0)
    lit = [prop for prop in props if not hasattr(prop, "GetLighting") or prop.GetLighting()]
    return list(dict.fromkeys((x.GetAmbient(), power * x.GetDiffuse(), power * x.GetSpecular()) for x in lit))


def _within_one(strengths: tuple[float, float, float]) -> tuple[float, float, float]:
    """Ambient, diffuse and specular light whose sum is at most 1; less diffuse light where it would be more."""
    ambient, diffuse, specular = (min(share, 1.0) for share in strengths)
    specular = min(specular, 1.0 - ambient)
    return ambient, min(diffuse, 1.0 - ambient - specular), specular


def _place(light: Any, camera: Camera) -> tuple[float, float]:
    """Angles of a light to the right of the eye, and above it, degrees."""
    kind = light.GetLightType()
    if kind == AT_EYE:
        return 0.0, 0.0
    toward = np.array(light.GetPosition()) - np.array(light.GetFocalPoint())
    if kind != OF_CAMERA:
        # world axes → right, up, back
        toward = camera.eye_from_world @ toward * (1, -1, -1)
    right, up, back = (toward / (np.linalg.norm(toward) or 1.0)).tolist()
    return float(np.degrees(np.arctan2(right, back))), float(np.degrees(np.arcsin(np.clip(up, -1.0, 1.0))))


# VTK's scalar modes that name an array, and its flag of the cropped box
BY_NAME, SUBVOLUME = (3, 4), 0x2000
# red, green, blue, opacity
COMPONENTS = 4
# VTK's additive blend mode, and control points of its transfer function
ADDITIVE, SAMPLES = 4, 512
# VTK's type of masks that show voxels other than 0
BINARY = 0


def layers_of(prop: Any) -> Iterator[Layer]:
    """Layers of a vtkVolume or vtkMultiVolume, one for each independent component of the samples.

    Raises InputError for data other than uniform grids, and for unsupported properties.
    """
    mapper = prop.GetMapper()
    if not prop.IsA("vtkMultiVolume"):
        yield from _layers(mapper, 0, prop)
        return
    for port in range(mapper.GetNumberOfInputPorts()):
        if mapper.GetNumberOfInputConnections(port):
            yield from _layers(mapper, port, prop.GetVolume(port))


def _layers(mapper: Any, port: int, prop: Any) -> Iterator[Layer]:
    """Layers of the input at a mapper's port, with the property and matrix of a vtkVolume."""
    looks = prop.GetProperty()
    source = mapper.GetInputAlgorithm(port, 0)
    if source is not None:
        source.Update()
    data = mapper.GetInputDataObject(port, 0)
    options = ArrayOptions(array=mapper.GetArrayName() or None) if mapper.GetScalarMode() in BY_NAME else ArrayOptions()
    array, in_cells = select_array(data, options)
    matrix = matrix_of(prop)
    planes = (*clip_planes(mapper), *_cropping(mapper, matrix))
    parts = [_apply_mask(_transform(part, matrix), mapper) for part in volumes_from_components(data, array, in_cells)]
    if len(parts) > 1 and not looks.GetIndependentComponents():
        parts = [_combine_colors(parts)]
    is_mean = blend_of(mapper) == "mean"
    for number, part in enumerate(parts):
        transfer = transfer_of(looks, number, float(np.mean(part.spacing)), is_mean)
        if mapper.GetBlendMode() == ADDITIVE:
            transfer = _additive(part, transfer)
        if part.color is not None:
            transfer = replace(transfer, colormap="gray", window=None)
        if is_mean:
            part, transfer = _average(part, transfer)
        weight = float(looks.GetComponentWeight(number)) if len(parts) > 1 else 1.0
        yield Layer(part, transfer, float(np.clip(weight, 0.0, 1.0)), clip=planes)


def _average(volume: Volume, transfer: Transfer) -> tuple[Volume, Transfer]:
    """Volume and transfer function of VTK's average along rays: of values times their opacities."""
    values = np.asarray(volume.samples[:])
    samples = (values * transfer.opacity(values)).astype(np.float32)
    low, high = transfer.color_range
    mean = replace(transfer, points=((low, 1.0), (high, 1.0)), gradient=(), shading=False)
    return replace(volume, samples=samples), mean


def _additive(volume: Volume, transfer: Transfer) -> Transfer:
    """White transfer function whose optical depth is VTK's sum: of opacities times shares of the values' range."""
    samples = np.asarray(volume.samples[:])
    low, high = float(np.nanmin(samples)), float(np.nanmax(samples))
    values = np.union1d(np.linspace(low, high, SAMPLES), [value for value, _ in transfer.points])
    shares = np.clip((values - low) / ((high - low) or 1.0), 0.0, 1.0)
    nodes = opacity_nodes(values, -np.expm1(-transfer.opacity(values) * shares))
    return replace(transfer, points=nodes, colormap="#ffffff", window=None, gradient=(), shading=False)


def _apply_mask(volume: Volume, mapper: Any) -> Volume:
    """The volume with the mapper's mask, if any. Raises InputError for a mask of labels, or of another size."""
    mask = mapper.GetMaskInput() if mapper.IsA("vtkGPUVolumeRayCastMapper") else None
    if mask is None:
        return volume
    array, in_cells = select_array(mask, ArrayOptions())
    (part,) = volumes_from_components(mask, array, in_cells)
    if mapper.GetMaskType() != BINARY or part.shape != volume.shape:
        got = "one of labels" if mapper.GetMaskType() != BINARY else f"one of {part.shape}"
        fix = "SetMaskInput(None), and mask the volume"
        raise expected("mask", f"a binary one of {volume.shape} voxels", got, fix)
    return volume.masked(np.asarray(part.samples))


def _cropping(mapper: Any, matrix: np.ndarray) -> list[Plane]:
    """Planes of a mapper's cropping box along the axes of its data. Raises InputError for other regions."""
    if not mapper.GetCropping():
        return []
    if mapper.GetCroppingRegionFlags() != SUBVOLUME:
        raise expected("cropping", "the box between the planes", "other regions", "SetCroppingRegionFlagsToSubVolume()")
    inverse, planes = np.linalg.inv(matrix), []
    for number, place in enumerate(mapper.GetCroppingRegionPlanes()):
        side = -1.0 if number % 2 else 1.0
        x, y, z, start = (side * inverse[number // 2]).tolist()
        planes.append((x, y, z, side * place - start))
    return planes


def _transform(volume: Volume, matrix: np.ndarray) -> Volume:
    """The volume moved by its actor's matrix."""
    if np.array_equal(matrix, np.eye(4)):
        return volume
    spacing, direction = spacing_and_direction(matrix[:3, :3] @ volume.world_from_index, "the actor's matrix")
    origin = triple(matrix[:3, :3] @ np.array(volume.origin) + matrix[:3, 3], "the actor's matrix")
    return replace(volume, spacing=spacing, origin=origin, direction=direction)


def _combine_colors(parts: list[Volume]) -> Volume:
    """Volume of colours and opacities. Raises InputError for other dependent components."""
    if len(parts) != COMPONENTS or parts[0].samples.dtype != np.uint8:
        got = f"{len(parts)} of {parts[0].samples.dtype}"
        raise expected("volume", "one component, independent ones, or four of uint8 for RGBA", got)
    return replace(parts[3], color=np.stack([part.samples for part in parts[:3]], axis=-1))


def blend_of(mapper: Any) -> Blend:
    """Blend of a volume mapper. Raises InputError for modes without a counterpart."""
    names: dict[int | None, Blend] = {mode.vtk: mode.name for mode in BLENDS.values()} | {ADDITIVE: "xray"}
    mode = int(mapper.GetBlendMode())
    if mode not in names:
        got = {5: "isosurface", 6: "slice"}.get(mode, str(mode))
        raise expected("blend mode", "composite, maximum, minimum, average or additive", got, "set another")
    return names[mode]


# default view of a scene, degrees
AZIMUTH, ELEVATION = 30.0, 20.0
# VTK's numbers of blend modes
VTK_BLENDS = {mode.name: mode.vtk for mode in BLENDS.values() if mode.vtk is not None}


def plotter_of(scene: Scene, camera: Camera | None, settings: Settings | None, options: dict[str, Any]) -> Any:
    """pyvista.Plotter of a scene; see `Scene.to_pyvista`."""
    pyvista = import_pyvista("Scene.to_pyvista")
    camera = camera or Camera.orbit(scene, AZIMUTH, ELEVATION)
    settings = with_background(settings or Settings(), scene.is_lit)
    if settings.blend not in VTK_BLENDS:
        raise expected("blend", f"one that VTK has: {', '.join(VTK_BLENDS)}", settings.blend)
    plotter = pyvista.Plotter(**{"window_size": list(camera.size), "lighting": "none", **options})
    light = LightModel.of(settings.light, settings.light_from, strengths=settings.strengths)
    plotter.add_light(_plotter_light(pyvista, light))
    for layer, layer_planes in zip(scene.shown, scene.planes, strict=True):
        planes = (*settings.clip, *layer_planes)
        plotter.add_actor(_volume(pyvista, layer, light, settings, planes), reset_camera=False)
    if any(mesh.texture is not None for mesh in scene.surfaces(settings)):
        raise expected("slices and caps", "none in a plotter", "colours by place", "PyVista's slice shows them")
    for mesh in map(paint_vertices, (*scene.surfaces(settings), *_iso_meshes(scene, settings))):
        color = srgb_from_linear(np.array(mesh.color)).tolist()
        look = {"scalars": "colors", "rgb": True} if mesh.colors is not None else {"color": color}
        shares = {"ambient": light.ambient, "diffuse": light.diffuse, "specular": light.specular}
        plotter.add_mesh(poly_data(mesh), opacity=mesh.opacity, reset_camera=False, **look, **shares)
    if settings.ground is not None:
        plotter.set_background(srgb_from_linear(np.array(settings.ground)).tolist())
    plotter.camera = camera_of(camera, scene.corners)
    plotter.renderer.ResetCameraClippingRange()
    return plotter


def _iso_meshes(scene: Scene, settings: Settings) -> Iterator[Mesh]:
    """Iso-surfaces of the layers, in their colours and opacities, as meshes."""
    for layer, planes in zip(scene.shown, scene.planes, strict=True):
        look = layer.seen
        for surface in look.iso:
            mesh = iso_mesh(layer.volume, surface.value).cut((*settings.clip, *planes))
            color = surface.color or tuple(map(float, look.color(surface.value)))
            yield replace(mesh, color=color, opacity=surface.opacity)


def camera_of(camera: Camera, corners: np.ndarray) -> Any:
    """pyvista.Camera of a camera. corners [N, 3]: box whose middle sets the depth of the focal point."""
    converted = import_pyvista("Camera.to_pyvista").Camera()
    middle = camera.eye_from_points((corners.min(axis=0) + corners.max(axis=0)) / 2)[2]
    away = float(middle) if middle > 0 else 1.0
    converted.position = camera.eye.tolist()
    converted.focal_point = (camera.eye + away * camera.forward).tolist()
    converted.up = (-camera.eye_from_world[1]).tolist()
    if camera.perspective:
        converted.view_angle = float(np.degrees(2 * np.arctan(camera.extent / 2)))
    else:
        converted.parallel_projection, converted.parallel_scale = True, camera.extent / 2
    return converted


def _volume(pyvista: Any, layer: Layer, light: LightModel, settings: Settings, planes: tuple[Plane, ...]) -> Any:
    """pyvista.Volume of a layer, clipped by the mapper; directions in a matrix, as VTK's CPU ray caster requires."""
    from vtkmodules.vtkRenderingVolumeOpenGL2 import vtkSmartVolumeMapper

    mapper, actor, volume = vtkSmartVolumeMapper(), pyvista.Volume(), layer.volume
    if volume.masks:
        raise expected(volume.name or "volume", "no masks: VTK's mapper does not support them", "masks")
    lit = settings.shading == "on" or (settings.shading == "auto" and layer.seen.shading)
    prop = property_of(volume, layer.seen, light, lit)
    data = image_data(Volume(volume.samples, volume.spacing, name=volume.name))
    if volume.color is not None:
        _set_colors(data, volume, layer.seen, prop)
    mapper.SetInputData(data)
    mapper.SetBlendMode(VTK_BLENDS[settings.blend])
    for plane in planes:
        mapper.AddClippingPlane(vtk_plane(plane))
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = volume.direction, volume.origin
    actor.SetMapper(mapper)
    actor.SetProperty(prop)
    actor.user_matrix = matrix
    return actor


def _set_colors(data: Any, volume: Volume, transfer: Transfer, prop: Any) -> None:
    """Makes colours and opacities the samples of the data, drawn unchanged."""
    opacity = np.rint(255 * transfer.opacity(np.asarray(volume.samples[:]))).astype(np.uint8)
    data.point_data["rgba"] = np.concatenate([np.asarray(volume.color[:]), opacity[..., None]], axis=3).reshape(-1, 4)
    data.set_active_scalars("rgba")
    prop.IndependentComponentsOff()
    shares = prop.GetScalarOpacity()
    shares.RemoveAllPoints()
    shares.AddPoint(0.0, 0.0)
    shares.AddPoint(255.0, 1.0)


def _plotter_light(pyvista: Any, light: LightModel) -> Any:
    """pyvista.Light at the eye or beside it; white ambient light keeps the objects' colours."""
    converted = pyvista.Light(light_type="headlight")
    if light.direction is not None:
        x, y, z = light.direction.tolist()
        converted.set_camera_light()
        # from its position in camera axes, right, up and back, to the origin
        converted.position, converted.focal_point = (-x, y, z), (0.0, 0.0, 0.0)
    converted.ambient_color = "white"
    return converted

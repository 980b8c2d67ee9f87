"""PyVista plotters of scenes: layers, meshes, planes, camera, light and background."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from splatgl.data.color import srgb_from_linear
from splatgl.data.mesh import Mesh
from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.geometry.camera import Camera
from splatgl.geometry.clipping import Plane
from splatgl.integrations.vtk.image_data import image_data, import_pyvista, poly_data
from splatgl.integrations.vtk.properties import property_of, vtk_plane
from splatgl.planning.scene import Layer, Scene
from splatgl.scene.open_scene import with_background
from splatgl.splat.lighting import Light
from splatgl.splat.settings import BLENDS, Settings
from splatgl.transfer.colormaps import paint_vertices
from splatgl.transfer.transfer import Transfer
from splatgl.writers.surface import iso_mesh

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
    light = Light.of(settings.light, settings.light_from, strengths=settings.strengths)
    plotter.add_light(_light(pyvista, light))
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


def _volume(pyvista: Any, layer: Layer, light: Light, settings: Settings, planes: tuple[Plane, ...]) -> Any:
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


def _light(pyvista: Any, light: Light) -> Any:
    """pyvista.Light at the eye or beside it; white ambient light keeps the objects' colours."""
    converted = pyvista.Light(light_type="headlight")
    if light.direction is not None:
        x, y, z = light.direction.tolist()
        converted.set_camera_light()
        # from its position in camera axes, right, up and back, to the origin
        converted.position, converted.focal_point = (-x, y, z), (0.0, 0.0, 0.0)
    converted.ambient_color = "white"
    return converted

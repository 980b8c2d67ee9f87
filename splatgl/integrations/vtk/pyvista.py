"""Plotters of PyVista of a scene: its layers, meshes, planes, camera, light and background."""

from __future__ import annotations

from typing import Any

import numpy as np

from splatgl.data.color import srgb_from_linear
from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.integrations.vtk.image_data import image_data, library, poly_data
from splatgl.integrations.vtk.properties import property_of, vtk_plane
from splatgl.splat.camera import Camera
from splatgl.splat.clipping import Plane
from splatgl.splat.colormaps import paint_vertices
from splatgl.splat.lighting import Light
from splatgl.splat.scene import Layer, Scene
from splatgl.splat.settings import Settings
from splatgl.splat.transfer import Transfer

# the view of a scene whose camera is not given, degrees
AZIMUTH, ELEVATION = 30.0, 20.0
# VTK's numbers of blend modes
BLENDS = {"composite": 0, "mip": 1, "minip": 2, "mean": 3}


def plotter_of(scene: Scene, camera: Camera | None, settings: Settings | None, options: dict[str, Any]) -> Any:
    """The pyvista.Plotter of a scene; see `Scene.to_pyvista`."""
    pyvista = library("Scene.to_pyvista")
    camera = camera or Camera.orbit(scene, AZIMUTH, ELEVATION)
    settings = settings or Settings()
    if settings.blend not in BLENDS:
        raise expected("blend", f"one that VTK has: {', '.join(BLENDS)}", settings.blend)
    plotter = pyvista.Plotter(**{"window_size": list(camera.size), "lighting": "none", **options})
    light = Light.of(settings.light, settings.light_from)
    plotter.add_light(_light(pyvista, light))
    for layer, own in zip(scene.shown, scene.planes, strict=True):
        planes = (*settings.clip, *own)
        plotter.add_actor(_volume(pyvista, layer, light, settings, planes), reset_camera=False)
    for mesh in map(paint_vertices, scene.surfaces(settings)):
        color = srgb_from_linear(np.array(mesh.color)).tolist()
        look = {"scalars": "colors", "rgb": True} if mesh.colors is not None else {"color": color}
        shares = {"ambient": light.ambient, "diffuse": light.diffuse, "specular": light.specular}
        plotter.add_mesh(poly_data(mesh), opacity=mesh.opacity, reset_camera=False, **look, **shares)
    if settings.background is not None:
        plotter.set_background(srgb_from_linear(np.array(settings.background)).tolist())
    plotter.camera = camera_of(camera, scene.corners)
    plotter.renderer.ResetCameraClippingRange()
    return plotter


def camera_of(camera: Camera, corners: np.ndarray) -> Any:
    """The pyvista.Camera of a camera. corners [N, 3]: of what it looks at, in whose middle its focal point is."""
    found = library("Camera.to_pyvista").Camera()
    middle = camera.eye_from_points((corners.min(axis=0) + corners.max(axis=0)) / 2)[2]
    away = float(middle) if middle > 0 else 1.0
    found.position = camera.eye.tolist()
    found.focal_point = (camera.eye + away * camera.forward).tolist()
    found.up = (-camera.eye_from_world[1]).tolist()
    if camera.perspective:
        found.view_angle = float(np.degrees(2 * np.arctan(camera.extent / 2)))
    else:
        found.parallel_projection, found.parallel_scale = True, camera.extent / 2
    return found


def _volume(pyvista: Any, layer: Layer, light: Light, settings: Settings, planes: tuple[Plane, ...]) -> Any:
    """The volume of a layer, which the mapper cuts; its directions in a matrix, as VTK's caster on the CPU needs."""
    from vtkmodules.vtkRenderingVolumeOpenGL2 import vtkSmartVolumeMapper

    mapper, found, volume = vtkSmartVolumeMapper(), pyvista.Volume(), layer.volume
    if volume.masks:
        raise expected(volume.name or "volume", "no masks, which this mapper of VTK has not", "some")
    lit = settings.shading == "on" or (settings.shading == "auto" and layer.seen.shading)
    looks = property_of(volume, layer.seen, light, lit)
    data = image_data(Volume(volume.samples, volume.spacing, name=volume.name))
    if volume.color is not None:
        _colored(data, volume, layer.seen, looks)
    mapper.SetInputData(data)
    mapper.SetBlendMode(BLENDS[settings.blend])
    for plane in planes:
        mapper.AddClippingPlane(vtk_plane(plane))
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = volume.direction, volume.origin
    found.SetMapper(mapper)
    found.SetProperty(looks)
    found.user_matrix = matrix
    return found


def _colored(data: Any, volume: Volume, transfer: Transfer, looks: Any) -> None:
    """Colours and opacities as the samples of the data, and what shows these as they are."""
    opacity = np.rint(255 * transfer.opacity(np.asarray(volume.samples[:]))).astype(np.uint8)
    data.point_data["rgba"] = np.concatenate([np.asarray(volume.color[:]), opacity[..., None]], axis=3).reshape(-1, 4)
    data.set_active_scalars("rgba")
    looks.IndependentComponentsOff()
    shares = looks.GetScalarOpacity()
    shares.RemoveAllPoints()
    shares.AddPoint(0.0, 0.0)
    shares.AddPoint(255.0, 1.0)


def _light(pyvista: Any, light: Light) -> Any:
    """A light at the eye, or beside it; the ambient share of what it shines on is of its own colour, too."""
    found = pyvista.Light(light_type="headlight")
    if light.direction is not None:
        x, y, z = light.direction.tolist()
        found.set_camera_light()
        # from its place in the camera's axes, right, up and back, to their origin
        found.position, found.focal_point = (-x, y, z), (0.0, 0.0, 0.0)
    found.ambient_color = "white"
    return found

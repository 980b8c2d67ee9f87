"""Scenes and settings of plotters of PyVista and of renderers of VTK."""

from __future__ import annotations

from typing import Any

import numpy as np

from splatgl.data.color import linear_from_srgb
from splatgl.data.errors import expected
from splatgl.splat.layers.layers import Scene
from splatgl.splat.plan.settings import Settings
from splatgl.splat.plotters.actors import meshes_of
from splatgl.splat.plotters.volumes import blend_of, layers_of
from splatgl.splat.view.camera import Camera

# VTK's numbers of kinds of light: at the eye, and where it is in the camera's axes
AT_EYE, OF_CAMERA = 1, 2
# degrees within which a light is at the eye
NEAR_EYE = 1.0


def renderer_of(x: Any) -> Any:
    """The vtkRenderer of a plotter, the active one, or of a window, its first. Raises InputError for what has none."""
    found = getattr(x, "renderer", x)
    if hasattr(found, "GetRenderers"):
        found = found.GetRenderers().GetFirstRenderer()
    if not hasattr(found, "GetVolumes"):
        raise expected("scene", "a plotter of PyVista, or a window or renderer of VTK", f"a {type(x).__name__}")
    return found


def scene_of(x: Any) -> Scene:
    """The visible volumes and meshes; see `Scene.of`."""
    renderer, camera = renderer_of(x), Camera.of(x)
    layers = [layer for prop in _volumes(renderer) for layer in layers_of(prop)]
    if not layers:
        raise expected("plotter", "a visible volume", "none", "add one: plotter.add_volume(…)")
    meshes = [
        mesh for actor in _items(renderer.GetActors()) if actor.GetVisibility() for mesh in meshes_of(actor, camera)
    ]
    return Scene(layers, meshes=[mesh for mesh in meshes if len(mesh) and mesh.opacity > 0])


def settings_of(x: Any) -> Settings:
    """Blend, background and light; see `Settings.of`."""
    renderer = renderer_of(x)
    volumes = _volumes(renderer)
    blends = {blend_of(prop.GetMapper()) for prop in volumes}
    if len(blends) > 1:
        raise expected("plotter", "volumes of one blend mode", " and ".join(sorted(blends)))
    sides = [renderer.GetBackground()] + [renderer.GetBackground2()] * bool(renderer.GetGradientBackground())
    ground = linear_from_srgb(np.clip(np.mean(sides, axis=0), 0.0, 1.0)).tolist()
    looks = [prop.GetProperty() for prop in volumes] + [actor.GetProperty() for actor in _items(renderer.GetActors())]
    return Settings(blend=blends.pop() if blends else "composite", background=ground).but(**_light(renderer, looks))


def _volumes(renderer: Any) -> list[Any]:
    return [each for each in _items(renderer.GetVolumes()) if each.GetVisibility() and each.GetMapper() is not None]


def _items(collection: Any) -> list[Any]:
    return [collection.GetItemAsObject(number) for number in range(collection.GetNumberOfItems())]


def _light(renderer: Any, looks: list[Any]) -> dict[str, Any]:
    """Settings of the brightest light; glossy if what it shines on is."""
    lights = [light for light in _items(renderer.GetLights()) if light.GetSwitch() and light.GetIntensity() > 0]
    if not lights:
        return {}
    brightest = max(lights, key=lambda light: light.GetIntensity())
    shining = any(each.GetShade() and each.GetSpecular() > 0 for each in looks if hasattr(each, "GetShade"))
    side, above = _place(brightest, Camera.of(renderer))
    if max(abs(side), abs(above)) < NEAR_EYE:
        return {"light": "glossy", "light_from": (0.0, 0.0)} if shining else {}
    return {"light": "glossy" if shining else "matte", "light_from": (side, above)}


def _place(light: Any, camera: Camera) -> tuple[float, float]:
    """Degrees of a light to the right of the eye, and above it."""
    kind = light.GetLightType()
    if kind == AT_EYE:
        return 0.0, 0.0
    toward = np.array(light.GetPosition()) - np.array(light.GetFocalPoint())
    if kind != OF_CAMERA:
        # world axes → right, up, back
        toward = camera.eye_from_world @ toward * (1, -1, -1)
    right, up, back = (toward / (np.linalg.norm(toward) or 1.0)).tolist()
    return float(np.degrees(np.arctan2(right, back))), float(np.degrees(np.arcsin(np.clip(up, -1.0, 1.0))))

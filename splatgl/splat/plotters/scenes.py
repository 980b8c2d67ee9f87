"""Scenes and settings of plotters of PyVista and of renderers of VTK."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from splatgl.data.color import linear_from_srgb
from splatgl.errors import expected
from splatgl.splat.camera import Camera
from splatgl.splat.plotters.actors import meshes_of
from splatgl.splat.plotters.volumes import blend_of, layers_of
from splatgl.splat.scene import Scene
from splatgl.splat.settings import Settings

# VTK's numbers of kinds of light: at the eye, and where it is in the camera's axes
AT_EYE, OF_CAMERA = 1, 2
# of ways between samples, and of shading
NEAREST, PHYSICAL = 0, 3
# values that are averaged, unless others are set
UNBOUNDED = (float(np.finfo(np.float32).min), float(np.finfo(np.float32).max))
# classes of props that have no like here
KINDS = {
    "vtkScalarBarActor": "a scalar bar",
    "vtkTextActor": "a text",
    "vtkTextActor3D": "a text",
    "vtkBillboardTextActor3D": "a text",
    "vtkCornerAnnotation": "a text",
    "vtkLegendBoxActor": "a legend",
    "vtkCubeAxesActor": "axes",
    "vtkAxesActor": "axes",
    "vtkAxisActor2D": "axes",
    "vtkImageSlice": "an image",
    "vtkActor2D": "labels",
}
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


def left_out(x: Any) -> Iterator[str]:
    """A line for each thing that a plotter shows, and its scene and settings do not have."""
    renderer = renderer_of(x)
    several = len(_items(renderer.GetRenderWindow().GetRenderers())) if renderer.GetRenderWindow() else 1
    shown = [each for each in _items(renderer.GetViewProps()) if each.GetVisibility()]
    kinds = [name for each in shown for name in _prop_left_out(each)]
    for name in dict.fromkeys(kinds):
        yield f"not drawn: {name}" + (f", {kinds.count(name)} times" if kinds.count(name) > 1 else "")
    lights = [light for light in _items(renderer.GetLights()) if light.GetSwitch() and light.GetIntensity() > 0]
    if len(lights) > 1:
        yield f"lit by the brightest of {len(lights)} lights"
    if renderer.GetGradientBackground():
        yield "the background is the mean of its gradient"
    if renderer.GetTexturedBackground() or renderer.GetBackgroundTexture() is not None:
        yield "not drawn: the background's texture"
    if renderer.GetPass() is not None:
        yield "not drawn: effects of render passes"
    if several - (renderer.GetRenderWindow() is not None and _overlays(renderer)) > 1:
        yield "not drawn: other renderers of the window"


def _overlays(renderer: Any) -> int:
    """How many renderers of the window lie over others, or show nothing: PyVista adds one for its background."""
    every = _items(renderer.GetRenderWindow().GetRenderers())
    return sum(each is not renderer and not each.GetViewProps().GetNumberOfItems() for each in every)


def _prop_left_out(prop: Any) -> Iterator[str]:
    """Of a visible prop: its kind, or parts of it."""
    if prop.IsA("vtkVolume"):
        if prop.GetProperty().GetInterpolationType() == NEAREST:
            yield "steps between voxels (nearest interpolation)"
        low, high = getattr(prop.GetMapper(), "GetAverageIPScalarRange", lambda: UNBOUNDED)()
        if prop.GetMapper() is not None and blend_of(prop.GetMapper()) == "mean" and (low, high) != UNBOUNDED:
            yield "the range of values that are averaged"
    elif prop.IsA("vtkActor") and hasattr(prop.GetMapper(), "GetLookupTable"):
        # PyVista's scenes of polygons, lines and points
        if prop.GetTexture() is not None:
            yield "a texture"
        if prop.GetProperty().GetInterpolation() == PHYSICAL:
            yield "physically based shading"
    else:
        words = KINDS.get(next((kind for kind in KINDS if prop.IsA(kind)), ""))
        yield words or f"a {prop.GetClassName().removeprefix('vtk')}"


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

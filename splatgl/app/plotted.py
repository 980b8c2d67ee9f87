"""Pictures of scenes in memory: of layers, and of plotters of PyVista."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Any

from splatgl.app.kept import kept_renderer
from splatgl.app.options import size
from splatgl.data.image import Image
from splatgl.errors import expected
from splatgl.splat.settings import Settings

if TYPE_CHECKING:
    from splatgl.splat.camera import Camera

# options of the view of layers, and of a plotter's
ORBIT = ("azimuth", "elevation", "fov", "size", "zoom", "up")


def is_scene(x: Any) -> bool:
    """Whether `x` is a scene of layers, a plotter of PyVista, or a window or renderer of VTK. Imports none of them."""
    layers = any(base.__module__ == "splatgl.splat.scene" for base in type(x).__mro__)
    return layers or any(hasattr(getattr(x, "renderer", x), name) for name in ("GetVolumes", "GetRenderers"))


def picture_of(x: Any, camera: Camera | None, settings: Settings | None, options: Mapping[str, Any]) -> Image:
    """The picture of layers, or of what a plotter shows from its camera, on its background.

    Of a plotter info["notes"] lists what it shows beside. camera, settings: instead of the plotter's. options: fields
    of Settings, and of the view: of a plotter the size.
    """
    from splatgl.splat.camera import Camera
    from splatgl.splat.scene import Scene

    layers = isinstance(x, Scene)
    drawing = {f.name: options[f.name] for f in fields(Settings) if f.name in options}
    viewing = {name: value for name, value in options.items() if name not in drawing}
    known = () if camera is not None else ORBIT if layers else ("size",)
    for name in viewing:
        if name not in known:
            what = f"fields of Settings{', ' if known else ''}{', '.join(known)}"
            raise expected("options", what, name, "a scene has its transfer functions" if layers else "")
    if "size" in viewing and isinstance(viewing["size"], str | int):
        viewing["size"] = size(str(viewing["size"]))
    scene = x if layers else Scene.of(x)
    view = camera or (Camera.orbit(scene, **{"azimuth": 30.0, "elevation": 20.0, **viewing}) if layers else None)
    view = view or Camera.of(x, viewing.get("size"))
    how = settings or (Settings() if layers else Settings.of(x))
    with kept_renderer() as renderer:
        image = renderer.render(scene, view, how.but(**drawing))
    if layers:
        return image
    from splatgl.splat.plotters.scenes import left_out

    return Image(image.pixels, {**image.info, "notes": tuple(left_out(x))})

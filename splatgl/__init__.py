"""splatgl: volume rendering by texture splats in OpenGL, with the error and the cost of every picture.

    import splatgl as sg
    volume = sg.load("head.nii.gz")
    splats = sg.extract(volume, sg.default_transfer(volume))
    camera = sg.Camera.orbit(volume, azimuth=30, elevation=20)
    with sg.Renderer() as renderer:
        renderer.render(splats, camera).save("head.png")

After Mueller, Möller, Swan, Crawfis, Shareef, Yagel, "Splatting Errors and Antialiasing", IEEE TVCG
4(2), 1998 [M98].
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from splatgl.data import scenes as scenes
    from splatgl.data.errors import InputError as InputError
    from splatgl.data.image import Image as Image
    from splatgl.data.readers import load as load
    from splatgl.data.volume import Volume as Volume
    from splatgl.gl.portions import Interrupted as Interrupted
    from splatgl.gl.renderer import Renderer as Renderer
    from splatgl.splat.camera import Camera as Camera
    from splatgl.splat.extract import extract as extract
    from splatgl.splat.motion import Motion as Motion
    from splatgl.splat.plan import plan as plan
    from splatgl.splat.presets import default_transfer as default_transfer
    from splatgl.splat.presets import preset as preset
    from splatgl.splat.rows import Splats as Splats
    from splatgl.splat.settings import Settings as Settings
    from splatgl.splat.transfer import Transfer as Transfer
    from splatgl.truth import reference as reference
    from splatgl.truth.compare import compare as compare

# public name → where it lives; loaded on first use, so that a command imports only what it needs
_PUBLIC = {
    "Camera": "splatgl.splat.camera",
    "Image": "splatgl.data.image",
    "InputError": "splatgl.data.errors",
    "Interrupted": "splatgl.gl.portions",
    "Motion": "splatgl.splat.motion",
    "Renderer": "splatgl.gl.renderer",
    "Settings": "splatgl.splat.settings",
    "Splats": "splatgl.splat.rows",
    "Transfer": "splatgl.splat.transfer",
    "Volume": "splatgl.data.volume",
    "compare": "splatgl.truth.compare",
    "default_transfer": "splatgl.splat.presets",
    "extract": "splatgl.splat.extract",
    "load": "splatgl.data.readers",
    "plan": "splatgl.splat.plan",
    "preset": "splatgl.splat.presets",
}
_MODULES = {"reference": "splatgl.truth.reference", "scenes": "splatgl.data.scenes"}

__all__ = ["__version__", *sorted([*_PUBLIC, *_MODULES])]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return import_module(_MODULES[name])
    if name in _PUBLIC:
        return getattr(import_module(_PUBLIC[name]), name)
    raise AttributeError(f"module 'splatgl' has no attribute {name!r}")


def __dir__() -> list[str]:
    return list(__all__)

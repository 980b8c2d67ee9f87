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

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.3.0.dev0"

if TYPE_CHECKING:
    from splatgl import distributed as distributed
    from splatgl import reference as reference
    from splatgl.animation.api import animate as animate
    from splatgl.annotations.annotate import annotated as annotated
    from splatgl.comparison.metrics import compare as compare
    from splatgl.comparison.verdict import judge as judge
    from splatgl.data import scenes as scenes
    from splatgl.data.image import Image as Image
    from splatgl.data.mesh import Mesh as Mesh
    from splatgl.data.volume import Label as Label
    from splatgl.data.volume import Volume as Volume
    from splatgl.distributed.render import over as over
    from splatgl.distributed.render import render_slabs as render_slabs
    from splatgl.errors import InputError as InputError
    from splatgl.errors import InputWarning as InputWarning
    from splatgl.exporters.api import export as export
    from splatgl.geometry.camera import Camera as Camera
    from splatgl.geometry.scissors import Scissors as Scissors
    from splatgl.geometry.slices import Slice as Slice
    from splatgl.gl.renderer import Renderer as Renderer
    from splatgl.gl.target import Interrupted as Interrupted
    from splatgl.planning.plan import plan as plan
    from splatgl.planning.scene import Layer as Layer
    from splatgl.planning.scene import Scene as Scene
    from splatgl.readers import load as load
    from splatgl.readers.meshes import load_mesh as load_mesh
    from splatgl.reference.check import check as check
    from splatgl.reference.depth_pick import pick as pick
    from splatgl.scene.api import Check as Check
    from splatgl.scene.api import Cuts as Cuts
    from splatgl.scene.api import Light as Light
    from splatgl.scene.api import Look as Look
    from splatgl.scene.api import View as View
    from splatgl.scene.api import depth_map as depth_map
    from splatgl.scene.api import render as render
    from splatgl.splat.extract import extract as extract
    from splatgl.splat.kernels import PiecewiseCubic as PiecewiseCubic
    from splatgl.splat.kernels import register_kernel as register_kernel
    from splatgl.splat.motion import Motion as Motion
    from splatgl.splat.segment_surfaces import surfaces as surfaces
    from splatgl.splat.settings import Settings as Settings
    from splatgl.splat.splats import Splats as Splats
    from splatgl.splat.vector_field import arrows as arrows
    from splatgl.splat.vector_field import directions as directions
    from splatgl.splat.vector_field import magnitudes as magnitudes
    from splatgl.splat.vector_field import streamlines as streamlines
    from splatgl.transfer.presets import default_transfer as default_transfer
    from splatgl.transfer.presets import preset as preset
    from splatgl.transfer.presets import presets as presets
    from splatgl.transfer.regions import Region as Region
    from splatgl.transfer.transfer import Transfer as Transfer
    from splatgl.transfer.transfer_nodes import opacity_curve as opacity_curve
    from splatgl.viewer.show import show as show

# public names by the modules that have them, imported on first use, so that a command imports only what it needs
_NAMES = {
    "animation.api": "animate",
    "annotations.annotate": "annotated",
    "comparison.metrics": "compare",
    "comparison.verdict": "judge",
    "data.image": "Image",
    "data.mesh": "Mesh",
    "data.volume": "Label Volume",
    "distributed.render": "over render_slabs",
    "errors": "InputError InputWarning",
    "exporters.api": "export",
    "geometry.camera": "Camera",
    "geometry.scissors": "Scissors",
    "geometry.slices": "Slice",
    "gl.renderer": "Renderer",
    "gl.target": "Interrupted",
    "planning.plan": "plan",
    "planning.scene": "Layer Scene",
    "readers": "load",
    "readers.meshes": "load_mesh",
    "reference.check": "check",
    "reference.depth_pick": "pick",
    "scene.api": "Check Cuts Light Look View depth_map render",
    "splat.extract": "extract",
    "splat.kernels": "PiecewiseCubic register_kernel",
    "splat.motion": "Motion",
    "splat.segment_surfaces": "surfaces",
    "splat.settings": "Settings",
    "splat.splats": "Splats",
    "splat.vector_field": "arrows directions magnitudes streamlines",
    "transfer.presets": "default_transfer preset presets",
    "transfer.regions": "Region",
    "transfer.transfer": "Transfer",
    "transfer.transfer_nodes": "opacity_curve",
    "viewer.show": "show",
}
_PUBLIC = {name: f"splatgl.{module}" for module, names in _NAMES.items() for name in names.split()}
_MODULES = {"distributed": "splatgl.distributed", "reference": "splatgl.reference", "scenes": "splatgl.data.scenes"}

__all__ = ["__version__", *sorted([*_PUBLIC, *_MODULES])]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        value = import_module(_MODULES[name])
    elif name in _PUBLIC:
        value = getattr(import_module(_PUBLIC[name]), name)
    else:
        raise AttributeError(f"module 'splatgl' has no attribute {name!r}")
    globals()[name] = value
    return value


def _picture(name: str) -> Any:
    """A function that returns the PNG of an object in a notebook, from a function of splatgl.viewer.thumbnails."""
    return lambda x: getattr(import_module("splatgl.viewer.thumbnails"), name)(x)


if "IPython" in sys.modules:
    _shell = sys.modules["IPython"].get_ipython()
    if _shell is not None and hasattr(_shell, "kernel"):
        _png = _shell.display_formatter.formatters["image/png"]
        for _name, _function in (("Transfer", "transfer_png"), ("Scene", "scene_png")):
            _png.for_type_by_name(_PUBLIC[_name], _name, _picture(_function))


def __dir__() -> list[str]:
    return list(__all__)

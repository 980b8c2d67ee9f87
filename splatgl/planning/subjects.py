"""Conversions of the arguments of public functions to volumes, splats, transfer functions, cameras and settings."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from splatgl.coercion import is_scene
from splatgl.data.scenes import SCENES
from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.geometry.camera import Camera
from splatgl.geometry.grid import Grid
from splatgl.options import refuse_unknown
from splatgl.planning.scene import Scene
from splatgl.readers import load
from splatgl.splat.extract import extract
from splatgl.splat.settings import Settings
from splatgl.splat.splats import Splats
from splatgl.transfer.presets import default_transfer, preset
from splatgl.transfer.transfer import Transfer
from splatgl.transfer.transfer_nodes import SUFFIXES, load_transfer

Others = Mapping[str, Any]


def volume_of(x: Any, _: Others | None = None) -> Volume:
    """The volume of a file, an address, a built-in scene, an array, or an image of another library."""
    if isinstance(x, str | Path):
        return SCENES[str(x)]() if str(x) in SCENES else load(x)
    if x is None or isinstance(x, Mapping | Camera | Transfer | Settings | Scene | Splats):
        raise TypeError
    return Volume.of(x)


def scene_of(x: Any, _: Others) -> Scene:
    """The scene of a plotter."""
    if not is_scene(x):
        raise TypeError
    return Scene.of(x)


def splats_of(x: Any, _: Others) -> Splats:
    """The splats of a volume with its default transfer function."""
    volume = x if isinstance(x, Volume) else volume_of(x)
    return extract(volume, default_transfer(volume))


def bounded_of(x: Any, _: Others) -> Any:
    """Something with corners, or a volume."""
    return x if hasattr(x, "corners") else volume_of(x)


def transfer_of(x: Any, others: Others) -> Transfer:
    """The transfer function of a preset's name or of a file, for the volume among the other arguments; or of fields."""
    if isinstance(x, Mapping):
        refuse_unknown("transfer", map(str, x), Transfer.__dataclass_fields__, "names of Transfer's fields")
        return Transfer(**x)
    if not isinstance(x, str | Path):
        raise TypeError
    volume = next((value for value in others.values() if isinstance(value, Volume)), None)
    if str(x).endswith(SUFFIXES):
        return load_transfer(str(x), Grid.of(volume).mean_spacing if volume else 1.0)
    if volume is None:
        raise expected("transfer", "a Transfer or its file, as a preset needs a volume", repr(x))
    return preset(str(x), volume)


def camera_of(x: Any, _: Others) -> Camera:
    """The camera of VTK, PyVista or a plotter."""
    if not any(hasattr(x, name) for name in ("GetFocalPoint", "GetRenderers", "renderer", "camera")):
        raise TypeError
    return Camera.of(x)


def settings_of(x: Any, _: Others) -> Settings:
    """The settings of a mapping of fields."""
    if not isinstance(x, Mapping):
        raise TypeError
    return Settings().but(**x)

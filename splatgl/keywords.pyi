"""Keywords of public functions for type checkers and editors.

scripts/keywords.py writes this file from the declared options.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, TypeAlias, TypedDict

import numpy as np

from splatgl.options import OptionGroup

Numbers: TypeAlias = Sequence[float] | np.ndarray
ViewName: TypeAlias = (
    Literal["anterior", "posterior", "left", "right", "superior", "inferior", "isometric"]
    | Literal["front", "back", "top", "bottom", "xy", "xz", "yz"]
    | Literal["+x", "+y", "+z", "-x", "-y", "-z"]
)

class PictureSettingsKeywords(TypedDict, total=False):
    """Fields of `Settings` that are options of all pictures, too."""

    blend: Literal["composite", "xray", "mip", "attenuated-mip", "minip", "mean"]
    mip_attenuation: float
    kernel: str
    classification: Literal["auto", "post", "pre"]
    compositing: Literal["auto", "sheets", "splats"]
    sheets: int | None
    steps: int | None
    antialias: Literal["auto", "paper", "off", "supersample"]
    samples: int
    align: Literal["auto", "exact", "ray", "grid", "hybrid"]
    z_s: float | None
    attenuation: Literal["auto", "opacity", "optical-depth", "fill"]
    blur_width: float
    footprint: Literal["auto", "table"]
    table_size: int | None
    table_bits: Literal[8, 16, 32]
    target: Literal["rgba32f", "rgba16f", "rgba8", "auto"]
    technique: Literal["auto", "quads", "tiles"]
    shading: Literal["auto", "on", "off"]
    light_from: Numbers | None
    ambient: float | None
    diffuse: float | None
    specular: float | None
    ambient_occlusion: float
    shadows: float
    motion: Literal["auto", "moments", "exact", "energy", "paper", "off"]
    moments: int | None
    shutter: float
    order: Literal["auto", "back-to-front", "front-to-back"]
    occlusion: Literal["auto", "off"]
    tolerance: float
    background: str | Numbers | None

class SettingsKeywords(PictureSettingsKeywords, total=False):
    """Fields of `Settings`."""

    light: Literal["head", "matte", "glossy", "flat"]
    clip: Sequence[Numbers]

class PictureLoadKeywords(TypedDict, total=False):
    """Fields of `LoadOptions` that are options of all pictures, too."""

    shape: Numbers | None
    dtype: str | None
    spacing: Numbers | None
    header_offset: int
    array: str | int | None
    channel: int | str | None
    level: int | None
    series: str | int | None
    well: str | None
    field: int | None
    color: str | Path | None
    relief: float | None
    values: Literal["labels", "amounts", "heights"] | None
    point_size: float | None
    anywhere: bool
    own: Mapping[str, object] | None

class LoadKeywords(PictureLoadKeywords, total=False):
    """Fields of `LoadOptions`."""

    time: int | float | str | None
    levels: int

class PictureViewKeywords(TypedDict, total=False):
    """Keywords of `View` that all pictures take, too."""

    size: int | str | Numbers
    azimuth: float | None
    elevation: float | None
    fov: float | None
    zoom: float | None
    eye: Numbers | None
    look_at: Numbers | None
    up: Numbers | None
    orthographic: bool | None
    height: float | None
    dpi: float | None
    width: str | None
    fit: Literal["all", "visible", "0.3"]

class ViewKeywords(PictureViewKeywords, total=False):
    """Keywords of `View`."""

    view: ViewName | None

class LookKeywords(TypedDict, total=False):
    """Keywords of `Look`."""

    preset: str
    curve: str
    colors: str | Sequence[Any]
    level_width: Numbers | str | None
    file: str
    only_labels: str | Sequence[int | tuple[int, float]] | Mapping[int, float]
    name_of: Mapping[int, str] | Sequence[str]
    names: str
    color_of: Mapping[str, str] | Sequence[str]
    window_of: Mapping[str, Numbers] | Sequence[str]
    look_of: Mapping[str, str] | Sequence[str]
    points: Sequence[Numbers]
    colormap: str | Sequence[Numbers] | np.ndarray
    window: Numbers | None
    unit: str | float | None
    gradient: Sequence[Numbers]
    scale: Literal["linear", "log"]
    log: bool
    iso: float | str | Sequence[Any]
    regions: Sequence[Any]
    region: Sequence[Any]
    threshold: float

class CutsKeywords(TypedDict, total=False):
    """Keywords of `Cuts`."""

    clip: str | Sequence[Any] | None
    crop: str
    mask: Any | None
    uncut: str | int | Sequence[int]
    scissors: Any

class LightKeywords(TypedDict, total=False):
    """Keywords of `Light`."""

    blend: Literal["composite", "xray", "mip", "attenuated-mip", "minip", "mean"]
    mip_attenuation: float
    shading: Literal["auto", "on", "off"]
    light: Literal["head", "matte", "glossy", "flat"]
    light_from: Numbers | None
    ambient: float | None
    diffuse: float | None
    specular: float | None
    ambient_occlusion: float
    shadows: float
    background: str | Numbers | None
    annotate: str | Sequence[str] | None
    slices: str | Sequence[str]
    slice: str | Sequence[str]
    measures: Any
    measure: Any

class CheckKeywords(TypedDict, total=False):
    """Keywords of `Check`."""

    kernel: str
    classification: Literal["auto", "post", "pre"]
    compositing: Literal["auto", "sheets", "splats"]
    sheets: int | None
    steps: int | None
    antialias: Literal["auto", "paper", "off", "supersample"]
    samples: int
    tolerance: float

class ArrayKeywords(TypedDict, total=False):
    """Options of `Volume.of`."""

    spacing: Numbers | None
    origin: Numbers | None
    unit: str | None
    name: str | None
    array: str | int | None
    values: str | None

class PictureKeywords(
    PictureSettingsKeywords, PictureLoadKeywords, PictureViewKeywords, LookKeywords, CutsKeywords, total=False
):
    """Options of all pictures."""

    view: ViewName | OptionGroup | None
    light: Literal["head", "matte", "glossy", "flat"] | OptionGroup | None
    surfaces: float | None
    layers: Any
    layer: Any
    meshes: Any
    mesh: Any
    annotate: str | Sequence[str] | None
    slices: str | Sequence[str]
    slice: str | Sequence[str]
    slice_planes: str | Sequence[Any]
    slice_plane: str | Sequence[Any]
    label_fill: float
    measures: Any
    measure: Any
    labels: Any
    clip_meshes: bool
    caps: Literal["plain", "volume"]
    vectors: Literal["magnitude", "direction"]
    streamlines: int
    arrows: int
    like: str | None
    paper: bool
    memory: int | str | None
    origin: Numbers | None
    name: str | None
    offset: int
    reader_option: Mapping[str, object] | None
    look: OptionGroup | None
    cuts: OptionGroup | None
    check: OptionGroup | None

class RenderKeywords(PictureKeywords, total=False):
    """Options of `render`, `show` and `depth_map`."""

    time: int | float | str | None

class AnimateKeywords(PictureKeywords, total=False):
    """Options of `animate`."""

    time: slice | int | float | str | None
    frames: int | None
    only: tuple[int, int] | None
    turntable: float | None
    spin: float | None
    axis: Numbers | None
    keyframes: str | Mapping[str, Any] | None
    hold: int
    flow: float | None
    draft: bool
    workers: int | None
    scheduler: str | None
    devices: Sequence[int]
    fps: float | None
    bits: Literal[8, 16]
    resume: bool

class ExportKeywords(PictureKeywords, total=False):
    """Options of `export`."""

    time: int | float | str | None
    format: Literal["html", "ply", "spz", "glb"] | None
    splats: int
    bits: Literal[8, 16]
    max_size: int | str

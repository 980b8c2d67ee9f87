"""`Settings` of a picture, and the table of blend modes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from numbers import Real
from typing import Any, Literal, get_args

from splatgl.errors import expected
from splatgl.splat.clipping import Plane, planes
from splatgl.splat.kernels import KERNELS
from splatgl.splat.lighting import checked_place


@dataclass(frozen=True)
class BlendMode:
    """join: `over` (by the transmittance of nearer splats), `sum`, `max`, `min` or `mean`.

    peak: whether a splat's value is its opacity times its share of the footprint's peak, instead of a line integral.
    """

    name: str
    join: str
    peak: bool
    about: str

    @property
    def ordered(self) -> bool:
        """Whether the picture depends on the order."""
        return self.join == "over"

    @property
    def unbounded(self) -> bool:
        """Whether pixel values are unbounded: errors and PNGs are relative to the brightest."""
        return self.join == "sum"

    @property
    def one_value(self) -> bool:
        """Whether a pixel of values classified after reconstruction shows one: the join of all along its ray."""
        return self.join in ("max", "min", "mean")

    @property
    def post_only(self) -> bool:
        """Whether splats that are classified before have no such blend."""
        return self.join in ("min", "mean")


BLENDS = {
    mode.name: mode
    for mode in (
        BlendMode("composite", "over", False, "'over' by opacity, nearest first"),
        BlendMode("xray", "sum", False, "sums of optical depth and of depth times colour"),
        BlendMode("mip", "max", True, "the maximum of opacity and of opacity times colour, or of values"),
        BlendMode("minip", "min", False, "the minimum of values"),
        BlendMode("mean", "mean", False, "the mean of values over the ray's length"),
    )
}


Antialias = Literal["auto", "paper", "off", "supersample"]
Align = Literal["auto", "exact", "ray", "grid", "hybrid"]
Attenuation = Literal["auto", "opacity", "optical-depth", "fill"]
Footprint = Literal["auto", "table"]
Target = Literal["rgba32f", "rgba16f", "rgba8", "auto"]
Technique = Literal["auto", "quads", "tiles"]
Shading = Literal["auto", "on", "off"]
Lights = Literal["head", "matte", "glossy", "flat"]
Motions = Literal["auto", "moments", "exact", "energy", "paper", "off"]
Occlusion = Literal["auto", "off"]
Order = Literal["auto", "back-to-front", "front-to-back"]
Compositing = Literal["auto", "sheets", "splats"]
Classification = Literal["auto", "post", "pre"]


def choices() -> dict[str, tuple[str, ...]]:
    """Values of each enumerated setting, the default first, registered kernels last."""
    closed = {"antialias": Antialias, "align": Align, "attenuation": Attenuation, "footprint": Footprint}
    closed |= {"target": Target, "technique": Technique, "shading": Shading, "light": Lights, "motion": Motions}
    closed |= {"occlusion": Occlusion, "order": Order, "compositing": Compositing, "classification": Classification}
    return {"blend": tuple(BLENDS), "kernel": ("auto", *KERNELS)} | {
        name: get_args(one) for name, one in closed.items()
    }


# largest footprint table; beyond it the kernel is resolved to float32
MAX_TABLE_SIZE = 4096
# at more than 64 samples an axis, a picture of 64 pixels would need a target of over 4096
MAX_SAMPLES = 64
# a shutter that never closes, in degrees
FULL_SHUTTER = 360.0
# pictures that a moving one is the mean of, at most
MAX_MOMENTS = 4096
# sheets that share a splat, and most parts of a sheet
LEAST_SHEETS, MOST_SHEETS, MOST_STEPS = 2, 4, 8

# the defaults of earlier versions
LIKE: dict[str, dict[str, Any]] = {"0.1": {"classification": "pre", "compositing": "splats", "antialias": "paper"}}


@dataclass(frozen=True)
class Settings:
    """Render settings by the paper's names, the default first.

    blend composite | xray | mip | minip | mean; the last two, and mip if classified after, of reconstructed values.
    kernel auto (crawfis-max, or the one that values were extracted for) | crawfis-max | gaussian | b-spline, or one
    that is registered.
    classification auto (post where volume and settings allow it) | post (reconstructed values are classified) | pre
    (voxels are).
    compositing auto (sheets where the settings allow it) | sheets (splats add up within sheets of equal distance from
    the eye, which composite; always if classified after) | splats (every splat in order). sheets: 2 to 4 that share a
    splat; steps: 1 to 8 parts of a sheet, each classified once; None: by the tolerance.
    antialias auto (as many samples a pixel as voxels and tolerance ask for) | paper (stretched beyond z_k) | off |
    supersample (samples × samples a pixel). align auto | exact | ray | grid | hybrid
    (ray-perpendicular up to depth z_s, grid-aligned beyond; z_s in world units, None: from `tolerance`).
    attenuation auto | opacity | optical-depth | fill (beyond z_k, composite only).
    footprint auto (by the squared distance: a table, or polynomials where the tolerance allows) | table (table_size²
    texels of table_bits 32 | 16 | 8); table_size None: 256, or 1024 by the squared distance.
    technique auto | quads (instanced quads) | tiles (binned into tiles of pixels, in compute shaders; auto: on software
    OpenGL, and for sheets; never with table footprints, another target than rgba32f, or back to front).
    occlusion auto | off (tiles terminate once the transmittance is below a share of the tolerance).
    target rgba32f | rgba16f | rgba8 | auto. shading auto (as the transfer function says) | on | off. light head (at the
    eye) | matte | glossy (both from above left) | flat; light_from: its degrees to the right of the eye and above it.
    ambient_occlusion, shadows: strengths from 0 to 1 by which matter keeps the sky and the light off what is behind.
    motion auto (exact for X-rays of voxels, else moments) | moments (the mean of pictures while the shutter is open) |
    exact (the mean of the footprint along its path) | energy | paper [M98 Eq. 11] | off: motion blur.
    moments: number of pictures, each streaked over its part of the paths by exact, energy and paper; None: as many as
    the paths ask for, one of streaks. shutter: its opening time, in degrees of a frame's 360.
    order auto | back-to-front | front-to-back. tolerance: largest allowed error, linear light.
    background: None (transparent) or a linear RGB triple. clip: planes (n_x, n_y, n_z, d): what is drawn lies where
    n · x ≥ d, world units, of each. Raises InputError for anything else.
    """

    blend: str = "composite"
    kernel: str = "auto"
    classification: Classification = "auto"
    compositing: Compositing = "auto"
    sheets: int | None = None
    steps: int | None = None
    antialias: Antialias = "auto"
    samples: int = 4
    align: Align = "auto"
    z_s: float | None = None
    attenuation: Attenuation = "auto"
    footprint: Footprint = "auto"
    table_size: int | None = None
    table_bits: int = 32
    target: Target = "rgba32f"
    technique: Technique = "auto"
    shading: Shading = "auto"
    light: Lights = "head"
    light_from: tuple[float, float] | None = None
    ambient_occlusion: float = 0.0
    shadows: float = 0.0
    motion: Motions = "auto"
    moments: int | None = None
    shutter: float = 180.0
    order: Order = "auto"
    occlusion: Occlusion = "auto"
    tolerance: float = 1 / 255
    background: tuple[float, float, float] | None = None
    clip: tuple[Plane, ...] = ()

    def __post_init__(self) -> None:
        for name, allowed in choices().items():
            if getattr(self, name) not in allowed:
                raise expected(name, " or ".join(allowed), repr(getattr(self, name)))
        _check_number("samples", self.samples, 1, MAX_SAMPLES)
        if self.sheets is not None:
            _check_number("sheets", self.sheets, LEAST_SHEETS, MOST_SHEETS)
        if self.steps is not None:
            _check_number("steps", self.steps, 1, MOST_STEPS)
        if self.moments is not None:
            _check_number("moments", self.moments, 1, MAX_MOMENTS)
        if self.table_size is not None:
            _check_number("table_size", self.table_size, 2, MAX_TABLE_SIZE)
        if self.table_bits not in (8, 16, 32):
            raise expected("table_bits", "8, 16 or 32", self.table_bits)
        if not (_is_number(self.tolerance) and 0 < self.tolerance <= 1):
            raise expected("tolerance", "a number in (0, 1]", repr(self.tolerance))
        if self.z_s is not None and not (_is_number(self.z_s) and self.z_s >= 0):
            raise expected("z_s", "a depth of at least 0", repr(self.z_s))
        if not (_is_number(self.shutter) and 0 <= self.shutter <= FULL_SHUTTER):
            raise expected("shutter", "an angle from 0 to 360 degrees", repr(self.shutter))
        for name in ("ambient_occlusion", "shadows"):
            if not (_is_number(getattr(self, name)) and 0 <= getattr(self, name) <= 1):
                raise expected(name, "a strength from 0 to 1", repr(getattr(self, name)))
        if self.background is not None:
            object.__setattr__(self, "background", _background(self.background))
        if self.light_from is not None:
            object.__setattr__(self, "light_from", checked_place(self.light_from))
        if self.clip != ():
            object.__setattr__(self, "clip", planes(self.clip))

    @property
    def given(self) -> dict[str, Any]:
        """The fields that differ from their defaults."""
        return {f.name: getattr(self, f.name) for f in fields(self) if getattr(self, f.name) != f.default}

    def but(self, **changes: Any) -> Settings:
        """These settings with some changed; InputError for an unknown name."""
        unknown = set(changes) - {field.name for field in fields(self)}
        if unknown:
            raise expected("settings", "names of Settings' fields", ", ".join(sorted(unknown)))
        return replace(self, **changes)

    @classmethod
    def of(cls, x: Any) -> Settings:
        """Blend, light and background of a PyVista plotter, or of a window or renderer of VTK. Raises InputError for
        blends that there are not.
        """
        from splatgl.integrations.vtk.scene import settings_of

        return settings_of(x)

    @classmethod
    def like(cls, version: str, **changes: Any) -> Settings:
        """The defaults of an earlier version, "0.1": its default picture, within its error bound."""
        if version not in LIKE:
            raise expected("like", f"a version that is known: {', '.join(LIKE)}", repr(version))
        return cls(**LIKE[version]).but(**changes)

    @classmethod
    def paper(cls, **changes: Any) -> Settings:
        """The 1998 hardware path: hybrid, an 8-bit 256×256 table, opacity attenuation, quads, 8-bit target, every splat
        in order.
        """
        return cls(
            **LIKE["0.1"],
            align="hybrid",
            footprint="table",
            table_size=256,
            table_bits=8,
            attenuation="opacity",
            technique="quads",
            target="rgba8",
        ).but(**changes)


def _is_number(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


def _check_number(name: str, value: int, low: int, high: int) -> None:
    if not (_is_number(value) and low <= value <= high and value == int(value)):
        raise expected(name, f"a whole number from {low} to {high}", repr(value))


def _background(color: Any) -> tuple[float, float, float]:
    rgb = list(color) if isinstance(color, Iterable) else []
    if len(rgb) != 3 or not all(_is_number(c) and 0 <= c <= 1 for c in rgb):
        raise expected("background", "three linear numbers from 0 to 1", repr(color)[:80])
    return float(rgb[0]), float(rgb[1]), float(rgb[2])

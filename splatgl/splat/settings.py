"""`Settings` of a picture, and the table of blend modes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, Protocol, Unpack

import numpy as np

from splatgl.coercion import public
from splatgl.data.color import AUTO, BACKGROUNDS, Color, read_background
from splatgl.errors import expected
from splatgl.geometry.clipping import Plane, check_planes
from splatgl.options import (
    HelpGroup,
    ValueKind,
    check_options,
    declared,
    is_number,
    keywords_of,
    non_default,
    option,
    reject_unknown,
    with_keywords,
)
from splatgl.splat.kernels import FREE, KERNELS, import_kernel
from splatgl.splat.lighting import check_place

if TYPE_CHECKING:
    from splatgl.keywords import SettingsKeywords


Blend = Literal["composite", "xray", "mip", "attenuated-mip", "minip", "mean"]


@dataclass(frozen=True)
class BlendMode:
    """Blend mode. join: `over` (by the transmittance of nearer splats), `sum`, `max`, `min`, `mean` or `attenuated`,
    the names that optics.glsl has, too. combine: joins two values along a ray. vtk: number of VTK's blend mode; None
    without one.
    """

    name: Blend
    join: str
    combine: np.ufunc
    vtk: int | None
    about: str


BLENDS: dict[str, BlendMode] = {
    mode.name: mode
    for mode in (
        BlendMode("composite", "over", np.add, 0, "'over' by opacity, nearest first"),
        BlendMode("xray", "sum", np.add, None, "sums of optical depth and of depth times colour"),
        BlendMode("mip", "max", np.maximum, 1, "the maximum of opacity and of opacity times colour, or of values"),
        BlendMode(
            "attenuated-mip", "attenuated", np.maximum, None, "the maximum of values, weakened by those before them"
        ),
        BlendMode("minip", "min", np.minimum, 2, "the minimum of values"),
        BlendMode("mean", "mean", np.add, 3, "the mean of values over the ray's length"),
    )
}
# by join
COMBINE = {mode.join: mode.combine for mode in BLENDS.values()}


class Blending(Protocol):
    """The meaning of a blend for a picture."""

    blend: Blend

    @property
    def join(self) -> str:
        """How values along a ray are joined; see BlendMode."""
        return BLENDS[self.blend].join

    @property
    def hides(self) -> bool:
        """Whether nearer splats occlude farther ones, so that the picture depends on the order."""
        return self.join == "over"

    @property
    def is_sum(self) -> bool:
        """Whether pixel values are unbounded: errors and PNGs are relative to the brightest."""
        return self.join == "sum"

    @property
    def shows_value(self) -> bool:
        """Whether a pixel shows one value of its ray, if values are classified after reconstruction."""
        return not (self.hides or self.is_sum)

    @property
    def needs_values(self) -> bool:
        """Whether splats classified before reconstruction do not support the blend."""
        return self.shows_value and self.join != "max"

    def brightest(self, pixels: np.ndarray) -> float:
        """The light that errors of a picture are relative to: the largest component of sums, else 1."""
        return float(pixels.max()) if self.is_sum else 1.0


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


# largest footprint table; beyond it the kernel is resolved to float32
MAX_TABLE_SIZE = 4096
# at more than 64 samples an axis, a picture of 64 pixels would need a target of over 4096
MAX_SAMPLES = 64
# degrees of a shutter that never closes
FULL_SHUTTER = 360.0
# of attenuated-mip: everything behind the first matter is dark long before
MOST_STRENGTH = 1e6
# pixels to which antialiasing may stretch a voxel
LEAST_BLUR, MOST_BLUR = 0.25, 4.0
# most pictures that a moving picture is the mean of
MAX_MOMENTS = 4096
# sheets that share a splat, and most parts of a sheet
LEAST_SHEETS, MOST_SHEETS, MOST_STEPS = 2, 4, 8

# tolerance of pictures in motion, and of drafts
LENIENT = 8 / 255
# kinds of antialiasing whose pixels are means of samples
AVERAGED = ("auto", "supersample")

# the defaults of earlier versions
LIKE: dict[str, dict[str, Any]] = {
    "0.1": {"classification": "pre", "compositing": "splats", "antialias": "paper", "background": None},
    "0.2": {"kernel": FREE, "motion": "moments"},
    "0.3": {},
}


_picture = partial(option, group=HelpGroup.PICTURE)
_accuracy = partial(option, group=HelpGroup.ACCURACY)
_speed = partial(option, group=HelpGroup.SPEED)
_animation = partial(option, group=HelpGroup.ANIMATION)
_paper = partial(option, group=HelpGroup.PAPER, level="expert")
_STRENGTH = ValueKind.number("a strength from 0 to 1", 0, 1, metavar="S")


def _background(color: Any) -> Color | str | None:
    color = read_background(color) if isinstance(color, str) else color
    if color is None or isinstance(color, str):
        return AUTO if color == AUTO else None
    rgb = list(color) if isinstance(color, Iterable) else []
    if len(rgb) != 3 or not all(is_number(c) and 0 <= c <= 1 for c in rgb):
        raise ValueError
    return float(rgb[0]), float(rgb[1]), float(rgb[2])


def read_kernel(text: str) -> str:
    """The name of a kernel, or of that which MODULE:NAME imports. Raises ValueError for an unknown name."""
    if ":" not in text and text not in ("auto", *KERNELS):
        raise ValueError
    return import_kernel(text) if ":" in text else text


@public
@dataclass(frozen=True)
class Settings(Blending):
    """Settings of a picture; `splatgl/docs/settings.md` explains the values of each. Raises InputError for others.

    sheets, steps, table_size, moments, z_s, light_from that are None follow from the other settings. background: linear
    RGB, None (transparent) or "auto", which a `Renderer` leaves transparent. clip: planes (n_x, n_y, n_z, d); what lies
    at n · x ≥ d of each is drawn, world units.

    ```python
    settings = sg.Settings(light="glossy", background="#203040")
    image = sg.render(sg.scenes.ball(12), settings=settings.replace(blend="mip"), size=64)
    ```
    """

    blend: Blend = _picture(
        "composite",
        ValueKind.choice(Blend),
        "compositing. One splat over the next, sum (X-ray), or maximum, minimum or mean of the values along a ray",
        level="basic",
    )
    mip_attenuation: float = _picture(
        0.05,
        ValueKind.number(f"a strength from 0 to {MOST_STRENGTH:g}", 0, MOST_STRENGTH, metavar="S"),
        "strength of attenuated-mip, per reference length of the brightest values; 0: as mip (default 0.05)",
        label="attenuation",
    )
    kernel: str = _accuracy(
        "auto",
        replace(ValueKind.choice(lambda: ("auto", *KERNELS)), read=read_kernel, metavar="NAME|MODULE:NAME"),
        "radial kernel of each voxel. auto: b-spline where values are classified, else crawfis-max; MODULE:NAME: a "
        "kernel of a Python module, whose code is run",
    )
    classification: Classification = _accuracy(
        "auto",
        ValueKind.choice(Classification),
        "what is classified. post: reconstructed values; pre: voxels, whose colours are then reconstructed",
    )
    compositing: Compositing = _accuracy(
        "auto",
        ValueKind.choice(Compositing),
        "unit of compositing. sheets: slabs of equal distance from the camera, in which splats add up; splats: one "
        "by one",
    )
    sheets: int | None = _accuracy(
        None, ValueKind.whole(LEAST_SHEETS, MOST_SHEETS), "sheets that share a splat, 2 to 4 (default: by --tolerance)"
    )
    steps: int | None = _accuracy(
        None, ValueKind.whole(1, MOST_STEPS), "parts of a sheet, each classified once, 1 to 8 (default: by --tolerance)"
    )
    antialias: Antialias = _accuracy(
        "auto",
        ValueKind.choice(Antialias),
        "antialiasing. auto: as many samples as --tolerance needs; supersample: --samples along each axis; "
        "paper: splats beyond z_k are stretched [Eq. 4] and attenuated by (z_k/z_v)^2 [Eq. 6]",
    )
    samples: int = _accuracy(
        4, ValueKind.whole(1, MAX_SAMPLES), "samples along each axis of a pixel to supersample, 1 to 64"
    )
    align: Align = _paper(
        "auto",
        ValueKind.choice(Align),
        "orientation of splats. exact: line integral [row 1]; ray: quads across the ray [row 4]; grid: quads "
        "parallel to the image [row 5]; hybrid: ray up to --z-s, then grid [4.2]; auto: exact",
    )
    z_s: float | None = _paper(
        None,
        ValueKind.number("a depth of at least 0", 0, metavar="Z"),
        "depth beyond which hybrid splats are parallel to the image, world units (default: by --tolerance)",
    )
    attenuation: Attenuation = _paper(
        "auto",
        ValueKind.choice(Attenuation),
        "quantity attenuated by (z_k/z_v)^2 beyond z_k. Opacity (the paper's), optical depth, or fill, the pixel "
        "coverage (auto)",
    )
    blur_width: float = _paper(
        1.0,
        ValueKind.number(f"a width from {LEAST_BLUR:g} to {MOST_BLUR:g} pixels", LEAST_BLUR, MOST_BLUR, metavar="W"),
        "width in pixels, 0.25 to 4, to which antialias paper stretches voxels. A wider low-pass blurs, a narrower "
        "one aliases [6] (default 1)",
    )
    footprint: Footprint = _paper(
        "auto",
        ValueKind.choice(Footprint),
        "footprint of a splat. auto: a table over the squared distance, or polynomials; table: the paper's texture",
    )
    table_size: int | None = _paper(
        None,
        ValueKind.whole(2, MAX_TABLE_SIZE),
        "texels along each axis of the footprint table, up to 4096 (default 256, or 1024 over the squared distance)",
    )
    table_bits: int = _paper(32, ValueKind.one_of(8, 16, 32), "bits a texel of the footprint table")
    target: Target = _paper(
        "rgba32f",
        ValueKind.choice(Target),
        "number format of the framebuffer. The paper's has 8 bits, in which display values (sRGB) are mixed",
    )
    technique: Technique = _speed(
        "auto",
        ValueKind.choice(Technique),
        "rendering technique. quads: one quad per splat; tiles: compute shaders that process splats by tiles of pixels",
    )
    shading: Shading = _picture(
        "auto",
        ValueKind.choice(Shading),
        "shading of surfaces, C = c (0.3 + 0.7 |n l|). auto: as the transfer function says",
    )
    light: Lights = _picture(
        "head",
        ValueKind.choice(Lights),
        "light. At the eye, from above left without or with highlights, or one that shows colours more than shapes",
        level="basic",
    )
    light_from: tuple[float, float] | None = _picture(
        None,
        ValueKind("degrees", check_place, ValueKind.numbers(2, "").read, "SIDE,ABOVE", hint="Numbers"),
        "position of the light, degrees to the right of and above the camera",
    )
    ambient: float | None = _picture(
        None, _STRENGTH, "strength of the light from everywhere, 0 to 1 (default: as --light says)"
    )
    diffuse: float | None = _picture(
        None, _STRENGTH, "strength of light that surfaces scatter by their angle, 0 to 1 (default: as --light says)"
    )
    specular: float | None = _picture(
        None,
        _STRENGTH,
        "strength of highlights, 0 to 1 (default: as --light says). The strengths add up to at most 1; those not "
        "given are reduced",
    )
    ambient_occlusion: float = _picture(
        0.0, _STRENGTH, "darkens cavities, 0 (off) to 1. Most visible with --light flat", label="ambient occl."
    )
    shadows: float = _picture(
        0.0, _STRENGTH, "darkness of shadows, 0 (off) to 1. A light at the eye moves to above left", level="basic"
    )
    motion: Motions = _paper(
        "auto",
        ValueKind.choice(Motions),
        "motion blur. moments: mean of pictures; exact: mean of the footprint along its path; energy: half discs and "
        "a rectangle of equal energy; paper: Eq. 11; auto: moments, but exact for X-rays of voxels; movies: off unless "
        "--flow, --moments or --shutter ask for blur",
    )
    moments: int | None = _animation(
        None,
        ValueKind.whole(1, MAX_MOMENTS),
        "pictures that a frame is the mean of, up to 4096 (default: by the motion)",
    )
    shutter: float = _animation(
        180.0,
        ValueKind.number("an angle from 0 to 360 degrees", 0, FULL_SHUTTER, metavar="DEG"),
        "exposure in degrees, 360 being a whole frame",
    )
    order: Order = _paper(
        "auto", ValueKind.choice(Order), "drawing order of splats. It follows from their rows, without a sort"
    )
    occlusion: Occlusion = _speed(
        "auto",
        ValueKind.choice(Occlusion),
        "occlusion culling. auto: skips splats behind pixels that hardly any light passes",
    )
    tolerance: float = _accuracy(
        1 / 255,
        ValueKind.number("a number in (0, 1]", 0, 1, above=True, metavar="E"),
        "largest allowed error of a colour in linear light, up to 1 (default 1/255)",
    )
    background: Color | str | None = _picture(
        AUTO,
        ValueKind(
            "three linear numbers from 0 to 1, or a colour such as black",
            _background,
            read_background,
            "COLOUR",
            written=BACKGROUNDS,
            hint="str | Numbers | None",
        ),
        "auto, transparent, #rrggbb or a CSS name. auto: white behind surfaces, else black",
        level="basic",
    )
    clip: tuple[Plane, ...] = option(
        (),
        ValueKind("planes", check_planes, hint="Sequence[Numbers]"),
        "planes that keep n · x ≥ d of (n_x, n_y, n_z, d)",
    )

    if TYPE_CHECKING:

        def __init__(self, **options: Unpack[SettingsKeywords]) -> None: ...

    def __post_init__(self) -> None:
        check_options(self)

    @property
    def strengths(self) -> tuple[float | None, ...]:
        """Strengths of ambient, diffuse and specular light; None: the light's."""
        return self.ambient, self.diffuse, self.specular

    @property
    def filter_width(self) -> float:
        """Minimum width of a voxel in pixels after antialiasing; samples, of which each pixel has several."""
        return self.blur_width if self.antialias == "paper" else 1.0

    @property
    def mixes_display(self) -> bool:
        """Whether display values (sRGB) are mixed, as in framebuffers of 8 bits; else linear light."""
        return self.target == "rgba8" and not self.is_sum

    @property
    def ground(self) -> Color | None:
        """The background of the picture of a renderer, linear RGB. None: transparent, as "auto" is before it is chosen
        for a scene.
        """
        return None if isinstance(self.background, str) else self.background

    @property
    def backdrop(self) -> Color | None:
        """The background that pixels hold, linear RGB. None: transparent, as all sums are."""
        return None if self.is_sum else self.ground

    @property
    def absorbing(self) -> Settings:
        """The settings of a picture whose rays are absorbed: composite instead of one value of each."""
        return self.replace(blend="composite") if self.shows_value else self

    @property
    def draft(self) -> Settings:
        """The settings of a draft: one sample a pixel, to a larger tolerance."""
        antialias: Antialias = "off" if self.antialias in AVERAGED else self.antialias
        return self.replace(antialias=antialias, tolerance=max(self.tolerance, LENIENT))

    def require_composite(self, what: str) -> None:
        """Raises InputError for all blends but composite, which the named feature does not support."""
        if not self.hides:
            raise expected(what, "blend composite", self.blend)

    @property
    def given(self) -> dict[str, Any]:
        """The fields that differ from their defaults."""
        return non_default(self)

    def replace(self, **changes: Unpack[SettingsKeywords]) -> Settings:
        """The settings with changes. Raises InputError for unknown names."""
        reject_unknown("settings", changes, declared(self), "names of Settings' fields")
        return replace(self, **changes)  # type: ignore[arg-type]

    @classmethod
    def of(cls, x: Any) -> Settings:
        """Blend, light and background of a PyVista plotter, or of a window or renderer of VTK. Raises InputError for
        blends that there are not.
        """
        from splatgl.integrations.vtk.scene import settings_of

        return settings_of(x)

    @classmethod
    def like(cls, version: str, **changes: Unpack[SettingsKeywords]) -> Settings:
        """The defaults of an earlier version, "0.1" or "0.2": its default picture, except for faults fixed since."""
        if version not in LIKE:
            raise expected("like", f"a version that is known: {', '.join(LIKE)}", repr(version))
        return cls(**LIKE[version]).replace(**changes)

    @classmethod
    def paper(cls, **changes: Unpack[SettingsKeywords]) -> Settings:
        """The 1998 hardware path: hybrid, an 8-bit 256×256 table, opacity attenuation, quads, 8-bit target that mixes
        display values, every splat in order, and streaks of the paper's Eq. 11 where something moves.
        """
        return cls(
            **{**LIKE["0.1"], "motion": "paper"},
            align="hybrid",
            footprint="table",
            table_size=256,
            table_bits=8,
            attenuation="opacity",
            technique="quads",
            target="rgba8",
        ).replace(**changes)


_makers = (Settings.like.__func__, Settings.paper.__func__)  # type: ignore[attr-defined]
for _function in (Settings.__init__, Settings.replace, *_makers):
    with_keywords(keywords_of(Settings))(_function)


def choices() -> dict[str, tuple[str, ...]]:
    """Values of each setting that has names, the default first, registered kernels last."""
    return {name: setting.choices for name, setting in declared(Settings).items() if setting.choices}

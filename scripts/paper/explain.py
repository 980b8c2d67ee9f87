"""`scripts/figure explain`: effect of antialiasing on one voxel, and the error of each splat form there."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from paper.figures.footprint_errors import ALL, Form, Peak, Space, maximum
from paper.figures.paper_setup import straight_ahead
from paper.forms import half_line

from splatgl.errors import expected
from splatgl.geometry.camera import Camera
from splatgl.options import declared
from splatgl.planning.resolve import PRE_KERNEL, voxel_kernel
from splatgl.splat.footprint import Splat, row1
from splatgl.splat.kernels import Kernel, kernel
from splatgl.splat.settings import Settings

WHAT = {
    "row1": "trapezoid, diverging rays: the right value",
    "row2": "box, diverging rays",
    "row3": "ray-perpendicular, ideal",
    "row4": "ray-perpendicular quad",
    "row5": "grid-aligned quad",
    "a": "ray-perpendicular quad made elliptic",
    "b": "ellipse on the image plane",
    "b1": "the same by the cost of row 5",
    "c": "true distance before z_k, b behind it",
    "bprime": "b with the trapezoid's bend",
}
# maximum distance in spacings: beyond it rays lose all precision
FAR = 1e9
# forms that require the voxel's own ray in front of the eye
AHEAD = ("a", "b", "b1", "c", "bprime")
# depth in radii within which all rays of the image are tried
NEAR = 2.0
PICTURE_RAYS = 161
SPACE_RAYS = 41


def add_parser(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `scripts/figure explain`."""
    # a position may start with a minus sign
    parser._negative_number_matcher = re.compile(r"^-\.?\d")
    parser.add_argument(
        "voxel", type=_position, metavar="X,Y,Z", help="centre of the voxel: right, down and forward of the eye"
    )
    parser.add_argument(
        "--size", type=int, default=512, metavar="N", help="width and height of the picture in pixels (default 512)"
    )
    parser.add_argument(
        "--fov", type=float, default=60.0, metavar="A", help="full angle of view in degrees (default 60)"
    )
    kind = declared(Settings)["kernel"].kind
    about = "radial kernel (default crawfis-max)"
    parser.add_argument("--kernel", type=kind.parse, default=PRE_KERNEL, metavar=kind.metavar, help=about)
    parser.add_argument(
        "--spacing", type=float, default=1.0, metavar="S", help="voxel spacing, in units of X,Y,Z (default 1)"
    )
    parser.set_defaults(run=run)


def _position(text: str) -> tuple[float, ...]:
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected 3 numbers separated by commas, got {text!r}") from None
    return x, y, z


def run(args: argparse.Namespace) -> int:
    """Prints the page; returns 0."""
    if not 1 / FAR <= args.spacing <= FAR:
        raise expected("spacing", f"a positive length from {1 / FAR:g} to {FAR:g}", args.spacing)
    if not (np.abs(args.voxel) <= FAR * min(args.spacing, 1.0)).all():
        raise expected("X,Y,Z", f"finite numbers, up to {FAR:g} spacings", args.voxel)
    camera = straight_ahead(args.size, args.fov)
    sight = Sight(kernel(voxel_kernel(Settings(kernel=args.kernel))), camera, np.array(args.voxel) / args.spacing)
    if sight.voxel[2] <= -sight.kernel.radius:
        raise expected("X,Y,Z", "a voxel in front of the eye", f"Z = {args.voxel[2]:g}", "give a larger Z")
    print("\n".join([*_place(sight, args), "", *_table(sight)]))
    return 0


@dataclass(frozen=True, eq=False)
class Sight:
    """A voxel [3] in front of the camera at the origin; lengths in voxel spacings."""

    kernel: Kernel
    camera: Camera
    voxel: np.ndarray

    @property
    def z(self) -> float:
        """The voxel's depth, in voxel spacings."""
        return float(self.voxel[2])

    @property
    def half(self) -> bool:
        """Whether the kernel reaches the eye plane: rays start inside it, and it is not stretched."""
        return self.z <= self.kernel.radius

    @cached_property
    def z_k(self) -> float:
        """Depth beyond which it would be stretched."""
        return np.inf if self.half else float(self.camera.z_k(1.0))

    @property
    def m(self) -> float:
        """The stretch: depth over z_k, at least 1."""
        return max(self.z / self.z_k, 1.0)

    @property
    def level(self) -> float:
        """1/255 of the footprint's peak F(0)/m²."""
        return float(self.kernel.footprint(np.zeros(()))) / self.m**2 / 255

    def right(self, splat: Splat) -> np.ndarray:
        """The exact value: row 1, integrated from the eye if the kernel reaches it."""
        if not self.half:
            return row1(splat)
        direction = np.concatenate([splat.slope, np.ones((*splat.slope.shape[:-1], 1))], axis=-1)
        return half_line(splat.kernel, splat.voxel, direction)

    def worst(self, form: Form) -> tuple[float, np.ndarray]:
        """Maximum error in levels, and the slopes [2] of its ray."""
        splat, points = self._rays()

        def error(place: np.ndarray) -> np.ndarray:
            seen = splat(place)
            value = form(seen)
            # a quad that the ray meets behind the eye is not drawn: value 0
            return np.asarray(np.abs(np.where(np.isnan(value), 0.0, value) - self.right(seen)))

        with np.errstate(divide="ignore", invalid="ignore"):
            peak: Peak = maximum(error, 1, 2, points)
        return float(peak.value[0]) / self.level, splat(peak.place[:, None]).slope[0, 0]

    def centre(self, form: Form) -> float:
        """Error in levels on the ray through the voxel's centre; NaN if there is none."""
        if self.z <= 0:
            return np.nan
        splat = Splat(self.kernel, self.voxel, self.voxel[:2] / self.z, self.z_k)
        return float(np.abs(form(splat) - self.right(splat))) / self.level

    @property
    def near(self) -> bool:
        """Whether its footprint may be as wide as the image."""
        return self.z <= NEAR * self.kernel.radius

    def _rays(self) -> tuple[Callable[[np.ndarray], Splat], int]:
        """Rays by position in [−1, 1]², over the footprint or, near the eye, over the image; and how many to try."""
        if not self.near:
            return Space(self.kernel, self.z_k, self.voxel[None]).splat, SPACE_RAYS
        half = np.arctan(self.camera.extent / 2)
        return lambda place: Splat(self.kernel, self.voxel, np.tan(place * half), self.z_k), PICTURE_RAYS


def _place(sight: Sight, args: argparse.Namespace) -> list[str]:
    """Position of the voxel, and the effect of antialiasing on it."""
    x, y, z = args.voxel
    s, z_k = args.spacing, float(sight.camera.z_k(args.spacing))
    lines = [
        f"voxel ({x:g}, {y:g}, {z:g}), spacing {s:g}; "
        f"kernel {sight.kernel.name}, radius {sight.kernel.radius:g} voxels",
        f"picture {args.size}×{args.size}, {args.fov:g}° across; {_pixel(sight)}",
        "",
        f"z_v   {z:<12.6g} its depth",
        f"z_k   {z_k:<12.6g} the depth at which a voxel is one pixel wide",
        f"m     {sight.m:<12.6g} stretch: {_why(sight)}",
        f"1/m²  {sight.m**-2:<12.6g} amplitude",
    ]
    if np.linalg.norm(sight.voxel) < sight.kernel.radius:
        lines += ["", "The eye is inside the kernel: the right value is the integral from the eye on,", HALF]
    elif sight.half:
        lines += ["", "The kernel reaches the eye's plane: the right value starts at the eye,", HALF]
    return lines


HALF = "the half line; the forms below know nothing of it and take the whole line."


def _why(sight: Sight) -> str:
    if sight.half:
        return "none so near to the eye"
    return "z_v/z_k, behind z_k" if sight.z >= sight.z_k else "none before z_k"


def _pixel(sight: Sight) -> str:
    if sight.z <= 0:
        return "its centre is behind the eye"
    pitch, count = sight.camera.extent / sight.camera.size[1], sight.camera.size[0]
    column, row = np.floor(sight.voxel[:2] / sight.z / pitch + count / 2).astype(int)
    inside = 0 <= column < count and 0 <= row < count
    return f"its centre is in pixel ({column}, {row})" if inside else "its centre is outside of the picture"


def _table(sight: Sight) -> list[str]:
    """Errors of every form, in levels."""
    rays = "the picture's rays" if sight.near else "the footprint's rays"
    lines = [
        f"error in levels (1/255 of the footprint's peak), over {rays}",
        f"{'':7}{'':43}{'worst':>9} {'off (px)':>8} {'centre':>9}",
    ]
    for name, form in ALL.items():
        if name in AHEAD and sight.z <= 0:
            shares = ("–", "–", "–")
        else:
            level, slope = sight.worst(form)
            shares = (_digits(level), _off(sight, slope) if level > TINY else "–", _digits(sight.centre(form)))
        shown = name.replace("prime", "′")
        what = "the kernel as it is" if sight.half and name == "row1" else WHAT[name]
        lines.append(f"{shown:7}{what:43}{shares[0]:>9} {shares[1]:>8} {shares[2]:>9}")
    return lines


# levels below this are rounding
TINY = 1e-9
# distances below this many pixels count as 0
SAME_RAY = 1e-3


def _digits(level: float) -> str:
    if not np.isfinite(level):
        return "–"
    return "0" if level < TINY else f"{level:.3g}"


def _off(sight: Sight, slope: np.ndarray) -> str:
    """Distance in pixels from the voxel's centre to the ray, as text."""
    if sight.z <= 0:
        return "–"
    pixels = float(np.hypot(*(slope - sight.voxel[:2] / sight.z)) * sight.camera.z_k(1.0))
    return "0" if pixels < SAME_RAY else f"{pixels:.3g}"

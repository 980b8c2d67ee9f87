"""The error bound: the largest difference of a picture from the float64 reference, row 1 of Table 1 for every `align`.

A footprint's error has three parts: the position D (float32 and the form), the form's gain, and the table.

Accumulation along a ray is derived. A fragment's optical depth τF has an error δ ≤ ρ τF + σ τF(0). With c its colour
and T the transmittance behind it, ∂C/∂τF = T (c − colour behind), so that

    Σ T σ τ F(0) ≤ σ S,    S the depth of all footprints that one ray meets, even at the rim (ray_overlap.py);
    ρ Σ T τF |c − behind| ≤ ρ/2,    within sheets ρ (MIXED),

since with q the visible colour, c = q − dq/dτ in [0, 1], and ∫ e^(−τ) |dq/dτ| dτ ≤ 1/2 for every q. Where F is small
the relative error is large and the absolute error is not, so that (ρ, σ) is chosen per picture.
Three quantities are measured, with a margin: ROUNDINGS, the second-order error beyond z_k (BENT, MOVED), and the effect
of misplaced sheets (DISPLACED).

For motion blur the reference is the float64 streaks of the same splats, not temporal supersampling. A streak is the
mean of a footprint along its path, and so is its error; the difference of two areas adds its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from splatgl.splat.culling import clip_behind_eye
from splatgl.splat.kernels import Kernel, kernel, polynomials, radial_table, rim_step
from splatgl.splat.motion import Exposure
from splatgl.splat.plan import Lookup
from splatgl.splat.ray_overlap import RayOverlap, cells_of, ray_overlap
from splatgl.splat.splats import Splats
from splatgl.splat.view import GridView

if TYPE_CHECKING:
    from splatgl.splat.plan import Plan


# float32 rounds by at most half of this
ULP = 2.0**-23
# samples of the footprint from centre to rim, dense at the rim; candidate absolute errors
SAMPLES = 400
ABSOLUTE = np.logspace(-12, 0, 73)
# cancellation error of a polynomial in float32, in ULPs of its value
POLYNOMIAL_DIGITS = 64
# error of filtering 8-bit texels in 8-bit arithmetic, besides the texels' own rounding
EIGHT_BITS = 1.5 / 255


@dataclass(frozen=True)
class PlacementError:
    """Errors of a fragment: distance in voxels (place), value relative to itself (gain) and to F(0) (level)."""

    place: float
    gain: float = 0.0
    level: float = 0.0


def accumulated_error(lookup: Lookup, placement: PlacementError, weight: float, overlap: float) -> float:
    """The largest accumulated error along a ray: min over σ of weight · ρ(σ) + overlap · F(0) · σ."""
    missed = _deviation(lookup, placement)
    value, peak = _profile(lookup.kernel)
    over = np.maximum(missed[None, :] - ABSOLUTE[:, None], 0.0)
    relative = np.where(over > 0, over / np.maximum(np.abs(value), 1e-30), 0.0).max(axis=1)
    return float((weight * relative + overlap * peak * ABSOLUTE).min())


@lru_cache(maxsize=4)
def _profile(name: str) -> tuple[np.ndarray, float]:
    """F/F(0) at _distances, and F(0)."""
    shape = kernel(name)
    peak = float(shape.footprint(np.zeros(())))
    return np.asarray(shape.footprint(_distances(shape)) / peak), peak


def _distances(shape: Kernel) -> np.ndarray:
    return shape.radius * (1 - np.linspace(1, 0, SAMPLES) ** 3)


def _deviation(lookup: Lookup, placement: PlacementError) -> np.ndarray:
    """|drawn − right| / F(0) at _distances."""
    # quantised to tenths of log10, so that moving cameras hit the cache
    return _deviation_at(lookup, _quantize(placement.place), _quantize(placement.gain)) + placement.level


def _quantize(number: float) -> float:
    return float(10 ** (np.ceil(10 * np.log10(max(number, 1e-12))) / 10))


@lru_cache(maxsize=256)
def _deviation_at(lookup: Lookup, place: float, gain: float) -> np.ndarray:
    shape = kernel(lookup.kernel)
    d = _distances(shape)
    value, peak = _profile(lookup.kernel)
    # where F falls everywhere, the ends have the largest difference
    sides = [shape.footprint(np.clip(d + side * place, 0, None)) / peak for side in (-1, -0.5, 0.5, 1)]
    moved = np.max([np.abs(side - value) for side in sides], axis=0)
    return np.asarray(moved + _table_error(lookup, shape, d, value) + (gain + ULP) * np.abs(value))


def _table_error(lookup: Lookup, shape: Kernel, d: np.ndarray, value: np.ndarray) -> np.ndarray:
    if lookup.kind == "polynomial":
        fitted = polynomials(lookup.kernel)
        assert fitted is not None
        return np.asarray(np.abs(fitted((d / shape.radius) ** 2) - value) + POLYNOMIAL_DIGITS * ULP * value)
    if lookup.kind == "radial":
        table = radial_table(shape, lookup.size)[0]
        place = np.clip((d / shape.radius) ** 2 * (lookup.size - 1), 0, lookup.size - 1)
        texel = place.astype(int)
        return np.asarray(np.abs(table[texel, 0] + table[texel, 1] * (place - texel) - value))
    # bilinear between texels h apart: h²/8 of the second derivatives, plus the texels' rounding
    h = 2 * shape.radius / lookup.size
    first = np.gradient(value, d)
    missed = h * h / 8 * (np.abs(np.gradient(first, d)) + np.abs(first) / np.maximum(d, h))
    return np.asarray(missed + (EIGHT_BITS if lookup.bits == 8 else 2.0**-lookup.bits))


# largest error of a voxel's position against a pixel's ray, in float32 ULPs of its distance from the eye
ROUNDINGS = 0.5
# beyond z_k `exact` has second-order errors: at depth z a relative gain of BENT/z² and a shift of
# (MOVED₀ + MOVED₁ tan²θ)/z² voxels, up to 60° off axis; three times the shift for the Gaussian, which has a rim
BENT, MOVED = 0.8, (0.3, 0.75)
RIMMED = 3.0
# error of one rounding of a number of 0.5 to 1, and of any smaller number; drivers may truncate to 16 bits instead of
# rounding, and blend 8-bit targets in 8 bits; 'over' in float32 rounds 1 − α, its product and the sum
TARGET = {"rgba32f": (ULP / 4, 0.0), "rgba16f": (2.0**-11, 2.0**-24), "rgba8": (1.5 / 255, 1.5 / 255)}
OVER = 3.0
# a kernel around the eye: error of the half-line table's share of a chord, times F/F(0); and of the sum over all
# lattice kernels around the eye
HALF_LINE, AROUND = 3.2e-5, 1.2e-4
# shading, colour and one_minus_exp in float32
ARITHMETIC = 8 * ULP
# within a sheet, errors of opposite sign change the mean colour besides the opacity. A splat's place in sheets is wrong
# by at most PLACE_DIGITS ULPs; DISPLACED: largest change of a picture per misplaced sheet (measured from 300 to 300 000
# voxels away, opacities of 0.05 to 1: 0.04)
MIXED, PLACE_DIGITS, DISPLACED = 1.0, 4.0, 0.25
# tiles use colours of 21 bits and a faster one_minus_exp
GATHERED = 10 * ULP
# a streak has three positions instead of one; error of float32 areas over its length, in F(0); largest ratio of a ray's
# overlap between the exposure's ends and middle to the overlap there
PLACES, AREAS, BETWEEN = 3.0, 5e-6, 1.5
# nearer to the eye's plane than this many kernel reaches, streaks are degenerate: AHEAD of motion.glsl with a margin
AHEAD = 1.15
# largest change of a moving splat's opacity, per relative and per absolute change of its two depths
DWELT = (1.7, 2.0)


@dataclass(frozen=True)
class Bound:
    """Parts of the bound, linear light; `total`: the largest error of a pixel, at most `largest`.

    footprint: form, table and float32 positions; hidden: early termination; rounding: of the target, per blend.
    """

    footprint: float
    hidden: float
    rounding: float
    largest: float

    @property
    def total(self) -> float:
        """The sum of the parts, at most `largest`."""
        return float(min(self.footprint + self.hidden + self.rounding, self.largest))

    def __str__(self) -> str:
        return (
            f"{self.total:.3g} (footprints {self.footprint:.3g}, hidden {self.hidden:.3g}, "
            f"rounding {self.rounding:.3g})"
        )


def bound(splats: Splats, plan: Plan, brightest: float) -> Bound | None:
    """Error bound of a picture; brightest: its largest component, to which an X-ray's errors are relative.

    None for streaks near the eye and of long voxels beyond z_k, which deviate from their model; for values classified
    after reconstruction; and for boxes, since a ray along a face may meet either of two.
    """
    if plan.program.look.steps > 0 or plan.program.boxes:
        return None
    if plan.exposure is None:
        splats = clip_behind_eye(splats, plan.resolved.camera)
    if not len(splats):
        lost = _resolve_error(plan, 1.0 if plan.resolved.background else 0.0)
        return Bound(0.0, 0.0, lost, lost)
    program, blend = plan.program, plan.program.look.blend
    most = max(splats.brightest, 1.0)
    if plan.exposure is None:
        placement, met = _placement_error(splats, plan.view, plan), ray_overlap(splats, plan.view)
    else:
        blurred = _streak_errors(splats, plan, plan.exposure)
        if blurred is None:
            return None
        placement, met = blurred
    brightest_pixel = _largest_pixel(splats, plan, met, most)
    # 8 bits clamp values over 1
    cut = plan.target == "rgba8" and (blend.unbounded or brightest_pixel > 1.0)
    # and an approximate form may miss the brightest parts
    other = plan.view.perspective and program.align != "exact"
    brightest = brightest_pixel if cut or other else brightest
    footprint = _footprint_error(splats, plan, placement, met, brightest / most) * most
    footprint += _displacement_error(splats, plan) * most
    scale = {"over": most, "sum": brightest, "max": brightest_pixel}[blend.join]
    share, least = TARGET[plan.target]
    rounding = max(_next_power_of_two(scale) * share, least) * (1.0 if blend.join == "max" else met.count)
    if blend.ordered and plan.target == "rgba32f":
        rounding *= OVER
    lost = _resolve_error(plan, max(scale, 1.0 if plan.resolved.background else 0.0))
    # rounding up, or a form that overestimates a ray's length, makes pixels brighter than the true maximum
    longest = 2 * float(np.hypot(_corner_slope(plan.view), 1.0)) if other and not blend.ordered else 1.0
    hidden = plan.hiding.cutoff * most
    return Bound(
        footprint, hidden, brightest_pixel if cut else rounding + lost, brightest_pixel * longest + least + lost
    )


def _streak_errors(splats: Splats, plan: Plan, exposure: Exposure) -> tuple[PlacementError, RayOverlap] | None:
    """Placement error and ray overlap of streaks; None if streaks deviate from their model."""
    shape, props = plan.kernel, plan.program.seen
    steps = splats.grid.world_from_index / splats.grid.mean_spacing
    astray = 0.0 if exposure.flow is None else 2 * float(np.linalg.norm(exposure.drift(splats), axis=1).max())
    cameras = (exposure.first, exposure.middle, exposure.last)
    views = [GridView.of(splats.grid, camera.resized(plan.view.size), shape, props.antialias) for camera in cameras]
    boxes = [view.box(splats) for view in views]
    longest = float(np.linalg.norm(steps, ord=2))
    nearest = min(float(box[2].min()) for box in boxes) - astray * longest
    if nearest <= AHEAD * shape.radius * longest or (props.antialias and not props.cubic):
        return None
    placements = [_placement_error(splats, view, plan) for view in views]
    placement = PlacementError(
        PLACES * max(error.place for error in placements),
        max(error.gain for error in placements),
        AREAS if plan.program.motion == "exact" else 0.0,
    )
    # a path's length, in voxels, and the area of the stadium that a disc sweeps
    flat = [
        box[:2] / (box[2] if view.perspective else 1.0) / camera.extent
        for box, view, camera in zip(boxes, views, cameras, strict=True)
    ]
    deepest = max(float(box[2].max()) for box in boxes) if exposure.middle.perspective else 1.0
    path = float(np.linalg.norm(flat[2] - flat[0], axis=0).max()) * exposure.middle.extent * deepest
    area = BETWEEN * (1 + 2 * path / (np.pi * shape.radius))
    met = [ray_overlap(splats, view, astray) for view in views]
    count = min(float(len(splats)), area * max(overlap.count for overlap in met))
    return placement, RayOverlap(
        count, min(splats.total_depth * longest, BETWEEN * max(overlap.depth for overlap in met))
    )


def _largest_pixel(splats: Splats, plan: Plan, met: RayOverlap, most: float) -> float:
    """An upper bound on pixel values."""
    if plan.program.look.blend.ordered:
        return most
    if plan.program.look.blend.peak:
        return most * _largest_opacity(splats)
    return most * met.depth * float(plan.kernel.footprint(np.zeros(())))


def _largest_opacity(splats: Splats) -> float:
    """The largest opacity of a splat, over the transfer function's reference length."""
    return float(-np.expm1(-splats.deepest * splats.unit / splats.grid.mean_spacing))


def _resolve_error(plan: Plan, scale: float) -> float:
    """Float32 error of averaging samples and blending over a background; 0 without either."""
    if not plan.resolved.averaged and plan.resolved.background is None:
        return 0.0
    return ULP * (plan.samples + 3) * _next_power_of_two(scale)


def _next_power_of_two(largest: float) -> float:
    """The next power of two: numbers below it have a rounding error of at most it times TARGET."""
    return float(2.0 ** np.ceil(np.log2(max(largest, 1e-30))))


def _footprint_error(splats: Splats, plan: Plan, placement: PlacementError, met: RayOverlap, brightest: float) -> float:
    """Total error of all fragments of a ray, for colours up to 1."""
    program, blend, half_line = plan.program, plan.program.look.blend, plan.program.seen.half_line
    # a highlight is a power of a cosine
    arithmetic = ARITHMETIC * 2.0**program.look.light.sharpness + GATHERED * (program.technique == "tiles")
    if blend.peak:
        largest = float(_deviation(plan.lookup, placement).max()) + HALF_LINE * half_line + arithmetic
        return min(largest * _largest_opacity(splats), 1.0)
    # an X-ray is a plain sum
    weight, deep = (0.5 if blend.ordered else brightest), met.depth
    if plan.resolved.sheets is not None:
        weight = MIXED
    if program.motion != "off" and program.look.attenuation == "fill":
        weight, deep = DWELT[0], DWELT[1] * met.depth
    share = accumulated_error(plan.lookup, placement, weight, deep)
    if half_line:
        # in optical depth, over kernels around the eye
        cells, error = cells_of(splats), HALF_LINE * splats.total_depth
        error = min(error, AROUND * cells.depth) if cells.aligned else error
        share += error * float(plan.kernel.footprint(np.zeros(())))
    return share + arithmetic * max(weight, 1.0)


def _displacement_error(splats: Splats, plan: Plan) -> float:
    """Error by the places of splats in sheets, in float32."""
    if plan.resolved.sheets is None:
        return 0.0
    far = np.abs(plan.resolved.sheets.places(plan.view, splats.corners_in_grid())).max()
    return DISPLACED * PLACE_DIGITS * ULP * float(far)


def _placement_error(splats: Splats, view: GridView, plan: Plan) -> PlacementError:
    """The largest error of a fragment's distance D, in voxels, and of its value."""
    radius, corners = view.kernel.radius, view.box(splats)
    widths = np.linalg.svd(view.eye_from_index, compute_uv=False)
    # float32: relative to the distance from the eye, larger for thin voxels
    far = float(np.linalg.norm(corners, axis=0).max()) if view.perspective else float(np.abs(corners).max())
    place, gain = ROUNDINGS * ULP * (far + radius) / widths[-1], 0.0
    if not view.perspective:
        return PlacementError(place)
    if view.antialias:
        nearest = max(view.widened_beyond[1], float(corners[2].min())) / widths[0]
        moved = MOVED[0] + MOVED[1] * _corner_slope(view) ** 2
        place += (RIMMED if rim_step(view.kernel) > 1e-6 else 1.0) * moved / nearest**2 * widths[0] / widths[-1]
        gain = BENT / nearest**2 + plan.resolved.unsure
    if plan.program.align != "exact":
        place += _form_error(view, plan, float(corners[2].min())) / widths[-1]
    return PlacementError(min(place, radius), gain)


def _corner_slope(view: GridView) -> float:
    """The slope of a ray at the picture's corner."""
    return float(np.hypot(*view.edge))


def _form_error(view: GridView, plan: Plan, nearest: float) -> float:
    """Position error of Table 1's forms, which use one plane or direction for all rays: slant at the picture's edge."""
    radius = view.kernel.radius
    near = radius**2 / max(nearest, 1e-3)
    if plan.program.align == "ray" and not view.antialias:
        return float(near)
    return float(radius * (np.hypot(_corner_slope(view), 1.0) - 1) + near)

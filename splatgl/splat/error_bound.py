"""The error bound: the largest difference of a picture from the float64 reference, row 1 of Table 1 for every `align`.

A footprint's error has three parts: the position D (float32 and the form), the form's gain, and the table.

Accumulation along a ray is derived. A fragment's optical depth τF has an error δ ≤ ρ τF + σ τF(0). With c its colour
and T the transmittance behind it, ∂C/∂τF = T (c − colour behind), so that

    Σ T σ τ F(0) ≤ σ S,    S the depth of all footprints that one ray meets, even at the rim (ray_overlap.py);
    ρ Σ T τF |c − behind| ≤ ρ min(1/2, A),    within sheets ρ A,

A the pixel's opacity, since with q the visible colour, c = q − dq/dτ in [0, 1], ∫ e^(−τ) |dq/dτ| dτ ≤ 1/2 for every q,
and |c − behind| ≤ 1. Where F is small the relative error is large and the absolute error is not, so that (ρ, σ) is
chosen per picture. Along the straight path from right to drawn depths, ρ τF is at most ρ/(1 − ρ) of what is drawn, and
its opacity at most (A + σ S)/(1 − ρ): the sum is divided by (1 − ρ)². A is bounded by the drawn picture and by S.
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
from splatgl.splat.hidden_interior import LIGHT
from splatgl.splat.kernels import Kernel, kernel, polynomials, radial_table, rim_step
from splatgl.splat.motion import Exposure
from splatgl.splat.plan import Lookup
from splatgl.splat.ray_overlap import ROUNDED, RayOverlap, cells_of, ray_overlap
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
    """The largest accumulated error along a ray: min over σ of (weight · ρ(σ) + overlap · F(0) · σ)/(1 − ρ)²."""
    missed = _deviation(lookup, placement)
    value, peak = _profile(lookup.kernel)
    # with the largest, nothing is relative
    absolute = np.append(ABSOLUTE, missed.max())
    over = np.maximum(missed[None, :] - absolute[:, None], 0.0)
    relative = np.where(over > 0, over / np.maximum(np.abs(value), 1e-30), 0.0).max(axis=1)
    some = relative < 1
    return float(((weight * relative + overlap * peak * absolute)[some] / (1 - relative[some]) ** 2).min())


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
# beyond z_k `exact` has second-order errors: at depth z, in reaches of a kernel of radius R voxels, a relative gain of
# BENT/z² and a shift of R (MOVED₀ + MOVED₁ sin²θ)/z² voxels, θ the ray's angle to the axis in the space that widening
# shrinks; RIMMED times the shift for the Gaussian, which has a rim. For cubes the ray's length is expanded in the
# footprint's half width t, in slopes: a gain of SECANT · min(t², t³)
BENT, MOVED, RIMMED, SECANT = 0.4, (0.08, 1.5), 2.5, 0.12
# of other voxels also by the fourth power of sin θ; and near ones, whose first-order terms may be left out, by
# OMITTED₀/z² of them, at most OMITTED₁
MOVED_LONG, OMITTED = (0.4, 0.4, 9.0), (18.0, 1.8)
# error of one rounding of a number of 0.5 to 1, and of any smaller number; drivers may truncate to 16 bits instead of
# rounding, blend 8-bit targets in 8 bits, and flush the smallest numbers to 0; 'over' in float32 rounds 1 − α, its
# product and the sum
TARGET = {"rgba32f": (ULP / 4, 2.0**-126), "rgba16f": (2.0**-11, 2.0**-24), "rgba8": (1.5 / 255, 1.5 / 255)}
OVER = 3.0
# largest ratio of a line integral to the one through the centre of its voxel, beyond z_k
BRIGHTER = 1.1
# a kernel around the eye: error of the half-line table's share of a chord, times F/F(0); and of the sum over all
# lattice kernels around the eye
HALF_LINE, AROUND = 3.2e-5, 1.2e-4
# shading, colour and one_minus_exp in float32
ARITHMETIC = 8 * ULP
# a splat's place in sheets is wrong by at most PLACE_DIGITS ULPs; DISPLACED: largest change of a picture per misplaced
# sheet (measured from 300 to 300 000 voxels away, opacities of 0.05 to 1: 0.04)
PLACE_DIGITS, DISPLACED = 4.0, 0.25
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


def bound(splats: Splats, plan: Plan, pixels: np.ndarray) -> Bound | None:
    """Error bound of a picture. pixels [H, W, 4]: as drawn; the errors of an X-ray are relative to the largest.

    None for streaks near the eye and of long voxels beyond z_k, which deviate from their model; for values classified
    after reconstruction; and for boxes, since a ray along a face may meet either of two.
    """
    if plan.program.look.steps > 0 or plan.program.boxes:
        return None
    if plan.exposure is None:
        splats = clip_behind_eye(splats, plan.resolved.camera)
    if not len(splats):
        lost = _resolve_error(plan, 0.0)
        return Bound(0.0, 0.0, lost, lost)
    blend, most = plan.program.look.blend, max(splats.brightest, 1.0)
    if plan.exposure is None:
        placement, met = _placement_error(splats, plan.view, plan), ray_overlap(splats, plan.view)
    else:
        blurred = _streak_errors(splats, plan, plan.exposure)
        if blurred is None:
            return None
        placement, met = blurred
    brightest_pixel = _largest_pixel(splats, plan, met) * most
    # 8 bits clamp values over 1
    cut = plan.target == "rgba8" and (blend.unbounded or brightest_pixel > 1.0)
    opacity = _largest_alpha(plan, pixels, met) if blend.ordered else 1.0
    brightest = brightest_pixel if cut or not blend.unbounded else float(pixels.max())
    scale = {"over": most * opacity, "sum": brightest, "max": brightest_pixel}[blend.join]
    footprint = _footprint_error(splats, plan, placement, met, opacity if blend.ordered else brightest / most) * most
    footprint += _displacement_error(splats, plan, opacity) * most
    rounding, lost = _rounding_error(plan, scale, met.count), _resolve_error(plan, scale)
    hidden = (_hidden_light(plan, pixels, opacity) + LIGHT * (splats.hollow > 0)) * most
    largest = _largest_difference(plan, pixels, brightest_pixel) + lost
    return Bound(footprint, hidden, brightest_pixel if cut else rounding + lost, largest)


def _largest_difference(plan: Plan, pixels: np.ndarray, right: float) -> float:
    """The largest difference of two pictures without negative values: the largest value of either. right: of one."""
    if plan.resolved.background is None or plan.program.look.blend.unbounded:
        return max(right, float(pixels.max())) + max(-float(pixels.min()), 0.0)
    # rounding up, or a form that overestimates a ray's length, makes pixels brighter than the true maximum
    longer = 1.0 if plan.program.look.blend.ordered else _longest(plan)
    return right * longer + TARGET[plan.target][1]


def _longest(plan: Plan) -> float:
    """Largest ratio of a drawn line integral to the right one through the centre of its voxel."""
    if not plan.view.perspective or plan.program.align == "exact":
        return 1.0
    return 2 * float(np.hypot(_corner_slope(plan.view), 1.0))


def _largest_alpha(plan: Plan, pixels: np.ndarray, met: RayOverlap) -> float:
    """An upper bound on the opacities of right and drawn pixels without background, for `accumulated_error`."""
    if plan.exposure is not None:
        return 1.0
    largest = float(-np.expm1(-met.depth * _largest_integral(plan) * _longest(plan)))
    share, least = TARGET[plan.target]
    # roundings are relative to what is drawn
    lost = 2 * OVER * share * met.count
    if plan.resolved.background is not None or lost >= 0.5:
        return largest
    return min(largest, (float(pixels[..., 3].max()) + met.count * least) / (1 - lost))


def _rounding_error(plan: Plan, scale: float, count: float) -> float:
    """Error of `count` blends of numbers up to `scale`."""
    blend, (share, least) = plan.program.look.blend, TARGET[plan.target]
    once = max(_next_power_of_two(scale) * share, least)
    if blend.join == "max":
        return once
    return once * count * (OVER if blend.ordered and plan.target == "rgba32f" else 1.0)


def _hidden_light(plan: Plan, pixels: np.ndarray, opacity: float) -> float:
    """The largest transmittance behind which a tile may have terminated, 0 if no pixel is as opaque as that."""
    cutoff = plan.hiding.cutoff
    if opacity <= 1 - cutoff or cutoff == 0:
        return 0.0
    if plan.resolved.background is not None or plan.resolved.averaged:
        return cutoff
    alpha = pixels[..., 3]
    return float((1 - alpha[alpha > 1 - cutoff]).max(initial=0.0))


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


def _largest_pixel(splats: Splats, plan: Plan, met: RayOverlap) -> float:
    """An upper bound on the right pixel values, over a background on all, for colours up to 1."""
    if plan.program.look.blend.peak:
        return min(_largest_opacity(splats) * (1 + ROUNDED), 1.0)
    depth = met.depth * _largest_integral(plan) * (1 + ROUNDED)
    if not plan.program.look.blend.ordered:
        return depth
    plain = plan.exposure is None and plan.resolved.background is None
    return min(float(-np.expm1(-depth)) * (1 + ROUNDED), 1.0) if plain else 1.0


def _largest_integral(plan: Plan) -> float:
    """The largest line integral of a kernel, over its effective length."""
    return float(plan.kernel.footprint(np.zeros(()))) * (BRIGHTER if plan.view.antialias else 1.0)


def _largest_opacity(splats: Splats) -> float:
    """The largest opacity of a splat, over the transfer function's reference length."""
    return float(-np.expm1(-splats.deepest * splats.unit / splats.grid.mean_spacing))


def _resolve_error(plan: Plan, scale: float) -> float:
    """Float32 error of averaging samples up to `scale` and blending over a background; 0 without either.

    A mean rounds, along each axis, weights, products and sums of samples + 2; over a background round its colour,
    1 − α, their product and the sum.
    """
    lost = (2 * plan.samples + 9) * ULP / 2 * scale if plan.resolved.averaged else 0.0
    if plan.resolved.background is not None and not plan.program.look.blend.unbounded:
        lost += ULP * _next_power_of_two(max(scale, 1.0))
    return lost


def _next_power_of_two(largest: float) -> float:
    """The next power of two: numbers below it have a rounding error of at most it times TARGET."""
    return float(2.0 ** np.ceil(np.log2(max(largest, 1e-30))))


def _footprint_error(splats: Splats, plan: Plan, placement: PlacementError, met: RayOverlap, largest: float) -> float:
    """Total error of all fragments of a ray, for colours up to 1. largest: opacity or sum of a pixel."""
    program, blend, half_line = plan.program, plan.program.look.blend, plan.program.seen.half_line
    # a highlight is a power of a cosine
    arithmetic = ARITHMETIC * 2.0**program.look.light.sharpness + GATHERED * (program.technique == "tiles")
    if blend.peak:
        missed = float(_deviation(plan.lookup, placement).max()) + HALF_LINE * half_line + arithmetic
        return min(missed * _largest_opacity(splats), 1.0)
    # an X-ray is a plain sum; within a sheet, errors of opposite sign change the mean colour besides the opacity
    weight, deep = largest, met.depth
    if blend.ordered and plan.resolved.sheets is None:
        weight = min(0.5, largest)
    if program.motion != "off" and program.look.attenuation == "fill":
        weight, deep = DWELT[0], DWELT[1] * met.depth
    share = accumulated_error(plan.lookup, placement, weight, deep)
    if half_line:
        # in optical depth, over kernels around the eye
        cells, error = cells_of(splats), HALF_LINE * splats.total_depth
        error = min(error, AROUND * cells.depth) if cells.aligned else error
        share += error * float(plan.kernel.footprint(np.zeros(())))
    return share + arithmetic * max(weight, largest)


def _displacement_error(splats: Splats, plan: Plan, opacity: float) -> float:
    """Error by the places of splats in sheets, in float32: extinction that moves to the next sheet changes what is
    visible by its difference to that in transmittance, colour mixed and colour behind, each at most the depth.
    """
    if plan.resolved.sheets is None:
        return 0.0
    far = np.abs(plan.resolved.sheets.places(plan.view, splats.corners_in_grid())).max()
    deep = -2 * float(np.log1p(-opacity)) if opacity < 0.5 else 1.0
    return DISPLACED * PLACE_DIGITS * ULP * float(far) * opacity * min(deep, 1.0)


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
        depths = view.voxels(splats.corners_in_grid())[2]
        if depths.max() > view.widened_beyond[1]:
            nearest = max(view.widened_beyond[1], float(depths.min()))
            moved, gain = _second_order(view, plan.program.seen.cubic, nearest)
            place += moved
        gain += plan.resolved.unsure
    if plan.program.align != "exact":
        place += _form_error(view, plan, float(corners[2].min())) / widths[-1]
    return PlacementError(min(place, radius), gain)


def _second_order(view: GridView, cubic: bool, nearest: float) -> tuple[float, float]:
    """Shift, in voxels, and relative gain of widened splats from the depth `nearest` on, in mean spacings."""
    radius, widths = view.kernel.radius, np.linalg.svd(view.eye_from_index, compute_uv=False)
    # a splat may be outside the picture by the footprint's half width
    half = 2 * radius * view.pitch + radius * widths[0] / nearest
    slope = float(view.shrink(np.array(nearest))[0]) * (_corner_slope(view) + half)
    sine2 = slope**2 / (1 + slope**2)
    bent = radius**2 * (widths[0] / nearest) ** 2
    if cubic:
        rim, t = RIMMED if rim_step(view.kernel) > 1e-6 else 1.0, radius * view.pitch
        return rim * radius * bent * (MOVED[0] + MOVED[1] * sine2), BENT * bent + SECANT * min(t**2, t**3)
    near = bent / radius**2 * widths[0] / widths[-1]
    moved = MOVED_LONG[0] + MOVED_LONG[1] * sine2 + MOVED_LONG[2] * sine2**2 + min(OMITTED[0] * near, OMITTED[1])
    return radius**3 * near * moved, BENT * bent


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

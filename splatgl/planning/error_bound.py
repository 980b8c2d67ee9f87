"""The error bound: the largest difference of a picture from the float64 reference, row 1 of Table 1 for every `align`.

A footprint's error has three parts: the position D (float32 and the form), the form's gain, and the table.

Accumulation along a ray is derived. A fragment's optical depth τF has an error δ ≤ ρ τF + σ τF(0). With c its colour
and T the transmittance behind it, ∂C/∂τF = T (c − colour behind), so that

    Σ T σ τ F(0) ≤ σ S,    S the depth of all footprints that one ray meets, even at the rim (ray_overlap.py);
    ρ Σ T τF |c − behind| ≤ ρ min(A, q (1 − q) + A/4),    q ≤ A the visible colour, so at most 1/2,

A the pixel's opacity. In a sheet of depth X, opacity a, mean colour c̄ before the colour b, the terms are at most
a (c̄ + m − 2 c̄ m), m = c̄ + (b − c̄) X/(e^X − 1): a mean distance of numbers in [0, 1]. This is at most
q (1 − q) − (1 − a) b (1 − b) + a/4, since q = a c̄ + (1 − a) b and (X/(e^X − 1))² ≤ e^(−X); the sum over all sheets
telescopes. A splat that is composited alone is such a sheet. Where F is small the relative error is large and the
absolute error is not, so that (ρ, σ) is chosen per picture, and σ per splat where few are counted one by one: then the
errors of near splats do not weigh on far ones. Along the straight path from right to drawn depths, ρ τF is at most
ρ/(1 − ρ) of what is drawn, and its opacity at most (A + σ S)/(1 − ρ): the sum is divided by (1 − ρ)². A is bounded by
the drawn picture and by S.
Three quantities are measured, with a margin: ROUNDINGS, the second-order error beyond z_k (BENT, MOVED), and the effect
of misplaced sheets (DISPLACED).

For motion blur the reference is the float64 streaks of the same splats, not temporal supersampling. A streak is the
mean of a footprint along its path, and so is its error; the difference of two areas adds its own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from splatgl.data.color import STEEPEST
from splatgl.geometry.view import GridView
from splatgl.planning.culling import clip_behind_eye
from splatgl.planning.plan import FootprintTable
from splatgl.planning.ray_overlap import FEW, ROUNDED, RayOverlap, SplatGroups, cells_of, overlap_by_places, ray_overlap
from splatgl.splat.hidden_interior import LIGHT
from splatgl.splat.kernels import (
    Kernel,
    half_chord,
    half_line_table,
    kernel,
    polynomials,
    radial_table,
    rim_step,
)
from splatgl.splat.motion import Exposure
from splatgl.splat.splats import Splats

if TYPE_CHECKING:
    from splatgl.planning.plan import Plan


# float32 rounds by at most half of this
ULP = 2.0**-23
# samples of the footprint from centre to rim, dense at the rim; candidate absolute errors
SAMPLES = 400
ABSOLUTE = np.logspace(-12, 0, 181)
# candidate relative errors
RELATIVE = np.append(0.0, np.logspace(-8, -0.3, 64))
# cancellation error of a polynomial in float32, in ULPs of its value
POLYNOMIAL_DIGITS = 64
# errors of places are rounded up to so many numbers a decade
QUANTA = 60
# error of filtering 8-bit texels in 8-bit arithmetic, besides the texels' own rounding
EIGHT_BITS = 1.5 / 255


@dataclass(frozen=True)
class PlacementError:
    """Errors of a fragment: distance in voxels (place), value relative to itself (gain) and to F(0) (level)."""

    place: float
    gain: float = 0.0
    level: float = 0.0


@dataclass(frozen=True, eq=False)
class CentreRange:
    """Where the centres of splats are, eye axes and mean spacings; each number or [N].

    near, far: their depths; away: the largest distance from the eye; slope: of the steepest ray of the picture to them.
    """

    near: np.ndarray
    far: np.ndarray
    away: np.ndarray
    slope: np.ndarray


def accumulated_error(lookup: FootprintTable, placement: PlacementError, weight: float, overlap: float) -> float:
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


def _deviation(lookup: FootprintTable, placement: PlacementError) -> np.ndarray:
    """|drawn − right| / F(0) at _distances."""
    place, gain = _quantize(np.array([placement.place, placement.gain]))
    return _deviation_at(lookup, place, gain) + placement.level


def _quantize(numbers: np.ndarray) -> np.ndarray:
    """Numbers rounded up to the next of QUANTA a decade, so that moving cameras hit the cache."""
    return np.asarray(10 ** (np.ceil(QUANTA * np.log10(np.maximum(numbers, 1e-12))) / QUANTA))


@lru_cache(maxsize=1024)
def _deviation_at(lookup: FootprintTable, place: float, gain: float) -> np.ndarray:
    shape = kernel(lookup.kernel)
    d = _distances(shape)
    value, peak = _profile(lookup.kernel)
    # where F falls everywhere, the ends have the largest difference
    sides = [shape.footprint(np.clip(d + side * place, 0, None)) / peak for side in (-1, -0.5, 0.5, 1)]
    moved = np.max([np.abs(side - value) for side in sides], axis=0)
    return np.asarray(moved + _table_error(lookup, shape, d, value) + (gain + ULP) * np.abs(value))


def _table_error(lookup: FootprintTable, shape: Kernel, d: np.ndarray, value: np.ndarray) -> np.ndarray:
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
    # and no more than F changes between the texels
    peak, diagonal = _profile(lookup.kernel)[1], np.sqrt(2) * h
    before, after = (shape.footprint(np.clip(d + step, 0, None)) / peak for step in (-diagonal, diagonal))
    missed = np.minimum(missed, np.maximum(before - value, value - after))
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
# lattice kernels around the eye (measured in 60 000 places and directions: 4.8e-5, 8.3e-5, 8.7e-5), and of any kernel
HALF_LINE, AROUND, AROUND_ANY = 3.2e-5, {"crawfis-max": 6e-5, "gaussian": 1e-4, "b-spline": 1e-4}, 1.2e-4
# and its float32 coordinates and arithmetic, in ULPs; texels along each of its axes
HALF_LINE_DIGITS, HALF_LINE_SIZE = 16, 256
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
class ErrorBound:
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


def bound(splats: Splats, plan: Plan, pixels: np.ndarray) -> ErrorBound | None:
    """Error bound of a picture. pixels [H, W, 4]: as drawn; the errors of an X-ray are relative to the largest.

    None for streaks near the eye, on quads of rows 4 and 5 and of long voxels beyond z_k, which deviate from their
    model; for values classified
    after reconstruction; and for boxes, since a ray along a face may meet either of two.
    """
    if plan.program.appearance.steps > 0 or plan.program.boxes:
        return None
    if plan.exposure is None:
        splats = clip_behind_eye(splats, plan.resolved.camera)
    if not len(splats):
        lost = _resolve_error(plan, 0.0)
        return ErrorBound(0.0, 0.0, lost, lost)
    appearance, most = plan.program.appearance, max(splats.brightest, 1.0)
    if plan.exposure is None:
        placement, met = _placement_error(splats, plan.view, plan), ray_overlap(splats, plan.view)
    else:
        blurred = _streak_errors(splats, plan, plan.exposure)
        if blurred is None:
            return None
        placement, met = blurred
    brightest_pixel = _largest_pixel(splats, plan, met) * most
    # 8 bits clamp values over 1
    cut = plan.target == "rgba8" and brightest_pixel > 1.0
    opacity = _largest_alpha(plan, pixels, met) if appearance.hides else 1.0
    brightest = brightest_pixel if cut or not appearance.is_sum else float(pixels.max())
    scale = {"over": most * opacity, "sum": brightest, "max": brightest_pixel}[appearance.join]
    footprint = _footprint_error(splats, plan, placement, met, opacity if appearance.hides else brightest / most) * most
    footprint += _displacement_error(splats, plan, opacity) * most
    rounding, lost = _rounding_error(plan, scale, met.count), _resolve_error(plan, scale)
    hidden = (_hidden_light(plan, pixels, opacity) + LIGHT * (splats.skipped_interior > 0)) * most
    largest = _largest_difference(plan, pixels, brightest_pixel) + lost
    # errors of display values
    steep = STEEPEST if plan.resolved.display else 1.0
    return ErrorBound(steep * footprint, steep * hidden, brightest_pixel if cut else steep * (rounding + lost), largest)


def _largest_difference(plan: Plan, pixels: np.ndarray, right: float) -> float:
    """The largest difference of two pictures without negative values: the largest value of either. right: of one."""
    if plan.resolved.behind is None:
        return max(right, float(pixels.max())) + max(-float(pixels.min()), 0.0)
    # rounding up, or a form that overestimates a ray's length, makes pixels brighter than the true maximum
    longer = 1.0 if plan.program.appearance.hides else _longest(plan)
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
    # an approximate form may draw a footprint's middle where its rim is
    depth = met.light if plan.program.align == "exact" or not plan.view.perspective else met.depth
    largest = float(-np.expm1(-depth * _largest_integral(plan) * _longest(plan)))
    share, least = TARGET[plan.target]
    # roundings are relative to what is drawn
    lost = 2 * OVER * share * met.count
    if plan.resolved.background is not None or lost >= 0.5:
        return largest
    return min(largest, (float(pixels[..., 3].max()) + met.count * least) / (1 - lost))


def _rounding_error(plan: Plan, scale: float, count: float) -> float:
    """Error of `count` blends of numbers up to `scale`."""
    appearance, (share, least) = plan.program.appearance, TARGET[plan.target]
    once = max(_next_power_of_two(scale) * share, least)
    if appearance.join == "max":
        return once
    return once * count * (OVER if appearance.hides and plan.target == "rgba32f" else 1.0)


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
    if props.perspective and plan.program.align != "exact":
        return None
    steps = splats.grid.world_from_index / splats.grid.mean_spacing
    astray = 0.0 if exposure.flow is None else 2 * float(np.linalg.norm(exposure.drift(splats), axis=1).max())
    cameras = (exposure.first, exposure.middle, exposure.last)
    views = [
        GridView.of(splats.grid, camera.resized(plan.view.size), shape, props.antialias, plan.view.blur)
        for camera in cameras
    ]
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
    depth = min(splats.total_depth * longest, BETWEEN * max(overlap.depth for overlap in met))
    return placement, RayOverlap(count, depth, depth)


def _largest_pixel(splats: Splats, plan: Plan, met: RayOverlap) -> float:
    """An upper bound on the right pixel values, over a background on all, for colours up to 1."""
    if plan.program.appearance.join == "max":
        return min(_largest_opacity(splats) * (1 + ROUNDED), 1.0)
    depth = met.light * _largest_integral(plan) * (1 + ROUNDED)
    if not plan.program.appearance.hides:
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
    if plan.resolved.behind is not None:
        lost += ULP * _next_power_of_two(max(scale, 1.0))
    return lost


def _next_power_of_two(largest: float) -> float:
    """The next power of two: numbers below it have a rounding error of at most it times TARGET."""
    return float(2.0 ** np.ceil(np.log2(max(largest, 1e-30))))


def _footprint_error(splats: Splats, plan: Plan, placement: PlacementError, met: RayOverlap, largest: float) -> float:
    """Total error of all fragments of a ray, for colours up to 1. largest: opacity or sum of a pixel."""
    program, appearance, half_line = plan.program, plan.program.appearance, plan.program.seen.half_line
    # a highlight is a power of a cosine
    arithmetic = ARITHMETIC * 2.0**program.appearance.light.sharpness + GATHERED * (program.technique == "tiles")
    if appearance.join == "max":
        most = _largest_opacity(splats)
        missed = min(float(_deviation(plan.lookup, placement).max()) * most, _peak_error(splats, plan))
        return min(missed + (HALF_LINE * half_line + arithmetic) * most, 1.0)
    # an X-ray is a plain sum
    weight, deep = largest, met.depth
    if appearance.hides:
        mixed = 0.25 if largest > 0.5 or plan.resolved.background is not None else largest * (1 - largest)
        weight = min(mixed + largest / 4, largest)
    if program.motion != "off" and program.appearance.attenuation == "fill":
        weight, deep = DWELT[0], DWELT[1] * met.depth
    share = accumulated_error(plan.lookup, placement, weight, deep)
    if plan.exposure is None:
        share = min(share, _error_by_place(splats, plan, weight, deep))
    if half_line:
        # in optical depth, over kernels around the eye
        share += _half_line_error(splats, plan.view) * float(plan.kernel.footprint(np.zeros(())))
    return share + arithmetic * max(weight, largest)


def _half_line_error(splats: Splats, view: GridView) -> float:
    """Error of the optical depth, over F(0), of all kernels around the eye, or before its plane."""
    cells, longest = cells_of(splats), float(np.linalg.norm(view.eye_from_index, ord=2))
    error = HALF_LINE * splats.total_depth
    if cells.aligned:
        error = min(error, AROUND.get(view.kernel.name, AROUND_ANY) * cells.depth)
    if cells.groups is not None and len(cells.groups.place) <= FEW and view.perspective:
        away = np.linalg.norm(cells.groups.place - view.eye_index, axis=1) - cells.groups.radius
        near = away < view.kernel.radius * (1 + 4 * ULP)
        lost = np.interp(away[near].clip(0), *_half_line_profile(view.kernel.name))
        error = min(error, float(cells.groups.depth[near] @ lost) * longest)
    return error


@lru_cache(maxsize=4)
def _half_line_profile(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Distances [N] of a kernel's centre from the eye, and the largest errors of the half-line table there and beyond,
    over F(0) and the optical depth, for rays in all directions.
    """
    shape = kernel(name)
    table = half_line_table(shape, HALF_LINE_SIZE)
    away = shape.radius * np.linspace(1, 0, 97)[:, None] * (1 - 1e-9)
    angle = np.linspace(0.0, np.pi, 721)
    d, along = away * np.sin(angle), away * np.cos(angle)
    chord = half_chord(shape.radius, d)
    whole = 2 * shape.partial(d, chord)
    right = 0.5 + shape.partial(d, along) / whole
    place = [(d / shape.radius) ** 2 * (len(table) - 1), (along / chord + 1) / 2 * (len(table) - 1)]
    row, column = (np.clip(n.astype(int), 0, len(table) - 2) for n in place)
    down, across = place[0] - row, place[1] - column
    drawn = (1 - down) * ((1 - across) * table[row, column] + across * table[row, column + 1])
    drawn += down * ((1 - across) * table[row + 1, column] + across * table[row + 1, column + 1])
    lost = np.abs(drawn - right) * shape.footprint(d) / float(shape.footprint(np.zeros(())))
    return away[::-1, 0], np.maximum.accumulate(lost.max(axis=1))[::-1] + HALF_LINE_DIGITS * ULP


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
    corners, depths = view.box(splats), view.voxels(splats.corners_in_grid())[2]
    away = np.linalg.norm(corners, axis=0).max() if view.perspective else np.abs(corners).max()
    place, gain = _placement_errors(CentreRange(depths.min(), depths.max(), away, np.array(np.inf)), view, plan)
    return PlacementError(float(place), float(gain))


def _regions(groups: SplatGroups, view: GridView) -> CentreRange:
    """The region of each group."""
    voxel, spread = view.voxels(groups.place), groups.radius * np.linalg.norm(view.eye_from_index, ord=2)
    near, far = voxel[2] - spread, voxel[2] + spread
    away = np.linalg.norm(voxel, axis=0) if view.perspective else np.abs(voxel).max(axis=0)
    slope = (np.hypot(voxel[0], voxel[1]) + spread) / np.maximum(near, 1e-3)
    return CentreRange(near, far, away + spread, slope)


def _error_by_place(splats: Splats, plan: Plan, weight: float, depth: float) -> float:
    """`accumulated_error` with each group's own σ at one ρ; inf where `_placed_groups` knows none.

    ρ is the best if the ray that meets most met all groups in proportion.
    """
    groups = _placed_groups(splats, plan)
    if groups is None:
        return np.inf
    kinds, kind = _error_kinds(groups, plan)
    absolute = np.array([_remainders(plan.lookup, *numbers) for numbers in kinds])
    share = np.bincount(kind, groups.depth, len(absolute)) / float(groups.depth.sum(dtype=np.float64))
    peak = _profile(plan.lookup.kernel)[1]
    best = int(((weight * RELATIVE + depth * peak * (share @ absolute)) / (1 - RELATIVE) ** 2).argmin())
    weighted = replace(groups, depth=groups.depth * absolute[kind, best])
    met = overlap_by_places(weighted, plan.view, [(plan.kernel.radius, 1.0)])
    return float((weight * RELATIVE[best] + met.depth * peak) / (1 - RELATIVE[best]) ** 2)


def _peak_error(splats: Splats, plan: Plan) -> float:
    """The largest error of a splat's opacity; inf where `_placed_groups` knows none."""
    groups = _placed_groups(splats, plan)
    if groups is None:
        return np.inf
    kinds, kind = _error_kinds(groups, plan)
    missed = np.array([_deviation_at(plan.lookup, *numbers).max() for numbers in kinds])
    depth = np.minimum(groups.depth, splats.deepest) * splats.unit / splats.grid.mean_spacing
    return float((missed[kind] * -np.expm1(-depth)).max())


def _placed_groups(splats: Splats, plan: Plan) -> SplatGroups | None:
    """At most FEW groups of static splats in a perspective view, whose errors differ from place to place, else None."""
    groups = cells_of(splats).groups
    few = groups is not None and len(groups.place) <= FEW
    return groups if few and plan.exposure is None and plan.view.perspective else None


def _error_kinds(groups: SplatGroups, plan: Plan) -> tuple[np.ndarray, np.ndarray]:
    """Different errors (place, gain) [K, 2] of splats in groups, and which of them each group has [N]."""
    place, gain = _placement_errors(_regions(groups, plan.view), plan.view, plan)
    kinds, kind = np.unique(_quantize(np.stack([place, gain])), axis=1, return_inverse=True)
    return kinds.T, kind.ravel()


@lru_cache(maxsize=1024)
def _remainders(lookup: FootprintTable, place: float, gain: float) -> np.ndarray:
    """The σ of each of RELATIVE."""
    missed, value = _deviation_at(lookup, place, gain), _profile(lookup.kernel)[0]
    return np.asarray(np.maximum(missed - RELATIVE[:, None] * np.abs(value), 0.0).max(axis=1))


def _placement_errors(region: CentreRange, view: GridView, plan: Plan) -> tuple[np.ndarray, np.ndarray]:
    """The largest errors of a fragment's distance D, in voxels, and of its value, in each region."""
    radius, widths = view.kernel.radius, np.linalg.svd(view.eye_from_index, compute_uv=False)
    # float32: relative to the distance from the eye, larger for thin voxels
    place = ROUNDINGS * ULP * (region.away + radius)
    if plan.program.technique == "tiles":
        # centres are rounded as pixels, counted from the corner of a picture that may be far wider than its splats
        corner = _corner_slope(view)
        wider = region.far * (corner - 1) if view.perspective else corner - region.away
        place = place + ROUNDINGS * ULP * np.maximum(wider, 0.0)
    if not view.perspective:
        # a shift along the rays changes nothing
        return place / max(view.widths[1], view.filter_pitch if view.antialias else 0.0), np.zeros_like(place)
    gain = np.full_like(place, plan.resolved.unsure if view.antialias else 0.0)
    # a splat may be outside the picture by the footprint's half width
    near = np.maximum(region.near, 1e-3)
    slope = np.minimum(_corner_slope(view), region.slope + radius * widths[0] / near)
    # across the view, widened voxels' offsets shrink, and a shift in depth is one across by the ray's slope
    place = place * np.minimum(view.shrink(near)[0] * np.hypot(slope, 1.0), 1.0) / widths[-1]
    if view.antialias and (wide := region.far > view.widened_beyond[1]).any():
        moved, bent = _second_order(view, plan.program.seen.cubic, np.maximum(view.widened_beyond[1], near), slope)
        place, gain = place + np.where(wide, moved, 0.0), gain + np.where(wide, bent, 0.0)
    if plan.program.align != "exact":
        place = place + _form_error(view, plan, near, slope) / widths[-1]
    return np.minimum(place, radius), gain


def _second_order(view: GridView, cubic: bool, nearest: np.ndarray, slope: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shift, in voxels, and relative gain of widened splats from the depth `nearest` on, in mean spacings."""
    radius, widths = view.kernel.radius, np.linalg.svd(view.eye_from_index, compute_uv=False)
    half = 2 * radius * view.filter_pitch + radius * widths[0] / nearest
    slope = view.shrink(nearest)[0] * (slope + half)
    sine2 = slope**2 / (1 + slope**2)
    bent = radius**2 * (widths[0] / nearest) ** 2
    if cubic:
        rim, t = RIMMED if rim_step(view.kernel) > 1e-6 else 1.0, radius * view.filter_pitch
        return rim * radius * bent * (MOVED[0] + MOVED[1] * sine2), BENT * bent + SECANT * min(t**2, t**3)
    near = bent / radius**2 * widths[0] / widths[-1]
    moved = MOVED_LONG[0] + MOVED_LONG[1] * sine2 + MOVED_LONG[2] * sine2**2 + np.minimum(OMITTED[0] * near, OMITTED[1])
    return radius**3 * near * moved, BENT * bent


def _corner_slope(view: GridView) -> float:
    """The slope of a ray at the picture's corner."""
    return float(np.hypot(*view.edge))


def _form_error(view: GridView, plan: Plan, nearest: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Position error of Table 1's forms, which use one plane or direction for all rays, at a ray's slope."""
    radius = view.kernel.radius
    near = radius**2 / nearest
    if plan.program.align == "ray" and not view.antialias:
        return np.asarray(near)
    return np.asarray(radius * (np.hypot(slope, 1.0) - 1) + near)

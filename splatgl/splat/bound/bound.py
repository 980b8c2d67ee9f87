"""How far a picture may be from the float64 reference of the same splats: a bound for each picture.

The reference is row 1 of Table 1, whatever `align` says: a form's own error counts, as do tables and float32.

How errors add up is derived. A fragment's optical depth τF is off by δ ≤ ρ τF + σ τF(0). With c the light that it
gives and T the light that passes up to its end, ∂C/∂τF = T (c − what is seen behind it), so that

    Σ T σ τ F(0) ≤ σ S,    S the depth of all footprints that one ray meets, be it at the rim (ray_overlap.py);
    ρ Σ T τF |c − behind| ≤ ρ/2,

since with q for what is seen, c = q − dq/dτ in [0, 1], and no q makes ∫ e^(−τ) |dq/dτ| dτ more than a half. Where F is
small a relative error is large and an absolute one is not, so that (ρ, σ) is chosen for each picture
(footprint_error.py).
Two numbers are measured, with a margin: ROUNDINGS, and how much the second order beyond z_k is (BENT, MOVED).

A moving picture is bound to the float64 streaks of the same splats, not to what many moments show. A streak is the mean
of a footprint on its way, and so are its errors; besides, it is the difference of two areas.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from splatgl.splat.bound.footprint_error import ULP, PlacementError, largest, summed
from splatgl.splat.bound.ray_overlap import RayOverlap, cells_of, ray_overlap
from splatgl.splat.extraction.splats import Splats
from splatgl.splat.kernel.kernels import rim_step
from splatgl.splat.motion.motion import Exposure
from splatgl.splat.view.ahead import ahead
from splatgl.splat.view.view import View

if TYPE_CHECKING:
    from splatgl.splat.plan.plan import Plan

# by how many of a float32's last digits of its distance from the eye a voxel may be misplaced against a pixel's ray
ROUNDINGS = 0.5
# beyond z_k `exact` is right to second order: at depth z it gains or loses BENT/z² of itself, and is off by
# (MOVED₀ + MOVED₁ tan²θ)/z² voxels; up to 60° off the axis, and three times as much for the Gaussian, which has a rim
BENT, MOVED = 0.8, (0.3, 0.75)
RIMMED = 3.0
# what one rounding may lose of a number of 0.5 to 1, and of any number however small; drivers may cut 16 bits off
# instead of rounding them, and lay 8 bits over each other in 8 bits; 'over' in float32 rounds 1 − α, its product and
# the sum
TARGET = {"rgba32f": (ULP / 4, 0.0), "rgba16f": (2.0**-11, 2.0**-24), "rgba8": (1.5 / 255, 1.5 / 255)}
OVER = 3.0
# a kernel around the eye: its share of a chord, times F/F(0), comes from a table within the first; all the lattice's
# around it add up to the second
HALF_LINE, AROUND = 3.2e-5, 1.2e-4
# shading, colour and one_minus_exp in float32
ARITHMETIC = 8 * ULP
# tiles have colours of 21 bits, and a quicker one_minus_exp
GATHERED = 10 * ULP
# a streak has three places instead of one, and float32's areas over its length are off by so much of F(0); between the
# exposure's ends and middle a ray meets no more than so many times what it meets there
PLACES, AREAS, BETWEEN = 3.0, 5e-6, 1.5
# nearer to the eye's plane, in reaches of a kernel, streaks are drawn otherwise: motion.glsl's AHEAD, and some
AHEAD = 1.15
# the opacity of what moves changes by no more than this, relative to its two depths' relative changes and to absolute
# ones
DWELT = (1.7, 2.0)


@dataclass(frozen=True)
class Bound:
    """Parts of the bound, linear light; `total`: what a pixel may be off by, no more than `largest` can be.

    footprint: form, table and float32's places; hidden: closed pixels; rounding: of the target, blend after blend.
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
    """The bound of a picture; brightest: its largest component, which an X-ray's errors are in proportion to.

    None for streaks that are drawn otherwise than their model: near the eye, and of long voxels beyond z_k.
    """
    if plan.exposure is None:
        splats = ahead(splats, plan.resolved.camera)
    if not len(splats):
        lost = _resolved(plan, 1.0 if plan.resolved.background else 0.0)
        return Bound(0.0, 0.0, lost, lost)
    program, blend = plan.program, plan.program.look.blend
    most = max(splats.brightest, 1.0)
    if plan.exposure is None:
        placement, met = _placement(splats, plan.view, plan), ray_overlap(splats, plan.view)
    else:
        blurred = _blurred(splats, plan, plan.exposure)
        if blurred is None:
            return None
        placement, met = blurred
    whole = _largest(splats, plan, met, most)
    # 8 bits cut off what is over 1
    cut = plan.target == "rgba8" and (blend.unbounded or whole > 1.0)
    # and a form that is not the right one may not show at all what is bright
    other = plan.view.perspective and program.align != "exact"
    brightest = whole if cut or other else brightest
    footprint = _footprints(splats, plan, placement, met, brightest / most) * most
    # blends
    scale = {"over": most, "sum": brightest, "max": whole}[blend.join]
    share, least = TARGET[plan.target]
    rounding = max(_last_digit(scale) * share, least) * (1.0 if blend.join == "max" else met.count)
    if blend.ordered and plan.target == "rgba32f":
        rounding *= OVER
    lost = _resolved(plan, max(scale, 1.0 if plan.resolved.background else 0.0))
    # rounded up, or by a form that takes a ray for longer than it is, pixels are brighter than any can be
    longest = 2 * float(np.hypot(_edge(plan.view), 1.0)) if other and not blend.ordered else 1.0
    hidden = plan.hiding.cutoff * most
    return Bound(footprint, hidden, whole if cut else rounding + lost, whole * longest + least + lost)


def _blurred(splats: Splats, plan: Plan, exposure: Exposure) -> tuple[PlacementError, RayOverlap] | None:
    """The same for streaks."""
    shape, seen = plan.kernel, plan.program.seen
    steps = splats.grid.world_from_index / splats.grid.mean_spacing
    astray = 0.0 if exposure.flow is None else 2 * float(np.linalg.norm(exposure.drift(splats), axis=1).max())
    cameras = (exposure.first, exposure.middle, exposure.last)
    views = [View.of(splats.grid, each.resized(plan.view.size), shape, seen.antialias) for each in cameras]
    boxes = [view.box(splats) for view in views]
    longest = float(np.linalg.norm(steps, ord=2))
    nearest = min(float(box[2].min()) for box in boxes) - astray * longest
    if nearest <= AHEAD * shape.radius * longest or (seen.antialias and not seen.cubic):
        return None
    placements = [_placement(splats, view, plan) for view in views]
    placement = PlacementError(
        PLACES * max(each.place for each in placements),
        max(each.gain for each in placements),
        AREAS if plan.program.motion == "exact" else 0.0,
    )
    # a path's length, in voxels, and the stadium that it makes of a disc
    flat = [
        box[:2] / (box[2] if view.perspective else 1.0) / camera.extent
        for box, view, camera in zip(boxes, views, cameras, strict=True)
    ]
    deepest = max(float(box[2].max()) for box in boxes) if exposure.middle.perspective else 1.0
    path = float(np.linalg.norm(flat[2] - flat[0], axis=0).max()) * exposure.middle.extent * deepest
    area = BETWEEN * (1 + 2 * path / (np.pi * shape.radius))
    met = [ray_overlap(splats, view, astray) for view in views]
    count = min(float(len(splats)), area * max(each.count for each in met))
    return placement, RayOverlap(count, min(splats.total_depth * longest, BETWEEN * max(each.depth for each in met)))


def _largest(splats: Splats, plan: Plan, met: RayOverlap, most: float) -> float:
    """More than any pixel can be."""
    if plan.program.look.blend.ordered:
        return most
    if plan.program.look.blend.peak:
        return most * _opacity(splats)
    return most * met.depth * float(plan.kernel.footprint(np.zeros(())))


def _opacity(splats: Splats) -> float:
    """The largest of a splat, over the transfer function's reference length."""
    return float(-np.expm1(-splats.deepest * splats.unit / splats.grid.mean_spacing))


def _resolved(plan: Plan, scale: float) -> float:
    """What float32 loses where samples are averaged and lie over a background; nothing where they are pixels."""
    if plan.samples == 1 and plan.resolved.background is None:
        return 0.0
    return ULP * (plan.samples + 1) * _last_digit(scale)


def _last_digit(largest: float) -> float:
    """A power of two that is not less: numbers below it lose no more than it times TARGET."""
    return float(2.0 ** np.ceil(np.log2(max(largest, 1e-30))))


def _footprints(splats: Splats, plan: Plan, placement: PlacementError, met: RayOverlap, brightest: float) -> float:
    """What all fragments of a ray are off by together, for colours up to 1."""
    program, blend, half_line = plan.program, plan.program.look.blend, plan.program.seen.half_line
    arithmetic = ARITHMETIC + GATHERED * (program.technique == "tiles")
    if blend.peak:
        share = (largest(plan.lookup, placement) + HALF_LINE * half_line + arithmetic) * _opacity(splats)
        return min(share, 1.0)
    # an X-ray is the sum itself
    weight, deep = (0.5 if blend.ordered else brightest), met.depth
    if program.motion != "off" and program.look.attenuation == "fill":
        weight, deep = DWELT[0], DWELT[1] * met.depth
    share = summed(plan.lookup, placement, weight, deep)
    if half_line:
        share += _around(splats) * float(plan.kernel.footprint(np.zeros(())))
    return share + arithmetic * max(weight, 1.0)


def _around(splats: Splats) -> float:
    """What the half-line table makes kernels around the eye miss together, in optical depth."""
    cells = cells_of(splats)
    each = HALF_LINE * splats.total_depth
    return min(each, AROUND * cells.depth) if cells.aligned else each


def _placement(splats: Splats, view: View, plan: Plan) -> PlacementError:
    """How far a fragment's distance D may be off, in voxels, and its value."""
    radius, corners = view.kernel.radius, view.box(splats)
    widths = np.linalg.svd(view.eye_from_index, compute_uv=False)
    # float32: a share of the way from the eye, worse where voxels are thin
    far = float(np.linalg.norm(corners, axis=0).max()) if view.perspective else float(np.abs(corners).max())
    place, gain = ROUNDINGS * ULP * (far + radius) / widths[-1], 0.0
    if not view.perspective:
        return PlacementError(place)
    if view.antialias:
        nearest = max(view.widened_beyond[1], float(corners[2].min())) / widths[0]
        moved = MOVED[0] + MOVED[1] * _edge(view) ** 2
        place += (RIMMED if rim_step(view.kernel) > 1e-6 else 1.0) * moved / nearest**2 * widths[0] / widths[-1]
        gain = BENT / nearest**2 + plan.resolved.unsure
    if plan.program.align != "exact":
        place += _form(view, plan, float(corners[2].min())) / widths[-1]
    return PlacementError(min(place, radius), gain)


def _edge(view: View) -> float:
    """The slope of a ray at the picture's corner."""
    return float(np.hypot(*view.edge))


def _form(view: View, plan: Plan, nearest: float) -> float:
    """Table 1's forms, which take one plane or one direction for all: off by the slant at the picture's edge."""
    radius = view.kernel.radius
    near = radius**2 / max(nearest, 1e-3)
    if plan.program.align == "ray" and not view.antialias:
        return float(near)
    return float(radius * (np.hypot(_edge(view), 1.0) - 1) + near)

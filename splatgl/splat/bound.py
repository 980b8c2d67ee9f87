"""How far a picture may be from the float64 reference of the same splats: a bound for each picture.

How errors add up is derived; ROUNDINGS and SECOND_ORDER are measured, with a margin, over scenes and stress cases.

A fragment's optical depth τF is off by δ ≤ ρ τF + σ τF(0). With transmittance T before it,

    Σ T ρ τF e^(−τF) ≤ ρ Σ T (1 − e^(−τF)) ≤ ρ,    Σ T σ τ F(0) ≤ σ S,

S being the depth of all footprints that one ray touches, be it at the rim. Where F is small a relative error is
large and an absolute one is not, so that (ρ, σ) is chosen for each picture to make ρ + σS least. Errors of the
distance D count as |F(D ± δD) − F(D)|, errors of a table as what it misses.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from splatgl.splat.camera import Camera
from splatgl.splat.kernel import Kernel, kernel, radial_table
from splatgl.splat.rows import Splats

if TYPE_CHECKING:
    from splatgl.splat.plan import Plan

# a float32 rounds by half of this
ULP = 2.0**-23
# by how many of those of its distance from the eye a voxel may be misplaced against a pixel's ray
ROUNDINGS = 0.5
# beyond z_k `exact` is right to second order: off by about this over z_k² voxels
SECOND_ORDER = 0.25
# samples of the footprint, from the middle to the rim, dense there; absolute errors that are tried
SAMPLES = 400
ABSOLUTE = np.logspace(-12, 0, 73)
# the target's rounding of each blend, by how much at most
TARGET = {"rgba32f": ULP / 2, "rgba16f": 2.0**-11, "rgba8": 0.5 / 255}
# what filtering 8-bit texels in 8-bit arithmetic loses, beyond the texels' own rounding
EIGHT_BITS = 1.5 / 255
# a kernel around the eye: its chord's share comes from a table within this, and so many are there at once
HALF_LINE, AROUND = 5e-5, 25
# shading, colour and one_minus_exp in float32
ARITHMETIC = 8 * ULP


@dataclass(frozen=True)
class Bound:
    """Parts of the bound, linear light; `total` is what a pixel may be off by, no more than `largest` can be.

    footprint: form, table and float32's places; hidden: closed pixels; rounding: of the target, blend after blend.
    """

    footprint: float
    hidden: float
    rounding: float
    largest: float

    @property
    def total(self) -> float:
        return min(self.footprint + self.hidden + self.rounding, self.largest)

    def __str__(self) -> str:
        return (
            f"{self.total:.3g} (footprints {self.footprint:.3g}, hidden {self.hidden:.3g}, "
            f"rounding {self.rounding:.3g})"
        )


def bound(splats: Splats, camera: Camera, plan: Plan, brightest: float) -> Bound:
    """The bound of a picture; brightest: its largest component, which an X-ray's errors are in proportion to."""
    if not len(splats):
        return Bound(0.0, 0.0, 0.0, 0.0)
    program = plan.program
    most = max(splats.brightest, 1.0)
    depth = splats.deepest
    spacing = splats.grid.mean_spacing
    length = float(np.linalg.norm(np.ptp(splats.index_bounds, axis=0) @ splats.grid.world_from_index.T)) / spacing + 1
    # a ray touches the footprints within R of it; beyond z_k m² as many, of 1/m² the depth
    cover = np.pi * plan.kernel.radius**2 * length
    stretch = max(plan.farthest / plan.z_k, 1.0) if program.antialias and plan.z_k > 0 else 1.0
    count = min(len(splats), cover * stretch**2)
    # a long voxel counts for its length where a ray runs along it
    longest = float(np.linalg.norm(splats.grid.world_from_index, ord=2)) / spacing
    touched = min(splats.total_depth, cover * depth) * longest

    largest = most * (touched * _profile(plan.kernel.name)[1] if program.blend == "xray" else 1.0)
    # 8 bits cut off what is over 1
    cut = program.blend == "xray" and program.target == "rgba8"
    brightest = largest if cut else brightest

    # footprints
    misplaced = _misplaced(splats, camera, plan)
    if program.blend == "mip":
        share = float(_missed(plan.kernel.name, _table_key(plan), misplaced).max())
    else:
        weight = 1.0 if program.blend == "composite" else brightest
        share = _least(plan.kernel.name, _table_key(plan), misplaced, weight, touched)
    if program.half_line:
        share += HALF_LINE * AROUND * depth
    footprint = most * (share + ARITHMETIC)
    # blends
    scale = most if program.blend == "composite" else max(brightest, 1e-30)
    rounding = scale * TARGET[program.target] * (1.0 if program.blend == "mip" else count)
    return Bound(footprint, plan.passing * most, largest if cut else rounding, largest)


def _misplaced(splats: Splats, camera: Camera, plan: Plan) -> float:
    """How far a fragment's distance D may be off, in voxels."""
    spacing = splats.grid.mean_spacing
    radius = plan.kernel.radius
    corners = camera.eye_from_points(splats.corners) / spacing
    # float32: a share of the way from the eye, worse where voxels are thin
    thinnest = float(np.linalg.svd(splats.grid.world_from_index / spacing, compute_uv=False)[-1])
    far = float(np.linalg.norm(corners, axis=1).max()) if plan.program.perspective else float(np.abs(corners).max())
    error = ROUNDINGS * ULP * (far + radius) / thinnest
    if not plan.program.perspective:
        return error
    if plan.program.antialias:
        error += SECOND_ORDER / max(plan.z_k / spacing, 1e-3) ** 2
    if plan.program.align != "exact":
        error += _form(camera, plan, corners)
    return min(error, radius)


def _form(camera: Camera, plan: Plan, corners: np.ndarray) -> float:
    """Table 1's forms, which take one plane or one direction for all: off by the slant at the picture's edge."""
    radius, nearest = plan.kernel.radius, float(corners[:, 2].min())
    edge = camera.extent / 2 * np.hypot(camera.size[0] / camera.size[1], 1.0)
    near = radius**2 / max(nearest, 1e-3)
    if plan.program.align == "ray" and not plan.program.antialias:
        return float(near)
    return float(radius * (np.hypot(edge, 1.0) - 1) + near)


def _table_key(plan: Plan) -> tuple[str, int, int]:
    return plan.program.footprint, plan.table_size, plan.table_bits


def _least(name: str, table: tuple[str, int, int], misplaced: float, weight: float, touched: float) -> float:
    """min over σ of weight·ρ(σ) + touched·σ."""
    missed = _missed(name, table, misplaced)
    value, peak = _profile(name)
    over = np.maximum(missed[None, :] - ABSOLUTE[:, None], 0.0)
    relative = np.where(over > 0, over / np.maximum(value, 1e-30), 0.0).max(axis=1)
    return float((weight * relative + touched * peak * ABSOLUTE).min())


@lru_cache(maxsize=4)
def _profile(name: str) -> tuple[np.ndarray, float]:
    """F/F(0) at _distances, and F(0)."""
    shape = kernel(name)
    peak = float(shape.footprint(np.zeros(())))
    return np.asarray(shape.footprint(_distances(shape)) / peak), peak


def _distances(shape: Kernel) -> np.ndarray:
    return shape.radius * (1 - np.linspace(1, 0, SAMPLES) ** 3)


def _missed(name: str, table: tuple[str, int, int], misplaced: float) -> np.ndarray:
    """|drawn − right| / F(0) at _distances, for a distance that is off by `misplaced` at most."""
    # steps of a tenth in the logarithm, so that moving cameras find what is there
    step = float(10 ** (np.ceil(10 * np.log10(max(misplaced, 1e-12))) / 10))
    return _missed_at(name, table, step)


@lru_cache(maxsize=128)
def _missed_at(name: str, table: tuple[str, int, int], misplaced: float) -> np.ndarray:
    shape, d = kernel(name), _distances(kernel(name))
    value, peak = _profile(name)
    sides = [shape.footprint(np.clip(d + side * misplaced, 0, None)) / peak for side in (-1, 1)]
    moved = np.max([np.abs(side - value) for side in sides], axis=0)
    kind, size, bits = table
    if kind == "radial":
        missed = _radial_error(shape, size, d, value)
    else:
        # bilinear between texels h apart: h²/8 of the second derivatives
        h = 2 * shape.radius / size
        first = np.gradient(value, d)
        missed = h * h / 8 * (np.abs(np.gradient(first, d)) + np.abs(first) / np.maximum(d, h))
        # and what the texels themselves round to
        missed = missed + (EIGHT_BITS if bits == 8 else 2.0**-bits)
    return np.asarray(moved + missed + ULP * value)


def _radial_error(shape: Kernel, size: int, d: np.ndarray, value: np.ndarray) -> np.ndarray:
    table = radial_table(shape, size)[0]
    place = np.clip((d / shape.radius) ** 2 * (size - 1), 0, size - 1)
    texel = place.astype(int)
    return np.asarray(np.abs(table[texel, 0] + table[texel, 1] * (place - texel) - value))

"""Checks of the paper's claims, and of what this package adds to them.

The scene is the paper's (`figures.paper_setup`); a level is 1/255 of row 1's largest value for that voxel. Claims of
the paper name its section and figure; others say that they are not the paper's, and are not counted.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from textwrap import fill

import numpy as np
from paper.figures.footprint_errors import (
    ALL,
    DEPTHS,
    OFFSETS,
    SWITCH,
    VOXELS,
    Form,
    Space,
    Voxel,
    cumulative,
    plane_of,
    surfaces,
)
from paper.figures.paper_setup import PAPER, Setting, Stretched
from paper.tables import TEXT_WIDTH

from splatgl.splat.footprint import Splat, switch_depth
from splatgl.splat.kernels import Kernel, kernel

# tolerances in levels for z_s
TOLERANCES = (8.0, 4.0, 2.0, 1.0, 0.5)
# values that the paper reads off its figures
SHARE, BOX = 0.05, 0.02
# relative difference up to which z_s counts as equal to the paper's
NEARLY = 0.1
# minimum correlation of two surfaces that "behave as" each other
ALIKE = 0.98
# number of depths along the image edge in the search for a volume's worst voxel
EDGE_DEPTHS = 24


@dataclass(frozen=True)
class Claim:
    """A claim and its check. source: reference, such as "M98 §4.2"; numbers: results as text; holds: whether they
    support the claim. values: results in the order of `numbers`.
    """

    name: str
    text: str
    source: str
    numbers: str
    holds: bool
    values: tuple[float, ...]

    @property
    def of_the_paper(self) -> bool:
        """Whether the paper itself makes the claim."""
        return self.source.startswith("M98")


def near_axis() -> Claim:
    """Fig. 9, first voxel."""
    voxel = VOXELS[0]
    row5, row4 = _levels(voxel)
    spike = 255 * float(voxel.plane.spike(ALL["row4"])[0] / voxel.plane.top()[0])
    return Claim(
        "near the axis",
        "near the axis both kinds of quads err by less than 1 level",
        "M98 §4.2, Fig. 9",
        f"row 5 {row5:.4f}, row 4 {row4:.4f} levels at y = 16, two voxels behind the front; {spike:.4f} at the very "
        "rim of row 4, where the kernel is cut",
        max(row5, row4, spike) < 1,
        (row5, row4, spike),
    )


def close_to_z_k() -> Claim:
    """Fig. 9, second voxel, and a few voxels behind it."""
    levels = [_levels(Voxel(PAPER.edge, PAPER.z_k + behind)) for behind in (0, 5, 10)]
    pairs = "; ".join(f"{row5:.2f} and {row4:.3f}" for row5, row4 in levels)
    return Claim(
        "close to z_k",
        "close to z_k and far off the axis row 5 errs by more than 25 levels, row 4 by less than 2",
        "M98 §4.2, Fig. 9",
        f"{pairs} levels at z_k, z_k + 5 and z_k + 10, y = 256",
        min(row5 for row5, _ in levels) > 25 and max(row4 for _, row4 in levels) < 2,
        tuple(value for pair in levels for value in pair),
    )


def far_off() -> Claim:
    """Fig. 9, third voxel."""
    row5, row4 = _levels(VOXELS[2])
    return Claim(
        "at the back",
        "far behind z_k and off the axis both err by less than 8 levels",
        "M98 §4.2, Fig. 9",
        f"row 5 {row5:.3f}, row 4 {row4:.3f} levels at y = 256, z = {VOXELS[2].z:.3f}",
        max(row5, row4) < 8,
        (row5, row4),
    )


def in_between() -> Claim:
    """Row 4 along the volume's edge, between the second and the third voxel."""
    dz = np.arange(0.0, PAPER.back - PAPER.z_k, 3.0)
    levels = plane_of(dz, PAPER.edge).levels(ALL["row4"])
    fine = dz[levels.argmax()] + np.arange(-3.0, 3.5)
    levels = plane_of(fine, PAPER.edge).levels(ALL["row4"])
    top, where = float(levels.max()), float(fine[levels.argmax()])
    return Claim(
        "between",
        "nowhere behind z_k does row 4 err by more than the 8 levels of the last voxel",
        "inferred from M98 Fig. 9",
        f"row 4 peaks at {top:.2f} levels at z_k + {where:.0f}",
        top < 8,
        (top, where),
    )


def share_of_row5() -> Claim:
    """The two surfaces of Fig. 10 against each other, by three conventions."""
    grid = surfaces()
    row5, row4 = grid.errors["row5"], grid.errors["row4"]
    maxima = float(row4.max() / row5.max())
    ratio = (row4 / row5)[:, 1:][grid.dz >= 0]
    plane = plane_of(DEPTHS, OFFSETS)
    drawn, seen = (
        float(np.divide(*(voxels.error(ALL[row]).max() for row in ("row4", "row5"))))
        for voxels in (replace(plane, planar=False), replace(plane, y=np.minimum(plane.y, plane.z * PAPER.slope)))
    )
    return Claim(
        "row 4 within 5 %",
        "the error of row 4 stays below 5 % of that of row 5",
        "M98 §4.2, Fig. 10",
        f"{100 * maxima:.1f} % as a ratio of the largest errors, with the plane's weight 1/m and the volume's front "
        f"corner, which is outside the picture; {100 * drawn:.1f} % with the weight 1/m² of drawn splats, "
        f"{100 * seen:.1f} % within the picture; voxel by voxel behind z_k from {100 * ratio.min():.1f} to "
        f"{100 * ratio.max():.1f} %",
        max(maxima, drawn, seen) < SHARE,
        (maxima, drawn, seen, float(ratio.min()), float(ratio.max())),
    )


def switch_near() -> Claim:
    """Depth at which grid-aligned quads may be used, against the paper's number."""
    half = np.radians(30)
    depths = [switch_depth(PAPER.kernel, half, PAPER.n, PAPER.edge, tau) for tau in TOLERANCES]
    behind = tuple(float((depth - 1) * PAPER.z_k) for depth in depths)
    there = plane_of(SWITCH, PAPER.edge)
    extra = float((there.levels(ALL["row5"]) - there.levels(ALL["row4"]))[0])
    listed = ", ".join(f"{b:.0f}" for b in behind)
    return Claim(
        "z_s",
        "grid-aligned quads do from z_s ≈ z_k + 70 on",
        "M98 §4.2, Fig. 10c",
        f"at z_k + 70 they cost {extra:.1f} levels more at y = 256; for at most "
        f"{', '.join(f'{t:g}' for t in TOLERANCES)} levels z_s is z_k + {listed}",
        any(abs(b / SWITCH - 1) <= NEARLY for b in behind),
        (extra, *behind),
    )


def better_behind() -> Claim:
    """Rows 5 and 4 at the depths of Fig. 10 behind the paper's z_s, off the axis."""
    grid = surfaces()
    extra = (grid.errors["row5"] - grid.errors["row4"])[grid.dz >= SWITCH, 1:]
    better = int((extra < 0).sum())
    return Claim(
        "better behind z_s",
        "far behind z_k grid-aligned quads are slightly better than ray-perpendicular ones",
        "M98 §4.2, Fig. 10c",
        f"for {better} of {extra.size} voxels behind z_k + 70; elsewhere row 5 errs by up to {extra.max():.3f} more, "
        f"of {grid.errors['row5'].max():.3f}",
        better > 0,
        (float(better), float(extra.size), float(extra.max())),
    )


def box_for_trapezoid() -> Claim:
    """Row 2's shape against row 1's in a 256³ volume."""
    setting = Setting(256)
    voxel = Stretched(setting.kernel, 0.0, setting.back, setting.z_k)
    corner, rim = voxel.box_for_trapezoid()
    return Claim(
        "box for trapezoid",
        "a box in place of the trapezoid is never off by more than 0.02 volume units (256³)",
        "M98 §4.2",
        f"R²/z_k = {corner:.5f} at the corners, {rim:.5f} at the kernel's rim",
        corner <= BOX,
        (corner, rim),
    )


def ideal_and_practical() -> Claim:
    """Rows 3 and 4 over the voxels of Fig. 10."""
    grid = surfaces()
    apart = float((255 * np.abs(grid.errors["row3"] - grid.errors["row4"]) / grid.top).max())
    return Claim(
        "ideal and practical",
        "practical ray-perpendicular quads (row 4) are as good as ideal ones (row 3)",
        "M98 §4.2, Fig. 10",
        f"their largest errors differ by at most {apart:.4f} level",
        apart < 0.01,
        (apart,),
    )


def cumulative_error() -> Claim:
    """Sums of the error over a footprint against its maximum, over the voxels of Fig. 10."""
    grid, correlations, ratios = surfaces(), [], []
    for row in ("row5", "row4"):
        total, top = cumulative(row)[:, 1:].ravel(), grid.errors[row][:, 1:].ravel()
        correlations.append(float(np.corrcoef(total, top)[0, 1]))
        ratios += [float((total / top).min()), float((total / top).max())]
    return Claim(
        "cumulative error",
        "the error summed over a footprint behaves as its maximum does",
        "M98 §4.2, Fig. 10",
        f"correlation {correlations[0]:.3f} (row 5), {correlations[1]:.4f} (row 4); the sum is {ratios[0]:.2f} to "
        f"{ratios[1]:.2f} (row 5), {ratios[2]:.2f} to {ratios[3]:.2f} (row 4) times the maximum, in pixels",
        min(correlations) > ALIKE,
        (*correlations, *ratios),
    )


def xray_of(row: str) -> Claim:
    """A layer of a constant volume on rays 0°, 15° and 30° off the axis, before, at and beyond z_k."""
    shape = kernel("crawfis-max")
    sums = [
        layer_sums(ALL[row], shape, PAPER.z_k, depth * PAPER.z_k, angle)
        for depth in (0.8, 1.0, 1.5, 1.9)
        for angle in (0.0, 15.0, 30.0)
    ]
    short = max(float(1 - s.mean()) for s in sums)
    ripple = max(float(np.abs(s / s.mean() - 1).max()) for s in sums)
    kind = {"row4": "ray-perpendicular", "row5": "grid-aligned"}[row]
    return Claim(
        f"X-ray sums, {row}",
        f"X-ray sums of {kind} splats are accurate: a constant volume sums to its path length",
        "of X-ray splatting, not M98",
        f"short by at most {100 * short:.3f} % up to 30° off the axis; lattice ripple {100 * ripple:.2f} %",
        short < 0.01,
        (short, ripple),
    )


def whole_volume() -> Claim:
    """Worst voxels of the whole volume, including the image corners."""
    depth = np.append(np.linspace(PAPER.front, PAPER.back, EDGE_DEPTHS), PAPER.z_k)
    out = np.minimum(PAPER.edge, depth * PAPER.slope)
    visible = np.concatenate([np.stack([out, out, depth], axis=1), [(0.0, 0.0, PAPER.z_k)]])
    corner = Space(PAPER.kernel, PAPER.z_k, np.array([(PAPER.edge, PAPER.edge, PAPER.front)]))
    behind = Space(PAPER.kernel, PAPER.z_k, visible[visible[:, 2] >= PAPER.z_k])
    in_view = Space(PAPER.kernel, PAPER.z_k, visible)
    row5, row4 = (float(in_view.levels(ALL[row]).max()) for row in ("row5", "row4"))
    forms = {form: float(behind.levels(ALL[form]).max()) for form in ("a", "b1", "b", "bprime")}
    outside = float(corner.levels(ALL["row5"])[0])
    return Claim(
        "whole volume",
        "forms as cheap as rows 4 and 5 stay within half a level of row 1 all over a 512³ volume",
        "beyond M98",
        f"row 5 {outside:.1f} levels in the volume's front corner ({row5:.1f} within the picture), row 4 {row4:.1f}; "
        + ", ".join(f"{form.replace('prime', '′')} {value:.2g}" for form, value in forms.items()),
        max(forms.values()) < 0.5,
        (outside, row5, row4, *forms.values()),
    )


def _levels(voxel: Voxel) -> tuple[float, float]:
    return float(voxel.plane.levels(ALL["row5"])[0]), float(voxel.plane.levels(ALL["row4"])[0])


CLAIMS: tuple[Callable[[], Claim], ...] = (
    near_axis,
    close_to_z_k,
    far_off,
    share_of_row5,
    switch_near,
    better_behind,
    box_for_trapezoid,
    ideal_and_practical,
    cumulative_error,
    # not the paper's
    in_between,
    lambda: xray_of("row4"),
    lambda: xray_of("row5"),
    whole_volume,
)


@lru_cache(maxsize=1)
def claims() -> tuple[Claim, ...]:
    """Checks all claims; takes a few seconds."""
    return tuple(check() for check in CLAIMS)


def page(figure: int | None = None) -> str:
    """Claims as text for a terminal of 78 columns, the paper's first; figure: only claims about that figure."""
    chosen = [claim for claim in claims() if figure is None or f"Fig. {figure}" in claim.source]
    blocks = [_block(claim) for claim in chosen if claim.of_the_paper]
    held = sum(claim.holds for claim in chosen if claim.of_the_paper)
    scene = (
        f"{PAPER.n}³ voxels, {PAPER.n}² pixels, half-angle 30°, kernel exp(−2r²) cut at 2;\n"
        f"z_k = {PAPER.z_k:.3f}; a level is 1/255 of a splat's largest value"
    )
    count = f"{held} of the paper's {len(blocks)} claims hold"
    beside = [_block(claim) for claim in chosen if not claim.of_the_paper]
    return "\n\n".join([scene, *blocks, count, *(["Beside the paper's claims:", *beside] if beside else [])])


def _block(claim: Claim) -> str:
    verdict, margin = ("holds:        " if claim.holds else "DOES NOT HOLD:"), " " * 15
    head = fill(f"{claim.text} [{claim.source}]", TEXT_WIDTH, initial_indent=f"{verdict} ", subsequent_indent=margin)
    numbers = fill(f"found: {claim.numbers}", TEXT_WIDTH, initial_indent=margin, subsequent_indent=margin)
    return f"{head}\n{numbers}"


# positions of the ray within a voxel, along each axis
PHASES = 8
# summation distance from the ray, over m · radius · the slant
REACH = 1.1


def layer_sums(form: Form, kernel: Kernel, z_k: float, depth: float, angle: float) -> np.ndarray:
    """[PHASES²]: sums on rays at `angle` degrees through a layer of voxels at `depth`, of unit extinction, over the
    path length: 1 is right. Their spread is the kernel's ripple.
    """
    slope = np.tan(np.radians(angle))
    reach = REACH * kernel.radius * max(depth / z_k, 1.0) / np.cos(np.radians(angle)) + 1
    # voxels at every 1/PHASES: each phase's lattice is one of PHASES² subsets
    offsets = np.arange(-np.ceil(reach) * PHASES, np.ceil(reach) * PHASES) / PHASES
    x, y = np.meshgrid(offsets, slope * depth + offsets)
    voxel = np.stack([x, y, np.full_like(x, depth)], axis=-1)
    value = form(Splat(kernel, voxel, np.array([0.0, slope]), z_k))
    cells = len(offsets) // PHASES
    sums = value.reshape(cells, PHASES, cells, PHASES).sum(axis=(0, 2))
    return np.asarray(sums.ravel() * np.cos(np.radians(angle)))

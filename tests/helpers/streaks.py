"""Streaks in float64: splats that move during the exposure.

Compared with means of subframes, it measures the error of streaks: straight lines for curved paths, one width for a
changing depth, and optical depth that is blurred before it occludes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from paper.forms import energy_gain, paper_gain, stretched_footprint

from splatgl.data.image import Image
from splatgl.errors import expected
from splatgl.geometry.camera import Camera
from splatgl.geometry.view import GridView
from splatgl.planning.resolve import Resolved
from splatgl.reference.rays import FootprintRow, PixelBoxes, pixel_ends
from splatgl.reference.renderer import SplatScene, draw_bands
from splatgl.splat.footprint import GRAZING, SplatQuads, on_quads, run_lengths, table_quad
from splatgl.splat.kernels import tabulate
from splatgl.splat.line_integral import Integral, row1
from splatgl.splat.motion import Motion, Streaks, streaks
from splatgl.splat.motion_blur import MOTIONS, SHORT, BlurTable, blur_table, moving_depth
from splatgl.splat.settings import AVERAGED, Settings
from splatgl.splat.splats import Splats


@dataclass(frozen=True, eq=False)
class StreakRow(FootprintRow):
    """Row 1, or rows 4 and 5 on quads, for voxels [3, N] that move by step [2, N] across the view; motion: exact,
    energy or paper. alone [2, N]: optical depths, and `isolation`, where opacities are averaged; None: depths are.
    """

    step: np.ndarray
    motion: str
    alone: np.ndarray | None = None

    def on(self, splat: np.ndarray, ray: np.ndarray) -> Integral:
        """Integrals of splats [P] along rays [2, P]. value: the mean along the path; peak: the maximum."""
        voxel, step = self.voxel[:, splat], self.step[:, splat]
        quads = self.quads.take(splat) if self.quads else None
        integral = on_quads(self.view, quads, ray) if quads else row1(self.view, voxel, ray)
        integral.peak[:] = integral.value
        # a kernel around the eye has no image position to move from
        moving = np.flatnonzero(step.any(axis=0) & (voxel[2] > self.view.reach))
        if len(moving):
            some = ray[:, moving], step[:, moving]
            passed = (
                pass_quads(quads.take(moving), *some) if quads else pass_kernels(self.view, voxel[:, moving], *some)
            )
            integral.value[moving] = passed.streak_shape(self.view, self.motion)
            integral.peak[moving] = passed.most(self.view)
        if self.alone is None:
            return integral
        depth, isolated = self.alone[:, splat]
        value = moving_depth(depth * integral.value, depth * integral.peak, isolated)
        return Integral(value / np.where(depth > 0, depth, 1.0), integral.peak)


@dataclass(frozen=True, eq=False)
class Passing:
    """Closest passes of rays and moving kernels, in the kernel's units.

    along, across [P]: offset along and across the path; length [P]: of the path; gain [P]: integral over F.
    """

    along: np.ndarray
    across: np.ndarray
    length: np.ndarray
    gain: np.ndarray

    def streak_shape(self, view: GridView, motion: str) -> np.ndarray:
        """Values [P] of the streaks; motion: exact by the blur table, energy or paper by a scaled peak."""
        kernel = view.kernel
        if motion == "exact":
            table = blur_table(kernel.name, dtype="<f8")
            peak = kernel.footprint(np.zeros(()))
            return np.asarray(self.gain * peak * blur(table, self.along, self.across, self.length))
        weaken = energy_gain if motion == "energy" else paper_gain
        return np.asarray(weaken(kernel, self.length) * self.most(view))

    def most(self, view: GridView) -> np.ndarray:
        """The maximum along the path, at the closest point."""
        return np.asarray(self.gain * stretched_footprint(view.kernel, self.along, self.across, self.length))


class Inner(NamedTuple):
    """Maps offsets across the view to the kernel's axes: axes [3, 2, N]; shrink: see GridView.shrink."""

    axes: np.ndarray
    shrink: np.ndarray


def inner_of(view: GridView, z: np.ndarray) -> Inner:
    """The map of voxels at depth z [N], antialiasing included."""
    shrink = view.shrink(z)
    scaled = view.index_from_eye[:, :2] @ view.axes
    return Inner(np.einsum("ij,jn,kj->ikn", scaled, shrink, view.axes), shrink)


def pass_kernels(view: GridView, voxel: np.ndarray, ray: np.ndarray, step: np.ndarray) -> Passing:
    """Passes of rays [2, N] by voxels [3, N] that move by step [2, N].

    Beyond z_k in perspective space, where the ray has the voxel's slope; first-order term of the trapezoid.
    """
    z = voxel[2]
    inner = inner_of(view, z)
    if view.perspective:
        slope = np.where(view.is_widened(z), voxel[:2] / z, ray)
        offset, seconds, depth = ray * z - voxel[:2], np.sqrt(1 + (ray * ray).sum(axis=0)), z
    else:
        slope = np.zeros_like(step)
        offset, seconds, depth = ray - voxel[:2], np.ones_like(z), np.full_like(z, np.inf)

    # offset, slope and step in the kernel's axes, scaled down where antialiasing widens
    o, line, move = (inner.axes[:, 0] * vector[0] + inner.axes[:, 1] * vector[1] for vector in (offset, slope, step))
    ahead = view.index_from_eye[:, 2:]
    line = line + ahead
    square = (line * line).sum(axis=0)
    t = -(o * line).sum(axis=0) / square
    across_line = move - (move * line).sum(axis=0) / square * line
    length = np.sqrt((across_line * across_line).sum(axis=0))
    heading = across_line / np.where(length > 0, length, 1.0)
    gain = seconds * inner.shrink[0] * inner.shrink[1] / np.sqrt(square)

    # the point on the path nearest to the ray, and the offset from there to the ray
    r = o + t * line
    passed = np.clip((r * heading).sum(axis=0), -length / 2, length / 2)
    r = r - passed * heading
    t = t + passed / np.where(length > 0, length, 1.0) * (move * line).sum(axis=0) / square

    # the ray bends in a widened kernel: the trapezoid's term shifts it and changes its length
    bends = np.where(inner.shrink.min(axis=0) < 1, 1 / depth, 0.0)
    toward, deep = (r * ahead).sum(axis=0), (line * ahead).sum(axis=0)
    distance2 = (r * r).sum(axis=0)
    moved = np.maximum(distance2 + 2 * bends * t * t * toward, 0.0)
    r = r * np.sqrt(moved / np.where(distance2 > 0, distance2, 1.0))
    gain = gain * (1 - bends * (2 * t * deep + toward) / square)

    further = (r * heading).sum(axis=0)
    across = np.sqrt(np.maximum((r * r).sum(axis=0) - further * further, 0.0))
    return Passing(passed + further, across, length, gain)


def aligned_quads(view: GridView, voxel: np.ndarray, align: str, z_s: float) -> SplatQuads:
    """Quads of voxels [3, N]: row 4's nearer than z_s, in mean spacings, for align hybrid, or all; else row 5's."""
    near = voxel[2] < {"ray": np.inf, "grid": -np.inf}.get(align, z_s)
    turned, flat = (vars(table_quad(view, voxel, plane)) for plane in ("ray", "grid"))
    return SplatQuads(*(np.where(near, turned[name], flat[name]) for name in turned))


def pass_quads(quads: SplatQuads, ray: np.ndarray, step: np.ndarray) -> Passing:
    """Passes of rays [2, N] by footprints on quads, which are cut in half along step [2, N] as seen on their planes.

    Rays that meet a plane behind the eye are infinitely far.
    """
    line = np.stack([*ray, np.ones(ray.shape[1])])
    facing = (quads.normal * line).sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = (quads.normal * quads.voxel).sum(axis=0) / facing
    hit = (facing != 0) & (depth > 0)
    offset = np.where(hit, depth, 1.0) * line - quads.voxel
    at = np.einsum("ain,in->an", np.stack([quads.axis_1, quads.axis_2]), offset) / quads.size
    passed = passing_on_quad(at, step_on(quads, step))
    return replace(passed, across=np.where(hit, passed.across, np.inf), gain=quads.gain)


def step_on(quads: SplatQuads, step: np.ndarray) -> np.ndarray:
    """[2, N]: steps [2, N] across the view on the planes of quads, in voxels."""
    axes = np.stack([quads.axis_1, quads.axis_2])
    return np.asarray(np.einsum("ain,in->an", axes[:, :2], step) / quads.size)


def passing_on_quad(at: np.ndarray, step: np.ndarray) -> Passing:
    """Passes of points [2, N] by footprints that move by step [2, N], both on the quad's plane, in voxels."""
    length = np.hypot(*step)
    heading = step / np.where(length > 0, length, 1.0)
    across = np.abs(heading[0] * at[1] - heading[1] * at[0])
    return Passing((heading * at).sum(axis=0), across, length, np.ones_like(length))


def render(
    splats: Splats, camera: Camera, settings: Settings, motion: Motion, shutter: float = 180.0, shape: str = "exact"
) -> Image:
    """Image of moving splats, float64 [H, W, 4], linear premultiplied; shape: exact, energy or paper.

    Blur attenuates opacity or optical depth, as antialiasing does. Raises InputError for another shape, and for maximum
    blending and supersampling, which are not supported.
    """
    if shape not in MOTIONS:
        raise expected("shape", " or ".join(MOTIONS), repr(shape))
    if settings.antialias in AVERAGED or settings.join == "max":
        raise expected("settings", "antialias paper or off, blend composite or xray", "others")
    paths = streaks(splats, camera, motion, shutter)
    resolved = Resolved.of(splats, paths.camera, settings, moving=True)
    view, attenuation = replace(resolved.view, kernel=tabulate(resolved.kernel.name)), resolved.appearance.attenuation
    quads, boxes = None, _boxes(view, paths)
    if view.perspective and settings.align not in ("auto", "exact"):
        quads = aligned_quads(view, paths.middle, settings.align, (settings.z_s or 0.0) / splats.grid.mean_spacing)
        zero, (width, height) = np.zeros(len(splats), dtype=np.int64), paths.camera.size
        boxes = PixelBoxes(zero, zero + width, zero, zero + height)
    row = StreakRow(view, "row1", paths.middle, quads, paths.step, shape)
    scene = SplatScene.of(splats, resolved, row, boxes)
    if attenuation != "optical-depth":
        slope = paths.middle[:2] / paths.middle[2]
        lengths = pass_quads(quads, slope, paths.step).length if quads else length_of(view, paths)
        if attenuation == "fill":
            through = run_length_along(view.index_from_eye[:, :2] @ paths.step, splats.runs)
            scene = replace(scene, row=replace(row, alone=np.stack([scene.depth, isolation(lengths, through)])))
        else:
            scene = replace(scene, coverage=scene.coverage * energy_gain(view.kernel, lengths))
    info = {"scene": splats.name, "blend": settings.blend, "motion": shape, "shutter": shutter}
    return Image(draw_bands(scene, resolved), {**info, "renderer": "float64 streaks"})


def length_of(view: GridView, paths: Streaks) -> np.ndarray:
    """[N]: path lengths in units of the possibly widened kernels."""
    center = paths.middle[:2]
    if view.perspective:
        center = center / np.where(np.abs(paths.middle[2]) > view.reach, paths.middle[2], view.reach)
    return pass_kernels(view, paths.middle, center, paths.step).length


def _boxes(view: GridView, paths: Streaks) -> PixelBoxes:
    """Pixels that a streak can reach: the box of both ends; the whole image if one end is not visible."""
    width, height = paths.camera.size
    ends = []
    for side in (-0.5, 0.5):
        voxel = paths.middle.copy()
        voxel[:2] += side * paths.step
        ends.append(pixel_ends(view, "row1", voxel, paths.camera))
    unseen = [right < left for left, right, _, _ in ends]
    some, all_ = unseen[0] | unseen[1], (unseen[0] & unseen[1]) | (paths.middle[2] < 0) & unseen[0]
    left, top = (np.where(some, 0, np.minimum(ends[0][n], ends[1][n])) for n in (0, 2))
    right, bottom = (np.where(some, full, np.maximum(ends[0][n], ends[1][n])) for n, full in ((1, width), (3, height)))
    return PixelBoxes(left, np.where(all_ | (right <= left) | (bottom <= top), left, right), top, bottom)


def blur(table: BlurTable, u: np.ndarray, v: np.ndarray, length: np.ndarray) -> np.ndarray:
    """B(u, v, l)/F(0), arrays that broadcast."""
    real = table.texels.dtype.type
    u, v, length = np.broadcast_arrays(*(np.asarray(x, dtype=real) for x in (u, v, length)))
    q = v * v
    chord = np.sqrt(np.maximum(real(table.kernel.radius**2) - q, real(1e-12)))
    area, row, part = line(table, q)
    moves = length > SHORT
    safe = np.where(moves, length, real(1))
    ends = [share(table, (u + side * safe / 2) / chord, row, part) for side in (real(1), real(-1))]
    long = area * (ends[0] - ends[1]) / safe
    return np.where(moves, np.where(q < table.kernel.radius**2, long, 0), simpson(table, u, v, length))


def line(table: BlurTable, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The line's area over F(0), the row before it and the fraction of the step to the next."""
    last = len(table.texels) - 1
    place = np.clip(q * table.texels.dtype.type(last / table.kernel.radius**2), 0, last)
    row = np.minimum(place.astype(np.intp), last - 1)
    part = place - row.astype(table.texels.dtype)
    return hermite(table.texels[row, -1], table.texels[row + 1, -1], part), row, part


def share(table: BlurTable, t: np.ndarray, row: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Share of the line from its middle to t half chords, odd in t, ±½ at most."""
    last = table.texels.shape[1] - 2
    place = np.minimum(np.abs(t), 1) * table.texels.dtype.type(last)
    column = np.minimum(place.astype(np.intp), last - 1)
    along = place - column.astype(table.texels.dtype)
    here, right = (hermite(table.texels[r, column], table.texels[r, column + 1], along) for r in (row, row + 1))
    return np.copysign(here + (right - here) * part, t)


def simpson(table: BlurTable, u: np.ndarray, v: np.ndarray, length: np.ndarray) -> np.ndarray:
    """F + (F₊ − 2F + F₋)/6: bit-identical to F for a path of length 0."""
    peak = float(table.kernel.footprint(np.zeros(())))
    first, middle, last = (
        (table.kernel.footprint(np.hypot(u + side * length / 2, v)) / peak).astype(table.texels.dtype)
        for side in (-1, 0, 1)
    )
    return np.asarray(middle + (first - 2 * middle + last) / 6)


def hermite(first: np.ndarray, last: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Cubic Hermite interpolation of two values [..., 0] with slopes [..., 1] per step, at `part` of the step."""
    rise = last[..., 0] - first[..., 0]
    bend = 3 * rise - 2 * first[..., 1] - last[..., 1]
    twist = first[..., 1] + last[..., 1] - 2 * rise
    return np.asarray(first[..., 0] + part * (first[..., 1] + part * (bend + part * twist)))


def isolation(length: np.ndarray, through: np.ndarray) -> np.ndarray:
    """The exponent e [N]: 1 for a lone splat, 0 for one with neighbours along its path.

    length: of the path, in units of the footprint; through: of the run of matter along it, in voxels.
    """
    follows = np.maximum(through - 1, 0.0) / (length + 1)
    return np.asarray(1 / (1 + follows * follows))


def run_length_along(direction: np.ndarray, runs: np.ndarray) -> np.ndarray:
    """Run length [N] of occupied voxels along directions [3, N] in index axes, of any length, in voxels."""
    along = np.abs(direction) / np.maximum(np.sqrt((direction * direction).sum(axis=0)), 1e-300)
    return np.asarray((run_lengths(runs) / np.maximum(along, GRAZING)).min(axis=0))

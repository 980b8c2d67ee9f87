"""Stress cases of cameras: positions of the eye, and lenses."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from paper.forms import half_line

from splatgl.geometry.camera import Camera
from splatgl.splat.footprint import NEAR
from splatgl.splat.kernels import Gaussian, kernel
from tests.stress.case import (
    SHAPE_BOUND,
    UP,
    Bench,
    Check,
    Group,
    ahead,
    alpha,
    block,
    check,
    check_rows,
    distance_of,
    dots,
    lattice,
    middle,
    parallel,
    random_splats,
    rays_of,
)

EYE = Group()
# depth of a kernel exp(−2r²) cut at 2, and its integral from the eye along a ray through its centre; the last two
# are partly and entirely behind. Closed form: √(π/8) [erf(√2·2) + erf(√2·z)]
BEHIND = ((0.0, 0.626617374643), (0.5, 1.054429570589), (1.0, 1.224761381304), (-0.5, 0.198805178697), (-3.0, 0.0))
# the half-line table is bilinear, 256²
HALF_LINE_BOUND = 5e-5


@EYE.case(
    "eye-in-kernel",
    "a voxel at, around or behind the eye: tan δ has a pole, and ghosts come from behind",
    "one Gaussian splat at depth 0, 0.5, 1, −0.5 and −3 voxels, X-ray",
    "closed form: half a line through the kernel",
)
def _in_kernel(bench: Bench) -> list[Check]:
    camera = ahead(fov=80.0)
    volume = 1 / Gaussian().scale
    on_axis, rays = [], []
    for z, right in BEHIND:
        images = bench.both(dots([(0.0, 0.0, z)]), camera, blend="xray", kernel="gaussian")
        drawn, paper = (alpha(pixels) * volume for pixels in images)
        on_axis.append((middle(drawn), right, middle(paper)))
        direction = rays_of(camera)
        voxel = np.broadcast_to([0.0, 0.0, z], direction.shape)
        rays.append((drawn, half_line(kernel("gaussian"), voxel, direction) * volume, paper))
    bound = HALF_LINE_BOUND * volume
    return [check_rows("along the axis", on_axis, bound), check_rows("every ray", rays, bound)]


@EYE.case(
    "eye-places",
    "the eye on a voxel, between voxels, at the volume's corner, on its face, in a kernel, at the near plane",
    "20×18×16 random voxels, all nearer than z_k, 48×48 pixels, 70°",
    "float64 reference",
)
def _places(bench: Bench) -> Iterator[Check]:
    splats = random_splats((20, 18, 16))
    eyes = {
        "on a voxel": ((10.0, 9.0, 8.0), (1.0, 0.2, 0.1)),
        "between voxels": ((10.5, 8.5, 8.5), (0.3, 1.0, -0.2)),
        "at the corner": ((-0.5, -0.5, -0.5), (1.0, 1.0, 1.0)),
        "on a face": ((10.0, 9.0, -0.5), (0.0, 0.1, 1.0)),
        "inside a kernel": ((10.3, 9.2, 7.6), (-1.0, 0.5, 0.4)),
        "astride near plane": ((10.2, 8.7, 8.0 - NEAR), (0.0, 0.0, 1.0)),
        "on the near plane": ((10.0, 9.0, 8.0 + NEAR), (0.0, 0.0, -1.0)),
    }
    for name, (eye, view) in eyes.items():
        up = (0.0, 0.0, 1.0) if abs(view[2]) < 1 else (0.0, 1.0, 0.0)
        camera = Camera.look_at(eye, np.add(eye, view), up, 70.0, (48, 48))
        yield bench.check_reference(name, splats, camera)


@EYE.case(
    "axis-views",
    "the camera along ±x, ±y, ±z with the eye exactly on faces between cells",
    "nine opaque layers, each of its own colour, across the axis; only the nearest is visible",
    "the nearest layer's colour",
)
def _axes(bench: Bench) -> Iterator[Check]:
    count = 9
    for perspective in (True, False):
        rows = []
        for axis in range(3):
            # a cube of 9³ voxels with nearly opaque layers across the axis
            colors = np.random.default_rng(axis).uniform(0.1, 1.0, (count, 3))
            grid = lattice(*[np.arange(count)] * 3)
            splats = dots(grid, 40.0, colors[grid[:, axis]])
            for side in (-1.0, 1.0):
                images = bench.both(splats, _along(axis, side, perspective))
                drawn, paper = (middle(pixels)[:3] for pixels in images)
                rows.append((drawn, colors[0] if side > 0 else colors[-1], paper))
        yield check_rows("perspective" if perspective else "orthographic", rows, 1e-6)


def _along(axis: int, side: float, perspective: bool) -> Camera:
    """A view along ±axis from 12 voxels before the cube's middle, on a face between cells along both other axes."""
    target = np.full(3, 3.5)
    eye, up = target - 12.0 * np.eye(3)[axis] * side, np.eye(3)[(axis + 1) % 3]
    if perspective:
        return Camera.look_at(eye, target, up, 20.0, (9, 9))
    return Camera.orthographic(eye, target, up, 3.0, (9, 9))


@EYE.case(
    "eye-on-faces",
    "the eye inside of the volume, on the corner of eight cells, looking along each axis",
    "12³ voxels of opacity 0.2",
    "float64 reference",
)
def _on_faces(bench: Bench) -> list[Check]:
    splats, eye = block((12, 12, 12), 0.2), np.full(3, 5.5)
    rows = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            camera = Camera.look_at(eye, eye + side * np.eye(3)[axis], np.eye(3)[(axis + 1) % 3], 60.0, (16, 16))
            drawn, paper = bench.both(splats, camera)
            rows.append((drawn, bench.truth(splats, camera), paper))
    return [check_rows("six axes", rows, 1e-4)]


LENSES = Group()
# exact splats are accurate to second order in 1/z_k; if z_k is less than a voxel that does not apply, and the
# bound is 5 levels of 255
NO_Z_K_BOUND = 5 / 255
# X-ray sums of a lattice of exp(−2r²) stretched by m in a parallel view: (m, ripple in closed form)
LATTICES = ((1.5, 1.6e-4), (16.0, 2.6e-6), (64.0, 2.6e-6))


# 7 voxels wide at 2e5 voxels, where float32 has steps of 1/64 voxel
@LENSES.case(
    "half-angle-0.001",
    "a half-angle of 0.001°, the volume 2e5 voxels away",
    "9³ random voxels, seen along an axis and obliquely, 33×33 pixels",
    "float64 reference",
)
def _narrow(bench: Bench) -> Iterator[Check]:
    splats, target = random_splats((9, 9, 9)), np.full(3, 4.0)
    for name, view in (("along z", (0.0, 0.0, 1.0)), ("oblique", (0.48, 0.6, 0.64))):
        camera = Camera.look_at(target - 2e5 * np.array(view), target, UP, 0.002, (33, 33))
        yield bench.check_reference(f"9³ voxels {name}", splats, camera)


@LENSES.case(
    "far-voxel",
    "a ray that passes a voxel 1e6 voxels away: |v|² − (v·d̂)² is rounded away",
    "one splat, rays up to 1.5 voxels off; the paper's column: that formula in float32",
    "closed form: F(d)",
)
def _far_voxel(bench: Bench) -> list[Check]:
    shape, rows = kernel("crawfis-max"), []
    for depth in (1e2, 1e4, 1e6):
        # 3 voxels wide, so that the outermost rays pass 1.45 voxels from the voxel
        camera = ahead(fov=float(np.degrees(2 * np.arctan(1.5 / depth))), size=(31, 31))
        drawn = alpha(bench.draw(dots([(0.0, 0.0, depth)]), camera, blend="xray", antialias="off"))
        far = distance_of(camera)
        # d = |v × d̂| = z sin of the ray's angle
        right = shape.footprint(depth * far / np.sqrt(1 + far * far))
        v2, z, one = np.float32(depth * depth), np.float32(depth), np.float32(1)
        along = z / np.sqrt(one + np.float32(1) * far.astype(np.float32) ** 2)
        formula = shape.footprint(np.sqrt(np.maximum(v2 - along * along, np.float32(0)).astype(np.float64)))
        rows.append((drawn, right, formula))
    return [check_rows("at 1e2, 1e4, 1e6", rows, SHAPE_BOUND)]


@LENSES.case(
    "half-angle-85",
    "a half-angle of 85°, from before and from inside",
    "8³ random voxels, 120×240 pixels, z_k = 10.5 voxels",
    "float64 reference",
)
def _wide_85(bench: Bench) -> Iterator[Check]:
    splats = random_splats((8, 8, 8))
    for name, eye in (("from before", (3.5, 3.5, -3.0)), ("from inside", (3.6, 3.3, 3.2))):
        camera = Camera.look_at(eye, np.add(eye, (0.1, 0.05, 1.0)), UP, 170.0, (120, 240))
        yield bench.check_reference(name, splats, camera)


# 512 pixels high: z_k = 0.4468 voxels; a kernel that reaches the eye plane is left unchanged
@LENSES.case(
    "half-angle-89.9",
    "a half-angle of 89.9°: z_k = 0.45 voxels is less than the kernel's radius",
    "four splats round the eye, X-ray; 6³ random voxels; 65×512 pixels",
    "closed form: half a line through the kernel; float64 reference",
)
def _wide_89(bench: Bench) -> Iterator[Check]:
    camera = ahead(fov=179.8, size=(65, 512))
    rays, rows = rays_of(camera), []
    for voxel in ((0.0, 0.0, 0.2), (0.3, -0.4, 1.0), (0.0, 1.2, -0.3), (0.0, 0.0, 1.55)):
        drawn, paper = map(alpha, bench.both(dots([voxel]), camera, blend="xray"))
        rows.append((drawn, half_line(kernel("crawfis-max"), np.broadcast_to(voxel, rays.shape), rays), paper))
    yield check_rows("kernels round the eye", rows, HALF_LINE_BOUND)
    splats = random_splats((6, 6, 6))
    for name, eye in (("from before", (2.5, 2.5, -4.0)), ("from inside", (2.6, 2.3, 2.2))):
        view = Camera.look_at(eye, np.add(eye, (0.0, 0.0, 1.0)), UP, 179.8, (65, 512))
        yield bench.check_reference(f"6³ voxels {name}", splats, view, NO_Z_K_BOUND)


@LENSES.case(
    "parallel-zoom",
    "parallel rays with 0.01 and 1000 voxels a pixel",
    "one splat 311 pixels wide; 301² voxels in a pixel, X-ray",
    "closed form: F(d); Σ F(d/m)/m²",
)
def _parallel_zoom(bench: Bench) -> list[Check]:
    shape = kernel("crawfis-max")
    # 0.01 voxels a pixel: a splat of 311 pixels
    camera = parallel(0.01, (353, 353))
    right = shape.footprint(distance_of(camera))
    drawn, paper = map(alpha, bench.both(dots([(0.0, 0.0, 0.0)]), camera, blend="xray"))
    checks = [check("0.01 voxels a pixel", drawn, right, SHAPE_BOUND, paper)]
    # 1000: 300² voxels in one pixel, each Σ F(D/m)/m²
    view = parallel(1000.0, (3, 3), (150.0, 150.0))
    drawn, paper = map(alpha, bench.both(block((301, 301, 1), 0.5), view, blend="xray"))
    x, y = np.meshgrid(np.arange(301) - 150.0, np.arange(301) - 150.0)
    centres = np.arange(3) - 1.0
    exact = [
        [-np.log1p(-0.5) * shape.footprint(np.hypot(x / 1e3 - i, y / 1e3 - j)).sum() / 1e6 for i in centres]
        for j in centres
    ]
    return [*checks, check("1000 voxels a pixel", drawn, exact, SHAPE_BOUND * np.max(exact), paper)]


@LENSES.case(
    "lattice-sums",
    "a sheet in parallel rays, pixels wider than voxels",
    "kernel exp(−2r²), X-ray, m = 1.5, 16 and 64",
    "the sheet's optical depth within the lattice's ripple, 1.6e−4 and 2.6e−6, and the table's 2e−5",
)
def _lattice_sums(bench: Bench) -> Iterator[Check]:
    for m, ripple in LATTICES:
        half = int(np.ceil(2 * m)) + int(2 * m) + 2
        splats = block((2 * half + 1, 2 * half + 1, 1), 0.5)
        camera = parallel(m, (3, 3), (half + 0.31, half + 0.17))
        images = bench.both(splats, camera, blend="xray", kernel="gaussian")
        drawn, paper = (alpha(pixels) / np.log(2) for pixels in images)
        # an orthographic view uses the same radial table
        yield check(f"m = {m:g}", drawn, 1.0, ripple + SHAPE_BOUND, paper)

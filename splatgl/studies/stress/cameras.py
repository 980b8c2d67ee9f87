"""Stress cases of cameras: positions of the eye, and lenses."""

from __future__ import annotations

import numpy as np

from splatgl.data.volume import Volume
from splatgl.splat.camera import Camera
from splatgl.splat.footprint import NEAR, half_line
from splatgl.splat.kernels import Gaussian, kernel
from splatgl.splat.splats import Splats
from splatgl.studies.stress.case import (
    UP,
    Bench,
    Case,
    Check,
    ahead,
    alpha,
    block,
    check,
    dots,
    middle,
    noise,
    parallel,
    transfer,
    voxels,
)

# depth of a kernel exp(−2r²) cut at 2, and its integral from the eye along a ray through its centre; the last two
# are partly and entirely behind. Closed form: √(π/8) [erf(√2·2) + erf(√2·z)]
BEHIND = ((0.0, 0.626617374643), (0.5, 1.054429570589), (1.0, 1.224761381304), (-0.5, 0.198805178697), (-3.0, 0.0))
# the half-line table is bilinear, 256²
HALF_LINE_BOUND = 5e-5
# float32 pictures against the float64 reference: 1e−4 of full scale is a fortieth of a level
PICTURE_BOUND = 1e-4


def in_kernel(bench: Bench) -> list[Check]:
    """Checks X-rays of one splat around the eye against half-line integrals, on the axis and in every pixel."""
    camera = ahead(fov=80.0)
    volume = 1 / Gaussian().scale
    found, paper = [], []
    whole_found, whole_right, whole_paper = [], [], []
    for z, _ in BEHIND:
        splats = dots([(0.0, 0.0, z)])
        drawn = bench.draw(splats, camera, blend="xray", kernel="gaussian")
        found.append(middle(drawn)[3] * volume)
        old = bench.paper(splats, camera, blend="xray", kernel="gaussian")
        paper.append(middle(old)[3] * volume)
        whole_paper.append(alpha(old) * volume)
        across, down = np.meshgrid(*camera.slopes())
        rays = np.stack([across, down, np.ones_like(across)], axis=-1)
        voxel = np.broadcast_to([0.0, 0.0, z], rays.shape)
        whole_found.append(alpha(drawn) * volume)
        whole_right.append(half_line(kernel("gaussian"), voxel, rays) * volume)
    return [
        check("along the axis", found, [right for _, right in BEHIND], HALF_LINE_BOUND * volume, paper),
        check("every ray", whole_found, whole_right, HALF_LINE_BOUND * volume, whole_paper),
    ]


def places(bench: Bench) -> list[Check]:
    """Checks pictures from eyes on, between and beside voxels against the float64 reference."""
    size = (20, 18, 16)
    splats = voxels(Volume(noise(size, 0.3)), transfer())
    eyes = {
        "on a voxel": ((10.0, 9.0, 8.0), (1.0, 0.2, 0.1)),
        "between voxels": ((10.5, 8.5, 8.5), (0.3, 1.0, -0.2)),
        "at the corner": ((-0.5, -0.5, -0.5), (1.0, 1.0, 1.0)),
        "on a face": ((10.0, 9.0, -0.5), (0.0, 0.1, 1.0)),
        "inside a kernel": ((10.3, 9.2, 7.6), (-1.0, 0.5, 0.4)),
        "astride near plane": ((10.2, 8.7, 8.0 - NEAR), (0.0, 0.0, 1.0)),
        "on the near plane": ((10.0, 9.0, 8.0 + NEAR), (0.0, 0.0, -1.0)),
    }
    checks = []
    for name, (eye, view) in eyes.items():
        camera = Camera.look_at(eye, np.add(eye, view), UP_Z if abs(view[2]) < 1 else UP_Y, 70.0, (48, 48))
        drawn, right = bench.draw(splats, camera), bench.truth(splats, camera)
        checks.append(check(name, drawn, right, PICTURE_BOUND, bench.paper(splats, camera)))
    return checks


UP_Z, UP_Y = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)


def _layers(axis: int) -> tuple[Splats, np.ndarray]:
    """A cube of 9³ voxels with nearly opaque layers across `axis`, each with its own colour; and the colours."""
    count = 9
    colors = np.random.default_rng(axis).uniform(0.1, 1.0, (count, 3))
    grid = np.stack(np.meshgrid(*[np.arange(count)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    return dots(grid, 40.0, colors[grid[:, axis]]), colors


def axes(bench: Bench) -> list[Check]:
    """Checks that views along ±x, ±y and ±z show the nearest of nine opaque layers."""
    checks = []
    for perspective in (True, False):
        found, right, paper = [], [], []
        for axis in range(3):
            splats, colors = _layers(axis)
            for side in (-1.0, 1.0):
                camera = _along(axis, side, perspective)
                nearest = colors[0] if side > 0 else colors[-1]
                found.append(middle(bench.draw(splats, camera))[:3])
                paper.append(middle(bench.paper(splats, camera))[:3])
                right.append(nearest)
        checks.append(check("perspective" if perspective else "orthographic", found, right, 1e-6, paper))
    return checks


def _along(axis: int, side: float, perspective: bool) -> Camera:
    """A view along ±axis from 12 voxels before the cube's middle, on a face between cells along both other axes."""
    target = np.full(3, 3.5)
    view = np.eye(3)[axis] * side
    eye = target - 12.0 * view
    up = np.eye(3)[(axis + 1) % 3]
    if perspective:
        return Camera.look_at(eye, target, up, 20.0, (9, 9))
    return Camera.orthographic(eye, target, up, 3.0, (9, 9))


def on_faces(bench: Bench) -> list[Check]:
    """Checks views along each axis from the corner of eight cells against the float64 reference."""
    splats = block((12, 12, 12), 0.2)
    drawn, right, paper = [], [], []
    for axis in range(3):
        for side in (-1.0, 1.0):
            eye = np.full(3, 5.5)
            up = np.eye(3)[(axis + 1) % 3]
            camera = Camera.look_at(eye, eye + side * np.eye(3)[axis], up, 60.0, (16, 16))
            drawn.append(bench.draw(splats, camera))
            right.append(bench.truth(splats, camera))
            paper.append(bench.paper(splats, camera))
    return [check("six axes", drawn, right, PICTURE_BOUND, paper)]


EYE_CASES = (
    Case(
        "eye-in-kernel",
        "a voxel at, around or behind the eye: tan δ has a pole, and ghosts come from behind",
        "one Gaussian splat at depth 0, 0.5, 1, −0.5 and −3 voxels, X-ray",
        "closed form: half a line through the kernel",
        in_kernel,
    ),
    Case(
        "eye-places",
        "the eye on a voxel, between voxels, at the volume's corner, on its face, in a kernel, at the near plane",
        "20×18×16 random voxels, all nearer than z_k, 48×48 pixels, 70°",
        "float64 reference",
        places,
    ),
    Case(
        "axis-views",
        "the camera along ±x, ±y, ±z with the eye exactly on faces between cells",
        "nine opaque layers, each of its own colour, across the axis; what is seen is the nearest",
        "the nearest layer's colour",
        axes,
    ),
    Case(
        "eye-on-faces",
        "the eye inside of the volume, on the corner of eight cells, looking along each axis",
        "12³ voxels of opacity 0.2",
        "float64 reference",
        on_faces,
    ),
)


# radial table of 1024: 1e−5 of the peak; with float32's roundings
SHAPE_BOUND = 2e-5
# exact splats are accurate to second order in 1/z_k; if z_k is less than a voxel that does not apply, and the
# bound is 5 levels of 255
NO_Z_K_BOUND = 5 / 255
# X-ray sums of a lattice of exp(−2r²) stretched by m in a parallel view: (m, ripple in closed form)
LATTICES = ((1.5, 1.6e-4), (16.0, 2.6e-6), (64.0, 2.6e-6))


def narrow(bench: Bench) -> list[Check]:
    """0.001°: 7 voxels wide at 2e5 voxels, where float32 has steps of 1/64 voxel."""
    splats = voxels(Volume(noise((9, 9, 9), 0.3)), transfer())
    checks = []
    for name, view in (("along z", (0.0, 0.0, 1.0)), ("oblique", (0.48, 0.6, 0.64))):
        target = np.full(3, 4.0)
        camera = Camera.look_at(target - 2e5 * np.array(view), target, UP, 0.002, (33, 33))
        drawn, right = bench.draw(splats, camera), bench.truth(splats, camera)
        checks.append(check(f"9³ voxels {name}", drawn, right, PICTURE_BOUND, bench.paper(splats, camera)))
    return checks


def far_voxel(bench: Bench) -> list[Check]:
    """Checks a footprint 1e2, 1e4 and 1e6 voxels away against F(d)."""
    shape = kernel("crawfis-max")
    found, right, formula = [], [], []
    for depth in (1e2, 1e4, 1e6):
        # 3 voxels wide, so that the outermost rays pass 1.45 voxels from the voxel
        camera = ahead(fov=float(np.degrees(2 * np.arctan(1.5 / depth))), size=(31, 31))
        drawn = alpha(bench.draw(dots([(0.0, 0.0, depth)]), camera, blend="xray", antialias="off"))
        across, down = np.meshgrid(*camera.slopes())
        far = np.hypot(across, down)
        found.append(drawn)
        # d = |v × d̂| = z sin of the ray's angle
        right.append(shape.footprint(depth * far / np.sqrt(1 + far * far)))
        v2, z, one = np.float32(depth * depth), np.float32(depth), np.float32(1)
        along = z / np.sqrt(one + np.float32(1) * far.astype(np.float32) ** 2)
        formula.append(shape.footprint(np.sqrt(np.maximum(v2 - along * along, np.float32(0)).astype(np.float64))))
    return [check("at 1e2, 1e4, 1e6", found, right, SHAPE_BOUND, formula)]


def wide_85(bench: Bench) -> list[Check]:
    """Checks views of half-angle 85° against the float64 reference, from before and from inside."""
    splats = voxels(Volume(noise((8, 8, 8), 0.3)), transfer())
    checks = []
    for name, eye in (("from before", (3.5, 3.5, -3.0)), ("from inside", (3.6, 3.3, 3.2))):
        camera = Camera.look_at(eye, np.add(eye, (0.1, 0.05, 1.0)), UP, 170.0, (120, 240))
        drawn, right = bench.draw(splats, camera), bench.truth(splats, camera)
        checks.append(check(name, drawn, right, PICTURE_BOUND, bench.paper(splats, camera)))
    return checks


def wide_89(bench: Bench) -> list[Check]:
    """512 pixels high: z_k = 0.4468 voxels; a kernel that reaches the eye plane is left unchanged."""
    shape = kernel("crawfis-max")
    camera = ahead(fov=179.8, size=(65, 512))
    slopes = np.stack(np.meshgrid(*camera.slopes()), axis=-1)
    rays = np.concatenate([slopes, np.ones((*slopes.shape[:2], 1))], axis=-1)
    found, right, paper = [], [], []
    for voxel in ((0.0, 0.0, 0.2), (0.3, -0.4, 1.0), (0.0, 1.2, -0.3), (0.0, 0.0, 1.55)):
        found.append(alpha(bench.draw(dots([voxel]), camera, blend="xray")))
        paper.append(alpha(bench.paper(dots([voxel]), camera, blend="xray")))
        right.append(half_line(shape, np.broadcast_to(voxel, rays.shape), rays))
    checks = [check("kernels round the eye", found, right, HALF_LINE_BOUND, paper)]

    splats = voxels(Volume(noise((6, 6, 6), 0.3)), transfer())
    for name, eye in (("from before", (2.5, 2.5, -4.0)), ("from inside", (2.6, 2.3, 2.2))):
        view = Camera.look_at(eye, np.add(eye, (0.0, 0.0, 1.0)), UP, 179.8, (65, 512))
        drawn, answer = bench.draw(splats, view), bench.truth(splats, view)
        checks.append(check(f"6³ voxels {name}", drawn, answer, NO_Z_K_BOUND, bench.paper(splats, view)))
    return checks


def parallel_zoom(bench: Bench) -> list[Check]:
    """Checks parallel X-rays of 0.01 and 1000 voxels a pixel against sums of footprints."""
    shape = kernel("crawfis-max")
    # 0.01 voxels a pixel: a splat of 311 pixels
    camera = parallel(0.01, (353, 353))
    across, down = np.meshgrid(*camera.slopes())
    right = shape.footprint(np.hypot(across, down))
    dot = dots([(0.0, 0.0, 0.0)])
    drawn, paper = (alpha(draw(dot, camera, blend="xray")) for draw in (bench.draw, bench.paper))
    checks = [check("0.01 voxels a pixel", drawn, right, SHAPE_BOUND, paper)]

    # 1000: 300² voxels in one pixel, each Σ F(D/m)/m²
    splats = block((301, 301, 1), 0.5)
    view = parallel(1000.0, (3, 3), (150.0, 150.0))
    found, old = (alpha(draw(splats, view, blend="xray")) for draw in (bench.draw, bench.paper))
    x, y = np.meshgrid(np.arange(301) - 150.0, np.arange(301) - 150.0)
    centres = np.arange(3) - 1.0
    answer = [
        [-np.log1p(-0.5) * shape.footprint(np.hypot(x / 1e3 - i, y / 1e3 - j)).sum() / 1e6 for i in centres]
        for j in centres
    ]
    checks.append(check("1000 voxels a pixel", found, answer, SHAPE_BOUND * np.max(answer), old))
    return checks


def lattice_sums(bench: Bench) -> list[Check]:
    """Checks that X-rays of a sheet show its optical depth within the kernel's ripple."""
    checks = []
    for m, ripple in LATTICES:
        half = int(np.ceil(2 * m)) + int(2 * m) + 2
        side = 2 * half + 1
        splats = block((side, side, 1), 0.5)
        camera = parallel(m, (3, 3), (half + 0.31, half + 0.17))
        drawn = alpha(bench.draw(splats, camera, blend="xray", kernel="gaussian")) / np.log(2)
        old = alpha(bench.paper(splats, camera, blend="xray", kernel="gaussian")) / np.log(2)
        # an orthographic view uses the same radial table
        checks.append(check(f"m = {m:g}", drawn, 1.0, ripple + SHAPE_BOUND, old))
    return checks


LENS_CASES = (
    Case(
        "half-angle-0.001",
        "a half-angle of 0.001°, the volume 2e5 voxels away",
        "9³ random voxels, seen along an axis and obliquely, 33×33 pixels",
        "float64 reference",
        narrow,
    ),
    Case(
        "far-voxel",
        "a ray that passes a voxel 1e6 voxels away: |v|² − (v·d̂)² is rounded away",
        "one splat, rays up to 1.5 voxels off; the paper's column: that formula in float32",
        "closed form: F(d)",
        far_voxel,
    ),
    Case(
        "half-angle-85",
        "a half-angle of 85°, from before and from inside",
        "8³ random voxels, 120×240 pixels, z_k = 10.5 voxels",
        "float64 reference",
        wide_85,
    ),
    Case(
        "half-angle-89.9",
        "a half-angle of 89.9°: z_k = 0.45 voxels is less than the kernel's radius",
        "four splats round the eye, X-ray; 6³ random voxels; 65×512 pixels",
        "closed form: half a line through the kernel; float64 reference",
        wide_89,
    ),
    Case(
        "parallel-zoom",
        "parallel rays with 0.01 and 1000 voxels a pixel",
        "one splat 311 pixels wide; 301² voxels in a pixel, X-ray",
        "closed form: F(d); Σ F(d/m)/m²",
        parallel_zoom,
    ),
    Case(
        "lattice-sums",
        "a sheet in parallel rays, pixels wider than voxels",
        "kernel exp(−2r²), X-ray, m = 1.5, 16 and 64",
        "the sheet's optical depth within the lattice's ripple, 1.6e−4 and 2.6e−6, and the table's 2e−5",
        lattice_sums,
    ),
)

"""Eye positions: in a kernel, on voxels, at corners, at the near plane, along every axis."""

from __future__ import annotations

import numpy as np

from splatgl.data.volume import Volume
from splatgl.splat.camera import Camera
from splatgl.splat.footprint import NEAR, half_line
from splatgl.splat.kernels import Gaussian, kernel
from splatgl.splat.splats import Splats
from splatgl.truth.stress.bench import Bench, voxels
from splatgl.truth.stress.case import Case, Check, check
from splatgl.truth.stress.scenes import ahead, alpha, block, dots, middle, noise, transfer

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


CASES = (
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

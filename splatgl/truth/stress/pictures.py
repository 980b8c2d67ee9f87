"""Splat and image sizes: far smaller or larger than pixels, on the rim, and images of one row or column."""

from __future__ import annotations

import numpy as np

from splatgl.data.volume import Volume
from splatgl.splat.camera import Camera
from splatgl.splat.kernels import kernel
from splatgl.truth.stress.bench import Bench, voxels
from splatgl.truth.stress.case import Case, Check, check
from splatgl.truth.stress.scenes import ahead, alpha, dots, middle, noise, parallel, peak, transfer

# radial table of 1024: 1e−5 of the peak; with float32's roundings
SHAPE_BOUND = 2e-5
# float32 pictures against the float64 reference
PICTURE_BOUND = 1e-4
# z_v/z_k
RATIOS = tuple(10.0**n for n in range(-3, 7))
# width, height
SIZES = ((1, 1), (1, 4096), (4096, 1))


def zoom_range(bench: Bench) -> list[Check]:
    """A splat on the axis from z_k/1000, where it is wider than the image, to 10⁶ z_k."""
    shape = kernel("crawfis-max")
    found, paper, right = [], [], []
    for ratio in RATIOS:
        camera = ahead(fov=0.5, size=(33, 33))
        depth = ratio * camera.z_k(1.0)
        dot = dots([(0.0, 0.0, depth)])
        m2 = max(1.0, ratio) ** 2
        drawn, old = (middle(draw(dot, camera, blend="xray"))[3] for draw in (bench.draw, bench.paper))
        # eye inside the kernel: the part in front of it
        whole = float(shape.partial(np.zeros(()), np.array(min(depth, shape.radius)))) + peak() / 2
        found.append(drawn)
        paper.append(old)
        right.append(whole / m2)
    return [check("X-ray, F(0)/m²", found, right, SHAPE_BOUND, paper, relative=True)]


def wider_than_picture(bench: Bench) -> list[Check]:
    """One pixel's worth of a splat: 0.001° wide at half a voxel's distance outside of it."""
    shape = kernel("crawfis-max")
    camera = ahead(fov=0.002, size=(17, 17))
    found, paper, right = [], [], []
    for depth in (2.0, 5.0, 50.0):
        for off in (0.0, 0.5, 1.5):
            dot = dots([(off, 0.0, depth)], 0.7)
            found.append(middle(bench.draw(dot, camera))[3])
            paper.append(middle(bench.paper(dot, camera))[3])
            right.append(-np.expm1(-0.7 * float(shape.footprint(np.array(off)))))
    return [check("0, 0.5, 1.5 voxels off", found, right, SHAPE_BOUND, paper)]


def rim(bench: Bench) -> list[Check]:
    """Rays at and near R: F(R) is 0, and no value is negative or NaN."""
    checks = []
    for name in ("crawfis-max", "gaussian"):
        shape = kernel(name)
        # pixel centres at multiples of R/16, including the axis
        camera = parallel(shape.radius / 16, (49, 49))
        across, down = np.meshgrid(*camera.slopes())
        distance = np.hypot(across, down)
        dot = dots([(0.0, 0.0, 0.0)])
        right = np.where(distance < shape.radius * (1 - 1e-9), shape.footprint(distance), 0.0)
        drawn, paper = (alpha(draw(dot, camera, blend="xray", kernel=name)) for draw in (bench.draw, bench.paper))
        checks.append(check(f"{name}, all of it", drawn, right, SHAPE_BOUND, paper))
        beyond = distance >= shape.radius * (1 - 1e-9)
        checks.append(check(f"{name}, from R on", drawn[beyond], 0.0, 1e-6, paper[beyond]))
    return checks


def sizes(bench: Bench) -> list[Check]:
    """Checks pictures of SIZES pixels against the float64 reference."""
    volume = Volume(noise((10, 10, 10), 0.3))
    splats = voxels(volume, transfer(shading=True))
    checks = []
    for size in SIZES:
        # the long side spans 40°, a single pixel 1°
        fov = 40.0 if size[1] > 1 else 40.0 / size[0] if size[0] > 1 else 1.0
        camera = Camera.look_at((25.0, -20.0, 15.0), volume.center, (0, 0, 1), fov, size)
        drawn, right = bench.draw(splats, camera), bench.truth(splats, camera)
        checks.append(check(f"{size[0]}×{size[1]}", drawn, right, PICTURE_BOUND, bench.paper(splats, camera)))
    return checks


CASES = (
    Case(
        "zoom-range",
        "z_v/z_k from 1e−3 to 1e6, antialiased: an 8-bit alpha is 0 for m > 22.6",
        "one splat on the axis, X-ray",
        "closed form: F(0)/m², half a line where the eye is in the kernel",
        zoom_range,
    ),
    Case(
        "wider-than-picture",
        "a splat wider than the whole picture",
        "0.002° across, at 2, 5 and 50 voxels, the splat's middle 0, 0.5 and 1.5 voxels off the view",
        "closed form: 1 − exp(−τ F(d))",
        wider_than_picture,
    ),
    Case(
        "rim",
        "rays exactly at the kernel's radius, where square roots of small negative numbers wait",
        "one splat in parallel rays at multiples of R/16, X-ray, both kernels",
        "closed form: F(d), 0 from R on",
        rim,
    ),
    Case(
        "picture-sizes",
        "pictures of 1×1, 1×4096 and 4096×1 pixels",
        "10³ random voxels, shaded",
        "float64 reference",
        sizes,
    ),
)

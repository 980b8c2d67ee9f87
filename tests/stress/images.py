"""Stress cases of images: sizes, classification, and every method."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from splatgl.data.scenes import ball
from splatgl.data.volume import Volume
from splatgl.geometry.camera import Camera
from splatgl.planning.resolve import depth_range
from splatgl.reference import renderer
from splatgl.report.methods import DEFAULT, methods
from splatgl.splat.extract import POST_KERNEL, extract
from splatgl.splat.kernels import FREE, kernel
from splatgl.splat.settings import Settings
from splatgl.splat.splats import Splats
from splatgl.transfer.transfer import Transfer
from tests.stress.case import (
    SHAPE_BOUND,
    UP,
    Bench,
    Check,
    Group,
    ahead,
    alpha,
    box_ends,
    check,
    check_rows,
    distance_of,
    dots,
    middle,
    noise,
    optical_depth,
    parallel,
    peak,
    rays_of,
    transfer,
    voxels,
)

CLASSES = Group()
# voxels of a box along each axis
SIDE = 12
# optical depth of a voxel in fog that is neither thin nor opaque
FOG = 0.05
# extremes of it
DEPTHS = (1e-12, 1e-6, 1.0, 1e2, 1e4)
# float32 sums of a ray through constant values
CONSTANT = 2e-5
# the slope of a field of means, and where it passes a value, are off by this share
SLOPE = 0.03
# voxels by which limits of coefficients may widen a plate of one voxel at half its value
THIN = 0.4


def fog(depth: float, spacing: Sequence[float] = (1.0, 1.0, 1.0)) -> Splats:
    """A box of constant value, of optical depth `depth` per mean spacing."""
    unit = np.log(2) / depth * float(np.prod(spacing)) ** (1 / 3)
    return after(np.ones((SIDE,) * 3), ((0.0, 0.0), (1.0, 0.5)), unit, spacing)


def after(
    samples: np.ndarray,
    points: Sequence[Sequence[float]],
    unit: float | None = None,
    spacing: Sequence[float] = (1.0, 1.0, 1.0),
    kernel: str = POST_KERNEL,
) -> Splats:
    """Splats of values [z, y, x], unshaded."""
    transfer, (x, y, z) = Transfer(points, unit=unit, shading=False), spacing
    return extract(Volume(samples, (x, y, z)), transfer, classification="post", kernel=kernel)


def slope(scale: float = 1.0) -> np.ndarray:
    """Values that rise by `scale` from plane to plane."""
    return np.broadcast_to(np.arange(2.0 * SIDE)[:, None, None] * scale, (2 * SIDE, SIDE, SIDE)).copy()


def down() -> Camera:
    """One pixel, along +z through the middle of the volumes, off the voxels' centres."""
    return parallel(0.5, (1, 1), (SIDE / 2 - 0.37, SIDE / 2 - 0.61))


@CLASSES.case(
    "spikes",
    "opacities narrower than a step of the ray, and than a grey level",
    "values that rise by 1 a voxel, spikes of 0.6 from 2 to 2e-6 values wide; classified after reconstruction",
    "closed form: the spike's area over the slope",
)
def _spikes(bench: Bench) -> Iterator[Check]:
    for width in (1.0, 0.1, 1e-3, 1e-6):
        # an opacity of 0.6 at the top; its area over the spike
        at = (np.arange(20_000) + 0.5) / 20_000
        right = float(Transfer.extinction(0.6 * at, width).mean()) * 2 * width
        drawn = [
            optical_depth(middle(bench.draw(after(slope(), spike, width), down()))[3])
            for spike in (((z - width, 0.0), (z, 0.6), (z + width, 0.0)) for z in (11.0, 11.37, 12.5, 12.81))
        ]
        yield check(f"{2 * width:g} values wide", drawn, right, SLOPE * right)


@CLASSES.case(
    "steps",
    "a step of opacity between neighbouring values; values from 1e-38 to 1e38",
    "values that rise by 1, 1e-38 and 1e37 a voxel; classified after reconstruction",
    "closed form: the way behind the step",
)
def _steps(bench: Bench) -> Iterator[Check]:
    for scale in (1.0, 1e-38, 1e37):
        drawn, right = [], []
        for z in (9.5, 10.2, 13.01):
            points = ((z * scale, 0.0), (z * scale, 0.05))
            drawn.append(optical_depth(middle(bench.draw(after(slope(scale), points), down()))[3]))
            right.append((2 * SIDE - 0.5 - z) * -np.log1p(-0.05))
        yield check(f"{scale:g} a voxel", drawn, right, SLOPE * FOG)


@CLASSES.case(
    "depths",
    "optical depths from 1e-12 to 1e4 a voxel",
    "boxes of constant value along an axis; classified after reconstruction",
    "closed form: 1 − e^−τ",
)
def _depths(bench: Bench) -> Iterator[Check]:
    for depth in DEPTHS:
        drawn = middle(bench.draw(fog(depth), down()))[3]
        yield check(f"τ = {depth:g} a voxel", drawn, -np.expm1(-depth * SIDE), CONSTANT, relative=True)


@CLASSES.case(
    "boxes",
    "voxels of 16:1 and 16:2:1, and sheets around the eye",
    "fog in a box from outside and inside, its edges and corners; classified after reconstruction",
    "closed form: 1 − e^−τ of each ray's chord",
)
def _boxes(bench: Bench) -> Iterator[Check]:
    for spacing in ((1.0, 1.0, 1.0), (1.0, 1.0, 16.0), (8.0, 0.5, 1.0)):
        size = np.array(spacing)
        low, high = -0.5 * size, (SIDE - 0.5) * size
        splats, center = fog(FOG, spacing), (low + high) / 2
        for name, eye in (("inside", low + 0.3 * (high - low)), ("outside", center + (high - low) * (1.3, -1.1, 0.9))):
            camera = Camera.look_at(eye, center + 0.11 * size, UP, 30.0, (15, 15))
            rays = rays_of(camera)
            rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True) @ camera.eye_from_world
            near, far = box_ends(camera.eye, rays, low, high)
            right = -np.expm1(-FOG / float(np.prod(size)) ** (1 / 3) * (far - near))
            drawn = alpha(bench.draw(splats, camera))
            yield check(f"{':'.join(f'{s:g}' for s in spacing)}, {name}", drawn, right, 5 * CONSTANT)


@CLASSES.case(
    "gaps",
    "empty space between thin plates",
    "plates 1 to 4 voxels thick, a step of opacity at half their value; classified after reconstruction",
    "by symmetry: the step lies midway between two voxels; limits may widen a plate of one by 0.4 voxels",
)
def _gaps(bench: Bench) -> Iterator[Check]:
    thin = -2 * THIN * np.log1p(-0.2)
    for thick, between, name, bound in (
        (1, 3, FREE, 0.1),
        (1, 3, POST_KERNEL, thin),
        (2, 9, POST_KERNEL, 0.1),
        (4, 40, POST_KERNEL, 0.1),
    ):
        line = np.repeat([0.0, 1.0, 0.0, 1.0, 0.0], [between, thick, between, thick, between])
        samples = np.broadcast_to(line[:, None, None], (len(line), SIDE, SIDE)).copy()
        splats = after(samples, ((0.5, 0.0), (0.5, 0.2)), kernel=name)
        drawn = optical_depth(middle(bench.draw(splats, down(), kernel=name))[3])
        what = f"{thick} voxels, {between} apart, {name}"
        yield check(what, drawn, -2 * thick * np.log1p(-0.2), bound)


METHODS = Group()
# voxels a radius, and pixels a side
RADIUS, PIXELS = 5.0, 12
# eyes: at the centre, and at a distance where a pixel is six voxels wide; with angles of view, degrees
VIEWS = ((0.3, 90.0), (100.0, 40.0))


@METHODS.case(
    "methods",
    "every method of splatgl report, from inside and from afar: share of its own error bound",
    "a ball of 5 voxels; the eye in it, and 100 voxels away with pixels 6 voxels wide",
    "the float64 reference; the error over the bound that each picture states",
)
def _every(bench: Bench) -> list[Check]:
    splats = voxels(ball(RADIUS), Transfer(points=[(0.0, 0.0), (1.0, 0.6)], unit=1.0))
    # images classified after reconstruction, or drawn in float64, state no bound
    bounded = [name for name, m in methods().items() if m.changes.get("classification") != "post" and not m.row]
    worst = dict.fromkeys(bounded, 0.0)
    for distance, fov in VIEWS:
        eye = distance * np.array([0.48, -0.8, 0.36])
        camera = Camera.look_at(eye, eye * 1.5 if distance < RADIUS else (0, 0, 0), (0, 0, 1), fov, (PIXELS, PIXELS))
        for name in worst:
            method = methods()[name]
            settings = method.settings(Settings.like("0.1"), depth_range(splats, camera))
            drawn = bench.renderer.render(splats, camera, settings)
            bench.count(drawn.pixels)
            error = float(np.abs(drawn.pixels - renderer.render(splats, camera, settings).pixels).max())
            limit = drawn.info["error_bound"]
            assert isinstance(limit, float)
            worst[name] = max(worst[name], error / limit if limit else error)
    order = sorted(worst, key=lambda name: (name != DEFAULT, name))
    return [check(f"{name}: error/bound", worst[name], 0.0, 1.0) for name in order]


IMAGES = Group()
# z_v/z_k
RATIOS = tuple(10.0**n for n in range(-3, 7))
# width, height
IMAGE_SIZES = ((1, 1), (1, 4096), (4096, 1))


@IMAGES.case(
    "zoom-range",
    "z_v/z_k from 1e−3 to 1e6, antialiased: an 8-bit alpha is 0 for m > 22.6",
    "one splat on the axis, X-ray; the paper's: −ln(1 − α) of its composite, as X-rays exceed its 8 bits",
    "closed form: F(0)/m², half a line where the eye is in the kernel",
)
def _zoom_range(bench: Bench) -> list[Check]:
    shape = kernel("crawfis-max")
    rows = []
    for ratio in RATIOS:
        camera = ahead(fov=0.5, size=(33, 33))
        depth = ratio * camera.z_k(1.0)
        dot = dots([(0.0, 0.0, depth)])
        drawn, paper = middle(bench.draw(dot, camera, blend="xray")), middle(bench.paper(dot, camera))
        # eye inside the kernel: the part in front of it
        whole = float(shape.partial(np.zeros(()), np.array(min(depth, shape.radius)))) + peak() / 2
        rows.append((drawn[3], whole / max(1.0, ratio) ** 2, optical_depth(paper[3])))
    return [check_rows("X-ray, F(0)/m²", rows, SHAPE_BOUND, relative=True)]


@IMAGES.case(
    "wider-than-picture",
    "a splat wider than the whole picture",
    "0.002° across, at 2, 5 and 50 voxels, the splat's middle 0, 0.5 and 1.5 voxels off the view",
    "closed form: 1 − exp(−τ F(d))",
)
def _wider_than_picture(bench: Bench) -> list[Check]:
    shape = kernel("crawfis-max")
    camera = ahead(fov=0.002, size=(17, 17))
    rows = []
    for depth in (2.0, 5.0, 50.0):
        for off in (0.0, 0.5, 1.5):
            dot = dots([(off, 0.0, depth)], 0.7)
            drawn, paper = map(middle, bench.both(dot, camera))
            rows.append((drawn[3], -np.expm1(-0.7 * float(shape.footprint(np.array(off)))), paper[3]))
    return [check_rows("0, 0.5, 1.5 voxels off", rows, SHAPE_BOUND)]


@IMAGES.case(
    "rim",
    "rays exactly at the kernel's radius, where square roots of small negative numbers wait",
    "one splat in parallel rays at multiples of R/16, X-ray, both kernels",
    "closed form: F(d), 0 from R on",
)
def _rim(bench: Bench) -> Iterator[Check]:
    for name in ("crawfis-max", "gaussian"):
        shape = kernel(name)
        # pixel centres at multiples of R/16, including the axis
        camera = parallel(shape.radius / 16, (49, 49))
        distance = distance_of(camera)
        dot = dots([(0.0, 0.0, 0.0)])
        right = np.where(distance < shape.radius * (1 - 1e-9), shape.footprint(distance), 0.0)
        drawn, paper = map(alpha, bench.both(dot, camera, blend="xray", kernel=name))
        yield check(f"{name}, all of it", drawn, right, SHAPE_BOUND, paper)
        beyond = distance >= shape.radius * (1 - 1e-9)
        yield check(f"{name}, from R on", drawn[beyond], 0.0, 1e-6, paper[beyond])


@IMAGES.case(
    "picture-sizes", "pictures of 1×1, 1×4096 and 4096×1 pixels", "10³ random voxels, shaded", "float64 reference"
)
def _sizes(bench: Bench) -> Iterator[Check]:
    volume = Volume(noise((10, 10, 10), 0.3))
    splats = voxels(volume, transfer(shading=True))
    for size in IMAGE_SIZES:
        # the long side spans 40°, a single pixel 1°
        fov = 40.0 if size[1] > 1 else 40.0 / size[0] if size[0] > 1 else 1.0
        camera = Camera.look_at((25.0, -20.0, 15.0), volume.center, (0, 0, 1), fov, size)
        yield bench.check_reference(f"{size[0]}×{size[1]}", splats, camera)

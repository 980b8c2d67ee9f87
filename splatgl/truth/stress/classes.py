"""Values classified after reconstruction, and sheets: steps, spikes and fog whose answers are known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from splatgl.data.volume import Volume
from splatgl.splat.camera import Camera
from splatgl.splat.extract import POST_KERNEL, extract
from splatgl.splat.kernels import FREE
from splatgl.splat.splats import Splats
from splatgl.splat.transfer import Transfer
from splatgl.truth.stress.bench import Bench
from splatgl.truth.stress.case import Case, Check, check
from splatgl.truth.stress.scenes import UP, middle, optical_depth, parallel

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


def spikes(bench: Bench) -> list[Check]:
    """Checks spikes of opacity in a slope, at places between the voxels."""
    checks = []
    for width in (1.0, 0.1, 1e-3, 1e-6):
        # an opacity of 0.6 at the top; its area over the spike
        at = (np.arange(20_000) + 0.5) / 20_000
        right = float(Transfer.extinction(0.6 * at, width).mean()) * 2 * width
        found = [
            optical_depth(middle(bench.draw(after(slope(), spike, width), down()))[3])
            for spike in (((z - width, 0.0), (z, 0.6), (z + width, 0.0)) for z in (11.0, 11.37, 12.5, 12.81))
        ]
        checks.append(check(f"{2 * width:g} values wide", found, right, SLOPE * right))
    return checks


def steps(bench: Bench) -> list[Check]:
    """Checks a step between two neighbouring values, and values of any size."""
    checks = []
    for scale in (1.0, 1e-38, 1e37):
        found, right = [], []
        for z in (9.5, 10.2, 13.01):
            points = ((z * scale, 0.0), (z * scale, 0.05))
            found.append(optical_depth(middle(bench.draw(after(slope(scale), points), down()))[3]))
            right.append((2 * SIDE - 0.5 - z) * -np.log1p(-0.05))
        checks.append(check(f"{scale:g} a voxel", found, right, SLOPE * FOG))
    return checks


def depths(bench: Bench) -> list[Check]:
    """Checks boxes of nearly transparent to opaque matter, along an axis."""
    checks = []
    for depth in DEPTHS:
        right = -np.expm1(-depth * SIDE)
        found = middle(bench.draw(fog(depth), down()))[3]
        checks.append(check(f"τ = {depth:g} a voxel", found, right, CONSTANT, relative=True))
    return checks


def chord(camera: Camera, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """[H, W]: world lengths of a perspective camera's rays in a box, from the eye on."""
    across, down = camera.slopes()
    ray = np.stack([*np.broadcast_arrays(across[None, :], down[:, None]), np.ones((len(down), len(across)))], axis=-1)
    ray = ray / np.linalg.norm(ray, axis=-1, keepdims=True) @ camera.eye_from_world
    with np.errstate(divide="ignore"):
        ends = np.stack([(low - camera.eye) / ray, (high - camera.eye) / ray])
    near, far = ends.min(axis=0).max(axis=-1), ends.max(axis=0).min(axis=-1)
    return np.asarray(np.maximum(far - np.maximum(near, 0.0), 0.0))


def boxes(bench: Bench) -> list[Check]:
    """Checks fog in boxes of long voxels, from outside and inside."""
    checks = []
    for spacing in ((1.0, 1.0, 1.0), (1.0, 1.0, 16.0), (8.0, 0.5, 1.0)):
        size = np.array(spacing)
        low, high = -0.5 * size, (SIDE - 0.5) * size
        splats, center = fog(FOG, spacing), (low + high) / 2
        for name, eye in (("inside", low + 0.3 * (high - low)), ("outside", center + (high - low) * (1.3, -1.1, 0.9))):
            camera = Camera.look_at(eye, center + 0.11 * size, UP, 30.0, (15, 15))
            length = chord(camera, low, high)
            right = -np.expm1(-FOG / float(np.prod(size)) ** (1 / 3) * length)
            found = bench.draw(splats, camera)[..., 3]
            checks.append(check(f"{':'.join(f'{s:g}' for s in spacing)}, {name}", found, right, 5 * CONSTANT))
    return checks


def gaps(bench: Bench) -> list[Check]:
    """Checks plates with empty space between, which a step at half their value ends midway between two voxels.

    Within limits, a plate of one voxel has no values below 0 beside it, and is THIN voxels wider at most.
    """
    checks = []
    thin = -2 * THIN * np.log1p(-0.2)
    for thick, between, kernel, bound in (
        (1, 3, FREE, 0.1),
        (1, 3, POST_KERNEL, thin),
        (2, 9, POST_KERNEL, 0.1),
        (4, 40, POST_KERNEL, 0.1),
    ):
        plate, empty = np.ones(thick), np.zeros(between)
        line = np.concatenate([empty, plate, empty, plate, empty])
        samples = np.broadcast_to(line[:, None, None], (len(line), SIDE, SIDE)).copy()
        splats = after(samples, ((0.5, 0.0), (0.5, 0.2)), kernel=kernel)
        found = optical_depth(middle(bench.draw(splats, down(), kernel=kernel))[3])
        what = f"{thick} voxels, {between} apart, {kernel}"
        checks.append(check(what, found, -2 * thick * np.log1p(-0.2), bound))
    return checks


CASES = (
    Case(
        "spikes",
        "opacities narrower than a step of the ray, and than a grey level",
        "values that rise by 1 a voxel, spikes of 0.6 from 2 to 2e-6 values wide; classified after reconstruction",
        "closed form: the spike's area over the slope",
        spikes,
    ),
    Case(
        "steps",
        "a step of opacity between neighbouring values; values from 1e-38 to 1e38",
        "values that rise by 1, 1e-38 and 1e37 a voxel; classified after reconstruction",
        "closed form: the way behind the step",
        steps,
    ),
    Case(
        "depths",
        "optical depths from 1e-12 to 1e4 a voxel",
        "boxes of constant value along an axis; classified after reconstruction",
        "closed form: 1 − e^−τ",
        depths,
    ),
    Case(
        "boxes",
        "voxels of 16:1 and 16:2:1, and sheets around the eye",
        "fog in a box from outside and inside, its edges and corners; classified after reconstruction",
        "closed form: 1 − e^−τ of each ray's chord",
        boxes,
    ),
    Case(
        "gaps",
        "empty space between thin plates",
        "plates 1 to 4 voxels thick, a step of opacity at half their value; classified after reconstruction",
        "by symmetry: the step lies midway between two voxels; limits may widen a plate of one by 0.4 voxels",
        gaps,
    ),
)

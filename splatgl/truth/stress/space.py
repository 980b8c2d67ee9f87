"""Grids: extreme spacings and origins, mirrored and rotated axes."""

from __future__ import annotations

import numpy as np

from splatgl.data.volume import Triple, Volume
from splatgl.splat.camera import Camera
from splatgl.splat.kernels import kernel
from splatgl.truth.stress.bench import Bench, voxels
from splatgl.truth.stress.case import Case, Check, check
from splatgl.truth.stress.scenes import alpha, dots, noise, transfer

SIZE = (48, 48)
SHAPE = (14, 12, 10)
PICTURE_BOUND = 1e-4
# a scene in other units has the same values except for roundings of float64 and a few of float32
SAME = 1e-5
SHAPE_BOUND = 2e-5
# exact splats are accurate to second order in (kernel's depth)/(its distance): here 1/30
FEW_PIXELS_BOUND = 1e-3
# here 1/2: the bound is 5 levels of 255
NEAR_BOUND = 5 / 255
# of samples.transpose(1, 2, 0): index x runs along z, y along x, z along y
RENAMED = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])


def _picture(
    bench: Bench, volume: Volume, turn: np.ndarray | None = None, center: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """(drawn, paper) from 1.6 diagonals of the volume's box away, all turned by `turn`."""
    rotate = np.eye(3) if turn is None else turn
    box = volume.world_from_index @ np.array(volume.shape[::-1], np.float64)
    size = float(np.linalg.norm(box))
    middle = volume.center if center is None else center
    eye = middle + rotate @ np.array([0.7, -1.3, 0.6]) * size
    camera = Camera.look_at(eye, middle, rotate @ np.array([0.0, 0.0, 1.0]), 36.0, SIZE)
    splats = voxels(volume, transfer(shading=True))
    return bench.draw(splats, camera), bench.paper(splats, camera)


def _same(bench: Bench, name: str, volume: Volume, right: Volume, bound: float = SAME) -> Check:
    drawn, paper = _picture(bench, volume)
    return check(name, drawn, _picture(bench, right)[0], bound, paper)


def _volume(spacing: Triple = (1.0, 1.0, 1.0), origin: Triple = (0.0, 0.0, 0.0)) -> Volume:
    return Volume(noise(SHAPE, 0.4), spacing, origin)


def scale(bench: Bench) -> list[Check]:
    """Checks that voxels of 1e−9 and 1e9 world units give the picture of spacing 1."""
    checks = []
    for size in (1e-9, 1e9):
        checks.append(_same(bench, f"spacing {size:.0e}", _volume((size,) * 3), _volume()))
        box = (size, 1.3 * size, 0.6 * size)
        checks.append(_same(bench, f"{size:.0e}, not cubic", _volume(box), _volume((1.0, 1.3, 0.6))))
    return checks


def flat_voxels(bench: Bench) -> list[Check]:
    """1:1000. One splat against F(D)/|S⁻¹d̂|, and a volume against the reference."""
    shape = kernel("crawfis-max")
    spacing = np.array([1.0, 1.0, 1000.0])
    mean = 10.0
    found, paper, right = [], [], []
    for view in ((1.0, 0.0, 0.2), (0.3, 0.1, 1.0), (0.0, 1.0, 0.0), (1.0, 1.0, 100.0)):
        direction = np.array(view) / np.linalg.norm(view)
        for off in (0.0, 0.4, 1.1):
            side = np.cross(direction, (1.0, 2.0, 0.3))
            target = side / np.linalg.norm(side / spacing) * off
            camera = Camera.look_at(target - 5e3 * direction, target, (0.1, 1.0, 0.3), 1e-3, (1, 1))
            dot = dots([(0.0, 0.0, 0.0)], 1 / mean, spacing=(1.0, 1.0, 1000.0))
            # in index space the ray passes at distance D and covers |S⁻¹ d̂| voxels per unit length
            along = direction / spacing
            distance = np.linalg.norm(np.cross(target / spacing, along)) / np.linalg.norm(along)
            right.append(float(shape.footprint(np.asarray(distance))) / np.linalg.norm(along) / mean)
            settings = {"blend": "xray", "antialias": "off"}
            found.append(bench.draw(dot, camera, **settings)[0, 0, 3])
            paper.append(bench.paper(dot, camera, **settings)[0, 0, 3])
    checks = [check("one voxel", found, right, SHAPE_BOUND * float(np.max(right)), paper)]
    volume = Volume(noise((12, 12, 4), 0.3), (1.0, 1.0, 1000.0))
    splats = voxels(volume, transfer(unit=1.0))
    views = (
        ("edge on", (3000.0, 900.0, 1500.0), PICTURE_BOUND),
        ("flat on", (5.0, 6.0, -5e4), FEW_PIXELS_BOUND),
        ("flat on, near", (5.0, 6.0, -3e3), NEAR_BOUND),
    )
    for name, eye, bound in views:
        fov = 2.0 if eye[2] > -1e4 else 0.1
        camera = Camera.look_at(eye, volume.center, (0.0, 1.0, 0.1), fov, SIZE)
        drawn, answer = (draw(splats, camera, attenuation="optical-depth") for draw in (bench.draw, bench.truth))
        checks.append(check(f"volume {name}", drawn, answer, bound, bench.paper(splats, camera)))
    return checks


def offsets(bench: Bench) -> list[Check]:
    """Checks that origins of 1e7 and 1e9 give the picture at the origin."""
    checks = []
    for far in (1e7, 1e9):
        for name, origin in (("x, y, z", (far, -far, far)), ("x", (far, 0.0, 0.0))):
            checks.append(_same(bench, f"{far:.0e} along {name}", _volume(origin=origin), _volume()))
    return checks


def directions(bench: Bench) -> list[Check]:
    """Checks mirrored, rotated and permuted axes against the image of the plain volume."""
    samples = noise(SHAPE, 0.4)
    right, _ = _picture(bench, Volume(samples))
    checks, last = [], np.array(samples.shape[::-1]) - 1.0
    # a reversed axis, with a negative direction
    for axis, name in enumerate("xyz"):
        flip = np.eye(3)
        flip[axis, axis] = -1.0
        origin = np.zeros(3)
        origin[axis] = last[axis]
        turned = Volume(np.flip(samples, 2 - axis), origin=_triple(origin), direction=flip)
        drawn, paper = _picture(bench, turned)
        checks.append(check(f"−{name}", drawn, right, SAME, paper))
    # rotation of volume and eye
    rotation = _rotation()
    volume = Volume(samples, origin=(3.0, -2.0, 1.0), direction=rotation)
    drawn, paper = _picture(bench, volume, rotation)
    checks.append(check("turned", drawn, right, SAME, paper))
    # axes permuted: z, y, x read as x, z, y
    volume = Volume(np.ascontiguousarray(samples.transpose(1, 2, 0)), direction=RENAMED)
    drawn, paper = _picture(bench, volume)
    # overlapping splats of a plane are drawn in another order, which affects colours but not opacity
    checks.append(check("axes renamed, opacity", alpha(drawn), alpha(right), SAME, alpha(paper)))
    return checks


def _triple(values: np.ndarray) -> Triple:
    return float(values[0]), float(values[1]), float(values[2])


def _rotation() -> np.ndarray:
    q, _ = np.linalg.qr(np.random.default_rng(12).normal(size=(3, 3)))
    return np.asarray(q * np.sign(np.linalg.det(q)))


CASES = (
    Case(
        "spacing-scale",
        "voxels of 1e−9 and 1e9 world units",
        "14×12×10 random voxels, shaded, cubic or 1:1.3:0.6, 48×48 pixels",
        "the picture with spacing 1",
        scale,
    ),
    Case(
        "spacing-1-1000",
        "voxels a thousand times as long as wide",
        "one splat on 12 rays; 12×12×4 voxels seen flat and edge on",
        "closed form: F(D)/|S⁻¹d̂|; float64 reference",
        flat_voxels,
    ),
    Case(
        "world-offset",
        "origins of 1e7 and 1e9, where float32 steps by 1 and 64",
        "14×12×10 random voxels, shaded, 48×48 pixels",
        "the picture at the origin",
        offsets,
    ),
    Case(
        "directions",
        "axes that run backwards, turned grids, renamed axes",
        "the same samples stored otherwise, or all of it turned with the eye",
        "the picture of the plain volume",
        directions,
    ),
)

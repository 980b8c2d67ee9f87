"""Stress cases of grids: sample types, spacings and axes."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from splatgl.data.volume import Triple, Volume
from splatgl.geometry.camera import Camera
from splatgl.splat.kernels import kernel
from splatgl.transfer.transfer import Transfer
from tests.stress.case import (
    PICTURE_BOUND,
    SHAPE_BOUND,
    Bench,
    Check,
    Group,
    alpha,
    check,
    check_rows,
    dots,
    noise,
    parallel,
    transfer,
    voxels,
)

SAMPLES = Group()
SIZE = (48, 48)
TYPES = ("uint8", "int16", "uint16", "int32", "float16", "float32", "float64", ">i2", ">f4", "int64")
# the smallest numbers of either type
DENORMALS = (("float32", float(np.finfo(np.float32).smallest_subnormal)), ("float64", 5e-324))


def _orbit(volume: Volume) -> Camera:
    return Camera.orbit(volume, azimuth=33, elevation=21, size=SIZE)


def _both(bench: Bench, samples: np.ndarray, look: Transfer) -> tuple[np.ndarray, np.ndarray]:
    volume = Volume(samples)
    return bench.both(voxels(volume, look), _orbit(volume))


@SAMPLES.case(
    "sample-types",
    "samples of any type and byte order",
    "10×11×12 whole numbers from 0 to 100, shaded: uint8 to int64, float16 to float64, big-endian ones",
    "the picture of float64, bit for bit",
)
def _types(bench: Bench) -> list[Check]:
    whole = np.rint(noise((10, 11, 12), 100.0))
    look = transfer(((0.0, 0.0), (100.0, 0.3)), shading=True)
    right, _ = _both(bench, whole.astype(np.float64), look)
    drawn, paper = zip(*(_both(bench, whole.astype(name), look) for name in TYPES), strict=True)
    return [check(f"{len(TYPES)} types", drawn, right, 0.0, paper)]


@SAMPLES.case(
    "dynamic-range",
    "values from 1e−38 to 1e38, and to ±1.8e308, in one volume",
    "8³ voxels, a step of opacity; shaded and not",
    "opacity of the picture of the same voxels as 0 and 1, bit for bit",
)
def _dynamic_range(bench: Bench) -> Iterator[Check]:
    rng = np.random.default_rng(38)
    exponent = rng.uniform(-38.0, 38.0, (8, 8, 8))
    cases = (
        ("float32, 1e±38", (10.0**exponent).astype(np.float32), 1.0),
        ("both signs", (np.sign(exponent) * 10.0 ** np.abs(exponent)).astype(np.float32), 0.0),
        ("float64, 1e±308", np.sign(exponent) * 10.0 ** (308.0 * np.abs(exponent) / 38.0), 0.0),
        ("largest numbers", np.where(exponent > 0, np.finfo(np.float64).max, np.finfo(np.float64).min), 0.0),
    )
    for name, samples, edge in cases:
        # a step at `edge`: values above it have opacity 0.2; the exact image is that of 0 and 1
        look = Transfer(points=((edge, 0.0), (edge, 0.2)), window=(-1.0, 1.0) if edge == 0 else (0.0, 1.0))
        plain = Transfer(points=((0.5, 0.0), (0.5, 0.2)), window=(-1.0, 1.0), shading=False)
        flat = Transfer(look.points, window=look.window, shading=False)
        right, _ = map(alpha, _both(bench, (samples >= edge).astype(np.uint8), plain))
        drawn, paper = map(alpha, _both(bench, samples, flat))
        yield check(name, drawn, right, 0.0, paper)
        # shaded: no gradient direction may be lost to overflow; light is at least its ambient part
        shaded, _ = map(alpha, _both(bench, samples, look))
        yield check(f"{name}, shaded", shaded, right, 0.0)


def _steep(dtype: str, scale: float, bench: Bench) -> list[Check]:
    """A shaded ramp as steep as its type allows: lighting must equal that of a gentle ramp."""
    _, _, x = np.mgrid[0:6, 0:6, 0:6]
    ramp = (x - 2.5) / 2.5
    right, _ = _both(bench, ramp, Transfer(points=((-1.0, 0.2), (1.0, 0.2))))
    drawn, paper = _both(bench, (ramp * scale).astype(dtype), Transfer(points=((-scale, 0.2), (scale, 0.2))))
    return [check(f"{dtype}, ±{scale:g}", drawn, right, 1e-6, paper)]


for _bits, _limit, _extreme in (
    (32, "3e38", "differences of neighbours that overflow float32"),
    (64, "1.7e308", "a window that overflows float64"),
):
    SAMPLES.case(
        f"steep-ramp-{_bits}",
        _extreme,
        f"6³ voxels, a ramp from −{_limit} to {_limit}, shaded",
        "the picture of the ramp from −1 to 1",
    )(partial(_steep, f"float{_bits}", float(_limit)))


@SAMPLES.case(
    "denormals",
    "values that are multiples of 1.4e−45 (float32) and 5e−324 (float64)",
    "8³ voxels, a ramp, shaded",
    "the picture of the ramp 0, 1, 2, …",
)
def _denormals(bench: Bench) -> Iterator[Check]:
    _, _, x = np.mgrid[0:8, 0:8, 0:8]
    right, _ = _both(bench, x.astype(np.float64), transfer(((0.0, 0.0), (8.0, 0.4)), shading=True))
    for name, least in DENORMALS:
        look = transfer(((0.0, 0.0), (8 * least, 0.4)), shading=True)
        drawn, paper = _both(bench, (x * least).astype(name), look)
        yield check(f"{name}, multiples of {least:.1g}", drawn, right, 1e-6, paper)


@SAMPLES.case(
    "broken-samples",
    "NaN, +Inf, −Inf, and slices of nothing else",
    "9×10×11 voxels, a tenth of them broken; one whole slice; everything",
    "the picture without those voxels",
)
def _broken(bench: Bench) -> Iterator[Check]:
    look = transfer(((0.0, 0.0), (1.0, 0.4)))
    clean = noise((9, 10, 11), 0.9).astype(np.float32) + np.float32(0.1)
    holes = np.random.default_rng(3).uniform(size=clean.shape) < 0.1
    right, _ = _both(bench, np.where(holes, np.float32(0), clean), look)
    for name, value in (("NaN", np.nan), ("+Inf", np.inf), ("−Inf", -np.inf)):
        drawn, paper = _both(bench, np.where(holes, np.float32(value), clean), look)
        yield check(name, drawn, right, 0.0, paper)
    # a slice of NaN is a gap; gradients of its neighbours use only finite samples
    ramp = np.broadcast_to(np.arange(9, dtype=np.float32)[None, None, :] / 8, (8, 8, 9)).copy()
    gap = ramp.copy()
    gap[4] = np.nan
    shaded = transfer(((-1.0, 0.4), (1.0, 0.4)), shading=True)
    whole, cut = voxels(Volume(ramp), shaded), voxels(Volume(gap), shaded)
    normals = cut.records["normal"].astype(np.float64) - whole.records["normal"][whole.positions[:, 2] != 4]
    yield check("gradients at a gap", normals, 0.0, 0.0)
    camera = _orbit(Volume(ramp))
    right = bench.draw(dots(cut.positions, cut.depths, cut.colors), camera)
    drawn, paper = bench.both(cut, camera, shading="off")
    yield check("an all-NaN slice", drawn, right, 1e-6, paper)
    drawn, paper = _both(bench, np.full((3, 4, 5), np.nan), look)
    yield check("all NaN", drawn, 0.0, 0.0, paper)


@SAMPLES.case(
    "tiny-volumes",
    "1×1×1, 1×N×N, N×1×1, empty, one value only",
    "4 voxels a pixel of parallel rays",
    "closed form: 1 − exp(−τ Σ F(d)); the background",
)
def _tiny(bench: Bench) -> Iterator[Check]:
    shape = kernel("crawfis-max")
    tau = -np.log1p(-0.4)
    look = transfer(((0.0, 0.0), (1.0, 0.4)), unit=1.0)
    camera = parallel(0.25, (33, 33))
    across, down = np.meshgrid(*camera.slopes())
    for size in ((1, 1, 1), (1, 5, 4), (5, 1, 4), (5, 4, 1)):
        origin = (-(size[0] - 1) / 2, -(size[1] - 1) / 2, -(size[2] - 1) / 2)
        splats = voxels(Volume(np.ones(size[::-1], np.uint8), origin=origin), look)
        x, y = (np.arange(n) - (n - 1) / 2 for n in size[:2])
        distance = np.hypot(across[..., None, None] - x[:, None], down[..., None, None] - y)
        right = -np.expm1(-tau * size[2] * shape.footprint(distance).sum(axis=(2, 3)))
        drawn, paper = map(alpha, bench.both(splats, camera))
        yield check("×".join(map(str, size)), drawn, right, SHAPE_BOUND, paper)
    background = (0.2, 0.3, 0.4)
    empty = voxels(Volume(np.zeros((3, 3, 3), np.uint8)), look)
    drawn = bench.draw(empty, _orbit(Volume(np.zeros((3, 3, 3)))), background=background)
    ground = np.array([*background, 1.0]).astype(np.float32)
    yield check("nothing in it", drawn, ground, 0.0)
    # one value: no range to stretch, no gradient to shade by
    drawn, paper = _both(bench, np.full((3, 3, 3), 7.0), Transfer(points=((7.0, 0.4),)))
    plain, _ = _both(bench, np.ones((3, 3, 3)), Transfer(points=((1.0, 0.4),), shading=False))
    yield check("one value", drawn, plain, 0.0, paper)


SPACE = Group()
SHAPE = (14, 12, 10)
# a scene in other units has the same values except for roundings of float64 and a few of float32
SAME = 1e-5
# exact splats are accurate to second order in (kernel's depth)/(its distance): here 1/30
FEW_PIXELS_BOUND = 1e-3
# here 1/2: the bound is 5 levels of 255
NEAR_BOUND = 5 / 255
# of samples.transpose(1, 2, 0): index x runs along z, y along x, z along y
RENAMED = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])


def _picture(bench: Bench, volume: Volume, rotate: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """(drawn, paper) from 1.6 diagonals of the volume's box away, all rotated."""
    rotate = np.eye(3) if rotate is None else rotate
    box = volume.world_from_index @ np.array(volume.shape[::-1], np.float64)
    size = float(np.linalg.norm(box))
    eye = volume.center + rotate @ np.array([0.7, -1.3, 0.6]) * size
    camera = Camera.look_at(eye, volume.center, rotate @ np.array([0.0, 0.0, 1.0]), 36.0, SIZE)
    return bench.both(voxels(volume, transfer(shading=True)), camera)


def _same(bench: Bench, name: str, volume: Volume, right: Volume) -> Check:
    drawn, paper = _picture(bench, volume)
    return check(name, drawn, _picture(bench, right)[0], SAME, paper)


def _volume(spacing: Triple = (1.0, 1.0, 1.0), origin: Triple = (0.0, 0.0, 0.0)) -> Volume:
    return Volume(noise(SHAPE, 0.4), spacing, origin)


@SPACE.case(
    "spacing-scale",
    "voxels of 1e−9 and 1e9 world units",
    "14×12×10 random voxels, shaded, cubic or 1:1.3:0.6, 48×48 pixels",
    "the picture with spacing 1",
)
def _scale(bench: Bench) -> Iterator[Check]:
    for size in (1e-9, 1e9):
        yield _same(bench, f"spacing {size:.0e}", _volume((size,) * 3), _volume())
        box = (size, 1.3 * size, 0.6 * size)
        yield _same(bench, f"{size:.0e}, not cubic", _volume(box), _volume((1.0, 1.3, 0.6)))


@SPACE.case(
    "spacing-1-1000",
    "voxels a thousand times as long as wide",
    "one splat on 12 rays; 12×12×4 voxels seen flat and edge on",
    "closed form: F(D)/|S⁻¹d̂|; float64 reference",
)
def _flat_voxels(bench: Bench) -> Iterator[Check]:
    shape = kernel("crawfis-max")
    spacing = np.array([1.0, 1.0, 1000.0])
    mean = 10.0
    rows = []
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
            right = float(shape.footprint(np.asarray(distance))) / np.linalg.norm(along) / mean
            drawn, paper = bench.both(dot, camera, blend="xray", antialias="off")
            rows.append((drawn[0, 0, 3], right, paper[0, 0, 3]))
    yield check_rows("one voxel", rows, SHAPE_BOUND * max(float(right) for _, right, _ in rows))
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
        drawn, exact = (draw(splats, camera, attenuation="optical-depth") for draw in (bench.draw, bench.truth))
        yield check(f"volume {name}", drawn, exact, bound, bench.paper(splats, camera))


@SPACE.case(
    "world-offset",
    "origins of 1e7 and 1e9, where float32 steps by 1 and 64",
    "14×12×10 random voxels, shaded, 48×48 pixels",
    "the picture at the origin",
)
def _offsets(bench: Bench) -> Iterator[Check]:
    for far in (1e7, 1e9):
        for name, origin in (("x, y, z", (far, -far, far)), ("x", (far, 0.0, 0.0))):
            yield _same(bench, f"{far:.0e} along {name}", _volume(origin=origin), _volume())


@SPACE.case(
    "directions",
    "axes that run backwards, turned grids, renamed axes",
    "the same samples stored otherwise, or all of it turned with the eye",
    "the picture of the plain volume",
)
def _directions(bench: Bench) -> Iterator[Check]:
    samples = noise(SHAPE, 0.4)
    right, _ = _picture(bench, Volume(samples))
    last = np.array(samples.shape[::-1]) - 1.0
    # a reversed axis, with a negative direction
    for axis, name in enumerate("xyz"):
        flip = np.eye(3)
        flip[axis, axis] = -1.0
        flipped = Volume(np.flip(samples, 2 - axis), origin=tuple(np.eye(3)[axis] * last), direction=flip)
        drawn, paper = _picture(bench, flipped)
        yield check(f"−{name}", drawn, right, SAME, paper)
    # rotation of volume and eye
    q, _ = np.linalg.qr(np.random.default_rng(12).normal(size=(3, 3)))
    rotation = np.asarray(q * np.sign(np.linalg.det(q)))
    volume = Volume(samples, origin=(3.0, -2.0, 1.0), direction=rotation)
    drawn, paper = _picture(bench, volume, rotation)
    yield check("turned", drawn, right, SAME, paper)
    # axes permuted: z, y, x read as x, z, y
    volume = Volume(np.ascontiguousarray(samples.transpose(1, 2, 0)), direction=RENAMED)
    drawn, paper = _picture(bench, volume)
    # overlapping splats of a plane are drawn in another order, which affects colours but not opacity
    yield check("axes renamed, opacity", alpha(drawn), alpha(right), SAME, alpha(paper))

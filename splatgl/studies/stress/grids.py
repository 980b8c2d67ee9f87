"""Stress cases of grids: sample types, spacings and axes."""

from __future__ import annotations

import numpy as np

from splatgl.data.volume import Triple, Volume
from splatgl.splat.camera import Camera
from splatgl.splat.kernels import kernel
from splatgl.splat.transfer import Transfer
from splatgl.studies.stress.case import Bench, Case, Check, alpha, check, dots, noise, parallel, transfer, voxels

SIZE = (48, 48)
TYPES = ("uint8", "int16", "uint16", "int32", "float16", "float32", "float64", ">i2", ">f4", "int64")
PICTURE_BOUND = 1e-4
SHAPE_BOUND = 2e-5
# the smallest numbers of either type
DENORMALS = (("float32", float(np.finfo(np.float32).smallest_subnormal)), ("float64", 5e-324))


def _orbit(volume: Volume, size: tuple[int, int] = SIZE) -> Camera:
    return Camera.orbit(volume, azimuth=33, elevation=21, size=size)


def _drawn(bench: Bench, volume: Volume, look: Transfer) -> tuple[np.ndarray, np.ndarray]:
    splats, camera = voxels(volume, look), _orbit(volume)
    return bench.draw(splats, camera), bench.paper(splats, camera)


def types(bench: Bench) -> list[Check]:
    """Checks that whole numbers give the picture of float64 in all of TYPES, bit for bit."""
    whole = np.rint(noise((10, 11, 12), 100.0))
    look = transfer(((0.0, 0.0), (100.0, 0.3)), shading=True)
    right, _ = _drawn(bench, Volume(whole.astype(np.float64)), look)
    found = [_drawn(bench, Volume(whole.astype(name)), look) for name in TYPES]
    # equal numbers must give the same image, bit for bit
    return [check(f"{len(TYPES)} types", [own for own, _ in found], right, 0.0, [old for _, old in found])]


def dynamic_range(bench: Bench) -> list[Check]:
    """Checks the opacity of a step among values of very different size, shaded and not, bit for bit."""
    rng = np.random.default_rng(38)
    exponent = rng.uniform(-38.0, 38.0, (8, 8, 8))
    cases = (
        ("float32, 1e±38", (10.0**exponent).astype(np.float32), 1.0),
        ("both signs", (np.sign(exponent) * 10.0 ** np.abs(exponent)).astype(np.float32), 0.0),
        ("float64, 1e±308", np.sign(exponent) * 10.0 ** (308.0 * np.abs(exponent) / 38.0), 0.0),
        ("largest numbers", np.where(exponent > 0, np.finfo(np.float64).max, np.finfo(np.float64).min), 0.0),
    )
    checks = []
    for name, samples, edge in cases:
        # a step at `edge`: values above it have opacity 0.2; the exact image is that of 0 and 1
        look = Transfer(points=((edge, 0.0), (edge, 0.2)), window=(-1.0, 1.0) if edge == 0 else (0.0, 1.0))
        plain = Transfer(points=((0.5, 0.0), (0.5, 0.2)), window=(-1.0, 1.0), shading=False)
        over = Volume((samples >= edge).astype(np.uint8))
        flat = Transfer(look.points, window=look.window, shading=False)
        right, _ = _drawn(bench, over, plain)
        found, old = _drawn(bench, Volume(samples), flat)
        checks.append(check(name, alpha(found), alpha(right), 0.0, alpha(old)))
        # shaded: no gradient direction may be lost to overflow; light is at least its ambient part
        shaded, _ = _drawn(bench, Volume(samples), look)
        checks.append(check(f"{name}, shaded", alpha(shaded), alpha(right), 0.0))
    return checks


def _steep(bench: Bench, dtype: str, scale: float) -> list[Check]:
    """A shaded ramp as steep as its type allows: lighting must equal that of a gentle ramp."""
    _, _, x = np.mgrid[0:6, 0:6, 0:6]
    ramp = (x - 2.5) / 2.5
    right, _ = _drawn(bench, Volume(ramp), Transfer(points=((-1.0, 0.2), (1.0, 0.2))))
    look = Transfer(points=((-scale, 0.2), (scale, 0.2)))
    found, old = _drawn(bench, Volume((ramp * scale).astype(dtype)), look)
    return [check(f"{dtype}, ±{scale:g}", found, right, 1e-6, old)]


def denormals(bench: Bench) -> list[Check]:
    """Checks shaded ramps of the smallest numbers against the ramp 0, 1, 2, …."""
    _, _, x = np.mgrid[0:8, 0:8, 0:8]
    checks = []
    right, _ = _drawn(bench, Volume(x.astype(np.float64)), transfer(((0.0, 0.0), (8.0, 0.4)), shading=True))
    for name, least in DENORMALS:
        volume = Volume((x * least).astype(name))
        found, old = _drawn(bench, volume, transfer(((0.0, 0.0), (8 * least, 0.4)), shading=True))
        checks.append(check(f"{name}, multiples of {least:.1g}", found, right, 1e-6, old))
    return checks


def broken(bench: Bench) -> list[Check]:
    """Checks that voxels of NaN and ±Inf leave gaps and do not affect their neighbours' gradients."""
    look = transfer(((0.0, 0.0), (1.0, 0.4)))
    clean = noise((9, 10, 11), 0.9).astype(np.float32) + np.float32(0.1)
    holes = np.random.default_rng(3).uniform(size=clean.shape) < 0.1
    emptied = np.where(holes, np.float32(0), clean)
    right, _ = _drawn(bench, Volume(emptied), look)
    checks = []
    for name, value in (("NaN", np.nan), ("+Inf", np.inf), ("−Inf", -np.inf)):
        found, old = _drawn(bench, Volume(np.where(holes, np.float32(value), clean)), look)
        checks.append(check(name, found, right, 0.0, old))

    # a slice of NaN is a gap; gradients of its neighbours use only finite samples
    ramp = np.broadcast_to(np.arange(9, dtype=np.float32)[None, None, :] / 8, (8, 8, 9)).copy()
    gap = ramp.copy()
    gap[4] = np.nan
    shaded = transfer(((-1.0, 0.4), (1.0, 0.4)), shading=True)
    whole, cut = voxels(Volume(ramp), shaded), voxels(Volume(gap), shaded)
    kept = whole.positions[:, 2] != 4
    normals = cut.records["normal"].astype(np.float64) - whole.records["normal"][kept]
    checks.append(check("gradients at a gap", normals, 0.0, 0.0))
    camera = _orbit(Volume(ramp))
    without = dots(cut.positions, cut.depths, cut.colors)
    drawn, right = bench.draw(cut, camera, shading="off"), bench.draw(without, camera)
    checks.append(check("an all-NaN slice", drawn, right, 1e-6, bench.paper(cut, camera, shading="off")))
    nothing = _drawn(bench, Volume(np.full((3, 4, 5), np.nan)), look)
    checks.append(check("all NaN", nothing[0], 0.0, 0.0, nothing[1]))
    return checks


def tiny(bench: Bench) -> list[Check]:
    """Checks volumes of very few voxels, empty ones and constant ones."""
    shape = kernel("crawfis-max")
    tau = -np.log1p(-0.4)
    look = transfer(((0.0, 0.0), (1.0, 0.4)), unit=1.0)
    camera = parallel(0.25, (33, 33))
    across, down = np.meshgrid(*camera.slopes())
    checks = []
    for name, size in (("1×1×1", (1, 1, 1)), ("1×5×4", (1, 5, 4)), ("5×1×4", (5, 1, 4)), ("5×4×1", (5, 4, 1))):
        volume = Volume(
            np.ones(size[::-1], np.uint8), origin=(-(size[0] - 1) / 2, -(size[1] - 1) / 2, -(size[2] - 1) / 2)
        )
        splats = voxels(volume, look)
        x, y = (np.arange(n) - (n - 1) / 2 for n in size[:2])
        distance = np.hypot(across[..., None, None] - x[:, None], down[..., None, None] - y)
        right = -np.expm1(-tau * size[2] * shape.footprint(distance).sum(axis=(2, 3)))
        drawn, old = bench.draw(splats, camera), bench.paper(splats, camera)
        checks.append(check(name, alpha(drawn), right, SHAPE_BOUND, alpha(old)))
    background = (0.2, 0.3, 0.4)
    empty = voxels(Volume(np.zeros((3, 3, 3), np.uint8)), look)
    drawn = bench.draw(empty, _orbit(Volume(np.zeros((3, 3, 3)))), background=background)
    ground = np.array([*background, 1.0]).astype(np.float32)
    checks.append(check("nothing in it", drawn, ground, 0.0))
    # one value: no range to stretch, no gradient to shade by
    flat, old = _drawn(bench, Volume(np.full((3, 3, 3), 7.0)), Transfer(points=((7.0, 0.4),)))
    plain, _ = _drawn(bench, Volume(np.ones((3, 3, 3))), Transfer(points=((1.0, 0.4),), shading=False))
    return [*checks, check("one value", flat, plain, 0.0, old)]


SAMPLE_CASES = (
    Case(
        "sample-types",
        "samples of any type and byte order",
        "10×11×12 whole numbers from 0 to 100, shaded: uint8 to int64, float16 to float64, big-endian ones",
        "the picture of float64, bit for bit",
        types,
    ),
    Case(
        "dynamic-range",
        "values from 1e−38 to 1e38, and to ±1.8e308, in one volume",
        "8³ voxels, a step of opacity; shaded and not",
        "opacity of the picture of the same voxels as 0 and 1, bit for bit",
        dynamic_range,
    ),
    Case(
        "steep-ramp-32",
        "differences of neighbours that overflow float32",
        "6³ voxels, a ramp from −3e38 to 3e38, shaded",
        "the picture of the ramp from −1 to 1",
        lambda bench: _steep(bench, "float32", 3e38),
    ),
    Case(
        "steep-ramp-64",
        "a window that overflows float64",
        "6³ voxels, a ramp from −1.7e308 to 1.7e308, shaded",
        "the picture of the ramp from −1 to 1",
        lambda bench: _steep(bench, "float64", 1.7e308),
    ),
    Case(
        "denormals",
        "values that are multiples of 1.4e−45 (float32) and 5e−324 (float64)",
        "8³ voxels, a ramp, shaded",
        "the picture of the ramp 0, 1, 2, …",
        denormals,
    ),
    Case(
        "broken-samples",
        "NaN, +Inf, −Inf, and slices of nothing else",
        "9×10×11 voxels, a tenth of them broken; one whole slice; everything",
        "the picture without those voxels",
        broken,
    ),
    Case(
        "tiny-volumes",
        "1×1×1, 1×N×N, N×1×1, empty, one value only",
        "4 voxels a pixel of parallel rays",
        "closed form: 1 − exp(−τ Σ F(d)); the background",
        tiny,
    ),
)


SHAPE = (14, 12, 10)
# a scene in other units has the same values except for roundings of float64 and a few of float32
SAME = 1e-5
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


SPACE_CASES = (
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

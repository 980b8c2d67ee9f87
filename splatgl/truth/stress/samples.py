"""Sample values of volumes: any type, any range, NaN and infinity, and volumes of very few voxels."""

from __future__ import annotations

import numpy as np

from splatgl.data.volume import Volume
from splatgl.splat.camera import Camera
from splatgl.splat.kernels import kernel
from splatgl.splat.transfer import Transfer
from splatgl.truth.stress.bench import Bench, voxels
from splatgl.truth.stress.case import Case, Check, check
from splatgl.truth.stress.scenes import alpha, dots, noise, parallel, transfer

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


CASES = (
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

"""Single splats drawn by OpenGL against closed forms: footprints, rotation, stretch, path length."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.gl.features import FRAME_BINDING, STYLE_BINDING, frame_block, style_block
from splatgl.gl.program import build, splat_switches
from splatgl.planning.plan import Plan
from splatgl.splat.kernels import kernel
from tests.helpers.noise import scale
from tests.helpers.splatting import SPLATS

NAMES = {"D": "gaussian", "CM": "crawfis-max"}
LEVEL = 255.0


def one_splat(voxel: object, spacing: float = 1.0) -> sg.Splats:
    return sg.Splats.from_points([voxel], [[1, 1, 1]], [1.0], spacing)


@pytest.mark.few(1)
@pytest.mark.parametrize(("align", "row"), [("ray", "row4"), ("grid", "row5")])
@pytest.mark.parametrize("name", NAMES)
def test_pinned_vectors(
    align: str, row: str, name: str, renderer: sg.Renderer, pinned: list[dict], pinned_camera: sg.Camera
) -> None:
    """All 48 voxels within 0.15 level, float32 table."""
    h = kernel(NAMES[name])
    settings = SPLATS.replace(blend="xray", kernel=NAMES[name], align=align)
    for vector in (v for v in pinned if v["kernel"] == name):
        image = renderer.render(one_splat(vector["voxel"]), pinned_camera, settings)
        i, j = vector["pixel"]
        m = max(1.0, vector["voxel"][2] / pinned_camera.z_k(1.0))
        peak = float(h.footprint(np.zeros(()))) / m**2
        assert LEVEL * abs(image.pixels[j, i, 3] - vector[row] * scale(h)) / peak < 0.15


def test_hybrid_switches_at_z_s(renderer: sg.Renderer, pinned: list[dict], pinned_camera: sg.Camera) -> None:
    """Nearer than z_s a hybrid splat is ray-perpendicular bit for bit, beyond it grid-aligned."""
    voxel = (150.0, -120.0, 500.0)
    drawn = {
        name: renderer.render(one_splat(voxel), pinned_camera, SPLATS.replace(blend="xray", **asked)).pixels
        for name, asked in {
            "ray": {"align": "ray"},
            "grid": {"align": "grid"},
            "near": {"align": "hybrid", "z_s": 501.0},
            "far": {"align": "hybrid", "z_s": 499.0},
        }.items()
    }
    assert (drawn["near"] == drawn["ray"]).all()
    assert (drawn["far"] == drawn["grid"]).all()
    assert (drawn["ray"] != drawn["grid"]).any()


@pytest.mark.parametrize("align", ["ray", "grid"])
@pytest.mark.parametrize("direction", [np.eye(3), np.array([[0.8, -0.6, 0.3], [0.6, 0.8, 0], [0, 0, 1.7]])])
def test_corners_by_transform_feedback(align: str, direction: np.ndarray, renderer: sg.Renderer) -> None:
    """The vertex shader's corners equal float64 within 1e−6 of the quad's distance: the rotation is its own."""
    volume = sg.Volume(np.ones((5, 6, 7), np.uint8), direction=direction, origin=(-3, 2, 4))
    splats = sg.extract(volume, sg.Transfer([(0, 0.5)], shading=False), classification="pre")
    camera = sg.Camera.look_at((1.0, -9.0, 3.0), (0.5, 3.0, 6.0), (0, 0.2, 1), fov=50, size=(20, 16))
    plan = sg.plan(splats, camera, SPLATS.replace(align=align))
    assert plan.program.seen.antialias
    switches = splat_switches(plan.program)
    ctx = renderer.ctx
    for name in ("FOOTPRINT", "TILED"):  # the fragment shader's alone
        switches.pop(name)
    program = build(ctx, "splat.vert", None, switches, varyings=("corner_eye", "gain"))
    count = len(splats)
    buffers = [ctx.buffer(frame_block(splats, plan).tobytes()), ctx.buffer(style_block(splats, plan).tobytes())]
    records, out = ctx.buffer(splats.records), ctx.buffer(reserve=count * 4 * 16)
    buffers[0].bind_to_uniform_block(FRAME_BINDING)
    buffers[1].bind_to_uniform_block(STYLE_BINDING)
    array = ctx.vertex_array(program, [(records, "4u4 8x/i", "in_first")])
    array.transform(out, vertices=4, instances=count)
    found = np.frombuffer(out.read(), np.float32).reshape(count, 4, 4)
    corners, gains = corners_in_float64(splats, camera, plan, align)
    scale = np.linalg.norm(corners, axis=-1, keepdims=True)
    assert np.abs((found[..., :3] - corners) / scale).max() < 1e-6
    assert np.abs(found[..., 3] / gains - 1).max() < 2e-6
    things: list[Any] = [array, program, records, out, *buffers]
    for thing in things:
        thing.release()


def corners_in_float64(splats: sg.Splats, camera: sg.Camera, plan: Plan, align: str) -> tuple[np.ndarray, np.ndarray]:
    """Corners [N, 4, 3] in eye axes and mean spacings, and gains [N, 1], by an eigen decomposition in numpy.

    The order and signs of an ellipse's axes are free; they are matched by the caller's choice below.
    """
    spacing = splats.grid.mean_spacing
    a = camera.eye_from_world @ splats.grid.world_from_index / spacing
    world = splats.positions @ splats.grid.world_from_index.T + splats.grid.origin
    v = camera.eye_from_points(world) / spacing
    corners, gains = np.empty((len(v), 4, 3)), np.empty((len(v), 1))
    for n, place in enumerate(v):
        u = place / np.linalg.norm(place) if align == "ray" else np.array([0.0, 0.0, 1.0])
        # the rotation that turns forward into u the shortest way (u is never near backward here)
        axis = np.cross([0, 0, 1.0], u)
        skew = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
        turn = np.eye(3) + skew + skew @ skew / (1 + u[2])
        e = turn[:, :2]
        p = camera.extent / camera.size[1] * max(place[2], 0.0)
        if splats.grid.cubic:
            axes, widths = e, np.ones(2)
        else:
            widths, vectors = np.linalg.eigh((e.T @ a) @ (e.T @ a).T)
            widths, vectors = np.sqrt(widths[::-1]), vectors[:, ::-1]
            c = (e.T @ a) @ (e.T @ a).T
            diff, mixed = (c[0, 0] - c[1, 1]) / 2, c[0, 1]
            root = np.hypot(diff, mixed)
            major = np.array([diff + root, mixed] if diff >= 0 else [mixed, root - diff])
            major /= np.linalg.norm(major)
            assert abs(abs(major @ vectors[:, 0]) - 1) < 1e-9
            axes = e @ np.array([[major[0], -major[1]], [major[1], major[0]]])
        size = np.maximum(widths, p)
        gains[n] = 1 / size.prod()
        for corner in range(4):
            signs = np.array([corner & 1, corner >> 1]) * 2 - 1
            # and 1/32 of a pixel more, so that no rasteriser loses a quad between two
            half = plan.kernel.radius * size + camera.extent / camera.size[1] * max(place[2], 0.0) / 32
            corners[n, corner] = place + axes @ (signs * half)
    return corners, gains


@pytest.mark.parametrize("name", ["gaussian", "crawfis-max"])
@pytest.mark.parametrize("pixel", [0.5, 1.5, 4.0, 16.0])
def test_orthographic_footprint(name: str, pixel: float, renderer: sg.Renderer) -> None:
    """One voxel at 0.5 … 16 voxels a pixel: F(d/m)/m² within 0.15 level at every pixel centre."""
    h = kernel(name)
    offset = np.array([0.31, -0.17]) * pixel
    camera = sg.Camera.orthographic((*offset, -50), (*offset, 0), (0, -1, 0), 32 * pixel, (32, 32))
    image = renderer.render(one_splat((0, 0, 0)), camera, SPLATS.replace(blend="xray", kernel=name))
    x, y = camera.slopes()
    m = max(1.0, pixel)
    right = h.footprint(np.hypot(x[None, :] + offset[0], y[:, None] + offset[1]) / m) / m**2
    assert np.abs(image.pixels[..., 3] - right).max() * LEVEL * m**2 < 0.15 * float(h.footprint(np.zeros(())))


@pytest.mark.parametrize(("bits", "bound"), [(32, 0.06), (16, 0.06), (8, 1.5)])
def test_table_bits(bits: int, bound: float, renderer: sg.Renderer) -> None:
    """A wide splat in levels of its peak: 8 bits are really sampled.

    They cost half a level; llvmpipe filters 8-bit texels in 8-bit arithmetic, which costs as much again.
    """
    h = kernel("crawfis-max")
    camera = sg.Camera.orthographic((0, 0, -9), (0, 0, 0), (0, -1, 0), 4.0, (200, 200))
    settings = SPLATS.replace(blend="xray", footprint="table", table_bits=bits)
    image = renderer.render(one_splat((0, 0, 0)), camera, settings)
    x, y = camera.slopes()
    right = h.footprint(np.hypot(x[None, :], y[:, None]))
    worst = LEVEL * np.abs(image.pixels[..., 3] - right).max() / right.max()
    assert bound / 5 < worst < bound


@pytest.mark.parametrize(("name", "bound"), [("crawfis-max", 0.011), ("gaussian", 0.045)])
@pytest.mark.parametrize("pixel", [1 / 16, 1 / 4, 1.0, 1.1, 2.0, 4.0])
def test_constant_volume_orthographic(name: str, bound: float, pixel: float, renderer: sg.Renderer) -> None:
    """Extinction × path length, voxels 16 … 1/4 pixels wide."""
    n, sigma = 24, 0.3
    volume = sg.Volume(np.ones((n, n, n), np.uint8))
    splats = sg.extract(volume, sg.Transfer([(0, -np.expm1(-sigma))], unit=1.0, shading=False), classification="pre")
    middle = (n - 1) / 2
    camera = sg.Camera.orthographic((middle, middle, -60), (middle, middle, 0), (0, -1, 0), 16 * pixel, (16, 16))
    image = renderer.render(splats, camera, SPLATS.replace(blend="xray", kernel=name))
    x, y = camera.slopes()
    inside = np.maximum(np.abs(x[None, :]), np.abs(y[:, None])) < n / 2 - 2 * max(1, pixel)
    assert inside.any()
    assert np.abs(image.pixels[inside, 3] / (sigma * n) - 1).max() < bound


@pytest.mark.parametrize(("name", "bound"), [("crawfis-max", 0.011), ("gaussian", 0.045)])
@pytest.mark.parametrize("distance", [80.0, 200.0])
def test_constant_volume_perspective(name: str, bound: float, distance: float, renderer: sg.Renderer) -> None:
    """Rays at a slant keep their path length with ray-perpendicular splats; grid-aligned ones lose cos θ."""
    n, sigma = 40, 0.1
    volume = sg.Volume(np.ones((n, n, n), np.uint8))
    splats = sg.extract(volume, sg.Transfer([(0, -np.expm1(-sigma))], unit=1.0, shading=False), classification="pre")
    middle = np.full(3, (n - 1) / 2)
    eye = middle + np.array([0.0, -0.55, -1.0]) * distance
    camera = sg.Camera.look_at(eye, (middle[0], eye[1], middle[2]), (0, -1, 0), fov=70, size=(96, 96))
    length, margin = box_chords(camera, np.full(3, -0.5), np.full(3, n - 0.5), (distance / camera.z_k(1.0)))
    inside = margin & (length > 8)
    assert inside.sum() > 20
    drawn = {
        align: renderer.render(splats, camera, SPLATS.replace(blend="xray", kernel=name, align=align)).pixels[..., 3]
        for align in ("ray", "grid")
    }
    ratio = {align: drawn[align][inside] / (sigma * length[inside]) for align in drawn}
    assert np.abs(ratio["ray"] - 1).max() < bound
    x, y = camera.slopes()
    cosine = 1 / np.sqrt(1 + x[None, :] ** 2 + y[:, None] ** 2)
    assert np.abs(ratio["grid"] / cosine[inside] - 1).max() < bound + 0.01
    print(f"grid: {ratio['grid'].min():.3f} … {ratio['grid'].max():.3f}, cos θ from {cosine[inside].min():.3f}")


def box_chords(camera: sg.Camera, low: np.ndarray, high: np.ndarray, m: float) -> tuple[np.ndarray, np.ndarray]:
    """Length of each pixel's ray in a box, and whether it enters and leaves 2·max(1, m) from any edge."""
    x, y = camera.slopes()
    ray = np.stack(np.broadcast_arrays(x[None, :], y[:, None], 1.0), axis=-1) @ camera.eye_from_world
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.sort(np.stack([(low - camera.eye) / ray, (high - camera.eye) / ray]), axis=0)
    start, stop = t[0].max(axis=-1), t[1].min(axis=-1)
    length = np.maximum(stop - start, 0)
    keep = length > 0
    for end in (start, stop):
        point = camera.eye + ray * end[..., None]
        # distance to the faces next to the one it passes: the second smallest
        gap = np.sort(np.minimum(point - low, high - point), axis=-1)
        keep &= gap[..., 1] > 2 * max(1.0, m)
    return length, keep

"""`align="exact"`: the true line integral on the GPU, near, far, beside and around the eye."""

from __future__ import annotations

import numpy as np
import pytest
from noise import scale
from splatting import SPLATS

import splatgl as sg
from splatgl.splat.footprint import FORMS, Splat, half_line, row1
from splatgl.splat.kernels import Kernel, kernel

NAMES = {"D": "gaussian", "CM": "crawfis-max"}
LEVEL = 255.0


@pytest.mark.parametrize("form", FORMS)
def test_forms_match_the_pinned_vectors(form: str, pinned: list[dict], pinned_camera: sg.Camera) -> None:
    x, y = pinned_camera.slopes()
    for vector in pinned:
        h = kernel(NAMES[vector["kernel"]])
        i, j = vector["pixel"]
        splat = Splat(h, np.array(vector["voxel"]), np.array([x[i], y[j]]), pinned_camera.z_k(1.0))
        assert float(FORMS[form](splat)) / scale(h) == pytest.approx(vector[form], abs=1e-11)


@pytest.mark.parametrize(
    ("voxel", "right"),
    [((0, 0, 0), 0.626617374643), ((0, 0, 0.5), 1.054429570589), ((0, 0, 1), 1.224761381304),
     ((0, 0, -0.5), 0.198805178697), ((0, 0, -3), 0.0)],
)  # fmt: skip
def test_half_line_values(voxel: tuple, right: float) -> None:
    h = kernel("gaussian")
    found = half_line(h, np.array(voxel, float), np.array([0, 0, 2.0]))
    assert float(found) / scale(h) == pytest.approx(right, abs=1e-11)


@pytest.mark.parametrize("name", NAMES)
def test_pinned_vectors(name: str, renderer: sg.Renderer, pinned: list[dict], pinned_camera: sg.Camera) -> None:
    """All 48 voxels, within 0.03 level of row 1."""
    h = kernel(NAMES[name])
    for vector in (v for v in pinned if v["kernel"] == name):
        splats = sg.Splats.from_points([vector["voxel"]], [[1, 1, 1]], [1.0])
        image = renderer.render(splats, pinned_camera, SPLATS.but(blend="xray", kernel=NAMES[name], tolerance=1e-6))
        i, j = vector["pixel"]
        m = max(1.0, vector["voxel"][2] / pinned_camera.z_k(1.0))
        peak = float(h.footprint(np.zeros(()))) / m**2
        assert LEVEL * abs(image.pixels[j, i, 3] - vector["row1"] * scale(h)) / peak < 0.03


def volume_voxels(rng: np.random.Generator, count: int) -> np.ndarray:
    """Voxels of a 512³ volume whose footprints do not touch in a 512² picture, half-angle 30°."""
    found: list[np.ndarray] = []
    places = np.zeros((0, 2))
    while len(found) < count:
        voxel = np.append(rng.integers(-256, 256, 2), rng.uniform(341.005, 853.005))
        place = voxel[:2] / voxel[2] * 443.405 + 256
        inside = (place > 4).all() and (place < 508).all()
        if inside and (len(places) == 0 or np.abs(places - place).max(axis=1).min() > 12):
            found.append(voxel)
            places = np.vstack([places, place])
    return np.array(found)


@pytest.mark.few(1)
@pytest.mark.parametrize("name", ["gaussian", "crawfis-max"])
def test_two_thousand_voxels(name: str, renderer: sg.Renderer, pinned_camera: sg.Camera) -> None:
    """Within 0.03 level of row 1 at every pixel, corners included; ray and grid are printed beside it."""
    h, rng = kernel(name), np.random.default_rng(20)
    worst = {"exact": 0.0, "ray": 0.0, "grid": 0.0}
    for _ in range(10):
        voxels = volume_voxels(rng, 200)
        i, j, right, peak = single_footprints(h, voxels, pinned_camera)
        splats = sg.Splats.from_points(voxels, np.ones_like(voxels), np.ones(len(voxels)))
        for align in worst:
            image = renderer.render(splats, pinned_camera, SPLATS.but(blend="xray", kernel=name, align=align))
            levels = LEVEL * np.abs(image.pixels[j, i, 3] - right) / peak
            worst[align] = max(worst[align], float(levels.max()))
    print(f"{name}: levels at worst {worst}")
    assert worst["exact"] < 0.03
    assert worst["ray"] > 1
    assert worst["grid"] > 20


def single_footprints(h: Kernel, voxels: np.ndarray, camera: sg.Camera) -> tuple[np.ndarray, ...]:
    """Columns, rows, row 1 and peaks of the pixels within 6 of each voxel's centre; footprints must not touch."""
    pitch = camera.extent / camera.size[1]
    middle = np.floor(voxels[:, :2] / voxels[:, 2:] / pitch + 256).astype(int)
    around = np.stack(np.meshgrid(np.arange(-6, 7), np.arange(-6, 7)), axis=-1).reshape(-1, 2)
    pixel = middle[:, None] + around[None]
    keep = ((pixel >= 0) & (pixel < 512)).all(axis=-1)
    voxel = np.broadcast_to(voxels[:, None], (*pixel.shape[:2], 3))[keep]
    pixel = pixel[keep]
    x, y = camera.slopes()
    splat = Splat(h, voxel, np.stack([x[pixel[:, 0]], y[pixel[:, 1]]], axis=-1), camera.z_k(1.0))
    return pixel[:, 0], pixel[:, 1], row1(splat), float(h.footprint(np.zeros(()))) / splat.m**2


@pytest.mark.few(1)
@pytest.mark.parametrize("name", ["gaussian", "crawfis-max"])
def test_voxels_around_the_eye(name: str, renderer: sg.Renderer) -> None:
    """500 voxels 0.1 … 20 from the eye, some behind its plane: within 0.05 level of the half-line integral."""
    h, rng = kernel(name), np.random.default_rng(21)
    camera = sg.Camera.look_at((0, 0, 0), (0, 0, 1), (0, -1, 0), 60, (64, 64))
    x, y = camera.slopes()
    rays = np.stack(np.broadcast_arrays(x[None, :], y[:, None], 1.0), axis=-1)
    worst, behind = 0.0, 0
    for _ in range(500):
        direction = rng.normal(size=3)
        voxel = direction / np.linalg.norm(direction) * 20 * rng.random() ** 2 + 0.1 * direction
        behind += voxel[2] < 0
        splats = sg.Splats.from_points([voxel], [[1, 1, 1]], [1.0])
        image = renderer.render(splats, camera, SPLATS.but(blend="xray", kernel=name, align="exact", antialias="off"))
        right = half_line(h, voxel, rays)
        worst = max(worst, float(np.abs(image.pixels[..., 3] - right).max()) * LEVEL)
    print(f"{name}: {worst / float(h.footprint(np.zeros(()))):.4f} level at worst, {behind} voxels behind the plane")
    assert behind > 100
    assert worst < 0.05 * float(h.footprint(np.zeros(())))


def test_half_lines_only_near_the_eye(renderer: sg.Renderer) -> None:
    splats = sg.extract(sg.Volume(np.ones((9, 9, 9))), sg.Transfer([(0, 0.3)]), classification="pre")
    inside = sg.Camera.look_at((4, 4, 4), (4, 4, 9), (0, 1, 0), 60, (16, 16))
    outside = sg.Camera.look_at((4, 4, -20), (4, 4, 9), (0, 1, 0), 60, (16, 16))
    assert sg.plan(splats, inside, SPLATS).program.seen.half_line
    assert not sg.plan(splats, outside, SPLATS).program.seen.half_line


def test_forcing_half_lines_changes_nothing_far_away(renderer: sg.Renderer) -> None:
    splats = sg.extract(sg.Volume(np.ones((9, 9, 9))), sg.Transfer([(0, 0.3)]), classification="pre")
    camera = sg.Camera.look_at((4, 4, -20), (4, 4, 9), (0, 1, 0), 60, (32, 32))
    chosen = sg.plan(splats, camera, SPLATS)
    plain = renderer.passes.draw(splats, chosen.forced(technique="quads"))
    forced = renderer.passes.draw(splats, chosen.forced(half_line=True))
    assert (plain == forced).all()

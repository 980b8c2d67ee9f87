"""`align="exact"`: the true line integral on the GPU, near, far, beside and around the eye, and on any grid."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from paper.forms import FORMS, half_line

import splatgl as sg
from splatgl.data.scenes import SCENES
from splatgl.splat.footprint import Splat, row1
from splatgl.splat.kernels import Kernel, kernel
from tests.helpers.noise import scale
from tests.helpers.splatting import SPLATS, each_two

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
        image = renderer.render(splats, pinned_camera, SPLATS.replace(blend="xray", kernel=NAMES[name], tolerance=1e-6))
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
            image = renderer.render(splats, pinned_camera, SPLATS.replace(blend="xray", kernel=name, align=align))
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
    """150 voxels 0.1 … 20 from the eye, some behind its plane: within 0.05 level of the half-line integral."""
    h, rng = kernel(name), np.random.default_rng(21)
    camera = sg.Camera.look_at((0, 0, 0), (0, 0, 1), (0, -1, 0), 60, (20, 20))
    x, y = camera.slopes()
    rays = np.stack(np.broadcast_arrays(x[None, :], y[:, None], 1.0), axis=-1)
    worst, behind = 0.0, 0
    for _ in range(150):
        direction = rng.normal(size=3)
        voxel = direction / np.linalg.norm(direction) * 20 * rng.random() ** 2 + 0.1 * direction
        behind += voxel[2] < 0
        splats = sg.Splats.from_points([voxel], [[1, 1, 1]], [1.0])
        image = renderer.render(
            splats, camera, SPLATS.replace(blend="xray", kernel=name, align="exact", antialias="off")
        )
        right = half_line(h, voxel, rays)
        worst = max(worst, float(np.abs(image.pixels[..., 3] - right).max()) * LEVEL)
    print(f"{name}: {worst / float(h.footprint(np.zeros(()))):.4f} level at worst, {behind} voxels behind the plane")
    assert behind > 30
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
    plain = renderer.passes.draw(splats, chosen.with_choices(technique="quads"))
    forced = renderer.passes.draw(splats, chosen.with_choices(half_line=True))
    assert (plain == forced).all()


# --- against the float64 reference ------------------------------------------------------------------------------------


DATA = Path(os.environ.get("SPLATGL_DATA", Path(__file__).parents[3] / "shared" / "data"))
SHEAR = np.array([[1.0, 0.35, 0.1], [0.0, 1.0, -0.25], [0.2, 0.0, 1.0]])
GRIDS = {
    "cubic": ((1, 1, 1), np.eye(3)),
    "slices": ((1, 1, 5), np.eye(3)),
    "boxes": ((0.5, 1, 2), np.eye(3)),
    "sheared": ((1, 1.2, 1.5), SHEAR),
}
ALL = slice(None)
# a tolerance for which nothing is left out: footprints are read from the finest table
FINEST = 1e-6
HOT = sg.Transfer([(0, 0), (1, 0.5)], colormap="hot")


def noise(grid: str) -> sg.Splats:
    spacing, direction = GRIDS[grid]
    samples = np.random.default_rng(3).random((12, 13, 14)).astype(np.float32)
    return sg.extract(sg.Volume(samples, spacing=spacing, direction=direction), HOT, classification="pre")


def worst(renderer: sg.Renderer, splats: sg.Splats, camera: sg.Camera, settings: sg.Settings) -> float:
    """Largest difference of either technique from row 1, relative to the largest Σ τ in xray."""
    right = sg.reference.render(splats, camera, settings).pixels
    assert right[..., 3].max() > 0.1
    ways = [settings.replace(technique=name, tolerance=FINEST) for name in ("quads", "tiles")]
    apart = [float(np.abs(renderer.render(splats, camera, way).pixels - right).max()) for way in ways]
    return max(apart) / (float(right.max()) if settings.blend == "xray" else 1.0)


@pytest.mark.turns(2)
@pytest.mark.few(2)
@pytest.mark.parametrize(
    ("grid", "where", "blend"),
    each_two(GRIDS, ("near", "far", "inside", "orthographic"), ("composite", "xray", "mip")),
)
def test_any_grid(grid: str, where: str, blend: str, renderer: sg.Renderer) -> None:
    """Float32's last digits before z_k, inside and in parallel; 3e−5 beyond z_k at an ordinary picture size."""
    splats = noise(grid)
    middle = splats.corners.mean(axis=0)
    camera = {
        "near": sg.Camera.orbit(splats, 30, 20, size=(96, 96), fov=60),
        "far": sg.Camera.orbit(splats, 30, 20, size=(192, 192), fov=60, zoom=1 / 8),
        "inside": sg.Camera.look_at(middle + 0.1, middle + np.array([1, 2, 0.3]), (0, 0, 1), 80, (48, 48)),
        "orthographic": sg.Camera.orbit(splats, 30, 20, size=(16, 16)).parallel(splats),
    }[where]
    assert worst(renderer, splats, camera, SPLATS.replace(blend=blend)) < (3e-5 if where == "far" else 8e-6)


@pytest.mark.few(2)
@pytest.mark.parametrize("grid", GRIDS)
def test_second_order_beyond_z_k(grid: str, renderer: sg.Renderer) -> None:
    """Halving the picture at the same scale of voxels quarters z_k² …: the error falls with 1/z_k² or faster."""
    splats = noise(grid)
    errors = []
    for size in (24, 48, 96):
        camera = sg.Camera.orbit(splats, 30, 20, size=(size, size), fov=60, zoom=16 / size)
        errors.append(worst(renderer, splats, camera, SPLATS))
    assert errors[0] < 2e-3
    assert errors[1] < errors[0] / 3
    assert errors[2] < errors[1] / 3


@pytest.mark.few(1)
@pytest.mark.parametrize("attenuation", ["opacity", "optical-depth", "fill"])
def test_attenuation(attenuation: str, renderer: sg.Renderer) -> None:
    camera = sg.Camera.orbit(noise("boxes"), 50, 10, size=(96, 96), zoom=1 / 8)
    assert worst(renderer, noise("boxes"), camera, SPLATS.replace(attenuation=attenuation)) < 3e-5


@pytest.mark.turns(2)
@pytest.mark.few(4)
@pytest.mark.parametrize(
    ("name", "planes", "blend"),
    [
        pytest.param("tunnel", slice(None, None, 10), "composite", marks=pytest.mark.long),
        *(
            (*subject, blend)
            for blend in ("composite", "xray", "mip")
            for subject in (
                ("tunnel", slice(110, None, 25)),
                ("stent_ct_128x128x256.nrrd", ALL),
                ("neuron_a_409x415x119.tif", ALL),
            )
        ),
    ],
)
def test_scenes(name: str, planes: slice, blend: str, renderer: sg.Renderer) -> None:
    """A built-in scene or some planes of it, a CT and a microscopy volume at 128²: RMSE below 2e−4, maximum below
    3e−3.
    """
    from splatgl.scene.view import ViewOptions

    if name not in SCENES and not (DATA / name).exists():
        pytest.skip(f"{name} is not there")
    volume = SCENES[name]() if name in SCENES else sg.load(DATA / name)
    transfer = sg.default_transfer(volume)
    if planes != ALL:
        some = np.zeros_like(volume.samples)
        some[planes] = volume.samples[planes]
        volume = replace(volume, samples=some)
    splats = sg.extract(volume, transfer, classification="pre")
    camera = ViewOptions(size=(128, 128)).camera(volume, splats)
    settings = SPLATS.replace(blend=blend)
    drawn = renderer.render(splats, camera, settings)
    found = sg.compare(drawn, sg.reference.render(splats, camera, settings))
    print(f"{name} {blend}: RMSE {found.rmse:.1e}, maximum {found.maximum:.1e}")
    scale = float(drawn.pixels.max()) if blend == "xray" else 1.0
    assert drawn.pixels[..., 3].max() > 0.1
    assert found.rmse < 2e-4 * scale
    assert found.maximum < 3e-3 * scale

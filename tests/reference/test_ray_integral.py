"""The volume rendering integral without splats: it converges, and agrees with splatting where that is exact."""

from __future__ import annotations

import numpy as np
import pytest

import splatgl as sg
from splatgl.geometry.view import GridView
from splatgl.reference import march
from splatgl.reference.field import ray_integral
from splatgl.reference.renderer import render
from splatgl.splat.kernels import kernel
from splatgl.splat.line_integral import row1
from tests.helpers.splatting import SPLATS


def random_volume(opacity: float, spacing: tuple[float, float, float] = (1, 1, 1), shading: bool = False) -> sg.Splats:
    samples = np.random.default_rng(2).uniform(-0.5, 1, (6, 7, 8)).clip(0).astype(np.float32)
    volume = sg.Volume(samples, spacing=spacing, origin=(3, 4, -5))
    return sg.extract(
        volume, sg.Transfer([(0, 0), (1, opacity)], colormap="hot", shading=shading), classification="pre"
    )


@pytest.mark.parametrize("spacing", [(1, 1, 1), (0.6, 1, 2.1)])
@pytest.mark.parametrize("parallel", [False, True])
def test_one_splat_is_its_line_integral(spacing: tuple[float, float, float], parallel: bool) -> None:
    """One voxel has nothing to overlap with: the integral is 1 − exp(−τ row1), the eye before it or in it."""
    samples = np.zeros((3, 3, 3))
    samples[1, 1, 1] = 1
    splats = sg.extract(
        sg.Volume(samples, spacing=spacing), sg.Transfer([(0, 0), (1, 0.9)], shading=False), classification="pre"
    )
    middle = splats.grid.world_from_index @ [1, 1, 1]
    for away in (4.0, 0.3):
        camera = sg.Camera.look_at(middle + away * np.array([0.6, -0.7, 0.2]), middle, (0, 0, 1), 60, (6, 5))
        camera = camera.parallel(splats, 2.0) if parallel else camera
        x, y = (slope / (1 if camera.perspective else splats.grid.mean_spacing) for slope in camera.slopes())
        view = GridView.of(splats.grid, camera, kernel("crawfis-max"), antialias=False)
        voxel = view.voxels(splats.positions)[:, :, None]
        value = row1(view, voxel, np.stack(np.broadcast_arrays(x[None, :], y[:, None]))).value
        found = ray_integral(splats, camera, steps_per_voxel=64).pixels[..., 3]
        assert np.abs(found - -np.expm1(-splats.records["optical_depth"].astype(float) * value)).max() < 2e-5
        assert found.max() > 0.3


def test_it_converges_with_the_square_of_the_step() -> None:
    splats = random_volume(0.6)
    camera = sg.Camera.orbit(splats, 30, 20, size=(8, 8))
    steps = (4, 8, 16)
    pictures = [ray_integral(splats, camera, steps_per_voxel=n).pixels for n in (*steps, 64)]
    errors = [np.sqrt(np.mean((picture - pictures[-1]) ** 2)) for picture in pictures[:-1]]
    order = np.log(errors[0] / errors[2]) / np.log(steps[2] / steps[0])
    print(f"rmse {errors} at {steps} steps a voxel: order {order:.2f}")
    assert order > 1.8
    assert errors[1] < 2e-4


def test_thin_fog_is_as_splatting_has_it() -> None:
    """The faster it thins the less it matters what occludes what: splatting's error falls with τ²."""
    camera = sg.Camera.orbit(random_volume(0.5), 30, 20, size=(10, 8))
    errors = []
    for opacity in (0.2, 0.02):
        splats = random_volume(opacity, shading=True)
        asked = SPLATS.replace(antialias="off")
        found = sg.compare(render(splats, camera, asked), ray_integral(splats, camera, asked, steps_per_voxel=16))
        errors.append(found.maximum)
    assert errors[0] < 0.02
    assert errors[1] < errors[0] / 50


def test_alpha_needs_no_order() -> None:
    """Optical depth adds up alike in any order: opacities agree to the quadrature's error, in dense matter too."""
    splats = random_volume(0.95, (0.7, 1, 1.8))
    camera = sg.Camera.orbit(splats, 30, 20, size=(10, 8))
    asked = SPLATS.replace(antialias="off", background=None)
    found, right = ray_integral(splats, camera, asked, 32).pixels, render(splats, camera, asked).pixels
    assert np.abs(found[..., 3] - right[..., 3]).max() < 1e-4


def test_parallel_rays_see_nothing_behind_the_eye() -> None:
    """The eye's plane amid the voxels: those behind it are absent, those before it whole."""
    splats = random_volume(0.3)
    middle = splats.corners.mean(axis=0)
    camera = sg.Camera.orthographic(middle, middle + np.array([0.3, 1, 0.2]), (0, 0, 1), 6, (8, 8))
    asked = SPLATS.replace(antialias="off")
    found, right = ray_integral(splats, camera, asked, 16).pixels, render(splats, camera, asked).pixels
    assert np.abs(found[..., 3] - right[..., 3]).max() < 1e-4
    assert right[..., 3].min() > 0.01


def test_samples_and_background() -> None:
    splats = random_volume(0.5)
    camera = sg.Camera.orbit(splats, 30, 20, size=(6, 4))
    fine = ray_integral(splats, camera.resized((12, 8)), steps_per_voxel=2).pixels
    ground = (0.2, 0.4, 0.6)
    found = ray_integral(splats, camera, SPLATS.replace(background=ground), 2, samples=2).pixels
    mean = fine.reshape(4, 2, 6, 2, 4).mean(axis=(1, 3))
    assert np.abs(found - (mean + (1 - mean[..., 3:]) * [*ground, 1])).max() < 1e-14


def test_what_it_refuses() -> None:
    splats = random_volume(0.5)
    camera = sg.Camera.orbit(splats, size=(4, 4))
    with pytest.raises(sg.InputError, match="ray integral: expected blend composite"):
        ray_integral(splats, camera, SPLATS.replace(blend="mip"))
    with pytest.raises(sg.InputError, match="steps_per_voxel: expected a number of at least 1"):
        ray_integral(splats, camera, steps_per_voxel=0)
    loose = sg.Splats.from_points([(0, 0, 0.25)], [(1, 1, 1)], [1])
    with pytest.raises(sg.InputError, match="splats: expected at most one at each point of a lattice"):
        ray_integral(loose, camera)


def test_empty_space_is_left_out_and_nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two far voxels, and far ones again: what is leapt over between them, as slab by slab."""
    samples = np.zeros((40, 40, 40), np.float32)
    for place in ((3, 4, 5), (20, 21, 19), (21, 21, 19), (37, 36, 38), (36, 5, 20)):
        samples[place] = 0.9
    splats = sg.extract(
        sg.Volume(samples, spacing=(1, 0.8, 1.3)), sg.Transfer([(0, 0), (1, 0.9)], shading=False), classification="pre"
    )
    camera = sg.Camera.orbit(splats, 30, 20, size=(40, 40))
    found = ray_integral(splats, camera, steps_per_voxel=3).pixels
    monkeypatch.setattr(march.Blocks, "free", lambda _, places, *rest: np.zeros(places.shape[1]))
    right = ray_integral(splats, camera, steps_per_voxel=3).pixels
    assert found.max() > 0.3
    np.testing.assert_array_equal(found, right)

"""Exact pictures against the float64 reference: any grid, any blend mode, near, far, inside; real volumes."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from splatting import SPLATS

import splatgl as sg
from splatgl.data.scenes import SCENES

DATA = Path(os.environ.get("SPLATGL_DATA", Path(__file__).parents[2] / "shared" / "data"))
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
    ways = [settings.but(technique=name, tolerance=FINEST) for name in ("quads", "tiles")]
    apart = [float(np.abs(renderer.render(splats, camera, way).pixels - right).max()) for way in ways]
    return max(apart) / (float(right.max()) if settings.blend == "xray" else 1.0)


@pytest.mark.few(2)
@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("blend", ["composite", "xray", "mip"])
@pytest.mark.parametrize("where", ["near", "far", "inside", "orthographic"])
def test_any_grid(grid: str, blend: str, where: str, renderer: sg.Renderer) -> None:
    """Float32's last digits before z_k, inside and in parallel; 3e−5 beyond z_k at an ordinary picture size."""
    splats = noise(grid)
    middle = splats.corners.mean(axis=0)
    camera = {
        "near": sg.Camera.orbit(splats, 30, 20, size=(96, 96), fov=60),
        "far": sg.Camera.orbit(splats, 30, 20, size=(192, 192), fov=60, zoom=1 / 8),
        "inside": sg.Camera.look_at(middle + 0.1, middle + np.array([1, 2, 0.3]), (0, 0, 1), 80, (48, 48)),
        "orthographic": sg.Camera.orbit(splats, 30, 20, size=(16, 16)).parallel(splats),
    }[where]
    assert worst(renderer, splats, camera, SPLATS.but(blend=blend)) < (3e-5 if where == "far" else 8e-6)


@pytest.mark.few(2)
@pytest.mark.parametrize("grid", GRIDS)
def test_second_order_beyond_z_k(grid: str, renderer: sg.Renderer) -> None:
    """Halving the picture at the same scale of voxels quarters z_k² …: the error falls with 1/z_k² or faster."""
    splats = noise(grid)
    errors = []
    for size in (24, 48, 96):
        camera = sg.Camera.orbit(splats, 30, 20, size=(size, size), fov=60, zoom=24 / size)
        errors.append(worst(renderer, splats, camera, SPLATS))
    assert errors[0] < 2e-3
    assert errors[1] < errors[0] / 3
    assert errors[2] < errors[1] / 3


@pytest.mark.few(1)
@pytest.mark.parametrize("attenuation", ["opacity", "optical-depth", "fill"])
def test_attenuation(attenuation: str, renderer: sg.Renderer) -> None:
    camera = sg.Camera.orbit(noise("boxes"), 50, 10, size=(96, 96), zoom=1 / 8)
    assert worst(renderer, noise("boxes"), camera, SPLATS.but(attenuation=attenuation)) < 3e-5


@pytest.mark.few(4)
@pytest.mark.parametrize(
    ("name", "planes"),
    [
        ("tunnel", slice(110, None, 25)),
        pytest.param("tunnel", ALL, marks=pytest.mark.long),
        *(("stent_ct_128x128x256.nrrd", ALL), ("neuron_a_409x415x119.tif", ALL)),
    ],
)
@pytest.mark.parametrize("blend", ["composite", "xray", "mip"])
def test_scenes(name: str, planes: slice, blend: str, renderer: sg.Renderer) -> None:
    """A built-in scene or some planes of it, a CT and a microscopy volume at 256²: RMSE below 2e−4, maximum below
    3e−3.
    """
    from splatgl.scene.view import View

    if name not in SCENES and not (DATA / name).exists():
        pytest.skip(f"{name} is not there")
    volume = SCENES[name]() if name in SCENES else sg.load(DATA / name)
    transfer = sg.default_transfer(volume)
    if planes != ALL:
        some = np.zeros_like(volume.samples)
        some[planes] = volume.samples[planes]
        volume = replace(volume, samples=some)
    splats = sg.extract(volume, transfer, classification="pre")
    camera = View(size=(256, 256)).camera(volume, splats)
    settings = SPLATS.but(blend=blend)
    drawn = renderer.render(splats, camera, settings)
    found = sg.compare(drawn, sg.reference.render(splats, camera, settings))
    print(f"{name} {blend}: RMSE {found.rmse:.1e}, maximum {found.maximum:.1e}")
    scale = float(drawn.pixels.max()) if blend == "xray" else 1.0
    assert drawn.pixels[..., 3].max() > 0.1
    assert found.rmse < 2e-4 * scale
    assert found.maximum < 3e-3 * scale

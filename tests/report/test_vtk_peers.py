"""VTK's ray casters draw the scenes that benchmarks compare with them."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from benchmarks.vtk_peers import MAPPERS, Peer

import splatgl as sg
from splatgl.data.scenes import SCENES
from splatgl.reference.field import field_integral, ray_integral
from tests.helpers.splatting import SPLATS

pytestmark = pytest.mark.usefixtures("shared_programs")


@pytest.mark.long
def test_peers_draw_the_same_scene(tmp_path: Path) -> None:
    pytest.importorskip("vtk")
    volume = sg.scenes.ball(8)
    transfer = sg.Transfer(points=[(0.2, 0.0), (0.2, 0.5), (1.0, 0.5)], window=(0, 1), unit=1.0, shading=False)
    camera = sg.Camera.orbit(volume, azimuth=20, elevation=10, size=(40, 40))
    drawn = ray_integral(sg.extract(volume, transfer, classification="pre"), camera, SPLATS, 2).pixels
    for mapper in MAPPERS:
        with closing(Peer(mapper, (volume, transfer), camera, SPLATS)) as peer:
            image, seconds = peer.frame()
        assert seconds > 0 and image.pixels.shape == drawn.shape
        # the same ball at the same place, its edge aside
        assert np.abs(image.pixels - drawn).mean() < 0.2 * drawn.mean()
        assert np.abs(image.pixels[20, 20] - drawn[20, 20]).max() < 0.05


@pytest.mark.few(1)
@pytest.mark.parametrize("mapper", MAPPERS)
def test_peers_draw_the_trilinear_field(mapper: str) -> None:
    pytest.importorskip("vtk")
    volume = SCENES["balls"]()
    drawn, field = peer_and_field(mapper, volume, sg.default_transfer(volume))
    # measured: 0.023 of the blue by the CPU's caster, 0.0037 of the others by OpenGL's
    assert np.abs(drawn.sum(axis=(0, 1)) / field.sum(axis=(0, 1)) - 1).max() < 0.03
    assert np.sqrt(np.square(drawn - field).mean()) < 0.003


@pytest.mark.few(1)
@pytest.mark.parametrize(("mapper", "bound"), [("cpu", 0.02), ("gpu", 0.1)])
def test_peers_draw_the_box_of_the_voxels(mapper: str, bound: float) -> None:
    """Half a voxel beyond the outer samples, on a turned grid; OpenGL's steps reach beyond it by a part of a step."""
    pytest.importorskip("vtk")
    turned = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    ramp = np.broadcast_to(np.linspace(0, 1, 9, dtype=np.float32), (5, 7, 9))
    volume = sg.Volume(ramp, (1.0, 1.5, 2.0), (3.0, 4.0, 5.0), turned)
    transfer = sg.Transfer(points=[(0, 0.1), (1, 0.3)], unit=1.5, shading=False)
    drawn, field = peer_and_field(mapper, volume, transfer)
    assert np.abs(drawn.sum(axis=(0, 1)) / field.sum(axis=(0, 1)) - 1).max() < bound
    assert np.sqrt(np.square(drawn - field).mean()) < 0.03


def peer_and_field(mapper: str, volume: sg.Volume, transfer: sg.Transfer) -> tuple[np.ndarray, np.ndarray]:
    """A peer's picture and the trilinear field's, [48, 48, 4]."""
    camera = sg.Camera.orbit(volume, azimuth=30, elevation=20, size=(48, 48))
    with closing(Peer(mapper, (volume, transfer), camera, SPLATS)) as peer:
        return peer.frame()[0].pixels, field_integral(volume, transfer, camera, "trilinear", 4).pixels


def test_samples_of_peers_are_averaged() -> None:
    pytest.importorskip("vtk")
    volume = sg.scenes.ball(8)
    content, camera = (volume, sg.default_transfer(volume)), sg.Camera.orbit(volume, size=(20, 16))
    found = []
    for view, settings in (
        (camera, SPLATS.replace(antialias="supersample", samples=2)),
        (camera.resized((40, 32)), SPLATS.replace(antialias="off")),
    ):
        with closing(Peer("cpu", content, view, settings)) as peer:
            found.append(peer.frame()[0].pixels)
    means, fine = found
    assert np.abs(means - fine.reshape(16, 2, 20, 2, 4).mean(axis=(1, 3))).max() < 1e-6


@pytest.mark.parametrize("changed", [{"blend": "xray"}, {"background": (1.0, 1.0, 1.0)}])
def test_what_peers_cannot_draw_is_left_out(changed: dict) -> None:
    pytest.importorskip("vtk")
    volume = sg.scenes.ball(4)
    content = (volume, sg.default_transfer(volume))
    with pytest.raises(sg.InputError):
        Peer("cpu", content, sg.Camera.orbit(volume), SPLATS.replace(**changed))

"""Surfaces as mesh files: a ball's area, closed across slabs; places in the file's frame; nothing half written."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.readers.meshes import load_mesh
from splatgl.writers.surface import iso_mesh

trimesh = pytest.importorskip("trimesh")
pytest.importorskip("skimage")
RADIUS = 6.0


def ball(flip: float = 1.0) -> sg.Volume:
    """Twenty less the distance from (8, 9, 10), in millimetres, on a grid of other spacings."""
    spacing = np.array([0.8, 0.9, 1.0])
    z, y, x = np.indices((20, 20, 20))
    places = np.stack([x, y, z], axis=-1) * spacing - (8, 9, 10)
    samples = (20 - np.linalg.norm(places, axis=-1)).astype(np.float32)
    direction = np.diag([flip, 1.0, 1.0])
    return sg.Volume(samples, spacing=spacing, origin=(-8 * flip, -9, -10), direction=direction, unit="mm", frame="LPS")


@pytest.mark.parametrize("flip", [1.0, -1.0])
def test_a_ball_is_closed_across_slabs(flip: float) -> None:
    mesh = iso_mesh(ball(flip), 20 - RADIUS, slab=3 * 400)
    closed = trimesh.Trimesh(mesh.vertices, mesh.faces)
    assert closed.is_watertight and mesh.frame == "LPS"
    assert closed.volume == pytest.approx(4 / 3 * np.pi * RADIUS**3, rel=0.02)
    assert np.abs(np.linalg.norm(mesh.vertices, axis=1) - RADIUS).max() < 0.04


@pytest.mark.parametrize("suffix", [".stl", ".ply", ".obj", ".glb"])
def test_files_are_read_back_in_their_frame(tmp_path: Path, suffix: str) -> None:
    ball().save(tmp_path / "ball.nrrd")
    output = tmp_path / f"ball{suffix}"
    assert main(["surface", str(tmp_path / "ball.nrrd"), "--iso", "14", "-o", str(output), "--quiet"]) == 0
    read, right = load_mesh(output), iso_mesh(ball(), 14.0)
    assert read.frame == "LPS" and len(read.faces) == len(right.faces)
    assert np.allclose(np.sort(read.vertices, axis=0), np.sort(right.vertices, axis=0), atol=1e-5)


def test_several_surfaces_are_several_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ball().save(tmp_path / "ball.nrrd")
    line = ["surface", str(tmp_path / "ball.nrrd"), "--iso", "14", "--iso", "15.5", "-o"]
    assert main([*line, str(tmp_path / "s-{iso}.ply")]) == 0
    assert sorted(path.name for path in tmp_path.glob("*.ply")) == ["s-14.ply", "s-15.5.ply"]
    assert "triangles" in capsys.readouterr().out
    assert main([*line, str(tmp_path / "s.stl")]) == 2
    assert "such as" in capsys.readouterr().err and not (tmp_path / "s.stl").exists()


@pytest.mark.parametrize(("value", "message"), [("99", "a value that its samples pass"), ("x", "one finite number")])
def test_nothing_is_written_without_a_surface(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], value: str, message: str
) -> None:
    ball().save(tmp_path / "ball.nrrd")
    code = 0
    try:
        code = main(["surface", str(tmp_path / "ball.nrrd"), "--iso", value, "-o", str(tmp_path / "s.stl")])
    except SystemExit as error:
        code = int(str(error.code))
    assert code == 2 and message in capsys.readouterr().err and not (tmp_path / "s.stl").exists()


def test_it_is_open_beside_missing_and_masked_voxels() -> None:
    volume = ball()
    gone = volume.samples.copy()
    gone[:, :, 10:] = np.nan
    for half in (replace(volume, samples=gone), volume.masked(np.indices((20,) * 3)[2] < 10)):
        mesh = iso_mesh(half, 14.0)
        assert mesh.vertices[:, 0].max() < 0.3 and not trimesh.Trimesh(mesh.vertices, mesh.faces).is_watertight


def test_labels_have_none() -> None:
    with pytest.raises(sg.InputError, match="expected amounts, got labels"):
        iso_mesh(replace(ball(), labels=()), 14.0)


def test_one_plane_has_none() -> None:
    with pytest.raises(sg.InputError, match="expected at least two voxels along each axis, got 5×4×1"):
        iso_mesh(sg.Volume(np.random.default_rng(1).random((1, 4, 5))), 0.5)

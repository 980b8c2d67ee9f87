"""Splats as 3-D Gaussians, and surfaces as glTF, read back by readers that share no code with the writers."""

from __future__ import annotations

import gzip
import struct
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.splat.kernels import kernel
from splatgl.writers.gaussians import gaussian_width

LOOK: dict[str, Any] = {
    "points": [(20, 0.0), (120, 0.5), (200, 0.9)],
    "colormap": "hot",
    "window": (20, 200),
    "size": 32,
}


def volume() -> sg.Volume:
    """A ball in long, tilted voxels."""
    z, y, x = np.mgrid[0:9, 0:10, 0:11].astype(float)
    values = 220 * np.exp(-((x - 5) ** 2 + (y - 4) ** 2 + (z - 4) ** 2) / 9)
    turn = np.linalg.qr(np.array([[1, 0.4, 0.1], [-0.3, 1, 0.2], [0, 0.5, 1.0]]))[0]
    return sg.Volume(values.astype(np.float32), (1.0, 0.5, 2.0), (40.0, -20.0, 5.0), turn, name="ball")


def read_ply(path: Path) -> dict[str, np.ndarray]:
    """The vertices of a binary PLY of floats."""
    head, data = path.read_bytes().split(b"end_header\n", 1)
    lines = head.decode().splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    (count,) = (int(line.split()[2]) for line in lines if line.startswith("element vertex"))
    names = [line.split()[2] for line in lines if line.startswith("property float")]
    rows = np.frombuffer(data, "<f4").reshape(count, len(names))
    return dict(zip(names, rows.T.astype(np.float64), strict=True))


def read_spz(path: Path) -> dict[str, np.ndarray]:
    """The Gaussians of an SPZ of version 2, in the fields of the PLY."""
    data = gzip.decompress(path.read_bytes())
    magic, version, count, degree, bits, flags, _ = struct.unpack("<IIIBBBB", data[:16])
    assert (magic, version, degree, flags) == (0x5053474E, 2, 0, 0) and len(data) == 16 + count * 19
    body = np.frombuffer(data[16:], np.uint8).astype(np.int64)
    sizes = np.cumsum([0, 9, 1, 3, 3, 3]) * count
    place, alpha, color, scale, turn = (body[a:b].reshape(count, -1) for a, b in pairwise(sizes))
    fixed = place.reshape(count, 3, 3) @ np.array([1, 256, 65536])
    world = np.where(fixed >= 2**23, fixed - 2**24, fixed) / 2.0**bits
    found = {name: world[:, axis] for axis, name in enumerate("xyz")}
    share = alpha[:, 0] / 255
    found["opacity"] = np.log(share / (1 - share + 1e-9))
    xyz = (turn - 127.5) / 127.5
    turns = np.concatenate([np.sqrt(np.maximum(1 - (xyz**2).sum(axis=1, keepdims=True), 0)), xyz], axis=1)
    for axis in range(3):
        found[f"f_dc_{axis}"] = (color[:, axis] / 255 - 0.5) / 0.15
        found[f"scale_{axis}"] = scale[:, axis] / 16 - 10
    return found | {f"rot_{axis}": turns[:, axis] for axis in range(4)}


def covariance(found: dict[str, np.ndarray]) -> np.ndarray:
    """[3, 3]: of the first Gaussian, by its rotation and scales."""
    w, x, y, z = (found[f"rot_{axis}"][0] for axis in range(4))
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    return turn @ np.diag([np.exp(2 * found[f"scale_{axis}"][0]) for axis in range(3)]) @ turn.T


@pytest.mark.parametrize("kind", ["ply", "spz"])
def test_gaussians_are_those_of_the_voxels(kind: str, tmp_path: Path) -> None:
    path = sg.export(volume(), tmp_path / f"ball.{kind}", shading="off", **LOOK)
    found = (read_ply if kind == "ply" else read_spz)(path)
    exact = sg.extract(volume(), sg.Transfer(LOOK["points"], "hot", (20, 200)), classification="pre")
    coarse = kind == "spz"
    right = exact.positions @ exact.grid.world_from_index.T + exact.grid.origin
    place = np.stack([found[name] for name in "xyz"], axis=1)
    nearest = np.linalg.norm(right[:, None] - place[None], axis=2)
    match = nearest.argmin(axis=1)
    assert len(place) == len(exact) and nearest.min(axis=1).max() < 1e-3
    # extinction times the footprint's middle
    opacity = 1 / (1 + np.exp(-found["opacity"][match]))
    middle = float(kernel("crawfis-max").footprint(np.zeros(())))
    assert np.abs(opacity - -np.expm1(-exact.depths * middle)).max() < (0.02 if coarse else 0.01)
    harmonic = np.stack([found[f"f_dc_{axis}"][match] for axis in range(3)], axis=1)
    srgb = 0.5 + 0.28209479177387814 * harmonic
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((np.maximum(srgb, 0) + 0.055) / 1.055) ** 2.4)
    assert np.abs(linear - exact.colors).max() < (0.04 if coarse else 0.02)
    width, rmse = gaussian_width(kernel("crawfis-max"))
    turn = exact.grid.world_from_index
    assert np.allclose(
        covariance(found), width**2 * turn @ turn.T, rtol=0.3 if coarse else 1e-4, atol=0.1 if coarse else 1e-6
    )
    assert 0.4 < width < 0.8 and rmse < 0.03


def test_plyfile_reads_gaussians(tmp_path: Path) -> None:
    """The layout of 3-D Gaussian splatting, by a library that others read it with."""
    plyfile = pytest.importorskip("plyfile")
    path = sg.export(volume(), tmp_path / "ball.ply", splats=100, **LOOK)
    (element,) = plyfile.PlyData.read(path).elements
    names = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "opacity"]
    names += [f"{name}_{axis}" for name, count in (("scale", 3), ("rot", 4)) for axis in range(count)]
    assert element.name == "vertex" and [each.name for each in element.properties] == names
    found = read_ply(path)
    assert all(np.array_equal(element[name], found[name]) for name in names) and element["rot_0"].min() >= 0


def test_gaussians_are_points_to_load(tmp_path: Path) -> None:
    path = sg.export(volume(), tmp_path / "ball.ply", splats=100, **LOOK)
    points = sg.load(str(path)).points
    found = read_ply(path)
    assert points is not None and len(points) == len(found["x"]) <= 100
    order = np.lexsort(points.places.T), np.lexsort(np.stack([found[name] for name in "xyz"]))
    right = np.stack([found[name] for name in "xyz"], axis=1)
    assert np.abs(points.places[order[0]] - right[order[1]]).max() < 1e-4


def test_a_gaussian_is_nearest_to_a_gaussian_kernel() -> None:
    """exp(−2r²), but for its end at 2 voxels."""
    width, rmse = gaussian_width(kernel("gaussian"))
    assert width == pytest.approx(0.5, abs=0.002) and rmse < 1e-3


def test_the_command_tells_the_kernel(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    volume().save(tmp_path / "ball.nrrd")
    assert main(["export", str(tmp_path / "ball.nrrd"), "-o", str(tmp_path / "a.spz"), "--size", "32"]) == 0
    assert "3-D Gaussians" in (told := capsys.readouterr().out) and "% of the peak (RMSE)" in told


def test_surfaces_and_lines_are_gltf(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    pytest.importorskip("skimage")
    path = sg.export(volume(), tmp_path / "ball.glb", iso=[100, 180], size=32)
    scene = trimesh.load(path)
    assert len(scene.geometry) == 2
    outer, inner = sorted(scene.geometry.values(), key=lambda mesh: -mesh.area)
    assert outer.area > inner.area > 0 and np.linalg.norm(outer.centroid - volume().center) < 2.5
    _, y, x = np.mgrid[0:8, 0:8, 0:8].astype(float)
    flow = np.stack([y - 3.5, 3.5 - x, 0.2 + 0 * x], axis=-1)
    wind = sg.Volume(np.ones((8, 8, 8), np.float32), vectors=flow)
    lines = trimesh.load(sg.export(wind, tmp_path / "wind.glb", streamlines=5, size=32))
    (tubes,) = lines.geometry.values()
    # coloured by speed
    assert len(tubes.faces) > 50 and len(np.unique(tubes.visual.vertex_colors, axis=0)) > 2

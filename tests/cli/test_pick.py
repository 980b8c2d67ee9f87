"""`splatgl pick` and meshes: what a ray meets, in closed form; text, JSON and bad input."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main

# 0.1 of the light is absorbed by each unit of length
FOG = sg.Transfer([(0, 0.1)], unit=1.0)
BLOCK = sg.Volume(np.full((20, 20, 20), 5.0, np.float32), unit="mm", value_unit="HU", name="fog")
CAMERA = sg.Camera.orthographic((9.5, -30, 9.5), (9.5, 9.5, 9.5), (0, 0, 1), 15.0, (15, 15))


def wall(y: float, opacity: float = 1.0) -> sg.Mesh:
    corners = np.array([[-9, y, -9], [40, y, -9], [40, y, 40], [-9, y, 40]])
    return sg.Mesh(corners, [[0, 1, 2], [0, 2, 3]], opacity=opacity, name="wall")


def through(*meshes: sg.Mesh) -> sg.Scene:
    return sg.Scene([sg.Layer(BLOCK, FOG)], meshes=meshes)


def test_rays_end_at_opaque_meshes() -> None:
    """Fog absorbs half after ln 2 / −ln 0.9 = 6.58 units, at y = −0.5 + 6.58; a wall before that is met instead."""
    depth = np.log(2) / -np.log(0.9)
    for y in (-5.0, 2.0, 6.0):
        found = sg.pick(through(wall(y)), CAMERA, (7, 7))
        assert found is not None and (found.mesh, found.name, found.layer) == (0, "wall", -1)
        assert found.place == pytest.approx((9.5, y, 9.5)) and found.distance == pytest.approx(30 + y)
        assert np.isnan(found.value)
    found = sg.pick(through(wall(8.0)), CAMERA, (7, 7))
    assert found is not None and found.mesh is None and found.value == 5
    assert found.place[1] == pytest.approx(depth - 0.5, abs=0.26)


def test_transparent_meshes_weaken() -> None:
    """A wall of 0.3 before the fog: half is absorbed after ln(0.7 / 0.5) / −ln 0.9 units of it; one of 0.6 is met."""
    found = sg.pick(through(wall(-3.0, 0.3)), CAMERA, (7, 7))
    assert found is not None and found.mesh is None
    assert found.place[1] == pytest.approx(np.log(0.7 / 0.5) / -np.log(0.9) - 0.5, abs=0.26)
    found = sg.pick(through(wall(-3.0, 0.6)), CAMERA, (7, 7))
    assert found is not None and found.mesh == 0


def test_perspective_and_the_largest_value() -> None:
    """The place lies on the wall, where the ray does; of values, those before an opaque wall count."""
    samples = np.zeros((20, 20, 20), np.float32)
    samples[:, 4], samples[:, 15] = 1.0, 3.0
    scene = sg.Scene([sg.Layer(sg.Volume(samples), FOG)], meshes=[wall(10.0)])
    camera = sg.Camera.look_at((9.5, -30, 9.5), (9.5, 9.5, 9.5), (0, 0, 1), 30.0, (16, 16))
    found = sg.pick(scene, camera, (3, 12), mode="max")
    assert found is not None and found.value == pytest.approx(1.0, abs=0.13) and abs(found.index[1] - 4) < 0.3
    found = sg.pick(through(wall(-5.0)), camera, (3, 12))
    assert found is not None and found.place[1] == pytest.approx(-5.0)
    seen = camera.eye_from_points(np.array(found.place))
    pixel = seen[:2] / seen[2] / camera.extent * 16 + 8
    assert pixel == pytest.approx([3.5, 12.5])
    beside = sg.pick(sg.Scene([sg.Layer(BLOCK, FOG)], meshes=[wall(-5.0)]), camera.resized((400, 16)), (199, 8))
    assert beside is not None and beside.mesh == 0


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It tells what Python tells; clips are honoured; nothing, and bad input, in a line."""
    np.save(tmp_path / "a.npy", BLOCK.samples)
    base = ["pick", str(tmp_path / "a.npy"), "7,7", "--points", "0:0.1", "--unit", "1", "--size", "15", "--quiet"]
    view = ["--eye", "9.5,-30,9.5", "--look-at", "9.5,9.5,9.5", "--height", "15"]
    assert main([*base, *view, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    right = sg.pick(sg.Volume(BLOCK.samples), CAMERA, (7, 7), FOG)
    assert right is not None and told["place"] == pytest.approx(right.place) and told["value"] == 5
    assert told["voxel"] == pytest.approx(right.index) and told["distance"] == pytest.approx(right.distance)
    assert main([*base, *view, "--clip", "y>0.5"]) == 0
    place = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("place: "))
    # less than three quarters are absorbed by what is left, from 9.5 to 19.5: the middle of it is told
    assert float(place.split(", ")[1]) == pytest.approx(14.5, abs=0.26)
    assert main([*base, "--eye", "9.5,-30,9.5", "--look-at", "9.5,-60,9.5", "--up", "0,0,1"]) == 1
    assert "nothing" in capsys.readouterr().out
    for bad in ("7", "15,0", "-1,2", "a,b"):
        arguments = [*base[:2], bad, *base[3:], *view]
        try:
            code = main(arguments)
        except SystemExit as ended:
            code = int(ended.code or 0)
        assert code == 2 and "expected" in capsys.readouterr().err


def test_units_of_values(tmp_path: Path) -> None:
    """Of xarray and NetCDF as they state it; a length is the grid's."""
    xarray, h5py = pytest.importorskip("xarray"), pytest.importorskip("h5py")
    array = xarray.DataArray(np.zeros((3, 4, 5)), dims=("z", "y", "x"), attrs={"units": "K"})
    assert sg.Volume.of(array).value_unit == "K"
    for told, right in (("m/s", "m/s"), ("1", ""), ("mm", "")):
        with h5py.File(tmp_path / "a.h5", "w") as file:
            file["image_1"] = np.zeros((3, 4, 5))
            file["image_1"].attrs["units"] = told
        volume = sg.load(tmp_path / "a.h5")
        assert (volume.value_unit, volume.quantity) == (right, "")

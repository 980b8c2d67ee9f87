"""Pictures of every kind by the present OpenGL driver, against float64.

`scripts/test --all` repeats this file by OpenGL 3.3 and 4.1, which have no compute shaders, and by Zink;
`scripts/driver_table.py` compares drivers.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import driver_table
import numpy as np
import pytest
from driver_table import PICTURES, SCENES, SETTINGS, Subject

import splatgl as sg
from splatgl.gl import layer_quads, quads
from splatgl.gl.layer_quads import LayerQuads
from splatgl.planning.culling import PixelWindow

# Mesa answers as an older driver
DRIVERS = {
    "3.3": {"MESA_GL_VERSION_OVERRIDE": "3.3", "MESA_GLSL_VERSION_OVERRIDE": "330"},
    "softpipe": {"GALLIUM_DRIVER": "softpipe"},
}
SUBJECT = Subject((24, 20), 10)
# a table of 8 bits errs by half a step for each splat on a ray, half floats by 2⁻¹² a splat
ALLOWED = {"table": 6e-3, "half": 8e-3}
BLURRED = ("moments", "streaks")
# drawn by quads on any driver, although it has compute shaders
BY_QUADS = (
    "mask",
    "labels",
    "layers",
    "layers inside",
    "layers parallel",
    "layers of voxels",
    "meshes",
    "meshes, layers",
)


def right(name: str, subject: Subject = SUBJECT) -> np.ndarray:
    """The float64 reference of a picture."""
    if name in SETTINGS:
        drawn = subject.values(name), subject.camera, subject.settings(name)[0]
    elif name in SCENES:
        drawn = subject.scene(name)
    else:
        settings = sg.Settings(blend="mip" if "mip" in name else "composite")
        drawn = subject.splats, subject.inside if "inside" in name else subject.camera, settings
    return sg.reference.render(*drawn).pixels


def assert_right(name: str, pixels: np.ndarray, subject: Subject = SUBJECT) -> None:
    picture = right(name, subject)
    assert picture.max() > 0.2
    scale = max(float(picture.max()), 1.0)
    np.testing.assert_allclose(pixels, picture, atol=ALLOWED.get(name, 1e-3) * scale, err_msg=name)


COMPARED = [*(name for name in SETTINGS if name not in BLURRED), *SCENES, "bricks", "bricks, mip", "bricks inside"]


@pytest.mark.turns(2)
@pytest.mark.few(1)
@pytest.mark.parametrize("name", [*COMPARED, "parts", "parts, mip"])
def test_pictures_are_those_of_float64(renderer: sg.Renderer, name: str) -> None:
    assert_right(name, PICTURES[name](SUBJECT, renderer, name))


@pytest.mark.few(1)
@pytest.mark.parametrize("name", BY_QUADS)
def test_quads_draw_them_too(renderer: sg.Renderer, name: str) -> None:
    subject, camera, settings = SUBJECT.scene(name)
    image = renderer.render(subject, camera, settings.replace(technique="quads"))
    assert image.info["technique"] == "quads"
    assert_right(name, image.pixels)


@pytest.mark.parametrize("name", ["layers inside", pytest.param("meshes, layers", marks=pytest.mark.long)])
def test_bands_and_slabs_make_no_difference(renderer: sg.Renderer, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Slots are reused from slab to slab; a band has its own."""
    subject, camera, settings = SUBJECT.scene(name)
    settings = settings.replace(technique="quads")
    whole = renderer.render(subject, camera, settings).pixels
    bands: list[PixelWindow] = []
    drawn = LayerQuads._band

    def counted(self: LayerQuads, *given: Any) -> None:
        bands.append(given[3])
        drawn(self, *given)

    monkeypatch.setattr(LayerQuads, "_band", counted)
    monkeypatch.setattr(layer_quads, "POOL", 2**20)
    monkeypatch.setattr(layer_quads, "SLAB", 3)
    parts = renderer.render(subject, camera, settings).pixels
    assert len({band.y for band in bands}) > 1
    # a piece that two slabs share is composited in two steps
    np.testing.assert_allclose(parts, whole, atol=2e-5)


def test_bands_of_sheets_make_no_difference(renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    """The depths of meshes are those of the picture's rows, not of a band's."""
    subject, camera, settings = SUBJECT.scene("meshes")
    settings = settings.replace(technique="quads")
    whole = renderer.render(subject, camera, settings).pixels
    monkeypatch.setattr(quads, "MOST_PIXELS", 8 * SUBJECT.size[0])
    np.testing.assert_allclose(renderer.render(subject, camera, settings).pixels, whole, atol=2e-5)


@pytest.mark.few(1)
@pytest.mark.parametrize("name", ["bricks", "bricks, mip", "parts", "parts, mip"])
def test_quads_draw_bricks(renderer: sg.Renderer, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(renderer, "tiles", None)
    assert_right(name, PICTURES[name](SUBJECT, renderer, name))


@pytest.mark.long
@pytest.mark.parametrize(
    ("driver", "names"), [("3.3", ["default", "meshes, layers"]), ("softpipe", ["default", "layers"])]
)
def test_older_drivers_draw_the_default_and_layers(
    renderer: sg.Renderer, tmp_path: Path, driver: str, names: list[str]
) -> None:
    """In processes of their own, as Mesa reads its variables when it is loaded."""
    if not renderer.info.software:
        pytest.skip("needs Mesa")
    size, voxels = map(str, (SUBJECT.size[0], SUBJECT.voxels))
    command = [sys.executable, driver_table.__file__, "draw", str(tmp_path), *names, "--size", size, "--voxels", voxels]
    ended = subprocess.run(command, env=os.environ | DRIVERS[driver], capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr
    # no picture is refused
    (line,) = ended.stdout.splitlines()
    assert "OpenGL 3.3" in line
    square = Subject((SUBJECT.size[0],) * 2, SUBJECT.voxels)
    for name in names:
        assert_right(name, np.load(tmp_path / f"{name}.npy"), square)


def test_3_3_refuses_tiles(renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(renderer, "tiles", None)
    with pytest.raises(sg.InputError, match=r"^technique tiles: expected .* without compute shaders, older than 4.3"):
        renderer.render(SUBJECT.splats, SUBJECT.camera, sg.Settings(technique="tiles"))

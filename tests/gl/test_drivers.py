"""Pictures of every kind by the present OpenGL driver, against float64.

`scripts/test --all` repeats this file by OpenGL 3.3 and 4.1, which have no compute shaders, and by Zink;
`scripts/driver_table.py` compares drivers.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import driver_table
import numpy as np
import pytest
from driver_table import PICTURES, SCENES, SETTINGS, Subject

import splatgl as sg

# Mesa answers as an older or another driver
DRIVERS = {
    "3.3": {"MESA_GL_VERSION_OVERRIDE": "3.3", "MESA_GLSL_VERSION_OVERRIDE": "330"},
    "4.1": {"MESA_GL_VERSION_OVERRIDE": "4.1", "MESA_GLSL_VERSION_OVERRIDE": "410"},
    "softpipe": {"GALLIUM_DRIVER": "softpipe"},
    "Zink": {"MESA_LOADER_DRIVER_OVERRIDE": "zink", "LIBGL_ALWAYS_SOFTWARE": "1"},
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


def right(name: str) -> np.ndarray:
    """The float64 reference of a picture."""
    if name in SETTINGS:
        drawn = SUBJECT.values(name), SUBJECT.camera, SUBJECT.settings(name)[0]
    elif name in SCENES:
        drawn = SUBJECT.scene(name)
    else:
        settings = sg.Settings(blend="mip" if "mip" in name else "composite")
        drawn = SUBJECT.splats, SUBJECT.inside if "inside" in name else SUBJECT.camera, settings
    return sg.reference.render(*drawn).pixels


def assert_right(name: str, pixels: np.ndarray) -> None:
    picture = right(name)
    assert picture.max() > 0.2
    scale = max(float(picture.max()), 1.0)
    np.testing.assert_allclose(pixels, picture, atol=ALLOWED.get(name, 1e-3) * scale, err_msg=name)


COMPARED = [*(name for name in SETTINGS if name not in BLURRED), *SCENES, "bricks", "bricks, mip", "bricks inside"]


@pytest.mark.few(6)
@pytest.mark.parametrize("name", [*COMPARED, "parts", "parts, mip"])
def test_pictures_are_those_of_float64(renderer: sg.Renderer, name: str) -> None:
    assert_right(name, PICTURES[name](SUBJECT, renderer, name))


@pytest.mark.few(4)
@pytest.mark.parametrize("name", BY_QUADS)
def test_quads_draw_them_too(renderer: sg.Renderer, name: str) -> None:
    subject, camera, settings = SUBJECT.scene(name)
    image = renderer.render(subject, camera, settings.but(technique="quads"))
    assert image.info["technique"] == "quads"
    assert_right(name, image.pixels)


@pytest.mark.parametrize("name", ["bricks", "bricks, mip", "parts", "parts, mip"])
def test_quads_draw_bricks(renderer: sg.Renderer, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(renderer, "tiles", None)
    assert_right(name, PICTURES[name](SUBJECT, renderer, name))


def drawn_by(driver: str, folder: Path, *names: str) -> None:
    command = [sys.executable, driver_table.__file__, "draw", str(folder), *names, "--size", "24", "--voxels", "10"]
    ended = subprocess.run(command, env=os.environ | DRIVERS[driver], capture_output=True, text=True)
    if driver == "Zink" and ended.returncode and "expected a context" in ended.stderr:
        pytest.skip("no Vulkan driver, or none that Zink serves")
    assert ended.returncode == 0, ended.stderr
    assert len(ended.stdout.splitlines()) == 1, ended.stdout


def test_3_3_draws_the_default_and_layers(tmp_path: Path) -> None:
    drawn_by("3.3", tmp_path, "default", "meshes, layers")
    subject = Subject((24, 24), 10)
    for name, drawn in (
        ("default", (subject.splats, subject.camera)),
        ("meshes, layers", subject.scene("meshes, layers")),
    ):
        picture = sg.reference.render(*drawn).pixels
        np.testing.assert_allclose(np.load(tmp_path / f"{name}.npy"), picture, atol=1e-3, err_msg=name)


def test_3_3_refuses_tiles(renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(renderer, "tiles", None)
    with pytest.raises(sg.InputError, match=r"^technique tiles: expected .* without compute shaders, older than 4.3"):
        renderer.render(SUBJECT.splats, SUBJECT.camera, sg.Settings(technique="tiles"))

"""OpenGL before 4.3 has no compute shaders: every setting is drawn by quads, or refused in a line that says why."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.data.volume import Label

# Mesa answers as an older driver
OLDER = {
    "3.3": {"MESA_GL_VERSION_OVERRIDE": "3.3", "MESA_GLSL_VERSION_OVERRIDE": "330"},
    "4.1": {"MESA_GL_VERSION_OVERRIDE": "4.1", "MESA_GLSL_VERSION_OVERRIDE": "410"},
    "softpipe": {"GALLIUM_DRIVER": "softpipe"},
}
SIZE = (24, 20)
TRANSFER = sg.Transfer([(0.35, 0.0), (0.7, 0.4), (1.0, 0.9)], colormap="bone", shading=True)
SETTINGS: dict[str, dict[str, Any]] = {
    "default": {},
    **{blend: {"blend": blend} for blend in ("xray", "mip", "minip", "mean")},
    "lit": {"light": "glossy", "light_from": (40.0, 30.0)},
    "cues": {"ambient_occlusion": 0.6, "shadows": 0.7},
    "cut": {"clip": ((1.0, 0.3, 0.0, 4.0), (-1.0, 0.0, 0.2, -9.0))},
    "fine": {"tolerance": 1e-4, "sheets": 4, "steps": 8},
    "voxels": {"classification": "pre"},
    "0.1": {"like": "0.1"},
    "filled": {"attenuation": "fill", "antialias": "paper"},
    "moments": {"moments": 3},
    "streaks": {"like": "0.1", "motion": "exact"},
    "white": {"background": (1.0, 1.0, 1.0)},
}
OTHERS = ("masked", "labels", "inside", "parallel", "layers' sums")
REFUSED = ("tiles", "layers", "meshes", "bricks")


def volume() -> sg.Volume:
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 10)] * 3, indexing="ij"))
    noise = 0.1 * np.random.default_rng(1).random((10, 10, 10))
    return sg.Volume(np.float32(np.clip(1.3 - np.sqrt((grid**2).sum(axis=0)), 0, 1) + noise), name="ball")


def segments() -> sg.Volume:
    found = np.zeros((10, 10, 10), np.uint8)
    found[2:5, 2:8, 2:7], found[6:9, 2:8, 2:7] = 1, 2
    return sg.Volume(found, name="segments", labels=(Label(1, "a", "#ff0000"), Label(2, "b", "#00ff00")))


def picture(renderer: sg.Renderer, name: str) -> np.ndarray:
    """One of SETTINGS, OTHERS or REFUSED."""
    camera = sg.Camera.orbit(volume(), azimuth=30, elevation=20, size=SIZE)
    middle = sg.Camera.look_at((5, 5, 5), (7, 6, 5.5), (0, 0, 1), 60, SIZE)
    splats, plain = sg.extract(volume(), TRANSFER), sg.Settings()
    if name in SETTINGS:
        settings = sg.Settings.like("0.1") if "like" in SETTINGS[name] else plain
        settings = settings.but(**{key: value for key, value in SETTINGS[name].items() if key != "like"})
        motion = sg.Motion(spin=(0, 0, 20)) if name in ("moments", "streaks") else None
        return renderer.render(splats, camera, settings, motion).pixels
    if name == "masked":
        return sg.render(volume(), size=SIZE, mask=segments().samples > 0, shadows=0.5).pixels
    if name == "bricks":
        return sg.render_slabs(volume(), TRANSFER, camera, memory="1MiB").pixels
    both = sg.Scene([sg.Layer(volume(), TRANSFER), sg.Layer(segments(), sg.default_transfer(segments()))])
    mesh = sg.Mesh(np.array([[1, 1, 4], [9, 2, 5], [5, 9, 6.0]]), np.array([[0, 1, 2]]))
    drawn, view, settings = {
        "labels": (sg.extract(segments(), sg.default_transfer(segments())), camera, plain),
        "inside": (splats, middle, plain),
        "parallel": (splats, camera.parallel(volume()), plain),
        "layers' sums": (both, camera, plain.but(blend="xray")),
        "tiles": (splats, camera, plain.but(technique="tiles")),
        "layers": (both, camera, plain),
        "meshes": (sg.Scene([sg.Layer(volume(), TRANSFER)], meshes=[mesh]), camera, plain),
    }[name]
    return renderer.render(drawn, view, settings).pixels


def draw(folder: Path) -> None:
    """Run by itself: every picture that is named on the command line, or the line that refuses it."""
    with sg.Renderer() as renderer:
        print(renderer.info.version)
        for name in sys.argv[2:]:
            try:
                np.save(folder / f"{name}.npy", picture(renderer, name))
            except sg.InputError as error:
                print(error)


def drawn_by(older: str, folder: Path, *names: str) -> str:
    command = [sys.executable, __file__, str(folder), *names]
    told = subprocess.run(command, env=os.environ | OLDER[older], capture_output=True, text=True)
    assert told.returncode == 0, told.stderr
    return told.stdout


def test_the_default_is_drawn_by_3_3(tmp_path: Path) -> None:
    """Against float64; and what only compute shaders draw is refused."""
    told = drawn_by("3.3", tmp_path, "default", *REFUSED).splitlines()
    assert told[0].startswith("3.3")
    camera = sg.Camera.orbit(volume(), azimuth=30, elevation=20, size=SIZE)
    right = sg.reference.render(sg.extract(volume(), TRANSFER), camera).pixels
    assert right.max() > 0.3
    np.testing.assert_allclose(np.load(tmp_path / "default.npy"), right, atol=1e-3)
    assert [line.split(":")[0] for line in told[1:]] == ["technique tiles", "layers", "meshes", "a volume in bricks"]
    for line in told[1:]:
        assert "compute shaders" in line and ("got OpenGL 3.3" in line or "older than 4.3" in line), line


@pytest.mark.long
@pytest.mark.parametrize("older", OLDER)
def test_every_setting_is_drawn_by_older_ones(renderer: sg.Renderer, tmp_path: Path, older: str) -> None:
    names = [*SETTINGS, *OTHERS]
    assert len(drawn_by(older, tmp_path, *names).splitlines()) == 1
    for name in names:
        right = picture(renderer, name)
        scale = max(float(np.abs(right).max()), 1.0)
        np.testing.assert_allclose(np.load(tmp_path / f"{name}.npy"), right, atol=1e-3 * scale, err_msg=name)


if __name__ == "__main__":
    draw(Path(sys.argv[1]))

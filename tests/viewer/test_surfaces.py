"""Iso-surfaces and caps of meshes are edited in the panel by hand, seen in the picture, and undone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from tests.helpers.window import MISSING, Window, pointed

# places in a window of 600 × 450 pixels: the menu of a mesh, its list of cuts and the last of them; headings, and the
# value of a surface; a pixel of the mesh, and the column through the middle of the volume, left of the panel
MENU, CUTS, VOLUME = (552, 116), (516, 159), (480, 243)
LOOK, CURVE, SURFACES, VALUE = (360, 166), (360, 191), (360, 216), (310, 241)
STONE, COLUMN = (220, 230), 255
SCENE = """volume = "ball.npy"
clip = "y>0.5"
[transfer]
points = [[0.0, 0.0], [20.0, 0.0]]
iso = ["12:red"]
colormap = "viridis"
[camera]
view = "front"
fit = "0.3"
[[mesh]]
file = "stone.stl"
color = "blue"
"""


def clicked(window: Window, place: tuple[int, int]) -> None:
    pointed(window, *place)
    window.hands("click", 1)
    window.ask("settle")


def red_rows(window: Window) -> int:
    """Rows of the surface in the middle column."""
    pixels = window.shot()[:, COLUMN].astype(int)
    return int((pixels[:, 0] > pixels[:, 1:].max(axis=1) + 40).sum())


@pytest.mark.long
@pytest.mark.skipif(bool(MISSING), reason=f"needs {' and '.join(MISSING)}: apt-get install xvfb xdotool")
def test_surfaces_and_caps_by_hand(tmp_path: Path) -> None:
    pytest.importorskip("imgui_bundle", reason="needs the extra gui: pip install splatgl[gui]")
    trimesh = pytest.importorskip("trimesh")
    z, y, x = np.indices((26, 26, 26))
    np.save(tmp_path / "ball.npy", (20 - np.sqrt((x - 12) ** 2 + (y - 12) ** 2 + (z - 12) ** 2)).astype(np.float32))
    stone = sg.Mesh.of_points([[12, 12, 12]], 5.0)
    trimesh.Trimesh(stone.vertices, stone.faces).export(tmp_path / "stone.stl")
    (tmp_path / "scene.toml").write_text(SCENE)
    window = Window(tmp_path / "scene.toml", tmp_path, size=(600, 450), panel=True)
    blue = window.shot()[STONE[1], STONE[0]].astype(int)
    assert blue[2] > 80 > blue[:2].max()
    clicked(window, MENU)
    clicked(window, CUTS)
    clicked(window, VOLUME)
    window.key("escape")
    # viridis near its end
    found = window.shot()[STONE[1], STONE[0]].astype(int)
    assert found[1] > 150 and found[1] > found[2] + 50
    assert window.key("ctrl+z")["message"] == "undone"
    assert np.abs(window.shot()[STONE[1], STONE[0]].astype(int) - blue).max() <= 1
    clicked(window, LOOK)
    clicked(window, CURVE)
    clicked(window, SURFACES)
    rows = red_rows(window)
    pointed(window, *VALUE)
    told = window.drag(1, VALUE, (VALUE[0] + 20, VALUE[1]))
    ((value, color, opacity),) = told["iso"]
    assert 12.3 < value < 15 and (color, opacity) == ("#ff0000", 1.0)
    # what is seen of the surface is a ring, from its radius to the stone's
    assert 20 < red_rows(window) < 0.9 * rows
    assert window.key("ctrl+z")["iso"] == [[12.0, "#ff0000", 1.0]] and red_rows(window) == rows
    window.end()

"""Flat stacks of microscopes are seen along z, x to the right and y down; other volumes from where they were."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.animation.camera_track import turning
from splatgl.cli.main import main
from splatgl.data.volume import Hints, Volume
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.view import ViewOptions, is_flat_stack, orient_stack
from splatgl.viewer.document import Document
from splatgl.viewer.slice_views import panes, slice_up
from splatgl.viewer.state import State
from tests.helpers.commands import acted

pytestmark = pytest.mark.usefixtures("shared_programs")


def stack(depth: int = 6) -> Volume:
    """Dark, with a bright bar along x near x = 0, y = 0 of the first plane, and a dimmer dot at the end of y."""
    samples = np.zeros((depth, 40, 60), np.uint8)
    samples[0, 2:5, 2:22] = 250
    samples[depth - 1, 34:38, 3:7] = 120
    samples[1, 20, 50:58] = np.arange(40, 80, 5)
    samples[2, 22, 20:50] = np.arange(90, 150, 2)
    return Volume(samples)


# what differs from the stack → whether it is seen along z
CASES = {
    "a stack": ({}, True),
    "planes as far apart as in a cube": ({"spacing": (1.0, 1.0, 8.0)}, False),
    "dense, of a microscope's file": (
        {"samples": np.random.default_rng(0).random((6, 40, 60)), "hints": Hints(stack=True)},
        True,
    ),
    "one dense plane": ({"samples": np.random.default_rng(0).random((1, 40, 60))}, True),
    "anatomy": ({"frame": "LPS"}, False),
    "a view of its own": ({"hints": Hints(azimuth=10.0)}, False),
    "turned": ({"direction": np.diag([-1.0, -1.0, 1.0])}, False),
    "colours of its own": ({"color": np.zeros((6, 40, 60, 3), np.uint8)}, False),
    "dense, of a microscope": ({"samples": np.random.default_rng(0).random((6, 40, 60)), "unit": "um"}, True),
    "dense": ({"samples": np.random.default_rng(0).random((6, 40, 60))}, False),
    "a terrain": ({"samples": (np.arange(6)[:, None, None] < 3) * np.ones((6, 40, 60), np.uint8)}, False),
}


@pytest.mark.parametrize("name", CASES)
def test_what_is_a_flat_stack(name: str) -> None:
    changes, flat = CASES[name]
    volume = orient_stack(replace(stack(), **changes))
    assert is_flat_stack(replace(stack(), **changes)) == flat == (len(volume.notes) == 1)
    assert (abs(ViewOptions().camera(volume, volume).forward[2]) > 0.999) == flat


def test_x_is_to_the_right_and_y_down(renderer: sg.Renderer) -> None:
    volume = orient_stack(stack())
    splats = sg.extract(volume, sg.default_transfer(volume))
    camera = ViewOptions(size=(60, 40)).camera(volume, volume)
    assert np.allclose(camera.forward, [0, 0, 1]) and np.allclose(camera.right, [1, 0, 0])
    alpha = renderer.render(splats, camera).pixels[..., 3]
    rows, columns = np.nonzero(alpha > 0.5)
    # the bar: at the top, from the left to a third of the width
    assert rows.min() < 10 and columns[rows < 10].min() < 12 and 18 < columns[rows < 10].max() < 30
    dot = alpha[28:, :14]
    assert dot.max() > 0.2 and alpha[28:, 20:].max() < 0.05


@pytest.mark.parametrize("asked", [{"up": (0.0, 1.0, 0.0)}, {"eye": (0.0, -200.0, 50.0)}])
def test_a_view_that_says_what_is_up_is_taken(asked: dict[str, object], tmp_path: Path) -> None:
    np.save(tmp_path / "stack.npy", stack().samples)
    scene = SceneFile(str(tmp_path / "stack.npy"), view=ViewOptions(**asked))
    found, right = scene.view.camera(scene.open(), stack()), ViewOptions(**asked).camera(stack(), stack())
    assert np.allclose(found.eye, right.eye) and np.allclose(found.eye_from_world, right.eye_from_world)


def test_azimuth_and_elevation_turn_what_is_seen() -> None:
    """About the picture's columns, as a projection in Fiji, and towards its lower edge."""
    volume = orient_stack(stack())
    track = turning(ViewOptions(), volume, volume, 90.0)
    assert np.allclose(np.abs(track.camera(1).forward), [1, 0, 0])
    for camera in (track.camera(1), ViewOptions(azimuth=50.0).camera(volume, volume)):
        assert np.allclose(camera.eye_from_world[1], [0, 1, 0])
    tilted = ViewOptions(elevation=30.0).camera(volume, volume)
    assert np.allclose(tilted.right, [1, 0, 0]) and np.allclose(tilted.forward, [0, 0.5, np.sqrt(0.75)])


@pytest.mark.long
def test_it_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    np.save("stack.npy", stack().samples)
    draw = ["render", "stack.npy", "-o", "s.png", "--size", "20", "--check", "0"]
    assert main(draw) == 0
    assert capsys.readouterr().err.count("a flat stack is seen along z, x to the right and y down") == 1
    assert main([*draw, "--elevation", "60"]) == 0
    assert "flat stack" not in capsys.readouterr().err


def test_pictures_of_arrays_are_those_of_files(tmp_path: Path) -> None:
    np.save(tmp_path / "stack.npy", stack().samples)
    found = [sg.render(each, size=(30, 20)) for each in (stack().samples, tmp_path / "stack.npy")]
    assert np.array_equal(found[0].pixels, found[1].pixels) and found[0].pixels[..., 3].max() > 0.4


@pytest.mark.parametrize("depth", [2, 4, 60])
def test_a_stack_of_any_depth_lies_as_other_programs_show_it(depth: int, tmp_path: Path) -> None:
    """Row 0 on top and column 0 at the left, the first plane in front, in views from above and in slices."""
    tifffile = pytest.importorskip("tifffile")
    samples = np.full((depth, 40, 60), 10, np.uint8)
    samples[:, 4:8, 6:26], samples[:, 30:38, 6:14] = 250, 120
    look = {"points": [(0, 0.0), (250, 0.9)], "colormap": "gray", "window": (0, 250), "size": (60, 40)}
    tifffile.imwrite(tmp_path / "a.tif", samples, photometric="minisblack")
    pictures = [
        sg.render(tmp_path / "a.tif", view="top", blend="mip", orthographic=True, **look),
        sg.render(tmp_path / "a.tif", slices="z=0", **look),
        sg.render(sg.Volume(samples, unit="um"), slices="z=0", **look),
    ]
    for image in pictures:
        light = image.pixels[..., :3].max(axis=2)
        rows, columns = np.nonzero(light > 0.9 * light.max())
        assert rows.max() < 15 and columns.min() < 18 and 20 < columns.max() < 34
        assert light[26:, :22].max() > 1.5 * light[26:, 30:].max()
    volume = SceneFile(str(tmp_path / "a.tif")).open()
    for view, right, down in (
        ("top", (1, 0, 0), (0, 1, 0)),
        ("front", (1, 0, 0), (0, 0, 1)),
        ("left", (0, 1, 0), (0, 0, 1)),
    ):
        camera = ViewOptions(view=view).camera(volume, volume)
        assert np.allclose(camera.right, right) and np.allclose(camera.eye_from_world[1], down)
    # an eye, and what is up, are the user's
    asked = SceneFile(str(tmp_path / "a.tif"), view=ViewOptions(up=(0.0, 0.0, 1.0))).open()
    assert asked.hints.up is None


def test_the_window_shows_stacks_as_pictures_do(tmp_path: Path) -> None:
    """Its standard views, and its slices beside the picture."""
    for depth in (4, 60):
        held = sg.Volume(np.random.default_rng(1).random((depth, 20, 24)), unit="um")
        document = Document.open(SceneFile("a", held=held))
        state = acted(State.of(document, (40, 30)), "top", document)
        assert np.allclose(state.pose.camera.right, [1, 0, 0]) and np.allclose(state.pose.camera.forward, [0, 0, 1])
        assert state.message == "view along +Z"
        found = panes(state.slices, document.volume, slice_up(document), (300, 300))
        x, y, z = np.eye(3).tolist()
        assert [(each.plane.right.tolist(), each.plane.down.tolist()) for each in found] == [(x, y), (x, z), (z, y)]

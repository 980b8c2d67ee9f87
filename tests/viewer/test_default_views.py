"""One default view in every door: the window, its standard views and movies, pictures and `Camera.orbit`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.animation.animation import Animation, Timeline
from splatgl.animation.camera_track import TurntableTrack, keyframes
from splatgl.geometry.scissors import Scissors
from splatgl.scene.open_scene import OpenScene
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.view import ViewOptions, angles
from splatgl.viewer.document import Document
from splatgl.viewer.state import State
from tests.helpers.commands import acted

LOOK = {"points": ((40.0, 0.0), (60.0, 0.5))}
SCENES: dict[str, dict[str, Any]] = {
    "block": {},
    "before": {"settings": sg.Settings(classification="pre")},
    "wide": {"view": ViewOptions(size=(90, 40), azimuth=200.0, elevation=-35.0, fov=25.0)},
    "parallel": {"view": ViewOptions(orthographic=True)},
    "layers": {"layers": (SceneFile("other.npy", transfer=LOOK),)},
    "cropped": {"crop": "2:9,:,:"},
    "scissors": {"scissors": (Scissors("0.5,0 1,0 1,1 0.5,1"),)},
}


def block() -> np.ndarray:
    """A block in a corner, and a voxel alone in another."""
    samples = np.zeros((14, 12, 10), np.float32)
    samples[2:7, 1:6, 2:5] = np.indices((5, 5, 3)).sum(axis=0) + 50
    samples[12, 10, 8] = 60
    return samples


def same(a: sg.Camera, b: sg.Camera) -> bool:
    """Whether they are equal but for rounding."""
    first, second = (np.array([*each.eye, *each.eye_from_world.ravel(), each.extent]) for each in (a, b))
    return np.allclose(first, second, rtol=1e-9, atol=1e-9) and a.size == b.size and a.perspective == b.perspective


@pytest.mark.parametrize("fit", ["all", "visible", "0.3"])
@pytest.mark.parametrize("kind", SCENES)
def test_every_door_has_one_default_view(kind: str, fit: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Movies begin with it, unless they turn a camera that then fits the whole turn; all turn about one middle."""
    monkeypatch.chdir(tmp_path)
    np.save("block.npy", block())
    np.save("other.npy", block()[::-1])
    given = {"view": ViewOptions(), **SCENES[kind]}
    file = SceneFile("block.npy", transfer=LOOK, **{**given, "view": replace(given["view"], fit=fit)})
    camera = OpenScene.read(file).camera
    document = Document.open(file)
    pose = document.home(camera.size)
    assert pose.camera == camera
    rows = [{"frame": 0, "zoom": 1.0}, {"frame": 3, "zoom": 2.0}]
    for moves in ({"turntable": 0.0}, {"keyframes": {"keyframe": rows}}, {"turntable": 180.0}):
        movie = Animation.of([file], Timeline(frames=2, **moves), None, 8, is_quiet=True)  # type: ignore[arg-type]
        assert moves == {"turntable": 180.0} or same(movie.view(0).camera, camera), moves
        if isinstance(movie.track, TurntableTrack):
            assert np.allclose(movie.track.turn.center, document.middle) and np.allclose(pose.pivot, document.middle)
    # a standard view is that of a picture
    azimuth, elevation = angles("isometric", document.volume)
    turned = replace(file, view=replace(file.view, azimuth=azimuth, elevation=elevation))
    shown = acted(State.of(document, camera.size), "isometric", document).pose.camera
    if camera.perspective and kind != "scissors":
        assert same(shown, OpenScene.read(turned).camera)


def test_pictures_of_arrays_have_the_view_of_an_orbit() -> None:
    volume = sg.Volume(block())
    picture = sg.render(volume, size=(48, 40), transfer=LOOK)
    assert picture.camera == sg.Camera.orbit(volume, 30, 20, size=(48, 40)) == sg.Camera.default(volume, size=(48, 40))
    splats = sg.extract(volume, sg.Transfer(**LOOK))
    assert picture.camera == sg.Camera.orbit(splats, 30, 20, size=(48, 40))
    layers = sg.Scene([sg.Layer(volume, sg.Transfer(**LOOK))])
    assert picture.camera == sg.render(layers, size=(48, 40)).camera == sg.Camera.default(layers, size=(48, 40))
    assert sg.Camera.default(splats, camera=picture.camera.resized((9, 7)), settings=sg.Settings()).size == (9, 7)


@pytest.mark.parametrize("words", [{"view": "left"}, {"fit": "visible"}, {"width": "85mm"}])
def test_words_are_not_between_keyframes(words: dict[str, str]) -> None:
    rows = [{"frame": n, "zoom": 1.0, **words} for n in (0, 2)]
    volume = sg.Volume(block())
    with pytest.raises(sg.InputError, match="keyframe 1: expected keys frame, "):
        keyframes({"keyframe": rows}, ViewOptions(), volume, volume)

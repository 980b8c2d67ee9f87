"""Standard views by closed forms in all frames, sizes on paper, parallel rays of flat stacks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.errors import InputError
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.view import OF_PATIENTS, VIEWS, ViewOptions, orient_stack

CUBE = np.zeros((8, 8, 8), np.float32)
# from the patient to the eye, in LPS
SIDES = {
    "anterior": (0, -1, 0),
    "posterior": (0, 1, 0),
    "left": (1, 0, 0),
    "right": (-1, 0, 0),
    "superior": (0, 0, 1),
    "inferior": (0, 0, -1),
}
RAS = np.array([-1, -1, 1])


def back(view: str, frame: str | None, **more: Any) -> np.ndarray:
    """Unit vector to the eye."""
    volume = sg.Volume(CUBE, frame=frame)
    return -ViewOptions(view=view, **more).camera(volume, volume).forward


@pytest.mark.parametrize("view", SIDES)
def test_sides_of_a_patient(view: str) -> None:
    """The same side in LPS and in RAS, whose x and y point the other way."""
    assert np.allclose(back(view, "LPS"), SIDES[view], atol=1e-12)
    assert np.allclose(back(view, "RAS") * RAS, SIDES[view], atol=1e-12)


def test_views_without_anatomy() -> None:
    """The front is along +y, left and right are the viewer's, and isometric sees three sides alike."""
    assert np.allclose(back("front", None), (0, -1, 0)) and np.allclose(back("anterior", None), (0, -1, 0))
    assert np.allclose(back("left", None), (-1, 0, 0)) and np.allclose(back("right", None), (1, 0, 0))
    assert np.allclose(np.abs(back("isometric", None)), 1 / np.sqrt(3), atol=1e-5)
    assert np.allclose(back("top", "RAS"), (0, 0, 1)) and np.allclose(back("bottom", "LPS"), (0, 0, -1))


def test_azimuth_begins_at_the_patients_front() -> None:
    """And turns counter-clockwise from above: from the front to the patient's left."""
    for frame, turn in (("LPS", 1), ("RAS", RAS)):
        volume = sg.Volume(CUBE, frame=frame)
        seen = [-ViewOptions(azimuth=a, elevation=0).camera(volume, volume).forward * turn for a in (0, 90)]
        assert np.allclose(seen, [(0, -1, 0), (1, 0, 0)], atol=1e-12)


@pytest.mark.parametrize(("frame", "noted"), [(None, set(OF_PATIENTS)), ("LPS", set())])
def test_a_patients_view_of_others_is_noted(frame: str | None, noted: set[str]) -> None:
    volume = sg.Volume(CUBE + np.indices(CUBE.shape)[0], frame=frame)
    views = {*OF_PATIENTS, *VIEWS}
    told = {view: SceneFile("v", held=volume, view=ViewOptions(view=view)).open().notes for view in views}
    assert {view for view, notes in told.items() if any("does not state anatomy" in note for note in notes)} == noted


@pytest.mark.parametrize("frame", [None, "LPS", "RAS", "stack"])
def test_views_along_axes(frame: str | None) -> None:
    """As ParaView names them; across xy a stack has x to the right and y down, other data y up."""
    volume = sg.Volume(CUBE, frame=None if frame == "stack" else frame, unit="um" if frame == "stack" else "mm")
    volume = orient_stack(volume)
    for name in ("+x", "-x", "+y", "-y", "+z", "-z"):
        forward = ViewOptions(view=name).camera(volume, volume).forward
        assert forward["xyz".index(name[1])] == pytest.approx(float(f"{name[0]}1")), name
    for plane, axis in (("xy", 2), ("xz", 1), ("yz", 0)):
        camera = ViewOptions(view=plane).camera(volume, volume)
        assert abs(camera.forward[axis]) == pytest.approx(1.0)
    right, down, forward = ViewOptions(view="xy").camera(volume, volume).eye_from_world
    turn = -1 if frame == "RAS" else 1
    assert np.allclose([right, down], [(turn, 0, 0), (0, 1 if frame == "stack" else -turn, 0)], atol=1e-9)
    with pytest.raises(InputError, match="up: expected no other direction for a view across or along axes"):
        ViewOptions(view="xy", up=(1.0, 0.0, 0.0))


def test_a_view_replaces_angles_and_they_a_view(tmp_path: Path) -> None:
    np.save(tmp_path / "v.npy", CUBE)
    (tmp_path / "a.toml").write_text('volume = "v.npy"\n[camera]\nazimuth = 70\nelevation = 3\n')
    (tmp_path / "b.toml").write_text('volume = "v.npy"\n[camera]\nview = "left"\n')
    a, b = (SceneFile.from_toml(tmp_path / name) for name in ("a.toml", "b.toml"))
    viewed, turned = a.with_options(view="top").view, b.with_options(azimuth=5.0).view
    assert (viewed.view, viewed.azimuth, viewed.elevation) == ("top", None, None)
    assert (turned.view, turned.azimuth) == (None, 5.0) and b.view.view == "left"
    with pytest.raises(InputError, match="view: expected a standard view or angles, got left and azimuth"):
        ViewOptions(view="left", azimuth=3.0)


@pytest.mark.parametrize(
    ("options", "size", "dpi"),
    [
        ({"width": "85mm", "dpi": 300}, (1004, 1004), 300),
        ({"width": "85mm"}, (1004, 1004), 300),
        ({"width": "8.5 cm", "dpi": 600}, (2008, 2008), 600),
        ({"width": "3in", "dpi": 100, "size": (4, 3)}, (300, 225), 100),
        ({"width": "240pt", "dpi": 72}, (240, 240), 72),
        ({"dpi": 72, "size": (80, 60)}, (80, 60), 72),
    ],
)
def test_pixels_of_a_width_on_paper(options: dict[str, Any], size: tuple[int, int], dpi: float) -> None:
    """A millimetre is dpi/25.4 pixels; a changed view keeps its shape."""
    view = ViewOptions(**options)
    assert (view.size, view.dpi) == (size, dpi)
    assert view.changed(zoom=2.0).size == size
    twice = view.changed(dpi=2 * dpi).size
    assert twice == (tuple(2 * n for n in size) if "width" in options else size)


@pytest.mark.parametrize("text", ["85", "0mm", "mm", "-3mm", "3ft", "1e3mm", "nanmm"])
def test_other_widths_are_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"width: expected a (width on paper|length) such as 85mm"):
        ViewOptions(width=text)
    with pytest.raises(InputError, match="size: expected a width and a height of at least one whole pixel"):
        ViewOptions(width="85mm", size=(0, 4))


def test_flat_stacks_have_parallel_rays() -> None:
    """Unless a field of view is given, or perspective asked for; the stack fills the picture either way."""
    stack = orient_stack(sg.Volume(np.ones((4, 30, 40), np.uint8), unit="um"))
    cameras = [ViewOptions(**more).camera(stack, stack) for more in ({}, {"fov": 40.0}, {"orthographic": False})]
    assert [camera.perspective for camera in cameras] == [False, True, True]
    assert 30 < cameras[0].extent < 50 and not ViewOptions(elevation=45.0).camera(stack, stack).perspective
    cube = sg.Volume(CUBE, unit="um")
    assert ViewOptions().camera(cube, cube).perspective

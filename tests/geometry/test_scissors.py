"""Scissors against closed forms, planes and the float64 reference; segments that planes leave whole."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl import reference
from splatgl.cli.main import main
from splatgl.errors import InputError
from splatgl.geometry.clipping import Plane
from splatgl.geometry.scissors import Scissors
from splatgl.scene.open_scene import OpenScene
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.view import ViewOptions
from tests.helpers.blocks import FOG, OPACITY, PLAIN, SOLID, block, field, lengths
from tests.helpers.noise import close_up, views

pytestmark = pytest.mark.usefixtures("shared_programs")

TRIANGLE = ((0.25, 0.2), (0.9, 0.35), (0.4, 0.85))
# an L
CORNER = ((0.2, 0.1), (0.5, 0.1), (0.5, 0.5), (0.85, 0.5), (0.85, 0.8), (0.2, 0.8))


def planes_of(outline: Any, camera: sg.Camera) -> tuple[Plane, ...]:
    """Planes through the sides of a convex outline, whose corners follow each other clockwise, that keep its inside."""
    width, height = camera.size
    x, y = (np.array(outline) - 0.5).T * np.array([[width / height], [1]]) * camera.extent
    rays = np.stack([x, y, np.ones(len(x))], axis=1) @ camera.eye_from_world
    found = []
    for a, b in zip(rays, np.roll(rays, -1, axis=0), strict=True):
        if camera.perspective:
            normal, place = np.cross(a, b), camera.eye
        else:
            normal, place = np.cross(camera.forward, b - a), camera.eye + a
        normal = normal / np.linalg.norm(normal)
        found.append((*normal.tolist(), float(normal @ place)))
    return tuple(found)


@pytest.mark.parametrize("grid", ["cubes", "1:2:5", "sheared"])
@pytest.mark.parametrize("view", ["fitted", "parallel"])
def test_a_block_is_as_deep_as_what_scissors_leave(grid: str, view: str, renderer: sg.Renderer) -> None:
    """X-rays of fog from another side: within a hundredth of a voxel of the closed form, but at edges."""
    volume = block(grid)
    whole = sg.extract(volume, FOG)
    drawn_in = views(whole)[view]
    camera = close_up(volume, 200, 50, (48, 40))
    inside = lengths(volume, camera, planes_of(TRIANGLE, drawn_in))
    full = lengths(volume, camera, ())
    assert 0.05 < inside.sum() / full.sum() < 0.9
    for keep in (True, False):
        splats = sg.extract(volume.masked(Scissors(TRIANGLE, keep, drawn_in)), FOG)
        image = renderer.render(splats, camera, PLAIN.replace(blend="xray"))
        right = inside if keep else full - inside
        apart = np.abs(image.pixels[..., 3] / -np.log(1 - OPACITY) - right) / splats.grid.mean_spacing
        # where an edge of the block or of the outline passes, it is rounded
        assert np.quantile(apart, 0.9) < 0.01 and np.quantile(apart, 0.95) < 0.15 and apart.max() < 0.75


@pytest.mark.parametrize("technique", ["quads", "tiles"])
def test_scissored_pictures_are_the_reference(technique: Any, renderer: sg.Renderer) -> None:
    volume = field("sheared")
    whole = sg.extract(volume, SOLID)
    splats = sg.extract(volume.masked(Scissors(CORNER, camera=views(whole)["parallel"])), SOLID)
    settings = PLAIN.replace(technique=technique)
    side = views(whole)["fitted"]
    found, right = renderer.render(splats, side, settings).pixels, reference.render(splats, side, settings).pixels
    assert np.abs(right - reference.render(whole, side, settings).pixels).max() > 0.1
    assert np.abs(found - right).max() < 2e-3


def test_what_lies_under_an_outline_is_gone_from_its_picture(renderer: sg.Renderer) -> None:
    """Of opaque matter, seen from where it is drawn: nothing a voxel inside, all of it a voxel outside."""
    volume = block("sheared")
    opaque = sg.Transfer([(0.0, 0.999)], shading=True)
    camera = sg.Camera.orbit(volume, 20, 30, size=(64, 48), zoom=2)
    pictures = []
    for keep in (False, True):
        cut = volume.masked(Scissors(CORNER, keep, camera))
        pictures.append(renderer.render(sg.extract(cut, opaque), camera, PLAIN).pixels[..., 3])
    y, x = np.mgrid[:48, :64] + 0.5
    under = ((x > 0.2 * 64) & (x < 0.5 * 64) & (y > 0.1 * 48) & (y < 0.8 * 48)) | (
        (x > 0.4 * 64) & (x < 0.85 * 64) & (y > 0.5 * 48) & (y < 0.8 * 48)
    )
    around = np.zeros_like(under)
    # half a voxel at the ends of the volume
    for dy, dx in np.ndindex(9, 9):
        around |= np.roll(under, (dy - 4, dx - 4), (0, 1)) != under
    assert (under & ~around).sum() > 100
    whole = renderer.render(sg.extract(volume, opaque), camera, PLAIN).pixels[..., 3] > 0.99
    assert (pictures[0] > 0.99)[~under & ~around & whole].all() and (pictures[0] < 0.01)[under & ~around].all()
    assert (pictures[1] < 0.01)[~under & ~around].all() and (pictures[1] > 0.99)[under & ~around].all()


@pytest.mark.parametrize("keep", [True, False])
def test_voxels_are_kept_by_their_centers(keep: bool) -> None:
    """A face 0.3 voxels beyond the centres of a plane, which the mask's ramp covers in part."""
    volume = sg.Volume(np.ones((4, 5, 10)))
    camera = sg.Camera.orthographic((4.5, -30, 1.5), (4.5, 2, 1.5), (0, 0, 1), height=10, size=(100, 100))
    share = (4.3 - 4.5) / 10 + 0.5
    scissors = Scissors(((-1, -1), (share, -1), (share, 2), (-1, 2)), keep, camera)
    kept = scissors.keeps(volume, (0, 0, 0), volume.shape)
    assert (kept == ((np.arange(10) < 4.3) == keep)).all()


def test_a_view_in_another_frame_is_turned() -> None:
    samples = np.ones((6, 7, 8))
    camera = sg.Camera.look_at((3, -30, 3), (3, 3, 3), (0, 0, 1), size=(32, 32))
    scissors = Scissors(((0, 0), (0.5, 0), (0.5, 1), (0, 1)), camera=camera, frame="LPS")
    here = sg.Volume(samples, frame="LPS").masked(scissors).kept((0, 0, 0), samples.shape)
    # the same places, written in RAS
    turned = sg.Volume(samples, direction=np.diag([-1.0, -1.0, 1.0]), frame="RAS").masked(scissors)
    assert (here == turned.kept((0, 0, 0), samples.shape)).all() and 0 < here.sum() < here.size


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ("0.1,0.2 0.3,0.4", "scissors: expected x,y x,y x,y"),
        ("0.1,0.2 0.3,0.4 0.5", "got '0.1,0.2 0.3,0.4 0.5'"),
        ("0.1,0.2 0.1,0.4 0.1,0.9", "scissors: expected"),
        ("120,40 300,80 90,90", "fractions of the picture's width"),
        (3, "scissors: expected"),
        ({"outline": "0,0 1,0 1,1", "eye": [1, 2, 3]}, "eye, look_at, up, and fov or height"),
        ({"outlines": "0,0 1,0 1,1"}, "did you mean outline"),
    ],
)
def test_what_is_no_outline_is_told(given: Any, told: str) -> None:
    with pytest.raises(InputError, match=told) as found:
        Scissors.of(given)
    assert "\n" not in str(found.value)


def test_scissors_that_leave_nothing_are_told() -> None:
    volume = block(size=6)
    camera = sg.Camera.orbit(volume, size=(16, 16))
    with pytest.raises(InputError, match="mask scissors: expected an outline that leaves some of the volume, got none"):
        volume.masked(Scissors("-1,-1 2,-1 2,2 -1,2", camera=camera))


def test_commands_scene_files_and_python_agree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And a scene file that has the view of its scissors draws them from another side."""
    monkeypatch.chdir(tmp_path)
    samples = field().samples
    np.save("a.npy", samples)
    text = "0.5,0 1,0 1,1 0.5,1"
    stated = ["--fit", "0.3", "--background", "transparent"]
    assert main(["render", "a.npy", "-o", "out.npy", "--size", "32", "--quiet", *stated, "--scissors", text]) == 0
    right = np.load("out.npy")
    options = {"size": 32, "fit": "0.3", "background": "transparent"}
    assert np.array_equal(sg.render("a.npy", scissors=text, **options).pixels, right)
    # the view stays that of the whole, and its left half is untouched, but for the light near the face
    whole = sg.render("a.npy", **options).pixels
    assert np.abs(right[:, :11] - whole[:, :11]).max() < 4e-3 < whole[:, :11].max()
    assert right[:, 18:].max() == 0 < whole[:, 18:].max()
    Path("scene.toml").write_text(f'volume = "a.npy"\nscissors = ["{text}"]\n[camera]\nsize = [32, 32]\nfit = "0.3"\n')
    assert np.array_equal(sg.render("scene.toml", background="transparent").pixels, right)
    view = ViewOptions(size=(32, 32), fit="0.3")
    opened = OpenScene.read(SceneFile("a.npy", scissors=(Scissors(text),), view=view))
    assert opened.camera == OpenScene.read(SceneFile("a.npy", view=view)).camera
    Path("fixed.toml").write_text(opened.file.to_toml(tmp_path))
    assert "[[scissors]]" in Path("fixed.toml").read_text()
    from_side = [sg.render(name, azimuth=100, size=32).pixels for name in ("fixed.toml", "scene.toml")]
    assert np.abs(sg.render("fixed.toml", background="transparent").pixels - right).max() < 2e-3
    assert np.abs(from_side[0] - from_side[1]).max() > 0.1


def test_scissors_cut_every_layer() -> None:
    first, second = field(), field("1:2:5")
    look = {"blend": "xray", "antialias": "off", "size": 32}
    pixels = sg.render(first, layers=[second], scissors="0.5,0 1,0 1,1 0.5,1", **look).pixels
    assert pixels[:, 18:].max() == 0 < pixels[:, :14].max()


# --- segments that planes leave whole --------------------------------------------------------------------------------


def segments() -> sg.Volume:
    """Three slabs along x, of labels 1, 2 and 3."""
    return sg.Volume((1 + np.indices((12, 12, 12))[2] // 4).astype(np.uint8), labels=())


def test_a_segment_is_left_whole(renderer: sg.Renderer) -> None:
    """As if it were a layer of its own that nothing cuts; the others end at the plane."""
    volume, solid = segments(), sg.Transfer([(0, 0)], labels=[(n, "#ff0000", 0.9) for n in (1, 2, 3)], shading=False)
    camera = sg.Camera.orthographic((5.5, -30, 5.5), (5.5, 5.5, 5.5), (0, 0, 1), height=12, size=(24, 24))
    drawn = renderer.render(sg.Scene([sg.Layer(volume, solid, uncut=2)], clip=["z>0.5"]), camera, PLAIN).pixels[..., 3]
    # the lower half of segments 1 and 3 is gone
    assert (drawn[:12] > 0.99).all() and (drawn[12:, 8:16] > 0.99).all()
    assert drawn[13:, :8].max() == drawn[13:, 16:].max() == 0
    for same in ("2", [2], np.int64(2), (volume.samples == 2).astype(np.uint8)):
        scene = sg.Scene([sg.Layer(volume, solid, uncut=same)], clip=["z>0.5"])
        assert np.array_equal(renderer.render(scene, camera, PLAIN).pixels[..., 3], drawn)
    # several, and all but one
    outside = sg.Scene([sg.Layer(volume, solid, uncut="1,3:outside")], clip=["z>0.5"])
    assert np.array_equal(renderer.render(outside, camera, PLAIN).pixels[..., 3], drawn)


def test_a_part_of_a_field_is_left_whole(renderer: sg.Renderer) -> None:
    """Lengths of fog: cut by the plane, but in the part; both pieces meet without a gap or an overlap."""
    volume = block()
    part = (np.indices(volume.shape)[2] < 8).astype(np.uint8)
    camera = sg.Camera.orbit(volume, 30, 20, size=(40, 40))
    plane = (0.0, 0.0, 1.0, 9.5)
    scene = sg.Scene([sg.Layer(volume, FOG, uncut=part)], clip=[plane])
    image = renderer.render(scene, camera, PLAIN.replace(blend="xray")).pixels[..., 3] / -np.log(1 - OPACITY)
    left, right = (-1.0, 0.0, 0.0, -7.5), (1.0, 0.0, 0.0, 7.5)
    true = lengths(volume, camera, (left,)) + lengths(volume, camera, (right, plane))
    assert np.abs(image - true).max() < 0.02 and np.abs(true - lengths(volume, camera, (plane,))).max() > 3


@pytest.mark.few(1)
@pytest.mark.parametrize("technique", ["quads", "tiles"])
def test_cut_and_whole_parts_are_the_reference(technique: Any, renderer: sg.Renderer) -> None:
    volume = field()
    part = (np.indices(volume.shape)[2] < 8).astype(np.uint8)
    drawn = sg.Scene([sg.Layer(volume, SOLID, uncut=part)], clip=["z>0.5"])
    camera, settings = sg.Camera.orbit(block(), 30, 20, size=(20, 20)), PLAIN.replace(technique=technique)
    found = renderer.render(drawn, camera, settings).pixels
    assert np.abs(found - reference.render(drawn, camera, settings).pixels).max() < 2e-3 < found.max()


def test_the_command_leaves_segments_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    np.save("seg.npy", segments().samples)
    line = ["render", "seg.npy", "-o", "a.npy", "--size", "32", "--quiet", "--clip", "z>0.5", "--values", "labels"]
    line += ["--background", "transparent"]
    assert main([*line, "--uncut", "2"]) == 0
    found = np.load("a.npy")
    look: Any = {"size": 32, "clip": "z>0.5", "values": "labels", "background": "transparent"}
    assert np.array_equal(sg.render("seg.npy", **look, uncut=2).pixels, found)
    text = 'volume = "seg.npy"\nclip = ["z>0.5"]\nuncut = "2"\n[load]\nvalues = "labels"\n[camera]\nsize = [32, 32]\n'
    Path("scene.toml").write_text(text)
    assert np.array_equal(sg.render("scene.toml", background="transparent").pixels, found)
    assert SceneFile.from_toml(Path("scene.toml")).uncut == "2"
    assert main(line) == 0 and (np.load("a.npy")[..., 3] > 0).sum() < (found[..., 3] > 0).sum()
    assert main([*line, "--uncut", "9"]) == 2

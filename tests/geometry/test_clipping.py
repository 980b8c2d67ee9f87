"""Volumes cut by planes: closed forms, the float64 reference, and conditions in words."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl import reference
from splatgl.cli.main import main
from splatgl.errors import InputError
from splatgl.geometry.clipping import (
    MOST_CLIPS,
    ClipUnits,
    Plane,
    check_planes,
    clip_corners,
    crop_planes,
    parse_planes,
)
from splatgl.geometry.grid import corners_of
from splatgl.planning.bricks import Bricks
from splatgl.reference.field import kept_field_integral
from splatgl.scene.scene_file import SceneFile
from splatgl.splat.lighting import AMBIENT, DIFFUSE, LIGHTS
from tests.helpers.blocks import FOG, OPACITY, PLAIN, SOLID, block, field, lengths
from tests.helpers.noise import GRIDS, views
from tests.helpers.splatting import each_two

pytestmark = pytest.mark.usefixtures("shared_programs")

# normals, and distances from the middle in shares of the diagonal
CUTS = (((0.3, 0.5, 0.8), -0.05), ((-0.6, 0.2, 0.1), -0.12))


def cut(volume: sg.Volume, cuts: Any = CUTS) -> tuple[Plane, ...]:
    middle = volume.corners.mean(axis=0)
    size = float(np.linalg.norm(np.ptp(volume.corners, axis=0)))
    return check_planes([(*n, float(np.dot(n, middle) + d * size * np.linalg.norm(n))) for n, d in cuts])


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("grid", "view", "technique"), each_two(GRIDS, ("fitted", "parallel", "wide"), ("quads", "tiles"))
)
def test_a_cut_block_is_as_deep_as_what_is_left(grid: str, view: str, technique: Any, renderer: sg.Renderer) -> None:
    """X-rays of fog: within a hundredth of a voxel of the closed form, on every grid."""
    volume = block(grid)
    splats, found = sg.extract(volume, FOG), cut(volume)
    camera = views(splats)[view]
    image = renderer.render(splats, camera, PLAIN.replace(blend="xray", clip=found, technique=technique))
    right = lengths(volume, camera, found)
    whole = lengths(volume, camera, ())
    assert 0.05 < right.sum() / whole.sum() < 0.9
    apart = np.abs(image.pixels[..., 3] / -np.log(1 - OPACITY) - right)
    assert apart.max() < 0.01 * splats.grid.mean_spacing


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("blend", "technique"),
    [("composite", "tiles"), ("xray", "quads"), ("mip", "tiles"), ("minip", "quads"), ("mean", "tiles")],
)
def test_cut_pictures_are_the_reference(blend: str, technique: Any, renderer: sg.Renderer) -> None:
    volume = field("sheared")
    settings = PLAIN.replace(blend=blend, clip=cut(volume), technique=technique)
    how = "post" if blend in ("composite", "xray") else "post-all"
    splats = sg.extract(volume, SOLID, classification=how)
    for name in ("fitted", "parallel", "close"):
        camera = views(splats)[name]
        found = renderer.render(splats, camera, settings).pixels
        right = reference.render(splats, camera, settings).pixels
        assert np.abs(right - reference.render(splats, camera, settings.replace(clip=())).pixels).max() > 0.1
        # values at a table's cell may fall into the next
        off = np.abs(found - right) / max(np.abs(right).max(), 1.0)
        assert off.max() < 2e-3 and off.mean() < 1e-5


@pytest.mark.long
@pytest.mark.parametrize("blend", ["composite", "xray"])
def test_cut_pictures_are_those_of_the_field(blend: str, renderer: sg.Renderer) -> None:
    """Of the cut field itself, lit as a face where a plane cuts it: the error is that of the uncut picture."""
    volume = field(size=24)
    splats = sg.extract(volume, SOLID, classification="post")
    camera = views(splats)["fitted"]
    pixels = np.arange(camera.size[0] * camera.size[1])[::3]
    off = {}
    for found in ((), cut(volume)):
        settings = sg.Settings(blend=blend, clip=found, antialias="off", tolerance=1e-4)
        image = renderer.render(splats, camera, settings).pixels.reshape(-1, 4)[pixels]
        right = kept_field_integral(splats, camera, pixels, settings=settings)
        off[len(found)] = np.sqrt(((image - right) ** 2).mean()) / np.abs(right).max()
    assert off[2] < max(1.5 * off[0], 5e-3)


@pytest.mark.long
def test_faces_are_lit_by_their_planes(renderer: sg.Renderer) -> None:
    """Opaque matter without gradients, cut: ambient and diffuse light by the angle to the plane's normal."""
    volume = block()
    normal = np.array([0.5, 0.7, -0.4]) / np.linalg.norm([0.5, 0.7, -0.4])
    middle = volume.corners.mean(axis=0)
    camera = sg.Camera.orthographic(middle - np.array([0, 60, 0]), middle, (0, 0, 1), height=8, size=(8, 8))
    opaque = sg.Transfer([(0.0, 0.999999)], colormap="gray", window=(0, 1), unit=0.05, shading=True)
    splats = sg.extract(volume, opaque)
    settings = PLAIN.replace(clip=[(*normal, float(normal @ middle))])
    found = renderer.render(splats, camera, settings).pixels
    whole = renderer.render(splats, camera, PLAIN).pixels
    light = AMBIENT + DIFFUSE * normal[1]
    assert np.abs(found[..., :3] / whole[..., :3] - light).max() < 1e-3
    for name in ("matte", "glossy"):
        light = LIGHTS[name]
        a, b = np.radians([light.side, light.above])
        at, eye = np.array([np.sin(a) * np.cos(b), -np.cos(a) * np.cos(b), np.sin(b)]), np.array([0, -1.0, 0])
        half = (at + eye) / np.linalg.norm(at + eye)
        right = light.ambient + light.diffuse * max(-normal @ at, 0)
        right += light.specular * max(-normal @ half, 0) ** 2**light.sharpness
        found = renderer.render(splats, camera, settings.replace(light=name)).pixels
        assert np.abs(found[..., :3] - right).max() < 1e-3
    unlit = renderer.render(splats, camera, settings.replace(shading="off")).pixels
    assert np.abs(unlit - renderer.render(splats, camera, PLAIN.replace(shading="off")).pixels).max() < 2e-4


@pytest.mark.few(1)
@pytest.mark.parametrize("technique", ["tiles", "quads"])
def test_faces_are_one_voxel_deep(technique: Any, renderer: sg.Renderer) -> None:
    """Fog without gradients: the plane lights the first voxel along a ray behind the cut, what is behind is not lit."""
    volume = block()
    middle = volume.corners.mean(axis=0)
    fog = sg.Transfer([(0.0, 0.3)], colormap="gray", window=(0, 1), unit=1.0, shading=True)
    camera = sg.Camera.orthographic(middle - np.array([0, 60, 0]), middle, (0, 0, 1), height=4, size=(6, 6))
    normal = np.array([0.5, 0.7, 0.0]) / np.linalg.norm([0.5, 0.7, 0.0])
    settings = PLAIN.replace(clip=[(*normal, float(normal @ middle))], technique=technique)
    found = renderer.render(sg.extract(volume, fog), camera, settings).pixels
    # rays are 10 voxels long in the middle of the block: nothing is seen behind
    near, lit = 1 - 0.7**1.0, AMBIENT + DIFFUSE * normal[1]
    x = camera.eye_from_world[0, 0] * ((np.arange(6) + 0.5) / 6 - 0.5) * 4
    through = 0.7 ** (10 + x * normal[0] / normal[1])
    assert np.abs(found[..., 3] - (1 - through)).max() < 1e-3
    assert np.abs(found[..., 0] - (lit * near + (1 - near) - through)).max() < 2e-3


@pytest.mark.long
def test_planes_that_cut_nothing_change_nothing(renderer: sg.Renderer) -> None:
    volume = field()
    splats = sg.extract(volume, SOLID)
    camera = views(splats)["fitted"]
    beside = PLAIN.replace(clip=[(1, 0, 0, -100.0), (0, 0, -2, -300.0)])
    plans = [renderer.plan(splats, camera, each) for each in (PLAIN, beside)]
    assert [each.program.appearance.clipped for each in plans] == [False, True] and plans[0].key != plans[1].key
    pair = [renderer.render(splats, camera, each).pixels for each in (PLAIN, beside)]
    assert np.abs(pair[0] - pair[1]).max() < 1e-6


def test_voxels_classified_before_are_cut_whole(renderer: sg.Renderer) -> None:
    volume = field()
    splats = sg.extract(volume, SOLID, classification="pre")
    camera, found = views(splats)["fitted"], cut(volume)
    rows = np.array(found)
    world = splats.positions @ volume.world_from_index.T + volume.origin
    kept = splats.part((world @ rows[:, :3].T >= rows[:, 3]).all(axis=1))
    assert 0 < len(kept) < len(splats)
    drawn = renderer.render(splats, camera, PLAIN.replace(clip=found))
    assert (drawn.pixels == renderer.render(kept, camera, PLAIN).pixels).all()
    right = reference.render(splats, camera, PLAIN.replace(clip=found)).pixels
    assert drawn.info["error_bound"] and np.abs(drawn.pixels - right).max() <= drawn.info["error_bound"]


@pytest.mark.long
def test_bricks_that_are_cut_off_are_not_read(renderer: sg.Renderer) -> None:
    """The picture is the whole one's, and a quarter of the bricks is enough."""
    volume = field(size=96)
    splats = sg.extract(volume, SOLID)
    camera = views(splats)["fitted"]
    settings = PLAIN.replace(clip=crop_planes("60:,60:,:", volume))
    bricks = Bricks.of(volume, splats.post, 32)
    image = renderer.render_bricks(bricks, camera, settings)
    assert np.abs(image.pixels - renderer.render(splats, camera, settings).pixels).max() < 1e-6
    assert len(bricks.found) == 12 < len(bricks.low)


@pytest.mark.long
def test_layers_have_planes_of_their_own(renderer: sg.Renderer) -> None:
    """The scene's planes cut layers without any; a layer's are those of its own box; none cut a layer with none."""
    first, second = field(), field("1:2:5")
    looks = [sg.Layer(first, SOLID), sg.Layer(second, SOLID, clip=["z<0.5"])]
    scene = sg.Scene(looks, clip="x>0.5")
    camera = sg.Camera.orbit(second, 30, 20, size=(48, 36))
    high = np.ptp(second.corners[:, 2])
    assert scene.planes[1] == ((0.0, 0.0, -1.0, pytest.approx(-(second.corners[0, 2] + high / 2))),)
    assert scene.planes[0][0][3] == pytest.approx((min(-0.5, second.corners[0, 0]) + second.corners[1, 0]) / 2)
    image = renderer.render(scene, camera, PLAIN)
    assert np.abs(image.pixels - reference.render(scene, camera, PLAIN).pixels).max() < 2e-3
    whole = sg.Scene([looks[0], sg.Layer(second, SOLID, clip=())], clip="x>0.5")
    assert whole.planes[1] == ()
    assert np.abs(renderer.render(whole, camera, PLAIN).pixels - image.pixels).max() > 0.1


@pytest.mark.parametrize(
    ("text", "plane"),
    [
        ("x>0.25", (1, 0, 0, 2.0)),
        ("z <= 0.5", (0, 0, -1, -12.0)),
        ("y>12mm", (0, 1, 0, 12.0)),
        ("y>1.2cm", (0, 1, 0, 12.0)),
        ("-x<-3mm", (1, 0, 0, 3.0)),
        ("x+y>1", (1 / np.sqrt(2) * 20 / np.hypot(20, 8) * np.sqrt(2), None, 0, None)),
        ("1,2,3:0,0,2", (0, 0, 1, 3.0)),
    ],
)
def test_conditions(text: str, plane: tuple[Any, ...]) -> None:
    """Of fractions of a box of 8 × 20 × 24 millimetres, of lengths, and by a point and a normal."""
    box = ClipUnits(np.zeros(3), np.array([8.0, 20.0, 24.0]), "mm")
    (found,) = parse_planes(text, box)
    for mine, right in zip(found, plane, strict=True):
        assert right is None or mine == pytest.approx(right)
    if text == "x+y>1":
        # through the corners at which one fraction is 1
        n, d = np.array(found[:3]), found[3]
        assert n @ [8, 0, 5] == pytest.approx(d) and n @ [0, 20, 5] == pytest.approx(d)


@pytest.mark.parametrize(
    "text",
    ["x", "x>", "w>0.5", "x>1.5", "x>-1", "x>3parsec", "x>0.2y", "1,2:3", "1,2,3:0,0,0", "0x>0.5", "x>nan", "x>0.5:"],
)
def test_conditions_that_say_nothing(text: str) -> None:
    with pytest.raises(InputError, match="clip: expected"):
        parse_planes(text, ClipUnits(np.zeros(3), np.ones(3), "mm"))


@pytest.mark.parametrize(
    "given", [[(0, 0, 0, 1)], [(1, 0, 0)], [(1, 0, 0, np.inf)], 3, [(1, 0, 0, 1)] * (MOST_CLIPS + 1)]
)
def test_planes_that_are_none(given: Any) -> None:
    with pytest.raises(InputError, match="clip: expected"):
        sg.Settings(clip=given)


def test_planes_that_leave_nothing() -> None:
    with pytest.raises(InputError, match=r"planes that leave something of the volume, got x>0\.9, x<0\.1"):
        parse_planes(["x>0.9", "x<0.1"], ClipUnits(np.zeros(3), np.ones(3)))


def test_cuts_that_leave_no_visible_voxel_are_named() -> None:
    """The planes leave a part of the box, in which all voxels are transparent."""
    with pytest.raises(sg.InputError, match="got none; clip or crop less, lower --threshold"):
        sg.render("letter-f", clip="x>0.4", crop=":20,:,:", size=16)


def test_corners_of_what_is_left() -> None:
    """Of a cube that loses a corner, and of a sheared box."""
    cube = corners_of(np.zeros(3), np.ones(3))
    found = clip_corners(check_planes([(-1, -1, -1, -2.5)]), cube)
    assert len(np.unique(found.round(6), axis=0)) == 7 + 3
    sheared = field("sheared")
    assert {tuple(p) for p in clip_corners((), sheared.corners).round(6)} == {
        tuple(p) for p in sheared.corners.round(6)
    }


def test_parts_in_voxels() -> None:
    """Planes between voxels, on a sheared grid, none along the volume's own faces."""
    volume = field("sheared")
    found = np.array(crop_planes("2:,:-3,:", volume))
    assert len(found) == 2
    index = np.array([[1.5, 5, 5], [7, 12.5, 3]])
    world = index @ volume.world_from_index.T + volume.origin
    assert np.abs((found[:, :3] * world).sum(axis=1) - found[:, 3]).max() < 1e-9
    for bad in ("1:2", "5:2,:,:", "a:b,:,:", "1,2,3", "99:,:,:"):
        with pytest.raises(InputError, match="crop: expected"):
            crop_planes(bad, volume)


def test_scenes_keep_their_cuts(tmp_path: Path) -> None:
    """Written to a file and read again; a layer's empty list too."""
    scene = SceneFile(
        "fog", clip=("x>0.3", "z<10mm"), crop="1:9,:,:", layers=(SceneFile("fog", clip=()), SceneFile("fog"))
    )
    path = tmp_path / "scene.toml"
    path.write_text(scene.to_toml(tmp_path))
    again = SceneFile.from_toml(path)
    assert (again.clip, again.crop) == (scene.clip, scene.crop)
    assert [each.clip for each in again.layers] == [(), None]
    path.write_text('volume = "fog"\nclip = [3]\n')
    with pytest.raises(InputError, match="clip: expected conditions"):
        SceneFile.from_toml(path)


@pytest.mark.long
def test_commands_cut(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`--clip` and `--crop` draw what `sg.render` draws; a cropped view is fitted to the part."""
    data = np.random.default_rng(1).random((20, 20, 20)).astype(np.float32)
    np.save(tmp_path / "a.npy", data)
    options = ["--size", "48", "--check", "0", "--quiet", "--points", "0.3:0,0.9:0.7", "--background", "transparent"]
    source, out = str(tmp_path / "a.npy"), tmp_path / "o.npy"
    assert main(["render", source, "-o", str(out), "--clip", "x>0.4", "--clip", "y+z<1.2", *options]) == 0
    look: Any = {"size": 48, "points": ((0.3, 0), (0.9, 0.7)), "background": "transparent"}
    same = sg.render(source, **look, clip=["x>0.4", "y+z<1.2"])
    assert (np.load(out) == same.pixels).all()
    assert main(["render", source, "-o", str(out), "--crop", "5:10,5:10,5:10", *options]) == 0
    near = np.load(out)[..., 3]
    assert (near == sg.render(source, **look, crop="5:10,5:10,5:10").pixels[..., 3]).all()
    assert near[:, 4:-4].any() and np.flatnonzero(near.any(axis=1)).size > 30
    assert main(["render", source, "-o", str(out), "--clip", "x>2", *options]) == 2
    assert capsys.readouterr().err.startswith("splatgl: --clip: expected a fraction")

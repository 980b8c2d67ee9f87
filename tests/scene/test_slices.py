"""Sheets of slices, and planes in space among volumes and meshes, by closed forms and the float64 reference."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import splatgl as sg
from splatgl import reference
from splatgl.cli.main import main
from splatgl.errors import InputError
from splatgl.geometry.slices import SliceLayer
from splatgl.scene.scene_file import SceneFile
from splatgl.viewer.slice_planes import layer_painter
from tests.helpers.meshes import PLAIN, RED, block, cloud, knots

pytestmark = pytest.mark.usefixtures("shared_programs")

OPACITY = 0.05
FOG = sg.Transfer([(0.0, OPACITY)], colormap="gray", window=(0, 2), unit=1.0)
RAMP = sg.Transfer([(0.0, OPACITY)], colormap="gray", window=(0, 24), unit=1.0, shading=False)


def ramp() -> sg.Volume:
    """Values that grow along x, in fog of one density."""
    return sg.Volume(np.broadcast_to(np.arange(24, dtype=np.float32), (24, 24, 24)))


# x of the middles of the columns of `ahead`, between the voxels' middles
X = 1.7 + np.arange(20) + 0.5


def ahead() -> sg.Camera:
    """Along y, one world unit a pixel."""
    middle = np.array([11.7, 11.5, 11.6])
    return sg.Camera.orthographic(middle - np.array([0, 60, 0]), middle, (0, 0, 1), height=20, size=(20, 20))


# --- planes in space --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("opacity", [1.0, 0.4])
@pytest.mark.parametrize("depth", [7.0, 9.37])
def test_planes_in_fog(depth: float, opacity: float, renderer: sg.Renderer) -> None:
    """What lies before a plane weakens it; it shows the field's colours, unlit; what lies behind shines through."""
    scene = sg.Scene([sg.Layer(ramp(), RAMP)], slices=[f"y={depth}@{opacity}"])
    color = RAMP.color(X)[:, 0]
    before, behind = ((1 - OPACITY) ** length for length in (depth + 0.5, 23.5 - depth))
    light = color * ((1 - before) + before * (opacity + (1 - opacity) * (1 - behind)))
    alpha = 1 - before * (1 - opacity) * behind
    picture = renderer.render(scene, ahead(), PLAIN)
    exact = reference.render(scene, ahead(), PLAIN).pixels
    assert np.abs(exact[9, :, 0] - light).max() < 2e-4 and np.abs(exact[9, :, 3] - alpha).max() < 2e-4
    assert np.abs(picture.pixels - exact).max() < 5e-5
    assert picture.info["triangles"] == 2


@pytest.mark.turns(2)
@pytest.mark.few(4)
@pytest.mark.parametrize("grid", ["cubes", "sheared", "1:2:5"])
@pytest.mark.parametrize("where", ["z=6.3", "oblique"])
@pytest.mark.parametrize("kind", ["amounts", "logarithms", "labels", "colours", "layers"])
def test_planes_among_clouds_and_meshes_are_the_reference(
    kind: str, where: str, grid: str, renderer: sg.Renderer
) -> None:
    """Texels between which cubics lie against the field at each crossing; borders of labels may be a texel off."""
    volume, look = cloud(grid), sg.Transfer([(0.3, 0), (0.7, 0.03)], colormap="viridis", shading=True)
    text = f"{','.join(map(str, volume.center))}:1,2,-1.5" if where == "oblique" else where
    layers = [sg.Layer(volume, look)]
    if kind == "logarithms":
        volume = sg.Volume(volume.samples + 0.01, volume.spacing, volume.origin, volume.direction)
        layers = [sg.Layer(volume, sg.Transfer([(0.1, 0), (1.01, 0.03)], "viridis", window=(0.1, 1.01), scale="log"))]
    if kind == "labels":
        volume = sg.Volume((volume.samples * 4).astype(np.uint8), volume.spacing, volume.origin, volume.direction)
        layers = [sg.Layer(volume.of_values("labels"), opacity=0.05)]
    if kind == "colours":
        color = (np.stack([volume.samples] * 3, axis=-1) * [255, 128, 64]).astype(np.uint8)
        volume = sg.Volume(volume.samples, volume.spacing, volume.origin, volume.direction, color=color)
        layers = [sg.Layer(volume, sg.Transfer([(0.3, 0), (0.7, 0.03)]))]
    if kind == "layers":
        layers.append(sg.Layer(cloud("1:2:5"), sg.Transfer([(0.4, 0), (0.9, 0.03)], "hot"), opacity=0.5))
    scene = sg.Scene(layers, meshes=knots(volume)[1:2], slices=[f"{text}@0.7"])
    camera = sg.Camera.orbit(scene, 30, 20, size=(48, 40))
    found = renderer.render(scene, camera, PLAIN).pixels
    right = reference.render(scene, camera, PLAIN).pixels
    off = np.abs(found - right).max(axis=2)
    without = renderer.render(sg.Scene(layers, meshes=knots(volume)[1:2]), camera, PLAIN).pixels
    covered = np.abs(found - without).max(axis=2) > 0.05
    assert covered.sum() > 15
    # pixels at the outline may be given to the other side
    most, middle = {"labels": (0.1, 1e-6), "layers": (0.4, 2e-3)}.get(kind, (0.15, 1e-3))
    if kind == "amounts" and where != "oblique" and grid != "sheared":
        most, middle = 0.0, 5e-6
    assert (off > 4e-3).sum() <= most * covered.sum() and np.median(off[covered]) < middle


def test_oblique_planes_end_at_the_box(renderer: sg.Renderer) -> None:
    """Not at the last texel within it, which left teeth of an eighth of a voxel."""
    volume = cloud("turned")
    clear = sg.Transfer([(0.0, 0.0)], "gray", window=(-1, 1))
    scene = sg.Scene([sg.Layer(volume, clear)], slices=[f"{','.join(map(str, volume.center))}:0.3,0.5,0.8"])
    camera = sg.Camera.orbit(scene, -60, 50, size=(48, 40))
    found = renderer.render(scene, camera, PLAIN).pixels[..., 3]
    right = reference.render(scene, camera, PLAIN).pixels[..., 3]
    assert right.sum() > 200 and np.count_nonzero(np.abs(found - right) > 0.5) <= 1


def test_holes_of_planes_show_what_is_behind(renderer: sg.Renderer) -> None:
    samples = np.full((24, 24, 24), 1.0, np.float32)
    samples[:, 7, 8:16] = np.nan
    behind = sg.Mesh([[0, 20, 0], [24, 20, 0], [24, 20, 24], [0, 20, 24]], [[0, 1, 2], [0, 2, 3]], color=RED)
    clear = sg.Transfer([(0.0, 0.0)], "gray", window=(0, 2))
    scene = sg.Scene([sg.Layer(sg.Volume(samples), clear)], meshes=[behind], slices=["y=7"])
    settings = PLAIN.replace(shading="off")
    for draw in (renderer.render, reference.render):
        pixels = draw(scene, ahead(), settings).pixels
        hole = (X > 7.5) & (X < 15.5)
        assert np.abs(pixels[10, hole, :3] - RED).max() < 1e-5
        assert np.abs(pixels[10, ~hole, :3] - clear.color(1.0)).max() < 1e-5


def test_what_planes_refuse(renderer: sg.Renderer) -> None:
    with pytest.raises(InputError, match="slice: expected a voxel from 0 to 23 along y, got 'y=40'"):
        sg.Scene([sg.Layer(block(), FOG)], slices=["y=40"])
    scene = sg.Scene([sg.Layer(block(), FOG)], slices=["y=4"])
    pytest.importorskip("pyvista")
    with pytest.raises(InputError, match="slices and caps: expected none in a plotter"):
        scene.to_pyvista(off_screen=True)
    with pytest.raises(InputError, match="expected blend composite, got mip"):
        renderer.render(scene, ahead(), PLAIN.replace(blend="mip"))


# --- sheets -----------------------------------------------------------------------------------------------------------


def rows_of(info: Mapping[str, Any]) -> list[dict[str, Any]]:
    """What a picture says of its slices."""
    return list(info["slices"])


def test_a_slice_is_the_window_of_the_field() -> None:
    """A linear field, whose picture is a linear ramp of light between the pixels' centres, however large it is."""
    volume = sg.Volume(np.broadcast_to(np.arange(20, dtype=np.float32), (20, 20, 20)), unit="mm")
    image = sg.render(volume, sg.Transfer([(0, 0), (19, 1)], "gray", window=(0, 19)), slices="z=4.5", size=(100, 100))
    (row,) = rows_of(image.info)
    left, top, right, bottom = row["pixels"]
    assert right - left == bottom - top > 80
    x = (np.arange(right - left) + 0.5) * float(str(image.info["pitch"])) - 0.5
    light = sg.Transfer([(0, 0), (19, 1)], "gray", window=(0, 19)).color(x)
    assert np.abs(image.pixels[top + 60, left:right, :3] - light).max() < 1e-6
    assert np.abs(np.asarray(row["normal"])[2]) == 1 and image.info["unit"] == "mm"


@pytest.mark.parametrize("sides", [(20, 13), (13, 20), (7, 19)])
def test_a_slice_lies_in_the_middle_of_its_pixels(sides: tuple[int, int]) -> None:
    """Mirrored values have a mirrored picture, although the slice's shorter side is no whole number of pixels."""
    y, x = (np.abs(np.arange(count) - (count - 1) / 2) for count in sides)
    volume = sg.Volume(np.broadcast_to(y[:, None] + x, (3, *sides)))
    image = sg.render(volume, sg.Transfer([(0, 1), (20, 1)], "gray", window=(0, 20)), slices="z=1", size=(101, 101))
    (row,) = rows_of(image.info)
    left, top, right, bottom = row["pixels"]
    light = image.pixels[top:bottom, left:right, :3]
    # the halves without the title
    lower, after = light[len(light) // 2 :], light[:, (right - left) // 2 :]
    assert np.abs(lower - lower[:, ::-1]).max() < 1e-5 and np.abs(after - after[::-1]).max() < 1e-5


def test_a_picture_says_where_its_pixels_are() -> None:
    """A field that is linear in space, on planes that are turned and are not in its middle."""
    direction = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    z, y, x = np.indices((14, 20, 24))
    volume = sg.Volume(np.zeros(x.shape, np.float32), (1.5, 1.0, 2.0), (30.0, -20.0, 5.0), direction)
    at = np.stack([x, y, z], axis=-1) @ volume.world_from_index.T + volume.origin
    slope = np.array([0.3, -0.5, 0.8])
    volume = replace(volume, samples=(at @ slope).astype(np.float32))
    low, high = float(volume.samples.min()), float(volume.samples.max())
    look = sg.Transfer([(low, 0), (high, 1)], "gray", window=(low, high))
    middle = ",".join(f"{number:.6f}" for number in volume.center + 1.3)
    image = sg.render(volume, look, slices=[f"{middle}:1,2,-1", "y=3", "z=80%"], size=(320, 160), background="black")
    for row in rows_of(image.info):
        left, top, right, bottom = row["pixels"]
        j, i = np.indices((bottom - top, right - left)) + 0.5
        places = np.array(row["corner"]) + i[..., None] * row["steps"][0] + j[..., None] * row["steps"][1]
        index = np.linalg.solve(volume.world_from_index, (places - volume.origin).reshape(-1, 3).T).T
        inside = ((index > 1) & (index < np.array([22, 18, 12]))).all(axis=1).reshape(i.shape)
        inside[:20] = False  # the title
        light = image.pixels[top:bottom, left:right, 0][inside]
        assert inside.sum() > 200 and np.abs(light - look.color(places[inside] @ slope)[:, 0]).max() < 1e-4


def test_labels_over_slices_have_the_opacity_that_is_asked_for(tmp_path: Path) -> None:
    """One opacity of all labels, in the transfer function or of the layer, on the command line and in Python."""
    _, y, x = np.indices((8, 16, 16))
    image, labels = (x * 8).astype(np.uint8), np.where(x < 8, 1, 3).astype(np.uint8)
    np.save(tmp_path / "a.npy", image)
    np.save(tmp_path / "seg.npy", labels)
    volume, segments = sg.load(tmp_path / "a.npy"), sg.load(tmp_path / "seg.npy").of_values("labels")

    def picture(*options: str) -> np.ndarray:
        command = ["render", str(tmp_path / "a.npy"), "--slice", "z=4", "--size", "64", "--quiet"]
        assert main([*command, *options, "-o", str(tmp_path / "a.npy.npy")]) == 0
        return np.load(tmp_path / "a.npy.npy")[24:56, 16:48, :3]

    bare, full = picture(), picture("--labels", str(tmp_path / "seg.npy"))
    mixed = 0.7 * bare + 0.3 * full
    some = picture("--labels", str(tmp_path / "seg.npy"), "--only-labels", "1:0.3,3:0.3")
    assert np.abs(full - bare).max() > 0.3 and np.abs(some - mixed).max() < 1e-4
    own = sg.Layer(segments, opacity=0.3)
    scene = sg.Scene([sg.Layer(volume), own])
    points = np.array([[4.0, 8.0, 4.0], [12.0, 8.0, 4.0]])
    light = scene.painter("slice").light(points)[:, :3]
    first = sg.Scene([sg.Layer(volume)]).painter("slice").light(points)[:, :3]
    over = sg.Scene([sg.Layer(volume), sg.Layer(segments)]).painter("slice").light(points)[:, :3]
    assert np.abs(light - (0.7 * first + 0.3 * over)).max() < 1e-9
    looks = SliceLayer(volume, sg.default_transfer(volume)), SliceLayer(segments, sg.default_transfer(segments), 0.3)
    assert np.abs(layer_painter(looks, colored=True).light(points)[:, :3] - light).max() < 1e-9
    # amounts over amounts, too
    np.save(tmp_path / "more.npy", (y * 8).astype(np.uint8))
    whole, faint = (picture("--layer", f"{tmp_path / 'more.npy'}:hot{end}") for end in ("", ":0.3"))
    assert np.abs(faint - (0.7 * bare + 0.3 * whole)).max() < 1e-4


def test_labels_over_slices_are_outlined_and_filled_faintly(tmp_path: Path) -> None:
    """At the borders of labels, also against each other, their own colour; within, a share of it over the image."""
    image = (np.indices((3, 32, 32))[1] * 6).astype(np.uint8)
    labels = np.zeros_like(image)
    labels[:, 4:28, 4:16], labels[:, 4:28, 16:28] = 1, 2

    def picture(fill: float | None = None) -> np.ndarray:
        more = {} if fill is None else {"label_fill": fill}
        image = sg.render(image_volume, labels=labels, slices="z", size=(120, 120), **more)
        left, top, right, bottom = rows_of(image.info)[0]["pixels"]
        return image.pixels[top:bottom, left:right, :3]

    image_volume = sg.Volume(image)
    full, faint, lines = picture(1), picture(0.25), picture(0)
    size = len(full)
    inside, beside = slice(size * 7 // 32, size * 12 // 32), slice(0, size * 3 // 32)
    border = size // 2
    assert np.abs(faint - (0.75 * lines + 0.25 * full))[inside, inside].max() < 1e-5
    grey = np.ptp(lines, axis=-1)
    assert grey[inside, inside].max() < 1e-5 and np.ptp(full, axis=-1)[inside, inside].min() > 0.05
    assert np.array_equal(lines[inside, border], full[inside, border]) and grey[inside, border].min() > 0.05
    assert np.array_equal(lines[beside], full[beside]) and np.array_equal(picture(), picture(0.4))
    scene = SceneFile(str(tmp_path / "a.npy"), slices=("z",), label_fill=0.0)
    (tmp_path / "scene.toml").write_text(scene.to_toml(tmp_path))
    assert SceneFile.from_toml(tmp_path / "scene.toml").label_fill == 0
    looks = tuple(SliceLayer(each, sg.default_transfer(each)) for each in (sg.Volume(image), sg.Volume(labels)))
    assert layer_painter(looks, colored=True, fill=0.0) != layer_painter(looks, colored=True)
    with pytest.raises(InputError, match="label_fill: expected an opacity from 0 to 1, got 2"):
        picture(2)


@pytest.mark.parametrize("count", [1, 2, 4])
def test_layers_that_add_up_end_at_white(count: int) -> None:
    volumes = [sg.Volume(np.full((6, 6, 6), 0.9, np.float32)) for _ in range(count)]
    white = sg.Transfer([(0, 0), (1, 1)], "#ffffff", window=(0, 1), shading=False)
    scene = sg.Scene([sg.Layer(volume, white) for volume in volumes], slices=["z=3@0.65"])
    light = scene.painter("slice").light(np.array([[3.0, 3.0, 3.0]]))
    assert light[0] == pytest.approx([min(0.9 * count, 1)] * 3 + [1])
    (mesh,) = scene.sliced
    assert mesh.texture is not None and mesh.texture.texels.max() <= 1
    half = sg.Scene([sg.Layer(volumes[0], white), sg.Layer(volumes[0], white, opacity=0.05)])
    assert half.painter("slice").light(np.array([[3.0, 3.0, 3.0]]))[0, 0] == pytest.approx(0.9 * 1.05)


def test_sheets_have_one_scale_and_all_slices(tmp_path: Path) -> None:
    """Twelve slices of two shapes; spacing counts; nothing lies over another, and the PNG says where each is."""
    np.save(tmp_path / "a.npy", np.random.default_rng(1).random((10, 20, 30)).astype(np.float32))
    command = ["render", str(tmp_path / "a.npy"), "--spacing", "1,2,3", "--slice", "z=0:10", "--slice", "x=4"]
    command += [
        "--slice",
        "0,10,5:1,2,0",
        "--size",
        "300x200",
        "--dpi",
        "300",
        "--quiet",
        "-o",
        str(tmp_path / "a.png"),
    ]
    assert main(command) == 0
    with Image.open(tmp_path / "a.png") as picture:
        info = json.loads(picture.info["splatgl"])
        assert round(picture.info["dpi"][0]) == 300
    boxes = np.array([row["pixels"] for row in info["slices"]])
    assert len(boxes) == 12 and [row["title"] for row in info["slices"]][9:11] == ["z 9", "x 4"]
    sides = (boxes[:, 2:] - boxes[:, :2]) * info["pitch"]
    assert np.abs(sides[:10] - [30, 40]).max() <= info["pitch"] and np.abs(sides[10] - [40, 30]).max() <= info["pitch"]
    covered = np.zeros((200, 300), int)
    for left, top, right, bottom in boxes:
        covered[top:bottom, left:right] += 1
    assert covered.max() == 1 and covered.mean() > 0.35


def test_letters_and_titles_lie_beside_the_slices_of_a_sheet() -> None:
    """A slice covers the pixels of its box alone, and none of it is hidden; small ones have titles over them."""
    volume = sg.Volume(np.full((6, 20, 20), 7, np.uint8), frame="LPS", unit="mm")
    look: Any = {"points": [(0, 0), (7, 1)], "colormap": "#0000ff", "window": (0, 7), "slices": ["z=1", "z=2", "x"]}
    image = sg.render(volume, size=(400, 200), **look)
    inside = np.zeros(image.pixels.shape[:2], bool)
    slices: Any = image.info["slices"]
    for row in slices:
        left, top, right, bottom = row["pixels"]
        inside[top:bottom, left:right] = True
        assert (image.pixels[top - 16 : top, left:right, 0] > 0.5).any()
    assert (image.pixels[inside][:, :2] < 0.01).all() and (image.pixels[inside][:, 2] > 0.9).all()
    small = sg.render(volume, size=(60, 24), **look)
    assert (small.pixels[..., 0] > 0.5).any() and len(small.info["slices"]) == 3


def test_measures_are_drawn_on_the_slices_that_contain_them() -> None:
    volume = sg.Volume(np.full((6, 20, 20), 7, np.uint8), (1.0, 1.0, 2.0), unit="mm")
    look: Any = {"points": [(0, 0), (7, 1)], "colormap": "#0000ff", "window": (0, 7), "size": (300, 200)}
    measures = [[(4, 9.5, 4), (16, 9.5, 4.9)], [(4, 9.5, 4), (16, 9.5, 8)]]
    image = sg.render(volume, slices=["z=2", "z=3"], measures=measures, **look)
    drawn = []
    slices: Any = image.info["slices"]
    for row in slices:
        left, top, right, bottom = row["pixels"]
        middle = top + (bottom - top) / 2
        rows, columns = np.nonzero(image.pixels[round(middle - 2) : round(middle + 2), left:right, 0] > 0.3)
        drawn.append(len(rows))
        if drawn[-1]:
            assert abs(columns.min() / (right - left) - 4.5 / 20) < 0.05
            assert abs(columns.max() / (right - left) - 16.5 / 20) < 0.05
    assert drawn[0] > 50 and drawn[1] == 0
    assert [note for note in image.notes if "measure" in note] == [
        "measure 12.65 mm: on no slice, the nearest is 2 mm away"
    ]


def test_scene_files_keep_slices(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.random.default_rng(1).random((8, 8, 8)))
    scene = SceneFile(str(tmp_path / "a.npy"), slices=("z=1:5",), slice_planes=("x=2@0.5", "1.0,2.0,3.0:0.0,1.0,1.0"))
    (tmp_path / "scene.toml").write_text(scene.to_toml(tmp_path))
    again = SceneFile.from_toml(tmp_path / "scene.toml")
    assert (again.slices, again.slice_planes) == (scene.slices, scene.slice_planes)
    assert main(["render", str(tmp_path / "scene.toml"), "-o", str(tmp_path / "a.npy.png"), "--quiet"]) == 0


BAD = {
    "--slice z=8": "slice: expected a voxel from 0 to 7 along z, got 'z=8'",
    "--slice q=8": "expected AXIS=PLACE",
    "--slice z=1e400": "expected AXIS=PLACE",
    "--slice z=3 --depth d.npy": "--slice: expected no --depth beside it",
    "--slice z=3 --annotate box": "--annotate: expected scale, colorbar, title, measures beside slices, got box",
    "--slice-plane z=3@7": "expected an opacity from 0 to 1 after @, got '7'",
    "--slice-plane z=3 --workers 1": "--slice-plane: expected none",
}


@pytest.mark.parametrize("options", BAD)
def test_commands_that_are_refused(options: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    np.save(tmp_path / "a.npy", np.random.default_rng(1).random((8, 8, 8)))
    assert main(["render", str(tmp_path / "a.npy"), *options.split(), "-o", str(tmp_path / "o.png")]) == 2
    said = capsys.readouterr().err
    assert BAD[options] in said and said.count("\n") == 1 and not (tmp_path / "o.png").exists()


@pytest.mark.parametrize("option", ["--slice", "--slice-plane"])
def test_what_has_no_values_has_no_slices(option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    np.save(tmp_path / "nan.npy", np.full((4, 4, 4), np.nan))
    assert main(["render", str(tmp_path / "nan.npy"), option, "z", "-o", str(tmp_path / "o.png")]) == 2
    said = capsys.readouterr().err
    assert "expected finite samples, got none" in said and said.count("\n") == 1 and not (tmp_path / "o.png").exists()

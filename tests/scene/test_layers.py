"""Several volumes in one picture: closed forms, the float64 reference, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import splatgl as sg
from splatgl import reference
from splatgl.cli.main import main
from splatgl.gl import layers as layer_tiles
from splatgl.planning import bricks
from splatgl.planning.culling import PixelWindow
from splatgl.planning.scene import join_pictures, moments_per_frame
from splatgl.scene import open_scene
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.view import ViewOptions
from splatgl.splat import splats
from splatgl.splat.settings import Technique

pytestmark = pytest.mark.usefixtures("shared_programs")

FOG = {"a": (0.05, "gray"), "b": (0.12, "viridis")}
PLAIN = sg.Settings(antialias="off", occlusion="off")


def noise(rng: np.random.Generator, shape: tuple[int, int, int]) -> np.ndarray:
    """Smoothed along each axis, from 0 to 1."""
    found: np.ndarray = rng.random(shape)
    for axis in (0, 1, 2, 0, 1, 2):
        found = (np.roll(found, 1, axis) + 2 * found + np.roll(found, -1, axis)) / 4
    return np.asarray((found - found.min()) / np.ptp(found), np.float32)


def block(name: str, shape: tuple[int, int, int], **grid: object) -> sg.Layer:
    """A homogeneous block of fog."""
    opacity, colormap = FOG[name]
    volume = sg.Volume(np.ones(shape, np.float32), name=name, **grid)
    return sg.Layer(volume, sg.Transfer([(0.0, opacity)], colormap=colormap, unit=1.0))


@pytest.fixture(scope="module")
def blocks() -> sg.Scene:
    """Two that overlap, of other spacings: x from −.5 to 19.5, and from 7.15 to 30.95."""
    return sg.Scene([block("a", (20, 20, 20)), block("b", (10, 12, 14), spacing=(1.7, 1.3, 2.1), origin=(8, 5, 4))])


@pytest.fixture(scope="module")
def field(rng: np.random.Generator) -> sg.Scene:
    """Two fields, one on a sheared grid, in each other."""
    direction = np.array([[0.9, 0.1, 0], [-0.2, 1, 0.1], [0, 0.3, 1]])
    return sg.Scene(
        [
            sg.Layer(
                sg.Volume(noise(rng, (22, 24, 26)), name="first"),
                sg.Transfer([(0.4, 0), (0.7, 0.6)], colormap="ivory", shading=True),
            ),
            sg.Layer(
                sg.Volume(noise(rng, (16, 14, 12)), (2, 1.5, 3), (2, 3, -4), direction, name="second"),
                sg.Transfer([(0.5, 0), (0.6, 0.4)], colormap="viridis"),
            ),
        ]
    )


@pytest.fixture(scope="module")
def rng() -> np.random.Generator:
    return np.random.default_rng(5)


def along_x(scene: sg.Scene) -> sg.Camera:
    """A parallel view along +x."""
    return sg.Camera.orthographic((-30.0, 9.5, 9.5), (0.0, 9.5, 9.5), (0, 0, 1), height=8.0, size=(8, 8))


@pytest.mark.long
def test_blocks_have_the_extinction_of_both(renderer: sg.Renderer, blocks: sg.Scene) -> None:
    """In the part that they share extinctions add up, and colours mix by them."""
    image = renderer.render(blocks, along_x(blocks), PLAIN)
    sigma = {name: -np.log1p(-opacity) for name, (opacity, _) in FOG.items()}
    colors = {layer.volume.name: layer.seen.color(np.ones(1))[0] for layer in blocks.shown}
    light, ends = np.zeros(4), {"a": (-0.5, 19.5), "b": (8 - 0.85, 8 + 1.7 * 13 + 0.85)}
    for low, high in pairwise(sorted({x for pair in ends.values() for x in pair})):
        inside = [name for name, (first, last) in ends.items() if first <= low and high <= last]
        total = sum(sigma[name] for name in inside)
        color = sum((sigma[name] * colors[name] for name in inside), np.zeros(3)) / total
        light += (1 - light[3]) * -np.expm1(-total * (high - low)) * np.append(color, 1.0)
    assert len(np.unique(np.round(image.pixels, 5).reshape(-1, 4), axis=0)) == 1
    assert np.abs(image.pixels - light).max() < 2e-5
    # even matter is joined: a list has at most a page beside its last piece
    heads = renderer.passes.layers.heads
    assert heads is not None and np.frombuffer(heads.read(4), np.uint32)[0] <= 2 * 64
    alone = [renderer.render(layer.volume and sg.Scene([layer]), along_x(blocks), PLAIN) for layer in blocks.shown]
    clear = np.prod([1 - each.pixels[..., 3] for each in alone], axis=0)
    assert np.abs(1 - clear - image.pixels[..., 3]).max() < 2e-6


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("changes", "most", "parallel"),
    [
        ({"antialias": "off", "occlusion": "off"}, 4e-4, False),
        ({}, 4e-4, True),
        ({"classification": "pre", "occlusion": "off"}, 1e-3, True),
        ({"blend": "xray"}, 3e-4, False),
        ({"blend": "mip", "background": (1.0, 0.5, 0.0)}, 3e-4, True),
    ],
)
def test_as_in_float64(
    renderer: sg.Renderer, field: sg.Scene, changes: dict[str, object], most: float, parallel: bool
) -> None:
    camera = sg.Camera.orbit(field, 30, 20, 40, (20, 18))
    camera = camera.parallel(field) if parallel else camera
    settings = sg.Settings(**changes)
    image, right = renderer.render(field, camera, settings), reference.render(field, camera, settings)
    assert right.pixels[..., 3].max() > 0.5 and image.info["layers"] == ["first", "second"] == right.info["layers"]
    assert np.abs(image.pixels - right.pixels).max() < most * max(1, right.pixels.max())
    assert image.info["error_bound"] is None and image.info["tolerance_met"] is None


@pytest.mark.parametrize("technique", ["tiles", "quads"])
def test_regions_over_gradients_beside_another_layer(
    renderer: sg.Renderer, field: sg.Scene, technique: Technique
) -> None:
    """As in float64; not what the layer is without them."""
    regions = ["box:0.35,0.7,0.05,0.2:#2266ff:0.5", "gaussian:0.2,0.9,0,0.3:lime:0.3"]
    first, second = field.layers
    scene = sg.Scene([replace(first, transfer=replace(first.seen, regions=regions)), second])
    camera = sg.Camera.orbit(scene, 30, 20, 40, (16, 14))
    right = reference.render(scene, camera, PLAIN).pixels
    assert np.abs(right - reference.render(field, camera, PLAIN).pixels).max() > 0.05
    image = renderer.render(scene, camera, PLAIN.replace(technique=technique))
    assert image.info["technique"] == technique and np.abs(image.pixels - right).max() < 4e-4


def test_boxes_beside_another_layer_by_wide_pixels(renderer: sg.Renderer) -> None:
    """Along an axis signs of directions change in the middle of the picture, where a ray passes the fewest voxels."""
    rng = np.random.default_rng(4)
    cells = rng.random((5, 8, 24))
    colored = sg.Volume((cells * 255).astype(np.uint8), color=(rng.random((*cells.shape, 3)) * 255).astype(np.uint8))
    labels = sg.Volume((rng.random(cells.shape) * 3).astype(np.uint8)).of_values("labels")
    scene = sg.Scene([sg.Layer(colored, sg.Transfer([(0, 0.2)])), sg.Layer(labels, opacity=0.1)])
    camera = sg.Camera.look_at((30, 3.4, 2.2), (0, 3.4, 2.2), (0, 0, 1), fov=110, size=(21, 15))
    settings = PLAIN.replace(technique="quads", shading="off")
    image = renderer.render(scene, camera, settings)
    assert image.info["technique"] == "quads"
    assert np.abs(image.pixels - reference.render(scene, camera, settings).pixels).max() < 1e-3


@pytest.mark.parametrize("technique", ["quads", pytest.param("tiles", marks=pytest.mark.long)])
def test_what_is_behind_a_parallel_eye_casts_no_shadow(
    renderer: sg.Renderer, field: sg.Scene, technique: Technique
) -> None:
    camera = sg.Camera.orbit(field, 30, 20, 40, (12, 10)).parallel(field)
    middle = field.layers[0].volume.center
    inside = sg.Camera.orthographic(middle, middle + camera.forward, (0, 0, 1), 12.0, (12, 10))
    settings = PLAIN.replace(shadows=0.9, technique=technique)
    right = reference.render(field, inside, settings).pixels
    assert np.abs(right - reference.render(field, inside, PLAIN).pixels).max() > 0.05
    assert np.abs(renderer.render(field, inside, settings).pixels - right).max() < 1e-3


def test_without_an_order_layers_hide_by_turns() -> None:
    """Of maxima light adds up and what passes multiplies, before the background; sums add up."""
    first, second = (np.full((1, 1, 4), [[color, 0.0, 0.0, alpha]]) for color, alpha in ((0.1, 0.25), (0.3, 0.6)))
    mip = sg.Settings(blend="mip", background=(0.0, 1.0, 0.5))
    assert join_pictures([first, second], mip)[0, 0] == pytest.approx([0.4, 0.3, 0.15, 1.0])
    assert join_pictures([first, second], mip.replace(background=None))[0, 0] == pytest.approx([0.4, 0, 0, 0.7])
    assert join_pictures([first, second], sg.Settings(blend="xray"))[0, 0] == pytest.approx([0.4, 0, 0, 0.85])


@pytest.mark.long
def test_order_of_layers_does_not_matter(renderer: sg.Renderer, field: sg.Scene) -> None:
    """Nor does one that is hidden, or clear."""
    camera = sg.Camera.orbit(field, 30, 20, 40, (40, 36))
    image = renderer.render(field, camera)
    first, second = field.shown
    hidden, clear = sg.Layer(first.volume, visible=False), sg.Layer(first.volume, opacity=0.0)
    other = renderer.render(sg.Scene([second, hidden, clear, first]), camera)
    assert np.abs(image.pixels - other.pixels).max() < 2e-5
    assert np.abs(image.pixels - renderer.render(sg.Scene([first]), camera).pixels).max() > 0.05


def test_one_layer_is_its_volume(renderer: sg.Renderer, field: sg.Scene) -> None:
    layer = field.shown[0]
    camera = sg.Camera.orbit(field, 30, 20, 40, (40, 36))
    alone = renderer.render(sg.extract(layer.volume, layer.seen), camera)
    assert np.array_equal(renderer.render(sg.Scene([layer]), camera).pixels, alone.pixels)


@pytest.mark.long
def test_a_volume_twice_is_twice_as_dense(renderer: sg.Renderer, field: sg.Scene) -> None:
    """Half an opacity, as a factor, is not half an extinction."""
    volume = field.shown[1].volume
    thin, dense = (sg.Transfer([(0.5, a), (0.6, a)], colormap="viridis") for a in (0.2, 1 - 0.8**2))
    camera = sg.Camera.orbit(field, -60, 40, 40, (40, 36))
    twice = renderer.render(sg.Scene([sg.Layer(volume, thin)] * 2), camera, PLAIN)
    once = renderer.render(sg.extract(volume, dense), camera, PLAIN)
    assert once.pixels[..., 3].max() > 0.9 and np.abs(twice.pixels - once.pixels).max() < 2e-3
    half = sg.Layer(volume, dense, opacity=0.2 / 0.36)
    assert np.allclose([a for _, a in half.seen.points], 0.2)


@pytest.mark.long
def test_matter_beyond_the_room_is_drawn_in_parts(
    renderer: sg.Renderer, field: sg.Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rows, and columns of rows, bit for bit; a tile that is too full for all room is told."""
    camera = sg.Camera.orbit(field, 30, 20, 40, (60, 50))
    image = renderer.render(field, camera, PLAIN)
    for room in (2500, 9000):
        monkeypatch.setattr(layer_tiles, "ROOM", room)
        assert np.array_equal(renderer.render(field, camera, PLAIN).pixels, image.pixels)
    monkeypatch.setattr(layer_tiles, "ROOM", 10)
    with pytest.raises(sg.InputError, match="need too much GPU memory"):
        renderer.render(field, camera, PLAIN)
    monkeypatch.undo()
    assert np.array_equal(renderer.render(field, camera, PLAIN).pixels, image.pixels)


def test_what_is_refused(renderer: sg.Renderer, field: sg.Scene, blocks: sg.Scene) -> None:
    camera = sg.Camera.orbit(field, size=(16, 16))
    volume = blocks.shown[0].volume
    for settings, said in (
        (sg.Settings(compositing="splats"), "layers composite in sheets"),
        (sg.Settings(kernel="gaussian", classification="pre", attenuation="opacity"), "layers composite in sheets"),
    ):
        with pytest.raises(sg.InputError, match=said):
            renderer.render(field, camera, settings)
    moving = sg.Motion(spin=(0, 0, 0.1))
    with pytest.raises(sg.InputError, match="motion of layers: expected the mean of moments"):
        renderer.render(field, camera, sg.Settings(motion="exact"), moving)
    with pytest.raises(sg.InputError, match="motion of layers: expected a camera that moves"):
        renderer.render(field, camera, motion=replace(moving, flow=np.zeros((3, 3))))
    for layers in ([], [sg.Layer(volume, visible=False)], [volume] * 9):
        with pytest.raises(sg.InputError, match="layers: expected 1 to 8 that are visible"):
            sg.Scene(layers)
    with pytest.raises(sg.InputError, match="opacity: expected a factor from 0 to 1"):
        sg.Layer(volume, opacity=1.5)


@pytest.mark.long
def test_moving_layers_are_the_mean_of_their_moments(renderer: sg.Renderer, field: sg.Scene) -> None:
    """All of them turn together; what does not move is sharp, to the last bit."""
    camera, turn = sg.Camera.orbit(field, 20, 30, size=(32, 32)), sg.Motion(spin=(0, 0, 20.0))
    still = renderer.render(field, camera, PLAIN)
    for motion, settings in (
        (sg.Motion(), PLAIN),
        (turn, PLAIN.replace(motion="off")),
        (turn, PLAIN.replace(shutter=0)),
    ):
        assert np.array_equal(renderer.render(field, camera, settings, motion).pixels, still.pixels)
    image = renderer.render(field, camera, PLAIN.replace(moments=2), turn)
    # the middles of both halves of the half of a frame during which the shutter is open
    parts = [renderer.render(field, turn.view(camera, at), PLAIN).pixels for at in (-0.125, -0.375)]
    assert np.abs(image.pixels - np.mean(parts, axis=0)).max() < 1e-6
    assert image.info["moments"] == 2 and np.abs(image.pixels - still.pixels).max() > 0.02
    # by itself a frame has as many as keep steps below 1.5 pixels
    turns = (sg.Motion(spin=(0, 0, each)) for each in (30.0, 1e-5))
    quick, slow = (moments_per_frame(field, camera, PLAIN, turn) for turn in turns)
    assert quick > slow == 2


@pytest.mark.long
def test_volumes_in_another_frame_are_turned(renderer: sg.Renderer, rng: np.random.Generator) -> None:
    """LPS and RAS are of one patient: the picture is that of two in one frame, with what is cut off each."""
    turn, look = np.diag([-1.0, -1.0, 1.0]), sg.Transfer([(0.4, 0), (0.7, 0.6)], colormap="viridis", shading=True)
    samples, vectors = noise(rng, (14, 15, 16)), np.ones((14, 15, 16, 3))
    first = sg.Volume(noise(rng, (16, 16, 16)), frame="LPS")
    same = sg.Volume(samples, (1, 1, 1), (3, 2, 1), frame="LPS", vectors=vectors)
    other = sg.Volume(samples, (1, 1, 1), (-3, -2, 1), turn, frame="RAS", vectors=vectors * (-1, -1, 1))
    camera = sg.Camera.orbit(first, 30, 20, size=(32, 24))
    pictures = []
    for second, clip in ((same, [(1, 0, 0, 8.3)]), (other, [(-1, 0, 0, 8.3)])):
        masked = second.masked(np.indices(samples.shape)[1] < 11)
        layers = [sg.Layer(first, look, 0.4), sg.Layer(masked, look, 0.8, clip=clip)]
        scene = sg.Scene(layers)
        assert np.allclose(scene.layers[1].volume.vectors, 1) and scene.layers[1].volume.frame == "LPS"
        pictures.append(renderer.render(scene, camera, PLAIN).pixels)
    assert np.abs(pictures[0] - pictures[1]).max() < 2e-4 and pictures[0][..., 3].max() > 0.5
    assert same.placed("LPS") is same and same.placed(None) is same


def test_a_view_shows_all_layers(blocks: sg.Scene) -> None:
    camera = sg.Camera.orbit(blocks, 20, 30, size=(64, 64))
    x, y, depth = camera.eye_from_points(blocks.corners).T
    reach = np.abs(np.stack([x, y]) / depth).max()
    assert 0.9 < reach / (camera.extent / 2) <= 1 + 1e-9 and np.ptp(blocks.corners[:, 0]) == pytest.approx(31.45)


# --- the command line, and scene files --------------------------------------------------------------------------------


@pytest.fixture
def files(field: sg.Scene, tmp_path: Path) -> tuple[str, str]:
    """Two volumes; an option's value may hold a colon in the path."""
    for layer, name in zip(field.shown, ("first.npy", "a:b.npy"), strict=True):
        np.save(tmp_path / name, layer.volume.samples)
    return str(tmp_path / "first.npy"), str(tmp_path / "a:b.npy")


@pytest.mark.long
def test_layers_of_the_command_line(
    renderer: sg.Renderer, files: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The picture is that of Python, compared with float64; a scene file gives the same."""
    out, (first, second) = tmp_path / "a.npy", files
    asked = ["render", first, "--points", "0.4:0,0.7:0.6", "--size", "40", "-o", str(out), "--backend", "auto"]
    assert main([*asked, "--layer", f"{second}:viridis:0.5"]) == 0
    assert "in 60 checked pixels" in capsys.readouterr().out
    volumes = [sg.load(name) for name in files]
    other = replace(sg.default_transfer(volumes[1]), colormap="viridis")
    points = replace(sg.default_transfer(volumes[0]), points=((0.4, 0.0), (0.7, 0.6)))
    scene = sg.Scene([sg.Layer(volumes[0], points), sg.Layer(volumes[1], other, opacity=0.5)])
    camera = ViewOptions(size=(40, 40)).camera(volumes[0], scene)
    pixels = np.load(out)
    right = renderer.render(scene, camera, sg.Settings(background="white")).pixels
    assert np.array_equal(pixels, right) and pixels[..., 2].min() < 0.5

    made = SceneFile(first, transfer={"points": ((0.4, 0.0), (0.7, 0.6))}, view=ViewOptions(size=(40, 40)))
    made = replace(made, layers=(SceneFile(second, transfer={"colormap": "viridis"}, opacity=0.5),))
    (tmp_path / "scene.toml").write_text(made.to_toml(tmp_path))
    assert SceneFile.from_toml(tmp_path / "scene.toml").layers == made.layers
    assert main(["render", str(tmp_path / "scene.toml"), "-o", str(out), "--check", "0", "--quiet"]) == 0
    assert np.array_equal(np.load(out), pixels)


@pytest.mark.parametrize(
    ("text", "volume", "transfer", "opacity"),
    [
        ("pet.nrrd", "pet.nrrd", {}, 1.0),
        ("pet.nrrd:hot", "pet.nrrd", {"colormap": "hot"}, 1.0),
        ("pet.nrrd:CT-Bone:0.3", "pet.nrrd", {"preset": "CT-Bone"}, 0.3),
        ("pet.nrrd::0.3", "pet.nrrd", {}, 0.3),
        ("pet.nrrd:0.3", "pet.nrrd", {}, 0.3),
        ("https://a.org/b.zarr:#00ff66", "https://a.org/b.zarr", {"colormap": "#00ff66"}, 1.0),
        ("https://a.org/b.zarr", "https://a.org/b.zarr", {}, 1.0),
        ("a.h5:/one/two", "a.h5:/one/two", {}, 1.0),
    ],
)
def test_what_a_layer_is(text: str, volume: str, transfer: dict[str, str], opacity: float) -> None:
    assert SceneFile.read(text) == SceneFile(volume, transfer=transfer, opacity=opacity)
    options = {"series": "2", "time": 1, "channel": "DAPI"}
    read = SceneFile.read(f"{volume}:series=2:time=1:channel=DAPI{text.removeprefix(volume)}")
    assert read == SceneFile(volume, options, transfer, opacity=opacity)


def test_a_layer_reads_its_channel(tmp_path: Path) -> None:
    """As the same volume in memory does; an unknown channel is named."""
    np.savez(tmp_path / "two.npz", first=np.zeros((4, 4, 4)), second=np.indices((4, 4, 4))[0].astype(float))
    base = sg.Volume(np.ones((4, 4, 4)))
    layer = sg.Layer(sg.load(tmp_path / "two.npz", array="second"))
    by_text = sg.render(base, layers=[f"{tmp_path / 'two.npz'}:array=second"], size=32)
    assert np.array_equal(by_text.pixels, sg.render(base, layers=[layer], size=32).pixels)
    with pytest.raises(sg.InputError, match=r"array: expected .*first"):
        sg.render(base, layers=[f"{tmp_path / 'two.npz'}:array=third"], size=32)


@pytest.mark.parametrize("blend", ["mip", pytest.param("xray", marks=pytest.mark.long), "composite"])
def test_layers_of_more_splats_than_a_pass_holds(
    files: tuple[str, str], blend: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Blends without an order draw each layer in bricks; others draw averaged voxels, and a note says so."""
    first, second = files
    options = {"layers": [second], "size": 40, "blend": blend, "clip": "x<0.7"}
    whole = sg.render(first, **options)
    monkeypatch.setattr(open_scene, "SMALL", 100)
    for module in (bricks, splats):
        monkeypatch.setattr(module, "MOST_KEPT", 4000)
    parts = sg.render(first, **options)
    if blend == "composite":
        assert any("averaged over 2×2×2, so that each takes at most 4,000 splats" in note for note in parts.notes)
        assert 0 < int(str(parts.info["splats"])) < int(str(whole.info["splats"])) / 4
        return
    assert parts.info["layers"] == whole.info["layers"] and int(str(parts.info["bricks"])) > 1
    assert not any("limit" in note for note in parts.notes)
    np.testing.assert_allclose(parts.pixels, whole.pixels, atol=1e-4 * whole.pixels.max())
    checked = parts.accuracy.checked
    assert checked is not None and float(str(checked["largest"])) < 1e-4 * parts.pixels.max()


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--layer", "none.npy"], "none.npy: path: expected a file"),
        (["--layer", ":1.5"], "expected FILE[:LOOK[:OPACITY]]"),
        (["--layer", "a:b.npy:nothing"], "colormap: expected one of"),
        (["--layer", "a:b.npy", "--field"], "--field: expected a picture of one volume"),
        (["--layer", "a:b.npy", "--workers", "1"], "layers: expected none, with --workers"),
        (["--layer", "a:b.npy", "--check", "2.5"], "expected a number of pixels, or seconds such as 0.5s, got '2.5'"),
        (["--layer", "a:b.npy", "--memory", "300KiB"], "a layer that fits into 300"),
    ],
)
def test_bad_layers_are_told(
    files: tuple[str, str],
    more: list[str],
    said: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(Path(files[0]).parent)
    try:
        code = main(["render", files[0], "--size", "40", "-o", "out.png", *more])
    except SystemExit as ended:
        code = int(str(ended.code))
    error = capsys.readouterr().err
    assert code == 2 and said in error and error.count("\n") == 1 and not Path("out.png").exists()


def test_bad_layers_of_scene_files_are_told(tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    for text, said in (
        ("[[layer]]\nopacity = 0.5", r"\[\[layer\]\] 1: expected the key volume"),
        ('[[layer]]\nvolume = "a.npy"\nopacity = 2', "opacity: expected a factor from 0 to 1"),
        ('[[layer]]\nvolume = "a.npy"\nzoom = 2', "expected keys clip, crop, load, mask, opacity, surfaces, th"),
        ("layer = [3]", r"\[\[layer\]\] 1: expected a table"),
        ("layer = 3", "layer: expected list"),
    ):
        path.write_text('volume = "tunnel"\n' + text)
        with pytest.raises(sg.InputError, match=said):
            SceneFile.from_toml(path)


@pytest.mark.long
def test_all_layers_have_as_many_samples(renderer: sg.Renderer) -> None:
    """As the finest needs, whichever comes first."""
    coarse = sg.Layer(sg.Volume(np.ones((4, 4, 4), np.float32), (16, 16, 16)), sg.Transfer([(0, 0.3)]))
    fine = sg.Layer(sg.Volume(np.ones((64, 64, 64), np.float32)), sg.Transfer([(0, 0.3)]))
    camera = sg.Camera.orbit(coarse.volume, 30, 20, size=(24, 24))
    alone = [renderer.render(sg.Scene([each]), camera).info["samples"] for each in (coarse, fine)]
    assert alone[0] < alone[1]
    for layers in ([coarse, fine], [fine, coarse]):
        assert renderer.render(sg.Scene(layers), camera).info["samples"] == alone[1]


def test_windows_of_layers_grow_from_few_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    """After a window whose matter needs most of the room, those of less matter grow, although heights are rounded."""
    monkeypatch.setattr(layer_tiles, "most_block", lambda ctx: 2**27)
    tiles = layer_tiles.LayerTiles(SimpleNamespace(ctx=None), *[None] * 3)  # type: ignore[arg-type]
    tiles.sizes[1] = 24 * 1000
    heights: list[int] = []

    def fake(batch: object, target: object, window: PixelWindow, room: int) -> int:
        heights.append(window.height)
        return 0

    monkeypatch.setattr(tiles, "_window", fake)
    tiles._draw_windows(SimpleNamespace(layers=[None], stride=1), None, PixelWindow(0, 0, 1000, 200))  # type: ignore[arg-type]
    assert heights == [24, 32, 40, 48, 56]

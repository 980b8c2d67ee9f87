"""Every keyword with every kind of subject changes the picture, or a message names it."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.data.volume import halve_volume
from splatgl.errors import InputError
from splatgl.options import declared, flag_name
from splatgl.scene.api import PLAIN, opened, scene_of
from splatgl.scene.scene_file import SceneFile
from splatgl.splat.settings import Settings
from splatgl.transfer.transfer import Transfer
from splatgl.viewer.adaptive_quality import FULL
from splatgl.viewer.document import Document
from splatgl.viewer.frame_renderer import FrameRenderer
from splatgl.viewer.state import State
from tests.helpers.doors import NoScreen

pytestmark = pytest.mark.usefixtures("shared_programs")

N, SIZE = 10, 24
POINTS = ((20.0, 0.0), (150.0, 0.6))


def field() -> np.ndarray:
    """float32 [z, y, x]: a ball in a ramp."""
    z, y, x = np.mgrid[:N, :N, :N]
    return np.asarray(200 * np.exp(-((x - 4) ** 2 + (y - 5) ** 2 + (z - 4) ** 2) / 12.0) + x * 2, np.float32)


def segments() -> np.ndarray:
    """uint8 [z, y, x]: three segments."""
    numbers = np.zeros((N, N, N), np.uint8)
    numbers[2:8, 2:5, 2:8], numbers[2:8, 5:8, 2:8], numbers[2:5, 3:7, 3:6] = 1, 3, 2
    return numbers


def volume(scale: float = 1.0, name: str = "v") -> sg.Volume:
    return sg.Volume(field() * scale, spacing=(1, 1.2, 1.4), name=name, unit="mm")


def tetrahedron() -> sg.Mesh:
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    return sg.Mesh(np.array([[0, 0, 0], [9, 0, 0], [0, 9, 0], [0, 0, 9.0]]), faces, name="tet")


def write_stl(path: Path) -> str:
    mesh = tetrahedron()
    rows = ["solid t"]
    for face in mesh.faces:
        rows += ["facet normal 0 0 0", "outer loop"]
        rows += ["vertex " + " ".join(f"{x:g}" for x in mesh.vertices[n]) for n in face] + ["endloop", "endfacet"]
    path.write_text("\n".join([*rows, "endsolid t"]))
    return str(path)


def write_points(path: Path) -> str:
    random = np.random.default_rng(1)
    names = ("float x", "float y", "float z", "uchar red", "uchar green", "uchar blue")
    head = ["ply", "format ascii 1.0", "element vertex 200", *(f"property {name}" for name in names), "end_header"]
    rows = [f"{x:g} {y:g} {z:g} {n % 255} 90 {n}" for n, (x, y, z) in enumerate(random.random((200, 3)) * 9)]
    path.write_text("\n".join([*head, *rows]) + "\n")
    return str(path)


def saved(path: Path, samples: np.ndarray) -> str:
    np.save(path, samples)
    return str(path)


def scene_file(path: Path) -> str:
    saved(path.with_name("a.npy"), field())
    path.write_text('volume = "a.npy"\n[transfer]\npoints = [[20, 0.0], [150, 0.6]]\n')
    return str(path)


def channels() -> sg.Volume:
    parts = tuple(volume(n + 1.0, name) for n, name in enumerate(("DAPI", "GFP")))
    return replace(parts[0], channels=parts)


def pyramid() -> sg.Volume:
    fine = sg.Volume(np.kron(field(), np.ones((2, 2, 2), np.float32)), name="p")
    return replace(fine, coarser=(halve_volume(fine),))


def colours() -> sg.Volume:
    return replace(volume(), color=np.random.default_rng(2).integers(0, 255, (N, N, N, 3)).astype(np.uint8))


def with_vectors() -> sg.Volume:
    vectors = np.zeros((N, N, N, 3), np.float32)
    vectors[..., 0], vectors[..., 1] = 1, np.mgrid[:N, :N, :N][2] * 0.2
    return replace(volume(), vectors=vectors)


# subjects by the folder of their files
SUBJECTS: dict[str, Callable[[Path], Any]] = {
    "array": lambda folder: field(),
    "splats": lambda folder: sg.extract(volume(), sg.Transfer(POINTS)),
    "scene": lambda folder: sg.Scene([sg.Layer(volume(), sg.Transfer(POINTS))]),
    "mesh": lambda folder: write_stl(folder / "tet.stl"),
    "labels": lambda folder: sg.Volume.of(segments(), values="labels"),
    "volume": lambda folder: volume(),
    "file": lambda folder: saved(folder / "a.npy", field()),
    "scene file": lambda folder: scene_file(folder / "scene.toml"),
    "points": lambda folder: write_points(folder / "cloud.ply"),
    "colours": lambda folder: colours(),
    "pyramid": lambda folder: pyramid(),
    "channels": lambda folder: channels(),
    "vectors": lambda folder: with_vectors(),
}
QUICK = ("array", "splats", "scene", "mesh", "labels")


@cache
def values() -> dict[str, Any]:
    """A value of each keyword that shows in a picture of a volume."""
    region = ["box:30,90,2,50:red:0.5"]
    return {
        **{"size": (20, 24), "view": "top", "azimuth": 75, "elevation": 60, "fov": 70, "zoom": 0.6, "eye": (30, 20, 9)},
        **{"look_at": (1, 2, 3), "up": (1, 0, 0), "orthographic": True, "height": 30.0, "fit": "visible"},
        **{"dpi": 200, "width": "1mm"},
        **{"blend": "xray", "mip_attenuation": 0.5, "kernel": "gaussian", "classification": "pre"},
        **{"compositing": "splats", "sheets": 4, "steps": 4, "antialias": "off", "samples": 2, "align": "grid"},
        **{"z_s": 1.0, "attenuation": "opacity", "footprint": "table", "table_size": 8, "table_bits": 8},
        **{"target": "rgba8", "technique": "quads", "shading": "off", "light": "flat", "light_from": (60, 30)},
        **{"ambient": 0.9, "diffuse": 0.1, "specular": 0.5, "ambient_occlusion": 0.9, "shadows": 0.9},
        **{"motion": "exact", "moments": 4, "shutter": 90, "order": "back-to-front", "occlusion": "off"},
        **{"blur_width": 2.0, "tolerance": 0.05, "background": "red"},
        **{"clip": "x>0.5", "preset": "mip", "curve": "ramp:40,90"},
        **{"colors": "20:red,150:blue", "level_width": (100, 50), "file": "look.toml", "only_labels": [1]},
        **{"names": "lut.txt", "name_of": {1: "liver"}, "color_of": {"GFP": "red"}, "window_of": {"GFP": (10, 60)}},
        **{"colormap": "hot"},
        **{"points": [(50, 0), (80, 0.9)], "window": (30, 60), "unit": 5.0, "gradient": [(0, 0), (20, 1)]},
        **{"scale": "log", "log": True, "iso": 80, "regions": region, "region": region, "threshold": 0.3},
        **{"crop": "0:5,:,:", "mask": segments(), "uncut": "1", "scissors": "0,0 1,0 1,0.5", "surfaces": 0.5},
        **{"layers": [volume()], "layer": [volume()], "meshes": [tetrahedron()], "mesh": [tetrahedron()]},
        **{"annotate": "title=A", "slices": "z=4", "slice": "z=4", "slice_planes": "z=4", "slice_plane": "z=4"},
        **{"label_fill": 0.2, "look_of": {"GFP": "surface"}},
        **{"labels": segments(), "clip_meshes": True, "caps": "plain", "vectors": "magnitude", "streamlines": 10},
        **{"arrows": 10, "like": "0.1", "paper": True, "memory": "1MiB", "spacing": (1, 1, 3)},
        **{"origin": (5, 0, 0), "name": "x", "values": "labels", "array": "0", "shape": (10, 10, 10)},
        **{"dtype": "uint8", "header_offset": 1, "offset": 1, "channel": 5, "time": 1, "level": 1, "series": 1},
        **{"well": "A/1", "field": 1, "color": "x.png", "relief": 2.0, "point_size": 3.0, "anywhere": True},
        **{"own": {"gain": 2}, "reader_option": {"gain": 2}},
        **{"measures": [((1, 1, 1), (3, 1, 1))], "measure": [((1, 1, 1), (3, 1, 1))]},
    }


# values for single kinds, on which those above are the default
OTHER: dict[tuple[str, str], Any] = {
    **{(kind, "shading"): "on" for kind in ("points", "channels")},
    **{(kind, "fit"): "0.3" for kind in ("mesh", "points")},
    **{("labels", "values"): "amounts", ("labels", "threshold"): 0.995, ("labels", "compositing"): "sheets"},
    **{(kind, "classification"): "post" for kind in ("labels", "points", "colours")},
}
# further names by which messages call a keyword
CALLED = {
    **{
        "log": "scale",
        "region": "regions",
        "layer": "layers",
        "mesh": "meshes",
        "offset": "header_offset",
        "reader_option": "own",
        "measures": "measure",
    },
    **{"slices": "slice", "slice_planes": "slice", "slice_plane": "slice"},
    # settings of earlier versions
    **{"like": "compositing splats", "paper": "compositing splats"},
}
# what the info states of keywords that need not change pixels
STATED = {"dpi": "dpi", "origin": "eye", "name": "source", "occlusion": "cutoff", "meshes": "triangles"} | {
    "mesh": "triangles"
}


def draw(x: Any, folder: Path, **options: Any) -> sg.Image:
    options |= {name: str(folder / options[name]) for name in ("file", "names") if name in options}
    return sg.render(x, **{"size": SIZE, **options})


def names(keyword: str, message: str) -> bool:
    """Whether a message names a keyword, or its flag."""
    known = {keyword, f"{keyword}s", keyword.replace("_", "-"), CALLED.get(keyword, keyword)}
    return any(re.search(rf"(?<!\w)(?<!\w-){re.escape(name)}(?![\w-])", message) for name in known)


def effect(base: sg.Image, x: Any, folder: Path, keyword: str, value: Any) -> str:
    """What a keyword does: "picture", "info" or "message"; "" for nothing."""
    try:
        image = draw(x, folder, **{keyword: value})
    except InputError as error:
        return "message" * names(keyword, str(error))
    if image.pixels.shape != base.pixels.shape or not np.array_equal(image.pixels, base.pixels):
        return "picture"
    notes = [note for note in image.notes if note not in base.notes]
    if any(names(keyword, note) for note in notes):
        return "message"
    if keyword == "name_of":
        opened = scene_of(x, None, None, None, {keyword: value}).open()
        return "info" * ("liver" in [label.name for label in opened.labels or ()])
    key = STATED.get(keyword, "seconds")
    return "info" * (key != "seconds" and image.info.get(key) != base.info.get(key))


def check(kind: str, folder: Path) -> None:
    sg.Transfer(POINTS, "hot").save(folder / "look.toml")
    (folder / "lut.txt").write_text("1 liver 255 0 0 0\n")
    x = SUBJECTS[kind](folder)
    base = draw(x, folder)
    table = {**values(), **{keyword: value for (of, keyword), value in OTHER.items() if of == kind}}
    silent = [keyword for keyword in PLAIN if not effect(base, x, folder, keyword, table[keyword])]
    assert silent == []


@pytest.mark.parametrize("kind", QUICK)
def test_no_keyword_is_silent(kind: str, tmp_path: Path) -> None:
    check(kind, tmp_path)


@pytest.mark.long
@pytest.mark.parametrize("kind", [kind for kind in SUBJECTS if kind not in QUICK])
def test_no_keyword_of_other_subjects_is_silent(kind: str, tmp_path: Path) -> None:
    check(kind, tmp_path)


# what each keyword needs beside it in order to change a picture of a volume
BESIDE: dict[str, Mapping[str, Any]] = {
    "look_at": {"eye": (30, 20, 9)},
    "mip_attenuation": {"blend": "attenuated-mip"},
    "samples": {"antialias": "supersample"},
    "z_s": {"align": "hybrid"},
    "blur_width": {"antialias": "paper", "zoom": 0.5},
    "uncut": {"clip": "x>0.7", "labels": segments(), "uncut": ""},
    "annotate": {"size": 64},
    "measures": {"size": 64},
    "clip_meshes": {"clip": "x>0.5", "meshes": [tetrahedron()]},
    "caps": {"clip": "x>0.5", "meshes": [tetrahedron()]},
    "only_labels": {"labels": segments()},
}


@pytest.mark.parametrize("keyword", [name for name in BESIDE if name != "uncut"])
def test_keywords_with_what_they_need(keyword: str, tmp_path: Path) -> None:
    beside = BESIDE[keyword]
    with_it, without = (draw(volume(), tmp_path, **{**beside, **more}) for more in ({keyword: values()[keyword]}, {}))
    assert not np.array_equal(with_it.pixels, without.pixels)
    assert not any(names(keyword, note) for note in with_it.notes)


def test_the_table_has_every_keyword() -> None:
    assert values().keys() == PLAIN.keys()


@pytest.mark.parametrize("x", [field(), volume()], ids=["array", "volume"])
def test_a_number_is_the_length_that_opacities_refer_to(x: Any) -> None:
    view: Any = {"size": SIZE, "background": "transparent"}
    first, thin = (sg.render(x, **view, unit=unit).pixels for unit in (1.2, 6.0))
    right = sg.render(x, **view, transfer={"unit": 6.0}).pixels
    assert np.array_equal(thin, right) and thin[..., 3].mean() < 0.8 * first[..., 3].mean()
    near, far = (sg.depth_map(x, size=SIZE, unit=unit) for unit in (1.2, 6.0))
    assert np.isfinite(far).sum() < np.isfinite(near).sum()
    # text is the unit of lengths
    assert np.array_equal(sg.render(x, size=SIZE, unit="cm").pixels, sg.render(x, size=SIZE).pixels)
    assert scene_of(x, None, None, None, {"unit": "cm"}).open().unit == "cm"


def test_the_unit_of_files_and_of_movies(tmp_path: Path) -> None:
    path = saved(tmp_path / "a.npy", field())
    with pytest.raises(InputError, match="unit: expected a positive, finite length"):
        sg.render(path, unit="mm")
    shown = [
        sg.animate(x, tmp_path / f"{n}_{{frame}}.npy", frames=1, spin=0, size=SIZE, unit=6.0)[0]
        for n, x in enumerate((path, field()))
    ]
    assert np.array_equal(*(np.load(file) for file in shown))
    assert np.array_equal(np.load(shown[0]), sg.render(path, size=SIZE, unit=6.0).pixels)


@pytest.mark.parametrize("transfer", [sg.Transfer(POINTS), "mri", {"points": POINTS}])
def test_no_preset_beside_a_transfer_function(transfer: Any) -> None:
    with pytest.raises(InputError, match="preset: expected none together with a transfer function"):
        sg.render(field(), transfer, preset="surface")


def test_options_replace_the_look_of_a_scene_file(tmp_path: Path) -> None:
    path = scene_file(tmp_path / "scene.toml")
    assert np.array_equal(
        sg.render(path, preset="surface", size=SIZE).pixels,
        sg.render(str(tmp_path / "a.npy"), preset="surface", size=SIZE).pixels,
    )
    look = sg.Transfer(POINTS, "hot")
    (tmp_path / "scene.toml").write_text('volume = "a.npy"\n[transfer]\npreset = "mip"\ncurve = "ramp:40,90"\n')
    assert np.array_equal(sg.render(path, look, size=SIZE).pixels, sg.render(field(), look, size=SIZE).pixels)


def test_commands_print_options_without_effect(
    tmp_path: Path, renderer: sg.Renderer, capsys: pytest.CaptureFixture[str]
) -> None:
    """Settings that alone change nothing, all at once; the same lines are notes in Python."""
    path, output = saved(tmp_path / "a.npy", field()), str(tmp_path / "a.png")
    alone = ("--samples", "2"), ("--z-s", "1"), ("--mip-attenuation", "0.5")
    command = ["render", path, "-o", output, "--size", str(SIZE), "--shading", "off", "--light", "flat"]
    assert main([*command, *(word for words in alone for word in words)]) == 0
    said = [line.removeprefix("splatgl: ") for line in capsys.readouterr().err.splitlines()]
    for name in ("samples", "z_s", "mip_attenuation", "light"):
        assert sum(names(name, line) for line in said) == 1
    options: Any = {"shading": "off", "light": "flat", "samples": 2, "z_s": 1.0, "mip_attenuation": 0.5}
    image = sg.render(path, size=SIZE, **options)
    assert list(image.notes) == said
    # and once in the window
    scene = SceneFile(path, settings=sg.Settings(**options, shutter=90.0))
    document = Document.open(scene, quiet=True)
    painter = FrameRenderer(NoScreen(), renderer)  # type: ignore[arg-type]
    for level in (FULL, FULL):
        painter.draw(State.of(document, (SIZE, SIZE)), document, level, False, None)
    assert [line.removeprefix("splatgl: ") for line in capsys.readouterr().err.splitlines()] == said


def test_movies_and_slices_print_options_without_effect(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = saved(tmp_path / "a.npy", field())
    movie = ["animate", path, "-o", str(tmp_path / "b{frame}.png"), "--frames", "2", "--size", "16"]
    assert main([*movie, "--samples", "2", "--z-s", "1", "--shutter", "90"]) == 0
    said = capsys.readouterr().err
    assert said.count("samples: no effect") == said.count("z_s: no effect") == 1 and "shutter: no" not in said
    sheet = ["render", path, "-o", str(tmp_path / "c.png"), "--size", "16", "--slice", "z=4"]
    assert main([*sheet, "--zoom", "1.1", "--background", "white"]) == 0 and "no effect" not in capsys.readouterr().err
    assert main([*sheet, "--light", "flat", "--azimuth", "40"]) == 0
    assert "splatgl: light, azimuth: no effect, as slices have no view in space" in capsys.readouterr().err


def test_options_of_the_command_are_keywords() -> None:
    """An option that only the command has would not be in the table."""
    flags = {
        flag_name(o) or name
        for record in (Settings, SceneFile, Transfer)
        for name, o in declared(record).items()
        if o.group
    }
    assert flags <= PLAIN.keys()


def amounts(folder: Path) -> str:
    """A file of whole numbers that are no segments, 1 among them."""
    random = np.random.default_rng(3)
    return saved(folder / "ct.npy", (random.integers(0, 3, (N, N, N)) + 90 * (field() > 60)).astype(np.int16))


OF_SEGMENTS = {
    "only_labels": ("--only-labels", "1", "a segmentation, got amounts in"),
    "name_of": ("--name-of", "1=liver", "a segmentation, got amounts in"),
    "names": ("--names", "lut.txt", "a segmentation, got amounts in"),
    "surfaces": ("--surfaces", "0.5", "a segmentation among the volumes, got amounts in"),
    "color_of": ("--color-of", "1=red", "several channels, got one"),
    "look_of": ("--look-of", "1=surface", "several channels, got one"),
}


@pytest.mark.parametrize("name", OF_SEGMENTS)
def test_options_of_segments_need_a_segmentation(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, (flag, text, words) = amounts(tmp_path), OF_SEGMENTS[name]
    doors = [
        ["render", path, "-o", str(tmp_path / "a.png"), flag, text],
        ["pick", path, "3,3", "--size", "8", flag, text],
    ]
    doors += [["animate", path, "-o", str(tmp_path / "b{frame}.png"), "--frames", "2", flag, text]]
    for command in doors:
        assert main(command) == 2
        assert f"splatgl: {flag}: expected {words}" in capsys.readouterr().err
    assert not list(tmp_path.glob("*.png"))
    value = values()[name]
    for draw_x in (sg.render, sg.depth_map):
        for x in (path, np.load(path), sg.load(path)):
            with pytest.raises(InputError, match=f"^{name}: expected {words}"):
                draw_x(x, size=SIZE, **{name: value})


def test_segments_that_are_stated_or_found(tmp_path: Path) -> None:
    """Numbers that the user states as labels, a mask, and a segmentation beside the volume."""
    path = amounts(tmp_path)
    named = sg.render(path, size=SIZE, values="labels", only_labels=[1]).pixels
    assert named[..., 3].max() > 0.9
    mask = (segments() > 0).astype(np.uint8)
    assert np.array_equal(*(sg.render(mask, size=SIZE, only_labels=only).pixels for only in ([1], "all")))
    beside = sg.render(path, size=SIZE, labels=segments(), only_labels=[3]).pixels
    assert not np.array_equal(beside, sg.render(path, size=SIZE, labels=segments()).pixels)


def test_a_preset_and_segments_exclude_each_other() -> None:
    with pytest.raises(InputError, match="transfer of labels: expected keys only_labels, unit, shading, got preset"):
        sg.render(segments(), preset="mri", only_labels=[1], values="labels")


def test_channels_take_the_looks_that_are_asked_for() -> None:
    """Each by its own values: the second channel is a fiftieth as bright, and looks as the first."""
    hint = sg.Volume(field(), name="A"), sg.Volume(field() / 50, name="B")
    both = replace(hint[0], channels=hint)
    for look in ({"preset": "microscopy"}, {"curve": "ramp:50%,99%"}, {"points": [(50, 0), (80, 0.9)]}):
        shown = sg.render(both, size=SIZE, color_of={"A": "red", "B": "blue"}, **look).pixels
        same = look.keys() != {"points"}
        assert np.allclose(shown[..., 0], shown[..., 2], atol=1e-4) == same and shown[..., 0].max() > 0.2
    window = sg.render(both, size=SIZE, window=(30, 60)).pixels
    assert np.array_equal(window, sg.render(both, size=SIZE, window_of={"A": (30, 60), "B": (30, 60)}).pixels)
    assert np.array_equal(window, sg.render(both, size=SIZE, level_width=(45, 30)).pixels)


def test_channels_have_looks_of_their_own() -> None:
    """A preset, with its shading and in the channel's colour, or a colour map; others stay, by name or number."""
    both = channels()

    def looks(**options: Any) -> list[Any]:
        return [layer.transfer for layer in opened(scene_of(both, None, None, None, options)).scene.layers]

    plain, mixed = looks(), looks(look_of={"GFP": "surface"})
    right = sg.preset("surface", both.channels[1])
    assert mixed[0] == plain[0] and mixed[1].points == right.points and mixed[1].shading
    assert mixed[1].colormap == plain[1].colormap
    assert looks(look_of=["1=surface"], color_of={"GFP": "red"})[1] == replace(mixed[1], colormap="#ff0000")
    assert looks(look_of={"DAPI": "viridis"})[0] == replace(plain[0], colormap="viridis")
    for value, told in (({"GFP": "nothing"}, "colormap"), ({"CY5": "surface"}, "channel: expected one of DAPI, GFP")):
        with pytest.raises(InputError, match=told):
            looks(look_of=value)


def test_depths_of_a_scene_are_those_of_its_volume() -> None:
    x, look = volume(), sg.Transfer(POINTS)
    right = sg.depth_map(x, look, size=SIZE, azimuth=70)
    scene = sg.Scene([sg.Layer(x, look)])
    assert (
        np.array_equal(sg.depth_map(scene, size=SIZE, azimuth=70), right, equal_nan=True) and np.isfinite(right).any()
    )
    camera = sg.Camera.orbit(x, 70, size=(SIZE, SIZE))
    cut = sg.depth_map(sg.Scene([sg.Layer(x, look)], clip="x>0.5"), camera=camera)
    assert np.array_equal(cut, sg.depth_map(x, look, camera, clip="x>0.5"), equal_nan=True)
    with pytest.raises(InputError, match="transfer: expected none together with a scene"):
        sg.depth_map(scene, look)
    with pytest.raises(InputError, match="clip: expected planes of four finite numbers"):
        sg.depth_map(scene, clip="x>0.5")

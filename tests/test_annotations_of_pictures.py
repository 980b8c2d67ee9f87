"""Annotations of real pictures: lengths and letters as they are drawn, scene files, Python, and movies."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as Pillow

import splatgl as sg
from splatgl.annotations import scale_bar
from splatgl.annotations.axes import COLORS, LONG
from splatgl.annotations.canvas import Layer
from splatgl.cli.main import main
from splatgl.scene.scene_file import Scene

CLEAR = sg.Transfer([(1, 0.0), (2, 0.5)])


def bare(camera: sg.Camera) -> sg.Image:
    """A picture of nothing, on black."""
    pixels = np.zeros((camera.size[1], camera.size[0], 4), np.float32)
    return sg.Image(pixels, {"blend": "composite"})


@pytest.mark.parametrize("size", [(300, 240), (900, 500)])
@pytest.mark.parametrize("parallel", [False, True])
@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), (0.25, 0.5, 4.0)])
def test_the_bar_is_as_long_as_it_says(
    spacing: tuple[float, float, float], parallel: bool, size: tuple[int, int]
) -> None:
    """Its pixels, counted, against the distance between the projections of two points that far apart."""
    volume = sg.Volume(np.zeros((20, 30, 40), np.float32), spacing, unit="mm")
    camera = sg.Camera.orbit(volume, 25, 10, size=size)
    camera = camera.parallel(volume) if parallel else camera
    found = sg.annotated(bare(camera), volume, CLEAR, camera, ["scale"], ground=(0, 0, 0))
    # the bar is the widest run of lit pixels
    lit = found.pixels[..., :3].max(axis=2) > 0.5
    longest = max(len(run) for row in lit for run in "".join("x" if p else " " for p in row).split())
    lengths = [step * 10.0**power for power in range(-3, 4) for step in (1, 2, 5)]
    # two points at the middle's depth, that length apart across the view
    ends = volume.center + np.array([[0.0], [1.0]]) * camera.right
    seen = camera.eye_from_points(ends)
    pixel = (seen[1, 0] - seen[0, 0]) / (seen[0, 2] if parallel is False else 1.0) / (camera.extent / size[1])
    assert min(abs(length * pixel - longest) for length in lengths) <= 1.5
    assert longest <= 0.26 * size[0]


@pytest.mark.parametrize("angles", [(0.0, 0.0), (30.0, 20.0), (200.0, -50.0), (90.0, 0.0)])
def test_axes_point_where_the_camera_has_them(angles: tuple[float, float]) -> None:
    """The middle of each axis' colour lies from the triad's middle as its projection does."""
    volume = sg.Volume(np.zeros((9, 9, 9), np.float32))
    camera = sg.Camera.orbit(volume, *angles, size=(600, 600))
    image = sg.annotated(bare(camera), volume, CLEAR, camera, ["axes"], ground=(1, 1, 1))
    layer = Layer.over(bare(camera).pixels, (1, 1, 1))
    half = int(np.ceil(LONG * layer.em + 1.3 * layer.em))
    middle = np.array([layer.pad + half, 600 - layer.pad - half])
    for axis, color in enumerate(COLORS):
        along = camera.eye_from_world[:2, axis]
        close = np.abs(image.pixels[..., :3] - np.array(color)).max(axis=2) < 0.02
        y, x = np.nonzero(close & (image.pixels[..., 3] > 0.95))
        if np.linalg.norm(along) < 0.3:
            continue
        mean = np.array([x.mean(), y.mean()]) - middle
        assert mean @ along / np.linalg.norm(mean) / np.linalg.norm(along) > 0.97


def test_letters_of_files(tmp_path: Path) -> None:
    """A NIfTI file in RAS and a NRRD in LPS of one patient, with flipped axes: the same letters at the same edges."""
    nibabel, nrrd = pytest.importorskip("nibabel"), pytest.importorskip("nrrd")
    data = np.zeros((6, 7, 8), np.int16)
    data[2:4, 2:5, 2:6] = 100
    nibabel.save(nibabel.Nifti1Image(data, np.diag([-2.0, 2, 2, 1])), tmp_path / "a.nii")
    header = {"space": "left-posterior-superior", "space directions": np.diag([2.0, -2, 2])}
    nrrd.write(str(tmp_path / "a.nrrd"), data, header)
    pictures = []
    for name in ("a.nii", "a.nrrd"):
        volume = sg.load(tmp_path / name)
        frame = {"RAS": 1.0, "LPS": -1.0}[str(volume.frame)]
        # the same patient from the front and the left
        eye = volume.center + np.array([-40.0 * frame, 60.0 * frame, 10.0])
        camera = sg.Camera.look_at(eye, volume.center, (0, 0, 1), 30, (200, 200))
        pictures.append(sg.annotated(bare(camera), volume, CLEAR, camera, ["directions"], ground=(0, 0, 0)).pixels)
    assert pictures[0].any() and (pictures[0] == pictures[1]).all()


def test_scene_files_and_python_draw_what_the_command_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    np.save(tmp_path / "a.npy", np.random.default_rng(1).random((12, 12, 12)).astype(np.float32))
    source, out = str(tmp_path / "a.npy"), tmp_path / "o.npy"
    options = ["--size", "96", "--quiet", "--check", "0", "--points", "0.3:0,0.9:0.5", "-o", str(out)]
    names = ["scale", "axes", "title=One, two"]
    assert main(["render", source, "--annotate", ",".join(names), *options]) == 0
    right = np.load(out)
    same = sg.render(source, size=96, points=((0.3, 0), (0.9, 0.5)), annotate=names)
    assert (same.pixels == right).all() and same.info["annotated"] == names
    path = tmp_path / "s.toml"
    path.write_text(Scene(source, annotate=tuple(names)).to_toml(tmp_path))
    assert Scene.from_toml(path).annotate == tuple(names)
    assert main(["render", str(path), *options]) == 0
    assert (np.load(out) == right).all()
    # left out of comparisons
    assert main(["render", source, *options]) == 0
    plain = np.load(out)
    np.save(tmp_path / "ref.npy", plain)
    assert main(["render", str(path), "--ref", str(tmp_path / "ref.npy"), *options]) == 0
    for bad in ('annotate = ["sharp"]', "annotate = [3]", 'annotate = ["time"]'):
        path.write_text(f'volume = "a.npy"\n{bad}\n')
        assert main(["render", str(path), *options]) == 2
        assert "annotate: expected" in capsys.readouterr().err


def test_the_view_of_meshes_is_annotated() -> None:
    """A mesh beyond the volume moves the eye away: the bar is of the picture that is drawn."""
    volume = sg.Volume(np.random.default_rng(2).random((8, 8, 8)), unit="mm")
    ball = sg.Mesh.of_points([[40, 4, 4]], 3.0)
    look = {"size": 128, "points": ((0.4, 0), (0.9, 0.5)), "meshes": [ball], "background": "black"}
    image, plain = sg.render(volume, annotate="scale", **look), sg.render(volume, **look)
    camera = sg.Camera.orbit(sg.Scene([sg.Layer(volume, CLEAR)], meshes=[ball]), 30, 20, size=(128, 128))
    assert abs(float(np.array(image.info["eye"])[0]) - camera.eye[0]) < 5.0
    lit = np.abs(image.pixels - plain.pixels)[100:, 64:].max(axis=2) > 0.5
    longest = max(len(run) for row in lit for run in "".join("x" if p else " " for p in row).split())
    eye = np.array(image.info["eye"])
    depth = (volume.center - eye) @ np.array(image.info["forward"])
    pixel = 1 / (2 * np.tan(np.radians(20)) * depth / 128)
    assert min(abs(length * pixel - longest) for length in (1, 2, 5, 10, 20, 50)) <= 1.5


def test_movies_have_running_times(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of time points that are 90 s apart; frames differ in the corner of the time alone; others are another movie."""
    h5py = pytest.importorskip("h5py")
    cells = np.random.default_rng(3).random((1, 8, 8, 8)).astype(np.float32)
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["a"], file["time"] = np.repeat(cells, 3, axis=0), np.arange(3) * 1.5
        file["time"].attrs["units"] = "minutes"
        file["time"].make_scale()
        for n, name in enumerate("tzyx"):
            file["a"].dims[n].label = name
        file["a"].dims[0].attach_scale(file["time"])
    options = ["--size", "96", "--quiet", "--points", "0.3:0,0.9:0.5", "-o", str(tmp_path / "{frame:02d}.png")]
    assert main(["animate", f"{path}:/a", "--annotate", "time,title=A", *options]) == 0, capsys.readouterr().err
    frames = [np.asarray(Pillow.open(tmp_path / f"{n:02d}.png")).astype(int) for n in range(3)]
    told = [str(sg.Image.load(tmp_path / f"{n:02d}.png").info["annotated"]) for n in range(3)]
    assert [text[:15].split("'")[1] for text in told] == ["time=0 s", "time=90 s", "time=180 s"]
    apart = np.abs(frames[0] - frames[1]).max(axis=2)
    y, x = np.nonzero(apart)
    assert len(y) and y.max() < 30 and x.max() < 48
    assert main(["animate", f"{path}:/a", "--annotate", "title=B", "--resume", *options]) == 2
    assert "expected a frame of this animation" in capsys.readouterr().err
    np.save(tmp_path / "b.npy", cells[0])
    assert main(["animate", str(tmp_path / "b.npy"), "--annotate", "time", *options]) == 2
    assert "expected 'time=TEXT'" in capsys.readouterr().err


def spied(draw: Any, cameras: list[sg.Camera]) -> Any:
    """A method of renderers that keeps its cameras."""

    def wrapped(renderer: sg.Renderer, x: Any, camera: sg.Camera, *more: Any, **named: Any) -> Any:
        cameras.append(camera)
        return draw(renderer, x, camera, *more, **named)

    return wrapped


@pytest.mark.few(4)
@pytest.mark.parametrize("case", ["gradient", "threshold", "values", "colours", "levels", "parallel", "layers"])
def test_annotations_are_laid_with_the_camera_of_the_picture(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of every kind of picture, whose views are fitted to what is drawn."""
    _, y, x = np.indices((16, 16, 16))
    samples = np.minimum(x + y / 3, 12.0).astype(np.float32)
    volume = sg.Volume(samples, unit="mm")
    options: dict[str, Any] = {"points": [(3.0, 0.0), (4.0, 0.5)], "size": (96, 80), "annotate": "scale"}
    if case in ("gradient", "parallel"):
        options |= {"gradient": [(0.2, 0.0), (0.5, 1.0)], "classification": "pre", "orthographic": case == "parallel"}
    elif case == "threshold":
        options |= {"points": [(3.0, 0.0), (12.0, 0.5)], "threshold": 0.2, "classification": "pre"}
    elif case == "colours":
        volume = sg.Volume(samples, color=np.full((16, 16, 16, 3), 200, np.uint8))
    elif case == "levels":
        coarse = samples.reshape(8, 2, 8, 2, 8, 2).mean(axis=(1, 3, 5))
        volume = replace(volume, coarser=(sg.Volume(coarse, spacing=(2, 2, 2), origin=(0.5, 0.5, 0.5)),))
        options |= {"gradient": [(0.2, 0.0), (0.5, 1.0)], "classification": "pre"}
    elif case == "layers":
        options |= {"streamlines": 4}
        volume = sg.Volume(samples, vectors=np.tile(np.float32([1, 0, 0]), (16, 16, 16, 1)))
    laid: list[sg.Camera] = []
    drawn: list[sg.Camera] = []
    for name in ("render", "render_scene"):
        whole = getattr(sg.Renderer, name, None)
        if whole is not None:
            monkeypatch.setattr(sg.Renderer, name, spied(whole, drawn))
    plain = scale_bar.draw
    monkeypatch.setattr(
        scale_bar, "draw", lambda layer, told, camera: (laid.append(camera), plain(layer, told, camera))
    )
    sg.render(volume, **options)
    a, b = laid[-1], drawn[-1]
    assert np.array_equal(a.eye, b.eye) and np.array_equal(a.eye_from_world, b.eye_from_world)
    assert (a.extent, a.size, a.perspective) == (b.extent, b.size, b.perspective)


def test_frames_that_are_smaller_than_a_still_say_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A turn needs room; of one that is none, frame 0 has the camera of the still, for values and for voxels."""
    samples = np.zeros((6, 8, 24), np.float32)
    samples[2:4, 2:6, 3:20] = 1.0
    np.save(tmp_path / "long.npy", samples)
    drawn = [str(tmp_path / "long.npy"), "--size", "48x40", "--azimuth", "90", "--points", "0.4:0,0.6:0.5"]
    for more in ([], ["--classification", "pre", "--gradient", "0.1:0,0.3:1"]):
        frames = [*drawn, *more, "-o", str(tmp_path / "{frame}.npy"), "--frames", "2", "--only", "0-0"]
        assert main(["render", *drawn, *more, "-o", str(tmp_path / "still.npy")]) == 0
        still = np.load(tmp_path / "still.npy")
        capsys.readouterr()
        assert main(["animate", *frames]) == 0
        assert "times as large as render does; --zoom" in capsys.readouterr().err
        assert np.abs(np.load(tmp_path / "0.npy") - still).max() > 0.05
        assert main(["animate", *frames, "--turntable", "0"]) == 0
        assert "as large" not in capsys.readouterr().err
        assert np.array_equal(np.load(tmp_path / "0.npy"), still)

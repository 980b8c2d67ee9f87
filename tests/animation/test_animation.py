"""Animations: tracks, series, frames that are whole or not there, going on after a kill, movies."""

from __future__ import annotations

import gc
import os
import shutil
import signal
import subprocess
import sys
import time
import weakref
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np
import pytest
from PIL import Image as Pillow

import splatgl as sg
from splatgl.animation import movie
from splatgl.animation.animation import Animation, FrameFiles, FrameJob, FrameView, Timeline, scale_xray
from splatgl.animation.api import AnimationFiles
from splatgl.animation.camera_track import RotationHull, between, keyframes, turning
from splatgl.animation.movie import expanded, gif_times, read_ahead, volumes
from splatgl.cli.main import main
from splatgl.gl import renderer as renderers
from splatgl.scene.draw import ProgressLines, duration
from splatgl.scene.open_scene import series_look
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.view import ViewOptions
from tests.helpers.bricks import noise
from tests.helpers.memory import allow_any_memory

pytestmark = pytest.mark.usefixtures("shared_programs")

DATA = Path(os.environ.get("SPLATGL_DATA", Path(__file__).parents[3] / "shared" / "data"))
# seconds after which a thread hangs
LONGEST = 300.0
# seconds within which a thread begins what it does beside others
SHORT = 20.0
SMALL = ["--size", "24", "--quiet"]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a small volume, and three more of a series."""
    monkeypatch.chdir(tmp_path)
    z, y, x = np.mgrid[:12, :10, :16]
    for n in (2, 10, 9, 1):
        ball = np.hypot(np.hypot(x - 3 - n / 2, y - 5), z - 6) < 3.5
        np.save(f"t{n}.npy", (ball * 200).astype(np.uint8))
    shutil.copy("t2.npy", "ball.npy")
    return tmp_path


def animate(*arguments: str) -> int:
    return main(["animate", *arguments, *SMALL])


def pixels(path: str | Path) -> np.ndarray:
    return sg.Image.load(path).pixels


def test_a_turn_is_the_cameras_orbit(renderer: sg.Renderer, here: Path) -> None:
    """Frame after frame the picture of an eye that goes around, counter-clockwise from above; one turn closes."""
    assert animate("letter-f", "-o", "f/{frame:02d}.npy", "--frames", "4") == 0
    assert sorted(p.name for p in Path("f").iterdir()) == ["00.npy", "01.npy", "02.npy", "03.npy"]
    scene = SceneFile("letter-f", view=ViewOptions(size=(24, 24)))
    volume = scene.open()
    splats = sg.extract(volume, scene.transfer_for(volume), classification="pre")
    first = turning(scene.view, volume, splats, -90).camera(0)
    center = (volume.corners.min(axis=0) + volume.corners.max(axis=0)) / 2
    for n in range(4):
        angle = np.radians(90 * n)
        turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        eye = turn @ (first.eye - center) + center
        camera = sg.Camera.look_at(eye, eye + turn @ first.forward, (0, 0, 1), 40, (24, 24))
        expected = renderer.render(splats, camera, scene.settings.replace(background="white")).pixels
        assert np.abs(pixels(f"f/{n:02d}.npy") - expected).max() < 2e-5, n


def test_in_python_frames_are_those_of_the_command(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a file, of a pattern and of volumes in memory; a movie is one file."""
    series = sorted(here.glob("t*.npy"), key=lambda path: int(path.stem[1:]))
    assert animate("t*.npy", "-o", "a/{frame}.png", "--hold", "2", "--turntable", "90", "--zoom", "1.5") == 0
    options: Any = {"hold": 2, "turntable": 90, "zoom": 1.5, "size": 24}
    for number, x in enumerate(("t*.npy", [np.load(path) for path in series])):
        found = sg.animate(x, f"{number}/{{frame}}.png", **options)
        assert [str(path) for path in found] == [f"{number}/{n}.png" for n in range(8)]
        assert all((pixels(path) == pixels(f"a/{path.name}")).all() for path in found)
    Path("t.nrrd").write_bytes(
        b"NRRD0004\ntype: uint8\ndimension: 4\nsizes: 16 10 12 4\nkinds: domain domain domain time\nencoding: raw\n\n"
        + b"".join(np.load(path).tobytes() for path in series)
    )
    assert animate("t.nrrd", "-o", "s/{frame}.png", "--time", "1:4:2") == 0
    assert len(sg.animate("t.nrrd", "p/{frame}.png", time=slice(1, 4, 2), size=24)) == 2
    assert all((pixels(f"s/{n}.png") == pixels(f"p/{n}.png")).all() for n in range(2))
    played = sg.animate("ball.npy", "b.gif", "surface", frames=3, only=(1, 2), fps=5, size=24)
    assert played == [Path("b.gif")]
    # a notebook plays the movie from its own file, and lists frames
    shown = AnimationFiles(played)._repr_html_()
    assert shown is not None and shown.startswith('<img src="data:image/gif;base64,R0lGOD')
    assert AnimationFiles(found)._repr_html_() is None and type(played) is AnimationFiles
    Path("a.webm").write_bytes(b"1234")
    monkeypatch.setattr("splatgl.animation.api.MOST_INLINE", 3)
    assert AnimationFiles([Path("a.webm")])._repr_html_() == '<video controls loop src="a.webm"></video>'
    with Pillow.open("b.gif") as movie:
        assert (getattr(movie, "n_frames", 1), movie.info["duration"]) == (2, 200)


@pytest.mark.parametrize(
    ("x", "options", "message"),
    [
        ([], {}, "animate: expected volumes, arrays or files, got an empty list"),
        ("ball.npy", {"camera": None}, "animate: expected a view, got a camera; name its azimuth"),
        ("ball.npy", {"only": (3, 1)}, "only: expected two frames"),
        ("ball.npy", {"spin": 3, "turntable": 4}, "expected one of --turntable, --spin and --keyframes"),
        ("ball.npy", {"bits": 12}, "bits: expected 8 or 16, got 12"),
        ("ball.npy", {"fps": 0}, "fps: expected a number from 0.01 to 1000, got 0"),
        ("ball.npy", {"turntabel": 3}, "got turntabel"),
        ("ball.npy", {"time": slice(0, 2)}, "--time: expected a file of several time points, got 1"),
        ("ball.npy", {"workers": 0}, "--workers: expected a whole number from 1 to 1024, got 0"),
        ("ball.npy", {"devices": (0, 1)}, "--devices: expected --workers or --scheduler with it, got neither"),
    ],
    ids=str,
)
def test_in_python_bad_input_is_one_line(x: Any, options: dict[str, Any], message: str, here: Path) -> None:
    with pytest.raises(sg.InputError) as error:
        sg.animate(x, "a.gif", size=24, **options)
    assert message in str(error.value) and list(here.glob("*.gif")) == []


def test_a_spin_turns_the_volume_the_other_way(here: Path) -> None:
    assert animate("ball.npy", "-o", "a{frame}.npy", "--frames", "3", "--spin", "30", "--only", "2") == 0
    assert animate("ball.npy", "-o", "b{frame}.npy", "--frames", "3", "--turntable", "-90", "--only", "2") == 0
    assert animate("ball.npy", "-o", "c{frame}.npy", "--frames", "3", "--turntable", "90", "--only", "2") == 0
    assert np.abs(pixels("a2.npy") - pixels("b2.npy")).max() == 0 < np.abs(pixels("a2.npy") - pixels("c2.npy")).max()


def test_a_turning_camera_keeps_its_distance_and_sees_all() -> None:
    rng = np.random.default_rng(2)
    splats = sg.Splats.from_points(rng.uniform((-30, -3, -5), (30, 3, 9), (200, 3)), np.ones((200, 3)), np.ones(200))
    volume = sg.Volume(np.zeros((2, 2, 2)))
    track = turning(ViewOptions(azimuth=10, elevation=25), volume, splats, 7.0)
    center = (splats.corners.min(axis=0) + splats.corners.max(axis=0)) / 2
    distances = []
    for n in range(52):
        camera = track.camera(n)
        distances.append(np.linalg.norm(camera.eye - center))
        eye = camera.eye_from_points(splats.outline)
        assert np.abs(eye[:, :2] / eye[:, 2:]).max() <= camera.extent / 2
    assert np.ptp(distances) < 1e-9
    # and is no further than twice what the widest view wants
    widest = sg.Camera.orbit(splats, 0, 25)
    assert distances[0] < 1.2 * np.linalg.norm(widest.eye - center)
    assert len(RotationHull.of(splats, np.array([0.0, 0, 1])).outline) < 5000


def test_between_keyframes() -> None:
    frames, points = np.array([0.0, 10, 30]), np.array([[0.0], [1.0], [5.0]])
    for smooth in (True, False):
        at = [float(between(frames, points, t, smooth)[0]) for t in (-5, 0, 10, 30, 99)]
        assert at == [0, 0, 1, 5, 5]
    assert between(frames, points, 5, False) == pytest.approx([0.5])
    # smooth: no corner at a keyframe
    slopes = [(between(frames, points, t + 1e-5, True) - between(frames, points, t, True)) / 1e-5 for t in (10, 9.9999)]
    assert slopes[0] == pytest.approx(slopes[1], rel=1e-3)
    assert between(frames[:1], points[:1], 3, True) == pytest.approx([0])


def test_an_orbit_keeps_its_distance() -> None:
    """Between views from three sides the eye goes around what it looks at; straight, it would come nearer."""
    eyes, ups = [(10.0, 1, 0), (1.0, 10, 2), (-10.0, 1, 0)], [(0.0, 0, 1), (0.0, 0, 1), (0.0, 1, 1)]
    rows = [
        {"frame": 4 * n, "eye": eye, "look_at": (1.0, 1, 0), "up": up}
        for n, (eye, up) in enumerate(zip(eyes, ups, strict=True))
    ]
    ball = sg.Volume(np.ones((3, 3, 3), np.uint8))
    track, straight = (
        keyframes({"path": p, "keyframe": rows}, ViewOptions(), ball, ball) for p in ("orbit", "straight")
    )
    target = np.array([1.0, 1, 0])
    for n, (eye, up) in enumerate(zip(eyes, ups, strict=True)):
        asked, shown = sg.Camera.look_at(eye, (1, 1, 0), up), track.camera(4 * n)
        assert shown.eye == pytest.approx(asked.eye) and shown.eye_from_world == pytest.approx(asked.eye_from_world)
    for frame in (1.0, 2.5, 5.0, 7.0):
        camera = track.camera(frame)
        away = float(np.linalg.norm(camera.eye - target))
        assert 8.9 < away < 11.1 and camera.forward == pytest.approx((target - camera.eye) / away)
    assert np.linalg.norm(straight.camera(2).eye - target) < 8


def test_a_frame_s_camera_is_fitted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also as the start of the next frame's motion; another subject has cameras of its own."""
    ball, fitted = sg.Volume(np.ones((3, 3, 3), np.uint8)), list[float | None]()
    rows = [{"frame": 0, "azimuth": 0, "zoom": 1}, {"frame": 8, "azimuth": 80, "zoom": 2}]
    track = keyframes({"keyframe": rows}, ViewOptions(), ball, ball)
    fit = ViewOptions.camera
    monkeypatch.setattr(ViewOptions, "camera", lambda view, *x: fitted.append(view.azimuth) or fit(view, *x))
    for frame in range(1, 9):
        moved = track.camera(frame), track.motion(frame).camera
        assert moved[1] is not None and not np.allclose(moved[0].eye, moved[1].eye)
    # the first frame, from which the second one moves, too
    assert len(fitted) == 9 and len(set(fitted)) == 9
    near = replace(track, subject=replace(RotationHull.of(ball, np.array([0.0, 0, 1])), corners=ball.corners * 2))
    assert not np.allclose(near.camera(8).eye, track.camera(8).eye)


def test_an_orbit_takes_the_shorter_way_and_equal_ratios() -> None:
    """Halfway between keyframes the camera is turned by half of the angle, and as far away as the geometric mean."""
    rng = np.random.default_rng(3)
    eyes, ups = rng.normal(size=(2, 12, 3))
    eyes /= np.linalg.norm(eyes, axis=1, keepdims=True) / (1.0 + 3.0 * (np.arange(12) % 2))[:, None]
    rows = [{"frame": 2 * n, "eye": eyes[n].tolist(), "look_at": (0, 0, 0), "up": ups[n].tolist()} for n in range(12)]
    ball = sg.Volume(np.ones((3, 3, 3), np.uint8))
    track = keyframes({"path": "orbit", "ease": "linear", "keyframe": rows}, ViewOptions(), ball, ball)
    for n in range(11):
        before, halfway, after = (track.camera(2 * n + step).eye_from_world for step in range(3))
        whole, half = (np.arccos(np.clip((np.trace(turn @ before.T) - 1) / 2, -1, 1)) for turn in (after, halfway))
        assert half == pytest.approx(whole / 2, abs=1e-5)
        assert np.linalg.norm(track.camera(2 * n + 1).eye) == pytest.approx(2)


def test_a_scene_says_how_its_movie_moves(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As the options of the command, which replace it; it survives being written."""
    scene = 'volume = "ball.npy"\n[animation]\nturntable = 90.0\nframes = 3\nfps = 5.0\n'
    rows = "".join(f"[[animation.keyframe]]\nframe = {2 * n}\nazimuth = {30.0 * n}\n" for n in range(2))
    Path("turn.toml").write_text(scene)
    Path("keys.toml").write_text(f'{scene.split("turntable")[0]}ease = "linear"\n{rows}')
    Path("k.toml").write_text('ease = "linear"\n' + rows.replace("animation.", ""))
    for name in ("turn", "keys"):
        read = SceneFile.from_toml(Path(f"{name}.toml"))
        Path(f"{name}.toml").write_text(read.to_toml(here))
        assert SceneFile.from_toml(Path(f"{name}.toml")).animation == read.animation
        assert animate(f"{name}.toml", "-o", f"{name}{{frame}}.npy", "--only", "1-2") == 0
    assert animate("ball.npy", "-o", "a{frame}.npy", "--turntable", "90", "--frames", "3", "--only", "1-2") == 0
    assert animate("ball.npy", "-o", "b{frame}.npy", "--keyframes", "k.toml", "--only", "1-2") == 0
    assert np.array_equal(np.load("turn2.npy"), np.load("a2.npy"))
    assert np.array_equal(np.load("keys1.npy"), np.load("b1.npy"))
    assert animate("turn.toml", "-o", "c{frame}.npy", "--keyframes", "k.toml", "--only", "2-2") == 0
    assert np.array_equal(np.load("c2.npy"), np.load("b2.npy"))
    for line, message in (
        ("turn = 9", "turntable"),
        ("fps = true", "fps"),
        ("frames = 0", "frames"),
        ("ease = 1", "ease"),
    ):
        Path("bad.toml").write_text(f'volume = "ball.npy"\n[animation]\n{line}\n{rows}')
        capsys.readouterr()
        assert animate("bad.toml", "-o", "x{frame}.png") == 2
        said = capsys.readouterr().err
        assert message in said and said.count("\n") == 1 and not list(here.glob("x*"))


@pytest.mark.parametrize("row", [{"zoom": 1.0}, {"azimuth": 75, "elevation": 10, "zoom": 0.7}])
def test_a_keyframe_is_the_picture_of_render(row: dict[str, float], here: Path) -> None:
    """Bit for bit, unless the camera turns: then its distance is that of the whole turn."""
    track = {"keyframe": [{"frame": 0, **row}]}
    frame = sg.animate("ball.npy", "z{frame}.npy", keyframes=track, size=32)[0]
    assert np.array_equal(np.load(frame), sg.render("ball.npy", size=32, **row).pixels)


def test_a_series_begins_with_the_picture_of_render(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Bit for bit; what is visible at one time alone does not move the camera."""
    for number in range(2):
        np.save(f"s{number}.npy", np.pad(np.full((3 + 5 * number,) * 3, 9.0, np.float32), (2, 7 - 5 * number)))
    series = ["animate", "s0.npy", "s1.npy", "-o", "s{frame}_.npy", "--spin", "0", "--size", "24"]
    assert main(series) == 0 and "fits" not in capsys.readouterr().err
    assert np.array_equal(np.load("s0_.npy"), sg.render("s0.npy", size=24).pixels)
    assert main([*series, "--fit", "visible"]) == 0
    assert "the camera fits the whole of each volume of the series" in capsys.readouterr().err
    files = [SceneFile(f"s{number}.npy", view=ViewOptions(size=(24, 24), fit="visible")) for number in range(2)]
    over = (SceneFile("s0.npy", transfer={"points": ((0, 0.0), (9, 0.1))}),)
    layered = [replace(file, layers=over) for file in files]
    alone, both = (Animation.of(each, Timeline(spin=0.0), None, 8, is_quiet=True) for each in (files, layered))
    assert both.view(0).camera == alone.view(0).camera == sg.Camera.default("s0.npy", size=24)


def test_the_size_of_turning_keyframes_is_told(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    np.save("rod.npy", np.pad(np.full((4, 4, 20), 9.0, np.float32), 2))
    Path("k.toml").write_text("[[keyframe]]\nframe = 0\nazimuth = 90\n[[keyframe]]\nframe = 1\nazimuth = 180\n")
    assert main(["animate", "rod.npy", "-o", "r{frame}.npy", "--keyframes", "k.toml", "--size", "16"]) == 0
    assert "the camera fits the whole turn: frame 0 is 0." in capsys.readouterr().err


@pytest.mark.long
def test_keyframes_move_the_camera(here: Path) -> None:
    Path("k.toml").write_text(
        'ease = "linear"\n[[keyframe]]\nframe = 0\nazimuth = 0\nzoom = 1\n'
        "[[keyframe]]\nframe = 4\nazimuth = 90\nzoom = 4"
    )
    volume = sg.load("ball.npy")
    splats = sg.extract(volume, sg.default_transfer(volume), classification="pre")
    track = keyframes("k.toml", ViewOptions(elevation=0), volume, splats)
    assert track.last == 4
    center = (volume.corners.min(axis=0) + volume.corners.max(axis=0)) / 2
    away = [track.camera(n).eye - center for n in range(5)]
    assert np.linalg.norm(away[0]) / np.linalg.norm(away[2]) == pytest.approx(2, rel=1e-6)
    assert away[4] / np.linalg.norm(away[4]) == pytest.approx((1, 0, 0), abs=1e-9)
    assert track.motion(2).camera.eye == pytest.approx(track.camera(1).eye)
    assert track.motion(0).still
    assert animate("ball.npy", "-o", "k{frame}.png", "--keyframes", "k.toml") == 0
    assert len(list(here.glob("k*.png"))) == 5


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "at least one"),
        ("[[keyframe]]\nazimuth = 3", "frame, a whole number"),
        ("[[keyframe]]\nframe = 3", "say where the camera is"),
        ("[[keyframe]]\nframe = 0\nsize = [3, 4]", "keys frame"),
        ("[[keyframe]]\nframe = 0\nazimuth = 'a'", "one finite number"),
        ("[[keyframe]]\nframe = 0\nzoom = 0", "a positive number"),
        ("[[keyframe]]\nframe = 5\nfov = 9\n[[keyframe]]\nframe = 5\nfov = 8", "after 5"),
        ("[[keyframe]]\nframe = 0\nfov = 0", "frame 0: fov"),
        ("ease = 'hop'\n[[keyframe]]\nframe = 0\nfov = 9", "smooth or linear"),
        ("east = 1", "keys ease"),
    ],
)
def test_bad_keyframes_are_one_line(text: str, message: str, here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("k.toml").write_text(text)
    assert animate("ball.npy", "-o", "x{frame}.png", "--keyframes", "k.toml") == 2
    said = capsys.readouterr().err
    assert "k.toml" in said and message in said and said.count("\n") == 1
    assert not list(here.glob("x*"))


def test_series_go_by_the_numbers_in_names(here: Path) -> None:
    found = [s.volume for s in volumes(SceneFile("t*.npy"), ["ball.npy"])]
    assert found == ["t1.npy", "t2.npy", "t9.npy", "t10.npy", "ball.npy"]
    assert animate("t*.npy", "-o", "{frame}.npy", "--hold", "2", "--background", "transparent") == 0
    frames = [pixels(f"{n}.npy") for n in range(8)]
    assert (frames[0] == frames[1]).all() and (frames[6] == frames[7]).all()
    # the ball goes to the right: one camera for all
    middles = [float((f[..., 3].sum(axis=0) @ np.arange(24)) / f[..., 3].sum()) for f in frames[::2]]
    assert middles == sorted(middles) and middles[-1] > middles[0] + 2


def test_the_next_volume_is_read_meanwhile_and_no_more() -> None:
    class Held:
        pass

    alive: list[weakref.ref] = []
    read: list[int] = []

    def reader(n: int) -> Held:
        held = Held()
        read.append(n)
        alive.append(weakref.ref(held))
        return held

    for n, held in read_ahead(reader, [3, 4, 5, 6, 7]):
        deadline = time.monotonic() + LONGEST
        while n < 7 and n + 1 not in read and time.monotonic() < deadline:
            time.sleep(0)
        gc.collect()
        assert n in read and (n == 7 or n + 1 in read) and n + 2 not in read
        assert sum(ref() is not None for ref in alive) <= 2 and isinstance(held, Held)
    assert read == [3, 4, 5, 6, 7] and not list(read_ahead(reader, []))


@pytest.mark.long
def test_layers_and_meshes_are_in_movies(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Sharp frames are the stills of the same scene, of which layers and meshes are a part, also in a series."""
    np.save("slab.npy", np.full((4, 20, 20), 90, np.uint8))
    Path("flat.off").write_text("OFF\n3 1 0\n0 0 6\n16 0 6\n0 10 6\n3 0 1 2\n")
    Path("s.toml").write_text('volume = "ball.npy"\n[[layer]]\nvolume = "slab.npy"\nopacity = 0.5\n')
    beside = ["--layer", "slab.npy::0.5"]
    for asked in (["s.toml"], ["ball.npy", "--mesh", "flat.off:red:0.5"]):
        asked += ["--eye", "30,-20,12"]
        assert animate(*asked, "-o", "{frame}.npy", "--frames", "4", "--only", "0-1", "--motion", "off") == 0
        assert main(["render", *asked, "-o", "still.npy", *SMALL]) == 0
        assert np.abs(pixels("0.npy") - pixels("still.npy")).max() < 1e-6
        assert np.abs(pixels("1.npy") - pixels("0.npy")).max() > 0.1
    assert animate("t*.npy", *beside, "-o", "m{frame}.npy") == 0
    alone = Path("plain")
    assert animate("t*.npy", "-o", f"{alone}/{{frame}}.npy") == 0
    assert all(np.abs(pixels(f"m{n}.npy") - pixels(alone / f"{n}.npy")).max() > 0.1 for n in range(4))
    capsys.readouterr()
    assert animate("ball.npy", *beside, "-o", "x{frame}.npy", "--flow", "1") == 2
    assert "--flow: expected a scene of one volume" in capsys.readouterr().err
    assert animate("ball.npy", *beside, "-o", "x{frame}.npy", "--motion", "exact", "--frames", "2") == 2
    assert capsys.readouterr().err.startswith("splatgl: motion of layers")


def _write_series(kind: str) -> list[str]:
    """Writes three steps of a ball, the first one empty; returns the arguments of a command that animates them."""
    z, y, x = np.mgrid[:14, :14, :14]
    ball = np.exp(-((x - 6.5) ** 2 + (y - 6.5) ** 2 + (z - 6.5) ** 2) / 10)
    if kind == "channels":
        tifffile = pytest.importorskip("tifffile", reason="tifffile writes the file")
        steps = np.stack([np.stack([ball * n * 50, ball[:, ::-1] * (2 - n) * 80], 1) for n in range(3)])
        tifffile.imwrite("s.tif", steps.astype(np.uint16), imagej=True, metadata={"axes": "TZCYX", "mode": "composite"})
        return ["s.tif", "--channel", "all"]
    labels = np.where(ball > 0.3, np.where(x < 7, 3, 8), 0).astype(np.uint8)
    labels[:3, :4, :4] = 5
    for n in range(3):
        step = {"rising": np.float32(ball * n * 100), "labels": labels * (n > 0) + np.uint8(n > 1) * (labels == 8)}
        np.save(f"s{n}.npy", step[kind])
    return ["s*.npy"]


@pytest.mark.parametrize("kind", ["rising", "labels", "channels"])
def test_an_empty_first_step_does_not_choose_the_look_of_a_series(
    kind: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is clear, the widest one is as a still of it alone, and steps between are as much fainter as they are."""
    series = _write_series(kind)
    view = ["--eye", "30,-20,12", "--look-at", "6.5,6.5,6.5", "--background", "transparent"]
    assert main(["animate", *series, "-o", "{frame}.npy", *view, "--size", "24"]) == 0
    said = capsys.readouterr().err
    assert (
        "all use the transfer function of time 2, time 0, "
        if kind == "channels"
        else "all use the transfer function of s2.npy, "
    ) in said
    frames = [pixels(f"{n}.npy") for n in range(3)]
    if kind == "channels":
        # each by its own widest step: one rises, the other falls
        amounts = [np.delete(frame[..., :3].mean(axis=(0, 1)), 2) for frame in frames]
        assert amounts[0][0] == 0 and amounts[2][1] < 0.1 * amounts[0][1]
        assert 0.1 * amounts[2][0] < amounts[1][0] < 0.9 * amounts[2][0]
        return
    assert main(["render", "s2.npy", "-o", "one.npy", *view, *SMALL, "--check", "0"]) == 0
    assert not frames[0].any() and np.abs(frames[2] - pixels("one.npy")).max() < 1e-6
    shares = frames[1][..., 3].sum() / frames[2][..., 3].sum()
    assert (0.95 < shares < 1.05) if kind == "labels" else 0.1 < shares < 0.8
    # a stated look is what it was
    stated = ["--only-labels", "3"] if kind == "labels" else ["--points", "20:0,60:0.8", "--window", "0,100"]
    assert animate(*series, *stated, "-o", "p{frame}.npy", *view, "--only", "1-1") == 0
    assert main(["render", "s1.npy", *stated, "-o", "one.npy", *view, *SMALL, "--check", "0"]) == 0
    assert np.abs(pixels("p1.npy") - pixels("one.npy")).max() < 1e-6 and pixels("p1.npy").any()
    # the same in Python, of volumes in memory
    held = [np.load(f"s{n}.npy") for n in range(3)]
    seen = {"eye": (30, -20, 12), "look_at": (6.5, 6.5, 6.5), "size": 24, "background": "transparent"}
    found = sg.animate(held, "h{frame}.npy", **seen)
    assert all((pixels(path) == frame).all() for path, frame in zip(found, frames, strict=True))


def test_a_few_steps_choose_the_look_of_a_long_series(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Five are read, more only where these are constant; none where all is stated, and damaged ones are left out."""
    opened: list[int] = []
    own = SceneFile.open
    monkeypatch.setattr(SceneFile, "open", lambda file: opened.append(int(Path(file.volume).stem[1:])) or own(file))
    for n in range(40):
        np.save(f"k{n}.npy", np.pad(np.full((4, 4, 4), 9 * (n + 1), np.float32), 4) * (n != 0))
    files = [SceneFile(f"k{n}.npy") for n in range(40)]
    Path("k39.npy").write_bytes(b"no array")
    look = series_look(files)
    assert look is not None and opened == [0, 10, 20, 29, 39] and look.steps == (29,)
    stated = {"points": ((1.0, 0.0), (9.0, 0.5)), "colormap": "hot", "window": (0.0, 9.0)}
    opened.clear()
    look = series_look([replace(file, transfer=stated) for file in files])
    assert opened == [0] and look is not None and look.transfer == sg.Transfer(**stated)
    for n in {*range(40)} - {5}:
        np.save(f"k{n}.npy", np.zeros((12, 12, 12), np.float32))
    opened.clear()
    look = series_look(files)
    assert look is not None and look.steps == (5,) and len(opened) == 17
    assert series_look(files[:1]) is None


def test_isabel_is_a_series(here: Path) -> None:
    folder = DATA / "isabel"
    if not folder.is_dir():
        pytest.skip("no isabel: set SPLATGL_DATA")
    assert animate(f"{folder}/*.nrrd", "-o", "{frame}.npy", "--only", "0-1") == 0
    assert np.abs(pixels("0.npy") - pixels("1.npy")).max() > 0.05


def test_resume_keeps_what_is_there(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["ball.npy", "-o", "r/{frame:02d}.png", "--frames", "4"]
    assert animate(*command, "--only", "1-2") == 0
    kept = {path: path.stat().st_mtime_ns for path in Path("r").iterdir()}
    Path("r/.01.png.abcdefgh").write_bytes(b"half")
    Path("r/.other").write_bytes(b"mine")
    assert main(["animate", *command, "--resume", "--size", "24"]) == 0
    assert "r/00.png to r/03.png: 4 frames, 2 of them existed" in capsys.readouterr().out
    assert sorted(p.name for p in Path("r").iterdir()) == [".other", "00.png", "01.png", "02.png", "03.png"]
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    # another animation's frames are not taken for these
    assert animate(*command, "--resume", "--spin", "3") == 2
    assert "r/00.png: expected a frame of this animation" in capsys.readouterr().err
    assert animate(*command, "--spin", "3") == 0


@pytest.mark.long
def test_killed_and_resumed_without_a_gap(here: Path) -> None:
    """SIGKILL in the middle: all frames that are there are whole; going on gives those of a run that went through."""
    command = ["ball.npy", "-o", "k/{frame:03d}.png", "--frames", "400", "--size", "24", "--quiet"]
    process = subprocess.Popen([sys.executable, "-m", "splatgl", "animate", *command])
    try:
        while len(list(here.glob("k/[0-9]*.png"))) < 5 and process.poll() is None:
            time.sleep(0.005)
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    before = sorted(here.glob("k/[0-9]*.png"))
    assert 5 <= len(before) < 400, "killed in the middle"
    for path in before:
        assert pixels(path).shape == (24, 24, 4)
    assert main(["animate", *command, "--resume"]) == 0
    after = sorted(here.glob("k/*"))
    assert [p.name for p in after] == [f"{n:03d}.png" for n in range(400)]
    whole = [*command]
    whole[2] = "w/{frame:03d}.png"
    assert main(["animate", *whole, "--only", f"{len(before) - 2}-{len(before) + 2}"]) == 0
    for path in here.glob("w/*.png"):
        assert (pixels(path) == pixels(here / "k" / path.name)).all()


def test_the_time_of_frames_is_told() -> None:
    """After the first, if all take a while; without a bar a line each tenth or minute, at most every 10 s."""
    now = 0.0
    lines, slow, quick = (ProgressLines("frame", True, lambda: now) for _ in range(3))
    said = {}
    for done in range(1, 61):
        now += 4.0 if done < 40 else 0.5
        said[done] = lines.after(done, 60, is_logged=True)
    assert said[1] == ["the first frame took 4.0 s: 60 take up to about 4 min"]
    assert [done for done, told in said.items() if told] == [1, *range(6, 43, 6)]
    assert said[6] == ["6 of 60 frames drawn, about 4 min left"]
    assert len(slow.after(1, 9999, is_logged=False)) == 1 and slow.after(2, 9999, is_logged=True) == []
    now += 61
    assert slow.after(3, 9999, is_logged=False) == [] and len(slow.after(4, 9999, is_logged=True)) == 1
    quick.begun = now - 0.01
    assert quick.after(1, 60, is_logged=True) == []
    assert [duration(seconds) for seconds in (3.4, 600, 7500)] == ["3 s", "10 min", "2 h 05 min"]


def test_explain_tells_how_the_first_frame_moves(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["animate", "letter-f", "-o", "f{frame}.png", "--size", "16", "--frames", "2", "--spin", "5", "--paper"]
    assert main([*command, "--explain"]) == 0
    said = capsys.readouterr().out
    assert said.count("motion blur paper, shutter 180°") == 1 and "streaks are straight" in said
    assert main(command) == 0
    assert "motion blur" not in capsys.readouterr().out
    assert main([*command, "--explain", "--workers", "2"]) == 2
    assert "--explain: expected frames rendered by this process, got --workers" in capsys.readouterr().err


@pytest.mark.long
def test_moments_blur(here: Path) -> None:
    """The mean of pictures within half a frame; with streaks that is nearer to the mean of many. A shutter that does
    not open draws the frame itself.
    """
    # streaks are of splats, so that all are
    before = ["--like", "0.1"]
    one = ["--frames", "9", "--only", "1", *before]
    assert animate("ball.npy", "-o", "a{frame}.npy", *one, "--motion", "off") == 0
    assert animate("ball.npy", "-o", "b{frame}.npy", *one, "--motion", "off", "--moments", "3") == 0
    shut = ["--moments", "2", "--shutter", "0"]
    for motion in ("off", "exact"):
        assert animate("ball.npy", "-o", "c{frame}.npy", *one, *shut, "--motion", motion) == 0
        assert (pixels("a1.npy") == pixels("c1.npy")).all()
    assert animate("ball.npy", "-o", "d{frame}.npy", "--frames", "108", "--motion", "off", *before) == 0
    # of 108 frames a turn, 12 are one of 9; the shutter is open for 6, and its thirds' middles are 11, 9 and 7
    mean = (pixels("d11.npy") + pixels("d9.npy") + pixels("d7.npy")) / 3
    assert np.abs(pixels("b1.npy") - mean).max() < 2e-4 < np.abs(pixels("a1.npy") - mean).max()
    assert animate("ball.npy", "-o", "e{frame}.npy", *one, "--motion", "off", "--moments", "48") == 0
    # of itself it takes as many as the paths are long; streaks alone are further, and nearer the more of them
    for name, more in (
        ("f", ["--motion", "moments"]),
        ("g", ["--motion", "exact"]),
        ("h", ["--motion", "exact", "--moments", "4"]),
    ):
        assert animate("ball.npy", "-o", f"{name}{{frame}}.npy", *one, *more) == 0
    own, streak, streaks = (np.abs(pixels(f"{name}1.npy") - pixels("e1.npy")).max() for name in "fgh")
    assert 4 * own < streak and 2 * streaks < streak
    # maxima have no streaks, and a mean all the same
    for name, more in (("i", ["--motion", "moments"]), ("j", []), ("k", ["--motion", "off", "--moments", "48"])):
        assert animate("ball.npy", "-o", f"{name}{{frame}}.npy", *one, "--blend", "mip", *more) == 0
    own, still = (np.abs(pixels(f"{name}1.npy") - pixels("k1.npy")).max() for name in "ij")
    assert 10 * own < still


def test_moments_blur_pictures_of_values(here: Path) -> None:
    """The mean of pictures that are classified after reconstruction, if a shutter or moments ask for blur."""
    one = ["ball.npy", "--frames", "9", "--only", "1"]
    assert animate(*one, "-o", "a{frame}.npy", "--moments", "2") == 0
    assert animate("ball.npy", "-o", "d{frame}.npy", "--frames", "72", "--motion", "off", "--only", "5-7") == 0
    # of 72 frames a turn, 8 are one of 9; the shutter is open for 4, and its halves' middles are 7 and 5
    mean = (pixels("d7.npy") + pixels("d5.npy")) / 2
    assert np.abs(pixels("a1.npy") - mean).max() < 2e-4
    assert animate(*one, "-o", "s{frame}.npy", "--shutter", "0", "--motion", "exact") == 0
    assert animate(*one, "-o", "o{frame}.npy") == 0
    assert (pixels("s1.npy") == pixels("o1.npy")).all()
    for name, more in (("b", ["--shutter", "180"]), ("m", ["--motion", "moments"])):
        assert animate(*one, "-o", f"{name}{{frame}}.npy", *more) == 0
    assert (pixels("b1.npy") == pixels("m1.npy")).all() and (pixels("b1.npy") != pixels("o1.npy")).any()


@pytest.mark.long
def test_xray_has_one_scale_for_all_frames(here: Path) -> None:
    command = ["ball.npy", "--blend", "xray", "--frames", "6", "--background", "black"]
    assert animate(*command, "-o", "{frame}.png") == 0
    assert animate(*command, "-o", "{frame}.npy") == 0
    ratios = []
    for n in range(6):
        shown, right = pixels(f"{n}.png")[..., 0], pixels(f"{n}.npy")[..., 0]
        some = right > right.max() / 3
        ratios.append(float(np.median(shown[some] / right[some])))
    assert np.ptp(ratios) < 0.02 * ratios[0]


@pytest.mark.few(1)
@pytest.mark.parametrize("suffix", [".mp4", ".webm", ".gif"])
def test_movies(suffix: str, here: Path) -> None:
    """As many frames as asked for, of the right size and colours; nothing left beside it."""
    if suffix != ".gif":
        av = pytest.importorskip("av", reason="writes movies; it is in the extra video")
    assert main(["animate", "letter-f", "-o", f"m{suffix}", "--frames", "5", "--size", "33x24", "--quiet"]) == 0
    assert sorted(p.name for p in here.iterdir() if p.name.startswith(("m", ".m"))) == [f"m{suffix}"]
    if suffix == ".gif":
        from PIL import Image, ImageSequence

        with Image.open("m.gif") as movie:
            shown = [np.asarray(frame.convert("RGB")) for frame in ImageSequence.Iterator(movie)]
    else:
        with av.open(f"m{suffix}") as movie:
            shown = [frame.to_ndarray(format="rgb24") for frame in movie.decode(video=0)]
    assert len(shown) == 5 and shown[0].shape[:2] in ((24, 33), (24, 34))
    assert main(["animate", "letter-f", "-o", "p{frame}.png", "--frames", "5", "--size", "33x24", "--quiet"]) == 0
    for n in (0, 3):
        right = sg.Image.load(f"p{n}.png").over((0, 0, 0)).straight()[..., :3] * 255
        assert np.abs(shown[n][:24, :33] - right).mean() < 12


@pytest.mark.parametrize("stop", [KeyboardInterrupt(), sg.InputError("m.gif: cannot be written: no space left")])
def test_a_movie_goes_on_from_its_frames(
    stop: BaseException, here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The frames that stay are told, from the command as from Python."""

    def killed(*_: object) -> None:
        raise type(stop)(*stop.args)

    monkeypatch.setattr(movie, "write_movie", killed)
    arguments = ["ball.npy", "-o", "m.gif", "--frames", "3"]
    assert animate(*arguments) == (130 if isinstance(stop, KeyboardInterrupt) else 2)
    assert len(list(Path("m.gif.frames").iterdir())) == 3
    told = "3 of 3 frames stay in m.gif.frames; --resume, in Python resume=True, continues from them"
    assert capsys.readouterr().err.splitlines()[-1] == f"splatgl: {told}"
    with pytest.raises(type(stop)) as error:
        sg.animate("ball.npy", "n.gif", frames=2, size=8)
    assert error.value.__notes__ == [told.replace("3", "2").replace("m.gif", "n.gif")]
    monkeypatch.undo()
    monkeypatch.chdir(here)
    assert animate(*arguments, "--resume") == 0
    assert Path("m.gif").is_file() and not Path("m.gif.frames").exists()


def test_a_draft_takes_one_sample_and_voxels_as_wide_as_pixels(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Near the movie, and no part of it; where pixels are narrow, voxels stay."""
    z, y, x = np.mgrid[:44, :44, :44]
    np.save("fine.npy", ((np.hypot(np.hypot(x - 22, y - 20), z - 24) < 17) * 200).astype(np.uint8))
    draft, usual = (["fine.npy", "--frames", "3", "-o", f"{n}/{{frame}}.png"] for n in range(2))
    assert animate(*draft, "--draft") == animate(*usual) == 0
    for n in range(3):
        quick, full = (sg.Image.load(f"{kind}/{n}.png") for kind in range(2))
        assert (quick.info["samples"], quick.info["tolerance"]) == (1, 8 / 255)
        assert quick.info["voxels_averaged"] == 8 and "voxels_averaged" not in full.info
        assert quick.info["splats"] < full.info["splats"] / 3  # type: ignore[operator]
        assert 0 < np.sqrt(((quick.pixels - full.pixels) ** 2).mean()) < 0.1
    assert animate(*usual, "--resume", "--draft") == 2
    assert "a frame of this animation" in capsys.readouterr().err
    found = sg.animate("fine.npy", "py/{frame}.png", frames=3, size=24, draft=True)
    assert all(path.read_bytes() == Path(f"0/{path.name}").read_bytes() for path in found)
    (large,) = sg.animate("fine.npy", "l/{frame}.png", frames=3, size=96, only=(0, 0), draft=True)
    assert "voxels_averaged" not in sg.Image.load(large).info


@pytest.mark.parametrize("beside", [(), (SceneFile("ball.npy"),)], ids=["alone", "layers"])
def test_workers_draw_the_voxels_of_a_draft(beside: tuple[SceneFile, ...], here: Path) -> None:
    np.save("fine.npy", np.pad(np.full((30, 30, 30), 9.0, np.float32), 4))
    file = SceneFile("fine.npy", layers=beside, view=ViewOptions(size=(12, 12)))
    counts = []
    for is_draft in (False, True):
        movie = Animation.of([file], Timeline(draft=is_draft), None, 8, is_quiet=True)
        assert movie.only is not None
        for content in (movie.only.content, movie.job.subject(0).content):
            assert isinstance(content, sg.Splats | sg.Scene)
            counts.append([len(splats) for splats, _ in content.drawn(movie.job.settings)])
    assert counts[0] == counts[1] and counts[2] == counts[3] and counts[2][0] < counts[0][0] / 4
    assert counts[2][1:] == counts[0][1:]


@pytest.mark.few(1)
def test_frames_are_encoded_and_joined_while_the_next_ones_are_drawn(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each is planned once."""
    begun, joined, plans = [Event() for _ in range(5)], Event(), list[object]()
    frame, encoded, frames_of, plan = FrameJob.frame, FrameFiles.encoded, movie._frames, vars(renderers)["plan_scene"]

    def draws(self: FrameJob, renderer: sg.Renderer, files: Any, subject: Any, view: FrameView, explain: bool) -> Any:
        begun[view.frame].set()
        return frame(self, renderer, files, subject, view, explain)

    def encodes(self: FrameFiles, number: int, image: sg.Image, bits: int) -> bytes:
        # the time of the first is told at once
        assert number == 0 or (joined if number == 4 else begun[number + 1]).wait(SHORT), number
        return encoded(self, number, image, bits)

    def joins(*of: Any) -> Iterator[np.ndarray]:
        for shown in frames_of(*of):
            joined.set()
            yield shown

    monkeypatch.setattr(FrameJob, "frame", draws)
    monkeypatch.setattr(FrameFiles, "encoded", encodes)
    monkeypatch.setattr(movie, "_frames", joins)
    monkeypatch.setattr(renderers, "plan_scene", lambda *of: plans.append(of) or plan(*of))
    assert sg.animate("ball.npy", "m.gif", frames=5, size=24) == [Path("m.gif")]
    assert len(plans) == 5


@pytest.mark.parametrize("stop", [KeyboardInterrupt(), sg.InputError("the fourth cannot be drawn")])
def test_frames_before_one_that_fails_stay(stop: BaseException, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frame = FrameJob.frame

    def draws(self: FrameJob, renderer: sg.Renderer, files: Any, subject: Any, view: FrameView, explain: bool) -> Any:
        if view.frame == 3:
            raise type(stop)(*stop.args)
        return frame(self, renderer, files, subject, view, explain)

    monkeypatch.setattr(FrameJob, "frame", draws)
    with pytest.raises(type(stop)) as error:
        sg.animate("ball.npy", "m.gif", frames=6, size=24)
    assert error.value.__notes__[0].startswith("3 of 6 frames stay in m.gif.frames; --resume")
    assert len(list(Path("m.gif.frames").iterdir())) == 3 and not list(here.glob("*m.gif*.*"))[1:]
    monkeypatch.undo()
    monkeypatch.chdir(here)
    sg.animate("ball.npy", "m.gif", frames=6, size=24, resume=True)
    sg.animate("ball.npy", "n.gif", frames=6, size=24)
    assert Path("m.gif").read_bytes() == Path("n.gif").read_bytes()


def test_movies_need_their_extra(
    here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    assert animate("ball.npy", "-o", "m.mp4", "--frames", "2") == 2
    assert "pip install 'splatgl[video]'" in capsys.readouterr().err


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["-o", "a.png"], "a name with {frame} in it"),
        (["-o", "a{frame}{x}.png"], "a name with {frame} in it"),
        (["-o", "a{frame:.0s}.png"], "a name with {frame} in it"),
        (["-o", "a{frame!r}.png"], "a name with {frame} in it"),
        (["-o", "a{frame:c}.png"], "a name with {frame} in it"),
        (["-o", "a{frame:1000000}.png"], "a name with {frame} in it"),
        (["-o", "a{frame:{frame}}.png"], "a name with {frame} in it"),
        (["-o", ""], "output: expected a name, got nothing"),
        (["-o", "a{frame}.png", "--keyframes", ""], "keyframes: expected a name, got nothing"),
        (["-o", "a{frame}.gif", "--fps", "1e-308"], "--fps: expected a number from 0.01"),
        (["-o", "a{frame}.png", "--axis", "inf,0,1"], "--axis: expected 3 finite numbers"),
        (["-o", "a{frame.png"], "a name with {frame} in it"),
        (["-o", "a{frame}.jpg"], "ends in .png or .npy"),
        (["-o", "{frame}/a.png"], "in the file's name alone"),
        (["-o", "ball.npy/where/{frame}.png"], "expected a folder, got the file"),
        (["-o", "a{frame}.png", "--only", "5-2"], "expected A-B"),
        (["-o", "a{frame}.png", "--only", "8-12", "--frames", "10"], "frames from 0 to 9"),
        (["-o", "a{frame}.png", "--frames", "0"], "--frames: expected a whole number"),
        (["-o", "a{frame}.png", "--spin", "3", "--turntable", "3"], "one of --turntable, --spin and --keyframes"),
        (["-o", "a{frame}.png", "--fps", "0"], "--fps"),
        (["-o", "a{frame}.png", "--spin", "1e308"], "--spin: expected a number from"),
        (["-o", "a{frame}.png", "--flow", "inf"], "--flow: expected a number from"),
        (["-o", "a{frame}.png", "--axis", "0,0,0"], "axis: expected a direction"),
        (["-o", "a{frame}.png", "--shutter", "400", "--moments", "2"], "shutter: expected an angle"),
        (["-o", "a{frame}.png", "--flow", "1", "--motion", "off"], "--moments"),
        (["-o", "a{frame}.png", "--flow", "1"], "vectors"),
        (["-o", "a{frame}.png", "--flow", "1", "--moments", "2"], "vectors"),
        (["z*.npy", "-o", "a{frame}.png"], "a pattern that files fit"),
        (["-o", "a{frame}.png", "--keyframes", "none.toml"], "none.toml"),
    ],
)
def test_bad_input_is_one_line(
    arguments: list[str], message: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        code = animate("ball.npy", *arguments)
    except SystemExit as error:
        code = int(error.code or 0)
    said = capsys.readouterr().err.strip()
    assert code == 2 and message in said and said.count("\n") == 0
    assert not list(here.glob("a*"))


def test_templates(here: Path) -> None:
    frames = FrameFiles.at("x/{frame:05d}_a.png", "m")
    assert frames.path(37) == Path("x/00037_a.png") and not Path("x").exists()
    assert FrameFiles.at("x/{frame:3}{frame}.npy", "m").path(37) == Path("x/ 3737.npy")
    assert FrameFiles.at("m.mp4", "m").path(3) == Path("m.mp4.frames/000003.png")


def test_a_scaled_x_ray_scales_its_bound() -> None:
    image = scale_xray(sg.Image(np.full((2, 2, 4), 3.0, np.float32), {"error_bound": 0.5}), 4.0)
    assert image.info["error_bound"] == 0.125 and (image.pixels == 0.75).all()


@pytest.mark.long
@pytest.mark.parametrize(
    "options",
    [["--moments", "1"], ["--moments", "3"], ["--motion", "moments"], ["--shutter", "179", "--blend", "xray"]],
    ids=str,
)
def test_a_volume_beyond_memory_is_drawn_in_bricks(
    options: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Still and moving frames are those of the whole; moments are counted by the bricks' places, and explained."""
    monkeypatch.chdir(tmp_path)
    np.save("v.npy", noise(np.random.default_rng(1), (20, 20, 20)))
    asked = ["animate", "v.npy", "--frames", "30", "--only", "3-4", "--size", "24", "--points", "0.45:0,0.6:0.8"]
    keyed = [*asked, "--keyframes", "k.toml", *options]
    Path("k.toml").write_text(
        "[[keyframe]]\nframe = 0\neye = [60, 9, 20]\nlook_at = [10, 10, 10]\n"
        "[[keyframe]]\nframe = 29\neye = [9, 60, 20]\nlook_at = [10, 10, 10]\n"
    )
    assert main([*keyed, "-o", "a/{frame}.npy"]) == 0
    bricks = []
    render = sg.Renderer.render_bricks
    allow_any_memory(monkeypatch)
    monkeypatch.setattr(sg.Renderer, "render_bricks", lambda *a, **k: bricks.append(1) or render(*a, **k))
    monkeypatch.setattr("splatgl.fileio._budget", [1 << 20])
    capsys.readouterr()
    count = {"1": 1, "3": 3}.get(options[-1], 2)
    assert main([*keyed, "-o", "b/{frame}.npy", "--explain"]) == 0
    assert f"the mean of pictures at {count} times" in capsys.readouterr().out
    assert len(bricks) >= 2 * count
    for n in (3, 4):
        first, second = (np.load(f"{folder}/{n}.npy") for folder in "ab")
        # sums are exact streaks, if whole
        allowed = 0.03 * first.max() if "xray" in options else 2e-3
        assert first.max() > 0.3 and np.abs(first - second).max() < allowed


def test_the_plan_of_bricks_counts_the_moments_that_are_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of a part of the volume, whose corners are outside the picture."""
    monkeypatch.chdir(tmp_path)
    np.save("v.npy", noise(np.random.default_rng(1), (20, 20, 20)))
    drawn = []
    render = sg.Renderer.render_bricks
    allow_any_memory(monkeypatch)
    monkeypatch.setattr(sg.Renderer, "render_bricks", lambda *a, **k: drawn.append(1) or render(*a, **k))
    monkeypatch.setattr("splatgl.fileio._budget", [1 << 20])
    asked = ["animate", "v.npy", "--points", "0.45:0,0.6:0.8", "--size", "24", "--zoom", "4", "--frames", "12"]
    assert main([*asked, "--only", "3", "--motion", "moments", "--explain", "-o", "{frame}.npy"]) == 0
    assert len(drawn) > 1 and f"the mean of pictures at {len(drawn)} times" in capsys.readouterr().out


@pytest.mark.parametrize("options", [["--motion", "exact"], ["--flow", "1"]], ids=str)
def test_what_takes_all_splats_of_a_volume_beyond_memory_is_refused(
    options: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    np.save("v.npy", np.random.default_rng(1).random((20, 20, 20)))
    monkeypatch.setattr("splatgl.fileio._budget", [1 << 20])
    assert main(["animate", "v.npy", "-o", "{frame}.npy", "--frames", "2", "--size", "8", *options]) == 2
    error = capsys.readouterr().err
    assert "v.npy: expected a volume that fits into 1.0 MiB" in error and error.count("\n") == 1
    assert not list(Path().glob("[0-9]*"))


@pytest.mark.parametrize("fps", [7, 24, 30, 40, 50, 60, 90, 240])
@pytest.mark.parametrize("count", [1, 2, 3, 10, 97])
def test_a_gif_keeps_its_speed(count: int, fps: float) -> None:
    """In hundredths of a second, of which browsers show at least two; to within a hundredth at each frame."""
    chosen, durations = gif_times(count, fps)
    begins = np.cumsum([0, *durations])
    assert chosen[0] == 0 and min(durations) >= 20 and all(duration % 10 == 0 for duration in durations)
    assert np.abs(begins[:-1] - 1000 * np.array(chosen) / fps).max() <= 5
    assert abs(begins[-1] - 1000 * count / fps) <= 20 and (fps > 50 or chosen == list(range(count)))


def test_patterns_in_folders_with_brackets(here: Path) -> None:
    folder = here / "run [1]"
    folder.mkdir()
    for number in (10, 2):
        shutil.copy("ball.npy", folder / f"t{number}.npy")
    assert expanded(["run [1]/t*.npy"]) == ["run [1]/t2.npy", "run [1]/t10.npy"]
    # no patterns: a missing file in it, and an address
    for source in ("run [1]/t9.npy", "https://host/a.nrrd?b=[1]"):
        assert expanded([source]) == [source]
    assert animate("run [1]/t*.npy", "-o", "out [2]{frame}.png") == 0 and Path("out [2]1.png").is_file()
    with pytest.raises(sg.InputError, match="a pattern that files fit, got none"):
        expanded(["run [12]/t*.npy"])


def test_time_points_of_xarray_are_a_series(tmp_path: Path) -> None:
    """In any order of the dimensions, of arrays and datasets; as a list of them."""
    xarray = pytest.importorskip("xarray", reason="xarray is in the extra arrays")
    samples = np.random.default_rng(0).random((3, 4, 5, 6))
    data = xarray.DataArray(samples, dims=("time", "z", "y", "x"), name="heat")
    steps = [data.isel(time=number) for number in range(3)]
    frames = {"list": steps, "array": data, "last": data.transpose("z", "y", "x", "time"), "set": data.to_dataset()}
    found = {}
    for name, x in frames.items():
        files = sg.animate(x, tmp_path / name / "{frame}.png", size=32, turntable=0)
        found[name] = [sg.Image.load(file).pixels for file in files]
    assert len(found["list"]) == 3
    assert all(np.array_equal(pictures, found["list"]) for pictures in found.values())
    with pytest.raises(sg.InputError, match="3 dimensions, got 4"):
        sg.render(data)

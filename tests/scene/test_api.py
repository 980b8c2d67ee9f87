"""`render` and `show`: the command line's picture in one call; pictures as arrays, in Pillow and in notebooks."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from functools import partial
from pathlib import Path
from threading import Thread, current_thread, main_thread
from typing import Any

import numpy as np
import pytest
from PIL import Image as Pillow

import splatgl as sg
from splatgl import fileio
from splatgl.animation.animation import Animation
from splatgl.cli.main import main
from splatgl.gl.renderer import shared_renderer
from splatgl.opengl import OpenGL
from splatgl.planning.culling import OpaqueBounds
from splatgl.platforms import has_display
from splatgl.scene.draw import DrawOptions, draw
from splatgl.scene.open_scene import OpenScene
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.view import ViewOptions
from splatgl.viewer import show
from splatgl.viewer.show import in_notebook
from tests.helpers.memory import allow_any_memory

pytestmark = pytest.mark.usefixtures("shared_programs")


@pytest.fixture
def volume() -> sg.Volume:
    """Two soft balls, of different values."""
    z, y, x = np.indices((24, 28, 32)) - 14.0
    near = np.exp(-((x - 4) ** 2 + y**2 + z**2) / 30) + 0.5 * np.exp(-((x + 8) ** 2 + (y - 5) ** 2 + z**2) / 12)
    return sg.Volume((near * 200).astype(np.uint8), spacing=(1, 1, 1.5), name="balls")


def test_memory_is_the_budget_of_all_that_a_call_does(volume: sg.Volume, monkeypatch: pytest.MonkeyPatch) -> None:
    """While it reads and draws; afterwards the process has its own again."""
    found: list[int] = []

    def draw(*_: Any) -> None:
        found.append(fileio.budget())
        raise sg.InputError("seen")

    monkeypatch.setattr(OpenScene, "read", draw)
    monkeypatch.setattr(Animation, "of", draw)
    monkeypatch.setattr(show, "in_notebook", lambda: False)
    monkeypatch.setattr(show, "has_display", lambda: True)
    monkeypatch.setattr(show, "_window", draw)
    for call in (sg.render, sg.show, partial(sg.animate, output="a.png", frames=2)):
        with fileio.within(3 << 30), pytest.raises(sg.InputError, match=r"^seen$"):
            call(volume, memory="2GiB")
        with pytest.raises(sg.InputError, match=r"^memory: expected a positive number of bytes, got 0"):
            call(volume, memory=0)
    assert found == [2 << 30] * 3 and fileio.budget() != 2 << 30
    # the command of movies, too
    assert main(["animate", "ball", "-o", "{frame}.png", "--frames", "2", "--memory", "1GiB"]) == 2
    assert found[3:] == [1 << 30]


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("command", "options"),
    [
        ("", {}),
        (
            "--azimuth 60 --elevation -10 --zoom 1.5 --fov 30 --background #204060",
            {"azimuth": 60, "elevation": -10, "zoom": np.float32(1.5), "fov": 30, "background": "#204060"},
        ),
        ("--preset microscopy --blend mip", {"transfer": "microscopy", "blend": "mip"}),
        ("--colormap viridis --window 20,180", {"colormap": "viridis", "window": (20, 180)}),
        ("--like 0.1 --threshold 0.05", {"settings": sg.Settings.like("0.1"), "threshold": 0.05, "fit": "0.3"}),
        ("--orthographic --height 40", {"orthographic": True, "height": 40}),
        ("--eye 90,80,70 --look-at 10,10,10", {"eye": (90, 80, 70), "look_at": np.array([10.0, 10, 10])}),
        ("--memory 64KiB", {"memory": "64KiB"}),
    ],
)
def test_the_pixels_are_those_of_the_command(
    volume: sg.Volume, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str, options: dict[str, Any]
) -> None:
    allow_any_memory(monkeypatch)
    np.save(tmp_path / "balls.npy", volume.samples)
    out = tmp_path / "out.npy"
    shared = f"--spacing 1,1,1.5 --size 96x64 {command}".split()
    assert main(["render", str(tmp_path / "balls.npy"), "-o", str(out), "--quiet", *shared]) == 0
    right = np.load(out)
    assert right.any()
    for source in (tmp_path / "balls.npy", volume.samples, volume):
        image = sg.render(source, size=(96, 64), spacing=(1, 1, 1.5), **options)
        assert np.array_equal(image.pixels, right)
        assert ("bricks" in image.info) == ("memory" in options)
    # the transfer function is told, as in files of the command
    assert "points" in str(image.info["transfer"]) and image.info["version"] == sg.__version__


@pytest.mark.long
def test_scene_files_and_built_in_scenes(volume: sg.Volume, tmp_path: Path) -> None:
    np.save(tmp_path / "balls.npy", volume.samples)
    scene = tmp_path / "scene.toml"
    scene.write_text('volume = "balls.npy"\n[camera]\nsize = [48, 32]\nazimuth = 70\n[settings]\nblend = "mip"\n')
    assert main(["render", str(scene), "-o", str(tmp_path / "out.npy"), "--quiet", "--elevation", "5"]) == 0
    assert np.array_equal(sg.render(scene, elevation=5).pixels, np.load(tmp_path / "out.npy"))
    assert sg.render("letter-f", size=64).info["source"] == "letter-f"


@pytest.mark.long
def test_a_camera_a_transfer_function_and_splats(volume: sg.Volume, renderer: sg.Renderer) -> None:
    transfer = sg.Transfer([(20, 0.0), (150, 0.7)], colormap="bone")
    splats, camera = sg.extract(volume, transfer), sg.Camera.orbit(volume, 10, 30, size=(64, 48))
    white = sg.Settings(background="white")
    right = renderer.render(splats, camera, white).pixels
    assert np.array_equal(sg.render(volume, transfer, camera).pixels, right)
    assert np.array_equal(sg.render(splats, camera=camera).pixels, right)
    fitted = sg.Camera.orbit(OpaqueBounds(volume, transfer), 30, 20, size=(64, 48))
    assert np.array_equal(sg.render(splats, size=(64, 48)).pixels, renderer.render(splats, fitted, white).pixels)
    found = sg.render(volume, {"points": transfer.points, "colormap": "gray"}, camera, colormap="bone")
    assert np.array_equal(found.pixels, right)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"azimut": 3}, "got azimut; did you mean azimuth"),
        ({"shape": (1, 2, 3)}, "spacing, origin, unit, name, array, values, got shape"),
        ({"size": "big"}, "size: expected a width and a height"),
        ({"azimuth": "left"}, "azimuth: expected one finite number"),
        ({"background": "blau"}, "background: expected"),
        ({"blend": "add"}, "blend: expected composite"),
        ({"transfer": "bony"}, "preset: expected one of"),
        ({"transfer": 3}, "transfer: expected a Transfer"),
        ({"transfer": {"point": ()}}, "transfer: expected keys"),
        ({"camera": 3}, "camera: expected a Camera"),
        ({"settings": 3}, "settings: expected Settings"),
        ({"memory": "much"}, "memory: expected"),
        ({"points": [(300, 0.0), (400, 0.5)]}, "balls: expected voxels with an opacity"),
    ],
)
def test_wrong_options_are_told_in_a_line(volume: sg.Volume, options: dict[str, Any], told: str) -> None:
    with pytest.raises(sg.InputError, match=told) as found:
        sg.render(volume, **options)
    assert "\n" not in str(found.value)


def test_splats_refuse_what_they_were_extracted_with(volume: sg.Volume) -> None:
    splats = sg.extract(volume, sg.Transfer([(20, 0.0), (150, 0.7)]))
    for options in ({"threshold": 0.1}, {"spacing": (1, 1, 1)}, {"colormap": "bone"}):
        with pytest.raises(sg.InputError, match=f"splats: expected a view and settings, got {next(iter(options))}"):
            sg.render(splats, **options)
    camera = sg.Camera.orbit(volume)
    with pytest.raises(sg.InputError, match="no view together with a camera, got zoom"):
        sg.render(splats, camera=camera, zoom=2)


@pytest.mark.long
def test_calls_share_a_renderer_in_any_thread(volume: sg.Volume) -> None:
    right = sg.render(volume, size=64).pixels
    with shared_renderer() as first:
        pass
    found: dict[int, np.ndarray] = {}

    def draw(number: int) -> None:
        found[number] = sg.render(volume, size=64).pixels

    threads = [Thread(target=draw, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(found) == [0, 1, 2, 3] and all(np.array_equal(each, right) for each in found.values())
    with shared_renderer() as last:
        assert last is first
    # what was interrupted is closed
    with pytest.raises(KeyboardInterrupt), shared_renderer():
        raise KeyboardInterrupt
    assert np.array_equal(sg.render(volume, size=64).pixels, right)
    with shared_renderer() as other:
        assert other is not first


ENDED = """
import ctypes
import numpy as np
import splatgl as sg
from splatgl.gl.renderer import shared_renderer
from splatgl.gl.context import current
from splatgl.gl.backends import BackendError
ball = sg.scenes.ball(6)
first = sg.render(ball, size=24).pixels
with shared_renderer() as renderer, current(renderer.ctx):
    backend = renderer.info.backend
    egl = ctypes.CDLL("libEGL.so.1") if backend == "egl" else None
    if egl is not None:
        egl.eglGetCurrentDisplay.restype = ctypes.c_void_p
        display = egl.eglGetCurrentDisplay()
if egl is not None:
    # as VTK does
    egl.eglTerminate(ctypes.c_void_p(display))
    try:
        with current(renderer.ctx):
            pass
    except BackendError as error:
        assert "another library ended its display" in str(error)
print(backend, np.array_equal(first, sg.render(ball, size=24).pixels))
if egl is not None:
    egl.eglTerminate(ctypes.c_void_p(display))
"""


def test_a_display_that_another_library_ends_is_opened_again() -> None:
    run = subprocess.run([sys.executable, "-W", "ignore", "-c", ENDED], capture_output=True, text=True, check=True)
    if not run.stdout.startswith("egl"):
        pytest.skip(f"displays are EGL's, the context is {run.stdout.split()[0]}'s")
    assert run.stdout.split() == ["egl", "True"] and run.stderr == ""


@pytest.mark.long
@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are forked on Unix")
def test_a_forked_process_never_uses_its_parents_renderer() -> None:
    """It draws with a library that its parent had not opened, or is told how to start processes."""
    code = """
import os, numpy as np, splatgl as sg
cube = np.pad(np.ones((4, 4, 4)), 3)
assert sg.render(cube, size=32).pixels.any()
if not os.fork():
    try:
        print("drawn" if sg.render(cube, size=32).pixels.any() else "empty", flush=True)
    except sg.InputError as error:
        print(error, flush=True)
    os._exit(0)
os.wait()
assert sg.render(cube, size=32).pixels.any()
"""
    run = subprocess.run([sys.executable, "-W", "ignore", "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout == "drawn\n" or ("spawn" in run.stdout and run.stdout.count("\n") == 1)
    assert run.stderr == ""


@pytest.mark.long
def test_images_are_arrays_and_pictures(volume: sg.Volume, tmp_path: Path) -> None:
    image = sg.render(volume, size=(48, 32))
    assert np.asarray(image).dtype == np.uint8 and np.asarray(image, np.float64).dtype == np.float64
    with pytest.raises(ValueError, match="copy"):
        image.__array__(copy=False)
    image.save(tmp_path / "a.png")
    saved = np.asarray(Pillow.open(tmp_path / "a.png"))
    assert (np.asarray(image.to_pil()) == saved).all() and image.to_pil().mode == "RGBA"
    assert (np.asarray(image) == saved).all() and (image.srgb == saved).all()
    assert (np.asarray(Pillow.open(io.BytesIO(image._repr_png_()))) == saved).all()


def test_an_xray_is_shown_on_its_background(volume: sg.Volume, tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", volume.samples)
    options = ["--blend", "xray", "--background", "white", "--size", "48", "--quiet"]
    assert main(["render", str(tmp_path / "a.npy"), "-o", str(tmp_path / "a.png"), *options]) == 0
    image = sg.render(tmp_path / "a.npy", blend="xray", background="white", size=48)
    assert (np.asarray(image.to_pil()) == np.asarray(Pillow.open(tmp_path / "a.png"))).all()


def test_reprs_are_one_line_without_arrays(volume: sg.Volume) -> None:
    transfer = sg.Transfer([(20, 0.0), (150, 0.7)])
    splats, camera = sg.extract(volume, transfer), sg.Camera.orbit(volume, size=(64, 48))
    told = {
        repr(volume): ["'balls'", "32×28×24 uint8", "1×1×1.5"],
        repr(splats): ["'balls'", f"{len(splats):,} values"],
        repr(camera): ["64×48", "eye (", "fov 40°"],
        repr(camera.parallel(volume)): ["orthographic"],
        repr(transfer): ["points=((20.0, 0.0), (150.0, 0.7))"],
        repr(sg.render(volume, size=(48, 32))): ["48×32", "balls", "composite"],
    }
    for line, parts in told.items():
        assert "\n" not in line and len(line) < 160 and "array" not in line
        assert [part for part in parts if part not in line] == []


@pytest.mark.long
def test_show_without_a_display_returns_the_image(
    volume: sg.Volume, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    assert not has_display() and not in_notebook()
    image = sg.show(volume, size=48)
    right = sg.render(volume, size=48, background="white")
    assert isinstance(image, sg.Image) and np.array_equal(image.pixels, right.pixels)
    assert capsys.readouterr().out.count("\n") == 1
    assert sg.show(image) is image


def test_show_with_a_display_opens_the_window(volume: sg.Volume, monkeypatch: pytest.MonkeyPatch) -> None:
    """The window's own tests open one; here what it is opened with."""
    monkeypatch.setenv("DISPLAY", ":0")
    opened: list[Any] = []

    def open_window(files: Any, scene: Any, options: Any, opengl: Any) -> None:
        assert files.jobs.wait(60)
        (done,) = files.jobs.collect()
        opened.append((done.value.document, options))

    monkeypatch.setattr("splatgl.viewer.show.open_window", open_window)
    assert sg.show(volume, "microscopy", azimuth=70, size=(300, 200)) is None
    ((document, options),) = opened
    assert options.size == (300, 200) and document.styles[0].transfer == sg.preset("microscopy", volume)
    camera = sg.Camera.orbit(volume, 70, 20, size=(30, 20))
    assert np.allclose(document.home((30, 20)).camera.forward, camera.forward)
    # a scene file can't name an array
    with pytest.raises(sg.InputError, match="a volume in a file"):
        document.scene.to_toml(Path())
    sg.show(volume, camera=camera)
    assert np.allclose(opened[1][0].home((60, 40)).camera.eye, camera.eye)


def test_what_is_told_of_a_file_is_in_the_image(tmp_path: Path) -> None:
    labels = np.zeros((8, 8, 8), np.uint8)
    labels[2:4, 2:6, 2:6], labels[4:6, 2:6, 2:6], labels[6:, 2:6, 2:6] = 9, 2, 40
    np.save(tmp_path / "a.npy", labels)
    image = sg.render(tmp_path / "a.npy", size=16)
    assert str(image.info["notes"]).count("--values amounts") == 1
    assert "notes" not in sg.render(labels / 256.0, size=16).info


def test_a_thread_opens_the_renderer_while_the_volume_is_extracted(
    volume: sg.Volume, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And closes it; where it fails, the error is that of the renderer."""
    opened: list[sg.Renderer] = []
    opening = sg.Renderer.__init__

    def note(self: sg.Renderer, *args: Any) -> None:
        opening(self, *args)
        opened.append(self)
        assert current_thread() is not main_thread()

    scene = OpenScene.of(SceneFile("balls", view=ViewOptions(size=(24, 24))), volume)
    monkeypatch.setattr(sg.Renderer, "__init__", note)
    try:
        early = draw(scene, DrawOptions(OpenGL("egl")))
    except sg.InputError:
        pytest.skip("no EGL")
    assert len(opened) == 1 and vars(opened[0].ctx.extra)["_released"]
    monkeypatch.setattr(sg.Renderer, "__init__", opening)
    assert np.array_equal(early.pixels, draw(scene, DrawOptions()).pixels)

    def refuse(*_: object, **__: object) -> None:
        raise sg.InputError("no OpenGL")

    monkeypatch.setattr("splatgl.gl.renderer.open_context", refuse)
    with pytest.raises(sg.InputError, match="no OpenGL"):
        draw(scene, DrawOptions(OpenGL("egl")))

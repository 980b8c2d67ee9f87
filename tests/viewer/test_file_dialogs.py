"""Files in the window: dialogs to open and to save, and the list of those that were opened lately."""

from __future__ import annotations

import json
import os
import stat
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.scene.scene_file import SceneFile
from splatgl.viewer.commands import AS_SHOWN, Copy, PictureOptions
from splatgl.viewer.document import Document
from splatgl.viewer.files import MOST_RECENT, Recent, WindowLayout
from splatgl.viewer.saving import copy_text, save_as
from splatgl.viewer.state import State
from tests.helpers.blobs import blob
from tests.helpers.window import MISSING, Window, pointed

pytestmark = pytest.mark.usefixtures("shared_programs")

driven = pytest.mark.skipif(bool(MISSING), reason=f"needs {' and '.join(MISSING)}: apt-get install xvfb xdotool")
WITH_GUI = "needs the extra gui: pip install splatgl[gui]"
# places in a window of 600 × 450 pixels: the two sections that are open at first, which closes them, the section Files,
# the second file of it; in the dialog, the fifth row
SECTIONS, SECOND, ROW = ((400, 66), (400, 91), (400, 341)), (300, 433), (92, 159)


def test_recent_files_are_kept(tmp_path: Path) -> None:
    """The last ten, each once, the latest first, for the user alone."""
    environment = {"XDG_STATE_HOME": str(tmp_path / "state")}
    recent = Recent.of(environment)
    for number in range(12):
        recent = recent.opened(str(tmp_path / f"{number}.npy"))
    recent = recent.opened(str(tmp_path / "5.npy"))
    names = [Path(path).name for path in recent.paths]
    assert len(names) == MOST_RECENT and names[:3] == ["5.npy", "11.npy", "10.npy"] and names.count("5.npy") == 1
    assert Recent.of(environment).paths == recent.paths and recent.file is not None
    assert json.loads(recent.file.read_text()) == list(recent.paths)
    assert stat.S_IMODE(recent.file.parent.stat().st_mode) == 0o700
    assert [path.name for path in recent.file.parent.iterdir()] == ["recent.json"]
    # another window's are not lost
    other = Recent.of(environment).opened("/other.npy")
    assert recent.opened("/this.npy").paths[:2] == ("/this.npy", "/other.npy") and len(other.paths) == MOST_RECENT
    # no built-in scenes, and no addresses, which may hold keys
    assert recent.opened("tunnel").opened("https://host/v.zarr?key=1") == recent
    assert recent.forgotten().paths == () == Recent.of(environment).paths


def test_the_last_scene_is_kept(tmp_path: Path) -> None:
    """For the user alone, until it is forgotten; not one of arrays or addresses, and it is no recent file."""
    recent, scene = Recent.of({"XDG_STATE_HOME": str(tmp_path)}), SceneFile(str(tmp_path / "a.npy"))
    for other in (replace(scene, held=blob()), replace(scene, volume="https://host/v.zarr?key=1")):
        recent.keep(other)
        assert recent.scene is None
    recent.keep(scene)
    assert recent.scene is not None and SceneFile.from_toml(recent.scene).volume == scene.volume
    assert recent.opened(str(recent.scene)) == recent
    assert recent.forgotten().scene is None
    Recent().keep(scene)


@pytest.mark.parametrize("text", ["", "{", '{"a": 1}', "[1, 2]", "[" * 100000, '"x"'])
def test_a_damaged_list_is_empty(tmp_path: Path, text: str) -> None:
    (tmp_path / "splatgl").mkdir()
    (tmp_path / "splatgl" / "recent.json").write_text(text)
    recent = Recent.of({"XDG_STATE_HOME": str(tmp_path)})
    assert recent.paths == () and recent.opened("/a.npy").paths == ("/a.npy",)


def test_recent_files_need_no_folder(tmp_path: Path) -> None:
    """Where none can be made the list lasts as long as the window; a switch turns it off; XDG takes no relative one."""
    (tmp_path / "file").write_text("")
    recent = Recent.of({"XDG_STATE_HOME": str(tmp_path / "file")})
    assert recent.opened("/a.npy").paths == ("/a.npy",)
    for off in ("off", "0", ""):
        switched = Recent.of({"XDG_STATE_HOME": str(tmp_path / "state"), "SPLATGL_RECENT": off})
        assert switched.opened("/a.npy").paths == () and not (tmp_path / "state").exists()
    found = Recent.of({"XDG_STATE_HOME": "here", "HOME": str(tmp_path)})
    assert found.file == tmp_path / ".local" / "state" / "splatgl" / "recent.json"


def test_the_arrangement_of_the_window_is_kept(tmp_path: Path) -> None:
    """Anything but what a window may have stored is left out."""
    environment = {"XDG_STATE_HOME": str(tmp_path)}
    assert WindowLayout.of(environment) == WindowLayout()
    left = WindowLayout((900, 700), False, True, "light")
    left.remember(environment)
    assert WindowLayout.of(environment) == left
    left.remember({**environment, "SPLATGL_RECENT": "off", "XDG_STATE_HOME": str(tmp_path / "off")})
    assert [path.name for path in tmp_path.iterdir()] == ["splatgl"]
    for text in ("", "[1]", '{"size": [0, 700], "panel": 3, "theme": null, "other": 1}', '{"size": [true, 700]}'):
        (tmp_path / "splatgl" / "window.json").write_text(text)
        assert WindowLayout.of(environment) == WindowLayout()


def test_the_save_dialog_says_what_is_saved(tmp_path: Path) -> None:
    """The name's own ending is the format, if it is one; what is on the screen, unless it says otherwise."""
    pytest.importorskip("imgui_bundle", reason=WITH_GUI)
    from splatgl.viewer.dialogs import BACKGROUNDS, SaveDialog

    dialog = SaveDialog()
    dialog.open(tmp_path / "picture-001.png", (320, 240), 80)
    assert dialog._describe_size() == "400 × 240 pixels"
    assert dialog.path == tmp_path / "picture-001.png" and dialog.options == AS_SHOWN
    for name, form, right in (("fig.1", ".tif", "fig.1.tif"), ("a.NPY", ".png", "a.NPY"), ("a.mp4", ".png", "a.mp4")):
        dialog.name, dialog.form = name, form
        assert dialog.path.name == right
    dialog.by, dialog.background, dialog.has_annotations = 1, BACKGROUNDS.index("black"), False
    assert dialog.options == PictureOptions((320, 240), background="black", is_plain=True)
    dialog.open(tmp_path / "picture-002.png", (200, 100))
    assert dialog.pixels == (200, 100)
    dialog.by, dialog.width = 2, "85"
    assert (dialog.options.width, dialog.options.dpi) == ("85", 300.0) and "such as 85mm" in dialog._describe_size()


def test_a_window_has_its_latest_size(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a scene, too, unless an option states it; without a file nothing is read."""
    found: list[tuple[Any, ...]] = []
    monkeypatch.setattr("splatgl.cli.view.open_window", lambda *given: found.append(given))
    (folder / "s.toml").write_text('volume = "blob.npy"\n[camera]\nsize = [90, 60]\n')
    for arguments in (["s.toml"], ["s.toml", "--size", "50x40"], [], ["--size", "50x40"]):
        assert main(["view", *(str(folder / each) if each == "s.toml" else each for each in arguments)]) == 0
    (_, _, scene), (_, _, stated), (files, nothing, _), (_, _, sized) = (given[:3] for given in found)
    assert scene.size is None and stated.size == sized.size == (50, 40)
    assert nothing.volume == "" and files.jobs.busy is None


def test_a_picture_is_saved_otherwise_than_shown(folder: Path, renderer: sg.Renderer) -> None:
    """Of a width on paper, on black, without annotations, as the copied command draws it."""
    document = Document.open(SceneFile(str(folder / "blob.npy")))
    state, target = State.of(document, (120, 90)), folder / "a b.png"
    options = PictureOptions(width="1in", dpi=72.0, background="black", is_plain=True)
    assert save_as(state, document, renderer.render, target, options=options) == "saved a b.png"
    pixels = sg.Image.load(target).pixels
    assert pixels.shape[:2] == (54, 72) and pixels[0, 0].tolist() == [0, 0, 0, 1] and state.annotate
    command = copy_text(Copy.COMMAND, state, document, options, target.name)
    assert command.endswith("splatgl render scene.toml -o 'a b.png'\n")
    (folder / "scene.toml").write_text(command.split("'END'\n")[1].split("END\n")[0])
    options_of_command = ["-o", str(folder / "again.png"), "--backend", renderer.info.backend, "--quiet"]
    assert main(["render", str(folder / "scene.toml"), *options_of_command]) == 0
    assert np.array_equal(sg.Image.load(folder / "again.png").pixels, pixels)
    # as shown, it has the window's size and its annotations
    save_as(state, document, renderer.render, target)
    assert sg.Image.load(target).pixels.shape[:2] == (90, 120)


# --- driven -------------------------------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    np.save(tmp_path / "blob.npy", blob().samples)
    np.save(tmp_path / "other ä.npy", blob(16).samples)
    return tmp_path


def helper(folder: Path) -> dict[str, str]:
    """A desktop's dialog, which answers at once with what stands in a file."""
    (folder / "bin").mkdir()
    program = folder / "bin" / "zenity"
    program.write_text(f"#!/bin/sh\nprintf '%s\\n' \"$@\" > '{folder}/asked'\ncat '{folder}/answer'\n")
    program.chmod(0o755)
    return {"PATH": f"{folder / 'bin'}:{os.environ['PATH']}", "XDG_STATE_HOME": str(folder / "state")}


@pytest.mark.long
@driven
def test_the_desktop_s_dialog(folder: Path) -> None:
    """What it answers is opened, or saved under that name; what is cancelled does nothing."""
    pytest.importorskip("imgui_bundle", reason=WITH_GUI)
    environment = {**helper(folder), "SPLATGL_RECENT": "on"}
    window = Window(folder / "blob.npy", folder, environment)
    (folder / "answer").write_text("")
    assert window.key("ctrl+o")["source"].endswith("blob.npy")
    told = window.until(lambda told: not told["dialog"])
    assert told["source"].endswith("blob.npy") and not told["message"]
    asked = (folder / "asked").read_text()
    assert "*.nii.gz" in asked and "*.toml" in asked and str(folder) in asked
    (folder / "answer").write_text(f"{folder / 'other ä.npy'}\n")
    window.key("ctrl+o")
    window.until(lambda told: told["source"].endswith("other ä.npy"))
    assert window.ask("settle")["recent"] == [str(folder / "other ä.npy")]
    # edits are saved by a scene, not by a picture
    window.key("]")
    for name in ("picture.png", "named", "floats.npy"):
        (folder / "answer").write_text(f"{folder / name}\n")
        window.ask("set", effects=["RECORD_AS"])
        told = window.until(lambda told, name=name: f"saved {name}" in told["message"])  # type: ignore[misc]
        assert f"saved {name}" in told["message"]
    assert (
        main(["render", str(folder / "named.toml"), "-o", str(folder / "again.npy"), "--backend", "egl", "--quiet"])
        == 0
    )
    assert np.array_equal(np.load(folder / "again.npy"), np.load(folder / "floats.npy"))
    assert sg.Image.load(folder / "picture.png").pixels.shape[:2] == (180, 240)
    # the volume itself is not overwritten
    volume = (folder / "other ä.npy").read_bytes()
    (folder / "answer").write_text(f"{folder / 'other ä.npy'}\n")
    window.ask("set", effects=["RECORD_AS"])
    assert "another file" in window.until(lambda told: "another" in told["message"])["message"]
    assert (folder / "other ä.npy").read_bytes() == volume
    assert window.key("q")["closed"]
    window.end()
    # how the window stood is kept for the next one
    assert WindowLayout.of(environment).size == (240, 180)


@pytest.mark.long
@driven
def test_the_window_s_own_dialog(folder: Path) -> None:
    """Without a desktop's, the window has one: a double click opens, Escape closes, letters are text."""
    pytest.importorskip("imgui_bundle", reason=WITH_GUI)
    (folder / "empty").mkdir()
    state = {"PATH": str(folder / "empty"), "XDG_STATE_HOME": str(folder / "state"), "SPLATGL_RECENT": "on"}
    window = Window(folder / "blob.npy", folder, state, size=(600, 450), panel=True)
    told = window.key("ctrl+o")
    assert told["dialog"] and told["panel"]
    told = window.key("escape")
    assert not told["dialog"] and not told["closed"]
    window.key("ctrl+o")
    window.ask("double", within=300.0)
    pointed(window, *ROW)
    window.hands("click", 1, "click", 1)
    told = window.until(lambda told: told["source"].endswith("other ä.npy"))
    assert not window.ask("settle")["dialog"] and told["recent"] == [str(folder / "other ä.npy")]
    # a name is typed, whose letters are no shortcuts
    told = window.key("ctrl+s")
    before = told["settings"]
    for letter in "ab":
        told = window.key(letter)
    assert told["dialog"] and told["settings"] == before
    told = window.key("enter")
    assert not told["dialog"] and "saved" in told["message"] and (folder / "ab.png").exists()
    # the list of the panel opens the first file again
    window.drop(folder / "blob.npy")
    for section in SECTIONS:
        pointed(window, *section)
        window.hands("click", 1)
        window.ask("settle")
    pointed(window, *SECOND)
    window.hands("click", 1)
    assert window.until(lambda told: told["source"].endswith("other ä.npy"))["source"].endswith("other ä.npy")
    window.end()


@driven
@pytest.mark.long
def test_without_the_library_keys_say_so(folder: Path) -> None:
    hidden = folder / "hidden"
    hidden.mkdir()
    (hidden / "sitecustomize.py").write_text(
        "import importlib.util, sys\n"
        "found = importlib.util.find_spec\n"
        "hide = lambda name, package=None: None if name == 'imgui_bundle' else found(name, package)\n"
        "importlib.util.find_spec = hide\n"
    )
    paths = os.pathsep.join([str(hidden), *filter(None, [os.environ.get("PYTHONPATH")])])
    window = Window(folder / "blob.npy", folder, {"PYTHONPATH": paths}, panel=True)
    assert not window.state["panel"]
    for key, what in (
        ("ctrl+o", "the file dialog"),
        ("ctrl+s", "the file dialog"),
        ("tab", "the panel with the opacity curve, colours, settings, cuts and files"),
    ):
        told = window.key(key)
        assert told["message"].startswith(f"{what}: needs") and "splatgl[gui]" in told["message"]
        assert not told["panel"] and not told["closed"]
    # everything else works
    assert window.key("]")["points"] != window.state["points"] and "saved" in window.key("s")["message"]
    window.end()

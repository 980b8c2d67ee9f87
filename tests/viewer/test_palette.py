"""The words that users of other programs type to find a command, and the state of its row in the menus."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from splatgl.errors import InputWarning
from splatgl.scene.scene_file import SceneFile
from splatgl.viewer.commands import COMMANDS, ENABLED, TICKS, WORDS, is_enabled, is_ticked
from splatgl.viewer.document import Document
from splatgl.viewer.state import State
from tests.helpers.commands import acted

panel = pytest.importorskip("splatgl.viewer.panel", reason="needs the extra gui: pip install splatgl[gui]")

# of menus, tools and panels of ParaView, 3D Slicer, napari and Fiji
FIELD = """
open load import recent add layer overlay mesh model segmentation labels save export screenshot capture snapshot
picture image scene state copy script python quit exit close undo redo crop roi clip clipping plane cut slice slices
lasso scissors erase delete remove segments show hide visibility reset home fit center isometric anterior posterior
left right superior inferior front axial coronal sagittal orthographic perspective parallel projection camera rotate
spin orbit zoom roll trackball background color compare split link layout fullscreen panel sidebar properties theme
dark preferences help shortcuts hotkeys manual search info statistics blend mip maximum minip average x-ray rendering
light lighting shading shadows ambient specular opacity transparency alpha threshold contour isosurface surface
colormap preset window level contrast brightness range histogram transfer gradient bone lung axes orientation scale
annotation legend lut bounding measure distance ruler length angle probe pixel intensity crosshair oblique reslice mpr
play time frame animation movie video record keyframe quality
drop rename width hounsfield mask draw documentation options dpi resolution figure tiff loop interpolation
blending grayscale invert flip gallery session pan svg pdf
"""


def opened(folder: Path) -> Document:
    np.save(folder / "ramp.npy", np.linspace(-1000, 1500, 1000, dtype=np.float32).reshape(10, 10, 10))
    return Document.open(SceneFile(str(folder / "ramp.npy")))


def found(words: str) -> list[str]:
    return [command.id for command in panel.find_commands(words, COMMANDS)]


def test_words_of_the_field_find_commands() -> None:
    words = FIELD.split()
    assert len(words) == len(set(words)) >= 170
    assert not [word for word in words if not found(word)]


def test_titles_come_before_other_words() -> None:
    """The first command is the one that Enter runs."""
    first = {
        "crop": "handles",
        "clip plane": "plane",
        "reset": "reset",
        "zoom": "zoom-in",
        "compare": "pin",
        "threshold": "threshold-down",
        "save image": "screenshot",
        "measure": "measure",
        "help": "help",
        "theme": "theme",
        "layer": "section-layers",
        "preset bone": "preset-ct-bone",
        "colormap hot": "colormap-hot",
        "color map gray": "colormap-gray",
        "mip": "blend-mip",
        "isosurface": "section-iso-surfaces",
        "iso": "section-iso-surfaces",
        "window level": "section-look",
        "lut": "colormap-airways",
    }
    assert {words: found(words)[0] for words in first} == first


def test_a_misspelt_word_is_answered() -> None:
    assert found("zomm") == [] and panel.nearest_word("zomm") == " Did you mean zoom?"
    assert panel.nearest_word("qqqqq") == panel.nearest_word("magma") == ""
    assert panel.nearest_word("postrior") == " Did you mean posterior?"


def test_rows_of_menus_tell_what_is_on_and_what_does_nothing(tmp_path: Path) -> None:
    names, kinds = {c.id for c in COMMANDS}, {c.id.partition("-")[0] for c in COMMANDS}
    assert WORDS.keys() <= names and ENABLED.keys() <= names | kinds
    document = opened(tmp_path)
    state = State.of(document, (64, 48))
    commands = {command.id: command for command in COMMANDS}
    off = {name for name, command in commands.items() if not is_enabled(command, state, document)}
    assert {"uncut", "cuts", "play", "segments-show", "straighten-slices", "legend"} <= off
    assert is_ticked(commands["annotations"], state)
    assert not is_ticked(commands["annotations"], acted(state, "annotations", document))
    assert not off & {"preset-ct-bone", "plane", "undo"}
    assert is_ticked(commands["blend-composite"], state) and not is_ticked(commands["slices"], state)
    state = acted(acted(state, "slices", document), "plane", document)
    assert is_enabled(commands["uncut"], state, document) and is_ticked(commands["slices"], state)
    assert is_ticked(commands["cuts"], state) and TICKS.keys() & names


def test_colours_of_a_file_have_no_colour_map(tmp_path: Path) -> None:
    np.save(tmp_path / "rgb.npy", np.zeros((4, 4, 4, 3), np.uint8))
    with pytest.warns(InputWarning):
        document = Document.open(SceneFile(str(tmp_path / "rgb.npy")))
    state = State.of(document, (64, 48))
    off = {command.id for command in COMMANDS if not is_enabled(command, state, document)}
    assert {"colormap-hot", "colorbar"} <= off and "preset-ct-bone" not in off


def test_choices_are_commands(tmp_path: Path) -> None:
    document = opened(tmp_path)
    state = acted(acted(State.of(document, (64, 48)), "preset-ct-bones", document), "colormap-hot", document)
    assert state.style.base.colormap == "hot" and state.style.base.points[-1] == (1500.0, 0.99)
    assert acted(state, "blend-mip", document).settings.blend == "mip"


def test_keys_that_the_panel_does_not_take_begin_no_edit() -> None:
    """Tab, which shows the panel, does not go to its first field; a letter has the ctrl that is held while it comes."""
    from splatgl.viewer.imgui_backend import TAB, Gui

    got: list[tuple[str, tuple[int, ...]]] = []
    gui: Any = SimpleNamespace(
        waiting=[], owed=0, focused=False, until_field=0, _pass=lambda kind, *values: got.append((kind, values))
    )
    gui.io, gui.panel = SimpleNamespace(want_text_input=False), SimpleNamespace(popup=False, is_opening=False)
    assert not Gui.event(gui, "key", TAB, 1, 0) and not Gui.event(gui, "character", 114) and gui.waiting == []
    gui.focused = True
    assert Gui.event(gui, "key", TAB, 1, 0) and len(gui.waiting) == 1
    gui.waiting = [("key", (341, 1, 0)), ("key", (65, 1, 2)), ("key", (341, 0, 2)), ("key", (65, 0, 0))]
    Gui._pass_events(gui)
    assert got == [("key", (341, 1, 0)), ("key", (65, 1, 2))] and len(gui.waiting) == 2

"""Damaged scene and transfer files: one line that begins with the path, whatever is wrong."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

import pytest

from splatgl.errors import InputError
from splatgl.scene.scene_file import SceneFile
from splatgl.splat.settings import Settings
from splatgl.transfer.transfer import Transfer

READ: dict[str, Callable[[Path], object]] = {"scene": SceneFile.from_toml, "transfer": Transfer.load}
HEAD = 'volume = "tunnel"\n'
BAD_TEXT = {
    "digits": "threshold = " + "9" * 5000,
    "deep": "threshold = " + "[" * 10_000,
    "date": "threshold = 2024-02-31",
    "not text": "\0",
    "long": "#" * (2**20 + 1),
}
BAD_VALUES = [
    (
        "[camera]\nsize = 'abc'",
        "size: expected a width and a height of at least one whole pixel, such as 800x600, got 'abc'",
    ),
    ("[camera]\nsize = [1.5, 2]", "size: expected a width and a height"),
    ("[camera]\neye = [1, 2]", "eye: expected 3 finite numbers"),
    ("[camera]\nfov = 'wide'", "fov: expected one finite number, got 'wide'"),
    ("[camera]\nfov = [1]", "fov: expected one finite number"),
    ("[camera]\nzoom = inf", "zoom: expected one finite number, got inf"),
    ("[camera]\nazimuth = true", "azimuth: expected one finite number"),
    ("[camera]\northographic = 1", "orthographic: expected true or false"),
    ("[settings]\ntolerance = 'small'", "[settings]: tolerance: expected a number in (0, 1], got 'small'"),
    ("[settings]\nsamples = 'a'", "[settings]: samples: expected a whole number from 1 to 64"),
    ("[settings]\nsamples = inf", "[settings]: samples: expected a whole number from 1 to 64"),
    ("[settings]\nbackground = ['a', 'b', 'c']", "[settings]: background: expected three linear numbers"),
    ("[settings]\nsharp = 1", "[settings]: settings: expected names of Settings' fields, got sharp"),
    ("[load]\nspacing = [1, 0, 1]", "[load]: spacing: expected three positive numbers"),
    ("[load]\nsharp = 1", "[load]: load: expected keys"),
]


@pytest.mark.parametrize("kind", READ)
@pytest.mark.parametrize("text", BAD_TEXT.values(), ids=BAD_TEXT)
def test_text_that_is_no_table(tmp_path: Path, kind: str, text: str) -> None:
    path = tmp_path / "a.toml"
    path.write_text(HEAD + text)
    with pytest.raises(InputError) as caught:
        READ[kind](path)
    line = str(caught.value)
    assert line.startswith(str(path)) and "\n" not in line


@pytest.mark.parametrize(("text", "message"), BAD_VALUES, ids=[text.replace("\n", " ") for text, _ in BAD_VALUES])
def test_values_of_the_wrong_kind(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "a.toml"
    path.write_text(HEAD + text)
    with pytest.raises(InputError) as caught:
        SceneFile.from_toml(path)
    assert str(caught.value).startswith(str(path)) and message in str(caught.value)


@pytest.mark.parametrize("kind", READ)
def test_pipes_are_not_waited_for(tmp_path: Path, kind: str) -> None:
    os.mkfifo(tmp_path / "a.toml")
    with pytest.raises(InputError, match="pipe"):
        READ[kind](tmp_path / "a.toml")


@pytest.mark.parametrize("name", [f.name for f in fields(Settings)])
@pytest.mark.parametrize("value", ["x", True, [1, 2], {"a": 1}, float("nan"), -1e300])
def test_settings_of_any_kind_are_taken_or_refused_in_a_line(name: str, value: object) -> None:
    if name == "light_from" and value == [1, 2]:
        assert Settings(light_from=(1, 2)).light_from == (1.0, 2.0)
        return
    with pytest.raises(InputError, match=f"^{name}: "):
        Settings(**{name: value})

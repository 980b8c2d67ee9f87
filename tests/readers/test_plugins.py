"""Another package brings a format, a file to write and a command; a faulty one stops nothing."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from importlib import invalidate_caches
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import COMMANDS, main
from splatgl.plugins import load_plugins

# the package of the page "Write a reader"
PAGE = Path(sg.__file__).parent / "docs" / "plugins.md"
ENTRIES = """
[splatgl.readers]
dots = splatgl_dots:FORMAT
broken = splatgl_missing:FORMAT
wrong = splatgl_dots:count
[splatgl.writers]
dots = splatgl_dots:TARGET
[splatgl.commands]
dots = splatgl_dots:COMMAND
"""


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An installed package: the module of the page, and its entry points."""
    (code,) = [part.partition("```")[0] for part in PAGE.read_text(encoding="utf-8").split("```python\n")[1:2]]
    place = tmp_path / "site"
    info = place / "splatgl_dots-1.0.dist-info"
    info.mkdir(parents=True)
    (place / "splatgl_dots.py").write_text(code, encoding="utf-8")
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: splatgl-dots\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(ENTRIES)
    monkeypatch.syspath_prepend(place)
    load_plugins.cache_clear()
    invalidate_caches()
    yield place
    COMMANDS.pop("dots", None)
    sys.modules.pop("splatgl_dots", None)
    load_plugins.cache_clear()


def test_a_format_is_read_with_options_of_its_own(package: Path, tmp_path: Path) -> None:
    path = tmp_path / "a.dots"
    path.write_text("4 5 6\n1 2 3 90\n0 0 0 7\n")
    with pytest.warns(sg.InputWarning) as caught:
        volume = sg.load(path, spacing=(1, 1, 2))
    told = "\n".join(str(warning.message) for warning in caught)
    assert "splatgl_missing:FORMAT: cannot be imported" in told and "expected a Format, got a function" in told
    assert volume.shape == (6, 5, 4) and volume.spacing == (1, 1, 2) and volume.name == "a"
    assert volume.samples[3, 2, 1] == 90 and volume.samples.sum() == 97
    assert sg.load(path, own={"gain": 0.5}).samples.sum() == 48.5
    with pytest.raises(sg.InputError, match="own: expected some of gain for dots, got gains; did you mean gain"):
        sg.load(path, own={"gains": 1})
    with pytest.raises(sg.InputError, match="gain: expected a positive number, got -1"):
        sg.load(path, own={"gain": -1})
    np.save(tmp_path / "other.npy", volume.samples)
    with pytest.raises(sg.InputError, match=r"options: expected .*, got own"):
        sg.load(tmp_path / "other.npy", own={"gain": 1})


def test_commands_take_the_options(package: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, output = tmp_path / "a.dots", tmp_path / "b.dots"
    path.write_text("4 5 6\n1 2 3 90\n0 0 0 7\n")
    assert main(["convert", str(path), str(output), "--reader-option", "gain=2"]) == 0
    assert output.read_text().splitlines() == ["4 5 6", "0 0 0 14", "1 2 3 180"]
    assert main(["render", str(path), "--reader-option", "gain=x", "-o", str(tmp_path / "a.png")]) == 2
    assert "gain: expected N, a positive number, got 'x'" in capsys.readouterr().err
    assert main(["dots", str(output)]) == 0 and capsys.readouterr().out == "2\n"

"""Every command and every snippet of the README runs, and its links lead somewhere."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from splatgl.app.cli import _parser, main

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "README.md").read_text()


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", TEXT, re.DOTALL)


LINES = [line for block in blocks("sh") for line in block.splitlines()]
COMMANDS = [line for line in LINES if line.startswith(("splatgl ", "scripts/run "))]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the head.nii.gz that the README speaks of: a small blob."""
    nibabel = pytest.importorskip("nibabel")
    monkeypatch.chdir(tmp_path)
    x, y, z = np.meshgrid(*(np.linspace(-1, 1, 16),) * 3, indexing="ij")
    samples = (300 * np.exp(-3 * (x * x + y * y + z * z))).astype(np.int16)
    nibabel.save(nibabel.Nifti1Image(samples, np.diag([1, 0.9, 0.9, 1])), "head.nii.gz")
    return tmp_path


# what takes long: other tests run these commands on less
LONG = ("figure claims", "figure 10", "figure 5", "stress --case", "report", "--supersample", "render terrain")


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_have_the_options_they_use(command: str) -> None:
    arguments = shlex.split(command)[1:]
    _parser(arguments).parse_args(arguments)


@pytest.mark.parametrize(
    "command", [pytest.param(c, marks=pytest.mark.long if any(word in c for word in LONG) else ()) for c in COMMANDS]
)
def test_commands(command: str, here: Path) -> None:
    arguments = shlex.split(command)[1:]
    if arguments[0] == "render" and "--size" not in arguments:
        arguments += ["--size", "48"]
    assert main(arguments) == 0


def test_there_are_commands() -> None:
    assert len(COMMANDS) >= 8


def test_snippets(here: Path) -> None:
    for block in blocks("python"):
        exec(compile(block, "README.md", "exec"), {})
    assert (here / "out.png").exists()


def test_scene_file(here: Path) -> None:
    (here / "scene.toml").write_text(blocks("toml")[0])
    assert main(["render", "scene.toml", "--size", "20"]) == 0


def test_links() -> None:
    for link in re.findall(r"\]\(([^)#]+)\)", TEXT):
        assert (ROOT / link).exists(), link


def test_settings_table_is_the_code() -> None:
    """Each choice of Settings that has several values stands in the README's table."""
    from splatgl.splat.settings import CHOICES

    for name, allowed in CHOICES.items():
        if len(allowed) > 1 and name not in ("footprint", "primitive"):
            row = next(line for line in TEXT.splitlines() if line.startswith(f"| `--{name}`"))
            for value in allowed:
                assert re.search(rf"\b{re.escape(value)}\b", row), (name, value)

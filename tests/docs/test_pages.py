"""Every README: its commands and snippets run, its links, paths, options and names exist, its tables are the code's."""

from __future__ import annotations

import argparse
import re
import shlex
import tomllib
from dataclasses import dataclass, fields
from functools import cache
from importlib import import_module
from itertools import pairwise
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as Pillow

import splatgl as sg
from splatgl.cli.main import COMMANDS, _parser, main
from splatgl.readers import FORMATS
from splatgl.scene.scene_file import SceneFile
from splatgl.splat import kernels
from splatgl.splat.settings import Settings, choices
from splatgl.studies.stress import CASES
from splatgl.viewer.key_bindings import load_bindings

ROOT = Path(__file__).parents[2]
TOP = ROOT / "README.md"
READMES = [TOP, *sorted((ROOT / "splatgl").rglob("README.md"))]
IDS = [path.relative_to(ROOT).as_posix() for path in READMES]
ROOMS = ("data", "splat", "gl", "reference", "distributed", "cli", "viewer")
MOST_LINES = 170
# of code blocks; text is output, and holds no command
LANGUAGES = ("sh", "python", "toml", "text", "mermaid")
# what begins a command line
PROGRAMS = ("splatgl ", "scripts/", "pip ", "pytest ")

each_readme = pytest.mark.parametrize("path", READMES, ids=IDS)


@dataclass(frozen=True)
class Block:
    """A fenced block of a README."""

    path: Path
    language: str
    text: str


@cache
def blocks(path: Path) -> tuple[Block, ...]:
    """All fenced blocks of a README, labelled or not."""
    found: list[Block] = []
    inside: tuple[str, list[str]] | None = None
    for line in path.read_text(encoding="utf-8").splitlines():
        if line.startswith("```") and inside is None:
            inside = (line[3:].strip(), [])
        elif line.startswith("```") and inside is not None:
            found.append(Block(path, inside[0], "\n".join(inside[1]) + "\n"))
            inside = None
        elif inside is not None:
            inside[1].append(line)
    assert inside is None, f"{path}: a block without an end"
    return tuple(found)


def prose(path: Path) -> str:
    """The text without its fenced blocks."""
    return re.sub(r"(?ms)^```.*?^```$", "", path.read_text(encoding="utf-8"))


def inline(path: Path) -> list[str]:
    """All inline code."""
    return re.findall(r"`([^`\n]+)`", re.sub(r"\s*\n\s*", " ", prose(path)))


def of(language: str, path: Path | None = None) -> list[Block]:
    return [block for each in READMES for block in blocks(each) if block.language == language and path in (None, each)]


ALL = [block for path in READMES for block in blocks(path)]
# once each, without their comments
LINES = list(
    dict.fromkeys(
        re.sub(r"\s+#.*", "", line) for block in ALL for line in block.text.splitlines() if line.startswith(PROGRAMS)
    )
)
# `splatgl …`, and scripts/run, which is the same after a set-up
SPLATGL = [line for line in LINES if line.startswith(("splatgl ", "scripts/run "))]


def arguments_of(line: str) -> list[str]:
    return shlex.split(line)[1:]


def parse(arguments: list[str]) -> argparse.Namespace:
    return _parser(arguments).parse_args(arguments)


# --- blocks and their commands ---------------------------------------------------------------------------------------


def test_every_room_has_a_readme() -> None:
    assert set(READMES) == {TOP, *(ROOT / "splatgl" / room / "README.md" for room in ROOMS)}


def test_the_top_readme_is_short() -> None:
    assert len(TOP.read_text(encoding="utf-8").splitlines()) <= MOST_LINES


@each_readme
def test_every_block_says_what_it_is(path: Path) -> None:
    for block in blocks(path):
        assert block.language in LANGUAGES, f"a block labelled {block.language!r}: {block.text[:80]}"
        commands = [line for line in block.text.splitlines() if line.startswith(PROGRAMS)]
        lines = [line for line in block.text.splitlines() if line]
        assert commands == (lines if block.language == "sh" else [])


def test_there_are_commands() -> None:
    assert len(SPLATGL) >= 25 and {arguments_of(line)[0] for line in SPLATGL} == set(COMMANDS)


@pytest.mark.parametrize("command", SPLATGL)
def test_commands_have_the_options_they_use(command: str) -> None:
    # --list-bindings prints and exits
    if "--list-bindings" in command:
        pytest.skip("test_commands runs it")
    parse(arguments_of(command))


@each_readme
def test_inline_commands_have_the_options_they_use(path: Path) -> None:
    """`splatgl report` stands for the command; with more behind it, it is one to be typed."""
    for code in inline(path):
        if code.startswith("splatgl "):
            arguments = arguments_of(code)
            assert arguments[0] in COMMANDS, code
            if len(arguments) > 1 and arguments[1:] != ["--help"]:
                parse(arguments)


def test_other_programs_exist() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for line in LINES:
        program, *arguments = shlex.split(line)
        if program == "pip":
            assert arguments[0] == "install"
            name, extras = re.fullmatch(r"(\w+)\[([\w,]+)\]", arguments[1]).groups()
            assert name == project["name"] and set(extras.split(",")) <= set(project["optional-dependencies"])
        elif program not in ("splatgl", "pytest"):
            assert (ROOT / program).is_file(), line


# what the tests of these commands run, on less
ELSEWHERE = {
    "view": "opens a window: tests/viewer/test_viewer.py, tests/viewer/test_window.py",
    "report": "takes minutes: tests/studies/test_accuracy.py",
    "compare": "tests/cli/test_compare.py runs them on pictures that differ",
}
# what takes long: other tests run these commands on less
LONG = ("figure", "stress --case", "render terrain", "animate terrain", "animate tunnel")
# a picture and a movie are smaller here than in the README
SMALL = {"render": ["--size", "64"], "animate": ["--size", "24", "--frames", "2"]}


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with what the READMEs speak of, small: a blob of each format, pictures, and the TOML files."""
    nibabel, nrrd = pytest.importorskip("nibabel"), pytest.importorskip("nrrd")
    trimesh = pytest.importorskip("trimesh")
    monkeypatch.chdir(tmp_path)
    x, y, z = np.meshgrid(*(np.linspace(-1, 1, 16),) * 3, indexing="ij")
    samples = (300 * np.exp(-3 * (x * x + y * y + z * z))).astype(np.int16)
    nibabel.save(nibabel.Nifti1Image(samples, np.diag([1, 0.9, 0.9, 1])), "head.nii.gz")
    for name in ("t1.nrrd", "t2.nrrd"):
        nrrd.write(name, samples)
    pages = [Pillow.fromarray((plane / 2).astype(np.uint8)) for plane in samples]
    pages[0].save("neuron.tif", save_all=True, append_images=pages[1:])
    Pillow.fromarray((samples[8] / 2).astype(np.uint8)).save("height.png")
    Pillow.new("RGB", (16, 16), (90, 120, 60)).save("photo.jpg")
    nrrd.write("seg.nrrd", np.uint8(3 * (x < 0.3) + 4 * (y > 0.8)), {"spacings": [1, 0.9, 0.9]})
    trimesh.creation.box((9, 4, 6)).export("implant.ply")
    Path("surface.vtp").write_text(SURFACE)
    for name, text in toml_files().items():
        Path(name).write_text(text, encoding="utf-8")
    return tmp_path


# a tetrahedron with numbers
SURFACE = """<VTKFile type="PolyData" byte_order="LittleEndian"><PolyData><Piece NumberOfPoints="4" NumberOfPolys="4">
<PointData Scalars="height"><DataArray type="Float32" Name="height" format="ascii">2 3 11 3</DataArray>
<DataArray type="Float32" Name="wave" format="ascii">0 1 -1 0.5</DataArray></PointData>
<Points><DataArray type="Float32" NumberOfComponents="3" format="ascii">2 2 2 13 4 3 8 8 11 5 12 3</DataArray></Points>
<Polys><DataArray type="Int64" Name="connectivity" format="ascii">0 1 2 0 2 3 0 3 1 1 3 2</DataArray>
<DataArray type="Int64" Name="offsets" format="ascii">3 6 9 12</DataArray></Polys></Piece></PolyData></VTKFile>"""


def toml_files() -> dict[str, str]:
    """The TOML blocks, by the names that commands give them."""
    keys = {"scene.toml": "volume =", "flight.toml": "[[keyframe]]", "keys.toml": "[bindings]"}
    found = {name: [block.text for block in of("toml") if key in block.text] for name, key in keys.items()}
    assert sum(map(len, found.values())) == len(of("toml")) == len(keys)
    return {name: text for name, (text,) in found.items()}


@pytest.mark.few(1)
@pytest.mark.parametrize(
    "command", [pytest.param(c, marks=pytest.mark.long if any(word in c for word in LONG) else ()) for c in SPLATGL]
)
def test_commands(command: str, here: Path) -> None:
    name, *arguments = arguments_of(command)
    if name in ELSEWHERE and not any(option.startswith("--list") for option in arguments):
        pytest.skip(ELSEWHERE[name])
    if any(option.endswith((".mp4", ".webm")) for option in arguments):
        pytest.importorskip("av", reason="PyAV is in the extra video")
    arguments += SMALL.get(name, [])
    if "--ref" in arguments:
        assert main(["render", *arguments[:1], "-o", "right.png", *SMALL["render"]]) == 0
    if "--list-bindings" in arguments:
        with pytest.raises(SystemExit) as done:
            main([name, *arguments])
        assert done.value.code == 0
        return
    assert main([name, *arguments]) == 0
    for option, output in pairwise(arguments):
        if option == "-o" and "--ref" not in arguments:
            assert Path(output.format(frame=0)).exists(), output


# --- snippets and files ----------------------------------------------------------------------------------------------


@pytest.mark.few(1)
@pytest.mark.parametrize("block", of("python"), ids=lambda block: block.path.parent.name)
def test_snippets(block: Block, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # what they register is gone with them
    monkeypatch.setattr(kernels, "KERNELS", dict(kernels.KERNELS))
    monkeypatch.setattr("splatgl.splat.settings.KERNELS", kernels.KERNELS)
    names: dict[str, Any] = {"__name__": "__main__"}
    exec(compile(block.text, str(block.path), "exec"), names)
    # one that defines a test is run by test_pytest_plugin.py
    if block.path == TOP:
        assert (here / "out.png").exists() and names["image"].info["classification"] == "post"


def test_the_first_snippet_is_ten_lines() -> None:
    (block,) = of("python", TOP)
    assert len([line for line in block.text.splitlines() if line]) <= 10


def test_scene_file(here: Path) -> None:
    scene = SceneFile.from_toml(Path("scene.toml"))
    assert scene.settings.antialias == "supersample" and scene.view.size == (400, 300)
    assert main(["render", "scene.toml", "--size", "20"]) == 0


def test_key_bindings_file(here: Path) -> None:
    changed = {binding.action: binding.keys for binding in load_bindings("keys.toml")}
    assert changed["turn"] == ("space", "t") and changed["quit"] == ("q",)


# --- links, paths, names and options ---------------------------------------------------------------------------------


@cache
def anchors(path: Path) -> set[str]:
    """What a link to a heading is called: lower case, signs left out, hyphens for spaces."""
    headings = re.findall(r"(?m)^#+ (.+)$", prose(path))
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def broken_links(path: Path) -> list[str]:
    """Relative links and images of a README that lead nowhere."""
    broken = []
    for link in re.findall(r"\]\(([^)\s]+)\)", prose(path)):
        if link.startswith(("http://", "https://")):
            continue
        place, _, heading = link.partition("#")
        target = path.parent / place if place else path
        found = target.exists() and ROOT in target.resolve().parents and not place.startswith("/")
        if not found or (heading and heading not in anchors(target.resolve())):
            broken.append(link)
    return broken


@each_readme
def test_links(path: Path) -> None:
    assert broken_links(path) == []


def test_broken_links_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(globals(), "ROOT", tmp_path)
    path = tmp_path / "README.md"
    path.write_text(
        "# A b\n[x](README.md#a-b) [x](#a-b) [x](#c) ![x](none.png) [x](/etc) ![x](../x.png) [x](https://e.f)"
    )
    assert broken_links(path) == ["#c", "none.png", "/etc", "../x.png"]


def test_every_room_is_linked_from_the_top() -> None:
    for room in ROOMS:
        assert f"(splatgl/{room}/README.md)" in TOP.read_text(encoding="utf-8")


def test_every_picture_is_shown_once() -> None:
    shown = [
        (path.parent / link).resolve()
        for path in READMES
        for link in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", prose(path))
    ]
    kept = (p for p in (ROOT / "scripts" / "pictures").rglob("*") if p.is_file())
    assert sorted(shown) == sorted(p.resolve() for p in kept)


@each_readme
def test_paths_exist(path: Path) -> None:
    """Inline code that begins with a folder of the repository names a file in it."""
    for code in inline(path):
        if re.match(r"(splatgl|scripts|shaders|tests)(/|$)", code) and code != "splatgl":
            assert (ROOT / code.split()[0]).exists(), code


@each_readme
def test_names_exist(path: Path) -> None:
    """Inline `sg.…` is public; dotted `splatgl.…` is a name in a module."""
    for code in inline(path):
        for name in re.findall(r"^sg\.([A-Za-z_.]+)", code):
            attrgetter(name)(sg)
        for module, name in re.findall(r"^(splatgl\.[a-z_.]+)\.([A-Za-z_]+)$", code):
            getattr(import_module(module), name)


@cache
def known_options() -> frozenset[str]:
    """Options of all commands, of the pytest plugin, and of scripts/test and scripts/gpu_check."""
    known = set(re.findall(r'"(--splatgl[\w-]+)"', (ROOT / "splatgl" / "comparison" / "pytest_plugin.py").read_text()))
    known |= set(re.findall(r"(--all)\b", (ROOT / "scripts" / "test").read_text())) | {"--help"}
    known |= set(re.findall(r'"(--[a-z]+)"', (ROOT / "scripts" / "gpu_check.py").read_text()))
    for name in COMMANDS:
        parser = _parser([name])
        (commands,) = (each for each in parser._actions if isinstance(each, argparse._SubParsersAction))
        known |= set(commands.choices[name]._option_string_actions)
    return frozenset(known)


@each_readme
def test_options_exist(path: Path) -> None:
    named = {option for code in inline(path) for option in re.findall(r"(?<![\w-])--[a-z][\w-]*", code)}
    assert named <= known_options()


# --- tables ----------------------------------------------------------------------------------------------------------


def settings_rows() -> dict[str, list[str]]:
    """The cells of each row of the settings table, by its option."""
    text = (ROOT / "splatgl" / "splat" / "README.md").read_text(encoding="utf-8")
    (table,) = re.findall(r"(?m)^\| option \| values, default first.*\n((?:\|.*\n)+)", text)
    rows = [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in table.splitlines()[1:]]
    return {cells[0].strip("`"): cells for cells in rows}


def test_every_setting_is_in_the_table() -> None:
    names = {f"--{field.name.replace('_', '-')}" for field in fields(Settings)}
    assert names | {"--paper", "--like"} == set(settings_rows())


def test_settings_table_is_the_code() -> None:
    """The values of each choice are those of its row, the default first."""
    rows = settings_rows()
    for name, allowed in choices().items():
        values = rows[f"--{name}"][1].split(", ")
        assert sorted(values) == sorted(allowed), name
        assert values[0] == getattr(Settings(), name), name
    for name in ("samples", "table_bits", "shutter"):
        (first,) = re.findall(r"^[\d.]+", rows[f"--{name.replace('_', '-')}"][1])
        assert float(first) == getattr(Settings(), name)
    assert Settings().tolerance == 1 / 255 and rows["--tolerance"][1] == "1/255"


def test_every_format_is_in_the_table() -> None:
    (table,) = re.findall(r"(?m)^\| format \|.*\n((?:\|.*\n)+)", TOP.read_text(encoding="utf-8"))
    named = {suffix for line in table.splitlines() for suffix in re.findall(r"`(\.[\w.]+)`", line.split("|")[1])}
    assert named == {suffix for form in FORMATS for suffix in form.suffixes}


def test_every_stress_case_is_in_the_table() -> None:
    text = (ROOT / "splatgl" / "reference" / "README.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"(?m)^\| `([\w.-]+)` \| (.+?) \| [^|]+ \| [^|]+ \|[^|]*\|$", text))
    assert list(rows) == list(CASES)
    for name, case in CASES.items():
        # one case says beside it what its numbers are
        assert rows[name].startswith(case.stresses.replace("|", "\\|")), name
    assert f"draws {len(CASES)} cases" in text and f"all {len(CASES)} are within" in text

"""README and guide: commands and snippets run; links, paths, options and names exist; tables agree with the code."""

from __future__ import annotations

import argparse
import inspect
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cache
from importlib import import_module
from itertools import pairwise
from operator import attrgetter
from pathlib import Path
from typing import Any
from urllib.parse import quote

import gallery
import mkdocs_hooks
import numpy as np
import pytest
from PIL import Image as Pillow

import splatgl as sg
from splatgl.annotations.annotate import ANNOTATIONS
from splatgl.cli.main import COMMANDS, _parser, main
from splatgl.comparison.verdict import CompareOptions
from splatgl.readers import FORMATS
from splatgl.report.methods import methods
from splatgl.scene.scene_file import SceneFile
from splatgl.splat import kernels
from splatgl.splat.settings import Settings, choices
from splatgl.viewer import commands
from splatgl.viewer.input import load_bindings
from splatgl.writers import TARGETS
from tests.helpers import dicom
from tests.stress import CASES

ROOT = Path(__file__).parents[2]
TOP, DOCS = ROOT / "README.md", ROOT / "splatgl" / "docs"
GUIDE = sorted(DOCS.glob("*.md"))
PAGES = [TOP, ROOT / ".github" / "CONTRIBUTING.md", ROOT / ".github" / "SECURITY.md", *GUIDE]
IDS = [path.relative_to(ROOT).as_posix() for path in PAGES]
MOST_LINES = 120
# of the site: pictures are half of it
MOST_SITE_BYTES, MOST_LIVE_BYTES = 10_000_000, 3_000_000
# of the guide without the changelog, and of a page: tables of reference may be longer
MOST_WORDS, MOST_PAGE_WORDS = 24_000, 2_000
TABLES = {"changelog", "formats", "speed"}
# words of which the field has a plainer one
UNUSUAL = re.compile(r"\b(mend(s|ed|ing)?|refuse[sd]?|beside|obeyed|serves)\b", re.IGNORECASE)
# words that people search for, and the page that the search lists first
SEARCHES = {"kernel": "", "scale bar": "Annotations", "label opacity": "Layers and segmentations"}
# extras for work on splatgl itself
OWN_EXTRAS = {"all", "dev", "peers", "release"}
# pages of the guide without a picture, or without a reference at the end
NO_PICTURE = {"api", "changelog", "examples", "plugins", "stability"}
NO_REFERENCE = {"api", "changelog", "index", "plugins"}
# of code blocks; text is output, and holds no command
LANGUAGES = ("sh", "python", "toml", "yaml", "text")
# what begins a command line
PROGRAMS = ("splatgl ", "scripts/", "pip ", "pytest ")

each_page = pytest.mark.parametrize("path", PAGES, ids=IDS)


@dataclass(frozen=True)
class Block:
    """A fenced block of a page."""

    path: Path
    language: str
    text: str


@cache
def blocks(path: Path) -> tuple[Block, ...]:
    """All fenced blocks of a page, labelled or not."""
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
    return [block for each in PAGES for block in blocks(each) if block.language == language and path in (None, each)]


ALL = [block for path in PAGES for block in blocks(path)]
# once each, without their comments
LINES = list(
    dict.fromkeys(
        re.sub(r"\s+#.*", "", line) for block in ALL for line in block.text.splitlines() if line.startswith(PROGRAMS)
    )
)
# `splatgl …`, and scripts/run, which is the same after a set-up
SPLATGL = [line for line in LINES if line.startswith(("splatgl ", "scripts/run "))]


def arguments_of(line: str) -> list[str]:
    """Arguments of a command line; a file alone stands for `view FILE`."""
    arguments = shlex.split(line)[1:]
    return arguments if line.startswith("scripts/") or arguments[0] in COMMANDS else ["view", *arguments]


def parse(arguments: list[str]) -> argparse.Namespace:
    return _parser(arguments).parse_args(arguments)


# --- blocks and their commands ---------------------------------------------------------------------------------------


def test_the_readme_is_short_and_begins_with_two_commands() -> None:
    assert len(TOP.read_text(encoding="utf-8").splitlines()) <= MOST_LINES
    scripts = [line for block in blocks(TOP) for line in block.text.splitlines() if line.startswith("scripts/")]
    assert scripts == ["scripts/run render nerve -o nerve.png", "scripts/test"]


@pytest.mark.parametrize("path", GUIDE, ids=lambda path: path.stem)
def test_every_page_opens_with_a_task_and_ends_with_its_reference(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    title, task, third = [part for part in text.split("\n\n") if part][:3]
    assert title.startswith("# ") and "\n" not in title
    assert task.startswith("**Task: ") or path.stem == "index"
    assert third.startswith("![") or path.stem in NO_PICTURE | {"gallery"}
    headings = re.findall(r"(?m)^## (.+)$", text)
    assert path.stem in NO_REFERENCE or headings[-1].startswith("Reference")


def test_the_guide_is_short() -> None:
    words = {path.stem: len(path.read_text(encoding="utf-8").split()) for path in GUIDE}
    assert {name: n for name, n in words.items() if n > MOST_PAGE_WORDS and name not in TABLES} == {}
    assert sum(words.values()) - words["changelog"] <= MOST_WORDS


@each_page
def test_words_are_plain(path: Path) -> None:
    assert path.stem == "changelog" or UNUSUAL.findall(prose(path)) == []


def test_every_page_is_in_the_site() -> None:
    site = (ROOT / "scripts" / "mkdocs.yml").read_text(encoding="utf-8")
    listed = re.findall(r"[\w-]+\.md", site.partition("\nnav:")[2])
    generated = {"commands.md", *mkdocs_hooks.ELSEWHERE}
    assert sorted(listed) == sorted({path.name for path in GUIDE} | generated)


@each_page
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
    # --list-bindings prints and exits, and --kernel imports a module
    if "--list-bindings" in command or "my_kernels" in command:
        pytest.skip("test_commands runs it")
    parse(arguments_of(command))


@each_page
def test_inline_commands_have_the_options_they_use(path: Path) -> None:
    """`splatgl report` stands for the command; with more behind it, it is one to be typed."""
    for code in inline(path):
        if code.startswith("splatgl ") and code != "splatgl --version":
            arguments = arguments_of(code)
            assert arguments[0] in COMMANDS, code
            if len(arguments) > 1 and arguments[1] not in ("--help", "--help-all", "--list-bindings"):
                parse(arguments)


def test_other_programs_exist() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for line in LINES:
        program, *arguments = shlex.split(line)
        if program == "pip":
            assert arguments[0] == "install"
            name, extras = re.fullmatch(r"(\w+|\.)\[([\w,]+)\]", arguments[1]).groups()
            assert name in (project["name"], ".")
            assert set(extras.split(",")) <= set(project["optional-dependencies"])
        elif program not in ("splatgl", "pytest"):
            assert (ROOT / program).is_file(), line


@each_page
def test_no_command_needs_an_index_that_has_no_splatgl(path: Path) -> None:
    """From a checkout or a wheel; workflows and inline code included."""
    text = path.read_text(encoding="utf-8")
    assert re.findall(r"""pip install [^`\n]*?(?<![\w./-])splatgl(?:\[[\w,]*\])?["'`\s]""", text + "\n") == []


def test_every_extra_is_in_the_table() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    (whole,) = extras["all"]
    in_all = set(whole.removeprefix("splatgl[").removesuffix("]").split(","))
    rows = re.findall(r"(?m)^\| (`[^|]+) \| (yes)? ?\| ", (DOCS / "getting-started.md").read_text(encoding="utf-8"))
    listed = {name: bool(yes) for names, yes in rows for name in re.findall(r"`([\w-]+)`", names)}
    assert listed == {name: name in in_all for name in extras.keys() - OWN_EXTRAS}


# what the tests of these commands run, on less
ELSEWHERE = {
    "view": "opens a window: tests/viewer/test_viewer.py, tests/viewer/test_window.py",
    "report": "takes minutes: tests/report/test_report.py",
    "compare": "tests/cli/test_compare.py runs them on pictures that differ",
}
# what takes long: other tests run these commands on less
LONG = ("figure", "render terrain", "animate terrain", "animate tunnel", "visible_male", "--workers")
# a picture and a movie are smaller here than in the guide
SMALL = {"render": ["--size", "64"], "animate": ["--size", "64", "--frames", "2"]}


def blob(*shape: int) -> np.ndarray:
    """int16 [shape]: a soft ball, 300 in the middle."""
    axes = np.meshgrid(*(np.linspace(-1, 1, n) for n in shape), indexing="ij", sparse=True)
    return (300 * np.exp(-3 * sum(axis * axis for axis in axes))).astype(np.int16)


def write_nifti(name: str) -> None:
    nibabel = pytest.importorskip("nibabel")
    nibabel.save(nibabel.Nifti1Image(blob(16, 16, 16), np.diag([1, 0.9, 0.9, 1])), name)


def write_nrrd(name: str) -> None:
    nrrd = pytest.importorskip("nrrd")
    Path(name).parent.mkdir(exist_ok=True)
    samples, header = blob(16, 16, 16), {}
    if name == "seg.nrrd":
        x, y, _ = np.meshgrid(*(np.linspace(-1, 1, 16),) * 3, indexing="ij")
        samples, header = (3 * (x < 0.3) + 4 * (y > 0.8)).astype(np.uint8), {"spacings": [1, 0.9, 0.9]}
    if name == "tooth.nhdr":
        # regions lie at the values of a tooth
        samples = (samples / samples.max() * 1250).astype(np.uint16)
    nrrd.write(name, samples, header)


def write_tiff(name: str) -> None:
    pages = [Pillow.fromarray((plane / 2).astype(np.uint8)) for plane in blob(16, 16, 16)]
    pages[0].save(name, save_all=True, append_images=pages[1:])


def write_picture(name: str) -> None:
    Path(name).parent.mkdir(exist_ok=True)
    photo = name.endswith(".jpg")
    picture = Pillow.new("RGB", (16, 16), (90, 120, 60)) if photo else Pillow.fromarray(np.uint8(blob(16, 16) / 2))
    picture.save(name)


def write_raw(name: str) -> None:
    # as large as the name says, and little in it
    samples = np.zeros((256, 256, 128), np.uint8)
    samples[112:144, 112:144, 48:80] = blob(32, 32, 32) / 2
    samples.tofile(name)


def write_metaimage(name: str) -> None:
    head = "NDims = 3\nDimSize = 16 16 16\nElementType = MET_SHORT\nElementDataFile = LOCAL\n"
    Path(name).write_bytes(head.encode() + (blob(16, 16, 16) * 4 - 1000).astype("<i2").tobytes())


def write_flow(name: str) -> None:
    """A flow that turns about z, and its speed."""
    z, y, x = np.indices((9, 9, 9)) - 4
    flow = np.stack([-y, x, 1 + 0 * z], axis=-1).reshape(-1, 3)
    scalars = "\n".join(str(value) for value in np.hypot(x, y).ravel())
    vectors = "\n".join(" ".join(map(str, vector)) for vector in flow)
    Path(name).write_text(
        "# vtk DataFile Version 3.0\nflow\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 9 9 9\nORIGIN 0 0 0\n"
        f"SPACING 1 1 1\nPOINT_DATA 729\nSCALARS speed float\nLOOKUP_TABLE default\n{scalars}\n"
        f"VECTORS velocity float\n{vectors}\n"
    )


def write_mesh(name: str) -> None:
    pytest.importorskip("trimesh").creation.box((9, 4, 6)).export(name)


# a tetrahedron with numbers
SURFACE = """<VTKFile type="PolyData" byte_order="LittleEndian"><PolyData><Piece NumberOfPoints="4" NumberOfPolys="4">
<PointData Scalars="height"><DataArray type="Float32" Name="height" format="ascii">2 3 11 3</DataArray>
<DataArray type="Float32" Name="wave" format="ascii">0 1 -1 0.5</DataArray></PointData>
<Points><DataArray type="Float32" NumberOfComponents="3" format="ascii">2 2 2 13 4 3 8 8 11 5 12 3</DataArray></Points>
<Polys><DataArray type="Int64" Name="connectivity" format="ascii">0 1 2 0 2 3 0 3 1 1 3 2</DataArray>
<DataArray type="Int64" Name="offsets" format="ascii">3 6 9 12</DataArray></Polys></Piece></PolyData></VTKFile>"""


def write_surface(name: str) -> None:
    Path(name).write_text(SURFACE)


def write_channels(name: str) -> None:
    tifffile = pytest.importorskip("tifffile")
    size = {f"PhysicalSize{axis}": 2.0 for axis in "XYZ"}
    about = {"axes": "CZYX", "Channel": {"Name": ["DAPI", "GFP"]}, **size}
    both = np.stack([blob(16, 16, 16), blob(16, 16, 16)[:, ::-1]]) / 2
    tifffile.imwrite(name, both.astype(np.uint8), ome=True, metadata=about)


def write_dicom(name: str) -> None:
    pytest.importorskip("pydicom")
    dicom.written(Path(name), blob(16, 16, 16) * 4 - 1000)


def write_patients(pattern: str) -> None:
    for patient in ("t1", "t2"):
        folder = Path(pattern.replace("*", patient))
        folder.mkdir(parents=True)
        write_dicom(str(folder))


def write_kernel(name: str) -> None:
    text = 'import splatgl as sg\nsmooth = sg.PiecewiseCubic.of_family("my-smooth", 1.0, 0.0)\n'
    Path(f"{name}.py").write_text(text)


# files that pages name, small, by what writes them
FILES: dict[str, Callable[[str], None]] = {
    **dict.fromkeys(("head.nii.gz", "head_mri_160x232x160.nii.gz"), write_nifti),
    **dict.fromkeys(("t1.nrrd", "t2.nrrd", "seg.nrrd", "stent_ct_128x128x256.nrrd", "tooth.nhdr"), write_nrrd),
    "isabel/isabel_windspeed_t31.nrrd": write_nrrd,
    **dict.fromkeys(("neuron.tif", "neuron_a_409x415x119.tif"), write_tiff),
    **dict.fromkeys(("height.png", "photo.jpg"), write_picture),
    **dict.fromkeys(("terrain_asama/height_u16_256.png", "terrain_asama/satellite_2048.jpg"), write_picture),
    "visible_male_128x256x256_uint8.raw": write_raw,
    "lung_ct_115x157x129.mha": write_metaimage,
    "carotid_76x49x45_scalar_and_velocity.vtk": write_flow,
    "cells.ome.tif": write_channels,
    "dicom_folder": write_dicom,
    "patients/*/ct": write_patients,
    "implant.ply": write_mesh,
    "my_kernels": write_kernel,
    "surface.vtp": write_surface,
}


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder without a display, with the TOML files of the guide."""
    monkeypatch.chdir(tmp_path)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    for name, text in toml_files().items():
        Path(name).write_text(text, encoding="utf-8")
    return tmp_path


def write_files(text: str) -> None:
    """Writes the files that a command or a snippet names, and that of the scene.toml."""
    series = {"t1.nrrd", "t2.nrrd"} if '"t*.nrrd"' in text else set()
    for name, write in FILES.items():
        if name in text or name in series or (name == "head.nii.gz" and "scene.toml" in text):
            write(name)


def toml_files() -> dict[str, str]:
    """The TOML blocks, by the names that commands give them."""
    keys = {"scene.toml": "volume =", "flight.toml": "[[keyframe]]", "keys.toml": "[bindings]"}
    keys |= {"pyproject.toml": "[tool.splatgl.compare]", "motion.toml": "[animation]"}
    found = {name: [block.text for block in of("toml") if key in block.text] for name, key in keys.items()}
    assert sum(map(len, found.values())) == len(of("toml")) == len(keys)
    return {name: text for name, (text,) in found.items()}


@pytest.mark.few(1)
@pytest.mark.parametrize(
    "command", [pytest.param(c, marks=pytest.mark.long if any(word in c for word in LONG) else ()) for c in SPLATGL]
)
def test_commands(command: str, here: Path) -> None:
    write_files(command)
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
            assert Path(output.format(frame=0, name="t1", folder="t1")).exists(), output


# --- snippets and files ----------------------------------------------------------------------------------------------


# files of a sample project import each other: tests/comparison/test_pytest_plugin.py runs them together; programs of
# scripts/examples are run by test_examples.py
ELSEWHERE_RUN = {DOCS / "image-regression.md", DOCS / "examples.md"}


@pytest.mark.few(1)
@pytest.mark.parametrize(
    "block", [block for block in of("python") if block.path not in ELSEWHERE_RUN], ids=lambda block: block.path.stem
)
def test_snippets(block: Block, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_files(block.text)
    # what they register is gone with them
    monkeypatch.setattr(kernels, "KERNELS", dict(kernels.KERNELS))
    monkeypatch.setattr("splatgl.splat.settings.KERNELS", kernels.KERNELS)
    names: dict[str, Any] = {"__name__": "__main__"}
    exec(compile(block.text, str(block.path), "exec"), names)
    # one that defines a test is run by test_pytest_plugin.py
    if block.path == TOP:
        assert (here / "head.png").exists() and names["image"].info["classification"] == "post"


# public names that people use first
FIRST = ("render", "show", "load", "Volume", "Settings", "Transfer", "Camera", "compare", "animate", "scenes")


@pytest.mark.few(1)
@pytest.mark.parametrize("name", FIRST)
def test_examples_of_docstrings(name: str, here: Path) -> None:
    """The names that people use first have an example, which runs."""
    (example,) = re.findall(r"(?ms)^```python\n(.*?)^```$", inspect.getdoc(getattr(sg, name)) or "")
    write_files(example)
    exec(compile(example, name, "exec"), {"sg": sg})


def test_parameters_are_lists_in_the_site() -> None:
    pytest.importorskip("griffe", reason="scripts/docs needs the extra docs")
    from mkdocs_docstrings import list_parameters

    text = (
        "Says.\n\nx: one. y, z: two;\nmore: not\na name. w [3]: four. Raises InputError.\n\n```python\nx: int = 3\n```"
    )
    right = "Says.\n\n- `x`: one.\n- `y`, `z`: two; more: not a name.\n- `w` [3]: four.\n\nRaises InputError.\n\n"
    assert list_parameters(text, ["w", "x", "y", "z"]).split() == (right + "```python\nx: int = 3\n```").split()


def test_the_readmes_snippet_is_five_lines() -> None:
    (block,) = of("python", TOP)
    assert len([line for line in block.text.splitlines() if line]) == 5


def test_scene_file(here: Path) -> None:
    write_nifti("head.nii.gz")
    scene = SceneFile.from_toml(Path("scene.toml"))
    assert scene.settings.antialias == "supersample" and scene.view.size == (400, 300)
    assert main(["render", "scene.toml", "--size", "20"]) == 0
    # and one with the motion of a movie
    Path("moving.toml").write_text('volume = "head.nii.gz"\n' + Path("motion.toml").read_text())
    assert main(["animate", "moving.toml", "-o", "m{frame}.npy", "--only", "9-9", "--size", "16", "--quiet"]) == 0


def test_settings_of_comparisons(here: Path) -> None:
    options = CompareOptions.of_project(here)
    assert options.resolve().ignore == ((280, 10, 40, 12), (0, 0, 90, 20)) and options.baseline_class == "cpu"


def test_key_bindings_file(here: Path) -> None:
    changed = {command.id: command.keys for command in load_bindings("keys.toml")}
    assert changed["turn"] == ("space", "t") and changed["quit"] == ("q",)


# --- links, paths, names and options ---------------------------------------------------------------------------------


@cache
def anchors(path: Path) -> set[str]:
    """What a link to a heading is called: lower case, signs left out, hyphens for spaces."""
    headings = re.findall(r"(?m)^#+ (.+)$", prose(path))
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def broken_links(path: Path) -> list[str]:
    """Relative links and images of a page that lead nowhere."""
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


@each_page
def test_links(path: Path) -> None:
    assert broken_links(path) == []


def test_broken_links_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(globals(), "ROOT", tmp_path)
    path = tmp_path / "README.md"
    path.write_text(
        "# A b\n[x](README.md#a-b) [x](#a-b) [x](#c) ![x](none.png) [x](/etc) ![x](../x.png) [x](https://e.f)"
    )
    assert broken_links(path) == ["#c", "none.png", "/etc", "../x.png"]


def test_every_page_is_linked_from_the_index() -> None:
    text = (DOCS / "index.md").read_text(encoding="utf-8")
    assert [path.name for path in GUIDE if f"({path.name})" not in text] == ["api.md", "index.md"]


def test_every_picture_is_shown() -> None:
    shown = {
        (path.parent / link).resolve() for path in PAGES for link in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", prose(path))
    }
    assert shown == {path.resolve() for path in (DOCS / "pictures").rglob("*") if path.is_file()}


def test_the_gallery_is_what_its_script_writes() -> None:
    assert (DOCS / "gallery.md").read_text(encoding="utf-8") == gallery.page()


@each_page
def test_paths_exist(path: Path) -> None:
    """Inline code that begins with a folder of the repository names a file in it."""
    for code in inline(path):
        if re.match(r"(splatgl|scripts|shaders|tests)(/|$)", code) and code != "splatgl":
            assert (ROOT / code.split()[0]).exists(), code


def test_files_of_an_image_exist() -> None:
    """Files without a room are in splatgl/splat."""
    text = (DOCS / "architecture.md").read_text(encoding="utf-8")
    (table,) = re.findall(r"(?m)^\| input \|.*\n((?:\|.*\n)+)", text)
    names = re.findall(r"`([\w/]+\.py)`", table)
    missing = [name for name in names if not (ROOT / "splatgl" / ("" if "/" in name else "splat") / name).is_file()]
    assert len(names) > 20 and missing == []


@each_page
def test_names_exist(path: Path) -> None:
    """Inline `sg.…` is public; dotted `splatgl.…` is a name in a module."""
    for code in inline(path):
        for name in re.findall(r"^sg\.([A-Za-z_.]+)", code):
            attrgetter(name)(sg)
        for module, name in re.findall(r"^(splatgl\.[a-z_.]+)\.([A-Za-z_]+)$", code):
            getattr(import_module(module), name)


# options of pytest and of plugins that a page compares with its own
OTHERS = {"--junitxml", "--mpl", "--mpl-generate-path", "--mpl-baseline-path", "--mpl-generate-summary"}


@cache
def known_options() -> frozenset[str]:
    """Options of all commands, of the pytest plugin, and of scripts."""
    known = set(re.findall(r'"(--splatgl[\w-]+)"', (ROOT / "splatgl" / "comparison" / "pytest_plugin.py").read_text()))
    scripts = "".join((ROOT / "scripts" / name).read_text() for name in ("test", "release"))
    known |= set(re.findall(r"(--all|--rehearsal)\b", scripts)) | {"--help", "--version"}
    for script in ("scripts/gpu_check.py", "scripts/paper/__main__.py", "tests/stress/__main__.py"):
        known |= set(re.findall(r'"(--[a-z]+)"', (ROOT / script).read_text()))
    for name in COMMANDS:
        parser = _parser([name])
        (commands,) = (each for each in parser._actions if isinstance(each, argparse._SubParsersAction))
        known |= set(commands.choices[name]._option_string_actions)
    return frozenset(known | OTHERS)


@each_page
def test_options_exist(path: Path) -> None:
    named = {option for code in inline(path) for option in re.findall(r"(?<![\w-])--[a-z][\w-]*", code)}
    assert named <= known_options()


# --- tables ----------------------------------------------------------------------------------------------------------


def test_every_format_is_in_the_table() -> None:
    (table,) = re.findall(r"(?m)^\| format \|.*\n((?:\|.*\n)+)", (DOCS / "formats.md").read_text(encoding="utf-8"))
    named = {suffix for line in table.splitlines() for suffix in re.findall(r"`(\.[\w.]+)`", line.split("|")[1])}
    assert named == {suffix for form in FORMATS for suffix in form.suffixes}


def test_every_written_format_is_in_the_table() -> None:
    (table,) = re.findall(r"(?m)^\| name \| keeps .*\n((?:\|.*\n)+)", (DOCS / "formats.md").read_text(encoding="utf-8"))
    named = {suffix for line in table.splitlines() for suffix in re.findall(r"`(\.[\w.]+)`", line.split("|")[1])}
    assert named == {suffix for target in TARGETS for suffix in target.suffixes}


def test_every_stress_case_is_in_the_table() -> None:
    text = (DOCS / "accuracy.md").read_text(encoding="utf-8")
    table = text.partition("| case | error |")[2]
    assert re.findall(r"(?m)^\| `([\w.-]+)` \| [^|]+ \| [^|]+ \|[^|]*\|$", table) == list(CASES)
    assert f"draws {len(CASES)} cases" in text and f"all {len(CASES)} are within" in text


# --- the site --------------------------------------------------------------------------------------------------------


def test_generated_tables_have_all_rows() -> None:
    markers = [name for path in GUIDE for name in re.findall(r"<!-- table: (\w+) -->", path.read_text())]
    assert sorted(markers) == sorted(mkdocs_hooks.TABLES)
    page = mkdocs_hooks.site_page("<!-- table: keys --> <!-- table: methods -->")
    assert all(f"`{row.id}`" in page for row in commands.COMMANDS if row.keys)
    assert all(name in mkdocs_hooks.annotations() for name in ANNOTATIONS)
    table = mkdocs_hooks.site_page("<!-- table: settings -->")
    assert all(f"`--{field.name.replace('_', '-')}`" in table for field in fields(Settings))
    assert all(value in table for values in choices().values() for value in values)
    assert all(name in page for name in methods())


def test_the_page_of_commands_has_all_options() -> None:
    page = mkdocs_hooks.command_reference()
    for name, parser in mkdocs_hooks.command_parsers().items():
        section = page.partition(f"## splatgl {name}\n")[2].partition("\n## ")[0]
        hidden = {
            option for action in parser._actions if action.help == argparse.SUPPRESS for option in action.option_strings
        }
        assert [o for o in parser._option_string_actions if o not in section and o not in hidden] == []


def test_the_api_has_every_public_name() -> None:
    text = (DOCS / "api.md").read_text(encoding="utf-8")
    assert sorted(re.findall(r"(?m)^::: splatgl\.(\w+)$", text)) == sorted(set(sg.__all__) - {"__version__"})


@pytest.mark.long
def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    """It loads nothing from elsewhere, no page links to a file that is not there, and a folder's pages are searched."""
    for module in ("mkdocs", "material", "mkdocstrings"):
        pytest.importorskip(module, reason="scripts/docs needs the extra docs")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "-f", "scripts/mkdocs.yml", "-d", str(tmp_path)]
    built = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    live = {path.name: path.stat().st_size for path in (tmp_path / "live").iterdir()}
    assert live.keys() == gallery.LIVE.keys() and max(live.values()) < MOST_LIVE_BYTES
    page = (tmp_path / "api.html").read_text()
    assert "splatgl.Renderer" in page and "<li><code>transfer</code>: a Transfer" in page
    for path in tmp_path.glob("*.html"):
        html = path.read_text(encoding="utf-8")
        assert not re.search(r'(?:src="|<link [^>]*href=")https?:', html), path
        links = {link.partition("#")[0].partition("?")[0] for link in re.findall(r'(?:href|src)="([^"]+)"', html)}
        local = {link for link in links - {""} if not re.match(r"\w+:", link)}
        assert not [link for link in local if not (tmp_path / link.lstrip("/")).exists()], path
    assert sum(path.stat().st_size for path in tmp_path.rglob("*") if path.is_file()) < MOST_SITE_BYTES
    if browser := shutil.which("chromium") or shutil.which("google-chrome"):
        options = ["--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'user'}", "--dump-dom"]
        for words, title in SEARCHES.items():
            found = f"{(tmp_path / 'index.html').as_uri()}?q={quote(words)}"
            dump = [browser, *options, "--virtual-time-budget=4000", found]
            page = subprocess.run(dump, capture_output=True, text=True, check=True, timeout=600).stdout
            first = page.partition('<article class="md-search-result__article')[2].partition("</article>")[0]
            assert re.search(r"\d+ matching documents", page) and title in re.sub(r"<[^>]+>", "", first), words

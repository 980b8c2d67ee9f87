"""The wheel carries the shaders, from the repository and from an sdist; the core depends on six packages, by the recipe
for conda-forge, too; versions agree.
"""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

import splatgl as sg

ROOT = Path(__file__).parents[2]
CORE = {"moderngl", "numpy", "glfw", "pyrr", "Pillow", "pytest"}


def build(source: Path, kind: str, into: Path) -> Path:
    """One build by hatchling, without network."""
    pytest.importorskip("hatchling", reason="hatchling builds the wheel; it is in the extra dev")
    command = [sys.executable, "-m", "hatchling", "build", "-t", kind, "-d", str(into)]
    subprocess.run(command, cwd=source, check=True, capture_output=True)
    (built,) = into.iterdir()
    return built


def shaders(source: Path) -> set[str]:
    return {path.name for path in (source / "shaders").iterdir() if path.is_file()}


def packed_shaders(wheel: Path) -> set[str]:
    names = (Path(name) for name in zipfile.ZipFile(wheel).namelist())
    return {name.name for name in names if name.parts[:2] == ("splatgl", "shaders")}


def test_wheel_carries_shaders_and_types(tmp_path: Path) -> None:
    wheel = build(ROOT, "wheel", tmp_path)
    assert shaders(ROOT) and packed_shaders(wheel) == shaders(ROOT)
    names = set(zipfile.ZipFile(wheel).namelist())
    assert {"splatgl/py.typed", "splatgl/keywords.pyi", "splatgl/gl/context.py"} <= names
    assert {name.split("/")[0] for name in names} == {"splatgl", f"splatgl-{sg.__version__}.dist-info"}
    assert not [name for name in names if name.startswith("splatgl/docs/")]


def test_wheel_from_sdist_is_the_same(tmp_path: Path) -> None:
    with tarfile.open(build(ROOT, "sdist", tmp_path / "sdist")) as archive:
        archive.extraction_filter = getattr(tarfile, "data_filter", None)  # the default from Python 3.14 on
        archive.extractall(tmp_path / "unpacked")
    (source,) = (tmp_path / "unpacked").iterdir()
    wheel = build(source, "wheel", tmp_path / "wheel")
    assert packed_shaders(wheel) == shaders(ROOT)


@pytest.mark.long
def test_the_readme_installs_it(tmp_path: Path) -> None:
    """The README's first command, without the dependencies, in an environment of its own."""
    command = re.search(r"```sh\npip (.+)\n", (ROOT / "README.md").read_text(encoding="utf-8"))
    assert command is not None
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", tmp_path / "venv"], check=True)
    python = tmp_path / "venv" / "bin" / "python"
    pip = [sys.executable, "-m", "pip", "--python", str(python)]
    subprocess.run([*pip, *shlex.split(command[1]), "--quiet", "--no-deps"], cwd=ROOT, check=True)
    where = [python, "-I", "-c", "import splatgl; print(splatgl.__file__)"]
    found = subprocess.run(where, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert Path(found.stdout.strip()).is_relative_to(tmp_path)


@pytest.mark.parametrize("address", ["", "https://example.org/splatgl/blob/main"])
def test_links_of_the_long_description(tmp_path: Path, address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """An index shows the README alone: its links to files are absolute, or text where no address is known."""
    monkeypatch.setenv("SPLATGL_ADDRESS", address)
    with zipfile.ZipFile(build(ROOT, "wheel", tmp_path)) as wheel:
        text = wheel.read(f"splatgl-{sg.__version__}.dist-info/METADATA").decode()
    links = re.findall(r"\]\(([^)]*)\)", text)
    assert ("Three commands" in text) and (len(links) > 10) == bool(address)
    assert all(link.startswith("https://") for link in links)
    assert not address or ("![a skull in CT" in text and f"({address}/splatgl/docs/pictures/front.png)" in text)
    urls = dict(re.findall(r"(?m)^Project-URL: (\w+), (\S+)$", text))
    assert bool(urls) == bool(address) and urls.get("Repository", "https://example.org/splatgl").endswith("org/splatgl")
    files = [url.removeprefix(address + "/") for name, url in urls.items() if name != "Repository"]
    assert all((ROOT / file).is_file() for file in files), files


def test_core_is_six_packages() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert {line.split(">=")[0] for line in project["dependencies"]} == CORE
    assert project["scripts"] == {"splatgl": "splatgl.cli.main:main"}


def test_the_recipe_is_that_of_the_package() -> None:
    """Version, Python, entry point and dependencies, two of which have other names on conda-forge."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    text = (ROOT / "scripts" / "recipe.yaml").read_text(encoding="utf-8")
    assert f'version: "{sg.__version__}"\n' in text and f"summary: {project['project']['description']}\n" in text
    assert f'python_min: "{project["project"]["requires-python"].removeprefix(">=")}"\n' in text
    (backend,) = project["build-system"]["requires"]
    assert f"- {backend.replace('>=', ' >=')}\n" in text
    ((name, place),) = project["project"]["scripts"].items()
    assert f"- {name} = {place}\n" in text
    run = re.findall(r"(?m)^    - (.+ >=.+)$", text.partition("\n  run:\n")[2].partition("\n\n")[0])
    named = [line.replace(">=", " >=").replace("glfw", "pyglfw").lower() for line in project["project"]["dependencies"]]
    assert sorted(run) == sorted(["python >=${{ python_min }}", *named])


def test_the_citation_has_the_version() -> None:
    assert f"\nversion: {sg.__version__}\n" in (ROOT / ".github" / "CITATION.cff").read_text(encoding="utf-8")


def test_workflows_follow_the_package() -> None:
    """The first and the last Python of the classifiers on Linux, Windows and macOS, and folders that exist."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    pythons = [line.rpartition(" ")[2] for line in project["classifiers"] if re.search(r"Python :: 3\.\d", line)]
    text = (ROOT / ".github" / "workflows" / "test.yml").read_text(encoding="utf-8")
    assert text.count(f'python: ["{pythons[0]}", "{pythons[-1]}"]\n') == 2 and "- run: scripts/test\n" in text
    assert project["requires-python"] == f">={pythons[0]}" and all(
        name in text for name in ("ubuntu", "windows", "macos")
    )
    folders = re.findall(r"tests/\w+", text)
    assert folders and all((ROOT / folder).is_dir() for folder in folders)


def test_the_image_has_what_the_set_up_installs() -> None:
    """Software OpenGL, and the files that the wheel is built from."""
    image = (ROOT / "scripts" / "Dockerfile").read_text(encoding="utf-8")
    packages = re.search(r'mesa_packages="([^"]+)"', (ROOT / "scripts" / "setup.sh").read_text(encoding="utf-8"))
    assert packages is not None and f"python3 {packages[1]} " in image
    copied = re.findall(r"(?m)^COPY (?!--)(.+) \S+$", image)
    assert copied and all((ROOT / name).exists() for line in copied for name in line.split())
    assert re.search(r"(?m)^USER (?!root)", image)


def test_the_set_up_looks_for_opengl() -> None:
    """Its check, which no other test runs, opens a context, or says why not."""
    line = ". scripts/setup.sh; venv=$1; probe egl"
    command = ["bash", "-c", line.replace("$1", sys.prefix)]
    told = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert told.returncode in (0, 3) and told.stdout.strip() and not told.stderr, told.stderr


def test_files_that_the_test_script_names_exist() -> None:
    """Also those in braces, which only bash expands."""
    text = (ROOT / "scripts" / "test").read_text(encoding="utf-8")
    lists = " ".join(re.findall(r"tests/[\w/{},]+\.py", text))
    found = subprocess.run(["bash", "-c", f"ls {lists}"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert lists and found.returncode == 0, found.stderr

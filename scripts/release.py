"""Makes the archives of a version and checks them in clean environments; scripts/release runs it.

    scripts/release [--rehearsal] [--address URL] [--folder FOLDER] [--tests PATH …]

In order, and ending at the first failure: the version and its entry in the changelog; wheel and source archive, built
twice with the same bytes; twine's check; for every Python from 3.11 on that the machine has, the wheel with its newest
extras and the tests in the source archive, then the core built from the source archive; the lowest versions that
pyproject.toml allows, by the oldest Python; conda-forge's recipe with the source archive's checksum; a list of
components (CycloneDX) and checksums. Prints the command that uploads the archives.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import re
import shutil
import subprocess
import sys
import tarfile
from collections.abc import Iterable
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parent.parent
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
# of the wheel, which holds nothing but code
MOST_BYTES = 1_500_000
# rooms whose tests read the package's own files, or need what a clean machine lacks
UNTESTED = ("docs", "fuzz", "gpu", "helpers")
# tests of a rehearsal
REHEARSED = ("tests/readers/test_contents.py", "tests/comparison/test_compare.py")


class Failure(Exception):
    """A check that failed, in one line."""


def run(*command: str | Path, folder: Path = REPOSITORY, **environment: str) -> str:
    """The output of a command; raises Failure with its last lines if it fails."""
    print("  $", *command, flush=True)
    done = subprocess.run(
        [str(part) for part in command],
        cwd=folder,
        # a path to the repository would hide what is installed
        env={**{name: value for name, value in os.environ.items() if name != "PYTHONPATH"}, **environment},
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )
    if done.returncode:
        raise Failure(f"{command[0]} ended with {done.returncode}:\n" + "\n".join(done.stdout.splitlines()[-30:]))
    return done.stdout


def uv(*arguments: str | Path) -> str:
    """The output of a command of uv, as of `run`."""
    return run(sys.executable, "-m", "uv", *arguments)


def find_version(rehearsal: bool) -> str:
    """The version of the package, which must be committed, final and in the changelog unless this is a rehearsal."""
    text = (REPOSITORY / "splatgl/__init__.py").read_text()
    match = re.search(r'^__version__ = "([^"]+)"', text, re.M)
    version = match[1] if match else ""
    if rehearsal:
        return version
    if not re.fullmatch(r"\d+\.\d+\.\d+", version):
        raise Failure(
            f"version: expected a final one such as 0.3.0, got {version}; set __version__, or use --rehearsal"
        )
    if not re.search(rf"^## {re.escape(version)} \(\d{{4}}-\d\d-\d\d\)$", changelog(), re.M):
        raise Failure(f"changelog: expected the heading '## {version} (YYYY-MM-DD)', got none")
    for name, line in (
        (".github/CITATION.cff", f"version: {version}"),
        ("scripts/recipe.yaml", f'  version: "{version}"'),
    ):
        if f"\n{line}\n" not in (REPOSITORY / name).read_text():
            raise Failure(f"{name}: expected version {version}, got another")
    # new public names are listed
    run(sys.executable, "scripts/public_names.py")
    if run("git", "status", "--porcelain").strip():
        raise Failure("files: expected all changes committed, got others; commit them, or use --rehearsal")
    return version


def changelog() -> str:
    return (REPOSITORY / "splatgl/docs/changelog.md").read_text()


def build(folder: Path, address: str) -> tuple[Path, Path]:
    """Builds the wheel and the source archive twice; raises Failure if they differ."""
    epoch = run("git", "log", "-1", "--format=%ct").strip()
    found: list[dict[str, str]] = []
    for place in (folder, folder / "again"):
        place.mkdir(parents=True)
        # the wheel is built from the source archive
        run(sys.executable, "-m", "build", "--outdir", place, SOURCE_DATE_EPOCH=epoch, SPLATGL_ADDRESS=address)
        found.append(checksums(place))
    if found[0] != found[1]:
        raise Failure(f"archives: expected the same bytes twice, got {found[0]} and {found[1]}")
    shutil.rmtree(folder / "again")
    (wheel,), (source,) = folder.glob("*.whl"), folder.glob("*.tar.gz")
    if wheel.stat().st_size > MOST_BYTES:
        raise Failure(f"wheel: expected at most {MOST_BYTES:,} bytes, got {wheel.stat().st_size:,}")
    run(sys.executable, "-m", "twine", "check", "--strict", wheel, source)
    return wheel, source


def checksums(folder: Path) -> dict[str, str]:
    """SHA-256 of the files in a folder, by name."""
    files = sorted(path for path in folder.iterdir() if path.is_file())
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


class Environment:
    """A clean environment of one Python, in a folder of its own."""

    def __init__(self, folder: Path, python: str) -> None:
        self.folder = folder
        uv("venv", "--quiet", "--clear", "--no-python-downloads", "--python", python, folder)

    @property
    def python(self) -> Path:
        return self.folder / "bin/python"

    def install(self, *what: str, lowest: bool = False) -> None:
        resolution = ["--resolution", "lowest-direct"] if lowest else []
        uv("pip", "install", "--quiet", "--python", self.python, *resolution, *what)

    def draw(self) -> None:
        """Draws a picture outside the repository."""
        for command in (("--version",), ("render", "tunnel", "--size", "64", "-o", "tunnel.png")):
            run(self.python, "-m", "splatgl", *command, folder=self.folder)

    def test(self, source: Path, tests: Iterable[str]) -> str:
        """Runs tests of an unpacked source archive against what is installed; returns their last line."""
        options = ("-q", "-m", "not long", "-p", "no:cacheprovider", "--import-mode=append")
        return run(self.python, "-m", "pytest", *options, *tests, folder=source).strip().splitlines()[-1]


def find_pythons() -> list[str]:
    """The versions of Python that this machine has."""
    listed = uv("python", "list", "--only-installed", "--no-python-downloads", "--output-format", "json")
    return [version for version in PYTHONS if re.search(rf'"version":\s*"{re.escape(version)}\.', listed)]


def check(wheel: Path, source: Path, work: Path, tests: Iterable[str]) -> Environment:
    """Checks the archives in clean environments; returns the newest Python's, of the core alone."""
    with tarfile.open(source) as archive:
        archive.extractall(work, filter="data")
    unpacked = work / source.name.removesuffix(".tar.gz")
    # the installed package is tested, not the one beside the tests
    for path in (unpacked / "splatgl").iterdir():
        if path.name != "docs":
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    pythons = find_pythons()
    if not pythons:
        raise Failure(f"Python: expected one of {', '.join(PYTHONS)}, got none")
    for version in pythons:
        print(f"Python {version}: newest extras", flush=True)
        whole = Environment(work / version, version)
        whole.install(f"splatgl[all,dev] @ {wheel.as_uri()}")
        whole.draw()
        print("  ", whole.test(unpacked, tests))
        print(f"Python {version}: core, from the source archive", flush=True)
        core = Environment(work / f"{version}-core", version)
        core.install(f"splatgl @ {source.as_uri()}")
        core.draw()
    print(f"Python {pythons[0]}: lowest versions", flush=True)
    lowest = Environment(work / "lowest", pythons[0])
    lowest.install(f"splatgl[all,dev] @ {wheel.as_uri()}", lowest=True)
    lowest.draw()
    print("  ", lowest.test(unpacked, tests))
    print(f"not on this machine: Python {', '.join(sorted({*PYTHONS} - {*pythons})) or 'none'}")
    return core


def quick_tests() -> list[str]:
    """The rooms of tests that run against an installed package."""
    rooms = (path for path in (REPOSITORY / "tests").iterdir() if (path / "__init__.py").is_file())
    return sorted(f"tests/{path.name}" for path in rooms if path.name not in UNTESTED)


def main() -> None:
    parser = argparse.ArgumentParser(
        allow_abbrev=False, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rehearsal", action="store_true", help="take any version and uncommitted files, few tests")
    parser.add_argument(
        "--address", default="", metavar="URL", help="of the repository's files, for links in the README"
    )
    parser.add_argument("--folder", type=Path, default=REPOSITORY / "build/release", help="new folder (build/release)")
    parser.add_argument("--tests", nargs="+", metavar="PATH", help="tests that run (all quick ones)")
    args = parser.parse_args()
    folder = args.folder.resolve()
    if folder.exists():
        sys.exit(f"release: --folder: expected a new folder, got {folder}; remove it")
    work = folder.with_name(folder.name + "-work")
    shutil.rmtree(work, ignore_errors=True)
    try:
        version = find_version(args.rehearsal)
        wheel, source = build(folder, args.address)
        core = check(wheel, source, work, args.tests or (REHEARSED if args.rehearsal else quick_tests()))
        components = folder / f"splatgl-{version}.cdx.json"
        recipe = (REPOSITORY / "scripts/recipe.yaml").read_text()
        (folder / "recipe.yaml").write_text(recipe.replace("0" * 64, checksums(folder)[source.name]))
        run(sys.executable, "-m", "cyclonedx_py", "environment", "--output-reproducible", "-o", components, core.python)
        sums = "".join(f"{digest}  {name}\n" for name, digest in checksums(folder).items())
        (folder / "SHA256SUMS").write_text(sums)
    except Failure as failure:
        sys.exit(f"release: {failure}")
    finally:
        shutil.rmtree(work, ignore_errors=True)
    print(f"splatgl {version} is ready in {folder}. To publish it:")
    print(f"  python -m twine upload {wheel} {source}")


if __name__ == "__main__":
    main()

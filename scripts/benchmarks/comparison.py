"""Processor seconds of comparing a folder of pairs of pictures: `splatgl compare`, and the tools beside it.

    .venv/bin/python scripts/benchmarks/comparison.py [--node FOLDER] [--pairs N] [--rounds N] [--size N]

FOLDER is where `npm install pixelmatch pngjs odiff-bin @playwright/test` was run; without it those are left
out, as are Python's that are not installed: pytest-regressions, and Matplotlib's comparison, which pytest-mpl uses.
Pairs are PNGs of the terrain: of equal bytes, or with another rectangle each. Tools take turns; seconds are those of
all processes, starts of programs included, divided by the pairs: the median of the rounds.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from whole_commands import seconds

import splatgl as sg

# what reads the folders new and old; splatgl and the test runners write a report or the differences, too
PIXELMATCH = """
const { readdirSync, readFileSync } = require("fs"), { PNG } = require("pngjs")
import("pixelmatch").then(({ default: match }) => {
  for (const name of readdirSync("old")) {
    const [a, b] = ["new", "old"].map(folder => PNG.sync.read(readFileSync(`${folder}/${name}`)))
    match(a.data, b.data, null, a.width, a.height)
  }
})
"""
ODIFF = """
const { readdirSync } = require("fs"), { ODiffServer } = require("odiff-bin"), server = new ODiffServer()
const compare = async () => {
  for (const name of readdirSync("old")) await server.compare(`old/${name}`, `new/${name}`, "odiff.png")
}
compare().finally(() => server.stop())
"""
PLAYWRIGHT = """
const { readdirSync, readFileSync } = require("fs"), { test, expect } = require("@playwright/test")
for (const name of readdirSync("old"))
  test(name, () => expect(readFileSync(`new/${name}`)).toMatchSnapshot(name))
"""
MATPLOTLIB = """
from pathlib import Path
from matplotlib.testing.compare import compare_images
for path in Path("old").iterdir():
    compare_images(path, Path("new", path.name), 0)
for path in Path("new").glob("*-failed-diff.png"):
    path.unlink()
"""
REGRESSIONS = """
from pathlib import Path
import pytest
@pytest.mark.parametrize("name", [path.name for path in Path("old").iterdir()])
def test_pair(name, image_regression):
    image_regression.check(Path("new", name).read_bytes(), 0, fullpath=Path("old", name).absolute())
"""
OWN = """
from pathlib import Path
import pytest
@pytest.mark.parametrize("name", [path.stem for path in Path("old").iterdir()])
def test_pair(name, splatgl_image):
    splatgl_image(Path("new", f"{name}.png"), name=name)
"""
SETTINGS = """
module.exports = { testDir: ".", testMatch: "*.spec.js", snapshotPathTemplate: "old/{arg}{ext}", reporter: "line" }
"""


def make_pairs(folder: Path, count: int, size: int) -> None:
    """Folders equal and different, each with new and old: pictures of the terrain; each has another rectangle."""
    right = sg.render("terrain", size=size, background="white").samples8()[..., :3]
    for case in ("equal", "different"):
        for side in ("new", "old"):
            (folder / case / side).mkdir(parents=True)
    for number in range(count):
        # pictures differ from each other, so that nothing is found in a cache
        old = np.roll(right, number, axis=1)
        new = old.copy()
        new[size // 2 : size // 2 + size // 8, number : number + size // 8] //= 2
        for case, picture in (("equal", old), ("different", new)):
            for side, samples in (("new", picture), ("old", old)):
                sg.Image.from_samples(samples).save(folder / case / side / f"{number:04d}.png")


def commands(node: Path | None) -> Iterator[tuple[str, Sequence[str]]]:
    """The tools that are here, by name, with what runs them in a folder of pairs."""
    python, pytest = sys.executable, [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:napari"]
    yield "splatgl compare", [python, "-m", "splatgl", "compare", "new", "old"]
    yield "splatgl compare --report", [python, "-m", "splatgl", "compare", "new", "old", "--report", "r.html"]
    yield "pytest, splatgl", [*pytest, "test_own.py", "-o", "splatgl=baselines = 'base'", "--splatgl-report", "report"]
    for name, library, command in (
        ("pytest, pytest-regressions", "pytest_regressions", [*pytest, "test_regressions.py"]),
        ("Matplotlib (pytest-mpl)", "matplotlib", [python, "-c", MATPLOTLIB]),
    ):
        if find_spec(library):
            yield name, command
    if node is not None:
        modules = node / "node_modules"
        yield "pixelmatch", ["node", "-e", PIXELMATCH]
        yield "odiff", ["node", "-e", ODIFF]
        yield "Playwright", ["node", str(modules / "@playwright/test/cli.js"), "test"]


def main() -> None:
    parser = argparse.ArgumentParser(
        allow_abbrev=False, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--node", type=Path, help="folder where npm installed its tools")
    parser.add_argument("--pairs", type=int, default=100, help="pairs of a folder (100)")
    parser.add_argument("--rounds", type=int, default=3, help="times each tool runs (3)")
    parser.add_argument("--size", type=int, default=1024, help="pixels of a side (1024)")
    args = parser.parse_args()
    node = args.node and args.node.absolute()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        make_pairs(folder, args.pairs, args.size)
        texts = {"test_own.py": OWN, "test_regressions.py": REGRESSIONS, "pairs.spec.js": PLAYWRIGHT}
        for case in ("equal", "different"):
            for file, text in {**texts, "playwright.config.js": SETTINGS}.items():
                (folder / case / file).write_text(text)
            (folder / case / "base").mkdir()
            (folder / case / "base" / "test_own").symlink_to("../old")
            if node:
                (folder / case / "node_modules").symlink_to(node / "node_modules")
        found: dict[str, list[list[float]]] = {tool: [[], []] for tool, _ in commands(node)}
        for _ in range(args.rounds):
            for tool, command in commands(node):
                for case, times in zip(("equal", "different"), found[tool], strict=True):
                    times.append(seconds(command, cwd=folder / case, check=False)[0] / args.pairs)
        print(f"{'processor seconds a pair':28}  equal  different")
        for tool, (equal, different) in found.items():
            print(f"{tool:28} {statistics.median(equal):6.4f} {statistics.median(different):6.3f}")


if __name__ == "__main__":
    main()

"""Mutation tests: breaks one line of the package at a time and runs the test that must fail.

    scripts/mutants [--turn | --list | NAME…]

mutants.txt lists the mutants. They are applied to a copy of the repository in a temporary folder, one after another,
and the test of each runs there. First all tests run without mutants. --turn runs every twelfth mutant, starting with
another one each day; names select mutants whose file or test contains one of them.

Exit code 1 if a mutant survives or a test does not pass unbroken, 2 if a test could not run at all.
"""

from __future__ import annotations

import argparse
import datetime
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, TypeVar

ROOT = Path(__file__).parents[1]
LIST = Path(__file__).with_suffix(".txt")
# files that tests read
COPIED = (".github", "splatgl", "shaders", "tests", "scripts", "pyproject.toml", "README.md", "LICENSE")
# days until --turn has run all mutants
TURNS = 12
# timeout of a mutant's test, which counts as failing
SECONDS = 120.0
# start of driver messages that make any test fail
UNCOMPILED = "GLSL Compiler failed"
T = TypeVar("T")


class Mutant(NamedTuple):
    """A text that occurs once in a file, its replacement, and a test of `scripts/test` that must fail then."""

    file: str
    text: str
    replacement: str
    test: str

    def __str__(self) -> str:
        text, replacement = (" ".join(part.split()) for part in (self.text, self.replacement))
        return f"{self.file}: {text!r} -> {replacement!r}"


def listed() -> tuple[Mutant, ...]:
    """Mutants of mutants.txt, whose head describes its format."""
    mutants = []
    for stanza in LIST.read_text("utf-8").split("\n\n")[1:]:
        head, *lines = stanza.strip("\n").split("\n")
        text, replacement = ("\n".join(line[2:] for line in lines if line[0] == sign) for sign in "-+")
        file, test = head.split(maxsplit=1)
        mutants.append(Mutant(file, text, replacement, test))
    return tuple(mutants)


MUTANTS = listed()


class Unusable(Exception):
    """A test that could not run."""


class Copy:
    """A copy of the repository in a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        for name in COPIED:
            if (ROOT / name).is_dir():
                shutil.copytree(ROOT / name, folder / name)
            else:
                shutil.copy2(ROOT / name, folder)

    def run(self, tests: Sequence[str], *options: str) -> tuple[int | None, str]:
        """Runs tests in the copy; returns pytest's exit code, None after a timeout, and its output."""
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *options, *tests]
        environment = {
            # plugins of other packages take longer to load than a test to run
            **{"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1", "GALLIVM_PERF": "nopt"},
            **os.environ,
            # bytecode of a broken file would outlive it
            **{"PYTHONPATH": str(self.folder), "PYTHONDONTWRITEBYTECODE": "1"},
        }
        limit = SECONDS * len(tests)
        try:
            done = subprocess.run(
                command, cwd=self.folder, env=environment, capture_output=True, text=True, timeout=limit
            )
        except subprocess.TimeoutExpired:
            return None, f"no end after {limit:.0f} s"
        return done.returncode, done.stdout + done.stderr

    def passing(self, tests: Sequence[str]) -> tuple[set[str], bool]:
        """(tests that pass without mutants, whether any fails). Raises Unusable for a missing test."""
        code, output = self.run(tests, "-rp")
        if code not in (0, 1, None):
            raise Unusable(f"pytest ended with {code}:\n{output[-3000:]}")
        if code != 0:
            print(output[-3000:], file=sys.stderr)
        passed = {line.removeprefix("PASSED ") for line in output.splitlines() if line.startswith("PASSED ")}
        return passed, code != 0

    def survives(self, mutant: Mutant) -> bool:
        """Whether the test passes with the mutant. Raises Unusable if it cannot run."""
        path = self.folder / mutant.file
        right = path.read_text("utf-8")
        if right.count(mutant.text) != 1:
            raise Unusable(f"{mutant}: expected the text once in the file, got it {right.count(mutant.text)} times")
        path.write_text(right.replace(mutant.text, mutant.replacement), "utf-8")
        try:
            code, output = self.run([mutant.test], "-x")
        finally:
            path.write_text(right, "utf-8")
        if code not in (0, 1, None) or UNCOMPILED in output:
            raise Unusable(f"{mutant}: pytest ended with {code}:\n{output[-3000:]}")
        return code == 0


def try_all(chosen: Sequence[Mutant]) -> int:
    """Tries mutants and prints the results; returns the exit code."""
    started = _spent()
    with tempfile.TemporaryDirectory(prefix="splatgl-mutants-") as name:
        copy = Copy(Path(name))
        passing, has_failed = copy.passing(list(dict.fromkeys(mutant.test for mutant in chosen)))
        untried = [mutant for mutant in chosen if mutant.test not in passing]
        for mutant in untried:
            print(f"its test does not pass without it: {mutant}\n  {mutant.test}", file=sys.stderr)
        survivors = 0
        for mutant in chosen:
            if mutant not in untried:
                before = _spent()
                survives = copy.survives(mutant)
                survivors += survives
                result = f"SURVIVES {mutant.test}" if survives else "killed"
                print(f"{result} ({_spent() - before:.1f} s)  {mutant}", flush=True)
    rest = f", {len(untried)} could not be tried" * bool(untried)
    print(f"{survivors} of {len(chosen)} mutants survive{rest}; {_spent() - started:.0f} s of processor time")
    return int(survivors > 0 or has_failed)


def of_today(cases: Sequence[T], turns: int) -> list[T]:
    """Those whose turn is today; after as many days as there are turns, each has had one."""
    return list(cases[datetime.date.today().toordinal() % turns :: turns])


def _spent() -> float:
    """Processor time of finished tests, seconds."""
    used = os.times()
    return used.children_user + used.children_system


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        allow_abbrev=False, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="parts of the names of files or tests")
    parser.add_argument("--turn", action="store_true", help="every twelfth, starting with another one each day")
    parser.add_argument("--list", action="store_true", help="list them")
    args = parser.parse_args(arguments)
    chosen = [row for row in MUTANTS if not args.names or any(name in row.file + row.test for name in args.names)]
    if args.turn:
        chosen = of_today(chosen, TURNS)
    if args.list or not chosen:
        print("\n".join(f"{mutant}\n  {mutant.test}" for mutant in chosen) or "none of that name")
        return int(not chosen)
    try:
        return try_all(chosen)
    except Unusable as error:
        print(error, file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())

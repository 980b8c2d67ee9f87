"""The tests of `scripts/gpu_check`: runs those that need OpenGL while there is time, and tells how they ended."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

ROOT = Path(__file__).parents[2]
# what needs OpenGL: twins of shader functions, splats against float64, techniques, shapes, stored pictures
TESTED = (
    "gl/test_twins",
    "gl/test_twins_footprints",
    "gl/test_twins_sheets",
    "gl/test_splats",
    "gl/test_tiles",
    "gl/test_card_lists",
    "gl/test_shapes",
    "splat/test_sheets",
    "gl/test_agreement",
    "comparison/test_scenes",
)
# a line of pytest on one test
TOLD = re.compile(r"(tests/([\w/]+)\.py::.*) (PASSED|FAILED|ERROR|SKIPPED|XFAIL|XPASS)\b.*\[ *\d+%\]")


def tests(limit: float, card: bool) -> dict[str, Any]:
    """Outcome of the tests that need OpenGL, printed too. card: refuses software OpenGL."""
    environment = os.environ | ({"SPLATGL_REQUIRE_GPU": "1"} if card else {})
    files = [f"tests/{name}.py" for name in TESTED]
    command = [sys.executable, "-m", "pytest", "-v", "--tb=short", "-p", "no:cacheprovider", "-m", "not long", *files]
    print(f"tests, at most {limit:.0f} s", flush=True)
    with TemporaryDirectory() as folder:
        log = Path(folder) / "log"
        with log.open("w") as file:
            process = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT, cwd=ROOT, env=environment)
            try:
                code: int | None = process.wait(limit)
            except subprocess.TimeoutExpired:
                process.terminate()
                process.wait()
                code = None
        lines = log.read_text(errors="replace").splitlines()
    told = outcome(lines, code)
    print("\n".join([*told["failed"], f"tests {told['ended']}: {told['passed']} passed, {told['skipped']} skipped"]))
    return told


def outcome(lines: Sequence[str], code: int | None) -> dict[str, Any]:
    """What pytest's lines and exit code say; code: None if it ran out of time. left out: files that did not end."""
    found = [match for line in lines if (match := TOLD.match(line))]
    failed = [match[1] for match in found if match[3] in ("FAILED", "ERROR")]
    if code not in (0, None) and not failed:
        failed = [f"pytest ended with exit code {code}: {lines[-1] if lines else ''}"]
    left = []
    if code is None:
        begun = [name for name in TESTED if any(match[2] == name for match in found)]
        left = [name for name in TESTED if name not in begun]
        left[:0] = [f"the rest of {begun[-1]}"] if begun else []
    ended = "FAILED" if failed else "ran out of time" if code is None else "passed"
    passed, skipped = (sum(match[3] == word for match in found) for word in ("PASSED", "SKIPPED"))
    return {"ended": ended, "passed": passed, "skipped": skipped, "failed": failed, "left out": left}

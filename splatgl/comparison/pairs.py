"""Compares pairs of files: equal bytes first, then pictures, pages and frames, by several processes."""

from __future__ import annotations

import filecmp
import os
import shlex
import sys
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice, zip_longest
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from splatgl.comparison.metrics import equal_comparison
from splatgl.comparison.pictures import Picture, frames, read_size
from splatgl.comparison.verdict import Criteria, Pair, Verdict
from splatgl.errors import InputError

if TYPE_CHECKING:
    from splatgl.comparison.reports import Case

SAME, DIFFERENT, UNUSABLE = 0, 1, 2
# pairs that a process of its own compares faster than this one, which starts it in half a second
WORTH_A_PROCESS = 12


class FilePair(NamedTuple):
    """A pair of files by the name that both share."""

    name: str
    actual: Path
    right: Path


@dataclass(frozen=True)
class PairResult:
    """Result for two pictures. state: same, different, missing (of one side) or unusable; error: the reason.

    verdict: None if missing or unusable. frame: of a file with several. pair: on request.
    """

    files: FilePair
    state: str
    verdict: Verdict | None = None
    error: str = ""
    frame: int = 0
    pair: Pair | None = None

    @property
    def code(self) -> int:
        """The exit code: SAME, DIFFERENT or UNUSABLE."""
        return {"same": SAME, "unusable": UNUSABLE}.get(self.state, DIFFERENT)

    @property
    def name(self) -> str:
        """The name of the files, and the number of the frame from the second on."""
        return self.files.name + (f" [{self.frame + 1}]" if self.frame else "")

    @property
    def line(self) -> str:
        """The summary without the name."""
        return self.verdict.line if self.verdict else self.error

    @property
    def accept(self) -> str:
        """The shell command that makes the new picture the expected one; "" if nothing is to be accepted."""
        actual, right = (shlex.quote(path.as_posix()) for path in self.files[1:])
        if self.state in ("same", "unusable"):
            return ""
        if not self.files.actual.exists():
            return f"rm {right}"
        folder = shlex.quote(self.files.right.parent.as_posix())
        return f"{'' if self.files.right.parent.is_dir() else f'mkdir -p {folder} && '}cp {actual} {right}"

    def __str__(self) -> str:
        return str(self.verdict) if self.verdict else self.error


def compare_all(pairs: Sequence[FilePair], criteria: Criteria, processes: int | None = None) -> Iterator[PairResult]:
    """Yields the outcomes of pairs in their order. processes: at most; None: one a core, where that is faster.

    In programs other than splatgl they are threads.
    """
    several = len(pairs) > 1 and criteria.mask is None and not criteria.ignore
    equal = {files for files in pairs if several and have_equal_bytes(files)}
    rest = [files for files in pairs if files not in equal]
    count = min(processes or os.cpu_count() or 1, len(rest) // (1 if processes else WORTH_A_PROCESS))
    work = partial(compare_files, criteria=criteria, keep=len(pairs) == 1)
    with ExitStack() as stack:
        compared: Iterator[list[PairResult]] = map(work, rest)
        if count > 1:
            spawn = partial(ProcessPoolExecutor, mp_context=get_context("spawn"))
            pool: Executor = (spawn if _is_program() else ThreadPoolExecutor)(count)
            compared = stack.enter_context(pool).map(work, rest, chunksize=4)
        for files in pairs:
            yield from [_equal_outcome(files, criteria)] if files in equal else next(compared)


def _is_program() -> bool:
    """Whether splatgl is the program that runs: a new process imports the program, and another might begin anew."""
    program = Path(sys.argv[0])
    return program.stem == "splatgl" or program.parts[-2:] == ("splatgl", "__main__.py")


def have_equal_bytes(files: FilePair) -> bool:
    """Whether both files are PNGs that end as such, of equal bytes."""
    try:
        same_size = files.actual.stat().st_size == files.right.stat().st_size
        return same_size and read_size(files.actual) is not None and filecmp.cmp(*files[1:], shallow=False)
    except OSError:
        return False


def _equal_outcome(files: FilePair, criteria: Criteria) -> PairResult:
    width, height = read_size(files.actual) or (0, 0)
    limits = criteria.tolerance
    comparison = equal_comparison(width * height, limits.threshold, criteria.extra | limits.extra)
    return PairResult(files, "same", Verdict(str(files.actual), str(files.right), (width, height), comparison, limits))


def compare_files(files: FilePair, criteria: Criteria, keep: bool = False) -> list[PairResult]:
    """Outcomes of the pictures of two files: one, or one a page or frame. keep: keeps the pictures in it."""
    for what, path, other in (("new picture", files.actual, files.right), ("baseline", files.right, files.actual)):
        if not path.exists() and other.exists():
            return [PairResult(files, "missing", error=f"{files.name}: no {what}: expected {path}")]
    outcomes = []
    try:
        for number, pictures in enumerate(_together(files)):
            outcomes.append(replace(_compare(files, *pictures, criteria), frame=number))
            if not keep:
                outcomes[-1] = replace(outcomes[-1], pair=None)
    except InputError as error:
        outcomes.append(PairResult(files, "unusable", error=str(error), frame=len(outcomes)))
    return outcomes


def _together(files: FilePair) -> Iterator[tuple[Picture | None, Picture | None]]:
    """Pictures of both files; the first are read in parallel, as decoding releases the GIL."""
    both = frames(files.actual), frames(files.right)
    with ThreadPoolExecutor(2) as threads:
        first = list(threads.map(next, both))
    yield first[0], first[1]
    yield from zip_longest(*both)


def _compare(files: FilePair, actual: Picture | None, right: Picture | None, criteria: Criteria) -> PairResult:
    if actual is None or right is None:
        what, path = ("new picture", files.actual) if actual is None else ("baseline", files.right)
        return PairResult(files, "missing", error=f"{files.name}: no {what} in {path}, which has fewer")
    try:
        pair = Pair.of(actual, right, criteria)
        verdict = pair.judge(criteria)
    except InputError as error:
        return PairResult(files, "unusable", error=str(error))
    return PairResult(files, verdict.state, verdict, pair=pair)


def build_cases(outcomes: Iterable[PairResult], criteria: Criteria) -> list[Case]:
    """Cases of a report, the largest differences first; pictures that were not kept are read again."""
    from splatgl.comparison.reports import MOST_PICTURED

    ranked = sorted(outcomes, key=lambda o: (-o.code, -o.verdict.comparison.rmse if o.verdict else 0.0))
    return [_case(outcome, criteria, place < MOST_PICTURED) for place, outcome in enumerate(ranked)]


def _case(outcome: PairResult, criteria: Criteria, pictured: bool) -> Case:
    from splatgl.comparison.reports import Case, image_html, pair_html

    files, html = outcome.files, ""
    if pictured and outcome.verdict and not outcome.verdict.same:
        actual, right = (islice(frames(path), outcome.frame, None) for path in files[1:])
        html = pair_html(outcome.verdict, outcome.pair or Pair.of(next(actual), next(right), criteria))
    elif pictured and outcome.state == "missing" and files.actual.exists() != files.right.exists():
        is_expected = files.right.exists()
        html = image_html(next(frames(files.right if is_expected else files.actual)).image, is_expected)
    return Case(outcome.name, outcome.state, outcome.line.removeprefix(f"{files.name}: "), html, outcome.accept)

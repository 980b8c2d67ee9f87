"""`splatgl compare`: compares two images or folders of images, and reports where and how they differ."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path

from splatgl.cli.parser import add_option
from splatgl.comparison.metrics import require_flip
from splatgl.comparison.pairs import DIFFERENT, UNUSABLE, FilePair, PairResult, build_cases, compare_all
from splatgl.comparison.pictures import Picture, find_pairs, match_formats
from splatgl.comparison.verdict import STATED, CompareOptions, Criteria, Pair, Verdict
from splatgl.data.image import Image, encode_png
from splatgl.errors import expected
from splatgl.fileio import check_output, write_file
from splatgl.options import HelpGroup, ValueKind

# delay of the progress bar in seconds
PATIENCE = 1.0


def add_parser(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `splatgl compare`."""
    parser.add_argument(
        "actual", metavar="ACTUAL", help="picture, .png (8 or 16 bits), .npy, .gif, .pdf, .mp4 …, or a folder of them"
    )
    parser.add_argument("expected", metavar="EXPECTED", help="correct picture, or a folder with the same file names")
    parser.add_argument("--diff", metavar="FILE.png", help="write the difference: black, to pale yellow at the maximum")
    parser.add_argument("--report", metavar="FILE.html", help="write an HTML page of all differences")
    parser.add_argument("--summary", metavar="FILE.md", help="append a summary in Markdown ($GITHUB_STEP_SUMMARY)")
    parser.add_argument("--junit", metavar="FILE.xml", help="write a JUnit report, and the pictures that it attaches")
    parser.add_argument("--json", action="store_true", help="print JSON instead of text")
    parser.add_argument("--quiet", action="store_true", help="print only pairs that differ or cannot be compared")
    count = replace(whole := ValueKind.whole(1), read=lambda text: whole.check(int(text)))
    parser.add_argument("--processes", type=count.parse, metavar="N", help="at most (default: one a core)")
    parser.add_argument_group(
        HelpGroup.LIMITS, "default: rounding to 8 bits passes; any limit replaces the default ones"
    )
    for name, option in STATED.values():
        add_option(parser, name, option)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Compares and prints; returns 0 if all pairs are the same, 1 if any differ, 2 if any cannot be compared."""
    actual, right = Path(args.actual), Path(args.expected)
    pairs = [FilePair(*names) for names in find_pairs(actual, right)]
    if args.diff and actual.is_dir():
        raise expected("--diff", "two files", "two folders", "use --report for folders")
    outputs = ((args.diff, (".png",)), (args.report, (".html",)), (args.summary, (".md", "")), (args.junit, (".xml",)))
    for path, suffixes in outputs:
        if path:
            check_output(Path(path), suffixes if path != args.summary else (Path(path).suffix.lower(),))
            check_apart(Path(path), actual, right, *([Path(args.mask)] if args.mask else []))
    criteria = _criteria(args)
    progress = _bar(compare_all(pairs, criteria, args.processes), len(pairs), args.quiet or args.json)
    outcomes = list(progress)
    # print the verdict first, in case a file cannot be written
    print(_json(outcomes) if args.json else _text(outcomes, args), end="", flush=True)
    if args.diff and (pair := outcomes[0].pair):
        from splatgl.comparison import reports

        difference = reports.largest_difference(pair.actual, pair.right, pair.mask)
        write_file(Path(args.diff), encode_png(reports.heat_map(difference), reports.COMPRESSION))
    if args.report or args.summary or args.junit:
        _write_reports(args, outcomes, criteria, f"{actual} against {right}")
    return max(outcome.code for outcome in outcomes)


def check_apart(output: Path, *inputs: Path) -> None:
    """InputError if writing `output` would overwrite one of the compared images."""
    if output.exists() and any(path.exists() and output.samefile(path) for path in inputs):
        raise expected(output, "another file than the compared pictures", "one of them", "write to another name")


def check_against(image: Image, reference: Picture, output: Path) -> Verdict:
    """Verdict on a new image, as saved at `output`, by the default limits. Raises InputError for other sizes."""
    bits = reference.image.bits
    drawn = Picture(str(output), image if bits is None else image.rounded(bits))
    return Pair(*match_formats(drawn, reference), (drawn.name, reference.name)).judge()


def _criteria(args: argparse.Namespace) -> Criteria:
    """The criteria of the project and of the command line, whose files are relative to the working folder."""
    stated = {key: getattr(args, name) for key, (name, _) in STATED.items()}
    criteria = replace(CompareOptions.of_project(Path()), folder=Path()).changed(stated).resolve()
    if "flip" in criteria.extra | criteria.tolerance.extra:
        require_flip()
    return criteria


def _write_reports(args: argparse.Namespace, outcomes: Sequence[PairResult], criteria: Criteria, title: str) -> None:
    from splatgl.comparison.reports import append_text, build_page, junit_xml, markdown_summary

    cases = build_cases(outcomes, criteria)
    if args.report:
        write_file(Path(args.report), build_page(cases, title).encode())
    if args.summary:
        append_text(Path(args.summary), markdown_summary(cases, title, args.report or ""))
    if args.junit:
        junit = Path(args.junit)
        write_file(junit, junit_xml(cases, title, junit.with_suffix("")))


def _text(outcomes: Sequence[PairResult], args: argparse.Namespace) -> str:
    """A line for each pair that differs; for a single pair its metrics, too."""
    lines = []
    for outcome in outcomes:
        if outcome.code == UNUSABLE:
            print(f"splatgl: {outcome}", file=sys.stderr)
        elif outcome.code == DIFFERENT or (len(outcomes) == 1 and not args.quiet):
            lines.append(str(outcome))
    if len(outcomes) == 1 and not args.quiet and outcomes[0].verdict:
        checks = (c for c in outcomes[0].verdict.checks if not args.metric or c.name in args.metric)
        lines += [f"  {check}" for check in checks]
    if len(outcomes) > 1 and not args.quiet:
        counts, always = Counter(outcome.state for outcome in outcomes), ("same", "different", "unusable")
        shown = [f"{counts[state]} {state}" for state in (*always, *{"missing"} & counts.keys())]
        lines.append(f"{len(outcomes)} pairs: {', '.join(shown)}")
    return "".join(f"{line}\n" for line in lines)


def _json(outcomes: Sequence[PairResult]) -> str:
    """JSON with a record for each pair; infinite decibels become null."""
    records = [_record(outcome) for outcome in outcomes]
    return json.dumps({"exit": max(o.code for o in outcomes), "pairs": records}, indent=1, ensure_ascii=False) + "\n"


def _record(outcome: PairResult) -> dict[str, object]:
    if outcome.verdict is None:
        return {"name": outcome.name, "verdict": outcome.state, "error": outcome.error}
    verdict = outcome.verdict
    numbers = {
        key: None if isinstance(value, float) and not math.isfinite(value) else value
        for key, value in asdict(verdict.comparison).items()
    }
    return {
        "name": outcome.name,
        "verdict": outcome.state,
        "sizes": verdict.sizes or None,
        "kind": verdict.kind.name if verdict.kind else None,
        "message": str(verdict),
        "broken": [check.name for check in verdict.checks if not check.ok],
        "metrics": numbers,
        "limits": {key: value for key, value in asdict(verdict.tolerance).items() if value is not None},
    }


def _bar(outcomes: Iterable[PairResult], count: int, quiet: bool) -> Iterator[PairResult]:
    """Progress bar over pairs, if tqdm is installed and stderr is a terminal."""
    if not quiet and count > 1 and sys.stderr.isatty():
        try:
            from tqdm import tqdm

            outcomes = tqdm(outcomes, "comparing", count, unit="pair", delay=PATIENCE, leave=False)
        except ImportError:
            pass
    return iter(outcomes)

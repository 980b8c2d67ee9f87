"""`splatgl compare`: compares two images or folders of images, and reports where and how they differ."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from splatgl.comparison.metrics import require_flip
from splatgl.comparison.pictures import Picture, find_pairs, match_formats, read, read_mask
from splatgl.comparison.verdict import Tolerance, Verdict, judge
from splatgl.data.image import Image, encode_png
from splatgl.errors import InputError, expected
from splatgl.fileio import check_output, write_file

if TYPE_CHECKING:
    from splatgl.comparison.html_report import Case


SAME, DIFFERENT, UNUSABLE = 0, 1, 2
METRICS = ("maximum", "rmse", "psnr", "bias", "share", "unmatched", "ssim", "flip")
# flags of limits, their fields of Tolerance, and help
LIMITS = (
    ("--max-difference", "maximum", "largest difference of a channel"),
    ("--max-rmse", "rmse", "root mean square of the differences"),
    ("--max-bias", "bias", "mean difference of a channel"),
    ("--max-share", "share", "share of pixels above --threshold, 0 to 1"),
    ("--max-unmatched", "unmatched", "that share without edges that moved by one pixel"),
    ("--max-flip", "flip", "mean FLIP error, 0 to 1 (extra compare)"),
    ("--min-psnr", "psnr", "PSNR in decibels"),
    ("--min-ssim", "ssim", "structural similarity, up to 1"),
)
# delay of the progress bar in seconds
PATIENCE = 1.0


@dataclass(frozen=True)
class Criteria:
    """Limits, further metrics, mask and pixel formats of a comparison."""

    tolerance: Tolerance
    extra: frozenset[str] = frozenset()
    mask: np.ndarray | None = None
    any_mode: bool = False


@dataclass(frozen=True)
class Outcome:
    """Result for one pair. verdict: None if the pair cannot be compared; error: the reason. images: kept on request.
    of_sizes: whether the pictures differ in size.
    """

    name: str
    actual: Path
    right: Path
    verdict: Verdict | None
    error: str = ""
    images: tuple[Image, Image] | None = None
    of_sizes: bool = False

    @property
    def code(self) -> int:
        """The pair's exit code: SAME, DIFFERENT or UNUSABLE."""
        if self.verdict is None:
            return DIFFERENT if self.of_sizes else UNUSABLE
        return SAME if self.verdict.same else DIFFERENT

    def __str__(self) -> str:
        return str(self.verdict) if self.verdict is not None else self.error


def add_parser(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `splatgl compare`."""
    parser.add_argument(
        "actual", metavar="ACTUAL", help="picture, .png (8 or 16 bits) or .npy, or a folder of pictures"
    )
    parser.add_argument("expected", metavar="EXPECTED", help="correct picture, or a folder with the same file names")
    names = ", ".join(METRICS)
    parser.add_argument(
        "--metric", type=_metrics, default=(), metavar="M,M…", help=f"metrics to print: {names}; or all"
    )
    parser.add_argument("--mask", metavar="FILE", help="compare only where this picture is not black")
    parser.add_argument("--any-mode", action="store_true", help="also compare RGB with RGBA or gray, as they look")
    parser.add_argument("--diff", metavar="FILE.png", help="write the difference: black, to pale yellow at the maximum")
    parser.add_argument("--report", metavar="FILE.html", help="write an HTML page: side by side, difference, flicker")
    parser.add_argument("--json", action="store_true", help="print JSON instead of text")
    parser.add_argument("--quiet", action="store_true", help="print only pairs that differ or cannot be compared")
    group = parser.add_argument_group(
        "limits", "default: rounding to 8 bits passes; any limit replaces the default ones"
    )
    group.add_argument("--tolerance", type=_limit, metavar="E", help="same as --max-difference E")
    about = "smallest difference of a pixel that --max-share counts (default: one 8-bit step)"
    group.add_argument("--threshold", type=_limit, metavar="E", help=about)
    for option, name, about in LIMITS:
        group.add_argument(option, dest=f"limit_{name}", type=_limit, metavar="X", help=about)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Compares and prints; returns 0 if all pairs are the same, 1 if any differ, 2 if any cannot be compared."""
    actual, right = Path(args.actual), Path(args.expected)
    pairs = find_pairs(actual, right)
    if args.diff and actual.is_dir():
        raise expected("--diff", "two files", "two folders", "use --report for folders")
    for path, suffixes in ((args.diff, (".png",)), (args.report, (".html",))):
        if path:
            check_output(Path(path), suffixes)
            check_apart(Path(path), actual, right, *([Path(args.mask)] if args.mask else []))
    criteria = _criteria(args)
    keep = len(pairs) == 1
    outcomes = [compare_files(name, a, b, criteria, keep) for name, a, b in _bar(pairs, args.quiet or args.json)]
    # print the verdict first, in case a file cannot be written
    print(_json(outcomes) if args.json else _text(outcomes, args), end="", flush=True)
    if args.diff and outcomes[0].images and outcomes[0].verdict:
        write_file(Path(args.diff), _diff(*outcomes[0].images, criteria))
    if args.report:
        write_file(Path(args.report), _page(outcomes, criteria, f"{actual} against {right}").encode())
    return max(outcome.code for outcome in outcomes)


def compare_files(name: str, actual: Path, right: Path, criteria: Criteria, keep: bool = False) -> Outcome:
    """Compares a pair of files; returns errors as an outcome. keep: keeps the images in it."""
    try:
        images = _images(actual, right, criteria)
        sizes = [image.pixels.shape[:2] for image in images]
        if sizes[0] != sizes[1]:
            got, this = (f"{width}×{height}" for height, width in sizes)
            error = expected(actual, f"one size, {this}", got, "draw both at the same size")
            return Outcome(name, actual, right, None, str(error), images if keep else None, True)
        verdict = judge(*images, criteria.tolerance, criteria.extra, (str(actual), str(right)), criteria.mask)
    except InputError as error:
        return Outcome(name, actual, right, None, str(error))
    return Outcome(name, actual, right, verdict, images=images if keep else None)


def check_apart(output: Path, *inputs: Path) -> None:
    """InputError if writing `output` would overwrite one of the compared images."""
    if output.exists() and any(path.exists() and output.samefile(path) for path in inputs):
        raise expected(output, "another file than the compared pictures", "one of them", "write to another name")


def _images(actual: Path, right: Path, criteria: Criteria) -> tuple[Image, Image]:
    """Both images, read in parallel if large: decoding releases the GIL."""
    with ThreadPoolExecutor(2) as threads:
        pictures = list(threads.map(read, (actual, right)))
    return match_formats(pictures[0], pictures[1], criteria.any_mode)


def check_against(
    image: Image, reference: Picture, output: Path, background: tuple[float, float, float] | None = None
) -> Verdict:
    """Verdict on a new image, as saved at `output`, by the default limits."""
    drawn = Picture(str(output), image)
    if reference.bits is not None:
        drawn = replace(drawn, image=image.rounded(reference.bits, background), bits=reference.bits)
    first, second = match_formats(drawn, reference)
    return judge(first, second, Tolerance(), frozenset(), (str(output), reference.name))


def _criteria(args: argparse.Namespace) -> Criteria:
    limits = {name: getattr(args, f"limit_{name}") for _, name, _ in LIMITS}
    limits = {name: limit for name, limit in limits.items() if limit is not None}
    if args.tolerance is not None:
        limits["maximum"] = min(args.tolerance, limits.get("maximum", math.inf))
    tolerance = Tolerance.only(args.threshold, **limits) if limits else Tolerance(args.threshold)
    mask = read_mask(args.mask) if args.mask else None
    extra = frozenset(args.metric) & {"ssim", "flip"}
    if "flip" in extra | tolerance.extra:
        require_flip()
    return Criteria(tolerance, extra, mask, args.any_mode)


def _diff(actual: Image, right: Image, criteria: Criteria) -> bytes:
    from splatgl.comparison import html_report

    difference = html_report.largest_difference(actual, right, criteria.mask)
    return encode_png(html_report.heat_map(difference), html_report.COMPRESSION)


def _page(outcomes: list[Outcome], criteria: Criteria, title: str) -> str:
    """HTML report: pairs that cannot be compared, then the largest differences. Reads pairs with images again."""
    from splatgl.comparison.html_report import MOST_PICTURED, build_page

    ranked = sorted(outcomes, key=lambda o: -o.verdict.comparison.rmse if o.verdict else -math.inf)
    return build_page([_case(outcome, criteria, i < MOST_PICTURED) for i, outcome in enumerate(ranked)], title)


def _case(outcome: Outcome, criteria: Criteria, pictured: bool) -> Case:
    from splatgl.comparison.html_report import build_case, build_single_case, build_size_case

    if outcome.of_sizes and pictured:
        images = outcome.images or _images(outcome.actual, outcome.right, criteria)
        return build_size_case(outcome.name, outcome.error, *images)
    if outcome.of_sizes:
        return build_single_case(outcome.name, "different", outcome.error)
    if outcome.verdict is None:
        return build_single_case(outcome.name, "unusable", outcome.error)
    if outcome.verdict.same or not pictured:
        return build_single_case(outcome.name, "same" if outcome.verdict.same else "different", outcome.verdict.line)
    verdict = replace(outcome.verdict, name=outcome.name)
    first, second = outcome.images or _images(outcome.actual, outcome.right, criteria)
    return build_case(verdict, first, second, criteria.mask)


def _text(outcomes: list[Outcome], args: argparse.Namespace) -> str:
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
        counts = [sum(o.code == code for o in outcomes) for code in (SAME, DIFFERENT, UNUSABLE)]
        lines.append(f"{len(outcomes)} pairs: {counts[0]} same, {counts[1]} different, {counts[2]} unusable")
    return "".join(f"{line}\n" for line in lines)


def _json(outcomes: list[Outcome]) -> str:
    """JSON with a record for each pair; infinite decibels become null."""
    records = [_record(outcome) for outcome in outcomes]
    return json.dumps({"exit": max(o.code for o in outcomes), "pairs": records}, indent=1, ensure_ascii=False) + "\n"


def _record(outcome: Outcome) -> dict[str, object]:
    if outcome.verdict is None:
        state = "different" if outcome.of_sizes else "unusable"
        return {"name": outcome.name, "verdict": state, "error": outcome.error}
    verdict = outcome.verdict
    numbers = {
        key: None if isinstance(value, float) and not math.isfinite(value) else value
        for key, value in asdict(verdict.comparison).items()
    }
    return {
        "name": outcome.name,
        "verdict": "same" if verdict.same else "different",
        "kind": verdict.kind.name if verdict.kind else None,
        "message": str(verdict),
        "broken": [check.name for check in verdict.checks if not check.ok],
        "metrics": numbers,
        "limits": {key: value for key, value in asdict(verdict.tolerance).items() if value is not None},
    }


def _metrics(text: str) -> tuple[str, ...]:
    names = METRICS if text == "all" else tuple(text.split(","))
    if not set(names) <= set(METRICS):
        raise argparse.ArgumentTypeError(f"expected all, or some of {', '.join(METRICS)}, got {text}")
    return names


def _limit(text: str) -> float:
    """Parses a number or a fraction such as 2/255."""
    try:
        top, _, bottom = text.partition("/")
        value = float(top) / float(bottom or 1)
    except (ValueError, ZeroDivisionError):
        value = math.nan
    if not 0 <= value < math.inf:
        raise argparse.ArgumentTypeError(f"expected a number from 0, or a fraction such as 2/255, got {text!r}")
    return value


def _bar(pairs: list[tuple[str, Path, Path]], quiet: bool) -> Iterator[tuple[str, Path, Path]]:
    """Progress bar over pairs, if tqdm is installed and stderr is a terminal."""
    shown: Iterable[tuple[str, Path, Path]] = pairs
    if not quiet and len(pairs) > 1 and sys.stderr.isatty():
        try:
            from tqdm import tqdm

            shown = tqdm(pairs, "comparing", unit="pair", delay=PATIENCE, leave=False)
        except ImportError:
            pass
    return iter(shown)

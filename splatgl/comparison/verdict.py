"""Verdict on two images: limits on each metric, by settings of files, commands and calls, and what exceeds them."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.coercion import public
from splatgl.comparison.difference_kinds import OF_DRAWINGS, DifferenceKind, classify_difference
from splatgl.comparison.metrics import (
    ALIGNMENTS,
    EXTRA,
    NAMES,
    WINDOW,
    Comparison,
    apply_mask,
    compare,
    find_antialiased,
    format_size,
    unite_sizes,
)
from splatgl.comparison.pictures import Picture, as_image, match_formats, read_mask
from splatgl.data.image import Image
from splatgl.errors import InputError, error_prefix, expected
from splatgl.fileio import load_table
from splatgl.options import HelpGroup, ValueKind, check_options, checked, declared, flag_name, option, reject_unknown

# Two correct renderers round some pixels differently: one in a thousand gives an RMSE of 0.03/255 and a bias below
# 0.01/255. One step more everywhere, even in black, gives a bias of 0.05/255 or more.
ROUNDING_RMSE, ROUNDING_BIAS = 0.1 / 255, 0.02 / 255


def read_limit(value: Any) -> float | None:
    """A number from 0, or a fraction such as 2/255 as text; None for None. Raises ValueError for others."""
    if value is None:
        return None
    top, _, bottom = str(value).partition("/")
    number = float(top) / (float(bottom or 1) or math.nan)
    if not 0 <= number < math.inf:
        raise ValueError
    return number


FRACTION = "a number from 0, or a fraction such as 2/255"
LIMIT = ValueKind(FRACTION, read_limit, read_limit, "X", written=FRACTION, hint="float | str")


criterion, limiting = (partial(option, group=group) for group in (HelpGroup.COMPARISON, HelpGroup.LIMITS))


def _limit(flag: str, help: str, default: float | None = None, metavar: str = "") -> Any:
    """The limit of a metric: a maximum, or of a flag --min a minimum."""
    return limiting(default, LIMIT, help, flag=flag, metavar=metavar)


@dataclass(frozen=True)
class Tolerance:
    """Limits of the metrics; None is not checked. By default only the rounding of 8-bit images may differ.

    threshold: minimum difference of a differing pixel; None is one 8-bit step. threshold, maximum, rmse, bias: as
    fractions of the peak. Linear premultiplied light; see `Comparison`.
    """

    threshold: float | None = _limit(
        "--threshold", "smallest difference of a pixel that --max-share counts (default: one 8-bit step)", metavar="E"
    )
    maximum: float | None = _limit("--max-difference", "largest difference of a channel")
    rmse: float | None = _limit("--max-rmse", "root mean square of the differences", ROUNDING_RMSE)
    bias: float | None = _limit("--max-bias", "mean difference of the channel where it is largest", ROUNDING_BIAS)
    share: float | None = _limit("--max-share", "share of pixels above the threshold, 0 to 1", 0.0)
    unmatched: float | None = _limit("--max-unmatched", "share without a match within one pixel")
    levels: float | None = _limit("--max-levels", "largest difference of 8-bit samples, sRGB and alpha")
    density: float | None = _limit("--max-density", "largest share above the threshold in a window of 7×7 or on a line")
    flip: float | None = _limit("--max-flip", "mean FLIP error as seen at 0.7 m, 0 to 1 (extra compare)")
    psnr: float | None = _limit("--min-psnr", "PSNR: peak over rmse in decibels")
    ssim: float | None = _limit("--min-ssim", "mean structural similarity, up to 1")

    def __post_init__(self) -> None:
        check_options(self, "tolerance: ")

    @classmethod
    def only(cls, threshold: float | None = None, **limits: float) -> Tolerance:
        """Tolerance with these limits only."""
        return cls(threshold, **{"share": None, "rmse": None, "bias": None, **limits})

    @property
    def extra(self) -> set[str]:
        """The slower metrics that the limits need."""
        return {name for name in EXTRA if getattr(self, name) is not None}


METRICS = tuple(name for name in declared(Tolerance) if name != "threshold")
# Limits by the name of what may differ. driver: the same program on other drivers and processors, which differ by
# rounding: few pixels, by few levels, in no area and on no line. Of independent pixels, 0.5 % put 9 into a window of
# 7×7 with a probability of 3e-12, and 17 on a line of 98 pixels with one of 2e-21.
NOISE = {"none": Tolerance(), "driver": Tolerance(share=0.005, rmse=0.5 / 255, levels=8, density=8 / WINDOW)}


@dataclass(frozen=True)
class Criteria:
    """Criteria of a comparison.

    extra: metrics besides those with a limit. mask: bool [H, W], the pixels to compare. ignore: rectangles that are not
    compared: left, top, width, height. antialiased: whether pixels that smooth an edge are compared. any_mode: whether
    RGB may be compared with RGBA. align: of images of other sizes.
    """

    tolerance: Tolerance = field(default_factory=Tolerance)
    extra: frozenset[str] = frozenset()
    mask: np.ndarray | None = None
    ignore: tuple[tuple[int, int, int, int], ...] = ()
    antialiased: bool = criterion(
        True,
        ValueKind.flag(),
        "do not compare pixels that only smooth an edge",
        flag="--ignore-antialiased",
        bare=False,
    )
    any_mode: bool = criterion(False, ValueKind.flag(), "also compare RGB with RGBA or gray, as they look", bare=True)
    align: str = criterion(
        "corner", ValueKind.choice(ALIGNMENTS), "alignment of images of different size", metavar="HOW"
    )


@dataclass(frozen=True, eq=False)
class Pair:
    """Two images on one canvas. mask: the pixels to compare, or None. sizes: the difference of their sizes, or ""."""

    actual: Image
    right: Image
    names: tuple[str, str] = NAMES
    mask: np.ndarray | None = None
    sizes: str = ""

    @classmethod
    def of(cls, first: Picture, second: Picture, criteria: Criteria) -> Pair:
        """The pair, and the pixels that count by the criteria. Raises InputError if none does, see `match_formats`."""
        actual, right = match_formats(first, second, criteria.any_mode)
        sizes = [format_size(image.pixels) for image in (actual, right)]
        mask = criteria.mask
        if criteria.ignore:
            mask = np.ones(right.pixels.shape[:2], bool) if mask is None else mask.copy()
            for left, top, width, height in criteria.ignore:
                mask[top : top + height, left : left + width] = False
            if not mask.any():
                raise expected("ignore", "a part of the picture", "all of it")
        actual, right, mask = unite_sizes(actual, right, mask, criteria.align)
        if not criteria.antialiased and np.isfinite(actual.pixels).all() and np.isfinite(right.pixels).all():
            counts = ~find_antialiased(actual.pixels, right.pixels)
            mask = counts if mask is None else mask & counts
        difference = "" if sizes[0] == sizes[1] else f"size {sizes[0]}, expected {sizes[1]}"
        return cls(actual, right, (first.name, second.name), mask, difference)

    def judge(self, criteria: Criteria = Criteria()) -> Verdict:
        """The verdict, see `compare`; images of other sizes are different."""
        if self.sizes and self.mask is not None and not self.mask.any():
            raise expected(self.names[0], "a region that is compared in both pictures", f"none; {self.sizes}")
        verdict = self._measured(criteria.tolerance, criteria.extra)
        if not verdict.broken:
            return verdict
        first, second = (apply_mask(image.pixels, self.mask) for image in (self.actual, self.right))
        kind = classify_difference(first, second, verdict.comparison)
        if kind.name in ("changed", "noise", *OF_DRAWINGS) and criteria.tolerance == Tolerance():
            noise = self._measured(NOISE["driver"])
            count = round(noise.comparison.share_over * noise.comparison.pixels)
            if count and not noise.broken:
                text = f"{count} scattered pixels off by up to {noise.comparison.levels:.0f} levels, as between drivers"
                kind = DifferenceKind("driver", f"{text}; --noise driver allows it")
        return replace(verdict, kind=kind)

    def _measured(self, limits: Tolerance, extra: Collection[str] = ()) -> Verdict:
        """The verdict without the kind of difference."""
        comparison = compare(self.actual, self.right, limits.threshold, {*extra, *limits.extra}, self.names, self.mask)
        height, width = self.right.pixels.shape[:2]
        return Verdict(*self.names, (width, height), comparison, limits, sizes=self.sizes)


@dataclass(frozen=True)
class MetricCheck:
    """A metric's value, and its limit, if any."""

    name: str
    value: float
    limit: float | None
    ok: bool
    at_least: bool = False

    def __str__(self) -> str:
        text = f"{self.name} {format_metric(self.name, self.value)}"
        if self.limit is None:
            return text
        sign = ("≥" if self.ok else "<") if self.at_least else ("≤" if self.ok else ">")
        return f"{text} {sign} {format_metric(self.name, self.limit)}"


@dataclass(frozen=True)
class Verdict:
    """name, against: names of the two images. kind: the kind of difference, None if the same. size: (width, height).
    sizes: both sizes if they differ, else "": the metrics are those of what both images have.
    """

    name: str
    against: str
    size: tuple[int, int]
    comparison: Comparison
    tolerance: Tolerance
    kind: DifferenceKind | None = None
    sizes: str = ""

    @property
    def same(self) -> bool:
        """Whether every metric is within its limit, and both sizes are equal."""
        return not self.sizes and not self.broken

    @property
    def state(self) -> str:
        """same or different."""
        return "same" if self.same else "different"

    @cached_property
    def checks(self) -> tuple[MetricCheck, ...]:
        """Every computed metric; for X-rays, limits relative to the peak are multiplied by it."""
        fields, checks = {"share": "share_over", "unmatched": "share_unmatched"}, []
        for name in METRICS:
            value, limit = getattr(self.comparison, fields.get(name, name)), getattr(self.tolerance, name)
            if value is None:
                continue
            if name in ("maximum", "rmse", "bias") and limit is not None:
                limit *= self.comparison.peak
            at_least = declared(Tolerance)[name].flag.startswith("--min")
            is_ok = limit is None or (value >= limit if at_least else abs(value) <= limit)
            checks.append(MetricCheck(name, value, limit, is_ok, at_least))
        return tuple(checks)

    def __str__(self) -> str:
        """One line: the kind of change, its location, and each exceeded limit."""
        return f"{self.name}: {self.state}: {self.line}"

    @property
    def line(self) -> str:
        """The summary without the pair's name."""
        if self.same:
            return ", ".join(str(check) for check in self.checks)
        return f"{self.what}; {self.place}; {self.broken}" if self.kind else self.what

    @property
    def what(self) -> str:
        """The change in words."""
        kind = self.kind.text if self.kind else "the same"
        return f"{self.sizes}; of what both have, {self.comparison.pixels} pixels: {kind}" if self.sizes else kind

    @property
    def broken(self) -> str:
        """The exceeded limits."""
        return ", ".join(str(check) for check in self.checks if not check.ok)

    @property
    def place(self) -> str:
        """The bounding box of the difference, and the worst pixel."""
        column, row = self.comparison.where
        worst = f"worst {self.comparison.maximum:.4g} at column {column}, row {row}"
        if self.comparison.box is None:
            return f"no pixel over {self.comparison.over}, {worst}"
        left, top, right, bottom = self.comparison.box
        picture = f"of {self.size[0]}×{self.size[1]}"
        return f"columns {left}–{right - 1}, rows {top}–{bottom - 1} ({right - left}×{bottom - top} {picture}), {worst}"


def format_metric(name: str, value: float) -> str:
    """Formats a metric's value: fractions in per cent, PSNR in decibels."""
    if name in ("share", "unmatched"):
        return f"{100 * value:.3g} %"
    if name == "psnr":
        return f"{value:.2f} dB"
    if name == "density":
        return f"{WINDOW * value:.0f}/{WINDOW}"
    return f"{value:.4g}"


FILE, TABLE = "pyproject.toml", "[tool.splatgl.compare]"
Rectangle = tuple[int, int, int, int]


def _check_metrics(value: Any) -> tuple[str, ...]:
    names = METRICS if value == "all" else tuple(value.split(",") if isinstance(value, str) else value)
    if not set(names) <= set(METRICS):
        raise ValueError
    return names


def _list_parts(value: Any) -> list[Any]:
    return [value] if isinstance(value, str) or _is_rectangle(value) else list(value)


def _is_rectangle(value: Any) -> bool:
    """Whether a value is left, top, width and height."""
    numbers = list(value) if isinstance(value, Iterable) and not isinstance(value, str | Mapping) else []
    are_counts = all(isinstance(n, int | np.integer) and n >= 0 for n in numbers)
    return len(numbers) == 4 and are_counts and min(numbers[2:]) > 0


SOME = f"all, or some of {', '.join(METRICS)}"
REGIONS = "names with rectangles, such as clock = [0, 0, 90, 20]"
FILE_NAME = ValueKind.instance("a name", str, Path, metavar="FILE")


@dataclass(frozen=True)
class CompareOptions:
    """Options of comparisons as they are stated.

    regions: parts for `ignore` by their names. baselines, baseline_class, report, summary: of pytest alone. limits: by
    fields of Tolerance. criteria: with the options that it declares. folder: of relative names that are stated next.
    """

    metric: tuple[str, ...] = criterion(
        (), ValueKind(SOME, _check_metrics, _check_metrics, "M,M…", written=SOME), f"metrics to print: {SOME}"
    )
    mask: Path | None = criterion(None, FILE_NAME, "compare only where this picture is not black")
    ignore: tuple[Rectangle | Path, ...] = criterion(
        (),
        ValueKind("rectangles, pictures or names of regions", _list_parts, metavar="LEFT,TOP,WIDTH,HEIGHT|FILE|NAME"),
        "do not compare a rectangle, where a picture is not black, or a region of pyproject.toml; may be repeated",
        repeat=True,
    )
    noise: str = limiting(
        "none", ValueKind.choice(NOISE), "limits by name. driver allows few, scattered pixels that differ by few levels"
    )
    tolerance: Tolerance | float | None = limiting(
        None,
        replace(LIMIT, check=lambda value: value if isinstance(value, Tolerance) else LIMIT.check(value)),
        "same as --max-difference E",
        metavar="E",
    )
    regions: Mapping[str, Any] | None = option(None, ValueKind(REGIONS, dict))
    baselines: Path | None = option(None, FILE_NAME)
    baseline_class: str | None = option(None, ValueKind.instance("a name", str), flag="--class")
    report: Path | None = option(None, FILE_NAME)
    summary: Path | None = option(None, FILE_NAME)
    limits: Mapping[str, float] = field(default_factory=dict)
    criteria: Criteria = field(default_factory=Criteria)
    folder: Path = Path()

    @classmethod
    def of_project(cls, start: Path, folder: Path | None = None) -> CompareOptions:
        """The table [tool.splatgl.compare] of the nearest pyproject.toml in a folder or above it; empty without one.
        folder: of relative names; None: the file's.
        """
        file = next((f / FILE for f in (start, *start.resolve().parents) if (f / FILE).is_file()), None)
        if file is None:
            return cls(folder=folder or start)
        tables = load_table(file, "a project").get("tool", {}).get("splatgl", {})
        if not isinstance(tables, dict) or not isinstance(tables.get("compare", {}), dict):
            raise expected(f"{file}: {TABLE}", "a table", "another value")
        reject_unknown(f"{file}: [tool.splatgl]", tables, ("compare",), f"the table {TABLE}")
        return cls(folder=folder or file.parent).changed(tables.get("compare", {}), f"{file}: {TABLE}")

    def changed(self, values: Mapping[str, Any], what: str = "") -> CompareOptions:
        """The options with others by their names in OPTIONS; None states nothing. A limit among them replaces all
        limits, `noise` too. what: their place, for messages. Raises InputError for unknown names and bad values.
        """
        named = {name.replace("_", "-"): value for name, value in values.items() if value is not None}
        stated: dict[type, dict[str, Any]] = {record: {} for record in RECORDS}
        faults: list[str] = []
        for name, value in named.items():
            try:
                reject_unknown(what or "options", [name], OPTIONS)
                record, key, item = OPTIONS[name]
                with error_prefix(what) if what else nullcontext():
                    stated[record][key] = checked(item.kind, name, value)
            except InputError as error:
                # the place stands before the first one
                faults.append(str(error).removeprefix(f"{what}: " if faults else ""))
        if faults:
            raise InputError("; ".join(faults))
        with error_prefix(what) if what else nullcontext():
            own, limits = self._placed(stated[CompareOptions]), stated[Tolerance]
        kept = self
        if own.keys() & {"noise", "tolerance"} or limits.keys() & {*METRICS}:
            threshold = {name: value for name, value in self.limits.items() if name == "threshold"}
            kept = replace(self, noise="none", tolerance=None, limits=threshold)
        criteria = replace(self.criteria, **stated[Criteria])
        return replace(kept, limits={**kept.limits, **limits}, criteria=criteria, **own)

    def _placed(self, own: dict[str, Any]) -> dict[str, Any]:
        """Stated options with paths in place of names of files and regions."""
        regions = own.get("regions", self.regions) or {}
        if "ignore" in own:
            own["ignore"] = tuple(self._part(part, regions) for part in own["ignore"])
        return own | {
            name: self.folder / value for name, value in own.items() if declared(self)[name].kind is FILE_NAME
        }

    def _part(self, part: Any, regions: Mapping[str, Any]) -> Rectangle | Path:
        """A rectangle or the path of a picture, of numbers, a text or the name of a region."""
        region = regions.get(part, part) if isinstance(part, str) else part
        if isinstance(region, str) and "," in region:
            region = [int(n) if n.strip().isdigit() else n for n in region.split(",")]
        if _is_rectangle(region):
            left, top, width, height = map(int, region)
            return left, top, width, height
        if isinstance(region, str) and Path(region).suffix:
            return self.folder / region
        this = "left,top,width,height in pixels, a picture, or a name of " + (", ".join(regions) or "regions")
        raise expected("ignore", this, repr(part))

    def resolve(self) -> Criteria:
        """The criteria of a comparison: limits, and the mask of all pictures. Raises InputError for bad pictures."""
        mask = read_mask(self.mask) if self.mask else None
        for picture in (part for part in self.ignore if isinstance(part, Path)):
            counts = ~read_mask(picture)
            if mask is not None and mask.shape != counts.shape:
                raise expected(f"ignore: {picture}", "the mask's size", f"{counts.shape[1]}×{counts.shape[0]}")
            mask = counts if mask is None else mask & counts
        rectangles = tuple(part for part in self.ignore if not isinstance(part, Path))
        extra = frozenset(self.metric) & {*EXTRA}
        return replace(self.criteria, tolerance=self._tolerance(), extra=extra, mask=mask, ignore=rectangles)

    def _tolerance(self) -> Tolerance:
        """The limits: those given, of two maxima the smaller one, else those of the noise."""
        if isinstance(self.tolerance, Tolerance):
            return self.tolerance
        limits = dict(self.limits)
        threshold = limits.pop("threshold", None)
        if self.tolerance is not None:
            limits["maximum"] = min(self.tolerance, limits.get("maximum", math.inf))
        return Tolerance.only(threshold, **limits) if limits else replace(NOISE[self.noise], threshold=threshold)


RECORDS = (CompareOptions, Criteria, Tolerance)
# records, fields and options by the names that TOML has; Python writes these with _
OPTIONS = {
    (flag_name(item) if item.flag and not item.is_bare else name).replace("_", "-"): (record, name, item)
    for record in RECORDS
    for name, item in declared(record).items()
}
# fields and options that the command line and Python have, by the same names
STATED = {key: (name, item) for key, (_, name, item) in OPTIONS.items() if item.group}


@public
def judge(a: Any, b: Any, **settings: Any) -> Verdict:
    """Returns the verdict of `splatgl compare` on the image `a` against the reference `b`: whether they are the same,
    the metrics with their limits, and what kind of difference there is.

    a, b: images, files or arrays, as for `compare`; the finer one is rounded to the bits of the other. settings: those
    of [tool.splatgl.compare], such as noise="driver", max_rmse=0.01, ignore=["0,0,20,10"] (left, top, width, height),
    mask="mask.png", antialiased=False, align="center" for images of other sizes. Without limits only 8-bit rounding may
    differ. Raises InputError for unknown names and bad values.

    ```python
    new, old = (sg.render(sg.scenes.ball(12), zoom=zoom, size=64) for zoom in (1.0, 1.1))
    print(sg.judge(new, old, noise="driver"))
    ```
    """
    reject_unknown("judge", settings, [name.replace("-", "_") for name in STATED])
    criteria = CompareOptions().changed(settings).resolve()
    first, second = (Picture(name, as_image(value, name)) for name, value in zip(NAMES, (a, b), strict=True))
    return Pair.of(first, second, criteria).judge(criteria)

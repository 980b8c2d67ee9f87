"""Verdict on two images: limits on each metric, and which of them are exceeded, where, and by what kind of change."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from splatgl.comparison.compare import (
    ALIGNMENTS,
    EXTRA,
    NAMES,
    Comparison,
    apply_mask,
    compare,
    format_size,
    unite_sizes,
)
from splatgl.comparison.difference_kinds import DifferenceKind, classify_difference
from splatgl.comparison.metrics import WINDOW, find_antialiased
from splatgl.comparison.pictures import Picture, match_formats
from splatgl.data.image import Image
from splatgl.errors import expected
from splatgl.options import Group, Kind, check_options, declared, option

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
LIMIT = Kind(FRACTION, read_limit, read_limit, "X", written=FRACTION, hint="float | str")


criterion, limiting = (partial(option, group=group) for group in (Group.COMPARISON, Group.LIMITS))


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
        True, Kind.flag(), "do not compare pixels that only smooth an edge", flag="--ignore-antialiased", bare=False
    )
    any_mode: bool = criterion(False, Kind.flag(), "also compare RGB with RGBA or gray, as they look", bare=True)
    align: str = criterion("corner", Kind.choice(ALIGNMENTS), "alignment of images of different size", metavar="HOW")


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
            raise expected(self.names[0], "a part that counts in both pictures", f"none; {self.sizes}")
        verdict = self._measured(criteria.tolerance, criteria.extra)
        if not verdict.broken:
            return verdict
        first, second = (apply_mask(image.pixels, self.mask) for image in (self.actual, self.right))
        kind = classify_difference(first, second, verdict.comparison)
        if kind.name in ("changed", "noise") and criteria.tolerance == Tolerance():
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

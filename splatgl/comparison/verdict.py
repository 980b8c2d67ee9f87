"""Verdict on two images: limits on each metric, and which of them are exceeded, where, and by what kind of change."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from splatgl.comparison.compare import NAMES, Comparison, apply_mask, compare
from splatgl.comparison.difference_kinds import Kind, classify_difference
from splatgl.data.image import Image
from splatgl.errors import expected

# Two correct renderers round some pixels differently: one in a thousand gives an RMSE of 0.03/255 and a bias below
# 0.01/255. One step more everywhere, even in black, gives a bias of 0.05/255 or more.
ROUNDING_RMSE, ROUNDING_BIAS = 0.1 / 255, 0.02 / 255


@dataclass(frozen=True)
class Tolerance:
    """Limits of the metrics; None is not checked. By default only the rounding of 8-bit images may differ.

    threshold: minimum difference of a differing pixel, as a fraction of the peak; None is one 8-bit step. share,
    unmatched: maximum fraction of differing pixels, and of pixels that a shift by one pixel does not explain. maximum,
    rmse, bias: fractions of the peak. flip: a maximum. psnr (decibels), ssim: minima. Linear premultiplied light; see
    `Comparison`.
    """

    threshold: float | None = None
    share: float | None = 0.0
    rmse: float | None = ROUNDING_RMSE
    bias: float | None = ROUNDING_BIAS
    unmatched: float | None = None
    maximum: float | None = None
    psnr: float | None = None
    ssim: float | None = None
    flip: float | None = None

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if value is not None and not (isinstance(value, (int, float)) and value >= 0):
                raise expected(f"tolerance: {name}", "a number from 0", repr(value))

    @classmethod
    def of(cls, value: Tolerance | float | None) -> Tolerance:
        """value: a number is the maximum difference of any channel, as a share of the peak; None is the default."""
        if value is None or isinstance(value, Tolerance):
            return value or cls()
        return cls(share=None, rmse=None, bias=None, maximum=value)

    @classmethod
    def only(cls, threshold: float | None = None, **limits: float) -> Tolerance:
        """Tolerance with these limits only."""
        return cls(threshold, **{"share": None, "rmse": None, "bias": None, **limits})

    @property
    def extra(self) -> set[str]:
        """The slower metrics that the limits need."""
        return {name for name in ("ssim", "flip") if getattr(self, name) is not None}


@dataclass(frozen=True)
class Check:
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
    """name, against: names of the two images. checks: every computed metric.

    kind: the kind of difference, None if the same. size: (width, height).
    """

    name: str
    against: str
    size: tuple[int, int]
    comparison: Comparison
    tolerance: Tolerance
    checks: tuple[Check, ...]
    kind: Kind | None

    @property
    def same(self) -> bool:
        """Whether every metric is within its limit."""
        return all(check.ok for check in self.checks)

    def __str__(self) -> str:
        """One line: the kind of change, its location, and each exceeded limit."""
        return f"{self.name}: {'same' if self.same else 'different'}: {self.line}"

    @property
    def line(self) -> str:
        """The summary without the pair's name."""
        if self.kind is None:
            return ", ".join(str(check) for check in self.checks)
        return f"{self.kind.text}; {self.place}; {self.broken}"

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
        whole = f"of {self.size[0]}×{self.size[1]}"
        return f"columns {left}–{right - 1}, rows {top}–{bottom - 1} ({right - left}×{bottom - top} {whole}), {worst}"


def judge(
    actual: Image,
    right: Image,
    tolerance: Tolerance | float | None = None,
    extra: Collection[str] = (),
    names: tuple[str, str] = NAMES,
    mask: np.ndarray | None = None,
) -> Verdict:
    """The verdict on `actual` against `right`, see `compare`. extra: metrics to compute besides those with a limit."""
    limits = Tolerance.of(tolerance)
    comparison = compare(actual, right, limits.threshold, {*extra, *limits.extra}, names, mask)
    checks = _checks(comparison, limits)
    kind = None
    if not all(check.ok for check in checks):
        kind = classify_difference(apply_mask(actual.pixels, mask), apply_mask(right.pixels, mask), comparison)
    size = (right.pixels.shape[1], right.pixels.shape[0])
    return Verdict(names[0], names[1], size, comparison, limits, checks, kind)


def _checks(comparison: Comparison, limits: Tolerance) -> tuple[Check, ...]:
    """Checks of all metrics; for X-rays, limits relative to the peak are multiplied by it."""
    fields = {"share": "share_over", "unmatched": "share_unmatched"}
    checks = []
    for name in ("maximum", "rmse", "bias", "share", "unmatched", "flip", "psnr", "ssim"):
        value, limit = getattr(comparison, fields.get(name, name)), getattr(limits, name)
        if value is None:
            continue
        if name in ("maximum", "rmse", "bias") and limit is not None:
            limit *= comparison.peak
        at_least = name in ("psnr", "ssim")
        is_ok = limit is None or (value >= limit if at_least else abs(value) <= limit)
        checks.append(Check(name, value, limit, is_ok, at_least))
    return tuple(checks)


def format_metric(name: str, value: float) -> str:
    """Formats a metric's value: fractions in per cent, PSNR in decibels."""
    if name in ("share", "unmatched"):
        return f"{100 * value:.3g} %"
    if name == "psnr":
        return f"{value:.2f} dB"
    return f"{value:.4g}"

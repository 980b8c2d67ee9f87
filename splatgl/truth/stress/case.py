"""A stress case: an extreme scene, its exact result, and the image's error."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from splatgl.truth.stress.bench import Bench

# relative errors of values below this fraction of the largest are relative to that fraction
SMALLEST = 1e-300


@dataclass(frozen=True)
class Check:
    """A comparison: exact and measured value where the error is largest, that error, and its bound.

    relative: whether errors are relative to the exact value, or absolute (linear light; in X-rays Σ τ).
    bound: finite, as an infinite one promises nothing and is never kept.
    paper: result of the paper's own form, at its largest error; None: not available.
    """

    what: str
    right: float
    found: float
    error: float
    bound: float
    relative: bool
    paper: float | None
    paper_error: float | None

    @property
    def ok(self) -> bool:
        """Whether the error is within the bound, and that finite; NaN never is."""
        return bool(self.error <= self.bound < np.inf)

    @property
    def share(self) -> float:
        """Error over bound; infinite if a bound of 0 is violated."""
        if self.ok:
            return self.error / self.bound if self.bound > 0 else 0.0
        return self.error / self.bound if 0 < self.bound < np.inf and np.isfinite(self.error) else float("inf")


@dataclass(frozen=True)
class Case:
    """name: its identifier. stresses: the extreme property. how: scene, view and settings. right: source of the result.

    run renders it and returns its checks.
    """

    name: str
    stresses: str
    how: str
    right: str
    run: Callable[[Bench], list[Check]]


@dataclass(frozen=True)
class Result:
    """Result of a case. bad_pixels: NaN or infinite values over all its images."""

    case: Case
    checks: tuple[Check, ...]
    pictures: int
    bad_pixels: int
    seconds: float

    @property
    def ok(self) -> bool:
        """Whether every check is within its bound and every pixel is finite."""
        return self.bad_pixels == 0 and all(check.ok for check in self.checks)

    @property
    def worst(self) -> Check:
        """The check nearest to its bound, or farthest over it."""
        return max(self.checks, key=lambda check: check.share)


def check(
    what: str,
    found: ArrayLike,
    right: ArrayLike,
    bound: float,
    paper: ArrayLike | None = None,
    relative: bool = False,
) -> Check:
    """The largest error of values of any shape against the exact values, which broadcast to that shape."""
    answer = np.asarray(right, dtype=np.float64)
    worst = _worst(found, answer, relative)
    papers = _worst(paper, answer, relative) if paper is not None else (None, None, None)
    return Check(what, worst[0], worst[1], worst[2], bound, relative, papers[1], papers[2])


def raised(error: Exception) -> Check:
    """A failed check for a case that raised an error."""
    text = f"{type(error).__name__}: {error}".splitlines()[0]
    return Check(text, float("nan"), float("nan"), float("inf"), 0.0, False, None, None)


def _worst(found: ArrayLike, right: np.ndarray, relative: bool) -> tuple[float, float, float]:
    """(right, found, error) where the error is largest; NaN counts as infinite."""
    values, answer = np.broadcast_arrays(np.asarray(found, dtype=np.float64), right)
    with np.errstate(invalid="ignore", over="ignore"):
        error = np.abs(values - answer)
        if relative:
            error = error / np.maximum(np.abs(answer), SMALLEST)
    error = np.where(np.isnan(error), np.inf, error)
    # of equal errors, take the largest exact value: the background is uninformative
    place = np.unravel_index(int(np.where(error == error.max(), np.abs(answer), -1.0).argmax()), error.shape)
    return float(answer[place]), float(values[place]), float(error[place])

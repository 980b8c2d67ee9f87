"""A stress case: a scene at an extreme, the answer it must give, and how far a picture is from it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from splatgl.truth.stress.bench import Bench

# a value of 0 has no relative error; below this share of the largest one it is measured by that share
SMALLEST = 1e-300


@dataclass(frozen=True)
class Check:
    """One answer: what was right and found where the error is largest, that error, and what it may be.

    relative: whether errors are shares of the right answer, or absolute (linear light; in X-rays Σ τ).
    bound: infinite for what is only told.
    paper: what the paper's own form gives there, where its error is the largest; None: it has none.
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
        """Whether the bound is kept; an error that is not a number keeps none."""
        return bool(self.error <= self.bound)

    @property
    def share(self) -> float:
        """Error over bound; infinite where a bound of 0 is broken."""
        if self.ok:
            return self.error / self.bound if self.bound > 0 else 0.0
        return self.error / self.bound if self.bound > 0 and np.isfinite(self.error) else float("inf")


@dataclass(frozen=True)
class Case:
    """name: its identifier. stresses: what is extreme. how: scene, view and settings. right: where the answer is from.

    run draws it and returns its checks.
    """

    name: str
    stresses: str
    how: str
    right: str
    run: Callable[[Bench], list[Check]]


@dataclass(frozen=True)
class Result:
    """A case that was run. bad_pixels: values that are no numbers or infinite, over all its pictures."""

    case: Case
    checks: tuple[Check, ...]
    pictures: int
    bad_pixels: int
    seconds: float

    @property
    def ok(self) -> bool:
        """Whether every check keeps its bound and every pixel is finite."""
        return self.bad_pixels == 0 and all(check.ok for check in self.checks)

    @property
    def worst(self) -> Check:
        """The check nearest to its bound, or furthest over it."""
        return max(self.checks, key=lambda check: check.share)


def check(
    what: str,
    found: ArrayLike,
    right: ArrayLike,
    bound: float,
    paper: ArrayLike | None = None,
    relative: bool = False,
) -> Check:
    """The largest error of numbers of any shape against the right ones, whose shape they broadcast to."""
    answer = np.asarray(right, dtype=np.float64)
    worst = _worst(found, answer, relative)
    papers = _worst(paper, answer, relative) if paper is not None else (None, None, None)
    return Check(what, worst[0], worst[1], worst[2], bound, relative, papers[1], papers[2])


def raised(error: Exception) -> Check:
    """What a case that ended in an error has to show: a bound broken."""
    text = f"{type(error).__name__}: {error}".splitlines()[0]
    return Check(text, float("nan"), float("nan"), float("inf"), 0.0, False, None, None)


def _worst(found: ArrayLike, right: np.ndarray, relative: bool) -> tuple[float, float, float]:
    """(right, found, error) where the error is largest; one that is not a number is infinite."""
    values, answer = np.broadcast_arrays(np.asarray(found, dtype=np.float64), right)
    with np.errstate(invalid="ignore", over="ignore"):
        error = np.abs(values - answer)
        if relative:
            error = error / np.maximum(np.abs(answer), SMALLEST)
    error = np.where(np.isnan(error), np.inf, error)
    # of several, the one whose right answer is the largest: a picture's background tells nothing
    place = np.unravel_index(int(np.where(error == error.max(), np.abs(answer), -1.0).argmax()), error.shape)
    return float(answer[place]), float(values[place]), float(error[place])

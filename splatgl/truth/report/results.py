"""Results read back from a store's lines: a `Scene` with its `Row`s for each scene."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from splatgl.truth.report.front import Point, Timing, finite
from splatgl.truth.report.methods import EXACT, TRUTHS
from splatgl.truth.report.store import Store


@dataclass(frozen=True)
class Row:
    """One method on one scene. timing: None where it was not timed. errors: by truth, then by name."""

    method: str
    axis: str
    same_as: str
    omitted: str
    timing: Timing | None
    errors: dict[str, dict[str, float | None]] = field(default_factory=dict)
    missing: dict[str, str] = field(default_factory=dict)
    bound: float | None = None
    tolerance: float | None = None
    splats: int = 0
    extraction: float | None = None
    drawn: dict[str, Any] = field(default_factory=dict)

    def error(self, truth: str, name: str = "rmse") -> float | None:
        """The error of that name against that truth, None where it was not measured."""
        return self.errors.get(truth, {}).get(name)


@dataclass(frozen=True)
class Scene:
    """One scene's rows, in the registry's order. about: the store's record of it."""

    name: str
    about: dict[str, Any]
    rows: tuple[Row, ...]

    def row(self, method: str) -> Row | None:
        """The row of that method, None where there is none."""
        return next((row for row in self.rows if row.method == method), None)

    @property
    def usual(self) -> Timing | None:
        """The time of the default settings, the baseline for the others."""
        row = self.row(EXACT)
        return row.timing if row else None

    def points(self, truth: str, name: str = "rmse", same: bool = False) -> list[Point]:
        """The methods with time and error; same: including those with the same image as another."""
        found = []
        for row in self.rows:
            error = row.error(truth, name)
            if row.timing is not None and error is not None and (same or not row.same_as):
                found.append(Point(row.method, error, row.timing))
        return finite(found)

    @property
    def truths(self) -> list[str]:
        """The truths that any method was measured against."""
        return [truth for truth in TRUTHS if any(truth in row.errors for row in self.rows)]


@dataclass(frozen=True)
class Results:
    """Everything: the head's values, the scenes, and the lines about convergence."""

    head: dict[str, Any]
    scenes: tuple[Scene, ...]
    convergence: tuple[dict[str, Any], ...]

    @classmethod
    def of(cls, store: Store) -> Results:
        """Reads everything from a store that has its head line."""
        scenes = tuple(_scene(store, line) for line in store.of("scene"))
        return cls(store.of("head")[0], scenes, tuple(store.of("convergence")))

    @property
    def flip(self) -> bool:
        """Whether FLIP was measured."""
        return any(row.error("sampled", "flip") is not None for scene in self.scenes for row in scene.rows)


def _scene(store: Store, about: dict[str, Any]) -> Scene:
    name = about["scene"]
    times: dict[str, dict[int, float]] = {}
    for line in store.of("time", scene=name):
        times.setdefault(line["method"], {})[line["round"]] = line["seconds"]
    return Scene(name, about, tuple(_row(line, times) for line in store.of("picture", scene=name)))


def _row(line: dict[str, Any], times: dict[str, dict[int, float]]) -> Row:
    # identical images share their timing
    seconds = times.get(line["same_as"] or line["method"], {})
    return Row(
        method=line["method"],
        axis=line["axis"],
        same_as=line["same_as"],
        omitted=line["omitted"],
        timing=Timing.of(seconds) if seconds else None,
        **{
            name: line[name]
            for name in ("errors", "missing", "bound", "tolerance", "splats", "extraction", "drawn")
            if name in line
        },
    )

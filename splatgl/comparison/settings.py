"""Options of comparisons: from pyproject.toml, pytest's configuration, the command line and calls, in that order."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.coercion import public
from splatgl.comparison.compare import EXTRA, NAMES
from splatgl.comparison.pictures import Picture, as_image, read_mask
from splatgl.comparison.verdict import LIMIT, METRICS, NOISE, Criteria, Pair, Tolerance, Verdict, criterion, limiting
from splatgl.errors import error_prefix, expected
from splatgl.fileio import load_table
from splatgl.options import Kind, checked, declared, flag_name, option, refuse_unknown

FILE, TABLE = "pyproject.toml", "[tool.splatgl.compare]"
Rectangle = tuple[int, int, int, int]


def _check_tolerance(value: Any) -> Tolerance | float | None:
    return value if isinstance(value, Tolerance) else LIMIT.check(value)


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
FILE_NAME = Kind.instance("a name", str, Path, metavar="FILE")


@dataclass(frozen=True)
class CompareOptions:
    """Options of comparisons as they are stated.

    regions: parts for `ignore` by their names. baselines, baseline_class, report, summary: of pytest alone. limits: by
    fields of Tolerance. criteria: with the options that it declares. folder: of relative names that are stated next.
    """

    metric: tuple[str, ...] = criterion(
        (), Kind(SOME, _check_metrics, _check_metrics, "M,M…", written=SOME), f"metrics to print: {SOME}"
    )
    mask: Path | None = criterion(None, FILE_NAME, "compare only where this picture is not black")
    ignore: tuple[Rectangle | Path, ...] = criterion(
        (),
        Kind("rectangles, pictures or names of regions", _list_parts, metavar="LEFT,TOP,WIDTH,HEIGHT|FILE|NAME"),
        "do not compare a rectangle, where a picture is not black, or a region of pyproject.toml; may be repeated",
        repeat=True,
    )
    noise: str = limiting(
        "none", Kind.choice(NOISE), "limits by name. driver allows few, scattered pixels that differ by few levels"
    )
    tolerance: Tolerance | float | None = limiting(
        None, replace(LIMIT, check=_check_tolerance), "same as --max-difference E", metavar="E"
    )
    regions: Mapping[str, Any] | None = option(None, Kind(REGIONS, dict))
    baselines: Path | None = option(None, FILE_NAME)
    baseline_class: str | None = option(None, Kind.instance("a name", str), flag="--class")
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
        refuse_unknown(f"{file}: [tool.splatgl]", tables, ("compare",), f"the table {TABLE}")
        return cls(folder=folder or file.parent).changed(tables.get("compare", {}), f"{file}: {TABLE}")

    def changed(self, values: Mapping[str, Any], what: str = "") -> CompareOptions:
        """The options with others by their names in OPTIONS; None states nothing. A limit among them replaces all
        limits, `noise` too. what: their place, for messages. Raises InputError for unknown names and bad values.
        """
        named = {name.replace("_", "-"): value for name, value in values.items() if value is not None}
        refuse_unknown(what or "options", named, OPTIONS)
        stated: dict[type, dict[str, Any]] = {record: {} for record in RECORDS}
        with error_prefix(what) if what else nullcontext():
            for name, value in named.items():
                record, key, item = OPTIONS[name]
                stated[record][key] = checked(item.kind, name, value)
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
    refuse_unknown("judge", settings, [name.replace("-", "_") for name in STATED])
    criteria = CompareOptions().changed(settings).resolve()
    first, second = (Picture(name, as_image(value, name)) for name, value in zip(NAMES, (a, b), strict=True))
    return Pair.of(first, second, criteria).judge(criteria)

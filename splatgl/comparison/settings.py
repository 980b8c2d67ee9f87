"""Settings of comparisons: from pyproject.toml, pytest's configuration, the command line and calls, in that order."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.coercion import public
from splatgl.comparison.compare import ALIGNMENTS, NAMES
from splatgl.comparison.pictures import as_image, match_images, read_mask
from splatgl.comparison.verdict import NOISE, Criteria, Pair, Tolerance, Verdict
from splatgl.errors import error_prefix, expected
from splatgl.fileio import load_table
from splatgl.options import refuse_unknown

METRICS = ("maximum", "rmse", "psnr", "bias", "share", "unmatched", "levels", "density", "ssim", "flip")
# names of limits, their fields of Tolerance, and help
LIMITS = (
    ("tolerance", "maximum", "same as --max-difference E"),
    ("max-difference", "maximum", "largest difference of a channel"),
    ("max-rmse", "rmse", "root mean square of the differences"),
    ("max-bias", "bias", "mean difference of a channel"),
    ("max-share", "share", "share of pixels above --threshold, 0 to 1"),
    ("max-unmatched", "unmatched", "that share without edges that moved by one pixel"),
    ("max-levels", "levels", "largest difference of 8-bit samples, sRGB and alpha"),
    ("max-density", "density", "largest share of pixels above --threshold in a window of 7×7 or on a line"),
    ("max-flip", "flip", "mean FLIP error, 0 to 1 (extra compare)"),
    ("min-psnr", "psnr", "PSNR in decibels"),
    ("min-ssim", "ssim", "structural similarity, up to 1"),
)
FIELDS = {name: limit for name, limit, _ in LIMITS}
# settings of a project alone: names of regions, folder of baselines, classes of renderers and processors, page, summary
PROJECT = ("regions", "baselines", "class", "report", "summary")
KEYS = (*FIELDS, "threshold", "noise", "metric", "mask", "ignore", "antialiased", "align", "any-mode", *PROJECT)
FILE, TABLE = "pyproject.toml", "[tool.splatgl.compare]"


@dataclass(frozen=True)
class Settings:
    """values: by the names in KEYS. folder: relative names of files in them start here."""

    values: Mapping[str, Any] = field(default_factory=dict)
    folder: Path = Path()

    @classmethod
    def of_project(cls, start: Path) -> Settings:
        """The table [tool.splatgl.compare] of the nearest pyproject.toml in a folder or above it; empty without one."""
        file = next((f / FILE for f in (start, *start.resolve().parents) if (f / FILE).is_file()), None)
        if file is None:
            return cls(folder=start)
        tables = load_table(file, "a project").get("tool", {}).get("splatgl", {})
        if not isinstance(tables, dict) or not isinstance(tables.get("compare", {}), dict):
            raise expected(f"{file}: {TABLE}", "a table", "another value")
        refuse_unknown(f"{file}: [tool.splatgl]", tables, ("compare",), f"the table {TABLE}")
        return cls(folder=file.parent).but(tables.get("compare", {}), f"{file}: {TABLE}")

    def but(self, values: Mapping[str, Any], what: str = "options") -> Settings:
        """The settings with others. A limit among them replaces all limits, `noise` too. what: their place."""
        named = {name.replace("_", "-"): value for name, value in values.items() if value is not None}
        refuse_unknown(what, named, KEYS)
        limits = {"noise", *FIELDS}
        others = {k: v for k, v in self.values.items() if k not in limits or not limits & set(named)}
        changed = replace(self, values={**others, **named})
        if what != "options":
            with error_prefix(what):
                changed.criteria()
        return changed

    def get(self, name: str, default: Any = None) -> Any:
        """A value by its name."""
        return self.values.get(name, default)

    def path(self, name: str) -> Path | None:
        """A file or folder by the name of its setting; relative to the settings' folder."""
        value = self.get(name)
        if value is not None and not isinstance(value, str):
            raise expected(name, "a name", repr(value))
        return self.folder / value if value else None

    def criteria(self) -> Criteria:
        """The criteria of a comparison. Raises InputError for bad values."""
        noise, align = self.get("noise", "none"), self.get("align", "corner")
        for name, value, known in (("noise", noise, NOISE), ("align", align, ALIGNMENTS)):
            if value not in known:
                raise expected(name, " or ".join(known), repr(value))
        for name in ("antialiased", "any-mode"):
            if not isinstance(self.get(name, True), bool):
                raise expected(name, "true or false", repr(self.get(name)))
        metrics = self.get("metric", ())
        rectangles, pictures = self._ignored()
        mask = read_mask(self.folder / self.get("mask")) if self.get("mask") else None
        for name in pictures:
            counts = ~read_mask(self.folder / name)
            if mask is not None and mask.shape != counts.shape:
                raise expected(f"ignore: {name}", "the mask's size", f"{counts.shape[1]}×{counts.shape[0]}")
            mask = counts if mask is None else mask & counts
        return Criteria(
            tolerance=self._tolerance(NOISE[noise]),
            extra=frozenset(metrics) & {"ssim", "flip", "levels", "density"},
            mask=mask,
            ignore=rectangles,
            antialiased=self.get("antialiased", True),
            any_mode=self.get("any-mode", False),
            align=align,
        )

    def _tolerance(self, noise: Tolerance) -> Tolerance:
        """The limits: those given, else those of the noise."""
        threshold = self.get("threshold")
        threshold = None if threshold is None else read_limit("threshold", threshold)
        tolerance = self.get("tolerance")
        if isinstance(tolerance, Tolerance):
            return tolerance
        limits: dict[str, float] = {}
        for name, limit in FIELDS.items():
            if name in self.values:
                value = read_limit(name, self.values[name])
                limits[limit] = min(value, limits.get(limit, math.inf))
        return Tolerance.only(threshold, **limits) if limits else replace(noise, threshold=threshold)

    def _ignored(self) -> tuple[tuple[tuple[int, int, int, int], ...], list[str]]:
        """Rectangles, and names of pictures, that are not compared: of `ignore` and of the regions that it names."""
        regions = self.get("regions", {})
        if not isinstance(regions, Mapping):
            raise expected("regions", "names with rectangles, such as clock = [0, 0, 90, 20]", repr(regions))
        rectangles, pictures = [], []
        ignored = self.get("ignore", ())
        for part in [ignored] if isinstance(ignored, str) or _is_rectangle(ignored) else ignored:
            region = regions.get(part, part) if isinstance(part, str) else part
            if isinstance(region, str) and "," in region:
                region = [int(n) if n.strip().isdigit() else n for n in region.split(",")]
            if _is_rectangle(region):
                left, top, width, height = (int(n) for n in region)
                rectangles.append((left, top, width, height))
            elif isinstance(region, str) and Path(region).suffix:
                pictures.append(region)
            else:
                this = "left,top,width,height in pixels, a picture, or a name of " + (", ".join(regions) or "regions")
                raise expected("ignore", this, repr(part))
        return tuple(rectangles), pictures


def _is_rectangle(value: Any) -> bool:
    """Whether a value is left, top, width and height."""
    numbers = list(value) if isinstance(value, Iterable) and not isinstance(value, str | Mapping) else []
    are_counts = all(isinstance(n, int | np.integer) and n >= 0 for n in numbers)
    return len(numbers) == 4 and are_counts and min(numbers[2:]) > 0


def read_limit(name: str, value: Any) -> float:
    """A number from 0, or a fraction such as 2/255 as text. Raises InputError for others."""
    try:
        top, _, bottom = str(value).partition("/")
        number = float(top) / float(bottom or 1)
    except (ValueError, ZeroDivisionError):
        number = math.nan
    if isinstance(value, bool) or not 0 <= number < math.inf:
        raise expected(name, "a number from 0, or a fraction such as 2/255", repr(value))
    return number


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
    refuse_unknown("judge", settings, [name.replace("-", "_") for name in KEYS if name not in PROJECT])
    criteria = Settings().but(settings).criteria()
    images = match_images(as_image(a, NAMES[0]), as_image(b, NAMES[1]), NAMES)
    return Pair.of(*images, criteria).judge(criteria)

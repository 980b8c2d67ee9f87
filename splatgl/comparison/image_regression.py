"""The fixture splatgl_image: compares pictures with baselines, and writes baselines on request.

tests/baselines/<test file>/<name>.png              portable: for renderers without a specific baseline
tests/baselines/<test file>/<name>.nvidia.png       for NVIDIA only, instead of the portable one
tests/baselines/<test file>/<name>.nvidia-2.png     one more valid baseline for NVIDIA
tests/baselines/<test file>/<name>.portable-2.png   one more valid portable baseline
"""

from __future__ import annotations

import hashlib
import re
import shlex
from dataclasses import asdict, dataclass, field, replace
from itertools import count
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from PIL.Image import Image as PillowImage

from splatgl.comparison.html_report import Case, build_case, build_single_case
from splatgl.comparison.pictures import Picture, as_image, match_formats, read
from splatgl.comparison.verdict import Tolerance, Verdict, judge
from splatgl.data.image import Image
from splatgl.errors import InputError, expected

FOLDER = "baselines"
# key of baselines valid for any renderer
PORTABLE = "portable"
# substrings of GL_RENDERER, and their class; the first match counts, since ANGLE and Direct3D include the GPU's name
CLASSES = (
    ("llvmpipe", r"llvmpipe|softpipe|swrast|swiftshader"),
    ("nvidia", r"nvidia|geforce|quadro|tesla|\bnv[0-9a-f]{2,3}\b"),
    ("amd", r"\bamd\b|radeon|\bati\b"),
    ("intel", r"intel"),
    ("apple", r"apple"),
)
# length of the digest that distinguishes names after invalid characters are replaced
DIGEST = 6
# maximum length of a name: file systems allow 255 bytes including the suffix
LONGEST = 120


@dataclass(frozen=True)
class Baselines:
    """The accepted images of a name. key: the renderer's class, or None."""

    folder: Path
    stem: str
    key: str | None
    suffix: str = ".png"

    @property
    def portable(self) -> Path:
        """The baseline for renderers without a baseline of their class."""
        return self.folder / f"{self.stem}{self.suffix}"

    @property
    def of_class(self) -> Path:
        """The baseline of the renderer's class; the portable one if there is no class."""
        return self.folder / f"{self.stem}.{self.key}{self.suffix}" if self.key else self.portable

    def valid(self) -> list[Path]:
        """Existing files to compare with: the class's baseline, else the portable one; then additional ones."""
        more = self._more(self.key or PORTABLE)
        if self.key and self.of_class.is_file():
            return [self.of_class, *more]
        portable = [self.portable] if self.portable.is_file() else []
        return [*portable, *(self._more(PORTABLE) if self.key else []), *more]

    def others(self) -> list[Path]:
        """Baselines for other renderers only."""
        return sorted(set(self._named(r"\.[a-z]+(-\d+)?")) - set(self.valid()))

    def current(self) -> Path:
        """The first valid baseline; without one the path of the portable one."""
        return next(iter(self.valid()), self.portable)

    def fresh(self) -> Path:
        """Path for a new baseline: the first of the class, or a further one if a valid one exists."""
        if not self.valid():
            return self.of_class
        key = self.key or PORTABLE
        places = (self.folder / f"{self.stem}.{key}-{number}{self.suffix}" for number in count(2))
        return next(place for place in places if not place.exists())

    def _more(self, key: str) -> list[Path]:
        """Additional baselines of a class, or of any renderer."""
        return self._named(rf"\.{key}-\d+")

    def _named(self, pattern: str) -> list[Path]:
        """Files named by the stem, a match of the pattern, and the suffix."""
        whole = re.compile(re.escape(self.stem) + pattern + re.escape(self.suffix))
        return sorted(path for path in self.folder.glob("*") if whole.fullmatch(path.name))


def renderer_class(image: Image) -> str | None:
    """llvmpipe, nvidia, amd, intel or apple, from the image's `info["renderer"]`; None for any other or none."""
    renderer = str(image.info.get("renderer", ""))
    return next((name for name, pattern in CLASSES if re.search(pattern, renderer, re.IGNORECASE)), None)


def file_stem(name: str) -> str:
    """A file stem of Latin letters, digits, _ and -; a digest distinguishes names with replaced characters."""
    plain = re.sub(r"\[(.*)\]$", r"-\1", name)
    safe = re.sub(r"[^A-Za-z0-9_-]+", "-", plain).strip("-")[:LONGEST]
    if safe == plain:
        return safe
    return f"{safe}-{hashlib.sha1(name.encode()).hexdigest()[:DIGEST]}".lstrip("-")


@dataclass
class ImageRegression:
    """The fixture's value: call it with an image.

    test: its id on pytest's command line. default_name: of baselines. mode: the baselines to write. cases: collects the
    comparisons.
    """

    test: str
    file: Path
    default_name: str
    mode: Literal["", "update", "update-class", "add"]
    cases: list[dict[str, str]]
    report: bool = False
    used: set[str] = field(default_factory=set)

    def __call__(
        self,
        image: Image | np.ndarray | PillowImage | bytes | str | Path,
        name: str | None = None,
        tolerance: Tolerance | float | None = None,
        bits: int | None = 8,
        mask: np.ndarray | None = None,
    ) -> None:
        """Fails the test if `image` differs from all of its baselines, or has none.

        image: an Image, an image file or its bytes, an image of Pillow, linear premultiplied floats [H, W, 4], or sRGB
        samples (uint8, [H, W, 3 or 4]).
        name: of the baseline; the test's own if None. tolerance: the largest difference of a channel, or a
        `Tolerance`; None allows rounding to 8 bits. bits: 8 or 16 for a PNG, None for a .npy of floats; `image` is
        rounded accordingly before the comparison. mask: [H, W], the pixels to compare.
        """
        __tracebackhide__ = True
        try:
            picture = as_image(image)
            baselines = self._baselines(picture, name, bits)
            counts = None if mask is None else np.asarray(mask, bool)
            outcome = self._outcome(picture, baselines, Tolerance.of(tolerance), bits, counts)
        except InputError as error:
            self._keep(build_single_case(f"{self.test}: {name or self.default_name}", "unusable", str(error)))
            outcome = str(error)
        if outcome:
            pytest.fail(outcome, pytrace=False)

    def _baselines(self, picture: Image, name: str | None, bits: int | None) -> Baselines:
        """Baselines by name; a test's second unnamed image gets the suffix -2, and so on."""
        stem = file_stem(name or self.default_name)
        if name is None and stem in self.used:
            stem = next(f"{stem}-{i}" for i in range(2, len(self.used) + 3) if f"{stem}-{i}" not in self.used)
        self.used.add(stem)
        folder = self.file.parent / FOLDER / self.file.stem
        return Baselines(folder, stem, renderer_class(picture), ".png" if bits else ".npy")

    def _outcome(
        self, picture: Image, baselines: Baselines, tolerance: Tolerance, bits: int | None, mask: np.ndarray | None
    ) -> str:
        """The failure message; "" for success."""
        title = f"{self.test}: {baselines.stem}"
        paths = baselines.valid()
        outcomes = [self._compare(picture, path, tolerance, mask) for path in paths]
        match = next((verdict for verdict, _ in outcomes if verdict is not None and verdict.same), None)
        if match is not None:
            self._keep(Case(title, "same", match.line))
            return ""
        if self.mode:
            targets = {"add": baselines.fresh, "update-class": lambda: baselines.of_class, "update": baselines.current}
            return self._write(title, picture, targets[self.mode](), bits)
        if not paths:
            return self._missing(title, picture, baselines)
        return self._different(title, outcomes, baselines)

    def _compare(
        self, picture: Image, path: Path, tolerance: Tolerance, mask: np.ndarray | None
    ) -> tuple[Verdict | None, Case]:
        """Verdict and case for one baseline; no verdict if it cannot be compared."""
        try:
            actual, right = match_formats(Picture(path.stem, picture), replace(read(path), mode=None))
            verdict = judge(actual, right, tolerance, names=(path.stem, relative_path(path)), mask=mask)
        except InputError as error:
            return None, build_single_case(path.stem, "unusable", str(error), picture if self.report else None)
        if verdict.same or not self.report:
            return verdict, Case(path.stem, "same" if verdict.same else "different", verdict.line)
        return verdict, build_case(verdict, actual, right, mask)

    def _write(self, title: str, picture: Image, target: Path, bits: int | None) -> str:
        if not np.isfinite(picture.pixels).all():
            raise expected(title, "finite numbers to write as a baseline", "NaN or infinity")
        target.parent.mkdir(parents=True, exist_ok=True)
        picture.save(target, bits or 8)
        self._keep(Case(title, "same", f"written to {relative_path(target)}"), relative_path(target))
        return ""

    def _missing(self, title: str, picture: Image, baselines: Baselines) -> str:
        others = ", ".join(path.name for path in baselines.others())
        whose = f" for {baselines.key or 'any renderer'}, only {others}" if others else ""
        line = f"no baseline{whose}: expected {relative_path(baselines.portable)}"
        self._keep(build_single_case(title, "missing", line, picture if self.report else None))
        look, update = self._advice()
        return f"{line}\n  look at the picture: {look}\n  then make it with: {update}"

    def _different(self, title: str, outcomes: list[tuple[Verdict | None, Case]], baselines: Baselines) -> str:
        """Failure message, from the nearest baseline."""
        verdict, nearest = min(outcomes, key=lambda pair: np.inf if pair[0] is None else pair[0].comparison.rmse)
        self._keep(replace(nearest, name=title))
        which = f", the nearest of {len(outcomes)}" if len(outcomes) > 1 else ""
        lines = [nearest.line]
        if verdict is not None:
            lines = [
                f"{baselines.stem} differs: {verdict.kind.text if verdict.kind else ''}",
                f"where: {verdict.place}",
                f"limits: {verdict.broken}",
                f"baseline: {verdict.against}{which}",
            ]
        look, update = self._advice()
        return "\n  ".join([*lines, f"look at it: {look}", f"if it is right: {update}"])

    def _advice(self) -> tuple[str, str]:
        """(place or command that shows the picture, command that writes the baseline), for messages."""
        command = f"pytest {shlex.quote(self.test)}"
        return "in the report" if self.report else f"{command} --splatgl-report DIR", f"{command} --splatgl-update"

    def _keep(self, case: Case, written: str = "") -> None:
        self.cases.append({**asdict(case), "written": written})


def relative_path(path: Path) -> str:
    """The path, relative to the working folder if inside it."""
    return str(path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path)

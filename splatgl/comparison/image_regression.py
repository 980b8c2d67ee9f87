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
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from splatgl.comparison.pictures import Picture, as_images, read
from splatgl.comparison.reports import Case, image_html, pair_html
from splatgl.comparison.verdict import CompareOptions, Criteria, Pair, Tolerance, Verdict
from splatgl.data.image import Image
from splatgl.errors import InputError, expected
from splatgl.platforms import processor_vendor

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
    """The accepted images of a name. keys: the classes that the image belongs to, the narrowest first."""

    folder: Path
    stem: str
    keys: tuple[str, ...] = ()
    suffix: str = ".png"

    @property
    def portable(self) -> Path:
        """The baseline for images without a baseline of their class."""
        return self.folder / f"{self.stem}{self.suffix}"

    @property
    def of_class(self) -> Path:
        """The baseline of the narrowest class; the portable one if there is no class."""
        return self._of(self.keys[0]) if self.keys else self.portable

    def valid(self) -> list[Path]:
        """Existing files to compare with: the narrowest class's baseline, else the portable one; then more."""
        more: list[Path] = []
        for key in self.keys:
            more += self._more(key)
            if self._of(key).is_file():
                return [self._of(key), *more]
        return [*([self.portable] if self.portable.is_file() else []), *self._more(PORTABLE), *more]

    def others(self) -> list[Path]:
        """Baselines for other classes only."""
        return sorted(set(self._named(r"\.[a-z][a-z0-9-]*")) - set(self.valid()))

    def check_case(self) -> None:
        """Raises InputError for a baseline whose name differs in case alone: macOS and Windows take both for one."""
        stems = sorted({path.name.partition(".")[0] for path in self.folder.glob("*")})
        other = next((stem for stem in stems if stem != self.stem and stem.lower() == self.stem.lower()), None)
        if other is not None:
            fix = "rename one of them: macOS and Windows take both for one file"
            raise expected(f"baseline {self.stem}", "a name that differs in more than case", other, fix)

    def current(self) -> Path:
        """The first valid baseline; without one the path of the portable one."""
        return next(iter(self.valid()), self.portable)

    def fresh(self) -> Path:
        """Path for a new baseline: the first of the class, or a further one if a valid one exists."""
        if not self.valid():
            return self.of_class
        key = self.keys[0] if self.keys else PORTABLE
        places = (self.folder / f"{self.stem}.{key}-{number}{self.suffix}" for number in count(2))
        return next(place for place in places if not place.exists())

    def _of(self, key: str) -> Path:
        return self.folder / f"{self.stem}.{key}{self.suffix}"

    def _more(self, key: str) -> list[Path]:
        """Additional baselines of a class, or of any renderer."""
        return self._named(rf"\.{key}-\d+")

    def _named(self, pattern: str) -> list[Path]:
        """Files named by the stem, a match of the pattern, and the suffix."""
        names = re.compile(re.escape(self.stem) + pattern + re.escape(self.suffix))
        return sorted(path for path in self.folder.glob("*") if names.fullmatch(path.name))


def renderer_class(image: Image) -> str | None:
    """llvmpipe, nvidia, amd, intel or apple, from the image's `info["renderer"]`; None for any other or none."""
    renderer = str(image.info.get("renderer", ""))
    return next((name for name, pattern in CLASSES if re.search(pattern, renderer, re.IGNORECASE)), None)


def classes_of(image: Image, setting: str | None) -> tuple[str, ...]:
    """The classes of an image, the narrowest first. setting: "cpu" adds the vendor of the processor to images that it
    draws; another name is a class itself. Raises InputError for a name that files may not have.
    """
    renderer = renderer_class(image)
    classes = (renderer,) if renderer else ()
    if setting == "cpu":
        return (f"cpu-{processor_vendor()}", *classes) if renderer in (None, "llvmpipe") else classes
    if setting is not None and (not re.fullmatch("[a-z][a-z0-9-]*[a-z]", setting) or setting == PORTABLE):
        raise expected("class", "cpu, or small letters, digits and - that end in a letter", repr(setting))
    return (setting, *classes) if setting else classes


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

    test: its id on pytest's command line. folder: of its baselines. default_name: of baselines. mode: of the baselines
    to write: update, class, add, or "". cases: collects the comparisons. options: of the project.
    """

    test: str
    file: Path
    folder: Path
    default_name: str
    mode: str
    cases: list[Case]
    report: bool = False
    options: CompareOptions = field(default_factory=CompareOptions)
    used: set[str] = field(default_factory=set)

    def __call__(
        self,
        image: Any,
        name: str | None = None,
        tolerance: Tolerance | float | None = None,
        bits: int | None = 8,
        mask: np.ndarray | None = None,
        **options: Any,
    ) -> None:
        """Fails the test if `image` differs from all of its baselines, or has none.

        image: see `as_image`; or an image file, of which each page or frame has a baseline. name: of the baseline; the
        test's own if None. tolerance: the largest difference of a channel, or a `Tolerance`; None allows what the
        project's options allow, by default rounding to 8 bits. bits: 8 or 16 for a PNG, None for a .npy of floats;
        `image` is rounded accordingly before the comparison. mask: [H, W], the pixels to compare. options: further
        options, as on the command line of `splatgl compare`: noise, max_rmse, ignore, antialiased, align, class_, ….
        """
        __tracebackhide__ = True
        failures = []
        try:
            keywords = {key.rstrip("_"): value for key, value in options.items()}
            stated = self.options.changed({"tolerance": tolerance, **keywords})
            criteria = stated.resolve()
            if mask is not None:
                counts = np.asarray(mask, bool)
                criteria = replace(criteria, mask=counts if criteria.mask is None else counts & criteria.mask)
            pictures = list(as_images(image))
            for number, picture in enumerate(pictures, 1):
                stem = self._stem(name, number if len(pictures) > 1 else 0)
                suffix = ".png" if bits else ".npy"
                baselines = Baselines(self.folder, stem, classes_of(picture, stated.baseline_class), suffix)
                failures += [self._outcome(picture, baselines, criteria, bits)]
            if len(pictures) > 1 and not self.mode:
                failures += [self._surplus(name, len(pictures))]
        except InputError as error:
            self._keep(Case(f"{self.test}: {name or self.default_name}", "unusable", str(error)))
            failures += [str(error)]
        if any(failures):
            pytest.fail("\n".join(filter(None, failures)), pytrace=False)

    def _stem(self, name: str | None, number: int) -> str:
        """File stem of a baseline; a test's second unnamed image gets the suffix -2, and so on. number: of a frame."""
        stem = file_stem(f"{name or self.default_name}[{number}]" if number else name or self.default_name)
        if name is None and stem in self.used:
            stem = next(f"{stem}-{i}" for i in range(2, len(self.used) + 3) if f"{stem}-{i}" not in self.used)
        self.used.add(stem)
        return stem

    def _surplus(self, name: str | None, count: int) -> str:
        """The failure message for a baseline beyond the last frame; "" for none."""
        next_one = Baselines(self.folder, file_stem(f"{name or self.default_name}[{count + 1}]"))
        more = [path for path in (next_one.portable, next_one.portable.with_suffix(".npy")) if path.is_file()]
        return f"{name or self.default_name} has {count} frames, but {relative_path(more[0])} is there" if more else ""

    def _outcome(self, picture: Image, baselines: Baselines, criteria: Criteria, bits: int | None) -> str:
        """The failure message; "" for success."""
        title = f"{self.test}: {baselines.stem}"
        baselines.check_case()
        paths = baselines.valid()
        outcomes = [self._compare(picture, path, criteria) for path in paths]
        match = next((verdict for verdict, _ in outcomes if verdict is not None and verdict.same), None)
        if match is not None:
            self._keep(Case(title, "same", match.line), baselines)
            return ""
        if self.mode:
            targets = {"add": baselines.fresh, "class": lambda: baselines.of_class, "update": baselines.current}
            return self._write(title, picture, baselines, targets[self.mode](), bits)
        if not paths:
            return self._missing(title, picture, baselines)
        return self._different(title, outcomes, baselines)

    def _compare(self, picture: Image, path: Path, criteria: Criteria) -> tuple[Verdict | None, Case]:
        """Verdict and case for one baseline; no verdict if it cannot be compared."""
        try:
            baseline = Picture(relative_path(path), read(path).image)
            pair = Pair.of(Picture(path.stem, picture), baseline, criteria)
            verdict = pair.judge(criteria)
        except InputError as error:
            html = image_html(picture) if self.report else ""
            return None, Case(path.stem, "unusable", str(error), html)
        html = pair_html(verdict, pair) if self.report and not verdict.same else ""
        return verdict, Case(path.stem, verdict.state, verdict.line, html)

    def _write(self, title: str, picture: Image, baselines: Baselines, target: Path, bits: int | None) -> str:
        if not np.isfinite(picture.pixels).all():
            raise expected(title, "finite numbers to write as a baseline", "NaN or infinity")
        target.parent.mkdir(parents=True, exist_ok=True)
        picture.save(target, bits or 8)
        self._keep(Case(title, "same", f"written to {relative_path(target)}"), baselines, relative_path(target))
        return ""

    def _missing(self, title: str, picture: Image, baselines: Baselines) -> str:
        others = ", ".join(path.name for path in baselines.others())
        whose = f" for {' or '.join(baselines.keys) or 'any renderer'}, only {others}" if others else ""
        line = f"no baseline{whose}: expected {relative_path(baselines.portable)}"
        self._keep(Case(title, "missing", line, image_html(picture) if self.report else ""), baselines)
        look, update = self._advice()
        return f"{line}\n  look at the picture: {look}\n  then make it with: {update}"

    def _different(self, title: str, outcomes: list[tuple[Verdict | None, Case]], baselines: Baselines) -> str:
        """Failure message, from the nearest baseline."""
        verdict, nearest = min(outcomes, key=lambda pair: np.inf if pair[0] is None else pair[0].comparison.rmse)
        self._keep(replace(nearest, name=title), baselines)
        which = f", the nearest of {len(outcomes)}" if len(outcomes) > 1 else ""
        lines = [nearest.line]
        if verdict is not None:
            lines = [
                f"{baselines.stem} differs: {verdict.what}",
                *([f"where: {verdict.place}", f"limits: {verdict.broken}"] if verdict.kind else []),
                f"baseline: {verdict.against}{which}",
            ]
        look, update = self._advice()
        return "\n  ".join([*lines, f"look at it: {look}", f"if it is right: {update}"])

    def _advice(self) -> tuple[str, str]:
        """(place or command that shows the picture, command that writes the baseline), for messages."""
        command = f"pytest {shlex.quote(self.test)}"
        return "in the report" if self.report else f"{command} --splatgl-report DIR", f"{command} --splatgl-update"

    def _keep(self, case: Case, baselines: Baselines | None = None, written: str = "") -> None:
        """Collects a case. baselines, written: see `Case`."""
        accept = self._advice()[1] if case.state != "same" else ""
        place = {"folder": str(baselines.folder), "stem": baselines.stem} if baselines else {}
        self.cases.append(replace(case, accept=accept, written=written, test_file=str(self.file), **place))


def list_unused(cases: Sequence[Case], incomplete: Collection[Path]) -> list[str]:
    """Baselines that no test compares, and those of files that are gone. incomplete: test files not run in whole."""
    placed = [case for case in cases if case.stem]
    stems = {(Path(case.folder), case.stem) for case in placed}
    unused = []
    for folder, source in sorted({(Path(case.folder), Path(case.test_file)) for case in placed}):
        if source not in incomplete:
            unused += [path for path in _stored(folder) if (folder, path.name.partition(".")[0]) not in stems]
        for beside in sorted(path for path in folder.parent.iterdir() if path.is_dir()) if folder.is_dir() else []:
            if not (source.parent / f"{beside.name}.py").exists() and not (source.parent / beside.name).is_dir():
                unused += _stored(beside)
    return sorted({relative_path(path) for path in unused})


def _stored(folder: Path) -> list[Path]:
    return [path for path in folder.glob("*") if path.suffix in (".png", ".npy")]


def relative_path(path: Path) -> str:
    """The path, relative to the working folder if inside it."""
    return str(path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path)

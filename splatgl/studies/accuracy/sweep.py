"""Draws and times every method, and stores and loads the results."""

from __future__ import annotations

import json
import math
import random
import statistics
import time
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.comparison.compare import compare
from splatgl.data.image import Image
from splatgl.errors import InputError, expected
from splatgl.splat.settings import Settings
from splatgl.studies.accuracy.convergence import STUDIES
from splatgl.studies.accuracy.ground_truth import Level, Request, Subject, Truths
from splatgl.studies.accuracy.methods import TRUTHS, Method, axis_of, methods
from splatgl.studies.accuracy.pareto import Point, Timing
from splatgl.studies.accuracy.vtk_peers import Peer

if TYPE_CHECKING:
    from splatgl.gl.renderer import Renderer

# pixels above `p999`, per cent
WORST = 0.1


def errors(image: Image, truth: Image, flip: bool = False) -> dict[str, float | None]:
    """Errors of `image` against `truth`, both [H, W, 4], by name. Raises InputError as `compare`.

    rmse: of the differences, over the root mean square of the truth. maximum: of any channel; p999: exceeded by one
    pixel in a thousand; both relative to an X-ray's peak. share_over: of pixels off by more than 1/255. energy:
    (Σ − Σ_truth)/Σ_truth over all channels. flip: mean FLIP, None if not requested.
    """
    comparison = compare(image, truth, extra=("flip",) if flip else ())
    drawn, right = (np.asarray(part.pixels, np.float64) for part in (image, truth))
    worst = np.abs(drawn - right).max(axis=-1)
    scale = float(np.sqrt((right * right).mean()))
    return {
        "rmse": comparison.rmse / scale if scale else comparison.rmse,
        "maximum": comparison.maximum / comparison.peak,
        "p999": float(np.percentile(worst, 100 - WORST)) / comparison.peak,
        "share_over": comparison.share_over,
        "energy": comparison.sum_error,
        "flip": comparison.flip,
    }


@dataclass(frozen=True)
class Row:
    """One method on one scene. timing: None if not timed. errors: by truth and name."""

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

    def error(self, truth: str, name: str = "rmse") -> float | None:
        """Error of that name against that truth; None if not measured."""
        return self.errors.get(truth, {}).get(name)


@dataclass(frozen=True)
class SceneResults:
    """Rows of a scene, in the order of the registry. about: the scene's record in the store."""

    name: str
    about: dict[str, Any]
    rows: tuple[Row, ...]

    def row(self, method: str) -> Row | None:
        """Row of a method; None if there is none."""
        return next((row for row in self.rows if row.method == method), None)

    def timing(self, method: str) -> Timing | None:
        """Time of a method; None if not timed."""
        row = self.row(method)
        return row.timing if row else None

    def error(self, method: str, truth: str) -> float | None:
        """RMSE of a method against that truth; None if not measured."""
        row = self.row(method)
        return row.error(truth) if row else None

    def points(self, truth: str) -> list[Point]:
        """Methods with time and finite error, without those whose image is the same as another's."""
        return [
            Point(row.method, error, row.timing)
            for row in self.rows
            if (error := row.error(truth)) is not None and row.timing and not row.same_as and math.isfinite(error)
        ]

    @property
    def truths(self) -> list[str]:
        """Truths with errors of any method."""
        return [truth for truth in TRUTHS if any(truth in row.errors for row in self.rows)]


@dataclass(frozen=True)
class Results:
    """All results: values of the head, scenes, and records of convergence."""

    head: dict[str, Any]
    scenes: tuple[SceneResults, ...]
    convergence: tuple[dict[str, Any], ...]

    @classmethod
    def of(cls, store: Store) -> Results:
        """Results of a store."""
        scenes = tuple(_scene(store, line) for line in store.of("scene"))
        return cls(store.of("head")[0], scenes, tuple(store.of("convergence")))

    @property
    def flip(self) -> bool:
        """Whether FLIP was measured."""
        return any(row.error("sampled", "flip") is not None for scene in self.scenes for row in scene.rows)


def _scene(store: Store, about: dict[str, Any]) -> SceneResults:
    name, rows = about["scene"], []
    for line in store.of("picture", scene=name):
        # identical images share their timing
        times = store.of("time", scene=name, method=line["same_as"] or line["method"])
        timing = Timing.of({time["round"]: time["seconds"] for time in times}) if times else None
        values = {column.name: line[column.name] for column in fields(Row) if column.name in line}
        rows.append(Row(timing=timing, **values))
    return SceneResults(name, about, tuple(rows))


NAME = "runs.jsonl"
# kinds of records, and their keys
KINDS: dict[str, set[str]] = {
    "head": set(),
    "scene": {"scene", "mark", "splats", "size", "note"},
    "picture": {"scene", "axis", "method", "same_as", "omitted"},
    "time": {"scene", "method", "round", "seconds"},
    "convergence": {"study", "unit", "expected", "floor", "values", "errors", "orders"},
}


class Store:
    """Records of a report, appended to a JSON Lines file. lines: all records in order."""

    def __init__(self, path: Path, head: Mapping[str, Any], resume: bool = False) -> None:
        """Starts or resumes a store. Raises InputError to resume another report."""
        self.path = path
        self.lines: list[dict[str, Any]] = list(_read(path)) if resume and path.exists() else []
        for name, value in {"kind": "head", **head}.items() if self.lines else ():
            old = self.lines[0].get(name)
            if old != value:
                fix = "leave out --resume to begin anew"
                raise expected(f"{path} --resume", f"{name} {value!r}", repr(old), fix)
        # without a truncated line
        self._write("w", self.lines)
        if not self.lines:
            self.add("head", **head)

    def add(self, kind: str, **values: Any) -> dict[str, Any]:
        """Writes a record, and returns it."""
        line = {"kind": kind, **values}
        self.lines.append(line)
        self._write("a", [line])
        return line

    def _write(self, mode: str, lines: Sequence[Mapping[str, Any]]) -> None:
        try:
            with self.path.open(mode, encoding="utf-8") as file:
                file.writelines(f"{json.dumps(line, ensure_ascii=False)}\n" for line in lines)
        except OSError as error:
            raise InputError(f"{self.path}: cannot be written: {error.strerror or error}") from error

    def of(self, kind: str, **values: Any) -> list[dict[str, Any]]:
        """Records of that kind with those values."""
        return [
            line
            for line in self.lines
            if line["kind"] == kind and all(line.get(name) == value for name, value in values.items())
        ]


def _read(path: Path) -> Iterator[dict[str, Any]]:
    """Complete records of a file. Raises InputError if it is not a report."""
    for number, text in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), start=1):
        try:
            line = json.loads(text)
        except ValueError:
            # only the last line can be truncated
            return
        kind = line.get("kind") if isinstance(line, dict) else None
        if kind not in KINDS or not line.keys() >= KINDS[kind] or (number == 1) != (kind == "head"):
            raise expected(f"{path} line {number}", "a line of a report", text[:60], "leave out --resume to begin anew")
        yield line


# seed of the random order, fixed for all runs
SEED = 1998
# seconds in total after which a method is timed no more than LEAST_ROUNDS times
LONGEST, LEAST_ROUNDS = 20.0, 3
# a turn has as many frames as fit into TURN seconds, from 1 to FRAMES
TURN, FRAMES = 0.04, 5
# FLIP is measured against this truth
FLIP_TRUTH = "sampled"
# recorded properties of a rendering
DRAWN = ("align", "antialias", "footprint", "samples", "attenuation", "target")

# progress callback, called once per step
Tick = Callable[[str], None]


def select_methods(level: Level, only: tuple[str, ...] = (), peers: bool = False) -> list[Method]:
    """Methods of a report at a level. only: names of methods or axes, all if empty; peers: with VTK."""
    known = [method for method in methods().values() if method.quick or level.all_methods or only]
    named = [m for m in known if not only or m.name in only or axis_of(m.name).name in only]
    return [m for m in known if (m.peer and peers) or (m in named and (not m.peer or only))]


class Sweep:
    """Records images and times of a scene in a store. flip: whether FLIP is measured."""

    def __init__(self, renderer: Renderer, subject: Subject, truths: Truths, store: Store, flip: bool) -> None:
        self.renderer, self.subject, self.truths, self.store, self.flip = renderer, subject, truths, store, flip
        self.plans: dict[tuple[Hashable, int], str] = {}
        self.peers: dict[str, Peer] = {}

    def pictures(self, requested: list[Method], tick: Tick) -> None:
        """Draws each method once, and measures its errors."""
        for method in requested:
            tick(f"{self.subject.name}: {method.name}")
            done = self.store.of("picture", scene=self.subject.name, method=method.name)
            if done and not (done[0]["same_as"] or done[0]["omitted"] or method.peer):
                # already drawn: other methods may turn out to be identical
                splats, settings = self.subject.inputs(method)
                plan = self.renderer.plan(splats, self.subject.camera, settings)
                self.plans.setdefault((plan.key, id(splats)), method.name)
            if not done:
                line = {"axis": axis_of(method.name).name, "method": method.name, "same_as": "", "omitted": ""}
                try:
                    line |= self._peer_picture(method) if method.peer else self._picture(method)
                except InputError as error:
                    line["omitted"] = str(error)
                self.store.add("picture", scene=self.subject.name, **line)

    def _picture(self, method: Method) -> dict[str, Any]:
        """Record of a method. Raises InputError if the scene does not allow it."""
        splats, settings = self.subject.inputs(method)
        plan = self.renderer.plan(splats, self.subject.camera, settings)
        if not len(splats):
            raise InputError("no splat is left")
        # equal plans give equal images
        first = self.plans.setdefault((plan.key, id(splats)), method.name)
        image = self.renderer.render(splats, self.subject.camera, settings)
        return {
            "same_as": "" if first == method.name else first,
            "splats": len(splats),
            "extraction": round(self.subject.seconds[id(splats)], 6),
            "tolerance": settings.tolerance,
            "bound": image.info["error_bound"],
            "drawn": {name: image.info[name] for name in DRAWN} | {"technique": plan.program.technique},
            **self._measure(image, settings, method),
        }

    def _peer_picture(self, method: Method) -> dict[str, Any]:
        """Record of a method of a peer. Raises InputError if the peer cannot draw the scene."""
        return self._measure(self._peer(method).frame()[0], self.subject.settings, method)

    def _peer(self, method: Method) -> Peer:
        if method.name not in self.peers:
            if self.subject.content is None:
                raise expected("peers", "a volume", "splats alone")
            settings = self.subject.settings.but(**method.changes)
            self.peers[method.name] = Peer(method.peer, self.subject.content, self.subject.camera, settings)
        return self.peers[method.name]

    def close(self) -> None:
        """Ends the peers' processes."""
        for peer in self.peers.values():
            peer.close()
        self.peers.clear()

    def _measure(self, image: Image, settings: Settings, method: Method) -> dict[str, Any]:
        """Errors against the method's truths, and reasons for missing ones."""
        measured, missing = {}, {}
        for truth in axis_of(method.name).measured:
            # a missing field is recorded with the scene
            if truth == "field" and self.subject.no_field:
                continue
            # an image classified after reconstruction has no truth of splats
            if truth != "field" and image.info.get("classification") == "post":
                continue
            try:
                flip = self.flip and truth == FLIP_TRUTH
                measured[truth] = errors(image, self.truths.get(truth, settings), flip)
            except InputError as error:
                missing[truth] = str(error)
        return {"errors": measured, "missing": missing}

    def times(self, requested: list[Method], rounds: int, tick: Tick) -> None:
        """Times every method with a distinct image once per round, in random order.

        Load on the machine thus affects all methods alike, and they can be compared round by round.
        """
        named = {method.name: method for method in requested}
        distinct = [
            line["method"]
            for line in self.store.of("picture", scene=self.subject.name, same_as="", omitted="")
            if line["method"] in named
        ]
        done = self.store.of("time", scene=self.subject.name)
        spent = {name: sum(line["seconds"] for line in done if line["method"] == name) for name in distinct}
        finished = {(line["method"], line["round"]) for line in done}
        shuffled = random.Random(SEED)
        for turn in range(rounds):
            for name in shuffled.sample(distinct, len(distinct)):
                tick(f"{self.subject.name}: timing")
                if (name, turn) in finished or (spent[name] > LONGEST and turn >= LEAST_ROUNDS):
                    continue
                seconds = self.turn(named[name])
                spent[name] += seconds
                self.store.add("time", scene=self.subject.name, method=name, round=turn, seconds=round(seconds, 6))

    def turn(self, method: Method) -> float:
        """Seconds per frame after a warm-up frame: median of a turn."""
        self.frame(method)
        first = self.frame(method)
        count = min(FRAMES, int(TURN / first))
        # an odd number, so that the median is a measured time
        return statistics.median([first, *(self.frame(method) for _ in range(2 * ((count - 1) // 2)))])

    def frame(self, method: Method) -> float:
        """Seconds of a frame with its pixels read back."""
        if method.peer:
            return self._peer(method).frame()[1]
        splats, settings = self.subject.inputs(method)
        started = time.perf_counter()
        self.renderer.render(splats, self.subject.camera, settings, verify_bound=False)
        return time.perf_counter() - started


@dataclass(frozen=True)
class Task:
    """Task of a report. only: names of methods or axes, all if empty. peers: with VTK. flip: with FLIP."""

    level: Level
    only: tuple[str, ...] = ()
    peers: bool = False
    flip: bool = False
    folder: Path | None = None

    @property
    def methods(self) -> list[Method]:
        """Methods of the report."""
        return select_methods(self.level, self.only, self.peers)

    def steps(self, scenes: int) -> int:
        """Number of progress steps of `run_task`."""
        return scenes * len(self.methods) * (1 + self.level.rounds) + len(STUDIES)


def truths_of(truths: Truths, task: Task) -> list[Request]:
    """Distinct truths of a scene that a report needs."""
    subject, requests = truths.subject, dict[str, Request]()
    for method in task.methods:
        for kind in axis_of(method.name).measured:
            # a missing truth is recorded when the method is measured
            with suppress(InputError):
                settings = subject.settings if method.peer else subject.inputs(method)[1]
                request = truths.request(kind, settings)
                requests.setdefault(request[0], request)
    return list(requests.values())


def run_task(renderer: Renderer, subjects: Sequence[Subject], task: Task, store: Store, tick: Tick) -> None:
    """Measures everything that is not in the store."""
    for subject in subjects:
        known = store.of("scene", scene=subject.name)
        if known and known[0]["mark"] != subject.mark():
            raise expected(f"{subject.name} --resume", "the scene as it was", "another", "leave out --resume")
        if not known:
            splats = subject.splats()
            about = {"splats": len(splats), "size": list(subject.camera.size), "note": subject.note}
            about |= {"no_field": subject.no_field, "formula": subject.formula is not None}
            store.add("scene", scene=subject.name, mark=subject.mark(), **about)
        truths = Truths(renderer, subject, task.level, task.folder)
        sweep = Sweep(renderer, subject, truths, store, task.flip)
        with closing(sweep):
            sweep.pictures(task.methods, tick)
            sweep.times(task.methods, task.level.rounds, tick)
    for study in STUDIES:
        tick(f"convergence: {study.name}")
        if not store.of("convergence", study=study.name):
            store.add("convergence", **study.line(renderer, task.level))

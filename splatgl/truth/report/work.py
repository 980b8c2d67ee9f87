"""Runs a report in order: for each scene, images and errors, then times; convergence last."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path

from splatgl.errors import InputError, expected
from splatgl.reference.renderer import Planner
from splatgl.truth.report.convergence import STUDIES
from splatgl.truth.report.methods import axis_of
from splatgl.truth.report.store import Store
from splatgl.truth.report.subject import Level, Subject
from splatgl.truth.report.sweep import Sweep, Tick, chosen
from splatgl.truth.report.truths import Truths, Wanted


@dataclass(frozen=True)
class Task:
    """A report request. only: names of methods or axes, all if empty. peers: VTK too. flip: FLIP too."""

    level: Level
    only: tuple[str, ...] = ()
    peers: bool = False
    flip: bool = False
    folder: Path | None = None

    def steps(self, scenes: int) -> int:
        """Number of progress steps of `work`."""
        count = len(chosen(self.level, self.only, self.peers))
        return scenes * count * (1 + self.level.rounds) + len(STUDIES)


def truths_of(truths: Truths, task: Task) -> list[Wanted]:
    """The different truths of one scene that a report measures against."""
    subject, found = truths.subject, dict[str, Wanted]()
    for method in chosen(task.level, task.only, task.peers):
        for kind in axis_of(method.name).measured:
            # what has no truth is told when it is measured
            with suppress(InputError):
                settings = subject.settings if method.peer else subject.drawn(method)[1]
                wanted = truths.wanted(kind, settings)
                found.setdefault(wanted[0], wanted)
    return list(found.values())


def work(renderer: Planner, subjects: Sequence[Subject], task: Task, store: Store, tick: Tick) -> None:
    """Measures everything not in the store yet."""
    wanted = chosen(task.level, task.only, task.peers)
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
            sweep.pictures(wanted, tick)
            sweep.times(wanted, task.level.rounds, tick)
    for study in STUDIES:
        tick(f"convergence: {study.name}")
        if not store.of("convergence", study=study.name):
            store.add("convergence", **study.line(renderer, task.level))

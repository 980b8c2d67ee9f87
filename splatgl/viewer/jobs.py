"""The worker thread of a window, and its extraction jobs."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from enum import Enum, auto
from typing import Any, TypeVar

import numpy as np

from splatgl.errors import USER_ERRORS, error_text
from splatgl.splat.extract import Progress
from splatgl.splat.splats import checked
from splatgl.viewer.adaptive_quality import STRIDES
from splatgl.viewer.document import Document
from splatgl.viewer.layer_splats import LayerSplats

# most voxels of a stride that is extracted while a transfer function is edited: some 0.1 s
QUICK = 1 << 19
# seconds per voxel of an extraction that is not measured yet; share of its time after which progress slows down
PACE, SURE = 1e-6, 0.7
# how much other processes yield to the window
NICE = 10

T = TypeVar("T")


class JobKind(Enum):
    """Kinds of jobs."""

    OPEN = auto()
    RELOAD = auto()
    REFINE = auto()
    TIME_POINT = auto()
    ADD = auto()
    EXTRACT = auto()
    SLICE = auto()
    REFERENCE = auto()
    PICK = auto()


class JobCancelled(Exception):
    """The result of a job is no longer needed."""


@dataclass(frozen=True)
class FinishedJob:
    """A finished job, and its value or the error it raised."""

    kind: JobKind
    value: Any = None
    error: BaseException | None = None


class Jobs:
    """Runs jobs in a worker thread, which calls `wake` after each one.

    The thread is a daemon: closing the window does not wait for a large file, as an executor of `concurrent.futures`
    would.
    """

    def __init__(self, wake: Callable[[], None]) -> None:
        self.wake = wake
        self.lock = threading.Lock()
        # jobs by kind and key, the newest last
        self.waiting: dict[tuple[JobKind, str], tuple[str, Callable[[], Any]]] = {}
        self.running: tuple[JobKind, str] | None = None
        self.done: list[FinishedJob] = []
        self.thread: threading.Thread | None = None

    @property
    def all(self) -> list[tuple[JobKind, str]]:
        """Kind and name of the running job, then of the waiting jobs in their order."""
        with self.lock:
            waiting = [(kind, name) for (kind, _), (name, _) in self.waiting.items()]
            return [*([self.running] if self.running else []), *waiting]

    @property
    def busy(self) -> str | None:
        """Name of the job that waits last, or else the running one; None if idle."""
        jobs = self.all
        return jobs[-1][1] if jobs else None

    def submit(self, kind: JobKind, name: str, work: Callable[[], Any], key: str = "") -> None:
        """Runs `work` after the waiting jobs; a newer job of the same kind and key replaces it before it starts."""
        with self.lock:
            self.waiting.pop((kind, key), None)
            self.waiting[kind, key] = (name, work)
            if self.thread is None:
                self.thread = threading.Thread(target=self._run, name="splatgl-view", daemon=True)
                self.thread.start()

    def wait(self, seconds: float) -> bool:
        """Waits for all jobs, at most so long; returns whether they have ended."""
        thread = self.thread
        if thread is not None:
            thread.join(seconds)
        return self.busy is None

    def collect(self) -> list[FinishedJob]:
        """Jobs finished since the last call."""
        with self.lock:
            done, self.done = self.done, []
        return done

    def _run(self) -> None:
        while True:
            with self.lock:
                if not self.waiting:
                    self.running = self.thread = None
                    return
                kind, key = next(iter(self.waiting))
                name, work = self.waiting.pop((kind, key))
                self.running = kind, name
            try:
                done = FinishedJob(kind, work())
            except BaseException as error:  # the window's thread shows or raises it
                done = FinishedJob(kind, error=error)
            with self.lock:
                # at once, so that the job has ended when it is collected
                self.done.append(done)
                self.running = None
            self.wake()


@dataclass(frozen=True)
class ExtractedPart:
    """A layer at a stride that is being extracted, from `begin` to `end` of all work: since when, its voxels, seconds
    per voxel at the stride before, if known, and the share of it that is done for certain.
    """

    begin: float = 0.0
    end: float = 0.0
    begun: float = 0.0
    voxels: int = 0
    pace: float | None = None
    done: float = 0.0

    def share(self, now: float) -> float:
        """The share of all work that is done, by the time that this part takes at the pace of the one before."""
        passed = (now - self.begun) / max(self.voxels * (self.pace or PACE), 1e-3)
        # ever slower towards the end, but it never stands still
        expected = passed if passed < SURE else 1 - (1 - SURE) ** 2 / (passed + 1 - 2 * SURE)
        return self.begin + (self.end - self.begin) * max(self.done, expected)


class Extractor:
    """Extracts missing splats of a document."""

    def __init__(self, wake: Callable[[], None]) -> None:
        self.jobs = Jobs(wake)
        self.wanted: Document | None = None
        # the document whose extraction failed, and why: it is not tried again
        self.failed: Document | None = None
        self.why = ""
        # the part of the running job that is being extracted
        self.part = ExtractedPart()

    @property
    def busy(self) -> str | None:
        """The work that is being done, with its progress; None if nothing is."""
        return f"extracting {self.part.share(time.monotonic()):.0%}" if self.jobs.busy else None

    def request(self, document: Document, resting: bool) -> None:
        """Extracts the missing strides of a document; while its values are being edited, only quick ones."""
        if not _same_layers(self.wanted, document):
            self.wanted = document
        elif self.jobs.busy or self.has_failed(document):
            return
        counts = [
            sum(volume.count for volume in volumes)
            for volumes in zip(*(layer.volumes for layer in document.drawn_layers), strict=True)
        ]
        missing = [stride for stride in reversed(STRIDES) if stride not in document.extracted]
        quick = [stride for stride in missing if counts[STRIDES.index(stride)] <= QUICK]
        due = missing if resting else quick or missing[: not document.extracted]
        if due:
            self.jobs.submit(JobKind.EXTRACT, "extracting", lambda: self._extract(document, due))

    def has_failed(self, document: Document) -> bool:
        """Whether the extraction of a document failed."""
        return _same_layers(self.failed, document)

    def collect(self) -> list[FinishedJob]:
        """Finished jobs, without cancelled ones."""
        return [done for done in self.jobs.collect() if not isinstance(done.error, JobCancelled)]

    def _extract(self, document: Document, strides: list[int]) -> None:
        strides = [stride for stride in strides if stride > 1 or not document.exceeds_budget]
        counts = [layer.volumes[STRIDES.index(stride)].count for stride in strides for layer in document.drawn_layers]
        begins = iter((np.cumsum([0, *counts]) / max(sum(counts), 1)).tolist())
        self.part = ExtractedPart(end=next(begins), begun=time.monotonic())
        # seconds per voxel of every layer at the stride before
        paces: dict[LayerSplats, float] = {}

        def check() -> None:
            if not _same_layers(self.wanted, document):
                raise JobCancelled

        def of_layer(layer: LayerSplats) -> Progress:
            ends, now = (self.part.end, next(begins)), time.monotonic()
            self.part = ExtractedPart(*ends, now, counts.pop(0), paces.get(layer))

            def progress(parts: Iterator[T], count: int) -> Iterator[T]:
                for number, part in enumerate(parts):
                    check()
                    self.part = replace(self.part, done=number / max(count, 1))
                    yield part

            return progress

        def extracted(layer: LayerSplats) -> None:
            pace = (time.monotonic() - self.part.begun) / max(self.part.voxels, 1)
            paces[layer] = max(pace, PACE / 10)

        for stride in strides:
            try:
                with checked(check):
                    document.extract(stride, of_layer, extracted)
            except USER_ERRORS as error:
                self.failed, self.why = document, error_text(error)
                raise
            self.jobs.wake()


def _same_layers(a: Document | None, b: Document) -> bool:
    return a is not None and a.drawn_layers == b.drawn_layers

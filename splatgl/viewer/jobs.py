"""The worker thread of a window, and its extraction jobs."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from splatgl.errors import USER_ERRORS, error_text
from splatgl.viewer.adaptive_quality import REST, STRIDES
from splatgl.viewer.document import Document

if TYPE_CHECKING:
    from splatgl.viewer.viewer import Viewer


# voxels of a stride that are extracted while a transfer function is being edited: some 0.1 s
QUICK = 1 << 19
EXTRACTING = "extracting"

T = TypeVar("T")


class Extractor:
    """Extracts what is wanted. share: of the parts of the stride that is being extracted."""

    def __init__(self, wake: Callable[[], None]) -> None:
        self.jobs = Jobs(wake)
        self.wanted: Document | None = None
        # the document whose extraction failed, and why: it is not tried again
        self.failed: Document | None = None
        self.why = ""
        self.share = 0.0

    @property
    def busy(self) -> str | None:
        """What is being done, with its progress; None if nothing is."""
        return f"extracting {self.share:.0%}" if self.jobs.busy else None

    def want(self, document: Document, resting: bool) -> None:
        """Extracts the missing strides of a document; while its values are being edited, only quick ones."""
        if self.wanted is not document:
            self.wanted = document
        elif self.jobs.busy or self.failed is document:
            return
        missing = [stride for stride in reversed(STRIDES) if stride not in document.extracted]
        quick = [stride for stride in missing if document.voxels(stride) <= QUICK]
        due = missing if resting else quick or missing[: not document.extracted]
        if due:
            self.jobs.submit(EXTRACTING, lambda: self._extract(document, due))

    def collect(self) -> list[Done]:
        """Finished jobs; those that were given up are none."""
        return [done for done in self.jobs.collect() if not isinstance(done.error, Cancelled)]

    def _extract(self, document: Document, strides: list[int]) -> None:
        for stride in strides:
            if stride == 1 and document.heavy:
                return
            self.share = 0.0

            def parts(given: Iterator[T], count: int) -> Iterator[T]:
                for number, part in enumerate(given):
                    if self.wanted is not document:
                        raise Cancelled
                    self.share = number / max(count, 1)
                    yield part

            try:
                document.extract(stride, parts)
            except USER_ERRORS as error:
                self.failed, self.why = document, error_text(error)
                raise
            self.jobs.wake()


def followed(viewer: Viewer, blurs: bool) -> None:
    """Takes the document that a viewer's state asks for once its coarsest splats are there; the finer ones follow at
    rest. Until then the picture is that of the document before.
    """
    state, extractor = viewer.state, viewer.extractor
    if viewer.coming is not None:
        if viewer.coming.extracted:
            viewer.take(viewer.coming)
        elif viewer.coming is not extractor.failed:
            extractor.want(viewer.coming, False)
            return
    asked = viewer.coming or viewer.document
    document = asked.followed(state.looks, state.meshes, state.moving, blurs)
    if document is viewer.coming:
        # it failed, until something else is asked for; the picture is another one, which no key hides
        if not state.message:
            viewer.say(extractor.why, EXTRACTING)
        return
    if document is not viewer.document and not document.extracted:
        viewer.coming = document
        extractor.want(document, False)
        return
    if document is not viewer.document or viewer.coming is not None:
        viewer.take(document)
    moving = document.classified(state.moving, True)
    waiting = [each for each in (document, moving) if not each.complete]
    if waiting:
        extractor.want(waiting[0], viewer.now() - viewer.hands.touched >= REST)
    _weighed(viewer, document)


def _weighed(viewer: Viewer, document: Document) -> None:
    """Says where the splats of what is shown are too many to be drawn, as long as they are."""
    if document.heavy and document.extracted[0] == 2 and not viewer.state.message:
        count = sum(8 * len(part.at(2)) for part in document.drawing if part.heavy)
        viewer.say(f"some {count:,} splats: too many to draw all; make more of it transparent", "count")
    elif not document.heavy:
        viewer.over("count")


class Cancelled(Exception):
    """What a job makes is no longer wanted."""


@dataclass(frozen=True)
class Done:
    """A finished job's name and its result, or the error it raised."""

    name: str
    result: Any = None
    error: BaseException | None = None


class Jobs:
    """Runs jobs in a worker thread, which calls `wake` after each one."""

    def __init__(self, wake: Callable[[], None]) -> None:
        self.wake = wake
        self.lock = threading.Lock()
        # by kind, the newest last
        self.waiting: dict[str, tuple[str, Callable[[], Any]]] = {}
        self.running: str | None = None
        self.done: list[Done] = []
        self.thread: threading.Thread | None = None

    @property
    def busy(self) -> str | None:
        """Name of the job that waits last, or else the running one; None if idle."""
        names = self.names
        return names[-1] if names else None

    @property
    def names(self) -> list[str]:
        """Those of the running job and of the waiting ones, in their order."""
        with self.lock:
            return [*([self.running] if self.running else []), *(name for name, _ in self.waiting.values())]

    def submit(self, name: str, work: Callable[[], Any], kind: str = "") -> None:
        """Runs `work` after all that waits, unless a newer job of its kind replaces it first."""
        with self.lock:
            self.waiting.pop(kind, None)
            self.waiting[kind] = (name, work)
            if self.thread is None:
                # daemon: closing the window does not wait for a large file
                self.thread = threading.Thread(target=self._run, name="splatgl-view", daemon=True)
                self.thread.start()

    def settled(self, seconds: float) -> bool:
        """Waits for what is running, at most so long; whether it has ended."""
        thread = self.thread
        if thread is not None:
            thread.join(seconds)
        return self.busy is None

    def collect(self) -> list[Done]:
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
                name, work = self.waiting.pop(next(iter(self.waiting)))
                self.running = name
            try:
                done = Done(name, result=work())
            except BaseException as error:  # the window's thread says it, or raises it
                done = Done(name, error=error)
            with self.lock:
                # whoever collects it finds it ended
                self.done.append(done)
                self.running = None
            self.wake()

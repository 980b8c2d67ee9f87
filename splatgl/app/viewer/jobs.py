"""Background jobs: one worker thread and a queue, where a new job replaces a waiting one of its kind."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


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

"""Background jobs: one worker thread and a queue of length one, where a new job replaces the waiting one."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


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
        self.waiting: tuple[str, Callable[[], Any]] | None = None
        self.running: str | None = None
        self.done: list[Done] = []
        self.thread: threading.Thread | None = None

    @property
    def busy(self) -> str | None:
        """Name of the waiting or else the running job; None if idle."""
        with self.lock:
            return self.waiting[0] if self.waiting else self.running

    def submit(self, name: str, work: Callable[[], Any]) -> None:
        """Runs `work` once the thread is free, unless a newer job replaces it first."""
        with self.lock:
            self.waiting = (name, work)
            if self.running is None:
                self.running = name
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
                if self.waiting is None:
                    self.running = None
                    return
                (name, work), self.waiting = self.waiting, None
                self.running = name
            try:
                done = Done(name, result=work())
            except BaseException as error:  # the window's thread says it, or raises it
                done = Done(name, error=error)
            with self.lock:
                self.done.append(done)
            self.wake()

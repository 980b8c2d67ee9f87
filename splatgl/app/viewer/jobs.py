"""Work beside the window: one thread, of waiting jobs only the newest."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Done:
    """A job's name and what came of it: a result, or the error it raised."""

    name: str
    result: Any = None
    error: BaseException | None = None


class Jobs:
    """Runs jobs in a thread; `wake` is called from there when one is done."""

    def __init__(self, wake: Callable[[], None]) -> None:
        self.wake = wake
        self.lock = threading.Lock()
        self.waiting: tuple[str, Callable[[], Any]] | None = None
        self.running: str | None = None
        self.done: list[Done] = []

    @property
    def busy(self) -> str | None:
        """The name of what runs or waits, None if nothing does."""
        with self.lock:
            return self.waiting[0] if self.waiting else self.running

    def submit(self, name: str, work: Callable[[], Any]) -> None:
        """Runs `work` when the thread is free, unless a newer job comes before that."""
        with self.lock:
            self.waiting = (name, work)
            if self.running is None:
                self.running = name
                # a daemon: closing the window does not wait for a big file
                threading.Thread(target=self._run, name="splatgl-view", daemon=True).start()

    def collect(self) -> list[Done]:
        """What was finished since the last call."""
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

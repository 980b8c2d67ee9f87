"""Draws snapshots of napari in a process of its own, beside napari's window: previews first, then the picture.

The process reads jobs from its input and writes answers to its output, as pickles. Python's lock and OpenGL's context
of the window's process stay free.
"""

from __future__ import annotations

import os
import pickle
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from copy import copy
from dataclasses import dataclass, replace
from queue import SimpleQueue
from typing import IO, Any

import numpy as np

from splatgl.data.image import Image
from splatgl.errors import USER_ERRORS, InputError, error_text
from splatgl.gl.target import Interrupted
from splatgl.integrations.napari.draw import draw_snapshot
from splatgl.integrations.napari.snapshot import Snapshot, take
from splatgl.scene.shared_renderer import shared_renderer
from splatgl.splat.scene import Scene

# most voxels of all layers, and pixels, of the previews: the first takes some 0.1 s, the second some tenths
PREVIEWS = ((2**15, 2**15), (2**18, 2**17))
# seconds that a cancelled picture may still take before its process is ended
PATIENCE = 0.5
# by how much its process stands back behind others that want the processor, on POSIX
NICE = 5
_LENGTH = struct.Struct("<Q")


@dataclass(frozen=True)
class Answer:
    """Message of a worker on a job. state: preview, done, cancelled or error. image: the picture so far, and its
    samples, uint8 [H, W, 3], sRGB. share: of the whole work, estimated; seconds: so far.
    """

    job: int
    state: str
    image: Image | None = None
    rgb: np.ndarray | None = None
    text: str = ""
    share: float = 0.0
    seconds: float = 0.0


def write(stream: IO[bytes], value: Any) -> None:
    """Writes a pickle, with its arrays after it, which are not copied."""
    buffers: list[pickle.PickleBuffer] = []
    head = pickle.dumps(value, protocol=5, buffer_callback=buffers.append)
    parts = [memoryview(head), *(buffer.raw() for buffer in buffers)]
    stream.write(_LENGTH.pack(len(parts)))
    for part in parts:
        stream.write(_LENGTH.pack(part.nbytes))
        stream.write(part)
    stream.flush()


def read(stream: IO[bytes]) -> Any:
    """Reads what `write` wrote. Raises EOFError at the end."""
    (count,) = _LENGTH.unpack(_exactly(stream, _LENGTH.size))
    head, *buffers = [_exactly(stream, _LENGTH.unpack(_exactly(stream, _LENGTH.size))[0]) for _ in range(count)]
    return pickle.loads(head, buffers=buffers)


def _exactly(stream: IO[bytes], count: int) -> bytearray:
    data = bytearray(count)
    view, done = memoryview(data), 0
    while done < count:
        got = stream.readinto(view[done:])  # type: ignore[attr-defined]
        if not got:
            raise EOFError
        done += got
    return data


def levels(snapshot: Snapshot) -> Iterator[Snapshot]:
    """The snapshot at the levels that are drawn: previews that are much cheaper than the picture, and the picture."""
    voxels = sum(layer.data.size for layer in snapshot.layers if layer.data is not None and layer.visible)
    width, height = snapshot.size
    for most_voxels, most_pixels in PREVIEWS:
        stride = 1
        while voxels / stride**3 > most_voxels:
            stride *= 2
        scale = min((most_pixels / (width * height)) ** 0.5, 1.0)
        if stride > 1 or scale < 0.7:
            yield replace(snapshot, look=replace(snapshot.look, stride=stride, scale=scale, annotate=()))
    yield snapshot


def run(jobs: IO[bytes], answers: IO[bytes]) -> None:
    """Draws jobs, the newest first, until the input ends. A job is its number and a snapshot, or None to cancel."""
    queue: SimpleQueue[tuple[int, Snapshot] | None] = SimpleQueue()
    newest = [0]

    def receive() -> None:
        with suppress(EOFError):
            while True:
                number, snapshot = read(jobs)
                newest[0] = number
                if snapshot is not None:
                    queue.put((number, snapshot))
        newest[0] = -1
        queue.put(None)

    threading.Thread(target=receive, daemon=True).start()
    # OpenGL is ready when it is needed; the first job says why it is not
    with suppress(InputError), shared_renderer():
        pass
    scenes: dict[Any, Scene] = {}
    samples: dict[bytes, np.ndarray] = {}
    while (job := queue.get()) is not None:
        number, snapshot = job
        for layer in snapshot.layers:
            layer.data = samples.get(layer.samples_key) if layer.data is None else layer.data
        samples = {layer.samples_key: layer.data for layer in snapshot.layers if layer.data is not None}
        snapshot.scenes = scenes
        for answer in _answers(number, snapshot, lambda: newest[0] != number):  # noqa: B023
            write(answers, answer)


def _answers(number: int, snapshot: Snapshot, is_old: Callable[[], bool]) -> Iterator[Answer]:
    """Answers of a job, each level's as soon as it is drawn."""
    started, steps = time.perf_counter(), list(levels(snapshot))
    try:
        for step, level in enumerate(steps, 1):
            if is_old():
                raise Interrupted
            image = draw_snapshot(level, is_old)
            state, seconds = "done" if step == len(steps) else "preview", time.perf_counter() - started
            rgb = np.ascontiguousarray(image.samples8((0.0, 0.0, 0.0))[..., :3])
            yield Answer(number, state, image, rgb, share=step / len(steps), seconds=seconds)
    except Interrupted:
        yield Answer(number, "cancelled")
    except USER_ERRORS as error:
        yield Answer(number, "error", text=error_text(error))


class Worker:
    """A process that draws. tell: called in another thread with each answer of the newest job."""

    def __init__(self, tell: Callable[[Answer], None]) -> None:
        self.tell = tell
        self.number, self.busy = 0, False
        # number of the job that is being drawn, 0 for none; keys of samples that the process has
        self.drawn, self.known = 0, set[bytes]()
        self.process: subprocess.Popen[bytes] | None = None
        self.wanted: SimpleQueue[tuple[int, Any, Any] | None] = SimpleQueue()
        threading.Thread(target=self._send, daemon=True, name="splatgl-napari").start()

    def start(self) -> None:
        """Starts the process, which takes a second, unless it runs."""
        if self.process is None or self.process.poll() is not None:
            # imported, so that pickles name this module
            command = [sys.executable, "-c", f"from {__name__} import main; main()"]
            self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
            self.drawn, self.known = 0, set()
            threading.Thread(target=self._listen, args=(self.process,), daemon=True).start()

    def draw(self, viewer: Any, look: Any) -> int:
        """Draws a viewer in a look, instead of any earlier job; returns the job's number."""
        self.number += 1
        self.busy = True
        self.wanted.put((self.number, viewer, look))
        return self.number

    def cancel(self) -> None:
        """Ends the job; what is drawn so far stays."""
        self.number += 1
        self.busy = False
        self.wanted.put((self.number, None, None))

    def close(self) -> None:
        """Ends the process."""
        self.wanted.put(None)
        if self.process is not None:
            self.process.kill()
            self.process.wait()

    def _send(self) -> None:
        """Takes snapshots and sends them, in a thread of its own: reading samples may take long."""
        while (job := self.wanted.get()) is not None:
            number, viewer, look = job
            if number != self.number:
                continue
            try:
                self._order(number, None if viewer is None else replace(take(viewer), look=look))
            except Exception as error:  # of napari or of a library that reads samples: the panel shows it
                self._answer(Answer(number, "error", text=error_text(error)))

    def _order(self, number: int, snapshot: Snapshot | None) -> None:
        """Sends a job to the process; ends a process that draws on after its job is cancelled."""
        self.start()
        process = self.process
        assert process is not None and process.stdin is not None
        before, self.drawn = self.drawn, number if snapshot else self.drawn
        try:
            write(process.stdin, (number, self._signed(snapshot) if snapshot else None))
        except BrokenPipeError:
            # it ended since it was asked
            process.wait()
            if snapshot is not None:
                self.start()
                assert self.process is not None and self.process.stdin is not None
                self.drawn = number
                write(self.process.stdin, (number, self._signed(snapshot)))
        if snapshot is not None or not before:
            return
        end = time.monotonic() + PATIENCE
        while self.drawn and time.monotonic() < end:
            time.sleep(0.02)
        if self.drawn:
            process.kill()
            process.wait()
            self.start()

    def _signed(self, snapshot: Snapshot) -> Snapshot:
        """The snapshot without samples that the process has."""
        layers = [copy(layer) for layer in snapshot.layers]
        for layer in layers:
            layer.sign()
        known, self.known = self.known, {layer.samples_key for layer in layers if layer.data is not None}
        for layer in layers:
            layer.data = None if layer.samples_key in known else layer.data
        return replace(snapshot, layers=layers)

    def _listen(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stdout is not None
        with suppress(EOFError):
            while True:
                answer = read(process.stdout)
                if answer.state != "preview" and self.process is process and answer.job == self.drawn:
                    self.drawn = 0
                self._answer(answer)
        if self.process is process and self.drawn:
            self._answer(Answer(self.drawn, "error", text="the process that draws has ended; press Render again"))
            self.drawn = 0

    def _answer(self, answer: Answer) -> None:
        if answer.job == self.number:
            self.busy = answer.state == "preview"
            self.tell(answer)


def main() -> None:
    """Runs the process that draws; where processors are few, the window's comes first."""
    if hasattr(os, "nice"):
        os.nice(NICE)
    # what libraries print must not mix with the answers
    output = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    run(sys.stdin.buffer, output)

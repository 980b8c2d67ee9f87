"""Float64 reference of the displayed frame, rendered by another process, and the error of the frame."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import IO, Any

import numpy as np

from splatgl.data.image import Image
from splatgl.errors import USER_ERRORS, InputError, error_text
from splatgl.geometry.camera import Camera
from splatgl.planning.scene import Scene
from splatgl.reference import renderer
from splatgl.splat.kernels import BUILT_IN, KERNELS
from splatgl.splat.settings import Settings
from splatgl.splat.splats import Splats
from splatgl.viewer.document import Document
from splatgl.viewer.jobs import NICE, JobCancelled, JobKind, Jobs

# most splats of a reference: more take minutes and gigabytes
MOST = 2_000_000
# of kernels that a script defines
UNKNOWN = "another process, which draws it, does not know all of it"


@dataclass(frozen=True)
class Difference:
    """Maximum and RMS of |difference| over all channels, linear premultiplied light."""

    largest: float
    rmse: float

    @classmethod
    def of(cls, picture: np.ndarray, right: np.ndarray) -> Difference:
        """Measures `picture` against `right`, arrays of one shape."""
        apart = picture.astype(np.float64) - right
        return cls(float(np.abs(apart).max()), float(np.sqrt((apart * apart).mean())))


def resize_bilinear(picture: np.ndarray, size: tuple[int, int], step: int) -> np.ndarray:
    """An image [h, w, C] resized bilinearly to `size` pixels, every `step`-th row and column."""
    for axis, (count, wanted) in enumerate(zip(picture.shape, reversed(size), strict=False)):
        place = np.clip((np.arange(0, wanted, step) + 0.5) * count / wanted - 0.5, 0, count - 1)
        low = place.astype(np.intp)
        high, share = np.minimum(low + 1, count - 1), (place - low).astype(np.float32)
        share = share.reshape(-1, *[1] * (picture.ndim - 1 - axis))
        picture = np.take(picture, low, axis) * (1 - share) + np.take(picture, high, axis) * share
    return picture


# subject, camera and settings of a reference; compared by identity
Wanted = tuple[Splats | Scene, Camera, Settings]


class Reference:
    """The reference of the latest request. image: the result, if finished; note: the message until then.

    A process draws it: one that is no longer wanted is ended at once, with its memory, and the window is not slower.
    """

    def __init__(self, jobs: Jobs) -> None:
        self.jobs = jobs
        self.wanted: Wanted | None = None
        self.image: Image | None = None
        self.note = ""
        self.process: subprocess.Popen[bytes] | None = None

    def request(self, document: Document, camera: Camera, settings: Settings) -> None:
        """Starts rendering the reference of all splats of a document."""
        self.forget()
        subject, settings = document.subject_at(1, settings)
        wanted = self.wanted = subject, camera, settings
        if (count := document.counts[0]) > MOST:
            self.note = f"no reference: {count:,} splats would take minutes; raise the threshold"
            return
        self.note = "the float64 reference is being rendered ..."
        self.jobs.submit(JobKind.REFERENCE, "reference", lambda: (wanted, self._draw(wanted)))

    def forget(self) -> None:
        """Drops the reference, and ends the process that draws it."""
        self.wanted, self.image, self.note = None, None, ""
        process = self.process
        if process is not None:
            process.kill()

    def collect(self) -> bool:
        """Collects a finished reference; True if anything changed."""
        news = self.jobs.collect()
        for done in news:
            if isinstance(done.error, USER_ERRORS):
                self.note = f"no reference: {error_text(done.error)}"
            elif done.error is not None and not isinstance(done.error, JobCancelled):
                raise done.error
            if done.error is None and done.value[0] is self.wanted:
                self.image, self.note = done.value[1], ""
        return bool(news)

    def _draw(self, wanted: Wanted) -> Image:
        """Returns the picture that the process draws. Raises its error, or Cancelled."""
        code = f"import sys; sys.path[:] = {sys.path!r}; from {__name__} import serve; serve()"
        command = [sys.executable, "-c", code]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as self.process:
            process = self.process
            try:
                # it may have been dropped before there was a process
                if wanted is not self.wanted:
                    raise JobCancelled
                return self._await(process, wanted)
            except (EOFError, OSError, pickle.UnpicklingError) as error:
                # killed, between two news or within one
                if wanted is not self.wanted:
                    raise JobCancelled from error
                raise InputError(f"the process that draws it ended with {process.wait()}") from error
            finally:
                self.process = None
                process.kill()

    def _await(self, process: subprocess.Popen[bytes], wanted: Wanted) -> Image:
        assert process.stdin is not None and process.stdout is not None
        kernels = {name: shape for name, shape in KERNELS.items() if name not in BUILT_IN}
        try:
            sent = pickle.dumps((kernels, *wanted))
        except (AttributeError, pickle.PicklingError) as error:
            raise InputError(f"{UNKNOWN}: {error}") from error
        process.stdin.write(sent)
        process.stdin.close()
        while not isinstance(news := pickle.load(process.stdout), Image):
            if isinstance(news, BaseException):
                raise news
            if wanted is not self.wanted:
                raise JobCancelled
            self.note = f"the float64 reference is being rendered: {news:.0%}"
            self.jobs.wake()
        return news


def serve() -> None:
    """Draws a reference: reads what from the standard input, and writes its progress from 0 to 1, and the image or an
    error, to the standard output.
    """
    with os.fdopen(os.dup(1), "wb") as output:
        # what libraries print
        os.dup2(2, 1)
        if hasattr(os, "nice"):
            os.nice(NICE)

        def progress(bands: Iterator[tuple[int, int]], count: int) -> Iterator[tuple[int, int]]:
            for number, band in enumerate(bands):
                _send(output, number / count)
                yield band

        try:
            kernels, subject, camera, settings = _received()
            KERNELS.update(kernels)
            _send(output, renderer.render(subject, camera, settings, progress=progress))
        except USER_ERRORS as error:
            _send(output, error)


def _received() -> Any:
    try:
        return pickle.load(sys.stdin.buffer)
    except (AttributeError, ImportError) as error:
        raise InputError(f"{UNKNOWN}: {error}") from error


def _send(output: IO[bytes], news: Any) -> None:
    pickle.dump(news, output)
    output.flush()

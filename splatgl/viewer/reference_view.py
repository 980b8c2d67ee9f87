"""Float64 reference of the displayed frame, rendered in a worker thread, and the error of the frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from splatgl.data.image import Image
from splatgl.errors import USER_ERRORS, error_text
from splatgl.reference import renderer
from splatgl.splat.camera import Camera
from splatgl.splat.scene import Scene
from splatgl.splat.settings import Settings
from splatgl.splat.splats import Splats
from splatgl.viewer.document import Document
from splatgl.viewer.jobs import Cancelled, Jobs, Kind

# most splats of a reference: more take minutes and gigabytes
MOST = 2_000_000


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


@dataclass(frozen=True, eq=False)
class ReferenceInputs:
    """Inputs of a reference; compared by identity. count: of splats visible from any side."""

    splats: Splats | Scene
    camera: Camera
    settings: Settings
    count: int

    @classmethod
    def of(cls, document: Document, camera: Camera, settings: Settings) -> ReferenceInputs:
        """The reference of all splats of a document."""
        subject, settings = document.subject_at(1, settings)
        return cls(subject, camera, settings, document.counts[0])


class Reference:
    """The reference of the latest request. image: the result, if finished; note: the message until then."""

    def __init__(self, jobs: Jobs) -> None:
        self.jobs = jobs
        self.wanted: ReferenceInputs | None = None
        self.image: Image | None = None
        self.note = ""

    def request(self, wanted: ReferenceInputs) -> None:
        """Starts rendering a reference; the same request starts only once."""
        self.forget()
        self.wanted = wanted
        if wanted.count > MOST:
            self.note = f"no reference: {wanted.count:,} splats would take minutes; raise the threshold"
            return
        self.note = "the float64 reference is being drawn ..."
        self.jobs.submit(Kind.REFERENCE, "reference", lambda: (wanted, self._draw(wanted)))

    def forget(self) -> None:
        """Drops the reference; a render in progress stops at its next band."""
        self.wanted, self.image, self.note = None, None, ""

    def collect(self) -> bool:
        """Collects a finished reference; True if anything changed."""
        news = self.jobs.collect()
        for done in news:
            if isinstance(done.error, USER_ERRORS):
                self.note = f"no reference: {error_text(done.error)}"
            elif done.error is not None and not isinstance(done.error, Cancelled):
                raise done.error
            if done.error is None and done.value[0] is self.wanted:
                self.image, self.note = done.value[1], ""
        return bool(news)

    def _draw(self, wanted: ReferenceInputs) -> Image:
        def progress(bands: Iterator[tuple[int, int]], count: int) -> Iterator[tuple[int, int]]:
            for number, band in enumerate(bands):
                if wanted is not self.wanted:
                    raise Cancelled
                self.note = f"the float64 reference is being drawn: {number / count:.0%}"
                self.jobs.wake()
                yield band

        if wanted is not self.wanted:
            raise Cancelled
        return renderer.render(wanted.splats, wanted.camera, wanted.settings, progress=progress)

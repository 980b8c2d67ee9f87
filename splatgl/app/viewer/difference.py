"""The float64 reference of what the window shows, drawn beside it in a thread, and how far the picture is from it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from splatgl.app.viewer.jobs import Jobs
from splatgl.data.image import Image
from splatgl.splat.extraction.splats import Splats
from splatgl.splat.plan.settings import Settings
from splatgl.splat.view.camera import Camera
from splatgl.truth import reference

# beyond this many splats a reference takes minutes, and gigabytes
MOST = 2_000_000


class Cancelled(Exception):
    """The picture changed before its reference was done."""


@dataclass(frozen=True)
class Difference:
    """Largest and root mean square |difference| over channels, linear premultiplied light."""

    largest: float
    rmse: float

    @classmethod
    def of(cls, picture: np.ndarray, right: np.ndarray) -> Difference:
        """Measures `picture` against `right`, arrays of one shape."""
        apart = picture.astype(np.float64) - right
        return cls(float(np.abs(apart).max()), float(np.sqrt((apart * apart).mean())))


def enlarged(picture: np.ndarray, size: tuple[int, int], step: int) -> np.ndarray:
    """A picture [h, w, C] as the window shows it at `size` pixels, every `step`-th row and column: bilinear."""
    for axis, (count, wanted) in enumerate(zip(picture.shape, reversed(size), strict=False)):
        place = np.clip((np.arange(0, wanted, step) + 0.5) * count / wanted - 0.5, 0, count - 1)
        low = place.astype(np.intp)
        high, share = np.minimum(low + 1, count - 1), (place - low).astype(np.float32)
        share = share.reshape(-1, *[1] * (picture.ndim - 1 - axis))
        picture = np.take(picture, low, axis) * (1 - share) + np.take(picture, high, axis) * share
    return picture


@dataclass(frozen=True, eq=False)
class Wanted:
    """What a reference is of; another object is another picture."""

    splats: Splats
    camera: Camera
    settings: Settings


class Reference:
    """The reference of the newest picture asked for; `image` once it is there, `said` what to tell meanwhile."""

    def __init__(self, jobs: Jobs) -> None:
        self.jobs = jobs
        self.wanted: Wanted | None = None
        self.image: Image | None = None
        self.said = ""

    def ask(self, wanted: Wanted) -> None:
        """Starts the reference of a picture; of the same one only once."""
        self.forget()
        self.wanted = wanted
        if len(wanted.splats) > MOST:
            self.said = f"no reference: {len(wanted.splats):,} splats would take minutes; raise the threshold"
            return
        self.said = "the float64 reference is being drawn ..."
        self.jobs.submit("reference", lambda: (wanted, self._draw(wanted)))

    def forget(self) -> None:
        """Drops the reference, and what is being drawn with the next band of it."""
        self.wanted, self.image, self.said = None, None, ""

    def collect(self) -> bool:
        """Takes what is done; True if there is news."""
        news = self.jobs.collect()
        for done in news:
            if done.error is not None and not isinstance(done.error, Cancelled):
                raise done.error
            if done.error is None and done.result[0] is self.wanted:
                self.image, self.said = done.result[1], ""
        return bool(news)

    def _draw(self, wanted: Wanted) -> Image:
        def progress(bands: Iterator[tuple[int, int]], count: int) -> Iterator[tuple[int, int]]:
            for number, band in enumerate(bands):
                if wanted is not self.wanted:
                    raise Cancelled
                self.said = f"the float64 reference is being drawn: {number / count:.0%}"
                self.jobs.wake()
                yield band

        if wanted is not self.wanted:
            raise Cancelled
        return reference.render(wanted.splats, wanted.camera, wanted.settings, progress=progress)

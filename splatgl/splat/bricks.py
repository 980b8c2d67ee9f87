"""Volumes larger than memory: bricks in the order of sheets, and the memory that they need.

Sheets are spheres around the eye. Once no brick is left that could hold a splat of a sheet, that sheet is complete, and
its splats are given out, in batches whose sheets never come before those of the batch before. Records are those of the
whole volume, as each brick is read with the halo that they depend on.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from splatgl.data.volume import Volume, places
from splatgl.errors import expected
from splatgl.fileio import size_of
from splatgl.readers.common import is_mapped
from splatgl.splat.culling import AROUND_EYE
from splatgl.splat.extract import POST_KERNEL, only_pre
from splatgl.splat.extract_values import box_records, boxes, gaps_of, post_splats
from splatgl.splat.kernels import Kernel
from splatgl.splat.kernels import kernel as kernel_named
from splatgl.splat.preintegration import ValueClassifier
from splatgl.splat.resolve import why_per_splat
from splatgl.splat.settings import BLENDS, Settings
from splatgl.splat.sheets import NearField, Sheets, near_box
from splatgl.splat.splats import MOST_KEPT, Splats, record_type
from splatgl.splat.transfer import Transfer
from splatgl.splat.view import GridView

# voxels along a brick's sides, and those looked at together for missing ones
SIDE, PART = 64, 1 << 22
# splats of a batch at least, but for the last
BATCH = 1 << 19
# bricks of each processor that are extracted ahead
AHEAD = 2
# sheets by which float32 may place a splat before float64
SLACK = 1

# a sheet beyond all others
FAR = 2**30

# the sheets between which something lies, as `Sheets.base` counts them
Shell = tuple[int, int]
# records, and the first sheet of each, which never falls
Found = tuple[np.ndarray, np.ndarray]
# whether anything of a box of voxels, from low to high (x, y, z), can be seen
Seen = Callable[[np.ndarray, np.ndarray], bool]


@dataclass(frozen=True, eq=False)
class Bricks:
    """A volume in boxes of voxels. low, high int64 [B, 3]: of their own voxels low ≤ (x, y, z) < high.

    found: splats of those bricks that were extracted for a picture. gaps: missing samples beside them, which nothing
    masks, as they are known when a brick is read. shell: of all splats, only those between two sheets are drawn.
    """

    volume: Volume
    post: ValueClassifier
    low: np.ndarray
    high: np.ndarray
    found: dict[int, int] = field(default_factory=dict)
    gaps: dict[int, int] = field(default_factory=dict)
    shell: Shell | None = None

    @classmethod
    def of(cls, volume: Volume, post: ValueClassifier, side: int = SIDE) -> Bricks:
        """All of the volume in bricks of `side` voxels."""
        size = np.array(volume.shape[::-1])
        count = -(-size // side)
        low = np.stack(np.unravel_index(np.arange(count.prod()), count), axis=1) * side
        return cls(volume, post, low, np.minimum(low + side, size))

    @property
    def kernel(self) -> Kernel:
        """The kernel that the values are for."""
        return kernel_named(self.post.kernel)

    @cached_property
    def whole(self) -> Splats:
        """Two splats at the corners of the volume's box: what a plan needs to know of all of them."""
        records = np.zeros(2, record_type(self.volume.shape, post=True))
        records["position"][1] = np.array(self.volume.shape[::-1]) - 1
        return post_splats(
            self.volume, self.post, records, gaps_of(self.volume, self.post, boxes(self.volume.shape, PART))
        )

    @property
    def probes(self) -> Splats:
        """A splat at the first voxel of each brick: places by which paths are measured."""
        places = self.low[np.lexsort(self.low.T)]
        records = np.zeros(len(places), record_type(self.volume.shape, post=True))
        records["position"] = places
        return post_splats(self.volume, self.post, records)

    def _ahead(self, order: list[int], sheets: Sheets, view: GridView, seen: Seen) -> Iterator[Found]:
        """What is in those bricks in turn, some of them extracted ahead, side by side; nothing if one is not seen."""

        def work(brick: int) -> Found:
            records = self.records(brick)
            base = sheets.base(sheets.places(view, records["position"])).astype(np.int32)
            self.found[brick] = len(records)
            if self.shell is not None:
                first, last = self.shell
                self.found[brick] = int(((base >= first) & (base < last)).sum())
                kept = (base >= first - sheets.count) & (base <= last + 1)
                records, base = records[kept], base[kept]
            by_sheet = np.argsort(base, kind="stable")
            return records[by_sheet], base[by_sheet]

        nothing = np.zeros(0, record_type(self.volume.shape, post=True)), np.zeros(0, np.int32)
        workers = os.cpu_count() or 1
        waiting: deque[Future[Found] | None] = deque()
        with ThreadPoolExecutor(workers) as pool:
            try:
                for brick in order:
                    wanted = seen(self.low[brick], self.high[brick] - 1)
                    waiting.append(pool.submit(work, brick) if wanted else None)
                    if len(waiting) > AHEAD * workers:
                        first = waiting.popleft()
                        yield first.result() if first else nothing
                while waiting:
                    first = waiting.popleft()
                    yield first.result() if first else nothing
            finally:
                # a picture that is given up waits for none
                for each in waiting:
                    if each:
                        each.cancel()

    def records(self, brick: int) -> np.ndarray:
        """The records of one brick, in row order."""
        # of samples in memory, `whole` has masked them
        gaps: list[np.ndarray] | None = None if isinstance(self.volume.samples, np.ndarray) else []
        low, high = places(self.low[brick]), places(self.high[brick])
        found = box_records(self.volume, self.post, self.kernel, low, high, gaps)
        self.gaps[brick] = sum(map(len, gaps or ()))
        return found

    def reached(self, view: GridView) -> bool:
        """Whether the eye may be in a kernel, or a kernel cross its plane in the picture."""
        forward = view.eye_from_index[2]
        nearest = np.where(forward > 0, 0, np.array(self.volume.shape[::-1]) - 1)
        return view.perspective and bool(forward @ (nearest - view.eye_index) <= AROUND_EYE * view.reach)

    def nearest(self, sheets: Sheets, view: GridView) -> np.ndarray:
        """int64 [B]: the first sheet of the nearest place within each brick."""
        if view.perspective:
            return sheets.base(sheets.places(view, np.clip(view.eye_index, self.low, self.high - 1)))
        return sheets.base(self._corner_places(sheets, view).min(axis=0))

    def _corner_places(self, sheets: Sheets, view: GridView) -> np.ndarray:
        """[8, B]: the places in sheets of the corners of each brick."""
        ends = np.stack([self.low, self.high - 1])
        corners = [ends[[x, y, z], :, [0, 1, 2]].T for x in (0, 1) for y in (0, 1) for z in (0, 1)]
        return np.stack([sheets.places(view, corner) for corner in corners])

    def near(self, sheets: Sheets, view: GridView) -> NearField | None:
        """The voxels around the eye; None if there are none."""
        size = np.array(self.volume.shape[::-1])
        box = near_box(view, sheets, np.stack([np.zeros(3), size - 1.0]))
        if box is None:
            return None
        low, high = (places(np.clip(end, 0, size)) for end in box)
        records = box_records(self.volume, self.post, self.kernel, low, high)
        return NearField.of_records(records, box, view, sheets)

    def within(self, sheets: Sheets, view: GridView, shell: Shell) -> Bricks:
        """The bricks that matter to what lies between two sheets, and of them those splats."""
        furthest = sheets.base(self._corner_places(sheets, view).max(axis=0))
        kept = (self.nearest(sheets, view) <= shell[1] + 1) & (furthest >= shell[0] - sheets.count)
        return replace(self, low=self.low[kept], high=self.high[kept], found={}, gaps={}, shell=shell)

    def shells(self, sheets: Sheets, view: GridView, count: int) -> list[Shell]:
        """The ranges of sheets of `count` parts, or fewer, of about as many bricks each, nearest first."""
        nearest = np.sort(self.nearest(sheets, view))
        cuts = np.unique(nearest[np.arange(1, count) * len(nearest) // count])
        ends = [-FAR, *cuts[cuts > nearest[0]].tolist(), FAR]
        return list(pairwise(ends))

    def batches(self, sheets: Sheets, view: GridView, seen: Seen) -> Iterator[tuple[np.ndarray, int]]:
        """Records of batches, and how many bricks were done with. seen: asked of a brick before it is read."""
        nearest = self.nearest(sheets, view)
        order = np.argsort(nearest, kind="stable")
        # records in the order of their sheets, and these
        waiting: list[tuple[np.ndarray, np.ndarray]] = []
        for n, found in enumerate(self._ahead(order.tolist(), sheets, view, seen)):
            waiting += [found] if len(found[0]) else []
            last = n + 1 == len(order)
            limit = np.iinfo(np.int32).max if last else int(nearest[order[n + 1]]) - SLACK
            ready = [int(np.searchsorted(base, limit)) for _, base in waiting]
            if sum(ready) < BATCH and not last:
                continue
            nothing = np.zeros(0, record_type(self.volume.shape, post=True))
            batch = np.concatenate([nothing, *(each[:end] for (each, _), end in zip(waiting, ready, strict=True))])
            waiting = [_behind(*found, end) for found, end in zip(waiting, ready, strict=True) if end < len(found[0])]
            yield batch, n + 1
            del batch


def _behind(records: np.ndarray, base: np.ndarray, end: int) -> Found:
    """Those from `end` on; copied where that frees more than half of what they are part of."""
    whole = len(records) if records.base is None else len(records.base)
    if 2 * (len(records) - end) < whole:
        return records[end:].copy(), base[end:].copy()
    return records[end:], base[end:]


# peak bytes of extraction and drawing together, measured from 0.5 to 10 million splats: of each, and of others by
# OpenGL and numpy
EACH, FIXED = 100, 300 << 20
# in bricks: what is taken in any case, the least for what waits, bytes of a splat that waits, and most bands
BRICKS, LEAST, WAITING, MOST_BANDS = 450 << 20, 64 << 20, 64, 16
# bytes of a sample of the picture: target, resolved, read back, and open sheets
SAMPLE = 160
# boxes that are read for an estimate, the voxels along their sides, and the steps of their places, as shares of the
# volume's sides: the R sequence of three dimensions, which leaves no gaps (Roberts 2018)
PROBES, PROBE_SIDE, STEPS = 64, 24, (0.8191725134, 0.6710436067, 0.5497004779)
# standard errors of an estimate by which more splats are reckoned with, and splats if none is seen
ERRORS, MISSED = 2.0, 3.0


@dataclass(frozen=True)
class Need:
    """splats: estimated number. most: what that may be, by its standard error. bytes: peak of extracting and drawing
    so many at once.

    waiting: of splats in bricks, of which some must wait for others to be drawn. samples: of the picture.
    """

    splats: int
    most: int
    bytes: int
    waiting: int
    samples: int

    def __str__(self) -> str:
        """How many splats there may be, and what they and all else take."""
        few = f"up to about {self.most:,} splats"
        return f"{few} take {size_of(EACH * self.most)}, samples and pixels {size_of(self.bytes - EACH * self.most)}"

    def bands(self, memory: int) -> int:
        """Into how many bands of rows a picture in bricks is split, so that it takes about that many bytes."""
        room = max(memory - BRICKS, LEAST)
        return int(np.clip(-(-(self.waiting + SAMPLE * self.samples) // room), 1, MOST_BANDS))


def need(bricks: Bricks, pixels: int, enough: int) -> Need:
    """The estimate; if all voxels are within `enough` bytes and what the GPU keeps, that of all, without reading.

    pixels: of the picture, all samples.
    """
    volume = bricks.volume
    kept = isinstance(volume.samples, np.ndarray) and is_mapped(volume.samples)
    other = FIXED + SAMPLE * pixels + (0 if kept else volume.count * volume.samples.dtype.itemsize)
    size = np.array(volume.shape[::-1])
    # a layer of bricks' diagonals across the volume, half of which is drawn on average
    layer = int(np.sort(size)[1:].prod() * min(SIDE, int(size.min())))
    whole = Need(volume.count, volume.count, other + EACH * volume.count, WAITING * layer, pixels)
    if whole.bytes <= enough and volume.count <= MOST_KEPT:
        return whole
    low = spread(np.maximum(size - PROBE_SIDE, 0), PROBES)
    # of a small volume the same place comes again and again
    low, same = np.unique(low, axis=0, return_inverse=True)
    probes = Bricks(volume, bricks.post, low, np.minimum(low + PROBE_SIDE, size))
    voxels = (probes.high - low).prod(axis=1)[same.ravel()]
    shares = np.array([len(probes.records(n)) for n in range(len(low))])[same.ravel()] / voxels
    share = float(np.average(shares, weights=voxels))
    # where none is seen, some may be beside: as many as are missed with a chance of 1/20
    most = min(max(share + ERRORS * float(shares.std()) / np.sqrt(PROBES), MISSED / float(voxels.sum())), 1.0)
    splats, many = (int(np.ceil(part * volume.count)) for part in (share, most))
    return Need(splats, many, other + EACH * many, int(WAITING * share * layer), pixels)


def spread(most: np.ndarray, count: int) -> np.ndarray:
    """int64 [count, 3]: places from 0 to `most` (x, y, z), spread evenly however many are used."""
    place = (0.5 + np.outer(np.arange(count), STEPS)) % 1.0
    return np.asarray((place * most).round().astype(np.int64))


def bricks_of(volume: Volume, transfer: Transfer, settings: Settings) -> Bricks | None:
    """The volume in bricks for a picture with these settings; None if it takes voxels classified before."""
    if settings.classification == "pre" or only_pre(volume, transfer, 0.0) or why_per_splat(settings, moving=False):
        return None
    kernel = settings.kernel if settings.kernel != "auto" else POST_KERNEL
    every = BLENDS[settings.blend].one_value
    return Bricks.of(volume, ValueClassifier.of(transfer, kernel, volume.shape[::-1], every))


def required_bricks(volume: Volume, transfer: Transfer, settings: Settings) -> Bricks:
    """The volume in bricks. InputError for a picture that takes voxels classified before, with what takes them."""
    found = bricks_of(volume, transfer, settings)
    if found is None:
        why = only_pre(volume, transfer, 0.0) or why_per_splat(settings, moving=False) or "classification pre"
        raise expected("a picture in parts", "values classified after reconstruction", why, "draw it whole, alone")
    return found


def fits(bricks: Bricks, size: tuple[int, int], memory: int) -> Need | None:
    """None if all splats of a picture of that size (width, height) fit into that many bytes and the GPU; else what they
    need. InputError for no bytes.
    """
    if memory <= 0:
        raise expected("memory", "a positive number of bytes", memory)
    # samples are at most 2 × 2 where voxels are not narrower than pixels
    wanted = need(bricks, 4 * size[0] * size[1], memory)
    return None if wanted.bytes <= memory and wanted.most <= MOST_KEPT else wanted

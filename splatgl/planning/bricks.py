"""Volumes larger than memory: bricks in the order of sheets, and the memory that they need.

Sheets are spheres around the eye. A sheet is complete once no brick is left that could hold a splat of it; its splats
are then handed out, in batches whose sheets never fall. Records equal those of the whole volume, since each brick is
read with the halo that they depend on.
"""

from __future__ import annotations

import math
import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from splatgl.data.volume import Places, Volume, zyx_index
from splatgl.errors import expected
from splatgl.fileio import PROCESS, budget, byte_count, format_bytes, held_within_budget
from splatgl.geometry.camera import Camera
from splatgl.geometry.grid import Grid
from splatgl.geometry.view import GridView
from splatgl.planning.culling import AROUND_EYE
from splatgl.planning.resolve import reach_outside, samples_per_pixel, why_per_splat
from splatgl.readers.chunked import COPIES, Chunked
from splatgl.readers.common import is_mapped
from splatgl.splat.extract import POST_KERNEL, why_only_pre
from splatgl.splat.extract_values import box_records, boxes, gaps_of, post_splats
from splatgl.splat.hidden_interior import BLOCK, HiddenInterior, in_voxels
from splatgl.splat.hidden_interior import SIDE as SIDE_OF_CELLS
from splatgl.splat.kernels import Kernel
from splatgl.splat.kernels import kernel as kernel_named
from splatgl.splat.settings import Settings
from splatgl.splat.sheets import NearField, Sheets, near_box
from splatgl.splat.splats import MOST_KEPT, Splats, as_bytes, join_records, record_type
from splatgl.transfer.preintegration import ValueClassifier
from splatgl.transfer.transfer import Transfer

# voxels along a brick's sides, of whose blocks only some are extracted; voxels that are searched for missing samples
# at a time
SIDE, PART = 64, 1 << 22
# bytes of a cell in which hidden voxels are searched, the share of the memory that they take, and their longest side
SEARCHED, SEARCH_SHARE, WIDEST = 7, 1 / 2, 16
# least number of splats in a batch, except the last: with little memory, and with enough
LEAST_BATCH, BATCH = 1 << 16, 1 << 19
# bricks per thread that are extracted in advance
AHEAD = 2
# sheets by which float32 may place a splat nearer than float64
SLACK = 1

# a sheet beyond all others
FAR = 2**30

# first and last sheet of a range, as `Sheets.base` counts them
Shell = tuple[int, int]
# records, and the first sheet of each, in ascending order
SheetRecords = tuple[np.ndarray, np.ndarray]
# bool [N]: whether any voxel of boxes, from low to high [N, 3] (x, y, z), may be visible
IsVisible = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Bricks:
    """A volume in boxes of voxels. low, high int64 [B, 3]: brick b holds the voxels low ≤ (x, y, z) < high.

    counts: numbers of splats in the blocks of each extracted brick. gaps: number of missing samples beside them, known
    once a brick is read. shell: range of sheets whose splats are drawn; None: all. hidden: voxels that are left out.
    searched: the latest that were, by what they depend on. threads: that extract bricks. batch: least number of splats
    drawn together.
    """

    volume: Volume
    post: ValueClassifier
    low: np.ndarray
    high: np.ndarray
    counts: dict[int, np.ndarray] = field(default_factory=dict)
    gaps: dict[int, int] = field(default_factory=dict)
    shell: Shell | None = None
    hidden: HiddenInterior | None = None
    searched: dict[tuple[float, ...], HiddenInterior | None] = field(default_factory=dict)
    threads: int = 1
    batch: int = BATCH

    @classmethod
    def of(cls, volume: Volume, post: ValueClassifier, side: int = SIDE) -> Bricks:
        """Divides the whole volume into bricks of `side` voxels, to be drawn within the memory budget."""
        size = np.array(volume.shape[::-1])
        count = -(-size // side)
        low = np.stack(np.unravel_index(np.arange(count.prod()), count), axis=1) * side
        return cls(volume, post, low, np.minimum(low + side, size)).limited(budget())

    def limited(self, memory: int, parted: int = 0) -> Bricks:
        """The bricks, extracted by as many threads and drawn in as large batches as fit into `memory` bytes beside
        `parted` bytes, of which each band takes its part.
        """
        spare = max(memory - self.least(parted), 0)
        each = THREAD + self.decoding
        threads = min(1 + spare // 2 // each, os.cpu_count() or 1)
        more = (spare - each * (threads - 1)) // 2 // BATCHED
        return replace(self, threads=threads, batch=int(np.clip(LEAST_BATCH + more, LEAST_BATCH, BATCH)))

    @property
    def found(self) -> dict[int, int]:
        """Number of splats of each extracted brick."""
        return {brick: int(counts.sum()) for brick, counts in self.counts.items()}

    @property
    def held(self) -> int:
        """Bytes of samples in memory, or of decoded chunks, and of cells of hidden voxels."""
        return self._held_samples + (self.hidden.cells.nbytes if self.hidden else 0)

    @property
    def _held_samples(self) -> int:
        samples = self.volume.samples
        if isinstance(samples, np.ndarray):
            return 0 if is_mapped(samples) else samples.nbytes
        return max(held_within_budget(byte_count(samples.shape, samples.dtype)), self.decoding)

    @property
    def decoding(self) -> int:
        """Bytes that a thread takes to decode a chunk of the samples."""
        samples = self.volume.samples
        return COPIES * byte_count(samples.chunks, samples.dtype) if isinstance(samples, Chunked) else 0

    @property
    def fixed(self) -> int:
        """Bytes of the process that draws a picture, beside the picture's own and those of splats that wait."""
        return BRICKS + (THREAD + self.decoding) * (self.threads - 1) + BATCHED * self.batch + self.held

    def least(self, parted: int) -> int:
        """Bytes of the process that draws by one thread, in the smallest batches and most bands, which share `parted`
        bytes.
        """
        least = replace(self, threads=1, batch=LEAST_BATCH)
        return least.fixed + max(-(-parted // MOST_BANDS), min(parted, LEAST))

    @property
    def kernel(self) -> Kernel:
        """The kernel that reconstructs the values."""
        return kernel_named(self.post.kernel)

    @cached_property
    def whole(self) -> Splats:
        """The corners, from which a picture of the volume is planned, with its missing samples."""
        gaps = gaps_of(self.volume, self.post, boxes(self.volume.shape, PART))
        return post_splats(self.volume, self.post, self.corners.records, gaps)

    @property
    def corners(self) -> Splats:
        """Two splats at opposite corners of the volume's box."""
        records = np.zeros(2, record_type(self.volume.shape, post=True))
        records["position"][1] = np.array(self.volume.shape[::-1]) - 1
        return post_splats(self.volume, self.post, records)

    def samples(self, camera: Camera, settings: Settings) -> int:
        """Number of samples of a picture."""
        return camera.size[0] * camera.size[1] * samples_per_pixel(self.corners, camera, settings) ** 2

    def fitted(self, camera: Camera, settings: Settings, memory: int) -> tuple[Bricks, int]:
        """The bricks without hidden voxels, and the number of bands of rows, with which the process takes up to
        `memory` bytes. Raises InputError if it takes more with any.
        """
        visible = self.without_hidden(camera, settings)
        return estimate_need(visible, self.samples(camera, settings), memory).fitted(visible, memory)

    @property
    def probes(self) -> Splats:
        """One splat at the first voxel of each brick, to measure the paths of moving pictures."""
        places = self.low[np.lexsort(self.low.T)]
        records = np.zeros(len(places), record_type(self.volume.shape, post=True))
        records["position"] = places
        return post_splats(self.volume, self.post, records)

    def without_hidden(self, camera: Camera, settings: Settings) -> Bricks:
        """The bricks without voxels that the camera's eye does not see behind others; see hidden_interior.py."""
        reach = reach_outside(self.whole, settings, camera)
        if not reach:
            return self
        grid = Grid.of(self.volume)
        if camera.perspective:
            eye = np.append(grid.index_from_world(camera.eye), 1.0)
        else:
            eye = np.append(np.linalg.solve(grid.world_from_index, -camera.forward), 0.0)
        side = self._searched_side()
        key = (reach, side, *eye.tolist())
        if key not in self.searched:
            self.searched.clear()
            if side <= WIDEST:
                self.searched[key] = HiddenInterior.of(self.volume, self.post, self.whole.unit, reach, eye, side)
        return replace(self, hidden=self.searched.get(key))

    def _searched_side(self) -> int:
        """Voxels along the cells in which hidden ones are searched: as few as fit into the memory."""
        most, side = SEARCH_SHARE * (budget() - PROCESS - self._held_samples) / SEARCHED, SIDE_OF_CELLS
        while math.prod(-(-size // side) + 2 for size in self.volume.shape) > most and side <= WIDEST:
            side *= 2
        return side

    def _extract_ahead(
        self, order: list[int], sheets: Sheets, view: GridView, is_visible: IsVisible
    ) -> Iterator[SheetRecords]:
        """Yields the records of bricks in the given order, extracted in advance by threads; none if invisible."""

        def work(brick: int, shown: np.ndarray) -> SheetRecords:
            records = self.records(brick, shown)
            base = sheets.base(sheets.places(view, records["position"])).astype(np.int32)
            drawn = records["position"]
            if self.shell is not None:
                first, last = self.shell
                drawn = drawn[(base >= first) & (base < last)]
                in_shell = (base >= first - sheets.count) & (base <= last + 1)
                records, base = records[in_shell], base[in_shell]
            # a band may have left out some blocks
            x, y, z = ((drawn[:, n] - np.int32(low)) // BLOCK for n, low in enumerate(self.low[brick]))
            block = (z * shown.shape[1] + y) * shown.shape[2] + x
            counts = np.bincount(block, minlength=shown.size)
            self.counts[brick] = np.maximum(counts, self.counts.get(brick, 0))
            # 16 bits are sorted many times faster
            first = base.min(initial=np.iinfo(np.int32).max)
            by_sheet = np.argsort((base - first).astype(np.uint16), kind="stable")
            return np.take(records, by_sheet), base[by_sheet]

        nothing = np.zeros(0, record_type(self.volume.shape, post=True)), np.zeros(0, np.int32)
        waiting: deque[Future[SheetRecords] | None] = deque()
        with ThreadPoolExecutor(self.threads) as pool:
            try:
                for brick in order:
                    shown = self.shown(brick, is_visible)
                    waiting.append(pool.submit(work, brick, shown) if shown.any() else None)
                    if len(waiting) > AHEAD * self.threads:
                        first = waiting.popleft()
                        yield first.result() if first else nothing
                while waiting:
                    first = waiting.popleft()
                    yield first.result() if first else nothing
            finally:
                # an interrupted picture waits for no brick
                for future in waiting:
                    if future:
                        future.cancel()

    def shown(self, brick: int, is_visible: IsVisible) -> np.ndarray:
        """bool [z, y, x]: which blocks of BLOCK³ voxels of a brick may be visible, and are not hidden."""
        low, high = self.low[brick], self.high[brick]
        count = -(-(high - low) // BLOCK)
        if self.hidden is not None and self.hidden.hides(zyx_index(low), zyx_index(high)):
            return np.zeros(count[::-1], bool)
        if not is_visible(low[None], high[None] - 1)[0]:
            return np.zeros(count[::-1], bool)
        first = low + BLOCK * np.stack(np.unravel_index(np.arange(count.prod()), count[::-1])[::-1], axis=1)
        return is_visible(first, np.minimum(first + BLOCK, high) - 1).reshape(count[::-1])

    def records(self, brick: int, shown: np.ndarray | None = None) -> np.ndarray:
        """Extracts the records of one brick, in row order. shown: of its blocks; None: of all."""
        # `whole` masks the gaps of samples in memory
        gaps: list[np.ndarray] | None = None if isinstance(self.volume.samples, np.ndarray) else []
        low, high = zyx_index(self.low[brick]), zyx_index(self.high[brick])
        if self.hidden is not None and self.hidden.hides(low, high):
            return np.zeros(0, record_type(self.volume.shape, post=True))
        inside = self.hidden.inside if self.hidden else None

        def is_hidden(low: Places, high: Places) -> np.ndarray:
            assert shown is not None
            unseen = in_voxels(~shown, BLOCK, (0, 0, 0), (high[0] - low[0], high[1] - low[1], high[2] - low[2]))
            return unseen if inside is None else unseen | inside(low, high)

        is_partly = shown is not None and not shown.all()
        records = box_records(
            self.volume, self.post, self.kernel, (low, high), gaps, is_hidden if is_partly else inside
        )
        self.gaps[brick] = sum(map(len, gaps or ()))
        return records

    def surround_eye(self, view: GridView) -> bool:
        """Whether the eye may be inside a kernel, or a kernel of the picture may cross the eye's plane."""
        forward = view.eye_from_index[2]
        nearest = np.where(forward > 0, 0, np.array(self.volume.shape[::-1]) - 1)
        return view.perspective and bool(forward @ (nearest - view.eye_index) <= AROUND_EYE * view.reach)

    def nearest(self, sheets: Sheets, view: GridView) -> np.ndarray:
        """int64 [B]: first sheet of the point of each brick that is nearest to the eye."""
        if view.perspective:
            return sheets.base(sheets.places(view, np.clip(view.eye_index, self.low, self.high - 1)))
        return sheets.base(self._corner_places(sheets, view).min(axis=0))

    def _corner_places(self, sheets: Sheets, view: GridView) -> np.ndarray:
        """[8, B]: distances of each brick's corners, in sheets."""
        ends = np.stack([self.low, self.high - 1])
        corners = [ends[[x, y, z], :, [0, 1, 2]].T for x in (0, 1) for y in (0, 1) for z in (0, 1)]
        return np.stack([sheets.places(view, corner) for corner in corners])

    def near(self, sheets: Sheets, view: GridView) -> NearField | None:
        """The near field of the voxels around the eye; None if there are none."""
        size = np.array(self.volume.shape[::-1])
        box = near_box(view, sheets, np.stack([np.zeros(3), size - 1.0]))
        if box is None:
            return None
        low, high = (zyx_index(np.clip(end, 0, size)) for end in box)
        records = box_records(self.volume, self.post, self.kernel, (low, high))
        return NearField.of_records(records, box, view, sheets)

    def within(self, sheets: Sheets, view: GridView, shell: Shell) -> Bricks:
        """The bricks that contribute to a range of sheets, restricted to it."""
        furthest = sheets.base(self._corner_places(sheets, view).max(axis=0))
        overlaps = (self.nearest(sheets, view) <= shell[1] + 1) & (furthest >= shell[0] - sheets.count)
        return replace(self, low=self.low[overlaps], high=self.high[overlaps], counts={}, gaps={}, shell=shell)

    def shells(self, sheets: Sheets, view: GridView, count: int) -> list[Shell]:
        """At most `count` ranges of sheets with about equally many bricks, nearest first."""
        nearest = np.sort(self.nearest(sheets, view))
        cuts = np.unique(nearest[np.arange(1, count) * len(nearest) // count])
        ends = [-FAR, *cuts[cuts > nearest[0]].tolist(), FAR]
        return list(pairwise(ends))

    def batches(self, sheets: Sheets, view: GridView, is_visible: IsVisible) -> Iterator[tuple[np.ndarray, int]]:
        """Yields batches of records, with the number of bricks done. is_visible: is called before a brick is read."""
        nearest = self.nearest(sheets, view)
        order = np.argsort(nearest, kind="stable")
        # records in the order of their sheets, and their sheets
        waiting: list[tuple[np.ndarray, np.ndarray]] = []
        for n, arrived in enumerate(self._extract_ahead(order.tolist(), sheets, view, is_visible)):
            waiting += [arrived] if len(arrived[0]) else []
            last = n + 1 == len(order)
            if sum(len(base) for _, base in waiting) < self.batch and not last:
                continue
            limit = np.iinfo(np.int32).max if last else int(nearest[order[n + 1]]) - SLACK
            if sum(_count_before(waiting, limit)) < self.batch and not last:
                continue
            for end in self._cuts(waiting, limit):
                ready = _count_before(waiting, end)
                nothing = np.zeros(0, record_type(self.volume.shape, post=True))
                batch = join_records(
                    [nothing, *(records[:many] for (records, _), many in zip(waiting, ready, strict=True))]
                )
                pairs = zip(waiting, ready, strict=True)
                waiting = [_split_off(*pair, many) for pair, many in pairs if many < len(pair[0])]
                yield batch, n + 1
                del batch

    def _cuts(self, waiting: list[SheetRecords], limit: int) -> list[int]:
        """Sheets at which the splats before `limit` are parted into batches of about `batch`, of at least one sheet."""
        bases = [base[: np.searchsorted(base, limit)] for _, base in waiting]
        first = min((int(base[0]) for base in bases if len(base)), default=limit)
        last = max((int(base[-1]) for base in bases if len(base)), default=limit)
        counts = sum((np.bincount(base - first, minlength=last + 1 - first) for base in bases), np.zeros(1, np.int64))
        number = np.cumsum(counts) // max(self.batch, 1)
        return [*(first + np.flatnonzero(np.diff(number)) + 1).tolist(), limit]


def _count_before(waiting: list[SheetRecords], sheet: int) -> list[int]:
    """The number of splats of each that come before a sheet."""
    return [int(base.searchsorted(sheet)) if base[0] < sheet else 0 for _, base in waiting]


def _split_off(records: np.ndarray, base: np.ndarray, end: int) -> SheetRecords:
    """Returns records and sheets from `end` on, copied if that frees more than half of their memory."""
    total = len(records) if records.base is None else len(records.base)
    if 2 * (len(records) - end) < total:
        return as_bytes(records[end:]).copy().view(records.dtype), base[end:].copy()
    return records[end:], base[end:]


# peak bytes of a splat that is drawn with all others, beside those of the process, from 0 to 10 million splats
EACH = 100
# bytes in bricks: of the process, its programs, buffers and extraction by one thread; by each further thread, with its
# bricks in advance; per splat of a batch; per splat that waits; least for splats that wait and samples; and maximum
# number of bands
BRICKS, THREAD, BATCHED, WAITING, LEAST, MOST_BANDS = 350 << 20, 120 << 20, 270, 64, 32 << 20, 16
# bytes per sample of the picture: target, resolved and read-back copies, and open sheets; of these the latter, of which
# a picture without bricks has those of a band; samples of a band; samples of a pixel where voxels are not narrower than
# pixels
SAMPLE, OPEN_SHEETS, BAND, MOST_FINE = 160, 120, 1 << 20, 4
# boxes that are read for an estimate, voxels along their sides, and steps between them as shares of the volume's sides:
# the R sequence in three dimensions, which leaves no gaps (Roberts 2018)
PROBES, PROBE_SIDE, STEPS = 64, 24, (0.8191725134, 0.6710436067, 0.5497004779)
# standard errors that are added to an estimate, and the number of splats assumed if no box holds any
ERRORS, MISSED = 2.0, 3.0


@dataclass(frozen=True)
class MemoryEstimate:
    """Estimated memory of a picture. splats: estimated number; most: its upper limit, by the standard error.

    bytes: peak to extract and draw `most` splats at once. waiting: bytes of splats in bricks that wait to be drawn.
    samples: number of the picture's samples.
    """

    splats: int
    most: int
    bytes: int
    waiting: int
    samples: int

    def __str__(self) -> str:
        """Number of splats, and the memory for them and for everything else."""
        count = f"up to about {self.most:,} splats"
        samples = format_bytes(self.bytes - EACH * self.most)
        return f"{count} take {format_bytes(EACH * self.most)}, samples and pixels {samples}"

    def fitted(self, bricks: Bricks, memory: int) -> tuple[Bricks, int]:
        """The bricks and the number of bands of rows with which the process takes up to `memory` bytes. Raises
        InputError if it takes more with any.
        """
        least = bricks.least(self.parted)
        if least > memory:
            this, fix = f"at least {format_bytes(least)} for this picture", "a smaller --size or a coarser --level"
            raise expected("memory", this, format_bytes(memory), f"give more --memory, {fix}")
        bricks = bricks.limited(memory, self.parted)
        room = max(memory - bricks.fixed, LEAST)
        return bricks, int(np.clip(-(-self.parted // room), 1, MOST_BANDS))

    @property
    def parted(self) -> int:
        """Bytes of the samples and of splats that wait, which bands share."""
        return self.waiting + SAMPLE * self.samples


def needed_together(needs: Sequence[MemoryEstimate]) -> MemoryEstimate:
    """The memory of a picture of several channels, which share its samples and all that one volume needs beside."""
    samples = needs[0].samples
    own = sum(need.bytes - PROCESS - bytes_of_samples(samples) for need in needs)
    totals = {name: sum(getattr(need, name) for need in needs) for name in ("splats", "most", "waiting")}
    return MemoryEstimate(bytes=own + PROCESS + SAMPLE * samples, samples=samples, **totals)


def bytes_of_samples(count: int) -> int:
    """Bytes of the samples of a picture of one volume without bricks."""
    return (SAMPLE - OPEN_SHEETS) * count + OPEN_SHEETS * min(count, BAND)


def estimate_need(bricks: Bricks, pixels: int, enough: int) -> MemoryEstimate:
    """Estimates the memory of a picture. Reads nothing if all voxels fit into `enough` bytes and into the GPU.

    pixels: number of the picture's samples.
    """
    volume = bricks.volume
    mapped = isinstance(volume.samples, np.ndarray) and is_mapped(volume.samples)
    there = 0 if mapped else volume.count * volume.samples.dtype.itemsize
    other = PROCESS + bytes_of_samples(pixels) + there
    size = np.array(volume.shape[::-1])
    # a layer across the volume, as thick as a brick's diagonal, of which half is drawn on average
    layer = int(np.sort(size)[1:].prod() * min(SIDE, int(size.min())))
    all_splats = MemoryEstimate(volume.count, volume.count, other + EACH * volume.count, WAITING * layer, pixels)
    if all_splats.bytes <= enough and volume.count <= MOST_KEPT:
        return all_splats
    # boxes that hold more voxels than the volume give way to it
    side, count = (PROBE_SIDE, PROBES) if volume.count > PROBES * PROBE_SIDE**3 else (int(size.max()), 1)
    low = spread_places(np.maximum(size - side, 0), count)
    # a thin volume yields the same place several times
    low, same = np.unique(low, axis=0, return_inverse=True)
    probes = Bricks(volume, bricks.post, low, np.minimum(low + side, size), hidden=bricks.hidden)
    voxels = (probes.high - low).prod(axis=1)[same.ravel()]
    shares = np.array([len(probes.records(n)) for n in range(len(low))])[same.ravel()] / voxels
    share = float(np.average(shares, weights=voxels))
    # if no box holds a splat, as many as all boxes miss with a probability of 1/20
    most = min(max(share + ERRORS * float(shares.std()) / np.sqrt(count), MISSED / float(voxels.sum())), 1.0)
    splats, many = (int(np.ceil(part * volume.count)) for part in (share, most))
    return MemoryEstimate(splats, many, other + EACH * many, int(WAITING * share * layer), pixels)


def spread_places(most: np.ndarray, count: int) -> np.ndarray:
    """int64 [count, 3]: evenly distributed positions from 0 to `most` (x, y, z); so is every prefix of them."""
    place = (0.5 + np.outer(np.arange(count), STEPS)) % 1.0
    return np.asarray((place * most).round().astype(np.int64))


def bricks_of(volume: Volume, transfer: Transfer, settings: Settings) -> Bricks | None:
    """The volume in bricks; None if the settings need voxels classified before reconstruction."""
    if settings.classification == "pre" or why_only_pre(volume, transfer, 0.0) or why_per_splat(settings, moving=False):
        return None
    kernel = settings.kernel if settings.kernel != "auto" else POST_KERNEL
    largest = settings.shows_value and settings.join == "max"
    every = settings.shows_value and not largest
    return Bricks.of(volume, ValueClassifier.of(transfer.on(volume), kernel, volume.shape[::-1], every, largest))


def required_bricks(volume: Volume, transfer: Transfer, settings: Settings) -> Bricks:
    """The volume in bricks. Raises InputError, with the reason, if it needs voxels classified before reconstruction."""
    bricks = bricks_of(volume, transfer, settings)
    if bricks is None:
        why = why_only_pre(volume, transfer, 0.0) or why_per_splat(settings, moving=False) or "classification pre"
        raise expected("a picture in parts", "values classified after reconstruction", why, "draw it whole, alone")
    return bricks


def excess_need(bricks: Bricks, samples: int, memory: int) -> MemoryEstimate | None:
    """Memory needed by a picture of so many samples; None if all splats fit into `memory` bytes and the GPU."""
    wanted = estimate_need(bricks, samples, memory)
    return None if wanted.bytes <= memory and wanted.most <= MOST_KEPT else wanted


def excess_bricks(
    volume: Volume, transfer: Transfer, settings: Settings, view: Camera | tuple[int, int], threshold: float = 0.0
) -> tuple[Bricks, MemoryEstimate] | None:
    """The volume in bricks, and the memory of its picture; None if it fits into the budget and the GPU, and for voxels
    classified before reconstruction, or above a threshold. view: the camera, or the size alone.
    """
    bricks = None if threshold else bricks_of(volume, transfer, settings)
    if bricks is None:
        return None
    samples = bricks.samples(view, settings) if isinstance(view, Camera) else MOST_FINE * view[0] * view[1]
    need = excess_need(bricks, samples, budget())
    return (bricks, need) if need else None

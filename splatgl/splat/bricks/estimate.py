"""How much memory a picture of values takes, before anything but some small boxes is read."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from splatgl.fileio import budget as budget
from splatgl.fileio import size_of
from splatgl.readers.common import is_mapped
from splatgl.splat.bricks.bricks import SIDE, Bricks
from splatgl.splat.extraction.splats import MOST_KEPT

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

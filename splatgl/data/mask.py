"""`Mask`: which places of the world are kept, voxel by voxel of a grid of its own."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.data.volume import Places, Volume, with_parts
from splatgl.errors import InputError, expected

# numbers of labels behind a file's name; and the word behind it that keeps what lies outside
LABELS = re.compile(r"-?\d+(,-?\d+)*")
OUTSIDE = "outside"
# steps by which rows of a mask may leave those of a volume, at their ends, and still be alike
ROW_TOLERANCE = 1e-3
# what rounding may take from a place between two voxels
SLACK = 1e-6
# numbers that a message names
MOST_SHOWN = 20


@dataclass(frozen=True, eq=False)
class Mask:
    """inside bool [D, H, W] (z, y, x), of voxels of `grid`, whose samples are not read. outside: whether what lies
    outside of these is kept instead, and all beyond the grid.
    """

    inside: np.ndarray
    grid: Volume
    outside: bool = False

    @classmethod
    def of(cls, source: Volume, labels: Sequence[int] = (), outside: bool = False) -> Mask:
        """Inside are the voxels of a volume that are not 0 (nor NaN), or those of some labels. Raises InputError for a
        label that there is not, and if nothing is inside.
        """
        what = f"mask {source.name}".strip()
        # of segments that overlap, each in its channel
        parts = source.channels if source.channels and all(each.labels for each in source.channels) else (source,)
        every = [np.asarray(each.samples) for each in parts]
        if labels:
            there = np.unique(np.concatenate([np.unique(samples) for samples in every]))
            for number in labels:
                if number not in there:
                    shown = ", ".join(f"{each:g}" for each in there[:MOST_SHOWN]) + ", …" * (len(there) > MOST_SHOWN)
                    raise expected(what, f"labels among {shown}", number)
            inside = np.logical_or.reduce([np.isin(samples, list(labels)) for samples in every])
        else:
            inside = np.logical_or.reduce([(samples != 0) & (samples == samples) for samples in every])
        if not inside.any():
            raise expected(what, "voxels that are not 0", "none")
        bare = replace(source, samples=inside, color=None, vectors=None, coarser=(), channels=(), masks=())
        return cls(inside, bare, outside)

    def keeps(self, volume: Volume, low: Places, high: Places) -> np.ndarray:
        """bool: which voxels low ≤ (z, y, x) < high of a volume are kept: those whose centres lie in voxels inside,
        or in none. Where one says LPS and the other RAS, x and y are turned.
        """
        turn = np.diag([-1.0, -1.0, 1.0]) if {self.grid.frame, volume.frame} == {"LPS", "RAS"} else np.eye(3)
        into = np.linalg.inv(self.grid.world_from_index)
        step = into @ turn @ volume.world_from_index
        start = into @ (turn @ np.asarray(volume.origin) - np.asarray(self.grid.origin))
        across = step - np.diag(np.diag(step))
        if (np.abs(across) * max(volume.shape)).max() < ROW_TOLERANCE:
            found = self._along(np.diag(step), start, low, high)
        else:
            # plane by plane
            planes = range(low[0], high[0])
            found = np.stack([self._plane(step, start, z, low, high) for z in planes])
        return ~found if self.outside else found

    def _along(self, step: np.ndarray, start: np.ndarray, low: Places, high: Places) -> np.ndarray:
        """What is inside, where rows of both grids have the same directions."""
        shape = self.inside.shape
        found = np.zeros([b - a for a, b in zip(low, high, strict=True)], bool)
        at, some = [], []
        for axis, (first, last) in enumerate(zip(low, high, strict=True)):
            place = _nearest(np.arange(first, last) * step[2 - axis] + start[2 - axis])
            there = np.flatnonzero((place >= 0) & (place < shape[axis]))
            at.append(place[there])
            some.append(there)
        found[np.ix_(*some)] = self.inside[np.ix_(*at)]
        return found

    def _plane(self, step: np.ndarray, start: np.ndarray, z: int, low: Places, high: Places) -> np.ndarray:
        """What is inside of a plane of a volume."""
        y, x = np.meshgrid(np.arange(low[1], high[1]), np.arange(low[2], high[2]), indexing="ij")
        places = [_nearest(row[0] * x + row[1] * y + (row[2] * z + own)) for row, own in zip(step, start, strict=True)]
        there = np.ones(x.shape, bool)
        for place, size in zip(places, self.inside.shape[::-1], strict=True):
            there &= (place >= 0) & (place < size)
        x, y, z_ = (np.where(there, place, 0) for place in places)
        return np.asarray(there & self.inside[z_, y, x])


def make_mask(given: Any, volume: Volume, labels: Sequence[int] = (), outside: bool = False) -> Mask:
    """The mask of a volume, of an array [D, H, W] on the grid of `volume`, or of FILE[:N,N…][:outside]."""
    from splatgl.readers import load

    if isinstance(given, Mask):
        return given
    if isinstance(given, str | Path):
        file, numbers, beyond = parse_mask(str(given))
        if not file:
            raise expected("mask", "FILE[:N,N…][:outside]", repr(str(given)))
        try:
            source = load(file)
        except InputError as error:
            raise InputError(f"mask {error}") from error
        return Mask.of(source, (*labels, *numbers), outside != beyond)
    if isinstance(given, Volume):
        return Mask.of(given, labels, outside)
    array = np.asarray(given)
    if array.shape != volume.shape:
        raise expected("mask", f"an array {volume.shape} on the volume's grid, a Volume or a file", array.shape)
    grid = replace(
        volume, samples=array, name="", color=None, vectors=None, coarser=(), channels=(), masks=(), notes=()
    )
    return Mask.of(grid, labels, outside)


def parse_mask(text: str) -> tuple[str, tuple[int, ...], bool]:
    """File, labels and whether the outside is kept, of FILE[:N,N…][:outside]."""
    head, colon, last = text.rpartition(":")
    outside = bool(colon) and last == OUTSIDE
    text = head if outside else text
    head, colon, last = text.rpartition(":")
    if colon and LABELS.fullmatch(last):
        return head, tuple(int(number) for number in last.split(",")), outside
    return text, (), outside


def apply_mask(volume: Volume, mask: Mask) -> Volume:
    """The volume, its channels and levels, cut by one more mask, with a note on how much is left. Raises InputError if
    nothing is.
    """
    found = replace(volume, masks=(*volume.masks, mask))
    left = sum(int(found.kept((z, 0, 0), (z + 1, *volume.shape[1:])).sum()) for z in range(volume.shape[0]))
    what = f"mask {mask.grid.name}".strip()
    if not left:
        ours, theirs = (_describe_box(each, turned) for each, turned in ((mask.grid, volume.frame), (volume, None)))
        places = f"voxels of {volume.name or 'the volume'}, which lies at {theirs}"
        raise expected(what, places, f"none: it lies at {ours}" if not mask.outside else "none outside of it")
    share = "all" if left == volume.count else f"{left / volume.count:.3g}" if left * 1000 < volume.count else ""
    of_mask = (f"{what}: {note}" for note in mask.grid.notes)
    told = f"{what} keeps {share or f'{left / volume.count:.1%}'} of the voxels"
    made = replace(found, notes=(*volume.notes, *of_mask, told))
    made = with_parts(made, lambda part: replace(part, masks=(*part.masks, mask)))
    # not to be looked up again
    vars(made).update({name: value for name, value in vars(found).items() if name == "_kept"})
    return made


def _describe_box(volume: Volume, frame: str | None) -> str:
    """The ends of a volume's box, for a message, in a frame."""
    corners = volume.corners * ((-1, -1, 1) if {volume.frame, frame} == {"LPS", "RAS"} else (1, 1, 1))
    ends = zip("xyz", corners.min(axis=0), corners.max(axis=0), strict=True)
    return ", ".join(f"{axis} {low:.4g}…{high:.4g}" for axis, low, high in ends)


def _nearest(place: np.ndarray) -> np.ndarray:
    return np.floor(place + (0.5 + SLACK)).astype(np.int64)

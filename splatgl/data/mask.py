"""`Mask`: the part of the world that is visible, voxel by voxel on its own grid."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.data.volume import Places, Volume, with_parts
from splatgl.errors import InputError, expected, list_names

# label numbers behind a file name, and the word that keeps the outside instead
LABELS = re.compile(r"-?\d+(,-?\d+)*")
OUTSIDE = "outside"
# steps by which the rows of mask and volume may diverge at their ends and still count as parallel
ROW_TOLERANCE = 1e-3
# rounding error of a position between two voxels
SLACK = 1e-6


@dataclass(frozen=True, eq=False)
class Mask:
    """inside: bool [D, H, W] (z, y, x), for the voxels of `grid`, whose samples are not used. outside: whether all
    other voxels are kept instead, and everything beyond the grid.
    """

    inside: np.ndarray
    grid: Volume
    outside: bool = False

    @classmethod
    def of(cls, source: Volume, labels: Sequence[int] = (), outside: bool = False) -> Mask:
        """Mask of voxels that are neither 0 nor NaN, or have one of `labels`. Raises InputError for unknown labels."""
        what = f"mask {source.name}".strip()
        # segments that overlap are in several channels
        parts = source.channels if source.channels and all(channel.labels for channel in source.channels) else (source,)
        arrays = [np.asarray(part.samples) for part in parts]
        if labels:
            arrays = [np.asarray((part.rounded() or part).samples) for part in parts]
            known = np.unique(np.concatenate([np.unique(samples) for samples in arrays]))
            for number in labels:
                if number not in known:
                    raise expected(what, f"labels among {list_names([f'{n:g}' for n in known], 20)}", number)
            inside = np.logical_or.reduce([np.isin(samples, list(labels)) for samples in arrays])
        else:
            inside = np.logical_or.reduce([(samples != 0) & (samples == samples) for samples in arrays])
        if not inside.any():
            raise expected(what, "voxels that are not 0", "none")
        grid = replace(source, samples=inside, color=None, vectors=None, coarser=(), channels=(), masks=())
        return cls(inside, grid, outside)

    def keeps(self, volume: Volume, low: Places, high: Places) -> np.ndarray:
        """bool: whether each voxel low ≤ (z, y, x) < high of a volume is kept: its centre lies in a voxel inside (or
        outside, if so), in the mask's frame and unit.
        """
        turn = np.diag(volume.world.factors(self.grid.world))
        into = np.linalg.inv(self.grid.world_from_index)
        step = into @ turn @ volume.world_from_index
        start = into @ (turn @ np.asarray(volume.origin) - np.asarray(self.grid.origin))
        across = step - np.diag(np.diag(step))
        if (np.abs(across) * max(volume.shape)).max() < ROW_TOLERANCE:
            inside = self._along(np.diag(step), start, low, high)
        else:
            # plane by plane
            planes = range(low[0], high[0])
            inside = np.stack([self._plane(step, start, z, low, high) for z in planes])
        return ~inside if self.outside else inside

    def shares(self, volume: Volume, low: Places, high: Places) -> np.ndarray:
        """uint8: 255 for each voxel low ≤ (z, y, x) < high of a volume that is kept, else 0."""
        return self.keeps(volume, low, high) * np.uint8(255)

    @property
    def name(self) -> str:
        """Name of the mask's file."""
        return self.grid.name

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes of the mask's reader."""
        return self.grid.notes

    def _along(self, step: np.ndarray, start: np.ndarray, low: Places, high: Places) -> np.ndarray:
        """bool: voxels inside, for grids whose axes are parallel."""
        shape = self.inside.shape
        inside = np.zeros([b - a for a, b in zip(low, high, strict=True)], bool)
        sources, targets = [], []
        for axis, (first, last) in enumerate(zip(low, high, strict=True)):
            place = _nearest(np.arange(first, last) * step[2 - axis] + start[2 - axis])
            valid = np.flatnonzero((place >= 0) & (place < shape[axis]))
            sources.append(place[valid])
            targets.append(valid)
        inside[np.ix_(*targets)] = self.inside[np.ix_(*sources)]
        return inside

    def _plane(self, step: np.ndarray, start: np.ndarray, z: int, low: Places, high: Places) -> np.ndarray:
        """bool: voxels inside, for one plane of a volume."""
        y, x = np.meshgrid(np.arange(low[1], high[1]), np.arange(low[2], high[2]), indexing="ij")
        places = _nearest(np.tensordot(step, np.stack([x, y, np.full_like(x, z)]), 1) + start[:, None, None])
        valid = ((places >= 0) & (places < np.reshape(self.inside.shape[::-1], (3, 1, 1)))).all(axis=0)
        x, y, planes = np.where(valid, places, 0)
        return np.asarray(valid & self.inside[planes, y, x])


def make_mask(source: Any, volume: Volume, labels: Sequence[int] = (), outside: bool = False) -> Mask:
    """The mask of a volume, of an array [D, H, W] on the grid of `volume`, or of FILE[:N,N…][:outside]."""
    from splatgl.readers import load

    if hasattr(source, "shares"):
        return source
    if isinstance(source, str | Path):
        file, numbers, beyond = parse_mask(str(source))
        if not file:
            raise expected("mask", "FILE[:N,N…][:outside]", repr(str(source)))
        try:
            source = load(file)
        except InputError as error:
            raise InputError(f"mask {error}") from error
        return Mask.of(source, (*labels, *numbers), outside != beyond)
    if isinstance(source, Volume):
        return Mask.of(source, labels, outside)
    array = np.asarray(source)
    if array.shape != volume.shape:
        raise expected("mask", f"an array {volume.shape} on the volume's grid, a Volume or a file", array.shape)
    return Mask.of(replace(volume, samples=array, name="", channels=(), notes=()), labels, outside)


def parse_mask(text: str) -> tuple[str, tuple[int, ...], bool]:
    """File, labels and whether the outside is kept, of FILE[:N,N…][:outside], or without a file."""
    head, colon, last = text.rpartition(":")
    outside = bool(colon) and last == OUTSIDE
    text = head if outside else text
    head, _, last = text.rpartition(":")
    if LABELS.fullmatch(last):
        return head, tuple(int(number) for number in last.split(",")), outside
    return text, (), outside


def apply_mask(volume: Volume, mask: Any) -> Volume:
    """The volume with one more mask, and a note on how much is left. Raises InputError if nothing is left."""
    masked = replace(volume, masks=(*volume.masks, mask))
    left = sum(int(masked.kept((z, 0, 0), (z + 1, *volume.shape[1:])).sum()) for z in range(volume.shape[0]))
    what = f"mask {mask.name}".strip()
    if not left and not isinstance(mask, Mask):
        raise expected(what, f"an outline that leaves some of {volume.name or 'the volume'}", "none left")
    if not left:
        mask_box, volume_box = (_describe_box(grid, volume) for grid in (mask.grid, volume))
        places = f"voxels of {volume.name or 'the volume'}, which lies at {volume_box}"
        raise expected(what, places, f"none: it lies at {mask_box}" if not mask.outside else "none outside of it")
    share = "all" if left == volume.count else f"{left / volume.count:.3g}" if left * 1000 < volume.count else ""
    of_mask = (f"{what}: {note}" for note in mask.notes)
    note = f"{what} keeps {share or f'{left / volume.count:.1%}'} of the voxels"
    result = replace(masked, notes=(*volume.notes, *of_mask, note))
    result = with_parts(result, lambda part: replace(part, masks=(*part.masks, mask)))
    # reuse the mask that was computed above
    vars(result).update({name: value for name, value in vars(masked).items() if name == "_cached_mask"})
    return result


def _describe_box(volume: Volume, other: Volume) -> str:
    """The ends of a volume's box in the world of another one, as text."""
    corners = volume.corners * volume.world.factors(other.world)
    ends = zip("xyz", corners.min(axis=0), corners.max(axis=0), strict=True)
    return ", ".join(f"{axis} {low:.4g}…{high:.4g}" for axis, low, high in ends)


def _nearest(place: np.ndarray) -> np.ndarray:
    return np.floor(place + (0.5 + SLACK)).astype(np.int64)

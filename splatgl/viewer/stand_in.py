"""Stand-ins for volumes that do not fit into memory: coarser levels, or means over blocks.

A coarse stand-in is shown at once; finer voxels are read in a thread.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from splatgl.data.volume import FEWEST, Volume, halve_volume, subsample
from splatgl.fileio import budget, format_bytes
from splatgl.planning.bricks import bricks_of, estimate_need
from splatgl.splat.settings import Settings
from splatgl.splat.splats import MOST_KEPT
from splatgl.transfer.transfer import Transfer

# most voxels that are read and shown at once, of a stand-in, and of a level that has coarser ones
LARGE, STAND_IN, MOST_OF_LEVEL = 1 << 23, 1 << 23, 1 << 28
# pixels of a window, all samples
PIXELS = 4 << 20


@dataclass(frozen=True, eq=False)
class StandIn:
    """Visible voxels of a volume. note: description, "" for all voxels. finer: reads the finer ones, if any.

    level: its number in a multiscale image, with which the scene is saved; None for others.
    """

    volume: Volume
    note: str = ""
    finer: Callable[[], StandIn] | None = None
    level: int | None = None


def choose_stand_in(volume: Volume, transfer: Transfer, settings: Settings) -> StandIn:
    """Chooses the first stand-in: the finest level that fits into half of free memory."""
    most = budget()
    if not volume.coarser and _fits(volume, transfer, settings, most):
        return StandIn(volume)
    levels = _levels(volume)
    number = next((n for n, level in enumerate(levels) if _fits(level, transfer, settings, most)), None)
    if number is not None:
        first = number if levels[number].count <= LARGE else len(levels) - 1
        return _level(levels, first, number)
    base = levels[-1]
    step = max(2, int(np.ceil((base.count / STAND_IN) ** (1 / 3))))
    return StandIn(subsample(base, step), f"every {_nth(step)} voxel", lambda: _means(base, transfer, settings, most))


def _means(volume: Volume, transfer: Transfer, settings: Settings, most: int) -> StandIn:
    """Means over the smallest blocks of voxels that fit; for labels, the most frequent label of each block."""
    labels = bool(transfer.labels)
    means, side = halve_volume(volume, labels), 2
    while not _fits(means, transfer, settings, most) and max(means.shape) >= FEWEST:
        means, side = halve_volume(means, labels), 2 * side
    what = "most frequent labels" if labels else "means"
    return StandIn(means, f"{what} of {side}^3 voxels: smaller ones need more than {format_bytes(most)}")


def _levels(volume: Volume) -> list[Volume]:
    """Levels of a multiscale image, finest first, each with its coarser levels."""
    levels = [volume, *(replace(level, name=volume.name, hints=volume.hints) for level in volume.coarser)]
    return [replace(level, coarser=tuple(levels[number + 1 :])) for number, level in enumerate(levels)]


def _level(levels: list[Volume], number: int, finest: int) -> StandIn:
    """A level, which finer levels replace one by one."""
    volume, last = levels[number], len(levels) - 1
    note = f"level {number} of {last}, {' x '.join(map(str, volume.shape[::-1]))} voxels" if number else ""
    if number > finest:
        return StandIn(volume, note, lambda: _level(levels, number - 1, finest), number)
    return StandIn(volume, f"{note}: finer ones are too large for a window" if number else "", None, number)


def _fits(volume: Volume, transfer: Transfer, settings: Settings, most: int) -> bool:
    """Whether a volume fits; a level with coarser ones must also be drawn quickly."""
    if volume.coarser and volume.count > MOST_OF_LEVEL:
        return False
    bricks = bricks_of(volume, transfer, settings)
    if bricks is None:
        return True
    wanted = estimate_need(bricks, PIXELS, most)
    return wanted.bytes <= most and not (volume.coarser and wanted.most > MOST_KEPT)


def _nth(step: int) -> str:
    return f"{step}{ {2: 'nd', 3: 'rd'}.get(step, 'th') }"

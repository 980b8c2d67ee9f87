"""What of a volume the window shows: all of it if it fits into memory, else its finest level or means that do.

A stand-in comes at once; what is finer is read behind it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from splatgl.data.volume import FEWEST, Volume, halve_volume
from splatgl.fileio import budget, format_bytes
from splatgl.splat.bricks import bricks_of, estimate_need
from splatgl.splat.settings import Settings
from splatgl.splat.splats import MOST_KEPT
from splatgl.splat.transfer import Transfer

# voxels that are read and shown at once, of a stand-in at most, and of a level that has coarser ones at most
LARGE, STAND_IN, MOST_OF_LEVEL = 1 << 23, 1 << 23, 1 << 28
# pixels of a window, all samples
PIXELS = 4 << 20


@dataclass(frozen=True, eq=False)
class StandIn:
    """What is shown of a volume. told: what that is, "" if it is all. finer: reads what is to replace it, if any.

    level: its number in a multiscale image, with which the scene is saved; None for others.
    """

    volume: Volume
    told: str = ""
    finer: Callable[[], StandIn] | None = None
    level: int | None = None


def choose_stand_in(volume: Volume, transfer: Transfer, settings: Settings) -> StandIn:
    """The portion of a volume to begin with. Its memory is estimated for half of what is free."""
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


def subsample(volume: Volume, step: int) -> Volume:
    """Every so many voxels along each axis, plane by plane: a mapped file is read there only."""
    color = volume.color
    planes = [np.asarray(volume.samples[z])[::step, ::step] for z in range(0, volume.shape[0], step)]
    x, y, z = volume.spacing
    return replace(
        volume,
        samples=np.stack(planes),
        color=None if color is None else np.asarray(color[::step, ::step, ::step]),
        vectors=None,
        spacing=(x * step, y * step, z * step),
    )


def _means(volume: Volume, transfer: Transfer, settings: Settings, most: int) -> StandIn:
    """Means over blocks of voxels, of labels what most of a block are, as small as fit."""
    labels = bool(transfer.labels)
    found, side = halve_volume(volume, labels), 2
    while not _fits(found, transfer, settings, most) and max(found.shape) >= FEWEST:
        found, side = halve_volume(found, labels), 2 * side
    what = "most frequent labels" if labels else "means"
    return StandIn(found, f"{what} of {side}^3 voxels: smaller ones need more than {format_bytes(most)}")


def _levels(volume: Volume) -> list[Volume]:
    """Those of a multiscale image, finest first, each with its coarser ones."""
    levels = [volume, *(replace(level, name=volume.name, hints=volume.hints) for level in volume.coarser)]
    return [replace(level, coarser=tuple(levels[number + 1 :])) for number, level in enumerate(levels)]


def _level(levels: list[Volume], number: int, finest: int) -> StandIn:
    """One level, which finer ones replace one by one."""
    volume, last = levels[number], len(levels) - 1
    told = f"level {number} of {last}, {' x '.join(map(str, volume.shape[::-1]))} voxels" if number else ""
    if number > finest:
        return StandIn(volume, told, lambda: _level(levels, number - 1, finest), number)
    return StandIn(volume, f"{told}: finer ones are too large for a window" if number else "", None, number)


def _fits(volume: Volume, transfer: Transfer, settings: Settings, most: int) -> bool:
    """Whether a volume is shown; a level that has coarser ones only if all of it can be drawn in a moment, too."""
    if volume.coarser and volume.count > MOST_OF_LEVEL:
        return False
    bricks = bricks_of(volume, transfer, settings)
    if bricks is None:
        return True
    wanted = estimate_need(bricks, PIXELS, most)
    return wanted.bytes <= most and not (volume.coarser and wanted.most > MOST_KEPT)


def _nth(step: int) -> str:
    return f"{step}{ {2: 'nd', 3: 'rd'}.get(step, 'th') }"

"""Antialiased straight lines, all at once: pixels near segments, and how far these are from them."""

from __future__ import annotations

import numpy as np


def near(segments: np.ndarray, reach: float, size: tuple[int, int], scratch: np.ndarray) -> np.ndarray:
    """Numbers [N] of pixels whose centres are within `reach` pixels of segments [S, 4], (x, y, x, y).

    scratch [H · W]: infinite; there, at these numbers, the distances are written. What is as near to two is told twice.
    """
    width, height = size
    inside = clipped(segments, (-reach, -reach, width + reach, height + reach))
    if not len(inside):
        return np.zeros(0, np.intp)
    start, along = inside[:, :2], inside[:, 2:] - inside[:, :2]
    length = np.hypot(along[:, 0], along[:, 1])
    # a dot has any direction
    unit = np.where(length[:, None] > 0, along / np.where(length > 0, length, 1.0)[:, None], [1.0, 0.0])
    # steps along the axis that a segment runs along most, and, at each, as many pixels across as any needs
    steep = np.abs(along[:, 1]) > np.abs(along[:, 0])
    ends = np.sort(np.where(steep[:, None], inside[:, [1, 3]], inside[:, [0, 2]]), axis=1)
    first = np.floor(ends[:, 0] - reach).astype(np.intp)
    steps = np.floor(ends[:, 1] + reach).astype(np.intp) - first + 1
    owner = np.repeat(np.arange(len(inside)), steps)
    major = np.arange(len(owner)) - np.repeat(np.cumsum(steps) - steps - first, steps)
    # each segment as if its steps ran along the first of two axes; past its ends the line goes on
    swap = np.where(steep[:, None], np.array([1, 0]), np.array([0, 1]))
    run, rise = (np.take_along_axis(unit, swap[:, n : n + 1], 1)[:, 0] for n in (0, 1))
    at, beside = (np.take_along_axis(start, swap[:, n : n + 1], 1)[:, 0] for n in (0, 1))
    slope = rise / np.where(run == 0, 1.0, run)
    wide = int(np.ceil(2 * reach * np.sqrt(2))) + 2
    ahead = major + 0.5 - at[owner]
    minor = np.floor(beside[owner] + slope[owner] * ahead - wide / 2).astype(np.intp)
    across = minor + 0.5 - beside[owner]
    # both distances are linear in the pixels across
    run, rise = run[owner].astype(np.float32), rise[owner].astype(np.float32)
    pixels = np.arange(wide, dtype=np.float32)
    place = (ahead * run + across * rise).astype(np.float32)[:, None] + pixels * rise[:, None]
    off = (across * run - ahead * rise).astype(np.float32)[:, None] + pixels * run[:, None]
    beyond = np.maximum(np.maximum(-place, place - length[owner, None].astype(np.float32)), 0)
    apart = np.hypot(off, beyond)
    most = np.where(steep, width, height)[owner, None]
    column = minor[:, None] + np.arange(wide)
    lies = (major >= 0) & (major < np.where(steep, height, width)[owner])
    kept = (apart <= reach) & (column >= 0) & (column < most) & lies[:, None]
    stride = np.where(steep, width, 1)[owner], np.where(steep, 1, width)[owner]
    number = ((major * stride[0])[:, None] + column * stride[1][:, None])[kept]
    apart = apart[kept]
    np.minimum.at(scratch, number, apart)
    # each pixel once, as a rule: where it is nearest
    return np.asarray(number[scratch[number] == apart])


def clipped(segments: np.ndarray, box: tuple[float, float, float, float]) -> np.ndarray:
    """The parts [M, 4] of segments [S, 4] within a box (left, top, right, bottom); Liang and Barsky 1984."""
    start, along = segments[:, :2], segments[:, 2:] - segments[:, :2]
    enter, leave = np.zeros(len(segments)), np.ones(len(segments))
    meets = np.ones(len(segments), bool)
    for axis in (0, 1):
        still = along[:, axis] == 0
        step = np.where(still, 1.0, along[:, axis])
        ends = np.sort((np.array([box[axis], box[axis + 2]]) - start[:, axis, None]) / step[:, None], axis=1)
        enter = np.where(still, enter, np.maximum(enter, ends[:, 0]))
        leave = np.where(still, leave, np.minimum(leave, ends[:, 1]))
        meets &= ~still | ((start[:, axis] >= box[axis]) & (start[:, axis] <= box[axis + 2]))
    meets &= enter <= leave
    found = np.concatenate([start + along * enter[:, None], start + along * leave[:, None]], axis=1)
    return np.asarray(found[meets])


def dashes(segments: np.ndarray, dash: float, gap: float) -> np.ndarray:
    """Segments [S, 4] as dashes [D, 4] of one length, from the first point on; the last one may be shorter."""
    length = np.hypot(*(segments[:, 2:] - segments[:, :2]).T)
    count = np.ceil(length / (dash + gap)).astype(np.intp)
    owner = np.repeat(np.arange(len(segments)), count)
    from_ = (np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)) * (dash + gap)
    to = np.minimum(from_ + dash, length[owner])
    start = segments[owner, :2]
    unit = (segments[owner, 2:] - start) / np.where(length > 0, length, 1.0)[owner, None]
    return np.concatenate([start + unit * from_[:, None], start + unit * to[:, None]], axis=1)

"""Views of arrays that are no numpy arrays: some of their axes, in another order; owners that are kept alive."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

Key = int | slice | tuple[int | slice, ...]


class Turned:
    """Axes of an array that is read in parts, in another order; slices of it are numpy arrays.

    axes: for z, y, x, the axis of `array` that it is, counted from behind `lead`: places along its first axes.
    """

    def __init__(self, array: Any, axes: Sequence[int] = (0, 1, 2), lead: tuple[int, ...] = ()) -> None:
        self.array, self.axes, self.lead = array, tuple(axes), lead
        self.shape = tuple(int(array.shape[len(lead) + axis]) for axis in axes)
        self.dtype = np.dtype(array.dtype)

    def __getitem__(self, key: Key) -> np.ndarray:
        given = key if isinstance(key, tuple) else (key,)
        whole = given + (slice(None),) * (len(self.shape) - len(given))
        # numbers as slices, so that all axes are there to be turned
        slices = [slice(k, k + 1 or None) if isinstance(k, int | np.integer) else k for k in whole]
        own = tuple(slices[self.axes.index(axis)] for axis in range(len(self.axes)))
        part = np.asarray(self.array[self.lead + own]).transpose(self.axes)
        return part[tuple(0 if isinstance(k, int | np.integer) else slice(None) for k in whole)]


def kept(view: np.ndarray, owner: Any) -> np.ndarray:
    """The same memory as an array that keeps `owner`, whose memory it is, alive."""
    return np.asarray(_Kept(view, owner))


class _Kept:
    def __init__(self, view: np.ndarray, owner: Any) -> None:
        self.__array_interface__ = view.__array_interface__
        self.held = (view, owner)

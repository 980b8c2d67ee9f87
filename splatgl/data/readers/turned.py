"""`Turned`: an array of a store with its axes in another order, and axes of one entry that it lacks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from splatgl.data.readers.chunked import Files


class Turned:
    """An array behind the interface that `Chunked` reads; nothing is read before it is indexed.

    names: one per axis of the array; wanted: the same in the order wanted. A further one is an axis of one entry.
    """

    def __init__(self, array: Any, names: Sequence[str], wanted: Sequence[str]) -> None:
        self.array = array
        self.order = [names.index(name) if name in names else None for name in wanted]
        self.shape = tuple(1 if axis is None else int(array.shape[axis]) for axis in self.order)
        self.chunks = tuple(1 if axis is None else int(array.chunks[axis]) for axis in self.order)
        self.dtype, self.fill_value = array.dtype, array.fill_value

    def source(self, place: Sequence[Any]) -> tuple[Any, ...]:
        """What belongs to each axis of the array, of a place or an index along the turned axes."""
        found = {axis: each for axis, each in zip(self.order, place, strict=True) if axis is not None}
        return tuple(found[axis] for axis in range(len(found)))

    def __getitem__(self, index: Sequence[int | slice]) -> np.ndarray:
        free = [axis for axis, at in zip(self.order, index, strict=True) if isinstance(at, slice)]
        kept = sorted(axis for axis in free if axis is not None)
        part = np.asarray(self.array[self.source(index)]).transpose([kept.index(a) for a in free if a is not None])
        return np.expand_dims(part, free.index(None)) if None in free else part


class TurnedFiles:
    """The files of the array behind a `Turned`, asked for by its places."""

    def __init__(self, files: Files, array: Turned) -> None:
        self.files, self.array = files, array

    def tag(self) -> str:
        """That of the files."""
        return self.files.tag()

    def ready(self, places: Iterable[Sequence[int]]) -> None:
        """Brings the files of those places."""
        self.files.ready(self.array.source(place) for place in places)

    def holds(self, place: Sequence[int]) -> bool:
        """Whether there is a file of that place."""
        return self.files.holds(self.array.source(place))

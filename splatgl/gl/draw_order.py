"""Drawing orders: as indices on the GPU, of the latest views, and in chunks where splats are too many to be kept."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import Generic, TypeVar
from weakref import WeakKeyDictionary

import moderngl
import numpy as np

from splatgl.splat.order import Order, back_to_front
from splatgl.splat.rows import MOST_KEPT, Splats

# bytes of drawing orders kept, 4 a splat: what a hand that turns to and fro comes back to, not what a movie passes once
ORDER_BYTES = 2**25
# splats that are uploaded at a time where they are too many to be kept
CHUNK = 2**22

# what is drawn in which order; None: any will do. nearest first or last
Sequence = tuple[Order | None, bool]
# [begin, end) of the drawing order
Range = tuple[int, int]
# a list of indices
Listed = TypeVar("Listed", bound=moderngl.Buffer | moderngl.Texture)
# the latest drawing order of splats that are uploaded in chunks
_latest: WeakKeyDictionary[Splats, tuple[Order, np.ndarray]] = WeakKeyDictionary()


def chunks(which: Range) -> list[Range]:
    """The range, or ranges that make it up, of splats that are on the GPU at a time."""
    begin, end = which
    if end - begin <= MOST_KEPT:
        return [which]
    return [(first, min(first + CHUNK, end)) for first in range(begin, end, CHUNK)]


def indices(splats: Splats, sequence: Sequence) -> np.ndarray:
    """int64 [N]: the records in drawing order."""
    order, nearest_first = sequence
    assert order is not None
    kept = _latest.get(splats)
    found = kept[1] if kept and kept[0] == order else back_to_front(splats, order)
    if len(splats) > MOST_KEPT:
        _latest[splats] = order, found
    return found[::-1] if nearest_first else found


class Orders(Generic[Listed]):
    """The latest drawing orders on the GPU. make: of indices, uint32 [N]; forget: told what goes."""

    def __init__(
        self, splats: Splats, make: Callable[[np.ndarray], Listed], forget: Callable[[Sequence], None] | None = None
    ) -> None:
        self.splats, self.make, self.forget = splats, make, forget
        self.kept: OrderedDict[Sequence, Listed] = OrderedDict()

    def of(self, sequence: Sequence) -> Listed | None:
        """The list of indices; None for any order."""
        if sequence[0] is None:
            return None
        if sequence in self.kept:
            self.kept.move_to_end(sequence)
            return self.kept[sequence]
        if len(self.kept) > 1 and (len(self.kept) + 1) * 4 * len(self.splats) > ORDER_BYTES:
            oldest, listed = self.kept.popitem(last=False)
            if self.forget:
                self.forget(oldest)
            listed.release()
        self.kept[sequence] = self.make(indices(self.splats, sequence).astype(np.uint32))
        return self.kept[sequence]

    def release(self) -> None:
        while self.kept:
            self.kept.popitem()[1].release()

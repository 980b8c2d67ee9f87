"""Drawing orders: as indices on the GPU, of the latest views, and in chunks where splats are too many to be kept."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import NamedTuple
from weakref import WeakKeyDictionary

import moderngl
import numpy as np

from splatgl.splat.extraction.order import Order, back_to_front
from splatgl.splat.extraction.splats import MOST_KEPT, Splats

# bytes of drawing orders kept, 4 a splat: what a hand that turns to and fro comes back to, not what a movie passes once
ORDER_BYTES = 2**25
# splats that are uploaded at a time where they are too many to be kept
CHUNK = 2**22

# [begin, end) of the drawing order
Range = tuple[int, int]
# the latest drawing order of splats that are uploaded in chunks
_latest: WeakKeyDictionary[Splats, tuple[Order, np.ndarray]] = WeakKeyDictionary()


class DrawOrder(NamedTuple):
    """boxes: in which the rows are read; None: any order will do."""

    boxes: Order | None
    nearest_first: bool


def chunks(which: Range) -> list[Range]:
    """The range, or ranges that make it up, of splats that are on the GPU at a time."""
    begin, end = which
    if end - begin <= MOST_KEPT:
        return [which]
    return [(first, min(first + CHUNK, end)) for first in range(begin, end, CHUNK)]


def indices(splats: Splats, order: DrawOrder) -> np.ndarray:
    """int64 [N]: the records in drawing order."""
    assert order.boxes is not None
    kept = _latest.get(splats)
    found = kept[1] if kept and kept[0] == order.boxes else back_to_front(splats, order.boxes)
    if len(splats) > MOST_KEPT:
        _latest[splats] = order.boxes, found
    return found[::-1] if order.nearest_first else found


class Orders:
    """The latest drawing orders on the GPU. make: a texture of indices, uint32 [N]."""

    def __init__(self, splats: Splats, make: Callable[[np.ndarray], moderngl.Texture]) -> None:
        self.splats, self.make = splats, make
        self.kept: OrderedDict[DrawOrder, moderngl.Texture] = OrderedDict()

    def of(self, order: DrawOrder) -> moderngl.Texture | None:
        """The list of indices; None for any order."""
        if order.boxes is None:
            return None
        if order in self.kept:
            self.kept.move_to_end(order)
            return self.kept[order]
        if len(self.kept) > 1 and (len(self.kept) + 1) * 4 * len(self.splats) > ORDER_BYTES:
            self.kept.popitem(last=False)[1].release()
        self.kept[order] = self.make(indices(self.splats, order).astype(np.uint32))
        return self.kept[order]

    def release(self) -> None:
        """Frees the textures of all orders."""
        while self.kept:
            self.kept.popitem()[1].release()

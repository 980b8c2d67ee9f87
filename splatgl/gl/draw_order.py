"""Drawing orders: cached as GPU index textures, and split into chunks for sets too large to keep on the GPU."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import NamedTuple
from weakref import WeakKeyDictionary

import moderngl
import numpy as np

from splatgl.splat.ordering import Order, back_to_front
from splatgl.splat.splats import MOST_KEPT, Splats

# cached drawing orders in bytes, 4 a splat: enough for interactive turning back and forth, not for a movie
ORDER_BYTES = 2**25
# splats per upload of sets too large to keep
CHUNK = 2**22

# [begin, end) of the drawing order
Range = tuple[int, int]
# latest drawing order of each set uploaded in chunks
_latest: WeakKeyDictionary[Splats, tuple[Order, np.ndarray]] = WeakKeyDictionary()


class DrawOrder(NamedTuple):
    """boxes: the order of the rows; None: any order will do."""

    boxes: Order | None
    nearest_first: bool


def chunks(which: Range) -> list[Range]:
    """The range split into the parts that are on the GPU at a time."""
    begin, end = which
    if end - begin <= MOST_KEPT:
        return [which]
    return [(first, min(first + CHUNK, end)) for first in range(begin, end, CHUNK)]


def indices(splats: Splats, order: DrawOrder) -> np.ndarray:
    """[N]: the records in drawing order."""
    assert order.boxes is not None
    kept = _latest.get(splats)
    found = kept[1] if kept and kept[0] == order.boxes else back_to_front(splats, order.boxes)
    if len(splats) > MOST_KEPT:
        _latest[splats] = order.boxes, found
    return found[::-1] if order.nearest_first else found


class Orders:
    """LRU cache of drawing orders on the GPU. make: creates a texture from indices [N]."""

    def __init__(self, splats: Splats, make: Callable[[np.ndarray], moderngl.Texture]) -> None:
        self.splats, self.make = splats, make
        self.kept: OrderedDict[DrawOrder, moderngl.Texture] = OrderedDict()

    def of(self, order: DrawOrder) -> moderngl.Texture | None:
        """The index texture; None if any order will do."""
        if order.boxes is None:
            return None
        if order in self.kept:
            self.kept.move_to_end(order)
            return self.kept[order]
        if len(self.kept) > 1 and (len(self.kept) + 1) * 4 * len(self.splats) > ORDER_BYTES:
            self.kept.popitem(last=False)[1].release()
        self.kept[order] = self.make(indices(self.splats, order))
        return self.kept[order]

    def release(self) -> None:
        """Frees the textures of all orders."""
        while self.kept:
            self.kept.popitem()[1].release()

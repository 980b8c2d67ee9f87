"""What is kept of splats for as long as they live, and what tells that they are the same."""

from __future__ import annotations

from collections.abc import Callable
from weakref import WeakKeyDictionary, ref

import numpy as np

from splatgl.splat.extraction.splats import Splats


class Same:
    """Equal to another `Same` of the same object while that lives: its `id` may belong to another one afterwards."""

    def __init__(self, it: object) -> None:
        self.it, self.number = ref(it), id(it)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Same) and (it := self.it()) is not None and it is other.it()

    def __hash__(self) -> int:
        return self.number


class LatestParts:
    """The latest part of each set of splats, for as long as the set lives."""

    def __init__(self) -> None:
        # of all splats None is kept: a set that its own entry holds would never be freed
        self._kept: WeakKeyDictionary[Splats, tuple[object, Splats | None]] = WeakKeyDictionary()

    def of(self, splats: Splats, key: object, keeps: Callable[[], np.ndarray]) -> Splats:
        """The splats where `keeps()` [N] is True, which is asked once while `key` stays the same."""
        latest = self._kept.get(splats)
        if latest is None or latest[0] != key:
            kept = keeps()
            latest = self._kept[splats] = key, None if kept.all() else splats.part(kept)
        return splats if latest[1] is None else latest[1]

"""Few of many choices of switches, in which every two values meet that meet in any."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Iterable

# a name, and pairs of a switch and its value
Key = tuple[object, ...]


def covering(keys: Iterable[Key]) -> list[Key]:
    """Some of the keys (name, *switches), such that each two switches that a name has in one of the keys are together
    in one of those returned: always the next key is that in which most pairs meet for the first time.
    """
    pairs: dict[Key, set[Key]] = {}
    for key in keys:
        name, *switches = key
        pairs[key] = {(name, *pair) for pair in itertools.combinations(switches, 2)} or {(name,)}
    # by bounds of the numbers of new pairs, which only fall
    queue = [(-len(new), number, key) for number, (key, new) in enumerate(pairs.items())]
    heapq.heapify(queue)
    met: set[Key] = set()
    chosen: list[Key] = []
    while queue:
        _, number, key = heapq.heappop(queue)
        pairs[key] -= met
        if queue and len(pairs[key]) < -queue[0][0]:
            heapq.heappush(queue, (-len(pairs[key]), number, key))
        elif pairs[key]:
            met |= pairs[key]
            chosen.append(key)
    return chosen

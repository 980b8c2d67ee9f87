"""Work on many things a part at a time, side by side: small temporaries stay in the cache."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Found = TypeVar("Found")


def in_parts(count: int, size: int, work: Callable[[slice], Found]) -> list[Found]:
    """What the work finds of `count` things, `size` at a time, in their order."""
    parts = [slice(start, min(start + size, count)) for start in range(0, count, size)]
    if len(parts) < 2:
        return [work(part) for part in parts]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(work, parts))

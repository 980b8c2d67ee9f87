"""Volumes of an animation: one, or a time series with read-ahead."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from splatgl.data.scenes import SCENES
from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.scene.scene_file import Scene

T = TypeVar("T")
WILDCARDS = re.compile(r"[*?\[]")


def volumes(scene: Scene, more: Sequence[str]) -> list[Scene]:
    """The scene of each volume: a pattern expands to all matching files, sorted by the numbers in their names.

    Raises InputError for a pattern without matches.
    """
    found: list[str] = []
    for source in (scene.volume, *more):
        found += [source] if source in SCENES or Path(source).exists() else _matching(source)
    return [replace(scene, volume=source) for source in found]


def time_points(scene: Scene, volume: Volume, asked: int | slice | None) -> list[Scene]:
    """The scene of each time point of a file; the scene alone, if one is asked for or there is one only."""
    # a number of an array is one of a time point, its name is not
    picked = "time" in scene.load or str(scene.load.get("array", "")).isdecimal()
    if volume.times < 2 or isinstance(asked, int) or picked:
        if isinstance(asked, slice):
            raise expected("--time", "a file of several time points", volume.times)
        return [scene]
    numbers = range(volume.times)[asked or slice(None)]
    if not numbers:
        raise expected("--time", f"some of 0 to {volume.times - 1}", "none")
    return [replace(scene, load={**scene.load, "time": number}) for number in numbers]


def _matching(source: str) -> list[str]:
    """Files that match a pattern; the source itself if it is not a pattern."""
    if not WILDCARDS.search(source):
        return [source]
    path = Path(source)
    if WILDCARDS.search(str(path.parent)):
        raise expected(source, "a pattern in the file's name alone", "one in its folder's name")
    found = sorted((str(p) for p in path.parent.glob(path.name)), key=by_numbers)
    if not found:
        raise expected(source, "a pattern that files fit", "none", "quote it, and check the folder")
    return found


def by_numbers(name: str) -> list[tuple[bool, int, str]]:
    """Natural sort key: t9 before t10."""
    return [(part.isdigit(), int(part) if part.isdigit() else 0, part) for part in re.split(r"(\d+)", name)]


def read_ahead(read: Callable[[int], T], wanted: Sequence[int]) -> Iterator[tuple[int, T]]:
    """(n, read(n)) for each wanted n in order; a thread reads one item ahead."""
    with ThreadPoolExecutor(max_workers=1, thread_name_prefix="read-ahead") as pool:
        coming = [pool.submit(read, n) for n in wanted[:1]]
        for place, n in enumerate(wanted):
            result = coming.pop().result()
            coming += [pool.submit(read, following) for following in wanted[place + 1 : place + 2]]
            yield n, result
            # leave the only reference to the caller
            del result

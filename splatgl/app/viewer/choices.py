"""What of a file is shown: its arrays and channels, which the panel offers, and the first where one must be picked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from splatgl.app.viewer.content import Content
from splatgl.data.scenes import SCENES
from splatgl.errors import Choice, InputError
from splatgl.readers import listed, load
from splatgl.readers.remote import is_address
from splatgl.scene.scene_file import Scene

# options of `load` that pick one of what a file holds
PICKING = ("array", "channel")
# bytes of a file that is read again to learn what else it holds, at most
SMALL = 1 << 26
# what `splatgl info` marks volumes with
MARK, BESIDE = "* ", "   "
EVERY = "all"


@dataclass(frozen=True)
class Pick:
    """An option of `load`, and what it may be: values, each with a few words."""

    option: str
    found: tuple[tuple[str, str], ...]

    @property
    def texts(self) -> list[str]:
        """Values and words, in a line each."""
        return [f"{value}  {words}".rstrip() for value, words in self.found]

    def number(self, reading: Mapping[str, Any]) -> int:
        """Which of them is read; of channels none stands for all."""
        asked = str(reading.get(self.option, self.found[0][0]))
        return next((n for n, (value, words) in enumerate(self.found) if asked in (value, words)), 0)


def opened(scene: Scene) -> tuple[Content, tuple[Pick, ...]]:
    """The content of a scene, and what of its file can be picked. Where one has to be, that is the first."""
    try:
        content = Content.open(scene)
    except Choice as error:
        found = _found(scene.volume, error)
        if error.option not in PICKING or not found or error.option in scene.load:
            raise
        pick = Pick(error.option, found)
        content, others = opened(replace(scene, load={**scene.load, pick.option: found[0][0]}))
        return content, (pick, *(each for each in others if each.option != pick.option))
    return content, _picks(scene, content)


def _picks(scene: Scene, content: Content) -> tuple[Pick, ...]:
    """What else could have been read, as far as that is told at once."""
    if scene.volume in SCENES or is_address(scene.volume) or content.scene.vectors.show:
        return ()
    names = [part.volume.name for part in content.channels]
    found = {"array": _listed(scene.volume)}
    if len(names) > 1 and scene.load.get("channel", EVERY) == EVERY:
        found["channel"] = ((EVERY, "together"), *((str(n), name) for n, name in enumerate(names)))
    for option in PICKING:
        path = Path(scene.volume)
        if option in scene.load and not found.get(option) and (path.is_dir() or path.stat().st_size <= SMALL):
            found[option] = _without(scene, option)
    return tuple(Pick(option, choices) for option, choices in found.items() if len(choices) > 1)


def _without(scene: Scene, option: str) -> tuple[tuple[str, str], ...]:
    """What a reader offers where an option is not given."""
    try:
        volume = load(scene.volume, **{name: value for name, value in scene.load.items() if name != option})
    except Choice as error:
        return _found(scene.volume, error) if error.option == option else ()
    except InputError:
        return ()
    if option == "channel" and len(volume.channels) > 1:
        return ((EVERY, "together"), *((str(n), each.name) for n, each in enumerate(volume.channels)))
    return ()


def _found(path: str, error: Choice) -> tuple[tuple[str, str], ...]:
    """What there is to pick from; of HDF5, datasets that may be volumes."""
    given = [(value, words) for value, words in error.found if "…" not in value]
    return tuple(given) or (_listed(path) if error.option == "array" else ())


def _listed(path: str) -> tuple[tuple[str, str], ...]:
    lines = [line.removeprefix(MARK).split(BESIDE, 1) for line in listed(path) if line.startswith(MARK)]
    return tuple((name, words[0] if words else "") for name, *words in lines)

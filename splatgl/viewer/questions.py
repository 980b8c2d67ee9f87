"""`Question`: what the window asks, or tells until it is closed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from splatgl.scene.meshes import is_mesh
from splatgl.viewer.commands import Add, CopyText, Effect, Leave, Open, OpenOption, Request

# names of dropped files that a question lists
LISTED = 3


@dataclass(frozen=True)
class Question:
    """A question, or what is told. answers: what each button asks the window for; None: nothing."""

    title: str
    text: str
    answers: tuple[tuple[str, Effect | None], ...]


# asked before a window with unsaved edits closes
UNSAVED = Question(
    "Edits are not saved",
    "Save the changes as a scene before the window closes?",
    (("save and quit", Request.SAVE_AND_QUIT), ("discard", Request.DISCARD), ("cancel", None)),
)


def ask_to_leave(opens: Open | OpenOption) -> Question:
    """The question before other files replace a document with unsaved edits."""
    answers = ("save and open", Leave(opens, saves=True)), ("open without saving", Leave(opens)), ("cancel", None)
    return Question(UNSAVED.title, "Save the changes as a scene before another file is opened?", answers)


def ask_for_files(paths: Sequence[str]) -> Question:
    """The question what to do with dropped files."""
    several, more = len(paths) > 1, len(paths) - LISTED
    is_series = sum(not is_mesh(path) for path in paths) > 1
    names = ", ".join(Path(path).name for path in paths[:LISTED]) + f" and {more} more" * (more > 0)
    answers: tuple[tuple[str, Effect | None], ...] = (
        ("play as series" if is_series else "open", Open(tuple(paths))),
        ("add as layers" if several else "add as layer", Add(tuple(paths))),
        ("cancel", None),
    )
    return Question(f"What to do with {'these files' if several else 'this file'}?", names, answers)


def tell_error(message: str) -> Question:
    """An error, which stays until it is closed."""
    return Question("This did not work", message, (("close", None), ("copy", CopyText(message))))

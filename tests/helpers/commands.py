"""Commands of the window as functions of states."""

from __future__ import annotations

from splatgl.viewer.commands import COMMANDS
from splatgl.viewer.document import Document
from splatgl.viewer.state import State

RUN = {command.id: command for command in COMMANDS}


def acted(state: State, name: str, document: Document) -> State:
    """The state after a command."""
    return RUN[name](state, document)[0]

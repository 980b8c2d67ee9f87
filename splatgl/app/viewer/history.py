"""`History`: undo and redo over whole states, and what of them is not saved."""

from __future__ import annotations

from dataclasses import replace

from splatgl.app.viewer.pose import Pose
from splatgl.app.viewer.state import State

# what an undo does not bring back: what is open on the screen, and what is asked for
PASSING = (
    "message",
    "asks",
    "help",
    "hud",
    "panel",
    "turning",
    "time",
    "times",
    "playing",
    "fullscreen",
    "probe",
    "slices",
    "picks",
    "picked",
)
# what a saved scene holds and a closed window loses; a view is soon found again
EDITS = ("settings", "looks", "meshes", "annotate")
# largest number of steps
MOST = 200


class History:
    """The states to go back and forward to. One step is all that happens between two moments of rest."""

    def __init__(self, state: State) -> None:
        self.past: list[State] = []
        self.future: list[State] = []
        self.now = self.saved = state

    def note(self, state: State) -> None:
        """Records a state at rest, if it differs from the last one."""
        if not _same(state, self.now):
            self.past = [*self.past[-MOST + 1 :], self.now]
            self.future, self.now = [], state

    def undone(self, state: State) -> State:
        """The state before; the same one where there is none."""
        self.note(state)
        if not self.past:
            return replace(state, message="nothing to undo")
        self.future.append(self.now)
        return self._at(self.past.pop(), state, "undone")

    def redone(self, state: State) -> State:
        """The state that was undone last; the same one where there is none."""
        self.note(state)
        if not self.future:
            return replace(state, message="nothing to redo")
        self.past.append(self.now)
        return self._at(self.future.pop(), state, "redone")

    def fitted(self, before: Pose, pose: Pose) -> None:
        """Takes another size of the window as no step."""
        if self.now.pose is before:
            self.now = replace(self.now, pose=pose)

    def begin(self, state: State) -> None:
        """Forgets everything: the state is that of another content."""
        self.forget(state)
        self.saved = state

    def forget(self, state: State) -> None:
        """Forgets the steps: those of other layers or channels cannot be taken back."""
        self.past, self.future, self.now = [], [], state

    def keep(self, state: State) -> None:
        """Notes that the state's edits are saved."""
        self.saved = state

    def unsaved(self, state: State) -> bool:
        """Whether edits would be lost."""
        return any(getattr(state, name) != getattr(self.saved, name) for name in EDITS)

    def _at(self, found: State, state: State, said: str) -> State:
        shown = {name: getattr(state, name) for name in PASSING}
        pose = found.pose.resized(state.pose.camera.size)
        self.now = replace(found, **{**shown, "message": said, "pose": pose})
        return self.now


def _same(a: State, b: State) -> bool:
    names = (name for name in State.__dataclass_fields__ if name not in PASSING)
    return all(getattr(a, name) == getattr(b, name) for name in names)

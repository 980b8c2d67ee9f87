"""What a state asks of its viewer, and what time makes of a state: turning, playing, and the steps of the history."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from splatgl.app.viewer.added import as_seen
from splatgl.app.viewer.dialogs import OPEN, SAVE
from splatgl.app.viewer.moves import up_of
from splatgl.app.viewer.pacing import REST
from splatgl.app.viewer.saving import SAVES, saved

if TYPE_CHECKING:
    from splatgl.app.viewer.viewer import Viewer

# automatic rotation in degrees per second
SPEED = 30.0
UNSAVED = "edits are not saved: shift+s saves the scene; quit again to leave without"
# minimum seconds between the time points of a series that is played
PLAYED = 0.1


def moved_on(viewer: Viewer) -> None:
    """Turns and plays on; once all rests, notes a step of the history and frees what is given up."""
    now, state = viewer.now(), viewer.state
    if state.turning:
        viewer.state = state = replace(
            state, pose=state.pose.spun(SPEED * (now - viewer.ticked), up_of(viewer.content))
        )
        viewer.hands.touched = now
    shown = viewer.files.time == state.time and not viewer.files.jobs.busy and not viewer.dirty
    if state.playing and viewer.files.times and shown and now - viewer.played >= PLAYED:
        viewer.state = state = replace(state, time=(state.time + 1) % len(viewer.files.times))
        viewer.played = now
    viewer.ticked = now
    resting = now - viewer.hands.touched >= REST and not viewer.window.held
    if resting and not state.asks:
        viewer.history.note(state)
    viewer.sweep.look(viewer.painter.frame, resting, now)


def answered(viewer: Viewer) -> None:
    """Runs what the state asks of the window."""
    asks, viewer.state = viewer.state.asks, replace(viewer.state, asks=())
    for ask in asks:
        if ask in ("undo", "redo"):
            undone = viewer.history.undone if ask == "undo" else viewer.history.redone
            viewer.state = undone(viewer.state)
            viewer.hands.touch()
        elif ask == "cancel":
            _cancelled(viewer)
        elif ask in (OPEN, SAVE):
            viewer.dialogs.ask(ask)
        elif ask.startswith(f"{OPEN} "):
            viewer.hands.drop([ask.removeprefix(f"{OPEN} ")])
        elif ask == "forget":
            viewer.recent = viewer.recent.forgotten()
        elif ask in SAVES:
            told = viewer.state, ask, viewer.content, viewer.renderer.render, viewer.options.folder
            viewer.state = saved(*told, partial(as_seen, viewer))
            if ask == "save" and viewer.state.message.startswith("saved"):
                viewer.history.keep(viewer.state)
    viewer.dialogs.look()
    picked = viewer.state.picked
    if picked is not None:
        state, scene = viewer.state, viewer.content.scene
        kept = replace(scene, settings=state.settings, annotate=state.annotate, meshes=state.meshes)
        viewer.files.pick(kept, *picked)
        viewer.state = replace(state, picked=None)
    if viewer.files.times and not viewer.dirty:
        viewer.files.show_time(viewer.state.time)
    if "quit" in asks or viewer.window.closing:
        _quit(viewer)
    elif viewer.state.message != UNSAVED:
        viewer.warned = False


def _cancelled(viewer: Viewer) -> None:
    """Gives up what is being read; closes a window that has nothing to show."""
    opening = viewer.files.opening
    if viewer.files.cancel():
        viewer.closed |= viewer.content.waiting
        viewer.state = replace(viewer.state, time=viewer.files.time)
        if opening:
            # what waited for it
            viewer.files.refine(viewer.content)


def _quit(viewer: Viewer) -> None:
    """Closes the window, at the second request if edits would be lost."""
    if not viewer.history.unsaved(viewer.state) or viewer.warned:
        viewer.closed = True
        return
    viewer.warned = True
    viewer.window.stay()
    viewer.say(UNSAVED)

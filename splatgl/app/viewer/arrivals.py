"""What worker threads bring to a viewer: files that are read, finer portions of them, splats, and errors."""

from __future__ import annotations

from dataclasses import replace
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from splatgl.app.viewer.files import OPENING, TIME, Brought, News
from splatgl.app.viewer.jobs import Done
from splatgl.app.viewer.parts import bare
from splatgl.app.viewer.together import Together
from splatgl.errors import TOLD, told

if TYPE_CHECKING:
    from splatgl.app.viewer.content import Content
    from splatgl.app.viewer.state import State
    from splatgl.app.viewer.viewer import Viewer
    from splatgl.splat.transfer import Transfer


def arrived(viewer: Viewer, done: Done) -> None:
    """Handles a finished job; bad input only sets the message, or closes a window that has nothing to show."""
    viewer.refresh()
    viewer.files.finished(done.name)
    if isinstance(done.error, TOLD):
        viewer.say(told(done.error), done.name.split()[0])
        if viewer.content.waiting:
            viewer.failed, viewer.closed = done.error, True
        elif done.name.startswith(TIME):
            # the slider goes back to what is shown
            viewer.state = replace(viewer.state, time=viewer.files.time, playing=False)
        elif done.name.startswith(OPENING):
            # which waited for what was to be opened
            viewer.files.refine(viewer.content)
    elif done.error is not None:
        raise done.error
    elif isinstance(done.result, Brought):
        _brought(viewer, done.result)
    elif not isinstance(done.result, News):
        viewer.over(done.name.split()[0])
        viewer.refiner.renew(viewer.content.counts, prod(viewer.size))
        # all time points have the view of the first
        if viewer.state.pose is viewer.home and viewer.content.whole and viewer.files.time == 0:
            _fit(viewer)
    elif not done.result.stale(viewer.content):
        _opened(viewer, done.result)


def _opened(viewer: Viewer, news: News) -> None:
    """Takes a loaded file; a reloaded one keeps its view unless its scene file changed, a time point keeps all."""
    content, shown = news.content, viewer.content
    for what in () if news.finer else ("opening", "reading"):
        viewer.over(what)
    if news.reopen is not None or shown.waiting:
        viewer.recent = viewer.recent.opened(news.path or viewer.options.source)
    if news.reopen is not None:
        viewer.files.turn_to(news)
    elif not shown.waiting and isinstance(shown, Together) and shown.read:
        # meshes that were laid over what is shown meanwhile
        own = content.read if isinstance(content, Together) else {}
        content = Together.with_meshes(content, {**shown.read, **own})
    if news.time is not None:
        viewer.files.time = news.time
    elif not news.finer:
        viewer.files.times, viewer.files.time = news.times or viewer.files.times, 0
    if news.time is None and (news.reopen is not None or shown.waiting or content.scene != shown.scene):
        viewer.files.times = news.times
        before = viewer.state.pose
        viewer.state = replace(viewer.state.opened(content), times=len(news.times), picks=news.picks)
        viewer.home = viewer.state.pose
        if news.picked and np.array_equal(content.volume.corners, shown.volume.corners):
            viewer.state = replace(viewer.state, pose=before)
        viewer.history.begin(viewer.state)
        # what is kept for pictures of the file before would stay as long as the window
        viewer.renderer.free()
    elif news.time is None and _bases(viewer.state) == _bases(shown):
        _based(viewer, content)
        viewer.state = replace(viewer.state, message="")
    elif len(content.looks) != len(viewer.state.looks):
        _based(viewer, content)
    viewer.take(content)
    viewer.files.refine(content)
    viewer.hands.touch()


def _based(viewer: Viewer, content: Content) -> None:
    """Takes the transfer functions of a content, and forgets the steps of others, if it has other channels."""
    edited, count = viewer.history.unsaved(viewer.state), len(viewer.state.looks)
    viewer.state = viewer.state.based_on(content)
    if len(content.looks) != count:
        viewer.history.forget(viewer.state)
    if not edited:
        viewer.history.keep(viewer.state)


def _bases(x: State | Content) -> list[Transfer]:
    return [look.base for look in x.looks]


def _brought(viewer: Viewer, brought: Brought) -> None:
    """Lays meshes over what is shown, which is edited meanwhile; undoing it takes them away again."""
    viewer.history.note(viewer.state)
    viewer.take(Together.with_meshes(viewer.content, brought.read))
    names = ", ".join(Path(each.file).name for each in brought.files)
    # a file that is dropped again takes the place of the one before
    kept = [each for each in viewer.state.meshes if bare(each) not in brought.read]
    viewer.state = viewer.state.joined((*kept, *brought.files), f"{names} lies in the picture; ctrl+z takes it away")
    viewer.hands.touch()


def _fit(viewer: Viewer) -> None:
    """Fits a view that nobody has changed to the finest splats, as `splatgl render` does."""
    home = viewer.content.home(viewer.size)
    if home.view() == viewer.home.view():
        return
    viewer.home = home
    viewer.state = replace(viewer.state, pose=viewer.home)
    if not viewer.history.past and not viewer.history.unsaved(viewer.state):
        viewer.history.begin(viewer.state)

"""What worker threads bring to a viewer: files that are read, finer portions of them, splats, and errors."""

from __future__ import annotations

import gc
from dataclasses import replace
from math import prod
from typing import TYPE_CHECKING

from splatgl.app.viewer.extracting import EXTRACTING
from splatgl.app.viewer.files import News
from splatgl.app.viewer.jobs import Done
from splatgl.data.errors import InputError

if TYPE_CHECKING:
    from splatgl.app.viewer.viewer import Viewer


def arrived(viewer: Viewer, done: Done) -> None:
    """Handles a finished job; bad input only sets the message, or closes a window that has nothing to show."""
    viewer.refresh()
    viewer.files.finished(done.name)
    if done.error is not None and done.name == EXTRACTING:
        viewer.extractor.failed = viewer.extractor.wanted
    if isinstance(done.error, InputError | MemoryError):
        viewer.say(str(done.error) or "not enough memory")
        if viewer.content.waiting:
            viewer.failed, viewer.closed = done.error, True
    elif done.error is not None:
        raise done.error
    elif not isinstance(done.result, News):
        viewer.refiner.renew(viewer.content.counts, prod(viewer.size))
        # all time points have the view of the first
        if viewer.state.pose is viewer.home and viewer.content.whole and viewer.files.time == 0:
            _fit(viewer)
    elif not done.result.stale(viewer.content):
        _opened(viewer, done.result)


def _opened(viewer: Viewer, news: News) -> None:
    """Takes a loaded file; a reloaded one keeps its view unless its scene file changed, a time point keeps all."""
    content, shown = news.content, viewer.content
    if news.reopen is not None or shown.waiting:
        viewer.recent = viewer.recent.opened(news.path or viewer.options.source)
    if news.reopen is not None:
        viewer.files.turn_to(news, viewer.now())
    if news.time is None and not news.finer:
        viewer.files.times, viewer.files.time = news.times or viewer.files.times, 0
    if news.time is None and (news.reopen is not None or content.scene != shown.scene):
        viewer.files.times = news.times
        viewer.state = replace(viewer.state.opened(content), times=len(news.times))
        viewer.home = viewer.state.pose
        viewer.history.begin(viewer.state)
    elif news.time is None and viewer.state.base == shown.transfer:
        edited = viewer.history.unsaved(viewer.state)
        viewer.state = replace(viewer.state, base=content.transfer, message="")
        if not edited:
            viewer.history.keep(viewer.state)
    viewer.take(content)
    viewer.files.refine(content)
    # contents of the volume before refer to each other
    gc.collect()
    viewer.hands.touch()


def _fit(viewer: Viewer) -> None:
    """Fits a view that nobody has changed to the finest splats, as `splatgl render` does."""
    viewer.home = viewer.content.home(viewer.size)
    viewer.state = replace(viewer.state, pose=viewer.home)
    if not viewer.history.past and not viewer.history.unsaved(viewer.state):
        viewer.history.begin(viewer.state)

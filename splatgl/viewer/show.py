"""`sg.show`: a window, the view of a notebook, or the picture."""

from __future__ import annotations

import signal
import sys
import time
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext
from importlib.util import find_spec
from types import FrameType
from typing import TYPE_CHECKING, Any, Unpack

from splatgl.coercion import public
from splatgl.data.image import Image
from splatgl.errors import InputError, InputWarning
from splatgl.fileio import within
from splatgl.opengl import OpenGL
from splatgl.options import OptionGroup
from splatgl.platforms import has_display
from splatgl.scene.api import picture, scene_of, ungrouped, with_groups
from splatgl.scene.draw import DrawOptions
from splatgl.scene.scene_file import SceneFile
from splatgl.splat.settings import Settings
from splatgl.transfer.transfer import Transfer

if TYPE_CHECKING:
    from splatgl.geometry.camera import Camera
    from splatgl.keywords import RenderKeywords
    from splatgl.viewer.loading import Files, Reopen
    from splatgl.viewer.notebook import NotebookView
    from splatgl.viewer.viewer import Options


@with_groups()
@public
def show(
    x: Any,
    transfer: Transfer | OptionGroup | str | Mapping[str, Any] | None = None,
    camera: Camera | OptionGroup | Any | None = None,
    settings: Settings | OptionGroup | Any | None = None,
    **options: Unpack[RenderKeywords],
) -> NotebookView | Image | None:
    """Shows `x`; the arguments are those of `render`.

    In a notebook it returns what the cell displays: a view that the mouse turns (extra `notebook`), or the Image.
    Elsewhere, where there is a display, it opens the window of `splatgl view`, and returns None once that is closed.
    Without a display it returns the Image, and says how to save it. An Image is returned as it is, and Splats, Scenes
    and plotters, which no window opens, as an Image. Raises InputError as `render`.

    ```python
    sg.show("head.nii.gz", blend="mip", size=200)
    ```
    """
    if isinstance(x, Image):
        return x
    given, (look, view, base) = ungrouped(options, transfer, camera, settings)
    scene, memory = scene_of(x, look, view, base, given), DrawOptions(memory=given.get("memory")).memory
    if isinstance(scene, SceneFile):
        # windows and views print notes on files, as they read them
        told = warnings.catch_warnings(action="ignore", category=InputWarning)
        if in_notebook() and find_spec("jupyter_rfb"):
            from splatgl.viewer.notebook import NotebookView, Session

            with told:
                return NotebookView(Session(scene, memory))
        if in_notebook():
            print('for a view that the mouse turns: pip install "splatgl[notebook]"')
        elif has_display():
            with within(memory), told:
                _window(scene, "size" in given or view is not None)
            return None
    image = picture(scene, memory)
    if not in_notebook():
        print('no display: save the picture by image.save("picture.png")')
    return image


def in_notebook() -> bool:
    """Whether a Jupyter kernel runs this code; IPython in a terminal does not count."""
    python = sys.modules.get("IPython")
    shell = python.get_ipython() if python is not None else None
    return shell is not None and hasattr(shell, "kernel")


def _window(scene: SceneFile, sized: bool) -> None:
    """Opens the window until it is closed."""
    files = start_reading(scene)
    from splatgl.viewer.viewer import Options

    open_window(files, scene, Options(size=scene.view.size) if sized else Options(), OpenGL("window"))


# seconds in which most input errors are found, before a window is opened
AT_ONCE = 0.1


def start_reading(scene: SceneFile, source: str = "", reopen: Reopen | None = None) -> Files:
    """Starts to read a scene. Raises the errors of its reader that occur within AT_ONCE. source: path that is watched,
    and that `reopen` reads again; "": none.
    """
    from splatgl.viewer.files import watched_files
    from splatgl.viewer.jobs import Jobs
    from splatgl.viewer.loading import Files

    jobs = Jobs(lambda: None)
    files = Files(jobs, watched_files(source, scene) if source else (), reopen, time.monotonic())
    files.open_scene(scene)
    if jobs.wait(AT_ONCE) and jobs.done and jobs.done[0].error is not None:
        raise jobs.done[0].error
    return files


def start_empty() -> Files:
    """The files of an empty window, which reads none yet."""
    from splatgl.viewer.jobs import Jobs
    from splatgl.viewer.loading import Files

    return Files(Jobs(lambda: None), (), None, time.monotonic())


def open_window(files: Files, scene: SceneFile, options: Options, opengl: OpenGL) -> None:
    """Opens the window for files that are being read; returns once it is closed."""
    from splatgl.gl.backends import BackendError
    from splatgl.gl.renderer import open_renderer
    from splatgl.viewer.document import Document
    from splatgl.viewer.viewer import Viewer

    with open_renderer(opengl) as renderer:
        viewer = Viewer(Document.placeholder(scene), renderer, options, files)
        try:
            with _ended_by_signals(viewer) if options.owns_process else nullcontext():
                viewer.run()
        except BackendError as error:
            raise InputError(f"window: {error}") from error
        finally:
            viewer.close()


@contextmanager
def _ended_by_signals(viewer: Any) -> Iterator[None]:
    """Closes the window on SIGINT, SIGHUP and SIGTERM."""

    def close(number: int, frame: FrameType | None) -> None:
        viewer.closed = True

    names = [name for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    before = {name: signal.signal(getattr(signal, name), close) for name in names}
    try:
        yield
    finally:
        for name, handler in before.items():
            signal.signal(getattr(signal, name), handler)
        sys.stdout.flush()

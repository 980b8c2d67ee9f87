"""`show`: the interactive view of a notebook, a window, or the picture, whichever there is."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from splatgl.data.image import Image
from splatgl.scene.api import is_splats, picture, scene_of
from splatgl.scene.scene_file import Scene
from splatgl.splat.settings import Settings
from splatgl.splat.transfer import Transfer

if TYPE_CHECKING:
    from splatgl.splat.camera import Camera


def show(
    x: Any,
    transfer: Transfer | str | Mapping[str, Any] | None = None,
    camera: Camera | None = None,
    settings: Settings | None = None,
    **options: Any,
) -> Any:
    """Shows `x`; the arguments are those of `render`.

    In a notebook it returns what the cell displays: a view that the mouse turns (extra `notebook`), or the Image.
    Elsewhere, where there is a display, it opens the window of `splatgl view`, and returns None once that is closed.
    Without a display it returns the Image, and says how to save it. An Image is returned as it is, and Splats, which
    have no samples to show in motion, as an Image. Raises InputError as `render`.
    """
    if isinstance(x, Image):
        return x
    scene, memory = scene_of(x, transfer, camera, settings, options)
    if in_notebook():
        if not is_splats(x) and find_spec("jupyter_rfb"):
            from splatgl.app.notebook import Session
            from splatgl.app.notebook_view import View

            return View(Session(scene))
        return picture(x, scene, memory, seen=True)
    if not is_splats(x) and has_display():
        _window(scene, "size" in options or camera is not None)
        return None
    image = picture(x, scene, memory, seen=True)
    print('no display: save the picture by image.save("picture.png")')
    return image


def in_notebook() -> bool:
    """Whether cells are run by a Jupyter kernel; IPython in a terminal is none."""
    python = sys.modules.get("IPython")
    shell = python.get_ipython() if python is not None else None
    return shell is not None and hasattr(shell, "kernel")


def has_display() -> bool:
    """Whether a window can be seen: always but on Unix without a display."""
    if sys.platform in ("win32", "darwin"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _window(scene: Scene, sized: bool) -> None:
    """Opens the window until it is closed."""
    from splatgl.app.view import opened, reading

    files = reading(scene)
    from splatgl.app.viewer.viewer import Options

    opened(files, scene, Options(size=scene.view.size) if sized else Options())

"""`Dialogs`: asks for names of files, by the desktop's own dialog or else by one in the window. Extra `gui`."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from splatgl.app.viewer.added import as_seen
from splatgl.app.viewer.saving import free, saved_as
from splatgl.errors import missing_extra
from splatgl.readers import FORMATS

if TYPE_CHECKING:
    from splatgl.app.viewer.viewer import Viewer

# programs by which a desktop of X or Wayland shows its dialog
HELPERS = ("zenity", "kdialog", "matedialog", "qarma")
OPEN, SAVE = "open", "save-as"
TITLES = {OPEN: "Open a volume or a scene", SAVE: "Save: .toml a scene, .png a picture, .npy its floats"}


def native() -> bool:
    """Whether the desktop has a dialog of its own."""
    return not sys.platform.startswith("linux") or any(map(shutil.which, HELPERS))


def suffixes() -> tuple[str, ...]:
    """Those of files that can be opened."""
    known = (suffix for form in FORMATS if "file" in form.kinds for suffix in form.suffixes)
    return tuple(dict.fromkeys((".toml", *known)))


class Dialogs:
    """A viewer's dialogs, of which one at a time is open. A desktop's is a process, which is polled."""

    def __init__(self, viewer: Viewer) -> None:
        self.viewer = viewer
        self.open: Any = None
        self.kind = ""

    def ask(self, kind: str) -> None:
        """Opens the dialog to open a file or to save one; says what is missing where there is none."""
        viewer = self.viewer
        if not find_spec("imgui_bundle"):
            viewer.say(str(missing_extra("the file dialog", "imgui-bundle", "gui")))
        elif self.open is None:
            self.kind = kind
            name = free(viewer.options.folder, "scene", ".toml").name if kind == SAVE else ""
            folder = (viewer.options.folder if kind == SAVE else self._folder()).resolve()
            if native():
                self.open = _native(kind, folder / name)
            else:
                viewer.show_panel().browser.open(kind, TITLES[kind], folder, name)

    def look(self) -> None:
        """Takes what was chosen, if anything was."""
        viewer, chosen = self.viewer, None
        if self.open is not None and self.open.ready(0):
            found, self.open = self.open.result(), None
            chosen = (found,) if isinstance(found, str) and found else tuple(found)
            viewer.refresh()
        elif viewer.panel is not None and viewer.panel.panel.browser.chosen:
            browser = viewer.panel.panel.browser
            chosen, browser.chosen = browser.chosen, ()
        if chosen:
            self._take(chosen)

    def close(self) -> None:
        """Ends the desktop's dialog, which would outlive the window."""
        if self.open is not None:
            self.open.kill()
            self.open = None

    def _take(self, paths: Sequence[str]) -> None:
        viewer = self.viewer
        if self.kind == OPEN:
            viewer.hands.drop(list(paths))
            return
        told = viewer.state, viewer.content, viewer.renderer.render, Path(paths[0])
        viewer.state, kept = saved_as(*told, partial(as_seen, viewer), viewer.files.times)
        if kept:
            viewer.history.keep(viewer.state)
        viewer.refresh()

    def _folder(self) -> Path:
        """That of what is shown."""
        shown = Path(self.viewer.content.scene.volume)
        return shown.parent if shown.exists() else Path()


def _native(kind: str, path: Path) -> Any:
    """The desktop's dialog: an object with ready, result and kill."""
    from imgui_bundle import portable_file_dialogs as dialogs

    if kind == SAVE:
        wanted = ["Scene", "*.toml", "Picture", "*.png", "Floats", "*.npy"]
        return dialogs.save_file(TITLES[kind], str(path), wanted)
    known = " ".join(f"*{suffix}" for suffix in suffixes())
    wanted = ["Volumes and scenes", known, "All files", "*"]
    # a folder ends with a slash, or its name would be taken for that of a file
    return dialogs.open_file(TITLES[kind], f"{path}/", wanted, dialogs.opt.multiselect)


def opened(state: Any, path: str) -> Any:
    """The state that asks its window to open a file."""
    return replace(state, asks=(*state.asks, f"{OPEN} {path}"))

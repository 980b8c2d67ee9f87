"""The desktop's file dialogs; `file_browser` replaces missing ones."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from splatgl.readers import FORMATS
from splatgl.scene.meshes import ALONE

if TYPE_CHECKING:
    from splatgl.viewer.file_browser import Browser

# programs that show the dialog of a desktop of X or Wayland
HELPERS = ("zenity", "kdialog", "matedialog", "qarma")
OPEN, ADD, SAVE = "open", "add", "save-as"
TITLES = {OPEN: "Open a volume or a scene", SAVE: "Save: .toml a scene, .png a picture, .npy floats, .mp4 a movie"}
TITLES[ADD] = "Add a volume, a segmentation or a mesh"


def has_native() -> bool:
    """Whether the desktop has a dialog of its own."""
    return not sys.platform.startswith("linux") or any(map(shutil.which, HELPERS))


def suffixes() -> tuple[str, ...]:
    """The suffixes of files that can be opened."""
    known = (suffix for form in FORMATS if "file" in form.kinds for suffix in form.suffixes)
    return tuple(dict.fromkeys((".toml", *known, *ALONE)))


class Dialogs:
    """The open dialog, if any: a process of the desktop, which is polled, or a Browser."""

    def __init__(self) -> None:
        self.process: Any = None
        self.kind = ""

    def open(self, kind: str, folder: Path, name: str, browser: Callable[[], Browser]) -> None:
        """Opens a dialog, a key of TITLES. name: the proposed one; browser: returns that of the panel."""
        if self.process is None:
            self.kind = kind
            if has_native():
                self.process = _native(kind, folder / name)
            else:
                browser().open(kind, TITLES[kind], folder, name)

    def take(self, browser: Browser | None) -> tuple[str, ...]:
        """The paths that were chosen since the last call."""
        if self.process is not None and self.process.ready(0):
            result, self.process = self.process.result(), None
            return (result,) if isinstance(result, str) and result else tuple(result)
        return browser.take() if browser is not None else ()

    def close(self) -> None:
        """Ends the desktop's dialog, which would outlive the window."""
        if self.process is not None:
            self.process.kill()
            self.process = None


def _native(kind: str, path: Path) -> Any:
    """The desktop's dialog: an object with ready, result and kill."""
    from imgui_bundle import portable_file_dialogs as dialogs

    if kind == SAVE:
        wanted = ["Scene", "*.toml", "Picture", "*.png", "Floats", "*.npy", "Movie", "*.mp4 *.webm *.gif"]
        return dialogs.save_file(TITLES[kind], str(path), wanted)
    known = " ".join(f"*{suffix}" for suffix in suffixes())
    wanted = ["Volumes and scenes", known, "All files", "*"]
    # without its slash, the name of a folder would be proposed as a file's
    return dialogs.open_file(TITLES[kind], f"{path}/", wanted, dialogs.opt.multiselect)

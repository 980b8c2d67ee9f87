"""Files of the window: the desktop's dialogs, recently opened files, the saved layout, and changes on disk."""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from splatgl.animation.movie import by_numbers
from splatgl.data.scenes import SCENES
from splatgl.errors import USER_ERRORS, InputError
from splatgl.fileio import write_file
from splatgl.platforms import user_folder
from splatgl.readers import formats
from splatgl.readers.remote import is_address
from splatgl.scene.meshes import ALONE, is_mesh
from splatgl.scene.scene_file import SceneFile
from splatgl.transfer.label_detection import NAMES

if TYPE_CHECKING:
    from splatgl.viewer.panel import Browser


# programs that show the dialog of a desktop of X or Wayland
HELPERS = ("zenity", "kdialog", "matedialog", "qarma")
OPEN, ADD, SAVE = "open", "add", "save-as"
TITLES = {OPEN: "Open a volume or a scene", SAVE: "Save: .toml a scene, .png a picture, .npy floats, .mp4 a movie"}
TITLES[ADD] = "Add a volume, a segmentation or a mesh"


def suffixes() -> tuple[str, ...]:
    """The suffixes of files that can be opened."""
    known = (suffix for form in formats() if "file" in form.kinds for suffix in form.suffixes)
    return tuple(dict.fromkeys((".toml", *known, *ALONE)))


def is_segmentation(path: str) -> bool:
    """Whether the name of a file says that it is a segmentation."""
    return NAMES.search(Path(path).name.lower()) is not None and not is_mesh(path)


def grouped(paths: Iterable[str]) -> tuple[list[str], list[str], list[str]]:
    """Volumes in the order of their numbers, the segmentations beside them, by their names, and meshes."""
    meshes = [path for path in paths if is_mesh(path)]
    volumes = sorted((path for path in paths if path not in meshes), key=by_numbers)
    segmentations = [path for path in volumes if is_segmentation(path)]
    others = [path for path in volumes if path not in segmentations]
    return (others, segmentations, meshes) if others else (segmentations, [], meshes)


class Dialogs:
    """The open dialog, if any: a process of the desktop, which is polled, or a Browser."""

    def __init__(self) -> None:
        self.process: Any = None
        self.kind = ""

    def open(self, kind: str, folder: Path, name: str, browser: Callable[[], Browser]) -> None:
        """Opens a dialog, a key of TITLES. name: the proposed one; browser: returns that of the panel."""
        if self.process is None:
            self.kind = kind
            # a dialog of the desktop
            if not sys.platform.startswith("linux") or any(map(shutil.which, HELPERS)):
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


def watched_files(path: str, scene: SceneFile) -> tuple[str, ...]:
    """The local files of the scene opened from `path`; none for a built-in scene."""
    files = dict.fromkeys((path, *scene.files))
    return tuple(file for file in files if file not in SCENES and not is_address(file))


# polling period in seconds
PERIOD = 1.0

Stamp = tuple[int, int] | None


@dataclass(frozen=True)
class Watch:
    """seen: the last stamp of each path: (mtime in ns, bytes), None for a missing file. gone: number of consecutive
    checks with a missing file.
    """

    paths: tuple[Path, ...]
    seen: tuple[Stamp, ...]
    due: float
    gone: int = 0

    @classmethod
    def of(cls, paths: Iterable[str | Path], now: float) -> Watch:
        """Watches `paths` from their current stamps; the first check is due after PERIOD seconds."""
        files = tuple(Path(path) for path in paths)
        return cls(files, tuple(map(_stamp, files)), now + PERIOD)

    def look(self, now: float) -> tuple[Watch, bool]:
        """Checks the files if due; True if one changed and all exist: a file may be missing while it is replaced."""
        if now < self.due:
            return self, False
        stamps = tuple(map(_stamp, self.paths))
        if None in stamps:
            return replace(self, due=now + PERIOD, gone=self.gone + 1), False
        return replace(self, seen=stamps, due=now + PERIOD, gone=0), stamps != self.seen

    @property
    def missing(self) -> str:
        """Name of a file that is missing for longer than a replacement takes; "" if none is."""
        absent = [path.name for path in self.paths if not path.exists()] if self.gone > 1 else []
        return absent[0] if absent else ""


def _stamp(path: Path) -> Stamp:
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size


MOST_RECENT = 10
# environment variable that turns memory off, and its values that do
SWITCH, OFF = "SPLATGL_RECENT", ("", "0", "off", "no", "false")
# most bytes of a file that is read: larger ones are others
LARGEST = 1 << 20


@dataclass(frozen=True)
class Recent:
    """Recent files. paths: the latest first. file: that holds the list; None: no file does."""

    paths: tuple[str, ...] = ()
    file: Path | None = None

    @classmethod
    def of(cls, environment: Mapping[str, str]) -> Recent:
        """The list of the user; empty where it is turned off, or where there is no folder for it."""
        file = _state_file("recent.json", environment)
        return cls(_read_list(file), file) if file is not None else cls()

    def opened(self, path: str) -> Recent:
        """The list with a file that was opened, first; without built-in scenes and addresses, which may hold keys."""
        if self.file is None or not path or path in SCENES or "://" in path or path == str(self.last):
            return self
        # another window may have added some
        absolute = os.path.abspath(path)
        others = (other for other in _read_list(self.file) if other != absolute)
        return self._written((absolute, *others)[:MOST_RECENT])

    def forgotten(self) -> Recent:
        """The empty list, without the last scene."""
        if self.scene is not None:
            with suppress(OSError):
                self.scene.unlink()
        return self._written(())

    @property
    def last(self) -> Path | None:
        """The file that the scene of the latest window goes to; None where nothing is remembered."""
        return self.file and self.file.with_name("last.toml")

    @property
    def scene(self) -> Path | None:
        """The scene of the latest window, if it is kept."""
        return self.last if self.last is not None and self.last.exists() else None

    def keep(self, scene: SceneFile) -> None:
        """Keeps the scene of a window that is closed, but for one of addresses, which may hold keys, or of arrays."""
        with suppress(*USER_ERRORS):
            held = any(each.held is not None for each in (scene, *scene.layers))
            if self.last is not None and not held and "://" not in (text := scene.to_toml()):
                _make_private(self.last.parent)
                write_file(self.last, text.encode())

    def _written(self, paths: tuple[str, ...]) -> Recent:
        if self.file is not None:
            _write(self.file, paths)
        return replace(self, paths=paths)


# smallest and largest sides of a window that are remembered, screen units
SIDES = (64, 1 << 14)


@dataclass(frozen=True)
class WindowLayout:
    """Layout of the window. size: width and height, screen units; panel, slices: whether they are shown; theme: of
    the panel's THEMES; "": the first.
    """

    size: tuple[int, int] | None = None
    panel: bool = True
    slices: bool = False
    theme: str = ""

    @classmethod
    def of(cls, environment: Mapping[str, str]) -> WindowLayout:
        """How the user left the latest window; the default where nothing is remembered or the file is damaged."""
        file = _state_file("window.json", environment)
        stored = _read_json(file) if file is not None else None
        if not isinstance(stored, dict):
            return cls()
        size, default = stored.get("size"), cls()
        sides = size if isinstance(size, list) else ()
        is_size = [type(side) for side in sides] == [int, int] and SIDES[0] <= min(sides) and max(sides) <= SIDES[1]
        kept: dict[str, Any] = {name: stored.get(name) for name in ("panel", "slices", "theme")}
        right = {name: value for name, value in kept.items() if type(value) is type(getattr(default, name))}
        return replace(default, size=tuple(sides) if is_size else None, **right)

    def remember(self, environment: Mapping[str, str]) -> None:
        """Stores it for the next window, where there is a folder for it."""
        file = _state_file("window.json", environment)
        if file is not None and self != WindowLayout.of(environment):
            _write(file, asdict(self))


def _state_file(name: str, environment: Mapping[str, str]) -> Path | None:
    """A file of what is remembered; None where that is turned off, or where there is no folder for it."""
    folder = user_folder("state", environment)
    is_off = environment.get(SWITCH, "on").lower() in OFF
    return None if is_off or not folder.is_absolute() else folder / "splatgl" / name


def _write(file: Path, value: Any) -> None:
    """Writes a value as JSON, if that is possible."""
    with suppress(OSError, InputError):
        _make_private(file.parent)
        write_file(file, json.dumps(value, indent=0).encode())


def _make_private(folder: Path) -> None:
    """Makes a folder that other users must not read, unless it is there."""
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)


def _read_json(file: Path) -> Any:
    """The value in a file; None if it is missing, damaged or unreadable."""
    try:
        return json.loads(file.read_bytes()) if file.stat().st_size <= LARGEST else None
    except (OSError, ValueError, RecursionError):
        return None


def _read_list(file: Path) -> tuple[str, ...]:
    """The paths in a file; none if it is no list."""
    paths = _read_json(file)
    return tuple(path for path in paths if isinstance(path, str))[:MOST_RECENT] if isinstance(paths, list) else ()

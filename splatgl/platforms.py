"""Differences between Linux, Windows and macOS: backends of OpenGL, displays, free memory and folders of the user."""

from __future__ import annotations

import ctypes
import os
import platform
import re
import sys
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, cast

# backends of OpenGL, in the order in which "auto" tries them
BACKENDS = {"win32": ("wgl", "window"), "darwin": ("cgl", "window")}.get(sys.platform, ("egl", "osmesa", "window"))
CHOICES = f"{', '.join(('auto', *BACKENDS[:-1]))} or {BACKENDS[-1]}"
WINDOWS_DRIVER = "install the driver of the graphics card, or Mesa's opengl32.dll next to python.exe"
# how to get a window
DISPLAY_FIX = {"win32": WINDOWS_DRIVER, "darwin": "log in to the desktop of macOS"}.get(sys.platform, "set DISPLAY")
# how to install a missing backend; "auto" needs only the first
INSTALL = {
    "egl": "install software OpenGL with: sudo apt-get install libegl1 libgl1 libgl1-mesa-dri",
    "osmesa": "install it with: sudo apt-get install libosmesa6",
    "window": DISPLAY_FIX
    + (", or install what draws without one: sudo apt-get install libosmesa6" if "osmesa" in BACKENDS else ""),
    "wgl": WINDOWS_DRIVER,
    "cgl": "update macOS, which brings OpenGL 4.1",
}
# the same where DISPLAY names a display on which no window opens, and where its server has no OpenGL
NO_SERVER, NO_GLX = "correct DISPLAY", "enable GLX on the display (Xvfb, Xvnc: +extension GLX)"


def window_fix(reason: str) -> str:
    """Returns what to do where a display that the environment names opens no window, by GLFW's reason."""
    if sys.platform in ("darwin", "win32"):
        return DISPLAY_FIX
    return f"{NO_GLX if 'GLX' in reason else NO_SERVER}, or use splatgl render"


def has_display() -> bool:
    """Whether a window can be opened: always on Windows and macOS, elsewhere if the environment names a display."""
    names = ("DISPLAY", "WAYLAND_DISPLAY")
    return sys.platform in ("darwin", "win32") or any(os.environ.get(name) for name in names)


def processor_vendor() -> str:
    """intel, amd, arm, or the name of another architecture in small letters and digits."""
    text = f"{platform.processor()} {platform.machine()}"
    with suppress(OSError):
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")[:4096] + text
    vendors = (("intel", "genuineintel|^i386"), ("amd", "authenticamd"), ("arm", "arm|aarch64"))
    lower = text.lower()
    known = next((name for name, pattern in vendors if re.search(pattern, lower)), None)
    return known or re.sub("[^a-z0-9]", "", platform.machine().lower()) or "other"


# folders for files of programs, below the home folder
FOLDERS = {
    "win32": {"cache": "AppData/Local", "state": "AppData/Local"},
    "darwin": {"cache": "Library/Caches", "state": "Library/Application Support"},
}
OTHER_FOLDERS = {"cache": ".cache", "state": ".local/state"}


def user_folder(kind: str, environment: Mapping[str, str] = os.environ) -> Path:
    """The user's folder for files of programs. kind: cache or state; XDG_CACHE_HOME and XDG_STATE_HOME come first."""
    chosen = Path(environment.get(f"XDG_{kind.upper()}_HOME", ""))
    if chosen.is_absolute():
        return chosen
    local = environment.get("LOCALAPPDATA") if sys.platform == "win32" else None
    home = environment.get("HOME") or os.path.expanduser("~")
    return Path(local or Path(home) / FOLDERS.get(sys.platform, OTHER_FOLDERS)[kind])


# free bytes where nothing reports them
ASSUMED_FREE = 4 << 30


def free_memory() -> int:
    """Free bytes of the system and of the control group; the machine's memory, or ASSUMED_FREE, if none is reported."""
    measures = (_linux_memory, _windows_memory, _mac_memory, _machine_memory)
    free = next((free for measure in measures if (free := measure()) is not None), ASSUMED_FREE)
    return max(min([free, *_group_memory()]), 0)


def _linux_memory() -> int | None:
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        (line,) = (line for line in lines if line.startswith("MemAvailable:"))
        return int(line.split()[1]) << 10
    except (OSError, ValueError):
        return None


def _windows_memory() -> int | None:
    # MEMORYSTATUSEX: its size and the load in per cent, 4 bytes each; total and available bytes, and five more
    status, windows = (ctypes.c_uint64 * 8)(64), cast(Any, ctypes)
    try:
        known = windows.windll.kernel32.GlobalMemoryStatusEx(ctypes.byref(status))
    except (AttributeError, OSError):
        return None
    return status[2] if known else None


def _mac_memory() -> int | None:
    try:
        level = _sysctl("kern.memorystatus_level")
        # per cent
        return None if level is None else (_sysctl("hw.memsize") or 0) * level // 100
    except (AttributeError, OSError, TypeError):
        return None


def _sysctl(name: str) -> int | None:
    """A number of the kernel of macOS."""
    value, size = ctypes.c_uint64(0), ctypes.c_size_t(8)
    places = ctypes.byref(value), ctypes.byref(size)
    failed = ctypes.CDLL(None).sysctlbyname(name.encode(), *places, None, ctypes.c_size_t(0))
    return None if failed else value.value


def _machine_memory() -> int | None:
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):
        return None


def _group_memory() -> list[int]:
    """Free bytes of the control group, version 1 or 2; [] without a limit."""
    free = []
    root = Path("/sys/fs/cgroup")
    for limit, used in (
        ("memory.max", "memory.current"),
        ("memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes"),
    ):
        with suppress(OSError, ValueError):
            free.append(int((root / limit).read_text("ascii")) - int((root / used).read_text("ascii")))
    return free

"""A program that drags files onto a window and drops them there, as a file manager does (XDND 5), with libX11 alone.

python drag_source.py WINDOW PATH…

Without a path it ends in the middle of the drag.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import sys
from pathlib import Path

# X.h: what this needs of events; an event is 24 longs, whose first is its type
CLIENT_MESSAGE, SELECTION_REQUEST, SELECTION_NOTIFY = 33, 30, 31
ATOM, REPLACE, WORDS, VERSION = 4, 0, 24, 5
Event = ctypes.c_long * WORDS

X = ctypes.CDLL(ctypes.util.find_library("X11") or "libX11.so.6")
for _name in ("XOpenDisplay", "XDefaultRootWindow", "XCreateSimpleWindow", "XInternAtom"):
    getattr(X, _name).restype = ctypes.c_void_p if _name == "XOpenDisplay" else ctypes.c_ulong
X.XChangeProperty.argtypes = [
    ctypes.c_void_p,
    *[ctypes.c_ulong] * 3,
    *[ctypes.c_int] * 2,
    ctypes.c_char_p,
    ctypes.c_int,
]
X.XSendEvent.argtypes = [ctypes.c_void_p, ctypes.c_ulong, ctypes.c_int, ctypes.c_long, ctypes.c_void_p]


def main(window: int, paths: list[str]) -> None:
    """Returns once the window has said that it took the files."""
    display = ctypes.c_void_p(X.XOpenDisplay(None))
    root = X.XDefaultRootWindow(display)
    mine = X.XCreateSimpleWindow(display, ctypes.c_ulong(root), 0, 0, 1, 1, 0, 0, 0)
    atoms: dict[str, int] = {}

    def atom(name: str) -> int:
        return atoms.setdefault(name, X.XInternAtom(display, name.encode(), 0))

    def tell(kind: str, *data: int) -> None:
        message = Event(CLIENT_MESSAGE, 0, 1, display.value or 0, window, atom(kind), 32, mine, *data)
        X.XSendEvent(display, window, 0, 0, ctypes.byref(message))

    # in over the window's corner, and the button comes up once the window says that it would take them
    X.XSetSelectionOwner(display, ctypes.c_ulong(atom("XdndSelection")), ctypes.c_ulong(mine), ctypes.c_ulong(0))
    tell("XdndEnter", VERSION << 24, atom("text/uri-list"), 0, 0)
    tell("XdndPosition", 0, 0, 0, atom("XdndActionCopy"))
    if not paths:
        X.XCloseDisplay(display)
        return
    event = Event()
    while True:
        X.XNextEvent(display, ctypes.byref(event))
        # its type is an int: the other half of the long is nobody's
        kind = event[0] & 0xFFFFFFFF
        if kind == SELECTION_REQUEST:
            requestor, selection, target, place = event[5:9]
            uris = "".join(f"{Path(path).resolve().as_uri()}\r\n" for path in paths).encode()
            X.XChangeProperty(display, requestor, place, target, 8, REPLACE, uris, len(uris))
            notice = Event(SELECTION_NOTIFY, 0, 1, display.value or 0, requestor, selection, target, place, event[9])
            X.XSendEvent(display, requestor, 0, 0, ctypes.byref(notice))
        elif kind == CLIENT_MESSAGE and event[5] == atom("XdndStatus"):
            tell("XdndDrop" if event[8] & 1 else "XdndLeave", 0, 0, 0)
        elif kind == CLIENT_MESSAGE and event[5] == atom("XdndFinished"):
            break
    X.XCloseDisplay(display)


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2:])

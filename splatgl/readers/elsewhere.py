"""Calls of functions in another process, which stays open: C++ libraries crash on damaged files, loop, and print."""

from __future__ import annotations

import ctypes
import math
import os
import pickle
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from threading import Lock, Timer
from typing import Any

from splatgl.errors import USER_ERRORS, InputError, error_text
from splatgl.fileio import budget, within
from splatgl.plugins import find_function

# seconds for which the process waits for another call, or is waited for when it starts, and that a call may take: some,
# and one for so many bytes
IDLE, SECONDS, BYTES = 60.0, 60.0, 2**17
# seconds of the processor that a call may take, where the system limits them: they end a process whose caller has ended
BUSY, BUSY_BYTES = 10.0, 2**19
# bytes of the process itself, libraries included; bytes for a look at a file
OWN, LOOK_BYTES = 2**30, 2**31
# of SetErrorMode: no window tells of a crash
SILENT = 0x1 | 0x2
# what looks at files found, "" for nothing: by function, path, bytes and time
_LOOKS: dict[tuple[str, str, int, int], str] = {}
# the open process, by the one that started it: a copy of that by `fork` has to start its own
_open: dict[int, subprocess.Popen[bytes]] = {}
_lock = Lock()


def call(place: str, size: int, *arguments: object) -> Any:
    """The value of the function at module.function of this folder, called with arguments in another process, within
    this one's memory budget. size: bytes of the file. Raises the function's InputError, and one where it fails.
    """
    return _call((place, budget(), BUSY + size / BUSY_BYTES, arguments), SECONDS + size / BYTES)


def look(place: str, path: Path, seconds: float) -> None:
    """Has a function, as of `call`, read a file before this process does, once, in so many seconds of the processor.
    Raises InputError where it fails. A process that cannot be started says nothing of the file.
    """
    status = path.stat()
    key = place, str(path.resolve()), status.st_size, status.st_mtime_ns
    if key not in _LOOKS:
        _LOOKS[key] = ""
        try:
            _call((place, min(budget(), LOOK_BYTES), seconds, (path,)), SECONDS + seconds)
        except USER_ERRORS as error:
            _LOOKS[key] = error_text(error)
        except OSError:
            pass
    if _LOOKS[key]:
        raise InputError(_LOOKS[key])


def _call(asked: tuple[str, int, float, tuple[object, ...]], limit: float) -> Any:
    request = pickle.dumps(asked)
    with _lock:
        # a process that is not new may be at its end, or harmed by an earlier file
        for is_new in (False, True):
            process = None if is_new else _open.pop(os.getpid(), None)
            if process is None:
                is_new = True
                code = f"import sys; sys.path[:] = {sys.path!r}; from {__name__} import serve; serve()"
                pipe, flags = subprocess.PIPE, getattr(subprocess, "CREATE_NO_WINDOW", 0)
                process = subprocess.Popen(
                    [sys.executable, "-c", code],
                    stdin=pipe,
                    stdout=pipe,
                    stderr=subprocess.DEVNULL,
                    creationflags=flags,
                )
                if _ask(process, b"", IDLE) is None:
                    raise OSError("Python cannot be started")
            answer = _ask(process, request, limit)
            if answer is not None:
                _open[os.getpid()] = process
                break
            if is_new or process.returncode == -getattr(signal, "SIGXCPU", 0):
                why = "crashes, takes too long or needs more memory than there is"
                raise InputError(f"cannot be read: the format's library {why}; the file may be damaged")
    if isinstance(answer, BaseException):
        raise answer
    return answer[0]


def _ask(process: subprocess.Popen[bytes], request: bytes, seconds: float) -> Any:
    """The answer of a process, None if there is none; it is ended then."""
    assert process.stdin is not None and process.stdout is not None
    timer, answer = Timer(seconds, process.kill), None
    timer.start()
    try:
        with suppress(EOFError, OSError, pickle.UnpicklingError):
            process.stdin.write(request)
            process.stdin.flush()
            answer = pickle.load(process.stdout)
    finally:
        timer.cancel()
        if answer is None:
            process.kill()
            for file in (process.stdin, process.stdout):
                with suppress(OSError):
                    file.close()
            process.wait()
    return answer


def serve() -> None:
    """Calls what the standard input asks for, and writes a tuple of the value, or an error, to the standard output."""
    output = os.fdopen(os.dup(1), "wb")
    # what libraries print
    os.dup2(2, 1)
    # it is there
    pickle.dump((), output)
    output.flush()
    with suppress(EOFError):
        while True:
            idle = Timer(IDLE, os._exit, (0,))
            idle.start()
            place, memory, seconds, arguments = pickle.load(sys.stdin.buffer)
            idle.cancel()
            answer: object
            try:
                _limit(memory, seconds)
                with within(memory):
                    answer = (find_function(place, __package__)(*arguments),)
            except USER_ERRORS as error:
                answer = error
            pickle.dump(answer, output, 5)
            output.flush()
    os._exit(0)


def _limit(memory: int, seconds: float) -> None:
    """Limits the memory of this process, and its further seconds of the processor, where the system can."""
    if sys.platform == "win32":
        ctypes.windll.kernel32.SetErrorMode(SILENT)
    most = {"RLIMIT_AS": OWN + memory, "RLIMIT_CORE": 0, "RLIMIT_CPU": math.ceil(time.process_time() + seconds)}
    for name, number in most.items():
        # macOS refuses some
        with suppress(ImportError, OSError, ValueError, AttributeError):
            import resource

            hard = resource.getrlimit(getattr(resource, name))[1]
            soft = number if hard == resource.RLIM_INFINITY else min(number, hard)
            resource.setrlimit(getattr(resource, name), (soft, hard))

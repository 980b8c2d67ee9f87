"""Calls of functions in another process, which stays open: C++ libraries crash on damaged files, loop, and print."""

from __future__ import annotations

import math
import os
import pickle
import signal
import subprocess
import sys
import time
from contextlib import suppress
from threading import Lock, Timer
from typing import Any

from splatgl.errors import USER_ERRORS, InputError
from splatgl.fileio import budget, within
from splatgl.plugins import find_function

# seconds for which the process waits for another call, and that a call may take: some, and one for so many bytes
IDLE, SECONDS, BYTES = 60.0, 60.0, 2**17
# seconds of the processor that a call may take, where the system limits them: they end a process whose caller has ended
BUSY, BUSY_BYTES = 10.0, 2**19
# bytes of the process itself, libraries included
OWN = 2**30
# the open process, by the one that started it: a copy of that by `fork` has to start its own
_open: dict[int, subprocess.Popen[bytes]] = {}
_lock = Lock()


def call(place: str, size: int, *arguments: object) -> Any:
    """The value of the function at module.function of this folder, called with arguments in another process, within
    this one's memory budget. size: bytes of the file. Raises the function's InputError, and one where it fails.
    """
    request = pickle.dumps((place, budget(), BUSY + size / BUSY_BYTES, arguments))
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
            answer = _ask(process, request, SECONDS + size / BYTES)
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
    with suppress(ImportError, OSError, ValueError, AttributeError):
        import resource

        hard = resource.getrlimit(resource.RLIMIT_AS)[1]
        most = OWN + memory
        resource.setrlimit(resource.RLIMIT_AS, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
        resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(time.process_time() + seconds), hard))

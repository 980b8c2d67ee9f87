"""Preloaded by local workers, which ignore Ctrl-C, as their client ends them, and leave notes on files to it."""

from __future__ import annotations

import signal
import warnings

from splatgl.errors import InputWarning


def dask_setup(_: object) -> None:
    """Called by Dask in a worker's main thread."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    warnings.simplefilter("ignore", InputWarning)

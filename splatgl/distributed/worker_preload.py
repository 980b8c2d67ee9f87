"""Preloaded by local workers, which ignore Ctrl-C: their client ends them."""

from __future__ import annotations

import signal


def dask_setup(_: object) -> None:
    """Called by Dask in a worker's main thread."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

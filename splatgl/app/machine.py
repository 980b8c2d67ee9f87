"""Hardware and software versions, recorded with a report's timings."""

from __future__ import annotations

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from splatgl.gl.context import ContextInfo

PACKAGES = ("splatgl", "moderngl", "numpy", "Pillow", "matplotlib", "flip-evaluator", "vtk")


def machine(info: ContextInfo) -> dict[str, object]:
    """Processor, system, GL_RENDERER and library versions, as plain values."""
    return {
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 0,
        "system": platform.platform(),
        "python": platform.python_version(),
        "renderer": info.renderer,
        "opengl": info.version,
        "backend": info.backend,
        "software": info.software,
        "versions": {name: found for name in PACKAGES if (found := _version(name))},
    }


def _processor() -> str:
    """The processor's name from Linux, else from Python."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return named[0] if named else platform.processor() or platform.machine()


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ""

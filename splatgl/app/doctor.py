"""`splatgl doctor`: installed packages, available OpenGL contexts, and checks of the OpenGL features required."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version

from splatgl.data.errors import InputError, expected
from splatgl.gl.context import BACKENDS, context_info, egl_devices, open_context
from splatgl.gl.selfcheck import Check, run_checks

PACKAGES = ("splatgl", "moderngl", "numpy", "glfw", "pyrr", "Pillow")


def report(backend: str = "auto", device: int | None = None) -> tuple[str, bool]:
    """The report as multi-line text, and whether images rendered by `backend` can be trusted.

    False if no context opens, or if float32 blending or filtering is wrong. Raises InputError for an invalid backend
    or device.
    """
    if backend not in ("auto", *BACKENDS):
        raise expected("backend", " | ".join(("auto", *BACKENDS)), backend)
    if device is not None and device < 0:
        raise expected("device", "an EGL device number from 0", device)
    chosen, ok = _chosen(backend, device)
    parts = (["versions", *_versions()], ["backends", *_backends()], chosen)
    return "\n\n".join("\n".join(part) for part in parts), ok


def _versions() -> list[str]:
    """Versions of Python and the packages, one per line."""
    lines = [f"  {'Python':9} {platform.python_version()} on {platform.platform()}"]
    for name in PACKAGES:
        try:
            lines.append(f"  {name:9} {version(name)}")
        except PackageNotFoundError:
            lines.append(f"  {name:9} not installed")
    return lines


def _backends() -> list[str]:
    """Result of each backend, and of each EGL device if there are several."""
    asked: list[tuple[str, int | None]] = [(name, None) for name in BACKENDS]
    devices = egl_devices()
    if len(devices) > 1:
        asked[:1] = [("egl", number) for number in devices]
    return [_outcome(name, device) for name, device in asked]


def _outcome(name: str, device: int | None) -> str:
    """The renderer, or why there is none, in one line."""
    label = name if device is None else f"{name} {device}"
    try:
        ctx = open_context(name, device, require_gpu=False)
    except InputError as error:
        return f"  {label:9} {error}"
    try:
        info = context_info(ctx)
    finally:
        ctx.release()
    return f"  {label:9} {info.renderer}, OpenGL {info.version}" + (", software" if info.software else "")


def _chosen(backend: str, device: int | None) -> tuple[list[str], bool]:
    """The selected backend: its limits and checks, and whether all required checks pass."""
    try:
        ctx = open_context(backend, device)
    except InputError as error:
        return [f"nothing can be drawn: {error}"], False
    try:
        info, checks = context_info(ctx), run_checks(ctx)
    finally:
        ctx.release()
    ok = all(check.passed for check in checks if check.required)
    lines = [
        f"rendering with {info.backend}: {info.renderer}",
        f"  vendor {info.vendor}, GLSL {info.glsl}",
        f"  textures up to {info.max_texture_size}², {info.max_samples} samples, "
        f"uniform blocks of {info.max_uniform_block} bytes",
        *(check_line(check) for check in checks),
        "",
        "float32 pictures are right" if ok else "float32 pictures are WRONG on this driver",
    ]
    return lines, ok


def check_line(check: Check) -> str:
    """Text of a check; a failed optional check is reported as a property of the target."""
    word = "ok" if check.passed else ("WRONG" if check.required else "coarse")
    return f"  {check.name:18} {word:6} {check.got:.6f}, exact {check.answer:.6f}"

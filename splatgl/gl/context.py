"""Opens a core context of OpenGL 3.3 or newer by one of the platform's backends, and describes it."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

import moderngl

from splatgl.errors import InputError, expected
from splatgl.gl.backends import (
    SPAWN,
    BackendError,
    Headless,
    Loader,
    Osmesa,
    current_loader,
    device_count,
    forked,
    open_window,
    switch_to,
)
from splatgl.opengl import OpenGL
from splatgl.platforms import BACKENDS, INSTALL, has_display, window_fix

REQUIRE_GPU = "SPLATGL_REQUIRE_GPU"  # environment: 1 refuses software renderers
GL_SHADING_LANGUAGE_VERSION = 0x8B8C  # gl.h
# Substrings of GL_RENDERER, lower case, of renderers on the CPU
SOFTWARE_RENDERERS = ("llvmpipe", "softpipe", "swrast", "swiftshader", "software", "gdi generic", "basic render")


@dataclass(frozen=True)
class ContextInfo:
    """Backend of a context, and the strings and limits that OpenGL reports."""

    backend: str  # of BACKENDS
    vendor: str
    renderer: str
    version: str
    glsl: str
    max_texture_size: int  # texels a side
    max_samples: int  # of a multisampled target
    max_uniform_block: int  # bytes
    software: bool  # drawn on the CPU

    def __str__(self) -> str:
        kind = ", software" if self.software else ""
        return f"{self.backend}: {self.renderer}, OpenGL {self.version}{kind}"


def open_context(opengl: OpenGL) -> moderngl.Context:
    """Opens the newest core context of OpenGL 3.3 to 4.6, current in this thread; free it with its `release()`.

    Draw inside `with current(ctx):` where several contexts are open. A forked process can neither use its parent's
    contexts nor open one of a library that its parent had opened. Raises InputError with each backend's failure and
    what to install.
    """
    device, require_gpu = opengl.device, opengl.gpu
    if require_gpu is None:
        require_gpu = os.environ.get(REQUIRE_GPU, "") not in ("", "0")

    # Try in order; the error message lists every refusal
    before = current_loader()
    refusals: list[str] = []
    requested = "egl" if device is not None else opengl.backend
    for name in BACKENDS if requested == "auto" else (requested,):
        try:
            return _open(name, device, require_gpu)
        except BackendError as error:
            refusals.append(f"{name} says: {error}")
    switch_to(before)
    subject = "OpenGL on a graphics card" if require_gpu else "OpenGL"
    fix = INSTALL.get(requested, INSTALL[BACKENDS[0]])
    if forked():
        fix = SPAWN
    elif require_gpu:
        what = "leave out gpu" if opengl.gpu else f"unset {REQUIRE_GPU}"
        fix = f"{what} to draw in software"
    elif requested == "window" and has_display():
        # nothing draws a window without its display, not OSMesa either
        fix = window_fix("; ".join(refusals))
    elif device is not None:
        fix = "leave the device out to take the first that works"
    raise expected(subject, "a context of version 3.3 or newer", "none (" + "; ".join(refusals) + ")", fix)


def adopt(loader: Loader) -> moderngl.Context:
    """Returns the moderngl context of an opened loader, such as that of a visible window; its `release()` frees both.

    Raises BackendError and frees the loader if OpenGL is older than 3.3.
    """
    # Only a window has a default framebuffer, `ctx.screen`
    try:
        settings: dict[str, Any] = {"context": loader}
        context = moderngl.create_context(standalone=loader.system.backend != "window", **settings)
    except (moderngl.Error, ValueError) as error:
        loader.release()
        raise BackendError(str(error)) from error
    context.extra = loader
    return context


def inherited(ctx: moderngl.Context) -> bool:
    """Whether `ctx` was opened before this process was forked and is thus unusable here."""
    return _loader(ctx).inherited


def check_process(ctx: moderngl.Context) -> None:
    """Raises InputError if `ctx` is inherited."""
    _loader(ctx).check_process()


@contextmanager
def current(ctx: moderngl.Context) -> Iterator[moderngl.Context]:
    """Makes `ctx` the thread's current context, and restores the previous one on exit."""
    with _loader(ctx):
        yield ctx


def context_info(ctx: moderngl.Context) -> ContextInfo:
    """Returns the properties of a context from `open_context`."""
    loader = _loader(ctx)
    with loader:
        info = ctx.info
        renderer = str(info["GL_RENDERER"])
        return ContextInfo(
            backend=loader.system.backend,
            vendor=str(info["GL_VENDOR"]),
            renderer=renderer,
            version=str(info["GL_VERSION"]),
            glsl=_glsl_version(loader),
            max_texture_size=int(info["GL_MAX_TEXTURE_SIZE"]),
            max_samples=int(info["GL_MAX_SAMPLES"]),
            max_uniform_block=int(info["GL_MAX_UNIFORM_BLOCK_SIZE"]),
            software=is_software(renderer),
        )


def egl_devices() -> range:
    """Returns the EGL device numbers; empty without EGL or if EGL cannot count them."""
    try:
        return range(device_count())
    except BackendError:
        return range(0)


def is_software(renderer: str) -> bool:
    """Whether a GL_RENDERER string names a software renderer."""
    return any(name in renderer.lower() for name in SOFTWARE_RENDERERS)


def _loader(ctx: moderngl.Context) -> Loader:
    """Returns the loader of a context from this module; raises InputError for other contexts."""
    if not isinstance(ctx.extra, Loader):
        raise InputError("context: expected one from splatgl's open_context, got one made elsewhere")
    return ctx.extra


def _open(name: str, device: int | None, require_gpu: bool) -> moderngl.Context:
    """Opens a context of one backend; among EGL devices, graphics cards come before software renderers."""
    software: moderngl.Context | None = None
    refusals: list[str] = []
    for opener in _openers(name, device):
        try:
            context = adopt(opener())
        except BackendError as error:
            refusals.append(str(error))
            continue
        renderer = context_info(context).renderer
        if not is_software(renderer):
            if software is not None:
                software.release()
            return context
        if software is None and not require_gpu:
            software = context
        else:
            refusals.append(f"{renderer} draws in software")
            context.release()
    if software is None:
        raise BackendError("; ".join(refusals))
    _loader(software).make_current()
    return software


def _openers(name: str, device: int | None) -> list[Callable[[], Loader]]:
    """Returns functions that open a context of this backend, in the order to try."""
    if name == "osmesa":
        return [partial(Loader, "OSMesa", Osmesa)]
    if name == "window":
        return [open_window]
    # A driver that cannot count its devices may still open its first; others than EGL have one
    numbers = range(max(device_count(), 1)) if device is None else (device,)
    return [partial(Loader, name.upper(), partial(Headless, name, number)) for number in numbers]


def _glsl_version(loader: Loader) -> str:
    """Returns GL_SHADING_LANGUAGE_VERSION, which moderngl does not report; the context must be current."""
    get_string = ctypes.CFUNCTYPE(ctypes.c_char_p, ctypes.c_uint)(loader.load_opengl_function("glGetString"))
    return (get_string(GL_SHADING_LANGUAGE_VERSION) or b"").decode()

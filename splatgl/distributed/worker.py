"""State of a worker between tasks: one thread, one renderer, and the latest volume."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, Any, TypeVar

from splatgl.coercion import public
from splatgl.errors import InputError
from splatgl.opengl import OpenGL

if TYPE_CHECKING:
    from splatgl.gl.renderer import Renderer

Result = TypeVar("Result")


@public
@dataclass(frozen=True)
class Drawing(OpenGL):
    """OpenGL of workers. devices: EGL devices in turn; empty: `device`, or if it is None and there are several graphics
    cards, one each.
    """

    devices: tuple[int, ...] = ()


class _Cache:
    """The cached renderer, and the cached value of one key."""

    drawing: Drawing | None = None
    renderer: Renderer | None = None
    key: Hashable = None
    value: object = None


@cache
def _thread() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(1, "splatgl")


def call(work: Callable[..., Result], *arguments: Any) -> Result:
    """Calls work(*arguments) in the drawing thread of this process. An InputError names the worker."""
    try:
        return _thread().submit(work, *arguments).result()
    except InputError as error:
        worker = _worker()
        raise InputError(f"{error} (on worker {worker.address if worker else 'here'})") from None


def _worker() -> Any:
    """Dask's worker in this process, or None."""
    try:
        from distributed import get_worker

        return get_worker()
    except (ImportError, ValueError):
        return None


def renderer(drawing: Drawing) -> Renderer:
    """The renderer of this process; closes one with other options."""
    from splatgl.gl.renderer import open_renderer

    if _Cache.renderer is None or _Cache.drawing != drawing:
        _release()
        _Cache.renderer = open_renderer(replace(drawing, device=device_of(drawing, index())))
        _Cache.drawing = drawing
    return _Cache.renderer


def keep_latest(key: Hashable, make: Callable[[], Result]) -> Result:
    """The cached result of `make` for a key; frees the result of another key first."""
    if _Cache.key != key:
        _Cache.key, _Cache.value = None, None
        _Cache.value = make()
        _Cache.key = key
    return _Cache.value  # type: ignore[return-value]


def release() -> None:
    """Closes the renderer and frees the cache of this process."""
    call(_release)


def _release() -> None:
    if _Cache.renderer is not None:
        _Cache.renderer.close()
    _Cache.renderer, _Cache.drawing, _Cache.key, _Cache.value = None, None, None, None


def index() -> int:
    """The number of the worker, which is its name in local clusters of Dask; else 0."""
    worker = _worker()
    name = str(worker.name) if worker else ""
    return int(name) if name.isdecimal() else 0


def device_of(drawing: Drawing, number: int) -> int | None:
    """The EGL device of worker `number`; None: the first that works."""
    devices = drawing.devices
    if not devices and drawing.device is None and drawing.may_be_egl:
        cards = graphics_cards()
        devices = cards if len(cards) > 1 else ()
    return devices[number % len(devices)] if devices else drawing.device


def graphics_cards() -> tuple[int, ...]:
    """EGL devices that are graphics cards; empty if there are fewer than two devices."""
    from splatgl.gl.context import context_info, egl_devices, open_context

    cards, devices = [], egl_devices()
    for device in devices if len(devices) > 1 else ():
        try:
            ctx = open_context(OpenGL("egl", device, gpu=True))
        except InputError:
            continue
        cards += [] if context_info(ctx).software else [device]
        ctx.release()
    return tuple(cards)

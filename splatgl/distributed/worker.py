"""What a worker keeps between its tasks: one thread, one renderer, and what it opened last."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, TypeVar

from splatgl.data.volume import Volume
from splatgl.errors import InputError
from splatgl.splat.settings import Settings
from splatgl.splat.transfer import Transfer

if TYPE_CHECKING:
    from splatgl.gl.renderer import Renderer

Found = TypeVar("Found")


@dataclass(frozen=True)
class Drawing:
    """How workers open OpenGL. devices: EGL devices, one a worker in turn; empty: each its own, if there are several
    graphics cards.
    """

    backend: str = "auto"
    devices: tuple[int, ...] = ()
    gpu: bool = False


@dataclass(frozen=True, eq=False)
class Subject:
    """What is drawn: workers open it themselves. key: names it among those that a worker keeps."""

    key: str
    open: Callable[[], Volume]
    transfer: Transfer
    settings: Settings
    drawing: Drawing


class _Kept:
    """The renderer, and the last thing that was made for a key."""

    drawing: Drawing | None = None
    renderer: Renderer | None = None
    key: Hashable = None
    made: object = None


@cache
def _thread() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(1, "splatgl")


def call(work: Callable[..., Found], *arguments: Any) -> Found:
    """work(*arguments), in the one thread of this process that draws. An InputError names the worker."""
    try:
        return _thread().submit(work, *arguments).result()
    except InputError as error:
        raise InputError(f"{error} (on worker {_address()})") from None


def _address() -> str:
    try:
        from distributed import get_worker

        return str(get_worker().address)
    except (ImportError, ValueError):
        return "here"


def renderer(drawing: Drawing) -> Renderer:
    """This process's renderer; another one is closed."""
    from splatgl.gl.renderer import Renderer

    if _Kept.renderer is None or _Kept.drawing != drawing:
        _release()
        _Kept.renderer = Renderer(drawing.backend, device_of(drawing, index()), drawing.gpu)
        _Kept.drawing = drawing
    return _Kept.renderer


def keep_latest(key: Hashable, make: Callable[[], Found]) -> Found:
    """What `make` returns, made once for a key; what was made for another is let go before."""
    if _Kept.key != key:
        _Kept.key, _Kept.made = None, None
        _Kept.made = make()
        _Kept.key = key
    return _Kept.made  # type: ignore[return-value]


def release() -> None:
    """Closes what this process keeps."""
    call(_release)


def _release() -> None:
    if _Kept.renderer is not None:
        _Kept.renderer.close()
    _Kept.renderer, _Kept.drawing, _Kept.key, _Kept.made = None, None, None, None


def index() -> int:
    """The worker's number, as Dask names those that it starts; 0 for other names, and outside of workers."""
    try:
        from distributed import get_worker

        name = str(get_worker().name)
    except (ImportError, ValueError):
        return 0
    return int(name) if name.isdecimal() else 0


def device_of(drawing: Drawing, number: int) -> int | None:
    """The EGL device of worker `number`; None: the first that works."""
    devices = drawing.devices
    if not devices and drawing.backend in ("auto", "egl"):
        cards = graphics_cards()
        devices = cards if len(cards) > 1 else ()
    return devices[number % len(devices)] if devices else None


def graphics_cards() -> tuple[int, ...]:
    """EGL devices that are graphics cards; empty with fewer than two devices, none of which need be chosen."""
    from splatgl.gl.context import context_info, egl_devices, open_context

    found, devices = [], egl_devices()
    for device in devices if len(devices) > 1 else ():
        try:
            ctx = open_context("egl", device, require_gpu=True)
        except InputError:
            continue
        found += [] if context_info(ctx).software else [device]
        ctx.release()
    return tuple(found)

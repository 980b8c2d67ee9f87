"""Workers of Dask: where they run, the distribution of work to them, and the state of one between tasks.

Scheduling, transport and retries are Dask's. A worker does one thing at a time, in one thread, which owns its OpenGL
context; it opens files itself.
"""

from __future__ import annotations

import logging
import os
import platform
from collections.abc import Callable, Hashable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, TypeVar

from splatgl.coercion import public
from splatgl.errors import InputError, expected, import_extra, one_line
from splatgl.fileio import call_within, stated_budget
from splatgl.opengl import OpenGL

if TYPE_CHECKING:
    from distributed import Client, LocalCluster

    from splatgl.gl.renderer import Renderer


Result = TypeVar("Result")


@public
@dataclass(frozen=True)
class Drawing:
    """OpenGL of workers. backend, device, gpu: as of `OpenGL`. devices: EGL devices in turn; empty: `device`, or if it
    is None and there are several graphics cards, one each.
    """

    backend: str = "auto"
    device: int | None = None
    gpu: bool | None = None
    devices: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        self.opengl(self.device)

    def opengl(self, device: int | None) -> OpenGL:
        """The choice of OpenGL with a device. Raises InputError as `OpenGL`."""
        return OpenGL(self.backend, device, self.gpu)


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
        _Cache.renderer = open_renderer(drawing.opengl(device_of(drawing, index())))
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
    if not devices and drawing.device is None and drawing.opengl(None).may_be_egl:
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


# seconds within which a scheduler and its workers must answer
TIMEOUT = 8.0
# number of workers that may die of one task
DEATHS = 3
# address of the dashboard, unless Dask's configuration has splatgl.dashboard: this machine only
DASHBOARD = "127.0.0.1:0"
# most workers on one machine
MOST = 1024

Found = TypeVar("Found")


@contextmanager
@public
def connected(
    workers: int | None, scheduler: str | None, tell: Callable[[str], None] | None = print
) -> Iterator[Client]:
    """A client of a scheduler, or of a number of workers on this machine, which end with it.

    tell: called with the dashboard's address. Raises InputError if nothing answers in TIMEOUT seconds, and for workers
    without splatgl, or with another version of it.
    """
    if workers is not None and not 1 <= workers <= MOST:
        raise expected("--workers", f"a whole number from 1 to {MOST}", workers)
    dask, distributed = (import_extra(name, "workers", "distributed", "scale") for name in ("dask", "distributed"))
    # errors are one line
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    with ExitStack() as stack:
        if scheduler is None:
            threads = str(max((os.cpu_count() or 1) // (workers or 1), 1))
            environment = {"LP_NUM_THREADS": threads, **dask.config.get("distributed.nanny.pre-spawn-environ", {})}
            nanny = {"distributed.nanny.pre-spawn-environ": environment}
            failures = {"distributed.scheduler.allowed-failures": DEATHS - 1}
            stack.enter_context(dask.config.set({**nanny, **failures}))
            cluster = distributed.LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                dashboard_address=dask.config.get("splatgl.dashboard", DASHBOARD),
                silence_logs=logging.CRITICAL,
                preload=["splatgl.distributed.worker_preload"],
            )
            client = stack.enter_context(_client(stack.enter_context(cluster)))
        else:
            client = stack.enter_context(_client(scheduler))
            check_workers(client, scheduler)
        # without bokeh the page only says that it is missing
        if tell and client.dashboard_link and find_spec("bokeh"):
            tell(f"dashboard: {client.dashboard_link}")
        yield client


def _client(scheduler: str | LocalCluster) -> Client:
    from distributed import Client

    client = Client.__new__(Client)
    try:
        # not Dask's default client: a failed client could become the default again when it is freed
        client.__init__(scheduler, timeout=TIMEOUT, set_as_default=False)
        return client
    except Exception as error:
        # close now: freed while the next client starts, it would wait forever
        with suppress(Exception):
            client.close()
        raise InputError(f"{scheduler}: no Dask scheduler of this version answers: {one_line(error)}") from None


def check_workers(client: Client, name: str = "the scheduler") -> None:
    """Raises InputError without workers, and for workers with another version of splatgl or Python, or without."""
    try:
        client.wait_for_workers(1, timeout=TIMEOUT)
    except TimeoutError:
        raise expected(name, "at least one worker", "none", "start some with: dask worker") from None
    right = about()
    futures = {
        address: client.submit(about, workers=[address], allow_other_workers=False, pure=False)
        for address in addresses(client)
    }
    for address, future in futures.items():
        try:
            versions = future.result(timeout=TIMEOUT)
        except Exception as error:
            raise InputError(f"worker {address}: cannot run splatgl: {one_line(error)}") from None
        if versions != right:
            raise expected(f"worker {address}", " and ".join(right), " and ".join(versions), "install the same there")


def about() -> tuple[str, str]:
    """Versions that workers and their client must share."""
    version = import_module("splatgl").__version__
    return f"splatgl {version}", f"Python {'.'.join(platform.python_version_tuple()[:2])}"


def addresses(client: Client) -> list[str]:
    """Addresses of all workers, sorted by name."""
    workers: dict[str, Any] = client.scheduler_info(n_workers=-1)["workers"]
    return sorted(workers, key=lambda address: str(workers[address].get("name", "")))


def spread(
    client: Client, work: Callable[..., Found], items: Iterable[tuple[str, tuple[Any, ...]]]
) -> Iterator[tuple[str, Found]]:
    """(name, work(*arguments)) of each item (name, arguments), as they are done; as many at a time as there are
    workers, each within the memory budget that is set here.

    InputError of the first item that raises one; of an item whose worker died DEATHS times once all others are done.
    """
    from distributed import as_completed

    todo, waiting, lost = iter(items), dict[Any, str](), list[InputError]()
    running = as_completed(loop=client.loop)

    def more() -> None:
        # a dying worker would fail waiting tasks, too
        while len(waiting) < max(len(addresses(client)), 1):
            item = next(todo, None)
            if item is None:
                return
            future = client.submit(call, call_within, stated_budget(), work, *item[1], pure=False)
            waiting[future] = item[0]
            running.add(future)

    try:
        more()
        for future in running:
            name = waiting.pop(future)
            try:
                result = outcome(future, name)
            except WorkerDied as error:
                lost.append(error)
            else:
                yield name, result
            more()
    finally:
        client.cancel(list(waiting))
    if lost:
        raise lost[0]


class WorkerDied(InputError):
    """A task that no worker survived."""


def outcome(future: Any, name: str) -> Any:
    """The result of a future. name: of the task, for an InputError."""
    from distributed import KilledWorker

    try:
        return future.result()
    except KilledWorker as error:
        times = error.allowed_failures + 1
        raise WorkerDied(f"{name}: its worker died {times} times, most likely out of memory; try --memory") from None

"""The shared renderer of a process, and the time that skipped steps save."""

from __future__ import annotations

import atexit
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from threading import RLock

import numpy as np

from splatgl.errors import InputError
from splatgl.gl.backends import BackendError, restored
from splatgl.gl.context import current, inherited
from splatgl.gl.renderer import Renderer
from splatgl.planning.plan import Plan
from splatgl.planning.technique import Hiding

# one picture at a time in all threads
_LOCK = RLock()
_renderers: list[Renderer] = []


@contextmanager
def shared_renderer() -> Iterator[Renderer]:
    """The shared renderer, locked for the calling thread. Raises InputError as `Renderer`."""
    with _LOCK, restored():
        if _renderers and inherited(_renderers[0].ctx):
            # a forked process cannot close it
            _renderers.clear()
        if _renderers and not is_usable(_renderers[0]):
            _renderers.clear()
        if not _renderers:
            _renderers.append(Renderer())
        try:
            yield _renderers[0]
        except InputError:
            raise
        except BackendError as error:
            # another library switched OpenGL's context
            close_shared_renderer()
            raise InputError(f"OpenGL: {error}; draw in a process of its own") from error
        except BaseException:
            # an interrupted renderer is not used again
            close_shared_renderer()
            raise


def is_usable(renderer: Renderer) -> bool:
    """Whether the context still exists: VTK ends the display that it shares with other libraries of the process."""
    try:
        with current(renderer.ctx):
            return True
    except BackendError:
        return False


def close_shared_renderer() -> None:
    """Closes the shared renderer; the next call opens a new one."""
    with _LOCK:
        while _renderers:
            last = _renderers.pop()
            # a lost context has freed itself
            if inherited(last.ctx) or is_usable(last):
                last.close()


atexit.register(close_shared_renderer)


# interleaved frames per variant, after a warm-up frame that compiles and uploads; the fastest counts
ROUNDS = 3


def measure_savings(renderer: Renderer, plan: Plan) -> list[str]:
    """A line of text for the planned frame, and one for each omission that is undone: its time, and the largest change
    of the picture.
    """
    ways = {"as planned": plan, **undo_omissions(plan)}
    pictures: dict[str, np.ndarray] = {}
    times: dict[str, float] = {}
    with current(renderer.ctx):
        for turn in range(ROUNDS + 1):
            for name, way in ways.items():
                started = time.perf_counter()
                pictures[name] = renderer.passes.draw(plan.splats, way)
                if turn:
                    times[name] = min(times.get(name, np.inf), time.perf_counter() - started)
    right, base = pictures.pop("as planned"), times.pop("as planned")
    lines = [f"a frame takes {base * 1e3:.3g} ms; without an omission:"]
    for name, seconds in times.items():
        change = float(np.abs(pictures[name] - right).max())
        lines.append(f"  {name}: {seconds / base:.2f} times as long, changes the picture by {change:.2g} at most")
    return lines if times else [f"a frame takes {base * 1e3:.3g} ms; no omission can be undone"]


def undo_omissions(plan: Plan) -> dict[str, Plan]:
    """Plans that undo each omission, by name, and a plan that undoes all."""
    program = plan.program
    if program.align != "exact" or plan.exposure is not None:
        return {}
    one_by_one = {
        "quads for tiles": (program.technique != "quads", plan.with_choices(technique="quads")),
        "antialiasing": (not program.seen.antialias, plan.with_choices(antialias=True)),
        "voxels of any shape": (program.seen.cubic, plan.with_choices(cubic=False)),
        "what is hidden": (plan.hiding.cutoff > 0, replace(plan, hiding=Hiding())),
    }
    plans = {name: undone for name, (is_omitted, undone) in one_by_one.items() if is_omitted}
    if plans:
        everything = plan.with_choices(technique="quads", antialias=True, cubic=False, half_line=True)
        plans["all of that, and half lines"] = everything
    return plans

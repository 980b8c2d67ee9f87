"""`Renderer`: owns a context and all its GL objects; renders splats through a camera into an `Image`."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from types import TracebackType
from typing import Any

import moderngl
import numpy as np

from splatgl.data.errors import InputError
from splatgl.data.image import Image
from splatgl.gl.context import check_process, context_info, current, inherited, open_context
from splatgl.gl.passes import Passes
from splatgl.gl.target import check_size
from splatgl.splat.bound.bound import bound
from splatgl.splat.extraction.splats import Splats
from splatgl.splat.motion.motion import Motion
from splatgl.splat.plan.plan import Plan, plan
from splatgl.splat.plan.settings import FULL_SHUTTER, Settings
from splatgl.splat.plan.suited import suited
from splatgl.splat.view.camera import Camera

# the finest form, table and target, against which coarser ones are measured
FINER: dict[str, Any] = {
    "align": "exact",
    "footprint": "auto",
    "table_size": None,
    "table_bits": 32,
    "target": "rgba32f",
    "technique": "auto",
}
# OpenGL version with compute shaders
COMPUTE = 430


class Renderer:
    """Headless renderer. Use it in a `with` block, or call `close()`.

    backend: egl | osmesa | window | auto. device: index of the EGL device. require_gpu: fail if a
    software renderer answers. Raises InputError if no context can be opened.
    """

    def __init__(self, backend: str = "auto", device: int | None = None, require_gpu: bool = False) -> None:
        self.owned = ExitStack()
        self.ctx: moderngl.Context = open_context(backend, device, require_gpu=require_gpu or None)
        self.owned.callback(self.ctx.release)
        try:
            self.info = context_info(self.ctx)
            self.passes = Passes(self.ctx, self.owned)
            # tiles are faster if the CPU blends
            self.tiles = self.info.software if self.ctx.version_code >= COMPUTE else None
        except BaseException:
            self.owned.close()
            raise

    def __enter__(self) -> Renderer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Releases every GL object and the context; further calls do nothing, nor does one in a forked process."""
        if inherited(self.ctx):
            return
        with current(self.ctx):
            self.owned.close()

    def plan(
        self, splats: Splats, camera: Camera, settings: Settings | None = None, motion: Motion | None = None
    ) -> Plan:
        """The plan that `render` would draw; tiles depend on the driver."""
        return plan(splats, camera, settings, motion, self.tiles)

    def render(
        self,
        splats: Splats,
        camera: Camera,
        settings: Settings | None = None,
        motion: Motion | None = None,
        verify_bound: bool = True,
        interrupted: Callable[[], bool] | None = None,
    ) -> Image:
        """The picture, linear premultiplied float32 [H, W, 4], row 0 on top.

        In `xray` A is Σ τ and RGB Σ τ·colour, unclamped.

        motion: of the scene since the previous frame; blurred as `settings.motion` says, or, without settings, exactly,
        while the shutter is open, up to now. Its error bound is to straight streaks, and None near the eye and for long
        voxels beyond z_k. verify_bound: if the bound exceeds the tolerance, render again with the finest form and
        measure. `info["tolerance_met"]`: whether the error bound is known and within the tolerance, which for X-rays is
        relative to the brightest component. interrupted: called between portions of the drawing; if it returns True,
        Interrupted is raised, and later pictures are unaffected. Raises InputError for a size beyond OpenGL's, for the
        flow of other splats, and in a process that was forked after the renderer was opened.
        """
        check_process(self.ctx)
        started = time.perf_counter()
        chosen = self.plan(splats, camera, settings, motion)
        splats = suited(splats, settings or Settings(), chosen.exposure is not None)
        with current(self.ctx):
            check_size(self.ctx, chosen.view.size)
            pixels = self._draw(splats, chosen, interrupted=interrupted)
        seconds = time.perf_counter() - started
        provenance = self._provenance(splats, camera, chosen, seconds)
        if chosen.exposure is not None:
            provenance |= {"motion": chosen.program.motion, "shutter": chosen.exposure.frames * FULL_SHUTTER}
        brightest = _brightest(pixels, chosen)
        own = bound(splats, chosen, brightest)
        error = own.total if own else None
        allowed = chosen.resolved.tolerance * max(brightest, 1e-30)
        if verify_bound and error is not None and error > allowed and not chosen.exposure:
            error = min(error, self._verified(splats, camera, settings or Settings(), chosen, pixels))
        met = error is not None and bool(error <= allowed)
        return Image(pixels, {**provenance, "error_bound": error, "tolerance_met": met})

    def _verified(self, splats: Splats, camera: Camera, settings: Settings, chosen: Plan, pixels: np.ndarray) -> float:
        """Difference to the picture of the finest form, table and target, plus its bound; inf if it is the same."""
        finer = self.plan(splats, camera, settings.but(motion="off", **FINER))
        if _kind(finer) == _kind(chosen):
            return float("inf")
        with current(self.ctx):
            right = self._draw(splats, finer, "finer")
        apart, own = float(np.abs(right - pixels).max()), bound(splats, finer, _brightest(right, finer))
        return apart + own.total if own else float("inf")

    def _draw(
        self, splats: Splats, chosen: Plan, role: str = "draw", interrupted: Callable[[], bool] | None = None
    ) -> np.ndarray:
        """The pixels; InputError if OpenGL ran out of memory or lost its context."""
        try:
            pixels = self.passes.draw(splats, chosen, role, interrupted)
        except moderngl.Error as error:
            raise self._failure(splats, chosen, str(error)) from error
        problem = self.ctx.error
        if problem != "GL_NO_ERROR":
            raise self._failure(splats, chosen, problem)
        return pixels

    def _failure(self, splats: Splats, chosen: Plan, problem: str) -> InputError:
        # cached objects may be incomplete: the next picture recreates them
        self.passes.release()
        width, height = (side // chosen.samples for side in chosen.view.size)
        return InputError(
            f"OpenGL failed on {len(splats):,} splats at {width}×{height}: {problem}; "
            "try a smaller picture, fewer samples, or a higher threshold"
        )

    def _provenance(self, splats: Splats, camera: Camera, chosen: Plan, seconds: float) -> dict[str, object]:
        """Scene, plan and driver as plain values that fit into a PNG's text."""
        program = chosen.program
        return {
            "scene": splats.name,
            "splats": len(splats),
            "size": list(camera.size),
            "projection": "perspective" if camera.perspective else "orthographic",
            "eye": [float(x) for x in camera.eye],
            "forward": [float(x) for x in camera.forward],
            "blend": program.look.blend.name,
            "kernel": chosen.kernel.name,
            "technique": program.technique,
            "align": program.align,
            "z_s": chosen.z_s,
            "z_k": _finite(chosen.resolved.z_k),
            "antialias": program.seen.antialias,
            "samples": chosen.samples,
            "averaged": chosen.resolved.averaged,
            "classification": "post" if program.look.steps else "pre",
            "sheets": program.look.sheets,
            "steps": program.look.steps,
            "attenuation": program.look.attenuation,
            "shading": program.look.shading,
            "order": chosen.order,
            "footprint": chosen.table,
            "target": chosen.target,
            "tolerance": chosen.resolved.tolerance,
            "dropped_depth": splats.dropped_depth,
            "background": None if chosen.resolved.background is None else list(chosen.resolved.background),
            "renderer": self.info.renderer,
            "backend": self.info.backend,
            "opengl": self.info.version,
            "seconds": round(seconds, 6),
        }


def _kind(chosen: Plan) -> tuple[object, ...]:
    """The choices that decide how coarse a picture is."""
    program = chosen.program
    return program.align, program.footprint, chosen.target, chosen.lookup.size, chosen.lookup.bits


def _brightest(pixels: np.ndarray, chosen: Plan) -> float:
    """The largest component of an X-ray, to which its errors are relative; 1 for other pictures."""
    return float(pixels.max()) if chosen.program.look.blend.unbounded else 1.0


def _finite(x: float) -> float | None:
    return float(x) if np.isfinite(x) else None

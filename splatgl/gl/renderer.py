"""`Renderer`: owns an OpenGL context and its objects; draws splats and scenes into an `Image`."""

from __future__ import annotations

import atexit
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from functools import partial
from threading import RLock
from types import TracebackType
from typing import Any

import moderngl
import numpy as np

from splatgl.coercion import public
from splatgl.data.image import Image
from splatgl.errors import InputError, expected
from splatgl.geometry.camera import Camera
from splatgl.gl.backends import BackendError, ContextLost, restore_context, restored
from splatgl.gl.context import check_process, context_info, current, inherited, open_context
from splatgl.gl.passes import Passes
from splatgl.gl.shader import choose_shape
from splatgl.gl.sheet_tiles import SplatBatches
from splatgl.gl.target import check_size
from splatgl.opengl import OpenGL
from splatgl.planning.bricks import Bricks, IsVisible
from splatgl.planning.error_bound import bound
from splatgl.planning.plan import Plan, plan
from splatgl.planning.resolve import why_per_splat
from splatgl.planning.scene import ResolvedScene, Scene, ScenePlan, join_pictures, plan_scene
from splatgl.planning.technique import OcclusionCulling, TileSupport
from splatgl.splat.extract_values import post_splats
from splatgl.splat.hidden_interior import LEFT_OUT
from splatgl.splat.motion import Motion, Supersampling
from splatgl.splat.settings import FULL_SHUTTER, Settings
from splatgl.splat.splats import Splats

# the finest form, table and target, to which coarser ones are compared
FINER: dict[str, Any] = {
    "align": "exact",
    "footprint": "auto",
    "table_size": None,
    "table_bits": 32,
    "target": "rgba32f",
    "technique": "auto",
}


@public
class Renderer:
    """Headless renderer. Use it in a `with` block, or call `close()`.

    backend: egl, osmesa, window or auto. device: index of the EGL device. require_gpu: fail with a software renderer.
    shape: of shaders of tiles, processor or card; None: SPLATGL_SHAPE, or by the device. Raises
    InputError if no context can be opened.
    """

    def __init__(
        self, backend: str = "auto", device: int | None = None, require_gpu: bool = False, shape: str | None = None
    ) -> None:
        self.owned = ExitStack()
        self.ctx: moderngl.Context = open_context(OpenGL(backend, device, require_gpu or None))
        self.owned.callback(self.ctx.release)
        try:
            self.info = context_info(self.ctx)
            self.passes = Passes(self.ctx, self.owned, choose_shape(self.info.software, shape))
            # tiles are faster than quads on processors and on cards
            self.tiles: TileSupport = True if self.passes.device.compute else "sheets"
        except BaseException:
            self.owned.close()
            raise
        finally:
            restore_context()

    def __enter__(self) -> Renderer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Releases all GL objects and the context; further calls, and calls in a forked process, do nothing. Does
        nothing if another library destroyed the context.
        """
        if inherited(self.ctx):
            return
        with suppress(ContextLost), current(self.ctx):
            self.owned.close()

    def free(self) -> None:
        """Frees splats, tables and lists of tiles that are cached on the device for the next picture."""
        with current(self.ctx):
            self.passes.release()

    def plan(
        self,
        splats: Splats | Any,
        camera: Camera | Any,
        settings: Settings | Any | None = None,
        motion: Motion | None = None,
    ) -> Plan:
        """The plan of the picture of splats that `render` draws; tiles depend on the driver."""
        return plan(splats, camera, settings, motion, self.tiles)

    def render(
        self,
        splats: Scene | Splats | Any,
        camera: Camera | Any,
        settings: Settings | Any | None = None,
        motion: Motion | None = None,
        verify_bound: bool = True,
        interrupted: Callable[[], bool] | None = None,
    ) -> Image:
        """Draws a picture of splats or of the visible layers of a scene: linear premultiplied float32 [H, W, 4], row 0
        on top; in `xray` A is Σ τ and RGB Σ τ·colour, unclamped.

        motion: of the scene since the previous frame; blurred as `settings.motion` says, while the shutter is open, up
        to now. verify_bound: if the error bound exceeds the tolerance, draw again with the finest form and measure the
        difference. interrupted: called between portions of the drawing; if it returns True, Interrupted is raised, and
        later pictures are unaffected. `info["tolerance_met"]`: whether the error bound is within the tolerance,
        which for X-rays is relative to the brightest component; None without a bound. `image.accuracy` also compares
        pixels with float64, once it is asked for. The bound of a mean of moments refers to the mean of their float64
        references; the bound of streaks to straight streaks, None near the eye and for long voxels beyond z_k; several
        layers and meshes have none. Raises InputError for a size beyond OpenGL's limit, for
        the flow of other splats, in a process that was forked after the renderer was opened, and as `plan_scene`.
        """
        check_process(self.ctx)
        settings = settings or Settings()
        scene = plan_scene(splats, camera, settings, motion, self.tiles)
        chosen, started = scene.first, time.perf_counter()
        if not chosen.moments or motion is None:
            return self.draw(scene, verify_bound, interrupted)
        sharp = replace(settings, moments=None, motion=settings.motion if chosen.exposure else "off")
        draw = partial(self.render, verify_bound=verify_bound, interrupted=interrupted)
        mean = Supersampling(draw, motion, sharp.shutter, chosen.moments, blurred=chosen.exposure is not None)
        # a scene has no flow, and is passed to `draw` unchanged
        image = mean(splats, camera, sharp)  # type: ignore[arg-type]
        info = self._scene_info(scene, started)
        return Image(image.pixels.astype(np.float32), {**image.info, **info}, plan=scene)

    def draw(self, scene: ScenePlan, verify_bound: bool = True, interrupted: Callable[[], bool] | None = None) -> Image:
        """As `render`, a picture by its plan, without the mean of moments. In `composite` extinctions and emissions of
        layers add up at every depth, and meshes end or weaken rays; in other blends pictures of layers are joined.
        """
        check_process(self.ctx)
        started = time.perf_counter()
        with current(self.ctx):
            check_size(self.ctx, scene.first.view.size)
            pixels = self._draw_scene(scene, interrupted)
        info = self._scene_info(scene, started) | self._error(scene, pixels, verify_bound)
        return Image(pixels, info, drawn=None if scene.is_moving else pixels, plan=scene)

    def _draw_scene(self, scene: ScenePlan, interrupted: Callable[[], bool] | None) -> np.ndarray:
        chosen, resolved = scene.first, scene.resolved
        if resolved.is_single:
            return self._draw(chosen, interrupted=interrupted)
        if resolved.is_joined:
            pictures = [self._draw(layer, interrupted=interrupted) for layer in scene.layers]
            return join_pictures(pictures, resolved.settings)
        layers = [(layer.splats, layer) for layer in scene.layers]
        if not resolved.meshes:
            return self._guarded(chosen, partial(self.passes.draw_layers, layers, interrupted))
        is_lit = chosen.settings.shading != "off"
        return self._guarded(chosen, partial(self.passes.draw_surfaces, resolved.meshes, is_lit, layers, interrupted))

    def _scene_info(self, scene: ScenePlan, started: float) -> dict[str, object]:
        """Provenance of a picture of splats or layers. started: value of `time.perf_counter`."""
        info = self.provenance(scene.first, scene.resolved.camera, scene.seconds + time.perf_counter() - started)
        info |= {"notes": notes} if (notes := scene.notes) else {}
        if scene.resolved.is_single:
            return info
        splats, ground = [layer.splats for layer in scene.layers], scene.resolved.settings.ground
        return info | {
            "scene": " + ".join(layer.name for layer in splats),
            "layers": [layer.name for layer in splats],
            "splats": sum(map(len, splats)),
            "triangles": sum(map(len, scene.resolved.meshes)),
            "background": None if ground is None else list(ground),
        }

    def _error(self, scene: ScenePlan, pixels: np.ndarray, verify: bool) -> dict[str, object]:
        """The error bound, and whether the tolerance is met; several layers and meshes have no bound.

        verify: whether a picture whose bound exceeds the tolerance is compared with that of the finest form.
        """
        chosen = scene.first
        brightest = chosen.settings.brightest(pixels)
        known = bound(chosen.splats, chosen, pixels) if scene.resolved.is_single else None
        if known is None:
            return {"error_bound": None, "tolerance_met": None}
        error, allowed = known.total, chosen.resolved.tolerance * max(brightest, 1e-30)
        if verify and error > allowed and not chosen.exposure:
            error = min(error, self._verified(chosen, scene.resolved.camera, pixels))
        return {"error_bound": error, "tolerance_met": bool(error <= allowed)}

    def render_bricks(
        self,
        bricks: Bricks,
        camera: Camera,
        settings: Settings | None = None,
        progress: Callable[[int, int], None] | None = None,
        interrupted: Callable[[], bool] | None = None,
        bands: int = 1,
    ) -> Image:
        """Draws a volume while its values are extracted, with only some bricks in memory at a time.

        progress: called with the number of bricks done, and of all. bands: number of bands of rows, drawn one after
        another, as each needs memory for fewer splats. Raises InputError for settings that need splats other than
        values in sheets, and for a parallel view from inside the volume.
        """
        return self.draw_bricks(
            bricks, camera, self.plan_bricks(bricks, camera, settings), progress, interrupted, bands
        )

    def draw_bricks(
        self,
        bricks: Bricks,
        camera: Camera,
        chosen: Plan,
        progress: Callable[[int, int], None] | None = None,
        interrupted: Callable[[], bool] | None = None,
        bands: int = 1,
    ) -> Image:
        """As `render_bricks`, by a plan of `plan_bricks`."""
        started = time.perf_counter()
        visible = bricks.without_hidden(camera, chosen.settings)
        if visible.hidden is not None:
            chosen = replace(chosen, notes=(*chosen.notes, LEFT_OUT))
        pixels = self._draw_bricks(visible, chosen, progress, interrupted, bands)
        return self._of_bricks(bricks, camera, chosen, pixels, sum(bricks.found.values()), started)

    def render_part(
        self, bricks: Bricks, camera: Camera, settings: Settings | None = None, bands: int = 1
    ) -> np.ndarray:
        """Draws the samples, float32 [H, W, 4], of the shell of `Bricks.within`; in blends of one value, the value and
        the length over which it is known. Raises InputError as `render_bricks`.
        """
        return self._draw_bricks(bricks, self.plan_bricks(bricks, camera, settings), bands=bands)

    def render_joined(
        self, bricks: Bricks, camera: Camera, settings: Settings | None, samples: np.ndarray, splats: int
    ) -> Image:
        """The picture of joined samples of parts. bricks: of all parts. splats: number of splats of all parts."""
        started = time.perf_counter()
        chosen = self.plan_bricks(bricks, camera, settings)
        with current(self.ctx):
            pixels = self.passes.joined(samples, bricks.whole, chosen)
        return self._of_bricks(bricks, camera, chosen, pixels, splats, started)

    def plan_bricks(self, bricks: Bricks, camera: Camera, settings: Settings | None) -> Plan:
        """Plans a volume in bricks, or a part of one, whose pixels take all samples. Raises InputError as
        `render_bricks`, and for a size beyond OpenGL's limit.
        """
        check_process(self.ctx)
        whole = bricks.whole
        check_bricks_supported(whole, camera, settings or Settings())
        chosen = self.plan(whole, camera, settings)
        # bricks are clipped, not the splats that stand for them; they would be extracted twice to spare samples
        chosen = replace(chosen, splats=whole, resolved=replace(chosen.resolved, allowed=0.0))
        with current(self.ctx):
            check_size(self.ctx, chosen.view.size)
        return chosen.with_choices(half_line=True) if bricks.surround_eye(chosen.view) else chosen

    def _draw_bricks(
        self,
        bricks: Bricks,
        chosen: Plan,
        progress: Callable[[int, int], None] | None = None,
        interrupted: Callable[[], bool] | None = None,
        bands: int = 1,
    ) -> np.ndarray:
        before, bands = 0, max(bands, self.passes.sheets.least_bands(chosen.window))
        bricks.counts.clear()
        bricks.gaps.clear()

        def batches(seen: IsVisible) -> Iterator[Splats]:
            nonlocal before
            assert chosen.resolved.sheets is not None
            for records, done in bricks.batches(chosen.resolved.sheets, chosen.view, seen):
                yield post_splats(bricks.volume, bricks.post, records)
                if progress:
                    progress(before + done, bands * len(bricks.low))
            before += len(bricks.low)

        assert chosen.resolved.sheets is not None
        near = bricks.near(chosen.resolved.sheets, chosen.view)
        with current(self.ctx):
            return self._draw(chosen, interrupted=interrupted, batches=SplatBatches(batches, bands, bricks.shell, near))

    def _of_bricks(
        self, bricks: Bricks, camera: Camera, chosen: Plan, pixels: np.ndarray, splats: int, started: float
    ) -> Image:
        plan = ScenePlan((chosen,), ResolvedScene((), camera, chosen.settings, bricks=((bricks, chosen.settings),)))
        info = self._scene_info(plan, started)
        info |= {"splats": splats, "bricks": len(bricks.low), "error_bound": None, "tolerance_met": None}
        info["unmasked"] = bricks.whole.missing_samples + sum(bricks.gaps.values())
        return Image(pixels, info, drawn=pixels, plan=plan)

    def _verified(self, chosen: Plan, camera: Camera, pixels: np.ndarray) -> float:
        """The difference to the picture of the finest form, table and target, plus its bound; inf for that form."""
        finer = self.plan(chosen.splats, camera, _finer(chosen))
        if _kind(finer) == _kind(chosen):
            return float("inf")
        with current(self.ctx):
            right = self._draw(finer, "finer")
        known = bound(finer.splats, finer, right)
        return float(np.abs(right - pixels).max()) + known.total if known else float("inf")

    def _draw(
        self,
        chosen: Plan,
        role: str = "draw",
        interrupted: Callable[[], bool] | None = None,
        batches: SplatBatches | None = None,
    ) -> np.ndarray:
        return self._guarded(chosen, partial(self.passes.draw, chosen.splats, chosen, role, interrupted, batches))

    def _guarded(self, chosen: Plan, draw: Callable[[], np.ndarray]) -> np.ndarray:
        """The pixels. Raises InputError if OpenGL ran out of memory or lost its context."""
        try:
            pixels = draw()
        except moderngl.Error as error:
            raise self._failure(chosen, str(error)) from error
        problem = self.ctx.error
        if problem != "GL_NO_ERROR":
            raise self._failure(chosen, problem)
        return pixels

    def _failure(self, chosen: Plan, problem: str) -> InputError:
        # cached objects may be incomplete; the next picture recreates them
        self.passes.release()
        width, height = (side // chosen.samples for side in chosen.view.size)
        return InputError(
            f"OpenGL failed on {len(chosen.splats):,} splats at {width}×{height}: {problem}; "
            "try a smaller picture, fewer samples, or a higher threshold"
        )

    def provenance(self, chosen: Plan, camera: Camera, seconds: float) -> dict[str, object]:
        """Scene, plan and driver as plain values that the text of a PNG can store."""
        return {
            **chosen.resolved.info(chosen.splats, camera),
            "technique": chosen.program.technique,
            "align": chosen.program.align,
            "z_s": chosen.z_s,
            "z_k": _finite(chosen.resolved.z_k),
            "order": chosen.order,
            "cutoff": chosen.hiding.cutoff,
            "footprint": chosen.table,
            "target": chosen.target,
            "tolerance": chosen.resolved.tolerance,
            "dropped_depth": chosen.splats.dropped_depth,
            "unmasked": chosen.splats.missing_samples,
            "renderer": self.info.renderer,
            "backend": self.info.backend,
            "opengl": self.info.version,
            "seconds": round(seconds, 6),
            **_blur(chosen),
            **_light_info(chosen),
        }


def _finer(chosen: Plan) -> Settings:
    """Settings of the same picture with the finest form, table and target; `auto` could choose another picture."""
    same = {
        "compositing": "splats" if chosen.resolved.sheets is None else "sheets",
        "attenuation": chosen.program.appearance.attenuation,
    }
    return chosen.settings.replace(motion="off", **FINER | same)


def _kind(chosen: Plan) -> tuple[object, ...]:
    """The choices that decide how accurate a picture is."""
    program = chosen.program
    return program.align, program.footprint, chosen.target, chosen.lookup.size, chosen.lookup.bits


def _blur(chosen: Plan) -> dict[str, object]:
    """The motion blur of a picture; empty for a sharp one."""
    if chosen.exposure is not None:
        return {"motion": chosen.program.motion, "shutter": chosen.exposure.frames * FULL_SHUTTER}
    return {"motion": "moments"} if chosen.moments else {}


def _finite(x: float) -> float | None:
    return float(x) if np.isfinite(x) else None


def _light_info(chosen: Plan) -> dict[str, object]:
    """Number of cells, and seconds, of ambient occlusion and shadows; empty without them."""
    if chosen.resolved.cues is None:
        return {}
    fields = chosen.resolved.cues.fields
    depth, height, width = fields.coarse.extinction.shape
    return {"depth_cues": {"cells": [width, height, depth], "seconds": round(fields.seconds, 6)}}


def check_bricks_supported(whole: Splats, camera: Camera, settings: Settings) -> None:
    """Raises InputError for settings that pictures in bricks do not support. whole: splats that stand for all."""
    why = why_per_splat(settings, moving=False)
    if settings.classification == "pre" or why:
        raise expected("a volume in bricks", "values classified after reconstruction", why or "classification pre")
    for name in ("ambient_occlusion", "shadows"):
        if getattr(settings, name):
            fix = "give more --memory, or a part of the volume"
            raise expected(name.replace("_", " "), "a volume that fits into memory", "one in bricks or parts", fix)
    if not camera.perspective and camera.eye_from_points(whole.corners)[:, 2].min() < 0:
        raise expected("a volume in bricks", "a parallel view from outside", "an eye whose plane cuts the volume")


def open_renderer(opengl: OpenGL) -> Renderer:
    """A renderer of this choice of OpenGL."""
    return Renderer(opengl.backend, opengl.device, opengl.gpu or False)


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
        "what is hidden": (plan.hiding.cutoff > 0, replace(plan, hiding=OcclusionCulling())),
    }
    plans = {name: undone for name, (is_omitted, undone) in one_by_one.items() if is_omitted}
    if plans:
        everything = plan.with_choices(technique="quads", antialias=True, cubic=False, half_line=True)
        plans["all of that, and half lines"] = everything
    return plans

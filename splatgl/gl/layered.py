"""Pictures of scenes of several layers, by a renderer."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from splatgl.data.image import Image
from splatgl.errors import expected
from splatgl.gl.layer_tiles import Drawn
from splatgl.splat.camera import Camera
from splatgl.splat.motion import Moments, Motion
from splatgl.splat.resolve import streaked, suited
from splatgl.splat.scene import Scene, casting, check_layer, common_samples, joined
from splatgl.splat.settings import BLENDS, Settings
from splatgl.splat.splats import Splats

if TYPE_CHECKING:
    from splatgl.gl.renderer import Renderer


def render_scene(
    renderer: Renderer,
    scene: Scene,
    camera: Camera,
    settings: Settings,
    interrupted: Callable[[], bool] | None = None,
) -> Image:
    """The picture of all visible layers. In `composite` their extinctions and emissions add up at every depth; in other
    blends their pictures add up. Meshes end rays, or weaken them. No error bound is known. Raises InputError for
    settings that composite splat by splat, and for meshes in other blends.
    """
    started = time.perf_counter()
    drawn = common_samples(scene.drawn(settings), camera, settings)
    if len(drawn) == 1 and not scene.meshes:
        return renderer.render(drawn[0][0], camera, drawn[0][1], interrupted=interrupted)
    splats, meshes = [each for each, _ in drawn], scene.surfaces(settings)
    if BLENDS[settings.blend].ordered:
        layers = _together(
            [_planned(renderer, each, camera, own, "meshes" if meshes else "layers") for each, own in drawn], drawn
        )
        pixels = renderer.draw_layers(layers, meshes, settings.shading != "off", interrupted)
        info: Mapping[str, object] = renderer.provenance(layers[0][0], camera, layers[0][1], 0.0)
    elif scene.meshes:
        raise expected("meshes", "blend composite", settings.blend)
    else:
        alone = [(each, own.but(background=None)) for each, own in drawn]
        found = [renderer.render(each, camera, own, None, False, interrupted) for each, own in alone]
        pixels, info = joined([each.pixels for each in found], settings), found[0].info
    told = {
        "scene": " + ".join(each.name for each in splats),
        "layers": [each.name for each in splats],
        "splats": sum(map(len, splats)),
        "triangles": sum(map(len, meshes)),
        "background": None if settings.background is None else list(settings.background),
        "seconds": round(time.perf_counter() - started, 6),
        "error_bound": None,
        "tolerance_met": False,
        **({"notes": scene.notes} if scene.notes else {}),
    }
    return Image(pixels, {**info, **told})


def render_moving_scene(
    renderer: Renderer,
    scene: Scene,
    camera: Camera,
    settings: Settings,
    motion: Motion,
    interrupted: Callable[[], bool] | None = None,
) -> Image:
    """The picture of all visible layers while the camera, or all of them, move: the mean of its moments. Raises
    InputError as `render_scene`, for streaks, and for a flow.
    """
    if streaked(settings):
        raise expected("motion of layers", "the mean of moments", f"motion {settings.motion}")
    if motion.flow is not None:
        raise expected("motion of layers", "a camera that moves, or all of them", "a flow")
    count, still = scene.moments(camera, settings, motion), settings.but(motion="off", moments=None)

    def draw(_: Splats, view: Camera, asked: Settings) -> Image:
        return render_scene(renderer, scene, view, asked, interrupted)

    if count < 2:
        return render_scene(renderer, scene, camera, still, interrupted)
    # nothing but the camera moves: what each moment draws is the scene
    first = scene.drawn(settings)[0][0]
    mean = Moments(draw, motion, settings.shutter, count)(first, camera, still)
    return Image(mean.pixels.astype(np.float32), {**mean.info, "motion": "moments"})


def _together(layers: list[Drawn], drawn: list[tuple[Splats, Settings]]) -> list[Drawn]:
    """The layers, each of which keeps light off the others."""
    casters = [(splats, own) for (splats, _), (_, own) in zip(layers, drawn, strict=True)]
    every = zip(layers, casting([plan.resolved for _, plan in layers], casters), strict=True)
    return [(splats, replace(plan, resolved=each)) for (splats, plan), each in every]


def _planned(renderer: Renderer, splats: Splats, camera: Camera, settings: Settings, what: str) -> Drawn:
    chosen = renderer.plan(splats, camera, settings)
    check_layer(chosen.resolved, splats.name)
    if len(splats):
        renderer.require_tiles(what, chosen)
    return suited(splats, settings, moving=False), chosen

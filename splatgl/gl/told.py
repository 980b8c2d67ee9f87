"""What a renderer tells of pictures, and what it refuses."""

from __future__ import annotations

from splatgl.errors import expected
from splatgl.splat.camera import Camera
from splatgl.splat.plan import Plan
from splatgl.splat.resolve import one_by_one
from splatgl.splat.settings import Settings
from splatgl.splat.splats import Splats


def told_of(chosen: Plan) -> dict[str, object]:
    """The cells of ambient occlusion and shadows, and the seconds that they took; empty without."""
    if chosen.resolved.cues is None:
        return {}
    fields = chosen.resolved.cues.fields
    depth, height, width = fields.coarse.extinction.shape
    return {"depth_cues": {"cells": [width, height, depth], "seconds": round(fields.seconds, 6)}}


def refuse_bricks(whole: Splats, camera: Camera, settings: Settings) -> None:
    """InputError for a picture that can't be drawn while its splats are extracted; whole: stands for them."""
    why = one_by_one(settings, moving=False)
    if settings.classification == "pre" or why:
        raise expected("a volume in bricks", "values classified after reconstruction", why or "classification pre")
    for name in ("ambient_occlusion", "shadows"):
        if getattr(settings, name):
            fix = "give more --memory, or a part of the volume"
            raise expected(name.replace("_", " "), "a volume that fits into memory", "one in bricks or parts", fix)
    if not camera.perspective and camera.eye_from_points(whole.corners)[:, 2].min() < 0:
        raise expected("a volume in bricks", "a parallel view from outside", "an eye whose plane cuts the volume")

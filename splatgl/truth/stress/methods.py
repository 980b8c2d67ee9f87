"""Every method of the report's registry in extreme views: eye in the volume, and pixels far wider than voxels."""

from __future__ import annotations

import numpy as np

from splatgl.data.scenes import ball
from splatgl.reference import renderer
from splatgl.splat.camera import Camera
from splatgl.splat.resolve import depth_range
from splatgl.splat.settings import Settings
from splatgl.splat.transfer import Transfer
from splatgl.truth.report.methods import DEFAULT, methods
from splatgl.truth.stress.bench import Bench, voxels
from splatgl.truth.stress.case import Case, Check, check

# voxels a radius, and pixels a side
RADIUS, PIXELS = 5.0, 12
# eyes: at the centre, and at a distance where a pixel is six voxels wide; with angles of view, degrees
VIEWS = ((0.3, 90.0), (100.0, 40.0))


def every(bench: Bench) -> list[Check]:
    """Each method's largest error relative to its error bound."""
    splats = voxels(ball(RADIUS), Transfer(points=[(0.0, 0.0), (1.0, 0.6)], unit=1.0))
    # images classified after reconstruction state no bound
    bounded = [name for name, m in methods().items() if not m.peer and m.changes.get("classification") != "post"]
    worst = dict.fromkeys(bounded, 0.0)
    for distance, fov in VIEWS:
        eye = distance * np.array([0.48, -0.8, 0.36])
        camera = Camera.look_at(eye, eye * 1.5 if distance < RADIUS else (0, 0, 0), (0, 0, 1), fov, (PIXELS, PIXELS))
        for name in worst:
            method = methods()[name]
            settings = method.settings(Settings.like("0.1"), depth_range(splats, camera))
            drawn = bench.renderer.render(splats, camera, settings)
            bench.pictures += 1
            bench.bad_pixels += int((~np.isfinite(drawn.pixels)).sum())
            error = float(np.abs(drawn.pixels - renderer.render(splats, camera, settings).pixels).max())
            limit = drawn.info["error_bound"]
            assert isinstance(limit, float)
            worst[name] = max(worst[name], error / limit if limit else error)
    order = sorted(worst, key=lambda name: (name != DEFAULT, name))
    return [check(f"{name}: error/bound", worst[name], 0.0, 1.0) for name in order]


CASES = (
    Case(
        "methods",
        "every method of splatgl report, from inside and from afar",
        "a ball of 5 voxels; the eye in it, and 100 voxels away with pixels 6 voxels wide",
        "the float64 reference; the error over the bound that each picture states",
        every,
    ),
)

"""The right picture of what moves: the mean of many moments while the shutter is open."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from splatgl.data.errors import expected
from splatgl.data.image import Image
from splatgl.splat.extraction.splats import Splats
from splatgl.splat.motion.motion import Motion, exposure, streaks
from splatgl.splat.plan.settings import FULL_SHUTTER, Settings
from splatgl.splat.view.camera import Camera

# anything that draws: Renderer.render, or reference.render
Draw = Callable[[Splats, Camera, Settings], Image]


# between two moments nothing that is seen moves by more pixels than this: a footprint is three wide
STEP = 1.5
# moments at most, and splats whose paths are looked at
MOST, PROBED = 64, 4096
# the share of them that keeps to the step
KEPT = 0.99

# what draws pictures that move: Renderer.render
DrawMoving = Callable[[Splats, Camera, Settings, Motion], Image]


class Moments:
    """Draws by temporal supersampling with whatever else draws; itself such a `Draw`."""

    def __init__(self, draw: Draw, motion: Motion, shutter: float = 180.0, count: int = 256) -> None:
        if count < 1:
            raise expected("count", "at least one moment", count)
        self.draw, self.motion, self.count = draw, motion, count
        self.exposure = exposure(shutter)

    def __call__(self, splats: Splats, camera: Camera, settings: Settings) -> Image:
        """The mean of the moments' pictures; info is the last one's, with how many there were. Where each carries an
        error bound, their mean bounds this one's error, against the mean of the moments' right pictures.
        """
        total: np.ndarray | None = None
        bounds: list[float] = []
        for part in range(self.count):
            image = self._part(splats, camera, settings, part)
            pixels = image.pixels.astype(np.float64)
            total = pixels if total is None else total + pixels
            found = image.info.get("error_bound")
            bounds += [found] if isinstance(found, float) else []
        assert total is not None
        mean = total / self.count
        info = {**image.info, "moments": self.count, "shutter": self.exposure * FULL_SHUTTER}
        if "error_bound" in info:
            error = sum(bounds) / self.count if len(bounds) == self.count else None
            allowed = settings.tolerance * (max(float(mean.max()), 1e-30) if settings.blend == "xray" else 1.0)
            info |= {"error_bound": error, "tolerance_met": error is not None and error <= allowed}
        return Image(mean, info)

    def _part(self, splats: Splats, camera: Camera, settings: Settings, part: int) -> Image:
        """The picture in the middle of a part of the exposure."""
        at = -self.exposure * (part + 0.5) / self.count
        return self.draw(self.motion.moved(splats, at), self.motion.view(camera, at), settings)


class Shorter(Moments):
    """The mean of pictures that are each blurred over their part of the exposure: paths that bend become polygons,
    and matter is hidden by what was before it at the time.
    """

    def __init__(self, draw: DrawMoving, motion: Motion, shutter: float = 180.0, count: int = 4) -> None:
        super().__init__(draw, motion, shutter, count)  # type: ignore[arg-type]
        self.draw_moving = draw

    def _part(self, splats: Splats, camera: Camera, settings: Settings, part: int) -> Image:
        first, last = (-self.exposure * (part + side) / self.count for side in (1, 0))
        # a frame of its own, that the shutter is open for all of; its camera has the volume's motion
        view, flow = self.motion.view(camera, last), self.motion.flow
        moved = Motion(camera=self.motion.view(camera, first), flow=None if flow is None else flow * (last - first))
        return self.draw_moving(self.motion.moved(splats, last), view, settings.but(shutter=FULL_SHUTTER), moved)


def moments(splats: Splats, camera: Camera, motion: Motion, shutter: float) -> int:
    """How many moments show no more steps than footprints hide: for the fastest of what is seen, 1.5 pixels each.

    1 if nothing that is seen moves.
    """
    each = max(len(splats) // PROBED, 1)
    flow = None if motion.flow is None else motion.flow[::each]
    paths = streaks(replace(splats, records=splats.records[::each]), camera, replace(motion, flow=flow), shutter)
    spacing = splats.grid.mean_spacing
    # what is within the picture at any time on its path
    depth = np.where(paths.middle[2] > 0, paths.middle[2], np.inf) if camera.perspective else 1 / spacing
    middle, half_step = np.abs(paths.middle[:2] / depth), np.abs(paths.step / depth) / 2
    edge = np.array([[camera.size[0] / camera.size[1]], [1.0]]) * paths.camera.extent / 2
    seen = (middle <= edge + half_step).all(axis=0) & (paths.middle[2] > 0)
    if not seen.any():
        return 1
    longest = float(np.quantile(paths.pixels(spacing)[seen], KEPT))
    return min(int(np.ceil(longest / STEP)) + 1, MOST)

"""Motion blur of any picture: the mean of its moments while the shutter is open; of many, the reference of streaks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from splatgl.data.image import Image
from splatgl.errors import expected
from splatgl.splat.extraction.splats import Splats
from splatgl.splat.motion.motion import Motion, exposure, streaks
from splatgl.splat.plan.settings import FULL_SHUTTER, Settings
from splatgl.splat.view.camera import Camera

# a draw function: Renderer.render, or reference.render
Draw = Callable[[Splats, Camera, Settings], Image]


# maximum motion of visible splats between two moments, pixels: a footprint is three wide
STEP = 1.5
# maximum number of moments, and of splats whose paths are sampled
MOST, PROBED = 64, 4096
# fraction of the paths that must stay within STEP
KEPT = 0.99

# a draw function with motion: Renderer.render
DrawMoving = Callable[[Splats, Camera, Settings, Motion], Image]


class Moments:
    """Temporal supersampling of any `Draw`; itself a `Draw`."""

    def __init__(self, draw: Draw, motion: Motion, shutter: float = 180.0, count: int = 256) -> None:
        if count < 1:
            raise expected("count", "at least one moment", count)
        self.draw, self.motion, self.count = draw, motion, count
        self.exposure = exposure(shutter)

    def __call__(self, splats: Splats, camera: Camera, settings: Settings) -> Image:
        """The mean of the moments' images; info is the last one's, with their number. If each has an
        error bound, the mean of the bounds bounds the error against the mean of the moments' exact images.
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
        """The image at the middle of a part of the exposure."""
        at = -self.exposure * (part + 0.5) / self.count
        return self.draw(self.motion.moved(splats, at), self.motion.view(camera, at), settings)


class Shorter(Moments):
    """The mean of images, each with motion blur over its part of the exposure: curved paths become polygons, and
    occlusion follows the order at each time.
    """

    def __init__(self, draw: DrawMoving, motion: Motion, shutter: float = 180.0, count: int = 4) -> None:
        super().__init__(draw, motion, shutter, count)  # type: ignore[arg-type]
        self.draw_moving = draw

    def _part(self, splats: Splats, camera: Camera, settings: Settings, part: int) -> Image:
        first, last = (-self.exposure * (part + side) / self.count for side in (1, 0))
        # treated as a separate frame with the shutter always open; its camera includes the volume's motion
        view, flow = self.motion.view(camera, last), self.motion.flow
        moved = Motion(camera=self.motion.view(camera, first), flow=None if flow is None else flow * (last - first))
        return self.draw_moving(self.motion.moved(splats, last), view, settings.but(shutter=FULL_SHUTTER), moved)


def moments(splats: Splats, camera: Camera, motion: Motion, shutter: float) -> int:
    """Number of moments such that footprints hide the steps: at most 1.5 pixels each for the fastest visible splats.

    1 if nothing visible moves.
    """
    each = max(len(splats) // PROBED, 1)
    flow = None if motion.flow is None else motion.flow[::each]
    paths = streaks(replace(splats, records=splats.records[::each]), camera, replace(motion, flow=flow), shutter)
    spacing = splats.grid.mean_spacing
    # splats within the image at any time on their paths
    depth = np.where(paths.middle[2] > 0, paths.middle[2], np.inf) if camera.perspective else 1 / spacing
    middle, half_step = np.abs(paths.middle[:2] / depth), np.abs(paths.step / depth) / 2
    edge = np.array([[camera.size[0] / camera.size[1]], [1.0]]) * paths.camera.extent / 2
    seen = (middle <= edge + half_step).all(axis=0) & (paths.middle[2] > 0)
    if not seen.any():
        return 1
    longest = float(np.quantile(paths.pixels(spacing)[seen], KEPT))
    return min(int(np.ceil(longest / STEP)) + 1, MOST)

"""The right picture of what moves: the mean of many moments while the shutter is open."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from splatgl.data.errors import expected
from splatgl.data.image import Image
from splatgl.splat.camera import Camera
from splatgl.splat.motion import Motion, exposure
from splatgl.splat.rows import Splats
from splatgl.splat.settings import Settings

# anything that draws: Renderer.render, or reference.render
Draw = Callable[[Splats, Camera, Settings], Image]


class Moments:
    """Draws by temporal supersampling with whatever else draws; itself such a `Draw`."""

    def __init__(self, draw: Draw, motion: Motion, shutter: float = 180.0, count: int = 256) -> None:
        if count < 1:
            raise expected("count", "at least one moment", count)
        self.draw, self.motion, self.count = draw, motion, count
        self.exposure = exposure(shutter)

    def __call__(self, splats: Splats, camera: Camera, settings: Settings) -> Image:
        """The mean of the moments' pictures; info is the last one's, with how many there were."""
        total: np.ndarray | None = None
        for part in range(self.count):
            at = -self.exposure * (part + 0.5) / self.count
            image = self.draw(self.motion.moved(splats, at), self.motion.view(camera, at), settings)
            pixels = image.pixels.astype(np.float64)
            total = pixels if total is None else total + pixels
        assert total is not None
        info = {**image.info, "moments": self.count, "shutter": self.exposure * 360}
        return Image(total / self.count, info)

"""What every case draws with: the renderer, the paper's settings, and the float64 reference."""

from __future__ import annotations

from typing import Any

import numpy as np

from splatgl.splat.extraction.splats import Splats
from splatgl.splat.plan.settings import Settings
from splatgl.splat.view.camera import Camera
from splatgl.truth import reference
from splatgl.truth.drawing import Renderer

# the tolerance of what closed forms decide: nothing is left out for speed
FINEST = 1e-6


class Bench:
    """Draws and counts. All pictures are float64 [H, W, 4], linear, premultiplied, row 0 on top.

    pictures: how many `draw` has drawn; bad_pixels: how many of their values were not finite.
    """

    def __init__(self, renderer: Renderer) -> None:
        self.renderer = renderer
        self.pictures = 0
        self.bad_pixels = 0

    def draw(self, splats: Splats, camera: Camera, **settings: Any) -> np.ndarray:
        """By OpenGL, to FINEST unless a tolerance is given; what a case is about."""
        settings = {"tolerance": FINEST, **settings}
        pixels = self.renderer.render(splats, camera, Settings(**settings)).pixels.astype(np.float64)
        self.pictures += 1
        self.bad_pixels += int((~np.isfinite(pixels)).sum())
        return pixels

    def paper(self, splats: Splats, camera: Camera, **settings: Any) -> np.ndarray:
        """By OpenGL as in 1998: hybrid quads, 8-bit table and target, opacity attenuation."""
        return self.renderer.render(splats, camera, Settings.paper(**settings)).pixels.astype(np.float64)

    def truth(self, splats: Splats, camera: Camera, **settings: Any) -> np.ndarray:
        """By the true integrals in float64 [M98 Table 1 row 1]."""
        return reference.render(splats, camera, Settings(**settings)).pixels

"""Renderers used by every case: OpenGL, the paper's settings, and the float64 reference."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from splatgl import reference
from splatgl.reference.renderer import Renderer
from splatgl.splat.camera import Camera
from splatgl.splat.extract import extract
from splatgl.splat.settings import Settings
from splatgl.splat.splats import Splats

# tolerance for comparison with closed forms: nothing is omitted for speed
FINEST = 1e-6
# closed forms are of splats one by one, or of values on one ray through each pixel
PLAIN = {"compositing": "splats", "antialias": "paper"}

# splats of a volume and a transfer function, classified before
voxels = partial(extract, classification="pre")


class Bench:
    """Renders and counts. All images are float64 [H, W, 4], linear, premultiplied, row 0 at the top.

    pictures: number of images drawn by `draw`; bad_pixels: number of their non-finite values.
    """

    def __init__(self, renderer: Renderer) -> None:
        self.renderer = renderer
        self.pictures = 0
        self.bad_pixels = 0

    def draw(self, splats: Splats, camera: Camera, **settings: Any) -> np.ndarray:
        """Renders by OpenGL, to FINEST unless a tolerance is given: the result under test."""
        asked = Settings(**{**PLAIN, "tolerance": FINEST, **settings})
        pixels = self.renderer.render(splats, camera, asked).pixels.astype(np.float64)
        self.pictures += 1
        self.bad_pixels += int((~np.isfinite(pixels)).sum())
        return pixels

    def paper(self, splats: Splats, camera: Camera, **settings: Any) -> np.ndarray:
        """Renders by OpenGL as in 1998: hybrid quads, 8-bit table and target, opacity attenuation."""
        return self.renderer.render(splats, camera, Settings.paper(**settings)).pixels.astype(np.float64)

    def truth(self, splats: Splats, camera: Camera, **settings: Any) -> np.ndarray:
        """Renders exact integrals in float64 [M98 Table 1 row 1]."""
        return reference.render(splats, camera, Settings(**{**PLAIN, **settings})).pixels

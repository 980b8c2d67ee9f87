"""Regions over value and gradient, for noise."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from tests.helpers.bricks import noise

# over noise, whose values are about 0.5 and gradients about 0.1
SOME = (
    "box:0.3,0.55,0.03,0.12:#ff8800:0.5",
    "triangle:0.3,0.8,0,0.4:#2266ff:0.7",
    "gaussian:0.4,0.9,0.02,0.3:lime:0.4",
)


@pytest.fixture(scope="module")
def painting(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Path of a picture of noise, half of it transparent."""
    path = tmp_path_factory.mktemp("regions") / "painting.png"
    pixels = np.random.default_rng(4).integers(0, 256, (7, 11, 4), np.uint8)
    pixels[..., 3] //= 2
    pixels[::2, ::3, 3] = 0
    Image.fromarray(pixels, "RGBA").save(path)
    return str(path)


def half_flat(rng: np.random.Generator) -> np.ndarray:
    """Noise at one end along x, and one value at the other."""
    return np.asarray(0.5 + (noise(rng, (18, 15, 36)) - 0.5) * np.clip((np.arange(36) - 18) / 4, 0, 1), np.float32)

"""Guards a picture in pytest: pytest test_picture.py; the first time with --splatgl-update."""

from __future__ import annotations

from typing import Any

import splatgl as sg


def test_ball(splatgl_image: Any) -> None:
    """Fails if the picture differs from baselines/test_picture/test_ball.png by more than rounding."""
    splatgl_image(sg.render(sg.scenes.ball(12), azimuth=30, size=(160, 120)))


def test_front_and_side(splatgl_image: Any) -> None:
    """Two pictures of one test have names; drivers may differ by a little."""
    for name, azimuth in (("front", 0), ("side", 90)):
        splatgl_image(sg.render(sg.scenes.ball(12), azimuth=azimuth, size=(160, 120)), name=name, tolerance=0.02)

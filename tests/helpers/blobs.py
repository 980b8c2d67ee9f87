"""A volume for the viewer's tests, and how long they wait."""

from __future__ import annotations

import numpy as np

import splatgl as sg

SIZE = (120, 80)
# seconds after which a thread hangs
LONGEST = 300.0


def blob(side: int = 24, opaque: float = 40.0) -> sg.Volume:
    """Two balls of unlike size on a ground of zeros, on a grid that is not cubic."""
    z, y, x = np.indices((side, side, side)) / (side - 1) - 0.5
    big = np.clip(1.4 - 5 * np.sqrt(x * x + y * y + z * z), 0, 1)
    small = np.clip(1.2 - 12 * np.sqrt((x - 0.3) ** 2 + (y - 0.3) ** 2 + (z - 0.25) ** 2), 0, 1)
    return sg.Volume(np.float32(opaque * np.maximum(big, small)), spacing=(1.0, 1.0, 1.25), origin=(5.0, -3.0, 2.0))

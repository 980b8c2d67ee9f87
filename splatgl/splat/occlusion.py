"""When it pays to draw front to back in parts, and to close pixels between them that nothing passes any more."""

from __future__ import annotations

import numpy as np

from splatgl.splat.camera import Camera
from splatgl.splat.rows import Splats
from splatgl.splat.sprites import Reach

# share of the tolerance that may be hidden: the light that still passes a pixel when it is closed. sRGB is 13 times
# as steep at black as on average: so it is a level there too, at the default tolerance; 3/4 is but 5 % faster
SHARE = 1 / 13
# fewer splats, less depth on average over the window, or fewer splats over a pixel: closing costs more than it saves
FEWEST, SHALLOWEST, THINNEST = 20_000, 2.0, 12.0
# parts: measured to be best near this many times the square root of how many splats cover a pixel
PARTS, MOST_PARTS = 2.0, 48
# nearer parts are smaller: part i of n ends at (i/n)^this of the splats
GROWTH = 1.5


def parts(splats: Splats, camera: Camera, reach: Reach) -> int:
    """In how many parts to draw; 1 where closing pixels does not pay."""
    area = reach.window.width * reach.window.height
    if len(splats) < FEWEST or area == 0:
        return 1
    cover = len(splats) * (2 * reach.typical) ** 2 / area
    if cover < THINNEST or _mean_depth(splats, camera, reach, area) < SHALLOWEST:
        return 1
    return int(np.clip(round(PARTS * np.sqrt(cover)), 2, MOST_PARTS))


def cuts(count: int, number: int) -> list[int]:
    """Where `number` parts of `count` splats begin, and the end."""
    return [int(count * (n / number) ** GROWTH) for n in range(number)] + [count]


def _mean_depth(splats: Splats, camera: Camera, reach: Reach, area: int) -> float:
    """Optical depth that the splats would have if they were spread over the window."""
    pitch = camera.extent / camera.size[1]
    voxel = pitch * reach.mean_depth if camera.perspective else pitch / splats.grid.mean_spacing
    return splats.total_depth / (area * voxel**2)

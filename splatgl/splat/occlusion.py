"""When it pays to draw front to back in parts, and to close pixels between them that nothing passes any more."""

from __future__ import annotations

import numpy as np

from splatgl.splat.camera import Camera
from splatgl.splat.rows import Splats
from splatgl.splat.sprites import Reach

# share of the tolerance that may be hidden: the light that still passes a pixel when it is closed. sRGB is 13 times
# as steep at black as on average: so it is a level there too, at the default tolerance; 3/4 is but 5 % faster
SHARE = 1 / 13
# closing costs more than it saves: with fewer splats; with less optical depth on average over the window; with sprites
# that reach less far, in pixels; and seen from within, where the nearest sprite is this much larger than most
FEWEST, SHALLOWEST, SMALLEST, NEAREST = 20_000, 5.0, 2.5, 4.0
# with as much optical depth it pays for small sprites as well, and so does the map of what is hidden
SOLID = 20.0
# pixels along a tile's edge in the map of what is hidden, and how many of them the largest sprite may reach
TILE, FURTHEST = 4, 16
# parts: measured to be best near the square root of how many splats cover a pixel
MOST_PARTS = 32
# nearer parts are smaller: part i of n ends at (i/n)^this of the splats
GROWTH = 1.5


def closing(splats: Splats, camera: Camera, reach: Reach) -> tuple[int, bool]:
    """In how many parts to draw, 1 where closing pixels does not pay; and whether to map what is hidden."""
    area = reach.window.width * reach.window.height
    if len(splats) < FEWEST or area == 0 or around(reach) > FURTHEST or reach.largest > NEAREST * reach.typical:
        return 1, False
    depth = mean_depth(splats, camera, reach, area)
    if depth < SHALLOWEST or (depth < SOLID and reach.typical < SMALLEST):
        return 1, False
    cover = len(splats) * (2 * reach.typical) ** 2 / area
    return int(np.clip(round(np.sqrt(cover)), 2, MOST_PARTS)), depth >= SOLID


def around(reach: Reach) -> float:
    """How many tiles beyond its own a sprite may touch."""
    return float(np.ceil((reach.largest + 1) / TILE))


def cuts(count: int, number: int) -> list[int]:
    """Where `number` parts of `count` splats begin, and the end."""
    return [int(count * (n / number) ** GROWTH) for n in range(number)] + [count]


def mean_depth(splats: Splats, camera: Camera, reach: Reach, area: int) -> float:
    """Optical depth that the splats would have if they were spread over the window."""
    pitch = camera.extent / camera.size[1]
    voxel = pitch * reach.mean_depth if camera.perspective else pitch / splats.grid.mean_spacing
    return splats.total_depth / (area * voxel**2)

"""When splats are gathered by tiles of pixels instead of drawn as sprites, and in which portions.

A tile is a column of pixels for each of the lanes of a software renderer.
"""

from __future__ import annotations

import numpy as np

from splatgl.data.errors import expected
from splatgl.splat.camera import Camera
from splatgl.splat.kernel import Kernel
from splatgl.splat.occlusion import SOLID, mean_depth
from splatgl.splat.rows import MOST_KEPT, Splats
from splatgl.splat.settings import Settings
from splatgl.splat.sprites import Reach

# pixels along a tile's sides: tiles.glsl's COLUMNS and ROWS
COLUMNS, ROWS = 8, 8
# sprites are as good with fewer splats, and, but for solid volumes, where they reach less far, in pixels; those larger
# than so many pixels touch a lot of tiles and are left to quads
FEWEST, SMALLEST, LIMIT = 30_000, 2.0, 128.0
# a cursor for each tile and run of splats: pictures of more pixels would take more memory than sprites do
MOST_PIXELS = 2**24
# solid volumes of more splats than this are gathered in so many parts
MANY, PORTIONS = 1_000_000, 6
# splats gathered at a time: a texel each of three to seven textures
MOST = 2**20
# most halvings of an optical depth before its polynomial: what hides more than 1 − 2⁻³² hides all
HALVINGS = 5
# gain of a footprint at a slant over one that is seen from before, with a margin
SLANTED = 1.5


def tiled(splats: Splats, camera: Camera, settings: Settings, covered: Reach, preferred: bool | None) -> bool:
    """Whether tiles are drawn, for splats that could be sprites; preferred: None where the renderer has none."""
    why = _why_not(settings, preferred)
    if settings.primitive == "tile":
        if why:
            raise expected("primitive tile", "what tiles can be drawn with", why, "use auto")
        return True
    pixels = covered.window.width * covered.window.height
    if settings.primitive != "auto" or not preferred or why or len(splats) < FEWEST or pixels > MOST_PIXELS:
        return False
    # of so many there are no sprites
    return len(splats) > MOST_KEPT or covered.typical >= SMALLEST or _solid(splats, camera, covered)


def portions(splats: Splats, camera: Camera, covered: Reach) -> int:
    """In how many parts to gather: splats of solid volumes are mostly behind tiles that have ended."""
    return PORTIONS if len(splats) >= MANY and _solid(splats, camera, covered) else 1


def _solid(splats: Splats, camera: Camera, covered: Reach) -> bool:
    area = covered.window.width * covered.window.height
    return area > 0 and mean_depth(splats, camera, covered, area) >= SOLID


def _why_not(settings: Settings, preferred: bool | None) -> str:
    if preferred is None:
        return "an OpenGL without compute shaders"
    if settings.target not in ("auto", "rgba32f"):
        return f"target {settings.target}"
    if settings.blend == "composite" and settings.order == "back-to-front":
        return "order back-to-front"
    return ""


def halvings(splats: Splats, shape: Kernel, settings: Settings) -> int:
    """How often the largest depth, in powers of two, is halved until it is at most 1, where a polynomial holds."""
    if settings.attenuation == "opacity":
        # the unstretched splat's own, whatever the slant
        return HALVINGS
    longest = float(np.linalg.norm(splats.grid.world_from_index / splats.grid.mean_spacing, ord=2))
    deepest = splats.deepest * float(shape.footprint(np.zeros(()))) * longest * SLANTED / np.log(2.0)
    return int(np.clip(np.ceil(np.log2(max(deepest, 1e-30))), 0, HALVINGS))

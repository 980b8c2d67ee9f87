"""When splats are gathered by tiles of pixels instead of drawn as sprites, and in which portions.

A tile is a column of pixels for each of the lanes of a software renderer. What a splat costs by itself is shared by a
tile's pixels, and what it costs at a pixel is paid by those beside it too: large sprites get high tiles.
"""

from __future__ import annotations

import numpy as np

from splatgl.data.errors import expected
from splatgl.splat.kernel import Kernel
from splatgl.splat.rows import Splats
from splatgl.splat.settings import Settings
from splatgl.splat.sprites import Reach

# pixels along a tile's sides: high ones where half a sprite's side is this many pixels or more
COLUMNS, LOW, HIGH, LARGE = 8, 4, 8, 5.0
# sprites are as good with fewer splats; larger ones than so many pixels, which touch a lot of tiles, are left to quads
FEWEST, LIMIT = 5000, 128.0
# splats gathered at a time: a texel each of three to six textures
MOST = 2**20
# most halvings of an optical depth before its polynomial: what hides more than 1 − 2⁻³² hides all
HALVINGS = 5
# gain of a footprint at a slant over one that is seen from before, with a margin
SLANTED = 1.5


def tiled(splats: Splats, settings: Settings, preferred: bool | None) -> bool:
    """Whether tiles are drawn, for splats that could be sprites; preferred: None where the renderer cannot draw them."""
    why = _why_not(settings, preferred)
    if settings.primitive == "tile":
        if why:
            raise expected("primitive tile", "what tiles can be drawn with", why, "use auto")
        return True
    return settings.primitive == "auto" and bool(preferred) and not why and len(splats) >= FEWEST


def _why_not(settings: Settings, preferred: bool | None) -> str:
    if preferred is None:
        return "an OpenGL without compute shaders"
    if settings.target not in ("auto", "rgba32f"):
        return f"target {settings.target}"
    if settings.blend == "composite" and settings.order == "back-to-front":
        return "order back-to-front"
    return ""


def rows(covered: Reach) -> int:
    """Pixels along the upright side of a tile."""
    return HIGH if covered.typical >= LARGE else LOW


def halvings(splats: Splats, shape: Kernel) -> int:
    """How often the largest optical depth must be halved for 1 − 2⁻ˣ to be a polynomial's: down to 1, in powers of two."""
    longest = float(np.linalg.norm(splats.grid.world_from_index / splats.grid.mean_spacing, ord=2))
    deepest = splats.deepest * float(shape.footprint(np.zeros(()))) * longest * SLANTED / np.log(2.0)
    return int(np.clip(np.ceil(np.log2(max(deepest, 1e-30))), 0, HALVINGS))

"""How splats are gathered by tiles of pixels: in how many batches, and how their opacity is computed.

A tile is a column of pixels for each of the lanes of a software renderer.
"""

from __future__ import annotations

import numpy as np

from splatgl.splat.extraction.splats import Splats
from splatgl.splat.kernel.kernels import Kernel
from splatgl.splat.plan.occlusion_policy import solid
from splatgl.splat.view.screen_bounds import ScreenBounds
from splatgl.splat.view.view import View

# pixels along a tile's sides: tiles.glsl's COLUMNS and ROWS
COLUMNS, ROWS = 8, 8
# pixels gathered at a time: a cursor for each tile and run of splats takes as much memory as their colours
MOST_PIXELS = 2**24
# solid volumes of more splats than this are gathered in so many parts
MANY, BATCHES = 1_000_000, 6
# splats gathered at a time: a texel each of three to seven textures
MOST = 2**20
# most halvings of an optical depth before its polynomial: what hides more than 1 − 2⁻³² hides all
MOST_DOUBLINGS = 5
# gain of a footprint at a slant over one that is seen from before, with a margin
SLANTED = 1.5


def depth_batches(splats: Splats, view: View, bounds: ScreenBounds) -> int:
    """In how many parts to gather: splats of solid volumes are mostly behind tiles that have ended."""
    return BATCHES if len(splats) >= MANY and solid(splats, view, bounds) else 1


def exp_doublings(splats: Splats, shape: Kernel, attenuation: str) -> int:
    """How often the largest depth, in powers of two, is halved until it is at most 1, where a polynomial holds."""
    if attenuation == "opacity":
        # the unstretched splat's own, whatever the slant
        return MOST_DOUBLINGS
    longest = float(np.linalg.norm(splats.grid.world_from_index / splats.grid.mean_spacing, ord=2))
    deepest = splats.deepest * float(shape.footprint(np.zeros(()))) * longest * SLANTED / np.log(2.0)
    return int(np.clip(np.ceil(np.log2(max(deepest, 1e-30))), 0, MOST_DOUBLINGS))

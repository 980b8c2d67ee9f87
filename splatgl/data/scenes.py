"""Procedural scenes: the paper's tunnel, terrain and nerve cell, phantoms with known results, sampled formulas.

Deterministic: seeds are fixed. Every scene provides view hints.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from splatgl.data.scene_fields import balls, marschner_lobb, sinusoids
from splatgl.data.scene_nerve import nerve
from splatgl.data.scene_phantoms import ball, constant, letter_f, single_voxel
from splatgl.data.scene_terrain import terrain
from splatgl.data.volume import Hints, Volume
from splatgl.errors import expected

__all__ = ["SCENES", "ball", "balls", "constant", "letter_f", "marschner_lobb", "nerve", "single_voxel", "sinusoids"]
__all__ += ["terrain", "tunnel"]

# the tube in voxels: the box's sides and length, and a bore that leaves 0.69 million voxels of wall
TUNNEL_SHAPE = (300, 160, 160)
TUNNEL_OUTER, TUNNEL_BORE = 80.0, 75.32
# sRGB of the checks: a black line, at z_k, is seen on both
RED, WHITE = (220, 20, 20), (250, 250, 250)
# distance of the eye from the opening, in voxels
TUNNEL_EYE = 8.0


def tunnel(check: int = 10) -> Volume:
    """A tube of red and white checks along z, 160×160×300 voxels, 0.69 million of them wall.  [M98 §3.5 / Fig. 5]

    samples uint8: 255 in the wall, 0 elsewhere; color: the checks, about `check` voxels long and wide
    (an even number around). The view is down the bore. Raises InputError for checks under a voxel.
    """
    if not 1 <= check <= TUNNEL_SHAPE[0]:
        raise expected("check", f"a size from 1 to {TUNNEL_SHAPE[0]} voxels", check)
    length, height, width = TUNNEL_SHAPE
    x, y = np.arange(width) - (width - 1) / 2, np.arange(height)[:, None] - (height - 1) / 2

    # the wall's cross-section, and its checks around and along
    radius, turn = np.hypot(x, y), np.arctan2(y, x) / (2 * np.pi) + 0.5
    wall = (radius <= TUNNEL_OUTER) & (radius > TUNNEL_BORE)
    around = max(2, 2 * round(np.pi * TUNNEL_BORE / check))
    check_around = np.floor(turn * around).astype(int) % around
    check_along = np.arange(length) // check
    odd = (check_around + check_along[:, None, None]) % 2 == 1

    # repeat the cross-section along z
    samples = np.broadcast_to(wall * np.uint8(255), TUNNEL_SHAPE).copy()
    color = np.where(odd[..., None], np.array(WHITE, np.uint8), np.array(RED, np.uint8)) * wall[..., None]
    middle = ((width - 1) / 2, (height - 1) / 2)
    hints = Hints(
        points=((0.0, 0.0), (255.0, 0.99)),
        shading=False,
        eye=(*middle, -TUNNEL_EYE),
        target=(*middle, length / 2),
        up=(0.0, -1.0, 0.0),
        fov=60.0,
    )
    return Volume(samples, name="tunnel", color=color, hints=hints)


# built-in scenes by command-line name
SCENES: dict[str, Callable[[], Volume]] = {
    "tunnel": tunnel,
    "terrain": terrain,
    "nerve": nerve,
    "letter-f": letter_f,
    "marschner-lobb": marschner_lobb,
    "balls": balls,
    "sinusoids": sinusoids,
    "sinusoids-3": partial(sinusoids, 3),
}

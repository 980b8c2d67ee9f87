"""Culls splats that other matter hides from every side, for any view."""

from __future__ import annotations

import numpy as np

from splatgl.splat.extraction.splats import Splats

# a splat is hidden behind layers of cells, at most LAYERS in every direction, of this total optical depth:
# e^−6.2 = 0.002 of its light is transmitted, half of the tolerance below which nothing is culled
LAYERS, HIDING, FAITHFUL = 4, 6.2, 1 / 256
# maximum number of cells, since the whole box is processed
CELLS = 1 << 27
# minimum fraction of culled splats that justifies a copy
WORTH = 0.3


def skinned(splats: Splats) -> Splats:
    """The splats without those hidden from every side; the same object if hardly any are, or if they are classified
    after reconstruction.

    Valid for composite images from outside of the splats' box with no splat beyond z_k: there footprints are
    attenuated, and the matter behind them contributes.
    """
    if splats.post is not None:
        return splats
    cells = _cells(splats)
    shape = cells.max(axis=0) + 1 if len(splats) else np.zeros(3, np.int64)
    if not 0 < np.prod(shape, dtype=np.float64) <= CELLS:
        return splats
    depth = np.zeros(shape, np.float32)
    depth[tuple(cells.T)] = splats.records["optical_depth"]

    # hidden by any number of layers, up to LAYERS, each dense enough
    hidden = np.zeros(shape, bool)
    for layer in range(1, LAYERS + 1):
        for axis in range(3):
            depth = _least(depth, axis)
        hidden |= depth >= HIDING / layer
        if not (depth >= HIDING / LAYERS).any():
            break
    keep = ~hidden[tuple(cells.T)]
    if keep.mean() > 1.0 - WORTH:
        return splats

    return splats.part(keep, among_all=True)


def outside(splats: Splats, eye: np.ndarray) -> bool:
    """Whether an eye position, world, is outside of the splats' box."""
    low, high = splats.index_bounds
    place = splats.grid.index_from_world(eye)
    return bool((place < low).any() or (place > high).any())


def _cells(splats: Splats) -> np.ndarray:
    """Cell indices relative to the lowest."""
    cells = splats.cells.astype(np.int64)
    return np.asarray(cells - cells.min(axis=0)) if len(cells) else cells


def _least(array: np.ndarray, axis: int) -> np.ndarray:
    """Minimum of each value and its two neighbours along an axis; 0 at the ends."""
    across = np.moveaxis(array, axis, 0)
    least = np.zeros_like(across)
    np.minimum(np.minimum(across[:-2], across[1:-1]), across[2:], out=least[1:-1])
    return np.moveaxis(least, 0, axis)

"""Culls splats that other matter hides from every side, for any view."""

from __future__ import annotations

import numpy as np

from splatgl.splat.extraction.kept import LatestParts
from splatgl.splat.extraction.splats import Splats
from splatgl.splat.plan.resolve import Resolved

# a splat is hidden behind layers of cells, at most LAYERS in every direction, of this total optical depth:
# e^−6.2 = 0.002 of its light is transmitted, half of the tolerance below which nothing is culled
LAYERS, HIDING, FAITHFUL = 4, 6.2, 1 / 256
# maximum number of cells, since the whole box is processed
CELLS = 1 << 27
# minimum fraction of culled splats that justifies a copy
WORTH = 0.3
# boxes of labels are hidden behind a total optical depth of which 6e−6 of the light passes; of fewer all are drawn
OPAQUE, FEW = 12.0, 1 << 14
# cache: what is exposed of the latest splats
_latest = LatestParts()


def skinned(splats: Splats) -> Splats:
    """The splats without those hidden from every side; the same object if hardly any are, or if they are classified
    after reconstruction.

    Valid for composite images from outside of the splats' box with no splat beyond z_k: there footprints are
    attenuated, and the matter behind them contributes.
    """
    if splats.post is not None or not len(splats):
        return splats
    keep = _seen(splats, HIDING)
    if keep.mean() > 1.0 - WORTH:
        return splats
    return splats.part(keep, among_all=True)


def exposed(splats: Splats, resolved: Resolved) -> Splats:
    """Boxes of labels that a picture may show, without those that others hide from every side, if it is seen from
    outside of all and nothing is cut; of other splats all. Caches the latest result.
    """
    blended = not resolved.boxes or not resolved.look.blend.ordered or resolved.clip is not None
    if blended or len(splats) < FEW:
        return splats
    camera, (low, high) = resolved.camera, splats.index_bounds + np.array([[-0.5], [0.5]])
    place = splats.grid.index_from_world(camera.eye)
    if camera.perspective:
        if not ((place < low).any() or (place > high).any()):
            return splats
    elif camera.eye_from_points(splats.corners)[:, 2].min() < 0:
        return splats

    def keeps() -> np.ndarray:
        keep = _seen(splats, OPAQUE * splats.grid.mean_spacing / splats.grid.smallest_spacing)
        return keep if keep.mean() <= 1.0 - WORTH else np.ones(len(splats), bool)

    return _latest.of(splats, OPAQUE, keeps)


def _seen(splats: Splats, hiding: float) -> np.ndarray:
    """bool [N]: which splats are not behind layers of cells of that total depth, a mean spacing each, on every side."""
    cells = _cells(splats)
    shape = cells.max(axis=0) + 1 if len(splats) else np.zeros(3, np.int64)
    if not 0 < np.prod(shape, dtype=np.float64) <= CELLS:
        return np.ones(len(splats), bool)
    depth = np.zeros(shape, np.float32)
    depth[tuple(cells.T)] = splats.records["optical_depth"]

    # hidden by any number of layers, up to LAYERS, each dense enough
    hidden = np.zeros(shape, bool)
    for layer in range(1, LAYERS + 1):
        for axis in range(3):
            depth = _least(depth, axis)
        hidden |= depth >= hiding / layer
        if not (depth >= hiding / LAYERS).any():
            break
    return ~hidden[tuple(cells.T)]


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

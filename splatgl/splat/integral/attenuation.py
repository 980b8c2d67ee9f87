"""Attenuation beyond z_k by the share of its pixel that a splat's matter fills.

A pixel wider than a voxel shows an average over sub-pixel columns. Weakening opacity by 1/m² suits
isolated matter, weakening optical depth suits matter that fills its pixel; with both, matter behind
opaque matter widens it. The runs of occupied cells around a splat give the required quantities:

* column T = τ · the length of the ray in its run of matter; its opacity is A = 1 − e^(−T).
* A lone voxel's footprint hides more than its face, since the exponential saturates: by a rim of
  T/√(41 + 1.1 T²) voxels, within 7 % of ∫(1 − e^(−T F)) for T up to 16. So hidden = A Π(1 + rim/run).
* A run fills the share 1/m if it is one cell, 1 if it is long against the pixel; the product over the
  two most filled axes is the pixel's fill φ. For one cell it falls by 2 (m − 1)/m¹⁶ faster at first:
  up to z_k a cell is drawn as sharp as its kernel, already more than its pixel's average.
* The column's depth becomes T (hidden/T)^(1−φ): T for a filled pixel (φ = 1), `hidden` for φ = 0,
  and T again for m → 1. It is at most 5.5, an opacity of 1 − 1/245: more would only darken the
  neighbouring pixels that its stretched footprint touches.

The constants are fits to supersampled pictures; scripts/attenuation.py prints their errors.
"""

from __future__ import annotations

import numpy as np

from splatgl.splat.extraction.run_lengths import OCTAVES

# optical depth at which a column is opaque in 8 bits
LARGEST_DEPTH = 5.5
# rim(T) = T/√(RIM_START + RIM_GROWTH T²), voxels
RIM_START, RIM_GROWTH = 41.0, 1.1
# a lone cell's share of its pixel falls as 1/m − ONSET (m − 1)/m^ONSET_POWER
ONSET, ONSET_POWER = 2.0, 16
# rays with a smaller component along an axis count as perpendicular to it
GRAZING = 1e-3


def filled_depth(
    depth: np.ndarray, along: np.ndarray, widths: np.ndarray, pixel: np.ndarray, coverage: np.ndarray, runs: np.ndarray
) -> np.ndarray:
    """Optical depth per mean spacing [N] that replaces `depth` where a pixel is wider than a voxel.

    along [3, N]: the ray's unit vector in index steps per mean spacing; widths [3]: lengths of the grid's
    steps; pixel [N]: a pixel's side at the voxel, both in mean spacings; coverage [N]: 1/m²; runs: coded.
    """
    run = run_lengths(runs)
    m = np.maximum(pixel / widths[:, None], 1.0)
    layers = (run / np.maximum(np.abs(along), GRAZING)).min(axis=0)
    column = depth * layers
    # filled share of the pixel
    alone = 1 / m - ONSET * (m - 1) / m**ONSET_POWER
    share = 1 - (1 - alone) / (1 + ((run - 1) / (m + 1)) ** 4)
    filled = share.prod(axis=0) / share.min(axis=0)
    # opacity of the column, rim included
    wider = 1 + column / np.sqrt(RIM_START + RIM_GROWTH * column**2) / run
    hidden = -np.expm1(-column) * wider.prod(axis=0) / wider.max(axis=0)
    ratio = np.minimum(hidden / np.where(column > 0, column, 1.0), 1.0)
    left = column * ratio ** (1 - filled)
    stretch = 1 / np.sqrt(coverage)
    left = np.minimum(left, LARGEST_DEPTH * stretch / np.maximum(stretch - 1, 1e-6))
    return np.where(coverage < 1, left / layers, depth)


def run_lengths(runs: np.ndarray) -> np.ndarray:
    """Run lengths of matter [3, N] along the grid's axes, in voxels, from their codes [N]."""
    return np.asarray(np.exp2(np.stack([runs >> bits & 31 for bits in (0, 5, 10)]) * OCTAVES))


def run_along(direction: np.ndarray, runs: np.ndarray) -> np.ndarray:
    """Run length [N] of matter along directions [3, N] in index axes, of any length, in voxels."""
    along = np.abs(direction) / np.maximum(np.sqrt((direction * direction).sum(axis=0)), 1e-300)
    return np.asarray((run_lengths(runs) / np.maximum(along, GRAZING)).min(axis=0))

"""X-ray sums: the sum of all splats of one layer of a constant volume on a ray.  [M98 §4]"""

from __future__ import annotations

import numpy as np

from splatgl.splat.footprint import Splat
from splatgl.splat.kernels import Kernel
from splatgl.truth.figures.worst import Form

# positions of the ray within a voxel, along each axis
PHASES = 8
# summation distance from the ray, over m · radius · the slant
REACH = 1.1


def layer_sums(form: Form, kernel: Kernel, z_k: float, depth: float, angle: float) -> np.ndarray:
    """[PHASES²]: the sums on rays at `angle` degrees through a layer of voxels at `depth`, of unit extinction,
    over the ray's path length through it: 1 is right. The kernel's ripple shows as their spread.
    """
    slope = np.tan(np.radians(angle))
    reach = REACH * kernel.radius * max(depth / z_k, 1.0) / np.cos(np.radians(angle)) + 1
    # voxels at every 1/PHASES: each phase's lattice is one of PHASES² subsets
    offsets = np.arange(-np.ceil(reach) * PHASES, np.ceil(reach) * PHASES) / PHASES
    x, y = np.meshgrid(offsets, slope * depth + offsets)
    voxel = np.stack([x, y, np.full_like(x, depth)], axis=-1)
    value = form(Splat(kernel, voxel, np.array([0.0, slope]), z_k))
    cells = len(offsets) // PHASES
    sums = value.reshape(cells, PHASES, cells, PHASES).sum(axis=(0, 2))
    return np.asarray(sums.ravel() * np.cos(np.radians(angle)))

"""Means of pixels from k × k samples: the samples' mean and Euler–Maclaurin's end correction along each axis."""

from __future__ import annotations

import numpy as np

from splatgl.splat.resolve import END_CORRECTION


def pixel_means(samples: np.ndarray, k: int) -> np.ndarray:
    """float64 [H, W, C] of samples [H k, W k, C]; those beyond the picture's edges repeat the last.

    Along an axis (Σ f_j + (f_k − f_{k−1} − f_0 + f_{−1})/24)/k: all weights are positive, so that no mean is beyond the
    samples. Exact for cubics. Twin of `shaders/resolve.frag`.
    """
    for axis in (0, 1):
        rows = np.moveaxis(samples, axis, 0)
        inner = rows.reshape(-1, k, *rows.shape[1:])
        before = np.concatenate([inner[:1, 0], inner[:-1, -1]])
        after = np.concatenate([inner[1:, 0], inner[-1:, -1]])
        total = inner.sum(axis=1) + END_CORRECTION * (after - inner[:, -1] - inner[:, 0] + before)
        samples = np.moveaxis(total / k, 0, axis)
    return samples

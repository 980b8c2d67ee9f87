"""The record of a splat as the GPU reads it: classified before reconstruction, or after."""

from __future__ import annotations

import numpy as np

# 36 bytes a splat. position: (x, y, z) in grid indices. optical_depth: extinction × mean spacing.
# color: linear RGB. normal: unit world gradient as signed 16-bit fractions, zero where there is none.
# runs: see run_lengths.py; filled in on upload if the plan needs them.
RECORD = np.dtype(
    [
        ("position", "<f4", 3),
        ("optical_depth", "<f4"),
        ("color", "<f4", 3),
        ("normal", "<i2", 3),
        ("runs", "<i2"),
    ]
)
# classified after reconstruction. value: see PostClassified; gradient: of it per mean spacing, world axes
SAMPLE = np.dtype([("position", "<f4", 3), ("value", "<f4"), ("gradient", "<f4", 3), ("unused", "<i2", 4)])
GL_FORMAT = "3f4 1f4 3f4 3i2 1i2"
GL_ATTRIBUTES = ("in_position", "in_optical_depth", "in_color", "in_normal", "in_runs")
NORMAL_SCALE = 32767.0

"""Records of splats as the GPU reads them: of voxels on a grid, 24 bytes, or of points anywhere, 36."""

from __future__ import annotations

import numpy as np

# position: (x, y, z) in grid indices. color: linear RGB, of a voxel as 16-bit fractions. optical_depth: extinction ×
# mean spacing. normal: unit world gradient as signed 16-bit fractions, zero where there is none. runs: see
# run_lengths.py; filled in on upload if the plan needs them.
VOXEL = np.dtype(
    [("position", "<u2", 3), ("color", "<u2", 3), ("optical_depth", "<f4"), ("normal", "<i2", 3), ("runs", "<i2")]
)
POINT = np.dtype(
    [("position", "<f4", 3), ("optical_depth", "<f4"), ("color", "<f4", 3), ("normal", "<i2", 3), ("runs", "<i2")]
)
# classified after reconstruction. value: see PostClassified; gradient: of it per mean spacing, world axes
VALUE = np.dtype([("position", "<u2", 3), ("unused", "<u2"), ("value", "<f4"), ("gradient", "<f4", 3)])
POINT_VALUE = np.dtype([("position", "<f4", 3), ("value", "<f4"), ("gradient", "<f4", 3), ("unused", "<i2", 4)])
NORMAL_SCALE = 32767.0
COLOR_SCALE = 65535.0
# most voxels along an axis whose places fit 16 bits
MOST_ALONG = 2**16


def record_type(shape: tuple[int, ...], post: bool) -> np.dtype:
    """The narrowest record of a volume's voxels, classified after reconstruction if `post`."""
    if max(shape) <= MOST_ALONG:
        return VALUE if post else VOXEL
    return POINT_VALUE if post else POINT


def of_points(record: np.dtype) -> bool:
    """Whether the record's place may be anywhere."""
    return record in (POINT, POINT_VALUE)


def stored_color(color: np.ndarray, record: np.dtype) -> np.ndarray:
    """Linear RGB [..., 3] as that record holds it; of a voxel at most 1, and right to 7.6e-6."""
    if record == POINT:
        return np.asarray(color, np.float32)
    return np.rint(np.clip(color, 0, 1) * COLOR_SCALE).astype(np.uint16)


def color_scale(record: np.dtype) -> float:
    """What a record holds for a colour of 1."""
    return 1.0 if record == POINT else COLOR_SCALE


def linear_color(records: np.ndarray) -> np.ndarray:
    """Linear RGB [N, 3] of records, float32."""
    return np.asarray(records["color"] / np.float32(color_scale(records.dtype)))


def as_points(records: np.ndarray) -> np.ndarray:
    """A copy of records as those of points, whose places and colours may become any."""
    names = set(records.dtype.names or ())
    made = np.zeros(len(records), POINT_VALUE if "value" in names else POINT)
    for name in names - {"color", "unused"}:
        made[name] = records[name]
    if "color" in names:
        made["color"] = linear_color(records)
    return made


class Gathered:
    """Records of one part after another, in an array that grows where it lies: none is held twice."""

    def __init__(self, record: np.dtype) -> None:
        self.records = np.zeros(0, record)

    def add(self, part: np.ndarray) -> None:
        """Appends records; `records` that were taken before are no longer valid."""
        before = len(self.records)
        self.records.resize(before + len(part), refcheck=False)
        self.records[before:] = part

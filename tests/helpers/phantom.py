"""The phantom that the readers' tests write and read: a letter F in three different axes, on an oblique grid."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from splatgl.data.volume import Volume
from splatgl.readers.common import is_mapped

SPACING = (1.5, 2.25, 3.0)
ORIGIN = (10.0, -20.0, 30.5)


def letter_f() -> np.ndarray:
    """uint8 [4, 7, 5]: an F in (y, x), brighter with z, on a background that differs in every voxel."""
    z, y, x = np.indices((4, 7, 5))
    stroke = (x == 1) | ((y == 0) & (x > 0)) | ((y == 3) & (x > 0) & (x < 4))
    return np.where(stroke, 150 + 25 * z, z * 35 + y * 5 + x).astype(np.uint8)


def oblique() -> np.ndarray:
    """A rotation [3, 3] whose transpose is another one; its columns are the axes."""
    a, b = np.deg2rad(20), np.deg2rad(-35)
    about_z = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    about_x = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    return about_z @ about_x


F = letter_f()
Q = oblique()
SIZES = (5, 7, 4)
"""The phantom's voxels along x, y, z."""


def put(path: Path, *parts: str | bytes) -> Path:
    """Writes texts and bytes one behind the other."""
    path.write_bytes(b"".join(part.encode() if isinstance(part, str) else part for part in parts))
    return path


def check(volume: Volume, grid: bool, frame: str | None, mapped: bool, samples: np.ndarray = F) -> None:
    """The phantom, on its own grid or the plain one."""
    np.testing.assert_array_equal(volume.samples, samples)
    assert volume.frame == frame
    assert is_mapped(volume.samples) == mapped
    assert volume.name == "letter"
    np.testing.assert_allclose(volume.spacing, SPACING if grid else (1, 1, 1), rtol=1e-6)
    np.testing.assert_allclose(volume.origin, ORIGIN if grid else (0, 0, 0), rtol=1e-6)
    np.testing.assert_allclose(volume.direction, Q if grid else np.eye(3), atol=1e-6)

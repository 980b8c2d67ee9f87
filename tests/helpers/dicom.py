"""A series of DICOM slices."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.fuzz.seed_dicom import image, save

HU = np.random.default_rng(5).integers(-1000, 1500, (6, 9, 11)).astype(np.int16)


def written(folder: Path, array: np.ndarray = HU, step: float = 2.5, **tags: object) -> Path:
    """A folder of slices in a shuffled order of names."""
    folder.mkdir(parents=True, exist_ok=True)
    for n, plane in enumerate(array):
        save(image(plane, n * step, **tags), folder / f"{(n * 5 + 3) % len(array)}.dcm")
    return folder

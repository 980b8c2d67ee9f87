"""Draws a segmentation voxel by voxel, then as smooth surfaces: segmentation.py VOXELS.png SURFACES.png."""

from __future__ import annotations

import sys

import numpy as np

import splatgl as sg
from splatgl.data.volume import Label


def main(voxels: str, surfaces: str) -> None:
    """Two labels that share a border inside of a ball."""
    z, y, x = np.indices((32, 32, 32)) - 15.5
    labels = np.where(x * x + y * y + z * z < 150, 1 + (x > 3), 0).astype(np.uint8)
    names = (Label(1, "liver", "#b5654a"), Label(2, "tumour", "#f2d16b"))
    volume = sg.Volume(labels, labels=names)
    sg.render(volume, azimuth=30, size=(320, 320), background="white").save(voxels)
    sg.render(volume, surfaces=0.5, azimuth=30, size=(320, 320), background="white").save(surfaces)


if __name__ == "__main__":
    main(*sys.argv[1:3])

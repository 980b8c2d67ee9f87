"""Draws a volume with surfaces, balls and tubes in it: mesh.py PNG."""

from __future__ import annotations

import sys

import numpy as np

import splatgl as sg


def main(target: str) -> None:
    """A path through a faint ball, with a mark at each end; sg.load_mesh reads PLY, STL, VTP, … from files."""
    t = np.linspace(0, 4 * np.pi, 80)
    path = np.stack([9 * np.cos(t), 9 * np.sin(t), np.linspace(-14, 14, 80)], axis=1)
    volume = sg.scenes.ball(20)
    path += volume.center
    tube = sg.Mesh.of_lines([path], radius=0.5, color="#4682b4")
    ends = sg.Mesh.of_points(path[[0, -1]], radius=1.5, color="#d04020")
    image = sg.render(volume, points=[(0, 0), (1, 0.03)], meshes=[tube, ends], size=(320, 320), background="white")
    image.save(target)


if __name__ == "__main__":
    main(sys.argv[1])

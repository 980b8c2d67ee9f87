"""Splats without a grid: particles of any place, colour and density: points.py PNG."""

from __future__ import annotations

import sys

import numpy as np

import splatgl as sg


def main(target: str) -> None:
    """A spiral of coloured particles before white."""
    t = np.linspace(0, 6 * np.pi, 2000)
    points = np.stack([np.cos(t) * t, np.sin(t) * t, 2 * t], axis=1)
    colors = np.stack([t / t.max(), 0.3 + 0 * t, 1 - t / t.max()], axis=1)
    splats = sg.Splats.from_points(points, colors, np.full(len(t), 0.8), spacing=1.0)
    camera = sg.Camera.look_at((60, -50, 45), (0, 0, 18), (0, 0, 1), fov=40, size=(400, 400))
    with sg.Renderer() as renderer:
        renderer.render(splats, camera, sg.Settings(background=(1, 1, 1))).save(target)


if __name__ == "__main__":
    main(sys.argv[1])

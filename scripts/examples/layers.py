"""Draws two volumes in one picture, each with its own transfer function: layers.py PNG."""

from __future__ import annotations

import sys

import splatgl as sg


def main(target: str) -> None:
    """A faint ball around a dense one, on white."""
    shell, core = sg.scenes.ball(24), sg.scenes.ball(12)
    faint = sg.Transfer(points=[(0, 0.0), (1, 0.02)], colormap="bone")
    dense = sg.Transfer(points=[(0.4, 0.0), (0.8, 0.6)], colormap="hot")
    scene = sg.Scene([sg.Layer(shell, faint), sg.Layer(core, dense)])
    camera = sg.Camera.orbit(scene, azimuth=30, elevation=20, size=(320, 320))
    with sg.Renderer() as renderer:
        renderer.render(scene, camera, sg.Settings(background=(1, 1, 1))).save(target)


if __name__ == "__main__":
    main(sys.argv[1])

"""What a setting changes: the paper's practical splats next to the exact ones: compare_settings.py PNG."""

from __future__ import annotations

import sys

import splatgl as sg


def main(target: str) -> None:
    """Draws both, measures the paper's, and saves it."""
    volume = sg.scenes.ball(24)
    splats, camera = sg.extract(volume, sg.default_transfer(volume)), sg.Camera.orbit(volume, size=(256, 256))
    with sg.Renderer() as renderer:
        exact = renderer.render(splats, camera)
        paper = renderer.render(splats, camera, sg.Settings.paper())
    print(sg.compare(paper, exact))
    paper.save(target)


if __name__ == "__main__":
    main(sys.argv[1])

"""Draws the README's pictures into scripts/pictures: run it again after a change that shows.

.venv/bin/python scripts/pictures.py
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from PIL import Image as Pillow

import splatgl as sg
from splatgl.app.scene import Scene, View

FOLDER = Path(__file__).parent / "pictures"
SIZE = (400, 400)
# of the viewer's window; a palette keeps its picture small
WINDOW, COLORS = (860, 560), 128
# linear light of the page behind the pictures
PAPER = (1.0, 1.0, 1.0)
BLACK = (0.0, 0.0, 0.0)


def draw(renderer: sg.Renderer, name: str, settings: sg.Settings, size: tuple[int, int] = SIZE) -> np.ndarray:
    """float32 [H, W, 4] of a built-in scene from its own view."""
    scene = Scene(name, view=View(size=size), settings=settings)
    volume = scene.open()
    splats = sg.extract(volume, scene.transfer_for(volume))
    return renderer.render(splats, scene.view.camera(volume, splats), settings).pixels


def beside(*pictures: np.ndarray, gap: int = 6) -> sg.Image:
    """Pictures of one height in a row on white."""
    space = np.ones((pictures[0].shape[0], gap, 4), np.float32)
    parts = [part for picture in pictures for part in (picture, space)]
    return sg.Image(np.concatenate(parts[:-1], axis=1)).over(PAPER)


def window(source: str) -> None:
    """The viewer with its panel, as its window shows a volume or a scene once the picture is refined."""
    from splatgl.app.viewer.content import Content
    from splatgl.app.viewer.viewer import Options, Viewer

    scene = Scene.from_toml(Path(source)) if source.endswith(".toml") else Scene(source)
    with sg.Renderer("window") as renderer:
        viewer = Viewer(Content.open(scene), renderer, Options(size=WINDOW))
        try:
            # a few frames more than it needs, for the panel
            while viewer.painter.frame is None or not viewer.painter.frame.full:
                viewer.step()
            for _ in range(10):
                viewer.refresh()
                viewer.step(0.0)
            shown = viewer.shot()
        finally:
            viewer.close()
    Pillow.fromarray(shown).quantize(COLORS).save(FOLDER / "window.png", optimize=True)


def main() -> None:
    if sys.argv[1:2] == ["window"]:
        window(sys.argv[2] if len(sys.argv) > 2 else "nerve")
        return
    with sg.Renderer() as renderer:
        scenes = [
            draw(renderer, "tunnel", sg.Settings(background=BLACK)),
            draw(renderer, "terrain", sg.Settings(background=PAPER)),
            draw(renderer, "nerve", sg.Settings(background=BLACK)),
        ]
        beside(*scenes).save(FOLDER / "scenes.png")
        # the paper's Fig. 5 at a size at which z_k lies inside the tunnel
        small = (160, 160)
        kinds = [draw(renderer, "tunnel", sg.Settings(antialias=a, background=BLACK), small) for a in ("off", "paper")]
        beside(*(np.kron(kind, np.ones((3, 3, 1), np.float32)) for kind in kinds)).save(FOLDER / "antialiasing.png")


if __name__ == "__main__":
    main()

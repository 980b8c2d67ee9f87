"""Renders the images of the README files into scripts/pictures; rerun after a visible change.

.venv/bin/python scripts/pictures.py                  # the scenes
.venv/bin/python scripts/pictures.py gallery visible_male_128x256x256_uint8.raw neuron.tif stent.nrrd  # real data
.venv/bin/python scripts/pictures.py classification visible_male_128x256x256_uint8.raw
.venv/bin/python scripts/pictures.py side-by-side     # real volumes, by VTK as well: for minutes
.venv/bin/python scripts/pictures.py side-by-side "head, MRI"  # one of them, larger
.venv/bin/python scripts/pictures.py window head.nii  # the viewer's window
.venv/bin/python scripts/pictures.py report nerve     # error against run time, with VTK if it is there; for minutes
.venv/bin/python scripts/pictures.py tables           # of methods in splatgl/reference/README.md, of techniques in gl's
"""

from __future__ import annotations

import re
import sys
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from benchmarks.side_by_side import side_by_side
from PIL import Image as Pillow
from splatgl.studies.accuracy.document import CONVERGENCE, registry

import splatgl as sg
from splatgl.cli.main import main as command
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.view import ViewOptions
from splatgl.splat.technique import TECHNIQUES, combinations
from splatgl.studies.tables import Table

FOLDER = Path(__file__).parent / "pictures"
TRUTH = Path(__file__).parents[1] / "splatgl" / "reference" / "README.md"
GL = Path(__file__).parents[1] / "splatgl" / "gl" / "README.md"
# patterns of the tables that `tables` writes
REFUSED = r"(?m)^\| setting \| tiles .*\n(\|.*\n)*"
METHODS = r"(?s)<details><summary>all \d+ methods, by what is varied</summary>.*?</details>"
SIZE = (400, 400)
# size of the viewer's window; a palette keeps its image small
WINDOW, COLORS = (1240, 640), 128
# options of the gallery: CT of the Visible Male (z runs downwards), a neuron, CT of a stent
SKULL = "--preset ct-bone --spacing 1.57774,0.995861,1.00797 --up 0,0,-1 --azimuth 40 --elevation -5 --zoom 1.05"
NEURON = "--zoom 1.2"
STENT = "--points 0.2:0,0.35:0.6 --azimuth 0 --zoom 1.05"
# page background, linear light
PAPER = (1.0, 1.0, 1.0)
BLACK = (0.0, 0.0, 0.0)


def draw(renderer: sg.Renderer, name: str, settings: sg.Settings, size: tuple[int, int] = SIZE) -> np.ndarray:
    """float32 [H, W, 4] of a built-in scene with its default view."""
    scene = SceneFile(name, view=ViewOptions(size=size), settings=settings)
    volume = scene.open()
    splats = sg.extract(volume, scene.transfer_for(volume))
    return renderer.render(splats, scene.view.camera(volume, splats), settings).pixels


def beside(*pictures: np.ndarray, gap: int = 6) -> sg.Image:
    """Images of one height in a row on white."""
    space = np.ones((pictures[0].shape[0], gap, 4), np.float32)
    parts = [part for picture in pictures for part in (picture, space)]
    return sg.Image(np.concatenate(parts[:-1], axis=1)).over(PAPER)


def rendered(*jobs: tuple[str, str]) -> Pillow.Image:
    """Volumes side by side on black, as `splatgl render` draws them; jobs: sources and options."""
    common = "--size 400 --background black --quiet"
    pictures = []
    with TemporaryDirectory() as folder:
        drawn = f"{folder}/drawn.png"
        for source, options in jobs:
            if command(["render", source, "-o", drawn, *options.split(), *common.split()]):
                sys.exit("no picture")
            pictures.append(np.asarray(Pillow.open(drawn).convert("RGB")))
    return Pillow.fromarray(np.concatenate(pictures, axis=1)).quantize(COLORS)


def gallery(*sources: str) -> None:
    """A skull, a neuron and a stent, classified after reconstruction."""
    rendered(*zip(sources, (SKULL, NEURON, STENT), strict=True)).save(FOLDER / "gallery.png", optimize=True)


def classification(skull: str) -> None:
    """A skull classified before reconstruction, and after."""
    rendered((skull, f"{SKULL} --classification pre"), (skull, SKULL)).save(
        FOLDER / "classification.png", optimize=True
    )


def window(source: str) -> None:
    """The viewer with its panel and slices, showing a volume or a scene at full quality."""
    from splatgl.viewer.document import Document
    from splatgl.viewer.viewer import Options, Viewer

    scene = SceneFile.from_toml(Path(source)) if source.endswith(".toml") else SceneFile(source)
    with sg.Renderer("window") as renderer:
        viewer = Viewer(Document.open(scene), renderer, Options(size=WINDOW))
        try:
            # with slices beside it, and a few extra frames for the panel
            viewer.hands.key("z")
            viewer.step()
            while viewer.painter.frame is None or not viewer.painter.frame.full or viewer.busy:
                viewer.step()
            for _ in range(10):
                viewer.refresh()
                viewer.step(0.0)
            shown = viewer.shot()
        finally:
            viewer.close()
    Pillow.fromarray(shown).quantize(COLORS).save(FOLDER / "window.png", optimize=True)


def report(source: str) -> None:
    """The diagram of error against run time of `splatgl report --full`, with fewer colours."""
    from splatgl.cli.main import main as splatgl

    peers = ["--peers"] if find_spec("vtk") else []
    with TemporaryDirectory() as folder:
        if splatgl(["report", source, "--full", *peers, "-o", folder]):
            sys.exit("no report")
        (drawn,) = (path for path in Path(folder).glob("*.png") if path.stem != CONVERGENCE)
        Pillow.open(drawn).convert("RGB").quantize(COLORS).save(FOLDER / "report.png", optimize=True)


def tables() -> None:
    """The table of methods, from their registry, and of the settings that techniques do not support."""
    refused = Table(("setting", *TECHNIQUES), tuple(combinations())).markdown()
    for path, pattern, table in ((TRUTH, METHODS, registry().markdown()), (GL, REFUSED, refused + "\n")):
        text = path.read_text(encoding="utf-8")
        path.write_text(re.sub(pattern, lambda _, table=table: table, text), encoding="utf-8")


def main() -> None:
    asked = {"window": window, "report": report, "classification": classification}
    if sys.argv[1:2] == ["gallery"]:
        gallery(*sys.argv[2:])
        return
    if sys.argv[1:2] == ["side-by-side"]:
        side_by_side(FOLDER / ("first.png" if len(sys.argv) == 3 else "side_by_side.png"), *sys.argv[2:])
        return
    if sys.argv[1:2] == ["tables"]:
        tables()
        return
    if sys.argv[1:2] and sys.argv[1] in asked:
        asked[sys.argv[1]](sys.argv[2] if len(sys.argv) > 2 else "nerve")
        return
    with sg.Renderer() as renderer:
        scenes = [
            draw(renderer, "tunnel", sg.Settings(background=BLACK)),
            draw(renderer, "terrain", sg.Settings(background=PAPER)),
            draw(renderer, "nerve", sg.Settings(background=BLACK)),
        ]
        beside(*scenes).save(FOLDER / "scenes.png")
        # the paper's Fig. 5 at a size for which z_k lies inside the tunnel
        small = (160, 160)
        old = sg.Settings.like("0.1", background=BLACK)
        kinds = [draw(renderer, "tunnel", old.but(antialias=each), small) for each in ("off", "paper")]
        beside(*(np.kron(kind, np.ones((3, 3, 1), np.float32)) for kind in kinds)).save(FOLDER / "antialiasing.png")
    # Fig. 13: a rotating landscape
    command(["figure", "13", "-o", str(FOLDER / "spinning.png")])


if __name__ == "__main__":
    main()

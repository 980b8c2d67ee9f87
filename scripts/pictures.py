"""Draws the pictures of the README and the guide into splatgl/docs/pictures; rerun after a visible change and look.

    .venv/bin/python scripts/pictures.py NAME…            # no name: those that need no file: BUILT_IN
    .venv/bin/python scripts/pictures.py side-by-side "head, MRI"   # one of its volumes, larger: first.png

Names: FUNCTIONS below. `front`, `classification`, `presets`, `light`, `iso`, `publishing`, `slices`, `side-by-side` and
`window` need public volumes (their sources: splatgl/docs/gallery.md) in the folder SPLATGL_DATA. `side-by-side` and
`report` take minutes, and draw with VTK if it is installed. scripts/gallery draws the gallery.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from benchmarks.side_by_side import side_by_side
from paper.__main__ import main as draw_figure
from PIL import Image as Pillow

import splatgl as sg
from splatgl.cli.main import main as command
from splatgl.scene.scene_file import SceneFile

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "splatgl" / "docs" / "pictures"
DATA = Path(os.environ.get("SPLATGL_DATA", ROOT.parent / "shared" / "data"))
SIZE = (400, 400)
# size of the viewer's window; a palette keeps its image small
WINDOW, COLORS = (1240, 640), 128
MALE = DATA / "visible_male_128x256x256_uint8.raw"
# CT of the Visible Male: spacing of its slices; z runs downwards
UPRIGHT = "--spacing 1.57774,0.995861,1.00797 --up 0,0,-1 --azimuth 40 --elevation -5 --fit visible"
SKULL = f"{MALE} --preset ct-bone {UPRIGHT}"
# page background, linear light
PAPER = (1.0, 1.0, 1.0)


def beside(*pictures: np.ndarray, gap: int = 6) -> sg.Image:
    """Images of one height in a row on white."""
    space = np.ones((pictures[0].shape[0], gap, 4), np.float32)
    parts = [part for picture in pictures for part in (picture, space)]
    return sg.Image(np.concatenate(parts[:-1], axis=1)).over(PAPER)


def save(picture: Pillow.Image, name: str, colors: int = COLORS) -> None:
    """Saves a picture of the guide with a palette, which keeps it small."""
    picture.quantize(colors).save(FOLDER / f"{name}.png", optimize=True)


def rendered(name: str, *lines: str, size: str = "400", colors: int = COLORS) -> None:
    """Saves pictures in a row on black, each by the arguments of `splatgl render`."""
    pictures = []
    with TemporaryDirectory() as folder:
        for line in lines:
            drawn = f"{folder}/drawn.png"
            options = ["--size", size, "--background", "black", "--check", "0", "--quiet", "-o", drawn]
            if command(["render", *shlex.split(line), *options]):
                sys.exit(f"{name}: no picture")
            pictures.append(np.asarray(Pillow.open(drawn).convert("RGB")))
    row = Pillow.fromarray(np.concatenate(pictures, axis=1))
    row.quantize(colors, dither=Pillow.Dither.FLOYDSTEINBERG).save(FOLDER / f"{name}.png", optimize=True)


def front() -> None:
    """Picture of the front page: a skull, a neuron, a stent, and a head that is cut open."""
    rendered(
        "front",
        f"{SKULL} --light matte --ambient-occlusion 0.9",
        f"{DATA}/neuron_a_409x415x119.tif --azimuth 0 --elevation 0 --fit visible"
        " --colormap '0:#102040,0.3:#1fa0c0,0.7:#7fffd0,1:#ffffff'",
        f"{DATA}/stent_ct_128x128x256.nrrd --points 0.2:0,0.35:0.6 --azimuth 0 --light glossy --fit visible",
        f"{DATA}/head_mri_160x232x160.nii.gz --clip 'z<0.62' --elevation 35 --azimuth 30 --light matte"
        " --ambient-occlusion 0.7 --fit visible",
        size="400x480",
        colors=255,
    )


def classification() -> None:
    """A skull classified before reconstruction, and after."""
    rendered("classification", f"{SKULL} --classification pre", SKULL)


def light() -> None:
    """A skull with the light at the eye, with a matte light, and with ambient occlusion and shadows."""
    rendered("light", SKULL, f"{SKULL} --light matte", f"{SKULL} --light matte --ambient-occlusion 0.9 --shadows 0.7")


def slices() -> None:
    """Axial slices of a head on a sheet, and planes in space where it is cut open."""
    head = f"{DATA}/head_mri_160x232x160.nii.gz"
    rendered(
        "slices",
        f"{head} --slice axial=20%:90%:8%",
        f"{head} --slice-plane axial=55% --clip 'z<0.55' --elevation 35 --light matte",
        f"{head} --slice-plane sagittal=55% --slice-plane=-309,23,477:0,0.5,0.87 --points 0:0,1:0 --window 0,500"
        " --azimuth 60 --zoom 1.2",
        colors=255,
    )


def iso() -> None:
    """A head's skin, half transparent, before its skull."""
    line = f"{MALE} {UPRIGHT} --iso 45:peachpuff:0.45 --iso 90:ivory --light matte"
    rendered("iso", line, size="480x400")


def presets() -> None:
    """Contact sheet of one volume by each preset."""
    with TemporaryDirectory() as folder:
        if command(["presets", f"{DATA}/tooth.nhdr", "-o", f"{folder}/sheet.png"]):
            sys.exit("presets: no picture")
        sheet = Pillow.open(f"{folder}/sheet.png").convert("RGB")
    save(sheet.resize((sheet.width // 2, sheet.height // 2), Pillow.Resampling.LANCZOS), "presets")


def scenes() -> None:
    """The built-in scenes of the paper."""
    beside(*(sg.render(name, size=SIZE).pixels for name in ("tunnel", "terrain", "nerve"))).save(FOLDER / "scenes.png")


def antialiasing() -> None:
    """The paper's Fig. 5 at a size for which z_k lies inside the tunnel, without antialiasing and with it."""
    old = {"like": "0.1", "size": 160, "background": "black"}
    kinds = [sg.render("tunnel", antialias=kind, **old).pixels for kind in ("off", "paper")]
    beside(*(np.kron(kind, np.ones((3, 3, 1), np.float32)) for kind in kinds)).save(FOLDER / "antialiasing.png")


def spinning() -> None:
    """Fig. 13: a rotating landscape."""
    draw_figure(["13", "-o", str(FOLDER / "spinning.png")])


def depth() -> None:
    """The terrain, and its depth map: near is bright."""
    terrain, view = sg.scenes.terrain(), {"azimuth": 30, "elevation": 40, "size": (400, 300)}
    picture = sg.render(terrain, background="white", **view)
    depths = sg.depth_map(terrain, **view)
    gray = 1 - 0.9 * (depths - np.nanmin(depths)) / np.ptp(depths[np.isfinite(depths)])
    pixels = np.repeat(np.nan_to_num(gray, nan=0.0)[..., None], 4, axis=2).astype(np.float32)
    pixels[..., 3] = 1
    beside(picture.pixels, pixels).save(FOLDER / "depth.png")


def publishing() -> None:
    """A neuron of the width of a column, at 100 dots an inch, with its scale bar."""
    volume = sg.Volume.of(sg.load(DATA / "neuron_a_409x415x119.tif").samples, spacing=(0.5, 0.5, 0.5), unit="um")
    view = {"width": "85mm", "dpi": 100, "size": (4, 3), "background": "black", "fit": "visible"}
    sg.render(volume, "microscopy", annotate="scale,title=Neuron", **view).save(FOLDER / "publishing.png")


def turn() -> None:
    """Frames of an orbit around the nerve."""
    view = {"elevation": 30, "zoom": 1.3, "size": (200, 200), "background": "black"}
    frames = [sg.render("nerve", azimuth=angle, **view).pixels for angle in range(0, 360, 60)]
    beside(*frames).save(FOLDER / "turn.png")


def compare() -> None:
    """The terrain, the same with a wrong rectangle and an offset, and their difference."""
    with TemporaryDirectory() as folder:
        new, old, diff = (f"{folder}/{name}.png" for name in ("new", "old", "diff"))
        image = sg.render("terrain", elevation=40, size=(320, 240), background="white")
        image.save(old)
        wrong = image.pixels.copy()
        wrong[80:140, 180:240] = wrong[80:140, 172:232]
        wrong[110:160, 80:140, :3] *= 0.7
        sg.Image(wrong, image.info).save(new)
        command(["compare", new, old, "--diff", diff, "--quiet"])
        pictures = [np.asarray(Pillow.open(name).convert("RGB").resize((320, 240))) for name in (old, new, diff)]
    save(Pillow.fromarray(np.concatenate(pictures, axis=1)), "compare")


def image_report() -> None:
    """The report of the guide's sample project, with one bar changed, in Chromium."""
    page = (ROOT / "splatgl" / "docs" / "image-regression.md").read_text(encoding="utf-8")
    with TemporaryDirectory() as folder:
        for name, text in re.findall(r"`([\w.]+)`:\n\n```python\n(.*?)```", page, re.DOTALL):
            (Path(folder) / name).write_text(text, encoding="utf-8")
        pytest = [sys.executable, "-m", "pytest", "-q"]
        subprocess.run([*pytest, "--splatgl-update"], cwd=folder, check=True)
        test = Path(folder) / "test_chart.py"
        test.write_text(test.read_text(encoding="utf-8").replace("5", "4"), encoding="utf-8")
        subprocess.run([*pytest, "--splatgl-report", "."], cwd=folder, check=False)
        browser = ["chromium", "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"]
        options = ["--window-size=1100,640", f"--user-data-dir={folder}/user", f"--screenshot={folder}/page.png"]
        subprocess.run([*browser, *options, f"file://{folder}/index.html"], check=True)
        save(Pillow.open(f"{folder}/page.png").convert("RGB"), "image_report")


def web_page() -> None:
    """The head by the default method, and its page in Chromium."""
    look = [str(MALE), "--spacing", "1.57774,0.995861,1.00797", "--up=0,0,-1", "--size", "480"]
    with TemporaryDirectory() as folder:
        for words in (["render", *look, "-o", f"{folder}/default.png"], ["export", *look, "-o", f"{folder}/page.html"]):
            if command([*words, "--quiet"]):
                sys.exit("no picture")
        browser = ["chromium", "--headless", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader"]
        browser += ["--enable-unsafe-swiftshader", "--hide-scrollbars", "--virtual-time-budget=60000"]
        options = ["--window-size=504,640", f"--user-data-dir={folder}/user"]
        shot = f"{folder}/shot.png"
        subprocess.run([*browser, *options, f"--screenshot={shot}", f"file://{folder}/page.html"], check=True)
        page = Pillow.open(shot).convert("RGB")
        joined = Pillow.new("RGB", (480 + page.width, page.height), "white")
        joined.paste(Pillow.open(f"{folder}/default.png").convert("RGB"), (0, 47))
        joined.paste(page, (480, 0))
        save(joined, "web_page")


# the window's scene: bones of the Visible Male
BONES = f"""volume = "{MALE}"
[load]
spacing = [1.57774, 0.995861, 1.00797]
[transfer]
preset = "ct-bone"
[camera]
up = [0, 0, -1]
azimuth = 110
elevation = 5
fit = "visible"
"""


def window(source: str = "") -> None:
    """The viewer with its panel and slices, showing a scene file or the bones of a CT at full quality."""
    from splatgl.viewer.document import Document
    from splatgl.viewer.viewer import Options, Viewer

    with TemporaryDirectory() as folder:
        file = Path(source or f"{folder}/bones.toml")
        if not source:
            file.write_text(BONES, encoding="utf-8")
        scene = SceneFile.from_toml(file)
    with sg.Renderer("window") as renderer:
        viewer = Viewer(Document.open(scene), renderer, Options(size=WINDOW))
        try:
            # with slices beside it, and a few extra frames for the panel
            viewer.key("z")
            viewer.step()
            while viewer.painter.frame is None or not viewer.painter.frame.full or viewer.busy:
                viewer.step()
            for _ in range(10):
                viewer.refresh()
                viewer.step(0.0)
            shown = viewer.shot()
        finally:
            viewer.close()
    save(Pillow.fromarray(shown), "window")


def report(source: str = "nerve") -> None:
    """The diagram of error against run time of `splatgl report --full`, with fewer colours."""
    with TemporaryDirectory() as folder:
        if command(["report", source, "--full", "-o", folder]):
            sys.exit("no report")
        (drawn,) = Path(folder).glob("*.png")
        save(Pillow.open(drawn).convert("RGB"), "report")


def compared(*names: str) -> None:
    """Real volumes by splats, VTK and their field; one of them alone is drawn larger."""
    side_by_side(FOLDER / ("first.png" if len(names) == 1 else "side_by_side.png"), *names)


BUILT_IN = (scenes, antialiasing, spinning, depth, turn, compare, image_report)
FUNCTIONS = {
    **{
        each.__name__: each
        for each in (*BUILT_IN, front, classification, light, iso, presets, publishing, slices, web_page)
    },
    "window": window,
    "report": report,
    "side-by-side": compared,
}


def main(arguments: list[str]) -> None:
    """Draws the named pictures; the last three names take arguments of their own."""
    if not arguments:
        for function in BUILT_IN:
            function()
    elif arguments[0] in ("window", "report", "side-by-side"):
        FUNCTIONS[arguments[0]](*arguments[1:])
    else:
        for name in arguments:
            if name not in FUNCTIONS:
                sys.exit(f"pictures: expected a name ({', '.join(FUNCTIONS)}), got {name}")
            FUNCTIONS[name]()


if __name__ == "__main__":
    main(sys.argv[1:])

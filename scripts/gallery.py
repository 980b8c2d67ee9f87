"""The gallery: each picture by the one command that is printed under it, and its table in splatgl/cli/README.md."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parent.parent
PICTURES, README = ROOT / "scripts/pictures/gallery", ROOT / "splatgl/cli/README.md"
DATA = "../shared/data"
HEADING = "## Gallery"
COLUMNS, SIDE = 3, 400
# bytes above which a picture is stored with a palette
HEAVY = 140_000


@dataclass(frozen=True)
class Picture:
    """name: of the file; about: what it shows; command: arguments of `splatgl`, without size and output."""

    name: str
    about: str
    command: str

    @property
    def line(self) -> str:
        """The command, to be run in the repository's folder."""
        return f"splatgl {self.command} --size {SIDE} -o {self.name}.png"

    @property
    def missing(self) -> str | None:
        """A file of data that it needs and that is not there."""
        files = [part.split(":")[0] for part in shlex.split(self.command) if DATA in part]
        return next((file for file in files if not (ROOT / file).exists()), None)


ASAMA = f"{DATA}/terrain_asama"
MALE = f"{DATA}/visible_male_128x256x256_uint8.raw"
GALLERY = (
    Picture(
        "bone",
        "CT, bone under a sky: ambient occlusion",
        f"render {MALE} --preset ct-bone --light flat --ambient-occlusion 1 --azimuth 40 --up 0,0,-1",
    ),
    Picture(
        "layers",
        "skin over bone: two layers",
        f"render {MALE} --points 60:0,120:0.03 --layer {MALE}:ct-bone --azimuth 40 --up 0,0,-1",
    ),
    Picture("mri", "MRI, cut open", f"render {DATA}/head_mri_160x232x160.nii.gz --clip 'z<0.62' --elevation 45"),
    Picture(
        "lung",
        "vessels and airways of a lung, with its box",
        f"render {DATA}/lung_ct_115x157x129.mha --preset ct-lung --annotate box,axes",
    ),
    Picture("stent", "CT of an aortic stent, matte light", f"render {DATA}/stent_ct_128x128x256.nrrd --light matte"),
    Picture(
        "neuron",
        "fluorescence, largest values, scale bar",
        f"render {DATA}/neuron_a_409x415x119.tif --blend mip --colormap hot --annotate scale",
    ),
    Picture(
        "xray",
        "a radiograph: attenuation grows with Hounsfield units",
        f"render {DATA}/lung_ct_115x157x129.mha --blend xray --points=-1000:0,1000:0.05 --colormap gray --azimuth 0",
    ),
    Picture(
        "terrain",
        "a height map under its satellite picture",
        f"render {ASAMA}/height_u16_256.png --color {ASAMA}/satellite_2048.jpg --elevation 40",
    ),
    Picture(
        "hurricane",
        "wind speed, with colour bar and time",
        f"render {DATA}/isabel/isabel_windspeed_t31.nrrd --colormap viridis --zoom 0.75"
        " --annotate 'colorbar,title=Isabel,time=hour 31'",
    ),
    Picture(
        "tooth",
        "a tooth, cut to its pulp, with its box",
        f"render {DATA}/tooth.nhdr --clip 'x+y>1' --light glossy --annotate box",
    ),
    Picture(
        "tunnel", "the checkerboard tunnel, antialiased", "render tunnel --antialias supersample --samples 4 --check 0"
    ),
    Picture(
        "flow",
        "blood in the carotid arteries: streamlines by speed",
        f"render {DATA}/carotid_76x49x45_scalar_and_velocity.vtk --streamlines 150"
        " --elevation 30 --zoom 1.2 --background black",
    ),
)


def main(names: list[str]) -> int:
    """Draws the pictures, all or those named, and writes the table; returns 0, or 1 if a command failed."""
    unknown = [name for name in names if name not in [each.name for each in GALLERY]]
    if unknown:
        known = ", ".join(each.name for each in GALLERY)
        print(f"gallery: expected names of pictures ({known}), got {unknown[0]}", file=sys.stderr)
        return 2
    PICTURES.mkdir(parents=True, exist_ok=True)
    failed = 0
    for each in GALLERY:
        if names and each.name not in names:
            continue
        if each.missing is not None:
            print(f"{each.name}: left out: {each.missing} is not there")
            continue
        print(each.line, flush=True)
        failed += not draw(each)
    write_table()
    return 1 if failed else 0


def draw(picture: Picture) -> bool:
    """Runs the printed command, but for its output's folder; whether it succeeded."""
    output = PICTURES / f"{picture.name}.png"
    arguments = shlex.split(picture.line)[1:-1]
    ended = subprocess.run(
        [sys.executable, "-m", "splatgl", *arguments, str(output), "--quiet"],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        check=False,
    )
    if ended.returncode:
        print(f"{picture.name}: failed with {ended.returncode}", file=sys.stderr)
        return False
    if output.stat().st_size > HEAVY:
        lighter = Image.open(output).convert("RGB").quantize(255, dither=Image.Dither.FLOYDSTEINBERG)
        lighter.save(output, optimize=True)
    return True


def table() -> str:
    """The table: a row of pictures, and a row of what they show and their commands."""
    rows = [GALLERY[n : n + COLUMNS] for n in range(0, len(GALLERY), COLUMNS)]
    lines = []
    for number, row in enumerate(rows):
        pictures = [f"![{each.about}](../../scripts/pictures/gallery/{each.name}.png)" for each in row]
        lines.append("| " + " | ".join(pictures) + " |")
        if number == 0:
            lines.append("|" + "---|" * COLUMNS)
        lines.append("| " + " | ".join(f"{each.about}<br>`{each.line}`" for each in row) + " |")
    return "\n".join(lines)


def write_table() -> None:
    """Replaces the gallery of the README."""
    text = README.read_text(encoding="utf-8")
    before, _, after = text.partition(f"{HEADING}\n")
    rest = after.partition("\n## ")[2]
    told = "`scripts/gallery` draws these by the commands under them, which run in the repository's folder."
    README.write_text(f"{before}{HEADING}\n\n{told}\n\n{table()}\n\n## {rest}", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

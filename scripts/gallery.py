"""The gallery: draws each picture by the one command that stands under it, and writes splatgl/docs/gallery.md.

The volumes are public; SPLATGL_DATA names their folder, ../shared/data by default. SOURCES says where they come from.
"""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "splatgl" / "docs"
PICTURES, PAGE = DOCS / "pictures" / "gallery", DOCS / "gallery.md"
DATA = Path(os.environ.get("SPLATGL_DATA", ROOT.parent / "shared" / "data"))
SIDE = 400
# bytes above which a picture is stored with a palette
HEAVY = 140_000
INTRODUCTION = """# Gallery

**Task: see what splatgl draws, and by which command.**

`scripts/gallery` draws these pictures and writes this page. The volumes are public; [their sources](#reference-sources)
are at the end. Each command runs in the folder of the volumes."""
SOURCES = {
    "visible_male_128x256x256_uint8.raw": "CT of a head: NLM Visible Human Project, from ipyvolume (MIT)",
    "head_mri_160x232x160.nii.gz": "T1 MRI of a head: Seg3D data, from neurolabusc/VolumeRenderingData (MIT)",
    "lung_ct_115x157x129.mha": "CT of a chest: tests of elastix (Apache-2.0)",
    "stent_ct_128x128x256.nrrd": "CT of an aortic stent graft: public domain, from three.js",
    "neuron_a_409x415x119.tif": "a neuron, fluorescence microscopy: tests of rivuletpy (BSD-3)",
    "terrain_asama": "heights and satellite picture of Mount Asama: data of vtk.js (BSD-3)",
    "isabel": "Hurricane Isabel, WRF: courtesy of NCAR and NSF, from the data of TTK",
    "tooth.nhdr": "CT of a tooth: Seg3D data (MIT)",
    "carotid_76x49x45_scalar_and_velocity.vtk": "carotid arteries, MRA and velocity: data of VTK (BSD)",
}
"""Public volumes by file or folder: what they are, where they come from, and their licence."""


@dataclass(frozen=True)
class Picture:
    """name: of the file; about: caption; command: arguments of `splatgl`, without size and output."""

    name: str
    about: str
    command: str

    @property
    def line(self) -> str:
        """The command as a user types it."""
        return f"splatgl {self.command} --size {SIDE} -o {self.name}.png"

    @property
    def missing(self) -> str | None:
        """A volume that it needs and that is not there."""
        return next((name for name in SOURCES if name in self.command and not (DATA / name).exists()), None)

    @property
    def section(self) -> str:
        """Section of the page."""
        picture = f"![{self.about}](pictures/gallery/{self.name}.png)"
        return f"## {self.about[0].upper()}{self.about[1:]}\n\n{picture}\n\n```sh\n{self.line}\n```"


ASAMA, MALE = "terrain_asama", "visible_male_128x256x256_uint8.raw"
GALLERY = (
    Picture(
        "bone",
        "CT, bone under a sky: ambient occlusion",
        f"render {MALE} --preset ct-bone --light flat --ambient-occlusion 1 --azimuth 40 --up 0,0,-1 --fit visible",
    ),
    Picture(
        "layers",
        "skin over bone: two layers",
        f"render {MALE} --points 60:0,120:0.03 --layer {MALE}:ct-bone --azimuth 40 --up 0,0,-1 --fit visible",
    ),
    Picture("mri", "MRI, cut open", "render head_mri_160x232x160.nii.gz --clip 'z<0.62' --elevation 45 --fit visible"),
    Picture(
        "lung",
        "vessels and airways of a lung, with its box",
        "render lung_ct_115x157x129.mha --preset ct-lung --annotate box,axes",
    ),
    Picture(
        "stent", "CT of an aortic stent, matte light", "render stent_ct_128x128x256.nrrd --light matte --fit visible"
    ),
    Picture(
        "neuron",
        "fluorescence, largest values, scale bar",
        "render neuron_a_409x415x119.tif --blend mip --colormap hot --annotate scale --fit visible",
    ),
    Picture(
        "xray",
        "a radiograph: attenuation grows with Hounsfield units",
        "render lung_ct_115x157x129.mha --blend xray --points=-1000:0,1000:0.05 --colormap gray --azimuth 0",
    ),
    Picture(
        "terrain",
        "a height map under its satellite picture",
        f"render {ASAMA}/height_u16_256.png --color {ASAMA}/satellite_2048.jpg --elevation 40",
    ),
    Picture(
        "hurricane",
        "wind speed, with colour bar and time",
        "render isabel/isabel_windspeed_t31.nrrd --colormap viridis --zoom 0.75"
        " --annotate 'colorbar,title=Isabel,time=hour 31'",
    ),
    Picture(
        "tooth",
        "a tooth, cut to its pulp, with its box",
        "render tooth.nhdr --clip 'x+y>1' --light glossy --annotate box",
    ),
    Picture(
        "tunnel", "the checkerboard tunnel, antialiased", "render tunnel --antialias supersample --samples 4 --check 0"
    ),
    Picture(
        "attenuated",
        "angiography, largest values weakened by those before them",
        "render carotid_76x49x45_scalar_and_velocity.vtk --blend attenuated-mip --mip-attenuation 0.3"
        " --curve ramp:130,300:1 --colors '120:#200008,200:#b01818,320:#ffb060,450:white'"
        " --elevation 30 --zoom 1.2 --background black",
    ),
    Picture(
        "flow",
        "blood in the carotid arteries: streamlines by speed",
        "render carotid_76x49x45_scalar_and_velocity.vtk --streamlines 150"
        " --elevation 30 --zoom 1.2 --background black",
    ),
)


# pages that turn, which the site's build exports, by file: arguments of `splatgl`, without the output
LIVE = {
    "nerve.html": f"export nerve --size {SIDE}",
    "terrain.html": f"export terrain --splats 150000 --size {SIDE}",
    "tunnel.html": f"export tunnel --splats 700000 --size {SIDE}",
}


def main(names: list[str]) -> int:
    """Draws the pictures, all or those named, and writes the page; returns 0, or 1 if a command failed."""
    unknown = [name for name in names if name not in [picture.name for picture in GALLERY]]
    if unknown:
        known = ", ".join(picture.name for picture in GALLERY)
        print(f"gallery: expected names of pictures ({known}), got {unknown[0]}", file=sys.stderr)
        return 2
    PICTURES.mkdir(parents=True, exist_ok=True)
    failed = 0
    for picture in GALLERY:
        if names and picture.name not in names:
            continue
        if picture.missing is not None:
            print(f"{picture.name}: left out: {picture.missing} is not in {DATA}")
            continue
        print(picture.line, flush=True)
        failed += not draw(picture)
    PAGE.write_text(page(), encoding="utf-8")
    return 1 if failed else 0


def draw(picture: Picture) -> bool:
    """Runs the command, with its output among the pictures; True if it succeeded."""
    output = PICTURES / f"{picture.name}.png"
    arguments = shlex.split(picture.line)[1:-1]
    ended = subprocess.run(
        [sys.executable, "-m", "splatgl", *arguments, str(output), "--quiet"],
        cwd=DATA if DATA.is_dir() else ROOT,
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


def page() -> str:
    """The page: a section for each picture, then the sources of the volumes."""
    rows = [f"| `{name}` | {about} |" for name, about in SOURCES.items()]
    sources = "\n".join(["## Reference: sources", "", "| volume | source and licence |", "|---|---|", *rows])
    return "\n\n".join([INTRODUCTION, *(picture.section for picture in GALLERY), live(), sources]) + "\n"


def live() -> str:
    """Section of the pages that turn; the site shows them where it says so."""
    lines = "\n".join(f"splatgl {command} -o {name}" for name, command in LIVE.items())
    about = "The site's build exports these [web pages](web-pages.md)."
    return f"## Pages that turn\n\n{about}\n\n<!-- pages -->\n\n```sh\n{lines}\n```"


def export_pages(folder: Path) -> None:
    """Writes the pages that turn into a folder. Raises CalledProcessError if a command fails."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, command in LIVE.items():
        words = [sys.executable, "-m", "splatgl", *shlex.split(command), "-o", name, "--quiet"]
        subprocess.run(words, cwd=folder, env={**os.environ, "PYTHONPATH": str(ROOT)}, check=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

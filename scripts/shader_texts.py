"""Writes the texts of all shaders as OpenGL gets them, for compilers and tools that need no OpenGL.

    scripts/shader_texts FOLDER [--shape card]

The programs are those of PICTURES: pictures of each kind with one or two changed settings. A file is named by its
shader, by the first picture that needs it, and by switches of its own; its ending is its stage: .vert, .frag or .comp.
texts.tsv lists file, stage, `#version` and switches.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import cache
from itertools import chain, combinations, product, takewhile
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np

import splatgl as sg
from splatgl.data.volume import Label
from splatgl.gl.program import Chosen, Programs
from splatgl.gl.shader import SHAPES, ComputeShape, compose, declared_switches
from splatgl.planning.plan import Plan, Program
from splatgl.splat.sheets import NearField

SIZE = (32, 24)
STAGES = {".vert": "vertex", ".frag": "fragment", ".comp": "compute"}


class Text(NamedTuple):
    """Composed text. name: of its file. shader: file in shaders/."""

    name: str
    shader: str
    source: str

    @property
    def stage(self) -> str:
        """Returns vertex, fragment or compute."""
        return STAGES[Path(self.shader).suffix]

    @property
    def version(self) -> int:
        """Returns the version of GLSL."""
        return int(self.source.split(maxsplit=2)[1])

    @property
    def switches(self) -> dict[str, str]:
        """Returns the value of each switch."""
        head = takewhile(lambda line: line.startswith("#"), self.source.splitlines())
        return dict(line.split(" ", 2)[1:] for line in head if line.startswith("#define "))


@dataclass(frozen=True)
class Picture:
    """Picture whose programs are composed. voxels: a name of `splats`. settings: of `sg.Settings`. near: whether the
    eye is in the volume; far: whether voxels are smaller than a pixel. moving: `moves` or `flows`.
    """

    voxels: str = "values"
    settings: tuple[tuple[str, Any], ...] = ()
    masked: bool = False
    long: bool = False
    weighted: bool = False
    iso: bool = False
    regions: bool = False
    parallel: bool = False
    near: bool = False
    far: bool = False
    moving: str = ""

    def changed(self, changes: Mapping[str, Any]) -> Picture:
        """Returns the picture with other fields; names that are no fields are settings."""
        fields = {name: value for name, value in changes.items() if name in self.__dataclass_fields__}
        settings = {name: value for name, value in changes.items() if name not in fields}
        return replace(self, settings=tuple({**dict(self.settings), **settings}.items()), **fields)


# changes of a picture that need other programs
BLENDS: dict[str, dict[str, Any]] = {
    blend: {"blend": blend} for blend in ("xray", "mip", "attenuated-mip", "minip", "mean")
}
LIGHTS: dict[str, dict[str, Any]] = {
    "unlit": {"shading": "off"},
    "glossy": {"light": "glossy"},
    "occluded": {"ambient_occlusion": 0.6},
    "shadows": {"shadows": 0.7},
    "cues": {"ambient_occlusion": 0.6, "shadows": 0.7},
}
VIEWS: dict[str, dict[str, Any]] = {
    "parallel": {"parallel": True},
    "near": {"near": True},
    "far": {"far": True, "antialias": "paper"},
    "long": {"long": True},
}
CLIP: dict[str, dict[str, Any]] = {"clip": {"clip": ((1.0, 0.3, 0.0, 2.0),)}}
KERNELS: dict[str, dict[str, Any]] = {
    "gaussian": {"kernel": "gaussian"},
    "crawfis": {"kernel": "crawfis-max"},
    "spline": {"kernel": "b-spline"},
    "fine": {"tolerance": 1e-3},
    "radial": {"table_size": 512},
}
SHEETS: dict[str, dict[str, Any]] = {f"sheets{n}": {"sheets": n} for n in (2, 3, 4)}
STEPS: dict[str, dict[str, Any]] = {f"steps{n}": {"steps": n} for n in (1, 3)}
PAPER: dict[str, dict[str, Any]] = {
    "table": {"footprint": "table"},
    **{align: {"align": align} for align in ("ray", "grid", "hybrid")},
    **{attenuation: {"attenuation": attenuation} for attenuation in ("opacity", "optical-depth")},
}
MOTIONS: dict[str, dict[str, Any]] = {
    **{motion: {"motion": motion} for motion in ("energy", "paper")},
    "flow": {"voxels": "points", "moving": "flows"},
}
# kinds of pictures, and the changes that are made to each, one or two at a time
ONE_BY_ONE = {"classification": "pre", "compositing": "splats"}
PICTURES: dict[str, tuple[Picture, dict[str, dict[str, Any]]]] = {
    "": (
        Picture(),
        BLENDS | LIGHTS | VIEWS | CLIP | KERNELS | SHEETS | STEPS
        | {"masked": {"masked": True}, "weighted": {"weighted": True}, "iso": {"iso": True}}
        | {"regions": {"regions": True}},
    ),
    "voxels": (Picture("voxels"), BLENDS | LIGHTS | VIEWS | CLIP | KERNELS | SHEETS),
    "splats": (Picture("voxels", tuple(ONE_BY_ONE.items())), BLENDS | LIGHTS | VIEWS | KERNELS | PAPER),
    "points": (Picture("points"), BLENDS | VIEWS | SHEETS | {"splats": {"compositing": "splats"}}),
    "labels": (Picture("labels"), BLENDS | LIGHTS | VIEWS | CLIP),
    "streaks": (
        Picture("voxels", (*ONE_BY_ONE.items(), ("motion", "exact")), moving="moves"),
        BLENDS | LIGHTS | VIEWS | KERNELS | PAPER | MOTIONS,
    ),
}  # fmt: skip

# switches by which programs of the screen differ: comparison and overlay
SCREENS = tuple(product(("none", "split", "difference"), (False, True)))
COUNTING: tuple[dict[str, bool], ...] = ({"COUNTING": True}, {"COUNTING": False})
# by shape, shaders that list splats by tile, with their switches; and those of them that sort splats by sheet
LISTING: dict[str, list[tuple[str, dict[str, bool]]]] = {
    "processor": [
        *product(("tile_list.comp", "sheet_sort.comp"), COUNTING),
        *(("sheet_sort.comp", {**counting, "CLUSTERED": True}) for counting in COUNTING),
    ],
    "card": [
        *product(("card_pairs.comp", "card_sort.comp"), COUNTING),
        ("card_sort.comp", {"COUNTING": False, "LAST": True}),
        *product(("card_scan.comp",), ({"PAIRS": True}, {"PAIRS": False})),
        *product(("card_lists.comp", "card_sheets.comp"), ({},)),
    ],
}
SORTING = {"sheet_sort.comp", "card_sheets.comp"}
# switches that are no part of a plan
OPTIONS = {
    *("COUNTING", "CARRIED", "LIMITED", "LAYERED", "ORDERED", "CULLED", "LAYERS", "SIDE", "OVERLAY", "NEAR"),
    *("PAIRS", "LAST", "PIECE", "SLOTTED", "CLUSTERED"),
}
# numbers of layers that are composited together
LAYERS = (2, 3, 4)


@cache
def volume(long: bool, masked: bool) -> sg.Volume:
    """Returns a ball in noise; its voxels may be long, and a mask may keep a part."""
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 8)] * 3, indexing="ij"))
    noise = 0.1 * np.random.default_rng(1).random((8, 8, 8))
    samples = np.float32(np.clip(1.3 - np.sqrt((grid**2).sum(axis=0)), 0, 1) + noise)
    ball = sg.Volume(samples, name="ball", spacing=(1.0, 1.0, 2.0 if long else 1.0))
    return ball.masked(samples > 0.5) if masked else ball


@cache
def splats(
    voxels: str, long: bool, masked: bool, weighted: bool, iso: bool = False, regions: bool = False
) -> sg.Splats:
    """Returns the splats of values, voxels, points or labels."""
    if voxels == "points":
        points = np.random.default_rng(2).random((50, 3)) * 8
        return sg.Splats.from_points(points, np.ones((50, 3)), np.full(50, 0.4), (1, 1, 2) if long else 1.0)
    if voxels == "labels":
        segments = np.zeros((8, 8, 8), np.uint8)
        segments[1:4], segments[5:7] = 1, 2
        named = (Label(1, "a", "#ff0000"), Label(2, "b", "#00ff00"))
        whole = sg.Volume(segments, name="segments", labels=named, spacing=(1.0, 1.0, 2.0 if long else 1.0))
        return sg.extract(whole, sg.default_transfer(whole))
    gradient = [(0.0, 0.2), (0.5, 1.0)] if weighted else []
    transfer = sg.Transfer([(0.35, 0.0), (1.0, 0.9)], colormap="bone", shading=True, gradient=gradient, iso=[0.6] * iso)
    if regions:
        transfer = replace(transfer, regions=["box:0.2,0.8,0.1,0.5"])
    how = "pre" if voxels == "voxels" else "auto"
    return sg.extract(volume(long, masked), transfer, classification=how)


def plan_of(picture: Picture) -> Plan:
    """Returns the plan of a picture. Raises InputError if its settings refuse each other."""
    drawn = splats(picture.voxels, picture.long, picture.masked, picture.weighted, picture.iso, picture.regions)
    camera = sg.Camera.orbit(volume(picture.long, False), 30, 20, size=SIZE, zoom=0.02 if picture.far else 1.0)
    if picture.near:
        camera = sg.Camera.look_at((4, 4, 4), (6, 5, 4.5), (0, 0, 1), 60, SIZE)
    if picture.parallel:
        camera = camera.parallel(volume(picture.long, False))
    motion = None
    if picture.moving:
        flow = np.ones((len(drawn), 3)) if picture.moving == "flows" else None
        motion = sg.Motion(spin=np.array([0, 0, 20]), flow=flow)
    return sg.plan(drawn, camera, sg.Settings(**dict(picture.settings)), motion, tiles=True)


class Recorder(Programs):
    """Programs that are composed and never compiled, as drawing asks for them."""

    def __init__(self, shape: ComputeShape) -> None:
        super().__init__(cast(Any, None), ExitStack(), shape)
        self.picture = ""
        # by shader and source: two pictures may need the same text
        self.texts: dict[tuple[str, str], Text] = {}
        self.programs: list[tuple[Text, ...]] = []
        self.names: dict[tuple[str, str], int] = {}

    def add(self, stages: tuple[str, ...], chosen: Chosen) -> None:
        """Composes the texts of a program's stages."""
        switches = dict(chosen)
        declared = frozenset().union(*map(declared_switches, stages))
        keys = []
        for shader in stages:
            source = compose(shader, switches, declared).source
            if (shader, source) not in self.texts:
                self.texts[shader, source] = Text(self._name(shader, switches), shader, source)
            keys.append((shader, source))
        self.programs.append(tuple(self.texts[key] for key in keys))

    def draw(self, picture: str, plan: Plan, most: int) -> None:
        """Composes the programs of a plan. most: number of options that are on together."""
        self.picture, program, sheets = picture, plan.program, plan.resolved.sheets
        near = NearField.of(plan.splats, plan.view, sheets) if sheets else None
        around = {"NEAR": True} if near else {}
        if near is not None:
            self.for_screen("near_field.frag", program, {"SIDE": 2 * near.around})
        if program.technique == "tiles":
            self._tiles(program, around, most)
            return
        # layers and meshes are drawn in the order of depth
        mixed = program.appearance.hides and (program.boxes or sheets is not None)
        for options in choices(("LIMITED", "SLOTTED") if mixed and program.boxes else (), most):
            self.for_splats(program, dict.fromkeys(options, True))
        for count in LAYERS * mixed:
            self.for_screen("layers_join.frag", program, {"LAYERS": count})
        if sheets is not None:
            for options in choices(("LIMITED", "PIECE") if mixed else (), most):
                self.for_screen("sheet_close.frag", program, {**dict.fromkeys(options, True), **around})
            if program.appearance.shows_value:
                self.for_screen("sheet_show.frag", program)

    def meshes(self) -> None:
        """Composes the programs of meshes."""
        self.picture = "meshes"
        for perspective, light, textured in product((True, False), repeat=3):
            self.for_meshes(perspective, light, textured)
        self.for_screen("surface_clear.frag")
        self.for_screen("surface_over.frag")
        self.for_screen("slots_clear.frag")

    def screen(self) -> None:
        """Composes the programs of the resolve pass and of the window."""
        self.picture = "screen"
        self.for_screen("edges.frag")
        for single in (False, True):
            self.add(("whole.vert", "resolve.frag"), (("SINGLE", single),))
        for compare, overlay in SCREENS:
            self.add(("screen.vert", "screen.frag"), (("COMPARE", f"COMPARE_{compare.upper()}"), ("OVERLAY", overlay)))
        for mark in ("sprite", "stroke"):
            self.add((f"{mark}.vert", f"{mark}.frag"), ())

    def _tiles(self, program: Program, around: dict[str, bool], most: int) -> None:
        """Composes the programs of tiles. around: switches of sheets around the eye."""
        sheets = program.appearance.sheets > 0
        for ordered, culled in [(True, False)] if sheets else product((True, False), repeat=2):
            self.for_screen("tile_project.frag", program, {"ORDERED": ordered, "CULLED": culled})
        for name, switches in LISTING[self.shape.name]:
            if sheets or name not in SORTING:
                self.for_tiles(name, program, switches)
        drawing = "sheet_draw.comp" if sheets else "box_draw.comp" if program.boxes else "tile_draw.comp"
        # layers and meshes are drawn in the order of depth
        mixed = program.appearance.hides and drawing != "tile_draw.comp"
        for options in choices(("CARRIED", "LIMITED", "LAYERED") if mixed else ("CARRIED",), most):
            self.for_tiles(drawing, program, {**dict.fromkeys(options, True), **around})
        for count in LAYERS * mixed:
            self.for_tiles("layers_over.comp", program, {"LAYERS": count})

    def _kept(self, stages: tuple[str, ...], chosen: Chosen, compiled: Callable[[], Any]) -> Any:
        if (stages, chosen) not in self.kept:
            self.kept[stages, chosen] = cast(Any, None)
            self.add(stages, chosen)
        return None

    def _name(self, shader: str, switches: Mapping[str, str | int | bool]) -> str:
        """Returns an unused file name: shader, picture, and the switches that a picture may set or not."""
        stem, ending = shader.split(".")
        options = declared_switches(shader) & OPTIONS
        values = [(name.lower(), value) for name, value in switches.items() if name in options and value]
        name = ".".join([stem, self.picture, *(name if value is True else f"{name}{value}" for name, value in values)])
        number = self.names[name, ending] = self.names.get((name, ending), 0) + 1
        return f"{name}.{ending}" if number == 1 else f"{name}.{number}.{ending}"


def choices(names: Iterable[str], most: int) -> Iterator[tuple[str, ...]]:
    """Yields the choices of at most `most` of the names."""
    names = tuple(names)
    return chain.from_iterable(combinations(names, count) for count in range(most + 1))


def plans(most: int) -> Iterator[tuple[str, Plan, int]]:
    """Yields the name and the plan of each picture of at most `most` changes, by tiles and by quads, and the number of
    changes that are left. Leaves out settings that refuse each other.
    """
    for kind, (picture, changes) in PICTURES.items():
        for names in choices(changes, most):
            settings = [changes[name].items() for name in names]
            merged = dict(chain.from_iterable(settings))
            if len(merged) < sum(map(len, settings)):
                # two values of a setting
                continue
            for technique in ("auto", "quads"):
                try:
                    plan = plan_of(picture.changed({**merged, "technique": technique}))
                except sg.InputError:
                    continue
                yield "+".join(filter(None, (kind, *names))) or "default", plan, most - len(names)


def programs(shape: ComputeShape, most: int = 2) -> list[tuple[Text, ...]]:
    """Returns the texts of the stages of all programs. shape: of compute shaders. most: changes made together."""
    recorder = Recorder(shape)
    for name, plan, left in plans(most):
        recorder.draw(name, plan, left)
    recorder.meshes()
    recorder.screen()
    return recorder.programs


def main(arguments: list[str]) -> int:
    """Writes all texts into a folder."""
    parser = argparse.ArgumentParser(
        allow_abbrev=False, prog="scripts/shader_texts", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("--shape", choices=SHAPES, default="processor", help="of compute shaders (default processor)")
    options = parser.parse_args(arguments)
    folder = options.folder
    written = dict.fromkeys(chain.from_iterable(programs(SHAPES[options.shape])))
    folder.mkdir(parents=True, exist_ok=True)
    for text in written:
        (folder / text.name).write_text(text.source, encoding="utf-8")
    rows = [(text.name, text.stage, text.version, *map("=".join, text.switches.items())) for text in written]
    table = "".join("\t".join(map(str, row)) + "\n" for row in rows)
    (folder / "texts.tsv").write_text(table, encoding="utf-8")
    print(f"{len(written)} texts in {folder}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

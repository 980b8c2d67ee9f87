"""Composes shaders from the folder `shaders/`, with checked includes, switches and constants.

A file declares each switch that it reads as `// switch NAME DEFAULT`, and each number shared with Python as
`#constant NAME`. A stage that needs a later GLSL than 3.3 declares `// version 430`, or `// version 430 if SWITCH`;
included files may not, as an unused include would raise the version. An undeclared switch or constant, a missing file
or an include cycle raises ShaderError with file and line. The composed text records the origin of each line, to explain
compiler messages.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from types import ModuleType

import numpy as np

from splatgl.errors import expected
from splatgl.geometry import clipping, mask_field
from splatgl.planning import clusters, culling, technique
from splatgl.splat import footprint, motion, motion_blur, quantized, sheets, splats
from splatgl.transfer import colormaps, preintegration, regions

# a file; or a file for any of the switches on, and its twin without effect for all of them off
INCLUDE = re.compile(r'^\s*#include\s+"([^"]+)"(?: if (\w+(?: or \w+)*) else "([^"]+)")?\s*$')
COMMENT = re.compile(r"\s*//.*$")
CONSTANT = re.compile(r"^#constant (\w+)")
SWITCH = re.compile(r"^// switch (\w+) (\w+)(?:\s.*)?$")
# line numbers of llvmpipe/Mesa ("0:12(3): error"), NVIDIA ("0(12) : error") and AMD/Intel ("ERROR: 0:12:")
ERROR_LINE = re.compile(r"\b0[:(](\d+)")
VERSION_LINE = re.compile(r"^// version (\d+)(?: if (\w+))?\s*$")
EXTENSION_LINE = re.compile(r"^// extension (\w+)$")
VERSION = 330
WEB_HEAD = (
    "#version 300 es",
    *(f"precision highp {kind};" for kind in ("float", "int", "sampler2D", "sampler3D", "usampler2D")),
)


# environment: name of the shape of compute shaders
SHAPE = "SPLATGL_SHAPE"


@dataclass(frozen=True)
class ComputeShape:
    """Shape of compute shaders. lanes: invocations of a work group. rows: pixels in a column of a tile that an
    invocation draws. A processor draws columns of pixels, a graphics card one pixel an invocation.
    """

    name: str
    lanes: int
    rows: int

    @property
    def switches(self) -> dict[str, int]:
        """Switches of this shape in shaders."""
        return {"CARD": self.name == "card", "LANES": self.lanes, "ROWS": self.rows}


SHAPES = {shape.name: shape for shape in (ComputeShape("processor", 8, 8), ComputeShape("card", 64, 1))}


def choose_shape(software: bool, name: str | None = None) -> ComputeShape:
    """Returns the shape of a name, of the environment variable SPLATGL_SHAPE, or of the device. software: whether the
    device draws on the CPU. Raises InputError for an unknown name.
    """
    name = name or os.environ.get(SHAPE) or ("processor" if software else "card")
    if name not in SHAPES:
        raise expected(f"shape of compute shaders ({SHAPE})", " | ".join(SHAPES), name)
    return SHAPES[name]


class ShaderError(RuntimeError):
    """Error in a shader's text or composition: a bug, not bad input."""


@dataclass(frozen=True)
class ShaderText:
    """Composed source, with the original file and line of each line."""

    source: str
    lines: tuple[str, ...]

    def explain(self, message: str) -> str:
        """Returns the compiler message with the origins of the lines that it names."""
        numbers = {int(n) for n in ERROR_LINE.findall(message)}
        origins = [f"line {n} is {self.lines[n - 1]}" for n in sorted(numbers) if 0 < n <= len(self.lines)]
        return "\n".join([message.strip(), *origins])


@lru_cache(maxsize=1)
def folder() -> Path:
    """Returns the folder of shaders: inside the installed package, or next to it in a checkout."""
    inside = Path(__file__).parents[1] / "shaders"
    return inside if inside.is_dir() else Path(__file__).parents[2] / "shaders"


def compose(
    name: str, switches: Mapping[str, str | int | bool], allowed: frozenset[str] = frozenset(), is_web: bool = False
) -> ShaderText:
    """Returns the text of shader `name` with its includes and switches, ready to compile.

    allowed: switches that only another stage of the program declares. is_web: for WebGL 2, whose GLSL ES 3.00 converts
    no integers and asks for precisions.
    """
    declared = _declared(name)
    unknown = set(switches) - set(declared) - allowed
    if unknown:
        raise ShaderError(f"{name}: no such switch: {', '.join(sorted(unknown))}; it has {', '.join(declared)}")
    values = {switch: _literal(switches.get(switch, default)) for switch, default in declared.items()}
    choosing = tuple((switch, values[switch] != "0") for switch in _choosing(name) if switch in values)
    version, extensions, code, places = _expand_all(name, choosing)
    first = WEB_HEAD if is_web else (f"#version {version} core", *extensions)
    head = [*first, *(f"#define {switch} {value}" for switch, value in values.items())]
    return ShaderText("\n".join([*head, code]) + "\n", (f"{name}: switches",) * len(head) + places)


def declared_switches(name: str) -> frozenset[str]:
    """Returns the switches that shader `name` and all of its includes declare, used or not."""
    return frozenset(_declared(name))


@lru_cache(maxsize=64)
def _declared(name: str) -> dict[str, str]:
    """Returns the default of each switch."""
    return {switch: default for block in _expand(name, (), set()) for switch, default in block.switches.items()}


@lru_cache(maxsize=64)
def _choosing(name: str) -> tuple[str, ...]:
    """Returns the switches by which shader `name` and its includes choose files and the version."""
    blocks = list(_expand(name, (), set()))
    named = [block.include[2] or "" for block in blocks if block.include]
    named += [block.version[2] for block in blocks if block.version]
    return tuple(sorted({switch for names in named for switch in names.split(" or ") if switch}))


@lru_cache(maxsize=256)
def _expand_all(name: str, choosing: tuple[tuple[str, bool], ...]) -> tuple[str, tuple[str, ...], str, tuple[str, ...]]:
    """Returns version, extensions, code and the place of each of its lines. choosing: switches that choose
    files, and whether they are on.
    """
    on, off = ({switch for switch, is_on in choosing if is_on is wanted} for wanted in (True, False))
    blocks = list(_expand(name, (), set(), {**dict.fromkeys(on, "1"), **dict.fromkeys(off, "0")}))
    declared = (block.version for block in blocks if block.version and block.version[2] not in off)
    version = next((number for _, number, _ in declared), str(VERSION))
    used = tuple(f"#extension {extension} : enable" for block in blocks for extension in block.extensions)
    code = "\n".join(line for block in blocks for line in block.code)
    return version, used, code, tuple(place for block in blocks for place in block.places)


def _expand(
    name: str, outer: tuple[str, ...], included: set[str], values: Mapping[str, str] | None = None
) -> Iterator[Block]:
    """Yields the blocks of a file, each followed by those of what it includes; each file once. values: of switches;
    None: includes both twins.
    """
    included.add(name)
    for block in _parsed(name):
        if outer and block.version:
            place, _, _ = block.version
            raise ShaderError(f"{place}: a version is declared by the stage that is composed, not by what it includes")
        yield block
        for file in _included(block.end, block.include, values) if block.include else ():
            if file in (*outer, name):
                raise ShaderError(f"{block.end}: includes {file}, which includes it")
            if file not in included:
                if not (folder() / file).is_file():
                    raise ShaderError(f"{block.end}: no such file: {file}")
                yield from _expand(file, (*outer, name), included, values)


def _included(place: str, match: re.Match[str], values: Mapping[str, str] | None) -> tuple[str, ...]:
    """Returns the file that a line includes for these switches; all of its files for None."""
    if not match[2]:
        return (match[1],)
    if values is None:
        return match[1], match[3]
    for switch in match[2].split(" or "):
        if switch not in values:
            raise ShaderError(f"{place}: no such switch: {switch}")
    return (match[1] if any(values[switch] != "0" for switch in match[2].split(" or ")) else match[3],)


@dataclass
class Block:
    """Lines of a file up to an include, or to its end: their places, and their code for the compiler; what they
    declare, the version with its place and its switch, if any; the include, and its place.
    """

    places: list[str] = field(default_factory=list)
    code: list[str] = field(default_factory=list)
    version: tuple[str, str, str] | None = None
    extensions: list[str] = field(default_factory=list)
    switches: dict[str, str] = field(default_factory=dict)
    include: re.Match[str] | None = None
    end: str = ""


@lru_cache(maxsize=128)
def _parsed(name: str) -> list[Block]:
    """Returns the blocks of a file."""
    blocks = [Block()]
    for number, text in enumerate(_read(name), 1):
        block, place = blocks[-1], f"{name}:{number}"
        if "#include" in text and (match := INCLUDE.match(text)):
            block.include, block.end = match, place
            blocks.append(Block())
            continue
        if text.startswith("#constant") and (match := CONSTANT.match(text)):
            if match[1] not in CONSTANTS:
                raise ShaderError(f"{place}: no such constant: {match[1]}")
            text = f"#define {match[1]} {glsl(match[1])}"
        elif text.startswith("// "):
            if match := SWITCH.match(text):
                block.switches[match[1]] = match[2]
            elif match := EXTENSION_LINE.match(text):
                block.extensions.append(match[1])
            elif match := VERSION_LINE.match(text):
                block.version = place, match[1], match[2] or ""
        block.places.append(place)
        # drivers cache programs by their text: without comments, a changed comment recompiles nothing
        block.code.append(COMMENT.sub("", text) if "//" in text else text)
    return blocks


@lru_cache(maxsize=128)
def _read(name: str) -> tuple[str, ...]:
    path = folder() / name
    if not path.is_file():
        raise ShaderError(f"{name}: no such shader in {folder()}")
    return tuple(path.read_text(encoding="utf-8").splitlines())


def _literal(value: str | int | bool) -> str:
    return str(int(value)) if isinstance(value, bool | int) else value


# splats per row of the placed textures, and groups of four entries per row of the tile list
ABREAST, LISTED = 1024, 2048
# cell ends per row of the classification table
TABLE_ROW = 128
# invocations per work group of a card's sort, and pairs that a group sorts
SORT_LANES, SORT_BLOCK = 256, 2048
# entries of a page: pieces of matter, and last the number of the next page
PAGE = 9
# states of a tile on a card: the next dispatch continues it; light passes it no more
CONTINUED, CLOSED = 1, 2
# cursor of a terminated tile
NOWHERE = 0x80000000

# constants of Python that shaders have by the same names
_SAME: tuple[tuple[ModuleType, *tuple[str, ...]], ...] = (
    (clipping, "FACE", "FLUSH", "MOST_CLIPS"),
    (colormaps, "KNOWN"),
    (culling, "HALF_LINE_REACH", "HAS_PLACE", "PIXEL_MARGIN"),
    (footprint, "FIRST_ORDER", "GRAZING", "LARGEST_DEPTH", "ONSET", "RIM_GROWTH", "RIM_START"),
    (regions, "MOST_ISO", "THIN"),
    (motion, "AHEAD", "FAR", "NEAREST"),
    (motion_blur, "DENSE", "DENSEST", "LEAST", "SHORT"),
    (preintegration, "CELLS", "WEIGHTS"),
    (regions, "MOST_REGIONS"),
    (sheets, "ABSENT", "AMID", "EDGE", "LEAST_MASS"),
    (splats, "COLOR_SCALE"),
    (technique, "COLUMNS", "MOST_DOUBLINGS"),
)
CONSTANTS: dict[str, float | np.uint32] = {
    **{name: getattr(module, name) for module, *names in _SAME for name in names},
    "ABREAST": np.uint32(ABREAST),
    "BLOCK": np.uint32(culling.BLOCK),
    "CENTERED": sheets.CENTERED[0],
    "CLASSES": quantized.CLASSES,
    "CLOSED": np.uint32(CLOSED),
    "CONTINUED": np.uint32(CONTINUED),
    "GAUSSIAN": 0.5 / regions.DEVIATION**2,
    "GRAZING_RAY": clipping.GRAZING,
    "LISTED": np.uint32(LISTED),
    "MAP_ENTRIES": colormaps.ENTRIES,
    "MASK_EDGE": mask_field.EDGE,
    "MASK_ONE": float(mask_field.ONE),
    "MASK_ZERO": float(mask_field.ZERO),
    "NAME_BITS": np.uint32(clusters.NAME_BITS),
    "NOWHERE": np.uint32(NOWHERE),
    "PAGE": PAGE,
    "QUANTIZED_ROW": np.uint32(quantized.QUANTIZED_ROW),
    "RUN_OCTAVES": splats.OCTAVES,
    "SHARE_ONE": quantized.SHARE_ONE,
    "SHARE_STEPS": quantized.SHARE_STEPS,
    "SIDE_BITS": np.uint32(clusters.SIDE_BITS),
    "SORT_BLOCK": np.uint32(SORT_BLOCK),
    "SORT_LANES": np.uint32(SORT_LANES),
    "TABLE_ROW": TABLE_ROW,
    "TILE_ROWS": technique.ROWS,
    "WHOLLY": sheets.CENTERED[1],
}


def glsl(name: str) -> str:
    """Returns the constant as a GLSL literal; raises KeyError for an unknown name."""
    value = CONSTANTS[name]
    return f"{value}u" if isinstance(value, np.uint32) else repr(value)

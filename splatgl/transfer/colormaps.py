"""Colour maps, and colours of labels and meshes."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from importlib.util import find_spec
from typing import Any

import numpy as np

from splatgl.data.color import linear_from_srgb, srgb_from_linear
from splatgl.data.mesh import Mesh
from splatgl.data.volume import Label, Volume, fraction_error
from splatgl.errors import expected, missing_extra
from splatgl.readers.common import silence_libraries

ENTRIES = 256

# control colours (sRGB) at equal steps; mixed in sRGB, where equal steps look about equal
EVEN = {
    "gray": "000000 ffffff",
    "white": "ffffff",
    "ivory": "5a3a26 a87d55 dcc298 f4e9d0 fffdf6",
    "flesh": "2a0f0a 7c3a2a c47a5e e6ab8c f6d8c2 fff3ea",
    "fire": "000000 3b0a2a 8c1230 d63a14 f98a10 fdd24a fffde0",
    "arteries": "2a0204 7a0a10 c8141c e8382e f28a70 ffe4d8",
    "glow": "04121c 0b3f4a 127a6a 35c06a b4ee7a fbffe0",
    "terrain": "1f4f8a 3f86b4 d8cda0 7ea85a 3f7a3a 8a7350 b0a8a0 ffffff",
    # 17 of the 256 published colours, within 0.023 of all of them
    "viridis": "440154 48186a 472d7b 424086 3b528b 33638d 2c728e 26818e 21908c "
    "1f9f88 28ae80 3ebc74 5dc963 82d34c abdc32 d5e21a fde725",
    "spectrum": "2a2f8f 1f7fd0 20b8a8 62d050 f0e040 f28a1c c0161c",
    "cool-warm": "3b4cc0 7b9ff9 c0d4f5 dddddd f2cbb7 ee8468 b40426",
}
# control colours with explicit positions: (position, colour)
UNEVEN: dict[str, tuple[tuple[float, str], ...]] = {
    "bone": ((0.0, "000000"), (0.365, "515171"), (0.746, "a6c6c6"), (1.0, "ffffff")),
    # maps of presets, with the borders of tissues
    "airways": ((0.0, "0a2740"), (0.4, "2f7fb8"), (0.7, "a8d8ee"), (1.0, "ffffff")),
    "chest": ((0.0, "7a3a26"), (0.25, "b86a4e"), (0.36, "c4524a"), (0.47, "b3262a"), (0.65, "ecd9b4"), (1.0, "fffdf6")),
    "coronary": ((0.0, "5a0a10"), (0.3, "d8432e"), (0.6, "ffb46a"), (0.85, "ffffff"), (1.0, "ffffff")),
    "fat": ((0.0, "8a6420"), (0.5, "f0cf6a"), (1.0, "fff3cf")),
    "heart": ((0.0, "4a1512"), (0.25, "8c2f26"), (0.5, "d8604a"), (0.75, "f4b79a"), (1.0, "fff4ea")),
    "liver": ((0.0, "4a2416"), (0.3, "8a4a30"), (0.42, "2f6fc0"), (0.7, "8fc4f4"), (1.0, "ffffff")),
    "lungs": ((0.0, "20304a"), (0.3, "8a6a86"), (0.55, "e89aa0"), (0.8, "f8c8b0"), (1.0, "fff0e0")),
    "muscle": ((0.0, "3a0d0d"), (0.4, "8f2a26"), (0.7, "cc5a48"), (1.0, "f2b49a")),
    "vessels": ((0.0, "5a0c0c"), (0.2, "b8221c"), (0.4, "ec6a3a"), (0.65, "f4d9a8"), (1.0, "ffffff")),
    "hot": ((0.0, "0b0000"), (0.365, "ff0000"), (0.746, "ffff00"), (1.0, "ffffff")),
}
CORE = tuple(sorted((*EVEN, *UNEVEN)))
# a part of a map
PART = re.compile(r"(.+)\[(\d*\.?\d*):(\d*\.?\d*)\]")
# a control colour in a caller's comma-separated list
NODE = re.compile(r"([0-9.eE+-]+):(#[0-9a-fA-F]{6})")
# names by ParaView, in lower case, of maps that have others here and in the libraries
PARAVIEW = {
    **{"cool to warm": "cool-warm", "warm to cool": "coolwarm_r", "grayscale": "gray", "x ray": "gray_r"},
    **{"black-body radiation": "hot", "viridis (matplotlib)": "viridis", "inferno (matplotlib)": "inferno"},
    **{"plasma (matplotlib)": "plasma", "magma (matplotlib)": "magma"},
}
# libraries with more names, in lookup order
LIBRARIES = ("cmap", "matplotlib")


@lru_cache(maxsize=64)
def colormap(name: str) -> np.ndarray:
    """Colour map as linear RGB, float64 [256, 3], read-only; entry 0 is the low end.

    name: one of CORE, a solid "#rrggbb", control colours "0:#000000,0.4:#ff0000,1:#ffffff", or a name in cmap or
    matplotlib; "NAME[LOW:HIGH]" takes the part between two places from 0 to 1. Raises InputError for unknown names and
    parts.
    """
    part = PART.fullmatch(name)
    if part:
        low, high = float(part[2] or 0), float(part[3] or 1)
        if not 0 <= low < high <= 1:
            raise expected("colormap", "a part such as NAME[0.6:1], from 0 to 1", repr(name))
        colors = _srgb(part[1])
        table = linear_from_srgb(_mix(np.linspace(0.0, 1.0, ENTRIES), colors, np.linspace(low, high, ENTRIES)))
    else:
        table = linear_from_srgb(_srgb(name))
    table.setflags(write=False)
    return table


def interpolate_map(table: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Linear RGB [..., 3] at positions [...] from 0 to 1 in a table of colours."""
    at = place * (len(table) - 1)
    below = np.minimum(at.astype(np.intp), len(table) - 2)
    part = (at - below)[..., None]
    return np.asarray(table[below] * (1.0 - part) + table[below + 1] * part)


def base_name(name: str) -> str:
    """Name of the map without a part: "NAME" of "NAME[LOW:HIGH]"."""
    part = PART.fullmatch(name)
    return part[1] if part else name


def _srgb(name: str) -> np.ndarray:
    if name in EVEN:
        colors = [_hex(color) for color in EVEN[name].split()]
        return _mix(np.linspace(0.0, 1.0, len(colors)), np.array(colors))
    if name in UNEVEN:
        nodes = UNEVEN[name]
        return _mix(np.array([place for place, _ in nodes]), np.array([_hex(code) for _, code in nodes]))
    if re.fullmatch(r"#[0-9a-fA-F]{6}", name):
        return np.tile(_hex(name[1:]), (ENTRIES, 1))
    if ":#" in name:
        return _mix(*_nodes(name))
    return _from_library(name)


def _hex(code: str) -> list[float]:
    return [channel / 255 for channel in bytes.fromhex(code)]


def _mix(places: np.ndarray, colors: np.ndarray, at: np.ndarray | None = None) -> np.ndarray:
    at = np.linspace(0.0, 1.0, ENTRIES) if at is None else at
    return np.stack([np.interp(at, places, colors[:, channel]) for channel in range(3)], axis=1)


def _nodes(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Places [N] and sRGB colours [N, 3] in a list of control colours."""
    nodes = [NODE.fullmatch(node) for node in name.split(",")]
    try:
        places = np.array([float(node[1]) for node in nodes if node])
    except ValueError:
        places = np.zeros(0)
    if len(places) < len(nodes) or not ((places >= 0) & (places <= 1)).all() or (np.diff(places) < 0).any():
        raise expected("colormap", "POSITION:#rrggbb,… with ascending positions from 0 to 1", repr(name[:80]))
    return places, np.array([_hex(node[2][1:]) for node in nodes if node])


def colormap_name(places: np.ndarray, colors: np.ndarray) -> str:
    """Name of the colour map through sRGB colours [N, 3] at ascending positions [N]; all from 0 to 1."""
    parts = np.clip(np.rint(np.asarray(colors) * 255), 0, 255).astype(int)
    codes = ("#{:02x}{:02x}{:02x}".format(*row) for row in parts.tolist())
    return ",".join(f"{place:.6g}:{code}" for place, code in zip(places, codes, strict=True))


# error of sRGB, and number of control colours, up to which a map is simplified
NEARLY, MOST_CONTROLS = 1.5 / 255, 17


def control_colors(name: str) -> tuple[np.ndarray, list[str]]:
    """Positions [N], from 0 to 1, and codes "#rrggbb" of the control colours of a map; of a map without, of colours
    between which it is nearly linear.
    """
    if re.fullmatch(r"#[0-9a-fA-F]{6}", name):
        return np.zeros(1), [name]
    if ":#" in name and not PART.fullmatch(name):
        places, colors = _nodes(name)
    else:
        all_colors, at = srgb_from_linear(colormap(name)), np.linspace(0.0, 1.0, ENTRIES)
        some = [0, ENTRIES - 1]
        while len(some) < MOST_CONTROLS:
            missed = np.abs(_mix(at[some], all_colors[some], at) - all_colors).max(axis=1)
            if missed.max() <= NEARLY:
                break
            some = sorted([*some, int(missed.argmax())])
        places, colors = at[some], all_colors[some]
    return places, ["#" + bytes(np.rint(color * 255).astype(np.uint8)).hex() for color in colors]


def _from_library(name: str) -> np.ndarray:
    name = PARAVIEW.get(name.lower(), name)
    if name in CORE:
        return _srgb(name)
    installed = [library for library in LIBRARIES if find_spec(library)]
    known = f"{', '.join(CORE)}, #rrggbb"
    if not installed:
        raise missing_extra(f"colormap {name!r} (not one of {known})", "cmap", "colormaps")
    for library in installed:
        table = _from_cmap(name) if library == "cmap" else _from_matplotlib(name)
        if table is not None:
            return table
    raise expected("colormap", f"one of {known}, or a name that {' or '.join(installed)} knows", repr(name))


def _from_cmap(name: str) -> np.ndarray | None:
    import cmap

    try:
        # the library warns where several packages have a name, of which it takes the first
        with silence_libraries():
            return np.asarray(cmap.Colormap(name)(np.linspace(0.0, 1.0, ENTRIES)), dtype=np.float64)[:, :3]
    except (ValueError, TypeError):
        return None


def _from_matplotlib(name: str) -> np.ndarray | None:
    import matplotlib

    known = name in matplotlib.colormaps
    return np.asarray(matplotlib.colormaps[name](np.linspace(0.0, 1.0, ENTRIES)))[:, :3] if known else None


# (number, "#rrggbb", opacity), ascending
LabelStyles = Sequence[tuple[int, str, float]]

# default opacity of a label, per reference length
SOLID = 0.99
# maximum number of labels of a volume without a label table: listing more takes seconds
MOST_LABELS = 1 << 20
# default colours of labels, which differ in hue and lightness; further labels rotate the hues
COLORS = (
    *("#e0a48c", "#7fb069", "#5aa9e6", "#f2c14e", "#b388eb", "#e4572e", "#2ec4b6", "#f48fb1", "#a1887f", "#90a4ae"),
    *("#c0ca33", "#3f6fb5", "#d4a017", "#8d5a97", "#4caf50", "#ff8a65", "#00a6a6", "#b0413e", "#6d9dc5", "#f0e442"),
)
# rotation of the hue from one round of COLORS to the next, in turns: the golden ratio
TURN = 0.618034
# rounds after which hues repeat, to keep float64's digits for 64-bit numbers
TURNS = 1_000_003


def colors_of(numbers: Sequence[int]) -> list[str]:
    """Default colours of label numbers."""
    turns, places = zip(*(divmod(abs(number) - 1, len(COLORS)) for number in numbers), strict=True)
    rgb = np.array([list(bytes.fromhex(COLORS[place][1:])) for place in places], np.float64)
    angle = 2 * np.pi * (np.array([turn % TURNS for turn in turns]) * TURN % 1.0)
    # a rotation about the grey axis
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None] / 3**0.5
    around = rgb[:, [1, 2, 0]] - rgb[:, [2, 0, 1]]
    turned = c * rgb + (1 - c) * rgb.mean(axis=1, keepdims=True) - s * around
    channels = np.clip(turned, 0, 255).round().astype(int).tolist()
    return ["#{:02x}{:02x}{:02x}".format(*row) for row in channels]


def labels_of(volume: Volume) -> tuple[Label, ...]:
    """Labels of a volume: its label table, else all its numbers except 0. Raises InputError for fractions and for too
    many numbers.
    """
    if volume.labels:
        return volume.labels
    numbers: np.ndarray = np.zeros(0, volume.samples.dtype)
    for slab in volume.slabs(16, halo=0):
        present = np.unique(slab.samples)
        if present.dtype.kind == "f":
            present = present[np.isfinite(present)]
            if (present != np.rint(present)).any():
                raise fraction_error(volume)
        numbers = np.union1d(numbers, present)
        if len(numbers) > MOST_LABELS:
            raise expected(volume.name or "labels", f"at most {MOST_LABELS} labels", "more", "is it a segmentation?")
    return tuple(Label(number) for number in map(int, numbers.tolist()) if number)


def select_labels(labels: Sequence[Label], only: Sequence[tuple[int, float]] | None = None) -> LabelStyles:
    """Colours and opacities of labels. only: (number, opacity factor) of the labels to show, hidden ones too; None: all
    that are not hidden. Of labels of one number, in layers that overlap, the first counts. Raises InputError for
    unknown numbers.
    """
    table: dict[int, Label] = {}
    for label in labels:
        table.setdefault(label.number, label)
    chosen = [(label.number, float(not label.hidden)) for label in table.values()] if only is None else list(only)
    for number, _ in chosen:
        if number not in table:
            known = [str(label.number) for label in labels[:20]]
            raise expected("only_labels", f"some of {', '.join(known)}{', …' * (len(table) > 20)}", number)
    bare = [number for number, _ in chosen if not table[number].color]
    colors = dict(zip(bare, colors_of(bare), strict=True)) if bare else {}
    named = ((table[number], factor) for number, factor in chosen)
    return check_labels(
        [(label.number, label.color or colors[label.number], SOLID * label.opacity * factor) for label, factor in named]
    )


def check_labels(labels: Any) -> LabelStyles:
    """Checks (number, "#rrggbb", opacity) triples and sorts them by number. Raises InputError for anything else."""
    styles = []
    for entry in labels:
        match entry:
            case [int() | np.integer() as number, str() as color, int() | float() as opacity] if re.fullmatch(
                "#[0-9a-fA-F]{6}", color
            ):
                styles.append((int(number), color, float(opacity)))
            case _:
                raise expected("labels", '(number, "#rrggbb", opacity) for each label', repr(entry))
    if not all(0 <= opacity <= 1 for _, _, opacity in styles):
        raise expected("labels", "opacities from 0 to 1", [opacity for _, _, opacity in styles])
    if len({number for number, _, _ in styles}) < len(styles):
        raise expected("labels", "each number once", [number for number, _, _ in styles])
    return tuple(sorted(styles))


def label_opacity(labels: LabelStyles, values: np.ndarray) -> np.ndarray:
    """Opacities of values, float64, any shape; 0 of numbers that are no label."""
    return _look_up(labels, values, 0)


def label_color(labels: LabelStyles, values: np.ndarray) -> np.ndarray:
    """Linear RGB of values, float64 [..., 3]."""
    return _look_up(labels, values, 1)


def label_place(labels: LabelStyles, values: np.ndarray) -> np.ndarray:
    """Positions of values in `labels`, counted from 1, float64; 0 of numbers that are no label."""
    return _look_up(labels, values, 2)


def _look_up(labels: LabelStyles, values: np.ndarray, column: int) -> np.ndarray:
    numbers, *columns = _table(tuple(labels), values.dtype.kind in "bui")
    values = values.astype(numbers.dtype, copy=False)
    place = np.minimum(np.searchsorted(numbers, values), len(numbers) - 1)
    same, table = numbers[place] == values, columns[column]
    return np.where(same[..., None] if table.ndim > 1 else same, table[place], 0.0)


@lru_cache(maxsize=8)
def _table(labels: LabelStyles, integer: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Numbers in ascending order, opacities, linear RGB, and positions in `labels` from 1 on.

    integer: numbers as int64, since float64 cannot hold all of them; unsigned ones wrap around, as values do.
    """
    named = [number for number, _, _ in labels]
    numbers = np.array(named, object).astype(np.uint64 if min(named) >= 0 else np.int64).astype(np.int64)
    numbers = numbers if integer else np.array(named, np.float64)
    order = np.argsort(numbers, kind="stable")
    opacities = np.array([opacity for _, _, opacity in labels])
    srgb = np.array([list(bytes.fromhex(color[1:])) for _, color, _ in labels])
    return numbers[order], opacities[order], linear_from_srgb(np.arange(256) / 255)[srgb[order]], order + 1


# places in a map are from 0 to 1; values outside are clamped to ±FURTHEST, and NaN is UNKNOWN, which interpolation with
# other corners keeps below KNOWN
FURTHEST, UNKNOWN, KNOWN = 1e4, -1e12, -1e5


def map_places(mesh: Mesh) -> np.ndarray:
    """Positions [N] of vertices' values in their map, 0 to 1 within its window; UNKNOWN for NaN."""
    assert mesh.values is not None
    low, high = mesh.ranged
    place = np.clip((mesh.values - low) / (high - low), -FURTHEST, FURTHEST)
    return np.where(np.isnan(place), UNKNOWN, place)


def map_tables(meshes: Sequence[Mesh]) -> np.ndarray:
    """float32 [R, ENTRIES, 3]: linear RGB of the maps of all meshes that have one; one black row if none has."""
    tables = [colormap(mesh.colormap) for mesh in meshes if mesh.has_map]
    return np.array(tables or [np.zeros((ENTRIES, 3))], np.float32)


def paint_vertices(mesh: Mesh) -> Mesh:
    """The mesh with its values turned into vertex colours, for renderers without colour maps."""
    if not mesh.mapped:
        return mesh
    points = replace(mesh, faces=np.arange(len(mesh.vertices))[:, None] * np.ones(3, np.int64), corner_normals=None)
    linear = colors_at(points, np.arange(len(mesh.vertices)), np.broadcast_to([1.0, 0.0, 0.0], (len(mesh.vertices), 3)))
    colors = np.rint(srgb_from_linear(linear) * 255).astype(np.uint8)
    return replace(mesh, colors=colors, values=None)


def colors_at(mesh: Mesh, triangle: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Linear RGB [P, 3] at points of triangles [P]. share [P, 3]: barycentric coordinates."""
    if not mesh.mapped:
        return np.asarray((mesh.shades[triangle] * share[..., None]).sum(axis=1))
    place = (map_places(mesh)[mesh.faces[triangle]] * share).sum(axis=1)
    return map_color(colormap(mesh.colormap), place, np.asarray(mesh.color))


def map_color(table: np.ndarray, place: np.ndarray, plain: np.ndarray) -> np.ndarray:
    """Linear RGB [P, 3] at positions [P] of a map; `plain` where there is no value. Twin of
    `shaders/mesh_maps.glsl`.
    """
    return np.where((place < KNOWN)[:, None], plain, interpolate_map(table, np.clip(place, 0.0, 1.0)))

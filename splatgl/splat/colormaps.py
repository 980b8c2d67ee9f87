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
from splatgl.data.volume import Label, Volume
from splatgl.errors import expected, missing_extra

ENTRIES = 256

# control colours (sRGB) at equal steps; mixed in sRGB, where equal steps look about equal
EVEN = {
    "gray": "000000 ffffff",
    "white": "ffffff",
    "ivory": "5a3a26 a87d55 dcc298 f4e9d0 fffdf6",
    "flesh": "2a0f0a 7c3a2a c47a5e e6ab8c f6d8c2 fff3ea",
    "fire": "000000 3b0a2a 8c1230 d63a14 f98a10 fdd24a fffde0",
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
    # of presets: borders of tissues
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
# control colours of a caller, comma-separated
NODE = re.compile(r"([0-9.eE+-]+):(#[0-9a-fA-F]{6})")
# libraries with more names, in lookup order
LIBRARIES = ("cmap", "matplotlib")


@lru_cache(maxsize=64)
def colormap(name: str) -> np.ndarray:
    """A colour map as linear RGB, float64 [256, 3], read-only; entry 0 is the low end.

    name: one of CORE, a solid "#rrggbb", control colours "0:#000000,0.4:#ff0000,1:#ffffff", or a name in cmap or
    matplotlib; "NAME[LOW:HIGH]" is a part of it, from 0 to 1. Raises InputError for an unknown name, and for other
    parts.
    """
    part = PART.fullmatch(name)
    if part:
        low, high = float(part[2] or 0), float(part[3] or 1)
        if not 0 <= low < high <= 1:
            raise expected("colormap", "a part such as NAME[0.6:1], from 0 to 1", repr(name))
        whole = _srgb(part[1])
        table = linear_from_srgb(_mix(np.linspace(0.0, 1.0, ENTRIES), whole, np.linspace(low, high, ENTRIES)))
    else:
        table = linear_from_srgb(_srgb(name))
    table.setflags(write=False)
    return table


def whole(name: str) -> str:
    """The name of the map that a name is a part of."""
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
    """Places [N] and sRGB colours [N, 3] of control colours."""
    found = [NODE.fullmatch(each) for each in name.split(",")]
    try:
        places = np.array([float(each[1]) for each in found if each])
    except ValueError:
        places = np.zeros(0)
    if len(places) < len(found) or not ((places >= 0) & (places <= 1)).all() or (np.diff(places) < 0).any():
        raise expected("colormap", "PLACE:#rrggbb,… with places from 0 to 1 that never fall", repr(name[:80]))
    return places, np.array([_hex(each[2][1:]) for each in found if each])


def of_colors(places: np.ndarray, colors: np.ndarray) -> str:
    """The name of the map through sRGB colours [N, 3], from 0 to 1, at ascending places [N] from 0 to 1."""
    parts = np.clip(np.rint(np.asarray(colors) * 255), 0, 255).astype(int)
    codes = ("#{:02x}{:02x}{:02x}".format(*row) for row in parts.tolist())
    return ",".join(f"{place:.6g}:{code}" for place, code in zip(places, codes, strict=True))


def _from_library(name: str) -> np.ndarray:
    installed = [library for library in LIBRARIES if find_spec(library)]
    own = f"{', '.join(CORE)}, #rrggbb"
    if not installed:
        raise missing_extra(f"colormap {name!r} (not one of {own})", "cmap", "colormaps")
    for library in installed:
        table = _from_cmap(name) if library == "cmap" else _from_matplotlib(name)
        if table is not None:
            return table
    raise expected("colormap", f"one of {own}, or a name that {' or '.join(installed)} knows", repr(name))


def _from_cmap(name: str) -> np.ndarray | None:
    import cmap

    try:
        return np.asarray(cmap.Colormap(name)(np.linspace(0.0, 1.0, ENTRIES)), dtype=np.float64)[:, :3]
    except (ValueError, TypeError):
        return None


def _from_matplotlib(name: str) -> np.ndarray | None:
    import matplotlib

    known = name in matplotlib.colormaps
    return np.asarray(matplotlib.colormaps[name](np.linspace(0.0, 1.0, ENTRIES)))[:, :3] if known else None


# (number, "#rrggbb", opacity), ascending
Shown = Sequence[tuple[int, str, float]]

# opacity of a label, per reference length
SOLID = 0.99
# most numbers that a volume without a table of labels may have: a list of them takes seconds
MOST_LABELS = 1 << 20
# colours of labels without one, which differ in hue and lightness; beyond, turned hues
COLORS = (
    *("#e0a48c", "#7fb069", "#5aa9e6", "#f2c14e", "#b388eb", "#e4572e", "#2ec4b6", "#f48fb1", "#a1887f", "#90a4ae"),
    *("#c0ca33", "#3f6fb5", "#d4a017", "#8d5a97", "#4caf50", "#ff8a65", "#00a6a6", "#b0413e", "#6d9dc5", "#f0e442"),
)
# turn of the hue from one round of COLORS to the next: the golden ratio's
TURN = 0.618034
# turns after which hues repeat, so that those of numbers of 64 bits have digits left
TURNS = 1_000_003


def color_of(number: int) -> str:
    """The colour of a label that has none: the same in every file."""
    return colors_of([number])[0]


def colors_of(numbers: Sequence[int]) -> list[str]:
    """The colours of labels that have none."""
    turns, places = zip(*(divmod(abs(number) - 1, len(COLORS)) for number in numbers), strict=True)
    rgb = np.array([[int(COLORS[place][k : k + 2], 16) for k in (1, 3, 5)] for place in places], np.float64)
    angle = 2 * np.pi * (np.array([turn % TURNS for turn in turns]) * TURN % 1.0)
    # a rotation about the grey axis
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None] / 3**0.5
    around = rgb[:, [1, 2, 0]] - rgb[:, [2, 0, 1]]
    turned = c * rgb + (1 - c) * rgb.mean(axis=1, keepdims=True) - s * around
    whole = np.clip(turned, 0, 255).round().astype(int).tolist()
    return ["#{:02x}{:02x}{:02x}".format(*row) for row in whole]


def labels_of(volume: Volume) -> tuple[Label, ...]:
    """The labels of a volume: those of its table, else all numbers but 0. Raises InputError for what is no number of a
    label, or for too many.
    """
    if volume.labels:
        return volume.labels
    found: np.ndarray = np.zeros(0, volume.samples.dtype)
    for slab in volume.slabs(16, halo=0):
        there = np.unique(slab.samples)
        if there.dtype.kind == "f":
            there = there[np.isfinite(there)]
            if (there != np.rint(there)).any():
                raise expected(volume.name or "labels", "whole numbers", volume.samples.dtype.name)
        found = np.union1d(found, there)
        if len(found) > MOST_LABELS:
            raise expected(volume.name or "labels", f"at most {MOST_LABELS} labels", "more", "is it a segmentation?")
    return tuple(Label(number) for number in map(int, found.tolist()) if number)


def shown_labels(labels: Sequence[Label], only: Sequence[tuple[int, float]] | None = None) -> Shown:
    """Colours and opacities of labels. only: numbers of those that are shown, hidden ones too, and factors of their
    opacities. Raises InputError for a number that there is not.
    """
    table = {label.number: label for label in labels}
    chosen = [(each.number, float(not each.hidden)) for each in labels] if only is None else list(only)
    for number, _ in chosen:
        if number not in table:
            known = [str(label.number) for label in labels[:20]]
            raise expected("only_labels", f"some of {', '.join(known)}{', …' * (len(table) > 20)}", number)
    bare = [number for number, _ in chosen if not table[number].color]
    colors = dict(zip(bare, colors_of(bare), strict=True)) if bare else {}
    named = ((table[number], factor) for number, factor in chosen)
    return checked_labels(
        [(each.number, each.color or colors[each.number], SOLID * each.opacity * factor) for each, factor in named]
    )


def checked_labels(labels: Any) -> Shown:
    """Labels in the order of their numbers; InputError for anything else than triples of them."""
    found = []
    for entry in labels:
        match entry:
            case [int() | np.integer() as number, str() as color, int() | float() as opacity] if re.fullmatch(
                "#[0-9a-fA-F]{6}", color
            ):
                found.append((int(number), color, float(opacity)))
            case _:
                raise expected("labels", '(number, "#rrggbb", opacity) of each', repr(entry))
    if not all(0 <= opacity <= 1 for _, _, opacity in found):
        raise expected("labels", "opacities from 0 to 1", [opacity for _, _, opacity in found])
    if len({number for number, _, _ in found}) < len(found):
        raise expected("labels", "each number once", [number for number, _, _ in found])
    return tuple(sorted(found))


def label_opacity(labels: Shown, values: np.ndarray) -> np.ndarray:
    """Opacities, float64, the shape of values: 0 of what is no label."""
    return _looked_up(labels, values, 0)


def label_color(labels: Shown, values: np.ndarray) -> np.ndarray:
    """Linear RGB, float64 [..., 3]."""
    return _looked_up(labels, values, 1)


def label_place(labels: Shown, values: np.ndarray) -> np.ndarray:
    """Places of values in `labels`, from 1 on, float64; 0 of what is no label."""
    return _looked_up(labels, values, 2)


def _looked_up(labels: Shown, values: np.ndarray, column: int) -> np.ndarray:
    numbers, *columns = _table(tuple(labels), values.dtype.kind in "bui")
    values = values.astype(numbers.dtype, copy=False)
    place = np.minimum(np.searchsorted(numbers, values), len(numbers) - 1)
    same, table = numbers[place] == values, columns[column]
    return np.where(same[..., None] if table.ndim > 1 else same, table[place], 0.0)


@lru_cache(maxsize=8)
def _table(labels: Shown, whole: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Numbers in ascending order, opacities, linear RGB, and places in `labels` from 1 on. whole: of 64 bits, as
    float64 does not hold them all; those that are unsigned wrap around, as values do.
    """
    named = [number for number, _, _ in labels]
    numbers = np.array(named, object).astype(np.uint64 if min(named) >= 0 else np.int64).astype(np.int64)
    numbers = numbers if whole else np.array(named, np.float64)
    order = np.argsort(numbers, kind="stable")
    opacities = np.array([opacity for _, _, opacity in labels])
    srgb = np.array([[int(color[k : k + 2], 16) for k in (1, 3, 5)] for _, color, _ in labels])
    return numbers[order], opacities[order], linear_from_srgb(np.arange(256) / 255)[srgb[order]], order + 1


# places of values in a map are from 0 to 1; those beyond are kept up to the first number, and NaN is the second, below
# the third even near other corners
FURTHEST, UNKNOWN, KNOWN = 1e4, -1e12, -1e5


def places_of(mesh: Mesh) -> np.ndarray:
    """Places [N] of vertices' values in their map, 0 to 1 within its window; UNKNOWN where there is none."""
    assert mesh.values is not None
    low, high = mesh.ranged
    place = np.clip((mesh.values - low) / (high - low), -FURTHEST, FURTHEST)
    return np.where(np.isnan(place), UNKNOWN, place)


def tables_of(meshes: Sequence[Mesh]) -> np.ndarray:
    """float32 [R, ENTRIES, 3]: linear RGB of the maps of those meshes that have values; one row without any."""
    found = [colormap(mesh.colormap) for mesh in meshes if mesh.mapped]
    return np.array(found or [np.zeros((ENTRIES, 3))], np.float32)


def painted(mesh: Mesh) -> Mesh:
    """A mesh with the colours of its values at its vertices, for what does not look them up between."""
    if not mesh.mapped:
        return mesh
    every = replace(mesh, faces=np.arange(len(mesh.vertices))[:, None] * np.ones(3, np.int64), corner_normals=None)
    linear = colors_at(every, np.arange(len(mesh.vertices)), np.broadcast_to([1.0, 0.0, 0.0], (len(mesh.vertices), 3)))
    colors = np.rint(srgb_from_linear(linear) * 255).astype(np.uint8)
    return replace(mesh, colors=colors, values=None)


def colors_at(mesh: Mesh, triangle: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Linear RGB [P, 3] at points of triangles [P], by the shares [P, 3] of their corners."""
    if not mesh.mapped:
        return np.asarray((mesh.shades[triangle] * share[..., None]).sum(axis=1))
    place = (places_of(mesh)[mesh.faces[triangle]] * share).sum(axis=1)
    return mapped_color(colormap(mesh.colormap), place, np.asarray(mesh.color))


def mapped_color(table: np.ndarray, place: np.ndarray, plain: np.ndarray) -> np.ndarray:
    """Linear RGB [P, 3] at places [P] of a map; `plain` where there is no value. Twin of `shaders/mesh_maps.glsl`."""
    at = np.clip(place, 0.0, 1.0) * (ENTRIES - 1)
    low = np.minimum(at.astype(np.int64), ENTRIES - 2)
    found = table[low] + (table[low + 1] - table[low]) * (at - low)[:, None]
    return np.where((place < KNOWN)[:, None], plain, found)

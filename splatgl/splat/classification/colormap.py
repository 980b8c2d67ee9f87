"""Colour maps by name: a few of our own, solid "#rrggbb", and those of cmap or matplotlib where installed; and parts of
them, such as "viridis[0.5:]".
"""

from __future__ import annotations

import re
from functools import lru_cache
from importlib.util import find_spec

import numpy as np

from splatgl.data.color import linear_from_srgb
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

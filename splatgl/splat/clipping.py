"""Clip planes, their text form, and crop boxes.

Rays are clipped, so that values classified after reconstruction, and boxes of labels, end exactly at a plane; other
voxels that are classified before are kept or left out whole. A face that a plane cuts is lit by the plane's normal, to
a depth of FACE voxels.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations
from numbers import Real
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.data.volume import Volume
from splatgl.errors import InputError, expected
from splatgl.splat.grid import corners_of
from splatgl.splat.splats import LatestParts

if TYPE_CHECKING:
    from splatgl.splat.grid import Grid
    from splatgl.splat.splats import Splats


# most planes of a picture: those of a box and ten more
MOST_CLIPS = 16
# normals whose length is 1 but for rounding
UNIT = 1e-14
# voxels along a ray behind a cut that are lit as its face
FACE = 1.0
# a ray that leaves a plane, or a face of a volume's box, by less than GRAZING of its length lies in it if it begins
# within FLUSH voxels of it, and is kept: views along faces are usual, and rounding would decide each ray otherwise
GRAZING, FLUSH = 1e-5, 1e-3
# rounding: a voxel before a plane by less than this share of its distance from the origin counts as on it
ON_PLANE = 1e-12

# n_x, n_y, n_z, d: kept are the points x with n · x ≥ d, world units; n is a unit vector
Plane = tuple[float, float, float, float]
# cache: of the latest planes
_latest = LatestParts()


def planes(given: Any) -> tuple[Plane, ...]:
    """Planes [n_x, n_y, n_z, d] with unit normals. Raises InputError for other numbers, no direction, and too many."""
    rows = list(given) if isinstance(given, Iterable) and not isinstance(given, str) else [None]
    if len(rows) > MOST_CLIPS:
        raise expected("clip", f"at most {MOST_CLIPS} planes", len(rows))
    return tuple(_plane(row) for row in rows)


def _plane(row: Any) -> Plane:
    numbers = list(row) if isinstance(row, Sequence | np.ndarray) and not isinstance(row, str) else []
    fine = len(numbers) == 4 and all(isinstance(n, Real) and np.isfinite(float(n)) for n in numbers)
    length = float(np.linalg.norm(np.array(numbers[:3], np.float64))) if fine else 0.0
    if not (fine and 0 < length < np.inf):
        raise expected("clip", "planes of four finite numbers: a normal n and d, kept where n · x ≥ d", repr(row)[:80])
    # unit vectors stay as they are, bit for bit
    length = 1.0 if abs(length - 1.0) < UNIT else length
    x, y, z, d = (float(n) / length for n in numbers)
    return x, y, z, d


@dataclass(frozen=True, eq=False)
class Clip:
    """Planes over a grid. normal [K, 3]: unit vectors, world axes; kept are the grid positions i with g · i ≥ place, of
    g [K, 3] and place [K].
    """

    normal: np.ndarray
    g: np.ndarray
    place: np.ndarray

    @classmethod
    def of(cls, found: Sequence[Plane], grid: Grid) -> Clip | None:
        """The planes in the indices of a grid; None for none."""
        if not found:
            return None
        rows = np.array(found, np.float64)
        normal = rows[:, :3]
        return cls(normal, normal @ grid.world_from_index, rows[:, 3] - normal @ np.asarray(grid.origin, np.float64))

    def keeps(self, positions: np.ndarray, boxes: bool = False) -> np.ndarray:
        """bool [N]: which grid positions [N, 3] are kept; boxes: or any of the boxes of their voxels."""
        at = positions.astype(np.float64) @ self.g.T
        place = self.place - (0.5 * np.abs(self.g).sum(axis=1) if boxes else 0.0)
        return np.asarray((at >= place - ON_PLANE * (np.abs(at) + np.abs(place))).all(axis=1))

    def meets(self, low: np.ndarray, high: np.ndarray) -> bool:
        """Whether any of a box of grid positions, low to high [3], may be kept."""
        return bool((np.where(self.g > 0, high, low) * self.g).sum(axis=1).__ge__(self.place).all())

    def along(self, start: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of rays from `start` along `direction` [3, P], grid indices: the distances [P] between which all planes keep
        them, and the number [P] of the plane behind which they begin.
        """
        size = np.linalg.norm(self.g, axis=1)[:, None]
        speed, apart = self.g @ direction / size, (self.place[:, None] - self.g @ start) / size
        apart = np.where(np.abs(speed) < GRAZING * np.linalg.norm(direction, axis=0), apart - FLUSH, apart)
        with np.errstate(divide="ignore", invalid="ignore"):
            at = apart / speed
        # a ray along a plane is always or never kept
        still = np.where(apart > 0, np.inf, -np.inf)
        enters = np.where(speed > 0, at, np.where(speed == 0, still, -np.inf))
        leaves = np.where(speed < 0, at, np.inf)
        return enters.max(axis=0), leaves.min(axis=0), enters.argmax(axis=0)


def clipped(splats: Splats, found: tuple[Plane, ...], boxes: bool = False) -> Splats:
    """The splats whose centres planes keep, or any of their boxes; of values all, as rays are clipped. Caches the
    latest result.
    """
    clip = Clip.of(found, splats.grid) if len(splats) and splats.post is None else None
    if clip is None:
        return splats
    return _latest.of(splats, (found, boxes), lambda: clip.keeps(splats.positions, boxes))


CONDITION = "a condition such as x>0.3, x+y<1.2, z>=30mm, or X,Y,Z:NX,NY,NZ, a point and a normal"
NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?"
TERM = re.compile(rf"([+-]?)({NUMBER})?\*?([xyz])", re.IGNORECASE)
COMPARED = re.compile(rf"(.+?)(>=?|<=?)([+-]?{NUMBER})([a-zµμ]*)", re.IGNORECASE)
# metres; a volume's unit may also have another name, or none
LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "μm": 1e-6, "nm": 1e-9}
ANY_UNIT = "units"
# share of a box's sides beyond which a corner lies outside, for rounding
SLACK = 1e-9


@dataclass(frozen=True, eq=False)
class Box:
    """What fractions and lengths in words refer to. low, high [3]: world units; unit: their name."""

    low: np.ndarray
    high: np.ndarray
    unit: str = ""

    @classmethod
    def of(cls, volumes: Iterable[Volume]) -> Box:
        """Around volumes, in the unit of the first."""
        found = list(volumes)
        corners = np.concatenate([each.corners for each in found])
        return cls(corners.min(axis=0), corners.max(axis=0), found[0].unit)


@dataclass(frozen=True, eq=False)
class Part:
    """Points that a view is fitted to [N, 3], world units, and their frame."""

    outline: np.ndarray
    frame: str | None = None

    @property
    def corners(self) -> np.ndarray:
        """Corners [8, 3] of the box around them."""
        return corners_of(self.outline.min(axis=0), self.outline.max(axis=0))


def planes_of(cuts: str | Sequence[Any], box: Box) -> tuple[Plane, ...]:
    """The planes of conditions, or of rows of four numbers. Raises InputError for others, and if nothing is left."""
    given = [cuts] if isinstance(cuts, str) else list(cuts)
    found = planes([_condition(each, box) if isinstance(each, str) else each for each in given])
    if found and not len(left(found, corners_of(box.low, box.high))):
        raise expected("clip", "planes that leave something of the volume", ", ".join(map(str, given)))
    return found


def left(found: Sequence[Plane], corners: np.ndarray) -> np.ndarray:
    """Corners [N, 3] of what planes leave of a parallelepiped with corners [8, 3], in the order of `corners_of`."""
    sides = corners[[1, 2, 4]] - corners[0]
    size = float(np.linalg.norm(corners.max(axis=0) - corners.min(axis=0)))
    rows = [np.array(each) for each in found]
    for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        normal = np.cross(sides[b], sides[c])
        normal = normal / np.linalg.norm(normal) * np.sign(normal @ sides[a])
        rows += [np.append(normal, normal @ corners[0]), np.append(-normal, -normal @ (corners[0] + sides[a]))]
    every = np.array(rows)
    three = every[np.array(list(combinations(range(len(every)), 3)))]
    three = three[np.abs(np.linalg.det(three[..., :3])) > SLACK]
    points = np.linalg.solve(three[..., :3], three[..., 3:])[..., 0]
    inside = (points @ every[:, :3].T >= every[:, 3] - SLACK * size).all(axis=1)
    return np.asarray(points[inside])


def crop_planes(text: str, volume: Volume) -> tuple[Plane, ...]:
    """The planes around a part of a volume: A:B,C:D,E:F in voxels along x, y, z, as Python slices them.

    Raises InputError for other text, and if nothing is left.
    """
    sizes = volume.shape[::-1]
    parts = text.replace(" ", "").split(",")
    try:
        ends = [[int(end) if end else None for end in part.split(":")] for part in parts]
    except ValueError:
        ends = []
    if len(ends) != 3 or any(len(each) != 2 for each in ends):
        raise expected("crop", "A:B,C:D,E:F, voxels along x, y and z, of which any may be left out", repr(text))
    found = []
    for axis, (each, size) in enumerate(zip(ends, sizes, strict=True)):
        begin, end, _ = slice(*each).indices(size)
        if begin >= end:
            raise expected("crop", f"voxels from 0 to {size} along {'xyz'[axis]}", parts[axis])
        for sign, place, whole in ((1, begin, begin == 0), (-1, end, end == size)):
            if not whole:
                found.append(index_plane(volume, axis, sign, place - 0.5))
    return planes(found)


def index_plane(volume: Volume, axis: int, sign: int, place: float) -> Plane:
    """The plane at a grid index along an axis, that keeps larger ones, or smaller."""
    index = np.zeros(3)
    index[axis] = sign
    normal = index @ np.linalg.inv(volume.world_from_index)
    x, y, z = (float(each) for each in normal)
    return x, y, z, float(sign * place + normal @ np.asarray(volume.origin))


def _condition(text: str, box: Box) -> tuple[float, ...]:
    compact = text.replace(" ", "")
    if ":" in compact:
        return _through(text, compact)
    match = COMPARED.fullmatch(compact)
    terms = TERM.findall(match[1]) if match else []
    if not match or "".join("".join(each) for each in terms) != match[1].replace("*", ""):
        raise expected("clip", CONDITION, repr(text))
    normal = np.zeros(3)
    for sign, factor, axis in terms:
        normal["xyz".index(axis.lower())] += float(f"{sign}{factor or 1}")
    if not normal.any():
        raise expected("clip", CONDITION, repr(text))
    sign, number, unit = (1.0 if match[2][0] == ">" else -1.0), float(match[3]), match[4]
    if unit:
        place = number * _scale(unit, box.unit, text)
    else:
        if len(terms) == 1 and not 0 <= number / normal.sum() <= 1:
            raise expected("clip", "a fraction of the volume's box from 0 to 1, or a length with its unit", repr(text))
        # of fractions f = (x − low)/side
        normal = normal / (box.high - box.low)
        place = number + float(normal @ box.low)
    return (*(sign * normal).tolist(), sign * place)


def _through(text: str, compact: str) -> tuple[float, ...]:
    try:
        point, normal = (np.array([float(n) for n in part.split(",")]) for part in compact.split(":"))
        return (*normal.tolist(), float(normal @ point))
    except ValueError:
        raise expected("clip", CONDITION, repr(text)) from None


def _scale(unit: str, own: str, text: str) -> float:
    """World units per `unit`."""
    if unit in (own, ANY_UNIT):
        return 1.0
    if unit not in LENGTHS or own not in LENGTHS:
        raise InputError(f"clip: expected a length in {own or ANY_UNIT}, got {text!r}")
    return LENGTHS[unit] / LENGTHS[own]

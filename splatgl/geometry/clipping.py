"""Clip planes, their text form, and crop boxes.

Rays are clipped, so that values classified after reconstruction and boxes of labels end exactly at a plane. Other
voxels classified before reconstruction are drawn whole or not at all. A face cut by a plane is lit by the plane's
normal, to a depth of FACE voxels.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations
from numbers import Real
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np

from splatgl.data.affine import Change, metres_in
from splatgl.data.volume import Volume
from splatgl.errors import InputError, expected
from splatgl.geometry.grid import corners_of

if TYPE_CHECKING:
    from splatgl.geometry.grid import Grid
    from splatgl.splat.splats import Splats


# maximum number of planes of a picture: six of a box, and ten more
MOST_CLIPS = 16
# difference of a normal's length from 1 that is only rounding
UNIT = 1e-14
# voxels along a ray behind a plane that are lit as its face
FACE = 1.0
# a ray that diverges from a plane, or a face of a volume's box, by less than GRAZING of its length and begins within
# FLUSH voxels of it is kept: views along faces are common, and rounding would decide ray by ray
GRAZING, FLUSH = 1e-5, 1e-3
# rounding: a voxel before a plane by less than this share of its distance from the origin counts as on it
ON_PLANE = 1e-12

# n_x, n_y, n_z, d: keeps the points x with n · x ≥ d, world units; n is a unit vector
Plane = tuple[float, float, float, float]


class LatestParts:
    """Cache of the latest part of each set of splats; an entry lives as long as its set."""

    def __init__(self) -> None:
        # None stands for all splats: an entry that refers to its own set would never be freed
        self._kept: WeakKeyDictionary[Splats, tuple[object, Splats | None]] = WeakKeyDictionary()

    def of(self, splats: Splats, key: object, keeps: Callable[[], np.ndarray]) -> Splats:
        """The splats where `keeps()` [N] is True; calls it again only if `key` changes."""
        latest = self._kept.get(splats)
        if latest is None or latest[0] != key:
            mask = keeps()
            latest = self._kept[splats] = key, None if mask.all() else splats.part(mask)
        return splats if latest[1] is None else latest[1]


# cache: splats that the latest planes keep
_latest = LatestParts()


def check_planes(given: Any) -> tuple[Plane, ...]:
    """Checks rows [n_x, n_y, n_z, d] and scales normals to unit length. Raises InputError for anything else, for zero
    normals, and for too many planes.
    """
    rows = list(given) if isinstance(given, Iterable) and not isinstance(given, str) else [given]
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
    """Planes in grid indices: g [K, 3] and place [K] keep the grid positions i with g · i ≥ place.

    normal [K, 3]: unit vectors, world axes.
    """

    normal: np.ndarray
    g: np.ndarray
    place: np.ndarray

    @classmethod
    def of(cls, planes: Sequence[Plane], grid: Grid) -> Clip | None:
        """Converts planes to the indices of a grid; None for no planes."""
        if not planes:
            return None
        rows = np.array(planes, np.float64)
        normal = rows[:, :3]
        return cls(normal, normal @ grid.world_from_index, rows[:, 3] - normal @ np.asarray(grid.origin, np.float64))

    def keeps(self, positions: np.ndarray, boxes: bool = False) -> np.ndarray:
        """bool [N]: whether the planes keep grid positions [N, 3]; boxes: or any part of the voxels' boxes."""
        at = positions.astype(np.float64) @ self.g.T
        place = self.place - (0.5 * np.abs(self.g).sum(axis=1) if boxes else 0.0)
        return np.asarray((at >= place - ON_PLANE * (np.abs(at) + np.abs(place))).all(axis=1))

    def meets(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """bool [N]: whether the planes may keep any position of boxes from low to high [N, 3], grid indices."""
        furthest = (np.where(self.g > 0, high[:, None], low[:, None]) * self.g).sum(axis=2)
        return np.asarray((furthest >= self.place).all(axis=1))

    def along(self, start: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Distances [P] at which rays enter and leave the kept side, and the index [P] of the plane where they enter.

        start, direction [3, P]: of the rays, grid indices.
        """
        size = np.linalg.norm(self.g, axis=1)[:, None]
        speed, apart = self.g @ direction / size, (self.place[:, None] - self.g @ start) / size
        apart = np.where(np.abs(speed) < GRAZING * np.linalg.norm(direction, axis=0), apart - FLUSH, apart)
        with np.errstate(divide="ignore", invalid="ignore"):
            at = apart / speed
        # a ray parallel to a plane is kept wholly or not at all
        still = np.where(apart > 0, np.inf, -np.inf)
        enters = np.where(speed > 0, at, np.where(speed == 0, still, -np.inf))
        leaves = np.where(speed < 0, at, np.inf)
        return enters.max(axis=0), leaves.min(axis=0), enters.argmax(axis=0)


def clip_splats(splats: Splats, planes: tuple[Plane, ...], boxes: bool = False) -> Splats:
    """Splats whose centres, or any part of their boxes, the planes keep; all splats classified after reconstruction,
    since rays are clipped. Caches the latest result.
    """
    clip = Clip.of(planes, splats.grid) if len(splats) and splats.post is None else None
    if clip is None:
        return splats
    return _latest.of(splats, (planes, boxes), lambda: clip.keeps(splats.positions, boxes))


CONDITION = "a condition such as x>0.3, x+y<1.2, z>=30mm, or X,Y,Z:NX,NY,NZ, a point and a normal"
NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?"
# compiled where they are used: that takes longer than most modules
TERM = rf"([+-]?)({NUMBER})?\*?([xyz])"
COMPARED = rf"(.+?)(>=?|<=?)([+-]?{NUMBER})([^\W\d_]*)"
ANY_UNIT = "units"
# share of a box's sides beyond which a corner lies outside, for rounding
SLACK = 1e-9


@dataclass(frozen=True, eq=False)
class ClipUnits:
    """Box to which fractions in plane conditions refer. low, high [3]: world units; unit: name of the unit."""

    low: np.ndarray
    high: np.ndarray
    unit: str = ""

    @classmethod
    def of(cls, volumes: Iterable[Volume]) -> ClipUnits:
        """Box around all volumes, in the unit of the first."""
        boxed = list(volumes)
        corners = np.concatenate([volume.corners for volume in boxed])
        return cls(corners.min(axis=0), corners.max(axis=0), boxed[0].unit)

    def meets(self, other: ClipUnits) -> bool:
        """Whether the boxes have a point in common."""
        return bool((self.low <= other.high).all() and (other.low <= self.high).all())


def parse_planes(cuts: str | Sequence[Any], box: ClipUnits) -> tuple[Plane, ...]:
    """Parses plane conditions, or rows of four numbers. Raises InputError for anything else, and if the planes clip the
    whole box.
    """
    entries = [cuts] if isinstance(cuts, str) else list(cuts)
    rows = check_planes([_parse_condition(cut, box) if isinstance(cut, str) else cut for cut in entries])
    if rows and not len(clip_corners(rows, corners_of(box.low, box.high))):
        raise expected("clip", "planes that leave something of the volume", ", ".join(map(str, entries)))
    return rows


def change_planes(planes: Sequence[Plane], change: Change) -> tuple[Plane, ...]:
    """The planes in changed coordinates."""
    a, b, c = change.turn.tolist()
    return tuple((a * x, b * y, c * z, d * change.length) for x, y, z, d in planes)


def clip_corners(cuts: Sequence[Plane], corners: np.ndarray) -> np.ndarray:
    """Corners [N, 3] of the part of a parallelepiped that planes keep. corners [8, 3]: in the order of `corners_of`."""
    sides = corners[[1, 2, 4]] - corners[0]
    size = float(np.linalg.norm(corners.max(axis=0) - corners.min(axis=0)))
    rows = [np.array(plane) for plane in cuts]
    for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        normal = np.cross(sides[b], sides[c])
        normal = normal / np.linalg.norm(normal) * np.sign(normal @ sides[a])
        rows += [np.append(normal, normal @ corners[0]), np.append(-normal, -normal @ (corners[0] + sides[a]))]
    halfspaces = np.array(rows)
    three = halfspaces[np.array(list(combinations(range(len(halfspaces)), 3)))]
    three = three[np.abs(np.linalg.det(three[..., :3])) > SLACK]
    points = np.linalg.solve(three[..., :3], three[..., 3:])[..., 0]
    inside = (points @ halfspaces[:, :3].T >= halfspaces[:, 3] - SLACK * size).all(axis=1)
    return np.asarray(points[inside])


def crop_planes(text: str, volume: Volume) -> tuple[Plane, ...]:
    """Planes around a part of a volume: A:B,C:D,E:F, Python slices of voxels along x, y, z.

    Raises InputError for other text and for empty slices.
    """
    rows = []
    for axis, (begin, end) in enumerate(crop_ends(text, volume.shape)):
        for sign, place, at_end in ((1, begin, begin == 0), (-1, end, end == volume.shape[2 - axis])):
            if not at_end:
                rows.append(index_plane(volume, axis, sign, place - 0.5))
    return check_planes(rows)


def crop_ends(text: str, shape: Sequence[int]) -> list[tuple[int, int]]:
    """First and last voxel, not included, along x, y and z, of a crop's text. Raises InputError as `crop_planes`."""
    sizes = shape[::-1]
    parts = text.replace(" ", "").split(",")
    try:
        ends = [[int(end) if end else None for end in part.split(":")] for part in parts]
    except ValueError:
        ends = []
    if len(ends) != 3 or any(len(pair) != 2 for pair in ends):
        raise expected("crop", "A:B,C:D,E:F, voxels along x, y and z, where each number is optional", repr(text))
    found = []
    for axis, (pair, size) in enumerate(zip(ends, sizes, strict=True)):
        begin, end, _ = slice(*pair).indices(size)
        if begin >= end:
            raise expected("crop", f"voxels from 0 to {size} along {'xyz'[axis]}", parts[axis])
        found.append((begin, end))
    return found


def box_planes(volume: Volume) -> list[Plane]:
    """The six planes around a volume's box."""
    sides = [(axis, size) for axis, size in enumerate(volume.shape[::-1])]
    ends = [(axis, sign, end - 0.5) for axis, size in sides for sign, end in ((1, 0), (-1, size))]
    return [index_plane(volume, *end) for end in ends]


def index_plane(volume: Volume, axis: int, sign: int, place: float) -> Plane:
    """Plane at a grid index along an axis; it keeps larger indices for sign 1, smaller ones for −1."""
    index = np.zeros(3)
    index[axis] = sign
    normal = index @ np.linalg.inv(volume.world_from_index)
    x, y, z = (float(component) for component in normal)
    return x, y, z, float(sign * place + normal @ np.asarray(volume.origin))


def _parse_condition(text: str, box: ClipUnits) -> tuple[float, ...]:
    compact = text.replace(" ", "")
    if ":" in compact:
        try:
            point, normal = (np.array([float(n) for n in part.split(",")]) for part in compact.split(":"))
            return (*normal.tolist(), float(normal @ point))
        except ValueError:
            raise expected("clip", CONDITION, repr(text)) from None
    match = re.fullmatch(COMPARED, compact, re.IGNORECASE)
    terms = re.findall(TERM, match[1], re.IGNORECASE) if match else []
    if not match or "".join("".join(term) for term in terms) != match[1].replace("*", ""):
        raise expected("clip", CONDITION, repr(text))
    normal = np.zeros(3)
    for sign, factor, axis in terms:
        normal["xyz".index(axis.lower())] += float(f"{sign}{factor or 1}")
    if not normal.any():
        raise expected("clip", CONDITION, repr(text))
    sign, number, unit = (1.0 if match[2][0] == ">" else -1.0), float(match[3]), match[4]
    if unit:
        place = number * world_units(unit, box.unit, text)
    else:
        if len(terms) == 1 and not 0 <= number / normal.sum() <= 1:
            raise expected("clip", "a fraction of the volume's box from 0 to 1, or a length with its unit", repr(text))
        # in fractions f = (x − low)/side
        normal = normal / (box.high - box.low)
        place = number + float(normal @ box.low)
    return (*(sign * normal).tolist(), sign * place)


def world_units(unit: str, volume_unit: str, text: str, what: str = "clip") -> float:
    """World units per `unit`. Raises InputError, naming `what`, for one that the volume's does not convert to."""
    if unit in (volume_unit, ANY_UNIT):
        return 1.0
    metres, world = metres_in(unit), metres_in(volume_unit)
    if metres is None or world is None:
        raise InputError(f"{what}: expected a length in {volume_unit or ANY_UNIT}, got {text!r}")
    return metres / world

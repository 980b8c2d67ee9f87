"""Vector fields: streamlines, arrows, and volumes of magnitude and direction."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from splatgl.coercion import public
from splatgl.data.mesh import SIDES, Mesh
from splatgl.data.volume import Hints, Volume
from splatgl.errors import expected
from splatgl.geometry.grid import trilinear

# distance of two points of a line, in smallest spacings, and the step between drawn points
STEP, DRAWN = 0.25, 2
# candidates for each drawn line
TRIED = 3
# a tube's radius, in diagonals; and the length of the longest line
RADIUS, LONGEST = 1 / 500, 2.0
# share of the greatest speed below which nothing moves
STILL = 1e-6
# of samples that are compared with speeds
SPARSE = 4
LINE_COUNT, MOST = 200, 10_000
COLORMAP = "viridis"


@dataclass(frozen=True, eq=False)
class Streamlines:
    """Streamlines: points [N, 3] of each, world units, in the direction of flow, and the speeds [N] there."""

    points: list[np.ndarray]
    speeds: list[np.ndarray]


@public
def streamlines(
    volume: Volume | Any,
    count: int = LINE_COUNT,
    radius: float | None = None,
    colormap: str = COLORMAP,
    least: float | None = None,
    opacity: float = 1.0,
) -> Mesh:
    """Tubes along a volume's vectors, up to `count`, coloured by speed from 0 to the greatest.

    Seeds are voxels faster than `least`, each as far as possible from all previous lines. Lines end where the flow is
    slower, at the volume's outermost samples, or at a length of twice the diagonal. radius: world units; None: a
    five-hundredth of the diagonal. least: None: a tenth of the greatest speed (of 99.9 % of the voxels). Raises
    InputError for a volume without vectors.
    """
    field = VectorField.of(volume)
    lines = spread_lines(volume, check_count(count), least)
    size = RADIUS * field.diagonal if radius is None else radius
    drawn = [np.append(np.arange(0, len(line) - 1, DRAWN), len(line) - 1) for line in lines.points]
    points = [line[some] for line, some in zip(lines.points, drawn, strict=True)]
    speed = np.concatenate([np.zeros(0), *(speed[some] for speed, some in zip(lines.speeds, drawn, strict=True))])
    look = _speed_look(volume, field, np.repeat(speed, SIDES), colormap)
    return Mesh.of_lines(points, size, opacity=opacity, name="streamlines", frame=volume.frame, **look)


def spread_lines(volume: Volume, count: int, least: float | None = None) -> Streamlines:
    """The evenly distributed lines that `streamlines` draws."""
    field = VectorField.of(volume)
    slow = least_speed(field, least)
    seeds = field.spread(TRIED * count, slow)
    tried = lines_through(field, seeds, slow)
    place, far = field.world(seeds), np.full(len(seeds), np.inf)
    long_ = np.array([len(line) > 1 for line in tried.points], bool)
    chosen: list[int] = []
    while len(chosen) < min(count, int(long_.sum())):
        # the seed farthest from all chosen lines, which are excluded
        far[chosen], far[~long_] = -1.0, -1.0
        best = int(far.argmax())
        chosen.append(best)
        near = tried.points[best]
        step = max(int(1 / STEP), 1)
        apart = ((place[:, None] - near[None, ::step]) ** 2).sum(axis=2).min(axis=1)
        far = np.minimum(far, apart)
    return Streamlines([tried.points[n] for n in chosen], [tried.speeds[n] for n in chosen])


def lines_through(
    field: VectorField, seeds: np.ndarray, least: float = 0.0, length: float | None = None, step: float = STEP
) -> Streamlines:
    """Lines through seeds [N, 3], grid positions (x, y, z), in both directions, by the fourth-order Runge–Kutta method.

    length: in both directions together, world units; None: twice the diagonal. step: in smallest spacings. Lines end
    where the speed is below `least` or 0, and at the outermost samples.
    """
    slow = max(least, STILL * field.greatest)
    world = step * field.smallest_spacing
    count = int(np.ceil((LONGEST * field.diagonal if length is None else length) / 2 / world))
    ways = [_follow(field, seeds, sign * world, count, slow) for sign in (-1.0, 1.0)]
    points, speeds = [], []
    for before, after in zip(*ways, strict=True):
        index = np.concatenate([before[:0:-1], after])
        points.append(field.world(index))
        speeds.append(np.linalg.norm(field.at(index)[0], axis=1))
    return Streamlines(points, speeds)


def _follow(field: VectorField, seeds: np.ndarray, step: float, count: int, slow: float) -> list[np.ndarray]:
    """Grid positions [M, 3] along each seed's line, at steps of equal world length."""
    inverse = np.linalg.inv(field.world_from_index)

    def slope(place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        vectors, inside = field.at(place)
        speed = np.linalg.norm(vectors, axis=1)
        return (vectors / np.where(speed > 0, speed, 1.0)[:, None]) @ inverse.T, inside & (speed >= slow) & (speed > 0)

    place, on = seeds.astype(np.float64), np.arange(len(seeds))
    paths, owners = [place], [on]
    for _ in range(count):
        a, fine = slope(place)
        b, fine_b = slope(place + step / 2 * a)
        c, fine_c = slope(place + step / 2 * b)
        d, fine_d = slope(place + step * c)
        place = place + step / 6 * (a + 2 * b + 2 * c + d)
        fine &= fine_b & fine_c & fine_d & slope(place)[1]
        place, on = place[fine], on[fine]
        if not len(on):
            break
        paths.append(place)
        owners.append(on)
    order = np.argsort(np.concatenate(owners), kind="stable")
    ends = np.cumsum(np.bincount(np.concatenate(owners), minlength=len(seeds)))[:-1]
    return np.split(np.concatenate(paths)[order], ends)


def check_count(count: int) -> int:
    """Checks a number of lines or arrows. Raises InputError unless it is a whole number from 1 to MOST."""
    if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= MOST:
        raise expected("count", f"a whole number from 1 to {MOST}", repr(count)[:80])
    return count


# an arrow of length 1: start of its head, radii of shaft and head, and number of sides
HEAD, SHAFT, WIDE, ARROW_SIDES = 0.6, 0.05, 0.14, 10
# length of the longest, in mean distances between arrows
LENGTH = 2.0
ARROW_COUNT = 400


@public
def arrows(
    volume: Volume | Any,
    count: int = ARROW_COUNT,
    length: float | None = None,
    colormap: str = COLORMAP,
    least: float | None = None,
    opacity: float = 1.0,
) -> Mesh:
    """Arrows centred on up to `count` evenly distributed voxels faster than `least`; length and colour show the speed,
    from 0 to the greatest.

    length: of the greatest speed (of 99.9 % of the voxels), world units; None: twice the mean distance between
    arrows. least: None: a tenth of that speed. Raises InputError for a volume without vectors.
    """
    field = VectorField.of(volume)
    slow = least_speed(field, least)
    index = field.spread(check_count(count), slow)
    vectors = field.at(index)[0]
    speed = np.linalg.norm(vectors, axis=1)
    if length is None:
        room = (field.speed > slow).sum() * abs(float(np.linalg.det(field.world_from_index)))
        length = LENGTH * float(room / max(len(index), 1)) ** (1 / 3)
    vertices, faces = _arrow()
    axes = _axes(vectors / np.where(speed > 0, speed, 1.0)[:, None]) * (speed / field.greatest * length)[:, None, None]
    placed = field.world(index)[:, None] + vertices @ axes
    offsets = np.arange(len(index))[:, None, None] * len(vertices)
    look = _speed_look(volume, field, np.repeat(speed, len(vertices)), colormap)
    every = (faces + offsets).reshape(-1, 3)
    return Mesh(placed.reshape(-1, 3), every, opacity=opacity, name="arrows", frame=volume.frame, **look)


def _axes(along: np.ndarray) -> np.ndarray:
    """Orthonormal axes [N, 3, 3] whose first are the unit vectors `along` [N, 3]."""
    helper = np.eye(3)[np.abs(along).argmin(axis=1)] if len(along) else along
    side = np.cross(along, helper)
    side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-300)
    return np.stack([along, side, np.cross(along, side)], axis=1)


def _arrow() -> tuple[np.ndarray, np.ndarray]:
    """Vertices [N, 3] and faces [M, 3] of a closed arrow along x from −½ to ½."""
    turn = 2 * np.pi * np.arange(ARROW_SIDES) / ARROW_SIDES
    circle = np.stack([np.zeros(ARROW_SIDES), np.cos(turn), np.sin(turn)], axis=1)
    place = np.array([1.0, 0.0, 0.0])
    rings = [circle * SHAFT, circle * SHAFT + HEAD * place, circle * WIDE + HEAD * place]
    vertices = np.concatenate([*rings, [place * 0.0, place]]) - place / 2
    here, then = np.arange(ARROW_SIDES), (np.arange(ARROW_SIDES) + 1) % ARROW_SIDES
    tail, tip = np.full(ARROW_SIDES, 3 * ARROW_SIDES), np.full(ARROW_SIDES, 3 * ARROW_SIDES + 1)
    faces = [
        np.stack([tail, then, here], axis=1),
        np.stack([here + 2 * ARROW_SIDES, then + 2 * ARROW_SIDES, tip], axis=1),
    ]
    for first in (0, ARROW_SIDES):
        a, b = here + first, then + first
        faces += [np.stack([a, b, b + ARROW_SIDES], axis=1), np.stack([a, b + ARROW_SIDES, a + ARROW_SIDES], axis=1)]
    return vertices, np.concatenate(faces)


# share of the greatest speed below which nothing is drawn; share of samples that may exceed the greatest speed
SLOW, OUTLIERS = 0.1, 1e-3
# samples among which points are chosen
CANDIDATES = 1 << 14


@dataclass(frozen=True, eq=False)
class VectorField:
    """Vectors float64 [D, H, W, 3] along world axes, per sample; 0 where they are not finite. speed [D, H, W].

    world_from_index [3, 3], origin [3]: as of volumes.
    """

    vectors: np.ndarray
    speed: np.ndarray
    world_from_index: np.ndarray
    origin: np.ndarray

    @classmethod
    def of(cls, volume: Volume) -> VectorField:
        """Vector field of a volume. Raises InputError for a volume without vectors, or with none that is finite and not
        zero.
        """
        name = volume.name or "volume"
        if volume.vectors is None:
            raise expected(name, "vectors, such as a velocity at each voxel", "none")
        vectors = np.asarray(volume.vectors, np.float64)
        vectors = np.where(np.isfinite(vectors).all(axis=-1, keepdims=True), vectors, 0.0)
        speed = np.linalg.norm(vectors, axis=-1)
        if not 0 < speed.max() < np.inf:
            raise expected(name, "vectors, some of which are not zero", "none")
        return cls(vectors, speed, volume.world_from_index, np.asarray(volume.origin, np.float64))

    @property
    def greatest(self) -> float:
        """The greatest speed, without the OUTLIERS fastest samples."""
        fast = float(np.quantile(self.speed, 1 - OUTLIERS))
        return fast if fast > 0 else float(self.speed.max())

    @property
    def smallest_spacing(self) -> float:
        """World length of the shortest index step."""
        return float(np.linalg.norm(self.world_from_index, axis=0).min())

    @property
    def diagonal(self) -> float:
        """World length across the box of samples."""
        size = np.array(self.speed.shape[::-1])
        return float(np.linalg.norm(self.world_from_index @ size))

    def at(self, index: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Vectors [N, 3] at grid positions [N, 3] (x, y, z), linear between samples; and whether these are inside."""
        last = np.array(self.speed.shape[::-1]) - 1
        inside = np.asarray(((index >= -1e-9) & (index <= last + 1e-9)).all(axis=1))
        return trilinear(self.vectors, np.nan_to_num(index)), inside

    def world(self, index: np.ndarray) -> np.ndarray:
        """World points [..., 3] of grid positions."""
        return np.asarray(index @ self.world_from_index.T + self.origin)

    def spread(self, count: int, least: float) -> np.ndarray:
        """At most `count` samples [N, 3] (x, y, z), evenly distributed over those faster than `least`; deterministic.

        The first is the fastest; each further one is farthest from all previous ones.
        """
        z, y, x = np.nonzero(self.speed > least)
        index = np.stack([x, y, z], axis=1)[:: max(len(x) // CANDIDATES, 1)]
        place = self.world(index.astype(np.float64))
        chosen = [int(self.speed[tuple(index[:, ::-1].T)].argmax())] if len(index) else []
        far = np.full(len(index), np.inf)
        while 0 < len(chosen) < min(count, len(index)):
            far = np.minimum(far, ((place - place[chosen[-1]]) ** 2).sum(axis=1))
            chosen.append(int(far.argmax()))
        return index[chosen[:count]].astype(np.float64)


def least_speed(field: VectorField, least: float | None) -> float:
    """The speed below which nothing is drawn; None: SLOW times the maximum. Raises InputError for invalid numbers."""
    if least is None:
        return SLOW * field.greatest
    if not 0 <= least < np.inf:
        raise expected("least", "a speed from 0 on", least)
    return float(least)


def _named_speed(volume: Volume, field: VectorField) -> dict[str, str]:
    """Quantity and unit of the vectors' lengths: those of the volume, if these are its values."""
    few = np.s_[::SPARSE, ::SPARSE, ::SPARSE]
    are_values = np.allclose(np.asarray(volume.samples[few], np.float64), field.speed[few], equal_nan=True)
    named = {"quantity": volume.quantity or "speed", "value_unit": volume.value_unit}
    return named if are_values else {"quantity": "speed", "value_unit": ""}


def _speed_look(volume: Volume, field: VectorField, speed: np.ndarray, name: str) -> dict[str, Any]:
    """Options of a mesh whose vertices have speeds [N], in a colour map from 0 to the greatest."""
    quantity = ", ".join(filter(None, _named_speed(volume, field).values()))
    values = speed if len(speed) else None
    return {"values": values, "colormap": name, "window": (0.0, field.greatest), "quantity": quantity}


@public
def magnitudes(volume: Volume | Any) -> Volume:
    """Volume of the lengths of a volume's vectors. Raises InputError for a volume without vectors."""
    field = VectorField.of(volume)
    about = {"name": f"{volume.name}: magnitude", **_named_speed(volume, field)}
    return replace(volume, samples=field.speed.astype(np.float32), color=None, labels=None, hints=Hints(), **about)


@public
def directions(volume: Volume | Any) -> Volume:
    """Volume of the lengths of a volume's vectors, coloured by direction: red, green and blue are the shares along
    world x, y and z, as in diffusion imaging; opposite directions have the same colour. Raises InputError as
    `magnitudes`.
    """
    field = VectorField.of(volume)
    share = np.abs(field.vectors) / np.where(field.speed > 0, field.speed, 1.0)[..., None]
    lengths = magnitudes(volume)
    slow, fast = SLOW * field.greatest, field.greatest
    hints = Hints(points=((slow, 0.0), (fast, 0.6)), window=(0.0, fast))
    return replace(lengths, color=np.rint(share * 255).astype(np.uint8), name=f"{volume.name}: direction", hints=hints)

"""Streamlines of a volume's vectors as tubes, spread evenly, coloured by speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from splatgl.data.mesh import SIDES, Mesh
from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.splat.flow.vectors import VectorField, colors_of, slowest

# smallest spacings between two points of a line, and every how many of them are drawn
STEP, DRAWN = 0.25, 2
# lines that are followed for each that is drawn
TRIED = 3
# a tube's radius, in diagonals; and the length of the longest line
RADIUS, LONGEST = 1 / 500, 2.0
# share of the greatest speed below which nothing moves
STILL = 1e-6
COUNT, MOST = 200, 10_000
COLORMAP = "viridis"


@dataclass(frozen=True, eq=False)
class Lines:
    """Lines [N, 3], world units, in the direction of flow, and the speeds [N] of their points."""

    points: list[np.ndarray]
    speeds: list[np.ndarray]


def streamlines(
    volume: Volume,
    count: int = COUNT,
    radius: float | None = None,
    colormap: str = COLORMAP,
    least: float | None = None,
    opacity: float = 1.0,
) -> Mesh:
    """Tubes along a volume's vectors, up to `count`, coloured by speed from 0 to the greatest.

    They begin at voxels faster than `least`, each as far from the lines before it as can be, and end where the flow is
    slower, at the volume's outermost samples, or after twice its diagonal, both ways together. radius: world units,
    None: a five-hundredth of the diagonal. least: None: a tenth of the greatest speed (of 99.9 % of the voxels).
    Raises InputError for a volume without vectors.
    """
    field = VectorField.of(volume)
    lines = spread_lines(volume, checked(count), least)
    size = RADIUS * field.diagonal if radius is None else radius
    points = [
        line[::DRAWN] if len(line) % DRAWN else np.append(line[::DRAWN], line[-1:], axis=0) for line in lines.points
    ]
    speeds = [each[::DRAWN] if len(each) % DRAWN else np.append(each[::DRAWN], each[-1:]) for each in lines.speeds]
    speed = np.concatenate([np.zeros(0), *speeds])
    colors = np.repeat(colors_of(speed, field.greatest, colormap), SIDES, axis=0)
    return Mesh.of_lines(
        points, size, colors=colors if len(colors) else None, opacity=opacity, name="streamlines", frame=volume.frame
    )


def spread_lines(volume: Volume, count: int, least: float | None = None) -> Lines:
    """The lines that `streamlines` draws."""
    field = VectorField.of(volume)
    slow = slowest(field, least)
    seeds = field.spread(TRIED * count, slow)
    tried = lines_through(field, seeds, slow)
    place, far = field.world(seeds), np.full(len(seeds), np.inf)
    long_ = np.array([len(line) > 1 for line in tried.points], bool)
    chosen: list[int] = []
    while len(chosen) < min(count, int(long_.sum())):
        # where no line is near yet; a line that is drawn is not drawn again
        far[chosen], far[~long_] = -1.0, -1.0
        best = int(far.argmax())
        chosen.append(best)
        near = tried.points[best]
        step = max(int(1 / STEP), 1)
        apart = ((place[:, None] - near[None, ::step]) ** 2).sum(axis=2).min(axis=1)
        far = np.minimum(far, apart)
    return Lines([tried.points[n] for n in chosen], [tried.speeds[n] for n in chosen])


def lines_through(
    field: VectorField, seeds: np.ndarray, least: float = 0.0, length: float | None = None, step: float = STEP
) -> Lines:
    """The lines through seeds [N, 3], grid positions (x, y, z), by Runge and Kutta's method of fourth order, both ways.

    length: of both ways together, world units, None: twice the diagonal. step: in smallest spacings. They end where the
    speed is below `least` or nothing moves, and at the outermost samples.
    """
    slow = max(least, STILL * field.greatest)
    world = step * field.smallest_spacing
    count = int(np.ceil((LONGEST * field.diagonal if length is None else length) / 2 / world))
    ways = [_followed(field, seeds, sign * world, count, slow) for sign in (-1.0, 1.0)]
    points, speeds = [], []
    for before, after in zip(*ways, strict=True):
        index = np.concatenate([before[:0:-1], after])
        points.append(field.world(index))
        speeds.append(np.linalg.norm(field.at(index)[0], axis=1))
    return Lines(points, speeds)


def _followed(field: VectorField, seeds: np.ndarray, step: float, count: int, slow: float) -> list[np.ndarray]:
    """Grid positions [M, 3] on from each seed, at steps of equal world length."""
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


def checked(count: int) -> int:
    """A number of lines or arrows. Raises InputError for others."""
    if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= MOST:
        raise expected("count", f"a whole number from 1 to {MOST}", repr(count)[:80])
    return count

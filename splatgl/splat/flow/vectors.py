"""A volume's vectors between its samples, where they are fast, points spread evenly there, and colours of speeds."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from splatgl.data.color import srgb_from_linear
from splatgl.data.volume import Hints, Volume
from splatgl.errors import expected
from splatgl.splat.classification.colormap import colormap

# share of the vectors' greatest speed below which nothing is drawn, and the share of samples that may be faster than
# what counts as the greatest
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
        """Raises InputError for a volume without vectors, and for vectors of which none is finite and not zero."""
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
        """What counts as the greatest speed: few samples are faster."""
        found = float(np.quantile(self.speed, 1 - OUTLIERS))
        return found if found > 0 else float(self.speed.max())

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
        """Vectors [N, 3] at grid positions [N, 3] (x, y, z), linear between samples, and whether these are inside."""
        last = np.array(self.speed.shape[::-1]) - 1
        inside = np.asarray(((index >= -1e-9) & (index <= last + 1e-9)).all(axis=1))
        place = np.clip(np.nan_to_num(index), 0, last)
        first = np.minimum(place.astype(np.int64), np.maximum(last - 1, 0))
        part, found = place - first, np.zeros(index.shape)
        for corner in np.ndindex(2, 2, 2):
            weight = np.where(corner, part, 1 - part).prod(axis=1)
            x, y, z = np.minimum(first + corner, last).T
            found += weight[:, None] * self.vectors[z, y, x]
        return found, inside

    def world(self, index: np.ndarray) -> np.ndarray:
        """World points [..., 3] of grid positions."""
        return np.asarray(index @ self.world_from_index.T + self.origin)

    def spread(self, count: int, least: float) -> np.ndarray:
        """Up to so many samples [N, 3] (x, y, z), spread evenly over those faster than `least`, always the same ones.

        The first is the fastest; each further one is farthest from all before it.
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


def slowest(field: VectorField, least: float | None) -> float:
    """The speed below which nothing is drawn. Raises InputError for numbers that are none."""
    if least is None:
        return SLOW * field.greatest
    if not 0 <= least < np.inf:
        raise expected("least", "a speed from 0 on", least)
    return float(least)


def colors_of(speed: np.ndarray, greatest: float, name: str) -> np.ndarray:
    """sRGB uint8 [N, 3] of speeds from 0 to the greatest, by a colour map."""
    table = colormap(name)
    place = np.clip(speed / greatest, 0.0, 1.0) * (len(table) - 1)
    below = np.minimum(place.astype(np.int64), len(table) - 2)
    part = (place - below)[:, None]
    linear = table[below] * (1 - part) + table[below + 1] * part
    return np.asarray(np.rint(srgb_from_linear(linear) * 255), np.uint8)


def magnitudes(volume: Volume) -> Volume:
    """The lengths of a volume's vectors, as its values. Raises InputError for a volume without vectors."""
    field = VectorField.of(volume)
    name = f"{volume.name}: magnitude"
    return replace(volume, samples=field.speed.astype(np.float32), color=None, labels=None, hints=Hints(), name=name)


def directions(volume: Volume) -> Volume:
    """The lengths of a volume's vectors, as its values, coloured by direction: red, green and blue are the shares along
    world x, y and z, as in diffusion imaging; opposite directions are alike. Raises InputError as `magnitudes`.
    """
    field = VectorField.of(volume)
    share = np.abs(field.vectors) / np.where(field.speed > 0, field.speed, 1.0)[..., None]
    found = magnitudes(volume)
    slow, fast = SLOW * field.greatest, field.greatest
    hints = Hints(points=((slow, 0.0), (fast, 0.6)), window=(0.0, fast))
    return replace(found, color=np.rint(share * 255).astype(np.uint8), name=f"{volume.name}: direction", hints=hints)

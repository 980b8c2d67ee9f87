"""Values that blends of one value show along rays, and where the field has them, in float64."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from splatgl.reference.march import PARTS, Best, LayerRays, walk
from splatgl.reference.matter import ValueMatter
from splatgl.splat.settings import Settings

# values [P] and their depths [P]; NaN for none
Found = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True, eq=False)
class Shown:
    """Values that blends of one value show along rays: of the layer whose value is the most opaque. layer [P]: its
    position in the list of layers; value, depth [P]: NaN where all is transparent.
    """

    layer: np.ndarray
    value: np.ndarray
    depth: np.ndarray

    @classmethod
    def of(cls, layers: Sequence[LayerRays], settings: Settings, count: int) -> Self:
        """Of layers along `count` rays, in the blend of the settings."""
        most, layer = np.zeros(count), np.zeros(count, np.int64)
        value, depth = np.full((2, count), np.nan)
        for number, rays in enumerate(layers):
            values, depths = shown_value(rays, settings.join, settings.mip_attenuation)
            opacity = np.nan_to_num(rays.layer.matter.opacity(values))
            better = np.flatnonzero(opacity > most)
            most[better], layer[better] = opacity[better], number
            value[better], depth[better] = values[better], depths[better]
        return cls(layer, value, depth)


def shown_value(layer: LayerRays, join: str, attenuation: float) -> Found:
    """Values that a blend of one value shows of a layer, and the first depths where the field has them. join: as of the
    blend; attenuation: per reference length.
    """
    if join == "attenuated":
        return _attenuated(layer, attenuation)
    return _mean(layer) if join == "mean" else _extreme(layer, 1.0 if join == "max" else -1.0)


def _extreme(layer: LayerRays, sign: float) -> Found:
    """The largest values along rays, or for a sign of −1 the least."""
    count = len(layer.near)
    best, depth = Best(np.full(count, -np.inf), sign), np.full(count, np.nan)

    def visit(rays: np.ndarray, ends: np.ndarray) -> np.ndarray:
        ends = np.clip(ends, layer.near[rays], layer.far[rays])
        # the value of the voxel that the ray enters there
        at = (ends + np.concatenate([ends[1:], ends[-1:]])) / 2 if layer.layer.is_boxes else ends
        values = np.nan_to_num(layer.values(at, rays) * sign, nan=-np.inf)
        if layer.layer.is_boxes:
            # a plane between voxels belongs to neither
            values[at == ends] = -np.inf
        place = values.argmax(axis=0), np.arange(len(rays))
        better = values[place] > best.value[rays]
        best.value[rays[better]], depth[rays[better]] = values[place][better], ends[place][better]
        return np.ones(len(rays), bool)

    walk([layer], visit, best)
    rays = np.flatnonzero(np.isfinite(depth))
    for scale in () if layer.layer.is_boxes else (1.0, 1 / PARTS):
        near = np.arange(-PARTS, PARTS + 1)[:, None] / PARTS * (scale * layer.step[rays])
        visit(rays, depth[rays] + near)
    return np.where(np.isfinite(depth), best.value * sign, np.nan), depth


def _ends(layer: LayerRays, rays: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values [2, K, N] at both ends of pieces between depths [K + 1, N] of rays [N], their lengths [K, N], 0 without
    values, and the depths within the layer.
    """
    ends = np.clip(ends, layer.near[rays], layer.far[rays])
    values = layer.values(ends, rays)
    both = np.stack([values[:-1], values[1:]])
    both = np.where(np.isnan(both), both[::-1], both)
    return both, np.where(np.isfinite(both[0]), np.diff(ends, axis=0), 0.0), ends


def _attenuated(layer: LayerRays, attenuation: float) -> Found:
    """Values of the largest attenuated shares of the colours' window."""
    count, matter = len(layer.near), layer.layer.matter
    assert isinstance(matter, ValueMatter)
    low, high = matter.post.transfer.color_range
    width = (high - low) or matter.post.span
    best, passed = Best(np.full(count, -np.inf), 0.0), np.zeros(count)
    shown, depth = np.full((2, count), np.nan)

    def visit(rays: np.ndarray, ends: np.ndarray) -> np.ndarray:
        values, length, ends = _ends(layer, rays, ends)
        shares = np.clip((np.nan_to_num(values, nan=low) - low) / width, 0.0, 1.0)
        through = shares.mean(axis=0) * length * layer.length[rays] * (attenuation / layer.layer.splats.unit)
        before = passed[rays] + np.cumsum(np.pad(through, ((1, 0), (0, 0))), axis=0)
        passed[rays] = before[-1]
        for side, share in enumerate(shares):
            seen = np.where(length > 0, share * np.exp(-before[side : side + len(share)]), -np.inf)
            place = seen.argmax(axis=0), np.arange(len(rays))
            better = seen[place] > best.value[rays]
            best.value[rays[better]], shown[rays[better]] = seen[place][better], values[side][place][better]
            depth[rays[better]] = ends[place[0] + side, place[1]][better]
        return np.ones(len(rays), bool)

    walk([layer], visit, best)
    return shown, depth


def _mean(layer: LayerRays) -> Found:
    """Mean values over rays' lengths."""
    count = len(layer.near)
    every, depth, sums = Best(np.full(count, -np.inf), 0.0), np.full(count, np.nan), np.zeros((2, count))

    def add(rays: np.ndarray, ends: np.ndarray) -> np.ndarray:
        values, length, _ = _ends(layer, rays, ends)
        sums[:, rays] += np.stack([np.nan_to_num(values.mean(axis=0)) * length, length]).sum(axis=1)
        return np.ones(len(rays), bool)

    walk([layer], add, every)
    shown = np.where(sums[1] > 0, sums[0], np.nan) / np.where(sums[1] > 0, sums[1], 1.0)

    def meet(rays: np.ndarray, ends: np.ndarray) -> np.ndarray:
        values, length, ends = _ends(layer, rays, ends)
        apart = values - shown[rays]
        meets = (apart[0] * apart[1] <= 0) & (length > 0)
        some = np.flatnonzero(meets.any(axis=0))
        place = meets[:, some].argmax(axis=0), some
        rise = apart[1][place] - apart[0][place]
        share = np.clip(-apart[0][place] / np.where(rise == 0, 1.0, rise), 0.0, 1.0)
        depth[rays[some]] = ends[place] + share * (ends[place[0] + 1, some] - ends[place])
        return ~meets.any(axis=0)

    walk([layer], meet, every)
    return shown, depth

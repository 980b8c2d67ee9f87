"""The opacity curve: its nodes, its scale that is fine near zero, and the values' histogram."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from splatgl.splat.statistics import Statistics
from splatgl.splat.transfer import Nodes, Transfer

# opacities below this share about as much of the axis as each decade above it
FINE = 0.01
# opacities with numbers along the axis
TICKS = (0.0, 0.01, 0.03, 0.1, 0.3, 1.0)
# points of the drawn line between two nodes
SAMPLES = 16
BINS = 128
# percentiles of the values for the initial range
ENDS = (0.0, 99.95)


def rise(opacity: ArrayLike) -> np.ndarray:
    """Opacity to height as a fraction of the axis: linear near zero, logarithmic above FINE."""
    return np.asarray(np.arcsinh(np.asarray(opacity, np.float64) / FINE) / np.arcsinh(1.0 / FINE))


def fall(height: float) -> float:
    """Inverse of `rise`: height fraction to opacity; 0 and 1 are exact."""
    return float(np.clip(np.sinh(height * np.arcsinh(1.0 / FINE)) * FINE, 0.0, 1.0)) if height < 1.0 else 1.0


def line(transfer: Transfer, low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
    """Values [n] and heights [n] of the curve from low to high: straight in opacity, constant beyond its ends."""
    nodes = transfer.points
    ends = ((min(low, nodes[0][0]), nodes[0][1]), *nodes, (max(high, nodes[-1][0]), nodes[-1][1]))
    share = np.linspace(0.0, 1.0, SAMPLES)[:, None]
    found = [np.array(start) * (1.0 - share) + np.array(stop) * share for start, stop in pairwise(ends)]
    values, opacities = np.concatenate(found).T
    if transfer.logarithmic:
        opacities = transfer.opacity(values)
    return np.ascontiguousarray(values), rise(opacities)


def values_of(stats: Statistics) -> tuple[float, float]:
    """Initial range of the axis of values."""
    if stats.constant:
        value = float(stats.values[0]) if len(stats.values) else 0.0
        return value - 0.5, value + 0.5
    low, high = (stats.percentile(end) for end in ENDS)
    return (low, high) if low < high else (float(stats.values[0]), float(stats.values[-1]))


def histogram(stats: Statistics, low: float, high: float, logarithmic: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Edges [n + 1] and heights [n] in [0, 1] of the values' counts between low and high.

    For integer values, every bin covers the same number of them. logarithmic: heights by the counts' logarithms.
    """
    edges = np.linspace(low, high, BINS + 1)
    if len(stats.values) and (stats.values[:: 1 + len(stats.values) // 1000] % 1 == 0).all():
        step = max(1.0, np.ceil((high - low) / BINS))
        edges = np.arange(np.floor(low), high + step, step)
    counts, _ = np.histogram(stats.values, edges)
    heights = np.log1p(counts) if logarithmic else counts
    return edges, np.asarray(heights / max(float(heights.max()), 1e-9))


def moved(nodes: Nodes, index: int, node: tuple[float, float]) -> Nodes:
    """The nodes with one moved; it stays between its neighbours."""
    low = nodes[index - 1][0] if index else -np.inf
    high = nodes[index + 1][0] if index + 1 < len(nodes) else np.inf
    there = (float(np.clip(node[0], low, high)), float(np.clip(node[1], 0.0, 1.0)))
    return (*nodes[:index], there, *nodes[index + 1 :])


def added(nodes: Nodes, node: tuple[float, float]) -> tuple[Nodes, int]:
    """The nodes with one added, and its index."""
    index = int(np.searchsorted([value for value, _ in nodes], node[0]))
    return (*nodes[:index], node, *nodes[index:]), index


def removed(nodes: Nodes, index: int) -> Nodes:
    """The nodes with one removed; the last one is never removed."""
    return nodes if len(nodes) == 1 else (*nodes[:index], *nodes[index + 1 :])

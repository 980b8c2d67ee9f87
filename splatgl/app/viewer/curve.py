"""Editing the opacity curve: nodes on a canvas over the values' histogram. Independent of any window."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from splatgl.splat.classification.statistics import Statistics
from splatgl.splat.classification.transfer import Nodes

# opacities below this share about as much canvas height as each decade above it
FINE = 0.01
# picking distance of a node in pixels
NEAR = 9.0
BINS = 128
# percentiles of the values for the initial range
ENDS = (0.0, 99.95)


@dataclass(frozen=True)
class Canvas:
    """A screen rectangle, upper left corner and size in pixels, for values low … high."""

    left: float
    top: float
    width: float
    height: float
    low: float
    high: float

    def place(self, value: float, opacity: float) -> tuple[float, float]:
        """Position of a node in pixels."""
        across = (value - self.low) / (self.high - self.low)
        return self.left + across * self.width, self.top + (1.0 - rise(opacity)) * self.height

    def node(self, place: tuple[float, float]) -> tuple[float, float]:
        """(value, opacity) of a pixel position, inside or outside the canvas."""
        across = (place[0] - self.left) / self.width
        opacity = fall(float(np.clip(1.0 - (place[1] - self.top) / self.height, 0.0, 1.0)))
        return self.low + across * (self.high - self.low), opacity

    def zoomed(self, at: float, factor: float) -> Canvas:
        """The canvas with its value range scaled by `factor` about the value at x = `at`."""
        value = self.node((at, self.top))[0]
        return replace(self, low=value + (self.low - value) * factor, high=value + (self.high - value) * factor)


def rise(opacity: float) -> float:
    """Opacity to height as a fraction of the canvas: linear near zero, logarithmic above FINE."""
    return float(np.arcsinh(opacity / FINE) / np.arcsinh(1.0 / FINE))


def fall(height: float) -> float:
    """Inverse of `rise`: height fraction to opacity; 0 and 1 are exact."""
    return float(np.clip(np.sinh(height * np.arcsinh(1.0 / FINE)) * FINE, 0.0, 1.0)) if height < 1.0 else 1.0


def values_of(stats: Statistics) -> tuple[float, float]:
    """Initial value range of a canvas."""
    if stats.constant:
        value = float(stats.values[0]) if len(stats.values) else 0.0
        return value - 0.5, value + 0.5
    low, high = (stats.percentile(end) for end in ENDS)
    return (low, high) if low < high else (float(stats.values[0]), float(stats.values[-1]))


def histogram(stats: Statistics, low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
    """Edges [n + 1] and heights [n] in [0, 1] of the values' counts between low and high, on a log scale.

    For integer values, every bin covers the same number of them.
    """
    edges = np.linspace(low, high, BINS + 1)
    if len(stats.values) and (stats.values[:: 1 + len(stats.values) // 1000] % 1 == 0).all():
        step = max(1.0, np.ceil((high - low) / BINS))
        edges = np.arange(np.floor(low), high + step, step)
    counts, _ = np.histogram(stats.values, edges)
    return edges, np.asarray(np.log1p(counts) / np.log1p(max(int(counts.max()), 1)))


def nearest(nodes: Nodes, canvas: Canvas, place: tuple[float, float]) -> int | None:
    """Index of the node under the cursor, or None."""
    apart = [float(np.hypot(*np.subtract(canvas.place(*node), place))) for node in nodes]
    closest = int(np.argmin(apart))
    return closest if apart[closest] <= NEAR else None


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

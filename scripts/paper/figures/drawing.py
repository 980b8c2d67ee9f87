"""Styles and marks of the paper's figures: lines by the rows of Table 1, dimensions, isolines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.report.diagram import BLACK, BLUE, GREEN, ORANGE, RED

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PALE = "#c4c4c4"
LINES: dict[str, dict[str, Any]] = {
    "row1": {"color": BLACK, "linestyle": "-"},
    "row2": {"color": ORANGE, "linestyle": (0, (1, 1))},
    "row4": {"color": BLUE, "linestyle": (0, (5, 1.5))},
    "row5": {"color": RED, "linestyle": "-"},
    "b": {"color": GREEN, "linestyle": (0, (5, 1.5, 1, 1.5))},
    "bprime": {"color": BLACK, "linestyle": (0, (1, 1.2))},
}


def bare(axes: Axes, x: tuple[float, float], y: tuple[float, float]) -> None:
    """Sets the limits, and an equal aspect ratio; removes frame and ticks."""
    axes.set(xlim=x, ylim=y, aspect="equal")
    axes.set_axis_off()


def draw_eye(axes: Axes, below: float) -> None:
    """Draws the eye, a dot at the origin, with its name `below`."""
    axes.plot(0, 0, "o", color=BLACK, ms=4)
    axes.text(0, -below, "eye", ha="center", va="top")


def measure(axes: Axes, start: tuple[float, float], end: tuple[float, float], color: str = BLACK) -> None:
    """A double-headed arrow between two points, as a dimension line."""
    arrow = {"arrowstyle": "<|-|>,head_width=0.12,head_length=0.25", "color": color, "lw": 0.7, "shrinkA": 0}
    axes.annotate("", end, start, arrowprops={**arrow, "shrinkB": 0}, annotation_clip=False)


def draw_isolines(
    axes: Axes, surface: tuple[np.ndarray, ...], levels: Sequence[float], line: dict[str, Any], width: float
) -> None:
    """Draws isolines of a surface (x, y, value) in a style of LINES."""
    axes.contour(*surface, levels, colors=[line["color"]], linestyles=[line["linestyle"]], linewidths=width)


def plain(text: str) -> dict[str, Any]:
    """Text style: centred on its point, on white, to hide lines behind it."""
    box = {"facecolor": "white", "edgecolor": "none", "pad": 0.8}
    return {"s": text, "ha": "center", "va": "center", "bbox": box}

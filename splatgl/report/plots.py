"""Style of Matplotlib figures, and placement of labels."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.errors import missing_extra

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# one column of a two-column page, inches
COLUMN = 3.5
# dots per inch of a PNG: a column of 1400 dots
RESOLUTION = 400

# Colours of Okabe and Ito, suitable for colour blindness; forms also differ by dashes.
BLACK, BLUE, RED, GREEN, ORANGE = "#000000", "#0072B2", "#C44E00", "#00805C", "#C98500"
PALE, GRAY = "#c4c4c4", "#7a7a7a"
LINES: dict[str, dict[str, Any]] = {
    "row1": {"color": BLACK, "linestyle": "-"},
    "row2": {"color": ORANGE, "linestyle": (0, (1, 1))},
    "row4": {"color": BLUE, "linestyle": (0, (5, 1.5))},
    "row5": {"color": RED, "linestyle": "-"},
    "b": {"color": GREEN, "linestyle": (0, (5, 1.5, 1, 1.5))},
    "bprime": {"color": BLACK, "linestyle": (0, (1, 1.2))},
}

SETTINGS: Any = {
    "font.family": "STIXGeneral",
    "mathtext.fontset": "stix",
    "font.size": 8,
    "axes.labelsize": 8,
    "axes.titlesize": 8,
    "legend.fontsize": 7,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "lines.linewidth": 1.0,
    "axes.unicode_minus": True,
    "svg.fonttype": "path",
    "svg.hashsalt": "splatgl",
}


@contextmanager
def style() -> Iterator[None]:
    """Matplotlib settings for creating and writing a figure. Raises InputError without matplotlib."""
    try:
        import matplotlib
    except ImportError as error:
        raise missing_extra("figures", "matplotlib", "plots") from error
    with matplotlib.rc_context():
        # ignore the user's settings, for reproducible figures
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(SETTINGS)
        yield


def sheet(height: float, width: float = COLUMN) -> Figure:
    """Empty figure; sizes in inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def encode(figure: Figure, suffix: str, about: Mapping[str, str], maker: str, dpi: int = RESOLUTION) -> bytes:
    """The bytes of a .png or .svg, deterministic; about: Title and Description; maker: the program."""
    buffer = io.BytesIO()
    if suffix == ".svg":
        figure.savefig(buffer, format="svg", metadata={**about, "Creator": maker, "Date": None})
    else:
        figure.savefig(buffer, format="png", dpi=dpi, metadata={**about, "Software": maker})
    return buffer.getvalue()


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


# directions to try, best first: right, above, below, left, and between
DIRECTIONS = np.array([(1, 0), (1, 1), (1, -1), (0, 1), (0, -1), (-1, 0), (-1, 1), (-1, -1)])
# distance of a label from its point, half size of a point, half width of a line, its sampling distance, pixels
REACH, POINT, LINE, STEP = 7.0, 4.5, 1.0, 5.0


def places(
    points: np.ndarray, sizes: np.ndarray, frame: np.ndarray, lines: Sequence[np.ndarray] = ()
) -> list[np.ndarray | None]:
    """Lower left corner [2] of each label of `sizes` [N, 2] beside points [N, 2], most important first.

    lines: polygons [M, 2] that labels avoid. None for labels without space within `frame` (left, bottom, right, top).
    """
    along = np.concatenate([np.zeros((0, 2)), *(_along(line) for line in lines)])
    taken = [*np.concatenate([points - POINT, points + POINT], axis=1), *np.hstack([along - LINE, along + LINE])]
    placed: list[np.ndarray | None] = []
    for point, size in zip(points, sizes, strict=True):
        corners = (point + d * (REACH / np.hypot(*d)) - size * (1 - d) / 2 for d in DIRECTIONS)
        boxes = (np.concatenate([corner, corner + size]) for corner in corners)
        box = next((box for box in boxes if _is_free(box, frame, np.array(taken))), None)
        placed.append(None if box is None else box[:2])
        taken += [] if box is None else [box]
    return placed


def _along(line: np.ndarray) -> np.ndarray:
    """Points every STEP along a polygon, [K, 2]."""
    parts = [a + (b - a) * np.linspace(0, 1, 2 + int(np.hypot(*(b - a)) / STEP))[:, None] for a, b in pairwise(line)]
    return np.concatenate([np.zeros((0, 2)), *parts])


def _is_free(box: np.ndarray, frame: np.ndarray, taken: np.ndarray) -> bool:
    """Whether a box lies in the frame, and overlaps none of [N, 4]; each is left, bottom, right, top."""
    inside = (box[:2] >= frame[:2]).all() and (box[2:] <= frame[2:]).all()
    return bool(inside and not ((taken[:, :2] < box[2:]) & (taken[:, 2:] > box[:2])).all(axis=1).any())

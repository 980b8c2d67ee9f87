"""Style of Matplotlib figures, and placement of labels."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
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


def encode(figure: Figure, suffix: str, about: Mapping[str, str], maker: str) -> bytes:
    """The bytes of a .png or .svg, deterministic; about: Title and Description; maker: the program."""
    buffer = io.BytesIO()
    if suffix == ".svg":
        figure.savefig(buffer, format="svg", metadata={**about, "Creator": maker, "Date": None})
    else:
        figure.savefig(buffer, format="png", dpi=RESOLUTION, metadata={**about, "Software": maker})
    return buffer.getvalue()


def bare(axes: Axes) -> None:
    """Removes frame and ticks; equal aspect ratio."""
    axes.set_aspect("equal")
    axes.set_axis_off()


def measure(axes: Axes, start: tuple[float, float], end: tuple[float, float], color: str = BLACK) -> None:
    """A double-headed arrow between two points, as a dimension line."""
    arrow = {"arrowstyle": "<|-|>,head_width=0.12,head_length=0.25", "color": color, "lw": 0.7, "shrinkA": 0}
    axes.annotate("", end, start, arrowprops={**arrow, "shrinkB": 0}, annotation_clip=False)


def plain(text: str) -> dict[str, Any]:
    """Text style: centred on its point, on white, to hide lines behind it."""
    box = {"facecolor": "white", "edgecolor": "none", "pad": 0.8}
    return {"s": text, "ha": "center", "va": "center", "bbox": box}


# directions to try, best first: right, above, below, left, and between
DIRECTIONS = ((1, 0), (1, 1), (1, -1), (0, 1), (0, -1), (-1, 0), (-1, 1), (-1, -1))
# distances from the point to try, pixels; from the second on, with a leader line
REACHES = (7.0, 17.0, 30.0, 46.0, 64.0)
LED = REACHES[1]
# half size of a point, and margin around a label, pixels
POINT, MARGIN = 4.5, 1.5
# half width of a line, and its sampling distance, pixels
LINE, STEP = 1.0, 5.0


@dataclass(frozen=True)
class LabelBox:
    """A rectangle, pixels."""

    left: float
    bottom: float
    right: float
    top: float

    def touches(self, others: np.ndarray) -> bool:
        """Whether any of [N, 4] left, bottom, right, top overlaps it."""
        if not len(others):
            return False
        apart = (others[:, 0] > self.right) | (others[:, 2] < self.left)
        apart |= (others[:, 1] > self.top) | (others[:, 3] < self.bottom)
        return not bool(apart.all())

    def within(self, frame: LabelBox) -> bool:
        """Whether all of it is inside `frame`."""
        inside = self.left >= frame.left and self.right <= frame.right
        return inside and self.bottom >= frame.bottom and self.top <= frame.top

    @property
    def row(self) -> tuple[float, float, float, float]:
        """(left, bottom, right, top), as `touches` takes rows."""
        return self.left, self.bottom, self.right, self.top


@dataclass(frozen=True)
class Place:
    """Position of a label: its lower left corner, and whether it has a leader line; pixels."""

    left: float
    bottom: float
    led: bool


def places(
    points: np.ndarray, sizes: Sequence[tuple[float, float]], frame: LabelBox, lines: Sequence[np.ndarray] = ()
) -> list[Place | None]:
    """A position for each label of `sizes` beside points [N, 2], most important first.

    lines: polygons [M, 2] that labels avoid if possible. None for labels without space within `frame`.
    """
    taken = np.concatenate([points - POINT, points + POINT], axis=1)
    along = np.concatenate([np.zeros((0, 2)), *(_along(line) for line in lines)])
    drawn = np.concatenate([along - LINE, along + LINE], axis=1)
    placed: list[Place | None] = []
    for point, size in zip(points, sizes, strict=True):
        place = _place(point, size, frame, np.concatenate([taken, drawn])) or _place(point, size, frame, taken)
        placed.append(place)
        if place is not None:
            box = (place.left, place.bottom, place.left + size[0], place.bottom + size[1])
            leader = _along(np.array([point, _nearest(point, place, size)]))
            taken = np.concatenate([taken, [box], np.concatenate([leader - LINE, leader + LINE], axis=1)])
    return placed


def _along(line: np.ndarray) -> np.ndarray:
    """Points every STEP along a polygon, [K, 2]."""
    parts = [a + (b - a) * np.linspace(0, 1, 2 + int(np.hypot(*(b - a)) / STEP))[:, None] for a, b in pairwise(line)]
    return np.concatenate([np.zeros((0, 2)), *parts])


def _nearest(point: np.ndarray, place: Place, size: tuple[float, float]) -> np.ndarray:
    """End of a leader line from the point at its label."""
    low = np.array([place.left, place.bottom])
    return np.asarray(np.clip(point, low, low + size))


def _place(point: np.ndarray, size: tuple[float, float], frame: LabelBox, taken: np.ndarray) -> Place | None:
    for reach in REACHES:
        for across, up in DIRECTIONS:
            # the label's side or corner nearest to the point is `reach` away
            scale = reach / np.hypot(across, up)
            left = point[0] + across * scale - (size[0] if across < 0 else size[0] / 2 if across == 0 else 0)
            bottom = point[1] + up * scale - (size[1] if up < 0 else size[1] / 2 if up == 0 else 0)
            box = LabelBox(left - MARGIN, bottom - MARGIN, left + size[0] + MARGIN, bottom + size[1] + MARGIN)
            place = Place(float(left), float(bottom), reach >= LED)
            if box.within(frame) and not box.touches(taken) and not (place.led and _crosses(point, place, size, taken)):
                return place
    return None


def _crosses(point: np.ndarray, place: Place, size: tuple[float, float], taken: np.ndarray) -> bool:
    """Whether a leader line crosses anything but its point."""
    path = _along(np.array([point, _nearest(point, place, size)]))
    path = path[np.abs(path - point).max(axis=1) > 2 * POINT]
    return any(LabelBox(x, y, x, y).touches(taken) for x, y in path.tolist())

"""Style of the figures: one column wide, with lines distinguishable without colour."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from splatgl.errors import missing_extra

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# one column of a two-column page, inches
COLUMN = 3.5
# dots per inch of a PNG: a column of 1400 dots
RESOLUTION = 400

# Colours of Okabe and Ito, suitable for colour blindness; each form also has its own dashes.
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
        # ignore the user's own settings, for reproducible figures
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(SETTINGS)
        yield


def sheet(height: float, width: float = COLUMN) -> Figure:
    """An empty figure; inches."""
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

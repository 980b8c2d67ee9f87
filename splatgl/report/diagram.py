"""Work–precision diagram: error against time, both logarithmic, a line per axis of methods; Matplotlib's style."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.errors import import_extra
from splatgl.report.methods import AXES, DEFAULT, EXACT, PAPER, PAPER_FLOAT, PAPER_TABLE, MethodAxis, axis_of, methods
from splatgl.report.sweep import Point, SceneResults, front

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Plot
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure


# one column of a two-column page, inches
COLUMN = 3.5
# dots per inch of a PNG: a column of 1400 dots
PRINT_RESOLUTION = 400

# Colours of Okabe and Ito, suitable for colour blindness; forms also differ by dashes.
BLACK, BLUE, RED, GREEN, ORANGE = "#000000", "#0072B2", "#C44E00", "#00805C", "#C98500"
GRAY = "#7a7a7a"

SETTINGS: Any = {
    **{"font.family": "STIXGeneral", "mathtext.fontset": "stix", "svg.fonttype": "path", "svg.hashsalt": "splatgl"},
    **dict.fromkeys(("font.size", "axes.labelsize", "axes.titlesize"), 8),
    **dict.fromkeys(("legend.fontsize", "xtick.labelsize", "ytick.labelsize"), 7),
    **dict.fromkeys(("axes.linewidth", "xtick.major.width", "ytick.major.width"), 0.6),
    **dict.fromkeys(("xtick.major.size", "ytick.major.size"), 2.5),
    **dict.fromkeys(("xtick.direction", "ytick.direction"), "in"),
    **{"lines.linewidth": 1.0, "axes.unicode_minus": True},
}


@contextmanager
def style() -> Iterator[None]:
    """Matplotlib settings for creating and writing a figure. Raises InputError without matplotlib."""
    matplotlib = import_extra("matplotlib", "figures", "matplotlib", "plots")
    with matplotlib.rc_context():
        # ignore the user's settings, for reproducible figures
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(SETTINGS)
        yield


def sheet(height: float, width: float = COLUMN) -> Figure:
    """Empty figure; sizes in inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def encode(figure: Figure, suffix: str, about: Mapping[str, str], maker: str, dpi: int = PRINT_RESOLUTION) -> bytes:
    """The bytes of a .png or .svg, deterministic; about: Title and Description; maker: the program."""
    buffer = io.BytesIO()
    if suffix == ".svg":
        figure.savefig(buffer, format="svg", metadata={**about, "Creator": maker, "Date": None})
    else:
        figure.savefig(buffer, format="png", dpi=dpi, metadata={**about, "Software": maker})
    return buffer.getvalue()


# size of a panel in inches, and of its surroundings; the first panel shows most methods
PANEL, HEIGHT = 3.1, 3.5
FIRST = 1.35
TITLES = {
    "reference": "rendering error, against the float64 reference",
    "sampled": "with antialiasing: against supersampling",
    "integral": "with splatting itself: against the ray integral",
    "field": "with classification: against the field itself",
}
# practical settings are highlighted, each by its own marker
PRACTICAL = {
    **{DEFAULT: ("D", BLACK), EXACT: ("s", BLACK)},
    **{PAPER: ("o", BLACK), PAPER_TABLE: ("o", GRAY), PAPER_FLOAT: ("o", "white")},
}
# range of times that is drawn: half of the rounds are within it
QUARTILES = (0.25, 0.75)
# minimum decades of an error axis
DECADES = 2.0
# dots per inch of a PNG: a screen's width for three panels
RESOLUTION = 200
# markers and dashes identify each axis; colours are redundant
MARKS = "4^vD<>pPXhd*H8x+12"
DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1, 1.2)), (0, (5, 1.5, 1, 1.5)), (0, (3, 1, 1, 1, 1, 1)))
COLORS = (BLUE, RED, GREEN, ORANGE, GRAY)
# an error of 0 is plotted at this fraction of the smallest nonzero one
NOTHING = 0.3
LABEL = 6.5
# directions of a label from its point to try, best first: right, above, below, left, and between; its alignment there
DIRECTIONS = ((1, 0), (1, 1), (1, -1), (0, 1), (0, -1), (-1, 0), (-1, 1), (-1, -1))
ALIGNED, RAISED = {1: "left", 0: "center", -1: "right"}, {1: "bottom", 0: "center", -1: "top"}
# distance of a label from its point in points of print, and half size of a point in pixels
REACH, POINT = 5.0, 4.5


def plot_styles() -> dict[str, dict[str, Any]]:
    """Matplotlib's style of every axis, each with a unique combination of marker and dashes."""
    return {
        name: _style(MARKS[n % len(MARKS)], COLORS[n % len(COLORS)], linestyle=DASHES[n % len(DASHES)])
        for n, name in enumerate(AXES)
    }


def _style(marker: str, color: str, fill: str = "white", size: float = 4.0, linestyle: Any = "none") -> dict[str, Any]:
    look = {"marker": marker, "markersize": size, "markerfacecolor": fill, "markeredgecolor": color}
    return {**look, "color": color, "linestyle": linestyle, "markeredgewidth": 0.9, "linewidth": 0.9}


def picture(scene: SceneResults, head: Mapping[str, Any]) -> dict[str, bytes]:
    """The diagram as .png and .svg. Raises InputError if matplotlib is not installed."""
    about = {"Title": f"Error against run time: {scene.subject.name}", "Description": head["machine"]["renderer"]}
    with style():
        figure, maker = _figure(scene, head), f"splatgl {head['version']}"
        return {suffix: encode(figure, suffix, about, maker, RESOLUTION) for suffix in (".png", ".svg")}


def _figure(scene: SceneResults, head: Mapping[str, Any]) -> Figure:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    truths = [truth for truth in scene.truths if any(truth in axis_of(p.name).truths for p in scene.points(truth))]
    figure = sheet(HEIGHT + 0.75, PANEL * (FIRST - 1 + max(len(truths), 1)))
    width, height = scene.subject.camera.size
    by = head["machine"]["renderer"].split(" (")[0]
    count = f"{len(scene.subject.splats()):,}"
    figure.suptitle(f"{scene.subject.name}: {count} splats, {width}×{height} pixels, {by}", fontsize=9)
    if not truths:
        return figure
    wide = {"width_ratios": [FIRST, *(1 for _ in truths[1:])]}
    plots = figure.subplots(1, len(truths), squeeze=False, gridspec_kw=wide)[0]
    shown: dict[str, Any] = {}
    for plot, truth in zip(plots, truths, strict=True):
        shown |= _panel(plot, scene, truth)
    plots[0].set_ylabel("relative RMSE")
    rows = 2 if len(truths) > 1 else 5
    columns = -(-len(shown) // rows)
    where: Any = "outside lower center"
    figure.legend(list(shown.values()), list(shown), loc=where, ncols=columns, frameon=False, fontsize=6.5)
    # label placement needs all positions
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    figure.set_layout_engine("none")
    for plot, truth in zip(plots, truths, strict=True):
        _label(plot, scene, truth, canvas)
    return figure


def _panel(plot: Plot, scene: SceneResults, truth: str) -> dict[str, Any]:
    """Draws one truth's panel; returns the artists by name, for the legend."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    points = {point.name: point for point in scene.points(truth)}
    least = min((p.error for p in points.values() if p.error > 0), default=1.0)
    shown = {}
    for name, look in plot_styles().items():
        axis = AXES[name]
        if truth in axis.truths:
            on = _on(axis, points)
            for practical, (mark, fill) in PRACTICAL.items():
                for point in [point for point in on if point.name == practical]:
                    shown[practical] = _line(plot, [point], _style(mark, BLACK, fill, 6.0), least)
                    on.remove(point)
            if on:
                shown[name] = _line(plot, on, look if axis.connected else look | {"linestyle": "none"}, least)
    x, y = _places(front(scene.rivals(truth)), least)
    steps = np.repeat(x, 2)[1:], np.repeat(y, 2)[:-1]
    (shown["front"],) = plot.plot(*steps, color=BLACK, linewidth=2.6, alpha=0.18, solid_capstyle="round", zorder=1)
    plot.set(xscale="log", yscale="log", xlabel="milliseconds for a frame")
    plot.set_title(f"{TITLES[truth]}", fontsize=7.5)
    plot.grid(True, which="major", color="#e4e4e4", linewidth=0.5, zorder=0)
    plot.margins(0.12, 0.1)
    low, high = np.log10(plot.get_ylim())
    more = max(DECADES - (high - low), 0.0) / 2
    plot.set_ylim(10 ** (low - more), 10 ** (high + more))
    # powers of ten are too sparse within a decade
    plot.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    plot.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    plot.xaxis.set_minor_formatter(NullFormatter())
    return shown


def _on(axis: MethodAxis, points: Mapping[str, Point]) -> list[Point]:
    return [points[method.name] for method in axis.methods if method.name in points]


def _places(points: list[Point], least: float) -> tuple[np.ndarray, np.ndarray]:
    """Milliseconds, and errors clamped for a logarithmic axis."""
    x = np.array([1e3 * point.time.median for point in points])
    y = np.array([point.error or NOTHING * least for point in points])
    return x, y


def _line(plot: Plot, points: list[Point], look: Mapping[str, Any], least: float) -> Any:
    x, y = _places(points, least)
    spread = np.abs(np.array([1e3 * np.quantile(p.time.rounds, QUARTILES) for p in points]).T - x)
    plot.errorbar(x, y, xerr=spread, fmt="none", ecolor=look["color"], elinewidth=0.5, alpha=0.6, zorder=2)
    (drawn,) = plot.plot(x, y, **look, zorder=4 if look["color"] == BLACK else 3)
    return drawn


def _text(name: str, drawn: set[str]) -> str:
    """Label of a method: its whole name at the start of a line, else only the changed value."""
    axis = axis_of(name)
    first = next(method.name for method in axis.methods if method.name in drawn)
    return name if axis.connected and name == first else methods()[name].label or name


def _label(plot: Plot, scene: SceneResults, truth: str, canvas: FigureCanvasAgg) -> None:
    """Labels points if there is space: practical settings, then the front, then others.

    Only ends and members of the front are labelled on a line.
    """
    from matplotlib.transforms import Bbox

    points = [p for p in scene.points(truth) if truth in axis_of(p.name).truths]
    least = min((p.error for p in points if p.error > 0), default=1.0)
    best = {p.name for p in front(scene.rivals(truth))}
    inner = set()
    for axis in AXES.values():
        inner |= {p.name for p in _on(axis, {p.name: p for p in points})[1:-1] if axis.connected}
    named = [p for p in points if p.name not in inner - best]
    order = sorted(named, key=lambda p: (p.name not in PRACTICAL, p.name not in best))
    where = np.column_stack(_places(order, least))
    taken = [Bbox(at + np.array([[-POINT], [POINT]])) for at in plot.transData.transform(where)]
    lines = [
        line.get_transform().transform_path(line.get_path()) for line in plot.lines if line.get_linestyle() != "None"
    ]
    renderer, names = canvas.get_renderer(), {point.name for point in points}
    for point, at in zip(order, where.tolist(), strict=True):
        name, place = _text(point.name, names), (0, 0)
        text = plot.annotate(name, at, place, textcoords="offset points", fontsize=LABEL, zorder=6)
        for right, up in DIRECTIONS:
            offset = REACH / np.hypot(right, up)
            text.set(position=(right * offset, up * offset), ha=ALIGNED[right], va=RAISED[up])
            box = text.get_window_extent(renderer)
            is_inside = plot.bbox.containsx(box.x0) and plot.bbox.containsx(box.x1)
            is_inside &= plot.bbox.containsy(box.y0) and plot.bbox.containsy(box.y1)
            if is_inside and not (box.count_overlaps(taken) or any(line.intersects_bbox(box, False) for line in lines)):
                taken.append(box)
                break
        else:
            text.remove()

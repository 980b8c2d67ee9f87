"""The work–precision diagram: error over time, both logarithmic, a line for each axis of methods, and the front."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.truth.figures.style import BLACK, BLUE, GRAY, GREEN, ORANGE, RED, encode, sheet, style
from splatgl.truth.report.front import Point, front
from splatgl.truth.report.labels import Box, places
from splatgl.truth.report.methods import AXES, DEFAULT, PAPER, Axis, axis_of, methods
from splatgl.truth.report.results import Scene
from splatgl.truth.report.words import rivals

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Plot
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

# inches of a panel, and of what is around it
PANEL, HEIGHT = 3.3, 3.5
TITLES = {
    "reference": "how right it is drawn\nagainst the float64 reference",
    "sampled": "with antialiasing\nagainst supersampling",
    "integral": "with splatting itself\nagainst the ray integral",
}
# dots an inch of a PNG: a screen's width for three panels
RESOLUTION = 200
# each axis is known by its mark and dashes alone; colours come on top. filled marks: what 1998 had, and the default
MARKS = "s^vD<>pPXhd*oH8x+1"
DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1, 1.2)), (0, (5, 1.5, 1, 1.5)), (0, (3, 1, 1, 1, 1, 1)))
COLORS = (BLUE, RED, GREEN, ORANGE, GRAY)
# an error of 0 stands at this share of the least other
NOTHING = 0.3
LABEL = 6.5


@dataclass(frozen=True)
class Look:
    """How an axis is drawn."""

    marker: str
    dashes: Any
    color: str


def looks() -> dict[str, Look]:
    """A look for every axis: no two have the same mark and dashes."""
    return {
        name: Look(MARKS[n % len(MARKS)], DASHES[n % len(DASHES)], COLORS[n % len(COLORS)])
        for n, name in enumerate(AXES)
    }


def picture(scene: Scene, head: Mapping[str, Any], suffix: str) -> bytes:
    """The diagram as a .png or .svg. Raises InputError where matplotlib is not installed."""
    with style():
        return _encoded(_figure(scene, head), suffix, f"Error against run time: {scene.name}", head)


def convergence(lines: Sequence[Mapping[str, Any]], head: Mapping[str, Any], suffix: str) -> bytes:
    """Errors over what is refined, a line a study, as a .png or .svg. Raises InputError as `picture`."""
    with style():
        figure = sheet(HEIGHT, 1.6 * PANEL)
        plot = figure.subplots()
        for line, look in zip(lines, looks().values(), strict=False):
            x = np.array(line["values"]) / line["values"][0]
            errors = np.array(line["errors"])
            name = f"{line['study']}, from {line['values'][0]:g} {line['unit']}"
            plot.plot(x, errors, look.marker, linestyle=look.dashes, color=look.color, markersize=4, label=name,
                      markerfacecolor="white", linewidth=0.9)  # fmt: skip
        reach = np.array([1.0, 16.0])
        plot.plot(reach, 0.1 * reach**-2, color=BLACK, linewidth=2.6, alpha=0.18, label="order 2, as expected")
        plot.set(xscale="log", yscale="log", xlabel="times as fine", ylabel="relative RMSE")
        plot.grid(True, which="major", color="#e4e4e4", linewidth=0.5, zorder=0)
        plot.legend(frameon=False, fontsize=6.5, loc="upper right")
        _ticks(plot)
        return _encoded(figure, suffix, "Convergence", head)


def _encoded(figure: Figure, suffix: str, title: str, head: Mapping[str, Any]) -> bytes:
    about = {"Title": title, "Description": head["machine"]["renderer"]}
    maker = f"splatgl {head['version']}"
    if suffix == ".svg":
        return encode(figure, suffix, about, maker)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=RESOLUTION, metadata={**about, "Software": maker})
    return buffer.getvalue()


def _figure(scene: Scene, head: Mapping[str, Any]) -> Figure:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    truths = [truth for truth in scene.truths if scene.points(truth)]
    figure = sheet(HEIGHT + 0.75, PANEL * max(len(truths), 1))
    width, height = scene.about["size"]
    machine = head["machine"]
    by = machine["renderer"].split(" (")[0]
    figure.suptitle(f"{scene.name}: {scene.about['splats']:,} splats, {width}×{height} pixels, {by}", fontsize=9)
    if not truths:
        return figure
    plots = figure.subplots(1, len(truths), squeeze=False)[0]
    shown: dict[str, Any] = {}
    for plot, truth in zip(plots, truths, strict=True):
        shown |= _panel(plot, scene, truth)
    plots[0].set_ylabel("relative RMSE")
    rows = 2 if len(truths) > 1 else 5
    columns = -(-len(shown) // rows)
    where: Any = "outside lower center"
    figure.legend(list(shown.values()), list(shown), loc=where, ncols=columns, frameon=False, fontsize=6.5)
    # labels need to know where everything stands
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    figure.set_layout_engine("none")
    for plot, truth in zip(plots, truths, strict=True):
        _label(plot, scene, truth, canvas)
    return figure


def _panel(plot: Plot, scene: Scene, truth: str) -> dict[str, Any]:
    """One truth's panel; returns what is drawn, by name, for the legend."""
    points = {point.name: point for point in scene.points(truth)}
    least = min((p.error for p in points.values() if p.error > 0), default=1.0)
    shown = {}
    for name, look in looks().items():
        axis = AXES[name]
        if truth in axis.truths:
            drawn = _line(plot, _on(axis, points), look, least, axis.connected)
            if drawn is not None:
                shown[name] = drawn
    best = front(rivals(truth, scene))
    x, y = _places(best, least)
    stairs = np.repeat(x, 2)[1:], np.repeat(y, 2)[:-1]
    (shown["front"],) = plot.plot(*stairs, color=BLACK, linewidth=2.6, alpha=0.18, solid_capstyle="round", zorder=1)
    plot.set_xscale("log")
    plot.set_yscale("log")
    plot.set_xlabel("milliseconds for a frame")
    plot.set_title(TITLES[truth], fontsize=8)
    plot.grid(True, which="major", color="#e4e4e4", linewidth=0.5, zorder=0)
    plot.margins(0.12, 0.1)
    _ticks(plot)
    return shown


def _ticks(plot: Plot) -> None:
    """Plain milliseconds: powers of ten tell little over a decade."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    plot.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    plot.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    plot.xaxis.set_minor_formatter(NullFormatter())


def _on(axis: Axis, points: Mapping[str, Point]) -> list[Point]:
    return [points[method.name] for method in axis.methods if method.name in points]


def _places(points: list[Point], least: float) -> tuple[np.ndarray, np.ndarray]:
    """Milliseconds, and errors that a logarithm has a place for."""
    x = np.array([1e3 * point.time.median for point in points])
    y = np.array([point.error or NOTHING * least for point in points])
    return x, y


def _line(plot: Plot, points: list[Point], look: Look, least: float, connected: bool) -> Any:
    if not points:
        return None
    x, y = _places(points, least)
    spread = np.abs(np.array([[1e3 * p.time.low, 1e3 * p.time.high] for p in points]).T - x)
    plot.errorbar(x, y, xerr=spread, fmt="none", ecolor=look.color, elinewidth=0.5, alpha=0.6, zorder=2)
    filled = points[0].name in (DEFAULT, PAPER)
    (drawn,) = plot.plot(
        x,
        y,
        linestyle=look.dashes if connected else "none",
        color=look.color,
        marker=look.marker,
        markersize=5.5 if filled else 4,
        markerfacecolor=BLACK if filled else "white",
        markeredgecolor=BLACK if filled else look.color,
        markeredgewidth=0.9,
        linewidth=0.9,
        zorder=4 if filled else 3,
    )
    return drawn


def _text(name: str, drawn: set[str]) -> str:
    """A method's label: by its whole name where its line begins, then by what changes along it."""
    axis = axis_of(name)
    first = next(method.name for method in axis.methods if method.name in drawn)
    return name if axis.connected and name == first else methods()[name].label or name


def _label(plot: Plot, scene: Scene, truth: str, canvas: FigureCanvasAgg) -> None:
    """Names beside points: the practical settings first, then the front, then the others, as far as there is room."""
    points = [p for p in scene.points(truth) if truth in axis_of(p.name).truths]
    least = min((p.error for p in points if p.error > 0), default=1.0)
    best = {p.name for p in front(rivals(truth, scene))}
    order = sorted(points, key=lambda p: (p.name not in (DEFAULT, PAPER), p.name not in best))
    where = plot.transData.transform(np.column_stack(_places(order, least)))
    texts = [_text(p.name, {point.name for point in points}) for p in order]
    renderer = canvas.get_renderer()
    drawn = [plot.text(0, 0, text, fontsize=LABEL, zorder=6) for text in texts]
    sizes = [(box.width, box.height) for box in (text.get_window_extent(renderer) for text in drawn)]
    lines = [plot.transData.transform(line.get_xydata()) for line in plot.lines if line.get_linestyle() != "None"]
    found = places(where, sizes, Box(*plot.bbox.extents), lines)
    back = plot.transData.inverted()
    for text, place, point, (width, height) in zip(drawn, found, where, sizes, strict=True):
        if place is None:
            text.remove()
            continue
        left, bottom = back.transform((place.left, place.bottom))
        text.set_position((float(left), float(bottom)))
        text.set_verticalalignment("bottom")
        if place.led:
            nearest = np.clip(point, (place.left, place.bottom), (place.left + width, place.bottom + height))
            ends = back.transform([point, nearest])
            plot.plot(*ends.T, color=GRAY, linewidth=0.4, zorder=2, scalex=False, scaley=False)

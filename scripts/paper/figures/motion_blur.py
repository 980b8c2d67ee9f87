"""Figure 11: a moving splat's footprint, cut in half with a rectangle between the halves, and the exact result."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from paper.figures.drawing import bare, measure, plain
from paper.forms import energy_gain, paper_gain, streak, stretched_footprint
from paper.tables import Table

from splatgl.report.diagram import BLACK, BLUE, GRAY, GREEN, RED, sheet
from splatgl.splat.kernels import kernel
from splatgl.splat.motion_blur import MOTIONS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# length of the path in voxels, and its direction in degrees
LENGTH, TURN = 3.0, 25.0
# half of the shown square, voxels
SHOWN = 3.3
LENGTHS = (0.0, 0.5, 1.0, 2.0, 5.0, 10.0, 100.0, 1000.0)
# quadrature points for an energy: error 1e−5
ORDER = 40
LOOKS: dict[str, dict[str, Any]] = {
    "exact": {"color": BLACK, "linestyle": "-"},
    "energy": {"color": GREEN, "linestyle": (0, (5, 1.5))},
    "paper": {"color": RED, "linestyle": (0, (1, 1))},
}
NAMES = {"exact": "exact: mean along the path", "energy": "energy kept", "paper": "paper, Eq. 11"}


def construction() -> Figure:
    """Figure 11."""
    figure = sheet(3.7)
    grid = figure.add_gridspec(2, 3, height_ratios=(1, 1.35))
    for column, part in enumerate(("footprint", "stretched", "exact")):
        _picture(figure.add_subplot(grid[0, column]), part)
    _profile(figure.add_subplot(grid[1, :]))
    return figure


def _picture(axes: Axes, part: str) -> None:
    """The footprint, its separated halves, or its mean along the path, from above; grey: the square root."""
    shape = kernel("crawfis-max")
    place = np.linspace(-SHOWN, SHOWN, 151)
    x, y = np.meshgrid(place, place)
    turn = np.radians(TURN)
    u, v = x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn)
    length = np.array(0.0 if part == "footprint" else LENGTH)
    value = streak(shape, "exact", (u, v), length) if part == "exact" else stretched_footprint(shape, u, v, length)
    top = float(shape.footprint(np.zeros(())))
    extent = (-SHOWN, SHOWN, -SHOWN, SHOWN)
    axes.imshow(np.sqrt(value / top), cmap="Greys", vmin=0, vmax=1.25, extent=extent, origin="lower")
    along = np.array([np.cos(turn), np.sin(turn)])
    across = np.array([-along[1], along[0]]) * shape.radius
    _outline(axes, shape.radius, float(length) / 2, along, across)
    # the cut, and the path
    for side in {0.0} if part == "footprint" else {-0.5, 0.5}:
        middle = along * side * float(length)
        if part != "exact":
            axes.plot(*np.stack([middle - across, middle + across]).T, color=BLUE, lw=0.8, dashes=(3, 1.5))
    if part == "stretched":
        low, high = (along * s * LENGTH - across * 1.25 for s in (-0.5, 0.5))
        measure(axes, (float(low[0]), float(low[1])), (float(high[0]), float(high[1])), BLUE)
        middle = -across * 1.62
        axes.text(float(middle[0]), float(middle[1]), "$l$", color=BLUE, ha="center", va="center")
    letter, words = {"footprint": ("a", "cut"), "stretched": ("b", "stretched"), "exact": ("c", "exact")}[part]
    axes.set_title(f"({letter}) {words}")
    bare(axes, (-SHOWN, SHOWN), (-SHOWN, SHOWN))


def _outline(axes: Axes, radius: float, half: float, along: np.ndarray, across: np.ndarray) -> None:
    """The boundary of the support: two half circles and two straight lines."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, 60)
    arc = np.outer(np.cos(angle), along) * radius + np.outer(np.sin(angle), across)
    edge = np.concatenate([arc + along * half, -arc - along * half])
    axes.plot(*np.concatenate([edge, edge[:1]]).T, color=GRAY, lw=0.7)


def _profile(axes: Axes) -> None:
    shape = kernel("crawfis-max")
    u = np.linspace(-SHOWN, SHOWN, 401)
    still = shape.footprint(np.abs(u))
    top = float(still.max())
    axes.plot(u, still / top, color=GRAY, lw=0.8)
    axes.text(0.55, 0.85, "still", color=GRAY, ha="left", va="center")
    for motion in MOTIONS:
        value = streak(shape, motion, (u, np.zeros_like(u)), np.array(LENGTH)) / top
        label = f"{NAMES[motion]}; energy {energy(motion, LENGTH):.3f}"
        axes.plot(u, value, label=label, lw=1.1, **LOOKS[motion])
    for side in (-0.5, 0.5):
        axes.plot([side * LENGTH] * 2, [0, 0.62], color=BLUE, lw=0.6, dashes=(3, 1.5))
    axes.text(0, 0.06, **{**plain("$l$ = 3 voxels"), "color": BLUE})
    measure(axes, (-LENGTH / 2, 0.13), (LENGTH / 2, 0.13), BLUE)
    axes.set(xlabel="$u$ along the path (voxels)", ylabel="value$/F(0)$")
    axes.set(xlim=(-SHOWN, SHOWN), ylim=(0, 1.55), yticks=[0, 0.5, 1.0])
    axes.legend(frameon=False, loc="upper center", ncols=1, handlelength=2.6, borderaxespad=0.1, labelspacing=0.2)


def energy(motion: str, length: float, name: str = "crawfis-max") -> float:
    """The integral of a streak over the plane, by Gaussian quadrature across and between its non-smooth points."""
    shape = kernel(name)
    nodes, weights = np.polynomial.legendre.leggauss(ORDER)
    v, across = nodes * shape.radius, weights * shape.radius
    ends = np.unique([0.0, max(length / 2 - shape.radius, 0.0), length / 2, length / 2 + shape.radius])
    total = 0.0
    for low, high in pairwise(ends):
        u, along = low + (nodes + 1) / 2 * (high - low), weights / 2 * (high - low)
        total += 2 * float(along @ streak(shape, motion, (u[:, None], v[None]), np.array(length)) @ across)
    return total


def gain_table() -> Table:
    """Weight of the stretched footprint, and energy of each method, for both kernels."""
    rows = []
    for name in ("crawfis-max", "gaussian"):
        for length in LENGTHS:
            at = np.array(length)
            gains = float(paper_gain(kernel(name), at)), float(energy_gain(kernel(name), at))
            rows.append((name, length, *gains, *(energy(motion, length, name) for motion in MOTIONS)))
    names = ("kernel", "l", "Eq. 11", "E1/(E1 + l W)", *(f"energy of {motion}" for motion in MOTIONS))
    return Table(names, tuple(rows))

"""Fig. 8: position where a pixel's ray samples the footprint on grid-aligned and ray-perpendicular quads."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from splatgl.splat.footprint import Splat
from splatgl.splat.kernels import Kernel, kernel
from splatgl.truth.figures.style import BLACK, BLUE, GRAY, RED, bare, sheet
from splatgl.truth.figures.tables import Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Sight:
    """A voxel (y, z) and a pixel's ray of slope dy/dz, in a plane through the eye, before z_k."""

    kernel: Kernel
    y: float
    z: float
    slope: float

    @property
    def splat(self) -> Splat:
        """The voxel and the ray in Table 1's terms, without antialiasing."""
        return Splat(self.kernel, np.array([0.0, self.y, self.z]), np.array([0.0, self.slope]), np.inf)

    @property
    def distances(self) -> dict[str, float]:
        """Distances from the voxel at which F is evaluated: the ray's true distance, row 4's and row 5's."""
        splat = self.splat
        return {
            "row1": float(splat.distance),
            "row4": float(splat.tan_length),
            "row5": float(np.hypot(*splat.offset)),
        }

    @property
    def points(self) -> dict[str, np.ndarray]:
        """(z, y) on the ray: nearest to the voxel, on its ray-perpendicular and on its grid-aligned plane."""
        voxel, ray = np.array([self.z, self.y]), np.array([1.0, self.slope])
        return {
            "row1": ray * (voxel @ ray) / (ray @ ray),
            "row4": ray * (voxel @ voxel) / (voxel @ ray),
            "row5": ray * self.z,
        }


def example() -> Sight:
    """A voxel 34° off the axis and 3.6 spacings away, a ray 20° off: near, so that the quads differ visibly."""
    return Sight(kernel("crawfis-max"), 2.0, 3.0, 0.37)


def orientations() -> Figure:
    """Fig. 8."""
    sight = example()
    figure = sheet(3.7)
    grid = figure.add_gridspec(2, 1, height_ratios=(1.9, 1))
    _side_view(figure.add_subplot(grid[0]), sight)
    _profile(figure.add_subplot(grid[1]), sight)
    return figure


COLORS = {"row1": BLACK, "row4": BLUE, "row5": RED}
MARKS = {"row1": "o", "row4": "s", "row5": "^"}


def _side_view(axes: Axes, sight: Sight) -> None:
    radius, turn = sight.kernel.radius, np.linspace(0, 2 * np.pi, 300)
    axes.fill(sight.z + radius * np.cos(turn), sight.y + radius * np.sin(turn), color="#eeeeee", lw=0)
    length = np.hypot(sight.y, sight.z)
    across = np.array([-sight.y, sight.z]) / length
    voxel = np.array([sight.z, sight.y])
    for name, direction in (("row5", np.array([0.0, 1.0])), ("row4", across)):
        ends = voxel + np.outer([-radius, radius], direction)
        axes.plot(*ends.T, color=COLORS[name], lw=2.0, dashes=(5, 1) if name == "row4" else (), solid_capstyle="butt")
    end = sight.z + radius + 0.5
    axes.plot([0, end], [0, sight.slope * end], color=BLACK, lw=0.9)
    axes.plot([0, sight.z], [0, sight.y], color=GRAY, lw=0.7, dashes=(4, 2))
    axes.plot(*voxel, "o", color=BLACK, ms=3.5)
    for name, point in sight.points.items():
        axes.plot(*point, MARKS[name], color=COLORS[name], ms=4.5, mec="white", mew=0.4, zorder=4)
    near = sight.points["row1"]
    axes.plot(*np.stack([voxel, near]).T, color=BLACK, lw=0.7, linestyle=":")
    axes.plot(0, 0, "o", color=BLACK, ms=4)
    axes.text(0, -0.15, "eye", ha="center", va="top")
    axes.text(end + 0.05, sight.slope * end, "pixel’s ray", va="center")
    top = voxel + across * radius
    axes.text(top[0] - 0.08, top[1] + 0.05, "ray-perpendicular", color=BLUE, ha="right", va="bottom")
    axes.text(sight.z + 0.1, sight.y + radius + 0.1, "grid-aligned", color=RED, ha="left", va="bottom")
    axes.text(sight.z + 0.14, sight.y + 0.05, "$\\mathbf{v}$", va="bottom")
    axes.set_xlim(-0.35, end + 1.1)
    axes.set_ylim(-0.5, sight.y + radius + 0.45)
    bare(axes)


def _profile(axes: Axes, sight: Sight) -> None:
    d = np.linspace(0, sight.kernel.radius, 300)
    peak = sight.kernel.footprint(np.zeros(()))
    axes.plot(d, sight.kernel.footprint(d) / peak, color=GRAY, lw=1.0)
    names = {"row1": "true", "row4": "ray-perpendicular", "row5": "grid-aligned"}
    for name, distance in sight.distances.items():
        share = float(sight.kernel.footprint(np.array(distance)) / peak)
        label = f"{names[name]}: $d$ = {distance:.3f}, $F/F(0)$ = {share:.3f}"
        axes.plot([distance, distance], [0, share], color=COLORS[name], lw=0.7)
        axes.plot(distance, share, MARKS[name], color=COLORS[name], ms=4.5, mec="white", mew=0.4, label=label)
    axes.set_xlabel("distance $d$ from the voxel (voxels)")
    axes.set_ylabel("$F(d)/F(0)$")
    axes.set_xlim(0, sight.kernel.radius)
    axes.set_ylim(0, 1.05)
    axes.legend(frameon=False, loc="upper right", handlelength=1, borderaxespad=0.2)


def orientation_table() -> Table:
    """Distance at which each orientation evaluates F, and the value."""
    sight = example()
    peak = float(sight.kernel.footprint(np.zeros(())))
    rows = [(name, d, float(sight.kernel.footprint(np.array(d))) / peak) for name, d in sight.distances.items()]
    return Table(("form", "distance", "F/F(0)"), tuple(rows))

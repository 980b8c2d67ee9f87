"""Fig. 10: the largest error of each row over the voxel's depth and its distance from the axis."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.truth.figures.setting import PAPER, Setting
from splatgl.truth.figures.style import BLACK, COLUMN, sheet
from splatgl.truth.figures.tables import Table
from splatgl.truth.figures.worst import ALL, PLANE_RAYS, Plane, difference

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d.axes3d import Axes3D

SHOWN = ("row5", "row4", "row3", "row2")
TITLES = {"row5": "grid-aligned", "row4": "ray-perpendicular", "row3": "ray-perp., ideal", "row2": "box"}
# grid of the table: voxels off the axis, and beyond z_k
OFFSETS = (0.0, 16.0, 32.0, 64.0, 96.0, 128.0, 160.0, 192.0, 224.0, 256.0)
BEFORE = (-102.4, -64.0, -32.0, -1.0)
BEHIND = (0.0, 1.0, 5.0, 10.0, 20.0, 35.0, 70.0, 105.0, 140.0, 184.0, 210.0, 280.0, 325.0, 350.0, 409.6)
DEPTHS = BEFORE + BEHIND
# additional depths for drawing, so that the step at z_k is vertical and the ridge beyond it smooth
STEP = (-1e-6, 2.5, 15.0, 27.0, 45.0, 57.0, 87.0, 120.0, 160.0, 240.0, 380.0)
ISOLINES = 6
# offset of the isolines below zero, as a fraction of the largest error
FLOOR = 1.1


@dataclass(frozen=True, eq=False)
class Surfaces:
    """errors[row] [depths, offsets]: largest |row − row 1| over real slopes in the plane; top: largest row 1.

    In values of the unnormalised kernel exp(−2r²), whose F(0) is 1.2532; amplitude 1/m.
    """

    dz: np.ndarray
    y: np.ndarray
    errors: dict[str, np.ndarray]
    top: np.ndarray

    def levels(self, row: str) -> np.ndarray:
        """The same in 1/255 of row 1's largest value there."""
        return np.asarray(255 * self.errors[row] / self.top)


@lru_cache(maxsize=4)
def surfaces(dz: tuple[float, ...] = DEPTHS, y: tuple[float, ...] = OFFSETS, setting: Setting = PAPER) -> Surfaces:
    """The four surfaces over depths z_k + dz and offsets y."""
    plane, shape = _plane(dz, y, setting), (len(dz), len(y))
    errors = {row: (plane.error(ALL[row]).value / setting.kernel.scale).reshape(shape) for row in SHOWN}
    return Surfaces(np.array(dz), np.array(y), errors, (plane.top() / setting.kernel.scale).reshape(shape))


@lru_cache(maxsize=4)
def cumulative(row: str, setting: Setting = PAPER) -> np.ndarray:
    """[depths, offsets]: Σ |row − row 1| over a footprint's rays, per pixel width, in the table's units."""
    plane = _plane(DEPTHS, OFFSETS, setting)
    place = np.linspace(-1, 1, PLANE_RAYS)[None]
    error = difference(ALL[row], plane.splat(place)) / setting.kernel.scale
    step = plane.reach * (2 / (PLANE_RAYS - 1)) * setting.z_k
    return np.asarray((error.sum(axis=1) * step).reshape(len(DEPTHS), len(OFFSETS)))


def _plane(dz: tuple[float, ...], y: tuple[float, ...], setting: Setting) -> Plane:
    across, depth = np.meshgrid(y, setting.z_k + np.array(dz))
    return Plane(setting.kernel, setting.z_k, across.ravel(), depth.ravel())


def error_surfaces() -> Figure:
    """Fig. 10."""
    found = surfaces(tuple(sorted({*DEPTHS, *STEP} - {-1.0})), OFFSETS)
    figure = sheet(4.5, COLUMN)
    figure.set_layout_engine("none")
    for number, row in enumerate(SHOWN):
        left, low = 0.5 * (number % 2), 0.5 * (1 - number // 2)
        axes = figure.add_axes((left + 0.02, low + 0.025, 0.47, 0.405), projection="3d")
        top = _surface(axes, found, row)
        figure.text(left + 0.02, low + 0.48, f"({'abcd'[number]}) row {row[3:]}, {TITLES[row]}", va="center")
        figure.text(left + 0.02, low + 0.447, f"largest: {top}", va="center", fontsize=7)
    return figure


def _surface(axes: Axes3D, found: Surfaces, row: str) -> str:
    """Draws one surface over its isolines; returns its largest value as text."""
    top = float(found.errors[row].max())
    power = int(np.floor(np.log10(top)))
    height = found.errors[row] / 10.0**power
    y, dz = np.meshgrid(found.y, found.dz)
    floor = -FLOOR * height.max()
    look: dict[str, Any] = {"cmap": "YlGnBu", "edgecolor": BLACK, "linewidth": 0.15, "shade": False}
    axes.plot_surface(dz, y, height, rstride=1, cstride=1, vmin=-0.1 * height.max(), vmax=1.1 * height.max(), **look)
    isolines = np.linspace(0, 1, ISOLINES + 2)[1:-1] * height.max()
    axes.contour(dz, y, height, isolines, zdir="z", offset=floor, colors=BLACK, linewidths=0.5)
    axes.plot([0, 0], [found.y[0], found.y[-1]], floor, color=BLACK, lw=0.8, dashes=(4, 2))
    axes.set_zlim(floor, height.max())
    axes.set_xlim(found.dz[0], found.dz[-1])
    axes.set_ylim(found.y[0], found.y[-1])
    _frame(axes, height.max())
    axes.text2D(0.0, 0.9, f"$\\times 10^{{{power}}}$", transform=axes.transAxes, fontsize=6.5)
    return f"${top * 10.0**-power:.3f} \\times 10^{{{power}}}$"


def _frame(axes: Axes3D, top: float) -> None:
    """Ticks, labels and viewing direction."""
    axes.set_xticks([0, 200, 400])
    axes.set_yticks([0, 128, 256])
    axes.set_zticks(_ticks(top))
    axes.tick_params(labelsize=6.5, pad=-3.5, length=1)
    axes.set_xlabel("$z_v - z_k$", labelpad=-6.5, fontsize=7.5)
    axes.set_ylabel("$y_v$", labelpad=-7, fontsize=7.5)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_rotate_label(False)
    axes.view_init(elev=26, azim=-125)
    axes.set_box_aspect((1.1, 1.0, 1.2), zoom=1.0)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_pane_color((1, 1, 1, 0))
        axis._axinfo["grid"].update(linewidth=0.3, color="#bbbbbb")


def _ticks(top: float) -> list[float]:
    step = next(s for s in (0.5, 1.0, 2.0, 5.0) if top / s < 4.5)
    return [float(t) for t in np.arange(0.0, top + 1e-9, step)]


def surface_table() -> Table:
    """The surfaces of Fig. 10 at its grid of voxels."""
    found = surfaces()
    rows = []
    for i, dz in enumerate(found.dz):
        for j, y in enumerate(found.y):
            errors = [float(found.errors[row][i, j]) for row in SHOWN]
            rows.append((float(dz), float(y), *errors, float(found.top[i, j])))
    return Table(("z_v - z_k", "y", *SHOWN, "largest row1"), tuple(rows))

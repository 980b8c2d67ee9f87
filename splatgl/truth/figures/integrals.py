"""Fig. 9: errors of the drawn splats of three voxels against exact line integrals, by the ray's angle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.splat.footprint import row1
from splatgl.truth.figures.setting import PAPER, Setting
from splatgl.truth.figures.shapes import Stretched
from splatgl.truth.figures.style import BLACK, GRAY, LINES, sheet
from splatgl.truth.figures.tables import Table
from splatgl.truth.figures.worst import ALL, Plane, difference

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# the forms shown; b′ is derived for the weight 1/m² of space, not for the plane's 1/m
PLANAR, SPATIAL = ("row5", "row4", "b"), ("bprime",)
NAMES = {"row5": "row 5, grid-aligned", "row4": "row 4, ray-perpendicular", "b": "form b", "bprime": "form b′"}
RAYS = 601
ISOLINES = (0.02, 0.2, 0.4, 0.6, 0.8)
# levels shown, logarithmically
SHOWN = (2e-5, 90.0)


@dataclass(frozen=True)
class Voxel:
    """One of the figure's voxels, at (0, y, z) in `setting`."""

    setting: Setting
    name: str
    y: float
    z: float

    @property
    def plane(self) -> Plane:
        """The voxel as a plane's only one, N = 1."""
        return Plane(self.setting.kernel, self.setting.z_k, np.array([self.y]), np.array([self.z]))

    @property
    def shape(self) -> Stretched:
        """The voxel's kernel after antialiasing."""
        return Stretched(self.setting.kernel, self.y, self.z, self.setting.z_k)

    def angles(self, place: np.ndarray) -> np.ndarray:
        """Angles of sweep positions from the axis, degrees."""
        return np.degrees(np.arctan(self.plane.slope(place[None])[0]))

    def levels(self, form: str, place: np.ndarray) -> np.ndarray:
        """|form − row 1| on each ray, in 1/255 of row 1's largest value."""
        splat = self.plane.splat(place[None], planar=form in PLANAR)
        top = float(row1(self.plane.splat(np.linspace(-1, 1, RAYS)[None], splat.planar)).max())
        return np.asarray(255 * difference(ALL[form], splat)[0] / top)


def voxels(setting: Setting = PAPER) -> tuple[Voxel, Voxel, Voxel]:
    """Near the axis and the front; far off it at z_k; far off it at the back."""
    z_k = setting.z_k
    return (
        Voxel(setting, "front, near the axis", 16.0, setting.front + 2),
        Voxel(setting, "$z_k$, far off the axis", setting.edge, z_k),
        Voxel(setting, "back, far off the axis", setting.edge, setting.back),
    )


def integral_errors() -> Figure:
    """Fig. 9."""
    from matplotlib.lines import Line2D

    figure = sheet(5.6)
    axes = figure.subplots(3, 2)
    for number, (voxel, (left, right)) in enumerate(zip(voxels(), axes, strict=True)):
        _shape(left, voxel)
        _errors(right, voxel)
        left.set_title(f"({'abc'[number]}) {voxel.name}", loc="left")
        right.set_title(f"$y$ = {voxel.y:.0f}, $z$ = {voxel.z:.1f}", loc="right")
    axes[2, 0].set_xlabel("ray angle (°)")
    axes[2, 1].set_xlabel("ray angle (°)")
    lines = [Line2D([], [], label=NAMES[form], **LINES[form]) for form in (*PLANAR, *SPATIAL)]
    kernels: list[tuple[str, dict[str, Any]]] = [
        ("trapezoid (row 1)", LINES["row1"]),
        ("box (row 2)", LINES["row2"]),
    ]
    shapes = [Line2D([], [], label=name, **look) for name, look in kernels]
    figure.legend(handles=shapes + lines, loc="outside lower center", ncols=2, frameon=False, handlelength=2.6)
    return figure


def _shape(axes: Axes, voxel: Voxel) -> None:
    """Isolines over angle and depth: in perspective space every ray is vertical."""
    radius = voxel.setting.kernel.radius
    place = np.linspace(-1, 1, 241)
    slope, depth = np.meshgrid(voxel.plane.slope(place[None])[0], np.linspace(-1.15, 1.15, 241) * radius)
    z = voxel.z + depth
    for box, look, width in ((False, LINES["row1"], 0.8), (True, LINES["row2"], 1.4)):
        drawn: dict[str, Any] = {"colors": [look["color"]], "linestyles": [look["linestyle"]], "linewidths": width}
        axes.contour(np.degrees(np.arctan(slope)), depth, voxel.shape.value(slope * z, z, box), ISOLINES, **drawn)
    for form, ends in (("row5", quad(voxel, grid_aligned=True)), ("row4", quad(voxel, grid_aligned=False))):
        axes.plot(np.degrees(np.arctan(ends[:, 1] / ends[:, 0])), ends[:, 0] - voxel.z, lw=1.3, **LINES[form])
    axes.set_ylabel("$z - z_v$ (voxels)", labelpad=1)
    axes.set_ylim(-1.15 * radius, 1.15 * radius)
    _angles(axes, voxel)


def quad(voxel: Voxel, grid_aligned: bool) -> np.ndarray:
    """[N, 2]: points (z, y) of the drawn quad, which is m·R to either side of the voxel."""
    length = np.hypot(voxel.y, voxel.z)
    direction = np.array([0.0, 1.0]) if grid_aligned else np.array([-voxel.y, voxel.z]) / length
    half = voxel.shape.m * voxel.setting.kernel.radius
    return np.array([voxel.z, voxel.y]) + np.outer(np.linspace(-half, half, 41), direction)


def _errors(axes: Axes, voxel: Voxel) -> None:
    place = np.linspace(-1, 1, RAYS)
    for form in shown(voxel):
        levels = voxel.levels(form, place)
        axes.semilogy(voxel.angles(place), np.where(levels > 0, levels, np.nan), **LINES[form])
    if voxel.z < voxel.setting.z_k:
        axes.text(0.5, 0.93, "form c: exact", transform=axes.transAxes, ha="center", va="top", color=GRAY)
    axes.axhline(1.0, color=BLACK, lw=0.4)
    axes.set_ylim(*SHOWN)
    axes.set_yticks([1e-4, 1e-2, 1, 25], ["10$^{-4}$", "10$^{-2}$", "1", "25"])
    axes.minorticks_off()
    axes.set_ylabel("error (levels)", labelpad=1)
    _angles(axes, voxel)


def shown(voxel: Voxel) -> tuple[str, ...]:
    """The forms drawn; before z_k, b has nothing to correct, since c is exact."""
    return (*PLANAR, *SPATIAL) if voxel.z >= voxel.setting.z_k else ("row5", "row4")


def _angles(axes: Axes, voxel: Voxel) -> None:
    from matplotlib.ticker import MaxNLocator

    low, high = voxel.angles(np.array([-1.0, 1.0]))
    axes.set_xlim(low, high)
    axes.xaxis.set_major_locator(MaxNLocator(4))


def integral_table() -> Table:
    """Errors by the ray's angle, in levels; before z_k form c stands for b and b′."""
    place, rows = np.linspace(-1, 1, 201), []
    for voxel in voxels():
        forms = (*shown(voxel), "c", "c")[:4]
        columns = [voxel.angles(place), *[voxel.levels(form, place) for form in forms]]
        rows += [(voxel.y, voxel.z, *[float(v) for v in row]) for row in zip(*columns, strict=True)]
    return Table(("y", "z", "angle (deg)", "row 5", "row 4", "form b or c", "form b' or c"), tuple(rows))

"""Figures 9 and 10: errors of footprints.

An error is |form − row 1| of one splat on one ray. `Plane` is the paper's analysis in the (y, z) plane, where
a stretch by m attenuates by 1/m; `Space` is the splat as drawn.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike
from paper.figures.drawing import LINES, draw_isolines
from paper.figures.paper_setup import PAPER, Stretched
from paper.forms import FORMS
from paper.tables import Table

from splatgl.report.diagram import BLACK, COLUMN, GRAY, RED, sheet
from splatgl.splat.footprint import ROWS, Splat, row1
from splatgl.splat.kernels import Kernel

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d.axes3d import Axes3D


# the forms shown; b′ is derived for the weight 1/m² of space, not for the plane's 1/m
PLANAR, SPATIAL = ("row5", "row4", "b"), ("bprime",)
NAMES = {"row5": "row 5, grid-aligned", "row4": "row 4, ray-perpendicular", "b": "form b", "bprime": "form b′"}
RAYS = 601
INTEGRAL_ISOLINES = (0.02, 0.2, 0.4, 0.6, 0.8)
# kernels that the rows integrate: their isolines and line widths
DRAWN = (
    ("row1", INTEGRAL_ISOLINES, 0.8),
    ("row2", INTEGRAL_ISOLINES, 1.4),
    ("row5", (0.02, 0.4), 0.8),
    ("row4", (0.02, 0.4), 0.8),
)
# rim of row 5's kernel
CIRCLE = {"color": RED, "linestyle": (0, (1, 1.5))}
# levels shown, logarithmically
INTEGRAL_RANGE = (2e-5, 90.0)


@dataclass(frozen=True)
class Voxel:
    """Voxel at (0, y, z) of the paper's volume. name: its title in the figure."""

    y: float
    z: float
    name: str = ""

    @property
    def plane(self) -> Plane:
        """Plane with this voxel alone."""
        return Plane(PAPER.kernel, PAPER.z_k, np.array([self.y]), np.array([self.z]))

    @property
    def shape(self) -> Stretched:
        """The voxel's kernel after antialiasing."""
        return Stretched(PAPER.kernel, self.y, self.z, PAPER.z_k)

    def angles(self, place: np.ndarray) -> np.ndarray:
        """Angles of sweep positions from the axis, degrees."""
        return np.degrees(np.arctan(self.plane.slope(place[None])[0]))

    def levels(self, form: str, place: np.ndarray) -> np.ndarray:
        """|form − row 1| on rays, in 1/255 of row 1's largest value."""
        plane = replace(self.plane, planar=form in PLANAR)
        top = float(row1(plane.splat(np.linspace(-1, 1, RAYS)[None])).max())
        return np.asarray(255 * difference(ALL[form], plane.splat(place[None]))[0] / top)


VOXELS = (
    Voxel(16.0, PAPER.front + 2, "front, near the axis"),
    Voxel(PAPER.edge, PAPER.z_k, "$z_k$, far off the axis"),
    Voxel(PAPER.edge, PAPER.back, "back, far off the axis"),
)


def integral_errors() -> Figure:
    """Figure 9."""
    from matplotlib.lines import Line2D

    figure = sheet(5.6)
    axes = figure.subplots(3, 2)
    for number, (voxel, (left, right)) in enumerate(zip(VOXELS, axes, strict=True)):
        _shape(left, voxel)
        _errors(right, voxel)
        left.set_title(f"({'abc'[number]}) {voxel.name}", loc="left")
        right.set_title(f"$y$ = {voxel.y:.0f}, $z$ = {voxel.z:.1f}", loc="right")
    for lowest in axes[2]:
        lowest.set_xlabel("ray angle (°)")
    lines = [Line2D([], [], label=NAMES[form], **LINES[form]) for form in (*PLANAR, *SPATIAL)]
    kernels = {"trapezoid (row 1)": "row1", "box (row 2)": "row2"}
    shapes = [Line2D([], [], label=name, **LINES[row]) for name, row in kernels.items()]
    shapes.append(Line2D([], [], label="rim of row 5’s kernel, a circle", lw=0.9, **CIRCLE))
    figure.legend(handles=shapes + lines, loc="outside lower center", ncols=2, frameon=False, handlelength=2.6)
    return figure


def _shape(axes: Axes, voxel: Voxel) -> None:
    """Draws isolines over angle and depth: in perspective space all rays are vertical."""
    radius = PAPER.kernel.radius
    place = np.linspace(-1, 1, 241)
    slope, depth = np.meshgrid(voxel.plane.slope(place[None])[0], np.linspace(-1.15, 1.15, 241) * radius)
    z = voxel.z + depth
    angle = np.degrees(np.arctan(slope))
    for row, isolines, width in DRAWN:
        value = voxel.shape.value(row, slope * z, z)
        draw_isolines(axes, (angle, depth, value), isolines, LINES[row], width)
    circle = np.hypot((slope * voxel.z - voxel.y) / voxel.shape.m, depth)
    draw_isolines(axes, (angle, depth, circle), (radius,), CIRCLE, 0.9)
    for row in ("row5", "row4"):
        ends = voxel.shape.quad(row)
        axes.plot(np.degrees(np.arctan(ends[:, 1] / ends[:, 0])), ends[:, 0] - voxel.z, lw=1.3, **LINES[row])
    axes.set_ylabel("$z - z_v$ (voxels)", labelpad=1)
    axes.set_ylim(-1.15 * radius, 1.15 * radius)
    _angles(axes, voxel)


def _errors(axes: Axes, voxel: Voxel) -> None:
    place = np.linspace(-1, 1, RAYS)
    for form in drawn_forms(voxel):
        levels = voxel.levels(form, place)
        axes.semilogy(voxel.angles(place), np.where(levels > 0, levels, np.nan), **LINES[form])
    if voxel.z < PAPER.z_k:
        axes.text(0.5, 0.93, "form c: exact", transform=axes.transAxes, ha="center", va="top", color=GRAY)
    axes.axhline(1.0, color=BLACK, lw=0.4)
    axes.set_ylim(*INTEGRAL_RANGE)
    axes.set_yticks([1e-4, 1e-2, 1, 25], ["10$^{-4}$", "10$^{-2}$", "1", "25"])
    axes.minorticks_off()
    axes.set_ylabel("error (levels)", labelpad=1)
    _angles(axes, voxel)


def drawn_forms(voxel: Voxel) -> tuple[str, ...]:
    """Forms in the figure; before z_k form c is exact, so that b has nothing to correct."""
    return (*PLANAR, *SPATIAL) if voxel.z >= PAPER.z_k else ("row5", "row4")


def _angles(axes: Axes, voxel: Voxel) -> None:
    from matplotlib.ticker import MaxNLocator

    low, high = voxel.angles(np.array([-1.0, 1.0]))
    axes.set_xlim(low, high)
    axes.xaxis.set_major_locator(MaxNLocator(4))


def integral_table() -> Table:
    """Errors by the ray's angle, in levels; before z_k form c stands for b and b′."""
    place, rows = np.linspace(-1, 1, 201), []
    for voxel in VOXELS:
        forms = (*drawn_forms(voxel), "c", "c")[:4]
        columns = [voxel.angles(place), *[voxel.levels(form, place) for form in forms]]
        rows += [(voxel.y, voxel.z, *row) for row in np.stack(columns, axis=1).tolist()]
    return Table(("y", "z", "angle (deg)", "row 5", "row 4", "form b or c", "form b' or c"), tuple(rows))


SURFACE_ROWS = ("row5", "row4", "row3", "row2")
# panels with surfaces, by their letters; (c) is the difference of the first two
TITLES = {"row5": "a", "row4": "b", "row2": "d"}
NAMED = {"row5": "grid-aligned", "row4": "ray-perpendicular", "row2": "box"}
# offsets of the difference's curves, and depth behind z_k from which the paper takes grid-aligned quads [M98 §4.2]
CURVES, SWITCH = (256.0, 192.0, 128.0, 64.0), 70.0
# grid of the table: voxels off the axis, and beyond z_k
OFFSETS = (0.0, 16.0, 32.0, 64.0, 96.0, 128.0, 160.0, 192.0, 224.0, 256.0)
BEFORE = (-102.4, -64.0, -32.0, -1.0)
BEHIND = (0.0, 1.0, 5.0, 10.0, 20.0, 35.0, 70.0, 105.0, 140.0, 184.0, 210.0, 280.0, 325.0, 350.0, 409.6)
DEPTHS = BEFORE + BEHIND
# additional depths for drawing, so that the step at z_k is vertical and the ridge beyond it smooth
STEP = (-1e-6, 2.5, 15.0, 27.0, 45.0, 57.0, 87.0, 120.0, 160.0, 240.0, 380.0)
SURFACE_ISOLINES = 6
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


@lru_cache(maxsize=4)
def surfaces(dz: tuple[float, ...] = DEPTHS, y: tuple[float, ...] = OFFSETS) -> Surfaces:
    """The four surfaces over depths z_k + dz and offsets y."""
    plane, shape = plane_of(dz, y), (len(dz), len(y))
    errors = {row: (plane.error(ALL[row]) / PAPER.kernel.scale).reshape(shape) for row in SURFACE_ROWS}
    return Surfaces(np.array(dz), np.array(y), errors, (plane.top() / PAPER.kernel.scale).reshape(shape))


@lru_cache(maxsize=4)
def cumulative(row: str) -> np.ndarray:
    """[depths, offsets]: Σ |row − row 1| over a footprint's rays, per pixel width, in the table's units."""
    plane = plane_of(DEPTHS, OFFSETS)
    place = np.linspace(-1, 1, PLANE_RAYS)[None]
    error = difference(ALL[row], plane.splat(place)) / PAPER.kernel.scale
    step = plane.reach * (2 / (PLANE_RAYS - 1)) * PAPER.z_k
    return np.asarray((error.sum(axis=1) * step).reshape(len(DEPTHS), len(OFFSETS)))


def plane_of(dz: ArrayLike, y: ArrayLike) -> Plane:
    """Voxels of the paper's volume at all depths z_k + dz and offsets y."""
    across, depth = np.meshgrid(y, PAPER.z_k + np.asarray(dz))
    return Plane(PAPER.kernel, PAPER.z_k, across.ravel(), depth.ravel())


def error_surfaces() -> Figure:
    """Figure 10."""
    grid = surfaces(tuple(sorted({*DEPTHS, *STEP} - {-1.0})), OFFSETS)
    figure = sheet(4.5, COLUMN)
    figure.set_layout_engine("none")
    for row, letter in TITLES.items():
        left, low = 0.5 * (letter in "bd"), 0.5 * (letter in "ab")
        axes = figure.add_axes((left + 0.02, low + 0.025, 0.47, 0.405), projection="3d")
        top = _surface(axes, grid, row)
        figure.text(left + 0.02, low + 0.48, f"({letter}) row {row[3:]}, {NAMED[row]}", va="center")
        figure.text(left + 0.02, low + 0.447, f"largest: {top}", va="center", fontsize=7)
    figure.text(0.02, 0.48, "(c) row 5 minus row 4", va="center")
    _difference(figure.add_axes((0.1, 0.085, 0.37, 0.355)), grid)
    return figure


def _difference(axes: Axes, grid: Surfaces) -> None:
    """Draws the largest error of row 5 minus that of row 4 over depth."""
    extra = grid.errors["row5"] - grid.errors["row4"]
    for y, dashes in zip(CURVES, ((), (6, 1.5), (3, 1.5), (1, 1.2)), strict=True):
        axes.plot(grid.dz, extra[:, grid.y == y], color=BLACK, lw=0.9, dashes=dashes, label=f"$y_v$ = {y:.0f}")
    for depth, name in ((0.0, "$z_k$"), (SWITCH, f"$z_k + {SWITCH:.0f}$")):
        axes.axvline(depth, color=GRAY, lw=0.6, dashes=(4, 2))
        axes.text(depth + 8, 0.97 * extra.max() if depth else 1.05 * extra.max(), name, va="top", fontsize=6.5)
    axes.set(xlim=grid.dz[[0, -1]], ylim=(0, 1.08 * extra.max()), xticks=[0, 200, 400])
    axes.tick_params(labelsize=6.5)
    axes.set_xlabel("$z_v - z_k$", labelpad=1, fontsize=7.5)
    axes.legend(frameon=False, loc="center right", fontsize=6.5, handlelength=2.4, borderaxespad=0.1)


def _surface(axes: Axes3D, grid: Surfaces, row: str) -> str:
    """Draws one surface over its isolines; returns its largest value as text."""
    top = float(grid.errors[row].max())
    power = int(np.floor(np.log10(top)))
    height = grid.errors[row] / 10.0**power
    y, dz = np.meshgrid(grid.y, grid.dz)
    floor = -FLOOR * height.max()
    look: dict[str, Any] = {"cmap": "YlGnBu", "edgecolor": BLACK, "linewidth": 0.15, "shade": False}
    axes.plot_surface(dz, y, height, rstride=1, cstride=1, vmin=-0.1 * height.max(), vmax=1.1 * height.max(), **look)
    isolines = np.linspace(0, 1, SURFACE_ISOLINES + 2)[1:-1] * height.max()
    axes.contour(dz, y, height, isolines, zdir="z", offset=floor, colors=BLACK, linewidths=0.5)
    axes.plot([0, 0], [grid.y[0], grid.y[-1]], floor, color=BLACK, lw=0.8, dashes=(4, 2))
    axes.set(xlim=grid.dz[[0, -1]], ylim=grid.y[[0, -1]], zlim=(floor, height.max()))
    _frame(axes, height.max())
    axes.text2D(0.0, 0.9, f"$\\times 10^{{{power}}}$", transform=axes.transAxes, fontsize=6.5)
    return f"${top * 10.0**-power:.3f} \\times 10^{{{power}}}$"


def _frame(axes: Axes3D, top: float) -> None:
    """Sets ticks, labels and viewing direction."""
    step = next(s for s in (0.5, 1.0, 2.0, 5.0) if top / s < 4.5)
    axes.set(xticks=[0, 200, 400], yticks=[0, 128, 256], zticks=np.arange(0.0, top + 1e-9, step))
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


def surface_table() -> Table:
    """The surfaces of Fig. 10 at its grid of voxels."""
    grid = surfaces()
    dz, y = np.meshgrid(grid.dz, grid.y, indexing="ij")
    columns = [dz, y, *(grid.errors[row] for row in SURFACE_ROWS), grid.top]
    rows = tuple(map(tuple, np.stack(columns, axis=-1).reshape(-1, len(columns)).tolist()))
    return Table(("z_v - z_k", "y", *SURFACE_ROWS, "largest row1"), rows)


Form = Callable[[Splat], np.ndarray]
ALL: dict[str, Form] = {**ROWS, **FORMS}

# rays across a footprint of the first sweep: in the plane, and along each of two axes
PLANE_RAYS = 401
SPACE_RAYS = 41
# the sweep's margin around the footprint
MARGIN = 1.05
# points along each axis of a refinement; each is four times finer, down to 1e−6 of a sweep's step
CLOSER = 9
ROUNDS = 7
# bisections of a footprint's rim: 1e−12 of a sweep
RIM_STEPS = 40
# fraction of a footprint inside its rim
INSIDE = 0.999


@dataclass(frozen=True)
class Peak:
    """Maxima of N functions. value [N]; place [N, D] in [−1, 1]^D."""

    value: np.ndarray
    place: np.ndarray


def maximum(function: Callable[[np.ndarray], np.ndarray], count: int, axes: int, points: int) -> Peak:
    """Largest values of `count` functions over [−1, 1]^axes.

    function: places [N, K, D] → values [N, K]. points: of the first sweep, along each axis.
    """
    middle, reach = np.zeros((count, 1, axes)), 1.0
    value = np.full(count, -np.inf)
    for step in range(ROUNDS + 1):
        steps = np.linspace(-1.0, 1.0, points if step == 0 else CLOSER)
        mesh = np.stack(np.meshgrid(*[steps] * axes, indexing="ij"), axis=-1).reshape(1, -1, axes)
        place = np.clip(middle + reach * mesh, -1.0, 1.0)
        values = function(place)
        best = values.argmax(axis=1)
        value = np.maximum(value, values[np.arange(count), best])
        middle = place[np.arange(count), best][:, None]
        reach *= steps[1] - steps[0]
    return Peak(value, middle[:, 0])


@dataclass(frozen=True)
class Plane:
    """Voxels (0, y, z) [N] and rays in their plane; place ±1 is a little outside of the footprint.

    planar: the paper's analysis, where a stretch by m weakens by 1/m; else the splat as drawn, weakened by 1/m².
    """

    kernel: Kernel
    z_k: float
    y: np.ndarray
    z: np.ndarray
    planar: bool = True

    @property
    def reach(self) -> np.ndarray:
        """[N]: slopes from the voxel's to the sweep's end."""
        m = np.maximum(self.z / self.z_k, 1.0)
        return np.asarray(MARGIN * self.kernel.radius * m / self.z * (1 + (self.y / self.z) ** 2))

    def slope(self, place: np.ndarray) -> np.ndarray:
        """Slopes dy/dz [N, K] of places [N or 1, K]."""
        return np.asarray((self.y / self.z)[:, None] + self.reach[:, None] * place)

    def splat(self, place: np.ndarray) -> Splat:
        """Arguments of the forms, for places [N or 1, K]."""
        slope = self.slope(place)
        voxel = np.stack([np.zeros_like(self.y), self.y, self.z], axis=-1)[:, None]
        return Splat(self.kernel, voxel, np.stack([np.zeros_like(slope), slope], axis=-1), self.z_k, self.planar)

    def error(self, form: Form) -> np.ndarray:
        """[N]: the largest |form − row 1|, excluding the rim (see `spike`)."""
        return self._largest(partial(difference, form))

    def top(self) -> np.ndarray:
        """[N]: the largest value of row 1."""
        return self._largest(row1)

    def spike(self, form: Form) -> np.ndarray:
        """[N]: the largest |form − row 1| where either footprint ends.

        The footprint of a truncated kernel falls to 0 like a square root; if the two end a few 1e−5 of
        their radius apart, the error is a spike of that width, which hardly any pixel samples.
        """
        rims = np.concatenate([self._rims(row1), self._rims(form)], axis=1)
        return np.asarray(difference(form, self.splat(rims)).max(axis=1))

    def _largest(self, value: Form) -> np.ndarray:
        """[N]: the largest value within row 1's footprint except its rim."""
        low, high = (INSIDE * self._rims(row1)).T[:, :, None]
        middle, half = (low + high) / 2, (high - low) / 2
        return maximum(lambda at: value(self.splat(middle + half * at[..., 0])), len(self.y), 1, PLANE_RAYS).value

    def _rims(self, form: Form) -> np.ndarray:
        """Places [N, 2] just outside of a footprint, on either side."""
        inside, outside = np.zeros((len(self.y), 2)), np.tile([-1.0, 1.0], (len(self.y), 1))
        for _ in range(RIM_STEPS):
            middle = (inside + outside) / 2
            within = form(self.splat(middle)) > 0
            inside, outside = np.where(within, middle, inside), np.where(within, outside, middle)
        return outside

    def levels(self, form: Form) -> np.ndarray:
        """[N]: the largest error in levels, 1/255 of row 1's largest value."""
        return np.asarray(255 * self.error(form) / self.top())


@dataclass(frozen=True)
class Space:
    """Voxels [N, 3], farther from the eye than twice the kernel's radius, and all rays of their footprints.

    A place is (radial, across) on the plane through the voxel perpendicular to its ray; length 1 is the footprint's rim
    with a margin.
    """

    kernel: Kernel
    z_k: float
    voxel: np.ndarray

    def splat(self, place: np.ndarray) -> Splat:
        """Arguments of the forms, for places [N or 1, K, 2]."""
        v = self.voxel
        length = np.linalg.norm(v, axis=-1)
        out = np.hypot(v[:, 0], v[:, 1])
        unit = np.where(out[:, None] > 0, v[:, :2] / np.where(out > 0, out, 1.0)[:, None], (1.0, 0.0))
        radial = np.concatenate([unit * v[:, 2:], -out[:, None]], axis=-1) / length[:, None]
        across = np.stack([-unit[:, 1], unit[:, 0], np.zeros_like(out)], axis=-1)
        # a ball appears larger than its radius at the voxel's distance
        rim = MARGIN * self.kernel.radius * np.maximum(v[:, 2] / self.z_k, 1.0) * length / (length - self.kernel.radius)
        step = place * rim[:, None, None]
        ray = v[:, None] + step[..., :1] * radial[:, None] + step[..., 1:] * across[:, None]
        return Splat(self.kernel, v[:, None], ray[..., :2] / ray[..., 2:], self.z_k)

    def levels(self, form: Form) -> np.ndarray:
        """[N]: the largest error in levels, 1/255 of row 1's largest value."""

        def largest(value: Form) -> np.ndarray:
            return maximum(lambda place: value(self.splat(place)), len(self.voxel), 2, SPACE_RAYS).value

        return np.asarray(255 * largest(partial(difference, form)) / largest(row1))


def difference(form: Form, splat: Splat) -> np.ndarray:
    """|form − row 1|."""
    return np.abs(form(splat) - row1(splat))

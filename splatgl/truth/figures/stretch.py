"""Figs. 4 and 7: beyond z_k a kernel is stretched along the diverging rays and attenuated by its area."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.splat.footprint import Splat, row1
from splatgl.splat.kernels import kernel
from splatgl.truth.figures.setting import straight_ahead
from splatgl.truth.figures.shapes import Stretched
from splatgl.truth.figures.style import BLACK, BLUE, GRAY, LINES, PALE, RED, bare, measure, plain, sheet
from splatgl.truth.figures.tables import Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Fig. 4: a picture of 6 pixels, so that z_k = 5.20; voxels at these multiples of it
FEW_PIXELS = 6
DEPTHS = (0.5, 1.0, 2.5)
# half the side of Fig. 4's patches, pixels
PATCH = 4
# Fig. 7: the voxel's depth over z_k, in a picture of 8 pixels
FAR = 1.5
ISOLINES = (0.001, 0.02, 0.15, 0.5, 0.9)


def growing_footprints() -> Figure:
    """Fig. 4."""
    figure = sheet(3.9)
    grid = figure.add_gridspec(3, len(DEPTHS), height_ratios=(1.25, 1, 1))
    _side_view(figure.add_subplot(grid[0, :]))
    for column, depth in enumerate(DEPTHS):
        for row, stretch in enumerate((False, True)):
            axes = figure.add_subplot(grid[1 + row, column])
            _patch(axes, depth, stretch)
            if column == 0:
                axes.set_ylabel("stretched" if stretch else "as it is")
            if stretch:
                axes.set_xlabel(_numbers(depth))
    return figure


def _numbers(depth: float) -> str:
    m = max(depth, 1.0)
    times = "" if depth == 1 else f"{depth:g}\\,"
    return f"$z_v = {times}z_k$\n$m = {m:g}$, weight ${1 / m**2:.2g}$"


def _side_view(axes: Axes) -> None:
    camera, shape = straight_ahead(FEW_PIXELS), kernel("crawfis-max")
    z_k = float(camera.z_k(1.0))
    end = z_k * DEPTHS[-1] + shape.radius + 0.5
    for edge in np.arange(-FEW_PIXELS // 2, FEW_PIXELS // 2 + 1):
        axes.plot([0, end], [0, edge / z_k * end], color=PALE, lw=0.6)
    turn = np.linspace(0, 2 * np.pi, 400)
    for depth in DEPTHS:
        voxel = Stretched(shape, 0.0, depth * z_k, z_k)
        z, y = voxel.z + shape.radius * np.cos(turn), shape.radius * np.sin(turn)
        if depth > 1:
            axes.plot(z, y, color=RED, lw=0.9, dashes=(3, 1.5))
        axes.plot(z, y * voxel.width(z), color=BLUE, lw=1.1)
        axes.plot(voxel.z, 0, ".", color=BLACK, ms=4)
    axes.plot([z_k, z_k], [-2.9, 2.9], color=BLACK, lw=0.8, dashes=(5, 2))
    axes.text(z_k, 3.45, **plain("$z_k$"))
    axes.plot(0, 0, "o", color=BLACK, ms=4)
    axes.text(0, -0.6, "eye", ha="center", va="top")
    axes.text(DEPTHS[-1] * z_k, 0.45, "as it is", color=RED, ha="center", va="bottom", fontsize=7)
    axes.text(DEPTHS[-1] * z_k - 1.75, 2.9, "stretched", color=BLUE, ha="right", va="center", fontsize=7)
    axes.set_xlim(-0.6, end)
    axes.set_ylim(-4.3, 4.3)
    bare(axes)


def footprint_pixels(depth: float, stretch: bool) -> np.ndarray:
    """Row 1 at the centres of [2 PATCH]² pixels as a share of F(0), for a voxel that projects to a pixel's corner."""
    shape, z_k = kernel("crawfis-max"), float(straight_ahead(FEW_PIXELS).z_k(1.0))
    centre = (np.arange(-PATCH, PATCH) + 0.5) / z_k
    slope = np.stack(np.meshgrid(centre, centre), axis=-1)
    splat = Splat(shape, np.array([0.0, 0.0, depth * z_k]), slope, z_k if stretch else np.inf)
    return np.asarray(row1(splat) / shape.footprint(np.zeros(())))


def _patch(axes: Axes, depth: float, stretch: bool) -> None:
    from matplotlib.patches import Circle

    share = footprint_pixels(depth, stretch)
    # darker is larger; the square root makes faint footprints visible
    axes.imshow(np.sqrt(share), cmap="Greys", vmin=0, vmax=1.15, extent=(-PATCH, PATCH, -PATCH, PATCH))
    for edge in range(-PATCH, PATCH + 1):
        axes.axhline(edge, color=PALE, lw=0.4)
        axes.axvline(edge, color=PALE, lw=0.4)
    radius = kernel("crawfis-max").radius / depth * (max(depth, 1.0) if stretch else 1.0)
    axes.add_patch(Circle((0, 0), radius, fill=False, edgecolor=BLUE if stretch else RED, lw=1.0))
    if not share.any():
        axes.text(0, -2.2, color=RED, fontsize=7, **plain("lost"))
    axes.set_xticks([])
    axes.set_yticks([])


def growing_table() -> Table:
    """Radius on the screen, weight, and the sum over pixels, with and without the stretch."""
    rows = []
    for depth in DEPTHS:
        m, radius = max(depth, 1.0), kernel("crawfis-max").radius
        sums = [float(footprint_pixels(depth, stretch).sum()) for stretch in (False, True)]
        rows.append((depth, m, 1 / m**2, radius / depth, radius * m / depth, *sums))
    names = ("z_v/z_k", "m", "weight", "radius (px)", "stretched (px)", "pixel sum", "stretched sum")
    return Table(names, tuple(rows))


def far_voxel() -> Stretched:
    """The voxel of Fig. 7: on the axis, at 1.5 z_k."""
    z_k = float(straight_ahead(8).z_k(1.0))
    return Stretched(kernel("gaussian"), 0.0, FAR * z_k, z_k)


def trapezoid_and_box() -> Figure:
    """Fig. 7."""
    voxel = far_voxel()
    figure = sheet(2.9)
    axes = figure.add_subplot()
    near, far, reach = voxel.z - 3.1, voxel.z + 3.1, 4.1
    for edge in np.arange(-4, 5):
        ends = np.array([near, far])
        axes.plot(ends, edge / voxel.z_k * ends, color=PALE, lw=0.6)
    z, y = np.meshgrid(np.linspace(near, far, 301), np.linspace(-reach, reach, 301))
    for box, look in ((False, LINES["row1"]), (True, LINES["row4"])):
        drawn: dict[str, Any] = {"colors": [look["color"]], "linestyles": [look["linestyle"]], "linewidths": 0.9}
        axes.contour(z, y, voxel.value(y, z, box), ISOLINES, **drawn)
        axes.plot(*voxel.outline(box).T, lw=1.3, **look)
    axes.plot(voxel.z, 0, ".", color=BLACK, ms=4)
    # the two differ most at the far corners
    back = voxel.z + voxel.kernel.radius
    box_half, half = (float(abs(voxel.outline(box)[2, 1])) for box in (True, False))
    for height in (box_half, half):
        axes.plot([back + 0.05, back + 0.45], [height] * 2, color=RED, lw=0.6)
    measure(axes, (back + 0.3, box_half), (back + 0.3, half), RED)
    axes.text(back + 0.5, (box_half + half) / 2, "$R^2\\!/z_k$", color=RED, ha="left", va="center")
    axes.plot([voxel.z] * 2, [-reach, reach], color=GRAY, lw=0.6, dashes=(4, 2))
    axes.text(voxel.z, reach + 0.35, **plain(f"$z_v = {FAR:g}\\,z_k$"))
    front = voxel.z - voxel.kernel.radius
    axes.text(front - 0.1, box_half, "box", color=BLUE, ha="right", va="center")
    axes.text(front - 0.1, 1.85, "trapezoid", ha="right", va="center", bbox=plain("")["bbox"])
    measure(axes, (voxel.z, -reach + 0.35), (back, -reach + 0.35))
    axes.text((voxel.z + back) / 2, -reach + 0.35, **plain("$R$"))
    axes.annotate("", (near + 0.9, -reach - 0.1), (near, -reach - 0.1), arrowprops={"arrowstyle": "->", "lw": 0.7})
    axes.text(near + 1.0, -reach - 0.1, "$z$", va="center")
    axes.set_xlim(near - 0.2, far + 0.3)
    axes.set_ylim(-reach - 0.4, reach + 0.7)
    bare(axes)
    return figure


def trapezoid_table() -> Table:
    """Half widths of both along depth."""
    voxel = far_voxel()
    depth = voxel.z + np.linspace(-1, 1, 9) * voxel.kernel.radius
    trapezoid, box = (voxel.kernel.radius * voxel.width(depth, b) for b in (False, True))
    rows = [tuple(float(v) for v in row) for row in zip(depth, trapezoid, box, trapezoid - box, strict=True)]
    return Table(("z", "trapezoid half width", "box half width", "difference"), tuple(rows))

"""Figures 1 to 4, 7 and 8: the geometry of splats."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from paper.figures.drawing import LINES, PALE, bare, draw_eye, draw_isolines, measure, plain
from paper.figures.paper_setup import Stretched, straight_ahead
from paper.tables import Table

from splatgl.geometry.camera import Camera
from splatgl.report.diagram import BLACK, BLUE, GRAY, RED, sheet
from splatgl.splat.footprint import ROWS, Splat, row1
from splatgl.splat.kernels import kernel

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# Fig. 8: the voxel's distance from the axis; its panels, with the stretch of each
OFF_AXIS = 5.0
STRETCHES = {
    "row1": ("trapezoid", "by $z/z_k$, as the rays"),
    "row2": ("box", "by $m = z_v/z_k$"),
    "row5": ("grid-aligned", "by $m$, read along the axis"),
    "row4": ("tilted", "by $m$, across the voxel’s ray"),
}
# slopes of the table's rays from the voxel's, in voxels at its depth
APART = (-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0)


def oblique_voxel() -> Stretched:
    """The voxel of Fig. 8: 26° off the axis at 1.5 z_k, so near that the stretches differ visibly."""
    z_k = float(straight_ahead(8).z_k(1.0))
    return Stretched(kernel("gaussian"), OFF_AXIS, FAR * z_k, z_k)


def four_stretches() -> Figure:
    """Figure 8."""
    voxel = oblique_voxel()
    figure = sheet(3.9)
    ends = voxel.z + np.array([-3.4, 3.4])
    z, y = np.meshgrid(np.linspace(ends[0], ends[1], 241), voxel.y + np.linspace(-4.6, 4.6, 241))
    for number, (axes, (row, (name, about))) in enumerate(
        zip(figure.subplots(2, 2).flat, STRETCHES.items(), strict=True)
    ):
        for edge in range(-1, 9):
            axes.plot(ends, edge / voxel.z_k * ends, color=PALE, lw=0.6)
        draw_isolines(axes, (z, y, voxel.value(row, y, z)), ISOLINES[1:], LINES["row1"], 0.9)
        if row in ("row1", "row2"):
            axes.plot(*voxel.outline(row == "row2").T, color=BLUE, lw=1.3)
        else:
            axes.plot(*voxel.quad(row).T, color=BLUE, lw=2.0)
        axes.plot(voxel.z, voxel.y, ".", color=BLACK, ms=4)
        axes.text(ends[0], voxel.y + 5.1, f"({'abcd'[number]}) row {row[3:]}, {name}", va="center")
        axes.text(voxel.z, voxel.y - 5.0, about, ha="center", va="center", fontsize=7)
        bare(axes, (ends[0], ends[1]), (voxel.y - 4.6, voxel.y + 4.6))
    return figure


def stretches_table() -> Table:
    """Values of the four rows on rays across the voxel, as a share of the first's largest one there."""
    voxel = oblique_voxel()
    slope = (voxel.y + np.array(APART)) / voxel.z
    splat = Splat(
        voxel.kernel,
        np.array([0.0, voxel.y, voxel.z]),
        np.stack([0 * slope, slope], axis=-1),
        voxel.z_k,
    )
    values = np.stack([ROWS[row](splat) for row in STRETCHES], axis=1)
    rows = np.column_stack([APART, np.degrees(np.arctan(slope)), values / values[:, 0].max()]).tolist()
    return Table(("from the voxel", "angle (deg)", *STRETCHES), tuple(map(tuple, rows)))


@dataclass(frozen=True, eq=False)
class Resampling:
    """A slice of a volume of unit spacing, one of its planes of voxels at z_k, seen by a picture of few pixels."""

    camera: Camera
    planes: np.ndarray
    rows: np.ndarray

    @property
    def z_k(self) -> float:
        """Depth at which a voxel is one pixel wide."""
        return float(self.camera.z_k(1.0))

    @property
    def slopes(self) -> np.ndarray:
        """Slopes of the pixels' rays."""
        return self.camera.slopes()[1]

    def pitch(self, depth: float) -> float:
        """Distance of two neighbouring rays."""
        return float(self.camera.pixel_pitch(depth))

    @property
    def samples(self) -> np.ndarray:
        """[N, 2]: (depth, y) where the rays meet planes of voxels inside of the volume."""
        depth, slope = (a.ravel() for a in np.meshgrid(self.planes, self.slopes))
        inside = np.abs(slope * depth) <= self.rows.max()
        return np.stack([depth, slope * depth], axis=1)[inside]

    @property
    def marked(self) -> tuple[float, float, float]:
        """Three planes: before, at and beyond z_k."""
        at = int(np.abs(self.planes - self.z_k).argmin())
        return float(self.planes[1]), float(self.planes[at]), float(self.planes[-2])


def example_resampling() -> Resampling:
    """Eight pixels, half-angle 30°: z_k = 6.93; the volume reaches from z_k − 4 to z_k + 7."""
    camera = straight_ahead(8)
    return Resampling(camera, float(camera.z_k(1.0)) + np.arange(-4, 8), np.arange(-4.5, 5))


def sampling_table() -> Table:
    """Ray distance and rays per voxel at each plane of voxels."""
    scene = example_resampling()
    rows = [(float(z), float(z / scene.z_k), scene.pitch(z), 1 / scene.pitch(z)) for z in scene.planes]
    return Table(("z", "z/z_k", "ray distance (voxels)", "rays per voxel"), tuple(rows))


def eye_space() -> Figure:
    """Figure 1."""
    scene = example_resampling()
    figure = sheet(2.75)
    axes = figure.add_subplot()
    z, y = scene.planes, scene.rows
    for depth in z:
        axes.plot([depth, depth], [y[0], y[-1]], color=PALE, lw=0.6)
    for row in y:
        axes.plot([z[0], z[-1]], [row, row], color=PALE, lw=0.6)
    for slope in scene.slopes:
        end = min(z[-1] + 0.8, (y[-1] + 0.6) / abs(slope))
        axes.plot([0, end], [0, slope * end], color=BLUE, lw=0.6)
    _mark(axes, scene, scene.samples, y[-1] + 0.8)
    slopes = scene.slopes
    for depth in scene.marked:
        measure(axes, (depth, depth * slopes[3]), (depth, depth * slopes[4]), RED)
        axes.text(depth, y[0] - 0.95, color=RED, **plain(f"{scene.pitch(depth):.2f}$\\,s$"))
    axes.text(z[0] - 0.5, y[0] - 0.95, "ray distance", ha="right", va="center", color=RED)
    draw_eye(axes, 0.5)
    bare(axes, (-0.6, z[-1] + 1), (y[0] - 1.5, y[-1] + 1.6))
    return figure


def perspective_space() -> Figure:
    """Figure 2."""
    scene = example_resampling()
    figure = sheet(2.4)
    axes = figure.add_subplot()
    z, y = scene.planes, scene.rows
    # pixels from the picture's middle: y z_k/z
    top = float(scene.camera.size[1]) / 2
    along = np.linspace(z[0], z[-1], 200)
    for depth in z:
        end = min(y[-1] * scene.z_k / depth, top)
        axes.plot([depth, depth], [-end, end], color=PALE, lw=0.6)
    for row in y:
        across = row * scene.z_k / along
        axes.plot(along, np.where(np.abs(across) <= top, across, np.nan), color=PALE, lw=0.6)
    for slope in scene.slopes:
        axes.plot([z[0] - 0.8, z[-1] + 0.8], [slope * scene.z_k] * 2, color=BLUE, lw=0.6)
    samples = scene.samples
    bent = np.stack([samples[:, 0], samples[:, 1] * scene.z_k / samples[:, 0]], axis=1)
    _mark(axes, scene, bent, top + 0.4)
    for depth in scene.marked:
        half = 0.5 * scene.z_k / depth
        measure(axes, (depth, -half), (depth, half), RED)
        axes.text(depth, -top - 0.8, color=RED, **plain(f"{2 * half:.2f}$\\,p$"))
    axes.text(z[0] - 0.5, -top - 0.8, "voxel distance", ha="right", va="center", color=RED)
    bare(axes, (-0.6, z[-1] + 1), (-top - 1.3, top + 1.2))
    return figure


def _mark(axes: Axes, scene: Resampling, samples: np.ndarray, top: float) -> None:
    """Samples, z_k, and labels of the regions on either side."""
    axes.plot(*samples.T, ".", color=BLACK, ms=2.6)
    axes.plot([scene.z_k] * 2, [-top, top], color=BLACK, lw=0.8, dashes=(5, 2))
    axes.text(scene.z_k, top + 0.4, "$z_k$", ha="center", va="center")
    axes.text(scene.z_k - 0.5, top + 0.4, "enough samples", ha="right", va="center")
    axes.text(scene.z_k + 0.5, top + 0.4, "too few: aliasing", ha="left", va="center")


def similar_triangles() -> Figure:
    """Figure 3."""
    camera = straight_ahead(3)
    z_k, pitch = float(camera.z_k(1.0)), float(camera.pixel_pitch(1.0))
    figure = sheet(1.75)
    axes = figure.add_subplot()
    # the pixel on the axis; its sides' rays are one voxel apart at z_k
    for side in (-0.5, 0.5):
        axes.plot([0, z_k + 0.55], [0, side * pitch * (z_k + 0.55)], color=BLUE, lw=0.9)
    for edge in np.arange(-1.5, 2):
        axes.plot([0.97, 1.03], [edge * pitch] * 2, color=BLACK, lw=0.9)
    axes.plot([1, 1], [-1.5 * pitch, 1.5 * pitch], color=BLACK, lw=0.9)
    axes.plot([1, 1], [-pitch / 2, pitch / 2], color=BLACK, lw=3, solid_capstyle="butt")
    square = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5)])
    axes.fill(z_k + square[:, 0], square[:, 1], facecolor="#e8e8e8", edgecolor=GRAY, lw=0.7)
    axes.plot([0, z_k], [0, 0], color=GRAY, lw=0.6, dashes=(4, 2))
    axes.plot(0, 0, "o", color=BLACK, ms=4)
    measure(axes, (z_k, -0.5), (z_k, 0.5), RED)
    axes.text(z_k + 0.1, 0.0, "$s$", color=RED, va="center")
    axes.text(1.07, 0.035, "$p$", color=RED, va="bottom")
    measure(axes, (0, -0.85), (1, -0.85))
    axes.text(0.5, -0.85, **plain(r"$z_{\mathrm{img}}$"))
    measure(axes, (0, -1.15), (z_k, -1.15))
    axes.text(z_k / 2, -1.15, **plain("$z_k$"))
    axes.plot([z_k, z_k], [-1.25, -0.5], color=GRAY, lw=0.5)
    axes.plot([1, 1], [-0.95, -1.5 * pitch], color=GRAY, lw=0.5)
    axes.plot([0, 0], [-1.25, -0.1], color=GRAY, lw=0.5)
    axes.text(0, 0.12, "eye", ha="center")
    axes.text(1, 1.5 * pitch + 0.08, "image plane", ha="center")
    axes.text(z_k, 0.58, "voxel", ha="center")
    axes.text(1.9, 0.66, r"$\frac{p}{z_{\mathrm{img}}} = \frac{s}{z_k}$", ha="center", va="center", fontsize=11)
    bare(axes, (-0.25, z_k + 0.7), (-1.3, 0.95))
    return figure


def triangles_table() -> Table:
    """z_k from Eq. 3 and from the rays themselves, for pictures of several sizes."""
    rows = []
    for pixels in (3, 8, 64, 512):
        camera = straight_ahead(pixels)
        between = float(np.diff(camera.slopes()[1])[0])
        rows.append((float(pixels), float(camera.pixel_pitch(1.0)), float(camera.z_k(1.0)), 1 / between))
    return Table(("pixels", "p/z_img", "z_k = s z_img/p", "depth where rays are s apart"), tuple(rows))


# Fig. 4: a picture of 6 pixels, so that z_k = 5.20; voxels at these multiples of it
FEW_PIXELS = 6
DEPTHS = (0.5, 1.0, 2.5)
# half the side of Fig. 4's patches, pixels
PATCH = 4
# Fig. 7: the voxel's depth over z_k, in a picture of 8 pixels
FAR = 1.5
ISOLINES = (0.001, 0.02, 0.15, 0.5, 0.9)


def growing_footprints() -> Figure:
    """Figure 4."""
    figure = sheet(3.9)
    grid = figure.add_gridspec(3, len(DEPTHS), height_ratios=(1.25, 1, 1))
    _stretch_side_view(figure.add_subplot(grid[0, :]))
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


def _stretch_side_view(axes: Axes) -> None:
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
    draw_eye(axes, 0.6)
    axes.text(DEPTHS[-1] * z_k, 0.45, "as it is", color=RED, ha="center", va="bottom", fontsize=7)
    axes.text(DEPTHS[-1] * z_k - 1.75, 2.9, "stretched", color=BLUE, ha="right", va="center", fontsize=7)
    bare(axes, (-0.6, end), (-4.3, 4.3))


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
    axes.set(xticks=[], yticks=[])


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
    """Figure 7."""
    voxel = far_voxel()
    figure = sheet(2.9)
    axes = figure.add_subplot()
    near, far, reach = voxel.z - 3.1, voxel.z + 3.1, 4.1
    for edge in np.arange(-4, 5):
        ends = np.array([near, far])
        axes.plot(ends, edge / voxel.z_k * ends, color=PALE, lw=0.6)
    z, y = np.meshgrid(np.linspace(near, far, 301), np.linspace(-reach, reach, 301))
    for box, look in ((False, LINES["row1"]), (True, LINES["row4"])):
        draw_isolines(axes, (z, y, voxel.value("row2" if box else "row1", y, z)), ISOLINES, look, 0.9)
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
    bare(axes, (near - 0.2, far + 0.3), (-reach - 0.4, reach + 0.7))
    return figure


def trapezoid_table() -> Table:
    """Half widths of both along depth."""
    voxel = far_voxel()
    depth = voxel.z + np.linspace(-1, 1, 9) * voxel.kernel.radius
    trapezoid, box = (voxel.kernel.radius * voxel.width(depth, b) for b in (False, True))
    rows = np.stack([depth, trapezoid, box, trapezoid - box], axis=1).tolist()
    return Table(("z", "trapezoid half width", "box half width", "difference"), tuple(map(tuple, rows)))

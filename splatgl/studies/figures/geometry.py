"""Figures 1 to 4, 7 and 8: the geometry of splats."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from splatgl.splat.camera import Camera
from splatgl.splat.footprint import Splat, row1
from splatgl.splat.kernels import Kernel, kernel
from splatgl.studies.figures.paper_setup import Stretched, straight_ahead
from splatgl.studies.plots import (
    BLACK,
    BLUE,
    GRAY,
    LINES,
    PALE,
    RED,
    bare,
    draw_eye,
    draw_isolines,
    measure,
    plain,
    sheet,
)
from splatgl.studies.tables import Table

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
        """Distances at which rows 1, 4 and 5 evaluate F; row 1's is the true distance of the ray."""
        splat = self.splat
        return {"row1": float(splat.distance), "row4": float(splat.tan_length), "row5": float(np.hypot(*splat.offset))}

    @property
    def points(self) -> dict[str, np.ndarray]:
        """(z, y) on the ray: nearest to the voxel, on its ray-perpendicular and on its grid-aligned plane."""
        voxel, ray = np.array([self.z, self.y]), np.array([1.0, self.slope])
        return {
            "row1": ray * (voxel @ ray) / (ray @ ray),
            "row4": ray * (voxel @ voxel) / (voxel @ ray),
            "row5": ray * self.z,
        }


def example_sight() -> Sight:
    """A voxel 34° off the axis and 3.6 spacings away, a ray 20° off: near, so that the quads differ visibly."""
    return Sight(kernel("crawfis-max"), 2.0, 3.0, 0.37)


def orientations() -> Figure:
    """Figure 8."""
    sight = example_sight()
    figure = sheet(3.7)
    grid = figure.add_gridspec(2, 1, height_ratios=(1.9, 1))
    _orientation_side_view(figure.add_subplot(grid[0]), sight)
    _profile(figure.add_subplot(grid[1]), sight)
    return figure


COLORS = {"row1": BLACK, "row4": BLUE, "row5": RED}
MARKS = {"row1": "o", "row4": "s", "row5": "^"}


def _orientation_side_view(axes: Axes, sight: Sight) -> None:
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
    draw_eye(axes, 0.15)
    axes.text(end + 0.05, sight.slope * end, "pixel’s ray", va="center")
    top = voxel + across * radius
    axes.text(top[0] - 0.08, top[1] + 0.05, "ray-perpendicular", color=BLUE, ha="right", va="bottom")
    axes.text(sight.z + 0.1, sight.y + radius + 0.1, "grid-aligned", color=RED, ha="left", va="bottom")
    axes.text(sight.z + 0.14, sight.y + 0.05, "$\\mathbf{v}$", va="bottom")
    bare(axes, (-0.35, end + 1.1), (-0.5, sight.y + radius + 0.45))


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
    axes.set(xlabel="distance $d$ from the voxel (voxels)", ylabel="$F(d)/F(0)$")
    axes.set(xlim=(0, sight.kernel.radius), ylim=(0, 1.05))
    axes.legend(frameon=False, loc="upper right", handlelength=1, borderaxespad=0.2)


def orientation_table() -> Table:
    """Distance at which each orientation evaluates F, and the value."""
    sight = example_sight()
    peak = float(sight.kernel.footprint(np.zeros(())))
    rows = [(name, d, float(sight.kernel.footprint(np.array(d))) / peak) for name, d in sight.distances.items()]
    return Table(("form", "distance", "F/F(0)"), tuple(rows))


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
        draw_isolines(axes, (z, y, voxel.value(y, z, box)), ISOLINES, look, 0.9)
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

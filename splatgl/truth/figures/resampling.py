"""Figs. 1, 2 and 3: perspective rays sample a volume more coarsely with depth, and at z_k at its own resolution."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from splatgl.splat.camera import Camera
from splatgl.truth.figures.setting import straight_ahead
from splatgl.truth.figures.style import BLACK, BLUE, GRAY, PALE, RED, bare, measure, plain, sheet
from splatgl.truth.figures.tables import Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


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


def example() -> Resampling:
    """Eight pixels, half-angle 30°: z_k = 6.93; the volume reaches from z_k − 4 to z_k + 7."""
    camera = straight_ahead(8)
    return Resampling(camera, float(camera.z_k(1.0)) + np.arange(-4, 8), np.arange(-4.5, 5))


def sampling_table() -> Table:
    """Ray distance and rays per voxel at each plane of voxels."""
    scene = example()
    rows = [(float(z), float(z / scene.z_k), scene.pitch(z), 1 / scene.pitch(z)) for z in scene.planes]
    return Table(("z", "z/z_k", "ray distance (voxels)", "rays per voxel"), tuple(rows))


def eye_space() -> Figure:
    """Fig. 1."""
    scene = example()
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
        text = plain(f"{scene.pitch(depth):.2f}$\\,s$")
        axes.text(depth, y[0] - 0.95, color=RED, **text)
    axes.text(z[0] - 0.5, y[0] - 0.95, "ray distance", ha="right", va="center", color=RED)
    axes.plot(0, 0, "o", color=BLACK, ms=4)
    axes.text(0, -0.5, "eye", ha="center", va="top")
    axes.set_xlim(-0.6, z[-1] + 1)
    axes.set_ylim(y[0] - 1.5, y[-1] + 1.6)
    bare(axes)
    return figure


def perspective_space() -> Figure:
    """Fig. 2."""
    scene = example()
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
    axes.set_xlim(-0.6, z[-1] + 1)
    axes.set_ylim(-top - 1.3, top + 1.2)
    bare(axes)
    return figure


def _mark(axes: Axes, scene: Resampling, samples: np.ndarray, top: float) -> None:
    """Samples, z_k, and labels of the regions on either side."""
    axes.plot(*samples.T, ".", color=BLACK, ms=2.6)
    axes.plot([scene.z_k] * 2, [-top, top], color=BLACK, lw=0.8, dashes=(5, 2))
    axes.text(scene.z_k, top + 0.4, "$z_k$", ha="center", va="center")
    axes.text(scene.z_k - 0.5, top + 0.4, "enough samples", ha="right", va="center")
    axes.text(scene.z_k + 0.5, top + 0.4, "too few: aliasing", ha="left", va="center")


def similar_triangles() -> Figure:
    """Fig. 3."""
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
    axes.set_xlim(-0.25, z_k + 0.7)
    axes.set_ylim(-1.3, 0.95)
    bare(axes)
    return figure


def triangles_table() -> Table:
    """z_k from Eq. 3 and from the rays themselves, for pictures of several sizes."""
    rows = []
    for pixels in (3, 8, 64, 512):
        camera = straight_ahead(pixels)
        between = float(np.diff(camera.slopes()[1])[0])
        rows.append((float(pixels), float(camera.pixel_pitch(1.0)), float(camera.z_k(1.0)), 1 / between))
    return Table(("pixels", "p/z_img", "z_k = s z_img/p", "depth where rays are s apart"), tuple(rows))

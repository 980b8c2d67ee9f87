"""The paper's figures, drawn from the geometry and formulas of this package, with their data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from paper.figures import footprint_errors, geometry, motion_blur
from paper.tables import Table

from splatgl.report.diagram import encode, style

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing


@dataclass(frozen=True)
class Figure:
    """A figure of the paper: its number, or the name of a table, its caption, drawing and data."""

    number: int | str
    caption: str
    draw: Callable[[], Drawing]
    table: Callable[[], Table]

    @property
    def title(self) -> str:
        """The caption after the number of a figure."""
        return f"Figure {self.number}. {self.caption}" if isinstance(self.number, int) else self.caption

    def picture(self, suffix: str, maker: str = "splatgl") -> bytes:
        """Bytes of a .png or .svg that names its maker. Raises InputError without matplotlib."""
        with style():
            about = {"Title": self.title.partition(". ")[0], "Description": self.caption}
            return encode(self.draw(), suffix, about, maker)


_ALL = (
    Figure(
        1,
        "Eye space: perspective rays diverge, so that beyond z_k a volume of spacing s is sampled too coarsely.",
        geometry.eye_space,
        geometry.sampling_table,
    ),
    Figure(
        2,
        "Perspective space: the same rays are parallel and one pixel p apart, and beyond z_k the volume's "
        "samples crowd together more closely than that.",
        geometry.perspective_space,
        geometry.sampling_table,
    ),
    Figure(
        3,
        "By similar triangles a voxel of side s covers just one pixel of side p at the depth z_k = s z_img/p.",
        geometry.similar_triangles,
        geometry.triangles_table,
    ),
    Figure(
        4,
        "A voxel's footprint on the pixels before, at and beyond z_k: stretched by m = z_v/z_k and weakened by "
        "(z_k/z_v)² it keeps its energy and can't fall between the pixels (grey: the square root of its value).",
        geometry.growing_footprints,
        geometry.growing_table,
    ),
    Figure(
        7,
        "Beyond z_k a kernel widens with the rays (trapezoid, solid); stretching it by the same m at all depths "
        "(box, dashed) is off by at most R²/z_k.",
        geometry.trapezoid_and_box,
        geometry.trapezoid_table,
    ),
    Figure(
        8,
        "Four stretches of a kernel beyond z_k, off the axis, by what Table 1 integrates along diverging rays: the "
        "trapezoid (a), the box (b), a quad parallel to the image (c), and one perpendicular to the eye–voxel ray (d), "
        "across which the kernel is stretched.",
        geometry.four_stretches,
        geometry.stretches_table,
    ),
    Figure(
        9,
        "Three voxels of a 512³ volume in perspective space (left): isolines of the stretched kernel, of the kernels "
        "that rows 4 and 5 integrate, and their quads; dotted the circle to which a grid-aligned kernel maps. Right: "
        "the line integrals' errors in 1/255 of their peak.",
        footprint_errors.integral_errors,
        footprint_errors.integral_table,
    ),
    Figure(
        10,
        "The largest error of rows 5, 4 and 2 of Table 1 against row 1 (a, b, d) for a voxel at depth z_v and distance "
        "y_v from the axis of a 512³ volume, and that of row 5 minus that of row 4 over depth (c); dashed: z_k, and "
        "in (c) also z_k + 70, from where the paper takes grid-aligned quads.",
        footprint_errors.error_surfaces,
        footprint_errors.surface_table,
    ),
    Figure(
        11,
        "A moving splat: its footprint (a) is cut in half and stretched by the path's length l (b), which weakens it; "
        "the mean of the footprint along the path (c) is what it should be. Below: along the path's middle.",
        motion_blur.construction,
        motion_blur.gain_table,
    ),
)
FIGURES = {int(figure.number): figure for figure in _ALL}

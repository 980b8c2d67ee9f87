"""`Splats`: rows (z, y) of splats sorted by x.

Positions are grid indices, small and exact in float32; the affine grid maps them to world space in
float64. Only non-empty rows are stored (compressed sparse rows).  [M98 §5, voxel extractor]
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from splatgl.errors import expected
from splatgl.splat.classification.post import PostClassified
from splatgl.splat.extraction.lattice import Lattice, index_rows, lattice_across
from splatgl.splat.extraction.parts import in_parts
from splatgl.splat.extraction.points import checked_points, checked_spacing
from splatgl.splat.extraction.records import POINT, color_scale, linear_color

if TYPE_CHECKING:
    from splatgl.splat.extraction.extract import Source
    from splatgl.splat.extraction.label_normals import LabelNormals
    from splatgl.splat.view.mask import MaskField

# most splats kept on the GPU, 400 MB of voxels' records: the limit of texture rows
MOST_KEPT = 2**24
# optical depths computed at a time
DEPTHS = 2**18
# largest colour and optical depth: their sums fit float32
BRIGHTEST = 1e30


@dataclass(frozen=True, eq=False)
class Grid:
    """The affine lattice of positions: world = world_from_index @ position + origin."""

    world_from_index: np.ndarray
    origin: np.ndarray

    @property
    def mean_spacing(self) -> float:
        """|det A|^(1/3): the side of the cube with a voxel's volume; the unit of length in GL."""
        return float(np.exp(np.linalg.slogdet(self.world_from_index)[1] / 3))

    @property
    def smallest_spacing(self) -> float:
        """The smallest width of a voxel in any direction, world units: the first below a pixel."""
        return float(np.linalg.svd(self.world_from_index, compute_uv=False)[-1])

    @property
    def cubic(self) -> bool:
        """True if a voxel is a cube in any rotation: the footprint is then a disc."""
        scaled = self.world_from_index / self.mean_spacing
        return bool(np.abs(scaled.T @ scaled - np.eye(3)).max() < 1e-6)

    def index_from_world(self, point: np.ndarray) -> np.ndarray:
        """Grid coordinates (x, y, z) of world points [..., 3], float64."""
        return np.asarray((np.asarray(point) - self.origin) @ np.linalg.inv(self.world_from_index).T)


@dataclass(frozen=True, eq=False)
class Splats:
    """Splats in row order: z, then y, then x ascending.

    records [N]: see records.py; of values if `post` classifies them. cell_x int [N]: each splat's cell along x.
    row_z, row_y int32 [M]: the non-empty rows; row_start int64 [M+1] into the records.
    unit: reference length of opacities, world units. shaded: whether the transfer function shades.
    dropped_depth: largest optical depth that the threshold removed from one axis line. source: of all splats of a
    volume, from which pictures that take others extract them. mask: what cuts rays through values; None: nothing.
    frame: as of the volume.
    labels: normals of voxels of labels, which are drawn as boxes; None: these are none.
    unmasked: missing samples beside values, which `mask` leaves out: matter is up to a voxel wider there.
    """

    records: np.ndarray
    cell_x: np.ndarray
    row_z: np.ndarray
    row_y: np.ndarray
    row_start: np.ndarray
    grid: Grid
    unit: float
    shaded: bool = False
    dropped_depth: float = 0.0
    name: str = ""
    post: PostClassified | None = None
    source: Source | None = None
    mask: MaskField | None = None
    frame: str | None = None
    labels: LabelNormals | None = None
    unmasked: int = 0

    def __len__(self) -> int:
        return len(self.records)

    def __repr__(self) -> str:
        """One line: their number, and what they are."""
        kind = "values" if self.post is not None else "classified" + ", shaded" * self.shaded
        return f"<Splats {self.name!r}: {len(self):,} {kind}, spacing {self.grid.mean_spacing:.4g}>"

    @classmethod
    def from_points(
        cls,
        points: np.ndarray,
        colors: np.ndarray,
        extinctions: np.ndarray,
        spacing: float | Sequence[float] = 1.0,
    ) -> Splats:
        """Unshaded splats at arbitrary positions.

        points [N, 3] world; colors [N, 3] linear RGB ≥ 0; extinctions [N] ≥ 0 per world length.
        spacing, a number or (x, y, z), is the kernel's scale and the lattice whose cells
        round(p / spacing) give the order; ties keep the input's. Non-finite and transparent points
        are dropped. Raises InputError for other shapes, negative numbers and those beyond float32's range.
        """
        points, colors, extinctions = checked_points(points, colors, extinctions)
        scale = checked_spacing(spacing)
        with np.errstate(invalid="ignore", over="ignore"):
            cells = np.rint(points / scale)
        keep = np.isfinite(cells).all(axis=1) & np.isfinite(colors).all(axis=1)
        keep &= np.isfinite(extinctions) & (extinctions > 0)
        points, colors, extinctions, cells = points[keep], colors[keep], extinctions[keep], cells[keep]
        base = cells.min(axis=0) if len(cells) else np.zeros(3)
        if len(cells) and np.ptp(cells, axis=0).max() >= 2**31:
            raise expected("points", "at most 2³¹ cells along each axis", np.ptp(cells, axis=0).max())
        grid = Grid(np.diag(scale), base * scale)
        cells = (cells - base).astype(np.int32)
        order = np.lexsort((cells[:, 0], cells[:, 1], cells[:, 2]))
        depths = extinctions[order] * grid.mean_spacing
        if max(depths.max(initial=0.0), colors.max(initial=0.0)) > BRIGHTEST:
            raise expected("colors and extinctions", f"at most {BRIGHTEST:g}, per spacing", "larger ones")
        records = np.zeros(len(points), POINT)
        records["position"] = ((points - grid.origin) / scale)[order]
        records["optical_depth"] = depths
        records["color"] = colors[order]
        return assemble(records, cells[order], grid, unit=grid.mean_spacing, name="points")

    @property
    def positions(self) -> np.ndarray:
        """Grid indices (x, y, z) [N, 3], float32."""
        return np.asarray(self.records["position"], np.float32)

    @property
    def colors(self) -> np.ndarray:
        """Linear RGB [N, 3], float32, of splats that are classified before reconstruction."""
        return linear_color(self.records)

    @cached_property
    def index_bounds(self) -> np.ndarray:
        """[2, 3]: smallest and largest position, in grid indices; zeros if there is no splat."""
        if not len(self):
            return np.zeros((2, 3))
        position = self.records["position"]
        return np.array([[reach(position[:, axis]) for axis in range(3)] for reach in (np.min, np.max)], np.float64)

    @property
    def corners(self) -> np.ndarray:
        """The eight corners [8, 3], in world units, of the box of all splats, half a voxel larger."""
        return np.asarray(self.corners_in_grid(0.5) @ self.grid.world_from_index.T + self.grid.origin)

    def corners_in_grid(self, margin: float = 0.0) -> np.ndarray:
        """The eight corners [8, 3], in grid indices, of the box of all centres, larger by a margin in voxels."""
        return corners_of(*(self.index_bounds + np.array([[-margin], [margin]])))

    @cached_property
    def outline(self) -> np.ndarray:
        """Points [N, 3], world units, around all splats: the ends of all rows, half a voxel outwards."""
        if not len(self):
            return self.corners
        last = np.concatenate([self.row_start[:-1], self.row_start[1:] - 1])
        ends = self.records["position"][last].astype(np.float64)
        middle = self.index_bounds.mean(axis=0)
        # both signs, since an end at the middle has no outward direction
        outwards = [ends + np.where(side(ends, middle), 0.5, -0.5) for side in (np.greater, np.greater_equal)]
        return np.asarray(np.concatenate(outwards) @ self.grid.world_from_index.T + self.grid.origin)

    def classified_after(self, post: PostClassified) -> Splats:
        """The same samples under `post`, which must have their low and span, and its transfer function's unit."""
        unit = post.transfer.unit or self.grid.mean_spacing
        made = replace(self, post=post, unit=unit, shaded=post.transfer.shading, source=None)
        return self._shared(made, {"index_bounds", "outline"})

    def depths_of(self, which: np.ndarray | slice) -> np.ndarray:
        """Optical depths, float32, of those splats; of each sample as it is, if classified after reconstruction."""
        if self.post is None:
            return np.asarray(self.records["optical_depth"][which])
        depths = self.post.extinction(self.records["value"][which]) * (self.grid.mean_spacing / self.unit)
        return depths.astype(np.float32)

    @property
    def depths(self) -> np.ndarray:
        """Optical depths [N], float32, of all splats."""
        return np.concatenate([np.zeros(0, np.float32), *in_parts(len(self), DEPTHS, self.depths_of)])

    @cached_property
    def _deepest_and_total(self) -> tuple[float, float]:
        def found(part: slice) -> tuple[float, float]:
            depths = self.depths_of(part)
            return float(depths.max()), float(depths.sum(dtype=np.float64))

        parts = in_parts(len(self), DEPTHS, found)
        return max((deepest for deepest, _ in parts), default=0.0), sum(total for _, total in parts)

    @property
    def total_depth(self) -> float:
        """Σ optical depths."""
        return self._deepest_and_total[1]

    @property
    def deepest(self) -> float:
        """The largest optical depth of one splat."""
        return self._deepest_and_total[0]

    @cached_property
    def brightest(self) -> float:
        """The largest colour component, linear light; 1, where colour maps end, if classified after reconstruction."""
        if self.post is not None:
            return 1.0
        return float(self.records["color"].max(initial=0)) / color_scale(self.records.dtype)

    @cached_property
    def runs(self) -> np.ndarray:
        """int16 [N]: coded run lengths around each splat; see run_lengths.py."""
        from splatgl.splat.extraction.run_lengths import packed_runs

        return packed_runs(self)

    @cached_property
    def records_with_runs(self) -> np.ndarray:
        """The records with `runs` filled in."""
        records = self.records.copy()
        records["runs"] = self.runs
        return records

    @property
    def cells(self) -> np.ndarray:
        """Cell indices x, y, z of the splats, int32 [N, 3]."""
        count = np.diff(self.row_start)
        return np.stack([self.cell_x, np.repeat(self.row_y, count), np.repeat(self.row_z, count)], axis=1)

    def part(self, keep: np.ndarray, among_all: bool = False) -> Splats:
        """The splats where `keep` [N] is True. among_all: `runs` still counts the others as neighbours."""
        kept = np.flatnonzero(keep)
        row = np.searchsorted(self.row_start, kept, side="right") - 1
        row_z, row_y, row_start = index_rows(self.row_y[row], self.row_z[row])
        made = replace(
            self,
            records=self.records[keep],
            cell_x=self.cell_x[keep],
            row_z=row_z,
            row_y=row_y,
            row_start=row_start,
            source=None,
        )
        if among_all:
            vars(made)["runs"] = self.runs[keep]
        return made

    def in_cells(self, records: np.ndarray | None = None, grid: Grid | None = None) -> Splats:
        """Other records or another grid in the same cells: what was computed from these is shared."""
        made = replace(self, records=self.records if records is None else records, grid=grid or self.grid, source=None)
        return self._shared(made, {"runs", "_lattices"})

    def _shared(self, made: Splats, names: set[str]) -> Splats:
        """`made` with those of the derived data that are computed already."""
        for name in names & vars(self).keys():
            vars(made)[name] = vars(self)[name]
        return made

    def lattice(self, axis: int) -> Lattice:
        """The splats in planes across `axis` (0 is x); computed once."""
        if axis not in self._lattices:
            self._lattices[axis] = lattice_across(self, axis)
        return self._lattices[axis]

    @cached_property
    def _lattices(self) -> dict[int, Lattice]:
        return {}


def assemble(
    records: np.ndarray,
    cells: np.ndarray,
    grid: Grid,
    unit: float,
    name: str,
    shaded: bool = False,
    dropped: float = 0.0,
) -> Splats:
    """Splats from records already in row order; cells [N, 3] (x, y, z): whole numbers."""
    row_z, row_y, row_start = index_rows(cells[:, 1], cells[:, 2])
    return Splats(
        records, np.ascontiguousarray(cells[:, 0]), row_z, row_y, row_start, grid, unit, shaded, dropped, name
    )


def corners_of(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The eight corners [8, 3] of the box between two [3]."""
    return np.array([[x, y, z] for z in (low[2], high[2]) for y in (low[1], high[1]) for x in (low[0], high[0])])

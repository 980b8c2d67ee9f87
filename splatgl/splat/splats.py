"""`Splats`: records in rows, caches, parts and points.

Positions are grid indices, small and exact in float32; the affine grid maps them to world space in
float64. Only non-empty rows are stored (compressed sparse rows).  [M98 §3.5, voxel extractor]

Run lengths count occupied cells around a splat along each axis: 1 across a dot, thread, sheet or surface layer. They
give the filled share of a pixel wider than a voxel, and its number of layers in depth.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import TYPE_CHECKING, ClassVar, TypeVar
from weakref import ref

import numpy as np

from splatgl.coercion import public
from splatgl.data.color import srgb_from_linear
from splatgl.data.volume import LEAST_LENGTH, MOST_LENGTH, MOST_OBLONG
from splatgl.errors import expected
from splatgl.geometry.camera import Bounded, FittedPoints
from splatgl.geometry.grid import Grid, Lattice, columns, corners_of, index_rows, lattice_across
from splatgl.transfer.preintegration import ValueClassifier
from splatgl.transfer.regions import extinction_of

if TYPE_CHECKING:
    from splatgl.data.mesh import Mesh
    from splatgl.data.points import Points
    from splatgl.geometry.mask_field import MaskField
    from splatgl.splat.extract import SplatSource
    from splatgl.splat.lighting import LabelNormals
    from splatgl.splat.settings import Settings
    from splatgl.transfer.transfer import Transfer


class IdentityKey:
    """Identity of an object as a cache key, without keeping it alive: equal only while the object lives, since its `id`
    may be reused.
    """

    def __init__(self, it: object) -> None:
        self.it, self.number = ref(it), id(it)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, IdentityKey) and (it := self.it()) is not None and it is other.it()

    def __hash__(self) -> int:
        return self.number


Result = TypeVar("Result")


@cache
def _threads(process: int) -> ThreadPoolExecutor:
    """Threads of a process that work beside those which call `in_parts`. A forked process has none of its parent's."""
    return ThreadPoolExecutor(max((os.cpu_count() or 1) - 1, 1), "parts")


class _Check(threading.local):
    """State of a thread: what it calls between parts of its work."""

    call: Callable[[], None] | None = None


_check = _Check()


@contextmanager
def checked(check: Callable[[], None]) -> Iterator[None]:
    """Has `in_parts` and `check_now` of this thread call `check`, which ends the work by raising an error."""
    before, _check.call = _check.call, check
    try:
        yield
    finally:
        _check.call = before


def check_now() -> None:
    """Calls what the work of this thread is `checked` by, between its steps."""
    if _check.call is not None:
        _check.call()


def in_parts(count: int, size: int, work: Callable[[slice], Result]) -> list[Result]:
    """Runs `work` on slices of `size` out of `count` items in threads; returns the results in order."""
    parts = [slice(start, min(start + size, count)) for start in range(0, count, size)]

    def run(part: slice) -> Result:
        check_now()
        return work(part)

    if len(parts) < 2:
        return [run(part) for part in parts]
    futures = [_threads(os.getpid()).submit(work, part) for part in parts]
    try:
        # this thread works on what no other has begun: nested calls never wait for a free thread
        done = {n: run(part) for n, part in enumerate(parts) if futures[n].cancel()}
        return [done[n] if n in done else future.result() for n, future in enumerate(futures)]
    finally:
        for future in futures:
            future.cancel()


def check_points(points: object, colors: object, extinctions: object) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points and colours [N, 3] and extinctions [N] as float64. Raises InputError for other shapes and negative
    numbers.
    """
    p, c, e = (np.asarray(array, dtype=np.float64) for array in (points, colors, extinctions))
    if p.ndim != 2 or p.shape[1] != 3:
        raise expected("points", "shape [N, 3]", p.shape)
    if c.shape != p.shape:
        raise expected("colors", f"shape {p.shape}", c.shape)
    if e.shape != (len(p),):
        raise expected("extinctions", f"shape {(len(p),)}", e.shape)
    if (c < 0).any() or (e < 0).any():
        raise expected("colors and extinctions", "numbers of at least 0", min(c.min(), e.min()))
    return p, c, e


def check_spacing(spacing: float | Sequence[float]) -> np.ndarray:
    """Spacing [3]. Raises InputError unless it is positive and within the lengths and ratios that float32 resolves."""
    scale = np.asarray(spacing, dtype=np.float64)
    if scale.shape not in ((), (3,)) or not ((scale >= LEAST_LENGTH) & (scale <= MOST_LENGTH)).all():
        within = f"from {LEAST_LENGTH:g} to {MOST_LENGTH:g}"
        raise expected("spacing", f"a positive number or three (x, y, z), {within}", spacing)
    if scale.max() > MOST_OBLONG * scale.min():
        raise expected("spacing", f"three numbers (x, y, z) within a factor of {MOST_OBLONG:g}", spacing)
    return np.broadcast_to(scale, (3,))


# position: (x, y, z) in grid indices. color: linear RGB, of a voxel as 16-bit fractions. optical_depth: extinction ×
# mean spacing. normal: unit world gradient as signed 16-bit fractions, zero where there is none. runs: coded
# run lengths, filled in on upload if the plan needs them.
VOXEL = np.dtype(
    [("position", "<u2", 3), ("color", "<u2", 3), ("optical_depth", "<f4"), ("normal", "<i2", 3), ("runs", "<i2")]
)
POINT = np.dtype(
    [("position", "<f4", 3), ("optical_depth", "<f4"), ("color", "<f4", 3), ("normal", "<i2", 3), ("runs", "<i2")]
)
# classified after reconstruction. value: see ValueClassifier; gradient: of the value per mean spacing, world axes
VALUE = np.dtype([("position", "<u2", 3), ("unused", "<u2"), ("value", "<f4"), ("gradient", "<f4", 3)])
POINT_VALUE = np.dtype([("position", "<f4", 3), ("value", "<f4"), ("gradient", "<f4", 3), ("unused", "<i2", 4)])
# width of a splat whose line has the opacity .99 in the middle of a surface, where its own is ½; spacings
HALF_WIDTH = 1.7
NORMAL_SCALE = 32767.0
COLOR_SCALE = 65535.0
# maximum number of voxels along an axis whose positions fit 16 bits
MOST_ALONG = 2**16


def record_type(shape: tuple[int, ...], post: bool) -> np.dtype:
    """Smallest record type of a volume's voxels; post: of values classified after reconstruction."""
    if max(shape) <= MOST_ALONG:
        return VALUE if post else VOXEL
    return POINT_VALUE if post else POINT


def is_points(record: np.dtype) -> bool:
    """Whether positions of the record type may be anywhere, not only at voxel centres."""
    return record in (POINT, POINT_VALUE)


def stored_color(color: np.ndarray, record: np.dtype) -> np.ndarray:
    """Linear RGB [..., 3] as stored in a record type; of voxels clamped to 1, with an error of at most 7.6e-6."""
    if record == POINT:
        return np.asarray(color, np.float32)
    return np.rint(np.clip(color, 0, 1) * COLOR_SCALE).astype(np.uint16)


def color_scale(record: np.dtype) -> float:
    """Stored number of a colour component of 1."""
    return 1.0 if record == POINT else COLOR_SCALE


def linear_color(records: np.ndarray) -> np.ndarray:
    """Linear RGB [N, 3] of records, float32."""
    return np.asarray(records["color"] / np.float32(color_scale(records.dtype)))


def as_points(records: np.ndarray) -> np.ndarray:
    """Copies records to the type of points, whose positions and colours are unrestricted."""
    names = set(records.dtype.names or ())
    points = np.zeros(len(records), POINT_VALUE if "value" in names else POINT)
    for name in names - {"color", "unused"}:
        points[name] = records[name]
    if "color" in names:
        points["color"] = linear_color(records)
    return points


def join_records(parts: Sequence[np.ndarray]) -> np.ndarray:
    """Records of several arrays, one after another, as bytes: numpy copies them field by field otherwise."""
    return np.concatenate([as_bytes(part) for part in parts]).view(parts[0].dtype)


def as_bytes(records: np.ndarray) -> np.ndarray:
    """Records [N] without their fields, which numpy copies at once."""
    return records.view(f"V{records.dtype.itemsize}")


class GrowingRecords:
    """Array of records that grows in place, so that no record is stored twice."""

    def __init__(self, record: np.dtype) -> None:
        self.records = np.zeros(0, record)

    def add(self, part: np.ndarray) -> None:
        """Appends records, of which the first are not copied; arrays read from `records` before become invalid."""
        before = len(self.records)
        if not before and part.base is None:
            self.records = part
            return
        self.records.resize(before + len(part), refcheck=False)
        as_bytes(self.records)[before:] = as_bytes(part)


# five bits an axis: code k stands for a run of 2^(k·OCTAVES) cells, so that 31 is about 1000
OCTAVES = 0.32
CODES = 32
# neighbours whose optical depths differ by more than this factor break a run
CONTRAST = 4.0


def _runs_along(lattice: Lattice, octaves: np.ndarray) -> np.ndarray:
    """int16 [N], by record: coded length of the run of similar neighbours that contains each member, along its rows.

    octaves [N]: log2 of the members' optical depth.
    """
    count = len(lattice.cell)
    row = np.repeat(np.arange(len(lattice.row)), np.diff(lattice.row_start))
    # cells that hold several points stay in one run
    breaks = (np.diff(row) != 0) | (np.diff(lattice.cell) > 1) | (np.abs(np.diff(octaves)) > np.log2(CONTRAST))
    first = np.concatenate([[0], np.flatnonzero(breaks) + 1]) if count else np.zeros(0, np.int64)
    last = np.append(first[1:], count) - 1 if count else first
    length = lattice.cell[last] - lattice.cell[first] + 1
    code = np.minimum(np.rint(np.log2(length) / OCTAVES), CODES - 1).astype(np.int16)
    runs = np.repeat(code, np.diff(np.append(first, count)))
    result = np.empty(count, np.int16)
    result[slice(None) if lattice.index is None else lattice.index] = runs
    return result


# maximum number of splats on the GPU, 400 MB of voxels' records: the limit of texture rows
MOST_KEPT = 2**24
# optical depths computed at a time
DEPTHS = 2**18
# largest colour and optical depth: their sums fit float32
BRIGHTEST = 1e30


@public
@dataclass(frozen=True, eq=False)
class Splats:
    """Splats in row order: z, then y, then x ascending.

    records [N]: of values if `post` classifies them. cell_x int [N]: cells along x.
    row_z, row_y int32 [M]: the non-empty rows; row_start int64 [M+1] into the records.
    unit: reference length of opacities, world units. shaded: whether the transfer function shades.
    dropped_depth: largest optical depth that the threshold removed from one axis line. source: volume from which
    pictures extract splats of the other classification; None for parts. mask: clips rays through values. frame: the
    volume's anatomical frame. labels: normals of labels, which are drawn as boxes; None for other splats.
    unmasked: number of missing samples that `mask` ignores: matter is up to a voxel wider there. hollow: cells of
    hidden_interior.py that the kernels of pictures may reach, as hidden interiors are left out; 0: they are not. box:
    corners [8, 3], world units, of the volume that they are of; None for points. display: whether colours are display
    values, sRGB, instead of linear light.
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
    post: ValueClassifier | None = None
    source: SplatSource | None = None
    mask: MaskField | None = None
    frame: str | None = None
    labels: LabelNormals | None = None
    missing_samples: int = 0
    skipped_interior: int = 0
    box: np.ndarray | None = None
    display: bool = False
    notes: ClassVar[tuple[str, ...]] = ()

    def __len__(self) -> int:
        return len(self.records)

    def __repr__(self) -> str:
        """Number and kind of the splats in one line."""
        kind = "values" if self.post is not None else "classified" + ", shaded" * self.shaded
        return f"<Splats {self.name!r}: {len(self):,} {kind}, spacing {self.grid.mean_spacing:.4g}>"

    def holds(self, transfer: Transfer) -> bool:
        """Whether these values serve another transfer function; never without hidden interiors, which depend on it."""
        return self.post is not None and not self.skipped_interior and self.post.holds(transfer)

    @classmethod
    def from_points(
        cls, points: np.ndarray, colors: np.ndarray, extinctions: np.ndarray, spacing: float | Sequence[float] = 1.0
    ) -> Splats:
        """Unshaded splats at arbitrary positions.

        points [N, 3] world; colors [N, 3] linear RGB ≥ 0; extinctions [N] ≥ 0 per world length.
        spacing, a number or (x, y, z), is the kernel's scale and the lattice whose cells
        round(p / spacing) give the order; ties keep the input's. Non-finite and transparent points
        are dropped. Raises InputError for other shapes, negative numbers and those beyond float32's range.
        """
        points, colors, extinctions = check_points(points, colors, extinctions)
        scale = check_spacing(spacing)
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

    @cached_property
    def of_display(self) -> Splats:
        """The splats in display values. Raises InputError for values, which are classified while they are drawn."""
        if self.post is not None:
            if not len(self):
                return self
            fix = "use --classification pre"
            raise expected("target rgba8", "splats classified before reconstruction", "values", fix)
        records = self.records.copy()
        records["color"] = stored_color(srgb_from_linear(linear_color(records)), records.dtype)
        return replace(self, records=records, display=True)

    @classmethod
    def of_points(cls, points: Points, opacity: float) -> Splats:
        """Splats of points as large as their size; a surface of points 1/HALF_WIDTH of it apart has this opacity."""
        spacing = points.size / HALF_WIDTH
        extinctions = np.full(len(points), extinction_of(opacity) / spacing)
        return cls.from_points(points.places, points.colors, extinctions, spacing)

    def drawn(self, settings: Settings) -> list[tuple[Splats, Settings]]:
        """The splats as the only layer of a picture, as of `Scene.drawn`."""
        return [(self, settings)]

    def surfaces(self, settings: Settings) -> tuple[Mesh, ...]:
        """No meshes, as of `Scene.surfaces`."""
        return ()

    @property
    def positions(self) -> np.ndarray:
        """Grid indices (x, y, z) [N, 3], float32."""
        return np.asarray(self.records["position"], np.float32)

    @property
    def colors(self) -> np.ndarray:
        """Linear RGB [N, 3], float32, of splats classified before reconstruction."""
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
        """Corners [8, 3], world units, of the box of all splats, half a voxel larger."""
        return np.asarray(self.corners_in_grid(0.5) @ self.grid.world_from_index.T + self.grid.origin)

    def corners_in_grid(self, margin: float = 0.0) -> np.ndarray:
        """Corners [8, 3], grid indices, of the box of all centres, larger by a margin in voxels."""
        return corners_of(*(self.index_bounds + np.array([[-margin], [margin]])))

    @cached_property
    def outline(self) -> np.ndarray:
        """Points [N, 3], world units, around all splats: the ends of all rows, moved half a voxel outwards."""
        if not len(self):
            return self.corners
        last = np.concatenate([self.row_start[:-1], self.row_start[1:] - 1])
        ends = self.records["position"][last].astype(np.float64)
        middle = self.index_bounds.mean(axis=0)
        # both signs, since an end at the middle has no outward direction
        outwards = [ends + np.where(side(ends, middle), 0.5, -0.5) for side in (np.greater, np.greater_equal)]
        return np.asarray(np.concatenate(outwards) @ self.grid.world_from_index.T + self.grid.origin)

    @property
    def full_extent(self) -> Bounded:
        """The box of their volume, which views are fitted to; the splats themselves for points."""
        return self if self.box is None else FittedPoints(self.box, self.frame)

    def with_classifier(self, post: ValueClassifier) -> Splats:
        """The same records classified by `post`, whose low and span must be theirs."""
        unit = post.transfer.unit if isinstance(post.transfer.unit, float) else self.grid.mean_spacing
        splats = replace(self, post=post, unit=unit, shaded=post.transfer.shading, source=None)
        return self._share_cache(splats, {"index_bounds", "outline"})

    def depths_of(self, which: np.ndarray | slice) -> np.ndarray:
        """Optical depths, float32, of some splats; of their sample values if classified after reconstruction."""
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
        def measure(part: slice) -> tuple[float, float]:
            depths = self.depths_of(part)
            return float(depths.max()), float(depths.sum(dtype=np.float64))

        parts = in_parts(len(self), DEPTHS, measure)
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
        """The largest colour component, linear light; 1 if classified after reconstruction."""
        if self.post is not None:
            return 1.0
        return float(self.records["color"].max(initial=0)) / color_scale(self.records.dtype)

    @cached_property
    def runs(self) -> np.ndarray:
        """int16 [N]: run lengths around each splat along x, y, z, coded, as x + 32 y + 1024 z."""
        octaves = np.log2(np.maximum(self.records["optical_depth"], np.finfo(np.float32).tiny))
        x, y, z = (
            _runs_along(lattice, octaves if lattice.index is None else octaves[lattice.index])
            for lattice in (self.lattice(2), self.lattice(0), columns(self))
        )
        return x + 32 * y + 1024 * z

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
        if keep.shape != (len(self),) or keep.dtype != bool:
            raise expected("keep", f"true or false for each of {len(self)} splats", f"{keep.dtype} {keep.shape}")
        index = np.flatnonzero(keep)
        row = np.searchsorted(self.row_start, index, side="right") - 1
        row_z, row_y, row_start = index_rows(self.row_y[row], self.row_z[row])
        splats = replace(
            self,
            records=self.records[keep],
            cell_x=self.cell_x[keep],
            row_z=row_z,
            row_y=row_y,
            row_start=row_start,
            source=None,
        )
        if among_all:
            vars(splats)["runs"] = self.runs[keep]
        return splats

    def in_cells(self, records: np.ndarray | None = None, grid: Grid | None = None) -> Splats:
        """The splats with other records or another grid in the same cells; keeps data that depend on cells only."""
        splats = replace(
            self, records=self.records if records is None else records, grid=grid or self.grid, source=None
        )
        return self._share_cache(splats, {"runs", "_lattices"})

    def _share_cache(self, copy: Splats, names: set[str]) -> Splats:
        """Copies the named cached properties, if computed, to `copy` and returns it."""
        for name in names & vars(self).keys():
            vars(copy)[name] = vars(self)[name]
        return copy

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

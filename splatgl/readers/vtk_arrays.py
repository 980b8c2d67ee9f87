"""Arrays of VTK's grids, and the selection among them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from splatgl.data.affine import Coordinate, make_lattice, volume_on_grid
from splatgl.data.volume import Volume
from splatgl.errors import MissingOption, expected, list_names
from splatgl.readers.channels import COLOR_NOTE, VECTOR_NOTE, is_color_rule, is_vector_rule, split_components
from splatgl.readers.common import Shape, array_fields
from splatgl.readers.options import LoadOptions

# VTK's marks of points and cells, which are no values; bits of the first for a hidden point and a hidden cell
MARKS, HIDDEN_POINT, HIDDEN_CELL = ("vtkGhostType", "vtkGhostLevels", "vtkValidPointMask"), 2, 32


@dataclass(frozen=True)
class PointArray:
    """An array of a VTK grid; read() loads it as [D, H, W, components]. active: whether the file names it as the one
    that is drawn.
    """

    name: str
    components: int
    is_vectors: bool
    read: Callable[[], np.ndarray]
    dtype: np.dtype | None = None
    active: bool = False


@dataclass(frozen=True)
class Selection:
    """Selected arrays of a grid: samples [D, H, W] of points or of cells; colours uint8 and vectors float32
    [D, H, W, 3], or None. about: further fields of `Volume`, notes and hints among them.

    Speeds, and arrays that are named as a simulation's, get the hints of a field.
    """

    of_cells: bool
    samples: np.ndarray
    vectors: np.ndarray | None
    color: np.ndarray | None
    about: dict[str, Any]

    def volume(self, matrix: np.ndarray, origin: np.ndarray, shape: Sequence[int], what: str) -> Volume:
        """The volume on a grid of points [shape] (z, y, x), of which the first is at `origin`; the centres of cells are
        half a step farther. matrix: world-from-index; what: the name of the grid in messages.
        """
        middle = np.where(np.array(shape[::-1]) > 1, 0.5, 0.0) * self.of_cells
        arrays = {"vectors": self.vectors, "color": self.color}
        return volume_on_grid(self.samples, matrix, origin + matrix @ middle, what, **arrays, **self.about)

    def rectilinear(self, places: Sequence[np.ndarray], even: bool) -> Volume:
        """The volume on a rectilinear grid, resampled if it is uneven. places: coordinates of points along x, y, z.

        even: whether to take the steps for even.
        """
        centres = [(axis[1:] + axis[:-1]) / 2 if self.of_cells and len(axis) > 1 else axis for axis in places]
        axes = [Coordinate(name, len(axis), axis) for name, axis in zip("zyx", centres[::-1], strict=True)]
        grid = make_lattice(axes, even=even)
        vectors = None if self.vectors is None else np.asarray(grid.resampled(self.vectors))
        return grid.volume(self.samples, "coordinates", vectors=vectors, **self.about)


def select_arrays(points: Sequence[PointArray], cells: Sequence[PointArray], options: LoadOptions) -> Selection:
    """Selects among the arrays of points and of cells: those of cells if there are no others, or if one has that name.

    Without options the active array or the first with one component, else the length of the first vectors, becomes the
    samples, with NaN for hidden points or cells. `array` names another one; "scalars", "vectors" and "speed" also stand
    for the first of their kind. `channel` picks a component. Raises InputError naming the arrays if the choice is not
    clear.
    """
    marks = [[array for array in arrays if array.name == MARKS[0]] for arrays in (points, cells)]
    points, cells = ([array for array in arrays if array.name not in MARKS] for arrays in (points, cells))
    of_points, of_cells = ([array.name for array in arrays] for arrays in (points, cells))
    in_cells = not points or (options.array not in (None, *of_points) and options.array in of_cells)
    arrays = cells if in_cells else points
    if not arrays:
        raise expected("arrays", "point or cell data", "none")
    vectors = next((array for array in arrays if array.is_vectors), None)
    chosen = _select_array(arrays, vectors, options)
    is_field = chosen.is_vectors or is_vector_rule(chosen.dtype, chosen.components)
    if is_field:
        vectors = chosen
    color = None
    field = None if vectors is None else np.asarray(vectors.read(), dtype=np.float32)
    if is_field and options.channel is None and field is not None:
        samples = np.stack([np.linalg.norm(plane, axis=-1) for plane in field])
    elif options.channel is None and chosen.dtype is not None and is_color_rule(chosen.dtype, chosen.components):
        samples, color, _ = split_components(chosen.read(), is_color=True)
    else:
        samples = _component(chosen, options)
    # arrays of points and of cells are listed together
    every = [*arrays, *(points if in_cells else cells)]
    others = [array.name for array in every if array.name != chosen.name]
    notes = (COLOR_NOTE,) * (color is not None) + (VECTOR_NOTE,) * (is_field > chosen.is_vectors)
    if options.array is None and others:
        notes += (f"array {chosen.name} of {len(every)} is rendered; --array picks another: {list_names(others)}",)
    for mark in (mark for mark in marks[in_cells] if mark.read().dtype.kind in "iu"):
        hidden = (mark.read()[..., 0] & (HIDDEN_CELL if in_cells else HIDDEN_POINT)) != 0
        if hidden.any():
            samples = np.where(hidden, np.nan, samples).astype(np.float32)
            notes += (f"{hidden.sum()} {'cells' if in_cells else 'points'} that the file hides are left out",)
    about = {"notes": notes, **array_fields(chosen.name, samples.dtype, "", "mm", chosen.is_vectors)}
    return Selection(in_cells, samples, field, color, about)


def _select_array(arrays: Sequence[PointArray], vectors: PointArray | None, options: LoadOptions) -> PointArray:
    single = [array for array in arrays if array.components == 1]
    scalars = next((array for array in single if array.active), next(iter(single), None))
    if options.array is None:
        return scalars or vectors or arrays[0]
    named = next((array for array in arrays if array.name == options.array), None)
    chosen = named or {"scalars": scalars, "vectors": vectors, "speed": vectors}.get(str(options.array))
    if chosen is None:
        listed = ", ".join(f"{array.name} ({array.components})" for array in arrays)
        raise expected("array", f"one of {listed}", repr(options.array))
    return chosen


def _component(chosen: PointArray, options: LoadOptions) -> np.ndarray:
    count = chosen.components
    number = options.channel_number(count)
    if number is None and count > 1:
        fix = f"pick one with channel=0 … channel={count - 1}"
        error = expected("array", "one number per voxel", f"{count} in {chosen.name!r}", fix)
        raise MissingOption(str(error), "channel", [(f"0 … {count - 1}", f"numbers of each voxel in {chosen.name!r}")])
    return chosen.read()[..., number or 0]


def count_cells(points: Shape) -> Shape:
    """The numbers of cells between points; a flat grid has one layer."""
    d, h, w = (max(count - 1, 1) for count in points)
    return d, h, w

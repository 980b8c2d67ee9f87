"""Image data in VTK's HDF5 files (.vtkhdf): points or cells, scalars, vectors and colours, time steps.

Format: "VTKHDF file format", docs.vtk.org. Arrays are [z, y, x] or [z, y, x, components], with time before them if the
file has steps; a point's index counts from index 0, and Direction is listed row by row.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.data.times import Times
from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.fileio import byte_count, require_memory
from splatgl.readers.channels import ChannelSet
from splatgl.readers.common import Shape, grid_shape
from splatgl.readers.hdf5_files import attribute_numbers, attribute_text, find_node, has_real_numbers
from splatgl.readers.hdf5_parts import read_samples
from splatgl.readers.options import PARAVIEW, LoadOptions
from splatgl.readers.vtk_legacy import PointArray, count_cells, select_arrays

# surfaces in the format
SURFACE = "it is a surface: save it as .vtp or .stl for --mesh"
# the group that holds everything
ROOT = "VTKHDF"
# most time steps, and arrays of a grid
_MOST_STEPS, _MOST_ARRAYS = 2**20, 10_000


def read_image(path: Path, file: Any, options: LoadOptions) -> Volume:
    """The volume in an open file; `array` names an array, `time` picks a step, `channel` a component."""
    root = find_node(file, ROOT, anywhere=False)
    kind = attribute_text(root, "Type")
    if kind != "ImageData":
        raise expected(
            ROOT,
            "ImageData",
            repr(kind),
            SURFACE if kind == "PolyData" else PARAVIEW,
        )
    extent, *stated = (
        _read_numbers(root, name, default)
        for name, default in (("WholeExtent", []), ("Direction", np.eye(3)), ("Spacing", [1] * 3), ("Origin", [0] * 3))
    )
    if extent.size != 6:
        raise expected("WholeExtent", "six numbers", extent.size)
    low = extent[::2]
    shape = grid_shape([int(end - begin) + 1 for begin, end in zip(low, extent[1::2], strict=True)], "WholeExtent")
    steps = attribute_numbers(find_node(file, f"{ROOT}/Steps", anywhere=False) or root, "NSteps")
    timed = steps is not None and steps.size == 1
    times = int(np.clip(np.nan_to_num(steps[0]), 1, _MOST_STEPS)) if steps is not None and timed else 1
    values: Any = find_node(file, f"{ROOT}/Steps/Values", options.anywhere) if timed else None
    has_times = hasattr(values, "shape") and values.shape == (times,) and has_real_numbers(values)
    moments = Times.of(np.asarray(values[:], np.float64)) if has_times else None
    direction, spacing, origin = stated
    matrix = direction.reshape(3, 3) * spacing

    def read_step(_: int | None) -> Volume:
        time = (options.point) if timed else None
        points = _find_arrays(path, root, "PointData", shape, time, options)
        cells = _find_arrays(path, root, "CellData", count_cells(shape), time, options)
        choice = select_arrays(points, cells, options)
        return choice.volume(matrix, origin + matrix @ low, shape, "Direction and Spacing")

    return ChannelSet(times=times, moments=moments, components=2**20).volume(options, read_step)


def _read_numbers(root: Any, name: str, default: Any) -> np.ndarray:
    """The numbers of an attribute. Raises InputError for another count than in the default, if that has any."""
    numbers, standard = attribute_numbers(root, name), np.ravel(np.asarray(default, np.float64))
    numbers = standard if numbers is None else numbers
    if standard.size not in (0, numbers.size) or not (np.abs(numbers) < 1e30).all():
        raise expected(name, f"{standard.size or 6} finite numbers", numbers.size, "the header is damaged")
    return numbers


def _find_arrays(
    path: Path, root: Any, group: str, shape: Shape, time: int | None, options: LoadOptions
) -> list[PointArray]:
    """The arrays of points or of cells that have the grid's shape. time: the step of arrays of several, or None."""
    owner = find_node(root.file, f"{ROOT}/{group}", anywhere=False)
    names = list(owner)[:_MOST_ARRAYS] if hasattr(owner, "keys") else []
    arrays = []
    for name in names:
        node = find_node(root.file, f"{ROOT}/{group}/{name}", options.anywhere)
        if not hasattr(node, "shape") or not has_real_numbers(node):
            continue
        sizes = node.shape if time is None else node.shape[1:]
        if sizes[:3] != shape or len(sizes) > 4 or (time is not None and time >= node.shape[0]):
            continue
        components = sizes[3] if len(sizes) == 4 else 1
        vectors = components == 3 and not (node.dtype == np.uint8 or attribute_text(node, "Attribute") == "Scalars")
        index: list[int | slice] = [slice(None)] * len(node.shape)
        if time is not None:
            index[0] = time
        read = partial(_read_array, path, node, index, (*shape, components), options)
        arrays.append(PointArray(name, components, vectors, read, node.dtype))
    return arrays


def _read_array(path: Path, node: Any, index: Sequence[int | slice], shape: Any, options: LoadOptions) -> np.ndarray:
    """An array [D, H, W, components]; mapped where it is stored in one piece."""
    samples = read_samples(path, node, index, options.anywhere)
    if not isinstance(samples, np.ndarray):
        require_memory(byte_count(shape, node.dtype), node.id.get_storage_size())
        samples = samples[:]
    return samples.reshape(shape)

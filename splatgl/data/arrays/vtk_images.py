"""ImageData of VTK and PyVista: point or cell data, on a grid with a direction."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.data.arrays.plain import checked
from splatgl.data.errors import expected
from splatgl.data.readers.grid import axes_of, triple
from splatgl.data.volume import Volume

if TYPE_CHECKING:
    from splatgl.data.arrays import ArrayOptions


def of_vtk(x: Any, options: ArrayOptions) -> Volume:
    """The volume of a vtkImageData or pyvista.ImageData, a view of its memory: the active scalars, or those that
    `array` names. Samples of cells stand at their middle.
    """
    if not hasattr(x, "IsA") or not x.IsA("vtkImageData"):
        fix = "resample it: pyvista.ImageData(dimensions=…, spacing=…, origin=…).sample(x)"
        raise expected("array", "image data", f"a {type(x).__name__}", fix)
    from vtkmodules.util.numpy_support import vtk_to_numpy

    array, in_cells = _chosen(x, options)
    count = array.GetNumberOfComponents()
    if count > 1:
        fix = "add one of them as an array of its own"
        raise expected("array", "one number per voxel", f"{count} components in {array.GetName()!r}", fix)
    extent = x.GetExtent()
    first, last = np.array(extent[::2]), np.array(extent[1::2])
    sizes = last - first + (0 if in_cells else 1)
    if min(sizes) < 1:
        raise expected("image data", "at least one voxel along each axis", "×".join(map(str, sizes)))
    samples = checked(vtk_to_numpy(array).reshape(sizes[::-1]), "array")
    turn = x.GetDirectionMatrix()
    direction = np.array([[turn.GetElement(row, column) for column in range(3)] for row in range(3)])
    matrix = direction * np.array(x.GetSpacing())
    spacing, direction = axes_of(matrix, "direction and spacing")
    # the origin is that of index 0, which the extent need not hold
    origin = matrix @ (first + 0.5 * in_cells) + np.array(x.GetOrigin())
    return Volume(samples, spacing, triple(origin, "origin"), direction, name=array.GetName() or "")


def _chosen(x: Any, options: ArrayOptions) -> tuple[Any, bool]:
    """The array, and whether it is of cells: the one named, the active scalars, or the only one."""
    sides = [(x.GetPointData(), False), (x.GetCellData(), True)]
    named = [(data.GetArray(i), in_cells) for data, in_cells in sides for i in range(data.GetNumberOfArrays())]
    named = [(array, in_cells) for array, in_cells in named if array is not None]
    names = [str(array.GetName()) for array, _ in named]
    if options.array is not None:
        if str(options.array) not in names:
            raise expected("array", f"one of {', '.join(names) or 'none'}", repr(options.array))
        return named[names.index(str(options.array))]
    for data, in_cells in sides:
        if data.GetScalars() is not None:
            return data.GetScalars(), in_cells
    if len(named) != 1:
        raise expected("array", "one that is active", ", ".join(names) or "none", "name one: array=…")
    return named[0]

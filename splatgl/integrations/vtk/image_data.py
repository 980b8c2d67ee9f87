"""Converts ImageData of VTK and PyVista to volumes and back: point or cell data, with a direction."""

from __future__ import annotations

from typing import Any

import numpy as np

from splatgl.data.arrays import check_samples
from splatgl.data.mesh import Mesh
from splatgl.data.volume import ArrayOptions, Volume
from splatgl.errors import expected, missing_extra
from splatgl.readers.vtk_files import Selection, count_cells, place_on_even, vtk_numbers

# names of unnamed arrays
VALUES, COLORS, VECTORS = "values", "colors", "vectors"


def volume_from_vtk(x: Any, options: ArrayOptions) -> Volume:
    """Volume of a vtkImageData or pyvista.ImageData, a view of its memory: the active scalars, or the array named
    by `array`. Samples of cells lie at the cells' centres. Rectilinear grids are resampled to their least distances.
    """
    if not hasattr(x, "IsA") or not any(map(x.IsA, ("vtkImageData", "vtkRectilinearGrid"))):
        fix = "resample it: pyvista.ImageData(dimensions=…, spacing=…, origin=…).sample(x)"
        raise expected("array", "image data", f"a {type(x).__name__}", fix)
    array, in_cells = select_array(x, options)
    count = array.GetNumberOfComponents()
    if count > 1:
        fix = "add one component as a separate array"
        raise expected("array", "one number per voxel", f"{count} components in {array.GetName()!r}", fix)
    return volumes_from_components(x, array, in_cells)[0]


def volumes_from_components(x: Any, array: Any, in_cells: bool) -> list[Volume]:
    """A volume for each component of an array of a vtkImageData, views of its memory, or of a vtkRectilinearGrid."""
    if not x.IsA("vtkImageData") and not x.IsA("vtkRectilinearGrid"):
        volume_from_vtk(x, ArrayOptions())
    shape = x.GetDimensions()[::-1]
    values = vtk_numbers(array).reshape(*(count_cells(shape) if in_cells else shape), -1)
    about = {"name": array.GetName() or ""}
    parts = (check_samples(values[..., number], "array") for number in range(values.shape[3]))
    return [place_on_even(x, Selection(in_cells, part, None, None, about)) for part in parts]


def image_data(volume: Volume) -> Any:
    """pyvista.ImageData of a volume: point data of samples, without a copy where VTK permits, colours and vectors.

    Raises InputError without PyVista.
    """
    pyvista = import_pyvista("pyvista.ImageData")
    place = {"spacing": volume.spacing, "origin": volume.origin, "direction_matrix": volume.direction}
    data = pyvista.ImageData(dimensions=volume.shape[::-1], **place)
    for name, array in ((COLORS, volume.color), (VECTORS, volume.vectors)):
        if array is not None:
            data.point_data[name] = _vtk_array(array).reshape(-1, 3)
    name = volume.name or VALUES
    data.point_data[name] = _vtk_array(volume.samples).ravel()
    data.set_active_scalars(name)
    return data


def poly_data(mesh: Mesh) -> Any:
    """pyvista.PolyData of a mesh with its colours, uint8, and values."""
    pyvista = import_pyvista("Mesh.to_pyvista")
    data = pyvista.PolyData.from_regular_faces(mesh.vertices, mesh.faces)
    if mesh.colors is not None:
        data.point_data[COLORS] = mesh.colors
    if mesh.values is not None:
        data.point_data[mesh.quantity or VALUES] = mesh.values
    return data


def import_pyvista(what: str) -> Any:
    """The module pyvista. Raises InputError, naming the function that needs it, without."""
    try:
        import pyvista
    except ImportError as error:
        raise missing_extra(what, "pyvista", "pyvista") from error
    return pyvista


def _vtk_array(array: Any) -> np.ndarray:
    """The array, contiguous, in a type of VTK."""
    samples = np.asarray(array[:])
    kind = samples.dtype.newbyteorder("=")
    if kind.kind == "b":
        kind = np.dtype(np.uint8)
    elif kind.kind == "f" and kind.itemsize not in (4, 8):
        kind = np.dtype(np.float32 if kind.itemsize < 4 else np.float64)
    return np.ascontiguousarray(samples, kind)


def select_array(x: Any, options: ArrayOptions) -> tuple[Any, bool]:
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

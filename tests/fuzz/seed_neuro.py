"""Seed files of readers.py: MINC, AFNI and PAR/REC, as nibabel's own test data hold them, and VTK's bits and texts."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tests.fuzz.seed_files import CUBE, Seed, X, Y, Z, written


def _copies(*names: str) -> list[Seed]:
    """Files that come with nibabel, each with the others of its pair; headers first."""
    import nibabel.testing

    folder = Path(nibabel.testing.data_path)
    seeds = []
    for name in names:
        stem = name.rsplit(".", 1)[0]
        files = {name: (folder / name).read_bytes()}
        files |= {path.name: path.read_bytes() for path in sorted(folder.glob(f"{stem}.*")) if path.name != name}
        seeds.append(Seed(name, files))
    return seeds


def minc1() -> list[Seed]:
    return _copies("tiny.mnc", "minc1_4d.mnc")


def minc2() -> list[Seed]:
    return _copies("minc2_1_scale.mnc")


def afni() -> list[Seed]:
    return _copies("scaled+tlrc.HEAD")


def parrec() -> list[Seed]:
    return _copies("phantom_varscale.PAR")


def vtk_image(bits_only: bool = False) -> Any:
    """An image of VTK with an array of numbers and, beside it, bits, texts and ids."""
    import vtk
    from vtk.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray

    image = vtk.vtkImageData()
    image.SetDimensions(X, Y, Z)
    image.SetSpacing(1.5, 2, 3)
    arrays = image.GetPointData()
    if not bits_only:
        density = numpy_to_vtk(CUBE.ravel(), deep=1)
        density.SetName("density")
        arrays.SetScalars(density)
    mask, names = vtk.vtkBitArray(), vtk.vtkStringArray()
    for array, name in ((mask, "mask"), (names, "names")):
        array.SetName(name)
        array.SetNumberOfTuples(CUBE.size)
    for n, value in enumerate(CUBE.ravel().tolist()):
        mask.SetValue(n, int(value > 90))
        names.SetValue(n, f"n {n}" * (n % 40))
    ids = numpy_to_vtkIdTypeArray(np.arange(CUBE.size), deep=1)
    ids.SetName("ids")
    arrays.AddArray(mask)
    if not bits_only:
        arrays.AddArray(names)
        arrays.SetGlobalIds(ids)
    return image


def write_vti(path: Path, mode: str, bits_only: bool = False) -> None:
    import vtk

    writer = vtk.vtkXMLImageDataWriter()
    writer.SetInputData(vtk_image(bits_only))
    writer.SetFileName(str(path))
    getattr(writer, f"SetDataModeTo{mode}")()
    writer.Write()


def write_vtk(path: Path, mode: str, bits_only: bool = False) -> None:
    import vtk

    writer = vtk.vtkStructuredPointsWriter()
    writer.SetInputData(vtk_image(bits_only))
    writer.SetFileName(str(path))
    getattr(writer, f"SetFileTypeTo{mode}")()
    writer.Write()


def vtk_bits() -> list[Seed]:
    modes = [written("a.vti", partial(write_vti, mode=mode)) for mode in ("Ascii", "Binary", "Appended")]
    return [*modes, *(written("a.vtk", partial(write_vtk, mode=mode)) for mode in ("ASCII", "Binary"))]


def vtk_written() -> list[Seed]:
    """Cells in XML, plain and packed, and in legacy files of both versions, as VTK writes them."""
    import vtk

    append = vtk.vtkAppendFilter()
    append.AddInputData(vtk_image())
    append.Update()

    def write(path: Path, mode: str, version: int = 0, packed: bool = False) -> None:
        is_legacy = path.suffix == ".vtk"
        writer = vtk.vtkUnstructuredGridWriter() if is_legacy else vtk.vtkXMLUnstructuredGridWriter()
        writer.SetFileName(str(path))
        writer.SetInputData(append.GetOutput())
        getattr(writer, f"Set{'FileType' if is_legacy else 'DataMode'}To{mode}")()
        if is_legacy:
            writer.SetFileVersion(version)
        else:
            writer.SetCompressorTypeToZLib() if packed else writer.SetCompressorTypeToNone()
            writer.SetEncodeAppendedData(packed)
        writer.Write()

    legacy = [written("a.vtk", partial(write, mode=mode, version=n)) for mode in ("ASCII", "Binary") for n in (42, 51)]
    return [*legacy, *(written("a.vtu", partial(write, mode="Appended", packed=packed)) for packed in (False, True))]


def vtk_surface() -> list[Seed]:
    """PolyData in XML and legacy files."""
    import vtk

    source = vtk.vtkSphereSource()
    source.Update()

    def write(path: Path, mode: str) -> None:
        writer = vtk.vtkPolyDataWriter() if path.suffix == ".vtk" else vtk.vtkXMLPolyDataWriter()
        writer.SetFileName(str(path))
        writer.SetInputData(source.GetOutput())
        getattr(writer, f"Set{'FileType' if path.suffix == '.vtk' else 'DataMode'}To{mode}")()
        writer.Write()

    names = (("a.vtp", "Ascii"), ("a.vtp", "Appended"), ("a.vtk", "ASCII"), ("a.vtk", "Binary"))
    return [replace(written(name, partial(write, mode=mode)), kind="mesh") for name, mode in names]


NRRD_LIST = f"NRRD0005\ntype: uchar\ndimension: 3\nsizes: {X} {Y} {Z}\nencoding: raw\ndata file: "


def nrrd_list() -> list[Seed]:
    """A pattern of slices, and a list of them."""
    files = {f"s{n}.raw": plane.tobytes() for n, plane in enumerate(CUBE)}
    names = "LIST\n" + "\n".join(files) + "\n"
    return [
        Seed("a.nhdr", {"a.nhdr": (NRRD_LIST + data).encode(), **files}) for data in (f"s%d.raw 0 {Z - 1} 1\n", names)
    ]

"""Names of arrays inside files, FILE.h5:/a/b, and formats that are not read with what converts them."""

from __future__ import annotations

import re

HDF5 = (".h5", ".hdf5", ".he5", ".nc")
"""Endings of files that hold named datasets."""

_INSIDE = re.compile(rf"(?is)(.+(?:{'|'.join(map(re.escape, HDF5))})):(/.+)")

_FIJI = "save it as TIFF with Fiji (Bio-Formats)"
_PARAVIEW = "turn it into a .vti with ParaView's filter Resample To Image"
_SURFACE = "surfaces are not drawn; voxelize it"

CONVERTERS = {
    **dict.fromkeys((".czi", ".lif", ".nd2", ".oib", ".oif", ".lsm", ".vsi", ".dv", ".sld", ".ics", ".xml"), _FIJI),
    **dict.fromkeys(
        (".svs", ".ndpi", ".mrxs", ".scn"), "a slide is one plane; save a stack as OME-TIFF with Bio-Formats"
    ),
    **dict.fromkeys((".vtu", ".vts", ".pvtu", ".pvts"), _PARAVIEW),
    **dict.fromkeys((".vtp", ".pvtp", ".ply", ".stl", ".obj", ".off", ".glb", ".gltf"), _SURFACE),
    ".mat": "save the array with numpy.save, in the order [z, y, x]",
    ".mnc": "convert it with mnc2nii",
    ".st": "a tilt series is no volume; reconstruct it, such as with IMOD",
    ".ali": "a tilt series is no volume; reconstruct it, such as with IMOD",
    ".vdb": "save a dense array with numpy.save, in the order [z, y, x]",
    ".grb": "convert it with: cdo -f nc4 copy OLD NEW.nc",
    ".grib": "convert it with: cdo -f nc4 copy OLD NEW.nc",
    ".grib2": "convert it with: cdo -f nc4 copy OLD NEW.nc",
    ".hdf": "convert HDF4 with h4toh5; HDF5 is read as .h5",
    ".ozx": "it is a Zarr store in a zip: unpack it into a folder with: unzip FILE -d NAME.zarr",
    ".zarr.zip": "it is a Zarr store in a zip: unpack it into a folder with: unzip FILE -d NAME.zarr",
    ".7z": "unpack it",
    ".gz": "unpack it",
    ".bz2": "unpack it",
}
"""What to do with files that are not read, by ending."""


def inside(source: str) -> tuple[str, str | None]:
    """The file and the array in it of FILE.h5:/a/b; any other source as it is, and None."""
    found = _INSIDE.fullmatch(source)
    return (found[1], found[2]) if found else (source, None)


def converter(name: str) -> str:
    """What to do with a file of that name, which is not read; "" if that is not known."""
    low = name.lower()
    return next((fix for ending, fix in CONVERTERS.items() if low.endswith(ending)), "")

"""Recognizes the format of a file by its first bytes, and describes bytes of other kinds."""

from __future__ import annotations

import bz2
import re
import struct
import zipfile
import zlib
from contextlib import suppress
from pathlib import Path

# bytes that are read of a file, and packed ones of a compressed file; MRC's mark is at byte 208, DICOM's at 128
FIRST, PACKED = 1024, 4096
# first bytes that identify a kind of contents
STARTS = {
    b"\x93NUMPY": "NumPy",
    b"\x89PNG": "PNG",
    b"\xff\xd8\xff": "JPEG",
    b"GIF8": "GIF",
    b"NRRD": "NRRD",
    **dict.fromkeys((b"II*\x00", b"MM\x00*", b"II+\x00", b"MM\x00+"), "TIFF"),
    b"\x89HDF\r\n\x1a\n": "HDF5",
    b"MATLAB 5.0 MAT-file": "MATLAB's format before 7.3",
    b"SIMPLE  =": "FITS",
    b"CTDATA-HEADER_V1": "Scanco ISQ",
    **dict.fromkeys((b"CDF\x01", b"CDF\x02", b"CDF\x05"), "NetCDF-3"),
    b"\x0e\x03\x13\x01": "HDF4",
    b"# vtk DataFile": "legacy VTK",
    b"# === DATA DESCRIPTION FILE ===": "PAR/REC",
    b"GRIB": "GRIB",
    b"ZISRAWFILE": "CZI",
    b"\xda\xce\xbe\x0a": "ND2",
    b"\0\0\0\x0cjP  ": "JPEG 2000",
    b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1": "a compound file",
    b"LASF": "LAS",
    **dict.fromkeys((b"ply\n", b"ply\r"), "PLY"),
    **dict.fromkeys((b"# .PCD", b"VERSION .7", b"VERSION 0.7"), "PCD"),
    b"%PDF": "PDF",
    b"7z\xbc\xaf\x27\x1c": "7-Zip",
    b"\xfd7zXZ": "xz",
    b"\x28\xb5\x2f\xfd": "Zstandard",
    b"Rar!": "RAR",
    b"PK\x05\x06": "ZIP",
    b"version https://git-lfs": "a pointer of Git LFS",
}
# HDF5's mark may follow a user block, as in MATLAB's files
_HDF5, _USER_BLOCKS = b"\x89HDF\r\n\x1a\n", (512, 1024, 2048)
# elements of VTK's XML files, by the format of the file
VTK_XML = {
    **dict.fromkeys(("ImageData", "RectilinearGrid"), "VTK grid"),
    **dict.fromkeys(("UnstructuredGrid", "StructuredGrid", "PUnstructuredGrid", "PStructuredGrid"), "VTK data"),
    **dict.fromkeys(("PImageData", "PRectilinearGrid", "vtkMultiBlockDataSet"), "VTK data"),
    **dict.fromkeys(("vtkOverlappingAMR", "vtkNonOverlappingAMR", "vtkHierarchicalBoxDataSet"), "VTK data"),
    "Collection": "VTK series",
}
_VTK_TYPE = re.compile(rb'<VTKFile[^>]*?\btype\s*=\s*["\'](\w+)')
_META = re.compile(rb"(?:ObjectType *= *Image|NDims *= *[0-9])")
_AFNI = re.compile(rb"\s*type *= *(?:string|integer|float)-attribute")
# sizes of headers of NIfTI, their format, where the magic is, and what it is in single files and in pairs
_NIFTI = ((348, "i", 344, b"n+1", b"ni1"), (540, "i", 4, b"n+2", b"ni2"))
# modes of MRC, and types of MGH
_MRC_MODES, _MGH_TYPES = (0, 1, 2, 3, 4, 6, 7, 12, 16, 101), (0, 1, 3, 4)
# kinds of packed data that are damaged or too short to tell more, and of others
PACKINGS = ("gzip", "bzip2", "ZIP")
OTHER_GZIP, OTHER_BZIP2 = "gzipped data of another kind", "bzip2 data of another kind"
# kinds that only a name tells apart: of packed data, and of JPEG 2000, which ND2 before version 2 is
UNKNOWN = (*PACKINGS, OTHER_GZIP, OTHER_BZIP2, "JPEG 2000")
ASCII_NIFTI = "NIfTI in text"
# advice for kinds that are not read
FIXES = {
    "MATLAB's format before 7.3": "save it in MATLAB with save(..., '-v7.3')",
    ASCII_NIFTI: "save it as .nii.gz, such as with SimpleITK",
    "FITS": "save a dense array with numpy.save, in the order [z, y, x]",
    "Scanco ISQ": "convert it with itk-ioscanco to .mha",
    "HDF4": "convert it with h4toh5",
    "GRIB": "convert it with: cdo -f nc4 copy OLD NEW.nc",
    "a page of HTML": "download the file itself",
    "a pointer of Git LFS": "fetch the file with: git lfs pull",
    "JPEG 2000": "a picture is one slice; open the folder of all slices",
    "VTK PolyData": "it is a surface: --mesh and sg.load_mesh read it",
    **dict.fromkeys(("gzip", OTHER_GZIP, "bzip2", OTHER_BZIP2, "xz", "Zstandard", "7-Zip", "RAR", "ZIP"), "unpack it"),
}
# names of metadata in a Zarr store
ZARR = ("zarr.json", ".zarray", ".zgroup", ".zattrs")
# kinds that are read from gzip and bzip2 data
_PACKED = ("NIfTI", "MRC")
# first bytes that a message shows
_SHOWN = 12


def identify(path: Path) -> str:
    """The kind of a file's contents: the title of a format, or another name; "" if its first bytes are of none."""
    with path.open("rb") as file:
        head = file.read(PACKED)
    if head.startswith(b"\x1f\x8b"):
        with suppress(zlib.error):
            inner = zlib.decompressobj(wbits=31).decompress(head, FIRST)
            kind = _kind(inner)
            return kind if kind in ("MGH", *_PACKED) else OTHER_GZIP if len(inner) == FIRST else "gzip"
        return "gzip"
    if head.startswith(b"BZh"):
        # a block of bzip2 is unpacked as a whole
        with path.open("rb") as file, suppress(OSError, EOFError, ValueError):
            kind = _kind(bz2.BZ2File(file).read(FIRST))
            return kind if kind in _PACKED else OTHER_BZIP2
        return "bzip2"
    if any(head.startswith(_HDF5, block) for block in _USER_BLOCKS):
        return "HDF5"
    return _zip_kind(path) if head.startswith(b"PK\x03\x04") else _kind(head[:FIRST])


def _zip_kind(path: Path) -> str:
    """The kind of a zip by the names of its files."""
    with suppress(OSError, zipfile.BadZipFile, ValueError, NotImplementedError, EOFError, struct.error):
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
        if any(name.rsplit("/", 1)[-1] in ZARR for name in names):
            return "Zarr, zipped"
        if any(name.endswith(".npy") for name in names):
            return "NumPy archive"
    return "ZIP"


def _kind(head: bytes) -> str:
    """The kind of unpacked first bytes; "" if they are of none."""
    start = next((kind for mark, kind in STARTS.items() if head.startswith(mark)), "")
    if start:
        return start
    if head[128:132] == b"DICM":
        return "DICOM"
    if head[:2] == b"BM" and head[6:10] == bytes(4) and head[14:15] in (b"\x0c", b"\x28", b"\x40", b"\x6c", b"\x7c"):
        return "BMP"
    # the mark of Leica's XML, and a letter of UTF-16 behind it
    if head[:4] == b"p\0\0\0" and head[8:9] == b"*" and head[14:15] == b"\0":
        return "LIF"
    return _header_kind(head) or _text_kind(head)


def _header_kind(head: bytes) -> str:
    """The kind of a header of numbers."""
    for order in "<>":
        for size, code, at, single, pair in _NIFTI:
            if head[:4] == struct.pack(order + code, size) and len(head) >= size:
                magic = head[at : at + 3]
                return "NIfTI" if magic == single else "Analyze" if magic == pair or size == 348 else ""
        if len(head) >= FIRST and head[208:211] == b"MAP":
            mode = struct.unpack(order + "i", head[12:16])[0]
            sizes = struct.unpack(order + "3i", head[:12])
            if mode in _MRC_MODES and min(sizes) > 0:
                return "MRC"
    if len(head) >= 284:
        version, *dimensions, kind = struct.unpack(">6i", head[:24])
        if version == 1 and kind in _MGH_TYPES and all(0 < size < 1 << 20 for size in dimensions):
            return "MGH"
    return ""


def _text_kind(head: bytes) -> str:
    """The kind of a text."""
    text = head.removeprefix(b"\xef\xbb\xbf").lstrip()
    if text[:4] in (b"\xff\xfe<\0", b"\xfe\xff\0<"):
        return "XML"
    if text[:1] == b"<":
        match = _VTK_TYPE.search(text)
        kind = match[1].decode("ascii", "replace") if match else ""
        is_page = re.match(rb"<!doctype html|<html|<head", text.lower())
        if b"<SpimData" in text:
            return "BigDataViewer"
        if text.startswith(b"<nifti_image"):
            return ASCII_NIFTI
        return "a page of HTML" if is_page else VTK_XML.get(kind, f"VTK {kind}" if kind else "XML")
    lines = text.splitlines()
    fields = next((n for n, line in enumerate(lines) if b"=" not in line), len(lines))
    if any(map(_META.match, lines[:fields])):
        return "MetaImage"
    return "AFNI" if _AFNI.match(text) else ""


def is_pattern(path: Path) -> bool:
    """Whether a path is a pattern of names in a folder, such as slices/a_*.tif."""
    return any(mark in path.name for mark in "*?[") and path.parent.is_dir() and not path.exists()


def is_n5(folder: Path) -> bool:
    """Whether a folder is an N5 container."""
    attributes = folder / "attributes.json"
    if not attributes.is_file():
        return folder.name.lower().endswith(".n5")
    with attributes.open("rb") as file:
        return b'"n5"' in file.read(FIRST) or folder.name.lower().endswith(".n5")


def describe_bytes(path: Path) -> str:
    """The first bytes of a file that is of no known kind, for a message."""
    with path.open("rb") as file:
        head = file.read(_SHOWN)
    text = head.decode("latin-1")
    is_text = head.isascii() and text.replace("\n", " ").replace("\t", " ").strip("\r").isprintable()
    return f"text that begins with {text!r}" if is_text else f"bytes that begin with {head.hex(' ')}"

"""Bad files and options: one line that begins with the path, and nothing allocated on a header's word."""

from __future__ import annotations

import gzip
import sys
import tracemalloc
import warnings
import zlib
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.errors import InputError
from splatgl.readers import elsewhere, load
from tests.helpers.phantom import F

PNG = b"\x89PNG\r\n\x1a\n" + bytes(64)
NRRD = "NRRD0004\ntype: uchar\ndimension: 3\nsizes: {sizes}\nencoding: {encoding}\n{more}\n"
META = "NDims = 3\nDimSize = {sizes}\nElementType = MET_UCHAR\n{more}ElementDataFile = {file}\n"
VTK = "# vtk DataFile Version 3.0\nt\n{coding}\nDATASET {dataset}\nDIMENSIONS {sizes}\nPOINT_DATA {count}\n"
SCALARS = "SCALARS s unsigned_char\nLOOKUP_TABLE default\n"
BAD_VTI = (
    '<VTKFile type="ImageData" compressor="lz4"><ImageData WholeExtent="0 0 0 0 0 0"><Piece/></ImageData></VTKFile>'
)
BOMB = gzip.compress(bytes(10**8), 1)


def nrrd(sizes: str = "5 7 4", encoding: str = "raw", more: str = "", data: bytes = F.tobytes()) -> bytes:
    return NRRD.format(sizes=sizes, encoding=encoding, more=more).encode() + data


def meta(sizes: str = "5 7 4", more: str = "", file: str = "LOCAL", data: bytes = F.tobytes()) -> bytes:
    return META.format(sizes=sizes, more=more, file=file).encode() + data


def vtk(sizes: str, count: int, data: bytes, coding: str = "BINARY", dataset: str = "STRUCTURED_POINTS") -> bytes:
    return (VTK.format(sizes=sizes, count=count, coding=coding, dataset=dataset) + SCALARS).encode() + data


def npy(shape: str, descr: str = "|u1") -> bytes:
    text = f"{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + np.uint16(len(text)).tobytes() + text.encode()


HUGE = "999999 999999 999999"
BAD = [
    # the wrong kind of file
    *[
        (f"png{name}", PNG, "its contents are height picture, not what its name says")
        for name in (".nrrd", ".nii", ".npy", ".npz", ".tif", ".mha", ".vtk", ".vti", ".csv")
    ],
    ("a.nii", b"not an image" * 40, "expected NIfTI, as the name says, got text that begins with 'not an image'"),
    ("a.mha", b"some other text\n", "is this a MetaImage file"),
    ("a.vtk", b"some other text\n", "expected legacy VTK, as the name says, got text"),
    ("a.vti", b"<?xml version='1.0'?><svg/>", "expected a VTKFile of ImageData or RectilinearGrid, got svg"),
    ("a.vti", BAD_VTI.encode(), "cannot be read by VTK: Error creating lz4"),
    ("a.csv", b"1,2\n3,four\n", "table: expected heights, a row in each line, got 'four'"),
    ("a.png", PNG, "cannot be read as a picture"),
    ("a.npz", b"PK\x03\x04" + bytes(40), "expected NumPy archive, as the name says, got ZIP"),
    # cut short
    ("a.npy", npy("(4, 7, 5)") + bytes(139), "data: expected 140 bytes, got 139 bytes"),
    ("a.nrrd", nrrd(data=bytes(139)), "data: expected 140 bytes, got 139 bytes"),
    ("a.nrrd", nrrd(encoding="gzip", data=gzip.compress(F.tobytes())[:60]), "the file is cut short"),
    ("a.nrrd", nrrd(encoding="text", data=b"1 2 3"), "expected 140 numbers, got 3"),
    ("a.mha", meta(data=bytes(139)), "data: expected 140 bytes, got 139 bytes"),
    ("a.mha", meta(more="CompressedData = True\n", data=zlib.compress(F.tobytes())[:-1]), "the file is cut short"),
    ("a.mha", b"NDims = 3\nDimSize = 5 7 4\n", "ElementDataFile"),
    ("a.vtk", vtk("5 7 4", 140, bytes(139)), "data: expected 140 bytes, got 139 bytes"),
    ("a.vtk", vtk("5 7 4", 140, b"1 " * 139 + b"          ", "ASCII"), "expected 140 numbers, got 139"),
    ("a_5x7x4_uint8.raw", bytes(139), "expected 140 bytes (5x7x4 uint8 after 0), got 139 bytes"),
    ("a_5x7x4_uint8.raw", bytes(141), "expected 140 bytes (5x7x4 uint8 after 0), got 141 bytes"),
    ("a.nii.gz", gzip.compress(bytes(999))[:20], "cannot be read as packed data"),
    ("a.mgz", gzip.compress(bytes(9999)), "expected MGH, gzipped, as the name says, got gzipped data of another kind"),
    # sizes that no file could have, or this one cannot
    ("a.nrrd", nrrd("5 0 4"), "at least one sample along each axis"),
    ("a.nrrd", nrrd("5 -7 4"), "at least one sample along each axis"),
    ("a.nrrd", nrrd(HUGE), "the file is cut short or its header states a wrong size"),
    ("a.nrrd", nrrd(HUGE, "gzip", data=gzip.compress(bytes(9))), "compressed bytes, which hold"),
    ("a.nrrd", nrrd("9 9 9", "gzip", data=BOMB), "inflated data: expected 729 bytes, got more"),
    ("a.nrrd", nrrd(HUGE, "bzip2", data=b"BZh9"), "compressed bytes, which hold"),
    ("a.mha", meta("5 0 4"), "at least one voxel along each axis, got 5x0x4"),
    ("a.mha", meta("5 7"), "three axes"),
    ("a.mha", meta(HUGE), "the file is cut short or its header states a wrong size"),
    ("a.mha", meta(HUGE, "CompressedData = True\n"), "compressed bytes, which hold"),
    ("a.vtk", vtk("5 -7 4", -140, b""), "at least one voxel along each axis"),
    ("a.vtk", vtk("999999 999999 999999", 999999**3, b"1 2 3", "ASCII"), "cut short"),
    ("a.vtk", vtk("5 7 4", 139, bytes(140)), "POINT_DATA: expected 140 points"),
    ("a.npy", npy("(999999, 999999, 999999)"), "the file is cut short"),
    ("a.npy", npy("(4, 0, 5)"), "a 3-D array [z, y, x] of numbers"),
    ("a.npy", npy("(4, 5)"), "one plane has the shape (1, 4, 5)"),
    ("a.npy", npy("(4, 7, 5)", "|O"), "a 3-D array [z, y, x] of numbers"),
    ("a.npy", npy("(4, 7, 5)", "<c8"), "expected 1120 bytes, got 0 bytes"),
    # grids
    ("a.nrrd", nrrd(more="spacings: 1 0 1\n"), "a finite step along each axis"),
    ("a.mha", meta(more="ElementSpacing = 1 -1 1\n"), "spacing: expected three positive numbers"),
    ("a.mha", meta(more="TransformMatrix = 1 0 0 1 0 0 0 0 1\n"), "an invertible 3×3 matrix"),
    (
        "a.vtk",
        vtk("5 7 4", 140, bytes(140), dataset="POLYDATA"),
        "DATASET: expected a grid, got POLYDATA; it is a surface",
    ),
    # data outside the header's folder
    ("a.nhdr", nrrd(more="data file: /etc/hostname\n"), "a name inside the header's folder"),
    ("a.nhdr", nrrd(more="data file: ../b.raw\n"), "a name inside the header's folder"),
    ("a.mhd", meta(file="/etc/hostname"), "a name inside the header's folder"),
    ("a.mhd", meta(file="sub/../../b.raw"), "a name inside the header's folder"),
    ("a.mhd", meta(file="C:\\b.raw"), "a name inside the header's folder"),
    ("a.mhd", meta(file="b.raw"), "nothing named 'b.raw'"),
    ("a.mhd", meta(file="LIST", data=b""), "expected 4 files, got 0"),
    ("a.mhd", meta(file="a%d%d.raw 0 3 1"), "a name%03d.raw FIRST LAST STEP"),
    ("a.mhd", meta(file="a%99999999d.raw 0 3 1"), "a name%03d.raw FIRST LAST STEP"),
    ("a.mhd", meta(file="../a%d.raw 0 3 1"), "a name inside the header's folder"),
    ("a.mhd", meta(file="a%d.raw 0 9000000 1"), "expected 4 files"),
    ("a.mhd", meta(file="a%d.raw 0 3 1"), "a file next to the header"),
    # names
    ("a.raw", bytes(140), "give shape=X,Y,Z and dtype=TYPE"),
    ("a.abc", bytes(140), "a name that ends in one of .npy, .npz, .raw"),
    ("a.mha", b"", "the file is empty"),
]


@pytest.mark.parametrize(("name", "data", "message"), BAD, ids=lambda value: value if isinstance(value, str) else "")
def test_bad_file(tmp_path: Path, name: str, data: bytes, message: str) -> None:
    if "by VTK" in message:
        pytest.importorskip("vtk", reason="reads such files")
    path = tmp_path / name
    path.write_bytes(data)
    tracemalloc.start()
    with pytest.raises(InputError) as caught:
        load(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    line = str(caught.value)
    assert line.startswith(f"{path}: ") and message in line and line.isprintable()
    assert peak < 2**26


@pytest.mark.skipif(sys.platform == "win32", reason="limits no processor time")
def test_a_library_that_loops_is_ended_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By its processor time, so that it ends without its caller, too; a process that waited is not tried again."""
    monkeypatch.setattr(elsewhere, "_open", {})
    assert elsewhere.call("math:sqrt", 0, 4.0) == 2
    monkeypatch.setattr(elsewhere, "BUSY", 0.0)
    with pytest.raises(InputError, match="takes too long"):
        elsewhere.call("tests.helpers.hostile:spin", 0, str(tmp_path / "calls"))
    assert (tmp_path / "calls").read_text() == "called\n"


def test_link_out_of_the_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "out.raw").write_bytes(F.tobytes())
    folder = tmp_path / "in"
    folder.mkdir()
    (folder / "link.raw").symlink_to(tmp_path / "out.raw")
    (folder / "a.mhd").write_bytes(meta(file="link.raw"))
    with pytest.raises(InputError, match="a file inside the header's folder"):
        load(folder / "a.mhd")


@pytest.mark.parametrize("file", ["../out.raw", "link.raw", "{absolute}"])
@pytest.mark.parametrize("header", ["a.mhd", "a.nhdr"])
def test_data_anywhere_is_read_where_that_is_allowed(tmp_path: Path, header: str, file: str) -> None:
    (tmp_path / "out.raw").write_bytes(F.tobytes())
    folder = tmp_path / "in"
    folder.mkdir()
    (folder / "link.raw").symlink_to(tmp_path / "out.raw")
    name = file.format(absolute=tmp_path / "out.raw")
    text = meta(file=name, data=b"") if header == "a.mhd" else nrrd(more=f"data file: {name}\n", data=b"")
    (folder / header).write_bytes(text)
    with pytest.raises(InputError, match="--anywhere"):
        load(folder / header)
    assert (load(folder / header, anywhere=True).samples == F).all()


def test_missing_file_and_folders(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="got no such file"):
        load(tmp_path / "none.nrrd")
    (tmp_path / "head.nii.gz").touch()
    with pytest.raises(InputError, match=r"got no such file; did you mean head\.nii\.gz\?"):
        load(tmp_path / "heaad.nii.gz")
    (tmp_path / "folder.nrrd").mkdir()
    for folder in (tmp_path, tmp_path / "folder.nrrd"):
        with pytest.raises(InputError, match="folder"):
            load(folder)


@pytest.mark.parametrize("keep", [0.3, 0.6, 0.95])
@pytest.mark.parametrize("options", [{}, {"compression": "zlib"}, {"imagej": True}], ids=["plain", "zlib", "imagej"])
def test_tiff_cut_short(tmp_path: Path, keep: float, options: dict[str, object]) -> None:
    tifffile = pytest.importorskip("tifffile")
    stack = np.random.default_rng(1).integers(0, 255, (9, 30, 40), np.uint8)
    metadata = {"axes": "ZYX"} if "imagej" in options else None
    tifffile.imwrite(tmp_path / "a.tif", stack, photometric="minisblack", metadata=metadata, **options)
    data = (tmp_path / "a.tif").read_bytes()
    assert load(tmp_path / "a.tif").shape == stack.shape
    (tmp_path / "a.tif").write_bytes(data[: int(keep * len(data))])
    with pytest.raises(InputError, match=r"a\.tif: "):
        load(tmp_path / "a.tif")


def test_zarr_of_missing_chunks_is_refused(tmp_path: Path) -> None:
    zarr = pytest.importorskip("zarr")
    zarr.create_array(tmp_path / "a.zarr", shape=(9000, 9000, 9000), chunks=(5, 5, 5), dtype="u1")
    with pytest.raises(InputError, match="chunks: expected at most"):
        load(tmp_path / "a.zarr")
    # where each is large, and none is stored, they cost nothing
    zarr.create_array(tmp_path / "b.zarr", shape=(9000, 9000, 9000), chunks=(500,) * 3, dtype="u1", fill_value=7)
    volume = load(tmp_path / "b.zarr")
    found = volume.samples[4000:4600, 8, :3]
    assert found.shape == (600, 3) and (found == 7).all() and not volume.samples.cache


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"shape": (1, 2, 3)}, "expected some of spacing, values, array, channel, time, anywhere for NRRD, got shape"),
        ({"sharpness": 3}, "expected some of shape, dtype"),
        ({"channel": 1}, "channel"),
        ({"channel": -1}, "zero or more"),
        ({"spacing": (1, 0, 1)}, "three positive numbers"),
        ({"levels": 1}, "two or more"),
        ({"dtype": "S4"}, "a real number type"),
        ({"dtype": "uint8x"}, "a real number type"),
        ({"shape": (4, 5)}, "three positive whole numbers"),
        ({"shape": (4, 5, 6.5)}, "three positive whole numbers"),
        ({"shape": "4x5x6"}, "three positive whole numbers"),
        ({"spacing": 1.0}, "three positive numbers"),
        ({"spacing": "abc"}, "three positive numbers"),
        ({"levels": "many"}, "levels: expected two or more voxel levels, got 'many'"),
        ({"channel": "red"}, "channel: expected a whole number, got 'red'"),
        ({"color": 7}, "color: expected the path"),
        ({"dtype": 8}, "dtype: expected the name of a type, got 8"),
    ],
)
def test_bad_options(tmp_path: Path, given: dict[str, object], message: str) -> None:
    more = "space origin: (0,0,0)\nspace directions: none (1,0,0) (0,1,0) (0,0,1)\n"
    header = f"NRRD0004\ntype: uchar\ndimension: 4\nsizes: 1 5 7 4\nencoding: raw\n{more}\n"
    (tmp_path / "a.nrrd").write_bytes(header.encode() + F.tobytes())
    assert load(tmp_path / "a.nrrd").shape == F.shape
    with pytest.raises(InputError, match=message):
        load(tmp_path / "a.nrrd", None, **given)


@pytest.mark.parametrize(
    ("name", "data", "module"),
    [
        ("a.nrrd", nrrd(), "nrrd"),
        ("a.nii", np.int32(348).tobytes() + bytes(400), "nibabel"),
        ("a.tif", b"II*\0", "tifffile"),
    ],
)
def test_missing_library_names_the_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, data: bytes, module: str
) -> None:
    (tmp_path / name).write_bytes(data)
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(InputError, match=r"pip install 'splatgl\[readers\]'"):
        load(tmp_path / name)


def test_notes_of_files_are_warnings(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """At the line that reads or draws the file; commands print them once instead."""
    path = tmp_path / "a.nrrd"
    header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 4 4\nencoding: raw\nendian: little\n"
    path.write_bytes(header.encode() + b"spacings: 1 1 nan\n\n" + bytes(range(64)))
    for read in (sg.load, lambda path: sg.render(path, size=16)):
        with pytest.warns(sg.InputWarning) as caught:
            read(path)
        notes = [warning for warning in caught if warning.category is sg.InputWarning]
        lines = [str(warning.message) for warning in notes]
        assert notes[0].filename == __file__ and [line.startswith(f"{path}: ") for line in lines] == [True] * len(lines)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert main(["info", str(path)]) == 0
    assert capsys.readouterr().err.count(lines[0].removeprefix(f"{path}: ")) == 1

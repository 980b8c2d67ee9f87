"""Legacy VTK and VTI: the phantom and a vector field in every coding, written byte by byte."""

from __future__ import annotations

import base64
import itertools
import re
import zlib
from pathlib import Path

import numpy as np
import pytest

from splatgl.data.volume import Volume
from splatgl.errors import InputError
from splatgl.readers import load
from splatgl.readers.common import is_mapped
from tests.helpers.phantom import ORIGIN, SPACING, F, Q

WIND = np.random.default_rng(5).normal(size=(*F.shape, 3)).astype(np.float32)
SPEED = np.sqrt((WIND.astype(np.float64) ** 2).sum(axis=-1))


def check(volume: Volume, mapped: bool, direction: np.ndarray, origin: tuple[float, ...] = ORIGIN) -> None:
    np.testing.assert_array_equal(volume.samples, F)
    np.testing.assert_array_equal(volume.vectors, WIND)
    assert volume.vectors is not None and volume.vectors.dtype == np.float32
    np.testing.assert_allclose(volume.spacing, SPACING)
    np.testing.assert_allclose(volume.origin, origin)
    np.testing.assert_allclose(volume.direction, direction, atol=1e-12)
    assert (volume.frame, volume.name, is_mapped(volume.samples)) == (None, "letter", mapped)


# --- legacy ----------------------------------------------------------------------------------------------------------


def numbers(array: np.ndarray, binary: bool) -> bytes:
    if binary:
        return array.astype(array.dtype.newbyteorder(">")).tobytes() + b"\n"
    words = [repr(value) for value in array.ravel().tolist()]
    return "\n".join(" ".join(words[i : i + 9]) for i in range(0, len(words), 9)).encode() + b"\n"


def legacy(path: Path, binary: bool, *sections: bytes) -> Path:
    head = (
        f"# vtk DataFile Version 4.2\nthe letter\n{'BINARY' if binary else 'ASCII'}\nDATASET STRUCTURED_POINTS\n"
        "DIMENSIONS 5 7 4\nASPECT_RATIO 1.5 2.25 3\nORIGIN 10 -20 30.5\n"
    )
    path.write_bytes(head.encode() + b"".join(sections))
    return path


def sections(binary: bool) -> list[bytes]:
    """A file-level field, metadata, cells, tables and points: all that a reader must step over."""
    return [
        b"FIELD FieldData 1\nTimeValue 1 1 double\n" + numbers(np.array([2.5]), binary),
        b"CELL_DATA 2\nSCALARS cells float\nLOOKUP_TABLE default\n" + numbers(np.array([1, 2], np.float32), binary),
        b"POINT_DATA 140\nSCALARS letter%20F short 1\nLOOKUP_TABLE mine\n" + numbers(F.astype(np.int16), binary),
        b"METADATA\nINFORMATION 1\nNAME x LOCATION y\nDATA 1\n\n",
        b"LOOKUP_TABLE mine 1\n" + (bytes(4) + b"\n" if binary else b"0 0 0 1\n"),
        b"VECTORS wind float\n" + numbers(WIND, binary),
        b"FIELD more 2\nother 1 140 double\n" + numbers(F.astype(np.float64) + 1, binary),
        b"flow 3 140 float\n" + numbers(WIND * 2, binary),
    ]


@pytest.mark.parametrize("binary", [True, False], ids=["binary", "ascii"])
def test_legacy(tmp_path: Path, binary: bool) -> None:
    path = legacy(tmp_path / "letter.vtk", binary, *sections(binary))
    check(load(path), mapped=binary, direction=np.eye(3))
    np.testing.assert_array_equal(load(path, array="letter F").samples, F)
    np.testing.assert_array_equal(load(path, array="other").samples, F + 1.0)
    for name in ("wind", "vectors", "speed"):
        np.testing.assert_allclose(load(path, array=name).samples, SPEED, rtol=1e-6)
    np.testing.assert_array_equal(load(path, array="wind", channel=1).samples, WIND[..., 1])
    flow = load(path, array="flow")
    np.testing.assert_allclose(flow.samples, 2 * SPEED, rtol=1e-6)
    np.testing.assert_array_equal(flow.vectors, WIND * 2)
    with pytest.raises(InputError, match=r"one of letter F \(1\), wind \(3\), other \(1\), flow \(3\), got 'wnd'"):
        load(path, array="wnd")


def test_legacy_with_vectors_alone_gives_their_length(tmp_path: Path) -> None:
    volume = load(legacy(tmp_path / "letter.vtk", True, b"POINT_DATA 140\nVECTORS v float\n", numbers(WIND, True)))
    np.testing.assert_allclose(volume.samples, SPEED, rtol=1e-6)
    np.testing.assert_array_equal(volume.vectors, WIND)


def test_three_numbers_of_scalars_are_a_vector(tmp_path: Path) -> None:
    """ITK writes displacements as SCALARS of three numbers."""
    itk = pytest.importorskip("SimpleITK")
    field = np.random.default_rng(2).normal(size=(4, 5, 6, 3)).astype(np.float32)
    itk.WriteImage(itk.GetImageFromArray(field, isVector=True), tmp_path / "a.vtk")
    volume = load(tmp_path / "a.vtk")
    assert np.array_equal(volume.vectors, field) and "read as a vector" in volume.notes[0]
    assert np.array_equal(load(tmp_path / "a.vtk", channel=2).samples, field[..., 2])


def test_legacy_without_lookup_table_line(tmp_path: Path) -> None:
    path = legacy(tmp_path / "letter.vtk", True, b"POINT_DATA 140\nSCALARS s unsigned_char\n", numbers(F, True))
    np.testing.assert_array_equal(load(path).samples, F)


# --- XML -------------------------------------------------------------------------------------------------------------


def coded(array: np.ndarray, header: np.dtype, compressed: bool, raw: bool, split: bool = False) -> bytes:
    """An array behind its header; base64 of a plain one is one run, or two (split)."""
    data = array.tobytes()
    if not compressed:
        size = np.array([len(data)], header).tobytes()
        if raw or not split:
            return size + data if raw else base64.b64encode(size + data)
        return base64.b64encode(size) + base64.b64encode(data)
    blocks = [data[i : i + 64] for i in range(0, len(data), 64)]
    packed = [zlib.compress(block) for block in blocks]
    last = len(blocks[-1]) % 64  # 0: the last block is full
    head = np.array([len(blocks), 64, last, *map(len, packed)], header).tobytes()
    body = b"".join(packed)
    return head + body if raw else base64.b64encode(head) + base64.b64encode(body)


def vti(
    path: Path, mode: str, header: str = "UInt32", order: str = "<", zipped: bool = False, split: bool = False
) -> Path:
    """mode: ascii, binary (inline base64), raw or base64 (appended). The extent begins at (2, 3, 4)."""
    width = np.dtype(order + {"UInt32": "u4", "UInt64": "u8"}[header])
    attributes = list[str]()
    tail, offset = b"", 0
    for array, name, kind, parts in ((F.astype("i2"), "letter", "Int16", 1), (WIND, "wind", "Float32", 3)):
        ordered = array.astype(array.dtype.newbyteorder("<" if order == "<" else ">"))
        data = coded(ordered, width, zipped, mode == "raw", split)
        start = f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{parts}" '
        if mode == "ascii":
            attributes.append(start + f'format="ascii">{" ".join(map(repr, array.ravel().tolist()))}</DataArray>')
        elif mode == "binary":
            attributes.append(start + f'format="binary">\n   {data.decode()}\n</DataArray>')
        else:
            attributes.append(start + f'format="appended" offset="{offset}"/>')
            tail, offset = tail + data, offset + len(data)
    matrix = " ".join(map(repr, Q.ravel().tolist()))
    packer = 'compressor="vtkZLibDataCompressor"' if zipped else ""
    head = (
        f'<?xml version="1.0"?>\n<VTKFile type="ImageData" version="1.0" header_type="{header}" '
        f'byte_order="{"LittleEndian" if order == "<" else "BigEndian"}" {packer}>\n'
        f'<ImageData WholeExtent="2 6 3 9 4 7" Origin="10 -20 30.5" Spacing="1.5 2.25 3" Direction="{matrix}">\n'
        f'<Piece Extent="2 6 3 9 4 7"><PointData>{"".join(attributes)}</PointData></Piece>\n</ImageData>\n'
    ).encode()
    if mode in ("raw", "base64"):
        head += f'<AppendedData encoding="{mode}">\n   _'.encode() + tail + b"\n</AppendedData>\n"
    path.write_bytes(head + b"</VTKFile>\n")
    return path


CODINGS = list(itertools.product(["binary", "raw", "base64"], ["UInt32", "UInt64"], "<>", [False, True]))


@pytest.mark.parametrize(("mode", "header", "order", "zipped"), [("ascii", "UInt32", "<", False), *CODINGS])
def test_vti(tmp_path: Path, mode: str, header: str, order: str, zipped: bool) -> None:
    path = vti(tmp_path / "letter.vti", mode, header, order, zipped)
    first = (Q * SPACING) @ [2, 3, 4] + ORIGIN
    check(load(path), mapped=mode == "raw" and not zipped, direction=Q, origin=tuple(first))
    np.testing.assert_allclose(load(path, array="speed").samples, SPEED, rtol=1e-6)


@pytest.mark.parametrize("header", ["UInt32", "UInt64"])
def test_vti_header_coded_apart_from_the_data(tmp_path: Path, header: str) -> None:
    """UInt32: the header's own padding shows it."""
    path = vti(tmp_path / "letter.vti", "binary", header, split=True)
    np.testing.assert_array_equal(load(path).samples, F)


DAMAGE = [
    ("raw", b'WholeExtent="2 6', b'WholeExtent="2 7', b'Extent="2 6', b'Extent="2 7', "as the extent says"),
    ("raw", b"ImageData", b"PolyData_", b"", b"", "expected VTK grid, as the name says, got VTK PolyData_"),
    ("raw", b"<?xml version", b"<!DOCTYPE a><?xml version", b"", b"", "a DOCTYPE"),
    ("raw", b'Spacing="1.5', b'Spacing="nan', b"", b"", "Spacing: expected 3 numbers"),
    ("binary", b'type="Int16"', b'type="Bits"', b"", b"", "DataArray letter"),
    (
        "raw",
        b"</Piece>",
        b'</Piece><Piece Extent="0 0 0 0 0 0"/>',
        b"",
        b"",
        "expected the same arrays in all pieces, got different arrays",
    ),
]


@pytest.mark.parametrize("case", DAMAGE, ids=lambda case: case[-1])
def test_vti_damage(tmp_path: Path, case: tuple[str, bytes, bytes, bytes, bytes, str]) -> None:
    mode, old, new, also, instead, message = case
    path = vti(tmp_path / "letter.vti", mode)
    text = path.read_bytes().replace(old, new)
    path.write_bytes(text.replace(also, instead) if also else text)
    with pytest.raises(InputError, match=message):
        load(path)


def test_vti_block_that_inflates_beyond_its_header_is_cut(tmp_path: Path) -> None:
    """A block of zeros a thousand times longer than stated must not be inflated whole, nor shift what follows."""
    head = np.array([1, 140, 0, 0], "<u4")
    bomb = zlib.compress(bytes(10**6))
    head[3] = len(bomb)
    path = vti(tmp_path / "letter.vti", "raw", zipped=True)
    text = re.sub(rb"<DataArray[^>]*wind[^>]*>", b"", path.read_bytes().replace(b"Int16", b"UInt8"))
    start = text.index(b"   _") + 4
    path.write_bytes(text[:start] + head.tobytes() + bomb + b"</AppendedData></VTKFile>")
    with pytest.raises(InputError, match="inflated block: expected 140 bytes, got more"):
        load(path, array="letter")


def image_of(sizes: str, section: str, data: bytes) -> bytes:
    head = f"# vtk DataFile Version 3.0\nx\nBINARY\nDATASET STRUCTURED_POINTS\nDIMENSIONS {sizes}\nSPACING 1 2 3\n"
    return (head + f"ORIGIN 0 0 0\n{section}\nLOOKUP_TABLE default\n").encode() + data + b"\n"


def test_ids_bits_and_cells_of_legacy_files(tmp_path: Path) -> None:
    """VTK writes ids in four bytes and bits packed; a file may have arrays of cells alone. Cut files are told."""
    values = np.arange(60).reshape(3, 4, 5)
    path = tmp_path / "a.vtk"
    path.write_bytes(image_of("6 5 4", "CELL_DATA 60\nSCALARS ids vtkIdType 1", values.astype(">i4").tobytes()))
    volume = load(path)
    assert np.array_equal(volume.samples, values)
    assert volume.origin == (0.5, 1, 1.5) and volume.spacing == (1, 2, 3)
    bits = image_of("5 4 3", "POINT_DATA 60\nSCALARS mask bit 1", np.packbits(values.ravel() % 3 == 0).tobytes())
    more = b"FIELD f 1\nd 1 60 float\n" + values.astype(">f4").tobytes() + b"\n"
    path.write_bytes(bits + more)
    volume = load(path)
    assert np.array_equal(volume.samples, values % 3 == 0) and volume.samples.dtype == bool
    assert volume.notes == ("array mask of 2 is rendered; --array picks another: d",)
    assert np.array_equal(load(path, array="d").samples, values) and not load(path, array="d").notes
    for whole in (bits, image_of("5 4 3", "POINT_DATA 60\nSCALARS ids vtkIdType 1", bytes(240))):
        path.write_bytes(whole[:-4])
        with pytest.raises(InputError, match="the file is cut short or its header states a wrong size"):
            load(path)


def test_the_active_array_is_drawn_without_hidden_points(tmp_path: Path) -> None:
    """As VTK draws them: the array that the file names, and no point or cell that it marks as hidden."""
    vtk = pytest.importorskip("vtk")
    from vtk.util.numpy_support import numpy_to_vtk

    values = np.arange(60, dtype=np.int16).reshape(3, 4, 5)
    for of_cells in (False, True):
        image = vtk.vtkImageData()
        image.SetDimensions(*(size + of_cells for size in values.shape[::-1]))
        data = image.GetCellData() if of_cells else image.GetPointData()
        marks = np.where(values.ravel() < 7, vtk.vtkDataSetAttributes.HIDDENCELL if of_cells else 2, 1).astype(np.uint8)
        for name, numbers in (("first", values.ravel()), ("second", 2 * values.ravel()), ("vtkGhostType", marks)):
            array = numpy_to_vtk(numbers, deep=True)
            array.SetName(name)
            data.AddArray(array)
        data.SetActiveScalars("second")
        writer = vtk.vtkXMLImageDataWriter()
        writer.SetFileName(str(tmp_path / "a.vti"))
        writer.SetInputData(image)
        writer.Write()
        volume = load(tmp_path / "a.vti")
        np.testing.assert_array_equal(volume.samples, np.where(values < 7, np.nan, 2 * values))
        what = "cells" if of_cells else "points"
        assert volume.notes == (
            "array second of 2 is rendered; --array picks another: first",
            f"7 {what} that the file hides are left out",
        )

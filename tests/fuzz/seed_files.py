"""Seed files of readers.py: their structure, and those in VTK's two formats."""

from __future__ import annotations

import base64
import struct
import tempfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

SHAPE = (6, 9, 11)
CUBE = np.random.default_rng(1).integers(0, 200, SHAPE).astype(np.uint8)
FLOW = np.random.default_rng(2).normal(size=(*SHAPE, 3)).astype(np.float32)
RAW = CUBE.tobytes()
X, Y, Z = SHAPE[::-1]

Unpack = Callable[[bytes], bytes]


@dataclass(frozen=True)
class Seed:
    """A valid file: the name to load, and all files by name, the header first.

    kind: volume, mesh, scene or transfer. name_matters: the name states sizes. unpack, pack: decompress and compress
    the first file's content, so that mutations reach beyond its checksum.
    """

    main: str
    files: dict[str, bytes]
    kind: str = "volume"
    name_matters: bool = False
    unpack: Unpack | None = None
    pack: Unpack | None = None


def one(name: str, data: bytes, unpack: Unpack | None = None, pack: Unpack | None = None) -> Seed:
    return Seed(name, {name: data}, unpack=unpack, pack=pack)


def written(name: str, save: Callable[[Path], object]) -> Seed:
    """The output of a library under `name`: a file, or a folder with its contents."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        save(path)
        found = sorted(p for p in (path, *path.rglob("*")) if p.is_file())
        files = {str(p.relative_to(folder)): p.read_bytes() for p in found}
    # metadata first
    order = sorted(files, key=lambda key: not Path(key).name.startswith((".z", "zarr")))
    return Seed(name, {key: files[key] for key in order})


VTK = f"""# vtk DataFile Version 4.2
a title
{{coding}}
DATASET STRUCTURED_POINTS
DIMENSIONS {X} {Y} {Z}
SPACING 1.5 2 3
ORIGIN 10 -20 30.5
POINT_DATA {CUBE.size}
SCALARS density unsigned_char 1
LOOKUP_TABLE default
"""
META_BLOCK = b"\nMETADATA\nINFORMATION 0\n\n"


def vtk_legacy(coding: str) -> list[Seed]:
    def numbers(array: np.ndarray) -> bytes:
        if coding == "BINARY":
            return array.astype(array.dtype.newbyteorder(">")).tobytes() + b"\n"
        return "\n".join(" ".join(f"{v:g}" for v in row) for row in array.reshape(-1, X)).encode() + b"\n"

    head = VTK.format(coding=coding).encode() + numbers(CUBE)
    table = b"LOOKUP_TABLE default 2\n" + (bytes(8) if coding == "BINARY" else b"0 0 0 1 1 1 1 1") + b"\n"
    field = f"FIELD FieldData 1\nheat 1 {CUBE.size} float\n".encode() + numbers(CUBE.astype(np.float32))
    return [one("a.vtk", head + table + META_BLOCK + b"VECTORS flow float\n" + numbers(FLOW) + field)]


VTI = f"""<?xml version="1.0"?>
<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" header_type="{{header}}"{{packed}}>
<ImageData WholeExtent="2 {X + 1} 0 {Y - 1} 0 {Z - 1}" Origin="10 -20 30.5" Spacing="1.5 2 3"
 Direction="1 0 0 0 1 0 0 0 1">
<Piece Extent="2 {X + 1} 0 {Y - 1} 0 {Z - 1}"><PointData Scalars="density">
<DataArray type="UInt8" Name="density" format="{{form}}"{{where}}>{{density}}</DataArray>
<DataArray type="Float32" Name="flow" NumberOfComponents="3" format="{{form}}"{{there}}>{{flow}}</DataArray>
</PointData></Piece></ImageData>
"""
ZLIB = ' compressor="vtkZLibDataCompressor"'


def vti() -> list[Seed]:
    """Inline: ASCII, base64, and base64 of zlib blocks."""
    text = [" ".join(f"{v:g}" for v in array.ravel()) for array in (CUBE, FLOW)]
    plain = [base64.b64encode(struct.pack("<I", len(data)) + data).decode() for data in (RAW, FLOW.tobytes())]
    blocks = ["".join(base64.b64encode(part).decode() for part in _blocks(data)) for data in (RAW, FLOW.tobytes())]
    return [
        _vti("UInt32", "", "ascii", text),
        _vti("UInt32", "", "binary", plain),
        _vti("UInt64", ZLIB, "binary", blocks),
    ]


def _vti(header: str, packed: str, form: str, arrays: list[str]) -> Seed:
    body = VTI.format(header=header, packed=packed, form=form, where="", there="", density=arrays[0], flow=arrays[1])
    return one("a.vti", (body + "</VTKFile>").encode())


def vti_appended() -> list[Seed]:
    seeds = []
    for packed, coding in (("", "raw"), ("", "base64"), (ZLIB, "raw"), (ZLIB, "base64")):
        runs = []
        for data in (RAW, FLOW.tobytes()):
            parts = _blocks(data) if packed else (struct.pack("<Q", len(data)) + data,)
            runs.append(b"".join(base64.b64encode(part) if coding == "base64" else part for part in parts))
        offsets = [f' offset="{offset}"' for offset in (0, len(runs[0]))]
        body = VTI.format(
            header="UInt64", packed=packed, form="appended", where=offsets[0], there=offsets[1], density="", flow=""
        )
        tail = f'<AppendedData encoding="{coding}">_'.encode() + b"".join(runs) + b"</AppendedData></VTKFile>"
        seeds.append(one("a.vti", body.encode() + tail))
    return seeds


def _blocks(data: bytes, size: int = 400) -> tuple[bytes, bytes]:
    """Header and data of zlib blocks of `size` bytes, with 64-bit counts."""
    parts = [data[start : start + size] for start in range(0, len(data), size)]
    packed = [zlib.compress(part) for part in parts]
    last = len(parts[-1]) % size
    return struct.pack(f"<{3 + len(parts)}Q", len(parts), size, last, *map(len, packed)), b"".join(packed)


def vtk_cells() -> list[Seed]:
    """Hexahedra and tetrahedra of points, both as pieces, a curved grid, and AMR of two levels, in text."""

    def array(name: str, kind: str, values: np.ndarray, parts: int = 1) -> str:
        words = " ".join(f"{value:g}" for value in values.ravel())
        start = f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{parts}" format="ascii">'
        return f"{start}{words}</DataArray>"

    z, y, x = np.indices((3, 3, 4)).reshape(3, -1)
    first = [a + 4 * b + 12 * c for c in range(2) for b in range(2) for a in range(3)]
    corners = np.array([[n, n + 1, n + 5, n + 4, n + 12, n + 13, n + 17, n + 16] for n in first])
    seeds = []
    for kind, cells in ((12, corners), (10, corners[:, [0, 1, 3, 4]])):
        places = np.stack([x**1.5, y * 2.0, z], axis=1)
        text = (
            '<VTKFile type="UnstructuredGrid" version="1.0" header_type="UInt64"><UnstructuredGrid>'
            f'<Piece NumberOfPoints="36" NumberOfCells="{len(cells)}"><PointData>{array("s", "Float32", x + y)}'
            f"</PointData><CellData>{array('c', 'Int32', np.arange(len(cells)))}</CellData><Points>"
            f"{array('Points', 'Float64', places, 3)}</Points><Cells>{array('connectivity', 'Int64', cells)}"
            f"{array('offsets', 'Int64', np.arange(1, len(cells) + 1) * cells.shape[1])}"
            f"{array('types', 'UInt8', np.full(len(cells), kind))}</Cells></Piece></UnstructuredGrid></VTKFile>"
        )
        seeds.append(one("a.vtu", text.encode()))
    pieces = {f"{n}.vtu": seed.files["a.vtu"] for n, seed in enumerate(seeds)}
    listed = (
        '<PPointData><PDataArray type="Float32" Name="s"/></PPointData><PCellData><PDataArray type="Int32" Name="c"/>'
    )
    listed += '</PCellData><PPoints><PDataArray type="Float64" NumberOfComponents="3" Name="Points"/></PPoints>'
    listed += "".join(f'<Piece Source="{name}"/>' for name in pieces)
    parent = f'<VTKFile type="PUnstructuredGrid"><PUnstructuredGrid>{listed}</PUnstructuredGrid></VTKFile>'
    seeds.append(Seed("a.pvtu", {"a.pvtu": parent.encode(), **pieces}))
    curved = (
        '<VTKFile type="StructuredGrid" version="1.0"><StructuredGrid WholeExtent="0 3 0 2 0 2">'
        f'<Piece Extent="0 3 0 2 0 2"><PointData>{array("v", "Float32", places, 3)}</PointData><Points>'
        f"{array('Points', 'Float64', places, 3)}</Points></Piece></StructuredGrid></VTKFile>"
    )
    seeds.append(one("a.vts", curved.encode()))
    blocks = {}
    for level, (start, count) in enumerate((((0, 0, 0), 4), ((1, 1, 1), 3))):
        step, extent = 1 / 2**level, f"0 {count} 0 {count} 0 {count}"
        blocks[f"{level}.vti"] = (
            f'<VTKFile type="ImageData" version="1.0"><ImageData WholeExtent="{extent}" Spacing="{step} {step} {step}" '
            f'Origin="{" ".join(map(str, start))}"><Piece Extent="{extent}"><CellData>'
            f"{array('d', 'Float32', np.arange(count**3))}</CellData></Piece></ImageData></VTKFile>"
        ).encode()
    boxes = ("0 3 0 3 0 3", "2 4 2 4 2 4")
    levels = "".join(
        f'<Block level="{n}" spacing="{f"{1 / 2**n} " * 3}"><DataSet index="0" amr_box="{box}" file="{n}.vti"/></Block>'
        for n, box in enumerate(boxes)
    )
    head = '<VTKFile type="vtkOverlappingAMR" version="1.1"><vtkOverlappingAMR origin="0 0 0" grid_description="XYZ">'
    index = f"{head}{levels}</vtkOverlappingAMR></VTKFile>".encode()
    return [*seeds, Seed("a.vthb", {"a.vthb": index, **blocks})]

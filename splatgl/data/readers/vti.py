"""VTK's XML image files (.vti): grid and arrays of the XML part; the coding of the numbers is in vti_data.

Format: "VTK XML file formats", docs.vtk.org. A point's index counts from WholeExtent's lower end, and Direction is
listed row by row.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from splatgl.data.errors import expected
from splatgl.data.readers.files import Shape, grid_shape
from splatgl.data.readers.grid import axes_of, triple
from splatgl.data.readers.options import LoadOptions
from splatgl.data.readers.vti_data import Coding, Source, decode, parse_ascii
from splatgl.data.readers.vtk_arrays import PointArray, hints_for, pick
from splatgl.data.readers.xml_tree import parse_xml
from splatgl.data.volume import Volume

_TYPES = {
    f"{name}{8 * size}": f"{code}{size}"
    for name, code, sizes in (("Int", "i", (1, 2, 4, 8)), ("UInt", "u", (1, 2, 4, 8)), ("Float", "f", (4, 8)))
    for size in sizes
}

_APPENDED = b"<AppendedData"


def read(path: Path, options: LoadOptions) -> Volume:
    """The volume of a .vti file; `array` picks one by name, the first vectors go to `Volume.vectors`."""
    root, appended = _parse(path)
    if root.tag != "VTKFile" or root.get("type") != "ImageData":
        raise expected("type", "a VTKFile of ImageData", root.get("type") or root.tag)
    image, pieces = root.find("ImageData"), root.findall("ImageData/Piece")
    if image is None or len(pieces) != 1:
        raise expected("Piece", "one piece", len(pieces), "save the image in one piece")
    # 1. the grid; the origin is that of index 0, the first sample stands at the extent's lower end
    extent = _extent(pieces[0] if pieces[0].get("Extent") else image)
    shape = grid_shape([extent[axis + 1] - extent[axis] + 1 for axis in (0, 2, 4)], "Extent")
    direction = np.array(_numbers(image, "Direction", "1 0 0 0 1 0 0 0 1", 9)).reshape(3, 3)
    matrix = direction * _numbers(image, "Spacing", "1 1 1", 3)
    spacing, direction = axes_of(matrix, "Direction and Spacing")
    origin = matrix @ extent[::2] + _numbers(image, "Origin", "0 0 0", 3)
    # 2. the arrays
    coding = _coding(root)
    nodes = pieces[0].findall("PointData/DataArray")
    arrays = [_array(path, node, coding, appended, shape) for node in nodes]
    samples, vectors = pick(arrays, options)
    hints = hints_for(arrays, options, samples)
    return Volume(samples, spacing, triple(origin, "Origin"), direction, vectors=vectors, hints=hints)


def _parse(path: Path) -> tuple[Element, Source | None]:
    """The XML part of the file, and the start of its appended data, which need not be XML."""
    data = np.memmap(path, np.uint8, mode="r")
    text = data[: _find(data, _APPENDED)].tobytes()
    appended = None
    if len(text) < len(data):
        tag_end = len(text) + _find(data[len(text) :], b">")
        first = tag_end + _find(data[tag_end:], b"_") + 1
        raw = b'"raw"' in data[len(text) : tag_end].tobytes()
        appended = Source(path, None, first, raw)
        text += b"</VTKFile>"
    return parse_xml(text, "VTI"), appended


def _find(data: np.ndarray, word: bytes) -> int:
    """Offset of `word` in the bytes, or their number if absent; reads only up to it."""
    step = 1 << 20
    for start in range(0, len(data), step):
        place = data[start : start + step + len(word)].tobytes().find(word)
        if place >= 0:
            return start + place
    return len(data)


def _coding(root: Element) -> Coding:
    order = {"LittleEndian": "<", "BigEndian": ">"}.get(root.get("byte_order", "LittleEndian"))
    header = {"UInt32": "u4", "UInt64": "u8"}.get(root.get("header_type", "UInt32"))
    compressor = root.get("compressor", "")
    if order is None or header is None:
        got = f"{root.get('byte_order')}, {root.get('header_type')}"
        raise expected("byte_order and header_type", "Little/BigEndian, UInt32/64", got)
    if compressor not in ("", "vtkZLibDataCompressor"):
        raise expected("compressor", "zlib or none", compressor, "save it with zlib")
    return Coding(np.dtype(order + header), bool(compressor))


def _array(path: Path, node: Element, coding: Coding, appended: Source | None, shape: Shape) -> PointArray:
    name, type_name, kind = node.get("Name", "unnamed"), node.get("type", "none"), node.get("format", "none")
    components = int(_numbers(node, "NumberOfComponents", "1", 1)[0])
    if type_name not in _TYPES or components < 1:
        raise expected(f"DataArray {name}", "a number type and components", f"{type_name}, {components}")
    dtype = np.dtype(_TYPES[type_name]).newbyteorder(coding.header.byteorder)
    full = (*shape, components)
    if kind == "ascii":
        read = partial(parse_ascii, node.text or "", dtype, full)
    elif kind == "binary":
        inline = "".join((node.text or "").split()).encode("ascii", "replace")
        read = partial(decode, Source(path, inline, 0, False), coding, dtype, full)
    elif kind == "appended" and appended is not None:
        source = appended.at(int(_numbers(node, "offset", "0", 1)[0]))
        read = partial(decode, source, coding, dtype, full)
    else:
        raise expected(f"DataArray {name}", "format ascii, binary or appended (with data)", kind)
    return PointArray(name, components, components == 3 and dtype.kind == "f", read)


def _extent(element: Element) -> list[int]:
    name = "Extent" if element.get("Extent") else "WholeExtent"
    return [int(number) for number in _numbers(element, name, "", 6)]


def _numbers(element: Element, name: str, default: str, count: int) -> list[float]:
    text = element.get(name, default)
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        numbers = []
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise expected(name, f"{count} numbers", repr(text))
    return numbers

"""VTK's XML files: the XML part, and the arrays that it declares; the coding of the numbers is in vti_data.

Format: "VTK XML file formats", docs.vtk.org.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from splatgl.data.readers.files import Shape
from splatgl.data.readers.vti_data import COMPRESSORS, Coding, Source, decode, parse_ascii
from splatgl.data.readers.vtk_arrays import PointArray
from splatgl.data.readers.xml_tree import parse_xml
from splatgl.errors import expected

_TYPES = {
    f"{name}{8 * size}": f"{code}{size}"
    for name, code, sizes in (("Int", "i", (1, 2, 4, 8)), ("UInt", "u", (1, 2, 4, 8)), ("Float", "f", (4, 8)))
    for size in sizes
}

_APPENDED = b"<AppendedData"


@dataclass(frozen=True)
class VtkXml:
    """A file's XML part, the start of its appended data if it has such, and the coding of its arrays."""

    path: Path
    root: Element
    appended: Source | None
    coding: Coding

    @property
    def kind(self) -> str:
        """What the file holds, such as ImageData."""
        return self.root.get("type") or self.root.tag


def parse_vtk(path: Path, kinds: tuple[str, ...]) -> VtkXml:
    """The XML part of a file, whose appended data need not be XML. InputError if it holds none of `kinds`."""
    data = np.memmap(path, np.uint8, mode="r")
    text = data[: _find(data, _APPENDED)].tobytes()
    appended = None
    if len(text) < len(data):
        tag_end = len(text) + _find(data[len(text) :], b">")
        first = tag_end + _find(data[tag_end:], b"_") + 1
        raw = b'"raw"' in data[len(text) : tag_end].tobytes()
        appended = Source(path, None, first, raw)
        text += b"</VTKFile>"
    root = parse_xml(text, "VTK XML")
    if root.tag != "VTKFile" or root.get("type") not in kinds:
        raise expected("type", f"a VTKFile of {' or '.join(kinds)}", root.get("type") or root.tag)
    return VtkXml(path, root, appended, _coding(root))


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
    if compressor not in ("", *COMPRESSORS):
        raise expected("compressor", "zlib, LZ4, LZMA or none", compressor, "save it with zlib")
    return Coding(np.dtype(order + header), compressor)


def arrays_of(file: VtkXml, owner: Element, shape: Shape) -> list[PointArray]:
    """The arrays below an element [D, H, W, components], each read when it is needed."""
    return [_array(file, node, shape) for node in owner.findall("DataArray")]


def _array(file: VtkXml, node: Element, shape: Shape) -> PointArray:
    name, type_name, kind = node.get("Name", "unnamed"), node.get("type", "none"), node.get("format", "none")
    components = int(numbers_in(node, "NumberOfComponents", "1", 1)[0])
    if type_name not in _TYPES or components < 1:
        raise expected(f"DataArray {name}", "a number type and components", f"{type_name}, {components}")
    dtype = np.dtype(_TYPES[type_name]).newbyteorder(file.coding.header.byteorder)
    full = (*shape, components)
    if kind == "ascii":
        read = partial(parse_ascii, node.text or "", dtype, full)
    elif kind == "binary":
        inline = "".join((node.text or "").split()).encode("ascii", "replace")
        read = partial(decode, Source(file.path, inline, 0, False), file.coding, dtype, full)
    elif kind == "appended" and file.appended is not None:
        source = file.appended.at(int(numbers_in(node, "offset", "0", 1)[0]))
        read = partial(decode, source, file.coding, dtype, full)
    else:
        raise expected(f"DataArray {name}", "format ascii, binary or appended (with data)", kind)
    return PointArray(name, components, components == 3 and dtype.kind == "f", read, dtype)


def extent_of(element: Element) -> list[int]:
    """Lowest and highest index of points along x, y, z: six numbers."""
    name = "Extent" if element.get("Extent") else "WholeExtent"
    return [int(number) for number in numbers_in(element, name, "", 6)]


def numbers_in(element: Element, name: str, default: str, count: int) -> list[float]:
    """The numbers of an attribute. Raises InputError unless there are `count` finite ones."""
    text = element.get(name, default)
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        numbers = []
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise expected(name, f"{count} numbers", repr(text))
    return numbers

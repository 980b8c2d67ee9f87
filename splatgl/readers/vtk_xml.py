"""The XML part of VTK's files, and the coded bytes of their arrays.

Format: "VTK XML file formats", docs.vtk.org.
"""

from __future__ import annotations

import base64
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, tostring

import numpy as np

from splatgl.errors import expected
from splatgl.readers.common import decoder_errors, find_data_file, parse_xml, require_bytes

# numpy codes of VTK's types
XML_TYPES = {
    f"{name}{8 * size}": f"{code}{size}"
    for name, code, sizes in (("Int", "i", (1, 2, 4, 8)), ("UInt", "u", (1, 2, 4, 8)), ("Float", "f", (4, 8)))
    for size in sizes
}
# deepest nesting of files that name others; largest numbers of what VTK goes through one by one
_DEPTH, _MOST = 8, {"NumberOfComponents": 2**16, "level": 2**8}
_APPENDED, _END = b"<AppendedData", b"</AppendedData"


@dataclass(frozen=True)
class ByteSource:
    """Bytes of arrays, uint8 [N], of text or mapped from a file; raw or in base64."""

    data: np.ndarray
    raw: bool

    def at(self, offset: int) -> ByteSource:
        """The source `offset` stored bytes further on."""
        if offset < 0:
            raise expected("offset", "zero or more bytes", offset)
        return ByteSource(self.data[offset:], self.raw)

    def stored(self, count: int) -> int:
        """Stored bytes that code `count` bytes: base64 turns three into four characters."""
        return count if self.raw else 4 * -(-count // 3)

    def take(self, count: int) -> np.ndarray:
        """The first `count` bytes, decoded. Raises InputError for fewer bytes."""
        require_bytes(self.stored(count), len(self.data))
        data = self.data[: self.stored(count)]
        if not self.raw:
            with decoder_errors("base64 data"):
                data = np.frombuffer(base64.b64decode(data.tobytes(), validate=True), np.uint8)
            require_bytes(count, len(data), "base64 data")
        return data[:count]

    def block(self, header: np.dtype, needed: int | None = None) -> np.ndarray:
        """The bytes of an uncompressed array behind its header, their number. Raises InputError for fewer bytes, and
        for others than `needed`.
        """
        width = header.itemsize
        stated = int(self.take(width).view(header)[0])
        if needed not in (None, stated):
            raise expected("data", f"{needed} bytes, as the extent says", f"{stated} by its header")
        # header and data are one run of characters, or two if the header was padded
        apart = self.stored(width)
        if not self.raw and self.data[apart - 1] == ord("="):
            return self.at(apart).take(stated)
        return self.take(width + stated)[width:]


@dataclass(frozen=True)
class VtkXml:
    """A file's XML part, its appended data if any, and the coding of its arrays: the dtype of the headers' counts, and
    the compressor of blocks or "".
    """

    root: Element
    appended: ByteSource | None
    header: np.dtype
    compressor: str

    @property
    def kind(self) -> str:
        """The type of the data set, such as ImageData."""
        return self.root.get("type") or self.root.tag

    def source(self, node: Element) -> ByteSource | None:
        """The coded bytes of an element DataArray; None for numbers in text. Raises InputError without any."""
        form = node.get("format", "none")
        if form == "binary":
            inline = "".join((node.text or "").split()).encode("ascii", "replace")
            return ByteSource(np.frombuffer(inline, np.uint8), raw=False)
        if form == "appended" and self.appended is not None:
            return self.appended.at(int(parse_numbers(node, "offset", "0", 1)[0]))
        if form != "ascii":
            raise expected(f"DataArray {node.get('Name')}", "format ascii, binary or appended (with data)", form)
        return None


def parse_vtk(path: Path, kinds: tuple[str, ...]) -> VtkXml:
    """Parses the XML part of a file; appended data need not be XML. Raises InputError for a type not in `kinds`, where
    there are any.
    """
    data, appended = np.memmap(path, np.uint8, mode="r"), None
    text = data[: _find_word(data, _APPENDED)].tobytes()
    if len(text) < len(data):
        tag_end = len(text) + _find_word(data[len(text) :], b">")
        first = tag_end + _find_word(data[tag_end:], b"_") + 1
        # the end tag follows the data, unless the file is cut
        rest = data[max(len(data) - 256, first) :].tobytes()
        end = len(data) - len(rest) + rest.rfind(_END) if _END in rest else len(data)
        appended = ByteSource(data[first:end], b'"raw"' in data[len(text) : tag_end].tobytes())
        text += b"</VTKFile>"
    root = parse_xml(text, "VTK XML")
    if root.tag != "VTKFile" or (kinds and root.get("type") not in kinds):
        raise expected("type", f"a VTKFile{' of ' * bool(kinds)}{' or '.join(kinds)}", root.get("type") or root.tag)
    order = {"LittleEndian": "<", "BigEndian": ">"}.get(root.get("byte_order", "LittleEndian"))
    header = {"UInt32": "u4", "UInt64": "u8"}.get(root.get("header_type", "UInt32"))
    if order is None or header is None:
        got = f"{root.get('byte_order')}, {root.get('header_type')}"
        raise expected("byte_order and header_type", "Little/BigEndian, UInt32/64", got)
    return VtkXml(root, appended, np.dtype(order + header), root.get("compressor", ""))


def _find_word(data: np.ndarray, word: bytes) -> int:
    """Offset of `word` in the bytes, or their number without it; reads only up to it."""
    step = 1 << 20
    for start in range(0, len(data), step):
        place = data[start : start + step + len(word)].tobytes().find(word)
        if place >= 0:
            return start + place
    return len(data)


def parse_numbers(element: Element, name: str, default: str, count: int) -> list[float]:
    """The numbers of an attribute. Raises InputError unless there are `count` finite ones."""
    text = element.get(name, default)
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        numbers = []
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise expected(name, f"{count} numbers", repr(text)[:80])
    return numbers


def spell_numbers(path: Path) -> bytes | None:
    """A file whose numbers in text that VTK does not read, nan and inf, are in base64; None for others."""
    data = np.memmap(path, np.uint8, mode="r")
    if not any(_find_word(data, word) < len(data) for word in (b"nan", b"NaN", b"inf")):
        return None
    file = parse_vtk(path, ())
    nodes = [node for node in file.root.iter("DataArray") if node.get("type") in XML_TYPES]
    if not nodes or file.appended or any(node.get("format") != "ascii" for node in nodes):
        return None
    file.root.attrib.pop("compressor", None)
    for node in nodes:
        dtype = np.dtype(XML_TYPES[node.get("type", "")]).newbyteorder(file.header.byteorder)
        numbers = np.array((node.text or "").split() or np.empty(0, "S1")).astype(dtype).tobytes()
        node.text = base64.b64encode(np.array([len(numbers)], file.header).tobytes() + numbers).decode()
        node.set("format", "binary")
    return tostring(file.root)


def is_xml(path: Path) -> bool:
    """Whether a file begins as XML does."""
    with path.open("rb") as file:
        return file.read(16).lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<")


def check_xml(path: Path, anywhere: bool, kinds: tuple[str, ...] = (), depth: int = 0, is_part: bool = False) -> int:
    """Bytes of a file of VTK in XML and of those that it names. Raises InputError for a type not in `kinds`, names
    outside of its folder, if not `anywhere`, and for uncompressed arrays that are cut, as VTK takes them for whole.
    is_part: whether a file names it as a piece, so that it may hold less than the whole grid.
    """
    if depth > _DEPTH:
        raise expected("file", f"at most {_DEPTH} files that name each other", "more")
    file, size = parse_vtk(path, kinds), path.stat().st_size
    _check_pieces(file, is_part)
    for node in file.root.iter():
        if node.tag in ("DataArray", "Array") and not file.compressor and (source := file.source(node)):
            source.block(file.header)
        for attribute, most in _MOST.items():
            (number,) = parse_numbers(node, attribute, "0", 1)
            if not 0 <= number <= most:
                raise expected(attribute, f"at most {most}", f"{number:g}", "the file is damaged")
        if name := node.get("Source") or node.get("file"):
            other = find_data_file(path, name, anywhere)
            size += (
                check_xml(other, anywhere, (), depth + 1, file.kind.startswith("P"))
                if is_xml(other)
                else other.stat().st_size
            )
    return size


def _check_pieces(file: VtkXml, is_part: bool) -> None:
    """Raises InputError for pieces with different arrays, and for gaps between them, where VTK returns any values."""
    owner, kinds, extents, in_cells = file.root.find(file.kind), set(), [], False
    for piece in file.root.iter("Piece"):
        extent = np.array(parse_numbers(piece, "Extent", "0 0 0 0 0 0", 6)).reshape(3, 2)
        if (extent[:, 1] < extent[:, 0]).any() or piece.get("NumberOfPoints") == "0":
            continue
        arrays = [(name, node) for name in ("PointData", "CellData") for node in piece.findall(f"{name}/DataArray")]
        kinds.add(tuple((name, *map(node.get, ("Name", "type", "NumberOfComponents"))) for name, node in arrays))
        in_cells |= piece.find("CellData/DataArray") is not None or file.root.find(".//PCellData/") is not None
        extents.append(extent)
    if len(kinds) > 1:
        raise expected("pieces", "the same arrays in all pieces", "different arrays", "save the grid again")
    if owner is None or owner.get("WholeExtent") is None or len(extents) < 1 + is_part:
        return
    boxes = np.stack([np.array(parse_numbers(owner, "WholeExtent", "", 6)).reshape(3, 2), *extents])
    # points at the ends belong to a piece, and cells in between
    boxes[..., 1] = np.maximum(boxes[..., 1] + (not in_cells), boxes[..., 0] + 1)
    cuts = [np.unique(np.clip(boxes[:, axis], *boxes[0, axis])) for axis in range(3)]
    covered = np.zeros([len(cut) - 1 for cut in cuts], bool)
    for box in boxes[1:]:
        covered[tuple(slice(*np.searchsorted(cut, ends)) for cut, ends in zip(cuts, box, strict=True))] = True
    if not covered.all():
        raise expected("pieces", "a whole grid", "gaps between them")

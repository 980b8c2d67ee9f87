"""Checks of a TIFF file's structure before it is decoded: its pages, and OME's numbers of planes."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import BinaryIO
from xml.etree.ElementTree import Element

from splatgl.errors import expected

MAX_PLANES = 2**20
"""Most planes of a series: a list of them takes some bytes each, whether they are in the file or not."""

_TYPE_BYTES = (0, 1, 1, 2, 4, 8, 1, 1, 2, 4, 8, 4, 8, 4, 0, 0, 8, 8, 8)
"""Bytes of a tag's value by its type's number (TIFF 6.0 §2, TIFF technical note 1, BigTIFF)."""

_MIN_TAGS, _MAX_TAGS = 4, 4096
"""Tags of a page: width, height, where its strips are and how many bytes they have; none has thousands."""

_OME_COUNTS = ("IFD", "NumPlanes", "PlaneCount", "FirstC", "FirstT", "FirstZ", "SizeC", "SizeT", "SizeZ")


def check_chain(path: Path) -> None:
    """Raises InputError for pages that form a cycle, overlap, or share their tags' values.

    Truncated files are left to the decoder, which reports what is missing.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        layout = _layout(file.read(16))
        if layout is None:
            return
        form, offset = layout
        # 1. page by page: no cycles, and their total size is at most the file's
        seen: set[int] = set()
        used = 0
        while 0 < offset < size:
            if offset in seen:
                raise expected("pages", "an end", f"page {len(seen)} leading back to another", "the file is damaged")
            seen.add(offset)
            table, values, offset = form.page(file, offset)
            used += table + values
            # 2. few writers share tag values, and none shares long ones
            if used > 2 * size:
                raise expected("tags", f"at most {size} bytes", "more", "the file is damaged")


class _Form:
    """The two layouts: classic with 32-bit offsets, BigTIFF with 64-bit ones."""

    def __init__(self, order: str, big: bool) -> None:
        self.count = struct.Struct(order + ("Q" if big else "H"))
        self.tag = struct.Struct(order + ("HHQQ" if big else "HHII"))
        self.offset = struct.Struct(order + ("Q" if big else "I"))

    def page(self, file: BinaryIO, start: int) -> tuple[int, int, int]:
        """(bytes of the page's table, bytes of its tags' values, place of the next page; 0 at the end)."""
        file.seek(start)
        head = file.read(self.count.size)
        if len(head) < self.count.size:
            return 0, 0, 0
        (tags,) = self.count.unpack(head)
        if not _MIN_TAGS <= tags <= _MAX_TAGS:
            raise expected("tags of a page", f"{_MIN_TAGS} to {_MAX_TAGS}", tags, "the file is damaged")
        table = file.read(tags * self.tag.size)
        whole = len(table) // self.tag.size * self.tag.size
        entries = list(self.tag.iter_unpack(table[:whole]))
        values = sum(_TYPE_BYTES[kind] * count for _, kind, count, _ in entries if kind < len(_TYPE_BYTES))
        last = file.read(self.offset.size)
        following = self.offset.unpack(last)[0] if len(last) == self.offset.size else 0
        return len(table), values, following


def _layout(head: bytes) -> tuple[_Form, int] | None:
    """The file's layout and its first page's place; None if it is not TIFF."""
    order = {b"II": "<", b"MM": ">"}.get(head[:2])
    if order is None or len(head) < 16:
        return None
    (version,) = struct.unpack_from(order + "H", head, 2)
    if version not in (42, 43):
        return None
    big = version == 43
    return _Form(order, big), struct.unpack_from(order + ("Q" if big else "I"), head, 8 if big else 4)[0]


def check_ome(root: Element) -> None:
    """Raises InputError if OME's metadata state more planes than any file has."""
    for node in root.iter():
        counts = {name: _whole(node, name) for name in _OME_COUNTS if name in node.attrib}
        planes = abs(counts.get("SizeC", 1) * counts.get("SizeT", 1) * counts.get("SizeZ", 1))
        most = max((planes, *map(abs, counts.values())))
        if most > MAX_PLANES:
            raise expected("OME-XML", f"at most {MAX_PLANES} planes", most, "the metadata are damaged")
        if "Start" in node.attrib and "End" in node.attrib:
            _check_steps(node)


def _check_steps(node: Element) -> None:
    """A modulo annotation counts its own steps."""
    try:
        start, end, step = (float(node.get(name, "1")) for name in ("Start", "End", "Step"))
    except ValueError:
        return
    if not abs(end - start) <= MAX_PLANES * abs(step):
        raise expected("OME-XML", f"at most {MAX_PLANES} steps", "more", "the metadata are damaged")


def _whole(node: Element, name: str) -> int:
    try:
        return int(node.attrib[name])
    except ValueError:
        raise expected(f"OME-XML {name}", "a whole number", repr(node.attrib[name])) from None

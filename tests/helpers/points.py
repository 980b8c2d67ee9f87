"""Small files of points, written by laspy or by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

# places beyond float32's digits, and bytes of sRGB
PLACES = np.array([[500000.25, 4000000.5, 1.0], [500001.25, 4000003.5, -2.0], [500007.25, 4000000.5, 4.5]])
BYTES = np.array([[255, 0, 0], [0, 128, 7], [1, 2, 250]], np.uint8)


def write_las(path: Path, colors: np.ndarray | None, intensity: Any = 0) -> Path:
    laspy = pytest.importorskip("laspy", reason="needs the extra points")
    header = laspy.LasHeader(point_format=1 if colors is None else 3, version="1.2")
    header.offsets, header.scales = PLACES.min(axis=0), [0.25, 0.25, 0.25]
    las = laspy.LasData(header)
    las.x, las.y, las.z = PLACES.T
    if colors is not None:
        las.red, las.green, las.blue = colors.T
    las.intensity = np.broadcast_to(np.asarray(intensity, np.uint16), 3)
    las.write(path)
    return path


def write_ply(path: Path, form: str, names: dict[str, str], columns: list[np.ndarray], ahead: str = "") -> Path:
    """A PLY file of columns. names: type by property. ahead: lines of header before the points."""
    count = len(columns[0])
    lines = ["ply", f"format {form} 1.0", *ahead.splitlines(), f"element vertex {count}"]
    lines += [f"property {kind} {name}" for name, kind in names.items()]
    data = "\n".join(" ".join(map(str, row)) for row in zip(*(column.tolist() for column in columns), strict=True))
    if form != "ascii":
        order = "<" if "little" in form else ">"
        types = {"double": "f8", "uchar": "u1", "float": "f4"}
        records = np.zeros(count, [(name, order + types[kind]) for name, kind in names.items()])
        for name, column in zip(names, columns, strict=True):
            records[name] = column
        path.write_bytes("\n".join([*lines, "end_header\n"]).encode() + records.tobytes())
    else:
        path.write_text("\n".join([*lines, "end_header", *(["1 2"] if ahead else []), data]) + "\n")
    return path


COLORED = {**dict.fromkeys("xyz", "double"), **dict.fromkeys(("red", "green", "blue"), "uchar")}


def pack_lzf(data: bytes) -> bytes:
    """LZF: a copy where the last 8 bytes come again, else literals."""
    packed, at = bytearray(), 0
    while at < len(data):
        length = 0
        while at >= 8 and length < 264 and at + length < len(data) and data[at + length] == data[at + length - 8]:
            length += 1
        if length >= 3:
            packed += bytes([(length - 2) << 5, 7] if length < 9 else [224, length - 9, 7])
            at += length
        else:
            packed += bytes([0, data[at]])
            at += 1
    return bytes(packed)


def write_pcd(path: Path, kind: str) -> np.ndarray:
    """A PCD file of 40 points in the second colour, of which number 3 has no place; returns the places."""
    count = 40
    places = np.repeat(PLACES[:2] - PLACES[0], 20, axis=0).astype("<f4")
    places[3, 1] = np.nan
    packed = (BYTES[1].astype(np.uint32) * [65536, 256, 1]).sum().astype(np.uint32)
    rgb = np.full(count, packed, np.uint32).view(np.float32)
    fields = [*places.T, np.zeros(count, "<u2"), rgb]
    header = "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z ring rgb\nSIZE 4 4 4 2 4\nTYPE F F F U F\nCOUNT 1 1 1 1 1\n"
    header += f"WIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA {kind}\n"
    records = np.zeros(count, [(name, field.dtype) for name, field in zip("xyzqr", fields, strict=True)])
    for name, field in zip("xyzqr", fields, strict=True):
        records[name] = field
    data = records.tobytes()
    if kind == "ascii":
        rows = zip(*(field.tolist() for field in fields), strict=True)
        data = "".join(" ".join(f"{number:.9g}" for number in row) + "\n" for row in rows).encode()
    elif kind == "binary_compressed":
        plain = b"".join(field.tobytes() for field in fields)
        data = pack_lzf(plain)
        data = np.array([len(data), len(plain)], "<u4").tobytes() + data
    path.write_bytes(header.encode() + data)
    return places

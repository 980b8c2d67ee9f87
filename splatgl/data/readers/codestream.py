"""Sizes that JPEG and JPEG 2000 pictures state: checked before their decoders allocate what they say."""

from __future__ import annotations

import struct

MOST_TILES = 4096
"""Most tiles of a JPEG 2000 picture: its decoder allocates all of them at once."""

JP2 = b"\0\0\0\x0cjP  "
"""Begins a JPEG 2000 picture in a file's boxes; others begin with their codestream."""


def stream_size(data: bytes) -> tuple[tuple[int, ...], int]:
    """((rows, columns), tiles) of a JPEG, JPEG-LS or JPEG 2000 picture; ((), 0) without a header."""
    at = data.find(b"\xff\x4f\xff\x51") if data.startswith(JP2) else 0
    if data[at : at + 4] == b"\xff\x4f\xff\x51" and len(data) >= at + 42:
        x, y, x0, y0, w, h, left, top = struct.unpack_from(">8I", data, at + 8)
        tiles = -(-(x - left) // w) * -(-(y - top) // h) if w and h else 0
        return (y - y0, x - x0), tiles
    at = 2 if data.startswith(b"\xff\xd8") else len(data)
    while at + 9 <= len(data):
        marker, length = data[at + 1], int.from_bytes(data[at + 2 : at + 4], "big")
        if data[at] != 0xFF:
            break
        if marker == 0xFF:
            at += 1
            continue
        # frame headers: all of C0 to CF but Huffman tables, reserved and arithmetic conditioning; F7 of JPEG-LS
        if (0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC)) or marker == 0xF7:
            return struct.unpack_from(">HH", data, at + 5), 1
        at += 2 + max(length, 2)
    return (), 0

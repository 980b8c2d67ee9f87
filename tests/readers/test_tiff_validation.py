"""LZW-compressed strips of TIFF files: sound ones pass, damaged ones are refused before the decoder sees them."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import splatgl as sg
from splatgl.errors import InputError

imagecodecs = pytest.importorskip("imagecodecs", reason="the extra readers")
tifffile = pytest.importorskip("tifffile", reason="the extra readers")

from splatgl.readers.tiff_validation import check_lzw  # noqa: E402


def packed(codes: list[int]) -> bytes:
    """Codes of 9 bits each, up to the 253rd."""
    return np.packbits([code >> bit & 1 for code in codes for bit in range(8, -1, -1)]).tobytes()


@pytest.mark.parametrize("values", [1, 2, 7, 256])
@pytest.mark.parametrize("count", [0, 1, 99, 255, 4000, 200_000])
def test_sound_strips_pass(values: int, count: int) -> None:
    """Of imagecodecs, over several tables where there are that many."""
    data = np.random.default_rng(count).integers(0, values, count, np.uint8).tobytes()
    strip = imagecodecs.lzw_encode(data)
    check_lzw(strip)
    check_lzw(imagecodecs.bitorder_decode(strip), reversed_bits=True)


def test_sound_strips_of_libtiff_pass() -> None:
    picture = Image.fromarray(np.random.default_rng(0).integers(0, 256, (300, 400), np.uint8))
    file = io.BytesIO()
    picture.save(file, "TIFF", compression="tiff_lzw")
    file.seek(0)
    with tifffile.TiffFile(file) as tiff:
        page = tiff.pages[0]
        for start, length in zip(page.dataoffsets, page.databytecounts, strict=True):
            check_lzw(file.getvalue()[start : start + length])


@pytest.mark.parametrize(
    ("codes", "said"),
    [
        ([1, 2, 257], "begin with an empty table"),
        ([256, 258, 257], "in no table"),
        ([256, 1, 259, 257], "in no table"),
        ([256, 1, 2, 3, 261, 257], "in no table"),
        ([256, 1, 2, 256, 3, 260, 257], "in no table"),
        ([256] * 500, "a few codes"),
    ],
)
def test_damaged_strips_are_refused(codes: list[int], said: str) -> None:
    with pytest.raises(InputError, match=said):
        check_lzw(packed(codes))


def test_codes_up_to_the_next_one_are_sound() -> None:
    """A code may be the one that it introduces itself."""
    check_lzw(packed([256, 1, 258, 259, 260, 257]))


@pytest.mark.parametrize("tile", [None, (16, 16)])
def test_a_damaged_file_is_refused(tmp_path: Path, tile: tuple[int, int] | None) -> None:
    path = tmp_path / "a.tif"
    stack = np.random.default_rng(1).integers(0, 9, (4, 32, 32), np.uint8)
    tifffile.imwrite(path, stack, compression="lzw", photometric="minisblack", tile=tile)
    assert (sg.load(path).samples == stack).all()
    with tifffile.TiffFile(path) as tiff:
        start = tiff.pages[2].dataoffsets[0]
    data = bytearray(path.read_bytes())
    data[start : start + 12] = packed([256, 1, 400]).ljust(12, b"\xff")
    path.write_bytes(data)
    with pytest.raises(InputError, match="in no table"):
        sg.load(path)


def with_tag(data: bytes, code: int, kind: int, count: int, value: int) -> bytes:
    """A little-endian TIFF with another entry of a tag that it has."""
    start = int.from_bytes(data[4:8], "little")
    for place in range(start + 2, start + 2 + 12 * int.from_bytes(data[start : start + 2], "little"), 12):
        if int.from_bytes(data[place : place + 2], "little") == code:
            return data[: place + 2] + struct.pack("<HII", kind, count, value) + data[place + 12 :]
    raise AssertionError(code)


@pytest.mark.parametrize(
    ("tag", "said"),
    [
        # one strip of as many rows as a card's memory has
        ((257, 4, 1, 2**29), r"strips or tiles: expected \d+ a page, got 1"),
        ((256, 4, 1, 0), "size: expected at least one pixel|damaged"),
        ((296, 3, 2, 2 + (3 << 16)), ""),
        ((296, 2, 1, 1), ""),
    ],
    ids=["rows", "no columns", "several units", "a text as unit"],
)
@pytest.mark.parametrize("several", [False, True], ids=["file", "slices"])
def test_damaged_tags(tag: tuple[int, int, int, int], said: str, several: bool, tmp_path: Path) -> None:
    """Of a file and of slices: sizes are refused before there is memory for them, units are ignored."""
    for name in ("z0.tif", "z1.tif"):
        plane = np.arange(99, dtype=np.uint8).reshape(9, 11)
        tifffile.imwrite(tmp_path / name, plane, compression="zlib", rowsperstrip=9, resolution=(99, 99))
        (tmp_path / name).write_bytes(with_tag((tmp_path / name).read_bytes(), *tag))
    path = tmp_path if several else tmp_path / "z0.tif"
    if said:
        with pytest.raises(InputError, match=said):
            sg.load(path)
    else:
        assert sg.load(path).shape[1:] == (9, 11)

"""Zeiss's CZI files: subblocks of pixels, a directory of them, and XML.

Format: "ZISRAW (CZI) File Format", version 1.2.2. A plane of a scene is put together from its tiles; the tiles of
overviews, which are stored smaller than they are, are left out.
"""

from __future__ import annotations

import math
import re
import struct
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from splatgl.errors import expected, import_extra
from splatgl.readers.channels import Channel, parse_window
from splatgl.readers.chunked import OneFile
from splatgl.readers.common import decoder_errors, parse_number, parse_xml, require_bytes, require_plausible
from splatgl.readers.dicom_frames import check_picture
from splatgl.readers.microscopes import Found, MicroscopeImage, Planes, check_planes, even_spacing, functions_of
from splatgl.readers.tiff_validation import jpeg_xr_size

# behind a segment's name: bytes reserved and used
_SEGMENT = struct.Struct("<16sqq")
# of the file: places of the directory and of the XML, behind versions and identifiers
_HEADER = struct.Struct("<qq")
_HEADER_AT = _SEGMENT.size + 52
# an entry of the directory: schema, type of pixels, place, part, compression, pyramid, spare, dimensions; a dimension:
# letter, start, size, coordinate, stored size
_ENTRY, _DIMENSION = struct.Struct("<2siqiiB5si"), struct.Struct("<4siifi")
_SUBBLOCK = struct.Struct("<iiq")
# least bytes before the metadata of a subblock
_PREFIX = 256

# dtype and samples of a pixel by its type; blue comes first
_PIXELS = {0: ("u1", 1), 1: ("<u2", 1), 2: ("<f4", 1), 3: ("u1", 3), 4: ("<u2", 3), 8: ("<f4", 3), 9: ("u1", 4)}
_PIXELS |= {12: ("<i4", 1), 13: ("<f8", 1)}
_PLAIN, _JPEG, _JPEG_XR, _ZSTD, _ZSTD_PREFIXED = 0, 1, 4, 5, 6
# colour of a channel, with or without alpha before it
_COLOR = re.compile("#(?:[0-9a-fA-F]{2})?[0-9a-fA-F]{6}")


@dataclass(frozen=True)
class _Tile:
    """A subblock: its place in the file, type of pixels, compression, and start and size by the letter of an axis."""

    at: int
    pixels: int
    compression: int
    place: dict[str, tuple[int, int]]

    @property
    def corner(self) -> tuple[int, int]:
        """Row and column of the first pixel."""
        return self.place["Y"][0], self.place["X"][0]

    @property
    def size(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.place["Y"][1], self.place["X"][1]


def _find_images(path: Path) -> Found:
    """The scenes of a file, each with its tiles; without scenes the file is one."""
    with path.open("rb") as file:
        file.seek(_HEADER_AT)
        directory, metadata = _HEADER.unpack(file.read(_HEADER.size))
        tiles = _read_directory(file, directory, path.stat().st_size)
        root = _read_metadata(file, metadata, path.stat().st_size)
    scenes = defaultdict(list)
    for tile in tiles:
        scenes[tile.place.get("S", (0, 1))[0]].append(tile)
    names = [node.get("Name", "") for node in root.findall(".//Information/Image/Dimensions/S/Scenes/Scene")]
    named = ((number, names[number] if 0 <= number < len(names) else f"scene {number}") for number in sorted(scenes))
    return [_make_image(path, root, name, scenes[number]) for number, name in named], OneFile(path)


def _read_directory(file: Any, at: int, there: int) -> list[_Tile]:
    """The tiles in full size that the directory at a place lists."""
    _seek(file, at)
    count = struct.unpack("<i124x", file.read(128))[0]
    require_bytes(count * _ENTRY.size, there - at)
    tiles = []
    for _ in range(count):
        _, pixels, place, part, compression, _, _, dimensions = _ENTRY.unpack(file.read(_ENTRY.size))
        if part:
            raise expected("file", "one that holds all its parts", "one part of several", "save it as one file")
        sizes, shrunk = {}, False
        for _ in range(min(max(dimensions, 0), 32)):
            letter, start, size, _, stored = _DIMENSION.unpack(file.read(_DIMENSION.size))
            sizes[letter[:1].decode("ascii")] = (start, size)
            shrunk |= stored not in (0, size)
        if not shrunk:
            tiles.append(_Tile(place, pixels, compression, sizes))
    return tiles


def _seek(file: Any, at: int) -> str:
    """The name of the segment at a place, at whose data the file is left."""
    file.seek(at)
    return str(_SEGMENT.unpack(file.read(_SEGMENT.size))[0].rstrip(b"\0").decode("ascii"))


def _read_metadata(file: Any, at: int, there: int) -> Element:
    """The XML of the segment at a place; an empty element without one."""
    if at <= 0:
        return Element("ImageDocument")
    _seek(file, at)
    size = struct.unpack("<i252x", file.read(256))[0]
    require_bytes(size, there - file.tell(), "metadata")
    return parse_xml(file.read(size).strip(b"\0 \r\n"), "CZI's metadata") if size > 0 else Element("ImageDocument")


def _make_image(path: Path, root: Element, name: str, tiles: list[_Tile]) -> MicroscopeImage:
    """The image of a scene's tiles, with axes T, C, Z and any others but tiles of a mosaic."""
    first = tiles[0]
    if any(tile.pixels != first.pixels for tile in tiles) or first.pixels not in _PIXELS:
        kinds = sorted({tile.pixels for tile in tiles})
        raise expected("pixels", f"one type of {', '.join(map(str, _PIXELS))}", f"types {kinds}")
    code, samples = _PIXELS[first.pixels]
    # 1. the range along each axis
    letters = {letter for tile in tiles for letter in tile.place} - set("XYMS")
    lead = sorted(letters - set("TCZ")) + [letter for letter in "TCZ" if letter in letters]
    every = {letter: [tile.place.get(letter, (0, 1)) for tile in tiles] for letter in (*lead, "Y", "X")}
    low = {letter: min(start for start, _ in places) for letter, places in every.items()}
    size = {letter: max(start + n for start, n in places) - low[letter] for letter, places in every.items()}
    plane = [size["Y"], size["X"], *([samples] if samples > 1 else [])]
    counts, dtype = [size[letter] for letter in lead], np.dtype(code)
    check_planes(counts, plane, dtype, len(tiles))
    # 2. the tiles of each plane, the later ones above
    grouped = defaultdict(list)
    for tile in tiles:
        if any(tile.place.get(letter, (0, 1))[1] != 1 for letter in lead):
            raise expected("subblock", "one plane", tile.place, "save it with other settings")
        grouped[tuple(tile.place.get(letter, (0, 1))[0] - low[letter] for letter in lead)].append(tile)
    for group in grouped.values():
        group.sort(key=lambda tile: tile.place.get("M", (0, 1))[0])
    corner = (low["Y"], low["X"])
    planes = Planes(counts, plane, dtype, partial(_read_plane, path, grouped, corner, (plane, dtype)))
    # 3. the scale, and channels
    metres = [parse_number(root.findtext(f".//Scaling/Items/Distance[@Id='{axis}']/Value"), 0.0) for axis in "XYZ"]
    step = parse_number(root.findtext(".//Information/Image/Dimensions/T/Positions/Interval/Increment"), None)
    channels = _read_channels(root, size.get("C", 1), low.get("C", 0), dtype)
    axes = "".join([*lead, "YX", "S" * (samples > 1)])
    spacing = even_spacing(*(length * 1e6 for length in metres))
    missing, unit = math.prod(counts) - len(grouped), "um" if metres[0] else ""
    return MicroscopeImage(name, axes, planes.shape, lambda: planes, channels, spacing, unit, step, missing)


def _read_channels(root: Element, count: int, first: int, dtype: np.dtype) -> tuple[Channel, ...]:
    """Names, colours ("#AARRGGBB") and windows (shares of the largest number) of channels."""
    shown = root.findall(".//DisplaySetting/Channels/Channel")[first : first + count]
    named = root.findall(".//Information/Image/Dimensions/Channels/Channel")[first : first + count]
    most = float(np.iinfo(dtype).max) if dtype.kind == "u" else 0.0
    channels = []
    for number in range(count):
        nodes = [nodes[number] for nodes in (named, shown) if number < len(nodes)]
        name = next((node.get("Name") for node in nodes if node.get("Name")), None) or str(number)
        colors = [node.findtext("Color", "") for node in reversed(nodes)]
        color = next((f"#{text[-6:].lower()}" for text in colors if _COLOR.fullmatch(text)), None)
        low, high = ((nodes[-1].findtext(end) if nodes else None) for end in ("Low", "High"))
        window = parse_window(parse_number(low) * most, parse_number(high) * most) if most else None
        is_off = number < len(shown) and shown[number].findtext("IsSelected", "").lower() == "false"
        channels.append(Channel(name, color, window, active=not is_off))
    return tuple(channels)


def _read_plane(
    path: Path,
    groups: dict[tuple[int, ...], list[_Tile]],
    corner: tuple[int, int],
    form: tuple[Sequence[int], np.dtype],
    index: tuple[int, ...],
) -> np.ndarray | None:
    """The plane of an index from its tiles, or None without tiles. corner: row and column of the first pixel."""
    tiles = groups.get(index)
    if not tiles:
        return None
    plane = np.zeros(form[0], form[1])
    with path.open("rb") as file, decoder_errors("CZI"):
        for tile in tiles:
            row, column = (at - start for at, start in zip(tile.corner, corner, strict=True))
            rows, columns = tile.size
            plane[row : row + rows, column : column + columns] = _read_tile(file, tile, path.stat().st_size)
    return plane


def _read_tile(file: Any, tile: _Tile, there: int) -> np.ndarray:
    """The pixels of a tile [rows, columns] or [rows, columns, 3 or 4], red first."""
    name = _seek(file, tile.at)
    begin = file.tell()
    metadata, _, size = _SUBBLOCK.unpack(file.read(_SUBBLOCK.size))
    dimensions = _ENTRY.unpack(file.read(_ENTRY.size))[-1]
    if name != "ZISRAWSUBBLOCK" or min(metadata, size, dimensions) < 0:
        raise expected("subblock", "a segment ZISRAWSUBBLOCK", repr(name), "the file is damaged")
    prefix = _SUBBLOCK.size + _ENTRY.size + dimensions * _DIMENSION.size
    file.seek(begin + max(prefix, _PREFIX) + metadata)
    require_bytes(size, there - file.tell())
    code, samples = _PIXELS[tile.pixels]
    shape = (*tile.size, *([samples] if samples > 1 else []))
    pixels = _decode(file.read(size), tile.compression, np.dtype(code), shape)
    # the decoder of JPEG XR gives red first
    return pixels if samples == 1 or tile.compression == _JPEG_XR else pixels[..., [2, 1, 0, 3][:samples]]


def _decode(data: bytes, compression: int, dtype: np.dtype, shape: tuple[int, ...]) -> np.ndarray:
    """Pixels [shape] of a tile's data; decoders are told the size, and write no more."""
    needed = int(np.prod(shape, dtype=np.int64)) * dtype.itemsize
    if compression == _PLAIN:
        require_bytes(needed, len(data))
        return np.frombuffer(data[:needed], dtype).reshape(shape)
    require_plausible(needed, len(data), bounded=False)
    codecs = import_extra("imagecodecs", "compressed CZI files", "imagecodecs", "readers")
    if compression == _JPEG:
        return np.asarray(codecs.jpeg8_decode(data, out=np.zeros(shape, dtype)))
    if compression == _JPEG_XR:
        check_picture(jpeg_xr_size(data), shape[0], shape[1], exact=True)
        return np.asarray(codecs.jpegxr_decode(data, out=np.zeros(shape, dtype)))
    if compression not in (_ZSTD, _ZSTD_PREFIXED):
        fix = "save it with another compression in ZEN"
        raise expected("compression", "none, JPEG, JPEG XR or Zstandard", f"number {compression}", fix)
    # a prefix of 1 byte, or of 3 of which the last tells whether low bytes precede all high bytes
    prefix = data[0] if compression == _ZSTD_PREFIXED else 0
    split = prefix == 3 and bool(data[2] & 1)
    decoded = codecs.zstd_decode(data[prefix:], out=needed)
    require_bytes(needed, len(decoded), "inflated data")
    plain = np.frombuffer(decoded, np.uint8)
    if split and dtype.itemsize == 2:
        plain = np.ascontiguousarray(plain.reshape(2, -1).T).ravel()
    return plain.view(dtype).reshape(shape)


list_images, read = functions_of("CZI", _find_images)

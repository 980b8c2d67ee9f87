"""Decodes frames with pydicom, after checks of their stated sizes."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from itertools import islice
from typing import Any

import numpy as np

from splatgl.data.color import LUMA
from splatgl.errors import expected, missing_extra
from splatgl.readers.common import DEFLATE_RATIO, MAX_BYTES, require_bytes
from splatgl.readers.dicom_frames import Frame
from splatgl.readers.dicom_headers import Bounded, Header, dicom_errors, read_dataset

# most tiles of a JPEG 2000 picture: its decoder allocates all at once
MOST_TILES = 4096
# start of a JPEG 2000 picture in boxes; others start with their codestream
JP2 = b"\0\0\0\x0cjP  "


def picture_size(data: bytes) -> tuple[tuple[int, ...], int]:
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


# most bytes of a frame, 64 MiB, whatever its compressed size: decoders hold several times as many
FREE_FRAME = MAX_BYTES // 8
COLORS = ("RGB", "YBR_FULL", "YBR_FULL_422", "YBR_ICT", "YBR_RCT", "YBR_PARTIAL_422", "YBR_PARTIAL_420")
PALETTE = "PALETTE COLOR"
GREYS = ("MONOCHROME1", "MONOCHROME2")

RLE = "1.2.840.10008.1.2.5"


def is_color(header: Header) -> bool:
    """Whether the frames are in colour."""
    return header.photometric in (*COLORS, PALETTE)


def check_header(header: Header) -> None:
    """Raises InputError for unsupported pixels, and for sizes that the file cannot hold."""
    uid = find_decoder(header.syntax)
    rows, columns = header.size
    kinds = {1: (*GREYS, PALETTE), 3: (*COLORS, PALETTE)}
    if header.photometric not in kinds.get(header.samples, ()):
        # a damaged file may hold any text
        known = header.photometric in (*COLORS, *GREYS, PALETTE, "ARGB", "CMYK", "HSV")
        got = f"{header.samples} × {header.photometric if known else 'unknown'}"
        raise expected("pixels", "grey, RGB, YBR or palette pixels", got, "convert the file")
    if header.allocated not in (8, 16, 32, 64) or (is_color(header) and header.allocated > 16):
        raise expected("pixels", "8 to 32 bits each, colours 8 or 16", f"{header.allocated} bits", "convert the file")
    if not 0 <= header.stored[0] <= header.allocated:
        raise expected("bits stored", f"at most {header.allocated}", header.stored[0], "the header is damaged")
    there, needed = header.room, frame_bytes(header)
    if not uid.is_encapsulated:
        require_bytes(needed * header.frames, there, "pixels")
        return
    # a fragment takes 8 bytes at least
    if header.frames > there // 8 or needed > max(there * DEFLATE_RATIO, FREE_FRAME):
        got = f"{there} compressed bytes for {header.frames} × {columns} × {rows}"
        raise expected("pixels", "sizes that they can hold", got, "the file is cut short or its header is damaged")


def frame_bytes(header: Header) -> int:
    """Bytes of an uncompressed frame."""
    rows, columns = header.size
    pixels = rows * columns * header.samples * header.allocated // 8
    return pixels * 2 // 3 if header.photometric == "YBR_FULL_422" and find_decoder(header.syntax).is_native else pixels


def find_decoder(syntax: str) -> Any:
    """pydicom's decoder. Raises InputError if there is none, or if its library is not installed."""
    from pydicom.pixels.decoders.base import get_decoder

    with dicom_errors():
        try:
            decoder = get_decoder(syntax)
        except NotImplementedError:
            from pydicom.uid import UID

            name = UID(syntax).name if UID(syntax).is_transfer_syntax else "an unknown one"
            fix = "save the file uncompressed, for example with dcmdjpeg or gdcmconv --raw"
            raise expected("transfer syntax", "uncompressed, RLE, JPEG, JPEG-LS or JPEG 2000", name, fix) from None
        if not decoder.is_available:
            wavelets = "2000" in decoder.UID.name
            library, extra = ("pylibjpeg-openjpeg", "dicom") if wavelets else ("pylibjpeg-libjpeg", "dicom-jpeg")
            raise missing_extra(f"DICOM files in {UID_NAMES.get(syntax, decoder.UID.name)}", library, extra)
        return decoder


# short names of transfer syntaxes with long names
UID_NAMES = {"1.2.840.10008.1.2.4.50": "JPEG Baseline", "1.2.840.10008.1.2.4.70": "JPEG Lossless"}


def decode_frames(header: Header, frames: Sequence[Frame]) -> Iterator[tuple[Frame, np.ndarray, np.ndarray | None]]:
    """(frame, stored values [H, W], colours uint8 [H, W, 3] or None) of frames of one file, by their numbers."""
    decoder = find_decoder(header.syntax)
    with header.source.open() as file:
        tags = read_dataset(file)
        wanted = {frame.number: frame for frame in frames}
        is_mosaic = header.mosaic.tiles > 1
        for number, data in _read_stored(file, header, [0] if is_mosaic else sorted(wanted)):
            with dicom_errors():
                array = _decode(decoder, header, data, tags)
                color = _to_rgb(array, header, tags) if is_color(header) else None
            if array.shape[:2] != header.size:
                raise expected("pixels", f"{header.size}", array.shape[:2], "the file is damaged")
            if color is not None:
                array = np.rint(color @ LUMA).astype(np.uint8)
            for place in sorted(wanted) if is_mosaic else [number]:
                part = header.mosaic.tile(place) if is_mosaic else ()
                yield wanted[place], array[part], None if color is None else color[part]


def _read_stored(file: Bounded, header: Header, wanted: Sequence[int]) -> Iterator[tuple[int, bytes]]:
    """(number, stored bytes) of the frames."""
    decoder = find_decoder(header.syntax)
    file.seek(header.offset)
    if not decoder.is_encapsulated:
        size = frame_bytes(header)
        for number in wanted:
            # bytes of words begin at an even one
            odd = number * size % 2 * header.swapped
            file.seek(header.offset + number * size - odd)
            data = file.read(size + odd + (size + odd) % 2 * header.swapped)
            require_bytes(size + odd, len(data), "pixels")
            if header.swapped:
                data = np.frombuffer(data[: len(data) // 2 * 2], np.uint16).byteswap().tobytes()[odd : odd + size]
            yield number, data
        return
    from pydicom.encaps import generate_frames

    with dicom_errors():
        stored = generate_frames(file, number_of_frames=header.frames)
        last = -1
        for number in wanted:
            data = next(islice(stored, number - last - 1, None), b"")
            last = number
            if not data:
                raise expected("pixels", f"{header.frames} frames", number, "the file is cut short")
            yield number, data


def _decode(decoder: Any, header: Header, data: bytes, tags: Any) -> np.ndarray:
    """A frame's values; the sizes that a compressed frame's header states are checked first."""
    from pydicom.encaps import encapsulate
    from pydicom.pixels.utils import as_pixel_options

    if decoder.is_encapsulated:
        if header.syntax != RLE:
            check_picture(picture_size(data), *header.size, exact=True)
        data = encapsulate([data], has_bot=False)
    wide = "OB" if header.allocated <= 8 else "OW"
    shift = 0 if decoder.is_encapsulated or header.stored[0] + header.shift > header.allocated else header.shift
    plain = {"bits_stored": header.stored[0] + shift} if header.stored[0] else {}
    options: Any = as_pixel_options(tags, number_of_frames=1, pixel_keyword=header.pixels, pixel_vr=wide, **plain)
    options.pop("extended_offsets", None)
    array = np.asarray(decoder.as_array(data, index=0, validate=True, raw=False, **options)[0])
    return array >> shift if shift else array


def check_picture(stated: tuple[tuple[int, ...], int], rows: int, columns: int, exact: bool = False) -> None:
    """Raises InputError for a picture that is larger (or not `exact`ly as large) or of many tiles, as `picture_size`
    states.
    """
    size, tiles = stated
    fits = bool(size) and (size == (rows, columns) if exact else size[0] <= rows and size[1] <= columns)
    if not fits or not 1 <= tiles <= MOST_TILES:
        this = f"{columns} × {rows} pixels" + ("" if exact else " at most")
        got = f"{size[1]} × {size[0]} in {tiles} tiles" if size else "none"
        raise expected("compressed picture", this, got, "the file is damaged")


def _to_rgb(array: np.ndarray, header: Header, tags: Any) -> np.ndarray:
    """RGB, uint8 [H, W, 3]."""
    if header.photometric == PALETTE:
        from pydicom.pixels.processing import apply_color_lut

        array = apply_color_lut(array, tags)[..., :3]
    if array.dtype.itemsize > 1:
        bits = array.dtype.itemsize * 8 if header.photometric == PALETTE else header.stored[0] or header.allocated
        array = array >> max(bits - 8, 0)
    return np.clip(array, 0, 255).astype(np.uint8)

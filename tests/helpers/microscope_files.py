"""Small files of microscopes, written byte by byte after descriptions of their formats: CZI, LIF, ND2, OIB.

Samples are [T, C, Z, Y, X]; the spacing is SPACING in micrometres, and time points are STEP seconds apart.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

SPACING = (0.25, 0.5, 1.5)
STEP = 4.0
NAMES, COLORS = ("DAPI", "GFP"), ("#0000ff", "#00ff00")
STACK = np.random.default_rng(4).integers(0, 4000, (2, 2, 3, 5, 7)).astype(np.uint16)


# --- Zeiss: ZISRAW (CZI) file format 1.2.2 ----------------------------------------------------------------------------


def czi(path: Path, scenes: Sequence[np.ndarray] = (STACK,), compression: int = 0, pyramid: bool = False) -> Path:
    """A CZI file; each plane is two tiles side by side. compression: 0, or 4 for JPEG XR, 5 and 6 for Zstandard.
    pyramid: adds an overview of half the size to each plane.
    """
    entries, body, at = list[bytes](), list[bytes](), 544
    for scene, samples in enumerate(scenes):
        for t, c, z in np.ndindex(*samples.shape[:3]):
            plane = samples[t, c, z]
            half, left = plane.shape[1] // 2, 100 * scene - 50
            tiles = [(plane[:, :half], left, 0), (plane[:, half:], left + half, 1)]
            tiles += [(plane[::2, ::2], left, 2)] if pyramid else []
            for tile, x, m in tiles:
                factor = 2 if m == 2 else 1
                size = tile.shape if m != 2 else plane.shape[:2]
                places = [("X", x, size[1], tile.shape[1]), ("Y", 7, size[0], tile.shape[0])]
                places += [(letter, n, 1, 1) for letter, n in (("Z", z), ("C", c), ("T", t), ("S", scene))]
                places += [("M", m, 1, 1)] if m != 2 else []
                dimensions = b"".join(
                    struct.pack("<4siifi", name.encode(), start, length, float(start), stored)
                    for name, start, length, stored in places
                )
                kind = {"u1": 0, "u2": 1, "f4": 2}[tile.dtype.str[1:]] if tile.ndim == 2 else (3, 9)[tile.shape[2] - 3]
                entry = struct.pack("<2siqiiB5si", b"DV", kind, at, 0, compression, factor - 1, b"", len(places))
                entries.append(entry + dimensions)
                data = _czi_pixels(tile, compression)
                head = struct.pack("<iiq", 0, 0, len(data)) + entries[-1]
                body.append(_segment(b"ZISRAWSUBBLOCK", head.ljust(256, b"\0") + data))
                at += len(body[-1])
    directory = _segment(b"ZISRAWDIRECTORY", struct.pack("<i124x", len(entries)) + b"".join(entries))
    xml = _czi_metadata(len(scenes)).encode()
    metadata = _segment(b"ZISRAWMETADATA", struct.pack("<ii248x", len(xml), 0) + xml)
    guid = bytes(range(16))
    header = struct.pack("<iiii16s16siqqiq", 1, 0, 0, 0, guid, guid, 0, at, at + len(directory), 0, 0)
    path.write_bytes(_segment(b"ZISRAWFILE", header.ljust(512, b"\0")) + b"".join(body) + directory + metadata)
    return path


def _segment(name: bytes, data: bytes) -> bytes:
    data = data.ljust(-(-len(data) // 32) * 32, b"\0")
    return struct.pack("<16sqq", name, len(data), len(data)) + data


def _czi_pixels(tile: np.ndarray, compression: int) -> bytes:
    if compression == 0:
        return (tile[..., [2, 1, 0, 3][: tile.shape[2]]] if tile.ndim == 3 else tile).tobytes()
    import imagecodecs

    if compression == 4:
        return bytes(imagecodecs.jpegxr_encode(np.ascontiguousarray(tile), level=1.0))
    data = np.frombuffer(tile.tobytes(), np.uint8)
    if compression == 6 and tile.itemsize == 2:
        # low bytes before high bytes, which the prefix tells
        return b"\3\1\1" + bytes(imagecodecs.zstd_encode(data.reshape(-1, 2).T.tobytes()))
    return b"\1" * (compression == 6) + bytes(imagecodecs.zstd_encode(data.tobytes()))


def _czi_metadata(scenes: int) -> str:
    channels = "".join(f'<Channel Id="Channel:{n}" Name="{name}"/>' for n, name in enumerate(NAMES))
    shown = "".join(
        f'<Channel Name="{name}"><Color>#FF{color[1:].upper()}</Color><Low>0.01</Low><High>0.05</High></Channel>'
        for name, color in zip(NAMES, COLORS, strict=True)
    )
    named = "".join(f'<Scene Index="{n}" Name="well {n}"/>' for n in range(scenes))
    steps = "".join(
        f'<Distance Id="{axis}"><Value>{step * 1e-6}</Value></Distance>'
        for axis, step in zip("XYZ", SPACING, strict=True)
    )
    return (
        f"<ImageDocument><Metadata><Information><Image><Dimensions><Channels>{channels}</Channels><S><Scenes>{named}"
        f"</Scenes></S><T><Positions><Interval><Increment>{STEP}</Increment></Interval></Positions></T></Dimensions>"
        f"</Image></Information><Scaling><Items>{steps}</Items></Scaling><DisplaySetting><Channels>{shown}</Channels>"
        "</DisplaySetting></Metadata></ImageDocument>"
    )


# --- Leica: LIF, as liffile describes it ------------------------------------------------------------------------------


def lif(path: Path, stacks: Mapping[str, np.ndarray]) -> Path:
    """A LIF file of images by name."""
    images, blocks = "", b""
    for number, (name, samples) in enumerate(stacks.items()):
        t, c, z, y, x = samples.shape
        size = samples.itemsize
        lengths = [count - 1 for count in (x, y, z, t)]
        steps = [step * 1e-6 for step in SPACING] + [STEP]
        strides = [size, x * size, c * y * x * size, z * c * y * x * size]
        dimensions = "".join(
            f'<DimensionDescription DimID="{n + 1}" NumberOfElements="{count + 1}" Origin="0" Length="{count * step}" '
            f'Unit="{"s" if n == 3 else "m"}" BytesInc="{stride}" BitInc="0"/>'
            for n, (count, step, stride) in enumerate(zip(lengths, steps, strides, strict=True))
        )
        channels = "".join(
            f'<ChannelDescription DataType="0" ChannelTag="0" Resolution="{8 * size}" NameOfMeasuredQuantity="" '
            f'Min="0" Max="255" Unit="" LUTName="{table}" IsLUTInverted="0" BytesInc="{n * y * x * size}" BitInc="0">'
            f"<ChannelProperty><Key>DyeName</Key><Value>{dye}</Value></ChannelProperty></ChannelDescription>"
            for n, (dye, table) in enumerate(zip(NAMES, ("Blue", "Green"), strict=True))
        )
        images += (
            f'<Element Name="{name}" UniqueID="{number}"><Data><Image><ImageDescription><Channels>{channels}</Channels>'
            f"<Dimensions>{dimensions}</Dimensions></ImageDescription></Image></Data>"
            f'<Memory Size="{samples.nbytes}" MemoryBlockID="MemBlock_{number}"/></Element>'
        )
        name_bytes = f"MemBlock_{number}".encode("utf-16-le")
        head = struct.pack("<IIBQBI", 0x70, 14 + len(name_bytes), 0x2A, samples.nbytes, 0x2A, len(name_bytes) // 2)
        # planes of channels lie beside each other within z
        blocks += head + name_bytes + np.ascontiguousarray(samples.transpose(0, 2, 1, 3, 4)).tobytes()
    xml = (
        '<LMSDataContainerHeader Version="2"><Element Name="experiment" UniqueID="e"><Data><Experiment/></Data>'
        f"<Children>{images}</Children></Element></LMSDataContainerHeader>"
    ).encode("utf-16-le")
    path.write_bytes(struct.pack("<IIBI", 0x70, len(xml) + 5, 0x2A, len(xml) // 2) + xml + blocks)
    return path


# --- Nikon: ND2 version 3, as nd2 describes it ------------------------------------------------------------------------

_MAGIC = 0x0ABECEDA


def nd2(path: Path, positions: Sequence[np.ndarray] = (STACK,), lossless: bool = False) -> Path:
    """An ND2 file of positions; a frame has all channels of a plane, and loops are time, positions, z."""
    import zlib

    t, c, z, y, x = positions[0].shape
    planes = {
        f"a{n}": {
            "uiCompCount": 1,
            "uiSampleIndex": n,
            "sDescription": name,
            "pFluorescentProbe": {"m_ExcitationSpectrum": {"uiCount": 0}, "m_EmissionSpectrum": {"uiCount": 0}},
            # blue, green, red from the highest byte
            "uiColor": int(color[5:7] + color[3:5] + color[1:3], 16),
        }
        for n, (name, color) in enumerate(zip(NAMES[:c], COLORS, strict=False))
    }
    size = positions[0].itemsize
    attributes = {"uiWidth": x, "uiWidthBytes": x * c * size, "uiHeight": y, "uiComp": c, "uiBpcInMemory": 8 * size}
    attributes |= {"uiBpcSignificant": 8 * size, "uiSequenceCount": t * z * len(positions)}
    attributes |= {"eCompression": 0 if lossless else 2}
    picture = {"bCalibrated": True, "dCalibration": SPACING[0], "sPicturePlanes": {"uiCount": c, "sPlaneNew": planes}}
    points = [{"dPosX": float(n), "dPosY": 0.0, "dPosName": f"well {n}"} for n in range(len(positions))]
    depth = {"eType": 4, "uLoopPars": {"uiCount": z, "dZStep": SPACING[2]}}
    wells = {"eType": 2, "uLoopPars": {"Points": points}, "ppNextLevelEx": [depth]}
    pars = {"uiCount": t, "dStart": 0.0, "dPeriod": STEP * 1000, "dDuration": 0.0}
    loops = {"eType": 1, "uLoopPars": pars, "ppNextLevelEx": [wells]}
    chunks = {
        b"ImageAttributesLV!": _lite("SLxImageAttributes", attributes),
        b"ImageMetadataSeqLV|0!": _lite("SLxPictureMetadata", picture),
        b"ImageMetadataLV!": _lite("SLxExperiment", loops),
    }
    frames = ((at, samples, depth) for at in range(t) for samples in positions for depth in range(z))
    for number, (at, samples, depth_index) in enumerate(frames):
        data = np.ascontiguousarray(samples[at, :, depth_index].transpose(1, 2, 0)).tobytes()
        chunks[f"ImageDataSeq|{number}!".encode()] = bytes(8) + (zlib.compress(data) if lossless else data)
    signature = struct.pack("<IIQ32s64s", _MAGIC, 32, 64, b"ND2 FILE SIGNATURE CHUNK NAME01!", b"Ver3.0")
    file, places = io.BytesIO(), b""
    file.write(signature.ljust(4096, b"\0"))
    for name, data in chunks.items():
        places += name + struct.pack("<QQ", file.tell(), len(data))
        # 8 bytes behind its name, pixels begin 4096 bytes behind the chunk
        reserved = 4072 if name.startswith(b"ImageDataSeq") else 48
        file.write(struct.pack("<IIQ", _MAGIC, reserved, len(data)) + name.ljust(reserved, b"\0") + data)
    end = struct.pack("<32sQ", b"ND2 CHUNK MAP SIGNATURE 0000001!", file.tell())
    name = b"ND2 FILEMAP SIGNATURE NAME 0001!"
    file.write(struct.pack("<IIQ", _MAGIC, 32, len(places) + len(end)) + name + places + end)
    path.write_bytes(file.getvalue())
    return path


def _lite(name: str, value: Any) -> bytes:
    """A value with its name, in Nikon's "lite variant"; entries of lists have no names."""
    letters = name + "\0"
    head = bytes([len(letters)]) + letters.encode("utf-16-le")
    if isinstance(value, bool):
        return b"\1" + head + bytes([value])
    if isinstance(value, int):
        return b"\3" + head + struct.pack("<I", value)
    if isinstance(value, float):
        return b"\6" + head + struct.pack("<d", value)
    if isinstance(value, str):
        return b"\x08" + head + (value + "\0").encode("utf-16-le")
    items = value.items() if isinstance(value, Mapping) else (("", item) for item in value)
    parts = [_lite(key, item) for key, item in items]
    inside = b"".join(parts)
    length = 1 + len(head) + 12 + len(inside)
    return b"\x0b" + head + struct.pack("<IQ", len(parts), length) + inside + bytes(8 * len(parts))


# --- Olympus: OIB, a compound file (MS-CFB) of TIFF files and settings ------------------------------------------------


def oib(path: Path, samples: np.ndarray = STACK) -> Path:
    """An OIB file, or an OIF file with its folder, by the ending of `path`."""
    import tifffile

    t, c, z, y, x = samples.shape
    axes = [("X", x, "um", SPACING[0] * x), ("Y", y, "um", SPACING[1] * y), ("C", c, "", 0.0)]
    axes += [("Z", z, "nm", SPACING[2] * 1000 * (z - 1)), ("T", t, "ms", STEP * 1000 * (t - 1))]
    text = '[ProfileSaveInfo]\r\nName="a.oif"\r\nVersion="1.0"\r\n[Axis Parameter Common]\r\nAxisOrder="XYCZT"\r\n'
    for number in range(8):
        letter, count, unit, end = axes[number] if number < len(axes) else ("", 0, "", 0.0)
        text += f'[Axis {number} Parameters Common]\r\nAxisCode="{letter}"\r\nMaxSize={count}\r\nUnitName="{unit}"\r\n'
        text += f"StartPosition=0\r\nEndPosition={end}\r\n"
    text += f'[Reference Image Parameter]\r\nValidBitCounts=12\r\nWidthConvertValue={SPACING[0]}\r\nWidthUnit="um"\r\n'
    text += f'HeightConvertValue={SPACING[1]}\r\nHeightUnit="um"\r\n'
    for number, name in enumerate(NAMES):
        text += f'[GUI Channel {number + 1} Parameters]\r\nDyeName="{name}"\r\n'
    settings = b"\xff\xfe" + text.encode("utf-16-le")
    planes = {}
    for at, channel, depth in product(range(t), range(c), range(z)):
        file = io.BytesIO()
        tifffile.imwrite(file, samples[at, channel, depth], metadata=None)
        planes[f"s_C{channel + 1:03}Z{depth + 1:03}T{at + 1:03}.tif"] = file.getvalue()
    if path.suffix == ".oif":
        folder = path.with_name(path.name + ".files")
        folder.mkdir(parents=True)
        path.write_bytes(settings)
        for name, data in planes.items():
            (folder / name).write_bytes(data)
        return path
    info = '[OibSaveInfo]\r\nName="a"\r\nVersion="2.0.0.0"\r\nCompression="0"\r\nMainFileName="Stream00000"\r\n'
    info += 'Stream00000="a.oif"\r\nStorage00001="a.oif.files"\r\n'
    info += "".join(f'Stream{n:05}="Storage00001/{name}"\r\n' for n, name in enumerate(planes, 1))
    inner = {f"Stream{n:05}": data for n, data in enumerate(planes.values(), 1)}
    outer = {"OibInfo.txt": b"\xff\xfe" + info.encode("utf-16-le"), "Stream00000": settings}
    path.write_bytes(compound(outer, "Storage00001", inner))
    return path


_FREE, _END, _TABLE, _NONE = 0xFFFFFFFF, 0xFFFFFFFE, 0xFFFFFFFD, 0xFFFFFFFF
_CUTOFF = 4096


def compound(outer: Mapping[str, bytes], storage: str, inner: Mapping[str, bytes]) -> bytes:
    """A compound file of streams, some in a storage (MS-CFB §2); short ones lie in small sectors."""
    sectors, table = list[bytes](), list[int]()

    def store(data: bytes) -> int:
        """Appends data as a chain of sectors; returns the first."""
        if not data:
            return _END
        first, count = len(sectors), -(-len(data) // 512)
        sectors.extend(data[512 * n :][:512].ljust(512, b"\0") for n in range(count))
        table.extend([*range(first + 1, first + count), _END])
        return first

    small, small_table, entries = b"", list[int](), list[bytes]()
    # 1. streams, in the order of the directory: each is the right sibling of the one before
    names = [*outer, storage, *inner]
    for number, name in enumerate(names):
        data = outer.get(name) or inner.get(name) or b""
        last = number in (len(outer), len(names) - 1)
        right, child = (_NONE if last else number + 2), (_NONE if name != storage else len(outer) + 2)
        if name == storage:
            start = 0
        elif len(data) < _CUTOFF:
            start, count = len(small_table), -(-len(data) // 64)
            small_table += [*range(start + 1, start + count), _END]
            small += data.ljust(64 * count, b"\0")
        else:
            start = store(data)
        entries.append(_entry(name, 1 if name == storage else 2, right, child, start, len(data)))
    # 2. small sectors, their table, and the directory
    root = _entry("Root Entry", 5, _NONE, 1, store(small), len(small))
    numbers = np.array(small_table, "<u4").tobytes()
    small_at, small_count = store(numbers.ljust(-(-len(numbers) // 512) * 512, b"\xff")), -(-len(numbers) // 512)
    directory = b"".join([root, *entries])
    directory_at = store(directory.ljust(-(-len(directory) // 512) * 512, b"\0"))
    # 3. the table of all sectors, its own included
    count = 1
    while 128 * count < len(table) + count:
        count += 1
    places = list(range(len(sectors), len(sectors) + count))
    whole = np.full(128 * count, _FREE, "<u4")
    whole[: len(table)] = table
    whole[places] = _TABLE
    head = struct.pack("<8s16sHHHHHHI", bytes.fromhex("d0cf11e0a1b11ae1"), b"", 0x3E, 3, 0xFFFE, 9, 6, 0, 0)
    head += struct.pack("<IIIIIIIII", 0, count, directory_at, 0, _CUTOFF, small_at, small_count, _END, 0)
    head += np.array([*places, *[_FREE] * (109 - count)], "<u4").tobytes()
    return head + b"".join(sectors) + whole.tobytes()


def _entry(name: str, kind: int, right: int, child: int, start: int, size: int) -> bytes:
    letters = (name + "\0").encode("utf-16-le")
    return struct.pack(
        "<64sHBBIII16sIQQIQ", letters, len(letters), kind, 1, _NONE, right, child, b"", 0, 0, 0, start, size
    )

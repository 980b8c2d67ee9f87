"""Point clouds: LAS and LAZ (laspy), PCD and PLY without faces, as points with their own colours and sizes.

Without colours of its own a cloud shows its intensity in grey, else its height in a colour map.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from splatgl.data.color import linear_from_srgb
from splatgl.data.points import Points, median_spacing, size_classes
from splatgl.data.volume import MOST_LENGTH, Volume, empty_volume
from splatgl.errors import expected, import_extra
from splatgl.fileio import require_memory
from splatgl.readers.common import decoder_errors, read_text, require_bytes, require_plausible
from splatgl.readers.elsewhere import call
from splatgl.readers.options import LoadOptions
from splatgl.readers.polygons import HEADER, read_ply

# bytes of the header of a record of variable length in LAS
VLR = 54
# most points of a chunk of LAS
CHUNK = 2**20
# bytes in memory of a point: places, colours, a value
POINT_BYTES = 48
# share of the values at either end that a colour map leaves out
OUTSIDE = 0.01
SUFFIXES = (".las", ".laz", ".pcd")
# default size of points in spacings: of points at random, gaps as wide as a spacing are frequent
WIDER = 2.5
# opacity of a surface of points that are as far apart as they are large
SOLID = 0.99
# the largest value of LAS that may be 8 bits stored in 16
BYTE = 255
# zeroth spherical harmonic, by which 3-D Gaussian splats scale their colours
HARMONIC = 0.28209479177387814

Values = Mapping[str, np.ndarray]
_COLORS = (("red", "green", "blue"), ("r", "g", "b"), ("diffuse_red", "diffuse_green", "diffuse_blue"))


def is_points(source: str | Path) -> bool:
    """Whether a source is a cloud of points: by its suffix, a PLY file by its header, which has no faces."""
    path = Path(source)
    if path.suffix.lower() != ".ply" or not path.is_file():
        return path.suffix.lower() in SUFFIXES
    try:
        with path.open("rb") as file:
            text = file.read(HEADER).partition(b"end_header")[0].decode("ascii", "replace")
    except OSError:
        return False
    return not _has_faces(text)


def _has_faces(header: str) -> bool:
    """Whether a header of PLY has faces, or no points."""
    counts = dict(re.findall(r"(?m)^element[ \t]+(\w+)[ \t]+(\d{1,18})\b", header))
    return not int(counts.get("vertex", 0)) or any(int(counts.get(name, 0)) for name in ("face", "tristrips"))


def read(path: Path, options: LoadOptions) -> Volume:
    """The points of a .las, .laz, .pcd or .ply file, in an empty volume that has their bounding box; classes of sizes
    are channels. Points with a coordinate that is not finite, and those that LAS marks as withheld, are left out.

    `array`: values to show in a colour map instead of the colours: "height", "intensity" or another field.
    `point_size`: the diameter of all points, by default the file's, else their spacing.
    """
    with path.open("rb") as file:
        start = file.read(3)
    if start == b"LAS":
        # the decoder of LAZ ends its process on damaged data
        places, values, unit = call("points.read_las", path.stat().st_size, path)
    else:
        with decoder_errors("points"):
            places, values, unit = (_read_ply if start == b"ply" else _read_pcd)(path)
    return _make_volume(places, values, unit, options)


def _make_volume(places: np.ndarray, values: Values, unit: str, options: LoadOptions) -> Volume:
    """The volume of points at places [N, 3] in the colours and sizes of their values."""
    finite = np.isfinite(places).all(axis=1)
    notes: tuple[str, ...] = ()
    if not finite.all():
        left = f"{len(places) - int(finite.sum()):,} of {len(places):,} points"
        notes = (f"{left} have no position or are withheld, and are skipped",)
        values, places = {name: value[finite] for name, value in values.items()}, places[finite]
    if not len(places):
        raise expected("points", "at least one with finite coordinates", "none")
    if np.abs(places).max() > MOST_LENGTH:
        raise expected("points", f"coordinates up to {MOST_LENGTH:g}", f"{np.abs(places).max():g}")
    colors, color_notes = _find_colors({"height": places[:, 2], **values}, options.array)
    classes, size_note = _find_sizes(places, values, options.point_size, unit)
    low, high = places.min(axis=0), places.max(axis=0)
    box = empty_volume(low, high, SOLID, unit=unit, notes=(*notes, *color_notes, size_note))
    parts = [replace(box, points=Points(places[which], colors[which], size), notes=()) for size, which in classes]
    named = [replace(part, name=f"size {size:.4g}") for part, (size, _) in zip(parts, classes, strict=True)]
    return replace(box, points=parts[0].points, channels=tuple(named) if len(named) > 1 else ())


def _find_sizes(
    places: np.ndarray, values: Values, size: float | None, unit: str
) -> tuple[list[tuple[float, np.ndarray]], str]:
    """Sizes, the numbers of the points of each, and a note on them."""
    count, every = f"{len(places):,} points", np.arange(len(places))
    if size is not None:
        return [(size, every)], f"{count} of {size:.4g} {unit}".rstrip()
    radius = values.get("radius")
    sizes = values.get("size", values.get("diameter")) if radius is None else 2.0 * radius
    if sizes is not None and (sizes > 0).all() and np.isfinite(sizes).all():
        classes = size_classes(sizes.astype(np.float64))
        several = f" to {sizes.max():.4g}, drawn in {len(classes)} sizes" if len(classes) > 1 else ""
        return classes, f"{count} of {sizes.min():.4g}{several} {unit}".rstrip()
    size = WIDER * median_spacing(places)
    stated = f"{count} of {size:.4g} {unit}".rstrip()
    return [(size, every)], f"{stated}, {WIDER:g} times their spacing: --point-size sets another"


def _find_colors(values: Values, array: str | int | None) -> tuple[np.ndarray, tuple[str, ...]]:
    """Linear RGB float32 [N, 3] of points, and notes on it."""
    if array is not None and str(array) not in values:
        raise expected("array", f"one of {', '.join(sorted(values))}", repr(array))
    names = next((names for names in _COLORS if all(name in values for name in names)), None)
    if array is None and names:
        return _linear(np.stack([values[name] for name in names], axis=1)), ()
    if array is None and "f_dc_2" in values:
        base = np.stack([values[f"f_dc_{n}"] for n in range(3)], axis=1)
        colors = linear_from_srgb(np.clip(0.5 + HARMONIC * base, 0, 1)).astype(np.float32)
        return colors, ("3-D Gaussian splats are rendered as points of one size, in their mean colours",)
    intensity = values.get("intensity")
    name = str(array) if array else "intensity" if intensity is not None and np.ptp(intensity) > 0 else "height"
    notes = () if array else (f"without colours the points show their {name}: --array picks another",)
    return _map_colors(values[name], name).astype(np.float32), notes


def _linear(stored: np.ndarray) -> np.ndarray:
    """Linear RGB of stored sRGB [N, 3]: bytes, 16 bits, or fractions up to 1."""
    if stored.dtype.kind == "f":
        most = 1.0 if np.nanmax(stored, initial=0.0) <= 1.0 else 255.0
        return linear_from_srgb(np.clip(np.nan_to_num(stored / most), 0, 1)).astype(np.float32)
    # some files have bytes in 16 bits; others in their upper half
    is_byte = stored.dtype.itemsize == 1 or stored.max(initial=0) <= BYTE
    return linear_from_srgb(np.arange(256) / 255).astype(np.float32)[(stored if is_byte else stored >> 8) & BYTE]


def _map_colors(values: np.ndarray, name: str) -> np.ndarray:
    """Linear RGB of values: intensity in grey, others along a map from blue to yellow, without the outermost values."""
    finite = values[np.isfinite(values)].astype(np.float64)
    low, high = np.quantile(finite, [OUTSIDE, 1 - OUTSIDE]) if finite.size else (0.0, 1.0)
    share = np.clip((np.nan_to_num(values, nan=low) - low) / (high - low if high > low else 1.0), 0, 1)
    if name == "intensity":
        return np.repeat(linear_from_srgb(share)[:, None], 3, axis=1)
    # five colours of viridis, sRGB, between which brightness rises evenly
    nodes = np.array([[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]]) / 255
    srgb = [np.interp(share, np.linspace(0, 1, len(nodes)), nodes[:, channel]) for channel in range(3)]
    return linear_from_srgb(np.stack(srgb, axis=1))


def read_las(path: Path) -> tuple[np.ndarray, dict[str, np.ndarray], str]:
    """LAS and LAZ: scaled in float64, in metres unless the file names another system of coordinates."""
    laspy = import_extra("laspy", "LAS and LAZ files", "laspy[lazrs]", "points")
    with path.open("rb") as file:
        start, records = np.frombuffer(file.read(104)[96:].ljust(8, b"\0"), "<u4").tolist()
    require_bytes(records * VLR, start, "records of variable length")
    with decoder_errors("points"), laspy.open(path, read_evlrs=False) as file:
        header = file.header
        there, count = path.stat().st_size, int(header.point_count)
        require_plausible(count * int(header.point_format.size), there)
        if not header.are_points_compressed:
            require_bytes(int(header.offset_to_point_data) + count * int(header.point_format.size), there)
        require_memory(count * POINT_BYTES, there, "thin it out, such as with PDAL", "points")
        names = set(header.point_format.dimension_names)
        has_color = {"red", "green", "blue"} <= names
        kept = [*(("red", "green", "blue") if has_color else ()), "intensity", "classification", "return_number"]
        chunks, parts = [np.zeros((0, 3))], {name: list[np.ndarray]() for name in kept if name in names}
        for chunk in file.chunk_iterator(CHUNK):
            places = np.stack([np.asarray(chunk[axis], np.float64) for axis in "xyz"], axis=1)
            # points that the file marks as deleted have no place
            marked = np.asarray(chunk["withheld"], bool)[:, None] if "withheld" in names else False
            chunks.append(np.where(marked, np.nan, places))
            for name, values in parts.items():
                values.append(np.asarray(chunk[name]))
    places = np.concatenate(chunks)
    joined = {name: np.concatenate(values) for name, values in parts.items() if values}
    if len(places) != count:
        raise expected("points", f"{count:,}, as the header states", f"{len(places):,}", "the file is cut short")
    if has_color and count and not any(joined[name].any() for name in ("red", "green", "blue")):
        # the format has room for colours, which this file leaves black
        joined = {name: value for name, value in joined.items() if name not in ("red", "green", "blue")}
    return places, joined, _las_unit(header)


def _las_unit(header: Any) -> str:
    """ "m"; "" for coordinates in degrees or feet, by the file's well-known text or keys of GeoTIFF."""
    for record in header.vlrs:
        data = bytes(record.record_data_bytes()) if hasattr(record, "record_data_bytes") else b""
        if record.record_id == 2112 and re.search(rb"(?i)foot|feet|ftUS", data):
            return ""
        if record.record_id == 2112 and b"GEOG" in data and b"PROJ" not in data:
            return ""
        # keys of four numbers behind a header of four: the unit of lengths, the kind of coordinates
        keys = np.frombuffer(data[: len(data) // 8 * 8], "<u2").reshape(-1, 4) if record.record_id == 34735 else ()
        if any((key == 3076 and value != 9001) or (key == 1024 and value == 2) for key, _, _, value in keys):
            return ""
    return "m"


def _read_pcd(path: Path) -> tuple[np.ndarray, dict[str, np.ndarray], str]:
    """PCD 0.7: text, binary and compressed."""
    with path.open("rb") as file:
        fields = _pcd_header(file)
        start, there = file.tell(), path.stat().st_size
        words = {name: fields.get(name, "").split() for name in ("FIELDS", "SIZE", "TYPE", "COUNT")}
        names, kinds = words["FIELDS"], [kind.lower() for kind in words["TYPE"]]
        counts = [int(count) for count in words["COUNT"]] or [1] * len(names)
        codes = [f"<{kind}{size}" for kind, size in zip(kinds, words["SIZE"], strict=True)]
        if not {"x", "y", "z"} <= set(names) or len(counts) != len(names) or not set(kinds) <= set("iuf"):
            raise expected("FIELDS", "x, y and z, each with a SIZE and a TYPE", " ".join(names) or "none")
        count = int(fields.get("POINTS") or int(fields.get("WIDTH", 0)) * int(fields.get("HEIGHT", 1)))
        # a field may stand there twice, as "_" for padding does
        layout = enumerate(zip(names, codes, counts, strict=True))
        dtype = np.dtype([(f"{n} {name}", code, (size,)) for n, (name, code, size) in layout])
        require_memory(count * (dtype.itemsize + POINT_BYTES), there, "thin it out", "points")
        kind = fields["DATA"].lower()
        if kind == "ascii":
            table = read_text(file, np.dtype(np.float64), (count, sum(counts)), there - start)
            columns = np.split(table, np.cumsum(counts)[:-1], axis=1)
        elif kind == "binary":
            require_bytes(count * dtype.itemsize, there - start)
            records = np.frombuffer(file.read(count * dtype.itemsize), dtype)
            columns = [records[name] for name in dtype.names or ()]
        elif kind == "binary_compressed":
            packed, unpacked = np.frombuffer(file.read(8), "<u4").tolist()
            require_bytes(packed, there - start - 8)
            if unpacked != count * dtype.itemsize:
                raise expected("compressed data", f"{count * dtype.itemsize} bytes", unpacked, "the file is damaged")
            imagecodecs = import_extra("imagecodecs", "compressed PCD files", "imagecodecs", "readers")
            data, columns, at = bytes(imagecodecs.lzf_decode(file.read(packed), out=unpacked)), [], 0
            for code, size in zip(codes, counts, strict=True):
                bytes_of = count * size * np.dtype(code).itemsize
                columns.append(np.frombuffer(data, code, count * size, at).reshape(count, size))
                at += bytes_of
        else:
            raise expected("DATA", "ascii, binary or binary_compressed", repr(kind))
    values = {name: column[:, 0] for name, column in zip(names, columns, strict=True) if column.shape[1] == 1}
    for name, code in zip(names, codes, strict=True):
        if name in ("rgb", "rgba") and name in values:
            # blue in the lowest byte; as text a float or a whole number of the same bits
            numbers = values.pop(name)
            bits = numbers.astype(code[:2] + "4").view("<u4") if code[1] == "f" else numbers.astype(np.uint32)
            shifts = (("red", 16), ("green", 8), ("blue", 0))
            values |= {part: (bits >> shift & 255).astype(np.uint8) for part, shift in shifts}
    return np.stack([values.pop(axis).astype(np.float64) for axis in "xyz"], axis=1), values, ""


def _pcd_header(file: BinaryIO) -> dict[str, str]:
    """The fields of a PCD header, up to DATA, which is the last."""
    fields: dict[str, str] = {}
    while "DATA" not in fields:
        line = file.readline(HEADER).decode("ascii", "replace").strip()
        name, _, value = line.partition(" ")
        if (not line and not file.peek(1)) or len(fields) > 32 or not re.fullmatch("#.*|[A-Z]*", name):  # type: ignore[attr-defined]
            raise expected("header", "lines such as FIELDS x y z, and DATA at the end", repr(line[:40]))
        if line and not line.startswith("#"):
            fields[name] = value
    return fields


def _read_ply(path: Path) -> tuple[np.ndarray, dict[str, np.ndarray], str]:
    """The element vertex of a PLY file without faces."""
    with path.open("rb") as file:
        if _has_faces(file.read(HEADER).partition(b"end_header")[0].decode("ascii", "replace")):
            raise expected("PLY", "points without faces", "faces, or none", "sg.load_mesh and --mesh read surfaces")
    columns = dict(read_ply(path, last="vertex")["vertex"].columns)
    if not {"x", "y", "z"} <= set(columns):
        raise expected("vertex", "properties x, y and z", ", ".join(columns))
    places = np.stack([columns.pop(axis).astype(np.float64) for axis in "xyz"], axis=1)
    return places, columns, ""

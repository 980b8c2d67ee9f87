"""NRRD, attached (.nrrd) and detached (.nhdr), header parsed by pynrrd; raw data is memory-mapped.

Format: teem.sourceforge.net/nrrd/format.html. Axes are listed fastest first, and each entry of "space directions" is
the step along one axis: the columns of world-from-index.
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from splatgl.data.affine import shared_unit, unit_name, value_unit_name, volume_on_grid
from splatgl.data.times import seconds_in
from splatgl.data.volume import Label, Volume
from splatgl.errors import expected, import_extra
from splatgl.fileio import byte_count, decode_text
from splatgl.readers.channels import (
    COLOR_NOTE,
    MAGNITUDE_NOTE,
    Channel,
    ChannelSet,
    hex_color,
    is_color_rule,
    split_components,
)
from splatgl.readers.common import (
    bunzip,
    convert_words,
    decoder_errors,
    find_data_file,
    grid_shape,
    inflate,
    map_array,
    parse_number,
    read_text,
    stack_files,
)
from splatgl.readers.options import LoadOptions

# frames by name; in the scanner's and other frames "superior" need not be +z
_FRAMES = {
    **dict.fromkeys(("left-posterior-superior", "lps", "left-posterior-superior-time", "lpst"), "LPS"),
    **dict.fromkeys(("right-anterior-superior", "ras", "right-anterior-superior-time", "rast"), "RAS"),
}

# frames that are converted to LPS
_LEFT_ANTERIOR = ("left-anterior-superior", "las", "left-anterior-superior-time", "last")

# kinds and sizes of axes that hold a voxel's colour or vector
_COMPONENTS = {
    *(("rgb-color", 3), ("3-color", 3), ("rgba-color", 4), ("4-color", 4)),
    ("complex", 2),
    *((kind, 3) for kind in ("vector", "3-vector", "covariant-vector", "3-gradient", "3-normal")),
}

# most segments that a header may describe
MOST_SEGMENTS = 4096
_TEXT = ("ascii", "text", "txt")

# most bytes of a header: the gradients of a large diffusion study take some 2**17
_HEADER_LIMIT = 2**20
# most axes of a file: NRRD_DIM_MAX of the format's library
_MAX_AXES = 16
Header = Mapping[str, Any]
# a line of a list of data files, the key of their names, a pattern of their names, and most of them
_LIST, LISTED = re.compile(rb"data ?file: *LIST"), "files of a list"
_PATTERN, _MOST_FILES = re.compile(r"[^%]*%0?[0-9]{0,2}d[^%]*"), 100_000


def read(path: Path, options: LoadOptions) -> Volume:
    """The volume of a NRRD file; `time` (or `array`) picks the number along an axis of time, `channel` along another.

    Without `channel`, colours in bytes become `Volume.color` with their luma as samples, and vectors `Volume.vectors`
    with their lengths as samples. The layers of 3D Slicer's segmentations are channels.
    """
    header, start = _read_header(path)
    # 1. the three axes of space, and the others
    sizes = [int(size) for size in header["sizes"]]
    space = _space_axes(header, sizes)
    grid_shape([sizes[axis] for axis in space])
    others = [axis for axis in range(len(sizes)) if axis not in space]
    kinds = [str(kind).lower() for kind in header.get("kinds", [""] * len(sizes))]
    directions = header.get("space directions")
    if directions is not None:
        kinds = ["time" if _is_time(row) else kind for row, kind in zip(directions, kinds, strict=True)]
    # 3D Slicer calls the axis of a sequence or multi-volume a list
    counts = ["MultiVolume.FrameLabels" in header or f"axis {n} index values" in header for n in range(len(sizes))]
    kinds = ["time" if kind == "list" and is_time else kind for kind, is_time in zip(kinds, counts, strict=True)]
    times = [axis for axis in others if kinds[axis] == "time"]
    if options.array is not None and not times:
        raise expected("array", "an axis of the kind time", "none", "pick a component with channel=N")
    segments = _read_segments(header)
    layered = next((axis for axis in others if axis not in times and segments and sizes[axis] > 1), None)
    # 2. the samples, mapped if they can be
    stored = _read_data(path, header, start, sizes[::-1], options.anywhere)
    # 3. a volume per layer of segments, or the only volume
    names = [_layer_name(segments, layer) for layer in range(sizes[layered] if layered is not None else 0)]
    count, step = (sizes[times[0]], _time_step(header, times[0])) if times else (1, None)
    channel_set = ChannelSet(tuple(map(Channel, names)), together=True, times=count, step=step)

    def read_layer(layer: int | None) -> Volume:
        volume = _volume(header, stored, kinds, options if layer is None else replace(options, channel=layer))
        known = tuple(label for at, label in segments if layer is None or at == layer)
        rounded = volume.rounded() if known else None
        return volume if rounded is None else replace(rounded, labels=known)

    # without layers of segments, `channel` picks a component
    volume = channel_set.volume(options if layered is not None else replace(options, channel=None), read_layer)
    return replace(volume, labels=tuple(label for _, label in segments)) if volume.channels else volume


def _volume(header: Header, stored: np.ndarray, kinds: list[str], options: LoadOptions) -> Volume:
    """The volume of stored samples; `channel` picks along axes that are neither space nor time."""
    sizes, last = [int(size) for size in header["sizes"]], len(kinds) - 1
    space = _space_axes(header, sizes)
    others = [axis for axis in range(len(sizes)) if axis not in space]
    whole = [
        axis
        for axis in others
        if options.channel is None
        and (
            (kinds[axis], sizes[axis]) in _COMPONENTS
            or (kinds[axis] == "vector" and is_color_rule(stored.dtype, sizes[axis]))
        )
    ]
    picked = {last - axis: "time" if kinds[axis] == "time" else "channel" for axis in others if axis not in whole[:1]}
    if not [axis for axis in others if kinds[axis] != "time"]:
        options.reject("channel", "several numbers per voxel")
    samples = stored[options.index(stored.shape, picked)]
    color = vectors = None
    told: tuple[str, ...] = ()
    if whole:
        place = last - whole[0] - sum(axis < last - whole[0] for axis in picked)
        values, kind = np.moveaxis(samples, place, -1), kinds[whole[0]]
        # a vector of bytes is a colour, as ITK writes it
        is_color = "color" in kind or is_color_rule(values.dtype, values.shape[-1])
        if kind == "complex":
            samples = np.stack([np.hypot(*np.moveaxis(plane, -1, 0)).astype(np.float32) for plane in values])
            told = (MAGNITUDE_NOTE,)
        else:
            samples, color, vectors = split_components(values, is_color)
            told = (COLOR_NOTE,) * (is_color and "color" not in kind)
    matrix, origin, notes = _grid(header, space)
    # units are those of the space's axes with directions, else of the file's, which are then the same
    unit, factors = shared_unit(_units(header, space))
    matrix, origin = factors[:, None] * matrix, factors * origin
    rotation: Any = header.get("measurement frame")
    if vectors is not None and np.shape(rotation) == (3, 3) and np.isfinite(rotation).all():
        # the rows of the field are the columns of the matrix
        vectors = np.asarray(vectors @ np.asarray(rotation, np.float32))
    space_name = str(header.get("space", "")).lower()
    if space_name in _LEFT_ANTERIOR:
        # LAS to LPS: y points the other way
        matrix, origin = np.diag([1.0, -1.0, 1.0]) @ matrix, origin * (1, -1, 1)
        vectors = None if vectors is None else vectors * np.array([1, -1, 1], vectors.dtype)
    frame = "LPS" if space_name in _LEFT_ANTERIOR else _FRAMES.get(space_name)
    if space_name.startswith("scanner"):
        notes = (*notes, f"space {space_name}: the file does not state the patient's orientation")
    return volume_on_grid(
        samples,
        matrix,
        origin,
        "space directions and origin",
        unit=unit,
        frame=frame,
        color=color,
        vectors=vectors,
        value_unit=value_unit_name(header.get("sample units")),
        notes=(*told, *notes, *_ignored_notes(header)),
    )


def _is_time(direction: np.ndarray) -> bool:
    """Whether an axis runs along the fourth dimension of its space."""
    return len(direction) == 4 and np.isfinite(direction).all() and not any(direction[:3])


def _time_step(header: Header, axis: int) -> float:
    """Seconds from one time point to the next; a step without a unit is in seconds."""
    directions, spacings, units = (header.get(name) for name in ("space directions", "spacings", "units"))
    step = np.nan
    if directions is not None and _is_time(directions[axis]):
        step, units = directions[axis][3], header.get("space units")
        axis = 3
    elif len(listed := str(header.get(f"axis {axis} index values", "")).split()) > 1:
        step = parse_number(listed[1]) - parse_number(listed[0])
    elif spacings is not None and axis < len(spacings):
        step = spacings[axis]
    unit = str(units[axis]) if units is not None and axis < len(units) else ""
    return float(step) * (seconds_in(unit) or (0.0 if unit.strip("?") else 1.0))


def _ignored_notes(header: Header) -> tuple[str, ...]:
    """Notes on header entries that are ignored."""
    old = [float(header[name]) for name in ("old min", "oldmin", "old max", "oldmax") if name in header]
    if len(old) != 2 or not np.isfinite(old).all():
        return ()
    return (f"values are as stored: they were quantized from {old[0]:g} … {old[1]:g}",)


def _read_segments(header: Header) -> list[tuple[int, Label]]:
    """(layer, label) of 3D Slicer's segments; without layers, in old files, the n-th segment is 1 in the n-th layer."""
    labels: dict[tuple[int, int], Label] = {}
    for n in range(MOST_SEGMENTS):
        tags = {
            name: str(header.get(f"Segment{n}_{name}", "")) for name in ("LabelValue", "Layer", "Name", "Color", "ID")
        }
        if not any(tags.values()):
            break
        if not tags["LabelValue"]:
            tags |= {"LabelValue": "1", "Layer": str(n)}
        if not re.fullmatch("-?[0-9]{1,18}", tags["LabelValue"]):
            break
        layer = int(tags["Layer"]) if re.fullmatch("[0-9]{1,9}", tags["Layer"]) else 0
        parts = [float(part) for part in tags["Color"].split() if re.fullmatch(r"[01]|[01]?\.[0-9]+", part)]
        color = hex_color([round(min(part, 1.0) * 255) for part in parts]) if len(parts) == 3 else None
        number = int(tags["LabelValue"])
        labels.setdefault((layer, number), Label(number, tags["Name"], color))
    return [(layer, label) for (layer, _), label in labels.items()]


def _layer_name(segments: list[tuple[int, Label]], layer: int) -> str:
    """The names of a layer's segments if they are few, else its number."""
    names = [label.name for at, label in segments if at == layer]
    return ", ".join(names) if 0 < len(names) < 4 and all(names) else f"layer {layer}"


def _read_header(path: Path) -> tuple[Header, int]:
    nrrd = import_extra("nrrd", "NRRD files", "pynrrd", "readers")
    with path.open("rb") as file, decoder_errors("NRRD"):
        lines = _header_lines(file)
        # behind "data file: LIST" come names
        last = next((n for n, line in enumerate(lines, 1) if _LIST.match(line)), len(lines))
        # as text: pynrrd drops bytes that are not ASCII
        header, end = nrrd.read_header(list(map(decode_text, lines[:last]))), file.tell()
        header[LISTED] = [decode_text(line).strip() for line in lines[last:] if line.strip()]
    for name in ("dimension", "type", "encoding", "sizes"):
        if name not in header:
            raise expected("header", f"a field {name!r}", "none", "the header is incomplete")
    if not 1 <= header["dimension"] <= _MAX_AXES:
        raise expected("dimension", f"1 to {_MAX_AXES}", header["dimension"])
    if header["dimension"] != len(header["sizes"]):
        raise expected("sizes", f"{header['dimension']} (dimension)", len(header["sizes"]))
    kinds = header.get("kinds")
    if kinds is not None and len(kinds) != header["dimension"]:
        raise expected("kinds", f"one per axis ({header['dimension']})", len(kinds))
    if min(header["sizes"]) < 1:
        raise expected("sizes", "at least one sample along each axis", header["sizes"].tolist())
    return header, end


def _header_lines(file: BinaryIO) -> list[bytes]:
    """The lines of the header, with the blank line that ends it."""
    lines, room = list[bytes](), _HEADER_LIMIT
    while room > 0 and (line := file.readline(room)):
        lines.append(line)
        room -= len(line)
        if not line.strip():
            return lines
    if room <= 0:
        raise expected("header", f"at most {_HEADER_LIMIT} bytes", "more", "is this a NRRD file?")
    return lines


def _space_axes(header: Header, sizes: list[int]) -> list[int]:
    """Numbers of the axes of space, fastest first: axes with a direction, or of a spatial kind, or the first three."""
    directions, kinds = header.get("space directions"), header.get("kinds")
    if directions is not None and len(directions) != len(sizes):
        raise expected("space directions", f"one per axis ({len(sizes)})", len(directions))
    if directions is not None:
        axes = [axis for axis, row in enumerate(directions) if np.isfinite(row).all() and not _is_time(row)]
    elif kinds is not None and len(sizes) > 3:
        axes = [axis for axis, kind in enumerate(kinds) if kind.lower() in ("domain", "space")]
    else:
        axes = list(range(min(len(sizes), 3)))
    if len(axes) != 3:
        raise expected("axes", "three axes of space", f"{len(axes)} among {len(sizes)}")
    return axes


def _read_data(path: Path, header: Header, start: int, shape: list[int], anywhere: bool) -> np.ndarray:
    nrrd = import_extra("nrrd", "NRRD files", "pynrrd", "readers")
    with decoder_errors("NRRD"):
        dtype = nrrd.reader._determine_datatype(header)
    if dtype.kind not in "iuf":
        raise expected("type", "a real number type", repr(header["type"]))
    # the data: here, in another file, or in several
    name = header.get("data file", header.get("datafile"))
    if name is None:
        return _read_file(path, header, start, shape, dtype)
    names, axes = _list_files(name, header.get(LISTED, ()), shape)
    if not axes:
        return _read_file(find_data_file(path, name, anywhere), header, 0, shape, dtype)
    return stack_files(path, names, axes, shape, anywhere, lambda file, of: _read_file(file, header, 0, of, dtype))


def _list_files(name: str, listed: Sequence[str], shape: list[int]) -> tuple[list[str], int]:
    """Names of several data files, and how many of the fastest axes each holds: all but the slowest unless stated; ([],
    0) for one file.

    name: of one file, "LIST [N]" with names behind the header, or a pattern with the first and last number, step and N.
    """
    words = name.split()
    if words[:1] == ["LIST"]:
        names, rest = list(listed), words[1:]
    elif "%" in name and len(words) in (4, 5) and _PATTERN.fullmatch(words[0]):
        first, last, step = convert_words(words[1:4], int, "data file")
        numbers = range(first, last + (1 if step > 0 else -1), step or 1)[:_MOST_FILES]
        names, rest = [words[0] % number for number in numbers], words[4:]
    else:
        return [], 0
    axes = convert_words(rest, int, "data file")[0] if rest else len(shape) - 1
    if not 1 <= axes < len(shape):
        raise expected("data file", f"1 to {len(shape) - 1} axes a file", axes)
    return names, axes


def _read_file(path: Path, header: Header, start: int, shape: list[int], dtype: np.dtype) -> np.ndarray:
    """The samples [shape] in a file from byte `start` on; "line skip" counts before "byte skip"."""
    encoding = str(header["encoding"]).lower()
    start = _skip_lines(path, start, int(header.get("line skip", header.get("lineskip", 0))))
    skip = int(header.get("byte skip", header.get("byteskip", 0)))
    if skip < -1:
        raise expected("byte skip", "-1 (from the end), 0 or more", skip)
    # "byte skip" of compressed data counts inflated bytes
    if encoding == "raw":
        from_end = path.stat().st_size - byte_count(shape, dtype)
        return map_array(path, max(from_end, 0) if skip == -1 else start + skip, dtype, shape)
    if skip > 0:
        raise expected("byte skip", "0 in compressed or text data", skip)
    unpack = {"gzip": inflate, "gz": inflate, "bzip2": bunzip, "bz2": bunzip}.get(encoding)
    if unpack:
        return unpack(path, start, dtype, shape)
    if encoding in _TEXT:
        with path.open("rb") as file, decoder_errors("NRRD text data"):
            file.seek(start)
            text = io.BytesIO(file.read().replace(b",", b" "))
            return read_text(text, dtype, shape, text.getbuffer().nbytes)
    raise expected("encoding", "raw, gzip, bzip2 or text", repr(encoding), "convert the file to gzip")


def _skip_lines(path: Path, start: int, lines: int) -> int:
    with path.open("rb") as file:
        file.seek(start)
        for _ in range(lines):
            if not file.readline():
                raise expected("line skip", "fewer lines than the data file has", lines)
        return file.tell()


def _grid(header: Header, space: list[int]) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """World-from-index [3, 3], origin [3], notes: from "space directions", else "spacings", else "axis mins, maxs"."""
    origin = np.asarray(header.get("space origin", (0.0, 0.0, 0.0)), dtype=np.float64)
    origin = np.where(np.isfinite(origin), origin, 0.0)[:3]
    directions = header.get("space directions")
    if directions is not None:
        matrix = np.array([directions[axis] for axis in space], dtype=np.float64).T
        matrix = matrix[:3] if matrix.shape == (4, 3) else matrix
        if matrix.shape != (3, 3):
            raise expected("space directions", "vectors of three numbers", f"{matrix.shape[0]} numbers")
        return matrix, origin, ()
    steps = _axis_field(header, space, "spacings")
    low, high = (_axis_field(header, space, f"axis {name}", f"axis{name}") for name in ("mins", "maxs"))
    sizes = np.array([header["sizes"][axis] for axis in space], np.float64)
    centers = header.get("centers", header.get("centerings", ()))
    words = centers.split() if isinstance(centers, str) else list(centers)
    centerings = [words[axis].lower() if len(words) == len(header["sizes"]) else "" for axis in space]
    nodes = np.array([word == "node" for word in centerings])
    # from the middle of the first voxel to that of the last, or from face to face
    spans = (high - low) / np.where(nodes, np.maximum(sizes - 1, 1), sizes)
    taken = ~np.isfinite(steps) & np.isfinite(spans) & (spans != 0)
    steps = np.where(taken, spans, np.where(np.isfinite(steps), steps, 1.0))
    if "space origin" not in header:
        # a least coordinate alone gives the origin, too
        places = low + np.where(nodes, 0.0, steps / 2)
        origin = np.where(np.isfinite(low) & (taken | np.isfinite(places)), places, 0.0)
    stated = np.isfinite(_axis_field(header, space, "spacings")) | taken
    unknown = [axis for axis, known in zip("xyz", stated, strict=True) if not known]
    guessed = any(word not in ("cell", "node") for word, by in zip(centerings, taken, strict=True) if by)
    note = "axis mins and maxs are read as faces of the grid: the file does not state its centers"
    notes = (note,) * guessed
    if "spacings" in header and unknown:
        notes = (*notes, f"the file states no spacing along {', '.join(unknown)}: 1 is taken")
    return np.diag(steps), origin, notes


def _axis_field(header: Header, space: list[int], *names: str) -> np.ndarray:
    """The numbers of a field along the axes of space [3], NaN without the field."""
    name = next((name for name in names if name in header), None)
    if name is None:
        return np.full(3, np.nan)
    values = header[name]
    if len(values) != header["dimension"]:
        raise expected(name, f"one per axis ({header['dimension']})", len(values))
    return np.array([values[axis] for axis in space], np.float64)


def _units(header: Header, space: list[int]) -> list[str]:
    """The units of the axes of space, "" for those without one."""
    units = header.get("space units")
    if units is None and len(header.get("units", ())) == header["dimension"]:
        units = [header["units"][axis] for axis in space]
    return [unit_name(unit) for unit in [*(units or ()), "", "", ""][:3]]

"""Folders and patterns (FOLDER/NAME*.tif) with one picture per slice: TIFF, PNG, BMP, JPEG, JPEG 2000 and JPEG XL.

Slices are in the order of the numbers in their names. Numbers behind c, ch, channel, w or t, tp, time count channels
and time points. Large stacks are read in parts, a slice at a time.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.data.affine import metres_in, unit_name
from splatgl.data.volume import Volume
from splatgl.errors import expected, import_extra, list_names
from splatgl.fileio import WHOLE_BYTES, byte_count, decode_text, held_within_budget, require_memory
from splatgl.readers.channels import Channel, ChannelSet, mark_microscope, split_colors
from splatgl.readers.chunked import Chunked, Stored, file_tag
from splatgl.readers.common import decoder_errors, parse_number, parse_xml
from splatgl.readers.dicom_frames import MOST_TILES, picture_size
from splatgl.readers.heightmap import PICTURES, open_picture
from splatgl.readers.microscopes import Planes
from splatgl.readers.ome_zarr import natural_key
from splatgl.readers.options import LoadOptions
from splatgl.readers.tiff import (
    Grid,
    logged_errors,
    open_tiff,
    resolution_grid,
    stated_grid,
    tiff_dpi,
    value_notes,
    values_of,
)
from splatgl.readers.tiff_images import find_calibration, find_pixels
from splatgl.readers.tiff_validation import (
    check_before_decoding,
    check_chain,
    check_ome,
    check_page,
    check_strips,
    jpeg_xl_size,
)

# formats of slices by ending
KINDS = {".tif": "TIFF", ".tiff": "TIFF", ".png": "PNG", ".bmp": "BMP", ".jpg": "JPEG", ".jpeg": "JPEG"}
KINDS |= {".jp2": "JPEG 2000", ".j2k": "JPEG 2000", ".jxl": "JPEG XL"}
# decoders of imagecodecs that read these, and what tells their size
_DECODERS = {"JPEG 2000": ("jpeg2k_decode", picture_size), "JPEG XL": ("jpegxl_decode", jpeg_xl_size)}
# words before numbers of channels and of time points
_CHANNELS, _TIMES = ("c", "ch", "chan", "channel", "w"), ("t", "tp", "time", "timepoint")
_NUMBERS, _WORD = re.compile(r"\d+(?:\.\d+)*"), re.compile(r"([a-z]*)[^a-z]*$")
# size of a pixel in the logs of SkyScan's scanners, where the slices' stands behind that of the projections, and most
# bytes of a log
_LOG_SIZE, _LOG_BYTES = re.compile(rb"(?m)^\s*(Image )?Pixel Size \(([^)]{1,16})\)\s*=\s*([0-9.]+)"), 2**16
_LOG_SLICES = b"[Reconstruction]"
# most logs that are read
_MOST_LOGS = 5

Shape = tuple[int, ...]


def is_slices(path: Path) -> bool:
    """Whether a folder or pattern has at least two pictures of one format."""
    return len(_find_pictures(path)[0]) > 1


def read(path: Path, options: LoadOptions) -> Volume:
    """The volume of the most frequent kind of pictures; `channel` and `time` pick by the numbers in their names.

    Spacing comes from ImageJ's or OME's metadata, a scanner's log or resolution tags, else it is 1. Raises InputError
    for a picture of another size or type than the first.
    """
    files, left = _find_pictures(path)
    _check_series(files)
    stacks, channels, times, notes = _arrange(files)
    first = _read_plane(files[0])
    (spacing, unit), grid_notes = _find_grid(files[0])
    grid_notes = grid_notes if options.spacing is None else []
    grid_notes += _with_page(files[0], value_notes) if KINDS[files[0].suffix.lower()] == "TIFF" else []
    notes = [f"{len(stacks[0, 0])} slices, from {files[0].name} to {files[-1].name}", *grid_notes, *notes]
    notes += [f"{left} other file{'s are' if left > 1 else ' is'} left out"] * bool(left)
    of = ChannelSet(tuple(map(Channel, channels)) if len(channels) > 1 else (), times=max(len(times), 1))

    def read_one(channel: int | None) -> Volume:
        return _read_stack(stacks[channel or 0, options.point], first)

    volume = mark_microscope(of.volume(options, read_one))
    channels_on_grid = tuple(replace(channel, spacing=spacing, unit=unit) for channel in volume.channels)
    return replace(volume, spacing=spacing, unit=unit, channels=channels_on_grid, notes=(*notes, *volume.notes))


def _find_pictures(path: Path) -> tuple[list[Path], int]:
    """The pictures of the most frequent format and pattern of names, in the order of their numbers; how many others."""
    folder, pattern = (path, "*") if path.is_dir() else (path.parent, path.name)
    files = [file for file in folder.glob(pattern) if file.is_file()]
    pictures = [file for file in files if file.suffix.lower() in KINDS]
    kinds = Counter(KINDS[file.suffix.lower()] for file in pictures)
    most = max(sorted(kinds), key=lambda kind: kinds[kind], default="")
    same = [file for file in pictures if KINDS[file.suffix.lower()] == most]
    # previews and overviews beside slices have other names
    names = Counter(_NUMBERS.sub("#", file.stem) for file in same)
    usual, count = max(names.items(), key=lambda item: item[1], default=("", 0))
    if 2 * count > len(same):
        same = [file for file in same if _NUMBERS.sub("#", file.stem) == usual]
    return sorted(same, key=lambda file: natural_key(file.name)), len(files) - len(same)


def _check_series(files: Sequence[Path]) -> None:
    """Raises InputError for stacks of other names, one behind the other, whose numbers begin again."""
    series = [(name, list(some)) for name, some in groupby(files, lambda file: _NUMBERS.sub("#", file.stem))]
    counted = [{tuple(_NUMBERS.findall(file.stem)) for file in some} for _, some in series]
    if len({name for name, _ in series}) < len(series) or len(series) < 2 or min(map(len, counted)) < 2:
        return
    if any(a & b for a, b in pairwise(counted)):
        patterns = [f"{name.replace('#', '*')}{some[0].suffix}" for name, some in series]
        fix = f"name one of these: {files[0].parent / patterns[0]}"
        raise expected("slices", "those of one stack", list_names(patterns), fix)


def _arrange(files: Sequence[Path]) -> tuple[dict[tuple[int, int], list[Path]], list[str], list[str], list[str]]:
    """Slices by (channel, time), the names of channels and of time points, and notes on missing numbers."""
    numbers = [_NUMBERS.findall(file.stem) for file in files]
    if len(set(map(len, numbers))) != 1:
        return {(0, 0): list(files)}, [], [], []
    varying = [at for at in range(len(numbers[0])) if len({row[at] for row in numbers}) > 1]
    words = {}
    for at, match in enumerate(_NUMBERS.finditer(files[0].stem)):
        before = _WORD.search(files[0].stem[: match.start()].lower())
        words[at] = before[1] if before else ""
    axes = [[at for at in varying if words[at] in kinds][:1] for kinds in (_CHANNELS, _TIMES)]
    # a single varying number counts slices, whatever the word before it
    axes = axes if len(varying) > 1 else [[], []]
    rest = [at for at in varying if [at] not in axes]
    values = [sorted({row[at] for row in numbers for at in axis}, key=natural_key) for axis in axes]
    stacks: dict[tuple[int, int], list[Path]] = {}
    keys: dict[tuple[int, int], list[tuple[str, ...]]] = {}
    for file, row in zip(files, numbers, strict=True):
        place = tuple(value.index(row[axis[0]]) if axis else 0 for axis, value in zip(axes, values, strict=True))
        stacks.setdefault(place, []).append(file)  # type: ignore[arg-type]
        keys.setdefault(place, []).append(tuple(row[at] for at in rest))  # type: ignore[arg-type]
    first = keys.get((0, 0), [])
    if len(keys) != np.prod([max(len(value), 1) for value in values]) or any(key != first for key in keys.values()):
        raise expected("slices", "the same numbers in each channel and time", "some missing", "name them by a pattern")
    _check_counts(files[0], [[key[n] for key in first] for n in range(len(rest))])
    channels, times = (
        [f"{words[at]}{text}" for at in axis for text in value] for axis, value in zip(axes, values, strict=True)
    )
    return stacks, channels, times, _missing_notes([key[0] for key in first] if len(rest) == 1 else [])


def _check_counts(file: Path, columns: list[list[str]]) -> None:
    """Raises InputError if two numbers count: tiles, or several stacks whose names tell no channels or times."""
    counts = [len(set(column)) for column in columns]
    if len(counts) == 2 and min(counts) > 1 and counts[0] * counts[1] == len(columns[0]):
        fix = f"name those of one stack by a pattern such as {_NUMBERS.sub('*', file.stem, count=1)}{file.suffix}"
        raise expected("slices", "one number that counts them", f"two, {counts[0]} × {counts[1]}", fix)


def _missing_notes(texts: list[str]) -> list[str]:
    """A note on numbers that are missing in an even count."""
    if len(texts) < 3 or not all(text.isdigit() for text in texts):
        return []
    numbers = [int(text) for text in texts]
    step = Counter(b - a for a, b in pairwise(numbers)).most_common(1)[0][0]
    missing = sorted(set(range(numbers[0], numbers[-1], step)) - set(numbers)) if step > 0 else []
    if not missing or len(missing) > len(numbers):
        return []
    if len(missing) == 1:
        return [f"number {missing[0]} is missing: the slices around it are rendered as neighbours"]
    return [f"numbers {list_names(missing, 5)} are missing: the slices around them are rendered as neighbours"]


# --- samples ----------------------------------------------------------------------------------------------------------


def _read_stack(files: Sequence[Path], first: np.ndarray) -> Volume:
    """The volume of slices like `first`; read in parts if it takes more than WHOLE_BYTES."""
    size = byte_count((len(files), *first.shape), first.dtype)
    if first.ndim == 2 and size > held_within_budget(WHOLE_BYTES):
        for file in files:
            _check_same(file, *_describe_plane(file), files[0], first)

        def read_slice(index: tuple[int, ...]) -> np.ndarray:
            plane = _read_plane(files[index[0]])
            _check_same(files[index[0]], plane.shape, plane.dtype, files[0], first)
            return plane

        planes = Planes((len(files),), first.shape, first.dtype, read_slice)
        return Volume(Chunked(str(files[0].parent), planes, [slice(None)] * 3, _Slices(files), "slices"))
    require_memory(size, sum(file.stat().st_size for file in files))
    samples = np.empty((len(files), *first.shape), first.dtype)
    for n, file in enumerate(files):
        plane = _read_plane(file)
        _check_same(file, plane.shape, plane.dtype, files[0], first)
        samples[n] = plane
    if samples.ndim == 3:
        return Volume(samples)
    if samples.shape[-1] == 2 and KINDS[files[0].suffix.lower()] == "PNG":
        # grey with alpha
        return Volume(np.ascontiguousarray(samples[..., 0]))
    if samples.shape[-1] not in (3, 4) or samples.dtype != np.uint8:
        raise expected(files[0].name, "grey, or colours of 8 bits", f"{first.dtype} {first.shape}", "save it as grey")
    luma, color = split_colors(samples)
    return Volume(luma, color=color)


def _check_same(file: Path, shape: Shape, dtype: np.dtype | None, first_file: Path, first: np.ndarray) -> None:
    if tuple(shape) != first.shape or dtype not in (None, first.dtype):
        this = f"{first.shape[1]}×{first.shape[0]} {first.dtype}, as {first_file.name}"
        raise expected(file.name, this, f"{shape[1]}×{shape[0]} {dtype}", "move it elsewhere")


class _Slices(Stored):
    """The files of slices."""

    def __init__(self, files: Sequence[Path]) -> None:
        self.path, self.files = files[0].resolve(), files

    def tag(self) -> str:
        """Text that changes with any of the files."""
        return "\n".join(file_tag(file.resolve()) for file in self.files)


def _read_plane(file: Path) -> np.ndarray:
    """The samples [H, W] or [H, W, channels] of a picture."""
    kind = KINDS[file.suffix.lower()]
    if kind in _DECODERS:
        return _decode_plane(file, kind)
    if kind != "TIFF":
        return open_picture(file, 1)
    return _with_page(file, lambda page: values_of(np.asarray(page.asarray()), page.parent))


def _decode_plane(file: Path, kind: str) -> np.ndarray:
    """The samples of a picture that imagecodecs decodes."""
    imagecodecs = import_extra("imagecodecs", kind, "imagecodecs", "readers")
    data = file.read_bytes()
    # decoders hold up to four samples of 16 bits, twice
    require_memory(byte_count((*_stated_size(file, data), 16), np.dtype(np.uint8)), len(data))
    with decoder_errors(f"{kind} ({file.name})"):
        return np.asarray(getattr(imagecodecs, _DECODERS[kind][0])(data))


def _stated_size(file: Path, data: bytes) -> Shape:
    """(rows, columns) in the header of a picture that imagecodecs decodes."""
    kind = KINDS[file.suffix.lower()]
    with decoder_errors(f"{kind} ({file.name})"):
        size, tiles = _DECODERS[kind][1](data)
        if not size or tiles > MOST_TILES:
            raise expected(file.name, f"a picture of {kind}", "another header", "the file is damaged")
        return size


def _is_converted(page: Any) -> bool:
    """Whether the values of a page are of another type than its samples."""
    return find_calibration(page.parent) is not None or page.dtype.kind == "c"


def _describe_plane(file: Path) -> tuple[Shape, np.dtype | None]:
    """Shape and type of a picture, by its header where that tells them; no type where only decoding tells it."""
    if KINDS[file.suffix.lower()] == "TIFF":
        return _with_page(file, lambda page: (page.shape, None if _is_converted(page) else np.dtype(page.dtype)))
    from PIL import Image

    if KINDS[file.suffix.lower()] in _DECODERS:
        return _stated_size(file, file.read_bytes()), None
    with decoder_errors(f"a picture ({file.name})"), Image.open(file, formats=PICTURES) as picture:
        mode = {"L": np.uint8, "I;16": np.uint16, "1": np.bool_}.get(picture.mode)
        if mode is not None:
            return (picture.height, picture.width), np.dtype(mode)
    plane = _read_plane(file)
    return plane.shape, plane.dtype


def _with_page(file: Path, use: Any) -> Any:
    """The result of `use` for the only page of a TIFF file."""
    check_chain(file)
    with logged_errors(), open_tiff(file) as tiff, decoder_errors(f"TIFF ({file.name})"):
        if len(tiff.pages) != 1:
            raise expected(file.name, "one page a slice", f"{len(tiff.pages)} pages", "load the file alone")
        check_page(tiff.pages[0])
        check_strips(tiff.pages)
        check_before_decoding(tiff.pages)
        require_memory(byte_count(tiff.pages[0].shape, tiff.pages[0].dtype), file.stat().st_size)
        return use(tiff.pages[0])


# --- grid -------------------------------------------------------------------------------------------------------------


def _find_grid(file: Path) -> tuple[Grid, list[str]]:
    """(spacing, unit) of slices, and notes that tell where they come from."""
    hint = "one voxel apart: --spacing sets another distance"
    if KINDS[file.suffix.lower()] == "TIFF":
        check_chain(file)
        with logged_errors(), open_tiff(file) as tiff, decoder_errors(f"TIFF ({file.name})"):
            if tiff.ome_metadata:
                check_ome(parse_xml(tiff.ome_metadata, "OME-XML"))
            (x, y, z), unit = stated_grid(tiff, find_pixels(tiff, 0)) or ((1.0, 1.0, 1.0), "")
            dpi, flat = tiff_dpi(tiff.pages[0]), "spacing" not in (tiff.imagej_metadata or {"spacing": z})
        if unit:
            # a single slice of ImageJ's states no distance
            notes = [f"slices are as far apart as pixels are wide: {hint.split(': ')[1]}"] * flat
            return ((x, y, x if flat else z), unit), notes
    elif KINDS[file.suffix.lower()] in _DECODERS:
        dpi = (0.0, 0.0)
    else:
        from PIL import Image

        with decoder_errors(f"a picture ({file.name})"), Image.open(file, formats=PICTURES) as picture:
            across, down = picture.info.get("dpi", (0.0, 0.0))
            dpi = (float(across), float(down))
    for log in sorted(file.parent.glob("*.log"))[:_MOST_LOGS]:
        with log.open("rb") as opened:
            text = opened.read(_LOG_BYTES)
        slices = _LOG_SIZE.findall(text.partition(_LOG_SLICES)[2])
        sizes = slices or sorted(_LOG_SIZE.findall(text), reverse=True) or [(b"", b"", b"")]
        size, unit = parse_number(decode_text(sizes[0][2]), 0.0), unit_name(decode_text(sizes[0][1]))
        if 0 < size < np.inf and metres_in(unit):
            return ((size, size, size), unit), [f"voxels of {size:g} {unit} by {log.name}"]
    grid, note = resolution_grid(dpi)
    return grid, [note] if grid[1] else [hint, *[note] * bool(note)]

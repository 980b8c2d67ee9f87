"""`save`: writes a volume to a file or store; `TARGETS` has one row for each format."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.data.affine import METRES
from splatgl.data.arrays import ConvertedArray
from splatgl.data.color import luma
from splatgl.data.volume import Label, Volume, triple
from splatgl.errors import expected, import_extra
from splatgl.fileio import atomic_folder, atomic_write, check_output
from splatgl.plugins import find_function, load_plugins
from splatgl.readers.label_table import MARK, list_label_tables
from splatgl.transfer.colormaps import colors_of

# bytes of samples that are read at a time
SLAB_BYTES = 2**26
# largest whole number up to which float64 holds every one
EXACT = 2**53

_ALL = ("i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f4", "f8")


@dataclass(frozen=True)
class FileTarget:
    """A format that is written: its name, suffixes and writer: a function of a path and a `Content`, or the place of
    one as of a `Format`. Of another package it is what an entry point of the group `splatgl.writers` leads to.

    holds: what it keeps of "spacing", "origin", "direction", "color", "vectors", "channels", "layers" (channels of
    labels), "times", "labels" (their table), "images" (those of patients) and "value unit". frame: of its coordinates,
    None if it states any. units: of length that it names, () for all. types: numpy codes of samples. library: (module,
    package) that writes it, of an extra.
    """

    title: str
    suffixes: tuple[str, ...]
    writer: str | Callable[[Path, Content], None]
    holds: tuple[str, ...]
    frame: str | None = None
    units: tuple[str, ...] = ()
    types: tuple[str, ...] = _ALL
    library: tuple[str, str] | None = None
    extra: str = "readers"
    is_folder: bool = False


_GRID = ("spacing", "origin", "direction", "times")
_NIFTI = partial(FileTarget, frame="RAS", units=("mm", "um", "m"), library=("nibabel", "nibabel"))
TARGETS = (
    _NIFTI("NIfTI", (".nii",), "formats.write_nifti", (*_GRID, "color", "vectors")),
    _NIFTI("NIfTI", (".nii.gz",), "formats.write_nifti", (*_GRID, "color", "vectors")),
    FileTarget(
        "NRRD", (".nrrd",), "formats.write_nrrd", (*_GRID, "color", "vectors", "layers", "labels", "value unit")
    ),
    FileTarget(
        "MetaImage", (".mha",), "formats.write_metaimage", (*_GRID, "color", "vectors"), "LPS", ("mm", "um", "cm")
    ),
    FileTarget(
        "OME-TIFF",
        (".ome.tif", ".ome.tiff", ".tif", ".tiff"),
        "formats.write_tiff",
        ("spacing", "times", "color", "channels"),
        types=("u1", "i1", "u2", "i2", "i4", "u4", "f4", "f8"),
        library=("tifffile", "tifffile"),
    ),
    FileTarget(
        "OME-Zarr",
        (".zarr",),
        "formats.write_zarr",
        (*_GRID, "channels", "labels"),
        types=(*_ALL, "f2"),
        library=("zarr", "zarr"),
        is_folder=True,
    ),
    FileTarget(
        "DICOM SEG",
        (".dcm",),
        "segmentation.write_segmentation",
        ("spacing", "origin", "direction", "layers", "labels", "images"),
        "LPS",
        ("mm",),
        types=(*_ALL, "b1", "f2"),
        library=("highdicom", "highdicom"),
        extra="dicom-seg",
    ),
    FileTarget("NumPy", (".npy",), "formats.write_npy", ("color", "vectors"), types=(*_ALL, "b1", "f2", "f16")),
)


def targets() -> Iterator[FileTarget]:
    """TARGETS, and then those of other packages."""
    yield from TARGETS
    yield from load_plugins("writers", FileTarget)


def find_target(path: Path) -> FileTarget:
    """The format of a path to write. Raises InputError, before any work, for another name, a missing folder or library,
    and a place that cannot be written.
    """
    low = path.name.lower()
    of_name = (target for target in targets() if low.endswith(target.suffixes))
    target = next(of_name, None)
    if target is None:
        known = ", ".join(suffix for target in targets() for suffix in target.suffixes)
        raise expected(path, f"a name that ends in one of {known}", repr("".join(path.suffixes[-2:])))
    if not path.parent.is_dir() and not os.path.lexists(path.parent):
        raise expected(path, "a folder that is there", f"none named {path.parent}", "make it first")
    if target.is_folder and os.path.lexists(path):
        raise expected(path, "a name that is free", "one that is there", "remove it first")
    check_output(path, (path.suffix.lower(),))
    if target.library:
        import_extra(target.library[0], f"{target.title} files", target.library[1], target.extra)
    return target


@dataclass(frozen=True, eq=False)
class Content:
    """Content to write: the first time point, prepared for the format; the number of them, and a function that opens
    one. dtype: as written. images: those that labels were drawn on. notes: on what is lost, to which a writer may add.
    """

    volume: Volume
    target: FileTarget
    count: int
    open: Callable[[int], Volume]
    dtype: np.dtype
    images: Path | None = None
    notes: list[str] = field(default_factory=list)

    @property
    def components(self) -> int:
        """Numbers of a voxel: 3 of a colour or vector, else one for each channel."""
        return 3 if self.kind in ("color", "vectors") else max(len(self.volume.channels), 1)

    @cached_property
    def kind(self) -> str:
        """Kind of the numbers of a voxel: "color", "vectors", "channels", or "samples"."""
        if len(self.volume.channels) > 1:
            return "channels"
        if self.volume.color is not None and "color" in self.target.holds:
            return "color"
        return "vectors" if "vectors" in self.target.holds and _has_lengths(self.volume) else "samples"

    def slabs(self) -> Iterator[np.ndarray]:
        """Slabs [d, H, W, components] of all time points in order, each of about SLAB_BYTES."""
        for number in range(self.count):
            yield from self.slabs_of(self.arrays(number))

    def slabs_of(self, arrays: Sequence[Any]) -> Iterator[np.ndarray]:
        """Slabs [d, H, W, components] of the arrays of a time point."""
        depth, height, width = arrays[0].shape[:3]
        planes = max(1, SLAB_BYTES // (height * width * self.components * self.dtype.itemsize))
        for start in range(0, depth, planes):
            yield self.box(arrays, slice(start, start + planes))

    def arrays(self, time: int) -> list[Any]:
        """The arrays of a time point: one for each channel, else that of the colours, vectors or samples."""
        volume = self.volume if time == 0 else self.open(time)
        if volume.shape != self.volume.shape:
            raise expected("time points", f"the shape of the first, {self.volume.shape}", volume.shape)
        if self.kind in ("color", "vectors"):
            return [getattr(volume, self.kind)]
        return [part.samples for part in volume.channels or (volume,)]

    def box(self, arrays: Sequence[Any], box: Any) -> np.ndarray:
        """A box of arrays as numbers [d, H, W, components] of the written type."""
        parts = [np.asarray(array[box]) for array in arrays]
        joined = parts[0] if parts[0].ndim == 4 else np.stack(parts, axis=-1)
        return np.ascontiguousarray(joined, self.dtype)


def save(
    volume: Volume,
    path: str | Path,
    count: int = 1,
    open_time: Callable[[int], Volume] | None = None,
    images: str | Path | None = None,
) -> tuple[str, ...]:
    """Writes a volume, or nothing, and returns a line for everything that the format cannot store.

    count, open_time: the number of time points, and a function that opens one; the volume is the first of them. images:
    file or folder of the DICOM images that labels were drawn on, for .dcm. Large samples are read in slabs. Raises
    InputError for several channels where a format holds one, and for numbers that it cannot hold exactly.
    """
    path = Path(path)
    target = find_target(path)
    if images is not None and "images" not in target.holds:
        raise expected("images", f"no value for a {target.title} file", images)
    content = _prepare(volume, target, count, open_time)
    content, notes = replace(content, images=None if images is None else Path(images)), content.notes
    write = find_function(target.writer, __name__)
    with ExitStack() as stack:
        table = content.volume.labels if "labels" not in target.holds else None
        if table and content.dtype.kind in "iu":
            # left first, and so put in its place last: it is nothing without the volume
            beside = path.with_name(_stem(path, target) + ".label")
            stack.enter_context(atomic_write(beside)).write_text(label_table(table), encoding="utf-8")
            notes.append(f"names and colours of labels are in {beside.name}")
        elif not content.volume.labels and content.dtype.kind in "iu":
            tables = list_label_tables(path.parent, _stem(path, target))
            notes += [f"{file.name} names numbers of {path.name}: remove it if it is of another" for file in tables[:1]]
        write(stack.enter_context((atomic_folder if target.is_folder else atomic_write)(path)), content)
    return tuple(notes)


def _stem(path: Path, target: FileTarget) -> str:
    """The name up to the suffix by which a reader finds a table of labels; .ome stays."""
    suffix = next(suffix for suffix in target.suffixes if path.name.lower().endswith(suffix))
    return path.name[: -len(suffix.removeprefix(".ome"))]


def _prepare(volume: Volume, target: FileTarget, count: int, open_time: Callable[[int], Volume] | None) -> Content:
    """The content of a file."""
    holds, channels = target.holds, volume.channels or (volume,)
    if volume.points is not None:
        raise expected(volume.name or "volume", "voxels", f"{len(volume.points):,} points", "nothing grids points")
    if count > 1 and "times" not in holds:
        raise expected("time points", f"one in a {target.title} file", count, "pick one with time=0")
    are_layers = "layers" in holds and all(channel.labels is not None for channel in channels)
    if len(channels) > 1 and "channels" not in holds and not are_layers:
        names = ", ".join(channel.name for channel in channels[:8])
        others = ".nrrd" if all(channel.labels is not None for channel in channels) else ".ome.tif or .ome.zarr"
        fix = f"pick one with channel=0 … channel={len(channels) - 1}, or write {others}"
        raise expected("channels", f"one in a {target.title} file", f"{len(channels)} ({names})", fix)
    unit, factor = _stated_unit(volume.unit, target.units)

    def place(part: Volume) -> Volume:
        """The time point in the format's frame and unit, its colours as channels where it has no others."""
        part = part.placed(target.frame) if target.frame else part
        if part.color is not None and "color" not in holds and "channels" in holds and not part.channels:
            part = replace(part, channels=_color_channels(part))
        if factor == 1.0:
            return replace(part, unit=unit)
        spacing, origin = (np.multiply(numbers, factor) for numbers in (part.spacing, part.origin))
        return replace(part, unit=unit, spacing=triple(spacing, "spacing"), origin=triple(origin, "origin"))

    first = place(volume)
    content = Content(first, target, count, lambda n: place(open_time(n)) if open_time else first, np.dtype("f4"))
    notes = content.notes
    notes += _lost(volume, target, content.kind)
    if (unit, factor) != (volume.unit, 1.0):
        notes.append(f"unit: {volume.unit} is written as {unit or 'none'}, as {target.title} has no other")
    if content.kind == "color":
        return replace(content, dtype=np.dtype(np.uint8))
    if content.kind == "vectors":
        return content
    stored = np.result_type(*(part.samples.dtype for part in first.channels or (first,)))
    dtype = _stored_type(content, stored)
    if dtype.kind != stored.kind or dtype.itemsize != stored.itemsize:
        notes.append(f"samples: {stored.name} is written as {dtype.name}, as {target.title} has no other")
    return replace(content, dtype=dtype)


def _lost(volume: Volume, target: FileTarget, kind: str) -> list[str]:
    """A line for each property that the format cannot hold."""
    notes, holds = [], set(target.holds)
    is_turned = not np.allclose(volume.direction, np.eye(3), atol=1e-6)
    is_lost = {
        "spacing": volume.spacing != (1.0, 1.0, 1.0) or bool(volume.unit),
        "origin": any(volume.origin),
        "direction": is_turned or volume.frame is not None,
        "color": volume.color is not None and kind != "color" and "channels" not in holds,
        "vectors": volume.vectors is not None and kind != "vectors",
        "value unit": bool(volume.value_unit),
    }
    names = {"color": "colours", "vectors": "vectors in addition to samples", "direction": "orientation"}
    names["value unit"] = "unit of values"
    lost = [names.get(name, name) for name, gone in is_lost.items() if gone and name not in holds - {"vectors"}]
    if lost:
        notes.append(f"{target.title} holds no {', '.join(lost)}")
    is_placed = is_turned or any(volume.origin)
    if target.frame and volume.frame is None and is_placed:
        notes.append(f"the frame is unknown, and {target.title} has only {target.frame}: it is read as that")
    planes = _some_planes(volume, volume.color) if volume.color is not None and holds & {"color", "channels"} else ()
    if not all(np.array_equal(luma(color), samples) for samples, color in planes):
        notes.append("samples are not written where there are colours")
    if target.title == "OME-Zarr" and is_lost["direction"]:
        notes.append("orientation: OME-Zarr has none, splatgl alone reads what is written")
    return notes


def _has_lengths(volume: Volume) -> bool:
    """Whether a volume has vectors whose lengths are its samples, by a few planes."""
    planes = [] if volume.vectors is None else _some_planes(volume, volume.vectors)
    pairs = [(np.linalg.norm(vectors, axis=-1), samples) for samples, vectors in planes]
    return bool(pairs) and all(np.allclose(length, samples, equal_nan=True) for length, samples in pairs)


def _some_planes(volume: Volume, array: Any) -> list[tuple[np.ndarray, np.ndarray]]:
    """Samples and another array of at most eight planes."""
    places = range(0, volume.shape[0], -(-volume.shape[0] // 8))
    return [(np.asarray(volume.samples[z : z + 1]), np.asarray(array[z : z + 1])) for z in places]


def _color_channels(volume: Volume) -> tuple[Volume, ...]:
    """Red, green and blue of a volume's colours, as channels."""
    plain = replace(volume, color=None, vectors=None, channels=(), coarser=(), labels=None)
    rows = (("red", "#ff0000"), ("green", "#00ff00"), ("blue", "#0000ff"))
    return tuple(
        replace(
            plain,
            samples=ConvertedArray(volume.color, volume.shape, np.dtype(np.uint8), itemgetter((..., n))),
            name=name,
            hints=replace(volume.hints, color=color, window=(0.0, 255.0)),
        )
        for n, (name, color) in enumerate(rows)
    )


def _stated_unit(unit: str, units: Sequence[str]) -> tuple[str, float]:
    """The unit that is written, and the factor to it: the nearest smaller of `units`, "" for an unknown one."""
    if not units or unit in units or not unit:
        return unit, 1.0
    if unit not in METRES:
        return "", 1.0
    smaller = [name for name in units if METRES[name] <= METRES[unit]]
    taken = max(smaller, key=METRES.__getitem__) if smaller else min(units, key=METRES.__getitem__)
    return taken, METRES[unit] / METRES[taken]


def _stored_type(content: Content, stored: np.dtype) -> np.dtype:
    """The type, little-endian, that holds all samples exactly. Raises InputError if the format has none."""
    codes, kind, size = content.target.types, stored.kind, stored.itemsize
    if f"{kind}{size}" in codes:
        # by its code: NumPy has two types of 64 bits, and Zarr knows one
        return np.dtype(f"<{kind}{size}")
    if kind == "b":
        return np.dtype(np.uint8)
    if kind == "f":
        larger = [code for code in codes if code[0] == "f" and int(code[1:]) >= size]
        return np.dtype(f"<{(larger or ['f8'])[0]}")
    low, high = 0, 0
    for slab in replace(content, dtype=stored).slabs():
        low, high = min(low, int(slab.min())), max(high, int(slab.max()))
    for code in codes:
        if code[0] in "iu" and np.iinfo(code).min <= low and high <= np.iinfo(code).max and int(code[1]) >= 4:
            return np.dtype(f"<{code}")
    if max(-low, high) > EXACT:
        got = f"numbers from {low} to {high}"
        raise expected("samples", f"numbers that {content.target.title} holds exactly", got, "write .nrrd or .npy")
    return np.dtype("<f8")


def label_table(labels: Sequence[Label]) -> str:
    """ITK-SNAP's table of labels, as `load_label_table` reads it."""
    lines = ["#" * 48, f"# {MARK}", "# IDX -R- -G- -B- -A- VIS MSH LABEL", "#" * 48]
    for label, color in zip(labels, label_colors(labels), strict=True):
        rgb = " ".join(str(int(color[n : n + 2], 16)) for n in (1, 3, 5))
        name = re.sub(r'["\r\n]', " ", label.name)
        lines.append(f'{label.number} {rgb} {label.opacity:g} {int(not label.hidden)} 1 "{name}"')
    return "\n".join(lines) + "\n"


def label_colors(labels: Sequence[Label]) -> list[str]:
    """Colours "#rrggbb" of labels; the default ones where they have none."""
    defaults = colors_of([label.number or 1 for label in labels]) if labels else []
    return [label.color or default for label, default in zip(labels, defaults, strict=True)]

"""HDF5 files: opened safely, and their datasets read in parts.

Only filters that h5py or hdf5plugin have are run; a chunk that states a larger size than it can have is refused.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from importlib import import_module
from itertools import product
from pathlib import Path
from typing import Any, Literal

import numpy as np

from splatgl.data.arrays import of_array
from splatgl.data.volume import ArrayOptions, Volume
from splatgl.errors import InputError, expected, import_extra
from splatgl.fileio import WHOLE_BYTES, byte_count, decode_text, held_within_budget
from splatgl.readers.chunked import Chunked, Stored
from splatgl.readers.common import (
    DEFLATE_RATIO,
    MAX_BYTES,
    decoder_errors,
    inflated_size,
    map_array,
    require_bytes,
    require_plausible,
)
from splatgl.readers.elsewhere import look

# most objects that are visited, soft links to one object, and numbers of an attribute or a dimension scale
_MOST_OBJECTS, _MOST_LINKS, MOST_VALUES = 10_000, 32, 2**20
# the function that first reads a file, and its seconds of processor time: ten thousand objects take about one
_LOOK, _LOOK_SECONDS = "hdf5_files.read_metadata", 3.0
# attributes that the readers read by name, even if the list of all attributes is damaged
_ATTRIBUTES = (
    *("DIMENSION_LABELS", "DIMENSION_LIST", "axistags", "scale_factor", "add_offset", "_FillValue", "missing_value"),
    *("element_size_um", "spacing", "Spacing", "voxel_size", "voxelSize", "VoxelSize", "voxelsize", "pixel_size"),
    *("pixelSize", "resolution", "Resolution", "unit", "units", "positive", "standard_name", "coordinates", "axis"),
    *("NAME", "Name", "Color", "ColorRange", "Unit", "long_name"),
    *(f"{name}{axis}" for name in ("ExtMin", "ExtMax") for axis in range(3)),
    *(f"ImageSize{axis}" for axis in "XYZ"),
)


def open_hdf5(path: Path) -> Any:
    """The file in h5py, for reading."""
    h5py = import_extra("h5py", "HDF5 files", "h5py", "readers")
    probe(path)
    with decoder_errors("HDF5"):
        return h5py.File(path, "r", locking=False)


def probe(path: Path) -> None:
    """Raises InputError if the C library of HDF5 or NetCDF crashes or loops on the file, which is tried elsewhere."""
    look(_LOOK, path, _LOOK_SECONDS)


def read_metadata(path: Path) -> None:
    """Reads the metadata of an HDF5 file, or of a classic NetCDF file, of whose variables also a number."""
    with path.open("rb") as file:
        is_classic = file.read(3) == b"CDF"
    if not is_classic:
        import h5py

        # exceptions are left to the reader
        with suppress(Exception), h5py.File(path, "r", locking=False) as opened:
            opened.visititems(read_node)
        return
    netcdf = import_extra("netCDF4", "NetCDF-3 files", "netCDF4", "netcdf")
    # without the limit of memory, the reader would try for long
    with decoder_errors("NetCDF"):
        opened = netcdf.Dataset(path)
    opened.set_auto_maskandscale(False)
    with suppress(Exception):
        for owner in (opened, *opened.variables.values()):
            for name in owner.ncattrs():
                str(owner.getncattr(name))
        for variable in opened.variables.values():
            if variable.size:
                str(variable[(-1,) * variable.ndim])


def read_node(_name: str, node: Any) -> None:
    """Reads the attributes of a group or dataset, and a dataset's fill value and chunk information."""
    try:
        names = list(node.attrs)
    except Exception:
        # their list is damaged
        names = list(_ATTRIBUTES)
    for name in names:
        with suppress(Exception):
            if node.attrs.get_id(name).get_storage_size() < 1 << 20:
                str(node.attrs[name])
    if hasattr(type(node), "fillvalue"):
        with suppress(Exception):
            str(node.fillvalue)
        with suppress(Exception):
            if node.chunks is not None and node.size and not node.is_virtual and not node.external:
                node.id.get_storage_size()
                node.id.get_chunk_info_by_coord((0,) * len(node.chunks))


def find_datasets(file: Any) -> dict[str, Any]:
    """All datasets of the file itself by name. Raises InputError for very many objects."""
    import h5py

    nodes, visited = dict[str, Any](), 0

    def look(name: str, node: Any) -> None:
        nonlocal visited
        visited += 1
        if visited > _MOST_OBJECTS:
            raise expected("file", f"at most {_MOST_OBJECTS} groups and datasets", "more", "name one by array=/…")
        if isinstance(node, h5py.Dataset):
            nodes["/" + name] = node

    file.visititems(look)
    return nodes


def find_node(file: Any, name: str, anywhere: bool) -> Any:
    """The group or dataset of that name, None without one. Raises InputError for another file's, if not `anywhere`."""
    import h5py

    node, parts, links = file, [part for part in name.split("/") if part not in ("", ".")], 0
    while parts:
        if not isinstance(node, h5py.Group):
            return None
        part = parts.pop(0)
        link = node.get(part, getlink=True)
        if isinstance(link, h5py.ExternalLink) and not anywhere:
            raise external_error(name, link.filename)
        if isinstance(link, h5py.SoftLink):
            links += 1
            if links > _MOST_LINKS:
                raise expected(name, f"at most {_MOST_LINKS} links that lead there", "more")
            node = file if link.path.startswith("/") else node
            parts = [step for step in link.path.split("/") if step not in ("", ".")] + parts
            continue
        node = node.get(part)
    return node


def _read_attribute(node: Any, name: str) -> np.ndarray:
    """An attribute's values, flat; [] without any. Raises InputError for very many."""
    if name not in node.attrs:
        return np.zeros(0, "S1")
    attribute = node.attrs.get_id(name)
    if math.prod(attribute.shape or ()) > MOST_VALUES:
        raise expected(name, f"at most {MOST_VALUES} values", attribute.shape)
    return np.asarray(node.attrs[name]).ravel()


def attribute_numbers(node: Any, name: str) -> np.ndarray | None:
    """An attribute's real numbers, also from text, flat; None without numbers."""
    if name not in node.attrs:
        return None
    values = _read_attribute(node, name)
    if values.dtype.kind in "buif":
        return values.astype(np.float64)
    try:
        return np.array(attribute_text(node, name).replace(",", " ").split(), np.float64)
    except ValueError:
        return None


def dimension_scales(dataset: Any) -> list[Any]:
    """The first dimension scale of each axis, None for an axis without one; [] if no axis has one.

    Read from the attribute that names them: HDF5's own functions loop on damaged ones.
    """
    import h5py

    if "DIMENSION_LIST" not in dataset.attrs or dataset.attrs.get_id("DIMENSION_LIST").shape != (len(dataset.shape),):
        return []
    references = [np.asarray(entry).ravel() for entry in dataset.attrs["DIMENSION_LIST"]]
    nodes = [
        dataset.file[reference[0]] if reference.size and isinstance(reference[0], h5py.Reference) else None
        for reference in references
    ]
    return [node if isinstance(node, h5py.Dataset) else None for node in nodes]


def attribute_texts(node: Any, name: str) -> list[str]:
    """An attribute's texts, [] without any."""
    values = _read_attribute(node, name).tolist()
    # h5py returns text that is no UTF-8 with surrogates
    raw = [value if isinstance(value, bytes) else str(value).encode(errors="surrogateescape") for value in values]
    return [decode_text(entry) for entry in raw]


def attribute_text(node: Any, name: str) -> str:
    """An attribute's text, also from an array of letters; "" without one."""
    return "".join(attribute_texts(node, name))


def has_numbers(dataset: Any, kinds: str = "buifcV") -> bool:
    """Whether a dataset has numbers of these kinds, of a type that numpy knows; MATLAB writes complex ones (V) as pairs
    named real and imag.
    """
    try:
        dtype = dataset.dtype
        pairs = dtype.names == ("real", "imag") and {dtype[n].kind for n in (0, 1)} <= set("iuf")
        return dataset.shape is not None and dtype.kind in kinds and (pairs or dtype.kind != "V")
    except (TypeError, ValueError, RuntimeError, OverflowError):
        return False


def external_error(name: str, where: str) -> InputError:
    """The error for data of `name` that are in another file, `where`."""
    fix = "copy it there with h5repack, or say --anywhere if you trust it"
    return expected(name, "data in this file", f"data elsewhere ({where})", fix)


def check_group(file: Any, name: str, anywhere: bool) -> None:
    """Raises InputError for a group that another library must not read: data in other files, if not `anywhere`, or of
    implausible sizes, or filters with unbounded results.
    """
    import h5py

    def look(below: str, link: Any) -> None:
        if isinstance(link, h5py.ExternalLink) and not anywhere:
            raise external_error(f"{name}/{below}", link.filename)

    file[name].visititems_links(look)
    for dataset in find_datasets(file).values():
        _check_storage(dataset, anywhere)
        if not (dataset.external or dataset.is_virtual):
            needed = byte_count(dataset.shape or (), dataset.dtype)
            require_plausible(needed, dataset.id.get_storage_size(), bounded=False)


# filters by number that come with h5py; those of hdf5plugin, and others that have a name
_FILTERS = {1: "gzip", 2: "shuffle", 3: "fletcher32", 4: "szip", 6: "scaleoffset", 32000: "lzf"}
_PLUGINS = {
    **{307: "bzip2", 32001: "blosc", 32004: "lz4", 32008: "bitshuffle", 32013: "zfp", 32015: "zstd", 32017: "sz"},
    **{32018: "fcidecomp", 32024: "sz3", 32026: "blosc2", 32028: "sperr", 32033: "htj2k"},
}
_NAMES = _FILTERS | _PLUGINS | {5: "nbit", 305: "lzo", 32014: "fpzip", 32016: "b3d", 32019: "jpeg"}
_GZIP, _FLETCHER32, _SCALEOFFSET = 1, 3, 6
# of filters that allocate what a chunk's first bytes state: the place of that size, and its byte order
_STATED: dict[int, tuple[slice, Literal["little", "big"]]] = {
    4: (slice(0, 4), "little"),
    32001: (slice(4, 8), "little"),
    **dict.fromkeys((32004, 32008), (slice(0, 8), "big")),
}

# values, float32, of stored numbers
Unpack = Callable[[np.ndarray], np.ndarray]

# least bytes that are read together, if the file's chunks are smaller
_PART_BYTES = 2**20


def read_samples(
    path: Path, dataset: Any, index: Sequence[int | slice], anywhere: bool, values_of: Unpack | None = None
) -> np.ndarray | Chunked:
    """The part `index` of a dataset, as [D, H, W]: mapped, read, or from WHOLE_BYTES on read in parts.

    Slices of the index begin at 0. values_of: of stored numbers, float32; None: these are the values. Raises InputError
    for data that must not be decoded.
    """
    is_hdf5 = hasattr(dataset, "id")
    if is_hdf5:
        _check_storage(dataset, anywhere)
    if is_hdf5 and anywhere:
        # links may lead to another file
        path = Path(dataset.file.filename)
    offset = dataset.id.get_offset() if is_hdf5 and not (dataset.external or dataset.chunks) else None
    if offset is not None and values_of is None:
        return map_array(path, int(offset), dataset.dtype, dataset.shape)[tuple(index)]
    part = _ArraySource(path, dataset, index, values_of)
    if byte_count(part.free, part.dtype) > held_within_budget(WHOLE_BYTES):
        return Chunked(str(path), part, part.index, part, part.form)
    if is_hdf5 and not anywhere:
        require_plausible(byte_count(part.free, dataset.dtype), dataset.id.get_storage_size(), bounded=False)
    return part[part.index]


def _check_storage(dataset: Any, anywhere: bool) -> None:
    """Raises InputError for data in other files, for filters with unbounded results, and for very large chunks."""
    if not anywhere and (dataset.external or dataset.is_virtual):
        raise external_error(dataset.name, dataset.external[0][0] if dataset.external else "a virtual dataset")
    _check_filters(dataset)
    chunk = byte_count(dataset.chunks or (), dataset.dtype)
    if chunk > MAX_BYTES:
        fix = "repack it with smaller ones: h5repack -l CHUNK=64x64x64 OLD NEW"
        raise expected("chunks", f"at most {MAX_BYTES} bytes each", chunk, fix)


def _filters(dataset: Any) -> list[tuple[int, tuple[int, ...], str]]:
    """Number, parameters and name of each filter of a dataset, in the order in which they were applied."""
    stated = dataset.id.get_create_plist()
    filters = [stated.get_filter(number) for number in range(stated.get_nfilters())]
    return [
        (code, values, _NAMES.get(code) or "".join(filter(str.isprintable, decode_text(name)))[:40])
        for code, _, values, name in filters
    ]


def _check_filters(dataset: Any) -> None:
    """Raises InputError for filters that are not installed, or whose results are not bounded."""
    filters = _filters(dataset)
    codes = [code for code, _, _ in filters]
    if any(code in _PLUGINS for code in codes):
        # it registers its filters when it is imported
        with suppress(ImportError):
            import_module("hdf5plugin")
    missing = [f"{name} ({code})".strip() for code, _, name in filters if not _is_available(code)]
    if missing or max(map(codes.count, codes), default=1) > 1:
        known = ", ".join(name for code, name in _FILTERS.items() if _is_available(code))
        can = any(code in _PLUGINS for code in codes if not _is_available(code))
        fix = "install hdf5plugin: pip install 'splatgl[hdf5-filters]'; or " * can
        got = ", ".join(missing) or "one of them twice"
        raise expected("filters", known, got, f"{fix}repack it with: h5repack -f GZIP=4 OLD NEW")
    for code, values, _ in filters:
        # numbers and bytes of a chunk, which it allocates
        size = (math.prod(dataset.chunks or ()), dataset.dtype.itemsize)
        if code == _SCALEOFFSET and (len(values) < 5 or (values[2], values[4]) != size):
            raise expected("scaleoffset", "the chunk's size", values[2:5], "the file is damaged")


def of_dataset(x: Any, options: ArrayOptions) -> Volume:
    """The volume of a dataset of h5py. Raises InputError as `read_samples` for filters that are not installed."""
    if hasattr(x, "chunks"):
        _check_filters(x)
    return of_array(x, options)


def _is_available(code: int) -> bool:
    """Whether a known filter is there."""
    import h5py

    return (code in _FILTERS or code in _PLUGINS) and bool(h5py.h5z.filter_avail(code))


class _ArraySource(Stored):
    """An array with h5py's names for `Chunked`, and its file. Chunks of HDF5 are checked before HDF5 decodes them."""

    def __init__(self, path: Path, dataset: Any, index: Sequence[int | slice], values_of: Unpack | None) -> None:
        self.path, self.dataset, self.index, self.values_of = path.resolve(), dataset, tuple(index), values_of
        ends = zip(self.index, dataset.shape, strict=True)
        self.shape = tuple(size if isinstance(at, int) or at.stop is None else at.stop for at, size in ends)
        self.free = [size for size, at in zip(self.shape, self.index, strict=True) if isinstance(at, slice)]
        self.dtype = np.dtype(np.float32) if values_of else np.dtype(dataset.dtype)
        self.stored = tuple(dataset.chunks or ())
        self.chunks = self._joined()
        self.fill_value, self.empty, self.checked = 0, False, False
        self.form = "HDF5" if hasattr(dataset, "id") else "NetCDF"
        if self.form != "HDF5":
            return
        self.empty = not dataset.is_virtual and not dataset.external and not dataset.id.get_storage_size()
        codes = [code for code, _, _ in _filters(dataset) if code != _FLETCHER32]
        # the filter that was applied last, whose result is stored
        self.last, self.number = (codes[-1], len(codes) - 1) if codes else (0, 0)
        self.checked = self.last == _GZIP or self.last in _STATED
        with decoder_errors("HDF5"):
            self.fill_value = self._values(np.asarray(dataset.fillvalue)[None])[0]

    def _joined(self) -> tuple[int, ...]:
        """Samples along each axis that are read together: one chunk of the file, or several small ones."""
        sizes = list(self.stored or (1,) * len(self.shape))
        while byte_count(sizes, self.dtype) <= _PART_BYTES // 2:
            short = [
                axis for axis, at in enumerate(self.index) if isinstance(at, slice) and sizes[axis] < self.shape[axis]
            ]
            if not short:
                break
            # the shortest axis; of equal ones the faster one in the file
            axis = min(short, key=lambda axis: (sizes[axis], -axis))
            sizes[axis] *= 2
        return tuple(sizes)

    def _values(self, stored: np.ndarray) -> np.ndarray:
        return stored if self.values_of is None else self.values_of(stored)

    def tag(self) -> str:
        """The path, size and time of the file, and the dataset in it."""
        return f"{super().tag()} {self.dataset.name}"

    def __getitem__(self, key: tuple[int | slice, ...]) -> np.ndarray:
        with decoder_errors(self.form):
            for place in self._touched(key) if self.checked else ():
                self._check_chunk(place)
            return self._values(np.asarray(self.dataset[key]))

    def _touched(self, key: tuple[int | slice, ...]) -> Iterable[tuple[int, ...]]:
        """Index of the first sample of each chunk of the file that is to be read."""
        ends = [(at, at + 1) if isinstance(at, int) else (at.start or 0, at.stop) for at in key]
        return product(
            *(
                range(low - low % step, size if high is None else high, step)
                for (low, high), size, step in zip(ends, self.shape, self.stored, strict=True)
            )
        )

    def _check_chunk(self, place: tuple[int, ...]) -> None:
        """Raises InputError if the chunk expands beyond its size."""
        chunk = self.dataset.id.get_chunk_info_by_coord(place)
        if chunk.byte_offset is None or (self.last == _GZIP and chunk.size * DEFLATE_RATIO <= MAX_BYTES):
            return
        require_bytes(chunk.size, self.path.stat().st_size)
        room = byte_count(self.stored, self.dataset.dtype)
        skipped, data = self.dataset.id.read_direct_chunk(place)
        if self.last == _GZIP:
            size = inflated_size(io.BytesIO(data), room)
        else:
            where, order = _STATED[self.last]
            size = 0 if skipped >> self.number & 1 else int.from_bytes(data[where], order)
        if size > room:
            raise expected("chunk", f"{room} bytes", "more", "the file is damaged")

    def holds(self, place: Sequence[int]) -> bool:
        """Whether the file may store the samples that are read together there."""
        if self.empty or self.chunks != self.stored or self.form != "HDF5":
            return not self.empty
        begin = tuple(at - at % size for at, size in zip(place, self.stored, strict=True))
        return self.dataset.id.get_chunk_info_by_coord(begin).byte_offset is not None

"""HDF5 files: opens them after a probe in another process, and finds their datasets and attributes."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.errors import InputError, expected, import_extra
from splatgl.fileio import decode_text
from splatgl.readers.common import decoder_errors, run_elsewhere

# most objects that are visited, soft links to one object, and numbers of an attribute or a dimension scale
_MOST_OBJECTS, _MOST_LINKS, MOST_VALUES = 10_000, 32, 2**20
_PROBE = Path(__file__).with_name("hdf5_probe.py")
# seconds until the probe of a file is ended, which limits its processor time itself where the system can
_PROBE_TIMEOUT = 60.0
# whether the library fails on a file: by path, bytes, time
_FAILED: dict[tuple[str, int, int], bool] = {}


def open_hdf5(path: Path) -> Any:
    """The file in h5py, for reading."""
    h5py = import_extra("h5py", "HDF5 files", "h5py", "readers")
    probe(path)
    with decoder_errors("HDF5"):
        return h5py.File(path, "r", locking=False)


def probe(path: Path) -> None:
    """Raises InputError if the C library of HDF5 or NetCDF crashes or loops on the file; tried in another process, once
    per file.
    """
    status = path.stat()
    key = (str(path.resolve()), status.st_size, status.st_mtime_ns)
    if key not in _FAILED:
        _FAILED[key] = run_elsewhere([str(_PROBE), str(path)], _PROBE_TIMEOUT) is not True
    if _FAILED[key]:
        raise InputError("cannot be read: the format's library fails on the file, which may be damaged")


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


def has_real_numbers(dataset: Any) -> bool:
    """Whether a dataset has real numbers, of a type that numpy knows."""
    try:
        return dataset.dtype.kind in "buif" and dataset.shape is not None
    except (TypeError, ValueError, RuntimeError, OverflowError):
        return False


def has_numbers(dataset: Any) -> bool:
    """Whether a dataset has real or complex numbers; MATLAB writes complex ones as pairs named real and imag."""
    try:
        pairs = dataset.dtype.names == ("real", "imag") and {dataset.dtype[n].kind for n in (0, 1)} <= set("iuf")
        return has_real_numbers(dataset) or ((pairs or dataset.dtype.kind == "c") and dataset.shape is not None)
    except (TypeError, ValueError, RuntimeError, OverflowError):
        return False


def external_error(name: str, where: str) -> InputError:
    """The error for data of `name` that are in another file, `where`."""
    fix = "copy it there with h5repack, or say --anywhere if you trust it"
    return expected(name, "data in this file", f"data elsewhere ({where})", fix)

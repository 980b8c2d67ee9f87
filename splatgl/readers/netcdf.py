"""Classic NetCDF files (NetCDF-3: CDF-1, CDF-2 and CDF-5) through netCDF4; axes and packing as in `hdf5`.

Format: "NetCDF classic file format specifications", docs.unidata.ucar.edu. The library reads zeros beyond the end of a
file that is cut short, so sizes are checked first.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.data.volume import Volume
from splatgl.errors import import_extra
from splatgl.readers.common import decoder_errors, require_bytes
from splatgl.readers.hdf5 import array_error, choose_dataset, describe_datasets, read_dataset
from splatgl.readers.hdf5_files import has_numbers, probe
from splatgl.readers.hdf5_layouts import Scale
from splatgl.readers.options import LoadOptions

# first bytes of the three versions
STARTS = (b"CDF\x01", b"CDF\x02", b"CDF\x05")


def read(path: Path, options: LoadOptions) -> Volume:
    """The volume of a variable: `array` names it, else it is the only one that may be a volume; options as in HDF5."""
    with decoder_errors("NetCDF"):
        variables = _open(path)
        if options.array is None:
            variable, _ = choose_dataset(variables)
        else:
            variable = variables.get("/" + str(options.array).strip("/"))
            if variable is None or not has_numbers(variable):
                raise array_error(variables, variable, options)
        return read_dataset(path, variable, options)


def list_variables(path: Path) -> list[str]:
    """A line per variable, as `hdf5.list_datasets`."""
    with decoder_errors("NetCDF"):
        return describe_datasets(_open(path))


class _Attributes(dict[str, Any]):
    """Attributes with the method by which h5py's are asked for their shape."""

    def get_id(self, name: str) -> np.ndarray:
        return np.asarray(self[name])


class _Variable:
    """A variable with h5py's names for a dataset; scales: the coordinates of each axis, None without any."""

    chunks = None

    def __init__(self, variable: Any) -> None:
        self.variable, self.name, self.shape = variable, f"/{variable.name}", tuple(map(int, variable.shape))
        self.dtype = np.dtype(variable.dtype)
        self.attrs = _Attributes({name: variable.getncattr(name) for name in variable.ncattrs()})
        self.attrs["DIMENSION_LABELS"] = list(variable.dimensions)
        self.scales: list[Scale | None] = []

    def __getitem__(self, key: Any) -> np.ndarray:
        return np.asarray(self.variable[key])


def _open(path: Path) -> dict[str, Any]:
    """The variables of a file by name. Raises InputError for a file that is cut short."""
    netcdf = import_extra("netCDF4", "NetCDF-3 files", "netCDF4", "netcdf")
    probe(path)
    file = netcdf.Dataset(path, "r")
    # stored numbers, not masked or scaled ones
    file.set_auto_maskandscale(False)
    require_bytes(_least_bytes(file), path.stat().st_size)
    nodes = {name: _Variable(variable) for name, variable in file.variables.items()}
    for node in nodes.values():
        known = [nodes.get(name) for name in node.variable.dimensions]
        node.scales = [None if scale is None else Scale(scale, scale.name[1:]) for scale in known]
    return {node.name: node for node in nodes.values()}


def _least_bytes(file: Any) -> int:
    """Bytes that the header and the samples take at least, by the format's specification."""
    word = 8 if file.data_model == "NETCDF3_64BIT_DATA" else 4
    offset = 4 if file.data_model == "NETCDF3_CLASSIC" else 8
    size = 4 + word + 3 * (4 + word)
    size += sum(2 * word + _padded(len(name.encode())) for name in file.dimensions)
    size += _attribute_bytes(file, word)
    for name, variable in file.variables.items():
        size += 2 * word + _padded(len(name.encode())) + word * len(variable.dimensions)
        size += 4 + word + _attribute_bytes(variable, word) + 4 + word + offset
        size += math.prod(map(int, variable.shape)) * np.dtype(variable.dtype).itemsize
    return size


def _attribute_bytes(owner: Any, word: int) -> int:
    total = 0
    for name in owner.ncattrs():
        value = owner.getncattr(name)
        size = len(value.encode()) if isinstance(value, str) else np.asarray(value).nbytes
        total += 4 + 2 * word + _padded(len(name.encode())) + _padded(size)
    return total


def _padded(size: int) -> int:
    return -(-size // 4) * 4

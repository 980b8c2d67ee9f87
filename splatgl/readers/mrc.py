"""MRC and CCP4 maps (.mrc, .map, .rec, .ccp4); plain files are mapped, .gz and .bz2 inflated.

Format: Cheng et al., "MRC2014: Extensions to the MRC format header", J. Struct. Biol. 192 (2015), and CCP4's maplib.
The header's layout and types are mrcfile's. Columns run fastest; mapc, mapr, maps give the cell's axis of each.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from splatgl.data.affine import volume_on_grid
from splatgl.data.volume import Volume
from splatgl.errors import expected, import_extra
from splatgl.fileio import byte_count, require_memory
from splatgl.readers.channels import MAGNITUDE_NOTE, magnitudes
from splatgl.readers.common import (
    bunzip,
    decoder_errors,
    grid_shape,
    inflate,
    map_array,
    open_unpacked,
    packing_of,
    require_bytes,
)
from splatgl.readers.options import LoadOptions

# bytes of the header; an extended one of `nsymbt` bytes follows
_HEADER = 1024
# mark of IMOD, whose bytes (mode 0) are unsigned unless this flag is set (bio3d.colorado.edu/imod)
_IMOD, _IMOD_SIGNED = 1146047817, 1
# modes of real numbers; complex ones of two integers and of two floats; 101 has four bits a voxel
_REAL, _COMPLEX_INTEGERS, _COMPLEX = (0, 1, 2, 6, 12), 3, 4
_MODES = (*_REAL, _COMPLEX_INTEGERS, _COMPLEX)


def read(path: Path, options: LoadOptions) -> Volume:
    """The volume of an MRC file in ångström; `array` picks one of a stack of volumes."""
    header = _read_header(path)
    # 1. the samples, in the order of the file
    sizes = [int(header[name]) for name in ("nx", "ny", "nz")]
    columns = grid_shape(sizes)
    skip = int(header["nsymbt"])
    if skip < 0:
        raise expected("nsymbt", "zero or more bytes", skip, "the header is damaged")
    samples = _read_data(path, _HEADER + skip, _dtype(header), columns)
    # 2. one volume of a stack
    volumes = _count_volumes(header, columns[0])
    stack = samples.reshape(volumes, columns[0] // volumes, *columns[1:])
    samples = stack[options.index(stack.shape, {0: "array"})]
    pictures = int(header["ispg"]) == 0 and int(header["mz"]) == 1 and len(samples) > 1
    notes = ("the header states a stack of pictures, not of slices; it is rendered as slices",) * pictures
    if int(header["mode"]) not in _REAL:
        notes = (*notes, MAGNITUDE_NOTE)
        require_memory(byte_count(samples.shape, np.dtype(np.float32)), path.stat().st_size)
        samples = magnitudes(samples)
    # 3. axes: place[i] is the cell's axis (0 is x) of the file's axis i, columns first
    place = _axis_order(header)
    samples = samples.transpose([2 - place.index(axis) for axis in (2, 1, 0)])
    matrix, origin, unit = _grid(header, place)
    return volume_on_grid(samples, matrix, origin, "cell", unit=unit, notes=notes)


def _read_header(path: Path) -> Any:
    utils = import_extra("mrcfile.utils", "MRC files", "mrcfile", "readers")
    layout = import_extra("mrcfile.dtypes", "MRC files", "mrcfile", "readers").HEADER_DTYPE
    with decoder_errors("MRC"):
        with open_unpacked(path) as file:
            first = file.read(_HEADER)
        require_bytes(_HEADER, len(first), "header")
        header = np.frombuffer(first, layout)[0]
        try:
            order = utils.byte_order_from_machine_stamp(header["machst"])
        except ValueError:
            # old files have no stamp: take the order in which the mode is valid
            order = "<" if 0 <= header["mode"] < 2**16 else ">"
        header = np.frombuffer(first, layout.newbyteorder(order))[0]
    if int(header["mode"]) not in _MODES:
        known = ", ".join(map(str, sorted(_MODES)))
        raise expected("mode", f"one of {known}", int(header["mode"]), "is this an MRC file?")
    return header


def _dtype(header: Any) -> np.dtype:
    from mrcfile import utils

    if int(header["mode"]) == _COMPLEX_INTEGERS:
        part = header.dtype["nx"].byteorder + "i2"
        return np.dtype([("real", part), ("imag", part)])
    dtype = np.dtype(utils.dtype_from_mode(int(header["mode"])))
    mark, flags = np.frombuffer(header["extra2"].tobytes()[40:48], header.dtype["nx"])
    if dtype == np.int8 and mark == _IMOD and not flags & _IMOD_SIGNED:
        dtype = np.dtype(np.uint8)
    return dtype.newbyteorder(header.dtype["nx"].byteorder)


def _read_data(path: Path, start: int, dtype: np.dtype, shape: tuple[int, int, int]) -> np.ndarray:
    """The array [sections, rows, columns]."""
    needed, packing = start + byte_count(shape, dtype), packing_of(path)
    if not packing:
        return map_array(path, start, dtype, shape)
    data = (inflate if packing == "gzip" else bunzip)(path, 0, np.dtype(np.uint8), (needed,))
    return data[start:needed].view(dtype).reshape(shape)


def _count_volumes(header: Any, sections: int) -> int:
    """The number of volumes in the stack."""
    from mrcfile import utils

    planes = int(header["mz"])
    if not utils.spacegroup_is_volume_stack(header["ispg"]):
        return 1
    if planes < 1 or sections % planes:
        raise expected("mz", f"a divisor of the {sections} sections", planes, "the header is damaged")
    return sections // planes


def _axis_order(header: Any) -> list[int]:
    axes = [int(header[name]) - 1 for name in ("mapc", "mapr", "maps")]
    if axes == [-1, -1, -1]:
        return [0, 1, 2]
    if sorted(axes) != [0, 1, 2]:
        raise expected("mapc, mapr, maps", "1, 2 and 3 in any order", [axis + 1 for axis in axes])
    return axes


def _grid(header: Any, place: list[int]) -> tuple[np.ndarray, np.ndarray, str]:
    """World-from-index [3, 3], the position of the first sample, and the unit.

    The cell's edge a is along x, and b in the plane of x and y (International Tables for Crystallography B, section
    3.3.1). The origin is the header's, else the start of the grid in the cell.
    """
    cell = np.array([header["cella"][axis] for axis in "xyz"], np.float64)
    counts = np.array([header[name] for name in ("mx", "my", "mz")], np.float64)
    if not (np.isfinite(cell) & (cell > 0)).all() or counts.min() < 1:
        return np.eye(3), np.zeros(3), ""
    angles = np.array([header["cellb"][name] for name in ("alpha", "beta", "gamma")], np.float64)
    edges = _cell_edges(angles) * (cell / counts)
    origin = np.array([header["origin"][axis] for axis in "xyz"], np.float64)
    if not origin.any():
        starts = [int(header[name]) for name in ("nxstart", "nystart", "nzstart")]
        origin = edges @ [starts[place.index(axis)] for axis in range(3)]
    return edges, origin, "Å"


def _cell_edges(angles: np.ndarray) -> np.ndarray:
    """Directions of the cell's edges as columns [3, 3]; angles (alpha, beta, gamma) in degrees, 0 stands for 90."""
    if not np.isfinite(angles).all() or ((angles < 0) | (angles >= 180)).any():
        raise expected("cell", "angles from 0 to 180 degrees", angles.tolist(), "the header is damaged")
    right = np.where(angles == 0, 90.0, angles)
    # exact zeros for right angles
    cos = np.where(right == 90, 0.0, np.cos(np.deg2rad(right)))
    sin = np.sqrt(1 - cos[2] ** 2)
    lift = (cos[0] - cos[1] * cos[2]) / sin
    height = 1 - cos[1] ** 2 - lift**2
    if height <= 0:
        raise expected("cell", "angles that a cell can have", angles.tolist(), "the header is damaged")
    return np.array([[1, cos[2], cos[1]], [0, sin, lift], [0, 0, np.sqrt(height)]])

"""Script that reads metadata of a file in another process: C libraries of HDF5 and NetCDF fail on damaged ones."""

from __future__ import annotations

import ctypes
import sys
from contextlib import suppress
from typing import Any

try:
    import resource
except ImportError:
    # on Windows, the waiting process ends this one
    resource = None  # type: ignore[assignment]

# most seconds of processor time, bytes of memory, and bytes of a memory dump; ten thousand objects take about a second
LIMITS = {"RLIMIT_CPU": 3, "RLIMIT_AS": 16 << 30, "RLIMIT_CORE": 0}
# bytes of memory for a classic NetCDF file, whose header is small
CLASSIC_MEMORY = 2 << 30
# of SetErrorMode: no window tells of a crash
SILENT = 0x1 | 0x2
# printed before the file is opened: a later failure is the file's fault
STARTED = "looking"


# attributes that the readers read by name, even if the list of all attributes is damaged
ATTRIBUTES = (
    *("DIMENSION_LABELS", "DIMENSION_LIST", "axistags", "scale_factor", "add_offset", "_FillValue", "missing_value"),
    *("element_size_um", "spacing", "Spacing", "voxel_size", "voxelSize", "VoxelSize", "voxelsize", "pixel_size"),
    *("pixelSize", "resolution", "Resolution", "unit", "units", "positive", "standard_name", "coordinates", "axis"),
    *("NAME", "Name", "Color", "ColorRange", "Unit", "long_name"),
    *(f"{name}{axis}" for name in ("ExtMin", "ExtMax") for axis in range(3)),
    *(f"ImageSize{axis}" for axis in "XYZ"),
)


def read_node(_name: str, node: Any) -> None:
    """Reads the attributes of a group or dataset, and a dataset's fill value and chunk information."""
    try:
        names = list(node.attrs)
    except Exception:
        # their list is damaged
        names = list(ATTRIBUTES)
    for name in names:
        with suppress(Exception):
            if node.attrs.get_id(name).get_storage_size() < 1 << 20:
                str(node.attrs[name])
    if hasattr(type(node), "fillvalue"):
        with suppress(Exception):
            str(node.fillvalue)
        with suppress(Exception):
            chunk = node.chunks
            if chunk is not None and node.size and not node.is_virtual and not node.external:
                node.id.get_storage_size()
                node.id.get_chunk_info_by_coord((0,) * len(chunk))


def read_file(path: str) -> None:
    """Reads the metadata of an HDF5 file, or of a classic NetCDF file, of whose variables also a number."""
    with open(path, "rb") as file:
        classic = file.read(3) == b"CDF"
    if not classic:
        import h5py

        with h5py.File(path, "r", locking=False) as opened:
            opened.visititems(read_node)
        return
    import netCDF4

    if resource is not None:
        # a damaged count has the library allocate as much as it may
        with suppress(OSError, ValueError):
            resource.setrlimit(resource.RLIMIT_AS, (CLASSIC_MEMORY, CLASSIC_MEMORY))
    try:
        opened = netCDF4.Dataset(path)
    except Exception:
        # without the limit, another process would try for long
        sys.exit(1)
    opened.set_auto_maskandscale(False)
    owners: list[Any] = [opened, *opened.variables.values()]
    for owner in owners:
        for name in owner.ncattrs():
            str(owner.getncattr(name))
    for variable in opened.variables.values():
        if variable.size:
            str(variable[(-1,) * variable.ndim])


def limit_process() -> None:
    """Limits time and memory of this process, where the system can."""
    for name, most in LIMITS.items() if resource is not None else ():
        # macOS refuses some
        with suppress(OSError, ValueError, AttributeError):
            resource.setrlimit(getattr(resource, name), (most, most))
    if sys.platform == "win32":
        ctypes.windll.kernel32.SetErrorMode(SILENT)


if __name__ == "__main__":
    limit_process()
    print(STARTED, flush=True)
    try:
        read_file(sys.argv[1])
    except Exception:
        # the reader itself reports exceptions
        sys.exit(0)

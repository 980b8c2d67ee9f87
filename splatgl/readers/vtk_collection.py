"""VTK XML collections: time steps of .pvd and blocks of .vtm, each a file of its own.

Format: "VTK XML file formats", docs.vtk.org.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import Element

from splatgl.data.times import Times
from splatgl.data.volume import Volume
from splatgl.errors import expected, list_names
from splatgl.readers import vtk_cells, vtk_xml
from splatgl.readers.channels import ChannelSet
from splatgl.readers.common import find_data_file
from splatgl.readers.options import LoadOptions, converter
from splatgl.readers.vtk_xml import parse_numbers, parse_vtk

_READERS = {
    ".vti": vtk_xml.read,
    ".vtr": vtk_xml.read,
    ".pvti": vtk_xml.read_parallel,
    ".pvtr": vtk_xml.read_parallel,
    **dict.fromkeys((".vtu", ".vts", ".pvtu", ".pvts"), vtk_cells.read),
}

# the number of a time step or block, and an array in it
_NUMBERED = re.compile("[0-9]{1,9}(/|$)")
# the name of a time step or block, and the name of its file
Entry = tuple[str, str]


def read(path: Path, options: LoadOptions) -> Volume:
    """The volume of one time step of a .pvd file, or of one block of a .vtm file.

    `time` is the number of the step, `array` that of the block, or its name. An array in it follows a slash: 3/density;
    steps may be given so, too.
    """
    file = parse_vtk(path, ("Collection", "vtkMultiBlockDataSet"))
    is_series = file.kind == "Collection"
    owner = file.root.find(file.kind)
    entries = [] if owner is None else _list_steps(owner) if is_series else _list_blocks(owner)
    what = "time steps" if is_series else "blocks"
    if not entries:
        raise expected(what, "one or more", "none")
    by_time = is_series and (options.time is not None or not _NUMBERED.match(str(options.array)))
    if by_time:
        _, name = entries[min(options.point, len(entries) - 1)]
        array = options.array
    else:
        name, array = _select_entry(entries, options, what)
    entry_options = replace(options, array=array, time=None)
    moments = Times.of(float(time) for time, _ in entries) if by_time else None
    times = ChannelSet(times=len(entries) if by_time else 1, moments=moments)
    return times.volume(replace(options, channel=None), lambda _: _read_entry(path, name, entry_options, is_series))


def _read_entry(path: Path, name: str, options: LoadOptions, collections: bool) -> Volume:
    """The volume in a file that `path` names. collections: whether the file may be a collection of blocks."""
    suffix = Path(name).suffix.lower()
    if suffix not in _READERS and not (suffix == ".vtm" and collections):
        raise expected(name, f"a file of {', '.join(_READERS)}", repr(suffix), converter(name))
    file = find_data_file(path, name, options.anywhere)
    if suffix == ".vtm":
        parse_vtk(file, ("vtkMultiBlockDataSet",))
        return read(file, options)
    return _READERS[suffix](file, options)


def _list_steps(owner: Element) -> list[Entry]:
    """Sorted time steps with one file each."""
    steps = sorted(
        (parse_numbers(node, "timestep", "0", 1)[0], node.get("file", "")) for node in owner.findall("DataSet")
    )
    if len({time for time, _ in steps}) < len(steps):
        raise expected("DataSet", "one file a time step", "several", "save the parts as one .pvti")
    return [(f"{time:.10g}", name) for time, name in steps]


def _list_blocks(owner: Element) -> list[Entry]:
    """The blocks that are grids, by name; all blocks if none is a grid."""
    blocks = [(node.get("name", ""), node.get("file", "")) for node in owner.iter("DataSet")]
    return [entry for entry in blocks if Path(entry[1]).suffix.lower() in _READERS] or blocks


def _select_entry(entries: list[Entry], options: LoadOptions, what: str) -> tuple[str, str | int | None]:
    """The requested file, and the array in it."""
    listed = list_names([f"{n} ({name})" if name else f"{n}" for n, (name, _) in enumerate(entries)])
    requested = None if options.array is None else str(options.array)
    if requested is not None:
        head, _, rest = requested.partition("/")
        if _NUMBERED.match(requested):
            if int(head) >= len(entries):
                raise expected("array", f"one of the {what} {listed}", repr(requested))
            return entries[int(head)][1], rest or None
        if what == "blocks":
            for name, file in entries:
                if name and (requested == name or requested.startswith(f"{name}/")):
                    return file, requested[len(name) + 1 :] or None
    if len(entries) > 1:
        fix = f"pick one with array=0 … array={len(entries) - 1}, an array in it as in array=0/NAME"
        raise expected(what, "one", f"{len(entries)}: {listed}", fix)
    return entries[0][1], requested

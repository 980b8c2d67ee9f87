"""VTK XML collections: time steps of .pvd and blocks of .vtm, each a file of its own.

Format: "VTK XML file formats", docs.vtk.org.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import Element

from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.readers import vtk_xml
from splatgl.readers.common import find_data_file
from splatgl.readers.options import LoadOptions, converter
from splatgl.readers.vtk_xml import parse_numbers, parse_vtk

_GRIDS = {
    ".vti": vtk_xml.read,
    ".vtr": vtk_xml.read,
    ".pvti": vtk_xml.read_parallel,
    ".pvtr": vtk_xml.read_parallel,
}

# most names in a message
_MOST_LISTED = 8
# the name of a time step or block, and the name of its file
Entry = tuple[str, str]


def read(path: Path, options: LoadOptions) -> Volume:
    """The volume of one time step of a .pvd file, or of one block of a .vtm file.

    `array` is the number of the step or block, or a block's name; an array in it follows a slash: 3/density.
    """
    file = parse_vtk(path, ("Collection", "vtkMultiBlockDataSet"))
    steps = file.kind == "Collection"
    owner = file.root.find(file.kind)
    entries = [] if owner is None else _list_steps(owner) if steps else _list_blocks(owner)
    name, array = _select_entry(entries, options, "time steps" if steps else "blocks")
    return _read_entry(path, name, replace(options, array=array), collections=steps)


def _read_entry(path: Path, name: str, options: LoadOptions, collections: bool) -> Volume:
    """The volume in a file that `path` names. collections: whether the file may be a collection of blocks."""
    suffix = Path(name).suffix.lower()
    if suffix not in _GRIDS and not (suffix == ".vtm" and collections):
        raise expected(name, f"a file of {', '.join(_GRIDS)}", repr(suffix), converter(name) or "open that file itself")
    file = find_data_file(path, name, options.anywhere)
    if suffix == ".vtm":
        parse_vtk(file, ("vtkMultiBlockDataSet",))
        return read(file, options)
    return _GRIDS[suffix](file, options)


def _list_steps(owner: Element) -> list[Entry]:
    """Sorted time steps with one file each."""
    steps = sorted(
        (parse_numbers(node, "timestep", "0", 1)[0], node.get("file", "")) for node in owner.findall("DataSet")
    )
    if len({time for time, _ in steps}) < len(steps):
        raise expected("DataSet", "one file a time step", "several", "save the parts as one .pvti")
    return [(f"{time:g}", name) for time, name in steps]


def _list_blocks(owner: Element) -> list[Entry]:
    """The blocks that are grids, by name; all blocks if none is a grid."""
    blocks = [(node.get("name", ""), node.get("file", "")) for node in owner.iter("DataSet")]
    return [entry for entry in blocks if Path(entry[1]).suffix.lower() in _GRIDS] or blocks


def _select_entry(entries: list[Entry], options: LoadOptions, what: str) -> tuple[str, str | None]:
    """The requested file, and the array in it."""
    listed = ", ".join(f"{n} ({name})" if name else f"{n}" for n, (name, _) in enumerate(entries[:_MOST_LISTED]))
    listed += ", …" if len(entries) > _MOST_LISTED else ""
    if not entries:
        raise expected(what, "one or more", "none")
    requested = None if options.array is None else str(options.array)
    if requested is not None:
        head, _, rest = requested.partition("/")
        if re.fullmatch("[0-9]{1,9}", head):
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

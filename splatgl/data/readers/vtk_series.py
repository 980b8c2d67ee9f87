"""VTK's lists of files: time series (.pvd) and blocks (.vtm), of which one image or rectilinear grid is read."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import Element

from splatgl.data.readers import vti
from splatgl.data.readers.files import data_file
from splatgl.data.readers.inside import converter
from splatgl.data.readers.options import LoadOptions
from splatgl.data.readers.vtk_xml import numbers_in, parse_vtk
from splatgl.data.volume import Volume
from splatgl.errors import expected

_GRIDS = {".vti": vti.read, ".vtr": vti.read, ".pvti": vti.read_parallel, ".pvtr": vti.read_parallel}

_MOST_LISTED = 8
"""Most names in a message."""

Entry = tuple[str, str]
"""The name of a time step or block, and that of its file."""


def read(path: Path, options: LoadOptions) -> Volume:
    """The volume of one time step of a .pvd file, or of one block of a .vtm file.

    `array` is the number of the step or block, or a block's name; an array in it stands behind a slash: 3/density.
    """
    file = parse_vtk(path, ("Collection", "vtkMultiBlockDataSet"))
    steps = file.kind == "Collection"
    owner = file.root.find(file.kind)
    entries = [] if owner is None else _steps(owner) if steps else _blocks(owner)
    name, array = _chosen(entries, options, "time steps" if steps else "blocks")
    return _read(path, name, replace(options, array=array), collections=steps)


def _read(path: Path, name: str, options: LoadOptions, collections: bool) -> Volume:
    """The volume in a file that `path` names; a time step may be of blocks, these are of grids."""
    suffix = Path(name).suffix.lower()
    if suffix not in _GRIDS and not (suffix == ".vtm" and collections):
        raise expected(name, f"a file of {', '.join(_GRIDS)}", repr(suffix), converter(name))
    found = data_file(path, name, options.anywhere)
    if suffix == ".vtm":
        parse_vtk(found, ("vtkMultiBlockDataSet",))
        return read(found, options)
    return _GRIDS[suffix](found, options)


def _steps(owner: Element) -> list[Entry]:
    """Time steps in order, each with one file."""
    found = sorted((numbers_in(node, "timestep", "0", 1)[0], node.get("file", "")) for node in owner.findall("DataSet"))
    if len({time for time, _ in found}) < len(found):
        raise expected("DataSet", "one file a time step", "several", "save the parts as one .pvti")
    return [(f"{time:g}", name) for time, name in found]


def _blocks(owner: Element) -> list[Entry]:
    """The grids among the blocks, by their names; if there is none, all blocks."""
    found = [(node.get("name", ""), node.get("file", "")) for node in owner.iter("DataSet")]
    return [entry for entry in found if Path(entry[1]).suffix.lower() in _GRIDS] or found


def _chosen(entries: list[Entry], options: LoadOptions, what: str) -> tuple[str, str | None]:
    """The file that is asked for, and the array in it."""
    listed = ", ".join(f"{n} ({name})" if name else f"{n}" for n, (name, _) in enumerate(entries[:_MOST_LISTED]))
    listed += ", …" if len(entries) > _MOST_LISTED else ""
    if not entries:
        raise expected(what, "one or more", "none")
    asked = None if options.array is None else str(options.array)
    if asked is not None:
        head, _, rest = asked.partition("/")
        if re.fullmatch("[0-9]{1,9}", head):
            if int(head) >= len(entries):
                raise expected("array", f"one of the {what} {listed}", repr(asked))
            return entries[int(head)][1], rest or None
        if what == "blocks":
            for name, file in entries:
                if name and (asked == name or asked.startswith(f"{name}/")):
                    return file, asked[len(name) + 1 :] or None
    if len(entries) > 1:
        fix = f"pick one with array=0 … array={len(entries) - 1}, an array in it as in array=0/NAME"
        raise expected(what, "one", f"{len(entries)}: {listed}", fix)
    return entries[0][1], asked

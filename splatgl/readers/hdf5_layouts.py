"""Layouts of programs in HDF5: axes and grids of NetCDF, EMD, NeXus, MATLAB, ITK, EMAN2, Chimera and Velox.

Sources: "NeXus: NXdata" (manual.nexusformat.org); "EMD file format" (emdatasets.com) and emdfile; MATLAB's "MAT-file
versions" (rows run fastest, which HDF5 lists last); ITK's HDF5ImageIO; EMAN2's and UCSF Chimera's descriptions of HDF5.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from splatgl.data.affine import Lattice, axis_kind
from splatgl.data.times import seconds_in
from splatgl.readers.channels import is_color_rule
from splatgl.readers.hdf5_files import (
    attribute_numbers,
    attribute_text,
    attribute_texts,
    dimension_scales,
    find_node,
    has_real_numbers,
)

# most groups from the root to NeXus' default data; most bytes of Velox' description of an image
_DEPTH, _MOST_BYTES = 8, 2**20
# units of length that EMD's files spell in their own way
_EMD_UNITS = {"[n_m]": "nm", "[u_m]": "um", "[m_m]": "mm", "A": "Å", "[Å]": "Å"}


@dataclass(frozen=True)
class Scale:
    """Coordinates along an axis: their dataset, and the axis's name. ends: whether two stand for even ones, by EMD;
    faces: whether one more than there are samples are the faces of voxels, by NeXus.
    """

    node: Any
    name: str
    ends: bool = False
    faces: bool = False

    @property
    def attributes(self) -> dict[str, str]:
        """The attributes that describe the axis."""
        names = ("units", "unit", "positive", "standard_name", "axis")
        texts = {name: attribute_text(self.node, name) for name in names}
        return {name: _EMD_UNITS.get(text, text) if self.ends else text for name, text in texts.items()}

    def fits(self, size: int) -> bool:
        """Whether the coordinates are those of `size` samples."""
        counts = {(size,), *[(2,)] * self.ends, *[(size + 1,)] * self.faces}
        return has_real_numbers(self.node) and self.node.shape in counts

    def spread(self, places: np.ndarray, size: int) -> np.ndarray:
        """The coordinates of `size` samples out of those of the dataset."""
        if self.ends and len(places) == 2:
            return np.asarray(places[0] + (places[1] - places[0]) * np.arange(size))
        return (places[1:] + places[:-1]) / 2 if len(places) == size + 1 else places


def axis_scales(dataset: Any) -> list[Scale | None]:
    """The coordinates of each axis, None for an axis without any: dimension scales, or those of EMD or NeXus."""
    if hasattr(dataset, "scales"):
        return list(dataset.scales)
    scales = dimension_scales(dataset)
    if any(scale is not None for scale in scales):
        return [None if node is None else Scale(node, _last_name(node)) for node in scales]
    none: list[Scale | None] = [None] * len(dataset.shape)
    if not hasattr(dataset, "parent"):
        return none
    parent = dataset.parent
    if "emd_group_type" in parent.attrs:
        return _emd_scales(dataset, parent) or none
    names = _nexus_axes(dataset, parent)
    nodes = [find_node(dataset.file, f"{parent.name}/{name}", anywhere=False) if name else None for name in names]
    return [Scale(node, _last_name(node), faces=True) if hasattr(node, "shape") else None for node in nodes] or none


def _last_name(node: Any) -> str:
    return str(node.name).rsplit("/", 1)[-1]


def _emd_scales(dataset: Any, parent: Any) -> list[Scale | None]:
    """The scales in dim1, dim2, … beside the data, or in dim0, dim1, …; [] without any."""
    numbers = sorted(int(name[3:]) for name in parent if re.fullmatch("dim[0-9]{1,3}", name))[: len(dataset.shape)]
    nodes = [find_node(dataset.file, f"{parent.name}/dim{number}", anywhere=False) for number in numbers]
    scales: list[Scale | None] = [
        Scale(node, attribute_text(node, "name") or _last_name(node), ends=True) if hasattr(node, "shape") else None
        for node in nodes
    ]
    return scales if len(scales) == len(dataset.shape) else []


def _nexus_axes(dataset: Any, parent: Any) -> list[str]:
    """Names of the coordinates of each axis in the same group, "" for an axis without any; [] without any."""
    count = len(dataset.shape)
    owner = dataset if "axes" in dataset.attrs else parent
    texts = attribute_texts(owner, "axes") if "axes" in owner.attrs else []
    names = re.split("[:,]", texts[0].strip("[] ")) if len(texts) == 1 else texts
    if owner is parent and len(names) != count:
        return []
    placed = [""] * count
    for n, name in enumerate(map(str.strip, names)):
        stated = attribute_numbers(parent, f"{name}_indices") if name else None
        axis = int(stated[0]) if stated is not None and stated.size == 1 and np.isfinite(stated[0]) else n
        if 0 <= axis < count and re.fullmatch(r"\w[\w.-]*", name):
            placed[axis] = name
    return placed if any(placed) else []


def layout_kinds(dataset: Any, scales: Sequence[Scale | None], names: Sequence[str]) -> list[str]:
    """The kind of each axis, see `axis_kind`. names: labels of the axes, or [].

    Of more than three axes, one with coordinates in a unit of time is time.
    """
    shape = dataset.shape
    matlab = "MATLAB_class" in dataset.attrs
    if matlab and len(shape) >= 3:
        # rows are y, columns x, pages z; colours come behind the pages, or before them in sequences of pictures
        kinds = [*[""] * (len(shape) - 3), "z", "x", "y"]
        places = [axis for axis in (0, 1) if len(shape) == 4 and is_color_rule(dataset.dtype, shape[axis])]
        place = min(places, key=lambda axis: shape[axis], default=None)
        return kinds if place is None else ["c", *kinds[1:]] if place == 0 else ["z", "c", "x", "y"]
    if _is_velox(dataset):
        return ["y", "x", "z"]
    if not any(names):
        names = ["" if scale is None else scale.name for scale in scales]
    if len(names) != len(shape):
        return [""] * len(shape)
    about = [{} if scale is None else scale.attributes for scale in scales]
    kinds = [axis_kind(name, attributes) for name, attributes in zip(names, about, strict=True)]
    if sum(size > 1 for size in shape) > 3:
        units = [attributes.get("units") or attributes.get("unit") or "" for attributes in about]
        timed = (seconds_in(unit) is not None for unit in units)
        kinds = ["time" if is_time and not kind else kind for kind, is_time in zip(kinds, timed, strict=True)]
    return kinds


def _is_velox(dataset: Any) -> bool:
    return re.fullmatch("/Data/Image/[^/]+/Data", str(dataset.name)) is not None and len(dataset.shape) == 3


def layout_grid(dataset: Any) -> tuple[Lattice, str | None] | None:
    """The grid of x, y, z and its frame, if the program writes them without coordinates; else None."""
    if not hasattr(dataset, "parent"):
        return None
    parent = dataset.parent
    if re.fullmatch("/ITKImage/[0-9]+/VoxelData", str(dataset.name)):
        # each row of the directions is that of an axis
        steps = _numbers(parent, "Spacing", np.ones(3))
        matrix = _numbers(parent, "Directions", np.eye(3)).reshape(3, 3).T * steps
        return _plain_grid(matrix, _numbers(parent, "Origin", np.zeros(3)), ""), "LPS"
    sizes = [attribute_numbers(parent, f"EMAN.apix_{axis}") for axis in "xyz"]
    steps = np.array([size[0] if size is not None and size.size == 1 else np.nan for size in sizes])
    if (steps > 0).all() and np.isfinite(steps).all():
        return _plain_grid(np.diag(steps), np.zeros(3), "Å"), None
    step, start = (attribute_numbers(parent, name) for name in ("step", "origin"))
    if _last_name(dataset).startswith("data") and step is not None and step.size == 3 and (step > 0).all():
        return _plain_grid(np.diag(step), start if start is not None and start.size == 3 else np.zeros(3), "Å"), None
    return _velox_grid(dataset, parent) if _is_velox(dataset) else None


def _velox_grid(dataset: Any, parent: Any) -> tuple[Lattice, None] | None:
    """The size of pixels in the first frame's description, which is text in a column of bytes."""
    node = find_node(dataset.file, f"{parent.name}/Metadata", anywhere=False)
    if not hasattr(node, "shape") or node.dtype != np.uint8 or len(node.shape) != 2 or node.shape[0] > _MOST_BYTES:
        return None
    try:
        about = json.loads(bytes(node[:, 0]).split(b"\0")[0])["BinaryResult"]
        width, height = (float(about["PixelSize"][name]) * 1e9 for name in ("width", "height"))
    except (ValueError, KeyError, TypeError, RecursionError):
        return None
    if about.get("PixelUnitX") != "m" or not 0 < min(width, height) < np.inf:
        return None
    return _plain_grid(np.diag([width, height, width]), np.zeros(3), "nm", "frames are drawn one pixel apart"), None


def _numbers(parent: Any, name: str, default: np.ndarray) -> np.ndarray:
    """The numbers of a small dataset; the default for another count."""
    node = find_node(parent.file, f"{parent.name}/{name}", anywhere=False)
    if not hasattr(node, "shape") or not has_real_numbers(node) or np.prod(node.shape) != default.size:
        return default
    return np.asarray(node[()], np.float64).ravel()


def _plain_grid(matrix: np.ndarray, origin: np.ndarray, unit: str, *notes: str) -> Lattice:
    none = (None, None, None)
    return Lattice(matrix, origin.tolist(), unit, none, none, notes)


def default_dataset(file: Any, names: Sequence[str]) -> str | None:
    """The one among several datasets that NeXus' defaults lead to, or that alone is a signal; None without one."""
    node = file
    for _ in range(_DEPTH):
        default = attribute_text(node, "default")
        below = find_node(file, f"{node.name}/{default}", anywhere=False) if default else None
        if not hasattr(below, "keys"):
            break
        node = below
    signal = f"{node.name}/{attribute_text(node, 'signal')}"
    signals = [name for name in names if _is_signal(file[name])]
    return signal if signal in names else signals[0] if len(signals) == 1 else None


def _is_signal(dataset: Any) -> bool:
    return "signal" in dataset.attrs or attribute_text(dataset.parent, "signal") == _last_name(dataset)

"""Files that `save` writes: NIfTI, NRRD, MetaImage and NumPy, OME-TIFF and OME-Zarr with coarser levels."""

from __future__ import annotations

import gzip
import io
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any
from uuid import NAMESPACE_OID, uuid5

import numpy as np

from splatgl.data.volume import FEWEST, Places, Volume, halve_samples
from splatgl.errors import import_extra
from splatgl.readers.metaimage import TYPES as METAIMAGE_TYPES
from splatgl.writers import Content, label_colors

# most voxels along an axis of NIfTI-1, whose sizes have 16 bits
MOST_ALONG = 2**15 - 1
# bytes behind a header of NIfTI, which tell of extensions
_EXTENSION = 4
# numpy codes as words of NRRD
_NRRD_TYPES = {
    **{f"i{size}": f"int{8 * size}" for size in (1, 2, 4, 8)},
    **{f"u{size}": f"uint{8 * size}" for size in (1, 2, 4, 8)},
    "f4": "float",
    "f8": "double",
}
_SPACES = {"LPS": "left-posterior-superior", "RAS": "right-anterior-superior"}


def write_nifti(path: Path, content: Content) -> None:
    """Writes a .nii or .nii.gz file: NIfTI-1, or NIfTI-2 for longer axes."""
    with path.open("wb") as raw:
        if content.target.suffixes[0] == ".nii":
            _write_nifti(raw, content)
            return
        # as nibabel does: higher levels take several times as long for a few per cent
        with gzip.GzipFile("", "wb", compresslevel=1, fileobj=raw, mtime=0) as file:
            _write_nifti(file, content)


def _write_nifti(file: Any, content: Content) -> None:
    nibabel = import_extra("nibabel", "NIfTI files", "nibabel", "readers")
    volume, kind = content.volume, content.kind
    shape = [*volume.shape[::-1], *([content.count] if content.count > 1 or kind == "vectors" else [])]
    header = (nibabel.Nifti2Header if max(shape) > MOST_ALONG else nibabel.Nifti1Header)()
    header.set_data_dtype(np.dtype([(name, "u1") for name in "RGB"]) if kind == "color" else content.dtype)
    header.set_data_shape([*shape, 3] if kind == "vectors" else shape)
    if kind == "vectors":
        header.set_intent("vector")
    elif volume.labels is not None and content.dtype.kind in "iu":
        header.set_intent("label")
    steps = [volume.time_step or 1.0] if len(shape) > 3 else []
    header.set_zooms([*volume.spacing, *steps, *([1.0] if kind == "vectors" else [])])
    unit = {"m": "meter", "mm": "mm", "um": "micron"}.get(volume.unit, "unknown")
    header.set_xyzt_units(unit, "sec" if volume.time_step else "unknown")
    affine = np.eye(4)
    affine[:3, :3], affine[:3, 3] = volume.world_from_index, volume.origin
    # without an anatomical frame, a plain grid states none, and another one is "aligned to another file"
    is_plain = not any(volume.origin) and (volume.direction == np.eye(3)).all()
    code = 1 if volume.frame else 0 if is_plain else 2
    is_sheared = not np.allclose(volume.direction.T @ volume.direction, np.eye(3), atol=1e-5)
    if code and not is_sheared:
        header.set_qform(affine, code)
    if code:
        header.set_sform(affine, code)
    header.set_data_offset(int(header["sizeof_hdr"]) + _EXTENSION)
    header.write_to(file)
    if kind != "vectors":
        _write_slabs(file, content)
        return
    # the components are the slowest axis
    for component in range(3):
        for slab in content.slabs():
            file.write(slab[..., component].tobytes())


def _write_slabs(file: Any, content: Content, header: bytes = b"") -> None:
    file.write(header)
    for slab in content.slabs():
        file.write(slab.data)


def write_nrrd(path: Path, content: Content) -> None:
    """Writes a .nrrd file with raw samples; labels are 3D Slicer's segments, in layers if they are several channels."""
    with path.open("wb") as file:
        _write_slabs(file, content, nrrd_header(content).encode())


def nrrd_header(content: Content) -> str:
    """The header of a NRRD file, with the empty line behind it."""
    volume, kind, dtype = content.volume, content.kind, content.dtype
    ahead = {"color": ["RGB-color"], "vectors": ["vector"], "channels": ["list"]}.get(kind, [])
    after = ["time"] if content.count > 1 else []
    sizes = [*([content.components] if ahead else []), *volume.shape[::-1], *([content.count] if after else [])]
    kinds = [*ahead, "domain", "domain", "domain", *after]
    matrix = volume.world_from_index
    directions = [*["none"] * len(ahead), *(_point(matrix[:, axis]) for axis in range(3)), *["none"] * len(after)]
    lines = ["NRRD0005", f"type: {_NRRD_TYPES[dtype.str[1:]]}", f"dimension: {len(sizes)}"]
    lines += [f"space: {_SPACES[volume.frame]}" if volume.frame else "space dimension: 3"]
    lines += [f"sizes: {' '.join(map(str, sizes))}", f"space directions: {' '.join(directions)}"]
    lines += [f"kinds: {' '.join(kinds)}"]
    if after and volume.time_step:
        none = ["NaN"] * (len(sizes) - 1)
        lines += [f"spacings: {' '.join([*none, repr(volume.time_step)])}"]
        lines += ["units: " + '"" ' * len(none) + '"s"']
    lines += [*(["endian: little"] if dtype.itemsize > 1 else []), "encoding: raw"]
    lines += ["space units:" + f' "{_line(volume.unit)}"' * 3] if volume.unit else []
    lines += [f"space origin: {_point(np.asarray(volume.origin))}"]
    lines += [f"sample units: {_line(volume.value_unit)}"] if volume.value_unit else []
    layers = volume.channels if kind == "channels" else (volume,)
    segments = [
        (layer, label, color)
        for layer, part in enumerate(layers)
        for label, color in zip(part.labels or (), label_colors(part.labels or ()), strict=True)
    ]
    for n, (layer, label, color) in enumerate(segments):
        rgb = " ".join(f"{int(color[at : at + 2], 16) / 255:.6f}" for at in (1, 3, 5))
        tags: dict[str, Any] = {"ID": f"Segment_{n + 1}", "Name": _line(label.name), "Color": rgb}
        tags |= {"LabelValue": label.number, "Layer": layer}
        lines += [f"Segment{n}_{name}:={value}" for name, value in tags.items()]
    return "\n".join(lines) + "\n\n"


def _point(numbers: np.ndarray) -> str:
    return f"({','.join(repr(number) for number in numbers.tolist())})"


def _line(text: str) -> str:
    """Text of one line, without quotation marks."""
    return re.sub(r'[\r\n"]', " ", text)


def write_metaimage(path: Path, content: Content) -> None:
    """Writes a .mha file with its samples behind the header."""
    with path.open("wb") as file:
        _write_slabs(file, content, metaimage_header(content).encode())


def metaimage_header(content: Content) -> str:
    """The header of a MetaImage file."""
    volume = content.volume
    times = [content.count] if content.count > 1 else []
    count, rest = 3 + len(times), [0.0] * len(times)
    codes = {code: name for name, code in METAIMAGE_TYPES.items() if name not in ("MET_LONG", "MET_ULONG")}
    matrix = np.eye(count)
    matrix[:3, :3] = volume.direction
    fields: dict[str, Any] = {"ObjectType": "Image", "NDims": count, "BinaryData": True}
    fields |= {"BinaryDataByteOrderMSB": False, "CompressedData": False}
    if volume.frame or (volume.direction != np.eye(3)).any():
        # a row for each axis
        fields["TransformMatrix"] = matrix.T.ravel()
    fields |= {"Offset": np.array([*volume.origin, *rest])}
    fields["ElementSpacing"] = np.array([*volume.spacing, *[volume.time_step or 1.0] * len(times)])
    fields["DimSize"] = np.array([*volume.shape[::-1], *times])
    fields |= {"DistanceUnits": volume.unit} if volume.unit else {}
    fields |= {"ElementNumberOfChannels": content.components} if content.components > 1 else {}
    fields |= {"ElementType": codes[content.dtype.str[1:]], "ElementDataFile": "LOCAL"}
    texts = {
        name: " ".join(map(repr, value.tolist())) if isinstance(value, np.ndarray) else value
        for name, value in fields.items()
    }
    return "".join(f"{name} = {text}\n" for name, text in texts.items())


def write_npy(path: Path, content: Content) -> None:
    """Writes a .npy file: [z, y, x], or [z, y, x, 3] of colours and vectors."""
    shape = (*content.volume.shape, *([content.components] if content.components > 1 else []))
    header = io.BytesIO()
    fields = {"descr": content.dtype.str, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(header, fields)
    with path.open("wb") as file:
        _write_slabs(file, content, header.getvalue())


# voxels along the sides of a chunk, and chunks along those of a box in memory; the coarsest level is one chunk
CHUNK, BOX = 64, 2
# units of length by their names in OME-Zarr
UNITS = {
    **{"nm": "nanometer", "um": "micrometer", "mm": "millimeter", "cm": "centimeter", "m": "meter"},
    **{"km": "kilometer", "in": "inch", "Å": "angstrom"},
}
WHITE = "#ffffff"
# bytes from which a TIFF file needs offsets of 64 bits; metadata and tags take the rest
_BIG = 2**32 - 2**26


def write_tiff(path: Path, content: Content) -> None:
    """Writes an OME-TIFF file, uncompressed: axes t, c, z, y, x of which t and c need several entries."""
    import tifffile

    volume, is_color = content.volume, content.kind == "color"
    channels = 1 if is_color else content.components
    lead = [(axis, size) for axis, size in (("T", content.count), ("C", channels)) if size > 1]
    axes = "".join(axis for axis, _ in lead) + "ZYX" + "S" * is_color
    shape = (*(size for _, size in lead), *volume.shape, *((3,) if is_color else ()))
    unit = {"um": "µm", "": "pixel"}.get(volume.unit, volume.unit if volume.unit in UNITS else "pixel")
    metadata: dict[str, Any] = {"axes": axes, "Name": volume.name or "volume"}
    for axis, size in zip("XYZ", volume.spacing, strict=True):
        metadata |= {f"PhysicalSize{axis}": size, f"PhysicalSize{axis}Unit": unit}
    if content.count > 1 and volume.time_step:
        metadata |= {"TimeIncrement": volume.time_step, "TimeIncrementUnit": "s"}
    if channels > 1:
        colors = [channel.hints.color or WHITE for channel in volume.channels]
        # red in the highest byte, opaque, as a signed number
        numbers = [int(np.array(int(color[1:], 16) << 8 | 255, np.uint32).view(np.int32)) for color in colors]
        metadata["Channel"] = {"Name": [channel.name for channel in volume.channels], "Color": numbers}
        if not any(channel.hints.color for channel in volume.channels):
            del metadata["Channel"]["Color"]
    # tifffile's own holds the time and the machine's address
    metadata["UUID"] = uuid5(NAMESPACE_OID, repr((shape, content.dtype.str, metadata))).urn
    is_big = math.prod(shape) * content.dtype.itemsize > _BIG
    tifffile.imwrite(
        path,
        _planes(content),
        shape=shape,
        dtype=content.dtype,
        ome=True,
        bigtiff=is_big,
        photometric="rgb" if is_color else "minisblack",
        metadata=metadata,
    )


def _planes(content: Content) -> Iterator[np.ndarray]:
    """All planes in order, of a time point channel by channel; read some at a time."""
    for time in range(content.count):
        for array in content.arrays(time):
            for slab in content.slabs_of([array]):
                yield from slab if content.kind == "color" else slab[..., 0]


@dataclass(frozen=True, eq=False)
class LevelGrid:
    """A level of a store, axes z, y, x: its shape, its steps in voxels of the finer level, its spacing and origin."""

    shape: Places
    steps: Places
    scale: np.ndarray
    begin: np.ndarray


def level_grids(volume: Volume) -> list[LevelGrid]:
    """The levels of a volume, finest first: each has half as many voxels along axes of at least FEWEST, down to one
    chunk.
    """
    grids = [LevelGrid(volume.shape, (1, 1, 1), np.array(volume.spacing[::-1]), np.array(volume.origin[::-1]))]
    while max(grids[-1].shape) > CHUNK:
        finer = grids[-1]
        z, y, x = (2 if count >= FEWEST else 1 for count in finer.shape)
        steps = (z, y, x)
        d, h, w = (math.ceil(count / step) for count, step in zip(finer.shape, steps, strict=True))
        # the middle of the first block, along the volume's own axes
        middle = volume.direction @ ((np.array(steps[::-1]) - 1) / 2 * finer.scale[::-1])
        grids.append(LevelGrid((d, h, w), steps, finer.scale * steps, finer.begin + middle[::-1]))
    return grids


def level_boxes(shape: Places) -> Iterator[tuple[Places, Places]]:
    """Yields boxes (low, high) of whole chunks, (z, y, x), that cover a level."""
    side = BOX * CHUNK
    for at in product(*(range(0, count, side) for count in shape)):
        z, y, x = (min(a + side, count) for a, count in zip(at, shape, strict=True))
        yield (at[0], at[1], at[2]), (z, y, x)


def finer_box(grid: LevelGrid, finer: LevelGrid, low: Places, high: Places) -> tuple[slice, ...]:
    """The box of the finer level that makes a box of a level."""
    sides = zip(low, high, grid.steps, finer.shape, strict=True)
    return tuple(slice(a * step, min(b * step, count)) for a, b, step, count in sides)


def describe_levels(volume: Volume, grids: list[LevelGrid], lead: list[dict[str, Any]]) -> dict[str, Any]:
    """OME-Zarr's metadata of an image (0.5). lead: axes before z, y and x, with their "scale"."""
    axes: list[Any] = [{name: entry for name, entry in axis.items() if name != "scale"} for axis in lead]
    unit = {"unit": UNITS[volume.unit]} if volume.unit in UNITS else {}
    axes += [{"name": name, "type": "space", **unit} for name in "zyx"]
    ahead = [axis["scale"] for axis in lead]
    datasets: list[Any] = [
        {
            "path": str(number),
            "coordinateTransformations": [
                {"type": "scale", "scale": [*ahead, *grid.scale.tolist()]},
                {"type": "translation", "translation": [*[0.0] * len(ahead), *grid.begin.tolist()]},
            ],
        }
        for number, grid in enumerate(grids)
    ]
    return {"version": "0.5", "multiscales": [{"name": volume.name, "axes": axes, "datasets": datasets}]}


def write_zarr(path: Path, content: Content) -> None:
    """Writes an OME-Zarr store (0.5, Zarr 3): levels of means, of labels of the most frequent numbers."""
    import zarr

    group = zarr.open_group(path, mode="w", zarr_format=3)
    volume, grids = content.volume, level_grids(content.volume)
    lead: list[dict[str, Any]] = []
    if content.count > 1:
        unit = {"unit": "second"} if volume.time_step else {}
        lead.append({"name": "t", "type": "time", **unit, "scale": volume.time_step or 1.0})
    if content.components > 1:
        lead.append({"name": "c", "type": "channel", "scale": 1.0})
    sizes = [content.count] * (content.count > 1) + [content.components] * (content.components > 1)
    arrays: list[Any] = [
        group.create_array(
            str(number),
            shape=(*sizes, *grid.shape),
            chunks=(*[1] * len(sizes), *[CHUNK] * 3),
            dtype=content.dtype,
            fill_value=0,
            dimension_names=[*(axis["name"] for axis in lead), *"zyx"],
        )
        for number, grid in enumerate(grids)
    ]
    for time in range(content.count):
        for channel, source in enumerate(content.arrays(time)):
            at = (*[time] * (content.count > 1), *[channel] * (content.components > 1))
            for low, high in level_boxes(volume.shape):
                box = tuple(map(slice, low, high))
                arrays[0][(*at, *box)] = content.box([source], box)[..., 0]
            for number in range(1, len(grids)):
                for low, high in level_boxes(grids[number].shape):
                    block = arrays[number - 1][(*at, *finer_box(grids[number], grids[number - 1], low, high))]
                    halved = halve_samples(block, grids[number].steps, volume.labels is not None)
                    if content.dtype.kind in "iu":
                        halved = np.rint(halved)
                    arrays[number][(*at, *map(slice, low, high))] = halved.astype(content.dtype)
    group.attrs.update(_attributes(content, describe_levels(volume, grids, lead)))


def _attributes(content: Content, image: dict[str, Any]) -> dict[str, Any]:
    """Attributes of a store: OME's image, its channels and labels; for splatgl an orientation, which OME lacks."""
    volume, told = content.volume, dict(image)
    if len(volume.channels) > 1:
        rows = []
        for channel in volume.channels:
            window = channel.hints.window
            row: dict[str, Any] = {"label": channel.name, "active": True, "inverted": channel.hints.inverted}
            row |= {"color": channel.hints.color[1:].upper()} if channel.hints.color else {}
            if window:
                row["window"] = {"start": window[0], "end": window[1], "min": window[0], "max": window[1]}
            rows.append(row)
        told["omero"] = {"name": volume.name, "channels": rows}
    if volume.labels is not None:
        colors = zip(volume.labels, label_colors(volume.labels), strict=True)
        alpha = {label.number: round(255 * label.opacity) for label in volume.labels}
        told["image-label"] = {
            "colors": [
                {
                    "label-value": label.number,
                    "rgba": [*(int(color[n : n + 2], 16) for n in (1, 3, 5)), alpha[label.number]],
                }
                for label, color in colors
            ],
            "properties": [{"label-value": label.number, "name": label.name} for label in volume.labels],
        }
    attributes = {"ome": told}
    if volume.frame or not np.array_equal(volume.direction, np.eye(3)):
        attributes["splatgl"] = {"direction": volume.direction.tolist(), "frame": volume.frame}
    return attributes

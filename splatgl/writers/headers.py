"""NIfTI, NRRD, MetaImage and NumPy files: a header, and behind it all samples as they lie in memory."""

from __future__ import annotations

import gzip
import io
import re
from pathlib import Path
from typing import Any

import numpy as np

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
    """Writes a .nii file: NIfTI-1, or NIfTI-2 for longer axes."""
    with path.open("wb") as file:
        _write_nifti(file, content)


def write_nifti_gz(path: Path, content: Content) -> None:
    """Writes a .nii.gz file."""
    # as nibabel does: higher levels take several times as long for a few per cent
    with path.open("wb") as raw, gzip.GzipFile("", "wb", compresslevel=1, fileobj=raw, mtime=0) as file:
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


def _write_slabs(file: Any, content: Content) -> None:
    for slab in content.slabs():
        file.write(slab.data)


def write_nrrd(path: Path, content: Content) -> None:
    """Writes a .nrrd file with raw samples; labels are 3D Slicer's segments, in layers if they are several channels."""
    with path.open("wb") as file:
        file.write(nrrd_header(content).encode())
        _write_slabs(file, content)


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
        file.write(metaimage_header(content).encode())
        _write_slabs(file, content)


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
        file.write(header.getvalue())
        _write_slabs(file, content)

"""Folders with one picture per slice: TIFF, PNG, BMP and JPEG, in the order of the numbers in their names."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

from splatgl.data.color import luma
from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.fileio import byte_count, require_memory
from splatgl.readers.common import decoder_errors
from splatgl.readers.heightmap import open_picture
from splatgl.readers.ome_zarr import natural_key
from splatgl.readers.options import LoadOptions
from splatgl.readers.tiff import open_tiff
from splatgl.readers.tiff_validation import check_before_decoding, check_chain

# formats of slices by ending
KINDS = {".tif": "TIFF", ".tiff": "TIFF", ".png": "PNG", ".bmp": "BMP", ".jpg": "JPEG", ".jpeg": "JPEG"}


def is_slices(path: Path) -> bool:
    """Whether a folder holds at least two pictures of one format."""
    return len(_find_pictures(path)) > 1


def read(path: Path, _options: LoadOptions) -> Volume:
    """The volume of a folder's pictures of the most frequent format, one voxel apart.

    Raises InputError for a picture of another size or type than the first.
    """
    files = _find_pictures(path)
    first = _read_plane(files[0])
    require_memory(byte_count((len(files), *first.shape), first.dtype), sum(file.stat().st_size for file in files))
    samples = np.empty((len(files), *first.shape), first.dtype)
    for n, file in enumerate(files):
        plane = _read_plane(file)
        if plane.shape != first.shape or plane.dtype != first.dtype:
            this = f"{first.shape[1]}×{first.shape[0]} {first.dtype}, as {files[0].name}"
            raise expected(file.name, this, f"{plane.shape[1]}×{plane.shape[0]} {plane.dtype}", "move it elsewhere")
        samples[n] = plane
    left = sum(1 for file in path.iterdir() if file.is_file()) - len(files)
    span = f"from {files[0].name} to {files[-1].name}"
    notes = [f"{len(files)} slices, {span}, one voxel apart: --spacing sets another distance"]
    notes += [f"{left} other file{'s are' if left > 1 else ' is'} left out"] * bool(left)
    if samples.ndim == 3:
        return Volume(samples, notes=tuple(notes))
    if samples.shape[-1] not in (3, 4) or samples.dtype != np.uint8:
        raise expected(files[0].name, "grey, or colours of 8 bits", f"{first.dtype} {first.shape}", "save it as grey")
    color = np.ascontiguousarray(samples[..., :3])
    return Volume(luma(color), color=color, notes=tuple(notes))


def _find_pictures(path: Path) -> list[Path]:
    """The pictures of the most frequent format, in the order of the numbers in their names."""
    pictures = [file for file in path.iterdir() if file.suffix.lower() in KINDS and file.is_file()]
    kinds = Counter(KINDS[file.suffix.lower()] for file in pictures)
    most = max(sorted(kinds), key=lambda kind: kinds[kind], default="")
    return sorted(
        (file for file in pictures if KINDS[file.suffix.lower()] == most), key=lambda file: natural_key(file.name)
    )


def _read_plane(file: Path) -> np.ndarray:
    """The samples [H, W] or [H, W, channels] of a picture."""
    if KINDS[file.suffix.lower()] != "TIFF":
        return open_picture(file, 1)
    check_chain(file)
    with open_tiff(file) as tiff, decoder_errors(f"TIFF ({file.name})"):
        if len(tiff.pages) != 1:
            raise expected(file.name, "one page a slice", f"{len(tiff.pages)} pages", "load the file alone")
        check_before_decoding(tiff.pages)
        require_memory(byte_count(tiff.pages[0].shape, tiff.pages[0].dtype), file.stat().st_size)
        return np.asarray(tiff.pages[0].asarray())

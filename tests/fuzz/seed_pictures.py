"""Seed files of readers.py: every compression of TIFF, Zeiss' LSM, folders of slices, and Zarr stores in a zip."""

from __future__ import annotations

import io
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tests.fuzz.seed_files import CUBE, Seed, one, written

# compressions of TIFF that hold pictures, and options of their writer
PICTURES: dict[str, dict[str, Any]] = {
    "jpeg": {},
    "jpeg2000": {},
    "jpegxl": {"compressionargs": {"lossless": True}},
    "jpegxr": {"compressionargs": {"level": 1.0}},
    "png": {},
    "lerc": {},
    "lerc zstd": {"compressionargs": {"compression": "zstd"}},
    "lerc deflate": {"compressionargs": {"compression": "deflate"}},
    "webp": {"photometric": "rgb", "compressionargs": {"lossless": True}},
}


def write_compressed(path: Path, name: str, samples: np.ndarray = CUBE) -> None:
    """Writes samples with a compression of PICTURES; as colours where it holds nothing else."""
    import tifffile

    colors = np.stack([samples] * 3, -1) if name == "webp" else samples
    tifffile.imwrite(path, colors, compression=name.split()[0], **PICTURES[name])


def tiff_codecs() -> list[Seed]:
    """All but JPEG XR, which is decoded in a process of its own."""
    return [written("a.tif", partial(write_compressed, name=name)) for name in PICTURES if name != "jpegxr"]


def tiff_xr() -> list[Seed]:
    return [written("a.tif", partial(write_compressed, name="jpegxr"))]


def write_fax(path: Path) -> None:
    from PIL import Image

    Image.fromarray(CUBE[0] > 90).save(path, "TIFF", compression="group4")


def lsm_file() -> tuple[bytes, np.ndarray]:
    """An LSM file of 3 time points, 4 planes and 3 channels, and its samples [t, z, c, y, x]."""
    import tifffile

    samples = np.arange(3 * 4 * 3 * 12 * 14, dtype=np.uint16).reshape(3, 4, 3, 12, 14)
    fields = tifffile.TIFF.CZ_LSMINFO
    info = np.zeros((), np.dtype([(name or f"_{n}", kind) for n, (name, kind) in enumerate(fields)]))
    told: dict[str, float] = {
        "DimensionX": 14,
        "DimensionY": 12,
        "DimensionZ": 4,
        "DimensionChannels": 3,
        "DimensionTime": 3,
    }
    told |= {"MagicNumber": 50350412, "StructureSize": info.dtype.itemsize, "ScanType": 6, "TimeIntervall": 1.5}
    told |= {"VoxelSizeX": 2.5e-7, "VoxelSizeY": 2.5e-7, "VoxelSizeZ": 1e-6, "DataType": 2}
    for name, value in told.items():
        info[name] = value
    tag = [(34412, "B", info.dtype.itemsize, info.tobytes(), True)]
    out = io.BytesIO()
    with tifffile.TiffWriter(out, byteorder="<") as file:
        common: dict[str, Any] = {"planarconfig": "separate", "photometric": "minisblack", "metadata": None}
        for n, plane in enumerate(samples.reshape(-1, 3, 12, 14)):
            file.write(plane, software=False, extratags=tag if n == 0 else [], **common)
            file.write(np.zeros((3, 4, 4), np.uint8), software=False, subfiletype=1, **common)
    return out.getvalue(), samples


def lsm() -> list[Seed]:
    return [one("a.lsm", lsm_file()[0])]


def slices() -> list[Seed]:
    """Folders of PNG, BMP and TIFF, one of which has channels."""
    import tifffile
    from PIL import Image

    def picture(path: Path, ending: str) -> None:
        path.mkdir()
        for n, plane in enumerate(CUBE):
            Image.fromarray(plane).save(path / f"s{n}.{ending}", dpi=(254, 254))

    def channels(path: Path) -> None:
        path.mkdir()
        for n, plane in enumerate(CUBE):
            tifffile.imwrite(path / f"c{n % 2}_z{n // 2}.tif", plane, compression="lzw", resolution=(99.0, 99.0))
        (path / "scan.log").write_text("Image Pixel Size (um)=9.5\n")

    return [*(written("a", partial(picture, ending=ending)) for ending in ("png", "bmp")), written("a", channels)]


def zarr_zip() -> list[Seed]:
    import zarr

    def save(path: Path, version: int) -> None:
        with zarr.storage.ZipStore(path, mode="w", compression=8 * (version == 2)) as store:
            group = zarr.open_group(store, path="b" * (version == 2), mode="w", zarr_format=version)
            group.create_array("0", data=CUBE, chunks=(6, 5, 11))

    return [written("a.zarr.zip", partial(save, version=version)) for version in (2, 3)]

"""Small valid files of every reader, as seeds of readers.py."""

from __future__ import annotations

import bz2
import gzip
import io
import zipfile
import zlib
from collections.abc import Callable
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from tests.fuzz.seed_channels import (
    bigdataviewer,
    channels_of_tiff,
    channels_of_zarr,
    czi,
    lif,
    nd2,
    oib,
    times_of_nifti,
)
from tests.fuzz.seed_dicom import dicom_seeds
from tests.fuzz.seed_files import CUBE, FLOW, RAW, Seed, X, Y, Z, one, vti, vti_appended, vtk_cells, vtk_legacy, written
from tests.fuzz.seed_libraries import (
    components,
    hdf5,
    hdf5_layouts,
    hdf5_old,
    imaris,
    labels,
    mgh,
    mrc,
    netcdf,
    netcdf_classic,
    nibabel_pairs,
    nrrd_components,
    points,
    vtk_grids,
)
from tests.fuzz.seed_neuro import afni, minc1, minc2, nrrd_list, parrec, vtk_bits, vtk_surface, vtk_written
from tests.fuzz.seed_pictures import lsm, slices, tiff_codecs, tiff_xr, zarr_zip
from tests.fuzz.seed_segments import dicom_segments, dicom_words

# --- NumPy, raw -------------------------------------------------------------------------------------------------------


def npy() -> list[Seed]:
    arrays = (CUBE, np.asfortranarray(CUBE.astype(">f4")), CUBE > 90, CUBE.astype(np.float16))
    return [written("a.npy", partial(np.save, arr=array)) for array in arrays]


def npz() -> list[Seed]:
    def unpack(data: bytes) -> bytes:
        return zipfile.ZipFile(io.BytesIO(data)).read("cube.npy")

    def pack(data: bytes) -> bytes:
        out = io.BytesIO()
        with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("cube.npy", data)
        return out.getvalue()

    plain = written("a.npz", lambda path: np.savez(path, cube=CUBE, other=np.arange(4)))
    packed = written("a.npz", lambda path: np.savez_compressed(path, cube=CUBE))
    return [plain, one("a.npz", packed.files["a.npz"], unpack, pack)]


def raw() -> list[Seed]:
    names = {f"a_{X}x{Y}x{Z}_uint8.raw": CUBE, f"a_{X}x{Y}x{Z}_float32be.bin": CUBE.astype(">f4")}
    return [Seed(name, {name: array.tobytes()}, name_matters=True) for name, array in names.items()]


# --- NRRD, MetaImage --------------------------------------------------------------------------------------------------

NRRD = f"""NRRD0005
# a comment
type: {{type}}
dimension: 3
space: left-posterior-superior
sizes: {X} {Y} {Z}
space directions: (1.5,0,0) (0,2,0.5) (0,-0.5,3)
kinds: domain domain domain
endian: big
encoding: {{encoding}}
space origin: (10,-20,30.5)
space units: "mm" "mm" "mm"
{{more}}key:=value
"""
NRRD_4D = f"NRRD0004\ntype: uchar\ndimension: 4\nsizes: 1 {X} {Y} {Z}\nspacings: nan 1 -2 3\n"
NRRD_4D += "encoding: raw\nkinds: vector space space space\nline skip: 1\nbyte skip: -1\n\n"


def nrrd(encoding: str, packed: bytes, number: str = "uchar", more: str = "") -> bytes:
    return NRRD.format(encoding=encoding, type=number, more=more).encode() + b"\n" + packed


def nrrd_attached() -> list[Seed]:
    text = " ".join(map(str, CUBE.ravel())).encode()
    return [
        one("a.nrrd", nrrd("raw", RAW)),
        one("a.nrrd", nrrd("raw", CUBE.astype(">i2").tobytes(), "short")),
        one("a.nrrd", nrrd("text", text)),
        one("a.nrrd", NRRD_4D.encode() + RAW),
    ]


def nrrd_packed() -> list[Seed]:
    import bz2

    return [
        one("a.nrrd", nrrd("gzip", gzip.compress(RAW))),
        one("a.nrrd", nrrd("bzip2", bz2.compress(RAW))),
        one("a.nrrd", nrrd("gzip", gzip.compress(CUBE.astype(">f4").tobytes()), "float")),
    ]


def nrrd_detached() -> list[Seed]:
    header = nrrd("raw", b"", more="data file: a.raw\nbyte skip: 4\nline skip: 0\n")
    packed = nrrd("gzip", b"", more="data file: b.gz\n")
    return [
        Seed("a.nhdr", {"a.nhdr": header, "a.raw": b"four" + RAW}),
        Seed("a.nhdr", {"a.nhdr": packed, "b.gz": gzip.compress(RAW)}),
    ]


META = f"""ObjectType = Image
NDims = 3
BinaryData = {{binary}}
BinaryDataByteOrderMSB = True
CompressedData = {{packed}}
TransformMatrix = 1 0 0 0 0.8 0.6 0 -0.6 0.8
Offset = 10 -20 30.5
CenterOfRotation = 0 0 0
AnatomicalOrientation = RAI
ElementSpacing = 1.5 2 3
DimSize = {X} {Y} {Z}
HeaderSize = {{skip}}
ElementNumberOfChannels = 1
ElementType = {{type}}
ElementDataFile = {{file}}
"""


def meta(file: str, data: bytes = b"", packed: bool = False, binary: bool = True, number: str = "MET_UCHAR") -> bytes:
    skip = -1 if file != "LOCAL" else 0
    return META.format(file=file, packed=packed, binary=binary, type=number, skip=skip).encode() + data


def metaimage() -> list[Seed]:
    text = " ".join(map(str, CUBE.ravel())).encode()
    return [
        one("a.mha", meta("LOCAL", RAW)),
        one("a.mha", meta("LOCAL", CUBE.astype(">f8").tobytes(), number="MET_DOUBLE")),
        one("a.mha", meta("LOCAL", text, binary=False)),
    ]


def metaimage_packed() -> list[Seed]:
    return [one("a.mha", meta("LOCAL", zlib.compress(RAW), packed=True))]


def metaimage_detached() -> list[Seed]:
    return [
        Seed("a.mhd", {"a.mhd": meta("a.raw"), "a.raw": b"skipped" + RAW}),
        Seed("a.mhd", {"a.mhd": meta("a.zraw", packed=True).replace(b"-1\n", b"0\n"), "a.zraw": zlib.compress(RAW)}),
    ]


# --- NIfTI, TIFF, Zarr ------------------------------------------------------------------------------------------------


def nifti(suffix: str = ".nii") -> list[Seed]:
    import nibabel

    seeds = []
    for form, array in ((nibabel.Nifti1Image, CUBE.T), (nibabel.Nifti2Image, CUBE.T[..., None].astype(">i2"))):
        image = form(array, np.diag([1.5, -2.0, 3.0, 1.0]))
        image.header.set_xyzt_units("mm")
        image.header.set_slope_inter(2.0, -3.0)
        image.header.extensions.append(nibabel.nifti1.Nifti1Extension("comment", b"a comment"))
        seed = written(f"a{suffix}", partial(nibabel.save, image))
        gz = suffix.endswith(".gz")
        packing = (gzip.decompress, partial(gzip.compress, compresslevel=1)) if gz else (None, None)
        seeds.append(one(f"a{suffix}", seed.files[f"a{suffix}"], *packing))
    packed = [one("a.nii.bz2", bz2.compress(gzip.decompress(seeds[0].files[f"a{suffix}"])))] if gz else []
    return [*seeds, *packed, times_of_nifti(suffix)]


CURVE = "ImageJ=1.53t\nimages=5\nslices=5\ncf=7\nc0=9\nc1=2\nc2=50\nc3=1\nvunit=OD\n"


def tiff() -> list[Seed]:
    import tifffile

    def seed(array: np.ndarray, **options: object) -> Seed:
        given = {"photometric": "minisblack", **options}
        return written("a.tif", lambda path: tifffile.imwrite(path, array, **given))

    stack = CUBE.astype(np.uint16)
    return [
        seed(CUBE, metadata=None),
        seed(stack, metadata=None, byteorder=">", compression="zlib", predictor=True),
        seed(stack, compression="lzw", rowsperstrip=4),
        seed(CUBE, metadata=None, compression="packbits", tile=(16, 16)),
        seed(CUBE.astype(np.float32), bigtiff=True, compression="zstd"),
        seed(CUBE, imagej=True, resolution=(2, 3), metadata={"spacing": 3.0, "unit": "um", "axes": "ZYX"}),
        seed(CUBE[0], metadata=None),
        seed(CUBE, description=CURVE, metadata=None, photometric="minisblack"),
        seed(CUBE.astype(np.complex64), photometric="minisblack"),
        *channels_of_tiff("a.tif"),
    ]


def ome_tiff() -> list[Seed]:
    import tifffile

    axes = {"PhysicalSizeX": 1.5, "PhysicalSizeY": 2.0, "PhysicalSizeZ": 3000, "PhysicalSizeZUnit": "nm"}

    def seed(array: np.ndarray, order: str, **options: object) -> Seed:
        return written(
            "a.ome.tif", lambda path: tifffile.imwrite(path, array, metadata={"axes": order, **axes}, **options)
        )

    def pyramid(path: Path) -> None:
        with tifffile.TiffWriter(path) as file:
            file.write(CUBE, subifds=1, tile=(16, 16), compression="zlib", metadata={"axes": "ZYX", **axes})
            file.write(CUBE[:, ::2, ::2], subfiletype=1, tile=(16, 16), compression="zlib")

    plain = seed(CUBE[None], "CZYX", compression="zlib", photometric="minisblack")
    return [seed(CUBE, "ZYX"), plain, written("a.ome.tif", pyramid), *channels_of_tiff("a.ome.tif")]


def zarr_store(version: int) -> list[Seed]:
    import zarr

    def grouped(path: Path) -> None:
        group = zarr.open_group(path, mode="w", zarr_format=version)
        group.create_array("0", data=CUBE, chunks=(6, 5, 11))
        scale = [{"type": "scale", "scale": [3, 2, 1.5]}, {"type": "translation", "translation": [0, 1, 2]}]
        axes = [{"name": name, "unit": "micrometer"} for name in "zyx"]
        images = {"multiscales": [{"axes": axes, "datasets": [{"path": "0", "coordinateTransformations": scale}]}]}
        group.attrs.update(images if version == 2 else {"ome": images})

    def array(path: Path, **options: object) -> None:
        zarr.create_array(path, data=CUBE, zarr_format=version, chunks=(3, 9, 11), **options)

    seeds = [written("a.zarr", grouped), written("a.zarr", partial(array, compressors=None))]
    if version == 3:
        seeds.append(written("a.zarr", partial(array, shards=(6, 9, 11))))
        zipped = written("a.zarr", partial(array, compressors=zarr.codecs.GzipCodec()))
        return [*seeds, zipped, *channels_of_zarr(version)]
    from numcodecs import GZip, Zstd

    packed = [written("a.zarr", partial(array, compressors=codec)) for codec in (GZip(), Zstd())]
    return [*seeds, *packed, *channels_of_zarr(version)]


def dicom(packed: bool) -> list[Seed]:
    return dicom_seeds(packed, written)


# --- terrain, scenes --------------------------------------------------------------------------------------------------


def picture() -> list[Seed]:
    from PIL import Image

    def saved(name: str, array: np.ndarray, **options: object) -> Seed:
        return written(name, lambda path: Image.fromarray(array).save(path, **options))

    return [
        saved("a.png", CUBE[0]),
        saved("a.png", CUBE[0].astype(np.uint16) * 300),
        saved("a.jpg", CUBE[0]),
        saved("a.jpeg", np.kron(CUBE[0], np.ones((4, 4), np.uint8)), progressive=True),
    ]


def table() -> list[Seed]:
    rows = (",".join(f"{v:.3f}" for v in row) for row in FLOW[0, :, :, 0])
    return [one("a.csv", "\n".join(rows).encode())]


SCENE = """volume = "cube.npy"
threshold = 0.01
[transfer]
points = [[0, 0.0], [50.5, 0.2], [200, 1.0]]
colormap = "bone"
window = [0, 200]
unit = 1.5
gradient = [[0, 0.2], [10, 1.0]]
shading = true
[camera]
size = [64, 48]
azimuth = 30
elevation = 20.5
fov = 40
up = [0, 0, 1]
orthographic = false
[settings]
blend = "composite"
samples = 4
table_bits = 32
tolerance = 0.004
background = [0, 0.5, 1]
[load]
spacing = [1, 1, 2]
"""


def scene() -> list[Seed]:
    cube = written("cube.npy", partial(np.save, arr=CUBE)).files["cube.npy"]
    return [Seed("a.toml", {"a.toml": SCENE.encode(), "cube.npy": cube}, "scene")]


def transfer() -> list[Seed]:
    text = SCENE.split("[transfer]\n")[1].split("[camera]")[0]
    return [Seed("a.toml", {"a.toml": text.encode()}, "transfer")]


_ALL: dict[str, Callable[[], list[Seed]]] = {
    "npy": npy,
    "npz": npz,
    "raw": raw,
    "nrrd": nrrd_attached,
    "nrrd-packed": nrrd_packed,
    "nrrd-detached": nrrd_detached,
    "metaimage": metaimage,
    "meta-packed": metaimage_packed,
    "meta-detached": metaimage_detached,
    "nifti": nifti,
    "nifti-gz": partial(nifti, ".nii.gz"),
    "tiff": tiff,
    "ome-tiff": ome_tiff,
    "minc-1": minc1,
    "minc-2": minc2,
    "afni": afni,
    "par-rec": parrec,
    "vtk-bits": vtk_bits,
    "nrrd-list": nrrd_list,
    "tiff-codecs": tiff_codecs,
    "tiff-xr": tiff_xr,
    "lsm": lsm,
    "slices": slices,
    "zarr-zip": zarr_zip,
    "zarr-2": partial(zarr_store, 2),
    "zarr-3": partial(zarr_store, 3),
    "dicom": partial(dicom, False),
    "dicom-packed": partial(dicom, True),
    "dicom-segments": dicom_segments,
    "dicom-words": dicom_words,
    "hdf5": hdf5,
    "hdf5-old": hdf5_old,
    "hdf5-layouts": hdf5_layouts,
    "netcdf": netcdf,
    "netcdf-classic": netcdf_classic,
    "components": components,
    "imaris": imaris,
    "bigdataviewer": bigdataviewer,
    "czi": czi,
    "lif": lif,
    "nd2": nd2,
    "oib": oib,
    "mrc": mrc,
    "analyze": nibabel_pairs,
    "mgh": mgh,
    "nrrd-components": nrrd_components,
    "vtk-grids": vtk_grids,
    "vtk-cells": vtk_cells,
    "vtk-written": vtk_written,
    "vtk-surface": vtk_surface,
    "labels": labels,
    "points": points,
    "vtk-ascii": partial(vtk_legacy, "ASCII"),
    "vtk-binary": partial(vtk_legacy, "BINARY"),
    "vti": vti,
    "vti-appended": vti_appended,
    "picture": picture,
    "csv": table,
    "scene": scene,
    "transfer": transfer,
}
SEEDS = {name: lru_cache(build) for name, build in _ALL.items()}
"""The good files of each reader, built once."""

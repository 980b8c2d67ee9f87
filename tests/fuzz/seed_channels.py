"""Seeds of readers.py with channels and time points."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from tests.fuzz.seed_files import CUBE, Seed, written
from tests.helpers import microscope_files as microscopes

# t, c, z, y, x
SERIES = np.stack([np.stack([CUBE, CUBE[::-1]]), np.stack([CUBE // 2, CUBE // 3])])


def times_of_nifti(suffix: str) -> Seed:
    """Two time points, 1.5 s apart."""
    import nibabel

    image = nibabel.Nifti1Image(SERIES[:, 0].T, np.diag([1.5, -2.0, 3.0, 1.0]))
    image.header.set_xyzt_units("mm", "msec")
    image.header["pixdim"][4] = 1500
    return written(f"a{suffix}", partial(nibabel.save, image))


def channels_of_tiff(name: str) -> list[Seed]:
    """Stacks and planes with two channels and two time points, as ImageJ or OME writes them by the name's ending."""
    import tifffile

    kind = "ome" if name.endswith(".ome.tif") else "imagej"
    tables = [np.stack([np.arange(256) * (k == n) for k in range(3)]).astype(np.uint8) for n in range(2)]
    ours = {
        "imagej": {"mode": "composite", "LUTs": tables, "Ranges": (1.0, 200.0, 2.0, 99.0), "finterval": 2.5}
        | {"Labels": ["DAPI", "GFP"] * (2 * len(CUBE))},
        "ome": {"Channel": {"Name": ["DAPI", "GFP"], "Color": [255, 0x00FF00FF]}, "TimeIncrement": 2.5},
    }[kind]

    def seed(array: np.ndarray, axes: str, **options: object) -> Seed:
        given = {kind: True, "metadata": {"axes": axes, **ours}, "photometric": "minisblack", **options}
        return written(name, lambda path: tifffile.imwrite(path, array, **given))

    return [
        seed(SERIES.swapaxes(1, 2), "TZCYX"),
        seed(SERIES.swapaxes(1, 2), "TZCYX", compression="zlib"),
        seed(SERIES[:, :, 0], "TCYX", compression="lzw"),
    ]


def channels_of_zarr(version: int) -> list[Seed]:
    """An OME-Zarr image with its channels, another with its axes turned, and an array with named dimensions."""
    import zarr

    kinds = {"t": {"type": "time", "unit": "second"}, "c": {"type": "channel"}}

    def image(path: Path, order: str, array: np.ndarray) -> None:
        group = zarr.open_group(path, mode="w", zarr_format=version)
        group.create_array("0", data=array, chunks=array.shape)
        steps = [{"type": "scale", "scale": [2.0] * array.ndim}]
        axes = [{"name": name, **kinds.get(name, {"unit": "micrometer"})} for name in order]
        looks = [("DAPI", "0000FF", 10, 90), ("GFP", "00FF00", 5, 70)]
        channels = [{"label": n, "color": c, "window": {"start": a, "end": b}} for n, c, a, b in looks]
        told = {
            "multiscales": [{"axes": axes, "datasets": [{"path": "0", "coordinateTransformations": steps}]}],
            "omero": {"channels": channels},
        }
        group.attrs.update(told if version == 2 else {"ome": told})

    def named(path: Path) -> None:
        given = {"dimension_names": ["time", "z", "y", "x"]} if version == 3 else {}
        array = zarr.create_array(path, data=SERIES[:, 0], zarr_format=version, **given)
        if version == 2:
            array.attrs["_ARRAY_DIMENSIONS"] = ["time", "z", "y", "x"]

    return [
        written("a.zarr", partial(image, order="tczyx", array=SERIES)),
        written("a.zarr", partial(image, order="xyct", array=SERIES[:, :, 0].T)),
        written("a.zarr", named),
    ]


def czi() -> list[Seed]:
    """Plain, JPEG XR and both kinds of Zstandard; colours; an overview."""
    stack = microscopes.STACK
    kinds = [(stack, 0, True), (stack, 4, False), (stack, 5, False), (stack, 6, False)]
    kinds.append((np.repeat(stack[..., None] // 16, 3, axis=-1)[:1, :1].astype(np.uint8), 0, False))
    return [
        written("a.czi", partial(microscopes.czi, scenes=(samples, samples), compression=code, pyramid=overview))
        for samples, code, overview in kinds
    ]


def lif() -> list[Seed]:
    return [written("a.lif", partial(microscopes.lif, stacks={"a": microscopes.STACK, "b": microscopes.STACK[:1]}))]


def nd2() -> list[Seed]:
    positions = (microscopes.STACK, microscopes.STACK)
    return [written("a.nd2", partial(microscopes.nd2, positions=positions, lossless=way)) for way in (False, True)]


def oib() -> list[Seed]:
    return [written("a.oib", microscopes.oib)]


def bigdataviewer() -> list[Seed]:
    """A view of two channels with two levels."""
    import h5py

    setups = "".join(
        f"<ViewSetup><id>{n}</id><name>a</name><size>{' '.join(map(str, CUBE.shape[::-1]))}</size><voxelSize>"
        f"<unit>um</unit><size>1 1 2</size></voxelSize><attributes><channel>{n}</channel></attributes></ViewSetup>"
        for n in range(2)
    )
    moved = "<affine>1 0 0 5 0 1 0 6 0 0 2 7</affine>"
    xml = (
        '<SpimData version="0.2"><SequenceDescription><ImageLoader format="bdv.hdf5"><hdf5 type="relative">a.h5</hdf5>'
        f'</ImageLoader><ViewSetups>{setups}</ViewSetups><Timepoints type="range"><first>0</first><last>1</last>'
        '</Timepoints></SequenceDescription><ViewRegistrations><ViewRegistration timepoint="0" setup="0">'
        f"<ViewTransform>{moved}</ViewTransform></ViewRegistration></ViewRegistrations></SpimData>"
    )

    def save(path: Path) -> None:
        with h5py.File(path, "w", libver="earliest") as file:
            for n in range(2):
                file[f"s{n:02}/resolutions"] = np.array([[1.0, 1, 1], [2, 2, 2]])
                for time in range(2):
                    for level, cube in enumerate((CUBE, CUBE[::2, ::2, ::2])):
                        name = f"t{time:05}/s{n:02}/{level}/cells"
                        file.create_dataset(name, data=cube.astype(np.int16), chunks=(3, 4, 5), compression="gzip")

    return [Seed("a.xml", {"a.xml": xml.encode(), **written("a.h5", save).files})]

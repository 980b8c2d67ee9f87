"""Seed files of readers.py: HDF5, NetCDF-4, Imaris, MRC, Analyze, MGH, NRRD's components, VTK's grids and lists."""

from __future__ import annotations

import bz2
import gzip
import json
import tempfile
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tests.fuzz.seed_files import CUBE, FLOW, Seed, X, Y, Z, one, written
from tests.helpers.points import BYTES, COLORED, PLACES, write_las, write_pcd, write_ply


def _hdf5(path: Path, libver: str = "latest", **options: Any) -> None:
    import h5py

    with h5py.File(path, "w", libver=libver) as file:
        node = file.create_dataset("g/cube", data=CUBE, **options)
        node.attrs["element_size_um"] = (3.0, 2.0, 1.5)
        node.attrs["unit"] = "um"
        file["g/other"] = np.arange(4)
        file["link"] = h5py.SoftLink("/g/cube")
        file["elsewhere"] = h5py.ExternalLink("b.h5", "/cube")


def hdf5(libver: str = "latest") -> list[Seed]:
    ways: list[dict[str, Any]] = [
        {},
        {"chunks": (3, 9, 11)},
        {"chunks": (3, 5, 4), "compression": "gzip", "shuffle": True, "fletcher32": True},
        {"chunks": (3, 5, 4), "compression": "lzf", "maxshape": (None, None, 11)},
    ]
    times = written("a.h5", partial(_hdf5_times, libver=libver))
    return [*(written("a.h5", partial(_hdf5, libver=libver, **way)) for way in ways), times]


def _hdf5_times(path: Path, libver: str) -> None:
    """Time points and channels by the labels of their axes, as ilastik writes them, and a scale of times."""
    import h5py

    with h5py.File(path, "w", libver=libver) as file:
        both = np.stack([np.stack([CUBE, CUBE[::-1]], -1), np.stack([CUBE // 2, CUBE // 3], -1)])
        node = file.create_dataset("cells", data=both, chunks=(1, 3, 9, 11, 2), compression="gzip")
        node.attrs["axistags"] = json.dumps({"axes": [{"key": key} for key in "tzyxc"]})
        for axis, label in enumerate("tzyxc"):
            node.dims[axis].label = label
        file["minutes"] = np.arange(2) * 5.0
        file["minutes"].attrs["units"] = "minutes since 2020-01-01"
        file["minutes"].make_scale("minutes")
        node.dims[0].attach_scale(file["minutes"])


def hdf5_old() -> list[Seed]:
    """As files of most programs are: superblock 0, B-trees of version 1."""
    return hdf5("earliest")


def netcdf() -> list[Seed]:
    import h5py

    def save(path: Path) -> None:
        with h5py.File(path, "w") as file:
            node = file.create_dataset("t", data=CUBE[None].astype(np.int16), chunks=(1, 3, 9, 11), compression="gzip")
            for name, value in (("scale_factor", 0.5), ("add_offset", 3.0), ("_FillValue", np.int16(7))):
                node.attrs[name] = value
            for axis, name in enumerate(("time", "lev", "lat", "lon")):
                file[name] = np.arange(node.shape[axis]) * 1.5
                file[name].attrs["units"] = "m"
                file[name].make_scale(name)
                node.dims[axis].attach_scale(file[name])

    return [written("a.nc", save)]


def hdf5_layouts() -> list[Seed]:
    """EMD, NeXus, MATLAB, VTK and ITK in HDF5."""
    import h5py

    def emd(path: Path) -> None:
        with h5py.File(path, "w") as file:
            group = file.create_group("data/cube")
            group.attrs["emd_group_type"] = 1
            group["data"] = CUBE
            for n, name in enumerate("zyx"):
                node = group.create_dataset(f"dim{n}", data=np.arange(2 if n else CUBE.shape[0]) * 1.5)
                node.attrs["name"], node.attrs["units"] = name, "[n_m]"

    def nexus(path: Path) -> None:
        with h5py.File(path, "w") as file:
            file.attrs["default"] = "entry"
            group = file.create_group("entry")
            group.attrs["signal"], group.attrs["axes"] = "data", ["z", "y", "x"]
            group["data"], group["errors"] = CUBE, CUBE
            for n, name in enumerate("zyx"):
                group[name] = np.arange(CUBE.shape[n] + 1) * 1.5

    def matlab(path: Path) -> None:
        with h5py.File(path, "w", userblock_size=512) as file:
            pairs = np.zeros(CUBE.shape, [("real", "f4"), ("imag", "f4")])
            pairs["real"] = CUBE
            file.create_dataset("a", data=pairs).attrs["MATLAB_class"] = np.bytes_("single")

    def vtk(path: Path) -> None:
        with h5py.File(path, "w") as file:
            group = file.create_group("VTKHDF")
            group.attrs["Type"], group.attrs["WholeExtent"] = np.bytes_("ImageData"), [0, X - 1, 0, Y - 1, 0, Z - 1]
            group.attrs["Spacing"], group.attrs["Origin"] = (0.5, 1, 2.0), (1.0, 2, 3)
            group.attrs["Direction"], group.attrs["Version"] = np.eye(3).ravel(), [2, 0]
            flow = np.stack([CUBE] * 3, -1).astype("f4")
            group["PointData/a"], group["PointData/flow"] = np.stack([CUBE] * 2), np.stack([flow] * 2)
            group.create_group("Steps").attrs["NSteps"] = 2
            group["Steps/Values"] = [0.5, 1.0]

    def itk(path: Path) -> None:
        with h5py.File(path, "w") as file:
            group = file.create_group("ITKImage/0")
            group["VoxelData"], group["Spacing"], group["Directions"] = CUBE, (0.5, 1, 2.0), np.eye(3)

    saves = {"a.emd": emd, "a.nxs": nexus, "a.mat": matlab, "a.vtkhdf": vtk, "a.h5": itk}
    return [written(name, save) for name, save in saves.items()]


def netcdf_classic() -> list[Seed]:
    import netCDF4

    def save(path: Path, form: str) -> None:
        with netCDF4.Dataset(path, "w", format=form) as file:
            for name, size in zip(("time", "z", "y", "x"), (None, *CUBE.shape), strict=True):
                file.createDimension(name, size)
                node = file.createVariable(name, "f8", (name,))
                node[:], node.units = np.arange(size or 2) * 1.5, "m" if size else "hours since 2000-01-01"
            node = file.createVariable("t", "i2", ("time", "z", "y", "x"), fill_value=7)
            node.scale_factor, node.valid_range, node.missing_value = 0.5, np.array([1, 90], "i2"), [8, 9]
            node[:] = np.stack([CUBE, CUBE])

    forms = ("NETCDF3_CLASSIC", "NETCDF3_64BIT_OFFSET", "NETCDF3_64BIT_DATA")
    return [written("a.nc", partial(save, form=form)) for form in forms]


def components() -> list[Seed]:
    """Colours and vectors of NumPy and NIfTI."""
    import nibabel

    rgb = np.stack([CUBE] * 3, -1).astype(np.uint8)
    flow = nibabel.Nifti1Image(np.stack([CUBE.T] * 3, -1)[:, :, :, None].astype("f4"), np.eye(4))
    flow.header.set_intent(1007)
    bytes_of_rgb = nibabel.Nifti1Image(rgb.view([(letter, "u1") for letter in "RGB"])[..., 0].T, np.eye(4))
    return [
        written("a.npy", partial(np.save, arr=rgb)),
        written("b.npy", partial(np.save, arr=CUBE[None] * 1j)),
        written("a.nii", lambda path: nibabel.save(flow, path)),
        written("b.nii.gz", lambda path: nibabel.save(bytes_of_rgb, path)),
    ]


def imaris() -> list[Seed]:
    import h5py

    def letters(node: Any, **told: object) -> None:
        for name, value in told.items():
            node.attrs[name] = np.array(list(str(value).encode()), "u1").view("S1")

    def save(path: Path, channels: int = 1, times: int = 1) -> None:
        with h5py.File(path, "w", libver="earliest") as file:
            for number in range(channels):
                told = {"Name": f"C{number}", "Color": "0.1 1 0.5", "ColorRange": "5 180"}
                letters(file.create_group(f"DataSetInfo/Channel {number}"), **told)
            image = file.create_group("DataSetInfo/Image")
            letters(image, ExtMin0=0, ExtMin1=1, ExtMin2=2, ExtMax0=16.5, ExtMax1=19, ExtMax2=20, Unit="um")
            for level, cube in enumerate((CUBE, CUBE[::2, ::2, ::2])):
                for time, number in np.ndindex(times, channels):
                    name = f"DataSet/ResolutionLevel {level}/TimePoint {time}/Channel {number}"
                    channel = file.create_group(name)
                    sizes = zip("ZYX", cube.shape, strict=True)
                    letters(channel, **{f"ImageSize{axis}": size for axis, size in sizes})
                    padded = np.pad(cube, [(0, -size % 4) for size in cube.shape])
                    channel.create_dataset("Data", data=padded, chunks=(4, 4, 4), compression="gzip")

    return [written("a.ims", save), written("a.ims", partial(save, channels=2, times=2))]


def mrc() -> list[Seed]:
    import mrcfile

    def save(path: Path, array: np.ndarray) -> None:
        with mrcfile.new(path) as file:
            file.set_data(array)
            file.voxel_size = (1.5, 2.0, 3.0)
            file.header.origin = (10, -20, 30.5)

    arrays = (CUBE.astype(np.float32), CUBE.astype(np.int8), CUBE.astype(np.complex64))
    plain = [written("a.mrc", partial(save, array=array)) for array in arrays]
    first = plain[0].files["a.mrc"]
    pack = partial(gzip.compress, compresslevel=1)
    return [*plain, one("a.map.gz", pack(first), gzip.decompress, pack), one("a.map.bz2", bz2.compress(first))]


def nibabel_pairs() -> list[Seed]:
    import nibabel

    affine = np.diag([-1.5, 2.0, 3.0, 1.0])

    def pair(path: Path, form: Any) -> None:
        nibabel.save(form(CUBE.T.astype(np.int16), affine), path.with_suffix(".img"))

    def both(form: Any) -> Seed:
        files: dict[str, bytes] = {}
        with tempfile.TemporaryDirectory() as folder:
            pair(Path(folder) / "a.hdr", form)
            for suffix in (".hdr", ".img"):
                files[f"a{suffix}"] = (Path(folder) / f"a{suffix}").read_bytes()
        return Seed("a.hdr", files)

    forms = (nibabel.AnalyzeImage, nibabel.Spm2AnalyzeImage, nibabel.Nifti1Pair, nibabel.Nifti2Pair)
    packed = {f"{name}.gz": gzip.compress(data) for name, data in both(nibabel.Nifti1Pair).files.items()}
    return [*map(both, forms), Seed("a.hdr.gz", packed, unpack=gzip.decompress, pack=gzip.compress)]


def mgh() -> list[Seed]:
    import nibabel

    image = nibabel.MGHImage(CUBE.T, np.diag([-1.5, 2.0, 3.0, 1.0]))
    plain = written("a.mgh", partial(nibabel.save, image))
    pack = partial(gzip.compress, compresslevel=1)
    return [plain, one("a.mgz", pack(plain.files["a.mgh"]), gzip.decompress, pack)]


def nrrd_components() -> list[Seed]:
    head = "NRRD0004\ntype: {type}\ndimension: 4\nsizes: {sizes}\nencoding: raw\nendian: little\nkinds: {kinds}\n\n"
    told: dict[str, tuple[str, np.ndarray, str, tuple[int, ...]]] = {
        "3-color": ("uchar", FLOW.astype(np.uint8), "3-color space space space", (3, X, Y, Z)),
        "vector": ("float", np.moveaxis(FLOW, -1, 0), "space space space vector", (X, Y, Z, 3)),
        "time": ("float", np.moveaxis(FLOW, -1, 1)[:, :1], "space space time space", (X, Y, 1, Z)),
    }
    return [
        one("a.nrrd", head.format(type=kind, sizes=" ".join(map(str, sizes)), kinds=kinds).encode() + data.tobytes())
        for kind, data, kinds, sizes in told.values()
    ]


VTR = f"""<VTKFile type="RectilinearGrid" version="1.0" byte_order="LittleEndian" header_type="UInt64">
<RectilinearGrid WholeExtent="2 {X + 1} 0 {Y - 1} 0 {Z - 1}"><Piece Extent="{{extent}}">
<CellData><DataArray type="Float32" Name="cells" format="ascii">{{cells}}</DataArray></CellData>
<PointData><DataArray type="UInt8" Name="density" format="ascii">{{density}}</DataArray></PointData>
<Coordinates>{{axes}}</Coordinates></Piece></RectilinearGrid></VTKFile>
"""
LIST = '<VTKFile type="{kind}" version="1.0"><{kind}{more}>{entries}</{kind}></VTKFile>'


def vtk_grids() -> list[Seed]:
    """A rectilinear grid, two pieces of it, a time series and blocks."""
    left, right = _vtr(0, 4), _vtr(4, Z - 1)
    pieces = "".join(f'<Piece Extent="2 {X + 1} 0 {Y - 1} {z}" Source="{n}.vtr"/>' for n, z in ((1, "0 4"), (2, "4 5")))
    whole = f' WholeExtent="2 {X + 1} 0 {Y - 1} 0 {Z - 1}" GhostLevel="0"'
    arrays = '<PCellData><PDataArray type="Float32" Name="cells"/></PCellData><PPointData><PDataArray type="UInt8" '
    arrays += 'Name="density"/></PPointData><PCoordinates>'
    arrays += '<PDataArray type="Float64" Name="c"/>' * 3 + "</PCoordinates>"
    parent = LIST.format(kind="PRectilinearGrid", more=whole, entries=arrays + pieces).encode()
    steps = '<DataSet timestep="0.5" part="0" file="1.vtr"/>'
    blocks = '<Block index="0"><DataSet index="0" name="one" file="3.vtr"/></Block>'
    files = {"1.vtr": left, "2.vtr": right, "3.vtr": _vtr(0, Z - 1)}
    return [
        one("a.vtr", _vtr(0, Z - 1)),
        Seed("a.pvtr", {"a.pvtr": parent, **files}),
        Seed("a.pvd", {"a.pvd": LIST.format(kind="Collection", more="", entries=steps).encode(), **files}),
        Seed("a.vtm", {"a.vtm": LIST.format(kind="vtkMultiBlockDataSet", more="", entries=blocks).encode(), **files}),
    ]


def _vtr(low: int, high: int) -> bytes:
    def words(array: np.ndarray) -> str:
        return " ".join(f"{value:g}" for value in array.ravel())

    places = (np.arange(X) * 1.5, np.arange(Y) * 2.0, np.arange(low, high + 1) * 3.0)
    start = '<DataArray type="Float64" Name="c" format="ascii">'
    cells = FLOW[low:high, : Y - 1, : X - 1, 0]
    return VTR.format(
        extent=f"2 {X + 1} 0 {Y - 1} {low} {high}",
        cells=words(cells),
        density=words(CUBE[low : high + 1]),
        axes="".join(f"{start}{words(each)}</DataArray>" for each in places),
    ).encode()


TABLE = """################################################
# ITK-SnAP Label Description File
# File format:
# IDX   -R-  -G-  -B-  -A--  VIS MSH  LABEL
################################################
    0     0    0    0        0  0  0    "Clear Label"
    1   255    0    0        1  1  1    "Left hippocampus"
    2     0  255   12      0.5  1  0    "A"
   17     0    0  255        1  0  0    "hidden"
"""


def points() -> list[Seed]:
    columns = [*PLACES.T, *BYTES.T]
    las = [written(name, partial(write_las, colors=BYTES.astype(np.uint16))) for name in ("a.las", "a.laz")]
    pcd = [written("a.pcd", partial(write_pcd, kind=kind)) for kind in ("ascii", "binary", "binary_compressed")]
    forms = ("ascii", "binary_big_endian")
    ply = [written("a.ply", partial(write_ply, form=form, names=COLORED, columns=columns)) for form in forms]
    return las + pcd + ply


def labels() -> list[Seed]:
    """Segmentations with tables: ITK-SNAP's beside a NIfTI and an NRRD file, 3D Slicer's in NRRD, OME-Zarr's."""
    import nibabel
    import nrrd
    import zarr

    few = (CUBE % 4).astype(np.uint8)
    image = written("a.nii", partial(nibabel.save, nibabel.Nifti1Image(few.T, np.diag([1.0, 2.0, 3.0, 1.0]))))
    tags = {f"Segment{n}_{key}": value for n in range(2) for key, value in
            (("Name", f"part {n}"), ("LabelValue", str(n + 1)), ("Color", "0.1 0.9 0.4"), ("Layer", "0"))}  # fmt: skip
    plain = written("a.nrrd", lambda path: nrrd.write(str(path), few.T, {"encoding": "raw"}))
    slicer = written("a.seg.nrrd", lambda path: nrrd.write(str(path), few.T, {"encoding": "raw", **tags}))

    def ome(path: Path) -> None:
        group = zarr.open_group(path, mode="w", zarr_format=2)
        group.create_array("0", data=few, chunks=few.shape)
        axes = [{"name": name} for name in "zyx"]
        steps = [{"type": "scale", "scale": [1.0, 1.0, 1.0]}]
        colors = [{"label-value": n, "rgba": [n, 50, 200, 255]} for n in (1, 2)]
        group.attrs["multiscales"] = [{"axes": axes, "datasets": [{"path": "0", "coordinateTransformations": steps}]}]
        group.attrs["image-label"] = {"colors": colors, "properties": [{"label-value": 1, "class": "a"}]}

    return [
        Seed("a.nii", {"a.label": TABLE.encode(), **image.files}),
        Seed("a.nrrd", {"a.txt": TABLE.encode(), **plain.files}),
        slicer,
        written("a.zarr", ome),
    ]

"""HDF5, NetCDF-4 and Imaris: files written by h5py, read back; what names other files is refused."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest
from PIL import Image as Pillow

import splatgl as sg
from splatgl.cli.main import main
from splatgl.errors import InputError
from splatgl.readers import hdf5_files, load
from splatgl.readers.chunked import Chunked, Packing
from splatgl.readers.common import is_mapped
from splatgl.readers.hdf5 import _SPACINGS
from tests.helpers.phantom import SPACING, F

pytestmark = pytest.mark.usefixtures("shared_programs", "sound_files")

h5py = pytest.importorskip("h5py")

BIG = np.random.default_rng(1).integers(0, 2**16, (40, 50, 60), np.uint16)
WAYS: dict[str, dict[str, Any]] = {
    "plain": {},
    "gzip": {"chunks": (3, 4, 5), "compression": "gzip", "shuffle": True, "fletcher32": True},
    "lzf": {"chunks": (2, 7, 5), "compression": "lzf"},
}


def save(path: Path, name: str = "g/letter", data: np.ndarray = F, **options: Any) -> Path:
    """Writes or extends a file by one dataset."""
    attributes = options.pop("attributes", {})
    with h5py.File(path, "a") as file:
        node = file.create_dataset(name, data=data, **options)
        node.attrs.update(attributes)
    return path


@pytest.mark.few(4)
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("dtype", ["u1", ">i2", "<f4", "f8"])
def test_the_only_volume_is_read(tmp_path: Path, way: str, dtype: str) -> None:
    path = save(
        tmp_path / "letter.h5", data=F.astype(dtype), **WAYS[way], attributes={"element_size_um": SPACING[::-1]}
    )
    save(path, "table", np.arange(9))
    volume = load(path)
    np.testing.assert_array_equal(volume.samples, F)
    assert (volume.spacing, volume.unit, volume.name) == (SPACING, "um", "letter")
    assert volume.samples.dtype == np.dtype(dtype) and is_mapped(volume.samples) == (way == "plain")


def test_one_of_several_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = save(save(tmp_path / "a.h5"), "other", F + 1)
    with pytest.raises(
        InputError, match=r"a\.h5: datasets: expected one volume, got 2 in /g/letter 4×7×5, /other 4×7×5"
    ):
        load(path)
    for found in (load(f"{path}:/other"), load(path, array="/other"), load(path, array="other")):
        np.testing.assert_array_equal(found.samples, F + 1)
    with pytest.raises(InputError, match=r"dataset of numbers: /g/letter, /other, got '/no'"):
        load(f"{path}:/no")
    assert main(["info", str(path)]) == 0
    assert "* /g/letter   uint8 4×7×5\n* /other   uint8 4×7×5\n" in capsys.readouterr().out
    assert main(["info", f"{path}:/other"]) == 0
    assert "5 × 7 × 4" in capsys.readouterr().out


@pytest.mark.parametrize("axis", [0, 3])
def test_a_short_axis_is_channels(tmp_path: Path, axis: int) -> None:
    path = save(tmp_path / "a.h5", data=np.stack([F, F + 1], axis))
    with pytest.raises(InputError, match="pick with channel=0 … channel=1, channel=all"):
        load(path)
    np.testing.assert_array_equal(load(path, channel=1).samples, F + 1)
    both = load(path, channel="1,0").channels
    assert [each.name for each in both] == ["1", "0"] and np.array_equal(both[0].samples, F + 1)
    assert len(load(path, channel="all").channels) == 2


def test_labels_tell_the_axes(tmp_path: Path) -> None:
    path = save(tmp_path / "a.h5", data=F.transpose(2, 1, 0))
    with h5py.File(path, "a") as file:
        for axis, name in enumerate("xyz"):
            file["g/letter"].dims[axis].label = name
    np.testing.assert_array_equal(load(path).samples, F)
    tags = '{"axes": [{"key": "x"}, {"key": "y"}, {"key": "z"}, {"key": "c"}]}'
    data = F.transpose(2, 1, 0)[..., None].repeat(40, axis=3) + np.arange(40, dtype=np.uint8)
    path = save(tmp_path / "b.h5", data=data, attributes={"axistags": tags, "resolution": (1, 2, 3, 1)})
    assert load(path, channel=39).spacing == (1, 2, 3)
    np.testing.assert_array_equal(load(path, channel=39).samples, F + np.uint8(39))


def test_large_ones_are_read_in_parts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = save(tmp_path / "a.h5", data=BIG, chunks=(8, 8, 8), compression="gzip")
    whole = load(path).samples
    monkeypatch.setattr(hdf5_files, "WHOLE_BYTES", 1000)
    monkeypatch.setattr(hdf5_files, "_PART_BYTES", 2**14)
    part = load(path).samples
    assert isinstance(whole, np.ndarray) and isinstance(part, Chunked) and part.chunks != (8, 8, 8)
    np.testing.assert_array_equal(part[5:30, 20:45, ::7], BIG[5:30, 20:45, ::7])
    np.testing.assert_array_equal(part[:], whole)


@pytest.mark.parametrize("chunks", [None, (64, 64, 64)])
def test_what_is_only_declared_takes_no_memory(tmp_path: Path, chunks: tuple[int, ...] | None) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("a", (10**5,) * 3, "f4", chunks=chunks, fillvalue=7)
    volume = load(tmp_path / "a.h5")
    assert volume.count == 10**15
    assert (volume.samples[50_000:50_002, :3, 99_999] == 7).all() and not volume.samples.cache


def test_a_chunk_that_inflates_beyond_its_size_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import zlib

    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        node = file.create_dataset("a", (8, 8, 8), "u1", chunks=(8, 8, 8), compression="gzip")
        node.id.write_direct_chunk((0, 0, 0), zlib.compress(bytes(10**7)))
    monkeypatch.setattr(hdf5_files, "MAX_BYTES", 2**20)
    with pytest.raises(InputError, match="chunk: expected 512 bytes, got more"):
        load(path)


def elsewhere(folder: Path) -> dict[str, Path]:
    """Files that name another one, by what does so."""
    save(folder / "other.h5")
    (folder / "other.raw").write_bytes(F.tobytes())
    made = {}
    for kind in ("link", "soft", "raw", "virtual"):
        made[kind] = folder / f"{kind}.h5"
        with h5py.File(made[kind], "w") as file:
            if kind in ("link", "soft"):
                file["a" if kind == "link" else "b"] = h5py.ExternalLink(str(folder / "other.h5"), "/g/letter")
            if kind == "soft":
                file["a"] = h5py.SoftLink("/b")
            elif kind == "raw":
                file.create_dataset("a", F.shape, "u1", external=[(str(folder / "other.raw"), 0, F.size)])
            elif kind == "virtual":
                layout = h5py.VirtualLayout(F.shape, "u1")
                layout[:] = h5py.VirtualSource(str(folder / "other.h5"), "/g/letter", F.shape)
                file.create_virtual_dataset("a", layout)
    return made


@pytest.mark.parametrize("kind", ["link", "soft", "raw", "virtual"])
def test_data_in_other_files_are_read_where_that_is_allowed(tmp_path: Path, kind: str) -> None:
    path = elsewhere(tmp_path)[kind]
    with pytest.raises(InputError, match=r"expected data in this file, got data elsewhere \(.*--anywhere"):
        load(path, array="/a")
    np.testing.assert_array_equal(load(path, array="/a", anywhere=True).samples, F)


@pytest.mark.parametrize("name", ["scaleoffset", "szip"])
def test_filters_that_come_with_hdf5(tmp_path: Path, name: str) -> None:
    if name == "szip" and not h5py.h5z.filter_avail(h5py.h5z.FILTER_SZIP):
        pytest.skip("this build of HDF5 has no szip")
    options: dict[str, Any] = {"scaleoffset": 0} if name == "scaleoffset" else {"compression": name, "fletcher32": True}
    path = save(tmp_path / "a.h5", data=F.astype("i4"), chunks=F.shape, **options)
    np.testing.assert_array_equal(load(path).samples, F.astype("i4"))


def test_a_filter_whose_result_is_larger_than_a_chunk(tmp_path: Path) -> None:
    """Scaleoffset allocates the numbers that its parameters state, which are those of a chunk."""
    path = save(tmp_path / "a.h5", data=F.astype("i4"), chunks=F.shape, scaleoffset=8)
    stated = struct.pack("<5I", 2, 8, F.size, 0, 4)
    assert path.read_bytes().count(stated) == 1
    path.write_bytes(path.read_bytes().replace(stated, struct.pack("<5I", 2, 8, 2**30, 0, 4)))
    with pytest.raises(InputError, match="scaleoffset: expected the chunk's size, got"):
        load(path)


@pytest.mark.parametrize("filters", [{32008: "bitshuffle"}, {2: "shuffle", 32015: "zstd"}, {305: "lzo"}, {60000: ""}])
def test_filters_that_are_not_there_are_named(
    tmp_path: Path, filters: dict[int, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those of hdf5plugin with the way to get it."""
    there = h5py.h5z.filter_avail
    monkeypatch.setattr(h5py.h5z, "filter_avail", lambda code: code < 305 and there(code))
    plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    plist.set_chunk(F.shape)
    for code in filters:
        plist.set_filter(code, h5py.h5z.FLAG_OPTIONAL, ())
    with h5py.File(tmp_path / "a.h5", "w") as file:
        h5py.h5d.create(file.id, b"a", h5py.h5t.NATIVE_FLOAT, h5py.h5s.create_simple(F.shape), plist)
    code, name = list(filters.items())[-1]
    fix = r"install hdf5plugin: pip install 'splatgl\[hdf5-filters\]'; or " * (code > 32000 and bool(name))
    with pytest.raises(InputError, match=rf"filters: expected gzip, .*, got {name} ?\({code}\); {fix}repack it with"):
        load(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5") as file, pytest.raises(InputError, match=rf"filters: .* got {name} ?\({code}\)"):
        sg.Volume.of(file["a"])


@pytest.mark.parametrize("name", ["Bitshuffle", "Blosc", "Blosc2", "BZip2", "LZ4", "Zstd"])
def test_filters_of_hdf5plugin(tmp_path: Path, name: str) -> None:
    plugin = pytest.importorskip("hdf5plugin")
    path = save(tmp_path / "a.h5", data=F.astype("i4"), chunks=F.shape, compression=getattr(plugin, name)())
    np.testing.assert_array_equal(load(path).samples, F.astype("i4"))
    if name in ("Bitshuffle", "Blosc", "LZ4"):
        # the size in the first bytes of the chunk
        with h5py.File(path) as file:
            start = file["g/letter"].id.get_chunk_info(0).byte_offset
        data = bytearray(path.read_bytes())
        data[start : start + 8] = (
            data[start : start + 4] + bytes([255] * 4) if name == "Blosc" else bytes([0, 0, 0, 127] * 2)
        )
        path.write_bytes(data)
        with pytest.raises(InputError, match=r"chunk: expected \d+ bytes, got more"):
            load(path)


def test_files_on_which_the_library_fails_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A process of its own looks first; here it is one that ends as a crashed one does."""
    path = save(tmp_path / "a.h5")
    monkeypatch.setattr(hdf5_files, "_LOOK", "os:abort")
    with pytest.raises(InputError, match="the format's library crashes"):
        load(path)


# --- NetCDF ----------------------------------------------------------------------------------------------------------


def netcdf(path: Path, heights: np.ndarray) -> Path:
    stored = F.astype(np.int16)[None]
    with h5py.File(path, "w") as file:
        node = file.create_dataset("t", data=stored)
        node.attrs.update({"scale_factor": 0.5, "add_offset": 3.0, "_FillValue": np.int16(F[0, 0, 0]), "units": "K"})
        axes = {"time": np.arange(1.0), "z": heights, "y": 100 - 2.5 * np.arange(7), "x": 1.5 * np.arange(5)}
        for axis, (name, places) in enumerate(axes.items()):
            file[name] = places
            file[name].attrs["units"] = "km"
            file[name].make_scale(name)
            node.dims[axis].attach_scale(file[name])
    return path


def test_netcdf_unpacks_values_and_takes_the_grid_of_its_scales(tmp_path: Path) -> None:
    volume = load(netcdf(tmp_path / "a.nc", np.array([10.0, 14, 18, 22])))
    want = np.where(F[0, 0, 0] == F, np.nan, F * 0.5 + 3.0)
    np.testing.assert_array_equal(volume.samples, want.astype(np.float32))
    assert (volume.spacing, volume.origin, volume.unit) == ((1.5, 2.5, 4.0), (0.0, 100.0, 10.0), "km")
    np.testing.assert_array_equal(volume.direction, np.diag([1, -1, 1]))


def test_uneven_scales_are_resampled_unless_spacing_is_said(tmp_path: Path) -> None:
    path = netcdf(tmp_path / "a.nc", np.array([10.0, 14, 22, 34]))
    volume = load(path)
    told = "z: 4 samples in steps of 4 to 12 km, resampled every 4 km; RMSE at its own points 0 % of the range"
    assert volume.notes == (told,)
    assert volume.spacing == (1.5, 2.5, 4.0) and volume.shape == (7, 7, 5)
    given = load(path, spacing=(1, 2, 3))
    assert given.spacing == (1, 2, 3) and given.shape == F.shape and "rendered as uniform" in given.notes[0]
    np.testing.assert_array_equal(given.direction, np.diag([1, -1, 1]))
    # of whole numbers the nearest, of others the line between
    np.testing.assert_array_equal(volume.samples[[0, 1, 3, 6]], given.samples)
    both = given.samples[1:3].mean(axis=0)
    np.testing.assert_allclose(volume.samples[2], np.where(np.isnan(both), volume.samples[2], both), rtol=1e-6)
    with pytest.raises(InputError, match="z of /t: expected coordinates that rise or fall throughout"):
        load(netcdf(tmp_path / "b.nc", np.array([10.0, 14, 12, 34])))


def weather(path: Path, axes: dict[str, tuple[np.ndarray, dict[str, str]]], data: np.ndarray, name: str = "u") -> Path:
    """A dataset whose axes, in order, have these coordinates and attributes; None: no coordinate."""
    with h5py.File(path, "w") as file:
        node = file.create_dataset(name, data=data)
        for axis, (label, (places, told)) in enumerate(axes.items()):
            if places is None:
                continue
            file[label] = places
            file[label].attrs.update(told)
            file[label].make_scale(label)
            node.dims[axis].attach_scale(file[label])
    return path


LAT = np.linspace(60.0, 40, 11), {"units": "degrees_north"}
LON = np.linspace(-10.0, 15, 26), {"units": "degrees_east"}
# levels: places, attributes, the order of what is below and above, and the name of the axis
LEVELS: dict[str, tuple[str, np.ndarray, dict[str, str], bool]] = {
    "pressure": ("pressure_level", np.array([1000.0, 850, 700, 500, 300, 100]), {"units": "hPa"}, False),
    "pressure, rising": ("plev", np.array([1e4, 3e4, 5e4, 7e4, 8.5e4, 1e5]), {"units": "Pa"}, True),
    "millibars": ("level", np.array([100.0, 300, 500, 700, 850, 1000]), {"units": "millibars"}, True),
    "depth": ("deptht", np.array([0.5, 10, 30, 100, 200, 500]), {"units": "m", "positive": "down"}, True),
    "depth by its name": ("depth", np.array([0.5, 10, 30, 100, 200, 500]), {"units": "m"}, True),
    "depth by its standard name": ("a", np.arange(6.0), {"units": "m", "standard_name": "depth"}, True),
    "negative depth": ("z", np.arange(-5.0, 1), {"units": "m", "positive": "up"}, False),
    "sigma": ("lev", np.linspace(1, 0, 6), {"units": "1", "standard_name": "atmosphere_sigma_coordinate"}, False),
    "model levels": ("model_level", np.arange(1.0, 7), {"units": "1", "positive": "down"}, True),
    "altitude": ("altitude", np.array([0.0, 1, 2, 4, 8, 16]), {"units": "km"}, False),
}


@pytest.mark.few(8)
@pytest.mark.parametrize("kind", LEVELS)
@pytest.mark.parametrize("flip", [False, True])
def test_up_in_the_world_is_up(kind: str, flip: bool, tmp_path: Path) -> None:
    """North, east and up are +y, +x and +z: a place that is near the top of the world is near the top of the volume."""
    name, places, told, is_reversed = LEVELS[kind]
    order = slice(None, None, -1) if flip else slice(None)
    data = np.zeros((6, 11, 26), np.float32)
    # near the ground, in the north-east
    data[5 if is_reversed else 0, 1, 23] = 9.0
    lat = LAT[0][order], LAT[1]
    axes = {name: (places[order], told), "latitude": lat, "longitude": LON}
    volume = load(weather(tmp_path / "a.nc", axes, data[order, order]))
    index = np.unravel_index(int(np.argmax(volume.samples)), volume.shape)[::-1]
    place = volume.world_from_index @ index + volume.origin
    low, high = volume.corners.min(axis=0), volume.corners.max(axis=0)
    share = (place - low) / (high - low)
    assert share[0] > 0.85 and share[1] > 0.8 and share[2] < 0.25
    assert place[:2] == pytest.approx((13, 58)) and volume.unit == ""
    # what has another unit than degrees is drawn half as high as the picture is wide
    np.testing.assert_allclose((high - low)[:2], (26, 22))
    assert (high - low)[2] == pytest.approx(13) and any("is rendered as" in note for note in volume.notes)


def test_a_jet_between_uneven_levels_stays_where_it_is(tmp_path: Path) -> None:
    """Resampled linearly in pressure: exact for what is linear, and the largest value stays at its level."""
    levels = np.array([1000, 925, 850, 700, 600, 500, 400, 300, 250, 200, 150, 100], float)
    data = np.broadcast_to((1000 - np.abs(levels - 300))[:, None, None], (12, 11, 26)).astype(np.float32)
    axes = {"pressure_level": (levels, {"units": "hPa"}), "latitude": LAT, "longitude": LON}
    volume = load(weather(tmp_path / "a.nc", axes, data))
    factor = float(volume.notes[1].split("rendered as ")[1].split()[0])
    z = volume.origin[2] + volume.spacing[2] * volume.direction[2, 2] * np.arange(volume.shape[0])
    hectopascals = -z / factor
    np.testing.assert_allclose(hectopascals, np.arange(1000, 99, -50), rtol=1e-3)
    np.testing.assert_allclose(volume.samples[:, 0, 0], 1000 - np.abs(hectopascals - 300), atol=1.5)


def test_longitudes_go_on_beyond_360(tmp_path: Path) -> None:
    data = np.zeros((6, 11, 26), np.float32)
    axes = {"level": (np.arange(6.0), {}), "latitude": LAT, "longitude": (np.arange(345, 371) % 360, LON[1])}
    volume = load(weather(tmp_path / "a.nc", axes, data))
    assert volume.origin[0] == 345 and volume.spacing[0] == 1


def test_times_of_newer_names(tmp_path: Path) -> None:
    for name, told in (("valid_time", {}), ("when", {"units": "hours since 1970-01-01"}), ("T", {"axis": "T"})):
        axes = {name: (np.arange(2) * 3.0, told), "level": (np.arange(6.0), {}), "latitude": LAT, "longitude": LON}
        data = np.arange(2, dtype=np.float32)[:, None, None, None] * np.ones((2, 6, 11, 26), np.float32)
        path = weather(tmp_path / f"{name}.nc", axes, data)
        volume = load(path, time=1)
        assert volume.times == 2 and (volume.samples == 1).all() and not volume.channels
        assert volume.time_step == (10800 if "hours" in str(told) else None)


def test_lengths_share_a_scale_and_an_axis_without_places_gets_an_aspect(tmp_path: Path) -> None:
    axes: dict[str, Any]
    places = {"y": (np.arange(11) * 2.0, {"units": "km"}), "x": (np.arange(26) * 1.0, {"units": "km"})}
    axes = {"z": (np.arange(6) * 500.0, {"units": "m"}), **places}
    volume = load(weather(tmp_path / "a.nc", axes, np.zeros((6, 11, 26), np.float32)))
    assert volume.spacing == pytest.approx((1, 2, 0.5)) and volume.unit == "km" and volume.notes == ()
    axes = {"deptht": (np.arange(6) * 500.0, {"units": "m", "positive": "down"}), "y": (None, {}), "x": (None, {})}
    volume = load(weather(tmp_path / "b.nc", axes, np.zeros((6, 11, 26), np.float32)))
    assert volume.spacing == pytest.approx((1, 1, 13 / 6)) and volume.direction[2, 2] == -1
    assert "1 m of deptht is rendered as" in volume.notes[0]
    with h5py.File(tmp_path / "b.nc", "a") as file:
        file["u"].attrs["coordinates"] = "nav_lat nav_lon time_centered"
    assert "two dimensions (nav_lat, nav_lon) are not used" in load(tmp_path / "b.nc").notes[1]


def test_large_ones_are_resampled_where_they_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from splatgl.data import affine

    levels = np.array([0.0, 1, 2, 4, 6])
    data = np.random.default_rng(3).random((5, 40, 50)).astype(np.float32)
    axes: dict[str, Any] = {"z": (levels, {}), "y": (np.arange(40.0), {}), "x": (np.arange(50.0), {})}
    path = weather(tmp_path / "a.nc", axes, data)
    whole = load(path).samples
    monkeypatch.setattr(affine, "WHOLE_BYTES", 1000)
    part = load(path).samples
    assert isinstance(part, affine.Resampled) and part.shape == whole.shape == (7, 40, 50)
    for key in (np.s_[2:6, 3:9, 4:40], np.s_[3], np.s_[3, 4, 5], np.s_[...], np.s_[:, 7], np.s_[0:0]):
        np.testing.assert_array_equal(part[key], whole[key])
    counts = load(
        weather(tmp_path / "b.nc", axes, np.arange(5, dtype=np.int16)[:, None, None] * np.ones((5, 40, 50), "i2"))
    )
    assert set(np.unique(counts.samples)) == set(range(5)) and counts.samples.dtype == np.int16


def test_resampled_grids_fit_in_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """The smallest cell where it fits; within the budget less of what is refined most, never fewer than there are."""
    from splatgl.data import affine

    axes = [affine.Coordinate(name, 4, np.array([0.0, 1, 3, last])) for name, last in (("z", 1e3), ("y", 20), ("x", 9))]
    for memory, sizes in ((2**30, (1001, 21, 10)), (32 * 10_000, (47, 21, 10)), (32 * 64, (4, 4, 4))):
        monkeypatch.setattr(affine, "budget", lambda memory=memory: memory)
        grid = affine.make_lattice(axes)
        assert tuple(len(places) for places in grid.between if places is not None) == sizes
        line = np.add.outer(np.add.outer(axes[0].places, axes[1].places), axes[2].places)
        samples = grid.volume(line, "grid").samples
        for axis, (n, last) in enumerate(zip(sizes, (1e3, 20, 9), strict=True)):
            across = np.moveaxis(samples, axis, 0)[:, 0, 0]
            np.testing.assert_allclose(across, np.linspace(0, last, n), rtol=1e-9, atol=1e-6)


# --- Imaris ----------------------------------------------------------------------------------------------------------


def imaris(path: Path) -> Path:
    def letters(node: Any, **told: object) -> None:
        for name, value in told.items():
            node.attrs[name] = np.array(list(str(value).encode()), "u1").view("S1")

    with h5py.File(path, "w") as file:
        image = file.create_group("DataSetInfo/Image")
        letters(image, ExtMin0=10, ExtMin1=-20, ExtMin2=30.5, ExtMax0=17.5, ExtMax1=-4.25, ExtMax2=42.5, Unit="um")
        for c, name in enumerate(("DAPI", "GFP", "RFP")):
            told = {
                "Name": name,
                "Color": " ".join(f"{float(k == c):.3f}" for k in range(3)),
                "ColorRange": "5.000 90.000",
            }
            letters(file.create_group(f"DataSetInfo/Channel {c}"), **told)
        for time in range(2):
            for c in range(3):
                for level, cube in enumerate((F, F[::2, ::2, ::2])):
                    channel = file.create_group(f"DataSet/ResolutionLevel {level}/TimePoint {time}/Channel {c}")
                    letters(channel, **{f"ImageSize{a}": size for a, size in zip("ZYX", cube.shape, strict=True)})
                    padded = np.pad(cube + 10 * time + c, [(0, -size % 8) for size in cube.shape], constant_values=99)
                    channel.create_dataset("Data", data=padded, chunks=(4, 4, 4), compression="gzip")
    return path


def test_imaris(tmp_path: Path) -> None:
    path = imaris(tmp_path / "letter.ims")
    every = load(path, time=1)
    assert len(every.channels) == 3 and np.array_equal(every.channels[2].samples, F + 12)
    told = [(each.name, each.hints.color, each.hints.window) for each in every.channels]
    assert told[1:] == [("GFP", "#00ff00", (5, 90)), ("RFP", "#0000ff", (5, 90))]
    assert np.array_equal(load(path, channel="RFP", time=1).samples, F + 12)
    assert load(path, channel=0).times == 2 and load(path, channel=0).notes
    volume = load(path, array=1, channel=2)
    np.testing.assert_array_equal(volume.samples, F + 12)
    np.testing.assert_allclose(volume.spacing, SPACING)
    # ExtMin is the face of the first voxel
    np.testing.assert_allclose(volume.origin, (10.75, -18.875, 32))
    assert volume.unit == "um"
    (coarser,) = volume.coarser
    np.testing.assert_array_equal(coarser.samples, F[::2, ::2, ::2] + 12)
    np.testing.assert_allclose(coarser.corners, volume.corners)
    alone = load(path, array=1, channel=2, level=1)
    assert not alone.coarser and alone.spacing == coarser.spacing


@pytest.mark.few(2)
@pytest.mark.parametrize("where", [0, 3])
@pytest.mark.parametrize("way", ["labels", "scale", "axistags"])
def test_an_axis_of_time_is_played(way: str, where: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """By labels, by names of dimension scales with seconds, and by ilastik's tags; more points than channels may be."""
    data = np.stack([F + n for n in range(20)], where)
    names = ["z", "y", "x"]
    names.insert(where, "t")
    path = tmp_path / "a.h5"
    tags = {"axistags": json.dumps({"axes": [{"key": name} for name in names]})} if way == "axistags" else {}
    save(path, "a", data, attributes=tags)
    with h5py.File(path, "a") as file:
        if way == "labels":
            for dimension, name in zip(file["a"].dims, names, strict=True):
                dimension.label = name
        if way == "scale":
            time = file.create_dataset("time", data=np.arange(20) * 1.5)
            time.attrs["units"] = "minutes since 2020-01-01"
            time.make_scale()
            file["a"].dims[where].attach_scale(time)
    first, last = load(path), load(path, time=19)
    assert (first.times, first.time_step) == (20, 90.0 if way == "scale" else None)
    np.testing.assert_array_equal(first.samples, F)
    np.testing.assert_array_equal(last.samples, F + 19)
    assert any("time 0 of 20" in note for note in first.notes) and not last.notes
    with pytest.raises(InputError, match=r"time: expected a number from 0 to 19.*, got 20"):
        load(path, time=20)
    assert main(["info", f"{path}:/a"]) == 0
    assert "0 … 19" in capsys.readouterr().out
    options = ["--size", "16", "--points", "0:0,5:0.5", "--quiet"]
    assert main(["animate", f"{path}:/a", "-o", str(tmp_path / "o.gif"), "--time", "0:6:2", *options]) == 0
    with Pillow.open(tmp_path / "o.gif") as movie:
        assert getattr(movie, "n_frames", 1) == 3


def test_times_and_channels_of_one_dataset(tmp_path: Path) -> None:
    data = np.stack([[F + 10 * n + c for c in range(2)] for n in range(3)])
    path = save(tmp_path / "a.h5", data=data)
    with h5py.File(path, "a") as file:
        for dimension, name in zip(file["g/letter"].dims, "tczyx", strict=True):
            dimension.label = name
    np.testing.assert_array_equal(load(path, time=2, channel=1).samples, F + 21)
    with pytest.raises(InputError, match="pick with channel=0"):
        load(path, time=2)


def test_attributes_that_cannot_be_listed_are_looked_at_by_name() -> None:
    """A damaged list of attributes must not keep the look from those that the readers open, where HDF5 may loop."""

    class Attributes:
        asked: ClassVar[list[str]] = []

        def __iter__(self) -> Any:
            raise RuntimeError("Error iterating over attributes")

        def get_id(self, name: str) -> Any:
            self.asked.append(name)
            raise KeyError(name)

    hdf5_files.read_node("a", SimpleNamespace(attrs=Attributes()))
    assert {"DIMENSION_LABELS", "axistags", "units", "ExtMin0", "ImageSizeX"} <= set(Attributes.asked)
    assert set(_SPACINGS) <= set(Attributes.asked)


def test_the_look_at_a_file_asks_for_fill_values(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a damaged message HDF5's library reads beyond it."""
    asked: list[str] = []
    monkeypatch.setattr(h5py.Dataset, "fillvalue", property(lambda dataset: asked.append(dataset.name)))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        hdf5_files.read_node("a", file.create_dataset("a", data=np.zeros((3, 3, 3))))
    assert asked == ["/a"]


@pytest.mark.parametrize("form", ["NETCDF4", "NETCDF3_CLASSIC"])
def test_missing_and_unsigned_numbers_of_netcdf(tmp_path: Path, form: str) -> None:
    """As NetCDF's library reads them: both marks, limits, bytes without a sign, in single and double precision."""
    netcdf = pytest.importorskip("netCDF4")
    stored = np.arange(-60, 60, dtype=np.int8).reshape(4, 5, 6)
    with netcdf.Dataset(tmp_path / "a.nc", "w", format=form) as file:
        for name, size in zip("zyx", stored.shape, strict=True):
            file.createDimension(name, size)
        for name, kind, attributes in (
            ("both", "f4", {"_FillValue": np.float32(-60), "missing_value": [np.float32(7), np.float32(8)]}),
            ("limits", "f4", {"valid_range": np.array([-20, 30], "f4")}),
            ("least", "i1", {"valid_min": np.int8(-3), "scale_factor": 0.5}),
            ("unsigned", "i1", {"_Unsigned": "true", "_FillValue": np.int8(-1), "add_offset": 1.0}),
            ("double", "f4", {"missing_value": 2.5}),
        ):
            fill = attributes.pop("_FillValue", None)
            variable = file.createVariable(name, kind, ("z", "y", "x"), fill_value=fill)
            variable.setncatts(attributes)
            variable.set_auto_maskandscale(False)
            variable[:] = np.where(stored == 0, 2.5, stored) if name == "double" else stored
    with netcdf.Dataset(tmp_path / "a.nc") as file:
        for name in file.variables:
            right = np.ma.filled(file[name][:].astype(float), np.nan)
            np.testing.assert_array_equal(load(tmp_path / "a.nc", array=name).samples, right.astype(np.float32))
    # a mark in double precision is rounded to the numbers' type
    packing = Packing.of({"missing_value": np.array([0.1])}, np.dtype("f4"), None)
    assert packing is not None and np.isnan(packing.values(np.array([0.1, 0.2], np.float32))).tolist() == [True, False]

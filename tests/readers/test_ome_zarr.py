"""Zarr stores of several images and of xarray: groups in groups, plates, coordinates, packed and missing values."""

from __future__ import annotations

import gc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from splatgl.cli.main import main
from splatgl.errors import InputError
from splatgl.readers import LoadOptions, find_labels, list_volumes, load, ome_zarr
from splatgl.readers.chunked import Chunked
from splatgl.scene.scene_file import SceneFile

zarr = pytest.importorskip("zarr")

Z, Y, X = np.indices((8, 16, 24))
SAMPLES = (100 + 10 * Z + (X > 12) * 50).astype(np.uint16)
AXES = [{"name": "t", "type": "time"}, {"name": "c", "type": "channel"}] + [
    {"name": name, "type": "space", "unit": "micrometer"} for name in "zyx"
]


def image(group: Any, version: str = "0.4", add: int = 0) -> None:
    """An image of OME-Zarr in a group."""
    steps = [{"type": "scale", "scale": [1, 1, 2.0, 0.5, 0.5]}]
    told = {"axes": AXES, "datasets": [{"path": "0", "coordinateTransformations": steps}]}
    group.attrs.update(
        {"ome": {"version": "0.5", "multiscales": [told]}} if version == "0.5" else {"multiscales": [told]}
    )
    group.create_array("0", data=SAMPLES[None, None] + add, chunks=(1, 1, 4, 16, 24))


def check(path: Path, add: int = 0, **options: Any) -> tuple[str, ...]:
    volume = load(path, **options)
    assert np.array_equal(volume.samples, SAMPLES + add)
    assert volume.spacing == (0.5, 0.5, 2.0) and volume.unit == "um"
    return volume.notes


@pytest.mark.parametrize("version", ["0.4", "0.5"])
def test_images_in_groups_are_found(tmp_path: Path, version: str, capsys: pytest.CaptureFixture[str]) -> None:
    """The layout of bioformats2raw, and deeper ones; others than the first are told and can be read."""
    path = tmp_path / "a.zarr"
    root = zarr.open_group(path, mode="w", zarr_format=3 if version == "0.5" else 2)
    root.attrs.update({"bioformats2raw.layout": 3})
    root.create_group("OME")
    image(root.create_group("0"), version)
    assert check(path) == ()
    for n in (10, 2):
        image(root.create_group(f"more/{n}"), version, n)
    assert check(path) == ("image 0 of 3 is read; --array picks another: more/2, more/10",)
    assert check(path, 10, array="more/10") == check(path, 2, array="/more/2") == ()
    assert main(["info", str(path)]) == 0
    assert [line.split()[1] for line in capsys.readouterr().out.splitlines()[:3]] == ["0", "more/2", "more/10"]


def test_a_plate_and_what_holds_no_image(tmp_path: Path) -> None:
    root = zarr.open_group(tmp_path / "a.zarr", mode="w", zarr_format=2)
    root.attrs["plate"] = {"wells": [{"path": "A/1"}]}
    for well in ("A/1", "B/2"):
        image(root.create_group(f"{well}/0"))
    assert check(tmp_path / "a.zarr") == ()
    empty = zarr.open_group(tmp_path / "b.zarr", mode="w")
    empty.create_group("one")
    with pytest.raises(InputError, match="store: expected an array of three axes in one of its groups, got one"):
        load(tmp_path / "b.zarr")
    empty.create_group("two").create_array("deep", data=SAMPLES)
    assert np.array_equal(load(tmp_path / "b.zarr").samples, SAMPLES)
    with pytest.raises(InputError, match=r"got 'three'; pick one with array=NAME; there are: two/deep"):
        load(tmp_path / "b.zarr", array="three")


def test_no_option_is_ignored(tmp_path: Path) -> None:
    zarr.create_array(tmp_path / "a.zarr", data=SAMPLES)
    for options, said in (
        ({"array": "x"}, "array: expected a group of arrays, where this is one, got x"),
        ({"level": 0}, "level: expected a group of arrays, where this is one, got 0"),
        ({"channel": 1}, "channel: expected a file of channels, got 1"),
        ({"time": 1}, "time: expected a file of several time points, got 1"),
    ):
        with pytest.raises(InputError, match=said):
            load(tmp_path / "a.zarr", **options)


def dataset(path: Path, version: int) -> Any:
    """A store as xarray writes it: uneven and falling coordinates, packed and missing values."""
    xr = pytest.importorskip("xarray")
    coords = {
        "valid_time": ("valid_time", [0, 1]),
        "depth": ("depth", [0.0, 1.0, 3.0, 7.0], {"units": "m", "positive": "down"}),
        "lat": ("lat", 50 - 0.5 * np.arange(6), {"units": "degrees_north"}),
        "lon": ("lon", 3 + 0.25 * np.arange(5), {"units": "degrees_east"}),
        "z": ("z", 2.0 * np.arange(8), {"units": "m"}),
        "y": ("y", 0.5 * np.arange(16), {"units": "m"}),
        "x": ("x", 10 + 0.25 * np.arange(24), {"units": "m"}),
    }
    values = np.random.default_rng(0).uniform(0, 90, (8, 16, 24))
    values[2, 3, 4] = np.nan
    sea = np.arange(240.0).reshape(2, 4, 6, 5)
    found = xr.Dataset(
        {
            "u": (("z", "y", "x"), values, {"units": "m s-1"}),
            "t": (("valid_time", "depth", "lat", "lon"), sea),
            "turned": (("x", "z", "y"), np.moveaxis(values, 2, 0)),
        },
        coords=coords,
    )
    packed = {"dtype": "i2", "scale_factor": 0.01, "add_offset": 5.0, "_FillValue": -32767}
    found.to_zarr(path, mode="w", zarr_format=version, encoding={"u": packed})
    return found


@pytest.mark.parametrize("version", [2, 3])
def test_stores_of_xarray(tmp_path: Path, version: int, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.zarr"
    found = dataset(path, version)
    with pytest.raises(InputError, match=r"pick one with array=NAME; there are: (t|u|turned), \w+, \w+$"):
        load(path)
    for name in ("u", "turned"):
        volume = load(path, array=name)
        assert volume.spacing == (0.25, 0.5, 2.0) and volume.origin == (10, 0, 0) and volume.unit == "m"
        np.testing.assert_allclose(volume.samples, found["u"].values, atol=0.006)
        assert np.isnan(volume.samples).sum() == 1
    assert load(path, array="u").value_unit == "m s-1"
    assert load(path, array="u", spacing=(1, 1, 1)).spacing == (1, 1, 1)
    sea = load(path, array="t", time=1)
    assert sea.times == 2 and sea.shape == (8, 6, 5) and "resampled every 1 m" in sea.notes[0]
    assert np.array_equal(sea.samples[[0, 1, 3, 7]], found["t"].values[1])
    # depth runs down, latitudes fall
    assert sea.world_from_index[2, 2] < 0 and sea.world_from_index[1, 1] < 0
    # read in parts the same
    whole = load(path, array="u")
    monkeypatch.setattr(ome_zarr, "WHOLE_BYTES", 100)
    parts = load(path, array="u")
    assert isinstance(parts.samples, Chunked) and np.array_equal(parts.samples[:], whole.samples, equal_nan=True)


@pytest.mark.parametrize("name", ["a.ozx", "a.ome.zarr.zip", "a.zip"])
def test_a_store_in_a_zip(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    from zarr.storage import ZipStore

    with ZipStore(tmp_path / name, mode="w") as store:
        image(zarr.create_group(store, path="a.zarr" if name == "a.zip" else "", zarr_format=3), "0.5")
    whole = load(tmp_path / name)
    assert whole.shape == (8, 16, 24)
    monkeypatch.setattr(ome_zarr, "WHOLE_BYTES", 100)
    parts = load(tmp_path / name)
    assert isinstance(parts.samples, Chunked) and np.array_equal(parts.samples[:], whole.samples)
    # packed bytes of the first member in the zip's directory, which would be allocated
    data = (tmp_path / name).read_bytes()
    size = data.index(b"PK\x01\x02") + 20
    (tmp_path / name).write_bytes(data[:size] + b"\xfe\xff\xff\xff" + data[size + 4 :])
    with pytest.raises(InputError, match="zip: expected separate members"):
        load(tmp_path / name)


def test_damaged_children_print_nothing(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Nothing is logged after the error, when the collector frees the tasks of asyncio that failed."""
    path = tmp_path / "a.zarr"
    root = zarr.open_group(path, mode="w", zarr_format=3)
    for name in "abcd":
        root.create_group(name)
        (path / name / "zarr.json").write_text('{"zarr_format": 3, "node_type": "none"}')
    with pytest.raises(InputError, match=r"a\.zarr"):
        load(path)
    gc.collect()
    assert caplog.messages == []


def plate(path: Path, version: str) -> None:
    """Four wells of two fields, whose values grow by 1."""
    form = 3 if version == "0.5" else 2

    def tell(group: Any, **told: Any) -> None:
        group.attrs.update({"ome": {"version": "0.5", **told}} if version == "0.5" else told)

    root = zarr.open_group(path, mode="w", zarr_format=form)
    names = [f"{row}/{column}" for row in "AB" for column in (1, 3)]
    tell(root, plate={"wells": [{"path": name} for name in names]})
    for n, name in enumerate(names):
        well = root.create_group(name)
        tell(well, well={"images": [{"path": "0"}, {"path": "x"}]})
        image(well.create_group("0"), version, 2 * n)
        image(well.create_group("x"), version, 2 * n + 1)


@pytest.mark.parametrize("version", ["0.4", "0.5"])
def test_fields_of_wells(tmp_path: Path, version: str, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "a.zarr"
    plate(path, version)
    first, second = check(path)
    assert "well A/1 of 4 is read; --well picks another: A/3, B/1, B/3" in first and "field 0 of 2" in second
    assert check(path, 6, well="B/3", field=0) == check(path, 7, well="B/3", field=1) == ()
    assert check(path / "B" / "3", 7, field=1) == ()
    assert main(["info", str(path), "--well", "B/3", "--field", "1"]) == 0
    assert "* B/3/x  well B/3, field 1" in capsys.readouterr().out.splitlines()
    for options, message in (
        ({"well": "C/3"}, "well: expected one of A/1, A/3, B/1, B/3, got 'C/3'"),
        ({"field": 2}, "field: expected a number from 0 to 1 in well A/1"),
        ({"well": "B/3", "array": "B/3/x"}, "array: expected none together with well and field"),
    ):
        with pytest.raises(InputError, match=message):
            load(path, **options)


def test_labels_beside_an_image(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "a.zarr"
    root = zarr.open_group(path, mode="w", zarr_format=2)
    image(root)
    image(root.create_group("labels/cells"))
    assert list_volumes(path) == ["* /  24 × 16 × 8 × 1 × 1 uint16", "* labels/cells  labels, --labels cells"]
    assert find_labels(path, LoadOptions(), "cells") == "labels/cells"
    with pytest.raises(InputError, match="labels: expected a file, or one of cells, got 'nuclei'"):
        find_labels(path, LoadOptions(), "nuclei")
    scene = SceneFile(str(path)).with_options(labels="cells")
    assert (
        scene.layers[0].load == {"array": "labels/cells", "values": "labels"}
        and scene.layers[0].open().shape == SAMPLES.shape
    )
    # a field of a well has its own
    plate(tmp_path / "b.zarr", "0.4")
    image(zarr.open_group(tmp_path / "b.zarr/B/3/x", mode="a").create_group("labels/cells"))
    assert find_labels(tmp_path / "b.zarr", LoadOptions(well="B/3", field=1), "cells") == "B/3/x/labels/cells"


@pytest.mark.parametrize("version", [2, 3])
def test_channels_of_xarray_have_names(tmp_path: Path, version: int) -> None:
    xr = pytest.importorskip("xarray")
    both = xr.DataArray(np.stack([SAMPLES, SAMPLES + 1]), dims=("c", "z", "y", "x"), coords={"c": ["DAPI", "GFP"]})
    both.to_dataset(name="image").to_zarr(tmp_path / "a.zarr", zarr_format=version)
    assert np.array_equal(load(tmp_path / "a.zarr", channel="GFP").samples, SAMPLES + 1)


def test_n5_says_what_converts_it(tmp_path: Path) -> None:
    (tmp_path / "attributes.json").write_text('{"n5": "2.0.0"}')
    with pytest.raises(InputError, match="got N5; save it as OME-Zarr with Fiji"):
        load(tmp_path)


def test_units_of_ome_zarr_that_differ(tmp_path: Path) -> None:
    """Lengths are converted to the unit of x."""
    group = zarr.open_group(str(tmp_path / "a.zarr"), mode="w", zarr_format=2)
    group.create_array("0", shape=(3, 4, 5), dtype="u1", chunks=(3, 4, 5))[:] = 1
    units = {"z": "nanometer", "y": "", "x": "micrometer"}
    steps = [{"type": "scale", "scale": [500, 0.25, 0.5]}, {"type": "translation", "translation": [1000, 3, 4]}]
    group.attrs["multiscales"] = [
        {
            "version": "0.4",
            "axes": [{"name": name, "type": "space", "unit": unit} for name, unit in units.items()],
            "datasets": [{"path": "0", "coordinateTransformations": steps}],
        }
    ]
    volume = load(tmp_path / "a.zarr")
    assert volume.unit == "um" and volume.spacing == pytest.approx((0.5, 0.25, 0.5))
    assert volume.origin == pytest.approx((4, 3, 1))


@pytest.mark.parametrize("paths", [("scale0/image", "scale1/image"), ("0/a", "1/a"), ("./0", "1/"), ("s/0", "t/0")])
@pytest.mark.parametrize("below", ["", "series/0"])
def test_levels_at_any_path(tmp_path: Path, paths: tuple[str, str], below: str) -> None:
    """Each level has the grid of its own entry, wherever its array lies, and whether it is named or numbered."""
    group = zarr.open_group(tmp_path / "a.zarr", mode="w", zarr_format=2)
    group = group.create_group(below) if below else group
    entries = []
    for n, path in enumerate(paths):
        steps = [2.0, 0.5 * 2**n, 0.5 * 2**n]
        moved = [{"type": "scale", "scale": steps}, {"type": "translation", "translation": [7.0, 0.25 * n, 0.25 * n]}]
        entries.append({"path": path, "coordinateTransformations": moved})
        group.create_array(path.removeprefix("./").strip("/"), data=SAMPLES[:, :: 2**n, :: 2**n])
    group.attrs["multiscales"] = [{"axes": AXES[2:], "datasets": entries}]
    volume = load(tmp_path / "a.zarr")
    named = [load(tmp_path / "a.zarr", array=f"{below}/{path}".strip("/")) for path in paths]
    for n, levels in enumerate(zip((volume, *volume.coarser), named, strict=True)):
        numbered = load(tmp_path / "a.zarr", level=n)
        for level in (*levels, numbered):
            assert level.spacing == (0.5 * 2**n, 0.5 * 2**n, 2.0) and level.unit == "um"
            assert level.origin == (0.25 * n, 0.25 * n, 7.0) and level.shape == (8, 16 // 2**n, 24 // 2**n)


def test_levels_of_labels_beside_an_image(tmp_path: Path) -> None:
    """A level of labels that is named has the labels' grid, not that of the image's level of that name."""
    root = zarr.open_group(tmp_path / "a.zarr", mode="w", zarr_format=2)
    image(root)
    labels = root.create_group("labels/cells")
    steps = [{"type": "scale", "scale": [4.0, 1.0, 1.0]}]
    labels.attrs["multiscales"] = [{"axes": AXES[2:], "datasets": [{"path": "0", "coordinateTransformations": steps}]}]
    labels.create_array("0", data=(SAMPLES[::2, ::2, ::2] > 150).astype(np.uint8))
    assert load(tmp_path / "a.zarr", array="labels/cells/0").spacing == (1.0, 1.0, 4.0)

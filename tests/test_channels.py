"""Channels and time points of files: what is read, and one picture of several channels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.scene.scene_file import Scene
from splatgl.scene.view import View
from splatgl.splat.scene import channel_transfers

tifffile = pytest.importorskip("tifffile")
# t, c, z, y, x
SHAPE = (3, 2, 6, 16, 18)


def samples() -> np.ndarray:
    """Every value once."""
    return np.arange(np.prod(SHAPE), dtype=np.uint16).reshape(SHAPE)


def ome(path: Path, **more: object) -> Path:
    metadata = {
        "axes": "TCZYX",
        "Channel": {"Name": ["DAPI", "GFP"], "Color": [0x0000FFFF, 0x00FF00FF]},
        "TimeIncrement": 500.0,
        "TimeIncrementUnit": "ms",
        **more,
    }
    tifffile.imwrite(path, samples(), ome=True, metadata=metadata, photometric="minisblack")
    return path


def imagej(path: Path) -> Path:
    ramp = np.arange(256, dtype=np.uint8)
    luts = [np.stack([ramp * (k == n) for k in range(3)]).astype(np.uint8) for n in (0, 1)]
    metadata = {
        "axes": "TZCYX",
        "mode": "composite",
        "LUTs": luts,
        "Ranges": (10.0, 900.0, 5.0, 700.0),
        "finterval": 2.5,
    }
    tifffile.imwrite(path, np.moveaxis(samples(), 1, 2), imagej=True, metadata=metadata)
    return path


def ome_zarr(path: Path, order: str = "tczyx") -> Path:
    zarr = pytest.importorskip("zarr")
    group = zarr.open_group(path, mode="w", zarr_format=2)
    turned = samples().transpose(["tczyx".index(axis) for axis in order])
    group.create_array("0", data=turned, chunks=turned.shape)
    kinds = {"t": {"type": "time", "unit": "second"}, "c": {"type": "channel"}}
    axes = [{"name": axis, **kinds.get(axis, {"type": "space", "unit": "micrometer"})} for axis in order]
    scale = [{"t": 4.0, "c": 1.0, "z": 2.0, "y": 0.5, "x": 0.25}[axis] for axis in order]
    steps = [{"type": "scale", "scale": scale}]
    group.attrs["multiscales"] = [
        {"version": "0.4", "axes": axes, "datasets": [{"path": "0", "coordinateTransformations": steps}]}
    ]
    channels = [("DAPI", "0000FF", 10, 900), ("GFP", "00FF00", 5, 700)]
    group.attrs["omero"] = {
        "channels": [{"label": n, "color": c, "window": {"start": a, "end": b}} for n, c, a, b in channels]
    }
    return path


@pytest.mark.parametrize("kind", ["ome", "imagej", "zarr", "zarr turned"])
def test_channels_and_times(kind: str, tmp_path: Path) -> None:
    """All channels of the first time by default; each by its number or name; the values of each, voxel by voxel."""
    path, names, windows, step = {
        "ome": lambda: (ome(tmp_path / "a.ome.tif"), ("DAPI", "GFP"), (None, None), 0.5),
        "imagej": lambda: (imagej(tmp_path / "a.tif"), ("0", "1"), ((10, 900), (5, 700)), 2.5),
        "zarr": lambda: (ome_zarr(tmp_path / "a.zarr"), ("DAPI", "GFP"), ((10, 900), (5, 700)), 4.0),
        "zarr turned": lambda: (
            ome_zarr(tmp_path / "a.zarr", "xyczt"),
            ("DAPI", "GFP"),
            ((10, 900), (5, 700)),
            4.0,
        ),
    }[kind]()
    right = samples()
    volume = sg.load(path)
    assert (volume.times, volume.time_step) == (3, step) and "time 0 of 3" in volume.notes[0]
    assert tuple(each.name for each in volume.channels) == names
    assert tuple(each.hints.window for each in volume.channels) == windows
    assert [each.hints.color for each in volume.channels] == (
        ["#ff0000", "#00ff00"] if kind == "imagej" else ["#0000ff", "#00ff00"]
    )
    for number, channel in enumerate(volume.channels):
        assert np.array_equal(channel.samples, right[0, number]) and channel.spacing == volume.spacing
    assert np.array_equal(volume.samples, right[0, 0])
    if kind.startswith("zarr"):
        assert volume.spacing == (0.25, 0.5, 2.0) and volume.unit == "um"
    for time in (0, 2):
        for asked in (1, names[1]):
            one = sg.load(path, time=time, channel=asked)
            assert np.array_equal(one.samples, right[time, 1]) and not one.channels and not one.notes
    both = sg.load(path, channel=f"{names[1]},{names[0]}", time=1)
    assert [each.name for each in both.channels] == [names[1], names[0]]
    assert np.array_equal(both.samples, right[1, 1]) and np.array_equal(both.channels[1].samples, right[1, 0])
    assert len(sg.load(path, channel="all").channels) == 2
    for options, said in (
        ({"channel": "RFP"}, f"channel: expected a number from 0 to 1, or one of {names[0]}, {names[1]}, got 'RFP'"),
        ({"channel": 2}, "channel: expected a number from 0 to 1"),
        ({"time": 3}, "time: expected a number from 0 to 2"),
        ({"time": -1}, "time: expected zero or more"),
    ):
        with pytest.raises(sg.InputError, match=said):
            sg.load(path, **options)


def test_times_of_nifti(tmp_path: Path) -> None:
    nibabel = pytest.importorskip("nibabel")
    values = np.arange(3 * 4 * 5 * 6, dtype=np.int16).reshape(3, 4, 5, 6)
    image = nibabel.Nifti1Image(values, np.diag([2, 3, 4, 1]))
    image.header.set_xyzt_units("mm", "msec")
    image.header["pixdim"][4] = 1500
    image.to_filename(tmp_path / "a.nii")
    volume = sg.load(tmp_path / "a.nii")
    assert (volume.times, volume.time_step) == (6, 1.5) and np.array_equal(volume.samples, values[..., 0].T)
    for options in ({"time": 4}, {"array": 4}):
        assert np.array_equal(sg.load(tmp_path / "a.nii", **options).samples, values[..., 4].T)


def test_colour_stacks_of_tiff(tmp_path: Path) -> None:
    """RGB and RGBA, 8 and 16 bits; a number still picks one component."""
    rgb = np.random.default_rng(3).integers(0, 256, (5, 8, 9, 3), np.uint8)
    for name, values in (
        ("a", rgb),
        ("b", rgb.astype(np.uint16) * 257),
        ("c", np.concatenate([rgb, rgb[..., :1]], -1)),
    ):
        path = tmp_path / f"{name}.tif"
        tifffile.imwrite(path, values, photometric="rgb", extrasamples=["unassalpha"] if name == "c" else None)
        volume = sg.load(path)
        assert np.array_equal(volume.color, rgb) and volume.samples.dtype == np.uint8
        assert np.abs(volume.samples - rgb @ [0.2126, 0.7152, 0.0722]).max() <= 0.5
        assert np.array_equal(sg.load(path, channel=1).samples, values[..., 1]) and not volume.channels


def stained(tmp_path: Path) -> Path:
    """Two balls that overlap, of different colours; over two times."""
    z, y, x = np.indices((24, 32, 40))
    first, second = (np.exp(-((x - cx) ** 2 + (y - 16) ** 2 + (z - 12) ** 2) / 40) * 1000 for cx in (15, 24))
    stack = np.stack([np.stack([first, second]), np.stack([second, first])]).astype(np.uint16)
    metadata = {"axes": "TCZYX", "Channel": {"Name": ["DAPI", "GFP"], "Color": [0x0000FFFF, 0x00FF00FF]}}
    tifffile.imwrite(tmp_path / "cells.ome.tif", stack, ome=True, metadata=metadata, photometric="minisblack")
    return tmp_path / "cells.ome.tif"


@pytest.mark.long
def test_channels_are_one_picture(
    renderer: sg.Renderer, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each in its colour and window, mixed where they overlap; not one over the other."""
    path, out = stained(tmp_path), tmp_path / "a.npy"
    monkeypatch.chdir(tmp_path)
    line = ["render", path.name, "--size", "48", "-o", "a.npy", "--window-of", "0=100,900", "--window-of", "GFP=50,800"]
    assert main([*line, "--color-of", "DAPI=Fuchsia"]) == 0
    said = capsys.readouterr()
    assert "channels DAPI, GFP" in said.out and "time 0 of 2: --time picks another" in said.err
    volume = sg.load(path)
    windows = {"DAPI": (100.0, 900.0), "GFP": (50.0, 800.0)}
    looks = channel_transfers(volume, {"0": "#ff00ff"}, windows)
    assert [look.colormap for look in looks] == ["#ff00ff", "#00ff00"] and not any(look.shading for look in looks)
    full = 1 - np.exp(-6 / 24)
    assert [look.points for look in looks] == [((100, 0), (900, full)), ((50, 0), (800, full))]
    scene = sg.Scene([sg.Layer(each, look) for each, look in zip(volume.channels, looks, strict=True)])
    pixels = renderer.render(scene, View(size=(48, 48)).camera(volume, scene)).pixels
    assert np.array_equal(np.load(out), pixels)
    red, green, blue, alpha = np.moveaxis(pixels, -1, 0)
    assert np.allclose(red, blue, atol=1e-6) and (np.minimum(red, green) > 0.05).sum() > 20 and alpha.max() > 0.7
    scene_file = Scene(path.name, transfer={"color_of": [["DAPI", "#ff00ff"]], "window_of": list(windows.items())})
    (tmp_path / "scene.toml").write_text(scene_file.to_toml(tmp_path))
    assert main(["render", "scene.toml", "--size", "48", "-o", "b.npy", "--quiet"]) == 0
    assert np.array_equal(np.load(tmp_path / "b.npy"), pixels)


def test_one_channel_has_its_colour(tmp_path: Path) -> None:
    volume = sg.load(stained(tmp_path), channel="GFP", time=0)
    transfer = sg.default_transfer(volume)
    assert transfer.colormap == "#00ff00" and not transfer.shading


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--color-of", "RFP=#ff0000"], "channel: expected one of DAPI, GFP, got 'RFP'"),
        (["--color-of", "GFP=reddish"], "expected CHANNEL=COLOR"),
        (["--window-of", "GFP=5"], "expected 2 numbers"),
        (["--window-of", "GFP=5,5"], "LOW below HIGH"),
        (["--channel", "0", "--color-of", "0=#ff0000"], "expected several channels"),
        (["--time", "0:2"], "--time: expected one time point"),
        (["--time", "x"], "expected a number, or FIRST:END:STEP"),
        (["--time", "7"], "--time: expected a number from 0 to 1"),
    ],
)
def test_bad_channels_are_told(
    tmp_path: Path, more: list[str], said: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    stained(tmp_path)
    monkeypatch.chdir(tmp_path)
    try:
        code = main(["render", "cells.ome.tif", "--size", "16", "-o", "a.png", *more])
    except SystemExit as ended:
        code = int(str(ended.code))
    assert code == 2 and said in capsys.readouterr().err and not (tmp_path / "a.png").exists()


def test_info_lists_channels_and_times(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(ome_zarr(tmp_path / "a.zarr"))]) == 0
    page = capsys.readouterr().out
    for line in (
        "0: DAPI #0000ff   10 … 900",
        "1: GFP #00ff00   5 … 700",
        "--channel N|NAME,… picks",
        "0 … 2, 4 s apart",
    ):
        assert line in page


@pytest.mark.long
def test_time_points_are_played(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """All of a file, or some; a frame is the picture of its time."""
    path = stained(tmp_path)
    line = ["animate", str(path), "--size", "16", "--channel", "GFP", "-o", str(tmp_path / "f" / "{frame}.npy")]
    assert main(line) == 0
    assert "2 frames" in capsys.readouterr().out
    frames = [np.load(tmp_path / "f" / f"{n}.npy") for n in range(2)]
    assert not np.array_equal(*frames)
    back = ["-o", str(tmp_path / "g" / "{frame}.npy"), "--time", "::-1", "--quiet", "--eye", "20,-80,20"]
    assert main([*line[:-2], *back]) == main([*line, *back[4:]]) == 0
    assert all(
        np.array_equal(np.load(tmp_path / "g" / f"{n}.npy"), np.load(tmp_path / "f" / f"{1 - n}.npy")) for n in (0, 1)
    )
    assert main([*line, "--time", "5:"]) == 2 and "--time: expected some of 0 to 1" in capsys.readouterr().err
    assert main([*line, "--time", "1", "--frames", "2", "--quiet"]) == 0


def test_flat_stacks_are_seen_as_in_a_microscope(renderer: sg.Renderer, tmp_path: Path) -> None:
    """Along z: the corner at x = y = 0 is on the left and on top; those of its files by their hints."""
    stack = np.zeros((4, 40, 60), np.uint8)
    stack[:, 2:10, 2:14] = 200
    stack[:, 30:38, 46:58] = 60
    tifffile.imwrite(tmp_path / "a.ome.tif", stack, ome=True, metadata={"axes": "ZYX"}, photometric="minisblack")
    tifffile.imwrite(tmp_path / "plain.tif", stack, photometric="minisblack")
    assert not sg.load(tmp_path / "plain.tif").hints.stack
    volume = Scene(str(tmp_path / "a.ome.tif")).open()
    assert volume.hints.stack and "seen along z" in volume.notes[-1]
    splats = sg.extract(volume, sg.Transfer([(30, 0), (220, 0.9)]))
    camera = View(size=(60, 40)).camera(volume, splats)
    assert np.allclose(camera.right, (1, 0, 0)) and np.allclose(camera.forward, (0, 0, 1))
    image = renderer.render(splats, camera)
    alpha = image.pixels[..., 3]
    assert alpha[:20, :30].sum() > 1.5 * alpha[20:, 30:].sum() > 0 and alpha[20:, :30].max() < 0.05


def test_transfer_functions_of_channels_make_a_scene(renderer: sg.Renderer, tmp_path: Path) -> None:
    """`extract` with one for each channel is the scene of these layers."""
    volume = sg.load(ome(tmp_path / "a.ome.tif"))
    looks = [sg.Transfer([(0, 0), (1700, 0.3)], colormap=name, window=(0, 1700)) for name in ("hot", "viridis")]
    scene = sg.extract(volume, looks)
    assert isinstance(scene, sg.Scene) and [each.name for each in scene.splats(sg.Settings())] == ["DAPI", "GFP"]
    camera = sg.Camera.orbit(scene, 30, 20, size=(24, 24))
    layers = sg.Scene([sg.Layer(each, look) for each, look in zip(volume.channels, looks, strict=True)])
    assert (renderer.render(scene, camera).pixels == renderer.render(layers, camera).pixels).all()
    with pytest.raises(sg.InputError, match="one for each of 2 channels, got 3"):
        sg.extract(volume, [*looks, looks[0]])

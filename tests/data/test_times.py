"""Times of files: numbers with units, dates of CF, steps of collections; in pictures, pages, movies and the window."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

import splatgl as sg
from splatgl.animation.animation import FrameAnnotations
from splatgl.annotations.canvas import AnnotatedSubject
from splatgl.cli.main import main
from splatgl.data.times import Times, is_time
from splatgl.errors import InputError
from splatgl.scene.open_scene import OpenScene
from splatgl.scene.scene_file import SceneFile
from splatgl.viewer.document import Document
from splatgl.viewer.hud import Overlays
from splatgl.viewer.state import State

SIZE = 5


def pvd(folder: Path, steps: tuple[float, ...]) -> Path:
    """A collection of VTK with a file for each time step, whose values are its number."""
    entries = ""
    for number, step in enumerate(steps):
        values = " ".join(map(str, np.arange(SIZE**3) + number))
        extent = f"0 {SIZE - 1} " * 3
        (folder / f"{number}.vti").write_text(
            f'<VTKFile type="ImageData"><ImageData WholeExtent="{extent}" Origin="0 0 0" Spacing="1 1 1">'
            f'<Piece Extent="{extent}"><PointData><DataArray type="Float32" Name="p" format="ascii">{values}'
            "</DataArray></PointData></Piece></ImageData></VTKFile>"
        )
        entries += f'<DataSet timestep="{step}" file="{number}.vti"/>'
    (folder / "a.pvd").write_text(f'<VTKFile type="Collection"><Collection>{entries}</Collection></VTKFile>')
    return folder / "a.pvd"


def netcdf(path: Path, times: list[float], units: str, form: str = "NETCDF4") -> Path:
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("netCDF4")
    places = {name: np.arange(float(SIZE)) for name in "zyx"}
    samples = np.arange(len(times))[:, None, None, None] + np.zeros((SIZE,) * 3)
    array = xarray.DataArray(samples, dims=("time", *"zyx"), coords={"time": ("time", times), **places}, name="q")
    array.time.attrs["units"] = units
    array.to_dataset().to_netcdf(path, format=form)
    return path


@pytest.mark.parametrize(
    ("values", "units", "texts"),
    [
        ((0, 1.5, 4), "s", ("0 s", "1.5 s", "4 s")),
        ((0, 1.5, 4), "seconds since 2000-01-01", ("0 s", "1.5 s", "4 s")),
        ((0, 0.5), "Hours since 2000-01-01 00:00:00", ("0 h", "0.5 h")),
        ((0.1, 0.25), "", ("0.1", "0.25")),
        ((3, 7), "years", ("3 years", "7 years")),
        ((1045056, 1045062), "hours since 1900-01-01 00:00:0.0", ("2019-03-22 00:00", "2019-03-22 06:00")),
        ((43000.5,), "days since 1900-01-01", ("2017-09-24 12:00",)),
        ((1e9, 1e9 + 61), "seconds since 1970-01-01T00:00:00", ("2001-09-09 01:46:40", "2001-09-09 01:47:41")),
        ((1e15,), "days since 1900-01-01", ("1e+15 d",)),
    ],
)
def test_times_have_texts(values: tuple[float, ...], units: str, texts: tuple[str, ...]) -> None:
    times = Times.of(values, units)
    assert times is not None and tuple(map(times.text, range(len(values)))) == texts
    assert [times.number(text) for text in texts] == list(range(len(texts)))


def test_times_of_other_calendars_are_numbers() -> None:
    times = Times.of((43000.5,), "days since 1900-01-01", "360_day")
    assert times is not None and times.text(0) == "43000.5 d"
    assert Times.of((0.0, np.nan), "s") is None


def test_values_name_time_points() -> None:
    times = Times((0.0, 1.5, 90.0), "s")
    asked = ("1.5", "1.5s", "1500ms", "1.5 min", "0.0", "1.5e0")
    assert [times.number(text) for text in asked] == [1, 1, 1, 2, 0, 1]
    for text in ("2.0", "1.5km", "2019-03-22"):
        with pytest.raises(InputError, match=r"expected a number from 0 to 2, or one of 0 s, 1\.5 s, 90 s, got"):
            times.number(text)
    assert [is_time(text) for text in ("1.5", "3s", "2019-03-22", "1e3", "3", "-3", "x", "1:3", "")] == [
        *([True] * 4),
        *([False] * 5),
    ]


@pytest.mark.parametrize("form", ["NETCDF4", "NETCDF3_CLASSIC"])
def test_netcdf_has_its_own_times(form: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = netcdf(tmp_path / "a.nc", [0.0, 1.5, 4.0, 30.0], "seconds since 2000-01-01", form)
    for time, number in ((1.5, 1), ("4.0 s", 2), ("0.5min", 3), (2, 2), (None, 0)):
        volume = sg.load(path, time=time, array="q")
        assert (volume.time, volume.times, volume.samples[0, 0, 0]) == (number, 4, number)
    assert volume.moments == Times((0.0, 1.5, 4.0, 30.0), "s") and volume.time_step is None
    with pytest.raises(InputError, match=r"a\.nc: time: expected a number .*, or one of 0 s, 1\.5 s, .*'7\.0'"):
        sg.load(path, time=7.0, array="q")
    with pytest.raises(InputError, match=r"time: expected a number from 0 to 3, or a time such as 30\.0, got 9"):
        sg.load(path, time=9, array="q")
    assert main(["info", str(path), "--array", "q"]) == 0
    assert "0 s, 1.5 s, 4 s, 30 s: --time TIME picks, too" in capsys.readouterr().out
    assert main(["info", str(path), "--array", "q", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["time_values"], told["time_unit"]) == ([0.0, 1.5, 4.0, 30.0], "s")


def test_collections_have_their_time_steps(tmp_path: Path) -> None:
    """In stills, movies and the window."""
    path = pvd(tmp_path, (0.1, 0.25, 2.0))
    assert sg.load(path, time=0.25).samples[0, 0, 0] == 1 and sg.load(path, time=1).time == 1
    file = SceneFile(str(path), load={"time": "0.25"}, annotate=("time", "axes"))
    scene = OpenScene.of(file, file.open())
    assert scene.names == ("time=0.25", "axes")
    texts = tuple(map(scene.volume.time_text, range(3)))
    over = FrameAnnotations(("time", "scale"), AnnotatedSubject.of(scene.volume), scene.transfer, texts)
    assert [over.at(n)[0] for n in (0, 1, 2, "0.25")] == ["time=0.1", "time=0.25", "time=2", "time=0.25"]
    document = Document.open(SceneFile(str(path)), quiet=True)
    state = replace(State.of(document, (64, 64)), annotate=("time",), time=1, times=3)
    overlays, drawn = Overlays(), list[object]()
    overlays.overlay = cast(Any, SimpleNamespace(draw=lambda *given: drawn.extend(given) or np.zeros((64, 64, 4))))
    overlays.annotations(state, document)
    assert ("time=0.25",) in [each for each in drawn if isinstance(each, tuple)]


def test_files_without_times_have_numbers() -> None:
    with pytest.raises(InputError, match=r"time: expected a number, as the file states no times, got '1\.5'"):
        sg.Volume(np.zeros((2, 2, 2)), times=3).time_number("1.5")
    even = sg.Volume(np.zeros((2, 2, 2)), times=3, time_step=0.5)
    assert even.time_text(2) == "1 s" and even.time_number("0.5s") == 1
    assert sg.Volume(np.zeros((2, 2, 2)), times=3).time_text(2) == "2"

"""Defaults by what is drawn: maxima, points alone, levels and widths, angiograms, types, and the view."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.data.volume import Hints, Volume
from splatgl.errors import InputError
from splatgl.readers.dicom_vendors import ANGIOGRAM, is_angiogram
from splatgl.scene.open_scene import OpenScene
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.view import ViewOptions
from splatgl.transfer.presets import SOLID, default_transfer, preset, window_question

pytestmark = pytest.mark.usefixtures("shared_programs")


def ct() -> sg.Volume:
    """Air, a ball of water and bone in it, in Hounsfield units."""
    z, y, x = np.indices((24, 24, 24)) - 11.5
    r = np.sqrt(x * x + y * y + z * z)
    noise = np.random.default_rng(1).normal(0, 8, r.shape)
    return sg.Volume(np.where(r < 4, 900, np.where(r < 9, 40, -1000)) + np.rint(noise), frame="LPS", unit="mm")


def neuron() -> sg.Volume:
    """Bright lines on a dark ground."""
    samples = np.zeros((20, 40, 60), np.float32)
    samples[8:11, 18:21, 5:55] = np.linspace(50, 200, 50)
    return sg.Volume(samples)


def transfer_of(volume: sg.Volume, blend: str = "composite", **table: Any) -> sg.Transfer:
    return SceneFile("v", held=volume, transfer=table, settings=sg.Settings(blend=blend)).transfer_for(volume)


# --- points, maxima, windows ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("volume", [ct(), neuron()], ids=["ct", "neuron"])
def test_points_alone_keep_the_colours(volume: sg.Volume) -> None:
    """Any value has the colour that it has by default; other keys replace them."""
    base, pointed = default_transfer(volume), transfer_of(volume, points=[[30, 0.0], [100, 0.5]])
    values = np.linspace(float(volume.samples.min()), float(volume.samples.max()), 50)
    assert np.array_equal(pointed.color(values), base.color(values)) and pointed.shading == base.shading
    assert pointed.points == ((30.0, 0.0), (100.0, 0.5))
    other = transfer_of(volume, points=[[30, 0.0], [100, 0.5]], colormap="hot")
    assert other.colormap == "hot" and other.window is None
    # a Transfer is drawn as it is
    plain = sg.Transfer([(30, 0.0), (100, 0.5)])
    assert transfer_of(volume, **plain.fields) == plain


def test_maxima_have_a_ramp_over_the_window() -> None:
    """In grey for surfaces, in its own colours for what glows; over a window that is given, from clear to opaque."""
    head, cell = ct(), neuron()
    assert transfer_of(head, "mip") == preset("mip", head)
    glowing, base = transfer_of(cell, "mip"), default_transfer(cell)
    assert glowing.colormap == base.colormap and glowing.points == ((base.points[0][0], 0), (base.points[-1][0], SOLID))
    given = transfer_of(head, "mip", window=[100, 600])
    assert given.points == ((100.0, 0.0), (600.0, SOLID)) and given.window == (100.0, 600.0)
    assert transfer_of(head, "mip", preset="ct-bone") == transfer_of(head, preset="ct-bone")
    assert transfer_of(head, "mip", points=[[0, 0], [9, 1]]).points == ((0.0, 0.0), (9.0, 1.0))
    assert transfer_of(head, "xray") == default_transfer(head)


def test_level_and_width_are_a_window() -> None:
    volume = ct()
    assert transfer_of(volume, level_width=[40, 400]) == transfer_of(volume, window=[-160, 240])
    assert transfer_of(volume, level_width="Brain") == transfer_of(volume, level_width="40,80")
    with pytest.raises(InputError, match=r"level_width: .* or abdomen, bone, brain, .*, got 'heart'"):
        transfer_of(volume, level_width="heart")
    scene = SceneFile("v", held=volume, transfer={"window": (0, 9)}).with_options(level_width=(50, 100))
    assert scene.transfer == {"level_width": (50, 100)}
    assert scene.with_options(window=(1, 2)).transfer == {"window": (1, 2)}
    with pytest.raises(InputError, match="level_width: expected either it or window, got both"):
        transfer_of(volume, level_width=[40, 400], window=[0, 1])
    with pytest.raises(InputError, match="level_width: expected a level and a width above 0"):
        transfer_of(volume, level_width=[40, -400])


ASKED = [(40, 400), (50, 350), (-600, 1500), (300, 1500), (40, 80), (-500, 1500), (35, 80), (100, 700)]
PLAIN = [(-160, 240), (-1000, 1000), (0, 100), (-1000, 400), (-200, 300), (200, 300), (700, 1200), (-700, 400), (-1, 1)]


def test_a_window_that_may_be_level_and_width_is_asked_about() -> None:
    """Of a CT alone, in one note, which says what either would span."""
    volume = ct()
    assert [bool(window_question(volume, pair)) for pair in (*ASKED, *PLAIN)] == [True] * 8 + [False] * 9
    assert not window_question(neuron(), (40, 400))
    notes = SceneFile("v", held=volume, transfer={"window": (40, 400)}).open().notes
    (note,) = (note for note in notes if "--level-width" in note)
    assert note.endswith("--level-width 40,400 spans -160 to 240")
    assert not SceneFile("v", held=volume, transfer={"level_width": (40, 400)}).open().notes


def test_a_window_that_begins_in_the_noise_is_noted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the user, the file, or a channel; not of other values, and of looks with opacities."""
    monkeypatch.setattr("splatgl.transfer.presets.DENSE", 4096)
    samples = np.random.default_rng(5).normal(100, 6, (20, 30, 40))
    samples[8:12, 10:20, 10:20] += 500
    stack = Volume(samples.astype(np.float32), name="stack")

    def notes(volume: Volume, **keys: Any) -> list[str]:
        found = SceneFile("v", held=volume, transfer=keys).open().notes
        return [note for note in found if "noise" in note]

    (note,) = notes(stack, window=(90, 600))
    assert note.startswith("stack: the window begins at 90, within the noise (100 ± 6, 9") and "from 12" in note
    hinted = replace(stack, hints=Hints(window=(90.0, 600.0)))
    assert (
        notes(hinted) == [note] and notes(hinted, points=((90, 0), (600, 1))) == notes(stack, window=(140, 600)) == []
    )
    channels = tuple(replace(hinted, name=name) for name in ("a", "b"))
    both = replace(hinted, channels=channels)
    assert notes(both, window_of={"a": (140, 600)}) == [note.replace("stack", "b")]
    assert (
        notes(replace(stack, samples=np.linspace(0, 1, 24000, dtype=np.float32).reshape(20, 30, 40)), window=(0, 1))
        == []
    )


# --- modalities -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("tags", "right"),
    [
        ({"Modality": "XA"}, True),
        ({"Modality": "MR", "AngioFlag": "Y"}, True),
        ({"Modality": "MR", "AngioFlag": "N"}, False),
        ({"Modality": "MR", "AcquisitionContrast": "TOF"}, True),
        ({"Modality": "MR", "SeriesDescription": "TOF_3D_multi-slab"}, True),
        ({"Modality": "MR", "SeriesDescription": "Angiography of the neck"}, True),
        ({"Modality": "MR", "SeriesDescription": "t2_tse_profound"}, False),
        ({"Modality": "CT", "SeriesDescription": "CTA"}, False),
        ({}, False),
    ],
)
def test_angiograms_by_their_header(tags: dict[str, str], right: bool) -> None:
    assert is_angiogram(tags) == right


def test_angiograms_are_red() -> None:
    """The brightest are opaque and redder than green and blue."""
    volume = sg.Volume(neuron().samples, frame="LPS", hints=ANGIOGRAM)
    transfer = default_transfer(volume)
    red, green, blue = transfer.color(np.array([float(volume.samples.max()) * 0.8]))[0]
    assert red > 2 * max(green, blue) and transfer.opacity(np.array([volume.samples.max()])) > 0.9


@pytest.mark.parametrize("volume", [ct(), neuron()], ids=["ct", "neuron"])
def test_types_of_the_same_values_look_the_same(volume: sg.Volume) -> None:
    """As whole numbers of 16 bits, as float32 and as float64."""
    whole = np.rint(np.asarray(volume.samples)).astype(np.int16)
    kinds = [np.uint16, np.float32, np.float64] if whole.min() >= 0 else [np.int16, np.float32, np.float64]
    looks = []
    for kind in kinds:
        scene = SceneFile("v", held=sg.Volume(whole.astype(kind), frame=volume.frame, unit=volume.unit))
        opened = OpenScene.read(scene)
        looks.append((opened.transfer, opened.camera.eye.tolist(), opened.volume.notes))
    assert looks[0] == looks[1] == looks[2]


def test_one_fluorescent_plane_is_a_picture(tmp_path: Path) -> None:
    """Seen along z, whatever its type: no landscape."""
    tifffile = pytest.importorskip("tifffile")
    rng = np.random.default_rng(3)
    plane = rng.poisson(100, (64, 80)).astype(np.uint16)
    plane[20:24, 10:70] += 2000
    for name, values in (
        ("a.tif", plane),
        ("b.tif", plane.astype(np.float32)),
        ("c.tif", (plane / 16).astype(np.uint8)),
    ):
        tifffile.imwrite(tmp_path / name, values)
        scene = OpenScene.read(SceneFile(str(tmp_path / name)))
        assert scene.volume.shape == (1, 64, 80) and abs(scene.camera.forward[2]) > 0.999, name
        assert not scene.camera.perspective


def camera_of(samples: np.ndarray, blend: str = "composite", fit: str = "all", **look: Any) -> sg.Camera:
    file = SceneFile("v", held=sg.Volume(samples), settings=sg.Settings(blend=blend), transfer=look)
    return OpenScene.read(replace(file, view=ViewOptions(fit=fit))).camera


def corner_block() -> np.ndarray:
    samples = np.zeros((48, 48, 48), np.float32)
    samples[2:12, 2:12, 2:12] = 100 + np.indices((10, 10, 10)).sum(axis=0)
    return samples


@pytest.mark.parametrize("blend", ["composite", "mip"])
@pytest.mark.parametrize("fit", ["visible", "0.3"])
def test_a_view_may_fit_what_is_seen(blend: str, fit: str) -> None:
    """A small object in the corner of a large box is as large as in its own box."""
    samples = corner_block()
    far, near = (
        np.linalg.norm(camera_of(part, blend, fit).eye - (6.5, 6.5, 6.5)) for part in (samples, samples[:14, :14, :14])
    )
    assert far == pytest.approx(near, rel=0.1)


def test_the_default_view_is_of_the_box() -> None:
    """Neither the transfer function nor a voxel moves it; of what is visible, one voxel does not."""
    samples = corner_block()
    noisy = samples.copy()
    noisy[46, 46, 46] = 1000
    low, high = {"points": ((50.0, 0.0), (60.0, 0.9))}, {"points": ((115.0, 0.0), (120.0, 0.9))}
    assert len({camera_of(each, **look) for each in (samples, noisy) for look in (low, high)}) == 1
    assert len({camera_of(each, fit="visible", **look) for each in (samples, noisy) for look in (low,)}) == 1
    assert len({camera_of(each, fit="0.3", **look) for each in (samples, noisy) for look in (low,)}) == 2
    # samples that are all alone are what there is
    alone = np.zeros((32, 32, 32), np.float32)
    alone[4, 4, 4] = alone[9, 9, 9] = 100
    assert camera_of(alone, fit="visible", **low) != camera_of(alone, **low)
    thread = np.zeros((32, 32, 32), np.float32)
    thread[4, 4, 2:20] = 100
    ends = camera_of(thread, fit="visible", **low).eye_from_points([[2, 4, 4], [19, 4, 4]])
    assert (np.abs(ends[:, :2] / ends[:, 2:]) < np.tan(np.radians(20))).all()


def test_the_options_on_the_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    """--window asks once, --level-width does not; a view of a patient is noted where anatomy is not stated."""
    monkeypatch.chdir(tmp_path)
    np.save("ct.npy", ct().samples)
    arguments = ["render", "ct.npy", "-o", "a.png", "--size", "24", "--check", "0"]
    assert main([*arguments, "--window", "40,400", "--view", "superior"]) == 0
    told = capsys.readouterr()
    assert "splatgl: --window 40,400 spans 40 to 400 HU; if they are level and width" in told.err
    assert "the file does not state anatomy: superior is azimuth 0°, elevation 90°" in told.err
    assert "view: azimuth 0°, elevation 90°" in told.out
    assert main([*arguments, "--level-width", "40,400", "--view", "top"]) == 0
    assert capsys.readouterr().err == ""

"""What of a volume the window shows, within a budget of memory."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.data.volume import subsample
from splatgl.fileio import PROCESS
from splatgl.planning.bricks import EACH, bytes_of_samples
from splatgl.scene.open_scene import OpenScene
from splatgl.scene.scene_file import SceneFile
from splatgl.splat.settings import Settings
from splatgl.viewer import adaptive_quality
from splatgl.viewer.adaptive_quality import STRIDES, choose_stand_in
from splatgl.viewer.document import Document
from splatgl.viewer.saving import scene_of
from splatgl.viewer.state import State
from tests.helpers.bricks import noise
from tests.helpers.levels import SOFT, with_levels, write

ALL = sg.Transfer([(-1.0, 0.5), (2.0, 0.5)])


@pytest.fixture
def volume() -> sg.Volume:
    return sg.Volume(noise(np.random.default_rng(1), (48, 40, 44)), spacing=(1, 2, 3), origin=(5, 6, 7))


def allow(splats: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Room for so many splats, and little more."""
    room = PROCESS + bytes_of_samples(adaptive_quality.PIXELS) + (EACH + 4) * splats
    monkeypatch.setattr(adaptive_quality, "budget", lambda: int(room))


def test_what_fits_is_shown_whole(volume: sg.Volume, monkeypatch: pytest.MonkeyPatch) -> None:
    allow(volume.count, monkeypatch)
    for given in (volume, with_levels(volume, 2)):
        found = choose_stand_in(given, ALL, Settings())
        assert found.volume.samples is volume.samples and not found.note and found.finer is None
    # read in a moment or not: what takes longer is preceded by its coarsest level
    monkeypatch.setattr(adaptive_quality, "LARGE", 1000)
    found = choose_stand_in(with_levels(volume, 2), ALL, Settings())
    assert found.volume.shape == (12, 10, 11) and found.note == "level 2 of 2, 11 x 10 x 12 voxels" and found.finer
    found = found.finer()
    assert found.note == "level 1 of 2, 22 x 20 x 24 voxels" and found.finer
    found = found.finer()
    assert found.volume.samples is volume.samples and not found.note and found.finer is None


def test_a_level_that_fits(volume: sg.Volume, monkeypatch: pytest.MonkeyPatch) -> None:
    allow(volume.count / 8, monkeypatch)
    found = choose_stand_in(with_levels(volume, 3), ALL, Settings())
    said = "level 1 of 3, 22 x 20 x 24 voxels: finer ones are too large for a window"
    assert found.volume.shape == (24, 20, 22) and found.note == said and found.finer is None
    # whatever fits: most is not read for a window
    allow(volume.count, monkeypatch)
    monkeypatch.setattr(adaptive_quality, "MOST_OF_LEVEL", volume.count - 1)
    assert choose_stand_in(with_levels(volume, 3), ALL, Settings()).note == said
    # the coarser levels are those of pictures in motion
    assert found.volume.coarser[0].shape == (12, 10, 11)


def test_means_that_fit(volume: sg.Volume, monkeypatch: pytest.MonkeyPatch) -> None:
    allow(volume.count / 60, monkeypatch)
    monkeypatch.setattr(adaptive_quality, "STAND_IN", volume.count / 27)
    found = choose_stand_in(volume, ALL, Settings())
    assert found.note == "every 3rd voxel" and np.array_equal(found.volume.samples, volume.samples[::3, ::3, ::3])
    assert found.volume.spacing == (3, 6, 9) and found.volume.origin == volume.origin and found.finer
    finer = found.finer()
    assert finer.volume.shape == (12, 10, 11) and finer.note.startswith("means of 4^3 voxels: smaller ones need more")


def test_colours_go_along(volume: sg.Volume) -> None:
    color = np.zeros((*volume.shape, 3), np.uint8)
    color[..., 0] = np.arange(volume.shape[2])
    found = subsample(sg.Volume(volume.samples, color=color), 4)
    assert found.color is not None and np.array_equal(found.color[0, 0, :, 0], np.arange(0, 44, 4))


def test_contents_keep_opacities_a_length(volume: sg.Volume, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    np.save(tmp_path / "v.npy", volume.samples)
    scene = SceneFile(str(tmp_path / "v.npy"), transfer={"points": SOFT.points})
    whole = Document.open(scene)
    assert whole.stand_in is not None and not whole.stand_in.note
    allow(volume.count / 60, monkeypatch)
    document = Document.open(scene)
    finer = document.refined()
    lengths = [each.layers[0].at(stride).unit for each in (whole, document, finer) for stride in STRIDES]
    assert set(lengths) == {1.0}
    assert finer.volume.count < volume.count / 7 and finer.stand_in and finer.stand_in.finer is None
    # what is edited stays the same portion
    layer, transfer = finer.layers[0], sg.Transfer([(0.3, 0.0), (0.8, 0.1)])
    edited = layer.with_own(replace(layer.own, transfer=transfer, threshold=0.0))
    assert edited.stand_in is finer.stand_in and edited.volumes is finer.layers[0].volumes


@pytest.mark.long
def test_the_smallest_there_is_where_nothing_fits(volume: sg.Volume, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(adaptive_quality, "budget", lambda: 1)
    found = choose_stand_in(volume, ALL, Settings())
    assert found.finer and found.finer().volume.shape == (3, 3, 3)
    found = choose_stand_in(with_levels(volume, 2), ALL, Settings())
    assert found.volume.shape == (6, 5, 6) and found.note == "every 2nd voxel" and found.finer
    assert found.finer().volume.shape == (3, 3, 3)


def test_a_level_is_saved_with_its_scene(
    volume: sg.Volume, renderer: sg.Renderer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path / "v.zarr", with_levels(volume, 3))
    monkeypatch.setattr(adaptive_quality, "MOST_OF_LEVEL", volume.count - 1)
    document = Document.open(SceneFile(str(tmp_path / "v.zarr"), transfer={"points": SOFT.points}))
    found = scene_of(State.of(document, (20, 16)), document)
    assert found.load == {"level": 1} and found.open().shape == document.volume.shape
    assert np.array_equal(OpenScene.of(found, found.open()).splats.records, document.layers[0].at(1).records)

"""Levels of multiscale images: which one a picture takes, and what that is measured by."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.fileio import within
from splatgl.gl import large_volumes
from splatgl.gl.large_volumes import changed_boxes, choose_level, coarsest_fine_level, flat_picture, render_slabs
from splatgl.readers.chunked import Chunked
from splatgl.splat.settings import Settings
from tests.helpers.bricks import noise
from tests.helpers.levels import SOFT, with_levels, write

pytestmark = pytest.mark.usefixtures("shared_programs")


@pytest.fixture(scope="module")
def smooth() -> sg.Volume:
    """A ball of one voxel's size 64 times over, with three coarser levels."""
    z, y, x = np.mgrid[:64, :64, :64] - 31.5
    return with_levels(sg.Volume((1 - np.sqrt(x * x + y * y + z * z) / 40).astype(np.float32), spacing=(1, 1, 1.2)), 3)


def test_the_level_is_just_finer_than_a_pixel(smooth: sg.Volume) -> None:
    assert coarsest_fine_level(replace(smooth, coarser=()), sg.Camera.orbit(smooth, size=(4, 4))) == 0
    for size in (16, 40, 100, 400):
        camera = sg.Camera.orbit(smooth, 20, 10, size=(size, size))
        nearest = camera.eye_from_points(smooth.corners)[:, 2].min()
        number = coarsest_fine_level(smooth, camera)
        sides = [max(level.spacing) for level in (smooth, *smooth.coarser)]
        # [M98 Eq. 3]: nearer than z_k a voxel is wider than a pixel
        assert number == 0 or camera.z_k(sides[number]) <= nearest
        assert number == 3 or camera.z_k(sides[number + 1]) > nearest
    inside = sg.Camera.look_at(smooth.center, smooth.center + 1.0, (0, 0, 1), 60, (8, 8))
    assert coarsest_fine_level(smooth, inside) == 0


@pytest.mark.long
def test_smooth_volumes_take_a_coarser_level(smooth: sg.Volume, renderer: sg.Renderer) -> None:
    camera = sg.Camera.orbit(smooth, 20, 10, size=(16, 16))
    found = choose_level(smooth, SOFT, camera, Settings(), renderer)
    assert found.number >= 1 and found.volume.shape == smooth.coarser[found.number - 1].shape
    assert 0 < found.off[found.number] <= found.allowed and found.boxes == large_volumes.BOXES
    assert str(found).startswith(f"level {found.number}, ") and "level 0 by" in str(found)
    # opacities are those of the finest voxels' length
    assert found.volume.lengths.spacing == pytest.approx(1.2 ** (1 / 3))
    image = render_slabs(smooth, SOFT, camera, renderer=renderer)
    assert image.info["level"] == found.number and image.info["level_rmse"] == found.off[found.number]
    settings = Settings(antialias="supersample", samples=8)
    right = renderer.render(sg.extract(smooth, SOFT), camera, settings, verify_bound=False)
    assert np.sqrt(((image.pixels - right.pixels) ** 2).mean()) < 0.01 < right.pixels.max()


def test_a_budget_too_small_to_choose_a_level_is_told(smooth: sg.Volume) -> None:
    """Before a box is drawn; a level that is named needs no choice."""
    camera, told = sg.Camera.orbit(smooth, 20, 10, size=(16, 16)), r"^memory: expected at least .* to choose a level"
    with within(192 << 20), pytest.raises(sg.InputError, match=told + r", got 192\.0 MiB; give more --memory, or a"):
        choose_level(smooth, SOFT, camera, Settings())
    with pytest.raises(sg.InputError, match=told):
        sg.render_slabs(smooth, SOFT, camera, memory="192MiB")
    with within(192 << 20):
        assert choose_level(replace(smooth, coarser=()), SOFT, camera, Settings()).number == 0


@pytest.mark.parametrize("opacity", [pytest.param(0.9, marks=pytest.mark.long), 0.3])
def test_thin_things_take_the_finest_level(opacity: float, threads: sg.Volume, renderer: sg.Renderer) -> None:
    transfer = sg.Transfer([(0.3, 0.0), (1.0, opacity)], shading=False)
    camera = sg.Camera.orbit(threads, 20, 10, size=(24, 24))
    assert coarsest_fine_level(threads, camera) > 0
    found = choose_level(threads, transfer, camera, Settings(), renderer)
    assert found.number == 0 and set(found.off) == set(range(coarsest_fine_level(threads, camera) + 1))
    assert all(found.off[number] > found.allowed for number in found.off if number)
    # a twentieth more than the finest level itself is off
    assert found.allowed == pytest.approx(max(1.05 * found.off[0], Settings().tolerance))


@pytest.mark.long
def test_boxes_lie_where_opacity_varies(renderer: sg.Renderer) -> None:
    """Of fog with threads in one corner: means lose these, however few of the places hold any."""
    samples = np.full((96, 96, 96), 0.4, np.float32)
    rng = np.random.default_rng(3)
    for y, x in rng.integers(0, 14, (25, 2)):
        samples[:14, y, x] = 1.0
    volume = with_levels(sg.Volume(samples), 3)
    transfer = sg.Transfer([(0.3, 0.01), (0.8, 0.01), (0.9, 0.9)], shading=False)
    camera = sg.Camera.orbit(volume, 20, 10, size=(24, 24), zoom=0.9)
    assert coarsest_fine_level(volume, camera) > 1
    found = choose_level(volume, transfer, camera, Settings(), renderer)
    assert max(found.off.values()) > 0.02 and found.number < coarsest_fine_level(volume, camera)
    assert found.info["level_boxes"] == found.boxes == large_volumes.BOXES


EVEN = [(-1.0, 0.001), (1.0, 0.001)]
LOOKS = {
    "iso": (dict(points=EVEN, iso=["0.6:red:0.5"]), "composite", 1.0),
    "only iso": (dict(points=[(0.0, 0.0), (1.0, 0.0)], iso=["0.6"]), "composite", 1.0),
    "color": (dict(points=[(0.0, 0.1), (1.0, 0.1)], colormap="hot"), "composite", 1.0),
    "region": (dict(points=EVEN, regions=["box:0.3,2,0.2,2:red:0.5"]), "composite", 1.0),
    "gradient": (dict(points=EVEN, gradient=[(0.2, 0.1), (0.3, 1.0)]), "composite", 1.0),
    "xray": (dict(points=[(0.5, 0.0), (1.0, 0.5)]), "xray", 1.0),
    "mip": (dict(points=[(0.0, 0.5), (1.0, 0.5)], colormap="hot"), "mip", 1.0),
    "minip": (dict(points=[(-1.0, 0.5), (1.0, 0.5)], colormap="hot"), "minip", -1.0),
    "mean": (dict(points=[(0.0, 0.5), (0.3, 0.5)], colormap="hot"), "mean", 1.0),
}


def foggy_shell(value: float) -> sg.Volume:
    """Noise from 0.1 to 0.12, with a shell 1.5 voxels thick in one of eight boxes, and a level of means."""
    samples = 0.1 + 0.02 * np.random.default_rng(1).random((64, 64, 64))
    z, y, x = np.mgrid[:64, :64, :64]
    samples[np.abs(np.sqrt((x - 16) ** 2 + (y - 48) ** 2 + (z - 16) ** 2) - 8) < 0.75] = value
    return with_levels(sg.Volume(samples.astype(np.float32)), 1)


@pytest.mark.parametrize("look", LOOKS)
def test_boxes_whose_pictures_change_come_first(look: str) -> None:
    """By colours, surfaces and values, too, where all opacities are equal."""
    given, blend, value = LOOKS[look]
    volume, transfer = foggy_shell(value), sg.Transfer(**given, unit=1.0, shading=False)
    boxes = changed_boxes(volume, 1, transfer, sg.Camera.orbit(volume, 20, 10, size=(16, 16)), Settings(blend=blend))
    assert len(boxes) == 8 and boxes[0].tolist() == [[0, 32, 0], [32, 64, 32]]


def test_a_level_without_the_surface_is_not_chosen(renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(large_volumes, "BOXES", 1)
    volume, transfer = foggy_shell(1.0), sg.Transfer(EVEN, shading=False, iso=["0.6:red:0.5"])
    camera = sg.Camera.orbit(volume, 20, 10, size=(24, 24))
    assert coarsest_fine_level(volume, camera) == 1
    found = choose_level(volume, transfer, camera, Settings(), renderer)
    assert found.number == 0 and found.off[1] > 2 * found.allowed
    assert choose_level(volume, replace(transfer, iso=()), camera, Settings(), renderer).number == 1


def test_a_flat_picture_is_that_of_its_columns() -> None:
    """By hand: extinction per voxel, colours, and the surface between two voxels."""
    volume = sg.Volume(np.array([0.0, 1.0, 0.0], np.float32).reshape(3, 1, 1), spacing=(1, 1, 2))
    transfer = sg.Transfer([(0.0, 0.0), (1.0, 0.5)], window=(-1, 1), unit=1.0, iso=["0.5:red:0.2"])
    picture = flat_picture(volume, transfer, Settings(), 2)[0, 0]
    # half of the light passes twice through the voxel, and 0.8 through each surface
    assert picture[3] == pytest.approx(1 - 0.25 * 0.8**2)
    assert flat_picture(volume, transfer, Settings(blend="xray"), 2)[0, 0, 3] == pytest.approx(-np.log(0.25 * 0.8**2))
    assert flat_picture(volume, transfer, Settings(blend="mip"), 2)[0, 0, 3] == pytest.approx(0.5)
    assert flat_picture(volume, transfer, Settings(blend="minip"), 2)[0, 0, 3] == 0


@pytest.mark.long
def test_boxes_end_between_coarse_voxels(renderer: sg.Renderer) -> None:
    """A linear ramp, of which levels of any step are means: no level is off because its boxes are others."""
    ramp = np.tile(np.linspace(0, 1, 150, dtype=np.float32), (75, 75, 1))
    coarse = ramp.reshape(25, 3, 25, 3, 10, 15).mean(axis=(1, 3, 5))
    level = sg.Volume(coarse, spacing=(15, 3, 3), origin=(7, 1, 1))
    volume = sg.Volume(ramp, coarser=(level,))
    transfer = sg.Transfer([(-1.0, 0.02), (2.0, 0.02)], shading=False)
    camera = sg.Camera.orbit(volume, 20, 10, size=(8, 8))
    found = choose_level(volume, transfer, camera, Settings(), renderer)
    assert found.number == 1 and found.off[1] < 0.02


def test_nothing_in_sight_takes_the_finest_level(smooth: sg.Volume, renderer: sg.Renderer) -> None:
    camera = sg.Camera.orbit(smooth, size=(16, 16))
    found = choose_level(smooth, sg.Transfer([(2.0, 0.0), (3.0, 1.0)]), camera, Settings(), renderer)
    assert found.number == 0 and not found.off and str(found) == "level 0, 64×64×64"
    away = sg.Camera.look_at(camera.eye, camera.eye - camera.forward, (0, 0, 1), 40, (16, 16))
    assert choose_level(smooth, SOFT, away, Settings(), renderer).number == 0


@pytest.mark.long
@pytest.mark.parametrize("blend", ["xray", "mip"])
@pytest.mark.parametrize("parallel", [False, True])
def test_levels_of_other_pictures(blend: str, parallel: bool, smooth: sg.Volume, renderer: sg.Renderer) -> None:
    camera = sg.Camera.orbit(smooth, 20, 10, size=(16, 16))
    camera = camera.parallel(smooth) if parallel else camera
    found = choose_level(smooth, SOFT, camera, Settings(blend=blend), renderer)
    assert found.number >= 1 and found.off[found.number] <= found.allowed


@pytest.mark.long
def test_levels_of_a_store(
    smooth: sg.Volume, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write(tmp_path / "v.zarr", smooth)
    monkeypatch.chdir(tmp_path)
    volume = sg.load("v.zarr")
    assert len(volume.coarser) == 3 and all(isinstance(level.samples, Chunked) for level in volume.coarser)
    for level, right in zip(volume.coarser, smooth.coarser, strict=True):
        assert level.spacing == pytest.approx(right.spacing) and level.origin == pytest.approx(right.origin)
        assert np.array_equal(np.asarray(level.samples[:]), right.samples)
    # one that is asked for, or of which the file's grid is not known, has no others
    assert not sg.load("v.zarr", level=1).coarser and not sg.load("v.zarr", spacing=(1, 1, 1)).coarser
    asked = ["render", "v.zarr", "--points", "0.2:0,0.8:0.05", "--shading", "off", "--size", "10"]
    assert main([*asked, "-o", "auto.npy"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("level ") and "off by RMSE" in said and not said.startswith("level 0")
    assert "checked pixels, " in said and f", of level {said[6]}'s voxels" in said
    assert main([*asked, "-o", "finest.npy", "--level", "0", "--check", "0", "--quiet"]) == 0
    auto, finest = np.load("auto.npy"), np.load("finest.npy")
    assert not np.array_equal(auto, finest) and np.sqrt(((auto - finest) ** 2).mean()) < 0.01
    # near enough, the finest
    assert main([*asked, "-o", "near.npy", "--zoom", "12", "--check", "0"]) == 0
    assert "level" not in capsys.readouterr().out


def test_the_statistics_of_a_large_image_are_those_of_a_level(monkeypatch: pytest.MonkeyPatch) -> None:
    from splatgl.transfer import statistics

    volume = with_levels(sg.Volume(noise(np.random.default_rng(1), (32, 32, 32))), 2)
    monkeypatch.setattr(statistics, "MOST_OF_LEVEL", 16**3)
    assert np.array_equal(statistics.statistics(volume).values, statistics.statistics(volume.coarser[0]).values)

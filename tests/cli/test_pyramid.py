"""Classified volumes with coarser levels: what a level keeps, what is written, and what reads it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli import export
from splatgl.cli.export import classified, halved, write
from splatgl.cli.main import main
from splatgl.gl.large_volumes import choose_level
from splatgl.splat.settings import Settings
from splatgl.writers import formats
from tests.helpers.levels import with_levels

pytestmark = pytest.mark.usefixtures("shared_programs")

pytest.importorskip("zarr", reason="needs the extra readers")
LOOK = sg.Transfer([(0.3, 0.0), (1.0, 0.9)], colormap="hot", shading=False)


def through(opacity: np.ndarray, axis: int, side: float = 1.0) -> float:
    """The mean opacity of rays along an axis, by hand."""
    return float((1 - np.prod((1 - opacity.astype(float)) ** side, axis=axis)).mean())


def test_a_block_has_the_mean_opacity_of_its_rays() -> None:
    full = np.full((2, 2, 2), 0.4, np.float32)
    red = np.zeros((2, 2, 2, 3), np.uint8)
    red[..., 0] = 200
    opacity, color = halved(full, red, (2, 2, 2), (1.0, 1.0, 1.0))
    assert opacity == pytest.approx(0.4) and color.tolist() == [[[[200, 0, 0]]]]
    # an opaque thread along z: across it half of the rays are stopped, along it a quarter
    thread = np.zeros((2, 2, 2), np.float32)
    thread[:, 0, 0] = 1.0
    opacity, color = halved(thread, red, (2, 2, 2), (1.0, 1.0, 1.0))
    right = [-np.log(1 - through(thread, axis)) / 2 for axis in range(3)]
    assert right == pytest.approx([-np.log(0.75) / 2, -np.log(0.5) / 2, -np.log(0.5) / 2])
    assert -np.log(1 - opacity[0, 0, 0]) == pytest.approx(np.mean(right), rel=1e-5) and color[0, 0, 0, 0] == 200
    # of long voxels, and of colours by extinction; what is transparent has no colour
    mixed = np.array([[[0.5, 0.0], [0.75, 0.0]]], np.float32)
    shade = np.zeros((1, 2, 2, 3), np.uint8)
    shade[0, 0, 0], shade[0, 1, 0], shade[0, :, 1] = 90, 30, 255
    opacity, color = halved(mixed, shade, (1, 2, 2), (3.0, 1.0, 2.0))
    right = [-np.log(1 - through(mixed, axis, side)) / n for axis, side, n in ((0, 3, 3), (1, 1, 2), (2, 2, 4))]
    assert -np.log(1 - opacity[0, 0, 0]) == pytest.approx(np.mean(right), rel=1e-5) and color[0, 0, 0, 0] == 50
    # the last of an odd count twice
    odd = np.full((2, 2, 3), 0.4, np.float32), np.zeros((2, 2, 3, 3), np.uint8)
    assert halved(*odd, (2, 2, 2), (1.0, 1.0, 1.0))[0].tolist() == [[[pytest.approx(0.4)] * 2]]


def test_voxels_are_those_of_the_extractor(rng: np.random.Generator) -> None:
    volume = sg.Volume(rng.random((9, 8, 7), np.float32), spacing=(1, 1, 2))
    transfer = sg.Transfer([(0.4, 0.0), (0.9, 0.7)], gradient=[(0.0, 0.1), (0.5, 1.0)], shading=False)
    splats = sg.extract(volume, transfer, classification="pre")
    opacity, color = classified(volume, transfer, (2, 0, 3), (7, 8, 6))
    right = np.zeros(volume.shape)
    x, y, z = splats.records["position"].T
    right[z, y, x] = 1 - np.exp(-splats.records["optical_depth"].astype(float))
    assert np.abs(opacity - right[2:7, :, 3:6]).max() < 1e-6 and color[opacity > 0].any()


@pytest.fixture
def store(threads: sg.Volume, tmp_path: Path, monkeypatch: Any) -> sg.Volume:
    """Threads one voxel wide, turned, as a pyramid of four levels."""
    monkeypatch.setattr(formats, "CHUNK", 8)
    turned = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    given = replace(threads, coarser=(), direction=turned, spacing=(1, 1, 2), origin=(3, 4, 5), unit="um", frame="RAS")
    write(tmp_path / "p.zarr", given, LOOK)
    return sg.load(tmp_path / "p.zarr")


@pytest.mark.long
def test_a_pyramid_is_read(store: sg.Volume, threads: sg.Volume, renderer: sg.Renderer) -> None:
    sides = [level.shape for level in (store, *store.coarser)]
    assert sides == [(64, 64, 64), (32, 32, 32), (16, 16, 16), (8, 8, 8)]
    assert store.unit == "um" and store.frame == "RAS" and store.direction[0, 1] == -0.8
    for level in store.coarser:
        assert np.allclose(level.center, store.center) and np.allclose(level.corners, store.corners)
    # drawn as the volume is, classified before
    given = replace(store, samples=threads.samples, color=None, coarser=(), hints=sg.Volume(threads.samples).hints)
    camera = sg.Camera.orbit(store, 20, 10, size=(40, 40))
    right = renderer.render(sg.extract(given, LOOK, classification="pre"), camera, verify_bound=False)
    found = renderer.render(sg.extract(store, sg.default_transfer(store)), camera, verify_bound=False)
    assert right.pixels.max() > 0.3 and np.abs(found.pixels - right.pixels).max() < 0.01


@pytest.mark.long
def test_thin_things_stay_at_coarse_levels(
    store: sg.Volume,
    threads: sg.Volume,
    renderer: sg.Renderer,
) -> None:
    """Nearer to the finest level than means of values are."""
    camera = sg.Camera.orbit(store, 20, 10, size=(20, 20))
    transfer = sg.default_transfer(store)
    settings = Settings(classification="pre")
    right = renderer.render(
        sg.extract(store, transfer), camera, settings.replace(antialias="supersample", samples=8), verify_bound=False
    ).pixels
    place = {"direction": store.direction, "spacing": store.spacing, "origin": store.origin}
    means = with_levels(sg.Volume(threads.samples, **place), 3)
    for number in (1, 2):
        found = renderer.render(sg.extract(store.coarser[number], transfer), camera, settings, verify_bound=False)
        splats = sg.extract(means.coarser[number], replace(LOOK, unit=transfer.unit), classification="pre")
        lost = renderer.render(splats, camera, settings, verify_bound=False).pixels
        off = [float(np.sqrt(((pixels - right) ** 2).mean())) for pixels in (found.pixels, lost)]
        assert off[0] < 0.6 * off[1], (number, off)
        assert found.pixels[..., 3].sum() > 0.5 * right[..., 3].sum() > lost[..., 3].sum()
    assert choose_level(store, transfer, camera, Settings(), renderer).off


def test_the_command(tmp_path: Path, monkeypatch: Any, capsys: Any, threads: sg.Volume) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(formats, "CHUNK", 16)
    np.save("t.npy", threads.samples)
    asked = ["pyramid", "t.npy", "--points", "0.3:0,1:0.9", "-o"]
    assert main([*asked, "p.zarr"]) == 0
    assert capsys.readouterr().out == "p.zarr: 64×64×64, 32×32×32, 16×16×16\n"
    assert main(["render", "p.zarr", "--size", "20", "-o", "x.png", "--quiet"]) == 0
    assert sg.Image.load("x.png").info["classification"] == "pre"
    for given, said in (
        ([*asked, "p.zarr"], "expected a name that is free"),
        ([*asked, "p.tif"], "expected a name that ends in .zarr"),
        ([*asked, "t.npy/p.zarr"], "expected a folder, got the file"),
        ([*asked, "q.zarr", "--threshold", "0.1"], "--threshold: expected none"),
        (["pyramid", "missing.npy", "-o", "q.zarr"], "missing.npy"),
    ):
        assert main(given) == 2
        error = capsys.readouterr().err
        assert said in error and error.count("\n") == 1
    # half of one is not left behind
    monkeypatch.setattr(export, "halved", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        main([*asked, "q.zarr"])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["p.zarr", "t.npy", "x.png"]


@pytest.mark.long
def test_a_damaged_pyramid(store: sg.Volume, tmp_path: Path) -> None:
    zarr = pytest.importorskip("zarr")
    group = zarr.open_group(tmp_path / "p.zarr", mode="r+")
    told = dict(group.attrs["splatgl"])
    wrong = [{**told, "unit": "long"}, {**told, "color": "nothing"}, {**told, "direction": [1, 2]}]
    for broken in (*wrong, [1], {"a": 1}):
        group.attrs["splatgl"] = broken
        with pytest.raises(sg.InputError, match=r"^[^\n]*p\.zarr: [^\n]*$"):
            sg.load(tmp_path / "p.zarr")

"""The world length that opacities refer to: the mean spacing or the extent of a whole volume, in all of its parts."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.cli.presets import subsampled
from splatgl.data.volume import halve_volume, subsample
from splatgl.planning.scene import channel_opacity
from splatgl.scene.scene_file import SceneFile
from splatgl.splat.extract import extract
from splatgl.splat.settings import Settings
from splatgl.viewer.adaptive_quality import STRIDES
from splatgl.viewer.document import Document
from splatgl.viewer.loading import _opened
from splatgl.viewer.thumbnails import reduce_volume
from tests.helpers.levels import with_levels, write

pytestmark = pytest.mark.usefixtures("shared_programs")

SIDE = 48.0
CAMERA = sg.Camera.look_at((0, -150, 0), (0, 0, 0), (0, 0, 1), fov=30, size=(33, 33))
SOFT = sg.Transfer([(0, 0.0), (1, 0.05)], "gray")


def ball(count: int, **more: object) -> sg.Volume:
    """A Gaussian in a box of SIDE, of count³ samples."""
    step = SIDE / count
    place = (np.arange(count) + 0.5) * step - SIDE / 2
    squares = sum(axis**2 for axis in np.meshgrid(place, place, place, indexing="ij"))
    samples = np.exp(-squares / 128).astype(np.float32)
    return sg.Volume(samples, (step,) * 3, (place[0],) * 3, unit="mm", **more)  # type: ignore[arg-type]


def alpha(volume: sg.Volume, unit: float | str | None = "extent") -> float:
    image = sg.render(volume, replace(SOFT, unit=unit), camera=CAMERA, background="transparent")  # type: ignore[arg-type]
    return float(image.pixels[..., 3].max())


def test_the_extent_does_not_depend_on_the_sampling() -> None:
    by_extent, by_spacing = ([alpha(ball(count), unit) for count in (32, 64, 128)] for unit in ("extent", None))
    assert np.ptp(by_extent) < 0.003 and 0.8 < by_extent[0] < 0.9
    assert by_spacing[2] - by_spacing[0] > 0.3


def test_lengths_of_a_box() -> None:
    direction = np.array([[1.0, 0.3, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]])
    volume = sg.Volume(np.zeros((5, 20, 40), np.uint8), (0.5, 1.0, 4.0), direction=direction)
    assert volume.lengths == pytest.approx((2 ** (1 / 3), (20.0 * 20.0 * 20.0) ** (1 / 3) / 100))
    assert sg.Volume(np.zeros((100,) * 3, np.uint8), (0.5, 1.0, 2.0)).lengths == pytest.approx((1.0, 1.0))
    assert volume.placed(None, "mm").lengths == volume.lengths
    in_mm = replace(volume, unit="mm")
    assert in_mm.part((0, 0, 0), (2, 2, 2)).placed(None, "um").lengths == pytest.approx(
        tuple(1000 * length for length in volume.lengths)
    )


PARTS: dict[str, Callable[[sg.Volume], sg.Volume]] = {
    "a part": lambda volume: volume.part((1, 2, 3), (9, 20, 30)),
    "means": halve_volume,
    "means of means": lambda volume: halve_volume(halve_volume(volume)),
    "some samples": lambda volume: subsample(volume, 3),
    "a level": lambda volume: with_levels(volume, 2).coarser[1],
    "a preset's picture": lambda volume: subsampled(volume),
    "a thumbnail": lambda volume: reduce_volume(volume) or volume,
}


@pytest.mark.parametrize("name", PARTS)
@pytest.mark.parametrize("unit", [None, "extent"])
def test_parts_have_the_length_of_the_whole(name: str, unit: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("splatgl.cli.presets.MOST", 9000)
    monkeypatch.setattr("splatgl.viewer.thumbnails.MOST_VOXELS", 9000)
    volume = ball(33)
    part = PARTS[name](volume)
    assert part.shape != volume.shape and part.lengths == volume.lengths
    look = replace(SOFT, unit=unit)  # type: ignore[arg-type]
    for how in ("pre", "post"):
        assert extract(part, look, classification=how).unit == look.length(volume)


def test_channels_of_a_coarser_level_are_as_dense() -> None:
    volume = ball(32)
    assert channel_opacity(halve_volume(volume), sg.Settings()) == pytest.approx(channel_opacity(volume, sg.Settings()))


def test_a_level_that_is_read_alone_has_the_length_of_the_finest(tmp_path: Path) -> None:
    volume = with_levels(ball(33), 2)
    write(tmp_path / "v.zarr", volume)
    for level in (0, 1, 2):
        assert sg.load(tmp_path / "v.zarr", level=level).lengths == pytest.approx(volume.lengths)
    coarse = sg.load(tmp_path / "v.zarr", level=1, spacing=(2, 2, 2))
    assert coarse.lengths.spacing == pytest.approx(2.0)
    assert alpha(sg.load(tmp_path / "v.zarr", level=1), None) == pytest.approx(alpha(ball(33), None), abs=0.02)


@pytest.mark.parametrize("unit", [None, "extent"])
def test_previews_of_the_window(unit: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("splatgl.viewer.layer_splats.SMALL", 100)
    volume = ball(24)
    table = {"points": SOFT.points, **({"unit": unit} if unit else {})}
    layer = Document.open(SceneFile("ball", transfer=table, held=volume), quiet=True).layers[0]
    expected = replace(SOFT, unit=unit).length(volume)  # type: ignore[arg-type]
    assert len({splats.grid.mean_spacing for splats in map(layer.at, STRIDES)}) > 1
    assert {layer.at(stride).unit for stride in STRIDES} == {expected}
    look = replace(layer.transfer, points=((0.0, 0.0), (1.0, 0.04)))
    edited = layer.with_own(replace(layer.own, transfer=look, threshold=0.0))
    assert {splats.unit for splats in edited.by_stride.values()} == {expected}


def test_pictures_that_are_the_same_have_one_length(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for count in (16, 24):
        ball(count).save(tmp_path / f"b{count}.nrrd")
    names = [str(tmp_path / f"b{count}.nrrd") for count in (16, 24)]
    size = ("--size", "16", "--check", "0", "--json")
    assert main(["render", *names, "-o", str(tmp_path / "{name}.png"), "--same", *size]) == 0
    lengths = [json.loads(line)["transfer"]["length"] for line in capsys.readouterr().out.splitlines()]
    assert lengths == pytest.approx([SIDE / 16] * 2)
    assert sg.Image.load(tmp_path / "b24.png").info["opacity_length"] == pytest.approx(SIDE / 16)


def test_a_series_has_the_length_of_its_first(tmp_path: Path) -> None:
    for count in (16, 24):
        ball(count).save(tmp_path / f"b{count}.nrrd")
    target = tmp_path / "f{frame}.npy"
    files = sg.animate(str(tmp_path / "b*.nrrd"), target, SOFT, size=(24, 24), turntable=0)
    first, second = (np.load(file)[..., 3].max() for file in files)
    assert first == pytest.approx(second, abs=0.03)


def test_a_series_in_the_window_has_the_length_of_its_first(tmp_path: Path) -> None:
    for count in (16, 24):
        ball(count).save(tmp_path / f"b{count}.nrrd")
    scenes = tuple(SceneFile(str(tmp_path / f"b{count}.nrrd"), transfer={"points": SOFT.points}) for count in (16, 24))
    first = _opened(scenes[0], scenes).document
    second = Document.open(scenes[1], quiet=True).with_styles(first.styles, (), Settings())
    units = [document.layers[0].at(1).unit for document in (first.with_styles(first.styles, (), Settings()), second)]
    assert units == pytest.approx([SIDE / 16] * 2)


def test_what_is_told_of_the_length(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ball(24).save(tmp_path / "b.nrrd")
    assert main(["info", str(tmp_path / "b.nrrd")]) == 0
    assert "opacities  per 2 mm, the mean spacing; --unit extent: per 0.48 mm" in capsys.readouterr().out
    assert main(["info", str(tmp_path / "b.nrrd"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["opacity_lengths"] == pytest.approx({"spacing": 2.0, "extent": 0.48})
    line = ["render", str(tmp_path / "b.nrrd"), "-o", str(tmp_path / "b.png"), "--check", "0", "--size", "16"]
    for options, told in (
        ((), "per 2 mm, the mean spacing;"),
        (("--unit", "extent"), "per 0.48 mm, by the extent;"),
        (("--unit", "3"), "per 3 mm;"),
    ):
        assert main([*line, *options]) == 0
        assert told in capsys.readouterr().out


@pytest.mark.parametrize("unit", ["0", "-1", "nan", "box", ""])
def test_other_lengths_are_refused(unit: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    try:
        code = main(["render", "tunnel", "-o", str(tmp_path / "b.png"), "--unit", unit])
    except SystemExit as end:
        code = int(end.code or 0)
    assert code == 2 and not (tmp_path / "b.png").exists()
    assert "a positive, finite length in world units, or extent, got" in capsys.readouterr().err
    with pytest.raises(sg.InputError, match="a positive, finite length in world units, or extent, got"):
        sg.Transfer([(0, 0), (1, 1)], unit=unit)  # type: ignore[arg-type]

"""Values far from all others: numbers that stand for no value, hot pixels and marks change neither look nor picture."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.scene.scene_file import SceneFile
from splatgl.transfer.presets import PRESETS, preset
from splatgl.transfer.statistics import OutlierValues, outliers_of, without_outlier_values
from splatgl.viewer.document import Document
from splatgl.viewer.thumbnails import reduce_volume

SIDE = 24
Z, Y, X = np.mgrid[:SIDE, :SIDE, :SIDE] - (SIDE - 1) / 2
RADIUS = np.sqrt(X**2 + Y**2 + Z**2)
OUTSIDE = RADIUS > 11


def head() -> np.ndarray:
    """Whole numbers from 0 to 80, float64: a ball with a core, in noise."""
    noise = np.random.default_rng(5).normal(9, 2, RADIUS.shape)
    return np.asarray(np.clip(45 * (RADIUS < 8) + 20 * (np.abs(X - 3) < 2) * (RADIUS < 6) + noise, 0, 80).round())


def field() -> np.ndarray:
    """A smooth field of a simulation, float32, from 0.5 to 3.5."""
    return np.asarray(2 + np.sin(X / 4) * np.cos(Y / 5) + Z / 24, np.float32)


def pixels(samples: np.ndarray, **options: object) -> np.ndarray:
    return sg.render(samples, size=(32, 32), **options).pixels


@pytest.mark.parametrize(
    ("fill", "kind"),
    [
        *((fill, "float32") for fill in (-9999, -999, -1e30, 1e30, -3.4e38, 9.96921e36, 3.4028235e38, -10000, -777)),
        *((fill, "int16") for fill in (-32768, 32767, -9999)),
        *((255, "uint8"), (65535, "uint16"), (-(2**31), "int32"), (-1e30, ">f8"), (65535, "float64")),
    ],
)
def test_a_background_that_stands_for_no_value_is_left_out(fill: float, kind: str) -> None:
    samples = np.where(OUTSIDE, fill, head()).astype(kind)
    missing = np.where(OUTSIDE, np.nan, head()).astype(np.float32)
    drawn, right = (sg.Volume(each) for each in (samples, missing))
    for name in PRESETS:
        assert preset(name, drawn) == preset(name, right)
    image = sg.render(samples, size=(32, 32))
    assert any("far from all other values, are left out: --values amounts" in note for note in image.notes)
    assert np.array_equal(image.pixels, pixels(missing))
    assert len(outliers_of(sg.Volume(samples).of_values("amounts")).fills) == 0


def test_two_numbers_for_no_value_are_left_out() -> None:
    samples = np.where(OUTSIDE, -1e30, field().astype(np.float64))
    samples[RADIUS < 3] = 1e30
    assert outliers_of(sg.Volume(samples)).fills == (-1e30, 1e30)
    assert outliers_of(sg.Volume(np.where(OUTSIDE, np.where(Z > 0, -9999, -32768), head()))).fills == (-32768, -9999)


def scattered(samples: np.ndarray, share: float, value: float) -> np.ndarray:
    """The samples with a share of hot pixels, at least one."""
    hot = samples.copy()
    hot.flat[np.random.default_rng(1).permutation(hot.size)[: max(round(share * hot.size), 1)]] = value
    return hot


@pytest.mark.parametrize("make", [head, field])
@pytest.mark.parametrize(("share", "value"), [(0, 65535), (1e-4, 1e6), (0.002, 65535), (0.005, -6e4), (0.01, 65535)])
def test_hot_pixels_neither_hide_the_object_nor_change_its_look(
    make: Callable[[], np.ndarray], share: float, value: float
) -> None:
    hot = scattered(make(), share, value)
    image = sg.render(hot, size=(32, 32))
    assert any("single voxels" in note and "--values amounts" in note for note in image.notes)
    assert np.abs(image.pixels - pixels(make())).mean() < 2e-3
    window = sg.default_transfer(sg.Volume(make())).window
    assert sg.default_transfer(sg.Volume(hot)).window == pytest.approx(window, abs=0.06 * float(np.ptp(make())))


def test_a_mark_at_a_corner_is_left_out() -> None:
    marked = head().astype(np.uint16)
    marked[:3, :3, -3:] = 65535
    assert np.abs(pixels(marked) - pixels(head())).mean() < 2e-3


def ct(padding: float) -> np.ndarray:
    """Soft tissue in air, padded outside a cylinder."""
    tissue = np.where(RADIUS < 8, 40, -1000) + np.random.default_rng(2).normal(0, 10, RADIUS.shape)
    return np.where(np.hypot(X, Y) > 11.5, padding, tissue).round()


def spots() -> np.ndarray:
    """Zeros, and bright voxels that are alone."""
    random = np.random.default_rng(4)
    return np.where(random.random(RADIUS.shape) < 0.01, random.integers(1, 4000, RADIUS.shape), 0)


USUAL: dict[str, Callable[[], np.ndarray]] = {
    **{f"a CT padded with {padding}": lambda padding=padding: ct(padding) for padding in (-1024, -2000, -2048, -3024)},  # type: ignore[misc]
    "a CT with metal": lambda: np.where(RADIUS < 2, 30000, ct(-1000)),
    "air of −1000 around one tissue": lambda: np.where(RADIUS < 8, np.where(X > 0, 30, 60) + Y.round(), -1000),
    "a mask": lambda: (RADIUS < 8) * 255,
    "a mask in float": lambda: np.where(RADIUS < 8, 1e30, 0),
    "an inverted mask": lambda: (RADIUS > 8) * 255,
    "a mask of −9999": lambda: np.where(RADIUS < 8, 0, -9999),
    "labels": lambda: np.select([RADIUS < 3, RADIUS < 5, RADIUS < 8], [1035, 1001, 17], 0),
    "labels with a void": lambda: np.select([RADIUS < 3, RADIUS < 5, RADIUS < 8], [3, 2, 1], 255),
    "spots": spots,
    "spots in noise": lambda: spots() + np.random.default_rng(6).normal(100, 4, RADIUS.shape).round(),
    "a saturated object": lambda: np.minimum(head() * 20, 255),
    "a solid object in noise": lambda: np.where(RADIUS < 8, 65535, head() // 9),
    "a small bright object": lambda: np.where(RADIUS < 1.5, 5000, head()),
    "zeros around tissue": lambda: np.where(OUTSIDE, 0, head() + 4000),
    "an impulse": lambda: (RADIUS < 1) * 1.0,
    "large values": lambda: head() * 1e20,
    "cold air around an object": lambda: np.where(OUTSIDE, -20, field() + 4),
    "kelvin": lambda: np.where(OUTSIDE, 0, field() + 300),
}


@pytest.mark.parametrize("name", USUAL)
def test_usual_values_are_not_taken_for_others(name: str) -> None:
    assert outliers_of(sg.Volume(np.asarray(USUAL[name]()))) == OutlierValues()


def test_files_and_every_front_end_leave_them_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    np.save(tmp_path / "head.npy", np.where(OUTSIDE, -32768, head()).astype(np.int16))
    right = pixels(np.where(OUTSIDE, np.nan, head()))
    assert np.array_equal(pixels(tmp_path / "head.npy"), right)  # type: ignore[arg-type]
    document = Document.open(SceneFile(str(tmp_path / "head.npy")))
    assert document.layers[0].transfer == sg.default_transfer(sg.Volume(np.where(OUTSIDE, np.nan, head())))
    assert main(["info", str(tmp_path / "head.npy")]) == 0
    told = capsys.readouterr()
    assert "voxels of -32768" in told.err and "-32768" not in told.out
    kept = sg.render(tmp_path / "head.npy", size=(32, 32), values="amounts")
    assert not any("-32768" in note for note in kept.notes) and not np.array_equal(kept.pixels, right)


def test_each_channel_leaves_out_its_own() -> None:
    bad, good = np.where(OUTSIDE, -9999, head()), head()[::-1]
    parts = tuple(sg.Volume(each, name=name) for each, name in ((bad, "red"), (good, "blue")))
    volume = without_outlier_values(sg.Volume(bad, channels=parts))
    assert [each.name for each in volume.channels] == ["red", "blue"] and volume.channels[1].samples is good
    assert np.isnan(volume.samples).sum() == np.isnan(volume.channels[0].samples).sum() == OUTSIDE.sum()
    assert len(volume.notes) == 1 and volume.notes[0].startswith("red: voxels of -9999")


def test_thumbnails_leave_them_out() -> None:
    bad, right = (sg.Volume(np.where(OUTSIDE, fill, head())) for fill in (1e30, np.nan))
    small, expected = reduce_volume(bad), reduce_volume(right)
    assert small is not None and expected is not None
    assert np.array_equal(small.samples, expected.samples, equal_nan=True)


def test_large_samples_are_read_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("splatgl.transfer.statistics.MOST_SCANNED", 1000)
    bad = scattered(np.where(OUTSIDE, -32768, head()).astype(np.int16), 0.002, 30000)
    image = sg.render(bad, size=(32, 32))
    assert len([note for note in image.notes if "left out" in note]) == 2
    assert np.abs(image.pixels - pixels(np.where(OUTSIDE, np.nan, head()))).mean() < 0.01


def test_peaks_stay() -> None:
    """A voxel that is far brighter than most is a peak if one beside it is bright."""
    for sigma in np.linspace(1.0, 6.0, 51):
        from_voxel = (X - 0.5) ** 2 + (Y - 0.5) ** 2 + (Z + 0.5) ** 2
        peak = 200 * np.exp(-from_voxel / (2 * sigma**2)) + 9 * (RADIUS < 9)
        assert outliers_of(sg.Volume(peak.astype(np.float32))) == OutlierValues(), sigma


def test_lone_voxels_of_an_object_stay() -> None:
    """Puncta as wide as a voxel are drawn, unless they are saturated or extremely far from all others."""
    rng = np.random.default_rng(4)
    places = rng.permutation(RADIUS.size)[:20]
    for values, is_far in ((rng.uniform(4, 10, 20), False), (255.0, True), (1e4, True)):
        samples = np.asarray(field(), np.float64)
        samples.flat[places] = values
        assert (outliers_of(sg.Volume(samples)) != OutlierValues()) == is_far, values

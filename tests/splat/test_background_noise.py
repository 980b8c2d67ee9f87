"""A camera's offset and noise: the background of sparse volumes, and what is shown of them."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.data.volume import Volume
from splatgl.planning.scene import channel_transfers
from splatgl.transfer.presets import default_transfer, projection_transfer
from splatgl.transfer.statistics import background_of, mean_deviation, sampled_steps, statistics

DATA = Path(os.environ.get("SPLATGL_DATA", Path(__file__).parents[3] / "shared" / "data"))
# offset, noise (standard deviation), least Jaccard index of what is kept, relative to the best of any threshold
CAMERAS = [(0, 0, 1.0), (10, 0, 1.0), (500, 0, 1.0), (0, 8, 0.97), (10, 8, 0.97), (500, 8, 0.97), (100, 2, 0.98)]
CAMERAS += [(100, 4, 0.98), (100, 8, 0.97), (100, 12, 0.95), (100, 20, 0.8)]


def threads(shape: tuple[int, int, int] = (40, 160, 160)) -> np.ndarray:
    """Bright curved lines on zeros: about 0.8 % of the voxels."""
    samples = np.zeros(shape, np.uint8)
    rng = np.random.default_rng(2)
    t = np.linspace(0, 1, 4000)
    for _ in range(14):
        phase, pace = rng.uniform(0, 6, 3), rng.uniform(2, 7, 3)
        place = (0.5 + 0.48 * np.sin(phase[:, None] + pace[:, None] * t)) * (np.array(shape)[:, None] - 1)
        samples[tuple(place.round().astype(int))] = (135 + 120 * np.sin(9 * t + phase[0])).astype(np.uint8)
    return samples


def filmed(clean: np.ndarray, offset: float, noise: float, seed: int = 0) -> np.ndarray:
    drawn = clean + np.random.default_rng(seed).normal(offset, noise, clean.shape)
    return np.clip(np.round(drawn), 0, 65535).astype(np.uint16)


def overlap(kept: np.ndarray, right: np.ndarray) -> float:
    return float((kept & right).sum() / (kept | right).sum())


def best_overlap(samples: np.ndarray, right: np.ndarray) -> float:
    """The largest Jaccard index that any threshold has."""
    inside, outside = np.sort(samples[right]), np.sort(samples[~right])
    cuts = np.unique(inside)
    more = len(inside) - np.searchsorted(inside, cuts, "left")
    wrong = len(outside) - np.searchsorted(outside, cuts, "left")
    return float((more / (len(inside) + wrong)).max())


@pytest.mark.few(5)
@pytest.mark.parametrize(("offset", "noise", "share"), CAMERAS)
def test_an_offset_changes_nothing_of_what_is_shown(offset: int, noise: int, share: float) -> None:
    clean = threads()
    plain = default_transfer(Volume(clean))
    right = plain.opacity(clean) > 0
    samples = filmed(clean, offset, noise)
    transfer = default_transfer(Volume(samples))
    assert (transfer.colormap, transfer.shading) == ("glow", False)
    assert overlap(transfer.opacity(samples) > 0, right) >= share * best_overlap(samples, right)
    assert transfer.opacity(offset + 255) == pytest.approx(float(plain.opacity(255)), rel=0.12)


@pytest.mark.parametrize("offset", [3, 10, 100])
def test_photons_have_a_ground(offset: int) -> None:
    clean = threads()
    samples = np.random.default_rng(4).poisson(clean + float(offset)).astype(np.uint16)
    right = clean > 0
    transfer = default_transfer(Volume(samples))
    assert transfer.colormap == "glow"
    assert overlap(transfer.opacity(samples) > 0, right) > 0.93 * best_overlap(samples, right)


def test_a_scale_changes_nothing() -> None:
    """Of floats, of whole numbers or not."""
    clean = threads()
    right = clean > 0
    for samples in (filmed(clean, 100, 8), clean + np.random.default_rng(0).normal(100, 8, clean.shape)):
        kept = [default_transfer(Volume(each)).opacity(each) > 0 for each in (samples, samples.astype("f4") / 4096)]
        assert overlap(kept[0], kept[1]) > 0.97 and overlap(kept[1], right) > 0.95 * best_overlap(samples, right)


def test_a_few_dead_pixels_change_nothing() -> None:
    samples = threads().astype(np.uint16) + 100
    plain = default_transfer(Volume(samples))
    samples[::13, ::31, ::37] = 0
    assert np.array_equal(default_transfer(Volume(samples)).opacity(samples) > 0, plain.opacity(samples) > 0)


def test_all_of_few_is_found() -> None:
    """What stands out, between sampled planes, too."""
    samples = filmed(np.zeros((200, 64, 64)), 100, 5)
    samples[50:150, 30, 30] = np.linspace(160, 900, 100)
    stats = statistics(Volume(samples))
    assert stats.ground is not None and stats.ground.level == pytest.approx(100, abs=0.5)
    assert stats.ground.noise == pytest.approx(5, rel=0.1)
    assert (stats.values > 150).sum() == 100


@pytest.mark.parametrize(("smooth", "begins"), [(False, 115.0), (True, 0.0)])
def test_maxima_begin_above_noise(smooth: bool, begins: float) -> None:
    """Where objects fill a tenth of the volume, too. Tissue, of which neighbours are alike, is no noise."""
    noise, place = np.random.default_rng(7).normal(size=(32, 64, 64)), np.indices((32, 64, 64))
    if smooth:
        noise = np.sum([np.roll(noise, shift, axis) for shift in range(4) for axis in (1, 2)], axis=0)
        noise = (noise - noise.mean()) / noise.std()
    ball = 600 * np.exp(-(((place - 20) / 8.0) ** 2).sum(axis=0))
    volume, mip = Volume((100 + 6 * noise + ball).astype(np.float32)), sg.Settings(blend="mip")
    (low, _), *_, (high, _) = projection_transfer(default_transfer(volume), volume).points
    assert high > 400 and (begins <= low < 135 if begins else low < 95)
    if begins:
        both = replace(volume, channels=(volume, replace(volume, hints=replace(volume.hints, window=(90, 500)))))
        first, stated = channel_transfers(both, {}, {}, settings=mip)
        assert first.points[0] == (low, 0.0) and stated.points[0] == (90, 0.0)


NOTHING: dict[str, Callable[[np.random.Generator], np.ndarray]] = {
    "noise alone": lambda rng: rng.normal(100, 8, 100_000),
    "uniform": lambda rng: rng.random(100_000),
    "a slope": lambda rng: rng.exponential(8, 100_000),
    "two classes": lambda rng: np.concatenate([rng.normal(20, 3, 80_000), rng.normal(90, 3, 20_000)]),
    "dark objects": lambda rng: np.concatenate([rng.normal(200, 3, 99_000), rng.uniform(0, 180, 1_000)]),
    "both sides": lambda rng: rng.standard_t(2, 100_000),
    "few": lambda rng: np.append(rng.normal(100, 8, 100), 900.0),
}


@pytest.mark.parametrize("name", NOTHING)
def test_other_values_have_no_ground(name: str) -> None:
    values = np.sort(NOTHING[name](np.random.default_rng(6)))
    assert background_of(values, 0.95) is None


def test_few_different_objects_on_a_ground_are_no_labels() -> None:
    samples = filmed(np.zeros((20, 64, 64)), 100, 8)
    samples[5:15, 20:22, 20:22] = 300
    assert default_transfer(Volume(samples)).colormap == "glow"


@pytest.mark.parametrize("noise", [2, 8])
def test_the_neuron_with_an_offset(noise: int) -> None:
    path = DATA / "neuron_a_409x415x119.tif"
    if not path.exists():
        pytest.skip(f"{path} is not here")
    clean = np.asarray(sg.load(path).samples)
    plain = default_transfer(Volume(clean))
    assert plain.points == ((6.5, 0.0), (255.0, 0.8))
    samples = filmed(clean, 100, noise)
    transfer = default_transfer(Volume(samples))
    right = plain.opacity(clean) > 0
    # of independent noise of 8, no threshold keeps more than 0.86
    assert overlap(transfer.opacity(samples) > 0, right) > 0.98 * best_overlap(samples, right)
    assert overlap(transfer.opacity(samples) > 0.1, plain.opacity(clean) > 0.1) > 0.9


def test_hot_voxels_do_not_spread_values() -> None:
    """Of a series the step with an object is the widest, not an empty or constant one with a few hot voxels."""
    empty, z = np.zeros((64, 32, 32), np.uint16), np.arange(64)[:, None, None]
    hot, small, large, bad = empty.copy(), empty.copy(), empty.copy(), np.full(empty.shape, np.nan)
    hot[3::17, 5, 7] = 65535
    # between the planes of a sample
    small[33, 8:12, 8:12] = 30000
    large[:] = np.where(abs(z - 30) < 4, 900, 0)
    order = (bad, empty, empty + 60000, hot, small, large)
    spreads = [mean_deviation(Volume(samples)) for samples in order]
    assert spreads[:3] == [0, 0, 0] and spreads[3:] == sorted(spreads[3:]) and spreads[3] > 0
    assert mean_deviation(Volume(np.array([[[-1e308, 1e308, np.inf]]]))) == np.inf
    assert sampled_steps(2) == [0, 1] and sampled_steps(1000) == [0, 250, 500, 749, 999]


@pytest.mark.parametrize("scale", [1.0, 1e300, 1e-300])
def test_rounding_is_no_contrast(scale: float) -> None:
    """Values that differ by rounding alone count as one value, alone and as foreground."""
    values = np.where(np.random.default_rng(0).random((8, 8, 8)) > 0.5, 0.3, 0.1 * 3) * scale
    assert len(np.unique(values)) == 2 and statistics(Volume(values)).constant
    samples = np.zeros((24, 24, 24))
    samples[:4, :4, :4] = values[:4, :4, :4]
    assert len(statistics(Volume(samples)).cuts) == 1

"""What is stated of all pixels from a random sample of them, by exact statistics."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.reference.check import ALPHA, PILOT, PIXELS, Sampling, compare_sample, share_limit
from tests.fuzz import guarantee

SETTINGS = sg.Settings(tolerance=0.01)


def flat(width: int = 90, height: int = 70) -> np.ndarray:
    return np.zeros((height, width, 4), np.float32)


def stated(pixels: np.ndarray, right: np.ndarray, count: int | float) -> Any:
    """What is stated of pixels [H, W, 4] whose right values are known."""
    exact = right.reshape(-1, 4)
    return compare_sample(sg.Image(pixels), SETTINGS, count, lambda some: exact[some])[0].info["checked"]


@pytest.mark.parametrize(("above", "drawn"), [(0, 1), (0, 160), (1, 10), (5, 100), (30, 400), (1500, 9000)])
def test_limits_of_shares_are_those_of_clopper_and_pearson(above: int, drawn: int) -> None:
    """At the limit so few or fewer come true with probability ALPHA."""
    limit, log = share_limit(above, drawn), math.lgamma
    terms = (
        log(drawn + 1) - log(n + 1) - log(drawn - n + 1) + n * math.log(limit) + (drawn - n) * math.log1p(-limit)
        for n in range(above + 1)
    )
    assert abs(math.fsum(map(math.exp, terms)) - ALPHA) < 1e-8
    assert above > 0 or abs(limit - (1 - ALPHA ** (1 / drawn))) < 1e-12
    assert share_limit(drawn, drawn) == 1.0 and (drawn == 1 or share_limit(drawn - 1, drawn) == 1.0)


def test_statements_are_wrong_as_often_as_they_may_be() -> None:
    """Of just more wrong pixels than are stated, the draws meet none in nearly ALPHA of the pictures, not more."""
    rng, count, wrong, trials = np.random.default_rng(5), 60, 0, 600
    share = stated(flat(), flat(), count)["share"]
    for _ in range(trials):
        pixels = flat() + np.float32(rng.random())
        right = pixels.copy()
        right.reshape(-1, 4)[rng.permutation(right[..., 0].size)[: round(share * right[..., 0].size) + 1]] += 0.5
        wrong += stated(pixels, right, count)["largest"] == 0
    assert 0.02 < wrong / trials < ALPHA + 3 * math.sqrt(ALPHA / trials) and abs(share - 0.0487) < 1e-3


def test_draws_are_one_of_each_stratum_and_densest_at_edges() -> None:
    """Each pixel is drawn as often as its weight says; next to a thread far more often than elsewhere."""
    pixels = flat()
    pixels[:, 40] = 1.0
    near = np.zeros(pixels.shape[:2], bool)
    near[:, 39:42] = True
    times, seeds = np.zeros(near.size), 400
    sampling = Sampling.of(pixels, np.ones(pixels.shape[:2], bool))
    assert sampling.weights.min() == 1 and 1.1 < sampling.weights.mean() <= 4 / 3 + 1e-6
    for seed in range(seeds):
        drawn, often = Sampling(sampling.weights, sampling.order, seed).draw(PIXELS)
        assert (np.diff(drawn) > 0).all() and often.sum() == PIXELS
        times[drawn] += often
    shares = [times[part.ravel()].sum() / (seeds * PIXELS) for part in (near, ~near)]
    right = [sampling.weights[part.ravel()].sum() / sampling.weights.sum() for part in (near, ~near)]
    # one of each stratum: strata beside the thread all have their draw
    assert np.allclose(shares, right, rtol=0.02) and shares[0] / near.mean() > 5 * shares[1] / (~near).mean()
    left = np.zeros(near.shape, bool)
    left[:, :40] = True
    strata = (Sampling(sampling.weights, sampling.order, seed) for seed in range(99))
    # a binomial number would vary by 4
    assert np.std([left.ravel()[each.draw(64)[0]].sum() for each in strata]) < 2.5


def test_a_wrong_thread_is_found() -> None:
    """A thread that is off, in a seventieth of the pixels, which ten squares may miss."""
    rng = np.random.default_rng(3)
    for _ in range(20):
        pixels = rng.random(flat().shape).astype(np.float32) * 0.01
        column = int(rng.integers(90))
        pixels[:, column] += 0.5
        right = pixels.astype(np.float64)
        right[:, column] += 0.1
        found = stated(pixels, right, PIXELS)
        assert abs(found["largest"] - 0.1) < 1e-6 and found["worst"][0] == column
        assert found["share_above_tolerance"] > 1 / 90


def test_all_pixels_of_a_small_picture_are_compared() -> None:
    rng = np.random.default_rng(1)
    pixels = rng.random((4, 11, 4)).astype(np.float32)
    right = pixels + rng.choice([0.0, 0.02], (4, 11, 1))
    found = stated(pixels, right, PIXELS)
    off = np.abs(pixels - right)
    assert found["pixels"] == 44 and (found["confidence"], found["share"]) == (1.0, 0.0)
    assert abs(found["largest"] - off.max()) < 1e-12 and abs(found["rmse"] - np.sqrt((off**2).mean())) < 1e-9
    assert found["share_above_tolerance"] == (off.max(axis=2) > 0.01).mean()


def test_the_same_picture_gets_the_same_statement() -> None:
    pixels = np.random.default_rng(2).random((70, 90, 4)).astype(np.float32)
    first, again, other = (stated(each, pixels + 0.001, PIXELS) for each in (pixels, pixels, pixels[::-1].copy()))
    assert first == again and first["seed"] != other["seed"] and first["pixels"] == PIXELS


def test_as_many_pixels_are_drawn_as_a_time_allows(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a clock that a millisecond a pixel moves, and 20 ms for any number; never fewer than PILOT."""
    now = [0.0]
    monkeypatch.setattr("time.perf_counter", lambda: now[0])

    def draw(some: np.ndarray) -> np.ndarray:
        now[0] += 0.02 + 1e-3 * len(some)
        return np.zeros((len(some), 4))

    for seconds, count in ((0.5, 402), (0.01, PILOT), (0.15, 52)):
        now[0] = 0.0
        checked: Any = compare_sample(sg.Image(flat()), SETTINGS, seconds, draw)[0].info["checked"]
        assert abs(checked["pixels"] - count) <= 2 and (seconds < 0.1 or now[0] <= seconds + 1e-9)


@pytest.mark.parametrize("first", [0, pytest.param(20, marks=pytest.mark.long)])
def test_statements_hold_of_random_pictures(renderer: sg.Renderer, first: int) -> None:
    """The short form of tests/fuzz/guarantee.py."""
    count = 6 if first == 0 else 150
    wrong = np.sum([guarantee.outcome(renderer, seed).wrong for seed in range(first, first + count)], axis=0)
    assert guarantee.chance(int(max(wrong)), count) > 1e-3

"""One step of rounding, held to its definition: every sample of sRGB, and every alpha, against the next ones."""

from __future__ import annotations

import numpy as np
import pytest

import splatgl as sg
from splatgl.comparison.compare import compare
from splatgl.comparison.metrics import over_a_step
from splatgl.comparison.verdict import judge

LEVELS = np.arange(256)


def over(a: np.ndarray, b: np.ndarray, peak: float = 1.0) -> np.ndarray:
    """Of pictures from samples, uint8 [H, W, 4]."""
    x, y = (sg.Image.from_samples(samples.astype(np.uint8)).pixels * np.float32(peak) for samples in (a, b))
    return over_a_step(x, y, np.abs(x - y).max(axis=-1), peak)


def samples(color: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """Each colour with each alpha, [alphas, colours, 4]; green is the colour, red and blue lie between."""
    alpha, color = np.meshgrid(alpha, color, indexing="ij")
    return np.stack([color // 2, color, color // 3, alpha], axis=-1)


@pytest.mark.parametrize("peak", [1.0, 40.0])
@pytest.mark.parametrize("color", [-1, 0, 1])
@pytest.mark.parametrize("alpha", [-1, 0, 1])
def test_one_step_of_color_and_of_alpha_is_rounding(color: int, alpha: int, peak: float) -> None:
    """All 256 × 256 pixels. A colour without alpha is nowhere to be seen, and may be any."""
    right = samples(LEVELS, LEVELS)
    moved = samples(np.clip(LEVELS + color, 0, 255), np.clip(LEVELS + alpha, 0, 255))
    assert not over(moved, right, peak).any()


@pytest.mark.parametrize("steps", [-2, 2])
def test_two_steps_of_an_opaque_color_are_not(steps: int) -> None:
    """In the darks as next to white, where a step is 7 and 30 times as large."""
    right = samples(LEVELS[2:-2], np.array([255]))
    moved = right.copy()
    moved[..., 1] += steps
    assert over(moved, right).all()


@pytest.mark.parametrize("steps", [-2, 2])
def test_two_steps_of_alpha_are_not(steps: int) -> None:
    right = samples(LEVELS, LEVELS[2:-2])
    moved = right.copy()
    moved[..., 3] += steps
    assert over(moved, right).all()


def test_a_step_of_alpha_excuses_no_more_of_a_color_than_its_share() -> None:
    right, moved = samples(np.array([20]), np.array([255])), samples(np.array([23]), np.array([254]))
    assert over(moved, right).all()
    assert not over(samples(np.array([21]), np.array([254])), right).any()


def test_what_eyes_do_not_see_is_none() -> None:
    """Floats may differ in anything below a step in the darks, however thin the matter."""
    rng = np.random.default_rng(7)
    alpha = 10.0 ** rng.uniform(-8, 0, (50, 60, 1))
    b = np.concatenate([alpha * rng.random((50, 60, 3)), alpha], -1).astype(np.float32)
    a = b + rng.uniform(-3e-4, 3e-4, b.shape).astype(np.float32)
    assert not over_a_step(a, b, np.abs(a - b).max(axis=-1), 1.0).any()


@pytest.mark.parametrize("kind", ["dark object", "thin haze"])
def test_a_small_faint_object_is_missed_by_no_one(kind: str) -> None:
    """32×32 pixels of 512×512: too few for the mean, and less than a step next to white."""
    right, actual = np.zeros((512, 512, 4), np.uint8), np.zeros((512, 512, 4), np.uint8)
    if kind == "dark object":
        right[..., 3] = actual[..., 3] = 255
    right[100:132, 200:232] = (20, 20, 20, 255) if kind == "dark object" else (255, 255, 255, 2)
    pictures = [sg.Image.from_samples(p) for p in (actual, right)]
    assert compare(*pictures).maximum < 2.28 / 255
    verdict = judge(*pictures)
    assert not verdict.same and verdict.comparison.box == (200, 100, 232, 132)
    assert verdict.comparison.share_over == (32 / 512) ** 2

"""Comparison of two pictures: each number against one worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

import splatgl as sg
from splatgl.comparison.verdict import Tolerance, judge


def flat(value: float = 0.25, **info: object) -> sg.Image:
    return sg.Image(np.full((4, 5, 4), value, np.float32), info)


def changed(row: int, column: int, channel: int, by: float) -> sg.Image:
    pixels = flat().pixels.astype(np.float64)
    pixels[row, column, channel] += by
    return sg.Image(pixels)


def test_equal_pictures() -> None:
    found = sg.compare(flat(), flat())
    assert (found.maximum, found.rmse, found.share_over, found.sum_error, found.box) == (0, 0, 0, 0, None)
    assert found.psnr == np.inf


@pytest.mark.parametrize("by", [0.5, -0.5])
def test_one_changed_channel(by: float) -> None:
    found = sg.compare(changed(3, 1, 2, by), flat())
    assert found.maximum == 0.5
    assert found.where == (1, 3)
    assert found.rmse == pytest.approx(0.5 / np.sqrt(80))
    assert found.psnr == pytest.approx(-20 * np.log10(0.5 / np.sqrt(80)))
    assert found.share_over == 1 / 20
    assert found.sum_error == pytest.approx(by / 20)
    assert found.box == (1, 3, 2, 4)
    assert "maximum 0.5 at column 1, row 3" in str(found)


def test_box_and_share_count_from_one_level() -> None:
    pixels = flat().pixels.astype(np.float64)
    pixels[0, 1] += 1.01 / 255
    pixels[2, 3] -= 1.01 / 255
    pixels[3, 4] += 0.99 / 255
    found = sg.compare(sg.Image(pixels), flat())
    assert found.box == (1, 0, 4, 3)
    assert found.share_over == 2 / 20


def test_xrays_are_measured_by_their_largest_sum() -> None:
    found = sg.compare(flat(51.0), flat(50.0, blend="xray"))
    assert found.peak == 50
    assert found.psnr == pytest.approx(20 * np.log10(50))
    assert found.share_over == 1
    assert sg.compare(flat(50.1), flat(50.0, blend="xray")).share_over == 0


def test_nothing_against_something() -> None:
    assert sg.compare(flat(0.0), flat(0.0)).sum_error == 0
    assert sg.compare(flat(1.0), flat(0.0)).sum_error == np.inf
    assert sg.compare(flat(0.0), flat(1.0)).sum_error == -1


def test_what_can_not_be_compared() -> None:
    with pytest.raises(sg.InputError, match="pictures: expected one size, 5×4, got 3×2"):
        sg.compare(sg.Image(np.zeros((2, 3, 4))), flat())
    for bad in (np.nan, np.inf):
        with pytest.raises(sg.InputError, match=r"first picture: expected finite numbers, got .* at column 1, row 3"):
            sg.compare(changed(3, 1, 0, bad), flat())
        with pytest.raises(sg.InputError, match="second picture: expected finite numbers"):
            sg.compare(flat(), changed(3, 1, 0, bad))
    with pytest.raises(sg.InputError, match="pixels \\[H, W, 4\\]"):
        sg.compare(sg.Image(np.zeros((2, 3, 3))), flat())


def test_bias_is_the_signed_mean_of_the_worst_channel() -> None:
    pixels = flat().pixels.astype(np.float64)
    pixels[..., 0] += 0.01
    pixels[..., 2] -= 0.02
    assert sg.compare(sg.Image(pixels), flat()).bias == pytest.approx(-0.02)
    # what goes up here and down there leaves none
    pixels = flat().pixels.astype(np.float64)
    pixels[:2] += 0.1
    pixels[2:] -= 0.1
    assert sg.compare(sg.Image(pixels), flat()).bias == pytest.approx(0, abs=1e-12)


def test_threshold_decides_box_and_share() -> None:
    a = changed(3, 1, 2, 0.1)
    assert sg.compare(a, flat(), threshold=0.09).box == (1, 3, 2, 4)
    assert sg.compare(a, flat(), threshold=0.11).box is None
    assert sg.compare(a, flat(), threshold=0.11).share_over == 0


def test_masked_pixels_do_not_count() -> None:
    mask = np.zeros((4, 5), bool)
    mask[3, :2] = True
    found = sg.compare(changed(3, 1, 2, 0.5), flat(), mask=mask)
    assert (found.share_over, found.pixels, found.where) == (0.5, 2, (1, 3))
    assert found.rmse == pytest.approx(0.5 / np.sqrt(8))
    mask[3, 1] = False
    assert sg.compare(changed(3, 1, 2, np.nan), flat(), mask=mask).maximum == 0


def test_limits_hold_for_less_as_for_more() -> None:
    bias = Tolerance.only(bias=0.01)
    for value in (0.23, 0.27):
        assert not judge(flat(value), flat(), bias).same
    assert judge(flat(0.245), flat(), bias).same


def test_limits_of_xrays_are_shares_of_their_largest_sum() -> None:
    right = flat(50.0, blend="xray")
    for limit in (0.02, Tolerance.only(rmse=0.02), Tolerance.only(bias=0.02)):
        assert judge(flat(50.9), right, limit).same
        assert not judge(flat(51.1), right, limit).same


@pytest.mark.parametrize("bad", [-1, float("nan"), "0.1"])
def test_limits_are_numbers_from_zero(bad: float) -> None:
    with pytest.raises(sg.InputError, match=r"tolerance: maximum: expected a number from 0, got"):
        Tolerance.of(bad)


@pytest.mark.filterwarnings("error")
def test_the_largest_floats_are_measured_too() -> None:
    """Their difference is beyond float32: infinite, and said so without a warning."""
    found = judge(flat(3e38), flat(-3e38))
    assert (found.comparison.maximum, found.comparison.psnr) == (np.inf, -np.inf)
    assert "changed in no way that has a name" in str(found)


def test_bands_add_up(rng: np.random.Generator) -> None:
    """Heights that are no multiple of a band: the same numbers as at one go."""
    a, b = rng.random((53, 7, 4)).astype(np.float32), rng.random((53, 7, 4)).astype(np.float32)
    found = sg.compare(sg.Image(a), sg.Image(b))
    d = a.astype(np.float64) - b
    assert found.rmse == pytest.approx(np.sqrt(np.mean(d * d)), rel=1e-7)
    assert found.maximum == pytest.approx(np.abs(d).max(), rel=1e-6)
    assert found.sum_error == pytest.approx(d.sum() / b.sum(), rel=1e-5)
    assert abs(found.bias) == pytest.approx(np.abs(d.mean(axis=(0, 1))).max(), rel=1e-5)
    assert found.share_over == np.mean(np.abs(d).max(axis=-1) > 1 / 255)

"""Comparison of two pictures: each number against one worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

import splatgl as sg


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

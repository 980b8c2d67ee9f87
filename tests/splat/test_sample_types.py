"""The same values in any type of samples: equal transfer functions, views and pictures."""

from __future__ import annotations

import numpy as np
import pytest

import splatgl as sg
from splatgl.planning.culling import OpaqueBounds
from splatgl.transfer.presets import PRESETS, preset, slice_colors
from splatgl.transfer.statistics import statistics

TYPES = ("uint8", ">i2", "int64", "float16", ">f4", "float64")


def tissue() -> np.ndarray:
    """A ball in noise, of whole numbers from 0 to 120, [24, 24, 24]."""
    z, y, x = np.mgrid[:24, :24, :24] - 11.5
    noise = np.random.default_rng(3).normal(8, 3, x.shape)
    return np.asarray(np.clip(90 * (x**2 + y**2 + z**2 < 64) + 20 * (x**2 + y**2 < 9) + noise, 0, 120).round())


@pytest.mark.parametrize("kind", TYPES[1:])
def test_looks_and_pictures_do_not_depend_on_the_type(kind: str) -> None:
    bytes_, others = (sg.Volume(tissue().astype(each)) for each in (TYPES[0], kind))
    for name in PRESETS:
        assert preset(name, others) == preset(name, bytes_)
    default = sg.default_transfer(bytes_)
    assert sg.default_transfer(others) == default and slice_colors(others, default) == slice_colors(bytes_, default)
    for blend in ("composite", "mip"):
        pictures = [sg.render(volume, size=(24, 24), blend=blend).pixels for volume in (bytes_, others)]
        assert np.array_equal(*pictures)


@pytest.mark.parametrize("kind", TYPES[1:])
def test_samples_at_the_end_of_an_opacity_ramp_are_as_transparent_in_any_type(kind: str) -> None:
    samples = np.where(np.arange(12) % 5 == 2, 20, 10) * np.ones((6, 8, 1))
    ramp = sg.Transfer([(10.0, 0.0), (20.0, 0.9)])
    low, high = OpaqueBounds(sg.Volume(samples.astype(kind)), ramp).corners[[0, -1]]
    assert (low[0], high[0]) == (1.5, 7.5)
    # a float32 just above a value of the surface, which is rounded to it
    near = np.float32(0.1) * np.where(np.arange(12) > 5, 1, -1) * np.ones((6, 8, 1), np.float32)
    surface = sg.Transfer([(0.0, 0.0)], iso="0.1")
    ends = [OpaqueBounds(sg.Volume(near.astype(each)), surface).corners for each in ("float32", "float64")]
    assert np.array_equal(*ends)
    assert ends[0][0, 0] == 4.5


def test_values_far_from_zero_keep_their_look() -> None:
    near, far = (statistics(sg.Volume(tissue() + offset)) for offset in (0.0, 1e6))
    assert far.values - 1e6 == pytest.approx(near.values)
    pictures = [sg.render(tissue() + offset, size=(24, 24)).pixels for offset in (0.0, 1e6)]
    assert np.abs(pictures[0] - pictures[1]).max() < 1e-5

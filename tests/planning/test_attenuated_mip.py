"""Attenuated maximum: closed forms, a marcher that shares no code, and what its errors are bounded by."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.distributed.render import join_samples
from splatgl.reference.blend import join_attenuated
from splatgl.reference.field import field_integral
from splatgl.splat.settings import Technique
from tests.helpers.marcher import march

# opacity is the share of the window
LINEAR = sg.Transfer([(0, 0), (1, 1)])
BLEND = sg.Settings(blend="attenuated-mip", tolerance=1e-6, antialias="off")
# from zero at the first voxel, by so much a voxel
RISE, LENGTH = 0.02, 44


def along_x(profile: np.ndarray, **placed: Any) -> sg.Volume:
    return sg.Volume(np.broadcast_to(profile, (8, 8, len(profile))).copy(), **placed)


def view(volume: sg.Volume, side: int = 1) -> sg.Camera:
    """A parallel view along x, or with side -1 against it, of the middle of the volume."""
    middle = volume.center
    return sg.Camera.orthographic(middle - np.array([side * 100, 0, 0]), middle, (0, 0, 1), 0.5, (4, 4))


def drawn(
    volume: sg.Volume, camera: sg.Camera, settings: sg.Settings, renderer: sg.Renderer | None = None
) -> np.ndarray:
    """Alpha of a picture, or of the float64 reference."""
    splats = sg.extract(volume, LINEAR, classification="post-all")
    if renderer is None:
        return sg.reference.render(splats, camera, settings).pixels[..., 3]
    return renderer.render(splats, camera, settings, verify_bound=False).pixels[..., 3]


@pytest.mark.few(1)
@pytest.mark.parametrize("technique", ["tiles", "quads"])
def test_rising_values_are_largest_where_attenuation_takes_as_much_as_they_rise(
    renderer: sg.Renderer, technique: Technique
) -> None:
    """u = g t: g t exp(-a g t^2 / 2) is largest at t = (a g)^-1/2. However many sheets, parts and voxels sample it."""
    strength = 0.1
    right = np.sqrt(RISE / strength) * np.exp(-0.5)
    volume = along_x(RISE * np.arange(LENGTH))
    for changes in ({}, {"sheets": 2, "steps": 1}, {"sheets": 4, "steps": 8}):
        settings = BLEND.replace(mip_attenuation=strength, technique=technique, **changes)
        assert np.abs(drawn(volume, view(volume), settings) - right).max() < 4e-4
        # shaders of many parts take long to compile
        if settings.steps != 8:
            assert np.abs(drawn(volume, view(volume), settings, renderer) - right).max() < 4e-4
    # twice as fine, the same length
    fine = along_x(RISE / 2 * np.arange(2 * LENGTH), spacing=(0.5, 0.5, 0.5))
    settings = BLEND.replace(mip_attenuation=strength / 2, technique=technique)
    assert np.abs(drawn(fine, view(fine), settings, renderer) - right).max() < 4e-4


def test_strengths_count_per_reference_length() -> None:
    """Twice the reference length at twice the strength is the same picture; a strength of 0 is that of mip."""
    volume = along_x(RISE * np.arange(LENGTH))
    splats = sg.extract(volume, LINEAR, classification="post-all")
    double = sg.extract(volume, sg.Transfer([(0, 0), (1, 1)], unit=2.0), classification="post-all")
    one, two, none, mip = (
        sg.reference.render(some, view(volume), BLEND.replace(**changes)).pixels[..., 3]
        for some, changes in (
            (splats, {"mip_attenuation": 0.1}),
            (double, {"mip_attenuation": 0.2}),
            (splats, {"mip_attenuation": 0.0}),
            (splats, {"blend": "mip"}),
        )
    )
    assert np.abs(one - two).max() < 1e-12 and np.abs(none - mip).max() < 1e-12 and (one < 0.5 * none).all()


def test_a_slab_is_attenuated_by_the_one_before_it() -> None:
    """0.4 over 16 voxels, then 0.9: the larger of 0.4 and 0.9 exp(-a 0.4 16); from behind, 0.9."""
    volume, near, far = along_x(np.repeat([0.4, 0.9], 16)), 0.4, 0.9

    def field(places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.where(places[0] < 15.5, near, far), np.zeros((places.shape[1], 3))

    for strength, right in ((0.02, far * np.exp(-0.02 * near * 16)), (0.2, near)):
        settings = BLEND.replace(mip_attenuation=strength)
        exact = field_integral(volume, LINEAR, view(volume), field, 16, blend=settings).pixels[..., 3]
        assert np.abs(exact - right).max() < 1e-4
        # kernels turn the step into a slope of two voxels
        found = drawn(volume, view(volume), settings)
        assert np.abs(found - right).max() < strength * far
        behind = field_integral(volume, LINEAR, view(volume, -1), field, 16, blend=settings).pixels[..., 3]
        assert np.abs(behind - far).max() < 1e-12
        assert np.abs(drawn(volume, view(volume, -1), settings) - far).max() < 1e-3


def test_pictures_are_those_of_a_marcher(renderer: sg.Renderer) -> None:
    """Of noise, from an angle: sheets miss little of a maximum, as those of mip."""
    cells = np.random.default_rng(2).random((12, 12, 12))
    for axis in (0, 1, 2, 0, 1, 2):
        cells = (np.roll(cells, 1, axis) + 2 * cells + np.roll(cells, -1, axis)) / 4
    volume = sg.Volume((cells - cells.min()) / np.ptp(cells), spacing=(1.0, 1.2, 1.5))
    transfer = sg.Transfer([(0.0, 0.1), (1.0, 0.9)], "hot", window=(0.2, 0.9))
    splats = sg.extract(volume, transfer, classification="post-all")
    camera = sg.Camera.orbit(volume, 30, 20, size=(20, 16))
    for strength in (0.05, 0.4):
        settings = BLEND.replace(mip_attenuation=strength)
        right = march(splats, camera, "attenuated-mip", strength=strength)
        found = renderer.render(splats, camera, settings, verify_bound=False).pixels
        off = np.abs(found - right)[..., 3]
        assert right[..., 3].max() > 0.7 and off.max() < 0.015 and np.sqrt((off**2).mean()) < 0.0025
        assert np.abs(march(splats, camera, "mip") - right).max() > 0.05


def rays(rng: np.random.Generator, count: int = 200, parts: int = 40) -> np.ndarray:
    """Shares [parts, 3, count] at begin, middle and end of parts of smooth rays."""
    knots = rng.random((parts // 4 + 1, count))
    at = np.linspace(0, len(knots) - 1, 2 * parts + 1)
    low = np.minimum(at.astype(int), len(knots) - 2)
    smooth = knots[low] + (knots[low + 1] - knots[low]) * (at - low)[:, None]
    return np.stack([smooth[:-2:2], smooth[1::2], smooth[2::2]], axis=1)


def joined(shares: np.ndarray, depth: float) -> np.ndarray:
    light = np.zeros((shares.shape[2], 4))
    for part in shares:
        light = join_attenuated(light, part, np.ones(shares.shape[2]), np.full(shares.shape[2], depth))
    return light


def test_errors_of_values_grow_by_the_depth_of_the_ray_at_most(rng: np.random.Generator) -> None:
    """Shares that are off by e change the maximum by e (1 + a D) at most, D the ray's length, as the guide states."""
    shares = rays(rng)
    for depth, error in ((0.01, 0.02), (0.1, 0.005)):
        # the worst is all of one sign
        for off in (error, -error, rng.uniform(-error, error, shares.shape)):
            apart = np.abs(joined(np.clip(shares + off, 0, 1), depth) - joined(shares, depth))[:, 0].max()
            assert apart <= error * (1 + depth * len(shares)) * (1 + 1e-9) and apart > 0


def test_samples_miss_no_more_than_the_slope_between_them(rng: np.random.Generator) -> None:
    """Of parts of length h: h/4 (G + a) at most, G the largest slope of the shares, as the guide states."""
    coarse, depth = rays(rng), 0.2
    # the same rays, which are linear in halves, by eighths
    share = (np.arange(8) / 8)[:, None, None, None] + np.array([0, 1 / 16, 1 / 8])[None, :, None, None]
    first, middle, last = (coarse[None, None, :, n] for n in range(3))
    fine = np.where(share < 0.5, first + (middle - first) * 2 * share, middle + (last - middle) * (2 * share - 1))
    fine = np.moveaxis(fine, 2, 0).reshape(-1, 3, coarse.shape[2])
    slope = 2 * np.abs(np.diff(coarse, axis=1)).max()
    apart = np.abs(joined(fine, depth / 8) - joined(coarse, depth))[:, 0].max()
    assert 0 < apart <= (slope + depth) / 4


def test_parts_of_a_ray_join_to_the_whole(rng: np.random.Generator) -> None:
    """As workers draw them; parts without values change nothing."""
    shares = rays(rng)
    whole = joined(shares, 0.1)
    some, others = (joined(part, 0.1)[None] for part in (shares[:13], shares[13:]))
    assert np.abs(join_samples("attenuated", some, others)[0] - whole).max() < 1e-12
    for pair in ((some, np.zeros_like(some)), (np.zeros_like(some), some)):
        assert (join_samples("attenuated", *pair) == some).all()


@pytest.mark.parametrize("strength", [-0.1, float("nan"), 1e308, "much"])
def test_strengths_that_are_none(strength: Any) -> None:
    with pytest.raises(sg.InputError, match=r"^mip_attenuation: expected a strength from 0 to 1e\+06, got"):
        sg.Settings(mip_attenuation=strength)


def test_labels_and_voxels_classified_before_have_none() -> None:
    splats = sg.extract(along_x(np.arange(8.0)), sg.Transfer([(0, 0), (7, 1)]), classification="pre")
    with pytest.raises(sg.InputError, match=r"^blend attenuated-mip takes all voxels, classified after"):
        sg.reference.render(splats, sg.Camera.orbit(splats, size=(8, 8)), BLEND)


def test_the_value_that_is_shown_is_picked() -> None:
    """Behind a slab of 0.4, 0.9 is shown while attenuation leaves it the larger one."""
    volume = along_x(np.repeat([0.4, 0.9], 16))
    for strength, right in ((0.0, 0.9), (0.02, 0.9), (0.2, 0.4)):
        found = sg.pick(volume, view(volume), (1, 1), LINEAR, mode="max", attenuation=strength)
        assert found is not None and found.value == pytest.approx(right, abs=0.002)
        assert (found.index[0] > 14.9) == (right == 0.9)

"""The scenes by arithmetic: the paper's numbers, and phantoms with known answers."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import pytest

from splatgl.data import scenes
from splatgl.data.scenes import nerve_model, terrain_model
from splatgl.data.volume import Volume
from splatgl.errors import InputError


@pytest.fixture(scope="module")
def tunnel() -> Volume:
    return scenes.tunnel()


@pytest.fixture(scope="module")
def terrain() -> Volume:
    return terrain_model.terrain()


@pytest.fixture(scope="module")
def nerve() -> Volume:
    return nerve_model.nerve()


def depths(volume: Volume) -> np.ndarray:
    """Depth of every voxel that is drawn, along the hinted view."""
    hints = volume.hints
    assert hints.eye is not None
    assert hints.target is not None
    eye, target = np.array(hints.eye), np.array(hints.target)
    z, y, x = np.nonzero(volume.samples)
    return np.stack([x, y, z], axis=1) @ (target - eye) / np.linalg.norm(target - eye) - eye @ (
        target - eye
    ) / np.linalg.norm(target - eye)


# --- tunnel ---


def test_tunnel_is_the_papers(tunnel: Volume) -> None:
    assert tunnel.samples.shape == (300, 160, 160)
    assert np.count_nonzero(tunnel.samples) == pytest.approx(0.69e6, rel=0.01)
    # z_k of a 256² picture at 60° (221.7) lies in it
    assert depths(tunnel).min() < 221.7 < depths(tunnel).max()


def test_tunnel_is_checked_red_and_white(tunnel: Volume) -> None:
    assert tunnel.color is not None
    wall = tunnel.samples > 0
    shades = tunnel.color[wall]
    (red, white), counts = np.unique(shades, axis=0, return_counts=True)
    assert (tuple(red), tuple(white)) == (scenes.RED, scenes.WHITE) and not tunnel.color[~wall].any()
    assert red[0] > 2 * red[1:].max() and white.min() > 240, "a black line is seen on both"
    assert counts / counts.sum() == pytest.approx(0.5, abs=0.01)
    # the shade turns over every 10 voxels along, and an even number of times around
    along = tunnel.color[:, 80, 2, 0].astype(int)
    assert np.flatnonzero(np.diff(along)).tolist() == list(range(9, 299, 10))
    angle = np.linspace(0, 2 * np.pi, 4000, endpoint=False)
    ring = tunnel.color[
        5, np.rint(79.5 + 77.5 * np.sin(angle)).astype(int), np.rint(79.5 + 77.5 * np.cos(angle)).astype(int), 0
    ]
    crossings = np.count_nonzero(ring != np.roll(ring, 1))
    assert crossings >= 48
    assert crossings % 2 == 0


def test_tunnel_of_other_checks() -> None:
    fine = scenes.tunnel(check=4)
    assert fine.color is not None
    assert np.flatnonzero(np.diff(fine.color[:, 80, 2, 0].astype(int)))[0] == 3
    with pytest.raises(InputError, match="check"):
        scenes.tunnel(check=0)


# --- terrain ---


@pytest.mark.long
def test_terrain_is_the_papers(terrain: Volume) -> None:
    assert terrain.samples.shape == (103, 512, 512)
    assert 0.5e6 < np.count_nonzero(terrain.samples) < 1.0e6
    # about nine tenths lie beyond z_k of a 512² picture at 60°
    assert np.mean(depths(terrain) > 443.4) == pytest.approx(0.9, abs=0.02)


def test_terrain_has_no_holes(terrain: Volume) -> None:
    solid = terrain.samples > 0
    top = 102 - np.argmax(solid[::-1], axis=0)
    bottom = np.argmax(solid, axis=0)
    assert solid.any(axis=0).all()
    # no gap within a column, and each reaches down to its neighbours' surfaces
    assert np.array_equal(top - bottom + 1, solid.sum(axis=0))
    assert (top - bottom + 1).min() >= 2
    for axis in (0, 1):
        first, second = (np.take(bottom, range(s, 511 + s), axis) for s in (0, 1))
        top_first, top_second = (np.take(top, range(s, 511 + s), axis) for s in (0, 1))
        assert (first <= top_second).all()
        assert (second <= top_first).all()


def test_terrain_looks_like_land(terrain: Volume) -> None:
    solid = terrain.samples > 0
    top = 102 - np.argmax(solid[::-1], axis=0)
    assert terrain.color is not None
    y, x = np.indices(top.shape)
    photo = terrain.color[top, y, x].astype(int)
    water = top <= terrain_model.WATER
    assert 0.02 < water.mean() < 0.2
    assert (photo[water][:, 2] > photo[water][:, 0]).mean() > 0.95
    assert photo[top > 90].mean() > photo[(top > 25) & (top < 45)].mean() + 40
    green = (photo[..., 1] > photo[..., 0]) & (photo[..., 1] > photo[..., 2])
    assert green[(top > 25) & (top < 45)].mean() > 0.7


# --- nerve ---


def test_nerve_is_the_papers(nerve: Volume) -> None:
    assert nerve.samples.shape == (76, 512, 512)
    assert nerve.samples.dtype == np.uint8
    assert nerve.spacing == (1.0, 1.0, 1.0)


def test_nerve_is_a_thin_cell_in_the_dark(nerve: Volume) -> None:
    assert nerve.hints.points is not None
    lit = nerve.samples > nerve.hints.points[0][0]
    assert 0.002 < lit.mean() < 0.02
    # the dark noise stays below the ramp; the cell spans the picture
    assert np.percentile(nerve.samples, 90) < nerve.hints.points[0][0]
    z, y, x = np.nonzero(lit)
    assert np.ptp(x) > 400
    assert np.ptp(y) > 400
    assert np.ptp(z) > 30


def test_nerve_hangs_together(nerve: Volume) -> None:
    ndimage = pytest.importorskip("scipy.ndimage")
    lit = nerve.samples > 40
    labels, _ = ndimage.label(lit, np.ones((3, 3, 3)))
    assert np.bincount(labels.ravel())[1:].max() > 0.95 * lit.sum()


# --- phantoms ---


def test_letter_f_differs_from_all_its_mirrors_and_turns() -> None:
    samples = np.pad(scenes.letter_f().samples, [(0, 64 - n) for n in (64, 40, 56)])
    low = [axis.min() for axis in np.nonzero(samples)]
    samples = np.roll(samples, [-n for n in low], (0, 1, 2))
    for axes in itertools.permutations(range(3)):
        for signs in itertools.product((1, -1), repeat=3):
            if axes == (0, 1, 2) and signs == (1, 1, 1):
                continue
            other = samples.transpose(axes)[:: signs[0], :: signs[1], :: signs[2]]
            shift = [axis.min() for axis in np.nonzero(other)]
            assert not np.array_equal(np.roll(other, [-n for n in shift], (0, 1, 2)), samples)


def test_letter_f_axes_are_red_green_blue() -> None:
    volume = scenes.letter_f()
    assert volume.color is not None
    for at, channel in (((2, 2, 40), 0), ((2, 30, 2), 1), ((20, 2, 2), 2)):
        assert volume.samples[at] == 255
        assert np.argmax(volume.color[at]) == channel


def test_constant_and_single_voxel() -> None:
    assert np.array_equal(scenes.constant((2, 3, 4), 5.0).samples, np.full((2, 3, 4), 5.0))
    assert scenes.single_voxel().samples.shape == (1, 1, 1)
    volume = scenes.single_voxel(5)
    assert volume.samples.sum() == volume.samples[2, 2, 2] == 1.0
    assert np.allclose(volume.center, 0.0)
    with pytest.raises(InputError, match="odd"):
        scenes.single_voxel(2)


TURN = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, -1.0]])
SHEAR = np.array([[1.0, 0.3, 0.0], [0.0, 1.0, 0.2], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("direction", [None, TURN, SHEAR])
@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), (0.5, 1.0, 2.0)])
def test_ball_is_the_same_on_every_grid(spacing: tuple[float, float, float], direction: np.ndarray | None) -> None:
    volume = scenes.ball(6.0, spacing, direction)
    z, y, x = np.indices(volume.shape)
    world = np.stack([x, y, z], axis=-1) @ volume.world_from_index.T + np.array(volume.origin)
    r = np.linalg.norm(world, axis=-1)
    assert np.allclose(volume.samples, np.where(r < 6.0, 0.5 * (1 + np.cos(np.pi * r / 6.0)), 0.0))
    # it fits: the outermost samples are 0, and its integral is the closed form's
    for axis in range(3):
        assert np.take(volume.samples, (0, -1), axis).max() == 0.0
    cell = abs(np.linalg.det(volume.world_from_index))
    exact = 2 * np.pi * 6.0**3 * (1 / 3 - 2 / np.pi**2)
    assert volume.samples.sum() * cell == pytest.approx(exact, rel=2e-3)


def test_hard_ball() -> None:
    volume = scenes.ball(10.0, smooth=False)
    assert sorted(np.unique(volume.samples)) == [0.0, 1.0]
    assert volume.samples.sum() == pytest.approx(4 / 3 * np.pi * 1000, rel=0.02)
    with pytest.raises(InputError, match="radius"):
        scenes.ball(0.0)


# --- all of them ---


@pytest.mark.few(1)
@pytest.mark.parametrize("make", [nerve_model.nerve, terrain_model.terrain])
def test_the_same_seed_gives_the_same_scene(make: Callable[..., Volume], request: pytest.FixtureRequest) -> None:
    first = request.getfixturevalue(make.__name__)
    again = make()
    assert np.array_equal(first.samples, again.samples)
    assert make is not nerve_model.nerve or not np.array_equal(first.samples, make(seed=12).samples)


@pytest.mark.parametrize("name", [name for name in scenes.SCENES if name not in scenes.FORMULAS])
def test_every_scene_says_how_to_be_seen(name: str, request: pytest.FixtureRequest) -> None:
    volume = scenes.letter_f() if name == "letter-f" else request.getfixturevalue(name)
    hints = volume.hints
    assert hints.points is not None
    assert hints.fov is not None
    assert (hints.eye is not None and hints.target is not None) or hints.azimuth is not None


# --- formulas ---


@pytest.mark.parametrize("name", scenes.FORMULAS)
def test_formulas_are_what_is_sampled(name: str) -> None:
    """At every voxel, with gradients that are differences of values."""
    formula, volume = scenes.FORMULAS[name], scenes.SCENES[name]()
    z, y, x = (index.ravel() for index in np.indices(volume.shape))
    points = volume.world_from_index @ np.stack([x, y, z]) + np.asarray(volume.origin)[:, None]
    assert volume.name == name and np.abs(points).max() == pytest.approx(1.0)
    assert np.abs(formula(points)[0] - volume.samples.ravel()).max() < 1e-6
    # also on the axis of the rings
    points = np.concatenate([np.zeros((3, 1)), np.random.default_rng(1).uniform(-1, 1, (3, 200))], axis=1)
    steps = 1e-6 * np.eye(3)[..., None]
    slopes = np.stack([formula(points + step)[0] - formula(points - step)[0] for step in steps], axis=1) / 2e-6
    assert np.abs(formula(points)[1] - slopes).max() < 1e-7


def test_grids_of_formulas() -> None:
    assert scenes.marschner_lobb().shape == (40, 40, 40) and scenes.balls().shape == (48, 48, 48)
    coarse = scenes.sinusoids(3)
    assert coarse.shape == (16, 48, 48) and coarse.spacing[2] == pytest.approx(3.13 * coarse.spacing[0], rel=0.01)
    # the test signal's contrast along the rings
    assert float(np.ptp(scenes.marschner_lobb().samples[20, 20])) > 0.15
    for ratio in (0, 25):
        with pytest.raises(InputError, match="ratio"):
            scenes.sinusoids(ratio)

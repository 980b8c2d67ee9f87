"""Tiles without edges take one sample a pixel: within a share of the tolerance, and without flicker."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import splatgl as sg
from splatgl.gl import adaptive_samples, tiles
from splatgl.gl import layers as layers_in_tiles
from splatgl.gl.adaptive_samples import SingleSamples
from splatgl.gl.context import current
from splatgl.gl.target import Portions
from splatgl.planning.culling import PixelWindow
from splatgl.planning.resolve import SPARED_SHARE
from splatgl.planning.technique import COLUMNS
from splatgl.reference.blend import pixel_means

ALL = sg.Settings(antialias="supersample", samples=2)


@pytest.fixture(scope="module")
def ball() -> sg.Splats:
    """A ball with an opaque core in fog."""
    volume = sg.scenes.ball(6)
    return sg.extract(volume, sg.Transfer([(0, 0), (0.3, 0.02), (0.7, 0.02), (0.75, 1), (1, 1)], shading=True))


def tile_errors(single: np.ndarray, k: int) -> np.ndarray:
    """float64 [rows, columns]: for tiles of samples, k along each axis of a pixel, the largest second difference, over
    24, of pixels [H, W, C] in each; pixels at the picture's edge repeat. Twin of `shaders/edges.frag`.
    """
    padded = np.pad(single, ((1, 1), (1, 1), (0, 0)), mode="edge")
    along, across = padded[1:-1], padded[:, 1:-1]
    second = [np.abs(along[:, 2:] + along[:, :-2] - 2 * single), np.abs(across[2:] + across[:-2] - 2 * single)]
    error = np.max(second, axis=(0, 3)) / 24
    height, width = (-(-size // (COLUMNS // k)) for size in error.shape)
    side = COLUMNS // k
    missing = [(0, tiles * side - size) for tiles, size in zip((height, width), error.shape, strict=True)]
    return np.asarray(np.pad(error, missing, mode="edge").reshape(height, side, width, side).max(axis=(1, 3)))


def spared_means(samples: np.ndarray, single: np.ndarray, allowed: float, k: int) -> np.ndarray:
    """float64 [H, W, C]: pixels of samples [H k, W k, C]; in tiles with errors of at most `allowed` of one sample a
    pixel [H, W, C]. Twin of `shaders/resolve.frag`.
    """
    kept = tile_errors(single, k) <= allowed
    height, width = samples.shape[:2]
    kept = np.repeat(np.repeat(kept, COLUMNS, axis=0), COLUMNS, axis=1)[:height, :width]
    between = single
    for axis in (0, 1):
        place = np.clip((np.arange(samples.shape[axis]) + 0.5) / k - 0.5, 0, single.shape[axis] - 1)
        low = np.minimum(place.astype(int), max(single.shape[axis] - 2, 0))
        share = np.expand_dims(place - low, tuple({0, 1, 2} - {axis}))
        high = np.minimum(low + 1, single.shape[axis] - 1)
        between = between.take(low, axis) * (1 - share) + between.take(high, axis) * share
    fine = pixel_means(np.where(kept[..., None], between, samples), k)
    return np.where(kept[::k, ::k, None], pixel_means(single, 1), fine)


def test_kept_pixels_and_their_means(renderer: sg.Renderer, ball: sg.Splats, rng: np.random.Generator) -> None:
    """Of pixels that are smooth on the left, against float64; sides are no multiples of tiles."""
    if renderer.passes.device.card:
        pytest.skip("a card takes all samples")
    plan = renderer.plan(ball, sg.Camera.orbit(ball, size=(37, 22)))
    height, width = 22, 37
    single = (0.2 + rng.random((height, width, 4)) * np.linspace(-0.03, 0.3, width)[:, None].clip(0)).astype(np.float32)
    fine = rng.random((2 * height, 2 * width, 4), np.float32)
    passes = renderer.passes
    with current(renderer.ctx):
        chosen = SingleSamples(passes.device)
        plan = replace(plan, resolved=replace(plan.resolved, allowed=0.005))
        target = chosen.begin(plan)
        target.texture.write(np.ascontiguousarray(single), (0, 0, width, height))
        needed, share = chosen.measure(target, plan, PixelWindow(0, 0, width, height))
        drawn = passes.targets.get("draw", (2 * width, 2 * height), "rgba32f")
        drawn.texture.write(fine, (0, 0, 2 * width, 2 * height))
        passes.single.kept = chosen.kept
        found = passes._resolve(drawn, plan, None, Portions(renderer.ctx)).read()
    assert (needed == (tile_errors(single.astype(float), 2) > 0.005)).all()
    assert 0.2 < share < 0.9 and share == pytest.approx(needed.mean())
    assert np.abs(found - spared_means(fine.astype(float), single.astype(float), 0.005, 2)).max() < 1e-6


def test_differ_little_from_all_samples(renderer: sg.Renderer, ball: sg.Splats) -> None:
    """By less than the tolerance, a fifth of what one sample a pixel is off; a quarter of the pixels take one."""
    camera = sg.Camera.orbit(ball, 30, 20, size=(72, 72))
    found, right = (renderer.render(ball, camera, each, verify_bound=False).pixels for each in (sg.Settings(), ALL))
    one = renderer.render(ball, camera, ALL.replace(samples=1), verify_bound=False).pixels
    tolerance = sg.Settings().tolerance
    assert np.abs(one - right).max() > 5 * tolerance
    assert np.abs(found - right).max() < tolerance
    if not renderer.passes.device.card:
        assert (found == one).all(axis=2)[right[..., 3] > 0].mean() > 0.25
        assert renderer.plan(ball, camera).resolved.allowed == SPARED_SHARE * tolerance


def test_cancelled_pictures_leave_no_trace(
    renderer: sg.Renderer, ball: sg.Splats, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cancelled between any two dispatches of either pass, in several bands; then more bands than there were parts."""
    monkeypatch.setattr(tiles, "ENTRIES", 200)
    monkeypatch.setattr(adaptive_samples, "MOST_PIXELS", 72 * 24)
    camera = sg.Camera.orbit(ball, 30, 20, size=(72, 72))
    asked: list[bool] = []
    right = renderer.render(ball, camera, interrupted=lambda: asked.append(False) or False, verify_bound=False).pixels
    for allowed in range(0, len(asked), len(asked) // 9):
        answers = iter([False] * allowed + [True])
        with pytest.raises(sg.Interrupted):
            renderer.render(ball, camera, interrupted=partial(next, answers), verify_bound=False)
        assert (renderer.render(ball, camera, verify_bound=False).pixels == right).all()


def test_cancelled_pictures_are_no_part_of_others(
    renderer: sg.Renderer, ball: sg.Splats, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a cancelled picture of one sample a pixel, nothing is in one of all samples where that is empty."""
    monkeypatch.setattr(adaptive_samples, "MOST_NEEDED", 1.0)
    near, far = (sg.Camera.orbit(each, 30, 20, size=(72, 72)) for each in (ball, sg.scenes.ball(7)))
    right = renderer.render(ball, near, ALL, verify_bound=False).pixels
    asked: list[bool] = []
    # a first picture may make room, and is asked more often
    renderer.render(ball, far, verify_bound=False)
    renderer.render(ball, far, interrupted=lambda: asked.append(False) or False, verify_bound=False)
    answers = iter([False] * (len(asked) - 1) + [True])
    with pytest.raises(sg.Interrupted):
        renderer.render(ball, far, interrupted=partial(next, answers), verify_bound=False)
    assert (renderer.render(ball, near, ALL, verify_bound=False).pixels == right).all()


def test_layers_spare_samples_as_volumes_do(
    renderer: sg.Renderer, ball: sg.Splats, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By less than the tolerance, a fifth of what one sample a pixel is off; also where matter is drawn in parts."""
    volume = sg.scenes.ball(6)
    look = sg.Transfer([(0, 0), (0.3, 0.02), (0.7, 0.02), (0.75, 1), (1, 1)], shading=True)
    layers = [sg.Layer(replace(volume, origin=(place, 0, 0)), look) for place in (0, 7)]
    scene, camera = sg.Scene(layers), sg.Camera.orbit(ball, 30, 20, size=(72, 72))
    found, right = (renderer.render(scene, camera, each).pixels for each in (sg.Settings(), ALL))
    one = renderer.render(scene, camera, ALL.replace(samples=1)).pixels
    tolerance = sg.Settings().tolerance
    assert np.abs(one - right).max() > 5 * tolerance
    assert np.abs(found - right).max() < tolerance
    if renderer.passes.layers.single is not None:
        assert (found == one).all(axis=2)[right[..., 3] > 0].mean() > 0.25
        monkeypatch.setattr(layers_in_tiles, "ROOM", 1500)
        assert np.array_equal(renderer.render(scene, camera).pixels, found)


def test_no_flicker(renderer: sg.Renderer, ball: sg.Splats) -> None:
    """Small turns: second differences in time are those of all samples, but for half the tolerance."""
    pictures = [
        [
            renderer.render(ball, sg.Camera.orbit(ball, turn, 20, size=(72, 72)), each, verify_bound=False).pixels
            for turn in np.arange(5) * 0.5
        ]
        for each in (sg.Settings(), ALL)
    ]
    jumps = [np.abs(np.diff(turns, 2, axis=0)) for turns in pictures]
    assert (jumps[0] - jumps[1]).max() < 0.5 * sg.Settings().tolerance


@pytest.mark.parametrize("away", [(1, 0), (-1, 0), (0, 1), (0, -1)])
def test_nothing_is_drawn_of_what_lies_beside_the_picture(
    renderer: sg.Renderer, ball: sg.Splats, away: tuple[int, int]
) -> None:
    """On each side; also layers and a mesh, whose windows of pixels are empty as well."""
    volume = sg.scenes.ball(6)
    side = np.ptp(volume.corners, axis=0).max()
    target = volume.corners.mean(axis=0) + 2 * side * np.array([away[0], 0, away[1]])
    camera = sg.Camera.look_at(target - [0, 2 * side, 0], target, (0, 0, 1), fov=20.0, size=(24, 24))
    layer = sg.Layer(volume, sg.Transfer([(0.3, 0), (0.7, 1)]))
    mesh = sg.Mesh(np.eye(3, dtype=np.float32), np.array([[0, 1, 2]]))
    for what in (ball, sg.Scene([layer, layer]), sg.Scene([layer], meshes=[mesh])):
        for blend in ("composite", "mip") if what is ball else ("composite",):
            assert not renderer.render(what, camera, sg.Settings(blend=blend)).pixels.any()

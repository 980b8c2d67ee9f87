"""Drawing order: no pair of cells that share a face is drawn in the wrong order, without a sort."""

from __future__ import annotations

import inspect

import numpy as np
import pytest

import splatgl as sg
from splatgl.planning import culling
from splatgl.planning.culling import OrderKey, back_to_front, order_for
from tests.helpers.splatting import SPLATS


def full_grid(rng: np.random.Generator, share: float = 0.6) -> tuple[np.ndarray, sg.Splats]:
    kept = rng.random(tuple(rng.integers(1, 12, 3))) < share
    matrix = np.eye(3) + rng.uniform(-0.3, 0.3, (3, 3))
    volume = sg.Volume(kept.astype(np.uint8), direction=matrix, origin=rng.uniform(-50, 50, 3))
    return kept, sg.extract(volume, sg.Transfer([(0, 0), (1, 0.5)], shading=False), classification="pre")


def wrong_pairs(kept: np.ndarray, splats: sg.Splats, camera: sg.Camera) -> tuple[int, int]:
    """(wrong, all): of each two cells with a common face, the one on the eye's side must come last."""
    rank = np.full(kept.shape, -1)
    position = splats.positions.astype(int)
    sequence = back_to_front(splats, order_for(splats, camera))
    assert sorted(sequence) == list(range(len(splats)))
    x, y, z = position[sequence].T
    rank[z, y, x] = np.arange(len(splats))
    eye = splats.grid.index_from_world(camera.eye)
    view = np.linalg.solve(splats.grid.world_from_index, camera.forward)
    wrong = pairs = 0
    for axis in range(3):
        first = np.moveaxis(rank, 2 - axis, 0)
        low, high = first[:-1], first[1:]
        both = (low >= 0) & (high >= 0)
        face = np.arange(len(low))[:, None, None] + 0.5
        # the low cell is nearer if the eye is on its side of the face
        side = (eye[axis] - face) if camera.perspective else np.full_like(face, -view[axis])
        wrong += int((both & (np.sign(side) * (high - low) < 0)).sum())
        pairs += int(both.sum())
    return wrong, pairs


@pytest.mark.parametrize("kind", ["outside", "inside", "on a face", "on an edge", "on a corner", "orthographic"])
def test_no_face_pair_is_wrong(kind: str, rng: np.random.Generator) -> None:
    total = 0
    for _ in range(60):
        kept, splats = full_grid(rng)
        if not len(splats):
            continue
        size = np.array(kept.shape[::-1])
        index = rng.uniform(-0.5, size - 0.5) if kind != "outside" else rng.uniform(-2 * size - 3, 3 * size + 3)
        on = {"on a face": 1, "on an edge": 2, "on a corner": 3}.get(kind, 0)
        axes = rng.permutation(3)[:on]
        index[axes] = np.floor(index[axes]) + 0.5
        eye = splats.grid.world_from_index @ index + splats.grid.origin
        target, up = eye + rng.normal(size=3), rng.normal(size=3)
        make = sg.Camera.orthographic if kind == "orthographic" else sg.Camera.look_at
        wrong, pairs = wrong_pairs(kept, splats, make(eye, target, up))
        assert wrong == 0
        total += pairs
    assert total > 5000


def test_the_check_sees_a_wrong_order(rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    """Front to back is found wrong by the same count: the check can fail."""
    kept, splats = full_grid(np.random.default_rng(3), share=1.0)
    camera = sg.Camera.look_at((200, 100, -300), (0, 0, 0), (0, 1, 0))
    monkeypatch.setitem(globals(), "back_to_front", lambda s, c: culling.back_to_front(s, c)[::-1])
    wrong, pairs = wrong_pairs(kept, splats, camera)
    assert wrong == pairs > 0


def test_no_sort_in_the_order() -> None:
    assert "sort" not in inspect.getsource(culling).replace("without a sort", "")


def test_planes_lie_across_the_view() -> None:
    splats = sg.extract(sg.Volume(np.ones((5, 6, 7)), spacing=(1, 3, 1)), sg.Transfer([(0, 0.5)]), classification="pre")
    for axis, eye in enumerate(((90.0, 20, 3), (3, 90, 3), (3, 2, -90))):
        order = order_for(splats, sg.Camera.look_at(eye, (3, 2, 2), (0.1, 0.2, 0.3)))
        assert order.axis == axis
        cells = splats.positions[back_to_front(splats, order)][:, axis]
        assert len(np.flatnonzero(np.diff(cells))) == splats.index_bounds[1, axis]
    # of long voxels those that the view is nearest to the normal of, not those of which it passes the most
    samples = np.ones((3, 4, 5))
    for spacing, axis in (((1.0, 1.0, 5.0), 2), ((5.0, 1.0, 5.0), 2), ((9.0, 1.0, 1.0), 0)):
        splats = sg.extract(sg.Volume(samples, spacing), sg.Transfer([(0, 0.5)]), classification="pre")
        forward = (0.6, 0.0, 0.8) if axis == 2 else (0.8, 0.0, 0.6)
        assert order_for(splats, sg.Camera.look_at((0, 0, 0), forward, (0, 1, 0))).axis == axis


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_every_splat_is_drawn_once(axis: int) -> None:
    splats = sg.extract(sg.Volume(np.ones((5, 6, 7))), sg.Transfer([(0, 0.5)]), classification="pre")
    for cell in ((3, 2, 2), (-1, 6, 5), (7, -1, 0)):
        assert sorted(back_to_front(splats, OrderKey(cell, axis))) == list(range(len(splats)))


def test_front_to_back_is_the_same_picture(renderer: sg.Renderer) -> None:
    rng = np.random.default_rng(7)
    volume = sg.Volume(rng.random((12, 13, 14)).astype(np.float32))
    splats = sg.extract(volume, sg.Transfer([(0, 0), (1, 0.6)], colormap="hot"), classification="pre")
    for eye in ((30.0, 40.0, 25.0), (6.3, 5.9, 7.1)):
        camera = sg.Camera.look_at(eye, (6, 6.5, 0), (0, 1, 0), size=(64, 64))
        back = renderer.render(splats, camera, SPLATS).pixels
        front = renderer.render(splats, camera, SPLATS.replace(order="front-to-back")).pixels
        assert np.abs(back - front).max() < 3e-6
        assert back[..., 3].max() > 0.3


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_mirrored_views_agree(axis: int, renderer: sg.Renderer) -> None:
    """A mirrored volume from the mirrored eye gives the mirrored picture, the eye beyond all three axes."""
    rng = np.random.default_rng(11)
    samples = rng.random((9, 9, 9)).astype(np.float32)
    transfer = sg.Transfer([(0, 0), (1, 0.7)], colormap="viridis", shading=False)
    middle, eye = np.full(3, 4.0), np.array([25.0, -18.0, 30.0])
    flip = np.ones(3)
    flip[axis] = -1
    mirrored = np.flip(samples, 2 - axis)
    pictures = []
    for data, sign in ((samples, np.ones(3)), (mirrored, flip)):
        camera = sg.Camera.look_at(middle + eye * sign, middle, np.array([0.1, 0.9, 0.2]) * sign, 40, (48, 48))
        splats = sg.extract(sg.Volume(np.ascontiguousarray(data)), transfer, classification="pre")
        pictures.append(renderer.render(splats, camera, SPLATS).pixels)
    # a mirror turns the picture's right into its left
    assert np.abs(pictures[0] - pictures[1][:, ::-1]).max() < 1e-5
    assert np.abs(pictures[0] - pictures[1]).max() > 1e-3


def test_mirrored_views_inside_differ_a_little(renderer: sg.Renderer) -> None:
    """With the eye within the range of an axis overlapping splats do not commute: the difference is printed."""
    rng = np.random.default_rng(11)
    samples = rng.random((9, 9, 9)).astype(np.float32)
    transfer = sg.Transfer([(0, 0), (1, 0.7)], colormap="viridis", shading=False)
    pictures = []
    for data, sign in ((samples, 1), (samples[:, :, ::-1], -1)):
        eye = np.array([4 + 1.3 * sign, 4.4, 30.0])
        camera = sg.Camera.look_at(eye, (4, 4, 4), (0, 1, 0), 40, (48, 48))
        splats = sg.extract(sg.Volume(np.ascontiguousarray(data)), transfer, classification="pre")
        pictures.append(renderer.render(splats, camera, SPLATS).pixels)
    worst = float(np.abs(pictures[0] - pictures[1][:, ::-1]).max())
    print(f"largest difference of mirrored views, eye within one axis' range: {worst:.2e}")
    assert 1e-5 < worst < 0.25

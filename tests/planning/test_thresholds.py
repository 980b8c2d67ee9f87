"""Cameras exactly where a decision changes: what float32 and float64 would decide otherwise is decided once."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest

import splatgl as sg
from splatgl.geometry.clipping import clip_splats, index_plane
from splatgl.planning.bricks import Bricks
from splatgl.splat.kernels import kernel
from splatgl.splat.sheets import Sheets
from splatgl.transfer.preintegration import ValueClassifier

CLASSES = sg.Transfer([(0.0, 0.2), (1.0, 0.8)], window=(0, 1), shading=False)
PLAIN = sg.Settings(antialias="off", tolerance=0.005)
# spacings, and turns about z by whose cosine and sine no coordinate is exact
GRIDS = [((1.0, 1.0, 1.0), 0.0), ((0.7, 0.7, 0.7), 0.0), ((0.1, 0.1, 0.1), 0.3), ((1.0, 2.0, 3.0), np.arctan2(3, 4))]


class Way(NamedTuple):
    """How splats are extracted and drawn."""

    classification: str
    compositing: Any
    kernel: str


WAYS = {
    "values": Way("post", "auto", "b-spline"),
    "voxels": Way("pre", "auto", "crawfis-max"),
    "splats": Way("pre", "splats", "crawfis-max"),
}


def grid(spacing: Any, turn: float, samples: np.ndarray) -> sg.Volume:
    """A volume in no even place."""
    cos, sin = np.cos(turn), np.sin(turn)
    direction = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1.0]])
    return sg.Volume(samples.astype(np.float32), spacing=spacing, origin=(0.1, -3.7, 100.3), direction=direction)


def special(rng: np.random.Generator, count: int, way: Way) -> float:
    """A grid index along an axis: whole and half multiples of radius, spacing and sheets from voxels and faces."""
    shape = kernel(way.kernel)
    sheet = Sheets.of(shape, 2, 2 if way.classification == "post" else 0).thickness
    steps = np.concatenate(
        [[0.0, 0.5, 1.0, 2.5], shape.radius * np.array([0.5, 1, 1.5, 2, 3]), sheet * np.arange(1, 5) / 2]
    )
    return float(rng.choice([0.0, -0.5, count - 1.0, count - 0.5]) + rng.choice([-1, 1]) * rng.choice(steps))


def on_threshold(rng: np.random.Generator, volume: sg.Volume, way: Way, parallel: bool = False) -> sg.Camera:
    """An eye in such a place, some ulps off, that looks along an axis, or nearly so."""
    shape = np.array(volume.shape[::-1])
    eye = np.array([special(rng, n, way) if rng.random() < 0.6 else rng.uniform(-1, n) for n in shape])
    axis = int(rng.integers(3))
    eye[axis] = special(rng, shape[axis], way)
    beside = [n for n in range(3) if n != axis and not -1 <= eye[n] <= shape[n]]
    eye[beside] = rng.choice([0.0, -0.5, 1.0, 1.5], len(beside))
    look = np.zeros(3)
    look[axis] = 1.0 if eye[axis] < -0.5 else -1.0 if eye[axis] > shape[axis] - 0.5 else rng.choice([-1, 1])
    look += rng.choice([0.0, 0.0, 1e-7, 1e-4, 0.5]) * rng.normal(size=3)
    steps = volume.world_from_index
    axes = steps / np.linalg.norm(steps, axis=0)
    place = np.asarray(volume.origin) + steps @ eye
    for _ in range(rng.integers(0, 4)):
        place = np.nextafter(place, rng.choice([-1e9, 1e9], 3))
    up = axes[:, (axis + 1) % 3] if rng.random() < 0.7 else rng.normal(size=3)
    size = (int(rng.integers(7, 14)), int(rng.integers(7, 12)))
    if parallel and rng.random() < 0.2:
        return sg.Camera.orthographic(place, place + axes @ look, up, height=6 * max(volume.spacing), size=size)
    return sg.Camera.look_at(place, place + axes @ look, up, fov=float(rng.choice([20, 60, 90, 120])), size=size)


def off_most(renderer: sg.Renderer, name: str, seeds: range, shapes: Any, techniques: Any) -> list[float]:
    """How far pictures on thresholds are off the reference, one a seed."""
    way, found = WAYS[name], []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        samples = rng.random(rng.integers(3, 7, 3)) if seed % 3 else np.full((4, 5, 6), 0.5)
        spacing, turn = shapes[seed % len(shapes)]
        volume = grid(spacing, turn, samples)
        splats = sg.extract(volume, CLASSES, classification=way.classification)
        settings = PLAIN.replace(compositing=way.compositing, technique=techniques[seed % len(techniques)])
        camera = on_threshold(rng, volume, way, parallel=len(shapes) > 3)
        right = sg.reference.render(splats, camera, settings).pixels
        found.append(float(np.abs(renderer.render(splats, camera, settings).pixels - right).max()))
    return found


@pytest.mark.few(1)
@pytest.mark.parametrize("name", ["values", "splats"])
def test_pictures_on_thresholds_are_the_reference(renderer: sg.Renderer, name: str) -> None:
    assert max(off_most(renderer, name, range(3), GRIDS[:3], ["tiles"])) < 3e-3


@pytest.mark.long
@pytest.mark.parametrize("name", list(WAYS))
def test_many_pictures_on_thresholds_are_the_reference(renderer: sg.Renderer, name: str) -> None:
    found = off_most(renderer, name, range(100, 136), GRIDS, ["tiles", "tiles", "quads"])
    assert max(found) < 3e-3, int(np.argmax(found)) + 100


@pytest.mark.parametrize("name", ["values", "splats"])
def test_the_nearest_plane_two_radii_before_the_eye_is_drawn(renderer: sg.Renderer, name: str) -> None:
    """There half lines begin: float64 and float32 need not say the same of that plane, and it is drawn all the same."""
    way = WAYS[name]
    settings = PLAIN.replace(compositing=way.compositing, technique="tiles")
    near = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        volume = grid((0.1 + seed * 0.07,) * 3, 0.1 * seed, np.full((3, 4, 4), 0.5))
        splats = sg.extract(volume, CLASSES, classification=way.classification)
        eye = np.array([1.4, 1.6, -2 * kernel(way.kernel).radius])
        place = np.asarray(volume.origin) + volume.world_from_index @ eye
        for _ in range(seed % 4):
            place = np.nextafter(place, rng.choice([-1e9, 1e9], 3))
        camera = sg.Camera.look_at(place, place + np.array([0, 0, 1]), (0, 1, 0), 40, (5, 4))
        near.append(renderer.plan(splats, camera, settings).program.seen.half_line)
        right = sg.reference.render(splats, camera, settings).pixels
        assert np.abs(renderer.render(splats, camera, settings).pixels - right).max() < 1e-3, seed
    assert any(near) and not all(near)


@pytest.mark.long
@pytest.mark.parametrize(
    ("parallel", "technique"),
    [
        (False, "tiles"),
        (True, "tiles"),
        (True, "quads"),
    ],
)
def test_rays_in_faces_are_kept(renderer: sg.Renderer, parallel: bool, technique: Any) -> None:
    """Of the box, of planes and of masks: columns of pixels that lie exactly in one are as deep as those beside."""
    for turn in (0.0, 0.3):
        volume = grid((0.7, 0.7, 0.7), turn, np.full((6, 6, 7), 0.5))
        inside = np.indices(volume.shape)[2] <= 2
        axes = volume.world_from_index / 0.7
        for x, volumes, cut in (
            (6.5, volume, ()),
            (2.5, volume, (index_plane(volume, 0, -1, 2.5),)),
            (2.5, volume.masked(inside), ()),
        ):
            for off in (0.0, 1e-12, -1e-12):
                place = np.asarray(volume.origin) + volume.world_from_index @ [x + off, 2.3, -6.0]
                view = (place, place + axes[:, 2], axes[:, 1])
                camera = sg.Camera.orthographic(*view, 3, (5, 5)) if parallel else sg.Camera.look_at(*view, 20, (5, 5))
                settings = PLAIN.replace(technique=technique, clip=cut)
                splats = sg.extract(volumes, CLASSES, classification="post")
                found = renderer.render(splats, camera, settings).pixels[..., 3]
                assert np.abs(found - sg.reference.render(splats, camera, settings).pixels[..., 3]).max() < 2e-3
                kept = [column for column in (1, 3) if found[2, column] > 0.5]
                assert len(kept) == 1
                assert found[2, 2] == pytest.approx(found[2, kept[0]], abs=0.02)


def test_an_eye_on_a_plane_sees_no_face_of_it(renderer: sg.Renderer) -> None:
    """Matter there is lit by its own gradient, whichever side of the plane rounding puts the eye on."""
    volume = grid((0.7, 0.7, 0.7), 0.3, np.random.default_rng(2).random((6, 6, 6)))
    splats = sg.extract(volume, sg.Transfer([(0.0, 0.2), (1.0, 0.8)], window=(0, 1)), classification="post")
    eye = np.asarray(volume.origin) + volume.world_from_index @ [2.5, 2.2, 2.7]
    normal = np.array([0.6, 0.0, 0.8])
    camera = sg.Camera.look_at(eye, eye + np.array([0.3, 0.1, 1]), (0.1, 0.9, 0.3), 60, (7, 7))
    pictures = []
    for off in (0.0, 1e-15, -1e-9):
        settings = PLAIN.replace(technique="tiles", clip=((*normal, float(normal @ eye) + off),))
        pictures.append(renderer.render(splats, camera, settings).pixels)
        assert np.abs(pictures[-1] - sg.reference.render(splats, camera, settings).pixels).max() < 2e-3
        assert np.abs(pictures[-1] - pictures[0]).max() < 1e-4


def test_planes_through_voxels_keep_all_of_them() -> None:
    """Of voxels that lie on a plane, none is lost to rounding."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        volume = grid(rng.uniform(0.1, 2, 3), rng.uniform(0, 6), np.ones((5, 6, 7)))
        splats = sg.extract(volume, CLASSES, classification="pre")
        for axis in range(3):
            place = float(rng.integers(1, 4))
            kept = clip_splats(splats, (index_plane(volume, axis, 1, place),))
            assert len(kept) == (splats.positions[:, axis] >= place).sum()


@pytest.mark.long
def test_bricks_and_whole_volumes_on_thresholds_agree(renderer: sg.Renderer) -> None:
    rng, way = np.random.default_rng(5), WAYS["values"]
    for n in range(8):
        volume = grid(*GRIDS[n % len(GRIDS)], rng.random((6, 6, 6)))
        camera = on_threshold(rng, volume, way)
        bricks = Bricks.of(volume, ValueClassifier.of(CLASSES, "b-spline", volume.shape[::-1], every=False), side=3)
        found = renderer.render_bricks(bricks, camera, PLAIN).pixels
        whole = renderer.render(sg.extract(volume, CLASSES, classification="post"), camera, PLAIN).pixels
        assert np.abs(found - whole).max() < 1e-3

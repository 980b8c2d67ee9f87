"""Ends of grids, crops and masks, and beside missing samples: as wide and as bright as the same matter within air."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.geometry import mask_field
from splatgl.planning.bricks import Bricks
from splatgl.transfer.preintegration import ValueClassifier


def faces(kind: str, n: int = 12) -> sg.Volume:
    """A block of n³ voxels of 100: that fills its grid, or within 3 voxels of something else."""
    block = np.full((n, n, n), 100.0, np.float32)
    around = {"air": 0.0, "nan": np.nan, "inf": np.inf, "-inf": -np.inf}
    if kind in around:
        return sg.Volume(np.pad(block, 3, constant_values=around[kind]), origin=(-3, -3, -3))
    if kind == "mask":
        return faces("air", n).masked(faces("air", n).samples > 0)
    if kind == "crop":
        return faces("air", n).part((3, 3, 3), (n + 3,) * 3)
    return sg.Volume(block)


WHITE = sg.Transfer([(0, 0), (49.5, 0), (50.5, 0.99)], colormap="0:#ffffff,1:#ffffff", shading=True)


def block_camera(view: str) -> sg.Camera:
    if view == "front":
        return sg.Camera.orthographic((5.5, -30, 5.5), (5.5, 5.5, 5.5), (0, 0, 1), 18, size=(72, 72))
    return sg.Camera.look_at((30, -18, 22), (5.5, 5.5, 5.5), (0, 0, 1), fov=35, size=(48, 48))


@pytest.mark.few(1)
@pytest.mark.parametrize("kind", ["full", "crop", "mask", "nan", "inf", "-inf"])
def test_blocks_end_alike(renderer: sg.Renderer, kind: str) -> None:
    """As wide as its voxels, and as bright as within air, whatever ends it: it was 2 voxels wider within NaN, and 1.3
    to 1.5 times as bright at ends and within NaN.
    """
    splats = sg.extract(faces(kind), WHITE, classification="post")
    padded = sg.extract(faces("air"), WHITE, classification="post")
    front = renderer.render(splats, block_camera("front")).pixels
    across = front[36, :, 3].sum() * 18 / 72
    assert abs(across - 12) < 0.1
    # head on, a face is as bright as its colour
    assert np.abs(front[24:48, 24:48, 0] / front[24:48, 24:48, 3] - 1).max() < 0.01
    drawn, right = (renderer.render(each, block_camera("oblique")).pixels for each in (splats, padded))
    both = (drawn[..., 3] > 0.98) & (right[..., 3] > 0.98)
    assert both.sum() > 400 and abs(drawn[both][:, 0].mean() / right[both][:, 0].mean() - 1) < 0.02
    assert np.sqrt(((drawn - right)[both] ** 2).mean()) < 0.035


@pytest.mark.parametrize("kind", ["full", "nan", "inf"])
def test_voxels_at_ends_are_lit_as_within_air(kind: str) -> None:
    """Classified before: the same records."""
    found, right = (sg.extract(faces(each), WHITE, classification="pre") for each in (kind, "air"))
    assert len(found) == 12**3
    assert np.array_equal(found.records["normal"], right.records["normal"])


def test_fog_within_missing_samples_is_as_long_as_its_voxels(renderer: sg.Renderer) -> None:
    """Closed form: 1 − (1 − 0.1)^12 through the middle."""
    fog = sg.Transfer([(0, 0.1)], colormap="gray", unit=1.0)
    for kind in ("full", "nan", "-inf"):
        for splats in (sg.extract(faces(kind), fog, classification="post"),):
            alpha = renderer.render(splats, block_camera("front")).pixels[28:44, 28:44, 3]
            assert np.abs(alpha - (1 - 0.9**12)).max() < 2e-3


def test_a_voxel_alone_ends_at_its_corners(renderer: sg.Renderer) -> None:
    """Its one value is seen on all rays through its cube, however little of a kernel they pass near its corners."""
    splats = sg.extract(sg.Volume(np.ones((1, 1, 1), np.float32)), sg.Transfer([(0, 0.9)], unit=1.0))
    along = np.array([0.2, 1.0, 1.0])
    camera = sg.Camera.orthographic(-30 * along, (0, 0, 0), (0, 1, 0.1), 1.8, size=(48, 48))
    found = renderer.render(splats, camera, sg.Settings(blend="mip", antialias="off")).pixels[..., 3]
    across, down = np.meshgrid(*camera.slopes())
    start = camera.eye + across[..., None] * camera.eye_from_world[0] + down[..., None] * camera.eye_from_world[1]
    faces = np.sort((np.array([-0.5, 0.5])[:, None, None, None] - start) / camera.forward, axis=0)
    passed = faces[1].min(axis=-1) - faces[0].max(axis=-1)
    assert (passed > 0.05).sum() > 1000
    assert np.allclose(found[passed > 0.05], 0.9, atol=1e-3) and (found[passed < 0] == 0).all()


@pytest.mark.parametrize("classification", ["post", "pre"])
def test_a_plane_is_lit_across_it(classification: str, rng: np.random.Generator) -> None:
    """Of noise, as bright as its colours when seen from the front: its slopes within the plane do not light it."""
    samples = rng.uniform(60, 100, (1, 24, 24)).astype(np.float32)
    transfer = sg.Transfer([(0, 0), (20, 0), (20.1, 0.99)], colormap="0:#ffffff,1:#ffffff", shading=True)
    splats = sg.extract(sg.Volume(samples), transfer, classification=classification)
    across = splats.records["gradient" if classification == "post" else "normal"].astype(float)
    assert (np.abs(across[:, 2]) > 0.8 * np.linalg.norm(across, axis=1)).mean() > 0.9


@pytest.mark.long
def test_bricks_and_levels_end_alike(renderer: sg.Renderer) -> None:
    """Borders of bricks are no ends, and missing samples end matter in bricks, too."""
    volume = faces("nan")
    whole = renderer.render(sg.extract(volume, WHITE, classification="post"), block_camera("oblique")).pixels
    parts = renderer.render_bricks(in_bricks(volume), block_camera("oblique"))
    assert np.abs(parts.pixels - whole).max() < 1e-3 and parts.info["unmasked"] == 0
    stored = in_bricks(replace(volume, samples=Stored(np.asarray(volume.samples))))
    told = [renderer.render_bricks(stored, block_camera("oblique"), bands=n).info["unmasked"] for n in (1, 2)]
    assert told[0] == told[1] > 0  # type: ignore[operator]


class Stored:
    """Samples that are read in parts."""

    def __init__(self, samples: np.ndarray) -> None:
        self.samples, self.shape, self.dtype, self.ndim = samples, samples.shape, samples.dtype, 3

    def __getitem__(self, index: Any) -> np.ndarray:
        return np.asarray(self.samples[index])


def in_bricks(volume: sg.Volume) -> Bricks:
    return Bricks.of(volume, ValueClassifier.of(WHITE, "b-spline", volume.shape[::-1]), side=7)


def test_missing_samples_that_nothing_masks_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a store in bricks, and of more than a mask can hold: a block's faces are 6 · 12² and more within NaN."""
    volume = faces("nan")
    counts = []
    for samples in (volume.samples, Stored(np.asarray(volume.samples))):
        bricks = in_bricks(replace(volume, samples=samples))
        for brick in range(len(bricks.low)):
            bricks.records(brick)
        counts.append(bricks.whole.missing_samples + sum(bricks.gaps.values()))
    in_memory, found = counts
    assert in_memory == 0 and 6 * 12**2 <= found <= 18**3 - 12**3
    assert sg.extract(volume, WHITE, classification="post").missing_samples == 0
    monkeypatch.setattr(mask_field, "MOST", 100)
    assert sg.extract(volume, WHITE, classification="post").missing_samples == found


def test_gradients_that_weigh_are_of_samples_alone() -> None:
    """Faces of ends would be opaque by their gradients; and values that were extracted lit serve no such function."""
    weighing = sg.Transfer([(0, 0), (50, 0.9)], gradient=((0, 0), (10, 1)))
    splats = sg.extract(faces("full"), weighing, classification="post")
    assert (splats.records["gradient"] == 0).all()
    lit = sg.extract(faces("full"), WHITE, classification="post")
    assert lit.records["gradient"].any() and lit.post.holds(WHITE) and not lit.post.holds(weighing)


@pytest.mark.parametrize("blend", ["mip", pytest.param("minip", marks=pytest.mark.long)])
def test_missing_samples_around_the_eye_have_no_value(
    renderer: sg.Renderer, rng: np.random.Generator, blend: str
) -> None:
    """All others have the same, which is the least and the largest that a ray meets."""
    samples = np.where(rng.random((9, 9, 9)) < 0.3, np.nan, 100.0).astype(np.float32)
    splats = sg.extract(sg.Volume(samples), sg.Transfer([(0, 0), (100, 0.9), (200, 0)]), classification="post-all")
    camera = sg.Camera.look_at((4.3, 4.1, 3.6), (9, 5, 4), (0, 0, 1), fov=80, size=(16, 16))
    found = renderer.render(splats, camera, sg.Settings(blend=blend, antialias="off")).pixels[..., 3]
    assert (found > 0).mean() > 0.9 and np.abs(found[found > 0] - 0.9).max() < 2e-3

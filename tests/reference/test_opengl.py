"""OpenGL's pictures against the float64 reference: the same splats, forms, order and light."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

import splatgl as sg
from splatgl.data.scenes import letter_f
from splatgl.reference.renderer import render
from tests.helpers.splatting import SPLATS

# largest difference allowed: footprint tables and float32
TABLE = 2e-3
SHEAR = np.array([[1.0, 0.35, 0.1], [0.0, 1.0, -0.25], [0.2, 0.0, 1.0]])
GRIDS = {"cubes": ((1, 1, 1), np.eye(3)), "boxes": ((1, 0.7, 2.5), np.eye(3)), "sheared": ((1, 1.2, 1.5), SHEAR)}
# a row of Table 1 and the alignment that draws it
ROWS = {"row4": "ray", "row5": "grid"}


@pytest.fixture(scope="module", params=GRIDS)
def splats(request: pytest.FixtureRequest) -> sg.Splats:
    """A shaded random volume, half of it empty."""
    samples = np.random.default_rng(11).uniform(-1, 1, (9, 12, 11)).clip(0).astype(np.float32)
    spacing, direction = GRIDS[request.param]
    volume = sg.Volume(samples, spacing=spacing, direction=direction, origin=(5, -3, 2))
    transfer = sg.Transfer([(0, 0), (1, 0.7)], colormap="hot", unit=0.8)
    return sg.extract(volume, transfer, classification="pre")


def camera_of(splats: sg.Splats, size: tuple[int, int], parallel: bool) -> sg.Camera:
    camera = sg.Camera.orbit(splats, 35, 25, fov=50, size=size)
    return camera.parallel(splats) if parallel else camera


def difference(splats: sg.Splats, camera: sg.Camera, settings: sg.Settings, row: str, renderer: sg.Renderer) -> float:
    """The largest difference over all channels; in X-rays as a share of the largest Σ τ."""
    drawn, right = renderer.render(splats, camera, settings), render(splats, camera, settings, row)
    assert right.pixels[..., 3].max() > 0.01
    found = sg.compare(drawn, right)
    return found.maximum / found.peak


@pytest.mark.turns(2)
@pytest.mark.few(1)
@pytest.mark.parametrize("row", ROWS)
@pytest.mark.parametrize("blend", ["composite", "xray", "mip"])
def test_every_blend_near_and_far(splats: sg.Splats, row: str, blend: str, renderer: sg.Renderer) -> None:
    """Voxels of many pixels and pixels of many voxels, in perspective and parallel, both attenuations."""
    for size, parallel in product(((40, 30), (6, 5)), (False, True)):
        camera = camera_of(splats, size, parallel)
        for attenuation in ("opacity", "optical-depth") if blend == "composite" else ("auto",):
            asked = SPLATS.replace(blend=blend, align=ROWS[row], attenuation=attenuation)
            assert difference(splats, camera, asked, row, renderer) < TABLE


@pytest.mark.turns(2)
@pytest.mark.few(3)
@pytest.mark.parametrize(
    "asked",
    [
        {"kernel": "gaussian"},
        {"antialias": "off"},
        {"antialias": "supersample", "samples": 3},
        {"shading": "off"},
        {"blend": "mip", "shading": "on"},
        {"background": (0.2, 0.5, 1.0)},
        {"order": "front-to-back"},
    ],
    ids=str,
)
def test_settings(splats: sg.Splats, asked: dict, renderer: sg.Renderer) -> None:
    camera = camera_of(splats, (12, 10), parallel=False)
    assert difference(splats, camera, SPLATS.replace(align="ray", **asked), "row4", renderer) < TABLE


@pytest.mark.few(1)
def test_the_eye_amid_the_splats(splats: sg.Splats, renderer: sg.Renderer) -> None:
    """Around the eye too the same splats count, and none from behind."""
    eye = splats.corners.mean(axis=0)
    camera = sg.Camera.look_at(eye, eye + np.array([0.6, 1.0, 0.2]), (0, 0, 1), 70, (24, 24))
    for row, align in ROWS.items():
        for blend in ("composite", "xray"):
            asked = SPLATS.replace(blend=blend, align=align)
            assert difference(splats, camera, asked, row, renderer) < TABLE


def test_the_reference_tells_rows_apart(renderer: sg.Renderer) -> None:
    """A wide view: each alignment is nearest to its own row, and ray-perpendicular is nearer to the truth."""
    splats = sg.extract(letter_f(), sg.default_transfer(letter_f()), classification="pre")
    corner = splats.corners
    eye = corner.min(axis=0) - 12
    camera = sg.Camera.look_at(eye, corner.mean(axis=0) + np.array([12, -20, 20]), (0, 0, 1), 90, (32, 32))
    asked = {row: SPLATS.replace(align=align, blend="xray") for row, align in ROWS.items()}
    for row, other in (("row4", "row5"), ("row5", "row4")):
        own = difference(splats, camera, asked[row], row, renderer)
        assert own < TABLE
        assert difference(splats, camera, asked[row], other, renderer) > 5 * own
    errors = [difference(splats, camera, each, "row1", renderer) for each in asked.values()]
    assert errors[0] < errors[1]

"""What lies under a pixel: closed forms on every grid, planes, layers, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.reference.depth_pick import depths
from tests.helpers.marcher import Field, Rays
from tests.helpers.noise import GRIDS

FOG = sg.Transfer([(-1e9, 0.05)], unit=1.0)


def ramp(grid: str = "cubes", size: int = 20) -> sg.Volume:
    """Values linear in the indices: exact between samples."""
    z, y, x = np.indices((size, size, size))
    return sg.Volume(100.0 + x + 2 * y + 4 * z, **GRIDS[grid], name="ramp")


@pytest.mark.parametrize("parallel", [False, True])
@pytest.mark.parametrize("grid", list(GRIDS))
def test_half_of_the_light_is_absorbed_there(grid: str, parallel: bool) -> None:
    """In fog, ln 2 over the extinction behind where the ray enters; the point lies on the pixel's ray."""
    volume = ramp(grid, 40)
    camera = sg.Camera.orbit(volume, 30, 20, size=(33, 27))
    camera = camera.parallel(volume) if parallel else camera
    for pixel in ((16, 13), (15, 14), (17, 12)):
        found = sg.pick(volume, camera, pixel, FOG)
        assert found is not None
        eye = camera.eye_from_points(np.array(found.place))
        x, y = camera.slopes()
        seen = eye[:2] / (1.0 if parallel else eye[2])
        assert np.abs(seen - [x[pixel[0]], y[pixel[1]]]).max() < 1e-9
        back = np.array(found.place) - camera.eye
        unit = camera.forward if parallel else back / np.linalg.norm(back)
        # a ray enters its box where an index is −½ or 39½
        inverse = np.linalg.inv(volume.world_from_index)
        speed = inverse @ unit
        index = np.array(found.index)
        enters = np.max((index - np.where(speed > 0, -0.5, 39.5)) / speed * -1)
        assert -enters == pytest.approx(np.log(2) / -np.log(1 - 0.05), abs=0.3)
        assert found.distance == pytest.approx(eye[2] if parallel else float(np.linalg.norm(back)))
        assert found.value == pytest.approx(100 + index @ [1, 2, 4])
        assert np.allclose(volume.world_from_index @ index + volume.origin, found.place)


def test_surfaces_values_and_nothing() -> None:
    """A step is met at its face; the largest value lies in the middle of a ball; beside it is nothing."""
    x, y, z = np.meshgrid(*(np.arange(31.0) - 15,) * 3)
    volume = sg.Volume(300 * np.exp(-(x * x + y * y + z * z) / 60), name="ball")
    camera = sg.Camera.orthographic((15, -60, 15), (15, 15, 15), (0, 0, 1), 31, (31, 31))
    step = sg.Transfer([(150, 0.0), (150, 0.9999)])
    face = sg.pick(volume, camera, (15, 15), step)
    assert face is not None and face.place[1] == pytest.approx(15 - np.sqrt(60 * np.log(2)), abs=0.3)
    top = sg.pick(volume, camera, (15, 15), step, mode="max")
    assert top is not None and np.allclose(top.place, 15, atol=0.2) and top.value == pytest.approx(300, rel=0.01)
    assert sg.pick(volume, camera, (2, 2), step) is None and face.name == "ball"
    beside = sg.Camera.orthographic((115, -60, 15), (115, 15, 15), (0, 0, 1), 31, (31, 31))
    assert sg.pick(volume, beside, (15, 15), step) is None


def test_planes_and_layers() -> None:
    """Rays begin at a cut; of layers, the one that is seen; NaN is nothing."""
    fog, step = sg.Transfer([(-1e9, 0.02)], unit=1.0), sg.Transfer([(0, 0.9999)])
    cells = np.full((20, 20, 20), np.nan)
    cells[8:12, 12:16, 8:12] = 7.0
    inner = sg.Volume(cells, name="inner")
    camera = sg.Camera.orthographic((9.5, -60, 9.5), (9.5, 9.5, 9.5), (0, 0, 1), 10, (11, 11))
    scene = sg.Scene([sg.Layer(ramp(), fog), sg.Layer(inner, step)])
    found = sg.pick(scene, camera, (5, 5))
    assert found is not None and (found.layer, found.name, found.value) == (1, "inner", pytest.approx(7))
    assert found.place[1] == pytest.approx(12.0, abs=1.0)
    cut = sg.Scene([sg.Layer(ramp(), FOG)], clip="y>0.5")
    inside = sg.pick(cut, camera, (5, 5))
    whole = sg.pick(ramp(), camera, (5, 5), FOG)
    assert inside is not None and whole is not None
    # half of what the rest of the volume absorbs, if that is less than half of the light
    rest = 10 * -np.log(1 - 0.05)
    assert inside.place[1] == pytest.approx(9.5 + min(np.log(2), rest / 2) / -np.log(1 - 0.05), abs=0.3)


@pytest.mark.parametrize("pixel", [(-1, 0), (0, 40), (3,), "ab", None, (1, 2, 3)])
def test_pixels_that_are_none(pixel: Any) -> None:
    volume = ramp(size=4)
    camera = sg.Camera.orbit(volume, size=(40, 40))
    with pytest.raises(sg.InputError, match=r"pixel: expected (a column and a row within 40×40|some numbers)"):
        sg.pick(volume, camera, pixel, FOG)
    with pytest.raises(sg.InputError, match="mode: expected first or max"):
        sg.pick(volume, camera, (1, 1), FOG, mode="last")


def thin(seed: int) -> tuple[sg.Volume, sg.Transfer, sg.Camera]:
    """A field with thin matter: a narrow range of its values is opaque, or only the brightest voxels are."""
    rng = np.random.default_rng(seed)
    volume = sg.Volume(rng.random((9, 9, 9)), spacing=tuple(rng.uniform(0.5, 2, 3)), name="thin")
    low = rng.uniform(0.3, 0.9)
    peaks = [(0.985, 0.0), (0.985, 0.999)]
    spike = [(low, 0.0), (low, 0.999), (low + 2e-3, 0.999), (low + 2e-3, 0.0)]
    camera = sg.Camera.orbit(volume, rng.uniform(0, 360), rng.uniform(-60, 60), size=(9, 9))
    return volume, sg.Transfer(peaks if seed % 2 else spike, window=(0, 1), unit=0.05), camera


@pytest.mark.few(2)
@pytest.mark.parametrize("seed", range(6))
def test_no_thin_matter_is_stepped_over(seed: int) -> None:
    """What a ray marched in steps of a hundredth of a voxel meets is picked there, and its depth is told."""
    volume, spike, camera = thin(seed)
    mapped = depths(volume, camera, 0.0, transfer=spike)
    splats = sg.extract(volume, spike, classification="post")
    field, rays = Field(splats), Rays.of(splats, camera)
    down = (rays.toward @ camera.forward).reshape(9, 9)
    for pixel in np.flatnonzero(rays.far > rays.near).tolist():
        row, column = divmod(pixel, 9)
        length = np.linspace(rays.near[pixel], rays.far[pixel], 3000)
        value, _ = field.at(rays.start[:, pixel, None] + rays.step[:, pixel, None] * length)
        seen = np.nan_to_num(spike.opacity(value)) > 0
        found = sg.pick(volume, camera, (column, row), spike)
        if seen.sum() < 4:
            # matter thinner than that step may be met all the same
            continue
        assert found is not None
        eye = camera.eye_from_points(np.array(found.place))[2]
        assert np.abs(length[seen] * down[row, column] - eye).min() < 0.05
        assert mapped[row, column] <= (length[seen] * down[row, column])[0] + 0.02


def test_a_volume_keeps_its_voxels_until_its_samples_change(monkeypatch: pytest.MonkeyPatch) -> None:
    from splatgl.splat.extract import extract

    taken: list[str] = []
    name = "splatgl.planning.resolve.extract"
    monkeypatch.setattr(name, lambda *a, **k: taken.append("voxels") or extract(*a, **k))
    samples = np.arange(1000.0).reshape(10, 10, 10)
    volume = sg.Volume(samples)
    camera = sg.Camera.orbit(volume, size=(8, 8))
    first = sg.pick(volume, camera, (4, 4))
    assert sg.pick(volume, camera, (4, 4)) == first is not None and len(taken) == 1
    assert sg.pick(volume, camera, (4, 4), FOG) != first and len(taken) == 2
    samples[:] = samples[::-1].copy()
    changed = sg.pick(volume, camera, (4, 4), FOG)
    assert changed is not None and changed == sg.pick(sg.Volume(samples), camera, (4, 4), FOG)

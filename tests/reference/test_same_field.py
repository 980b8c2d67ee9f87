"""Random scenes of one opaque thing: picks and depth maps see what the picture covers, where a marcher meets it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.reference.depth_pick import depths
from tests.helpers.marcher import Field, Rays
from tests.helpers.noise import GRIDS

KINDS = ("points", "iso", "region", "weights", "labels", "colors", "mask", "clip", "layers", "mesh", "slice")
ONE_VALUE = ("mip", "minip", "mean", "attenuated-mip")
SIZE = (15, 13)
# pixels of a scene that are picked
PICKS = 20
# points of a ray per voxel in the marcher, and voxels by which depths may be off it
FINE, OFF = 32, 0.05


@dataclass(frozen=True, eq=False)
class Case:
    """A scene of one opaque thing, its picture's settings, and the camera. marched: volume and transfer function of
    which a marcher finds the depths; None for others.
    """

    scene: sg.Scene
    camera: sg.Camera
    settings: sg.Settings
    marched: sg.Splats | None


def thing(rng: np.random.Generator) -> sg.Volume:
    """A noisy ball or block, values from 0 to about 1, on a grid of any kind."""
    z, y, x = np.indices((14, 15, 13)) - np.array([6.5, 7.0, 6.0])[:, None, None, None]
    away = np.sqrt(x * x + y * y + z * z) if rng.random() < 0.6 else np.max(np.abs([x, y * 1.2, z]), axis=0)
    samples = np.clip((rng.uniform(3.5, 5.5) - away) / rng.uniform(0.6, 3) + 0.5, 0, 1) + 0.1 * rng.random(away.shape)
    return sg.Volume(samples, origin=tuple(rng.normal(size=3)), **GRIDS[str(rng.choice(list(GRIDS)))], name="thing")


def camera_of(rng: np.random.Generator, volume: sg.Volume) -> sg.Camera:
    """A view of the whole volume, a parallel one, or one from inside its box."""
    view = sg.Camera.orbit(volume, rng.uniform(0, 360), rng.uniform(-70, 70), size=SIZE)
    kind = rng.random()
    if kind < 0.3:
        return view.parallel(volume)
    if kind < 0.5:
        eye = np.asarray(volume.origin) + volume.world_from_index @ (rng.uniform(0.05, 0.3, 3) * 12)
        return sg.Camera.look_at(tuple(eye), tuple(volume.center), tuple(view.eye_from_world[1]), fov=50, size=SIZE)
    return view


def case_of(kind: str, seed: int) -> Case:
    """The scene of a seed, of a kind of KINDS."""
    rng = np.random.default_rng((seed, KINDS.index(kind)))
    volume = thing(rng)
    camera, unit, settings = camera_of(rng, volume), 1e-3 * min(volume.spacing), sg.Settings(antialias="off")
    look: dict[str, Any] = {"points": [(0.5, 0.0), (0.5, 0.9)], "unit": unit, "shading": False}
    layer: dict[str, Any] = {}
    scene: dict[str, Any] = {}
    middle = volume.center
    if kind == "iso":
        look = {"points": [(0.0, 0.0), (1.0, 0.0)], "iso": [0.5]}
    elif kind == "region":
        look = {"regions": ["box:0.4,0.7,0.02,9:#ffffff:0.9"], "unit": unit, "shading": False}
    elif kind == "weights":
        look["gradient"] = [(0.08, 0.0), (0.12, 1.0)]
    elif kind == "labels":
        labels = (np.asarray(volume.samples) > 0.5).astype(np.uint8)
        volume = replace(volume, samples=labels, labels=(sg.data.volume.Label(1),))
        look = {"points": [(0, 0)], "labels": [(1, "#ff0000", 0.9)], "unit": unit}
    elif kind == "colors":
        volume = replace(volume, color=rng.integers(0, 255, (*volume.shape, 3), np.uint8))
        look["unit"] = 10 * unit
    elif kind == "mask":
        volume = volume.masked(sg.Volume((np.indices(volume.shape)[2] < 6).astype(np.uint8)))
    elif kind == "clip":
        normal = rng.normal(size=3)
        scene["clip"] = [(*normal, float(normal @ middle))]
    elif kind == "layers":
        # one behind a frame's turn, and one that is hidden
        scene["others"] = [
            sg.Layer(replace(volume, samples=np.ones(volume.shape)), sg.Transfer([(0, 1)]), visible=False)
        ]
        layer["clip"] = "x>0.5"
    elif kind == "mesh":
        corners = middle + 0.6 * rng.normal(size=(3, 3)) * np.linalg.norm(camera.eye - middle) / 4
        scene["meshes"] = [sg.Mesh(corners, [[0, 1, 2]])]
        look["points"] = [(2.0, 0.0), (2.0, 0.9)]
    elif kind == "slice":
        scene["slices"] = ["z=7"]
        look["points"] = [(2.0, 0.0), (2.0, 0.9)]
    transfer = sg.Transfer(**look)
    one = sg.Layer(volume, transfer, **layer)
    made = sg.Scene([one, *scene.pop("others", [])], **scene)
    is_marched = kind in ("points", "region", "weights")
    return Case(made, camera, settings, made.splats(settings)[0] if is_marched else None)


def marched_depths(splats: sg.Splats, camera: sg.Camera) -> np.ndarray:
    """Depths [H, W] where half of the light is absorbed, by small steps along the rays of the independent marcher."""
    assert splats.post is not None
    rays, field, transfer = Rays.of(splats, camera), Field(splats), splats.post.transfer
    unit, found = transfer.unit or splats.grid.mean_spacing, np.full(len(rays.near), np.nan)
    for ray in np.flatnonzero(rays.far > rays.near):
        length = rays.far[ray] - rays.near[ray]
        t = np.linspace(rays.near[ray], rays.far[ray], int(length * np.linalg.norm(rays.step[:, ray]) * FINE) + 2)
        middle = (t[1:] + t[:-1]) / 2
        value, gradient = field.at(rays.start[:, ray, None] + rays.step[:, ray, None] * middle)
        size = np.linalg.norm(gradient, axis=1) * (splats.post.span / splats.grid.mean_spacing)
        known = np.isfinite(value)
        opacity = transfer.opacity(np.where(known, value, 0.0)) * transfer.weight(np.where(known, size, 0.0))
        depth = -np.log1p(-np.minimum(opacity, 1 - 2.0**-24)) / unit
        for region in transfer.regions:
            (low, high), (least, most) = region.values, region.gradients
            inside = (value >= low) & (value <= high) & (size >= least) & (size <= most)
            depth = depth - np.log1p(-region.opacity) / unit * inside
        until = np.cumsum(np.where(known, depth, 0.0) * np.diff(t))
        if until[-1] >= np.log(2):
            found[ray] = middle[int(np.searchsorted(until, np.log(2)))] * (rays.toward[ray] @ camera.forward)
    return found.reshape(camera.size[::-1])


def is_amid(covered: np.ndarray) -> np.ndarray:
    """bool [H, W]: pixels around which all eight are covered, or none."""
    padded, (height, width) = np.pad(covered, 1, mode="edge"), covered.shape
    return np.all([padded[y : y + height, x : x + width] == covered for y in range(3) for x in range(3)], axis=0)


def compared(case: Case, renderer: sg.Renderer) -> tuple[int, int]:
    """Numbers of pixels that are covered, and of those at edges that differ. Asserts that picture, depth map, picks and
    marcher agree elsewhere.
    """
    alpha = renderer.render(case.scene, case.camera, case.settings).pixels[..., 3]
    found, covered = depths(case.scene, case.camera, 0.5, case.settings), alpha >= 0.5
    off, amid = np.isfinite(found) != covered, is_amid(covered)
    assert not (off & amid).any()
    if case.marched is not None:
        right = marched_depths(case.marched, case.camera)
        voxel = max(np.linalg.norm(case.marched.grid.world_from_index, axis=0))
        both = np.isfinite(right) & np.isfinite(found)
        assert (both == np.isfinite(found))[amid].all()
        assert (np.abs(found - right)[both] < OFF * voxel).sum() >= 0.97 * both.sum()
    for row, column in np.argwhere(amid)[:: max(amid.sum() // PICKS, 1)].tolist():
        picked = sg.pick(case.scene, case.camera, (column, row), settings=case.settings)
        assert (picked is not None) == (alpha[row, column] > 1e-6)
        if picked is not None and covered[row, column]:
            depth = case.camera.eye_from_points(np.array(picked.place))[2]
            assert depth == pytest.approx(found[row, column], abs=0.2 * max(case.scene.shown[0].volume.spacing))
    return int(covered.sum()), int(off.sum())


@pytest.mark.few(3)
@pytest.mark.parametrize("kind", KINDS)
def test_one_thing(kind: str, renderer: sg.Renderer) -> None:
    """Half of the light is absorbed where the picture is covered."""
    assert compared(case_of(kind, 3), renderer)[0] > 10


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_many_things(kind: str, renderer: sg.Renderer) -> None:
    """The same; at edges a hundredth of the pixels differ."""
    found = np.array([compared(case_of(kind, seed), renderer) for seed in range(12) if seed != 3])
    assert found[:, 0].sum() > 50 and found[:, 1].sum() <= 0.01 * len(found) * SIZE[0] * SIZE[1]


@pytest.mark.parametrize("blend", ONE_VALUE)
def test_blends_of_one_value(blend: Any, renderer: sg.Renderer) -> None:
    """A pixel that shows a value is picked, and has a depth, where the field has it."""
    for seed in range(2):
        rng = np.random.default_rng(seed)
        volume = thing(rng)
        camera, settings = camera_of(rng, volume), sg.Settings(antialias="off", blend=blend)
        transfer = sg.Transfer([(0.0, 0.0), (1.1, 1.0)], unit=1.0, shading=False)
        scene = sg.Scene([sg.Layer(volume, transfer)])
        field = Field(scene.splats(settings)[0])
        alpha = renderer.render(scene, camera, settings).pixels[..., 3]
        found = depths(scene, camera, None, settings)
        across, down = camera.slopes()
        for row, column in [*np.ndindex(*alpha.shape)][seed::6]:
            picked = sg.pick(scene, camera, (column, row), settings=settings)
            assert (picked is not None) == np.isfinite(found[row, column])
            assert picked is not None or alpha[row, column] < 0.02
            if picked is None:
                continue
            far = found[row, column]
            scale = far if camera.perspective else 1.0
            eye = np.array([across[column] * scale, down[row] * scale, far])
            place = np.linalg.inv(volume.world_from_index) @ (
                eye @ camera.eye_from_world + camera.eye - np.asarray(volume.origin)
            )
            values = field.at(np.stack([np.array(picked.index), place], axis=1))[0]
            assert values[0] == pytest.approx(picked.value, abs=0.01)
            if blend != "attenuated-mip":
                assert transfer.opacity(values) == pytest.approx(alpha[row, column], abs=0.03)

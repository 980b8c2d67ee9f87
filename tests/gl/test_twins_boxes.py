"""Boxes of voxels in GLSL, and their float64 twins."""

from __future__ import annotations

import numpy as np
import pytest

import splatgl as sg
from splatgl.geometry.clipping import FACE
from splatgl.gl.features import base_of, box_uniforms
from splatgl.reference.layers import BoxScene
from splatgl.reference.rays import Rays, index_rays
from tests.helpers.boxes import noise as labels_of_noise
from tests.helpers.boxes import splats_of
from tests.helpers.noise import views
from tests.helpers.twins import COUNT, Twin

CUT = ((0.6, 0.0, 0.8, 2.0), (0.0, 1.0, 0.0, -1.0))


def box_ray(rays: Rays, speed: np.ndarray, base: np.ndarray) -> np.ndarray:
    """[N, 12]: a place on each ray, its ends, lengths per depth, its direction, and its face. speed [N]: index units
    per depth.
    """
    assert rays.face is not None
    start = rays.start.T - base + (rays.direction * speed).T
    faced = (rays.entry + FACE) / speed
    return np.column_stack([start, rays.near / speed, rays.toward, rays.stretch * speed, rays.face, faced])


def box_light(scene: BoxScene, rays: Rays, ends: np.ndarray) -> np.ndarray:
    every = np.arange(len(ends))
    return np.stack(scene._shade(every, ends.T, rays), axis=1)


@pytest.mark.parametrize("view", ["fitted", "parallel"])
def test_boxes_of_voxels(view: str, twin: Twin, renderer: sg.Renderer, rng: np.random.Generator) -> None:
    """Rays of any pixel, cut by planes; where they enter and leave voxels; and their light there."""
    splats = splats_of(labels_of_noise(rng, "sheared"))
    settings = sg.Settings(antialias="off", light="glossy", clip=CUT)
    plan = sg.plan(splats, views(splats)[view], settings, tiles=True)
    assert plan.program.boxes and splats.labels is not None
    scene, size = BoxScene(splats, plan.resolved), plan.view.size
    at = rng.integers(0, size, (COUNT, 2)) + 0.5
    slopes = ((at - np.array(size) / 2) * plan.view.pitch).T
    rays = scene.through(slopes)
    # eye-space depth is the shader's
    speed = np.linalg.norm(index_rays(plan.view, slopes)[1], axis=0)
    base, splat = base_of(splats, plan.view.eye_index), rng.integers(0, len(splats), COUNT)
    state = box_uniforms(splats, plan)
    right, hit = box_ray(rays, speed, base), rays.far > rays.near
    assert hit.mean() > 0.3
    for n, what in enumerate(("r.start + r.direction, r.near", "r.toward, r.stretch", "r.face")):
        said = f"BoxRay r = box_ray(a); result = vec4({what})"
        found = twin("boxes.glsl", said, plan, splats, state, a=at)
        assert np.abs(found - right[:, 4 * n : 4 * n + 4])[hit].max() < 1e-4
    ends = (scene.ends(rays, splat, np.arange(COUNT)) / speed).T
    given = {"a": at, "p": splats.positions[splat] - base}
    found = twin("boxes.glsl", "result.xy = box_ends(box_ray(a), p)", plan, splats, state, **given)[:, :2]
    met = ends[:, 1] > ends[:, 0]
    assert np.abs(found - ends)[met].max() < 1e-4 and ((found[:, 1] > found[:, 0]) == met).mean() > 0.999
    entry = rng.uniform(0, 60, COUNT)
    ends = np.stack([entry, entry + rng.uniform(0.1, 1.5, COUNT)], axis=1)
    given = {"a": at, "e": ends}
    found = twin("boxes.glsl", "result.xy = box_light(box_ray(a), e)", plan, splats, state, **given)[:, :2]
    assert np.abs(found - box_light(scene, rays, ends * speed[:, None]))[hit].max() < 1e-3

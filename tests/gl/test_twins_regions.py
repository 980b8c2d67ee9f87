"""Matter in regions of value and gradient in GLSL, and its float64 twin."""

from __future__ import annotations

import numpy as np

import splatgl as sg
from splatgl.gl.textures import CLASS_UNIT, class_uniforms
from tests.helpers.bricks import noise
from tests.helpers.noise import views
from tests.helpers.regions import SOME
from tests.helpers.regions import painting as painting
from tests.helpers.twins import COUNT, Twin


def steepness(slope: np.ndarray, mass: float) -> np.ndarray:
    """Magnitudes of gradients [N], of sums [N, 3] by mass."""
    return np.asarray(np.linalg.norm(slope, axis=1) / mass)


def test_regions_in_the_shader(renderer: sg.Renderer, twin: Twin, rng: np.random.Generator, painting: str) -> None:
    """Lines of any length, in cells of the table, through all shapes."""
    transfer = sg.Transfer(regions=[*SOME, f"image:0.2,0.9,0.01,0.3:{painting}:0.9"])
    splats = sg.extract(sg.Volume(noise(rng, (11, 12, 10))), transfer, classification="post")
    post, spacing = splats.post, splats.grid.mean_spacing
    assert post is not None
    plan = sg.plan(splats, views(splats)["fitted"], sg.Settings(tolerance=1e-6), tiles=True)
    renderer.passes.device.tables.classification(splats).use(CLASS_UNIT)
    first = rng.uniform((-0.2, 0.0), (1.2, 0.8), (COUNT, 2))
    last = first + rng.normal(0, 0.4, (COUNT, 2)) * 10 ** rng.uniform(-3, 0, (COUNT, 1))
    last[:, 1] = np.abs(last[:, 1])
    places = [np.column_stack([post.places(post.value(line[:, 0])), line[:, 1]]) for line in (first, last)]
    state = class_uniforms(post)
    found = twin("sheet_draw.comp", "result = mean_matter(a, b, 1.0)", plan, splats, state, a=places[0], b=places[1])
    right = post.mean_regions(first.T, last.T, spacing)
    off = np.abs(found - right).max(axis=1)
    # lines of a thousandth of the range, through an edge, have few digits
    assert (off < 1e-4).mean() > 0.99 and off.max() < 0.02 * right.max() and (right[:, 3] > 0).mean() > 0.3
    sums = rng.normal(size=(COUNT, 3))
    steep = twin("sheet_draw.comp", "result.x = steepness(s, 2.0)", plan, splats, state, s=sums)[:, 0]
    assert np.abs(steep - steepness(sums, 2.0)).max() < 1e-6

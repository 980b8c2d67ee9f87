"""Sheets in tiles without compute shaders: the same pictures as by compute shaders and by quads."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.gl import sheet_fragments
from splatgl.gl.shader import ShaderError
from splatgl.gl.sheet_fragments import list_by_tile
from splatgl.gl.target import Interrupted
from splatgl.planning.culling import PixelWindow
from splatgl.planning.plan import plan
from tests.helpers.blobs import blob

# differences of float32 sums in another order, and of polynomials instead of the tables of quads
SAME, CLOSE = 2e-5, 1e-3


@pytest.fixture(scope="module", params=["processor", "card"])
def older(request: pytest.FixtureRequest) -> Iterator[sg.Renderer]:
    """A renderer as of OpenGL without compute shaders, in each shape."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("splatgl.gl.device.has_compute", lambda ctx: False)
        with sg.Renderer(shape=request.param) as renderer:
            yield renderer


def subject(**settings: Any) -> tuple[sg.Splats, sg.Camera, sg.Settings]:
    volume = blob(20)
    transfer = sg.Transfer(points=[(5, 0.0), (40, 0.6), (90, 0.9)], colormap="hot", window=(0, 100), shading=True)
    camera = sg.Camera.orbit(volume, azimuth=25, elevation=20, size=(61, 47))
    return sg.extract(volume, transfer), camera, sg.Settings(**settings)


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"antialias": "off"},
        {"blend": "mip"},
        {"blend": "mean"},
        {"blend": "attenuated-mip"},
        {"sheets": 4, "steps": 3},
        {"clip": ((1.0, 0.3, 0.1, 0.0),)},
        {"tolerance": 8 / 255},
    ],
    ids=str,
)
def test_fragments_draw_what_quads_and_float64_draw(older: sg.Renderer, settings: dict[str, Any]) -> None:
    splats, camera, chosen = subject(**settings)
    drawn = older.render(splats, camera, chosen)
    assert drawn.plan.first.program.technique == "tiles"
    by_quads = older.render(splats, camera, chosen.replace(technique="quads")).pixels
    exact = sg.reference.render(splats, camera, chosen).pixels
    assert drawn.pixels.max() > 0.1
    # far less than wrong lists or sheets would change
    for other in (by_quads, exact):
        assert np.abs(drawn.pixels - other).max() <= max(chosen.tolerance / 8, CLOSE / 4)


def test_a_driver_that_rejects_the_text_draws_quads(older: sg.Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    splats, camera, chosen = subject()
    programs = older.passes.device.programs
    compiled = programs.for_screen

    def rejecting(fragment: str, *given: Any) -> Any:
        if fragment == "sheet_draw.frag":
            raise ShaderError("no such extension")
        return compiled(fragment, *given)

    monkeypatch.setattr(programs, "for_screen", rejecting)
    drawn = older.render(splats, camera, chosen).pixels
    right = older.render(splats, camera, chosen.replace(technique="quads")).pixels
    assert drawn.max() > 0.1 and np.abs(drawn - right).max() <= CLOSE / 4


@pytest.mark.compute
def test_fragments_draw_what_compute_shaders_draw(older: sg.Renderer, processor: sg.Renderer) -> None:
    for settings in ({}, {"antialias": "off"}, {"blend": "mip"}):
        splats, camera, chosen = subject(**settings)
        pixels = [renderer.render(splats, camera, chosen).pixels for renderer in (older, processor)]
        assert np.abs(pixels[0] - pixels[1]).max() <= SAME


def test_an_eye_inside_and_a_parallel_view(older: sg.Renderer) -> None:
    splats, camera, chosen = subject()
    inside = sg.Camera.look_at((10.2, 9.7, 9.9), (20, 12, 11), (0, 0, 1), fov=60, size=(40, 40))
    parallel = sg.Camera.orthographic(camera.eye, (10, 10, 10), (0, 0, 1), height=30, size=(40, 40))
    for view in (inside, parallel):
        drawn = older.render(splats, view, chosen)
        exact = sg.reference.render(splats, view, chosen).pixels
        assert drawn.plan.first.program.technique == "tiles" and drawn.pixels.max() > 0.1
        assert np.abs(drawn.pixels - exact).max() <= chosen.tolerance


def test_bands_and_lists_of_parts_of_tiles_change_nothing(older: sg.Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    splats, camera, chosen = subject()
    whole = older.render(splats, camera, chosen).pixels
    monkeypatch.setattr(sheet_fragments, "MOST_PIXELS", 61 * 2 * 16)
    monkeypatch.setattr(sheet_fragments, "MOST_TILES", 20)
    assert np.array_equal(older.render(splats, camera, chosen).pixels, whole)


@pytest.mark.parametrize("limit", ["MOST_PROJECTED", "MOST_LISTED", "MOST_ENTRIES"])
def test_quads_draw_what_is_too_much(older: sg.Renderer, monkeypatch: pytest.MonkeyPatch, limit: str) -> None:
    splats, camera, chosen = subject(antialias="off")
    whole, calls = older.render(splats, camera, chosen).pixels, list[int]()
    draw = older.passes.sheet_quads.draw

    def noted(*args: Any) -> None:
        calls.append(1)
        draw(*args)

    monkeypatch.setattr(older.passes.sheet_quads, "draw", noted)
    for name in {limit, "MOST_LISTED"} if limit == "MOST_ENTRIES" else {limit}:
        monkeypatch.setattr(sheet_fragments, name, 3)
    assert np.abs(older.render(splats, camera, chosen).pixels - whole).max() <= CLOSE
    assert calls


def test_a_cancelled_picture_leaves_the_next_as_it_is(older: sg.Renderer) -> None:
    splats, camera, chosen = subject()
    whole, asked = older.render(splats, camera, chosen).pixels, list[int]()

    def cancelled() -> bool:
        asked.append(1)
        return len(asked) > 3

    with pytest.raises(Interrupted):
        older.render(splats, camera, chosen, interrupted=cancelled)
    assert np.array_equal(older.render(splats, camera, chosen).pixels, whole)


def test_layers_bricks_and_meshes_are_drawn_without_compute_shaders(older: sg.Renderer) -> None:
    volume = blob(16)
    camera = sg.Camera.orbit(volume, azimuth=25, elevation=20, size=(40, 30))
    transfer = sg.Transfer(points=[(5, 0.0), (60, 0.5)], window=(0, 100))
    scene = sg.Scene([sg.Layer(volume, transfer), sg.Layer(replace(volume, name="other"), transfer)])
    assert older.render(scene, camera).pixels.max() > 0.1
    corners = volume.corners
    triangle = sg.Mesh(np.array([corners.min(axis=0), corners.max(axis=0), corners[1]]), np.array([[0, 1, 2]]))
    with_mesh = older.render(sg.Scene([sg.Layer(volume, transfer)], meshes=[triangle]), camera).pixels
    assert np.abs(with_mesh - older.render(sg.Scene([sg.Layer(volume, transfer)]), camera).pixels).max() > 0.05


def test_lists_have_the_splats_whose_boxes_hold_the_centre_of_a_sample() -> None:
    """In the order of the names; samples: of a pixel, along a side."""
    rng = np.random.default_rng(0)
    window = PixelWindow(16, 8, 40, 24)
    for samples in (1, 2):
        bounds = rng.uniform(-20, 90, (60, 4)).astype(np.float32) * samples
        bounds[:, 2:] = rng.uniform(0, 12, (60, 2)) * samples
        names = rng.permutation(60)
        lists = list_by_tile(names, bounds, window, samples)
        assert lists is not None and len(lists.ends) == 5 * 3 + 1
        for tile, (begin, end) in enumerate(lists.ranges.reshape(-1, 2)):
            left, top = 16 + tile % 5 * 8, 8 + tile // 5 * 8
            x, y = ((first * samples + 0.5, (first + 8) * samples - 0.5) for first in (left, top))
            near = (bounds[:, 0] - bounds[:, 3] <= x[1]) & (bounds[:, 0] + bounds[:, 3] >= x[0])
            near &= (bounds[:, 1] - bounds[:, 2] <= y[1]) & (bounds[:, 1] + bounds[:, 2] >= y[0])
            assert lists.names[begin:end].tolist() == names[near].tolist()


def test_a_plan_says_what_a_renderer_draws_in_tiles() -> None:
    splats, camera, _ = subject()
    assert plan(splats, camera, tiles="sheets").program.technique == "tiles"
    assert plan(splats, camera, sg.Settings.like("0.1"), tiles="sheets").program.technique == "quads"
    assert plan(splats, camera, tiles=None).program.technique == "quads"

"""The error bound of a picture holds, and is not idle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import splatgl as sg
from splatgl.splat.bound import bound
from splatgl.truth.stress import CASES, run_case

SIZE = (64, 48)
# the reference is slow: stress pictures of more splats or pixels are left to its own answers
MOST_SPLATS, MOST_PIXELS = 1000, 400
ALL = slice(None)
PIECES = {
    "tunnel": (slice(0, 16), ALL, ALL),
    "terrain": (ALL, slice(180, 260), slice(180, 260)),
    "nerve": (ALL, slice(180, 260), slice(180, 260)),
    "letter_f": (ALL, ALL, ALL),
}
WAYS = {
    "auto": {},
    "loose": {"tolerance": 0.2},
    "quads": {"primitive": "quad"},
    "ray": {"align": "ray"},
    "grid": {"align": "grid"},
    "hybrid": {"align": "hybrid"},
    "half floats": {"target": "rgba16f"},
    "8-bit table": {"align": "ray", "footprint": "table", "table_bits": 8},
    "paper": {"align": "hybrid", "table_bits": 8, "attenuation": "opacity", "target": "rgba8"},
    "gaussian": {"kernel": "gaussian"},
    "xray": {"blend": "xray"},
    "mip": {"blend": "mip"},
    "parallel": {},
}


@pytest.fixture(scope="module")
def scenes() -> dict[str, tuple[sg.Splats, sg.Camera]]:
    """A piece of each, since the reference is slow."""
    made = {}
    for name, piece in PIECES.items():
        volume = getattr(sg.scenes, name)()
        color = None if volume.color is None else volume.color[piece]
        volume = replace(volume, samples=volume.samples[piece], color=color)
        splats = sg.extract(volume, sg.default_transfer(volume))
        made[name] = (splats, sg.Camera.orbit(splats, 20, 30, size=SIZE))
    return made


def measured(renderer: sg.Renderer, splats: sg.Splats, camera: sg.Camera, settings: sg.Settings) -> tuple[float, float]:
    """(error, bound) of one picture."""
    image = renderer.render(splats, camera, settings)
    right = sg.reference.render(splats, camera, settings).pixels
    return float(np.abs(image.pixels - right).max()), float(image.info["error_bound"])


@pytest.mark.parametrize("name", PIECES)
def test_scenes_keep_their_bound_and_it_is_near(
    renderer: sg.Renderer, scenes: dict[str, tuple[sg.Splats, sg.Camera]], name: str
) -> None:
    splats, camera = scenes[name]
    near = []
    ways = WAYS if name == "letter_f" else {way: WAYS[way] for way in ("auto", "grid", "half floats", "mip", "xray")}
    for way, changes in ways.items():
        view = camera.parallel(splats) if way == "parallel" else camera
        error, limit = measured(renderer, splats, view, sg.Settings(**changes))
        print(f"{name} {way}: {error:.3g} of {limit:.3g}")
        assert 0 < error <= limit, way
        near.append(limit <= 20 * max(error, 1e-5))
    assert any(near)


def test_the_bound_follows_what_makes_the_error(renderer: sg.Renderer) -> None:
    """Not one number for all: each part grows with its cause."""
    volume = sg.scenes.letter_f()
    splats = sg.extract(volume, sg.default_transfer(volume))
    camera = sg.Camera.orbit(splats, size=SIZE)

    def parts(**changes: object) -> object:
        return bound(splats, camera, sg.plan(splats, camera, sg.Settings(**changes)), 1.0)

    exact, grid, half, coarse = parts(), parts(align="grid"), parts(target="rgba16f"), parts(table_size=32)
    assert grid.footprint > 20 * exact.footprint
    assert coarse.footprint > 1.2 * exact.footprint
    assert half.rounding > 1000 * exact.rounding and half.footprint == exact.footprint
    assert exact.hidden == 0.0
    assert exact.total == exact.footprint + exact.hidden + exact.rounding
    assert "hidden" in str(exact)


@pytest.mark.parametrize("case", CASES)
def test_stress_pictures_keep_their_bound(renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch, case: str) -> None:
    kept = []
    render = sg.Renderer.render

    def checked(
        self: sg.Renderer, splats: sg.Splats, camera: sg.Camera, settings: sg.Settings | None = None
    ) -> sg.Image:
        image = render(self, splats, camera, settings)
        if 0 < len(splats) <= MOST_SPLATS and camera.size[0] * camera.size[1] <= MOST_PIXELS and len(kept) < 6:
            right = sg.reference.render(splats, camera, settings).pixels
            kept.append((float(np.abs(image.pixels - right).max()), float(image.info["error_bound"])))
        return image

    monkeypatch.setattr(sg.Renderer, "render", checked)
    run_case(CASES[case], renderer)
    for error, limit in kept:
        assert error <= limit


def test_nothing_has_no_error() -> None:
    empty = sg.Splats.from_points(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
    camera = sg.Camera.look_at((0, -5, 0), (0, 0, 0), (0, 0, 1))
    assert bound(empty, camera, sg.plan(empty, camera), 0.0).total == 0.0

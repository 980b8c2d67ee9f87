"""Light from other places than the eye, and highlights: closed forms and the float64 reference."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl import reference
from splatgl.cli.main import main
from splatgl.splat.lighting import LIGHTS, LightModel
from splatgl.splat.settings import choices
from tests.helpers.noise import GRIDS, views

pytestmark = pytest.mark.usefixtures("shared_programs")

PLAIN = sg.Settings(antialias="off", occlusion="off")
CAMERA = sg.Camera.orthographic((20, 20, -60), (20, 20, 4), (0, -1, 0), 4, (4, 4))


def slope(tilt: tuple[float, float]) -> sg.Volume:
    """A field whose gradient, turned by degrees to the right and up from the view along +z, is the same everywhere."""
    a, b = np.radians(tilt)
    normal = np.array([np.sin(a) * np.cos(b), -np.sin(b), -np.cos(a) * np.cos(b)])
    z, y, x = np.indices((9, 41, 41)) - np.array([4, 20, 20])[:, None, None, None]
    return sg.Volume(100 + normal[0] * x + normal[1] * y + normal[2] * z)


@pytest.mark.turns(2)
@pytest.mark.few(6)
@pytest.mark.parametrize("name", list(LIGHTS))
@pytest.mark.parametrize("tilt", [(0.0, 0.0), (30.0, 0.0), (-35.0, 35.0), (-20.0, 15.0), (10.0, -60.0)])
def test_light_on_slopes(name: Any, tilt: tuple[float, float], renderer: sg.Renderer) -> None:
    """By the angles between the normal, the light and the eye; a light behind a surface gives ambient light alone."""
    splats = sg.extract(slope(tilt), sg.Transfer([(0, 0.99)], colormap="#808080"), classification="pre")
    light = LIGHTS[name]
    pixel = renderer.render(splats, CAMERA, PLAIN.replace(light=name)).pixels[2, 2]
    plain = renderer.render(splats, CAMERA, PLAIN.replace(shading="off")).pixels[2, 2]

    def unit(side: float, above: float) -> np.ndarray:
        a, b = np.radians([side, above])
        return np.array([np.sin(a) * np.cos(b), np.sin(b), np.cos(a) * np.cos(b)])

    normal, at, eye = unit(*tilt), unit(light.side, light.above), np.array([0, 0, 1.0])
    half = (at + eye) / np.linalg.norm(at + eye)
    factor = light.ambient + light.diffuse * max(normal @ at, 0)
    highlight = light.specular * max(normal @ half, 0) ** 2**light.sharpness
    assert pixel[3] == pytest.approx(plain[3], abs=1e-5)
    right = plain[0] * factor + highlight * plain[3]
    assert pixel[0] == pytest.approx(right, abs=3e-3)


def cloud(grid: str) -> sg.Volume:
    cells = np.random.default_rng(5).random((14, 14, 14))
    for axis in (0, 1, 2):
        cells = (np.roll(cells, 1, axis) + 2 * cells + np.roll(cells, -1, axis)) / 4
    return sg.Volume((cells - cells.min()) / np.ptp(cells), **GRIDS[grid])


@pytest.mark.few(1)
@pytest.mark.parametrize("technique", ["tiles", "quads"])
@pytest.mark.parametrize("how", [{}, {"classification": "pre"}, {"classification": "pre", "compositing": "splats"}])
def test_lit_pictures_are_the_reference(how: dict[str, Any], technique: Any, renderer: sg.Renderer) -> None:
    """Within the error bound, where one is known."""
    splats = sg.extract(cloud("sheared"), sg.Transfer([(0.3, 0), (0.7, 0.5)], colormap="viridis"))
    for name in ("fitted", "parallel"):
        camera = views(splats)[name]
        settings = PLAIN.replace(light="glossy", technique=technique, **how)
        image = renderer.render(splats, camera, settings)
        off = np.abs(image.pixels - reference.render(splats, camera, settings).pixels)
        plain = renderer.render(splats, camera, settings.replace(light="head")).pixels
        # a normal across the ray may be turned to either side
        assert (off > 2e-3).mean() < 1e-3 and off.max() < 0.03 and np.abs(plain - image.pixels).max() > 0.05
        bound = image.info["error_bound"]
        assert bound is None or (off <= bound).mean() > 0.999


def test_no_light_is_more_than_the_colours() -> None:
    """Shares are 1 together at most: nothing is brighter than white."""
    for light in LIGHTS.values():
        assert light.ambient + light.diffuse + light.specular <= 1 + 1e-12
    assert set(choices()["light"]) == set(LIGHTS)
    assert (
        LIGHTS["head"].plain
        and not LightModel.of("head", (10, 0)).plain
        and LightModel.of("matte", (0, 0)).direction is None
    )


def test_strengths_take_their_share_of_the_light() -> None:
    """Those given stay, the others shrink to what they leave, in proportion; more than all light is refused."""
    head = LightModel.of("head", strengths=(None, None, 0.25))
    assert (head.ambient, head.diffuse, head.specular, head.sharpness) == pytest.approx((0.225, 0.525, 0.25, 5))
    matte = LightModel.of("matte", strengths=(0.1, None, None))
    assert (matte.ambient, matte.diffuse, matte.specular, matte.sharpness) == (0.1, 0.75, 0.0, 0)
    assert LightModel.of("glossy", strengths=sg.Settings().strengths) == LIGHTS["glossy"]
    with pytest.raises(sg.InputError, match=r"^ambient, diffuse and specular: expected a sum of at most 1, got 1.1"):
        LightModel.of("head", strengths=(0.5, 0.6, None))


def test_strengths_light_pictures(renderer: sg.Renderer) -> None:
    """Ambient light alone shows plain colours; pictures are the reference's."""
    splats = sg.extract(cloud("cubes"), sg.Transfer([(0.3, 0), (0.7, 0.5)], shading=True))
    camera = views(splats)["fitted"]
    flat = renderer.render(splats, camera, PLAIN.replace(ambient=1.0)).pixels
    unlit = renderer.render(splats, camera, PLAIN.replace(shading="off")).pixels
    assert np.abs(flat - unlit).max() < 1e-5
    settings = PLAIN.replace(ambient=0.2, specular=0.5)
    found = renderer.render(splats, camera, settings).pixels
    off = np.abs(found - reference.render(splats, camera, settings).pixels)
    assert (off > 2e-3).mean() < 1e-3 and np.abs(found - unlit).max() > 0.05


def test_the_head_light_compiles_no_other(renderer: sg.Renderer) -> None:
    splats = sg.extract(cloud("cubes"), sg.Transfer([(0.3, 0), (0.7, 0.5)]))
    camera = views(splats)["fitted"]
    changes: tuple[dict[str, Any], ...] = ({}, {"light_from": (0, 0)}, {"light": "matte"})
    plans = [renderer.plan(splats, camera, PLAIN.replace(**each)) for each in changes]
    assert plans[0].program == plans[1].program != plans[2].program
    assert plans[0].key == plans[1].key != plans[2].key


@pytest.mark.parametrize("place", [(1,), "left", (1, float("nan")), (0, 500), 3])
def test_places_that_are_none(place: Any) -> None:
    with pytest.raises(sg.InputError, match="light_from: expected degrees"):
        sg.Settings(light_from=place)


@pytest.mark.long
def test_commands_light(tmp_path: Any, capsys: pytest.CaptureFixture[str]) -> None:
    np.save(tmp_path / "a.npy", cloud("cubes").samples.astype(np.float32))
    options = ["--size", "24", "--quiet", "--check", "0", "--points", "0.4:0,0.6:0.8", "-o", str(tmp_path / "o.npy")]
    source = str(tmp_path / "a.npy")
    assert main(["render", source, "--light", "glossy", "--light-from", "-20,60", *options]) == 0
    same = sg.render(source, size=24, points=((0.4, 0), (0.6, 0.8)), light="glossy", light_from=(-20, 60))
    assert (np.load(tmp_path / "o.npy") == same.pixels).all()
    assert main(["render", source, "--light-from", "500,0", *options]) == 2
    assert "--light-from: expected degrees" in capsys.readouterr().err

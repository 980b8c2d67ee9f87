"""Small views of the scenes in every blend mode, held to their baselines by the plugin that comes with the package."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import pytest

import splatgl as sg
from splatgl.comparison.image_regression import ImageRegression
from splatgl.comparison.verdict import Pair
from splatgl.scene.view import ViewOptions
from tests.helpers.splatting import SPLATS

SIZE = (96, 72)
SCENES = ("tunnel", "terrain", "nerve", "letter-f")


@cache
def view_of(scene: str) -> tuple[sg.Splats, sg.Camera]:
    """Splats and camera."""
    volume = getattr(sg.scenes, scene.replace("-", "_"))()
    splats = sg.extract(volume, sg.default_transfer(volume), classification="pre")
    return splats, ViewOptions(size=SIZE).camera(volume, splats)


@pytest.fixture(scope="module")
def osmesa() -> Iterator[sg.Renderer]:
    try:
        renderer = sg.Renderer("osmesa")
    except sg.InputError as error:
        pytest.skip(f"OSMesa is not here: {error}")
    with renderer:
        yield renderer


@pytest.mark.few(1)
@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("blend", ["composite", "xray", "mip"])
def test_scene(scene: str, blend: str, renderer: sg.Renderer, splatgl_image: ImageRegression) -> None:
    splatgl_image(renderer.render(*view_of(scene), SPLATS.replace(blend=blend)), name=f"{scene}-{blend}")


@pytest.mark.parametrize("scene", ["letter-f", *(pytest.param(name, marks=pytest.mark.long) for name in SCENES[:3])])
def test_another_backend_keeps_to_the_same_baseline(
    scene: str, osmesa: sg.Renderer, splatgl_image: ImageRegression
) -> None:
    image = osmesa.render(*view_of(scene), SPLATS)
    assert image.info["backend"] == "osmesa"
    splatgl_image(image, name=f"{scene}-composite")


@pytest.mark.long
@pytest.mark.parametrize("blend", ["composite", "xray", "mip"])
@pytest.mark.parametrize("scene", ["nerve", "letter-f"])
def test_two_backends_draw_the_same(scene: str, blend: str, renderer: sg.Renderer, osmesa: sg.Renderer) -> None:
    first, second = (some.render(*view_of(scene), SPLATS.replace(blend=blend)) for some in (renderer, osmesa))
    verdict = Pair(second, first).judge()
    assert verdict.same, str(verdict)
    assert second.pixels.max() > 0.1, "something is drawn"

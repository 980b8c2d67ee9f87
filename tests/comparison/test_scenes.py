"""Small views of the scenes in every blend mode, held to their baselines by the plugin that comes with the package."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

import splatgl as sg
from splatgl.comparison.image_regression import ImageRegression
from splatgl.comparison.verdict import judge
from splatgl.scene.view import ViewOptions
from tests.helpers.splatting import SPLATS

SIZE = (96, 72)
SCENES = ("tunnel", "terrain", "nerve", "letter-f")


@pytest.fixture(scope="module")
def scenes() -> dict[str, tuple[sg.Splats, sg.Camera]]:
    """Splats and camera of each, made once."""
    made = {}
    for name in SCENES:
        volume = getattr(sg.scenes, name.replace("-", "_"))()
        splats = sg.extract(volume, sg.default_transfer(volume), classification="pre")
        made[name] = (splats, ViewOptions(size=SIZE).camera(volume, splats))
    return made


@pytest.fixture(scope="module")
def osmesa() -> Iterator[sg.Renderer]:
    try:
        renderer = sg.Renderer("osmesa")
    except sg.InputError as error:
        pytest.skip(f"OSMesa is not here: {error}")
    with renderer:
        yield renderer


@pytest.mark.few(1)
@pytest.mark.parametrize("blend", ["composite", "xray", "mip"])
@pytest.mark.parametrize("scene", SCENES)
def test_scene(
    scene: str,
    blend: str,
    scenes: dict[str, tuple[sg.Splats, sg.Camera]],
    renderer: sg.Renderer,
    splatgl_image: ImageRegression,
) -> None:
    splatgl_image(renderer.render(*scenes[scene], SPLATS.but(blend=blend)), name=f"{scene}-{blend}")


@pytest.mark.few(2)
@pytest.mark.parametrize("scene", SCENES)
def test_another_backend_keeps_to_the_same_baseline(
    scene: str,
    scenes: dict[str, tuple[sg.Splats, sg.Camera]],
    osmesa: sg.Renderer,
    splatgl_image: ImageRegression,
) -> None:
    image = osmesa.render(*scenes[scene], SPLATS)
    assert image.info["backend"] == "osmesa"
    splatgl_image(image, name=f"{scene}-composite")


@pytest.mark.long
@pytest.mark.parametrize("blend", ["composite", "xray", "mip"])
@pytest.mark.parametrize("scene", ["nerve", "letter-f"])
def test_two_backends_draw_the_same(
    scene: str,
    blend: str,
    scenes: dict[str, tuple[sg.Splats, sg.Camera]],
    renderer: sg.Renderer,
    osmesa: sg.Renderer,
) -> None:
    first, second = (some.render(*scenes[scene], SPLATS.but(blend=blend)) for some in (renderer, osmesa))
    verdict = judge(second, first)
    assert verdict.same, str(verdict)
    assert second.pixels.max() > 0.1, "something is drawn"

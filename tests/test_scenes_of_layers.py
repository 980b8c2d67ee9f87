"""Several volumes in one picture: closed forms, the float64 reference, and what is refused."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

import splatgl as sg
from splatgl.gl import layer_tiles
from splatgl.truth import reference

FOG = {"a": (0.05, "gray"), "b": (0.12, "viridis")}
PLAIN = sg.Settings(antialias="off", occlusion="off")


def noise(rng: np.random.Generator, shape: tuple[int, int, int]) -> np.ndarray:
    """Smoothed along each axis, from 0 to 1."""
    found: np.ndarray = rng.random(shape)
    for axis in (0, 1, 2, 0, 1, 2):
        found = (np.roll(found, 1, axis) + 2 * found + np.roll(found, -1, axis)) / 4
    return np.asarray((found - found.min()) / np.ptp(found), np.float32)


def block(name: str, shape: tuple[int, int, int], **grid: object) -> sg.Layer:
    """A homogeneous block of fog."""
    opacity, colormap = FOG[name]
    volume = sg.Volume(np.ones(shape, np.float32), name=name, **grid)
    return sg.Layer(volume, sg.Transfer([(0.0, opacity)], colormap=colormap, unit=1.0))


@pytest.fixture(scope="module")
def blocks() -> sg.Scene:
    """Two that overlap, of other spacings: x from −.5 to 19.5, and from 7.15 to 30.95."""
    return sg.Scene([block("a", (20, 20, 20)), block("b", (10, 12, 14), spacing=(1.7, 1.3, 2.1), origin=(8, 5, 4))])


@pytest.fixture(scope="module")
def field(rng: np.random.Generator) -> sg.Scene:
    """Two fields, one on a sheared grid, in each other."""
    direction = np.array([[0.9, 0.1, 0], [-0.2, 1, 0.1], [0, 0.3, 1]])
    return sg.Scene(
        [
            sg.Layer(
                sg.Volume(noise(rng, (22, 24, 26)), name="first"),
                sg.Transfer([(0.4, 0), (0.7, 0.6)], colormap="ivory", shading=True),
            ),
            sg.Layer(
                sg.Volume(noise(rng, (16, 14, 12)), (2, 1.5, 3), (2, 3, -4), direction, name="second"),
                sg.Transfer([(0.5, 0), (0.6, 0.4)], colormap="viridis"),
            ),
        ]
    )


@pytest.fixture(scope="module")
def rng() -> np.random.Generator:
    return np.random.default_rng(5)


def along_x(scene: sg.Scene) -> sg.Camera:
    """A parallel view along +x."""
    return sg.Camera.orthographic((-30.0, 9.5, 9.5), (0.0, 9.5, 9.5), (0, 0, 1), height=8.0, size=(8, 8))


def test_blocks_have_the_extinction_of_both(renderer: sg.Renderer, blocks: sg.Scene) -> None:
    """In the part that they share extinctions add up, and colours mix by them."""
    image = renderer.render(blocks, along_x(blocks), PLAIN)
    sigma = {name: -np.log1p(-opacity) for name, (opacity, _) in FOG.items()}
    colors = {layer.volume.name: layer.seen.color(np.ones(1))[0] for layer in blocks.shown}
    light, ends = np.zeros(4), {"a": (-0.5, 19.5), "b": (8 - 0.85, 8 + 1.7 * 13 + 0.85)}
    for low, high in pairwise(sorted({x for pair in ends.values() for x in pair})):
        inside = [name for name, (first, last) in ends.items() if first <= low and high <= last]
        total = sum(sigma[name] for name in inside)
        color = sum((sigma[name] * colors[name] for name in inside), np.zeros(3)) / total
        light += (1 - light[3]) * -np.expm1(-total * (high - low)) * np.append(color, 1.0)
    assert len(np.unique(np.round(image.pixels, 5).reshape(-1, 4), axis=0)) == 1
    assert np.abs(image.pixels - light).max() < 2e-5
    alone = [renderer.render(layer.volume and sg.Scene([layer]), along_x(blocks), PLAIN) for layer in blocks.shown]
    clear = np.prod([1 - each.pixels[..., 3] for each in alone], axis=0)
    assert np.abs(1 - clear - image.pixels[..., 3]).max() < 2e-6


@pytest.mark.parametrize("parallel", [False, True])
@pytest.mark.parametrize(
    ("changes", "most"),
    [
        ({"antialias": "off", "occlusion": "off"}, 3e-4),
        ({}, 4e-4),
        ({"classification": "pre", "occlusion": "off"}, 1e-3),
        ({"blend": "xray"}, 3e-4),
        ({"blend": "mip", "background": (1.0, 0.5, 0.0)}, 3e-4),
    ],
)
def test_as_in_float64(
    renderer: sg.Renderer, field: sg.Scene, parallel: bool, changes: dict[str, object], most: float
) -> None:
    camera = sg.Camera.orbit(field, 30, 20, 40, (40, 36))
    camera = camera.parallel(field) if parallel else camera
    settings = sg.Settings(**changes)
    image, right = renderer.render(field, camera, settings), reference.render(field, camera, settings)
    assert right.pixels[..., 3].max() > 0.5 and image.info["layers"] == ["first", "second"] == right.info["layers"]
    assert np.abs(image.pixels - right.pixels).max() < most * max(1, right.pixels.max())
    assert image.info["error_bound"] is None and image.info["tolerance_met"] is False


def test_order_of_layers_does_not_matter(renderer: sg.Renderer, field: sg.Scene) -> None:
    """Nor does one that is hidden, or clear."""
    camera = sg.Camera.orbit(field, 30, 20, 40, (40, 36))
    image = renderer.render(field, camera)
    first, second = field.shown
    hidden, clear = sg.Layer(first.volume, visible=False), sg.Layer(first.volume, opacity=0.0)
    other = renderer.render(sg.Scene([second, hidden, clear, first]), camera)
    assert np.abs(image.pixels - other.pixels).max() < 2e-5
    assert np.abs(image.pixels - renderer.render(sg.Scene([first]), camera).pixels).max() > 0.05


def test_one_layer_is_its_volume(renderer: sg.Renderer, field: sg.Scene) -> None:
    layer = field.shown[0]
    camera = sg.Camera.orbit(field, 30, 20, 40, (40, 36))
    alone = renderer.render(sg.extract(layer.volume, layer.seen), camera)
    assert np.array_equal(renderer.render(sg.Scene([layer]), camera).pixels, alone.pixels)


def test_a_volume_twice_is_twice_as_dense(renderer: sg.Renderer, field: sg.Scene) -> None:
    """Half an opacity, as a factor, is not half an extinction."""
    volume = field.shown[1].volume
    thin, dense = (sg.Transfer([(0.5, a), (0.6, a)], colormap="viridis") for a in (0.2, 1 - 0.8**2))
    camera = sg.Camera.orbit(field, -60, 40, 40, (40, 36))
    twice = renderer.render(sg.Scene([sg.Layer(volume, thin)] * 2), camera, PLAIN)
    once = renderer.render(sg.extract(volume, dense), camera, PLAIN)
    assert once.pixels[..., 3].max() > 0.9 and np.abs(twice.pixels - once.pixels).max() < 2e-3
    half = sg.Layer(volume, dense, opacity=0.2 / 0.36)
    assert np.allclose([a for _, a in half.seen.points], 0.2)


def test_matter_beyond_the_room_is_drawn_in_parts(
    renderer: sg.Renderer, field: sg.Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rows, and columns of rows, bit for bit; a tile that is too full for all room is told."""
    camera = sg.Camera.orbit(field, 30, 20, 40, (60, 50))
    image = renderer.render(field, camera, PLAIN)
    for room in (2500, 9000):
        monkeypatch.setattr(layer_tiles, "ROOM", room)
        assert np.array_equal(renderer.render(field, camera, PLAIN).pixels, image.pixels)
    monkeypatch.setattr(layer_tiles, "ROOM", 10)
    with pytest.raises(sg.InputError, match="hold more matter than there is room for"):
        renderer.render(field, camera, PLAIN)
    monkeypatch.undo()
    assert np.array_equal(renderer.render(field, camera, PLAIN).pixels, image.pixels)


def test_what_is_refused(renderer: sg.Renderer, field: sg.Scene, blocks: sg.Scene) -> None:
    camera = sg.Camera.orbit(field, size=(16, 16))
    volume = blocks.shown[0].volume
    for settings, said in (
        (sg.Settings(technique="quads"), "compute shaders"),
        (sg.Settings(compositing="splats"), "layers composite in sheets"),
        (sg.Settings(kernel="gaussian", classification="pre", attenuation="opacity"), "layers composite in sheets"),
    ):
        with pytest.raises(sg.InputError, match=said):
            renderer.render(field, camera, settings)
    with pytest.raises(sg.InputError, match="motion: expected none"):
        renderer.render(field, camera, motion=sg.Motion())
    for layers in ([], [sg.Layer(volume, visible=False)], [volume] * 9):
        with pytest.raises(sg.InputError, match="layers: expected 1 to 8 that are visible"):
            sg.Scene(layers)
    with pytest.raises(sg.InputError, match="opacity: expected a factor from 0 to 1"):
        sg.Layer(volume, opacity=1.5)


def test_a_view_shows_all_layers(blocks: sg.Scene) -> None:
    camera = sg.Camera.orbit(blocks, 20, 30, size=(64, 64))
    x, y, depth = camera.eye_from_points(blocks.corners).T
    reach = np.abs(np.stack([x, y]) / depth).max()
    assert 0.9 < reach / (camera.extent / 2) <= 1 + 1e-9 and np.ptp(blocks.corners[:, 0]) == pytest.approx(31.45)

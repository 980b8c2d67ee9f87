"""The box: edges, ticks and numbers against projected points; annotations of live views, and of any size."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import splatgl as sg
from splatgl.annotations import bounding_box
from splatgl.annotations.annotate import bar_of, compose
from splatgl.annotations.canvas import WHITE, Layer, Subject
from splatgl.annotations.live import LiveOverlay, usual

SHEAR = np.array([[1.0, 0.3, 0.0], [0.0, 0.9, 0.2], [0.0, 0.1, 1.0]])
OBLONG = sg.Volume(np.zeros((20, 30, 40), np.float32), (1, 2, 3), (5, -10, 100), unit="mm", frame="LPS", name="ct")
SHEARED = sg.Volume(np.zeros((20, 30, 40), np.float32), (1, 2, 3), direction=SHEAR, unit="mm")
MIRRORED = sg.Volume(np.zeros((20, 30, 40), np.float32), (1, 2, 3), direction=np.diag([1.0, -1, 1]), unit="mm")
TRANSFER = sg.Transfer([(0, 0), (100, 0.5)], colormap="viridis")
VOLUMES = [OBLONG, SHEARED, MIRRORED]


def cameras(volume: sg.Volume, size: tuple[int, int] = (600, 500)) -> list[sg.Camera]:
    found = [sg.Camera.orbit(volume, *angles, size=size, zoom=0.7) for angles in ((30, 20), (200, -50), (118, 5))]
    return [*found, *(each.parallel(volume) for each in found)]


def at(points: np.ndarray, camera: sg.Camera) -> np.ndarray:
    """Places in pixels, by the definition of a camera."""
    seen = (np.asarray(points) - camera.eye) @ camera.eye_from_world.T
    depth = seen[:, 2] if camera.perspective else np.ones(len(seen))
    return seen[:, :2] / depth[:, None] / camera.extent * camera.size[1] + np.array(camera.size) / 2


@pytest.mark.parametrize("volume", VOLUMES)
def test_edges_are_drawn_where_corners_are(volume: sg.Volume) -> None:
    """Lines pass the middles of pixels along each edge that is not hidden; a fifth of a pixel beside, they are not."""
    for camera in cameras(volume):
        layer = Layer(np.zeros((500, 600, 4), np.float32), WHITE)
        bounding_box.draw_edges(layer, Subject.of(volume), camera)
        light = layer.pixels[..., 0]
        every = bounding_box.edges(volume.corners, camera)
        assert len(every) == 12 and sum(each.hidden for each in every) in (3, 5)
        for edge in every:
            a, b = at(volume.corners[list(edge.corners)], camera)
            share = np.linspace(0.1, 0.9, 41)[:, None]
            x, y = np.floor(a + (b - a) * share).astype(int).T
            if edge.hidden:
                assert (light[y, x] < 0.5).mean() > 0.8
            else:
                assert light[y, x].min() > 0.25


@pytest.mark.parametrize("volume", VOLUMES)
def test_hidden_edges_are_behind_and_outer_ones_on_the_outline(volume: sg.Volume) -> None:
    """A corner is behind the box if the ray to it enters the box before; outer edges have the box on one side."""
    for camera in cameras(volume):
        seen = at(volume.corners, camera)
        for edge in bounding_box.edges(volume.corners, camera):
            a, b = seen[list(edge.corners)]
            across = np.array([a[1] - b[1], b[0] - a[0]])
            sides = (seen - a) @ across
            one_side = sides.min() > -1e-6 * np.abs(sides).max() or sides.max() < 1e-6 * np.abs(sides).max()
            assert edge.outer == one_side
            if edge.outer:
                continue
            # a step from the edge towards the eye is in the box, if the edge is hidden
            middle = volume.corners[list(edge.corners)].mean(axis=0)
            step = (camera.eye - middle) if camera.perspective else -camera.forward
            index = np.linalg.solve(volume.world_from_index, middle + step * 1e-4 - volume.origin)
            inside = (index > -0.5).all() and (index < np.array(volume.shape[::-1]) - 0.5).all()
            assert edge.hidden == inside


@pytest.mark.parametrize("volume", VOLUMES)
def test_ticks_are_where_their_numbers_say(volume: sg.Volume) -> None:
    """World coordinates along world axes, lengths from the first corner along others; drawn at the projected point."""
    for camera in cameras(volume):
        subject, every = Subject.of(volume), bounding_box.edges(volume.corners, camera)
        layer = Layer(np.zeros((500, 600, 4), np.float32), WHITE)
        bounding_box.draw_edges(layer, subject, camera)
        chosen = bounding_box.numbered(every, subject, camera)
        assert [each.axis for each in chosen] == [0, 1, 2]
        for edge in chosen:
            places, texts, name = bounding_box.marks(subject, edge, camera, layer.em)
            numbers = [float(text) for text in texts]
            first, second = volume.corners[list(edge.corners)]
            assert len(numbers) >= 2 and name.endswith(", mm")
            step = numbers[1] - numbers[0]
            assert any(step == pytest.approx(n * 10.0**p) for n in (1, 2, 5) for p in range(-2, 4))
            if name[0] in "xyz":
                assert np.allclose(places[:, "xyz".index(name[0])], numbers)
                # the rest of the way along the edge is nothing
                assert np.allclose(np.cross(places - first, second - first), 0, atol=1e-8)
            else:
                assert np.allclose(np.linalg.norm(places - first, axis=1), numbers)
            out = bounding_box.outwards(edge, subject, camera)
            tips = np.floor(at(places, camera) + out * bounding_box.TICK * layer.em * 0.8).astype(int)
            assert layer.pixels[tips[:, 1], tips[:, 0], 0].min() > 0.25


def test_lines_behind_are_weakened_by_the_picture() -> None:
    """A dash shines through half of opacity with half of its light, and not at all through an opaque picture."""
    camera = sg.Camera.orbit(OBLONG, 30, 20, size=(400, 400), zoom=0.7)
    lights = []
    for alpha in (0.0, 0.5, 1.0):
        pixels = np.zeros((400, 400, 4), np.float32)
        pixels[..., 3] = alpha
        lights.append(sg.annotated(sg.Image(pixels, {}), OBLONG, TRANSFER, camera, ["box"], (0, 0, 0)).pixels[..., 0])
    hidden = next(each for each in bounding_box.edges(OBLONG.corners, camera) if each.hidden)
    a, b = at(OBLONG.corners[list(hidden.corners)], camera)
    x, y = np.floor(a + (b - a) * np.linspace(0.2, 0.8, 99)[:, None]).astype(int).T
    plain, half, none = (light[y, x] for light in lights)
    lone = (none == 0) & (plain > 0.3)
    assert lone.sum() > 20 and half[lone] == pytest.approx(plain[lone] / 2, abs=1e-6)


@pytest.mark.parametrize("size", [(64, 64), (96, 64), (64, 200), (256, 256), (1200, 90), (90, 900), (2048, 2048)])
@pytest.mark.parametrize("shown", [0.0, 1.0])
def test_nothing_overlaps_or_is_cut_off(size: tuple[int, int], shown: float) -> None:
    """Places of text lie within the picture and apart, and all ink but the box in them; what is left out is told."""
    asked = ("scale", "colorbar", "axes", "directions", "box", "title=Head", "time=3 h")
    for volume in VOLUMES[:2]:
        camera = sg.Camera.orbit(volume, 30, 20, size=size, zoom=0.7)
        layer = Layer.over(np.full((size[1], size[0], 4), shown, np.float32), (0, 0, 0))
        subject = Subject.of(volume)
        bar = bar_of(subject, TRANSFER, "composite", round(0.45 * size[1]))
        compose(layer, subject, camera, asked, [] if bar is None else [bar])
        assert not any(a.meets(b) for a, b in itertools.combinations(layer.taken, 2))
        for rect in layer.taken:
            assert rect.left >= 0 and rect.top >= 0 and rect.right <= size[0] and rect.bottom <= size[1]
        assert size[0] > 256 or layer.notes
        # without the box nothing is drawn outside of the places
        layer = Layer(np.zeros((size[1], size[0], 4), np.float32), WHITE)
        compose(layer, subject, camera, [each for each in asked if each != "box"], ())
        for rect in layer.taken:
            layer.clear(rect)
        assert not layer.pixels.any()


def test_text_goes_where_the_picture_is_empty() -> None:
    """An object in the lower right: the scale bar goes elsewhere; steady pictures keep it there."""
    camera = sg.Camera.orbit(OBLONG, 30, 20, size=(400, 400))
    pixels = np.zeros((400, 400, 4), np.float32)
    pixels[300:, 250:] = 0.7
    found = sg.annotated(sg.Image(pixels, {}), OBLONG, TRANSFER, camera, ["scale"], (0, 0, 0)).pixels
    assert (found[300:, 250:] == pixels[300:, 250:]).all() and (found != pixels).any()
    steady = sg.annotated(sg.Image(pixels, {}), OBLONG, TRANSFER, camera, ["scale"], (0, 0, 0), steady=True).pixels
    assert (steady[300:, 250:] != pixels[300:, 250:]).any()


def test_live_overlays_are_what_pictures_have() -> None:
    """To a step of 8 bits; the second use of the buffers leaves nothing of the first."""
    overlay, subject = LiveOverlay(), Subject.of(OBLONG)
    names = ["box", "colorbar", "title=Head", *usual(subject)]
    for angle in (10.0, 50.0, 51.0):
        camera = sg.Camera.orbit(OBLONG, angle, 20, size=(300, 260), zoom=0.6)
        live = overlay.drawn(subject, TRANSFER, camera, names)
        empty = sg.Image(np.zeros((260, 300, 4), np.float32), {"blend": "composite"})
        right = sg.annotated(empty, OBLONG, TRANSFER, camera, names, (0, 0, 0)).pixels
        assert list(overlay.notes) == sg.annotated(empty, OBLONG, TRANSFER, camera, names).info["not_annotated"]
        assert np.abs(live[..., 3] / 255 - right[..., 3]).max() <= 0.5 / 255 + 1e-6
        linear = np.where(live <= 10, live / 3294.6, ((live / 255 + 0.055) / 1.055) ** 2.4)[..., :3]
        assert np.abs(linear * right[..., 3:] - right[..., :3]).max() < 0.006


def test_an_eye_within_the_box_is_told() -> None:
    """No numbers, a note, and edges ahead of the eye alone."""
    center = OBLONG.center
    camera = sg.Camera.look_at(center, center + np.array([0, 1.0, 0]), (0, 0, 1), 120, (200, 200))
    layer = Layer(np.zeros((200, 200, 4), np.float32), WHITE)
    compose(layer, Subject.of(OBLONG), camera, ["box"], ())
    bounding_box.draw_behind(layer, Subject.of(OBLONG), camera)
    assert layer.notes == ["no numbers of the box: the eye is in it"] and layer.pixels.any()
    assert np.isfinite(layer.pixels).all()

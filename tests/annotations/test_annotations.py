"""Annotations: lengths, colours and letters by closed forms and as they are drawn; the box; bad input in one line."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as Pillow

import splatgl as sg
from splatgl.annotations import bars, world_lines
from splatgl.annotations.annotate import (
    ANNOTATIONS,
    LiveOverlay,
    annotated,
    check,
    compose,
    default_names,
    parse_annotations,
)
from splatgl.annotations.bars import length_text, log_ticks, of_values, scale_of, shorten_label, ticks
from splatgl.annotations.canvas import WHITE, AnnotatedSubject, AnnotationView, Canvas, Measure, legend_of
from splatgl.annotations.world_lines import COLORS, LONG, letters, measure_text
from splatgl.cli.main import main
from splatgl.data.affine import Coordinate, make_lattice
from splatgl.data.figure import TextMark
from splatgl.data.volume import AxisCoordinate, halve_volume
from splatgl.errors import InputError
from splatgl.scene.scene_file import SceneFile

pytestmark = pytest.mark.usefixtures("shared_programs")

ALL = ("scale", "colorbar", "axes", "directions", "title=Head", "time=3 h")
VOLUME = sg.Volume(np.zeros((9, 9, 9), np.float32), unit="mm", frame="LPS", name="ct")
TRANSFER = sg.Transfer([(0, 0), (100, 0.5)], colormap="viridis")


@pytest.mark.parametrize("perspective", [True, False])
def test_scale_bar_length(perspective: bool) -> None:
    """Orthographic: 100 mm fill 400 rows. Perspective: 2·50·tan(45°) = 100 mm at the centre's depth, 50."""
    eye, target = (4, -46, 4), (4, 4, 4)
    if perspective:
        camera = sg.Camera.look_at(eye, target, (0, 0, 1), 90.0, (400, 400))
    else:
        camera = sg.Camera.orthographic(eye, target, (0, 0, 1), 100.0, (400, 400))
    scale = scale_of(AnnotatedSubject.of(VOLUME), camera)
    assert scale == (pytest.approx(80), "20 mm")


def test_units_and_ticks() -> None:
    """Units change so that few digits are left; ticks are nice."""
    told = [length_text(0.5, "mm"), length_text(2000, "m"), length_text(5, ""), length_text(20, "Å")]
    assert told == ["500 µm", "2 km", "5", "20 Å"]
    assert ticks(-3, 101, 6) == [0, 20, 40, 60, 80, 100]


@pytest.mark.parametrize(
    ("low", "high", "right"),
    [
        (0.9, 60, [1, 2, 5, 10, 20, 50]),
        (0.01, 1000, [0.01, 0.1, 1, 10, 100, 1000]),
        (1e-9, 1e3, [1e-8, 1e-6, 1e-4, 0.01, 1, 100]),
        (3, 4, []),
    ],
)
def test_logarithmic_ticks(low: float, high: float, right: list[float]) -> None:
    """Decades, with 2 and 5 where there is room; of many, every few."""
    assert log_ticks(low, high, 6) == right


def test_a_logarithmic_bar_is_even_in_decades() -> None:
    """Its rows have the transfer function's colours, and a decade is as long as another."""
    transfer = sg.Transfer([(1, 0.0), (1000, 0.8)], colormap="viridis", scale="log")
    bar = of_values(transfer, "density", "composite", 300)
    assert bar is not None
    assert [bar.down(value) for value in (1000, 100, 10, 1)] == pytest.approx([0, 1 / 3, 2 / 3, 1])
    assert np.allclose(bar.colors[99:101, :3].mean(axis=0), transfer.color(100.0), atol=5e-3)
    assert bar.opacity is not None and bar.opacity[149:151].mean() == pytest.approx(0.4, abs=1e-3)
    assert bar.marks() == [1, 10, 100, 1000]


def test_a_bar_is_named_by_its_quantity() -> None:
    """By the array and its unit, which stays where a long name is cut; else by the volume's name."""
    volume = sg.Volume(np.zeros((2, 2, 2)), name="era5", quantity="u", value_unit="m/s")
    assert [AnnotatedSubject.of(each).value_name for each in (volume, replace(volume, quantity=""))] == [
        "u, m/s",
        "era5, m/s",
    ]
    cut = [
        shorten_label(label)
        for label in ("velocity, m/s", "specific_humidity_of_air, g/kg", "a" * 30, "b, " + "c" * 30)
    ]
    assert cut == ["velocity, m/s", "specific_hu..., g/kg", "a" * 17 + "...", "b, " + "c" * 14 + "..."]


def test_segments_have_no_bar() -> None:
    """Their colours are names, which no scale of numbers shows."""
    labels = sg.Transfer([(1, 0.0), (2, 0.9)], labels=((1, "#ff0000", 1.0), (2, "#00ff00", 1.0)))
    camera = sg.Camera.orbit(VOLUME, 30, 20, 40, (128, 128))
    found = sg.annotated(sg.Image(np.zeros((128, 128, 4), np.float32), {}), VOLUME, labels, camera, ["colorbar"])
    assert not found.pixels.any()
    assert found.info["not_annotated"] == ["no colour bar: the segments have colours of their own"]


def test_letters() -> None:
    """A patient seen from the front has L at the right; in RAS the same side is −x."""
    front = {"LPS": (4, -90, 4), "RAS": (4, 90, 4)}
    for frame, eye in front.items():
        camera = sg.Camera.look_at(eye, (4, 4, 4), (0, 0, 1))
        assert [letters(frame, camera.eye_from_world[n]) for n in (0, 1, 2)] == ["L", "I", "P"]
    assert letters("LPS", np.array([0.8, 0.6, 0.0])) == "LP"


@pytest.mark.parametrize("size", [(256, 256), (512, 512), (1024, 600), (300, 700)])
@pytest.mark.parametrize("light", [0.0, 1.0])
def test_bar_colors_and_untouched_pixels(size: tuple[int, int], light: float) -> None:
    """The bar has the transfer function's colours; far from annotations nothing changes."""
    camera = sg.Camera.orbit(VOLUME, size=size)
    pixels = np.full((size[1], size[0], 4), light, np.float32)
    image = annotated(sg.Image(pixels, {"blend": "composite"}), VOLUME, TRANSFER, camera, ALL)
    assert image.info["not_annotated"] == []
    bar = of_values(TRANSFER, "ct", "composite", round(0.45 * size[1]))
    assert bar is not None
    middle = image.pixels[size[1] // 2 - 20 : size[1] // 2 + 20]
    row = TRANSFER.color(
        bar.high
        - (np.argmin(np.abs(bar.colors[:, 0] - bar.colors[len(bar.colors) // 2, 0])) + 0.5) / len(bar.colors) * 100
    )
    assert np.abs(middle[..., :3] - row.astype(np.float32)).max(axis=-1).min() < 1e-6
    center = (slice(size[1] // 3, size[1] // 3 + 20), slice(size[0] // 3, size[0] // 2))
    np.testing.assert_array_equal(image.pixels[center], pixels[center])


@pytest.mark.parametrize("text", ["sharp", "title", "title=", "scale,scale", "scale=left", "axes=3"])
def test_bad_names(text: str) -> None:
    """One line that lists what is known."""
    with pytest.raises(sg.InputError, match="annotate: expected"):
        parse_annotations(text)


@pytest.mark.long
def test_render(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The command draws them; a small picture is told before."""
    out = tmp_path / "a.png"
    base = ["render", "nerve", "-o", str(out), "--annotate", "scale,axes,title=A, b"]
    assert main([*base, "--size", "128", "--quiet"]) == 0
    assert sg.Image.load(out).info["annotated"] == ["scale", "axes", "title=A, b"]
    assert main([*base, "--size", "32"]) == 2 and "at least 64×64" in capsys.readouterr().err


# --- the box, and annotations of live views ---------------------------------------------------------------------------


SHEAR = np.array([[1.0, 0.3, 0.0], [0.0, 0.9, 0.2], [0.0, 0.1, 1.0]])
OBLONG = sg.Volume(np.zeros((20, 30, 40), np.float32), (1, 2, 3), (5, -10, 100), unit="mm", frame="LPS", name="ct")
SHEARED = sg.Volume(np.zeros((20, 30, 40), np.float32), (1, 2, 3), direction=SHEAR, unit="mm")
MIRRORED = sg.Volume(np.zeros((20, 30, 40), np.float32), (1, 2, 3), direction=np.diag([1.0, -1, 1]), unit="mm")
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
        layer = Canvas(np.zeros((500, 600, 4), np.float32), WHITE)
        world_lines.draw_edges(layer, AnnotationView(AnnotatedSubject.of(volume), TRANSFER, camera))
        light = layer.pixels[..., 0]
        every = world_lines.edges(volume.corners, camera)
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
        for edge in world_lines.edges(volume.corners, camera):
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
        subject, every = AnnotatedSubject.of(volume), world_lines.edges(volume.corners, camera)
        layer = Canvas(np.zeros((500, 600, 4), np.float32), WHITE)
        world_lines.draw_edges(layer, AnnotationView(subject, TRANSFER, camera))
        chosen = world_lines.select_numbered_edges(every, subject, camera)
        assert [each.axis for each in chosen] == [0, 1, 2]
        for edge in chosen:
            places, texts, name = world_lines.marks(subject, edge, camera, layer.em)
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
            out = world_lines.outward_direction(edge, subject, camera)
            tips = np.floor(at(places, camera) + out * world_lines.TICK * layer.em * 0.8).astype(int)
            assert layer.pixels[tips[:, 1], tips[:, 0], 0].min() > 0.25


def test_lines_behind_are_weakened_by_the_picture() -> None:
    """A dash shines through half of opacity with half of its light, and not at all through an opaque picture."""
    camera = sg.Camera.orbit(OBLONG, 30, 20, size=(400, 400), zoom=0.7)
    lights = []
    for alpha in (0.0, 0.5, 1.0):
        pixels = np.zeros((400, 400, 4), np.float32)
        pixels[..., 3] = alpha
        lights.append(sg.annotated(sg.Image(pixels, {}), OBLONG, TRANSFER, camera, ["box"], (0, 0, 0)).pixels[..., 0])
    hidden = next(each for each in world_lines.edges(OBLONG.corners, camera) if each.hidden)
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
        layer = Canvas.over(np.full((size[1], size[0], 4), shown, np.float32), (0, 0, 0))
        view = AnnotationView(AnnotatedSubject.of(volume), TRANSFER, camera, "composite")
        compose(layer, view, asked)
        assert not any(a.meets(b) for a, b in itertools.combinations(layer.taken, 2))
        for rect in layer.taken:
            assert rect.left >= 0 and rect.top >= 0 and rect.right <= size[0] and rect.bottom <= size[1]
        assert size[0] > 256 or layer.notes
        # without the box nothing is drawn outside of the places
        layer = Canvas(np.zeros((size[1], size[0], 4), np.float32), WHITE)
        compose(layer, view, [name for name in asked if name != "box"])
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
    """To a step of 8 bits; the second use of the buffers leaves nothing of the first. In perspective, pictures alone
    state the depth that a scale bar is at, in a second line.
    """
    overlay, subject = LiveOverlay(), AnnotatedSubject.of(OBLONG)
    names = ["box", "colorbar", "title=Head", *default_names(subject)]
    for angle in (10.0, 50.0, 51.0):
        camera = sg.Camera.orbit(OBLONG, angle, 20, size=(300, 260), zoom=0.6)
        names = [name for name in names if name != "scale"]
        live = overlay.draw(subject, TRANSFER, camera, names)
        empty = sg.Image(np.zeros((260, 300, 4), np.float32), {"blend": "composite"})
        found = sg.annotated(empty, OBLONG, TRANSFER, camera, names, (0, 0, 0), steady=True)
        right = found.pixels
        assert list(overlay.notes) == found.info["not_annotated"]
        assert np.abs(live[..., 3] / 255 - right[..., 3]).max() <= 0.5 / 255 + 1e-6
        linear = np.where(live <= 10, live / 3294.6, ((live / 255 + 0.055) / 1.055) ** 2.4)[..., :3]
        assert np.abs(linear * right[..., 3:] - right[..., :3]).max() < 0.006


@pytest.mark.parametrize("size", [(320, 240), (640, 480), (310, 480), (950, 800)])
def test_a_color_bar_stands_beside_the_subject(size: tuple[int, int]) -> None:
    """In a picture of a disc, and in a view, which knows how much of the room a volume fills; the axes have theirs."""
    y, x = np.indices(size[::-1]) - np.reshape(size[::-1], (2, 1, 1)) / 2 + 0.5
    pixels = np.zeros((*size[::-1], 4), np.float32)
    pixels[np.hypot(x, y) < 0.36 * min(size)] = 0.5
    subject = replace(AnnotatedSubject.of(OBLONG), value_name="a quantity of a long name")
    camera = sg.Camera.orbit(OBLONG, size=size)
    image = sg.annotated(sg.Image(pixels, {}), subject, TRANSFER, camera, ["colorbar", "axes"], (0, 0, 0))
    assert image.info["not_annotated"] == []
    bar = sg.annotated(sg.Image(pixels, {}), subject, TRANSFER, camera, ["colorbar"], (0, 0, 0)).pixels
    live = LiveOverlay().draw(subject, TRANSFER, camera, ["colorbar"])[..., 3]
    for drawn in ((bar != pixels).any(axis=-1), live > 0):
        assert drawn.any() and not (drawn & (pixels[..., 3] > 0)).any()
        columns, rows = np.flatnonzero(drawn.any(axis=0)), np.flatnonzero(drawn.any(axis=1))
        assert columns[0] > 4 and columns[-1] < size[0] - 5 and rows[0] > 4 and rows[-1] < size[1] - 5


@pytest.mark.parametrize(("spacing", "label"), [((1, 1, 1), "5 voxels"), ((2, 2, 2), "10 units")])
def test_a_scale_bar_names_its_unit(spacing: tuple[float, float, float], label: str) -> None:
    """Voxels of a grid without one. Pictures state the depth that it is at; the window has tooltips."""
    volume = sg.Volume(np.zeros((20, 20, 20), np.float32), spacing)
    subject, camera = AnnotatedSubject.of(volume), sg.Camera.orbit(volume, size=(200, 200))
    scale = scale_of(subject, camera)
    assert scale is not None and scale[1] == label
    live = LiveOverlay().draw(subject, TRANSFER, camera, ["scale"])[..., 3]
    picture = sg.annotated(sg.Image(np.zeros((200, 200, 4), np.float32), {}), subject, TRANSFER, camera, ["scale"])
    rows = [pixels.any(axis=1).sum() for pixels in (live, picture.pixels[..., 3])]
    assert 0 < rows[0] < rows[1] - 5


def test_an_eye_within_the_box_is_told() -> None:
    """No numbers, a note, and edges ahead of the eye alone."""
    center = OBLONG.center
    camera = sg.Camera.look_at(center, center + np.array([0, 1.0, 0]), (0, 0, 1), 120, (200, 200))
    layer = Canvas(np.zeros((200, 200, 4), np.float32), WHITE)
    view = AnnotationView(AnnotatedSubject.of(OBLONG), TRANSFER, camera)
    compose(layer, view, ["box"])
    world_lines.draw_behind(layer, view)
    assert layer.notes == ["no numbers of the box: the eye is in it"] and layer.pixels.any()
    assert np.isfinite(layer.pixels).all()


# --- real pictures, scene files, Python, and movies -------------------------------------------------------------------


CLEAR = sg.Transfer([(1, 0.0), (2, 0.5)])


def bare(camera: sg.Camera) -> sg.Image:
    """A picture of nothing, on black."""
    pixels = np.zeros((camera.size[1], camera.size[0], 4), np.float32)
    return sg.Image(pixels, {"blend": "composite"})


@pytest.mark.parametrize("size", [(300, 240), (900, 500)])
@pytest.mark.parametrize("parallel", [False, True])
@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), (0.25, 0.5, 4.0)])
def test_the_bar_is_as_long_as_it_says(
    spacing: tuple[float, float, float], parallel: bool, size: tuple[int, int]
) -> None:
    """Its pixels, counted, against the distance between the projections of two points that far apart."""
    volume = sg.Volume(np.zeros((20, 30, 40), np.float32), spacing, unit="mm")
    camera = sg.Camera.orbit(volume, 25, 10, size=size)
    camera = camera.parallel(volume) if parallel else camera
    found = sg.annotated(bare(camera), volume, CLEAR, camera, ["scale"], ground=(0, 0, 0))
    # the bar is the widest run of lit pixels
    lit = found.pixels[..., :3].max(axis=2) > 0.5
    longest = max(len(run) for row in lit for run in "".join("x" if p else " " for p in row).split())
    lengths = [step * 10.0**power for power in range(-3, 4) for step in (1, 2, 5)]
    # two points at the middle's depth, that length apart across the view
    ends = volume.center + np.array([[0.0], [1.0]]) * camera.right
    seen = camera.eye_from_points(ends)
    pixel = (seen[1, 0] - seen[0, 0]) / (seen[0, 2] if parallel is False else 1.0) / (camera.extent / size[1])
    assert min(abs(length * pixel - longest) for length in lengths) <= 1.5
    assert longest <= 0.26 * size[0]


@pytest.mark.parametrize("angles", [(0.0, 0.0), (30.0, 20.0), (200.0, -50.0), (90.0, 0.0)])
def test_axes_point_where_the_camera_has_them(angles: tuple[float, float]) -> None:
    """The middle of each axis' colour lies from the triad's middle as its projection does."""
    volume = sg.Volume(np.zeros((9, 9, 9), np.float32))
    camera = sg.Camera.orbit(volume, *angles, size=(600, 600))
    image = sg.annotated(bare(camera), volume, CLEAR, camera, ["axes"], ground=(1, 1, 1))
    layer = Canvas.over(bare(camera).pixels, (1, 1, 1))
    half = int(np.ceil(LONG * layer.em + 1.3 * layer.em))
    middle = np.array([layer.pad + half, 600 - layer.pad - half])
    for axis, color in enumerate(COLORS):
        along = camera.eye_from_world[:2, axis]
        close = np.abs(image.pixels[..., :3] - np.array(color)).max(axis=2) < 0.02
        y, x = np.nonzero(close & (image.pixels[..., 3] > 0.95))
        if np.linalg.norm(along) < 0.3:
            continue
        mean = np.array([x.mean(), y.mean()]) - middle
        assert mean @ along / np.linalg.norm(mean) / np.linalg.norm(along) > 0.97


def test_axes_have_the_names_of_the_file() -> None:
    """Coloured names, apart from each other, also where two axes are seen along the same line."""
    names = "longitude", "latitude", "height above ground"
    volume = replace(VOLUME, axes=tuple(map(AxisCoordinate, names)))
    for angles in ((30, 20), (0, 5), (0, 0), (200, 60)):
        camera = sg.Camera.orbit(volume, *angles, size=(300, 300))
        image = sg.annotated(bare(camera), volume, CLEAR, camera, ["axes"])
        assert image.figure is not None and not image.info["not_annotated"]
        marks = [mark for mark in image.figure.over if isinstance(mark, TextMark)]
        assert [mark.text for mark in marks] == ["longitude", "latitude", "height..."]
        at = np.array([mark.at for mark in marks])
        apart = np.abs(at[[0, 0, 1]] - at[[1, 2, 2]])
        wide = Canvas.over(image.pixels, None).text_size("latitude")[0]
        assert ((apart[:, 0] > 0.6 * wide) | (apart[:, 1] > 7)).all()
        assert at.min() > 0 and (at[:, 0] + wide).max() < 300


def test_letters_of_files(tmp_path: Path) -> None:
    """A NIfTI file in RAS and a NRRD in LPS of one patient, with flipped axes: the same letters at the same edges."""
    nibabel, nrrd = pytest.importorskip("nibabel"), pytest.importorskip("nrrd")
    data = np.zeros((6, 7, 8), np.int16)
    data[2:4, 2:5, 2:6] = 100
    nibabel.save(nibabel.Nifti1Image(data, np.diag([-2.0, 2, 2, 1])), tmp_path / "a.nii")
    header = {"space": "left-posterior-superior", "space directions": np.diag([2.0, -2, 2])}
    nrrd.write(str(tmp_path / "a.nrrd"), data, header)
    pictures = []
    for name in ("a.nii", "a.nrrd"):
        volume = sg.load(tmp_path / name)
        frame = {"RAS": 1.0, "LPS": -1.0}[str(volume.frame)]
        # the same patient from the front and the left
        eye = volume.center + np.array([-40.0 * frame, 60.0 * frame, 10.0])
        camera = sg.Camera.look_at(eye, volume.center, (0, 0, 1), 30, (200, 200))
        pictures.append(sg.annotated(bare(camera), volume, CLEAR, camera, ["directions"], ground=(0, 0, 0)).pixels)
    assert pictures[0].any() and (pictures[0] == pictures[1]).all()


def test_scene_files_and_python_draw_what_the_command_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    np.save(tmp_path / "a.npy", np.random.default_rng(1).random((12, 12, 12)).astype(np.float32))
    source, out = str(tmp_path / "a.npy"), tmp_path / "o.npy"
    options = ["--size", "96", "--quiet", "--check", "0", "--points", "0.3:0,0.9:0.5", "-o", str(out)]
    names = ["scale", "axes", "title=One, two"]
    assert main(["render", source, "--annotate", ",".join(names), *options]) == 0
    right = np.load(out)
    same = sg.render(source, size=96, points=((0.3, 0), (0.9, 0.5)), annotate=names)
    assert (same.pixels == right).all() and same.info["annotated"] == names
    path = tmp_path / "s.toml"
    path.write_text(SceneFile(source, annotate=tuple(names)).to_toml(tmp_path))
    assert SceneFile.from_toml(path).annotate == tuple(names)
    assert main(["render", str(path), *options]) == 0
    assert (np.load(out) == right).all()
    # left out of comparisons
    assert main(["render", source, *options]) == 0
    plain = np.load(out)
    np.save(tmp_path / "ref.npy", plain)
    assert main(["render", str(path), "--ref", str(tmp_path / "ref.npy"), *options]) == 0
    for bad in ('annotate = ["sharp"]', "annotate = [3]", 'annotate = ["time"]'):
        path.write_text(f'volume = "a.npy"\n{bad}\n')
        assert main(["render", str(path), *options]) == 2
        assert "annotate: expected" in capsys.readouterr().err


def test_the_view_of_meshes_is_annotated() -> None:
    """A mesh beyond the volume moves the eye away: the bar is of the picture that is drawn."""
    volume = sg.Volume(np.random.default_rng(2).random((8, 8, 8)), unit="mm")
    ball = sg.Mesh.of_points([[40, 4, 4]], 3.0)
    look = {"size": 128, "points": ((0.4, 0), (0.9, 0.5)), "meshes": [ball], "background": "black"}
    image, plain = sg.render(volume, annotate="scale", **look), sg.render(volume, **look)
    camera = sg.Camera.orbit(sg.Scene([sg.Layer(volume, CLEAR)], meshes=[ball]), 30, 20, size=(128, 128))
    assert abs(float(np.array(image.info["eye"])[0]) - camera.eye[0]) < 5.0
    lit = np.abs(image.pixels - plain.pixels)[100:, 64:].max(axis=2) > 0.5
    longest = max(len(run) for row in lit for run in "".join("x" if p else " " for p in row).split())
    eye = np.array(image.info["eye"])
    depth = (volume.center - eye) @ np.array(image.info["forward"])
    pixel = 1 / (2 * np.tan(np.radians(20)) * depth / 128)
    assert min(abs(length * pixel - longest) for length in (1, 2, 5, 10, 20, 50)) <= 1.5


def test_movies_have_running_times(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of time points that are 90 s apart; frames differ in the corner of the time alone; others are another movie."""
    h5py = pytest.importorskip("h5py")
    cells = np.random.default_rng(3).random((1, 8, 8, 8)).astype(np.float32)
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["a"], file["time"] = np.repeat(cells, 3, axis=0), np.arange(3) * 1.5
        file["time"].attrs["units"] = "minutes"
        file["time"].make_scale()
        for n, name in enumerate("tzyx"):
            file["a"].dims[n].label = name
        file["a"].dims[0].attach_scale(file["time"])
    options = ["--size", "96", "--quiet", "--points", "0.3:0,0.9:0.5", "-o", str(tmp_path / "{frame:02d}.png")]
    assert main(["animate", f"{path}:/a", "--annotate", "time,title=A", *options]) == 0, capsys.readouterr().err
    frames = [np.asarray(Pillow.open(tmp_path / f"{n:02d}.png")).astype(int) for n in range(3)]
    told = [str(sg.Image.load(tmp_path / f"{n:02d}.png").info["annotated"]) for n in range(3)]
    assert [text[:15].split("'")[1] for text in told] == ["time=0 min", "time=1.5 min", "time=3 min"]
    # texts of one width
    apart = np.abs(frames[0] - frames[2]).max(axis=2)
    y, x = np.nonzero(apart)
    assert len(y) and y.max() < 30 and x.max() < 48
    assert main(["animate", f"{path}:/a", "--annotate", "title=B", "--resume", *options]) == 2
    assert "expected a frame of this animation" in capsys.readouterr().err
    np.save(tmp_path / "b.npy", cells[0])
    assert main(["animate", str(tmp_path / "b.npy"), "--annotate", "time", *options]) == 2
    assert "expected 'time=TEXT'" in capsys.readouterr().err


@pytest.mark.few(4)
@pytest.mark.parametrize("case", ["gradient", "threshold", "values", "colours", "levels", "parallel", "layers"])
def test_annotations_are_laid_with_the_camera_of_the_picture(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of every kind of picture, whose views are fitted to what is drawn."""
    _, y, x = np.indices((16, 16, 16))
    samples = np.minimum(x + y / 3, 12.0).astype(np.float32)
    volume = sg.Volume(samples, unit="mm")
    options: dict[str, Any] = {"points": [(3.0, 0.0), (4.0, 0.5)], "size": (96, 80), "annotate": "scale"}
    if case in ("gradient", "parallel"):
        options |= {"gradient": [(0.2, 0.0), (0.5, 1.0)], "classification": "pre", "orthographic": case == "parallel"}
    elif case == "threshold":
        options |= {"points": [(3.0, 0.0), (12.0, 0.5)], "threshold": 0.2, "classification": "pre"}
    elif case == "colours":
        volume = sg.Volume(samples, color=np.full((16, 16, 16, 3), 200, np.uint8))
    elif case == "levels":
        coarse = samples.reshape(8, 2, 8, 2, 8, 2).mean(axis=(1, 3, 5))
        volume = replace(volume, coarser=(sg.Volume(coarse, spacing=(2, 2, 2), origin=(0.5, 0.5, 0.5)),))
        options |= {"gradient": [(0.2, 0.0), (0.5, 1.0)], "classification": "pre"}
    elif case == "layers":
        options |= {"streamlines": 4}
        volume = sg.Volume(samples, vectors=np.tile(np.float32([1, 0, 0]), (16, 16, 16, 1)))
    laid: list[sg.Camera] = []
    drawn: list[sg.Camera] = []
    render = sg.Renderer.draw

    def rendered(renderer: sg.Renderer, scene: Any, *more: Any, **named: Any) -> sg.Image:
        drawn.append(scene.resolved.camera)
        return render(renderer, scene, *more, **named)

    monkeypatch.setattr(sg.Renderer, "draw", rendered)
    row = ANNOTATIONS["scale"]

    def draw(layer: Canvas, view: AnnotationView) -> None:
        laid.append(view.camera)
        row.draw(layer, view)

    monkeypatch.setitem(ANNOTATIONS, "scale", replace(row, draw=draw))
    sg.render(volume, **options)
    a, b = laid[-1], drawn[-1]
    assert np.array_equal(a.eye, b.eye) and np.array_equal(a.eye_from_world, b.eye_from_world)
    assert (a.extent, a.size, a.perspective) == (b.extent, b.size, b.perspective)


def test_frames_that_are_smaller_than_a_still_say_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A turn needs room; of one that is none, frame 0 has the camera of the still, for values and for voxels."""
    samples = np.zeros((6, 8, 24), np.float32)
    samples[2:4, 2:6, 3:20] = 1.0
    np.save(tmp_path / "long.npy", samples)
    drawn = [str(tmp_path / "long.npy"), "--size", "48x40", "--azimuth", "90", "--points", "0.4:0,0.6:0.5"]
    for more in ([], ["--classification", "pre", "--gradient", "0.1:0,0.3:1"]):
        frames = [*drawn, *more, "-o", str(tmp_path / "{frame}.npy"), "--frames", "2", "--only", "0-0"]
        assert main(["render", *drawn, *more, "-o", str(tmp_path / "still.npy")]) == 0
        still = np.load(tmp_path / "still.npy")
        capsys.readouterr()
        assert main(["animate", *frames]) == 0
        assert "times as large as the picture of render; --zoom" in capsys.readouterr().err
        assert np.abs(np.load(tmp_path / "0.npy") - still).max() > 0.05
        assert main(["animate", *frames, "--turntable", "0"]) == 0
        assert "as large" not in capsys.readouterr().err
        assert np.array_equal(np.load(tmp_path / "0.npy"), still)


# --- axes of files ----------------------------------------------------------------------------------------------------

# name, coordinates, attributes of the vertical axis → its numbers from the bottom to the top, and its title
VERTICALS = {
    "height": (np.linspace(0, 19.8, 12), {"units": "km"}, (0.0, 20.0), "height, km"),
    "level": (np.array([1000.0, 850, 700, 500, 300, 200]), {"units": "hPa"}, (1000.0, 200.0), "level, hPa"),
    "depth": (np.linspace(0, 4000, 9), {"units": "m", "positive": "down"}, (4000.0, 0.0), "depth, m"),
}


def over_degrees(name: str) -> sg.Volume:
    """A volume over longitude and latitude, whose vertical axis is scaled."""
    places, attributes, _, _ = VERTICALS[name]
    axes = [Coordinate.of(name, places, attributes)]
    axes.append(Coordinate.of("lat", np.linspace(35, 60, 10), {"units": "degrees_north"}))
    axes.append(Coordinate.of("lon", np.linspace(-10, 30, 16), {"units": "degrees_east"}))
    return make_lattice(axes).volume(np.ones([axis.size for axis in axes], np.float32), "coordinates")


@pytest.mark.parametrize("name", VERTICALS)
def test_numbers_of_scaled_axes_are_the_files(name: str) -> None:
    """They are those of its own axis, where they lie along it; coarser grids and channels have them, too."""
    volume, (_, _, ends, title) = over_degrees(name), VERTICALS[name]
    subject, camera = AnnotatedSubject.of(volume), sg.Camera.orbit(volume, 30, 20, size=(400, 400))
    chosen = world_lines.select_numbered_edges(world_lines.edges(subject.corners, camera), subject, camera)
    for edge, heading in zip(chosen, ("lon, °", "lat, °", title), strict=True):
        places, texts, shown = world_lines.marks(subject, edge, camera, 12)
        assert shown == heading and len(texts) >= 2
        axis = ["lon", "lat"].index(heading[:3]) if heading[0] == "l" and heading[1] != "e" else 2
        numbers, along = np.array(texts, float), places[:, axis]
        low, high = ends if axis == 2 else ((-10, 30), (35, 60))[axis]
        bottom, top = volume.corners[:, axis].min(), volume.corners[:, axis].max()
        # the box ends half a voxel beyond
        half = volume.spacing[axis] / 2
        share = (along - bottom - half) / (top - bottom - 2 * half)
        assert np.allclose(numbers, low + share * (high - low), atol=2e-2 * abs(high - low))
        assert share.min() > -0.15 and share.max() < 1.15
    assert halve_volume(volume).axes == volume.axes


def test_lengths_across_axes_of_several_units() -> None:
    """A bar has the unit of the axes across the picture, else there is none; distances are those along each axis."""
    volume = over_degrees("height")
    subject = AnnotatedSubject.of(volume)
    bar = scale_of(subject, sg.Camera.orbit(volume, 0, 0, size=(200, 200)))
    assert bar is not None and bar[1].endswith("°")
    rolled = sg.Camera.orbit(volume, 0, 0, size=(200, 200), up=(1.0, 0.0, 0.2))
    assert scale_of(subject, rolled) is None
    image = annotated(sg.Image(np.zeros((200, 200, 4), np.float32), {}), subject, TRANSFER, rolled, ["scale"])
    assert image.info["not_annotated"] == ["no scale bar: across the picture axes have several units"]
    slope = volume.axes[2].slope
    points = ((0.0, 40.0, 0.0), (3.0, 44.0, 2.0 / slope))
    assert measure_text(Measure(points), subject) == "lon 3 °, lat 4 °, height 2 km"
    assert measure_text(Measure((points[0], (3.0, 44.0, 0.0))), subject) == "5 °"
    assert measure_text(Measure((*points, (3.0, 40.0, 0.0))), subject) == "no angle: axes have several units"


def test_lengths_in_several_units_of_length_are_those_of_the_world() -> None:
    axes = [
        Coordinate("z", 4, np.linspace(0, 0.3, 4), "km"),
        *(Coordinate(n, 4, np.arange(4.0) * 100, "m") for n in "yx"),
    ]
    volume = make_lattice(axes).volume(np.ones((4, 4, 4), np.float32), "coordinates")
    assert measure_text(Measure(((0, 0, 0), (300, 0, 400))), AnnotatedSubject.of(volume)) == "500 m"


def test_heights_are_the_maps(tmp_path: Path) -> None:
    """However high the relief is drawn."""
    heights = np.add.outer(np.arange(12.0), np.arange(16.0)) * 10 + 500
    np.savetxt(tmp_path / "heights.csv", heights, delimiter=",")
    volume = sg.load(tmp_path / "heights.csv", relief=3.0)
    axis = volume.axes[2]
    assert (axis.name, axis.offset) == ("height", 500.0) and axis.offset + axis.slope * 3.0 == pytest.approx(760.0)


@pytest.mark.parametrize(
    ("unit", "text", "pixels", "corner"),
    [
        ("um", "20um", 20, "bottom-right"),
        ("um", "0.02 mm:top-left:5px:red", 20, "top-left"),
        ("mm", "20:bottom-left:#0f0", 20, "bottom-left"),
        ("mm", "2cm:6px", 20, "bottom-right"),
    ],
)
def test_a_stated_scale_bar(unit: str, text: str, pixels: int, corner: str) -> None:
    """Its length is exact, and its place, thickness and colour are as stated."""
    volume = sg.Volume(np.zeros((100, 100, 100), np.uint8), unit=unit)
    camera = sg.Camera.orthographic((50, -200, 50), (50, 50, 50), (0, 0, 1), 100, (200, 200))
    empty = sg.Image(np.zeros((200, 200, 4), np.float32), {"blend": "composite"})
    image = annotated(empty, volume, TRANSFER, camera, [f"scale={text}"], ground=(0.0, 0.0, 0.0))
    assert image.info["not_annotated"] == []
    stated = bars.ScaleBar.parse(text)
    color = stated.color or (1.0, 1.0, 1.0)
    matches = np.abs(image.pixels[..., :3] - color).max(axis=-1) < 1e-3
    rows = np.flatnonzero(matches.sum(axis=1) == 2 * pixels)
    assert len(rows) == (stated.thickness or 2)
    assert (rows.mean() < 60) == corner.startswith("top")
    assert (np.flatnonzero(matches[rows[0]]).mean() < 80) == corner.endswith("left")


@pytest.mark.parametrize(
    "text", ["20furlong", "transparent", "20um:30um", "0px", "-3um", "left", "20um:nocolor", "1e999"]
)
def test_other_scale_bars_are_refused(text: str) -> None:
    with pytest.raises(InputError, match="annotate: expected scale=LENGTH:CORNER:THICKNESS:COLOUR"):
        check([f"scale={text}"])


def test_a_length_needs_a_unit_of_the_data() -> None:
    volume = sg.Volume(np.zeros((10, 10, 10), np.uint8))
    empty = sg.Image(np.zeros((200, 200, 4), np.float32), {"blend": "composite"})
    image = annotated(empty, volume, TRANSFER, sg.Camera.orbit(volume, size=(200, 200)), ["scale=2um"])
    assert image.info["not_annotated"] == ["no scale bar of 2 um: the data does not state its unit of length"]


def test_a_legend_names_segments_and_layers_in_their_colours() -> None:
    table = (sg.Label(2, "liver", "#ff0000"), sg.Label(5))
    segments = sg.Volume(np.zeros((4, 4, 4), np.uint8), labels=table)
    look = sg.Transfer(labels=[(2, "#ff0000", 1.0), (5, "#00ff00", 0.5), (6, "#0000ff", 0.0)])
    assert legend_of([(segments, look)]) == (("liver", "#ff0000"), ("label 5", "#00ff00"))
    green = replace(TRANSFER, colormap="#00ff00")
    assert legend_of([(VOLUME, green), (segments, look)])[0] == ("ct", "#00ff00")
    assert legend_of([(VOLUME, green)]) == ()
    rows = tuple((f"segment {n}", "#ff0000") for n in range(40))
    view = AnnotationView(replace(AnnotatedSubject.of(VOLUME), legend=rows), TRANSFER, sg.Camera.orbit(VOLUME))
    canvas = replace(Canvas(np.zeros((512, 512, 4), np.float32), WHITE), marks=[])
    ANNOTATIONS["legend"].draw(canvas, view)
    texts = [mark.text for mark in canvas.marks or () if isinstance(mark, TextMark)]
    assert texts[:2] == ["segment 0", "segment 1"] and texts[-1] == "17 more"
    red = canvas.pixels[(canvas.pixels[..., 0] > 0.99) & (canvas.pixels[..., 1] < 0.01)]
    assert len(red) > 20 * 23
    alone = replace(canvas, notes=[])
    ANNOTATIONS["legend"].draw(alone, replace(view, subject=AnnotatedSubject.of(VOLUME)))
    assert alone.notes == ["no legend: there is one layer only, without segments"]
    # axes stay in a window with a text at the upper left
    subject, camera = replace(AnnotatedSubject.of(OBLONG), legend=rows[:3]), sg.Camera.orbit(OBLONG, size=(400, 300))
    axes, both = (
        LiveOverlay().draw(subject, TRANSFER, camera, names, above=56) for names in (["axes"], ["axes", "legend"])
    )
    assert (both == axes)[axes[..., 3] > 0].all() and (both != axes).any()


def test_doors_show_a_legend(tmp_path: Path) -> None:
    """Commands' scenes and Python tell the legend the same layers."""
    samples = np.zeros((8, 8, 8), np.uint8)
    samples[2:6, 2:6, 2:6] = 3
    volume = sg.Volume(samples, labels=(sg.Label(3, "cube", "#00ff00"),))
    image = sg.render(volume, size=200, annotate=["legend"])
    plain = sg.render(volume, size=200)
    assert image.info["not_annotated"] == [] and (image.pixels[:40, :60] != plain.pixels[:40, :60]).any()


def test_a_colour_bar_states_its_opacity_when_asked() -> None:
    for text, told in (("", False), ("opacity", True)):
        view = AnnotationView(AnnotatedSubject.of(VOLUME), TRANSFER, sg.Camera.orbit(VOLUME), text=text)
        canvas = replace(Canvas(np.zeros((512, 512, 4), np.float32), WHITE), marks=[])
        ANNOTATIONS["colorbar"].draw(canvas, view)
        texts = [mark.text for mark in canvas.marks or () if isinstance(mark, TextMark)]
        assert any(text.startswith("opacity to 0.") for text in texts) == told
    with pytest.raises(InputError, match="colorbar=opacity to state the largest, got colorbar=3"):
        check(["colorbar=3"])


def test_measures_of_every_door(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The command, Python and a scene file draw the same lines; measures draw themselves."""
    monkeypatch.chdir(tmp_path)
    np.save("v.npy", np.indices((8, 8, 8))[0].astype(np.uint8))
    points = ((1.0, 1.0, 1.0), (6.0, 1.0, 5.0))
    flags = ["--size", "128", "--check", "0", "-o", "a.npy"]
    assert main(["render", "v.npy", *flags, "--measure", "side=1,1,1:6,1,5"]) == 0
    by_command = np.load("a.npy")
    measure = Measure(points, "side")
    image = sg.render("v.npy", size=128, measures=[measure])
    assert image.info["annotated"] == ["measures"] and np.array_equal(image.pixels, by_command)
    scene = SceneFile("v.npy").with_options(size=(128, 128), measures=[measure], annotate="axes")
    assert scene.annotate == ("axes", "measures")
    (tmp_path / "a.toml").write_text(
        SceneFile("v.npy").with_options(size=(128, 128), measures=measure).to_toml(tmp_path)
    )
    assert np.array_equal(sg.render("a.toml").pixels, by_command)
    assert not np.array_equal(sg.render("v.npy", size=128).pixels, by_command)
    assert sg.render("v.npy", size=128, measures=[points]).info["not_annotated"] == []


@pytest.mark.parametrize("text", ["1,2,3", "1,2,3:4,5", "1,2,3:4,5,6:7,8,9:1,1,1", "a=", "x,y,z:1,2,3"])
def test_other_measures_are_refused(text: str) -> None:
    with pytest.raises(InputError, match="measures: expected two points, or three for an angle"):
        SceneFile("v.npy").with_options(measures=[text])

"""Three linked slices beside the picture: how they lie, what they show, and what the mouse does there."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import combinations, permutations
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.annotations.world_lines import letters
from splatgl.data.color import srgb_from_linear
from splatgl.geometry.slices import SliceLayer, SlicePainter, world_axes
from splatgl.gl.screen import Stroke
from splatgl.scene.scene_file import SceneFile
from splatgl.viewer.document import Document
from splatgl.viewer.saving import append_slices
from splatgl.viewer.slice_planes import layer_painter
from splatgl.viewer.slice_views import CURSOR, Pane, SliceTool, clip_strokes, column_width, panes, slice_values
from splatgl.viewer.state import Slices, State
from splatgl.viewer.trackball import Place, Pointer, Viewport, project
from tests.helpers.blobs import blob
from tests.helpers.commands import acted
from tests.helpers.window import MISSING, Window, resized

driven = pytest.mark.skipif(bool(MISSING), reason=f"needs {' and '.join(MISSING)}: apt-get install xvfb xdotool")
UP = np.array([0.0, 0.0, 1.0])
MIDDLE = Slices()
# letters to the left, right, top and bottom of axial, coronal and sagittal slices, as radiologists have them
RADIOLOGICAL = (("R", "L", "A", "P"), ("R", "L", "S", "I"), ("A", "P", "S", "I"))


def edges(pane: Pane, volume: sg.Volume) -> tuple[str, ...]:
    """The patient's letters at the left, right, top and bottom of a slice."""
    towards = (pane.plane.right, pane.plane.down)
    return tuple(letters(volume.frame, sign * vector) for vector in towards for sign in (-1, 1))


def shown(volume: sg.Volume, up: np.ndarray = UP, slices: Slices = MIDDLE) -> tuple[Pane, ...]:
    return panes(slices, volume, up, (1024, 768))


def painter(volume: sg.Volume, transfer: sg.Transfer, colored: bool = False) -> SlicePainter:
    return layer_painter((SliceLayer(volume, transfer),), colored, only=True)


def row_of(values: list[float], transfer: sg.Transfer, colored: bool = False) -> list[list[int]]:
    """Pixels of voxels along x in the slice across z."""
    volume = sg.Volume(np.array([[values]]))
    return [list(map(int, pixel)) for pixel in shown(volume)[0].pixels(painter(volume, transfer, colored))[0]]


@pytest.mark.parametrize("frame", ["LPS", "RAS"])
@pytest.mark.parametrize("order", list(permutations(range(3))))
def test_patients_lie_as_radiologists_have_them(frame: str, order: tuple[int, ...], rng: np.random.Generator) -> None:
    """However the grid lies in the patient; the first slice is axial, the second coronal, the third sagittal."""
    direction = np.eye(3)[:, list(order)] * rng.choice([-1, 1], 3)
    volume = sg.Volume(np.zeros((5, 6, 7), np.uint8), direction=direction, spacing=(1.0, 2.0, 3.0), frame=frame)
    found = shown(volume)
    assert tuple(edges(pane, volume) for pane in found) == RADIOLOGICAL
    assert [world_axes(volume)[pane.axis] for pane in found] == [2, 1, 0]


def test_others_lie_as_the_views_from_above_front_and_right() -> None:
    volume = sg.Volume(np.zeros((5, 6, 7), np.uint8))
    x, y, z = np.eye(3).tolist()

    def found(up: np.ndarray) -> list[tuple[object, ...]]:
        return [(each.axis, each.plane.right.tolist(), each.plane.down.tolist()) for each in shown(volume, up)]

    assert found(UP) == [(2, x, [0, -1, 0]), (1, x, [0, 0, -1]), (0, y, [0, 0, -1])]
    # planes of a microscope: y and z point down in all that have them
    assert found(-np.eye(3)[1]) == [(2, x, y), (1, x, z), (0, z, y)]


def test_slices_have_the_volume_s_proportions() -> None:
    volume = sg.Volume(np.zeros((10, 20, 40), np.uint8), spacing=(1.0, 3.0, 2.0))
    for pane in (*shown(volume), *panes(Slices(), volume, UP, (200, 900))):
        left, top, right, bottom = pane.box
        sizes = np.array(volume.shape[::-1]) * volume.spacing
        lengths = [float(np.abs(vector) @ sizes) for vector in (pane.plane.right, pane.plane.down)]
        assert (right - left) / (bottom - top) == pytest.approx(lengths[0] / lengths[1])
        assert pane.room[0] <= left < right <= pane.room[2] and pane.room[1] <= top < bottom <= pane.room[3]
    # windows of any size
    for window in ((64, 64), (2000, 100), (100, 2000), (1, 1)):
        assert 0 <= column_width(window, Slices(shown=True)) <= window[0] / 2 and column_width(window, Slices()) == 0
        assert all(np.isfinite(pane.box).all() for pane in panes(Slices(), volume, UP, window, 2.0))


@pytest.mark.parametrize("size", [(300, 480), (310, 480), (400, 300), (900, 700)])
def test_words_of_slices_cover_no_other(tmp_path: Path, size: tuple[int, int]) -> None:
    """Nor does the value, which is as wide as half a narrow slice."""
    sg.Volume(np.full((8, 8, 8), 1234.56, np.float32), frame="LPS").save(tmp_path / "blob.nrrd")
    document = Document.open(SceneFile(str(tmp_path / "blob.nrrd")), quiet=True)
    state = replace(State.of(document, size), slices=Slices(shown=True))
    words = [np.array(each.place) for each in SliceTool(lambda: None).marks(state, document, Viewport(size)).labels]
    assert len(words) == 3 * 5 + 1
    for a, b in combinations(words, 2):
        assert (np.minimum(a[2:], b[2:]) <= np.maximum(a[:2], b[:2])).any()


@pytest.mark.parametrize("frame", [None, "LPS", "RAS"])
@pytest.mark.parametrize("order", list(permutations(range(3))))
def test_every_pixel_is_the_voxel_that_is_there(
    frame: str | None, order: tuple[int, ...], rng: np.random.Generator
) -> None:
    """The middle of each voxel in a slice is found at its pixel, and its value is in that row and column."""
    direction = np.eye(3)[:, list(order)] * rng.choice([-1, 1], 3)
    volume = sg.Volume(rng.random((4, 5, 6)), direction=direction, spacing=(1.0, 2.0, 0.5), frame=frame)
    slices = Slices().at((2, 3, 1), volume)
    look = painter(volume, sg.Transfer(points=[(0.0, 0.0), (1.0, 0.5)], window=(0.0, 1.0)))
    for pane in shown(volume, slices=slices):
        pixels = pane.pixels(look)
        rows, columns = pixels.shape[:2]
        left, top, right, bottom = pane.box
        for row, line in enumerate(np.linspace(top, bottom, rows, endpoint=False) + (bottom - top) / rows / 2):
            for number in range(columns):
                x = left + (number + 0.5) * (right - left) / columns
                point = pane.point((x, line))
                assert np.allclose(pane.pixel(point), (x, line))
                index = np.linalg.solve(volume.world_from_index, point)
                i, j, k = np.rint(index).astype(int).tolist()
                assert np.allclose(index, (i, j, k)) and (i, j, k)[pane.axis] == (2, 3, 1)[pane.axis]
                assert np.abs(pixels[row, number, :3] - volume.samples[k, j, i] * 255).max() < 0.6


def test_the_point_stays_in_the_volume() -> None:
    volume = sg.Volume(np.zeros((4, 5, 6), np.uint8), origin=(10.0, 0.0, 0.0), spacing=(2.0, 1.0, 1.0))
    slices = Slices()
    assert slices.index(volume) == (3, 2, 2)
    assert slices.moved(0, 2, volume).index(volume) == (5, 2, 2)
    assert slices.moved(0, 99, volume).index(volume) == (5, 2, 2) and slices.moved(2, -9, volume).index(volume)[2] == 0
    assert slices.through(np.array([14.0, 3.0, 1.0]), volume).index(volume) == (2, 3, 1)
    # the same place in half as many voxels, and in one
    half = replace(volume, samples=volume.samples[::2, ::2, ::2], spacing=(4.0, 2.0, 2.0))
    assert slices.moved(0, 2, volume).index(half) == (2, 1, 1)
    assert slices.moved(0, 2, volume).index(sg.Volume(np.zeros((1, 1, 1)))) == (0, 0, 0)


def test_grey_is_the_window() -> None:
    """What is no number is clear, as in turned slices and in pictures of slices."""
    decade = sg.Transfer(points=[(0.0, 0.0), (10.0, 0.5)], window=(0.0, 10.0), colormap="hot")
    found = row_of([-5.0, 0.0, 5.0, 10.0, 99.0, np.nan, np.inf, -np.inf], decade)
    assert [pixel[0] for pixel in found] == [0, 0, 128, 255, 255, 0, 0, 0]
    assert [pixel[3] for pixel in found] == [255] * 5 + [0] * 3
    logs = sg.Transfer(points=[(1.0, 0.0), (100.0, 0.5)], scale="log")
    assert [pixel[0] for pixel in row_of([0.0, 1.0, 10.0, 1000.0], logs)] == [0, 0, 128, 255]
    # of one value: a step
    constant = sg.Transfer(points=[(3.0, 0.5)])
    assert [pixel[0] for pixel in row_of([2.0, 3.0, 4.0], constant)] == [0, 255, 255]


@pytest.mark.parametrize("scale", ["linear", "log"])
def test_colors_are_the_transfer_function_s(rng: np.random.Generator, scale: str) -> None:
    transfer = sg.Transfer(points=[(1.0, 0.0), (90.0, 1.0)], colormap="hot", scale=scale)
    values = rng.uniform(-5 if scale == "linear" else 0.5, 120, 600).astype(np.float32)
    exact = srgb_from_linear(transfer.color(values)) * 255
    # the table has enough entries, but where sRGB is steep near black
    assert np.abs(np.array(row_of(values.tolist(), transfer, True))[:, :3] - exact).max() < 2.0
    labels = sg.Transfer(
        points=[(0.0, 0.0), (2.0, 1.0)], labels=((1, "#ff0000", 1.0), (2, "#0000ff", 1.0), (3, "#00ff00", 0.0))
    )
    volume = sg.Volume(np.array([[[1, 2, 3]]], np.uint8))
    # hidden segments are clear
    found = shown(volume)[0].pixels(painter(volume, labels))[0].tolist()
    assert found == [[255, 0, 0, 255], [0, 0, 255, 255], [0, 0, 0, 0]]


def test_straight_slices_show_what_masks_keep(rng: np.random.Generator) -> None:
    """As turned ones do."""
    values = rng.random((6, 6, 6))
    volume = sg.Volume(values).masked(sg.Volume((values > 0.5).astype(np.uint8)))
    pixels = shown(volume)[0].pixels(painter(volume, sg.Transfer(points=[(0.0, 0.0), (1.0, 0.5)])))
    assert np.array_equal(pixels[::-1, :, 3] > 0, values[3] > 0.5)


@dataclass
class Parts:
    """Samples that are read in parts, and what was read of them."""

    values: np.ndarray
    reads: list[Any] = field(default_factory=list)

    @property
    def shape(self) -> tuple[int, ...]:
        return self.values.shape

    @property
    def dtype(self) -> np.dtype:
        return self.values.dtype

    def __getitem__(self, key: Any) -> np.ndarray:
        found = self.values[key]
        self.reads.append(found.size)
        return found


def test_only_the_slice_is_read(rng: np.random.Generator) -> None:
    parts = Parts(rng.random((8, 9, 10)))
    volume = sg.Volume(parts)
    look = painter(volume, sg.Transfer(points=[(0.0, 0.0), (1.0, 0.5)]))
    for pane in shown(volume):
        parts.reads.clear()
        pane.pixels(look)
        assert parts.reads == [volume.count / volume.shape[2 - pane.axis]]


def test_large_slices_are_thinned_out() -> None:
    volume = sg.Volume(np.zeros((4, 3000, 700), np.uint8))
    first = shown(volume)[0]
    thin = first.pixels(painter(volume, sg.Transfer(points=[(0.0, 0.0), (1.0, 0.5)])))
    high, wide = first.box[3] - first.box[1], first.box[2] - first.box[0]
    assert high <= thin.shape[0] <= 4 * high and wide <= thin.shape[1] <= 4 * wide


def test_lines_end_at_the_slices() -> None:
    red = (1.0, 0.0, 0.0, 1.0)
    lines = Stroke((10.0, 0.0), (50.0, 40.0), red), Stroke((40.0, 5.0), (60.0, 5.0), red)
    beyond, before = Stroke((60.0, 0.0), (90.0, 9.0), red), Stroke((0.0, 0.0), (20.0, 9.0), red)
    found = clip_strokes((*lines, beyond, before), 50.0)
    assert [(each.start, each.stop) for each in found] == [
        ((10.0, 0.0), (50.0, 40.0)),
        ((40.0, 5.0), (50.0, 5.0)),
        ((0.0, 0.0), (20.0, 9.0)),
    ]


def test_keys_show_them(tmp_path: Path) -> None:
    np.save(tmp_path / "blob.npy", blob().samples)
    document = Document.open(SceneFile(str(tmp_path / "blob.npy")))
    state = acted(State.of(document, (120, 80)), "slices", document)
    assert state.slices.shown and not acted(state, "slices", document).slices.shown
    moved = replace(state, slices=acted(state, "slice-colors", document).slices.at((0, 0, 0), document.volume))
    # another file: shown, in its middle
    assert moved.slices.colored and moved.opened(document).slices == Slices(shown=True, colored=True)


def test_one_slice_is_large(tmp_path: Path) -> None:
    """By a double click, or one after the other by a key; the values are those under the cursor."""
    np.save(tmp_path / "blob.npy", np.arange(8000, dtype=np.float32).reshape(20, 20, 20))
    document = Document.open(SceneFile(str(tmp_path / "blob.npy")))
    state = acted(State.of(document, (120, 80)), "slices", document)
    tool, view = SliceTool(lambda: None), Viewport((400, 300))
    pane = tool.panes(state, document, view)[1]
    at = (pane.box[0] + 5.0, pane.box[1] + 5.0)
    for _ in range(2):
        state = tool.press(state, document, view, Pointer(at, "left")) or state
        tool.release(state, document, view, Pointer(at, "left"))
    (large,) = tool.panes(state, document, view)
    assert large.axis == pane.axis and large.box[3] - large.box[1] > 2 * (pane.box[3] - pane.box[1])
    assert large.room[0] >= 0.35 * 400
    middle, corner = (
        slice_values(state, document, 60, None if place is None else large.point(place))
        for place in (None, (large.box[2] - 1, large.box[3] - 1))
    )
    assert middle != corner
    texts = [len(tool.marks(state, document, view, cursor).labels[-1].pixels) for cursor in (None, at)]
    assert texts[1] > 1.5 * texts[0]
    axes = []
    for _ in range(4):
        state = acted(state, "large-slice", document)
        axes.append(state.slices.large)
    assert set(axes) == {None, 0, 1, 2}


def test_a_linked_crosshair_marks_the_cursor_in_the_others(tmp_path: Path) -> None:
    """And in the picture; what is seen in the picture is marked in all three, unless it is turned off."""
    np.save(tmp_path / "v.npy", np.ones((10, 12, 14), np.float32))
    document = Document.open(SceneFile(str(tmp_path / "v.npy")))
    state, view, tool = State.of(document, (400, 300)), Viewport((400, 300)), SliceTool(lambda: None)
    state = acted(state, "slices", document)

    def marked(state: State, cursor: Place | None, seen: np.ndarray | None = None) -> list[Place]:
        """The centres of crosshairs, of whose lines the cursor's colour is."""
        strokes = [each for each in tool.marks(state, document, view, cursor, seen).strokes if each.color == CURSOR]
        ends = np.array([stroke.start for stroke in strokes]).reshape(-1, 4, 2)
        return [tuple(place) for place in ends.mean(axis=1).tolist()]

    here, *others = tool.panes(state, document, view)
    point = here.point(middle := ((here.box[0] + here.box[2]) / 2 + 7, (here.box[1] + here.box[3]) / 2 - 5))
    seen = project(state.pose.camera, point[None])[0]
    assert np.allclose(marked(state, middle), [*(pane.pixel(point) for pane in others), seen])
    assert np.allclose(marked(state, None, point), [pane.pixel(point) for pane in (here, *others)])
    assert marked(state, None) == [] == marked(acted(state, "linked-crosshair", document), middle, point)


def slice_colors_at(state: State, document: Document, index: tuple[int, int, int]) -> list[int]:
    """sRGB and opacity of the first slice at a voxel."""
    tool, view = SliceTool(lambda: None), Viewport((400, 300))
    pane = tool.panes(state, document, view)[0]
    sprite = next(sprite for sprite in tool.marks(state, document, view).sprites if sprite.place == pane.box)
    point = document.volume.world_from_index @ np.array(index) + np.asarray(document.volume.origin)
    (x, y), (left, top, right, bottom) = pane.pixel(point), sprite.place
    high, wide = sprite.pixels.shape[:2]
    found = sprite.pixels[int((y - top) / (bottom - top) * high), int((x - left) / (right - left) * wide)]
    return [int(part) for part in found]


def test_slices_show_every_visible_layer_as_pictures_of_slices_do(tmp_path: Path) -> None:
    """Amounts add up; a segmentation lies over a volume, which is grey by its window unless colours are asked for."""
    left, upper = np.zeros((2, 8, 8, 8), np.float32)
    left[..., :4], upper[:, 4:] = 1.0, 1.0
    labels = np.zeros((8, 8, 8), np.uint8)
    labels[:, 4:] = 2
    for name, values in (("left", left), ("upper", upper), ("labels", labels)):
        np.save(tmp_path / f"{name}.npy", values)
    ramp = {"points": ((0.0, 0.0), (1.0, 0.5)), "shading": False}
    one, other = (
        SceneFile(str(tmp_path / f"{name}.npy"), transfer={**ramp, "colormap": color})
        for name, color in (("left", "#ff0000"), ("upper", "#00ff00"))
    )
    document = Document.open(replace(one, layers=(other,)))
    state = State.of(document, (300, 300))
    state = replace(state, slices=replace(state.slices, shown=True))
    places = (1, 6, 4), (6, 6, 4), (1, 1, 4), (6, 1, 4)
    found = [slice_colors_at(state, document, place)[:3] for place in places]
    assert found == [[255, 255, 0], [0, 255, 0], [255, 0, 0], [0, 0, 0]]
    alone = state.with_style(0, replace(state.styles[0], visible=False))
    assert [slice_colors_at(alone, document, place)[:3] for place in places] == [[0, 255, 0]] * 2 + [[0, 0, 0]] * 2
    # the values of both at the point
    assert slice_values(state, document, 20) == ("left: 0", "upper: 1") and slice_values(alone, document, 2) == ("1",)
    assert slice_values(state, document, 7) == ("left: 0", "upp…: 1")
    # a segment over a volume, by its opacity times the layer's
    segments = SceneFile(str(tmp_path / "labels.npy"), transfer={"labels": ((2, "#0000ff", 0.5),)}, opacity=0.3)
    red = {**ramp, "colormap": "#ff0000"}
    document = Document.open(replace(one, transfer=red, layers=(segments,), label_fill=1.0))
    state = replace(State.of(document, (300, 300)), slices=replace(state.slices, colored=True))
    share = 0.3 * 0.5 / 0.99
    expected = (srgb_from_linear(np.array([1 - share, 0.0, share])) * 255).round().tolist()
    assert slice_colors_at(state, document, (1, 6, 4))[:3] == expected
    grey = replace(state, slices=replace(state.slices, colored=False))
    assert slice_colors_at(grey, document, (1, 1, 4)) == [255] * 4
    expected = (srgb_from_linear(np.array([1 - share, 1 - share, 1.0])) * 255).round().tolist()
    assert slice_colors_at(grey, document, (1, 6, 4))[:3] == expected


# --- driven -------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def window(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Window]:
    folder = tmp_path_factory.mktemp("slices")
    # values grow along x, y and z by 1, 20 and 400
    values = np.tensordot([400.0, 20.0, 1.0], np.indices((16, 16, 16)), 1).astype(np.float32)
    np.save(folder / "grid.npy", values)
    text = 'volume = "grid.npy"\n[transfer]\npoints = [[3000.0, 0.0], [6400.0, 0.6]]\nwindow = [0.0, 6400.0]\n'
    (folder / "grid.toml").write_text(text)
    found = Window(folder / "grid.toml", folder, size=(400, 300))
    yield found
    found.end()


def test_slices_are_saved_at_the_picture_s_height() -> None:
    """Whatever height the window has by then."""
    picture = sg.Image(np.full((6, 5, 4), 0.5, np.float32), {"blend": "composite"})
    for height in (4, 6, 9):
        both = append_slices(picture, np.full((height, 3, 3), 255, np.uint8)).pixels
        assert both.shape == (6, 8, 4) and (both[:, :5] == 0.5).all() and (both[:height, 5:] == 1).all()
        assert (both[height:, 5:, :3] == 0).all()


@pytest.mark.long
@driven
def test_slices_are_shown_moved_and_hidden(window: Window) -> None:
    before, plain = window.ask("reset"), window.shot()
    told = window.key("z")
    assert told["size"] == [300, 300] and window.shot().shape == plain.shape
    middles = {}
    for number, pane in enumerate(told["panes"]):
        left, top, right, bottom = pane["box"]
        middles[pane["axis"]] = round((left + right) / 2), round((top + bottom) / 2)
        assert number * 100 <= top < bottom <= (number + 1) * 100
    # the wheel moves the slice across z by voxels; the picture is not drawn again, and the view stays
    window.hands("mousemove", *middles[2], "click", 4, "click", 4)
    moved = window.ask("settle")
    assert moved["slices"]["place"][2] == pytest.approx(10.5 / 16) and moved["eye"] == told["eye"]
    # between its lines, a slice is grey by the window
    shot, index = window.shot(), (12, 3, 10)
    left, top, right, bottom = moved["panes"][0]["box"]
    x, y = left + (index[0] + 0.5) / 16 * (right - left), bottom - (index[1] + 0.5) / 16 * (bottom - top)
    grey_of = (400 * index[2] + 20 * index[1] + index[0]) / 6400 * 255
    assert shot[int(y), int(x)].tolist() == pytest.approx([grey_of] * 3, abs=3.0)
    # a click moves the two others, a drag too, which does not turn the view
    window.hands("mousemove", round(x), round(y), "click", 1)
    linked = window.ask("settle")
    assert linked["slices"]["place"] == pytest.approx([12.5 / 16, 3.5 / 16, 10.5 / 16])
    dragged = window.drag(1, middles[1], (middles[1][0] + 30, middles[1][1]))
    assert dragged["slices"]["place"][0] > 0.5 and dragged["axes"] == told["axes"]
    # beside them, the mouse turns the view
    assert window.drag(1, (100, 100), (140, 80))["axes"] != told["axes"]
    assert window.key("shift+z")["slices"]["colored"] and np.ptp(window.shot()[:, 300:].astype(int), axis=2).max() > 20
    # what is seen is saved, with annotations and without, but for the crosshair at the cursor
    assert not window.key("shift+y")["slices"]["linked"]
    for key in ("b", "j"):
        assert window.key(key)["settings"]["blend"] == "xray"
        # but for a handle at the rim of the panes
        shot, name = window.shot(), window.key("s")["message"].split()[-1]
        saved = (sg.Image.load(window.folder / name).over((0.0, 0.0, 0.0)).straight()[..., :3] * 255).round()
        assert saved.shape == shot.shape and np.abs(saved[:, 305:] - shot[:, 305:]).max() <= 1
        assert np.median(np.abs(saved[:200, :300] - shot[:200, :300])) == 0
        # their lines, too, above what is written; edges are blended in linear light, which makes them wider
        # right of the readout
        lines, found = (np.ptp(each[40:140, 150:300].astype(int), axis=2) > 60 for each in (shot, saved))
        assert 0.01 < lines.mean() < found.mean() < 2 * lines.mean() and (lines & ~found).mean() < 1e-3
    # while the window's size changes
    told = window.ask("set", state={"fullscreen": True}, effects=["SAVE_PICTURE"])
    shape = sg.Image.load(window.folder / told["message"].split()[-1]).pixels.shape
    assert told["fullscreen"] and shape == (told["size"][1], window.shot().shape[1], 4)
    window.key("F11")
    window.ask("reset")
    # but for the readout, as the mouse is elsewhere
    differs = (window.shot() != plain).any(axis=2)
    assert not differs[110:].any() and not differs[:, 160:].any() and window.ask("look")["size"] == before["size"]
    name = window.key("s")["message"].split()[-1]
    assert sg.Image.load(window.folder / name).pixels.shape[1] == 400


def shares_of_corners(told: dict[str, Any], sides: float) -> np.ndarray:
    """Places [8, 2] of the corners of a cube of voxels in the picture, from -1 to 1."""
    corners = (np.array(list(np.ndindex(2, 2, 2))) - 0.5) * sides + told["middle"]
    eye = (corners - told["eye"]) @ np.array(told["axes"]).T
    width, height = told["size"]
    return np.asarray(eye[:, :2] / eye[:, 2:] / told["extent"] * 2 * [height / width, 1.0])


@driven
def test_a_view_that_nobody_moved_is_fitted_to_what_is_left_of_the_window(window: Window) -> None:
    before = window.ask("reset")
    narrow = 150
    with resized(window, narrow, 300):
        fitted = window.ask("look")
        assert fitted["eye"] != before["eye"] and 0.7 < np.abs(shares_of_corners(fitted, 14)).max() < 1
        beside = window.key("z")
        assert beside["size"][0] < 100 and np.abs(shares_of_corners(beside, 14)).max() < 1
        assert window.key("z")["eye"] == fitted["eye"]
    assert window.ask("look")["eye"] == before["eye"]
    # a view that somebody moved stays
    moved = window.drag(1, (100, 90), (150, 60))
    assert window.key("z")["eye"] == moved["eye"]
    assert window.key("z")["eye"] == moved["eye"]


@pytest.mark.long
@driven
def test_slices_follow_the_window_and_the_file(window: Window) -> None:
    window.ask("reset")
    window.key("z")
    window.hands("windowsize", "--sync", window.identity, 300, 240)
    assert window.ask("settle")["size"] == [220, 240] and window.shot().shape == (240, 300, 3)
    # a double click on the volume sets the point, too
    window.ask("double", within=300.0)
    window.hands("mousemove", 110, 120, "click", 1, "click", 1)
    told = window.ask("settle")
    assert told["message"] == "turns about this point" and told["slices"]["place"] != [0.5, 0.5, 0.5]
    np.save(window.folder / "other.npy", blob(20).samples)
    assert window.drop(window.folder / "other.npy")["slices"] == {**told["slices"], "place": [0.5, 0.5, 0.5]}
    window.drop(window.folder / "grid.toml")
    window.hands("windowsize", "--sync", window.identity, 400, 300)
    window.ask("settle")


@pytest.mark.long
def test_a_slice_that_cannot_be_read_is_asked_for_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And says so; its pane is empty, where another one's picture would stand under its number."""
    zarr = pytest.importorskip("zarr")
    zarr.save(str(tmp_path / "grid.zarr"), np.zeros((16, 16, 16), np.float32))
    monkeypatch.setattr("splatgl.readers.ome_zarr.WHOLE_BYTES", 1000)
    document = Document.open(SceneFile(str(tmp_path / "grid.zarr"), transfer={"points": ((0.0, 0.0), (1.0, 0.5))}))
    assert not isinstance(document.volume.samples, np.ndarray)
    state = replace(State.of(document, (400, 300)), slices=Slices(shown=True))
    said: list[str] = []
    view = Viewport((400, 300))
    tool, asked = SliceTool(lambda: None), []

    def plane(*given: object) -> None:
        asked.append(given)
        raise KeyError("chunk")

    monkeypatch.setattr("splatgl.geometry.slices.sample_raster", plane)
    for _ in range(8):
        marks = tool.marks(state, document, view)
        assert tool.jobs.wait(300.0)
        said += tool.collect() or ()
    assert len(asked) == 3 == len(said) and "slice cannot be read" in said[0]
    assert not any(each.smooth for each in marks.sprites)
    # nor is it saved, under a number that it has not; once it can be read, it is, after slices were hidden
    with pytest.raises(sg.InputError, match="cannot be read: 'chunk'; hide the slices"):
        tool.complete_marks(state, document, view)
    monkeypatch.undo()
    assert not tool.marks(replace(state, slices=Slices()), document, view)
    assert sum(sprite.smooth for sprite in tool.complete_marks(state, document, view).sprites) == 3 and not tool.failed


@pytest.mark.long
@driven
def test_samples_in_parts_are_read_behind_the_window(tmp_path: Path) -> None:
    zarr = pytest.importorskip("zarr")
    values = np.tensordot([400.0, 20.0, 1.0], np.indices((16, 16, 16)), 1).astype(np.float32)
    zarr.save(str(tmp_path / "grid.zarr"), values)
    # slices are grey by the window of the colours
    scene = SceneFile(
        str(tmp_path / "grid.zarr"), transfer={"points": ((0.0, 0.0), (6315.0, 0.5)), "window": (0.0, 6315.0)}
    )
    (tmp_path / "scene.toml").write_text(scene.to_toml(tmp_path))
    window = Window(tmp_path / "scene.toml", tmp_path, size=(400, 300), whole=1000)
    told = window.key("z")
    left, top, right, bottom = map(round, told["panes"][0]["box"])
    first = window.shot()[top:bottom, left:right].mean()
    window.hands("mousemove", (left + right) // 2, (top + bottom) // 2, "click", 5, "click", 5)
    assert window.ask("settle")["slices"]["place"][2] < told["slices"]["place"][2]
    assert window.shot()[top:bottom, left:right].mean() < first - 3
    # a picture that is saved at once has the slice that it names
    name = window.ask("set", place=[0.5, 0.5, 0.9], effects=["SAVE_PICTURE"])["message"].split()[-1]
    window.ask("settle")
    saved = (sg.Image.load(tmp_path / name).over((0.0, 0.0, 0.0)).straight()[..., :3] * 255).round()
    assert np.abs(saved[top:bottom, left:right] - window.shot()[top:bottom, left:right]).max() <= 1
    window.end()

"""Splats that add up within sheets: their float64 twin, repetition, batches, weights, and the ray integral."""

from __future__ import annotations

from functools import cache, partial
from itertools import pairwise
from typing import Any

import moderngl
import numpy as np
import pytest

import splatgl as sg
from splatgl.gl import quads, sheet_tiles, target, tiles
from splatgl.gl.quads import SheetQuads
from splatgl.gl.target import Interrupted
from splatgl.planning.culling import order_for
from splatgl.reference.field import ray_integral
from splatgl.splat.kernels import KERNELS, depth_deviation, kernel
from splatgl.splat.settings import Technique
from splatgl.splat.sheets import Sheets
from tests.helpers.noise import GRIDS, LOOKS, close_up, inside, views

EXACT = sg.Settings(compositing="sheets", antialias="paper", tolerance=1e-6)
COUNTS = (2, 3, 4)
TECHNIQUES = ("tiles", "quads")


@cache
def matter(grid: str = "cubes", size: int = 9, shading: bool = False, opacity: float = 0.6) -> sg.Splats:
    """Noise; 8:1 is long voxels."""
    cells = np.random.default_rng(3).random((size, size, size))
    placed = {"spacing": (1.0, 1.0, 8.0)} if grid == "8:1" else GRIDS[grid]
    transfer = sg.Transfer([(0.3, 0), (1, opacity)], colormap="hot", shading=shading)
    return sg.extract(sg.Volume(cells, **placed), transfer, classification="pre")


def smooth(size: int = 16) -> np.ndarray:
    """Noise without the highest frequencies, from 0 to 1."""
    cells = np.random.default_rng(5).random((size, size, size))
    for axis in range(3):
        for _ in range(2):
            cells = (np.roll(cells, 1, axis) + 2 * cells + np.roll(cells, -1, axis)) / 4
    return np.asarray((cells - cells.min()) / np.ptp(cells))


def ball(size: int = 16) -> np.ndarray:
    """1 inside, falling to 0 within three voxels."""
    r = np.linalg.norm(np.indices((size, size, size)) - (size - 1) / 2, axis=0)
    return np.clip((size / 2 - 1 - r) / 3, 0, 1)


@cache
def overlapping(name: str) -> sg.Splats:
    """Matter whose kernels overlap on every ray: a cloud as of neurons, and a ball."""
    if name == "cloud":
        return sg.extract(
            sg.Volume(smooth()), sg.Transfer([(0.5, 0), (0.8, 0.8)], colormap="hot"), classification="pre"
        )
    return sg.extract(sg.Volume(ball()), sg.Transfer([(0, 0), (1, 0.7)], colormap="hot"), classification="pre")


def eyes(splats: sg.Splats) -> dict[str, sg.Camera]:
    return views(splats) | {"inside": inside(splats, LOOKS[4])}


def apart(renderer: sg.Renderer, splats: sg.Splats, camera: sg.Camera, settings: sg.Settings) -> float:
    """The largest difference between the picture and its float64 twin, which shows something."""
    found = renderer.render(splats, camera, settings, verify_bound=False).pixels
    right = sg.reference.render(splats, camera, settings).pixels
    assert right[..., 3].max() > 0.1 and np.isfinite(found).all()
    return float(np.abs(found - right).max())


@pytest.mark.turns(2)
@pytest.mark.few(3)
@pytest.mark.parametrize("technique", TECHNIQUES)
@pytest.mark.parametrize(
    ("grid", "view", "count", "changes"),
    [
        ("cubes", "fitted", 2, {}),
        ("cubes", "close", 3, {"antialias": "auto"}),
        ("cubes", "fitted", 4, {"background": (0.2, 0.4, 0.6), "antialias": "supersample", "samples": 2}),
        ("sheared", "inside", 3, {}),
        ("8:1", "parallel", 2, {}),
        ("8:1", "fitted", 3, {"antialias": "off"}),
        # widened, and the matter of a pixel weakened
        ("sheared", "parallel, far", 3, {"attenuation": "fill"}),
        ("cubes", "parallel, far", 2, {"attenuation": "optical-depth"}),
        ("cubes", "close", 3, {"kernel": "gaussian"}),
    ],
    ids=str,
)
def test_the_picture_is_its_twin(
    renderer: sg.Renderer, grid: str, view: str, count: int, changes: dict[str, Any], technique: Technique
) -> None:
    splats = matter(grid)
    camera = eyes(splats)[view]
    settings = EXACT.replace(sheets=count, technique=technique, **changes)
    chosen = renderer.plan(splats, camera, settings)
    assert chosen.resolved.sheets is not None and chosen.program.technique == technique
    assert chosen.program.seen.antialias or "far" not in view
    assert apart(renderer, splats, camera, settings) < 4e-6


@pytest.mark.few(1)
@pytest.mark.parametrize("technique", TECHNIQUES)
def test_pictures_of_light_and_of_widened_splats_are_their_twins(renderer: sg.Renderer, technique: Technique) -> None:
    """In perspective, widening is exact up to 1/z_k²: as far off as splats that composite one by one."""
    lit = matter("sheared", shading=True)
    assert apart(renderer, lit, views(lit)["fitted"], EXACT.replace(sheets=2, technique=technique)) < 4e-6
    splats = matter()
    settings = EXACT.replace(sheets=3, technique=technique)
    one_by_one = apart(renderer, splats, views(splats)["far"], settings.replace(compositing="splats"))
    assert apart(renderer, splats, views(splats)["far"], settings) < min(1.2 * one_by_one, 2e-3)


@pytest.mark.few(1)
def test_by_default_the_error_is_within_the_tolerance(renderer: sg.Renderer) -> None:
    """Polynomials of footprints are off by 4e−5 of them."""
    splats = matter()
    for view in ("parallel", "inside"):
        settings = sg.Settings(compositing="sheets")
        assert apart(renderer, splats, eyes(splats)[view], settings) < 5e-5


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("parts", "changed"),
    [
        ([(tiles, "MOST", 100)], 3e-6),
        ([(tiles, "MOST_LISTED", 800)], 3e-6),
        ([(tiles, "MOST_TILES", 5)], 0),
        ([(sheet_tiles, "MOST_ENTRIES", 16)], 3e-6),
        ([(sheet_tiles, "MOST_PIXELS", 600)], 0),
        ([(sheet_tiles, "MOST_RUN", 3), (sheet_tiles, "LEAST_RUNS", 8)], 0),
        ([(tiles, "MOST", 77), (sheet_tiles, "MOST_ENTRIES", 8), (sheet_tiles, "MOST_PIXELS", 600)], 3e-6),
    ],
    ids=str,
)
def test_batches_draw_the_same(
    renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch, parts: list[tuple[Any, str, int]], changed: float
) -> None:
    """And twice bit for bit; a sum's order of terms may be another."""
    splats = matter()
    for view in ("fitted", "close"):
        camera, settings = eyes(splats)[view], sg.Settings(compositing="sheets", sheets=3, occlusion="off")
        whole = renderer.render(splats, camera, settings, verify_bound=False).pixels
        with monkeypatch.context() as patched:
            for module, name, value in parts:
                patched.setattr(module, name, value)
            found = [renderer.render(splats, camera, settings, verify_bound=False).pixels for _ in range(2)]
        again = renderer.render(splats, camera, settings, verify_bound=False).pixels
        assert (whole == again).all() and (found[0] == found[1]).all()
        assert whole[..., 3].max() > 0.5 and np.abs(whole - found[0]).max() <= changed


@pytest.mark.compute
def test_tiles_end_where_almost_no_light_passes(processor: sg.Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    splats = matter(size=14, opacity=0.99)
    camera = views(splats)["fitted"]
    settings = sg.Settings(compositing="sheets", sheets=3)
    whole = processor.render(splats, camera, settings.replace(occlusion="off"), verify_bound=False).pixels
    cutoff = processor.plan(splats, camera, settings).hiding.cutoff
    listed: list[int] = []
    count = tiles.Lister.count
    monkeypatch.setattr(tiles.Lister, "count", lambda *given: listed.append(given[-1]) or count(*given))
    for most, batches in ((2**20, 1), (200, -(-len(splats) // 100))):
        monkeypatch.setattr(tiles, "MOST", most)
        listed.clear()
        ended = processor.render(splats, camera, settings, verify_bound=False).pixels
        assert 0 < np.abs(ended - whole).max() <= 1.01 * cutoff + 3e-6 and len(listed) == batches


@pytest.mark.parametrize("technique", TECHNIQUES)
def test_an_interrupted_picture_leaves_no_trace(
    renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch, technique: Technique
) -> None:
    splats, settings = matter(), sg.Settings(compositing="sheets", sheets=3, technique=technique)
    other, camera = views(splats)["close"], views(splats)["fitted"]
    right = renderer.render(splats, camera, settings, verify_bound=False).pixels
    monkeypatch.setattr(tiles, "MOST", 50)
    for portion in (0, 1, 3):
        answers = iter([*[False] * portion, True])
        with pytest.raises(Interrupted):
            renderer.render(splats, other, settings, verify_bound=False, interrupted=partial(next, answers))
        with monkeypatch.context() as patched:
            patched.setattr(tiles, "MOST", 2**20)
            assert (renderer.render(splats, camera, settings, verify_bound=False).pixels == right).all()


@pytest.mark.parametrize("count", COUNTS)
def test_quads_leave_out_sheets_without_splats(
    renderer: sg.Renderer, count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Places that nothing reaches for a while, in depth and across the view, and single splats between."""
    rng = np.random.default_rng(count)
    places = np.array([[0, 0, 0], [12, 3, 1], [12, 9, 5], [13, 9, 5], [40, -8, -4]])
    points = (places[:, None] + rng.normal(size=(5, 9, 3)) * [[[1]], [[0]], [[1.5]], [[0.1]], [[1]]]).reshape(-1, 3)
    splats = sg.Splats.from_points(points, rng.random((45, 3)), rng.uniform(0.05, 0.8, 45))
    settings = EXACT.replace(sheets=count, technique="quads", antialias="off")
    sheets: list[int] = []
    close = SheetQuads.close

    def counted(self: SheetQuads, into: moderngl.Framebuffer, sheet: int, join: str | None) -> None:
        sheets.append(sheet)
        close(self, into, sheet, join)

    monkeypatch.setattr(SheetQuads, "close", counted)
    for view in ("fitted", "parallel"):
        camera = eyes(splats)[view]
        chosen = renderer.plan(splats, camera, settings)
        assert chosen.resolved.sheets is not None
        first, _ = chosen.resolved.sheets.range(splats, chosen.view)
        firsts = set(quads.first_sheets(splats, chosen.resolved.sheets, chosen.view, first).tolist())
        sheets.clear()
        assert apart(renderer, splats, camera, settings) < 4e-6
        assert sheets == sorted(set(sheets)) and len(sheets) < sheets[-1] - sheets[0] + 1
        assert {number + n for number in firsts for n in range(count)} == set(sheets)


def test_the_order_of_quads_is_kept_while_the_eye_stays(renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another field of view, size or direction needs no other order; another eye does, and so do other splats."""
    splats, camera = matter(), views(matter())["fitted"]
    settings = EXACT.replace(technique="quads")
    sorted_: list[int] = []
    sort = quads.sort_by_number
    monkeypatch.setattr(quads, "sort_by_number", lambda *given: (sorted_.append(1), sort(*given))[1])
    renderer.free()
    turned = sg.Camera.look_at(camera.eye, splats.corners.mean(axis=0) + 0.3, (0, 0, 1), 25, (20, 28))
    moved = sg.Camera.look_at(camera.eye + 0.3, splats.corners.mean(axis=0), (0, 0, 1), 25, (20, 28))
    for view, drawn, count in (
        (camera, splats, 1),
        (turned, splats, 1),
        (moved, splats, 2),
        (moved, splats.part(np.arange(len(splats)) % 2 == 0), 3),
    ):
        assert apart(renderer, drawn, view, settings) < 2e-4
        assert len(sorted_) == count


def test_without_compute_shaders_quads_draw_sheets(renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    """In portions of any size, bit for bit."""
    splats, camera = matter(), views(matter())["fitted"]
    monkeypatch.setattr(renderer, "tiles", None)
    image = renderer.render(splats, camera, sg.Settings(compositing="sheets"))
    assert (image.info["technique"], image.info["order"], image.info["sheets"]) == ("quads", "front-to-back", 3)
    right = sg.reference.render(splats, camera, sg.Settings(compositing="sheets")).pixels
    assert np.abs(image.pixels - right).max() <= image.info["error_bound"]
    monkeypatch.setattr(target, "FIRST", 7)
    monkeypatch.setattr(target, "GROWTH", 1.0)
    again = renderer.render(splats, camera, sg.Settings(compositing="sheets")).pixels
    assert (again == image.pixels).all()


@pytest.mark.parametrize("name", ["cloud", "ball"])
def test_sheets_are_nearer_to_the_ray_integral(name: str) -> None:
    splats, settings = overlapping(name), sg.Settings(compositing="splats", antialias="off")
    camera = close_up(splats, 30, 20, (48, 48))
    truth = ray_integral(splats, camera).pixels

    def missed(settings: sg.Settings) -> float:
        off = sg.reference.render(splats, camera, settings).pixels - truth
        return float(np.sqrt((off**2).mean()))

    found = [missed(settings.replace(compositing="sheets", sheets=count)) for count in COUNTS]
    one_by_one = missed(settings)
    assert one_by_one > 10 * found[1] and one_by_one > 4 * found[0] and found[0] > found[1] > found[2]
    # no other thickness is much nearer
    assert found[1] < 2e-4


@pytest.mark.few(1)
@pytest.mark.parametrize("name", ["cloud", "ball"])
def test_nothing_pops_where_the_order_s_axis_changes(renderer: sg.Renderer, name: str) -> None:
    splats, settings = overlapping(name), sg.Settings(compositing="splats", antialias="off")
    sides = [sg.Camera.orbit(splats, 45 + off, 0, size=(48, 48)) for off in (-1e-3, 1e-3)]
    assert order_for(splats, sides[0]).axis != order_for(splats, sides[1]).axis
    moved = np.abs(np.subtract(*[ray_integral(splats, side).pixels for side in sides])).max()

    def change(settings: sg.Settings) -> float:
        return float(np.abs(np.subtract(*[renderer.render(splats, side, settings).pixels for side in sides])).max())

    assert change(settings) > 0.02
    assert change(settings.replace(compositing="sheets", sheets=3)) <= moved + 0.003


@pytest.mark.long
def test_nothing_pops_as_the_eye_passes_sheets(renderer: sg.Renderer) -> None:
    splats = overlapping("cloud")
    settings = sg.Settings(antialias="off", compositing="sheets", sheets=2)
    start = sg.Camera.orbit(splats, 30, 20, size=(24, 24))
    chosen = renderer.plan(splats, start, settings).resolved.sheets
    assert chosen is not None
    step = 2 * chosen.thickness / 32
    eyes = [start.eye + start.forward * step * n for n in range(33)]
    path = [sg.Camera.look_at(eye, eye + start.forward, (0, 0, 1), 40, (24, 24)) for eye in eyes]
    found = [renderer.render(splats, camera, settings, verify_bound=False).pixels for camera in path]
    truth = [ray_integral(splats, camera, steps_per_voxel=4).pixels for camera in path]
    for (one, two), (right, then) in zip(pairwise(found), pairwise(truth), strict=True):
        assert np.abs(two - one).max() <= np.abs(then - right).max() + 0.01


@pytest.mark.parametrize("count", COUNTS)
def test_weights_are_a_partition_of_one(count: int) -> None:
    sheets = Sheets.of(kernel("crawfis-max"), count, 0)
    place = np.linspace(-3, 20, 46001)
    base = sheets.base(place)
    weights = sheets.weights(place, base)
    assert np.abs(weights.sum(axis=0) - 1).max() < 1e-12 and weights.min() >= 0
    assert (np.diff(base) >= 0).all()
    # of each sheet over the place: continuous where the base changes
    dense = np.zeros((len(place), 30))
    for j in range(count):
        dense[np.arange(len(place)), base + j + 5] = weights[j]
    assert np.abs(np.diff(dense, axis=0)).max() < 1.01 * (place[1] - place[0])
    # the mean over the sheets, whose middles are half a sheet further, is the place
    middle = (weights * (base + np.arange(count)[:, None])).sum(axis=0)
    assert np.ptp(middle - place) < 1e-12


@pytest.mark.parametrize("name", list(KERNELS))
@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("steps", [0, 2])
def test_sheets_spread_as_far_as_the_kernel(count: int, steps: int, name: str) -> None:
    """Averaged over places, a sheet's box, or the B-spline between points, widens the weights."""
    sheets = Sheets.of(kernel(name), count, steps)
    place = np.linspace(0, 1, 4001)[:-1] + 1e-5
    base = sheets.base(place)
    away = base + np.arange(count)[:, None] - place
    weights = sheets.weights(place, base)
    mean = (weights * away).mean() * count
    spread = (weights * (away - mean) ** 2).sum(axis=0).mean() + (1 / 12 if steps == 0 else 1 / 4)
    assert abs(spread * sheets.thickness**2 - depth_deviation(kernel(name)) ** 2) < 1e-6


def test_depth_deviations_are_the_known_ones() -> None:
    known = {"crawfis-max": 0.4465, "gaussian": 0.4986, "b-spline": np.sqrt(0.3)}
    assert {name: round(depth_deviation(kernel(name)), 4) for name in known} == {
        name: round(value, 4) for name, value in known.items()
    }


def test_the_tolerance_chooses_the_sheets() -> None:
    splats = matter()
    camera = views(splats)["fitted"]
    for tolerance, count in ((0.1, 2), (4e-3, 3), (1e-5, 3)):
        chosen = sg.plan(splats, camera, EXACT.replace(tolerance=tolerance), tiles=True).resolved.sheets
        assert chosen is not None and (chosen.count, chosen.steps) == (count, 0)
    assert "share a splat, classified before" in sg.plan(splats, camera, EXACT.replace(sheets=4), tiles=True).explain()
    # sums and maxima know no order
    for blend in ("xray", "mip"):
        assert sg.plan(splats, camera, EXACT.replace(blend=blend), tiles=True).resolved.sheets is None


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"target": "rgba16f"}, "^sheets: expected what quads can draw, got target rgba16f; composite splats"),
        ({"align": "grid"}, "^sheets: expected what quads can draw, got align grid; composite splats"),
        ({"technique": "quads", "order": "back-to-front"}, "^technique quads: expected .*, got order back-to-front;"),
        ({"attenuation": "opacity"}, "^attenuation: expected optical-depth or fill, which add up within sheets"),
        ({"classification": "post"}, "^classification post: the splats were extracted to be classified before"),
    ],
    ids=str,
)
def test_what_sheets_cannot_draw_is_told(changes: dict[str, Any], said: str) -> None:
    splats = matter()
    with pytest.raises(sg.InputError, match=said) as error:
        sg.plan(splats, views(splats)["fitted"], EXACT.replace(**changes), tiles=True)
    assert "\n" not in str(error.value)


def test_more_sheets_than_can_be_are_told() -> None:
    ends = np.array([[0, 0, 0], [0, 0, 1e5]])
    splats = sg.Splats.from_points(ends, np.ones((2, 3)), np.ones(2))
    chosen = sg.plan(splats, views(splats)["fitted"], EXACT, tiles=True)
    assert chosen.resolved.sheets is None and "sheets left out" in chosen.explain()


@pytest.mark.parametrize("change", [{"sheets": 1}, {"sheets": 5}, {"steps": 0}, {"steps": 9}, {"compositing": "x"}])
def test_settings_of_sheets_out_of_range(change: dict[str, Any]) -> None:
    (name,) = change
    with pytest.raises(sg.InputError, match=f"^{name}: expected") as error:
        sg.Settings(**change)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("technique", ["tiles", "quads"])
def test_what_was_released_is_made_again(renderer: sg.Renderer, technique: Technique) -> None:
    splats = matter()
    camera, settings = views(splats)["fitted"], sg.Settings(compositing="sheets", technique=technique)
    first = renderer.render(splats, camera, settings).pixels
    renderer.passes.release()
    assert first.max() > 0.1 and (renderer.render(splats, camera, settings).pixels == first).all()

"""Values classified after reconstruction: their float64 twin, batches, extraction, the table, and what is refused."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.gl import sheet_tiles, tiles
from splatgl.gl.quads import first_sheets
from splatgl.planning.culling import tiles_beside_box
from splatgl.planning.scene import resolve_scene
from splatgl.reference.rays import Bounds, Rays, pixel_slopes
from splatgl.reference.renderer import render_pixels
from splatgl.scene.view import ViewOptions
from splatgl.splat import extract_values, prefilter
from splatgl.splat.kernels import kernel
from splatgl.splat.motion import Motion
from splatgl.splat.settings import Technique
from splatgl.transfer.preintegration import CELLS, ClassIntegral, ValueClassifier, opaque_intervals
from tests.helpers.noise import GRIDS, LOOKS, inside, views

pytestmark = pytest.mark.usefixtures("shared_programs")

EXACT = sg.Settings(tolerance=1e-6, antialias="off")
RAMP = sg.Transfer([(0.45, 0), (0.6, 0.8)], colormap="hot", shading=True)


@cache
def cells(size: int = 10) -> np.ndarray:
    """Noise, smoothed once along each axis."""
    found = np.random.default_rng(2).random((size, size, size))
    for axis in range(3):
        found = (np.roll(found, 1, axis) + 2 * found + np.roll(found, -1, axis)) / 4
    return found


@cache
def matter(grid: str = "cubes", shading: bool = True, kernel: str = "b-spline") -> sg.Splats:
    placed = {"spacing": (1.0, 1.0, 8.0)} if grid == "8:1" else GRIDS[grid]
    transfer = sg.Transfer(RAMP.points, colormap="hot", shading=shading)
    return sg.extract(sg.Volume(cells(), **placed), transfer, classification="post", kernel=kernel)


def eyes(splats: sg.Splats) -> dict[str, sg.Camera]:
    return views(splats) | {"inside": inside(splats, LOOKS[4])}


def drawn(splats: sg.Splats, settings: sg.Settings = EXACT) -> np.ndarray:
    """The float64 picture from outside."""
    return sg.reference.render(splats, sg.Camera.orbit(splats, 30, 20, size=(32, 24)), settings).pixels


def differences(renderer: sg.Renderer, splats: sg.Splats, camera: sg.Camera, settings: sg.Settings) -> np.ndarray:
    """Of the picture to its twin, which shows something."""
    found = renderer.render(splats, camera, settings, verify_bound=False).pixels
    right = sg.reference.render(splats, camera, settings).pixels
    assert right[..., 3].max() > 0.1 and np.isfinite(found).all()
    return np.abs(found - right)


@pytest.mark.turns(2)
@pytest.mark.few(1)
@pytest.mark.parametrize("technique", ["tiles", "quads"])
@pytest.mark.parametrize(
    ("grid", "view", "count", "steps", "changes"),
    [
        ("cubes", "fitted", 2, 1, {"kernel": "b-spline", "antialias": "supersample", "samples": 2}),
        ("sheared", "close", 3, 2, {"background": (0.2, 0.4, 0.6)}),
        ("8:1", "fitted", 4, 2, {}),
        ("8:1", "parallel", 2, 2, {"shading": "off"}),
        ("sheared", "parallel, close", 3, 1, {}),
        ("cubes", "inside", 3, 3, {"antialias": "auto"}),
    ],
    ids=str,
)
def test_the_picture_is_its_twin(
    renderer: sg.Renderer, grid: str, view: str, count: int, steps: int, changes: dict[str, Any], technique: Technique
) -> None:
    splats = matter(grid)
    settings = EXACT.replace(sheets=count, steps=steps, technique=technique, **changes)
    chosen = renderer.plan(splats, eyes(splats)[view], settings)
    assert chosen.program.technique == technique and chosen.program.appearance.steps == steps
    assert chosen.program.appearance.shading == (settings.shading == "auto") and chosen.kernel.name == "b-spline"
    assert differences(renderer, splats, eyes(splats)[view], settings).max() < 1e-4


@pytest.mark.few(1)
@pytest.mark.parametrize("count", [2, 3, 4])
def test_quads_composite_what_lies_behind_a_gap(renderer: sg.Renderer, count: int) -> None:
    """Nothing of the sheets before it is left, and the last segment of the nearer part is drawn."""
    found = np.concatenate([cells(), cells()[::-1], cells()])
    splats = sg.extract(sg.Volume(found), RAMP, classification="post")
    # cut off where it is opaque
    depth = splats.positions[:, 2]
    splats = splats.part((depth < 8) | (depth > 22))
    middle = splats.corners.mean(axis=0)
    side = sg.Camera.look_at(middle + np.array([3.0, 4.0, 36.0]), middle, (0, 1, 0), 30, (40, 30))
    settings = EXACT.replace(sheets=count, steps=2, technique="quads")
    for camera in (side, side.parallel(splats)):
        chosen = renderer.plan(splats, camera, settings)
        assert chosen.resolved.sheets is not None
        assert np.diff(np.unique(first_sheets(splats, chosen.resolved.sheets, chosen.view, 0))).max() > count + 1
        assert differences(renderer, splats, camera, settings).max() < 1.5e-4


@pytest.mark.long
def test_widened_kernels_are_their_twin_s(renderer: sg.Renderer) -> None:
    """Values are means: no form of attenuation changes them. In perspective widening is exact up to 1/z_k²."""
    splats = matter()
    for view, allowed in (("parallel, far", 4e-5), ("far", 2e-3)):
        settings = EXACT.replace(antialias="paper", sheets=2, steps=1)
        for name in ("fill", "auto"):
            chosen = renderer.plan(splats, eyes(splats)[view], settings.replace(attenuation=name))
            assert chosen.program.seen.antialias and chosen.program.appearance.attenuation == "optical-depth"
        assert differences(renderer, splats, eyes(splats)[view], settings).max() < allowed


@pytest.mark.few(2)
@pytest.mark.parametrize("tolerance", [2e-3, 1 / 255, 0.01, 4 / 255, 8 / 255])
@pytest.mark.compute
def test_the_error_is_of_the_tolerance_s_size(renderer: sg.Renderer, tolerance: float) -> None:
    """A polynomial whose error is 4e−5, or 4e−4, of a footprint's peak weighs values; single pixels are off by more."""
    splats, settings = matter(), sg.Settings(sheets=2, steps=1, tolerance=tolerance)
    chosen = renderer.plan(splats, eyes(splats)["fitted"], settings)
    assert chosen.program.footprint == ("single" if tolerance > 3e-3 else "polynomial")
    off = differences(renderer, splats, eyes(splats)["fitted"], settings)
    assert off.max() < 2 * tolerance and np.sqrt((off**2).mean()) < 0.25 * tolerance


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("grid", "view", "changes"),
    [
        ("cubes", "inside", {}),
        ("sheared", "close", {"shading": "off"}),
        ("8:1", "parallel", {}),
        ("cubes", "fitted", {"gradient": [(0.02, 0), (0.1, 1)]}),
    ],
    ids=str,
)
@pytest.mark.compute
def test_packed_splats_are_their_twins(renderer: sg.Renderer, grid: str, view: str, changes: dict[str, Any]) -> None:
    """As they are drawn by default: gradients in fewer bits, kernels in fewer tiles, integrals from the eye on."""
    transfer = replace(RAMP, gradient=changes.get("gradient", ()))
    placed = {"spacing": (1.0, 1.0, 8.0)} if grid == "8:1" else GRIDS[grid]
    splats = sg.extract(sg.Volume(cells(), **placed), transfer, classification="post")
    settings = sg.Settings(antialias="off", technique="tiles", shading=changes.get("shading", "auto"))
    chosen = renderer.plan(splats, eyes(splats)[view], settings).program
    assert (
        chosen.packed
        and chosen.seen.half_line == (view == "inside")
        and chosen.appearance.weighted == ("gradient" in changes)
    )
    off = differences(renderer, splats, eyes(splats)[view], settings)
    assert off.max() < 5e-4 and np.sqrt((off**2).mean()) < 5e-5


@pytest.mark.long
@pytest.mark.parametrize(
    ("portions", "changed"),
    [
        ([(tiles, "MOST", 100)], 1e-5),
        ([(tiles, "MOST_LISTED", 1500)], 1e-5),
        ([(sheet_tiles, "MOST_ENTRIES", 16)], 1e-5),
        ([(sheet_tiles, "MOST_PIXELS", 600)], 0),
        ([(sheet_tiles, "MOST_RUN", 3), (sheet_tiles, "LEAST_RUNS", 8)], 0),
    ],
    ids=str,
)
def test_batches_draw_the_same(
    renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch, portions: list[tuple[Any, str, int]], changed: float
) -> None:
    splats = matter()
    for view in ("fitted", "close"):
        camera, settings = eyes(splats)[view], EXACT.replace(sheets=3, steps=1, occlusion="off")
        whole = renderer.render(splats, camera, settings).pixels
        with monkeypatch.context() as patched:
            for module, name, value in portions:
                patched.setattr(module, name, value)
            parts = [renderer.render(splats, camera, settings).pixels for _ in range(2)]
        assert (whole == renderer.render(splats, camera, settings).pixels).all() and (parts[0] == parts[1]).all()
        assert whole[..., 3].max() > 0.5 and np.abs(whole - parts[0]).max() <= changed


@pytest.mark.long
def test_batches_draw_the_same_where_a_tile_is_two_subgroups() -> None:
    """As on processors without AVX: half of a tile's columns may end before the others, and go on with them."""
    narrow = {"LP_NATIVE_VECTOR_WIDTH": "128", "MESA_SHADER_CACHE_DISABLE": "true"}
    files = [str(Path(__file__).with_name(name)) for name in ("test_post_classification.py", "test_one_value.py")]
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-k"]
    wanted = "batches_draw_the_same and (100 or mean)"
    done = subprocess.run([*command, wanted, *files], env=os.environ | narrow, capture_output=True, text=True)
    assert done.returncode == 0 and "2 passed" in done.stdout, done.stdout[-2000:]


@pytest.mark.few(1)
@pytest.mark.parametrize("points", [RAMP.points, [(0.4, 0), (0.45, 0.5), (0.5, 0)], [(0.4, 0.3), (0.5, 0)]], ids=str)
@pytest.mark.compute
def test_transparent_sheets_are_passed_over(
    renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch, points: list[tuple[float, float]]
) -> None:
    """Bit for bit what classifying them gives; a narrower range of places would show."""
    splats = sg.extract(sg.Volume(cells()), sg.Transfer(points), classification="post-all")
    seen, camera = splats.post.seen, eyes(splats)["fitted"]
    pictures = []
    for low, high in (seen, (-np.inf, np.inf), (seen[0] + CELLS / 3, seen[1] - CELLS / 3)):
        with monkeypatch.context() as patched:
            patched.setitem(vars(splats.post), "seen", (low, high))
            pictures.append(renderer.render(splats, camera, EXACT).pixels)
    assert (pictures[0] == pictures[1]).all() and np.abs(pictures[0] - pictures[2]).max() > 0.01
    # the table's outermost cells with any matter are within
    matter = np.flatnonzero(np.diff(splats.post.table[0][:, 3].astype(int)) != 0)
    assert seen[0] <= matter[0] and matter[-1] + 1 <= seen[1]


@pytest.mark.long
@pytest.mark.parametrize("grid", ["cubes", "8:1"])
@pytest.mark.compute
def test_what_lies_beside_the_box_is_passed_over(
    renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch, grid: str
) -> None:
    """Kernels reach beyond the box, rays do not: tiles beside it are not listed, and the same bits are drawn."""
    splats, listed = matter(grid), []
    count, right = tiles.Lister.count, tiles_beside_box
    monkeypatch.setattr(tiles.Lister, "count", lambda *given: listed.append(count(*given)) or listed[-1])
    for name, camera in eyes(splats).items():
        pictures, entries = [], []
        for beside in (right, lambda *_: np.zeros(1, bool)):
            listed.clear()
            monkeypatch.setattr(sheet_tiles, "tiles_beside_box", beside)
            pictures.append(renderer.render(splats, camera.resized((192, 144)), EXACT).pixels)
            entries.append(sum(len(found) for found in listed if found is not None))
        assert (pictures[0] == pictures[1]).all() and pictures[0].max() > 0.1
        assert entries[0] < entries[1] if name == "fitted" else entries[0] <= entries[1]


def test_another_transfer_function_is_drawn(renderer: sg.Renderer) -> None:
    """The table that a renderer keeps is that of the splats drawn."""
    splats = matter()
    camera = eyes(splats)["fitted"]
    other = splats.with_classifier(splats.post.with_transfer(sg.Transfer([(0.5, 0), (0.55, 0.3)], colormap="viridis")))
    settings = EXACT.replace(sheets=2, steps=1)
    first = renderer.render(splats, camera, settings).pixels
    assert differences(renderer, other, camera, settings).max() < 4e-5
    assert (renderer.render(splats, camera, settings).pixels == first).all()


@pytest.mark.parametrize("kernel", ["b-spline", "crawfis-max"])
def test_slabs_do_not_matter(kernel: str) -> None:
    holes = np.where(np.random.default_rng(1).random((9, 8, 7)) < 0.1, np.nan, cells()[:9, :8, :7])
    for values in (holes, cells()):
        found = [
            sg.extract(sg.Volume(values), RAMP, slab=slab, classification="post", kernel=kernel)
            for slab in (None, 1, 3)
        ]
        assert len(found[0]) > 100 and len({splats.records.tobytes() for splats in found}) == 1


@pytest.mark.parametrize("kernel", ["b-spline", "crawfis-max"])
def test_the_voxels_kept_suffice(kernel: str, monkeypatch: pytest.MonkeyPatch) -> None:
    r = np.linalg.norm(np.indices((20, 20, 20)) - 9.5, axis=0)
    volume = sg.Volume(1 / (1 + np.exp((r - 5) / 0.8)))
    few = sg.extract(volume, RAMP, classification="post", kernel=kernel)
    monkeypatch.setattr(extract_values, "select_needed", lambda u, *_: (np.ones(u.shape, bool),) * 2)
    every = sg.extract(volume, RAMP, classification="post", kernel=kernel)
    assert len(few) < 0.5 * len(every) == 0.5 * volume.samples.size
    camera = sg.Camera.orbit(volume, 30, 20, size=(32, 24))
    pictures = [sg.reference.render(splats, camera, EXACT).pixels for splats in (few, every)]
    assert pictures[1].max() > 0.5 and np.abs(pictures[0] - pictures[1]).max() < 1e-3


def test_lean_splats_draw_nearly_the_same(renderer: sg.Renderer) -> None:
    """A picture in motion is not off by leaving out the voxels that only the rims of kernels need."""
    r = np.linalg.norm(np.indices((20, 20, 20)) - 9.5, axis=0)
    volume = sg.Volume(1 / (1 + np.exp((r - 5) / 0.8)))
    every = sg.extract(volume, RAMP, classification="post")
    lean = sg.extract(volume, RAMP, classification="post-lean")
    assert 0.5 * len(every) < len(lean) < 0.95 * len(every)
    assert set(lean.records["position"].view("u2,u2,u2").ravel().tolist()) < set(
        every.records["position"].view("u2,u2,u2").ravel().tolist()
    )
    camera = sg.Camera.orbit(every, 30, 20, size=(120, 90))
    apart = renderer.render(lean, camera).pixels - renderer.render(every, camera).pixels
    assert 0 < np.sqrt((apart**2).mean()) < 1 / 255


def test_records_do_not_depend_on_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the volume, of what is smoothed at a time, of the records filled at a time."""
    holes = cells().copy()
    holes[3:6, 4:7, 5:8] = np.nan
    right = sg.extract(sg.Volume(holes), RAMP, classification="post").records.tobytes()
    monkeypatch.setattr(prefilter, "PLANES", 3)
    monkeypatch.setattr(prefilter, "LEAST_ROWS", 2)
    monkeypatch.setattr(prefilter, "BLOCK_VOXELS", 1)
    monkeypatch.setattr(extract_values, "RECORDS", 37)
    for slab in (None, 1, 4):
        assert sg.extract(sg.Volume(holes), RAMP, slab=slab, classification="post").records.tobytes() == right


def test_boxes_of_sparse_voxels_give_the_records_of_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    """Coefficients of few voxels are computed in small boxes around them, with the same bits, and in fewer voxels."""
    samples = np.zeros((24, 30, 40), np.float32)
    samples[2:4, 3, 5:9], samples[17, 22:, 30:], samples[20, 1, 38] = 0.7, 0.9, 0.4
    volume, filtered = sg.Volume(samples), list[int]()
    right = prefilter.prefilter
    monkeypatch.setattr(prefilter, "prefilter", lambda u, kernel: filtered.append(u.size) or right(u, kernel))
    found = [sg.extract(volume, RAMP, classification="post").records.tobytes()]
    boxes, small = len(filtered), sum(filtered)
    monkeypatch.setattr(prefilter, "DENSE", 0.0)
    found.append(sg.extract(volume, RAMP, classification="post").records.tobytes())
    assert found[0] == found[1] and boxes > 1 and small < 0.7 * filtered[-1]


def test_values_of_any_size_draw_the_same() -> None:
    right = drawn(matter())
    for scale, offset, allowed in ((1e38, 0.0, 1e-9), (1e-38, 0.0, 1e-9), (1.0, 1e9, 1e-4)):
        points = [(value * scale + offset, share) for value, share in RAMP.points]
        transfer = sg.Transfer(points, colormap="hot", shading=True)
        splats = sg.extract(sg.Volume(cells() * scale + offset), transfer, classification="post")
        assert np.isfinite(splats.records["value"]).all()
        assert np.abs(drawn(splats) - right).max() < allowed


@pytest.mark.long
def test_missing_voxels_are_left_out(renderer: sg.Renderer) -> None:
    holes = cells().copy()
    holes[3:6, 4:7, 5:8], holes[0, 0, 0] = np.nan, np.inf
    splats = sg.extract(sg.Volume(holes), RAMP, classification="post")
    held = splats.positions.astype(int)
    assert len(splats) == len(matter()) - 28
    assert np.isfinite(holes[held[:, 2], held[:, 1], held[:, 0]]).all()
    assert np.isfinite(splats.records["gradient"]).all()
    assert differences(renderer, splats, eyes(splats)["fitted"], EXACT.replace(sheets=2, steps=1)).max() < 4e-5


@pytest.mark.few(1)
@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 10, 10), (10, 1, 1), (2, 2, 2)], ids=str)
def test_thin_volumes(renderer: sg.Renderer, shape: tuple[int, int, int]) -> None:
    volume = sg.Volume(cells()[tuple(slice(side) for side in shape)] * 0.2 + 0.5)
    splats = sg.extract(volume, RAMP, classification="post")
    camera = sg.Camera.orbit(volume, 30, 20, size=(32, 24))
    assert differences(renderer, splats, camera, EXACT.replace(sheets=2, steps=1)).max() < 1e-4


def test_nothing_opaque_is_an_empty_picture(renderer: sg.Renderer) -> None:
    splats = sg.extract(sg.Volume(cells() * 0.1), RAMP, classification="post")
    camera = eyes(matter())["fitted"]
    assert len(splats) == 0 and (renderer.render(splats, camera).pixels == 0).all()
    assert (sg.reference.render(splats, camera).pixels == 0).all()


@pytest.mark.parametrize(
    "points", [[(0.45, 0), (0.55, 1)], [(0.5, 0), (0.5, 1)], [(0.5, 0.4)], [(0.5, 0), (0.52, 0.6), (0.54, 0)]], ids=str
)
def test_steep_and_constant_transfer_functions(renderer: sg.Renderer, points: list[tuple[float, float]]) -> None:
    splats = sg.extract(sg.Volume(cells()), sg.Transfer(points, colormap="hot"), classification="post")
    settings = EXACT.replace(sheets=2, steps=1)
    # a step within one entry of the table is a ramp there
    assert differences(renderer, splats, eyes(splats)["fitted"], settings).max() < 5e-3


@pytest.mark.turns(2)
@pytest.mark.few(1)
@pytest.mark.parametrize("width", [3.0, 1.0, 1e-2, 1e-6])
@pytest.mark.parametrize("view", ["along", "oblique"])
@pytest.mark.parametrize("steps", [1, 3])
def test_no_spike_is_passed_over(renderer: sg.Renderer, steps: int, view: str, width: float) -> None:
    """Values rise by 1 per voxel: however narrow a spike is, and wherever it lies between two sheets, a ray that
    crosses it gathers its area over the slope of the values along the ray, to two per cent in these views.
    """
    z = np.indices((24, 12, 12))[0].astype(float)
    camera = sg.Camera.orbit(sg.Volume(z), 90, 90, size=(9, 9), zoom=3) if view == "along" else None
    view_options = ViewOptions((9, 9), azimuth=40, elevation=60, zoom=3, fit="0.3")
    camera = camera or view_options.camera(sg.Volume(z), sg.Volume(z))
    camera = camera.parallel(sg.Volume(z))
    slope = abs(camera.forward[2])
    for middle in (11.0, 11.37, 12.81):
        points = [(middle - width, 0), (middle, 0.6), (middle + width, 0)]
        transfer = sg.Transfer(points, unit=width, shading=False)
        at = (np.arange(20000) + 0.5) / 20000
        area = transfer.extinction(0.6 * at, width).mean() * 2 * width
        splats = sg.extract(sg.Volume(z), transfer, classification="post")
        alpha = renderer.render(splats, camera, EXACT.replace(steps=steps)).pixels[3:6, 3:6, 3]
        assert np.abs(alpha + np.expm1(-area / slope)).max() < 0.015, middle
        right = render_pixels(resolve_scene(splats, camera, EXACT.replace(steps=steps)), np.array([30, 40, 50]))
        assert np.abs(np.diag(alpha) - right[:, 3]).max() < 1e-5


@pytest.mark.long
@pytest.mark.parametrize("technique", ["tiles", "quads"])
def test_gradients_weigh_opacities(renderer: sg.Renderer, technique: Technique) -> None:
    """The twin's picture; where values rise evenly, the weight of their slope."""
    transfer = sg.Transfer(RAMP.points, gradient=[(0.02, 0), (0.1, 1)], colormap="hot")
    splats = sg.extract(sg.Volume(cells(), **GRIDS["sheared"]), transfer, classification="post")
    camera, settings = eyes(splats)["fitted"], EXACT.replace(sheets=2, steps=2, technique=technique)
    assert differences(renderer, splats, camera, settings).max() < 1e-4
    plain = splats.with_classifier(splats.post.with_transfer(replace(transfer, gradient=())))
    assert np.abs(drawn(splats) - drawn(plain)).max() > 0.1
    volume = sg.Volume(np.indices((24, 12, 12))[0] * 0.5, spacing=(2.0, 2.0, 2.0))
    ray = sg.Camera.orthographic((11.3, 10.7, -9), (11.3, 10.7, 0), (0, 1, 0), 0.5, (1, 1))
    points, lengths = [(3.0, 0.0), (3.0, 0.1)], (23.5 - 6) * 2
    for weight in (1.0, 0.25, 1e-3, 0.0):
        slope = sg.Transfer(points, unit=2.0, gradient=[(0.0, 0.0), (0.25, weight), (9, 0)], shading=False)
        splats = sg.extract(volume, slope, classification="post")
        alpha = renderer.render(splats, ray, settings).pixels[0, 0, 3]
        assert abs(np.log1p(-alpha) - np.log1p(-0.1 * weight) * lengths / 2) <= 0.05 * weight


def test_means_of_classes() -> None:
    """Between any two values, across steps and spikes, as sums of many small parts; and beyond the ends."""
    points = [(0, 0.1), (2, 0.5), (2, 0), (5, 0), (5.001, 0.9), (5.002, 0), (9, 0.3), (9, 0.7)]
    transfer = sg.Transfer(points, colormap="hot", window=(0, 10))
    integral = ValueClassifier.of(transfer, "b-spline", (9, 9, 9)).integral
    for first, last in ((1.5, 2.5), (4.9, 5.1), (5.0004, 5.0011), (-3, -1), (8, 14), (14, 8), (3, 3), (6.2, 6.2000001)):
        at = first + (last - first) * (np.arange(400_000) + 0.5) / 400_000
        extinction = transfer.extinction(transfer.opacity(at), 1.0)[:, None]
        right = np.concatenate([transfer.color(at) * extinction, extinction], axis=1).mean(axis=0)
        found = integral.mean(np.array([first]), np.array([last]))[0]
        assert np.abs(found - right).max() < 2e-4 * max(right.max(), 0.01), (first, last)


def test_intervals_of_opacity() -> None:
    def found(*points: tuple[float, float]) -> list[list[float]]:
        return opaque_intervals(sg.Transfer(list(points))).tolist()

    # ends of zero opacity are not in them
    (first, below), (above, last) = found((1, 0), (1, 0.5), (2, 0), (3, 0), (4, 0.1))
    assert (first, last) == (1, np.inf) and 2 - 1e-14 < below < 2 and 3 < above < 3 + 1e-14
    ((first, last),) = found((0, 0.5), (1, 0))
    assert first == -np.inf and 1 - 1e-15 < last < 1 and found((0, 0.2)) == [[-np.inf, np.inf]]
    assert found((0, 0), (1, 0)) == []


@pytest.mark.parametrize("empty", [0, 255, 7, -1e9, 1e-280], ids=str)
def test_samples_where_a_ramp_begins_are_left_out(empty: float) -> None:
    samples = np.full((9, 9, 9), float(empty))
    samples[4, 4, 4] = empty + (1e-3 if abs(empty) < 1 else 300 * abs(empty))
    up = sg.extract(sg.Volume(samples), sg.Transfer([(empty, 0), (float(samples.max()), 0.5)]), classification="post")
    assert 27 <= len(up) <= 125
    down = sg.Transfer([(-float(samples.max()), 0.5), (-empty, 0)])
    assert len(sg.extract(sg.Volume(-samples), down, classification="post")) == len(up)


def test_which_transfer_functions_the_records_serve() -> None:
    post = ValueClassifier.of(sg.Transfer([(10, 0), (20, 0.5), (30, 0), (50, 0), (60, 1)]), "b-spline", (9, 9, 9))
    for points, served in (
        ([(10, 0), (15, 1), (30, 0)], True),
        ([(12, 0), (14, 0.1), (28, 0), (55, 0), (1e3, 1)], True),
        ([(10, 0), (60, 0)], True),
        ([(9, 0), (15, 1), (30, 0)], False),
        ([(10, 0), (15, 1), (31, 0)], False),
        ([(10, 0), (60, 1)], False),
        ([(10, 1), (15, 0)], False),
        # beyond the largest record value, and finer than float32 resolves it
        ([(50, 0), (1e9, 1)], False),
        ([(20, 0), (20.001, 1), (20.002, 0)], False),
    ):
        transfer = sg.Transfer(points)
        assert post.holds(transfer) is served, points
        # what is kept stays, whatever is drawn in between
        assert post.with_transfer(sg.Transfer([(15, 0), (16, 1), (17, 0)])).holds(transfer) is served
    assert post.is_current and post.with_transfer(replace(post.transfer, colormap="hot")).is_current
    assert not post.with_transfer(sg.Transfer([(10, 0), (15, 1), (30, 0)])).is_current


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"blend": "mip"}, "^blend mip takes all voxels, classified after reconstruction"),
        ({"footprint": "table"}, "^sheets: expected what quads can draw, got footprint table"),
        ({"classification": "pre"}, "^classification pre: the splats were extracted to be classified after"),
        ({"kernel": "gaussian"}, "^kernel: expected auto or b-spline, got gaussian; extract the volume for that"),
    ],
    ids=str,
)
def test_what_cannot_be_classified_after_is_told(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(sg.InputError, match=said) as error:
        sg.plan(matter(), eyes(matter())["fitted"], sg.Settings(**changes), tiles=True)
    assert "\n" not in str(error.value)


def test_what_extraction_refuses(renderer: sg.Renderer) -> None:
    volume = sg.Volume(cells(), color=np.zeros((*cells().shape, 3), np.uint8))
    for asked, given, said in (
        (sg.Volume(cells()), {"threshold": 0.1}, "only classification pre is possible, because of threshold"),
        (volume, {}, "only classification pre is possible, because of colours of its own"),
        (sg.Volume(cells()), {"kernel": "box"}, "^kernel: expected"),
        (
            sg.Volume(cells()),
            {"classification": "after"},
            "^classification: expected auto, pre, post, post-all, post-max or post-lean, got 'after'$",
        ),
    ):
        with pytest.raises(sg.InputError, match=said) as error:
            sg.extract(asked, RAMP, **{"classification": "post", **given})  # type: ignore[call-overload]
        assert "\n" not in str(error.value)
    moves = Motion(velocity=(0.1, 0, 0))
    with pytest.raises(sg.InputError, match=r"^streaks take splats that are classified before"):
        renderer.render(matter(), eyes(matter())["fitted"], sg.Settings(motion="exact"), moves)


@pytest.mark.long
def test_the_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    np.save("noise.npy", cells().astype(np.float32))
    asked = ["render", "noise.npy", "--points", "0.45:0,0.6:0.8", "--size", "32"]
    assert main([*asked, "--classification", "post", "--sheets", "2", "--steps", "2", "-o", "post.npy"]) == 0
    assert main([*asked, "--classification", "pre", "-o", "sheets.npy"]) == 0
    assert main([*asked, "--compositing", "splats", "-o", "splats.npy"]) == 0
    post, sheets, splats = (np.load(f"{name}.npy") for name in ("post", "sheets", "splats"))
    assert post[..., 3].max() > 0.5 and np.abs(post - splats).max() > 0.05 and np.abs(sheets - splats).max() > 1e-3


def test_another_transfer_function_uploads_no_records(renderer: sg.Renderer) -> None:
    splats = matter()
    assert splats.post is not None
    camera = views(splats)["fitted"]
    renderer.render(splats, camera, EXACT)
    before = renderer.passes.device.splats.of(splats)
    cold = sg.Transfer([(0.45, 0), (0.6, 0.3)], colormap="viridis", unit=2.0, shading=False)
    recolored = splats.with_classifier(splats.post.with_transfer(cold))
    image = renderer.render(recolored, camera, EXACT)
    assert renderer.passes.device.splats.of(recolored) is before
    anew = sg.extract(sg.Volume(cells(), **GRIDS["cubes"]), cold, classification="post")
    chosen = [renderer.plan(drawn, camera, EXACT) for drawn in (splats, recolored)]
    assert chosen[0].program == replace(chosen[1].program, appearance=chosen[0].program.appearance)
    assert (recolored.unit, recolored.shaded) == (anew.unit, anew.shaded) == (2.0, False)
    assert np.abs(image.pixels - renderer.render(anew, camera, EXACT).pixels).max() < 1e-5
    assert image.info["classification"] == "post" and (image.info["sheets"], image.info["steps"]) == (3, 3)


@pytest.mark.few(2)
@pytest.mark.parametrize("points", [[(0, 0), (100, 1), (200, 0.2)], [(0, 0), (100, 1)], [(0, 0), (77.7, 1), (200, 0)]])
def test_flat_matter_at_a_point_of_opacity_1_is_opaque(
    renderer: sg.Renderer, points: list[tuple[float, float]]
) -> None:
    """A closed form, through the corners of a box, where rays are short: means over the cell beside the point were off
    by up to 0.18.
    """
    value = next(value for value, opacity in points if opacity == 1)
    transfer = sg.Transfer(points, shading=False)
    splats = sg.extract(sg.Volume(np.full((4, 4, 4), value)), transfer)
    camera = sg.Camera.orthographic((-5, -5, 8.0), (1.5, 1.5, 1.5), (0, 0, 1), 8.5, (24, 24))
    chosen = renderer.plan(splats, camera, sg.Settings(antialias="off"))
    slopes = pixel_slopes(np.arange(24 * 24), chosen.resolved.camera, chosen.view.pitch)
    rays = Rays.of(chosen.view, chosen.resolved.camera, Bounds.of_voxels((4, 4, 4)), slopes)
    right = -np.expm1(-24 * np.log(2) * (rays.far - rays.near) * rays.stretch).reshape(24, 24)
    for picture in (
        sg.reference.render(splats, camera, sg.Settings(antialias="off")),
        renderer.render(splats, camera, sg.Settings(antialias="off"), verify_bound=False),
    ):
        assert right.max() > 0.9 and np.abs(picture.pixels[..., 3] - right).max() < 1e-3
    # and of values that pass the point, the mean is as before
    integral = ClassIntegral.of(transfer, 0, points[-1][0], 2**14)
    at = (np.arange(2**18) + 0.5) / 2**18 * points[-1][0]
    mean = transfer.extinction(transfer.opacity(at), 1.0).mean()
    assert abs(integral.mean(np.zeros(1), np.array([points[-1][0]]))[0, 3] / mean - 1) < 2e-3


def test_means_of_values_close_together_keep_their_digits() -> None:
    """Beside every knot, and beyond the ends, in either order: the mean of one opacity is its extinction."""
    integral = ClassIntegral.of(sg.Transfer([(-100.0, 0.05)]), 0.0, 24.0, 24)
    for apart in 10.0 ** np.arange(-15, 2):
        low, high = integral.knots - apart / 2, integral.knots + apart / 2
        for first, last in ((low, high), (high, low)):
            np.testing.assert_allclose(integral.mean(first, last)[:, 3], -np.log1p(-0.05), rtol=1e-12)


def test_coefficients_of_scattered_voxels_are_those_of_the_whole_volume() -> None:
    """Boxes of cells with their margins, which begin anywhere in cells."""
    rng, shape = np.random.default_rng(3), kernel("b-spline")
    u = rng.random((40, 30, 50)).astype(np.float32)
    start, wanted = (5, 0, 3), np.zeros((31, 30, 44), bool)
    wanted[2:5, 3:9, 1:4] = wanted[20:, 17:20, 30:] = True
    assert len(prefilter.cover(wanted, start, 6)) > 1
    c, first = prefilter.coefficients(u, shape, wanted, start)
    z, y, x = (n + at for n, at in zip(np.nonzero(wanted), start, strict=True))
    assert first == (z.min(), y.min(), x.min())
    scattered = c[z - first[0], y - first[1], x - first[2]]
    assert np.abs(scattered - prefilter.prefilter(u, shape)[z, y, x]).max() < 1e-6

"""Volumes drawn brick by brick: the picture of the whole, what is read, budgets of memory, and stores read in parts."""

from __future__ import annotations

import math
import os
import re
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
import pytest

import splatgl as sg
from splatgl import fileio
from splatgl.cli.main import main
from splatgl.fileio import format_bytes, parse_bytes
from splatgl.geometry.view import GridView
from splatgl.gl import sheet_tiles, tiles
from splatgl.gl.large_volumes import render_slabs
from splatgl.planning import bricks as bricking
from splatgl.planning import culling
from splatgl.planning.bricks import Bricks, bricks_of, required_bricks
from splatgl.planning.culling import OpaqueBounds
from splatgl.planning.scene import resolve_scene
from splatgl.readers import chunked, ome_zarr
from splatgl.readers.chunked import Chunked
from splatgl.reference.check import check_bricks, compare_sample
from splatgl.reference.renderer import reachable, reachable_of, render_pixels
from splatgl.splat.hidden_interior import BLOCK
from splatgl.splat.kernels import kernel
from splatgl.splat.settings import Settings
from splatgl.splat.sheets import Sheets
from tests.helpers.bricks import ALL, PICTURES, RAMP, VIEWS, cameras, noise
from tests.helpers.memory import allow_any_memory
from tests.helpers.noise import GRIDS
from tests.helpers.regions import half_flat
from tests.helpers.splatting import spread

pytestmark = pytest.mark.usefixtures("shared_programs")


@pytest.fixture(autouse=True)
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Many small batches."""
    monkeypatch.setattr(bricking, "BATCH", 200)


def in_bricks(volume: sg.Volume, transfer: sg.Transfer, settings: Settings, side: int = 7) -> Bricks:
    found = bricks_of(volume, transfer, settings)
    assert found is not None
    return Bricks.of(volume, found.post, side)


@pytest.mark.long
@pytest.mark.parametrize(("blend", "grid", "name"), spread(7, PICTURES, ("cubes", "sheared"), VIEWS))
def test_bricks_draw_the_picture_of_the_whole(
    blend: str, grid: str, name: str, renderer: sg.Renderer, rng: np.random.Generator
) -> None:
    volume = sg.Volume(noise(rng, (18, 15, 20)), **GRIDS[grid])
    camera = cameras(volume)[name]
    transfer = sg.Transfer(RAMP.points, colormap="hot", gradient=[(0.0, 0.5), (0.2, 1.0)]) if grid == "cubes" else RAMP
    settings = ALL.replace(blend=blend, background=(0.2, 0.5, 1.0))
    right = renderer.render(sg.extract(volume, transfer), camera, settings, verify_bound=False)
    found = renderer.render_bricks(in_bricks(volume, transfer, settings), camera, settings)
    # bands of rows have fewer splats waiting
    banded = renderer.render_bricks(in_bricks(volume, transfer, settings), camera, settings, bands=3)
    assert np.abs(banded.pixels - found.pixels).max() < 5e-6 * max(right.pixels.max(), 1.0)
    assert banded.info["splats"] == found.info["splats"]
    assert right.pixels.max() > 0.3
    assert np.abs(found.pixels - right.pixels).max() < 5e-6 * max(right.pixels.max(), 1.0)
    assert found.info["bricks"] == 3 * 3 * 3 and found.info["classification"] == "post"
    if name in ("outside", "parallel"):
        assert found.info["splats"] == right.info["splats"]


@pytest.mark.long
def test_bricks_draw_regions_over_gradients(renderer: sg.Renderer, rng: np.random.Generator) -> None:
    """Of the voxels near steep ones alone, which bricks find beyond their sides; as in float64."""
    volume = sg.Volume(half_flat(rng), **GRIDS["sheared"])
    transfer = sg.Transfer(regions=["box:0.3,0.7,0.12,0.5:#ff8800:0.7"])
    camera, settings = cameras(volume)["outside"].resized((18, 13)), ALL.replace(tolerance=1e-6, antialias="off")
    splats, bricks = sg.extract(volume, transfer, classification="post"), in_bricks(volume, transfer, settings)
    found = renderer.render_bricks(bricks, camera, settings)
    assert found.info["splats"] == len(splats) < 0.7 * volume.count
    assert np.abs(found.pixels - renderer.render(splats, camera, settings, verify_bound=False).pixels).max() < 5e-6
    right = sg.reference.render(splats, camera, settings).pixels
    assert right[..., 3].max() > 0.3 and np.abs(found.pixels - right).max() < 1.5e-4


@pytest.mark.compute
def test_no_dispatch_has_more_tiles_than_it_may(
    processor: sg.Renderer, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All sheets that are still open at the end are closed, too, of a picture of many tiles."""
    volume = sg.Volume(noise(rng, (9, 8, 9)))
    camera = cameras(volume)["outside"]
    right = processor.render_bricks(in_bricks(volume, RAMP, ALL), camera, ALL).pixels
    groups: list[int] = []
    run = moderngl.ComputeShader.run

    def counted(self: moderngl.ComputeShader, *given: int) -> None:
        groups.append(given[0])
        run(self, *given)

    monkeypatch.setattr(moderngl.ComputeShader, "run", counted)
    # sorting takes so many groups
    most = 8
    for module in (tiles, sheet_tiles):
        monkeypatch.setattr(module, "MOST_TILES", most)
    found = processor.render_bricks(in_bricks(volume, RAMP, ALL), camera, ALL).pixels
    assert max(groups) <= most and len(groups) > 4
    assert np.array_equal(found, right)


@pytest.mark.long
@pytest.mark.parametrize(("name", "grid"), [("outside", "sheared"), ("inside", "cubes"), ("parallel", "sheared")])
def test_pixels_of_bricks_are_compared_as_those_of_the_whole(
    grid: str, name: str, renderer: sg.Renderer, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To float64's rounding, for which only bricks that may reach a pixel are extracted; wrong pixels are found."""
    volume = sg.Volume(noise(rng, (40, 36, 44)), **GRIDS[grid])
    camera = cameras(volume)[name]
    bricks, read = in_bricks(volume, RAMP, ALL, 6), set[int]()
    image = renderer.render_bricks(bricks, camera, ALL)
    records = Bricks.records
    monkeypatch.setattr(Bricks, "records", lambda self, n, *more: read.add(n) or records(self, n, *more))
    found: Any = check_bricks(image, bricks, camera, ALL, 1).info["checked"]
    assert len(read) < (0.9 if name == "inside" else 0.45) * len(bricks.low)
    scene = resolve_scene(sg.extract(volume, RAMP), camera, ALL)
    reached = reachable_of(bricks, camera, ALL)
    for near in (reached, reachable(scene)):
        assert not render_pixels(scene, np.flatnonzero(~near)[::9]).any()
    again: Any = compare_sample(image, ALL, 1, partial(render_pixels, scene), reached)[0].info["checked"]
    assert {**found, "rmse": 0} == {**again, "rmse": 0} | {"largest": found["largest"]} and found["largest"] < 2e-4
    assert abs(found["largest"] - again["largest"]) + abs(found["rmse"] - again["rmse"]) < 1e-12
    wrong = sg.Image(image.pixels + np.float32(0.01), image.info)
    found = check_bricks(wrong, bricks, camera, ALL).info["checked"]
    assert abs(found["largest"] - 0.01) < 1e-4
    assert "checked" not in check_bricks(image, bricks, camera, ALL, 0).info


@pytest.mark.long
def test_random_scenes_in_bricks(renderer: sg.Renderer) -> None:
    """Of any shape, size of bricks, kernel, tolerance and type of samples, with missing ones."""
    # 1087: long voxels beside the eye
    for number, seed in enumerate((*range(4), 1087)):
        rng = np.random.default_rng(seed)
        shape = tuple(int(n) for n in rng.integers(1, 24, 3))
        samples = noise(rng, shape)
        if seed % 3 == 0:
            samples[rng.random(shape) < 0.05] = np.nan
        elif seed % 3 == 1:
            samples = (samples * 255).astype(np.uint8)
        top = 255.0 if samples.dtype == np.uint8 else 1.0
        volume = sg.Volume(samples, spacing=tuple(rng.uniform(0.5, 3, 3)))
        transfer = sg.Transfer([(0.4 * top, 0), (rng.uniform(0.5, 0.7) * top, rng.uniform(0.05, 1))], colormap="bone")
        rng.random()
        # one tolerance of each kernel, as shaders are compiled for both; of each type of samples all kernels
        kinds = (("auto", 2e-3), ("crawfis-max", 1e-4), ("gaussian", 1e-3))
        kernel, tolerance = kinds[(number + number // 3) % len(kinds)]
        settings = ALL.replace(kernel=kernel, tolerance=tolerance)
        eye = volume.center + rng.normal(size=3) * np.ptp(volume.corners, axis=0) * rng.uniform(0.1, 2)
        camera = sg.Camera.look_at(eye, volume.center, (0.1, 0.2, 1), 50, (24, 20))
        splats = sg.extract(volume, transfer, kernel=kernel if kernel != "auto" else "b-spline")
        right = renderer.render(splats, camera, settings, verify_bound=False).pixels
        bricks = in_bricks(volume, transfer, settings, int(rng.integers(2, 12)))
        assert np.abs(renderer.render_bricks(bricks, camera, settings).pixels - right).max() < 5e-5, seed


def test_pixels_do_not_depend_on_what_else_is_in_view(renderer: sg.Renderer) -> None:
    """Tiles lie on one grid, whatever the window of what is drawn: lists of truncated kernels are the same."""
    ball = sg.scenes.ball(24)
    padded = replace(ball, samples=np.pad(ball.samples, 7))
    transfer = sg.Transfer([(0.3, 0.0), (0.5, 0.9)], colormap="hot", shading=True)
    camera = sg.Camera.orbit(padded, 31, 23, size=(143, 99))
    right = renderer.render(sg.extract(padded, transfer), camera, ALL, verify_bound=False)
    found = renderer.render_bricks(in_bricks(padded, transfer, ALL, 16), camera, ALL)
    windows = [
        renderer.plan(each, camera, ALL).window
        for each in (sg.extract(padded, transfer), in_bricks(padded, transfer, ALL).whole)
    ]
    assert windows[0].x % 8 != windows[1].x % 8
    assert np.abs(found.pixels - right.pixels).max() < 2e-6


@pytest.mark.long
def test_early_ends_stay_within_the_tolerance(renderer: sg.Renderer, rng: np.random.Generator) -> None:
    volume = sg.Volume(noise(rng, (36, 36, 36)))
    solid = sg.Transfer([(0.0, 0.9), (1.0, 0.9)], colormap="hot")
    settings = Settings()
    camera = sg.Camera.orbit(volume, 30, 20, size=(120, 120))
    right = renderer.render(sg.extract(volume, solid), camera, ALL, verify_bound=False).pixels
    found = renderer.render_bricks(in_bricks(volume, solid, settings, 4), camera, settings)
    assert np.abs(found.pixels - right).max() < settings.tolerance
    # what is hidden is not read
    assert found.info["splats"] < 0.8 * volume.count


def test_pixels_of_bricks_take_all_samples(renderer: sg.Renderer, rng: np.random.Generator) -> None:
    """As their plan says: none are spared, whatever the tolerance."""
    volume = sg.Volume(noise(rng, (9, 8, 10)))
    camera, settings = sg.Camera.orbit(volume, size=(64, 64)), Settings(tolerance=0.02)
    bricks = in_bricks(volume, RAMP, settings)
    plan = renderer.plan_bricks(bricks, camera, settings)
    assert plan.antialias == "2×2 samples a pixel"
    # also where pixels are wider than voxels, by which memory is estimated
    for view in (camera, camera.resized((7, 5))):
        wanted = settings.replace(tolerance=0.003)
        size = renderer.plan_bricks(bricks, view, wanted).view.size
        assert bricks.samples(view, wanted) == size[0] * size[1]
    assert bricks.samples(view, wanted) == 35 * 16
    assert "elsewhere" in renderer.plan(sg.extract(volume, RAMP), camera, settings).antialias
    right = renderer.render(sg.extract(volume, RAMP), camera, settings.replace(antialias="supersample", samples=2))
    found = renderer.render_bricks(bricks, camera, settings)
    assert np.abs(found.pixels - right.pixels).max() < 5e-6


def test_records_of_bricks_are_those_of_the_whole(rng: np.random.Generator) -> None:
    samples = noise(rng, (17, 12, 15))
    samples[4:7, 3:5, 2:9] = np.nan
    volume = sg.Volume(samples, spacing=(1.0, 1.0, 2.5))
    bricks = in_bricks(volume, RAMP, Settings(), 5)
    found = np.concatenate([bricks.records(n) for n in range(len(bricks.low))])
    whole = sg.extract(volume, RAMP, classification="post").records
    order = np.lexsort(found["position"].T)
    assert np.array_equal(found[order], whole)


class Parts:
    """Samples that count how many of them are read."""

    def __init__(self, samples: np.ndarray) -> None:
        self.samples, self.shape, self.dtype, self.read = samples, samples.shape, samples.dtype, 0

    def __getitem__(self, key: Any) -> np.ndarray:
        found = self.samples[key]
        self.read += found.size
        return found


def test_some_blocks_of_a_brick_have_the_records_of_all(rng: np.random.Generator) -> None:
    """Bits, though less is prefiltered; nothing is read of bricks without any."""
    volume = sg.Volume(noise(rng, (41, 26, 37)))
    bricks = in_bricks(volume, RAMP, ALL, 26)
    for brick in range(len(bricks.low)):
        whole = bricks.records(brick)
        low, high = bricks.low[brick], bricks.high[brick]

        def is_visible(low: np.ndarray, high: np.ndarray) -> np.ndarray:
            return (low[:, 0] < 20) & (high[:, 2] > 9) & (low[:, 1] + low[:, 2] < 40)

        shown = bricks.shown(brick, is_visible)
        place = (whole["position"] - low) // BLOCK
        some = whole[shown[place[:, 2], place[:, 1], place[:, 0]]]
        assert shown.shape == tuple(-(-(high - low) // BLOCK)[::-1]) and (not low[0]) == shown.any()
        assert bricks.records(brick, shown).tobytes() == some.tobytes()
        assert len(some) < len(whole)


@pytest.mark.parametrize("name", ["outside", "inside", "parallel"])
def test_shells_hold_what_reaches_them(name: str, rng: np.random.Generator) -> None:
    """Each all splats that add to its sheets, which begin before it, too; and each splat is counted once."""
    volume = sg.Volume(noise(rng, (20, 17, 22)), spacing=(1, 1.3, 0.8))
    bricks = in_bricks(volume, RAMP, ALL)
    records = np.concatenate([bricks.records(n) for n in range(len(bricks.low))])
    view = GridView.of(bricks.whole.grid, cameras(volume)[name], kernel("b-spline"), antialias=False)
    sheets = Sheets.of(kernel("b-spline"), 3, 2)
    base = sheets.base(sheets.places(view, records["position"]))
    count = 0
    for first, last in bricks.shells(sheets, view, 3):
        some = bricks.within(sheets, view, (first, last))
        found = np.concatenate(
            [batch for batch, _ in some.batches(sheets, view, lambda low, _: np.ones(len(low), bool))]
        )
        right = records[(base + sheets.count >= first) & (base <= last + 1)]
        assert 0 < len(right) < len(records)
        assert set(map(tuple, right["position"].tolist())) <= set(map(tuple, found["position"].tolist()))
        count += sum(some.found.values())
    assert count == len(records)


@pytest.mark.long
def test_only_what_is_seen_is_read(renderer: sg.Renderer) -> None:
    """In parts, of bricks that can be seen; by others that are no numpy arrays, too."""
    ball = sg.scenes.ball(20)
    parts = Parts(ball.samples)
    volume = replace(ball, samples=parts)
    transfer = sg.default_transfer(ball)
    assert volume.shape == ball.shape and volume.count == ball.count
    bricks = in_bricks(volume, transfer, ALL, 8)
    whole = sg.Camera.orbit(ball, size=(32, 32))
    near = sg.Camera.look_at(ball.corners[7] + 6, ball.corners[7] - 1, (0, 0, 1), 4, (32, 32))
    read, settings = [], ALL.replace(antialias="supersample")
    for camera in (whole, near):
        parts.read = 0
        found = renderer.render_bricks(bricks, camera, settings).pixels
        right = renderer.render(sg.extract(ball, transfer), camera, settings, verify_bound=False).pixels
        assert np.abs(found - right).max() < 1e-5
        read.append(parts.read)
    assert 0 < read[1] < 0.6 * read[0]
    assert np.array_equal(
        sg.extract(volume, transfer, classification="post").records, sg.extract(ball, transfer).records
    )


def test_a_budget_decides(renderer: sg.Renderer, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    volume = sg.Volume(noise(rng, (14, 14, 14)))
    camera = cameras(volume)["outside"]
    with pytest.raises(sg.InputError, match=r"^memory: expected at least .* for this picture, got 1 bytes; "):
        render_slabs(volume, RAMP, camera, ALL, 1, renderer=renderer)
    allow_any_memory(monkeypatch)
    done: list[tuple[int, int]] = []
    parts = render_slabs(volume, RAMP, camera, ALL, 1, lambda *told: done.append(told), renderer)
    whole = render_slabs(volume, RAMP, camera, ALL, 2**40, renderer=renderer)
    assert parts.info["bricks"] == 1 and whole.info["bricks"] == 0 and done[-1] == (1, 1)
    assert np.abs(parts.pixels - whole.pixels).max() < 5e-6
    assert render_slabs(volume, RAMP, camera, renderer=renderer).info["bricks"] == 0
    # voxels that are classified before are drawn whole
    assert (
        render_slabs(volume, RAMP, camera, ALL.replace(classification="pre"), 1, renderer=renderer).info["bricks"] == 0
    )
    with pytest.raises(sg.InputError, match=r"^memory: expected a positive number of bytes, got 0"):
        render_slabs(volume, RAMP, camera, memory=0, renderer=renderer)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        (Settings(classification="pre"), "got classification pre"),
        (Settings(compositing="splats"), "got compositing splats"),
    ],
    ids=str,
)
def test_what_bricks_cannot_draw(settings: Settings, said: str, renderer: sg.Renderer) -> None:
    volume = sg.scenes.ball(9)
    with pytest.raises(sg.InputError, match=f"^a volume in bricks: expected .* {said}(; |$)"):
        renderer.render_bricks(in_bricks(volume, RAMP, ALL), cameras(volume)["outside"], settings)


def test_a_parallel_view_from_within_is_refused(renderer: sg.Renderer) -> None:
    volume = sg.scenes.ball(9)
    camera = sg.Camera.orthographic(volume.center, volume.center + np.array([1, 0, 0]), (0, 0, 1), 9, (16, 16))
    with pytest.raises(sg.InputError, match=r"^a volume in bricks: expected a parallel view from outside"):
        renderer.render_bricks(in_bricks(volume, RAMP, ALL), camera, ALL)


def test_an_interrupted_picture_leaves_nothing(renderer: sg.Renderer, rng: np.random.Generator) -> None:
    volume = sg.Volume(noise(rng, (24, 24, 24)))
    bricks, camera = in_bricks(volume, RAMP, ALL), cameras(volume)["outside"]
    right = renderer.render_bricks(bricks, camera, ALL).pixels
    answers = iter([False] * 3 + [True] * 100)
    with pytest.raises(sg.Interrupted):
        renderer.render_bricks(bricks, camera, ALL, interrupted=lambda: next(answers))
    assert np.array_equal(renderer.render_bricks(bricks, camera, ALL).pixels, right)


def test_estimates(rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    """All splats of a volume no larger than the boxes, those of a larger one within a third; without reading where
    even the most fits.
    """
    allow_any_memory(monkeypatch)
    volume = sg.Volume(noise(rng, (40, 40, 40)))
    bricks = in_bricks(volume, RAMP, ALL, 8)
    kept = len(sg.extract(volume, RAMP, classification="post"))
    whole = bricking.estimate_need(bricks, 100, 0)
    assert whole.splats == whole.most == kept
    monkeypatch.setattr(bricking, "PROBE_SIDE", 9)
    # boxes that differ leave an estimate unsure
    half = sg.Volume(np.where(np.arange(40)[:, None, None] < 20, volume.samples, np.float32(0)))
    unsure = bricking.estimate_need(in_bricks(half, RAMP, ALL, 8), 100, 0)
    assert unsure.most > 1.02 * unsure.splats and unsure.bytes > bricking.EACH * unsure.most
    found = bricking.estimate_need(bricks, 100, 0)
    assert abs(found.splats - kept) < kept / 3 and found.bytes > bricking.EACH * found.most
    assert found.splats <= found.most <= volume.count
    assert found.fitted(bricks, 2**40)[1] == 1 and found.fitted(bricks, 1)[1] >= 1
    many = bricking.MemoryEstimate(10**9, 10**9, 10**12, 2**32, 2**20)
    few, more, most = (many.fitted(bricks, memory)[1] for memory in (2**31, 2**30, 1))
    assert 1 < few < more < most == bricking.MOST_BANDS
    # a picture without bricks has open sheets of a band alone; layers of all samples
    whole, beside = (bricking.estimate_need(bricks, 2**24, 0) for _ in range(2))
    assert whole.bytes < 100 * 2**24 < bricking.needed_together([whole, beside]).bytes
    monkeypatch.setattr(Bricks, "records", lambda *_: pytest.fail("read"))
    assert bricking.estimate_need(bricks, 100, 2**40).splats == volume.count
    assert 0 < fileio.budget() < 2**50


def test_less_memory_means_fewer_threads_smaller_batches_or_a_refusal(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Within the memory in all, and samples that are in memory count."""
    monkeypatch.setattr(bricking, "BATCH", 2**19)
    monkeypatch.setattr(os, "cpu_count", lambda: 8)
    bricks = in_bricks(sg.Volume(noise(rng, (9, 9, 9))), RAMP, ALL)
    need = bricking.estimate_need(bricks, 2**20, 0)
    assert bricks.held == bricks.volume.samples.nbytes
    (small, most), (middle, few), (large, one) = (need.fitted(bricks, memory << 20) for memory in (400, 1024, 8192))
    assert small.threads == 1 and (large.threads, large.batch) == (8, 2**19)
    assert 1 < middle.threads < 8 and small.batch < middle.batch <= large.batch
    assert most > few >= one == 1
    for memory in (400 << 20, 1024 << 20):
        assert need.fitted(bricks, memory)[0].fixed + need.parted // need.fitted(bricks, memory)[1] <= memory
    with pytest.raises(
        sg.InputError, match=r"^memory: expected at least .* MiB for this picture, got 100\.0 MiB; give"
    ):
        need.fitted(bricks, 100 << 20)
    # the least suffices, and samples in memory count
    least = bricks.least(need.parted)
    assert need.fitted(bricks, least)[0].batch == bricking.LEAST_BATCH
    with pytest.raises(sg.InputError, match=r"^memory: expected at least "):
        need.fitted(bricks, least - 1)
    more = in_bricks(sg.Volume(noise(rng, (90, 9, 9))), RAMP, ALL)
    assert more.least(need.parted) - least == more.held - bricks.held > 0


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="peaks are in KiB there")
@pytest.mark.parametrize(
    ("dtype", "chunk", "size", "memory"),
    [
        (np.float32, 64, 128, 400),
        (np.uint8, 64, 512, 512),
        (np.uint8, 64, 32, 256),
        (np.float32, 160, 128, 256),
    ],
)
def test_the_command_keeps_its_memory(tmp_path: Path, dtype: type, chunk: int, size: int, memory: int) -> None:
    """At every size of the picture the process takes no more than `--memory`, or ends with a line that says how much
    suffices, and then it does.
    """
    store = pyramid(tmp_path / "waves.zarr", dtype, chunk)
    command = [sys.executable, "-m", "splatgl", "render", str(store), "--size", str(size), "--check", "0"]
    peak = partial(peak_of, tmp_path, [*command, "-o", str(tmp_path / "a.npy"), "--memory"])
    code, taken, told = peak(memory)
    assert taken < memory
    if code:
        assert code == 2 and told.count("\n") == 1 and not (tmp_path / "a.npy").exists()
        least = re.match(r"splatgl: --memory: expected at least ([0-9.]+) MiB ", told)
        assert least, told
        # a choice of the level may come before the picture
        code, taken, told = peak(math.ceil(float(least[1]) + 150))
        assert code == 0 and taken < float(least[1]) + 150


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="peaks are in KiB there")
def test_a_picture_that_fits_is_drawn_whole(tmp_path: Path, rng: np.random.Generator) -> None:
    """Within the memory that is estimated for it."""
    volume = sg.Volume(noise(rng, (60, 60, 60)))
    volume.save(tmp_path / "a.nrrd")
    need = bricking.estimate_need(in_bricks(volume, RAMP, ALL), 4 * 1500**2, 2**40)
    command = [sys.executable, "-m", "splatgl", "render", str(tmp_path / "a.nrrd"), "--size", "1500", "--check", "0"]
    points = ",".join(f"{value}:{opacity}" for value, opacity in RAMP.points)
    command += ["--points", points, "-o", str(tmp_path / "a.npy"), "--memory"]
    code, taken, told = peak_of(tmp_path, command, (need.bytes >> 20) + 1)
    assert code == 0 and "bricks" not in told and taken <= need.bytes >> 20, told


# its own peak, in KiB, is that of a small process: a child of this one begins with the peak of this one
MEASURED = """
import os, subprocess, sys
process = subprocess.Popen(sys.argv[2:], stdout=subprocess.DEVNULL, stderr=open(sys.argv[1], "w"))
_, status, used = os.wait4(process.pid, 0)
print(os.waitstatus_to_exitcode(status), used.ru_maxrss)
"""


def peak_of(folder: Path, command: list[str], memory: int) -> tuple[int, float, str]:
    """Exit code of a command within `memory` MiB, its peak, MiB, and what it prints on standard error."""
    told = folder / "told.txt"
    measured = [sys.executable, "-c", MEASURED, str(told), *command, f"{memory}MiB"]
    code, used = subprocess.run(measured, check=True, capture_output=True, text=True).stdout.split()
    return int(code), int(used) / 1024, told.read_text()


def pyramid(path: Path, dtype: type, chunk: int, side: int = 160) -> Path:
    """Writes waves of side³ and coarser levels as OME-Zarr; returns the path."""
    zarr = pytest.importorskip("zarr", reason="writes the store; it is in the extra readers")
    wave = np.sin(np.arange(side) / 4)
    samples: np.ndarray = ((wave[:, None, None] + wave[:, None] + wave + 3) * 40).astype(dtype)
    group, levels = zarr.open_group(path, mode="w", zarr_format=2), []
    for n in range(3):
        part = samples[:: 2**n, :: 2**n, :: 2**n]
        group.create_array(str(n), data=part, chunks=(min(chunk, len(part)),) * 3)
        levels.append({"path": str(n), "coordinateTransformations": [{"type": "scale", "scale": [2.0**n] * 3}]})
    axes = [{"name": name, "type": "space"} for name in "zyx"]
    group.attrs["multiscales"] = [{"version": "0.4", "axes": axes, "datasets": levels}]
    return path


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_a_view_is_fitted_to_opaque_samples(
    dtype: type, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As it is to splats of voxels; to the volume, where none is opaque, or it is too large to look at."""
    samples: np.ndarray = (noise(rng, (14, 11, 17)) * 255).astype(dtype)
    samples[:4] = samples[:, :, 12:] = 0
    if dtype is np.float32:
        samples[0, 0, 0], samples[1, 1, 16] = np.inf, np.nan
    volume, transfer = (
        sg.Volume(samples, spacing=(1.0, 2.0, 0.5), origin=(3, 4, 5)),
        sg.Transfer([(130, 0.0), (150, 1.0)]),
    )
    found, right = OpaqueBounds(volume, transfer), sg.extract(volume, transfer, classification="pre")
    assert np.array_equal(found.corners, right.corners) and np.abs(found.corners - volume.corners).max() > 1
    cameras = [sg.Camera.orbit(each, 20, 30) for each in (found, right)]
    assert np.allclose(cameras[0].eye, cameras[1].eye, rtol=1e-12)
    nothing = OpaqueBounds(volume, sg.Transfer([(300.0, 0.0), (301.0, 1.0)]))
    assert np.array_equal(nothing.corners, volume.corners) and np.array_equal(nothing.outline, volume.outline)
    monkeypatch.setattr(culling, "MOST_EXAMINED", 100)
    assert np.array_equal(OpaqueBounds(volume, transfer).outline, volume.outline)


# --- stores ---------------------------------------------------------------------------------------------------------


@pytest.fixture
def store(tmp_path: Path, rng: np.random.Generator) -> tuple[Path, np.ndarray]:
    zarr = pytest.importorskip("zarr")
    samples = (noise(rng, (21, 18, 25)) * 255).astype(np.uint8)
    zarr.create_array(tmp_path / "v.zarr", data=samples[None], chunks=(1, 8, 8, 8))
    return tmp_path / "v.zarr", samples


def test_a_large_store_is_read_in_parts(
    store: tuple[Path, np.ndarray], renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, samples = store
    whole = sg.load(path)
    monkeypatch.setattr(ome_zarr, "WHOLE_BYTES", 1000)
    monkeypatch.setattr(chunked, "CACHE_BYTES", 2000)
    volume = sg.load(path)
    assert isinstance(whole.samples, np.ndarray) and isinstance(volume.samples, Chunked)
    assert volume.samples.dtype == np.uint8 and volume.shape == samples.shape
    for key in (
        3,
        slice(2, 9),
        (slice(None), 4),
        (slice(0, 21), slice(3, 17), slice(20, 25)),
        slice(5, 5),
        (1, 2, 3),
        slice(3, 20, 4),
        slice(None, None, -3),
    ):
        assert np.array_equal(volume.samples[key], samples[key])
    assert len(volume.samples.cache) == 3
    transfer = sg.default_transfer(volume)
    assert transfer == sg.default_transfer(whole)
    camera = sg.Camera.orbit(volume, size=(24, 24))
    right = renderer.render(sg.extract(whole, transfer), camera, ALL, verify_bound=False).pixels
    assert np.array_equal(sg.extract(volume, transfer).records, sg.extract(whole, transfer).records)
    found = renderer.render_bricks(in_bricks(volume, transfer, ALL), camera, ALL).pixels
    assert np.abs(found - right).max() < 1e-5


def test_chunks_that_show_nothing_are_read_once(
    tmp_path: Path, renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Extents of chunks are kept between runs, until anything in the store changes."""
    zarr = pytest.importorskip("zarr")
    monkeypatch.setenv("SPLATGL_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(ome_zarr, "WHOLE_BYTES", 1000)
    samples = np.full((32, 32, 32), 3, np.float32)
    samples[:8, :8, :8] = np.nan
    samples[24:, 24:, 24:] = 200
    array = zarr.create_array(tmp_path / "v.zarr", data=samples, chunks=(8, 8, 8))
    transfer = sg.Transfer([(100, 0.0), (200, 0.9)])
    read: list[tuple[int, ...]] = []
    ask = Chunked._chunk
    monkeypatch.setattr(Chunked, "_chunk", lambda self, place, *ends: read.append(place) or ask(self, place, *ends))

    def drawn() -> np.ndarray:
        read.clear()
        volume = sg.load(tmp_path / "v.zarr")
        bricks = in_bricks(volume, transfer, ALL, 8)
        image = renderer.render_bricks(bricks, sg.Camera.orbit(volume, size=(20, 20)), ALL)
        volume.samples.extents.save()
        return image.pixels

    first = drawn()
    assert set(read) == set(np.ndindex(4, 4, 4)) and first.max() > 0.1
    # the last chunk, and those within the halos of bricks that it is in the halo of
    assert np.array_equal(drawn(), first) and set(read) == {(z + 1, y + 1, x + 1) for z, y, x in np.ndindex(3, 3, 3)}
    array[8:16, :8, :8] = 150
    second = drawn()
    assert not np.array_equal(second, first) and set(read) == set(np.ndindex(4, 4, 4))
    # one that is damaged, and a folder that can't be written, are as none
    (file,) = (tmp_path / "cache" / "extents").glob(f"{sg.load(tmp_path / 'v.zarr').samples.extents.file.name}")
    file.write_bytes(file.read_bytes()[:50])
    assert np.array_equal(drawn(), second) and len(set(read)) == 64
    monkeypatch.setenv("SPLATGL_CACHE", str(tmp_path / "v.zarr" / "zarr.json" / "x"))
    assert np.array_equal(drawn(), second)


def test_a_damaged_chunk_is_told_in_one_line(
    store: tuple[Path, np.ndarray], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path, _ = store
    (chunk,) = path.glob("c/0/1/1/1")
    chunk.write_bytes(chunk.read_bytes()[:9])
    monkeypatch.setattr(ome_zarr, "WHOLE_BYTES", 1000)
    monkeypatch.chdir(path.parent)
    asked = ["render", str(path), "-o", "x.png", "--points", "100:0,150:1", "--size", "16", "--memory", "1"]
    assert main(asked) == 2
    error = capsys.readouterr().err
    assert (
        error.count("\n") == 1
        and "v.zarr: cannot be read as Zarr, chunk 1, 1, 1: " in error
        and not Path("x.png").exists()
    )


def test_too_many_pixels_are_refused_before_notes_on_memory(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    np.save(tmp_path / "a.npy", np.random.default_rng(1).random((9, 9, 9)))
    command = ["render", str(tmp_path / "a.npy"), "-o", str(tmp_path / "o.npy"), "--size", "99999", "--memory", "1KB"]
    assert main(command) == 2
    told = capsys.readouterr()
    assert not told.out and told.err.startswith("splatgl: image size: expected at most") and told.err.count("\n") == 1


@pytest.mark.long
def test_the_command_line(
    tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    np.save("noise.npy", noise(rng, (30, 30, 30)))
    asked = ["render", "noise.npy", "-o", "x.npy", "--points", "0.45:0,0.6:0.8", "--size", "24", "--memory"]
    assert main([*asked, "1KB"]) == 2 and not Path("x.npy").exists()
    refused = capsys.readouterr()
    assert refused.err.startswith("splatgl: --memory: expected at least ") and refused.err.count("\n") == 1
    allow_any_memory(monkeypatch)
    assert main([*asked, "1KB"]) == 0
    told = capsys.readouterr().out
    assert "more than 1000 bytes" in told or "more than 1.0 KiB" in told
    assert "drawn in 1 bricks" in told
    bricks = np.load("x.npy")
    assert main([*asked, "1TiB"]) == 0 and "bricks" not in capsys.readouterr().out
    assert np.abs(np.load("x.npy") - bricks).max() < 1 / 255
    for more, said in (
        (["1KB", "--field"], "--field: expected a picture that fits into 1000 bytes"),
        (["soon"], "expected a number of bytes, such as 4GiB or 500MB, got 'soon'"),
        (["0"], "memory: expected a positive number of bytes, got 0"),
    ):
        code = 0
        try:
            code = main([*asked, *more])
        except SystemExit as error:
            code = int(str(error.code))
        assert code == 2 and said in capsys.readouterr().err


def test_numbers_of_bytes() -> None:
    for text, count in (
        ("4GiB", 4 << 30),
        ("500MB", 500_000_000),
        ("1e9", 10**9),
        ("2k", 2000),
        ("7 b", 7),
        ("1.5MiB", 3 << 19),
    ):
        assert parse_bytes(text) == count
    assert [format_bytes(count) for count in (12, 2048, 3 << 29)] == ["12 bytes", "2.0 KiB", "1.5 GiB"]


def test_what_bricks_do_not_hold() -> None:
    """Colours of their own, and voxels classified before, are told by name."""
    plain = sg.Volume(np.ones((4, 4, 4)))
    own = sg.Volume(np.ones((4, 4, 4)), color=np.zeros((4, 4, 4, 3), np.uint8))
    for volume, settings, why in (
        (own, ALL, "colours of"),
        (plain, ALL.replace(classification="pre"), "classification pre"),
    ):
        with pytest.raises(sg.InputError, match=f"^a picture in parts: expected values .*, got {why}"):
            required_bricks(volume, RAMP, settings)
    assert len(required_bricks(plain, RAMP, ALL).low) == 1

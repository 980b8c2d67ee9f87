"""Sorts and lists of a graphics card: equal to those of the processor and of NumPy."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import moderngl
import numpy as np
import pytest

import splatgl as sg
from splatgl.gl.card_lists import CardLists
from splatgl.gl.context import current
from splatgl.gl.program import build_compute
from splatgl.gl.shader import SORT_BLOCK
from splatgl.gl.tiles import Lister, ProjectedSplats, Spec, TileBand
from splatgl.planning import bricks as bricking
from splatgl.planning.bricks import Bricks, bricks_of
from tests.helpers.noise import noise
from tests.helpers.splatting import SPLATS

pytestmark = pytest.mark.compute


class Bare:
    """Programs of the sort without a picture."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        self.programs: dict[object, moderngl.ComputeShader] = {}

    def __call__(self, name: str, switches: Mapping[str, bool]) -> moderngl.ComputeShader:
        key = name, *switches.items()
        if key not in self.programs:
            self.programs[key] = build_compute(self.ctx, name, switches)
        return self.programs[key]


@pytest.mark.parametrize("largest", [1, 15, 300, 70_000])
def test_a_sort_is_stable(renderer: sg.Renderer, rng: np.random.Generator, largest: int) -> None:
    ctx = renderer.ctx
    with current(ctx):
        lists, compile_ = CardLists(ctx), Bare(ctx)
        for count in (1, 255, 257, SORT_BLOCK, 3 * SORT_BLOCK + 17):
            keys = rng.integers(0, largest + 1, count, dtype=np.uint32)
            # as in a solid volume, whole groups of one digit
            keys[: count // 3] = largest
            lists.set_entries(count)
            lists._buffer("pairs", count * 8).write(np.stack([keys, np.arange(count, dtype=np.uint32)], axis=1))
            source = lists._sort(compile_, largest, count)
            sorted_ = np.frombuffer(lists.buffers[source].read(count * 8), np.uint32).reshape(count, 2)
            order = np.argsort(keys, kind="stable")
            np.testing.assert_array_equal(sorted_[:, 1], order)
            np.testing.assert_array_equal(sorted_[:, 0], keys[order])
        lists.release()


@pytest.mark.parametrize("name", ["quick", "many"])
def test_lists_are_those_of_the_processor(processor: sg.Renderer, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """Of splats of every size, some in all tiles; with some tiles closed, and in several sorts."""
    splats = noise("sheared", size=16, opacity=0.5)
    eye = splats.corners.mean(axis=0) + 6.0
    camera = sg.Camera.look_at(eye, splats.corners.mean(axis=0), (0, 0, 1), 60, (150, 90))
    counted: list[tuple[Spec, TileBand, ProjectedSplats, int]] = []

    def keep(lister: Lister, *given: Any) -> np.ndarray | None:
        counted.append(given)
        return original(lister, *given)

    original = Lister.count
    monkeypatch.setattr(Lister, "count", keep)
    processor.render(splats, camera, SPLATS.replace(technique="tiles", tolerance=1e-4))
    (spec, band, placed, count), *_ = counted
    lister = processor.passes.tiles.lister
    with current(processor.ctx):
        closed = np.zeros(band.closed.size, bool)
        closed[5:90:3] = True
        lists = CardLists(processor.ctx)
        if name == "many":
            lists.room = 1000
        lists.begin(closed)
        lists.set_entries(0)

        def compile_(name: str, switches: Mapping[str, bool]) -> moderngl.ComputeShader:
            return spec.compiled(processor.passes.device.programs, band, name, switches)

        listed: list[list[int]] = [[] for _ in closed]
        for unit, texture in enumerate(placed.textures):
            texture.use(8 + unit)
        sort, most = 0, 100
        lists.count_pairs(compile_, 0, count)
        while True:
            lists.list_tiles(compile_, sort)
            entries = np.frombuffer(lists.buffers["work"].read(4), np.uint32)[0]
            ranges = np.frombuffer(lists.buffers["lists"].read(closed.size * 16), np.uint32).reshape(-1, 4)
            numbers = np.frombuffer(lists.buffers["listed"].read(int(entries) * 4), np.uint32)
            for tile, (_, begin, end, _) in enumerate(ranges):
                listed[tile] += numbers[begin:end].tolist()
            sort += 1
            if entries < lists.room or sort == most:
                break
        assert 3 < sort < most if name == "many" else sort == 1
        band.closed[:] = closed
        expected = original(lister, spec, band, placed, count)
        assert expected is not None
        lister.list(spec, band, placed, count, int(expected[-1, 2]))
        numbers = np.frombuffer(lister.buffers.kept[6].read(int(expected[-1, 2]) * 4), np.uint32)
        for tile, begin, end, _ in expected:
            np.testing.assert_array_equal(listed[tile], numbers[begin:end])
        assert sum(map(len, expected)) > 0
        some = [t for t in range(closed.size) if not closed[t] and t not in expected[:, 0]]
        assert all(not listed[t] for t in some)
        lists.release()


class Reads:
    """Counts what is read back from the device, and what is written to its buffers and textures."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.before_picture, self.pictures, self.after, self.writes = 0, 0, 0, 0
        for kind, name in ((moderngl.Buffer, "read"), (moderngl.Texture, "read"), (moderngl.Framebuffer, "read_into")):
            patch.setattr(kind, name, self._reading(getattr(kind, name), kind is moderngl.Framebuffer))
        for kind in (moderngl.Buffer, moderngl.Texture):
            patch.setattr(kind, "write", self._writing(kind.write))

    def _reading(self, original: Callable[..., object], of_picture: bool) -> Callable[..., object]:
        def read(*args: object, **options: object) -> object:
            self.pictures += of_picture
            self.after += not of_picture and self.pictures > 0
            self.before_picture += not of_picture and self.pictures == 0
            return original(*args, **options)

        return read

    def _writing(self, original: Callable[..., object]) -> Callable[..., object]:
        def write(*args: object, **options: object) -> object:
            self.writes += 1
            return original(*args, **options)

        return write


def volume() -> sg.Volume:
    return sg.Volume(np.random.default_rng(4).random((20, 20, 20), np.float32))


@pytest.mark.few(1)
@pytest.mark.parametrize("change", [{}, {"blend": "xray"}, {"shading": "off"}, {"clip": ((1.0, 0.0, 0.0, 8.0),)}])
def test_a_card_reads_nothing_before_the_picture(
    card: sg.Renderer, monkeypatch: pytest.MonkeyPatch, change: dict
) -> None:
    splats = sg.extract(volume(), sg.Transfer([(0.4, 0), (1, 0.5)]))
    camera, settings = sg.Camera.orbit(splats, size=(32, 32)), sg.Settings(**change)
    first = card.render(splats, camera, settings).pixels
    reads = Reads(monkeypatch)
    np.testing.assert_array_equal(card.render(splats, camera, settings).pixels, first)
    # of what did not fit, after the picture
    assert (reads.before_picture, reads.pictures, reads.after) == (0, 1, 1)


def test_a_card_reads_once_a_batch_of_bricks(card: sg.Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bricking, "BATCH", 1000)
    scene, transfer = volume(), sg.Transfer([(0.4, 0), (1, 0.5)])
    found = bricks_of(scene, transfer, sg.Settings())
    assert found is not None
    bricks = Bricks.of(scene, found.post, 7)
    camera = sg.Camera.orbit(scene, size=(32, 32))
    batches = 0

    def count(*_: int) -> None:
        nonlocal batches
        batches += 1

    reads = Reads(monkeypatch)
    card.render_bricks(bricks, camera, progress=count)
    assert batches > 2
    assert reads.before_picture <= batches


def test_what_does_not_fit_is_drawn_again(
    renderer: sg.Renderer, card: sg.Renderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    splats = sg.extract(volume(), sg.Transfer([(0.4, 0), (1, 0.5)]))
    camera = sg.Camera.orbit(splats, size=(32, 32))
    right = renderer.render(splats, camera, sg.Settings(occlusion="off")).pixels
    lists = card.passes.device.card
    assert lists is not None
    monkeypatch.setattr(lists, "room", 1024)
    first = card.render(splats, camera, sg.Settings(occlusion="off")).pixels
    assert lists.sorts > 1
    assert np.abs(first - right).max() < 1e-5

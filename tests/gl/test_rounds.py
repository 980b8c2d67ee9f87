"""Rounds of sheets leave out clusters of splats that no open tile shows, and none that one does."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.geometry.view import tangents
from splatgl.gl.sheet_tiles import SheetOrder
from splatgl.planning import clusters as clustering
from splatgl.planning import technique as techniques
from splatgl.planning.clusters import INSIDE, NAME_BITS, SIDE_BITS, Clusters, RoundSplats, touched_tiles
from splatgl.planning.culling import PixelWindow
from splatgl.planning.plan import Plan
from splatgl.planning.technique import COLUMNS, ROWS
from tests.helpers.noise import GRIDS, LOOKS, inside, noise, views

WHOLE = sg.Settings(compositing="sheets", occlusion="off", antialias="off")
RAMP = sg.Transfer([(0.3, 0), (0.6, 0.97)], colormap="hot")


@pytest.fixture
def many_rounds(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int]]:
    """Draws every picture in many rounds. Returns the numbers of splats that are sorted and placed in each, as listed
    while pictures are drawn.
    """
    for module, name, value in (
        *((techniques, "SOLID", 0.0), (techniques, "MANY_IN_SHEETS", 1)),
        *((clustering, "LEAST", 200), (clustering, "SHARE", 0.1)),
    ):
        monkeypatch.setattr(module, name, value)
    found: list[tuple[int, int]] = []
    right = SheetOrder.sorted

    def sort(self: SheetOrder, *given: Any) -> tuple[object, int]:
        ordered, count = right(self, *given)
        for parts in given[5:]:
            found.append((int((parts[:, 1] - parts[:, 0]).sum()), count))
        return ordered, count

    monkeypatch.setattr(SheetOrder, "sorted", sort)
    return found


def cloud(kind: str, size: int = 13) -> sg.Splats:
    """Noise on a grid: values, voxels classified before, or points."""
    samples = np.random.default_rng(11).random((size, size - 2, size + 3))
    if kind == "points":
        rng = np.random.default_rng(4)
        place = rng.random((900, 3)) * 11
        return sg.Splats.from_points(place, rng.random((900, 3)), np.full(900, 0.8), spacing=(1.0, 0.9, 1.2))
    grid = {"values": "cubes", "sheared": "sheared", "voxels": "1:2:5"}[kind]
    return sg.extract(sg.Volume(samples, **GRIDS[grid]), RAMP, classification="pre" if kind == "voxels" else "post")


KINDS = ("values", "sheared", "voxels", "points")


def cameras(splats: sg.Splats) -> dict[str, sg.Camera]:
    """And those on thresholds: an eye in a voxel's centre and on a plane of clusters, and an axis along an edge."""
    grid, middle = splats.grid, np.floor(splats.index_bounds.mean(axis=0))
    ends = middle - middle % (INSIDE + 1)
    eyes = {
        "on a voxel": middle,
        "on a cluster's plane": np.array([ends[0] - 0.5, middle[1], splats.index_bounds[0, 2]]),
    }
    places = {name: grid.world_from_index @ eye + grid.origin for name, eye in eyes.items()}
    found = {name: sg.Camera.look_at(eye, splats.corners[7], (0, 0, 1), 60, (32, 24)) for name, eye in places.items()}
    return views(splats) | {"inside": inside(splats, LOOKS[4])} | found


@pytest.mark.parametrize("kind", KINDS)
def test_clusters_hold_each_splat_once(kind: str) -> None:
    splats = cloud(kind)
    found = Clusters.of(splats)
    number = found.names & ((1 << NAME_BITS) - 1)
    assert (np.sort(number) == np.arange(len(splats))).all()
    cluster = np.repeat(np.arange(len(found.begin) - 1), np.diff(found.begin))
    position = splats.positions[number].T
    assert (found.low[:, cluster] <= position).all() and (position <= found.high[:, cluster]).all()
    assert (np.diff(found.begin) > 0).all() and len(np.unique(found.corner, axis=1).T) == len(found.begin) - 1
    assert ((np.diff(number.astype(np.int64)) > 0) | (np.diff(cluster) == 1)).all()
    # the cell that the shader takes from a name
    inside_ = np.stack([(found.names >> (NAME_BITS + axis * SIDE_BITS)) & INSIDE for axis in range(3)])
    assert (found.corner[:, cluster] + inside_ == splats.cells[number].T).all()


def seen_tiles(splats: sg.Splats, plan: Plan) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest pixel [2, N] that a splat's kernel reaches, each alone; NaN of those near the eye."""
    view = plan.view
    x, y, z = view.voxels(splats.positions)
    steps, deep = view.eye_from_index * view.kernel.radius, view.reach
    ahead = (z > 1.01 * deep) | (not view.perspective)
    ends = []
    for place, step in ((x, steps[0]), (y, steps[1])):
        if view.perspective:
            safe = np.where(ahead, z, 2 * deep)
            below, above = tangents(place, safe, step, steps[2])
            low, high = place / safe - below, place / safe + above
        else:
            low, high = place - np.linalg.norm(step), place + np.linalg.norm(step)
        ends.append(np.where(ahead, np.stack([low, high]), np.nan) / view.pitch)
    middle = np.array([view.size]).T / 2
    return (np.stack([end[side] for end in ends]) + middle for side in (0, 1))  # type: ignore[return-value]


@pytest.mark.parametrize("kind", KINDS)
def test_bounds_of_clusters_hold_what_their_splats_reach(kind: str) -> None:
    splats = cloud(kind)
    found = Clusters.of(splats)
    number = found.names & ((1 << NAME_BITS) - 1)
    cluster = np.repeat(np.arange(len(found.begin) - 1), np.diff(found.begin))
    for name, camera in cameras(splats).items():
        plan = sg.plan(splats, camera, WHOLE.replace(technique="tiles"), tiles=True)
        sheets = plan.resolved.sheets
        assert sheets is not None
        first, last = found.sheets(plan.view, sheets)
        base = sheets.base(sheets.places(plan.view, splats.positions[number]))
        assert (first[cluster] < base).all() and (base < last[cluster]).all(), name
        window = PixelWindow(8, 8, 16, 16)
        rectangle = touched_tiles(found.low, found.high, plan.view, window)[:, cluster]
        low, high = (ends[:, number] for ends in seen_tiles(splats, plan))
        for axis, (start, many, side) in enumerate(((window.x, 2, COLUMNS), (window.y, 2, ROWS))):
            for tile in range(many):
                begin = start + tile * side
                reached = (low[axis] <= begin + side - 0.5) & (high[axis] >= begin + 0.5)
                listed = (rectangle[axis] <= tile) & (tile < rectangle[axis + 2])
                assert (listed | ~reached).all(), name
        assert name != "far" or (rectangle[2] - rectangle[0]).max() <= 2


@pytest.mark.compute
@pytest.mark.parametrize(
    ("kind", "names"),
    [
        ("voxels", ("close",)),
        pytest.param("voxels", ("far",), marks=pytest.mark.long),
        pytest.param("values", ("fitted", "on a voxel"), marks=pytest.mark.long),
        pytest.param("sheared", ("fitted",), marks=pytest.mark.long),
        pytest.param("points", ("on a voxel", "parallel, close"), marks=pytest.mark.long),
    ],
)
def test_rounds_draw_what_all_splats_draw(
    processor: sg.Renderer, many_rounds: list[tuple[int, int]], kind: str, names: tuple[str, ...]
) -> None:
    """No visible cluster is left out, wherever the eye is; and the same bits twice."""
    splats = cloud(kind)
    for name in names:
        camera, settings = cameras(splats)[name], WHOLE.replace(antialias="auto" if name == "far" else "off")
        whole = processor.render(splats, camera, settings, verify_bound=False).pixels
        assert not many_rounds
        settings = settings.replace(occlusion="auto")
        ended = [processor.render(splats, camera, settings, verify_bound=False).pixels for _ in range(2)]
        cutoff = processor.plan(splats, camera, settings).hiding.cutoff
        assert len(many_rounds) > 5 and (ended[0] == ended[1]).all()
        assert np.abs(ended[0] - whole).max() <= 1.01 * cutoff + 4e-6, name
        many_rounds.clear()


@pytest.mark.compute
@pytest.mark.parametrize("name", ["close", pytest.param("on a voxel", marks=pytest.mark.long)])
def test_rounds_are_the_float64_picture(
    processor: sg.Renderer, many_rounds: list[tuple[int, int]], monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setattr(clustering, "LEAST", 40)
    splats = cloud("voxels", 8)
    camera, settings = cameras(splats)[name].resized((12, 9)), WHOLE.replace(occlusion="auto")
    found = processor.render(splats, camera, settings, verify_bound=False).pixels
    right = sg.reference.render(splats, camera, settings).pixels
    assert right[..., 3].max() > 0.1 and np.abs(found - right).max() < 2e-5
    assert len(many_rounds) > 3


def wall() -> sg.Splats:
    """An opaque wall before a block; rays along z."""
    samples = np.zeros((24, 40, 40), np.float32)
    samples[:6], samples[12:] = 1.0, 1.0
    return sg.extract(sg.Volume(samples), sg.Transfer([(0.2, 0), (0.6, 0.99)]), classification="pre")


@pytest.mark.compute
def test_what_is_behind_terminated_tiles_or_beside_the_picture_is_not_sorted(
    processor: sg.Renderer, many_rounds: list[tuple[int, int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(clustering, "LEAST", 3000)
    splats = wall()
    behind = int((splats.positions[:, 2] > 9).sum())
    eye, middle = np.array([19.5, 19.5, -400.0]), np.array([19.5, 19.5, 0.0])
    # only the wall's middle is in the picture
    camera = sg.Camera.look_at(eye, middle, (0, 1, 0), 3.0, (48, 48))
    processor.render(splats, camera, WHOLE, verify_bound=False)
    ended = processor.render(splats, camera, WHOLE.replace(occlusion="auto"), verify_bound=False).pixels
    assert ended[..., 3].min() > 0.99
    sorted_, placed = (sum(column) for column in zip(*many_rounds, strict=True))
    assert behind > 15_000 and 0 < 3 * placed < sorted_ < 1.2 * (len(splats) - behind)


def test_a_round_takes_only_clusters_with_open_tiles() -> None:
    """Against a search of each cluster's tiles; tiles terminate at random."""
    splats, rng = noise(size=14), np.random.default_rng(8)
    found = Clusters.of(splats)
    camera = replace(views(splats)["fitted"], size=(96, 64))
    plan = sg.plan(splats, camera, WHOLE.replace(technique="tiles"), tiles=True)
    window = PixelWindow(0, 0, 96, 64)
    tiles = touched_tiles(found.low, found.high, plan.view, window).T
    closed = (rng.random((8, 12)) < 0.3) | (np.arange(12) < 6)
    closed = closed.ravel()
    shown: set[int] = set()
    for part in rounds_of(found, splats, plan, window, closed):
        first, last = (
            ends - plan.resolved.sheets.range(splats, plan.view)[0]
            for ends in found.sheets(plan.view, plan.resolved.sheets)
        )
        seen = [not closed.reshape(8, 12)[y:lower, x:right].all() for x, y, right, lower in tiles]
        begin, end = part.sheets
        met = (last >= begin) & ((first < end) | part.last)
        assert set(part.clusters) == set(np.flatnonzero(np.array(seen) & met))
        shown |= set(part.clusters)
        closed |= rng.random(closed.size) < 0.3
    assert 0 < len(shown) < len(found.begin) - 1


def rounds_of(
    found: Clusters, splats: sg.Splats, plan: Plan, window: PixelWindow, closed: np.ndarray
) -> Iterator[RoundSplats]:
    """Rounds of few splats."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(clustering, "LEAST", 60)
        yield from found.rounds(splats, plan, window, lambda: closed)

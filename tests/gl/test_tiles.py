"""Splats gathered by tiles draw what quads draw, however they are portioned; tiles that have ended hide no more than
they may."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.gl import tiles
from splatgl.planning import technique
from splatgl.planning.culling import BLOCK, Frustum, block_boxes, blocks_in_frustum
from splatgl.splat.kernels import kernel, polynomials, single_reach
from tests.helpers.noise import GRIDS, LOOKS, inside, noise, views
from tests.helpers.splatting import SPLATS, each_two

TILED = SPLATS.replace(technique="tiles")
# polynomials are off by 4e−5 of the footprint, colours by 1e−5
SAME = 5e-5


def apart(renderer: sg.Renderer, splats: sg.Splats, camera: sg.Camera, settings: sg.Settings) -> float:
    """The largest difference between tiles and quads, in shares of what is brightest, if that is over 1."""
    assert renderer.plan(splats, camera, settings.replace(technique="tiles")).program.technique == "tiles"
    quads = renderer.render(splats, camera, settings.replace(technique="quads")).pixels
    found = renderer.render(splats, camera, settings.replace(technique="tiles")).pixels
    assert quads.max() > 0.05 and np.isfinite(found).all()
    return float(np.abs(found - quads).max() / max(quads.max(), 1.0))


@pytest.mark.turns(2)
@pytest.mark.few(5)
@pytest.mark.parametrize(("grid", "view", "blend"), each_two(GRIDS, views(noise()), ("composite", "xray", "mip")))
def test_tiles_draw_what_quads_draw(renderer: sg.Renderer, grid: str, view: str, blend: str) -> None:
    splats = noise(grid)
    for name in ("crawfis-max", "gaussian"):
        settings = SPLATS.replace(blend=blend, kernel=name, occlusion="off", order="front-to-back")
        assert apart(renderer, splats, views(splats)[view], settings) < SAME


@pytest.mark.few(2)
@pytest.mark.parametrize("attenuation", ["opacity", "optical-depth", "fill"])
@pytest.mark.parametrize("view", ["far", "parallel, far"])
@pytest.mark.parametrize("grid", ["cubes", "1:2:5"])
def test_attenuation_is_the_same(renderer: sg.Renderer, grid: str, view: str, attenuation: str) -> None:
    splats = noise(grid)
    settings = SPLATS.replace(attenuation=attenuation, occlusion="off")
    assert renderer.plan(splats, views(splats)[view], settings).program.seen.antialias
    assert apart(renderer, splats, views(splats)[view], settings) < SAME


@pytest.mark.parametrize(
    "change", [{"antialias": "supersample"}, {"background": (0.2, 0.4, 0.6)}, {"table_size": 1024}], ids=str
)
def test_what_follows_and_other_footprints_are_the_same(renderer: sg.Renderer, change: dict) -> None:
    splats = noise()
    assert apart(renderer, splats, views(splats)["fitted"], SPLATS.replace(occlusion="off", **change)) < SAME


@pytest.mark.turns(2)
@pytest.mark.few(4)
@pytest.mark.parametrize(
    "portions",
    [
        *({"MOST": 100}, {"MOST_LISTED": 600}, {"ROUNDS": 24}, {"ROUNDS": 1}, {"MOST_TILES": 5}),
        {"MOST": 333, "MOST_LISTED": 500, "ROUNDS": 12},
    ],
    ids=str,
)
@pytest.mark.parametrize("blend", ["composite", "xray", "mip"])
def test_portions_draw_the_same(
    renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch, portions: dict[str, int], blend: str
) -> None:
    splats = noise()
    for view in ("fitted", "far"):
        camera, settings = views(splats)[view], TILED.replace(blend=blend)
        whole = renderer.render(splats, camera, settings).pixels
        with monkeypatch.context() as patched:
            for name, value in portions.items():
                patched.setattr(tiles, name, value)
            portioned = renderer.render(splats, camera, settings).pixels
        passing = renderer.plan(splats, camera, settings).hiding.cutoff
        assert np.abs(whole - portioned).max() < 2e-6 * max(whole.max(), 1.0) + passing


@pytest.mark.long
def test_more_splats_on_a_tile_than_a_loop_has_rounds(renderer: sg.Renderer) -> None:
    """Software OpenGL ends a loop after 65535, and each joins four."""
    rng = np.random.default_rng(5)
    count = 300_000
    cloud = sg.Splats.from_points(rng.random((count, 3)) * 4, rng.random((count, 3)), np.full(count, 1e-4))
    camera = sg.Camera.orbit(cloud, 30, 20, size=(8, 8))
    assert apart(renderer, cloud, camera, SPLATS.replace(blend="xray")) < SAME
    assert apart(renderer, cloud, camera, SPLATS.replace(occlusion="off")) < SAME


@pytest.mark.few(1)
@pytest.mark.parametrize("grid", GRIDS)
def test_tiles_that_end_hide_no_more_than_they_may(
    renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch, grid: str
) -> None:
    """Seen whole and from near, in one part and in several."""
    splats = noise(grid, size=24, opacity=0.95)
    for view in ("fitted", "close", "parallel"):
        camera = views(splats)[view]
        whole = renderer.render(splats, camera, TILED.replace(occlusion="off")).pixels
        monkeypatch.setattr(technique, "SOLID", 0.0)
        for many in (10**9, 1000):
            monkeypatch.setattr(technique, "MANY", many)
            chosen = renderer.plan(splats, camera, TILED)
            assert 0 < chosen.hiding.cutoff < 1e-3 and (chosen.hiding.depth_batches > 1) == (many == 1000)
            ended = renderer.render(splats, camera, TILED).pixels
            changed = float(np.abs(ended - whole).max())
            assert changed <= chosen.hiding.cutoff * 1.01 + 1e-6
            assert changed > 0 or grid != "cubes" or view != "fitted"


def test_who_gets_tiles(renderer: sg.Renderer) -> None:
    splats = noise()
    camera = views(splats)["close"]
    assert sg.plan(splats, camera, SPLATS, tiles=True).program.technique == "tiles"
    # a graphics card, or one without compute shaders; a target or an order that tiles have not
    assert sg.plan(splats, camera, SPLATS, tiles=False).program.technique == "quads"
    assert sg.plan(splats, camera, TILED, tiles=False).program.technique == "tiles"
    for other in ({"target": "rgba16f"}, {"order": "back-to-front"}, {"footprint": "table"}):
        assert sg.plan(splats, camera, SPLATS.replace(**other), tiles=True).program.technique == "quads"
        with pytest.raises(sg.InputError, match=r"^technique tiles: expected"):
            sg.plan(splats, camera, TILED.replace(**other), tiles=True)
    with pytest.raises(sg.InputError, match=r"^technique tiles: expected .* without compute shaders"):
        sg.plan(splats, camera, TILED, tiles=None)


def test_a_moving_camera_compiles_nothing_and_grows_nothing(renderer: sg.Renderer) -> None:
    splats = noise()
    settings = TILED.replace(occlusion="off")

    def kept() -> tuple[object, ...]:
        programs, drawn = renderer.passes.device.programs, renderer.passes.tiles
        return programs.compiled, [id(part) for part in (*drawn.placed.textures, drawn.placed.list)]

    # an order that is asked for again is read by another program
    for angle in (0, 0, 40):
        renderer.render(splats, sg.Camera.orbit(splats, angle, 20, size=(64, 48)), settings)
    before = kept()
    for angle in range(0, 40, 8):
        renderer.render(splats, sg.Camera.orbit(splats, angle, 20, size=(64, 48)), settings)
    assert kept() == before


def test_a_deep_splat_and_a_faint_one(renderer: sg.Renderer) -> None:
    """Halved as often as the deepest needs, no opacity loses digits."""
    for opacity in (1e-6, 1e-3, 0.3, 0.9, 0.9999, 1.0):
        splats = noise(size=4, opacity=opacity)
        camera = views(splats)["fitted"]
        right = sg.reference.render(splats, camera, SPLATS).pixels
        found = renderer.render(splats, camera, TILED.replace(occlusion="off")).pixels
        assert np.abs(found - right).max() < 5e-5 * right.max()


def test_polynomials_are_close_to_the_footprint() -> None:
    fitted, shape = polynomials("crawfis-max"), kernel("crawfis-max")
    assert fitted is not None and polynomials("gaussian") is None
    s = np.linspace(0, 0.998, 5000)
    right = shape.footprint(np.sqrt(s) * shape.radius) / shape.footprint(np.zeros(()))
    assert np.abs(fitted(s) / right - 1).max() < 5e-5
    assert fitted(np.ones(1)) == 0 and fitted(np.full(1, 2.0)) == 0


@pytest.mark.few(1)
@pytest.mark.parametrize("name", ["b-spline", "crawfis-max", "gaussian"])
def test_what_single_footprints_may_leave_out(name: str) -> None:
    """A share of a kernel's mass lies beyond their reach along lines, and no less: more of it to a larger tolerance."""
    shape = kernel(name)
    across = (np.arange(600) + 0.5) / 300 * shape.radius - shape.radius
    far = np.hypot(across[:, None], across)
    mass = shape.footprint(far)
    for tolerance, share in ((1 / 255, 2e-4), (4 / 255, 0.01), (0.5, 0.03)):
        reach = single_reach(name, tolerance) * shape.radius
        assert 0.5 * share < mass[far > reach].sum() / mass.sum() < 1.05 * share


@pytest.mark.long
def test_a_lenient_tolerance_keeps_the_picture(renderer: sg.Renderer) -> None:
    """What is drawn to eight levels, as in motion, is off by less than one on average."""
    volume = sg.scenes.ball(12)
    splats = sg.extract(volume, sg.default_transfer(volume))
    camera = sg.Camera.orbit(splats, 30, 20, size=(96, 72))
    right = renderer.render(splats, camera, sg.Settings(antialias="paper"))
    lenient = renderer.render(splats, camera, sg.Settings(antialias="paper", tolerance=8 / 255))
    apart = np.abs(lenient.pixels - right.pixels)
    assert 0 < np.sqrt((apart**2).mean()) < 1 / 255 and apart.max() < 16 / 255


def test_an_order_asked_for_again_is_read_in_turn(renderer: sg.Renderer) -> None:
    """From sorted records or by indices, the picture is the same bit for bit; others come and go between."""
    splats = noise()
    camera, other = (sg.Camera.orbit(splats, angle, 20, size=(64, 48)) for angle in (30, 140))
    for change in ({}, {"attenuation": "fill", "antialias": "paper"}):
        settings = TILED.replace(occlusion="off", **change)
        renderer.passes.device.splats.release()
        first = renderer.render(splats, camera, settings).pixels
        kept = renderer.passes.device.splats.of(splats).textured
        assert kept is not None and kept.sorted is None
        again = [renderer.render(splats, camera, settings).pixels for _ in range(2)]
        assert kept.sorted is not None and kept.sorted[1].order is None
        renderer.render(splats, other, settings)
        again.append(renderer.render(splats, camera, settings).pixels)
        assert all((pixels == first).all() for pixels in again)


def test_sorted_records_without_runs_do_not_serve_who_needs_them(renderer: sg.Renderer) -> None:
    splats = noise()
    camera = views(splats)["far"]
    plain, filled = (TILED.replace(occlusion="off", attenuation=name) for name in ("optical-depth", "fill"))
    right = renderer.render(splats, camera, filled).pixels
    renderer.passes.device.splats.release()
    for _ in range(2):
        renderer.render(splats, camera, plain)
    assert renderer.passes.device.splats.of(splats).textured.sorted is not None  # type: ignore[union-attr]
    assert (renderer.render(splats, camera, filled).pixels == right).all()


@pytest.mark.long
def test_blocks_beyond_the_edges_are_left_out(renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where an order is asked for again; the picture is the same bit for bit, also in portions."""
    for grid in ("cubes", "sheared"):
        splats = noise(grid, size=30, opacity=0.3)
        cameras = {name: view for name, view in views(splats).items() if "close" in name or name == "far"}
        for camera in (*cameras.values(), inside(splats, LOOKS[0]), inside(splats, LOOKS[1], fov=15)):
            for settings in (SPLATS.replace(occlusion="off"), SPLATS.replace(blend="xray", antialias="off")):
                renderer.passes.device.splats.release()
                first = renderer.render(splats, camera, settings).pixels
                for most in (2**20, 3000):
                    with monkeypatch.context() as patched:
                        patched.setattr(tiles, "MOST", most)
                        again = renderer.render(splats, camera, settings).pixels
                    assert np.abs(again - first).max() <= 1e-6 * first.max()


def test_a_block_is_left_out_only_if_all_of_it_is_beyond_the_edges() -> None:
    splats = noise(size=30)
    positions = splats.positions
    assert len(block_boxes(positions)) == -(-len(splats) // BLOCK)
    # as small as they are beside a large volume
    few = 8
    around = block_boxes(positions, few)
    outside = list(views(splats).values())
    left_out = 0
    for camera in (*outside, *(inside(splats, look) for look in LOOKS)):
        chosen = sg.plan(splats, camera, SPLATS)
        frustum = Frustum.of(chosen.view)
        seen = np.repeat(blocks_in_frustum(around, frustum), few)[: len(splats)]
        one_by_one = frustum.may_show(chosen.view.voxels(positions))
        assert (one_by_one <= seen).all()
        left_out += int((~seen).sum())
    assert left_out > len(splats)


def test_a_splat_may_reach_more_tiles_than_a_loop_has_rounds(renderer: sg.Renderer) -> None:
    """Behind another that has taken most of them: nothing of it is listed twice."""
    side = 2120
    assert (side // technique.COLUMNS) ** 2 > 65_535
    places = np.array([[0.0, 0.0, 2.0], [0.0, 0.0, 3.0]])
    splats = sg.Splats.from_points(places, np.ones((2, 3)), np.full(2, 0.5), spacing=(40, 40, 1))
    camera = sg.Camera.orthographic((0, 0, 0), (0, 0, 1), (0, 1, 0), 4.0, (side, side))
    drawn = renderer.render(splats, camera, TILED.replace(blend="xray", antialias="off"), verify_bound=False).pixels
    # sums of what is listed twice would be twice as large; the whole picture is near both centres
    right = sg.reference.render(
        splats, replace(camera, size=(4, 4)), SPLATS.replace(blend="xray", antialias="off")
    ).pixels
    assert drawn.min() > 0
    found = drawn[side // 8 :: side // 4, side // 8 :: side // 4]
    np.testing.assert_allclose(found, right, rtol=1e-3)


@pytest.mark.long
def test_few_voxels_fill_a_large_picture(renderer: sg.Renderer) -> None:
    """Each reaches more tiles than a loop has rounds, and a dispatch has groups."""
    volume, settings = sg.Volume(np.random.default_rng(1).random((4, 4, 4), np.float32)), sg.Settings.like("0.1")
    splats = sg.extract(volume, sg.default_transfer(volume))
    camera = sg.Camera.orbit(volume, 30, 20, size=(3000, 3000), zoom=3)
    drawn = renderer.render(splats, camera, settings, verify_bound=False)
    checked: Any = sg.check(drawn, splats, camera, settings).info["checked"]
    assert drawn.info["technique"] == "tiles" and checked["pixels"] >= 60 and checked["largest"] < 1e-3


def test_compute_shaders_that_do_nothing_are_told(processor: sg.Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    """As where a context is lost: one line instead of waiting forever."""
    splats = noise()
    # no round for anybody
    monkeypatch.setattr(tiles, "ROUNDS", 0)
    with pytest.raises(sg.InputError, match="compute shaders do nothing"):
        processor.render(splats, views(splats)["fitted"], TILED)

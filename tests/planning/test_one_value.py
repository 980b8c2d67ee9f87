"""Blends of one value of a ray: maximum, minimum and mean of what is reconstructed, then classified."""

from __future__ import annotations

from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.gl import quads, sheet_tiles, tiles
from splatgl.gl.target import Interrupted
from splatgl.planning.resolve import extract_for_settings, select_splats
from splatgl.planning.technique import COLUMNS, ROWS
from splatgl.reference.blend import join_values, joined_value
from splatgl.reference.field import field_integral
from splatgl.scene.view import ViewOptions
from splatgl.splat.settings import BLENDS, Technique
from tests.helpers.noise import GRIDS, LOOKS, inside, views
from tests.helpers.splatting import spread

pytestmark = pytest.mark.usefixtures("shared_programs")

TECHNIQUES = ("tiles", "quads")
BLENDED = tuple(name for name in BLENDS if sg.Settings(blend=name).shows_value)
EXACT = sg.Settings(tolerance=1e-6, antialias="off")
RAMP = sg.Transfer([(0.2, 0), (0.8, 0.9)], colormap="hot")


@cache
def cells(size: int = 10, smoothed: int = 1) -> np.ndarray:
    """Noise without its highest frequencies."""
    found = np.random.default_rng(2).random((size, size, size))
    for axis in (0, 1, 2) * smoothed:
        found = (np.roll(found, 1, axis) + 2 * found + np.roll(found, -1, axis)) / 4
    return np.asarray((found - found.min()) / np.ptp(found))


def every(samples: np.ndarray, transfer: sg.Transfer = RAMP, **placed: Any) -> sg.Splats:
    return sg.extract(sg.Volume(samples, **placed), transfer, classification="post-all")


def eyes(splats: sg.Splats) -> dict[str, sg.Camera]:
    return views(splats) | {"inside": inside(splats, LOOKS[4])}


def difference(renderer: sg.Renderer, splats: sg.Splats, camera: sg.Camera, settings: sg.Settings) -> float:
    """Of the picture to its twin, relative to its brightest if that is more than 1."""
    found = renderer.render(splats, camera, settings, verify_bound=False).pixels
    right = sg.reference.render(splats, camera, settings).pixels
    assert right[..., 3].max() > 0.1 and np.isfinite(found).all()
    return float(np.abs(found - right).max() / max(right.max(), 1))


PLACES = (
    ("cubes", "fitted", {"antialias": "supersample", "samples": 2, "background": (0.2, 0.4, 0.6)}),
    ("sheared", "inside", {"sheets": 2, "steps": 1}),
    ("8:1", "parallel, close", {"sheets": 4, "steps": 3}),
)


@pytest.mark.turns(2)
@pytest.mark.few(1)
@pytest.mark.parametrize(("technique", "blend", "place"), spread(12, TECHNIQUES, (*BLENDED, "xray"), PLACES), ids=str)
def test_the_picture_is_its_twin(
    renderer: sg.Renderer, technique: Technique, blend: str, place: tuple[str, str, dict[str, Any]]
) -> None:
    grid, view, changes = place
    placed = {"spacing": (1.0, 1.0, 8.0)} if grid == "8:1" else GRIDS[grid]
    splats = every(cells(), **placed)
    assert len(splats) == cells().size
    settings = EXACT.replace(blend=blend, technique=technique, **changes)
    # classes are means over the cells of a table
    assert difference(renderer, splats, eyes(splats)[view], settings) < 2e-4


@pytest.mark.long
@pytest.mark.parametrize("blend", BLENDED)
def test_without_compute_shaders_quads_draw_the_same(
    renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch, blend: str
) -> None:
    """Bit for bit, also after another blend and view, and after all was released."""
    splats, settings = every(cells()), EXACT.replace(blend=blend)
    camera, other = eyes(splats)["fitted"], eyes(splats)["close"].resized((60, 20))
    tiles_drew = renderer.render(splats, camera, settings, verify_bound=False).pixels
    monkeypatch.setattr(renderer, "tiles", None)
    found = []
    for between in (
        lambda: renderer.passes.release(),
        *(partial(renderer.render, splats, other, EXACT.replace(blend=name)) for name in BLENDS),
    ):
        between()
        image = renderer.render(splats, camera, settings, verify_bound=False)
        assert image.info["technique"] == "quads"
        found.append(image.pixels)
    assert all((each == found[0]).all() for each in found)
    assert tiles_drew.max() > 0.5 and np.abs(found[0] - tiles_drew).max() < 1e-5


@pytest.mark.compute
@pytest.mark.parametrize("blend", ["mip", "mean"])
def test_sheets_of_one_value_hold_no_gradients(
    processor: sg.Renderer, monkeypatch: pytest.MonkeyPatch, blend: str
) -> None:
    """Of open sheets that are stored between portions, only values and masses, as nothing reads the others."""
    monkeypatch.setattr(tiles, "MOST", 100)
    splats = every(cells())
    held = {}
    for name in (blend, "composite"):
        processor.free()
        rings = processor.passes.tiles.buffers.bind(sheet_tiles.RINGS, 30 * sheet_tiles.RING_BYTES)
        rings.clear()
        settings = EXACT.replace(blend=name, occlusion="off")
        processor.render(splats, eyes(splats)["fitted"], settings, verify_bound=False)
        assert rings.mglo is not None and rings.size == 30 * sheet_tiles.RING_BYTES
        stored = np.frombuffer(rings.read(), np.float32).reshape(30, -1, ROWS * COLUMNS, 4)
        # three sums of open sheets, and those of the last two
        held[name] = stored[:, [0, 1, 2, 5, 6]]
    assert held["composite"][..., :3].any() and held[blend][..., 3].any()
    assert not held[blend][..., :3].any()


@pytest.mark.few(1)
@pytest.mark.parametrize("technique", TECHNIQUES)
@pytest.mark.parametrize("kept", [(1.999, 2.0), (0.0, 0.001)], ids=["negative", "large"])
def test_values_may_be_far_from_those_they_were_extracted_for(
    renderer: sg.Renderer, kept: tuple[float, float], technique: Technique
) -> None:
    """Records relative to another transfer function's range: they are below it, or beyond."""
    splats = every(cells(), sg.Transfer([(kept[0], 0), (kept[1], 1)]))
    splats = splats.with_classifier(splats.post.with_transfer(RAMP))
    assert splats.records["value"].max() < -300 if kept[0] else splats.records["value"].max() > 900
    for blend in BLENDED:
        settings = EXACT.replace(blend=blend, technique=technique)
        assert difference(renderer, splats, eyes(splats)["fitted"], settings) < 2e-4


@pytest.mark.few(1)
@pytest.mark.parametrize("blend", ["composite", *BLENDED])
def test_quads_in_bands_draw_the_same(renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch, blend: str) -> None:
    """Of any number of rows, also after one was cancelled within a band; nothing reaches the outer ones."""
    splats, settings = every(cells()), EXACT.replace(blend=blend, technique="quads", sheets=2, steps=1)
    for view, rows in (("parallel", 8), ("inside", 24)):
        camera = eyes(splats)[view]
        whole = renderer.render(splats, camera, settings, verify_bound=False).pixels
        with monkeypatch.context() as patched:
            patched.setattr(quads, "MOST_PIXELS", rows * camera.size[0])
            # a ring with more rows would serve
            renderer.free()
            answers = iter([*[False] * 30, True])
            with pytest.raises(Interrupted):
                renderer.render(splats, camera, settings, interrupted=partial(next, answers))
            found = renderer.render(splats, camera, settings, verify_bound=False).pixels
            drawing = renderer.passes.techniques["sheets in quads"]
            assert isinstance(drawing, quads.SheetQuads) and drawing.ring is not None
            assert (drawing.ring.kind.size, drawing.ring.kind.rows) == (camera.size, rows)
        assert whole[..., 3].max() > 0.1 and np.abs(found - whole).max() < 2e-5


@pytest.mark.long
@pytest.mark.parametrize("blend", BLENDED)
def test_batches_draw_the_same(renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch, blend: str) -> None:
    """What is kept of a pixel between two portions is classified once, at the end."""
    splats = every(cells())
    settings = EXACT.replace(blend=blend, sheets=3, steps=1)
    # tiles of the larger picture leave the box before their list ends
    for view, size in (("fitted", (48, 36)), ("close", (48, 36)), ("fitted", (144, 108))):
        camera = eyes(splats)[view].resized(size)
        whole = renderer.render(splats, camera, settings, verify_bound=False).pixels
        for module, name, value in ((tiles, "MOST", 100), (sheet_tiles, "MOST_ENTRIES", 16)):
            with monkeypatch.context() as patched:
                patched.setattr(module, name, value)
                parts = renderer.render(splats, camera, settings, verify_bound=False).pixels
            assert whole[..., 3].max() > 0.4 and np.abs(whole - parts).max() < 1e-5


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("grid", "blend"), [*(("cubes", blend) for blend in BLENDED), ("sheared", "mip"), ("8:1", "mip")]
)
@pytest.mark.compute
def test_a_constant_is_what_the_transfer_function_says(renderer: sg.Renderer, grid: str, blend: str) -> None:
    """Wherever a ray is in the box, also where it only grazes a corner or an edge; elsewhere nothing."""
    placed = {"spacing": (1.0, 1.0, 8.0)} if grid == "8:1" else GRIDS[grid]
    transfer = sg.Transfer([(0, 0.2), (1, 0.7)], colormap="hot", unit=2.0)
    for shape in ((6, 7, 8), (1, 7, 8), (1, 1, 8), (1, 1, 1)):
        volume = sg.Volume(np.full(shape, 0.5), **placed)
        splats = every(volume.samples, transfer, **placed)
        right = np.append(transfer.color(np.array(0.5)), 1.0) * transfer.opacity(0.5)
        for camera in (sg.Camera.orbit(volume, 30, 20, size=(16, 14)), sg.Camera.orbit(volume, 0, 0, size=(16, 14))):
            field = field_integral(volume, transfer, camera, steps_per_voxel=1, blend=blend).pixels
            settings = EXACT.replace(blend=blend)
            twin, four = (
                sg.reference.render(splats, camera, settings.replace(**changes)).pixels
                for changes in ({}, {"sheets": 4})
            )
            drawn, by_quads = (
                renderer.render(splats, camera, settings.replace(technique=technique), verify_bound=False).pixels
                for technique in TECHNIQUES
            )
            seen = field[..., 3] > 0
            assert seen.any() and not seen.all()
            for found, allowed in ((field, 1e-9), (twin, 1e-9), (four, 1e-9), (drawn, 1e-4), (by_quads, 1e-4)):
                assert np.abs(found[seen] - right).max() < allowed
                assert (found[~seen] == 0).all()


@pytest.mark.few(1)
@pytest.mark.parametrize("blend", BLENDED)
def test_sheets_draw_the_fields_value(blend: str) -> None:
    """The nearer, the more sheets."""
    volume = sg.Volume(cells(20, 2))
    transfer = sg.Transfer([(0, 0), (1, 1)])
    camera = ViewOptions((20, 20), fit="0.3").camera(volume, volume)
    right = field_integral(volume, transfer, camera, steps_per_voxel=6, blend=blend).pixels[..., 3]
    splats = every(volume.samples, transfer)
    missed = []
    for changes in ({"sheets": 2}, {"sheets": 3}, {"sheets": 4}, {"sheets": 3, "steps": 1}):
        found = sg.reference.render(splats, camera, EXACT.replace(blend=blend, **changes)).pixels[..., 3]
        assert np.abs(found - right).max() < 0.06
        missed.append(float(np.sqrt(((found - right) ** 2).mean())))
    assert missed[0] > missed[1] > missed[2] and missed[1] < (0.0006 if blend == "mean" else 0.0045)
    # both ends and the middle of a part tell its mean, and nearly its extremes
    assert abs(missed[3] / missed[1] - 1) < {"minip": 0.012, "attenuated-mip": 0.1}.get(blend, 0.001)


def test_a_maximum_is_no_less_than_a_mean_and_that_than_a_minimum(renderer: sg.Renderer) -> None:
    splats = every(cells())
    camera = eyes(splats)["fitted"]
    low, middle, high = (
        renderer.render(splats, camera, EXACT.replace(blend=blend), verify_bound=False).pixels[..., 3]
        for blend in ("minip", "mean", "mip")
    )
    assert (low <= middle + 1e-5).all() and (middle <= high + 1e-5).all() and (high - low).max() > 0.5


@pytest.mark.few(1)
@pytest.mark.parametrize("technique", TECHNIQUES)
@pytest.mark.parametrize("blend", BLENDED)
def test_missing_voxels_have_no_share(renderer: sg.Renderer, blend: str, technique: Technique) -> None:
    """A ray through nothing else shows nothing; others show what is left."""
    holes = np.full((8, 12, 12), 0.5)
    holes[:, :, :7] = np.nan
    splats = every(holes)
    camera = sg.Camera.orbit(sg.Volume(np.ones(holes.shape)), 90, 0, size=(24, 24)).parallel(sg.Volume(holes))
    settings = EXACT.replace(blend=blend, technique=technique)
    assert difference(renderer, splats, camera, settings) < 1e-4
    alpha = renderer.render(splats, camera, settings, verify_bound=False).pixels[..., 3]
    field = field_integral(sg.Volume(holes), RAMP, camera, steps_per_voxel=2, blend=blend).pixels[..., 3]
    for found in (alpha, field):
        assert np.abs(found[found > 0] - RAMP.opacity(0.5)).max() < 0.03
    # sheets end where little is left of a kernel, the field where nothing is
    assert 0.2 < (alpha > 0).mean() <= (field > 0).mean() < 0.8 and ((alpha > 0) != (field > 0)).mean() < 0.1


def test_every_voxel_also_serves_compositing() -> None:
    r = np.linalg.norm(np.indices((16, 16, 16)) - 7.5, axis=0)
    ball = 1 / (1 + np.exp((r - 4) / 0.8))
    splats, few = every(ball), sg.extract(sg.Volume(ball), RAMP, classification="post")
    assert len(few) < 0.7 * len(splats) == 0.7 * ball.size
    camera = eyes(splats)["fitted"]
    pictures = [sg.reference.render(some, camera, EXACT).pixels for some in (splats, few)]
    assert np.abs(pictures[0] - pictures[1]).max() < 1e-3


def test_another_transfer_function_colours_the_same_value(renderer: sg.Renderer) -> None:
    """The value is what the transfer function does not change, if it rises."""
    splats = every(cells())
    camera, settings = eyes(splats)["fitted"], EXACT.replace(blend="mip")
    other = splats.with_classifier(splats.post.with_transfer(sg.Transfer([(0.2, 0), (0.8, 0.5)], colormap="viridis")))
    one, two = (renderer.render(some, camera, settings, verify_bound=False).pixels[..., 3] for some in (splats, other))
    assert np.abs(one * (0.5 / 0.9) - two).max() < 1e-4 and one.max() > 0.5


def test_joins() -> None:
    light = np.zeros((3, 4))
    for value, length in ((-2.0, 0.5), (-3.0, 1.0), (5.0, 0.0)):
        light = join_values(light, np.full(3, value), np.array([length, length, 0.0]), "max")
    assert np.array_equal(joined_value(light, "max"), [-2, -2, np.nan], equal_nan=True)
    low = join_values(
        join_values(np.zeros((1, 4)), np.array([4.0]), np.ones(1), "min"), np.array([3.0]), np.ones(1), "min"
    )
    assert joined_value(low, "min") == [3]
    mean = join_values(
        join_values(np.zeros((1, 4)), np.array([4.0]), np.ones(1), "mean"), np.array([1.0]), np.full(1, 3.0), "mean"
    )
    assert joined_value(mean, "mean") == [1.75]


@pytest.mark.parametrize(
    ("how", "changes", "said"),
    [
        ("post", {"blend": "mip"}, '^blend mip takes all voxels, .*: render with .* extract with .*"post-all"$'),
        ("post", {"blend": "mean"}, "^blend mean takes all voxels"),
        ("pre", {"blend": "minip"}, "^blend minip takes all voxels, classified after reconstruction"),
        (
            "post-all",
            {"blend": "mip", "shading": "on"},
            "^shading: expected auto or off, as mip shows values, not surf",
        ),
    ],
    ids=str,
)
def test_what_cannot_be_drawn_is_told(how: str, changes: dict[str, Any], said: str) -> None:
    splats = sg.extract(sg.Volume(cells()), RAMP, classification=how)
    with pytest.raises(sg.InputError, match=said) as error:
        sg.plan(splats, eyes(splats)["fitted"], sg.Settings(**changes), tiles=True)
    assert "\n" not in str(error.value)


def noisy_block(deviation: float = 0.0) -> sg.Volume:
    """A bright block in noise that ends below it, or of a deviation."""
    rng, shape = np.random.default_rng(5), (22, 26, 30)
    samples = rng.normal(0, deviation, shape) if deviation else rng.uniform(0, 0.2, shape)
    samples[9:12, 10:13, 12:16] += 0.6
    return sg.Volume(samples)


@pytest.mark.parametrize(("deviation", "most"), [(0.0, 13 * 13 * 14), (0.05, 15_500)], ids=["clear", "in noise"])
def test_maxima_take_what_opaque_values_depend_on(deviation: float, most: int) -> None:
    """The float64 picture is that of all voxels: where noise is transparent, and where some of it is not."""
    volume, transfer = noisy_block(deviation), sg.Transfer([(0.18 if deviation else 0.23, 0), (0.8, 0.9)])
    some, every = (sg.extract(volume, transfer, classification=how) for how in ("post-max", "post-all"))
    assert len(every) == volume.count and 0 < len(some) <= most
    camera, settings = sg.Camera.orbit(volume, 30, 20, size=(40, 40)), EXACT.replace(blend="mip")
    found, right = (sg.reference.render(splats, camera, settings).pixels for splats in (some, every))
    assert right[..., 3].max() > 0.5 and np.abs(found - right).max() < 1e-9


def test_maxima_above_all_samples_are_found() -> None:
    """A field of noise exceeds its samples: by a step beyond them, maxima are those of all voxels."""
    noise = np.random.default_rng(3).uniform(0, 100, (20, 20, 20)).astype(np.float32)
    camera, settings = sg.Camera.orbit(sg.Volume(noise), 30, 20, size=(40, 40)), EXACT.replace(blend="mip")
    for start in (95.0, 102.0, 105.0):
        transfer = sg.Transfer([(start, 0.0), (start + 0.01, 1.0)])
        some, every = (sg.extract(sg.Volume(noise), transfer, classification=how) for how in ("post-max", "post-all"))
        found, right = (sg.reference.render(splats, camera, settings).pixels for splats in (some, every))
        assert right[..., 3].max() > 0.5 and np.abs(found - right).max() < 1e-9


def test_other_blends_extract_the_voxels_that_they_need() -> None:
    volume, transfer = noisy_block(), sg.Transfer([(0.3, 0), (0.8, 0.9)])
    splats = extract_for_settings(volume, transfer, sg.Settings(blend="mip"))
    assert splats.post is not None and splats.post.largest and splats.post.is_current
    assert select_splats(splats, sg.Settings(blend="mip"), False) is splats
    for blend in ("minip", "mean", "attenuated-mip"):
        assert len(select_splats(splats, sg.Settings(blend=blend), False)) == volume.count
    composite = select_splats(splats, sg.Settings(), False)
    assert composite.post is not None and not composite.post.largest and len(composite) < len(splats)
    # what begins higher is there; what begins lower is not
    assert splats.post.holds(sg.Transfer([(0.4, 0), (0.7, 0.9)]))
    assert not splats.post.holds(sg.Transfer([(0.1, 0), (0.7, 0.9)]))


def test_maxima_without_transparent_values_take_all_voxels() -> None:
    volume = noisy_block()
    for points in ([(0, 0.1), (1, 0.9)], [(0, 0.3), (0.2, 0.0), (0.5, 0.0), (0.8, 0.9)]):
        assert len(sg.extract(volume, sg.Transfer(points), classification="post-max")) == volume.count
    assert not len(sg.extract(volume, sg.Transfer([(5, 0), (6, 1)]), classification="post-max"))


def test_the_plan_tells_what_it_does() -> None:
    splats = sg.extract(sg.Volume(cells()), sg.Transfer(RAMP.points, shading=True), classification="post-all")
    for blend in BLENDED:
        told = sg.plan(splats, eyes(splats)["fitted"], sg.Settings(blend=blend), tiles=True).explain()
        assert "shading left out" in told and "ordering left out" not in told and "2 parts each" in told


@pytest.mark.long
def test_the_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    np.save("noise.npy", cells().astype(np.float32))
    asked = ["render", "noise.npy", "--points", "0.2:0,0.8:1", "--size", "32", "--antialias", "off"]
    asked += ["--background", "transparent"]
    found = {}
    for blend in ("mip", "minip"):
        assert main([*asked, "--blend", blend, "-o", f"{blend}.npy"]) == 0
        found[blend] = np.load(f"{blend}.npy")[..., 3]
    assert 0 < found["minip"].sum() < 0.5 * found["mip"].sum()
    asked += ["--classification", "pre"]
    assert main([*asked, "--blend", "minip", "-o", "none.npy"]) == 2 and not Path("none.npy").exists()


def test_maxima_of_voxels_classified_before_are_their_opacities(renderer: sg.Renderer) -> None:
    """Whatever their size and the length to which opacities refer."""
    samples = np.zeros((3, 3, 3))
    samples[1, 1, 1] = 1
    camera = sg.Camera.orthographic((2.5, 2.5, -20), (2.5, 2.5, 2.5), (0, 1, 0), height=2.5, size=(5, 5))
    for unit in (0.5, 4.0):
        transfer = sg.Transfer([(0, 0), (1, 0.3)], unit=unit)
        splats = sg.extract(sg.Volume(samples, (2.5,) * 3), transfer, classification="pre")
        found = renderer.render(splats, camera, sg.Settings(blend="mip", compositing="splats", antialias="off"))
        assert found.pixels[2, 2, 3] == pytest.approx(0.3, abs=1e-4)


@pytest.mark.parametrize("blend", BLENDED)
def test_a_constant_volume_has_the_colour_of_its_value(renderer: sg.Renderer, blend: str) -> None:
    """Its colours are a step at the value, which is on the upper side: not half of both."""
    volume = sg.Volume(np.full((3, 3, 3), 100.0))
    transfer = sg.default_transfer(volume)
    color = transfer.color(100.0) * transfer.opacity(100.0)
    settings = EXACT.replace(blend=blend, technique="quads")
    splats = sg.extract(volume, transfer, classification="post")
    image = renderer.render(splats, sg.Camera.orbit(volume, 20, 15, size=(5, 5)), settings)
    assert np.abs(image.pixels[2, 2, :3] - color).max() < 1e-3


@pytest.mark.parametrize("value", [0.3, 100.0, -1000.0, 1e5])
def test_sums_of_a_constant_volume_have_float32_s_digits(renderer: sg.Renderer, value: float) -> None:
    """Cells of the table are differences of values, of which float64 has few digits where they are too narrow."""
    volume = sg.Volume(np.full((4, 4, 4), value))
    splats = sg.extract(volume, sg.default_transfer(volume), classification="post")
    camera, settings = sg.Camera.orbit(volume, 20, 15, size=(5, 5)), EXACT.replace(blend="xray", technique="quads")
    right = sg.reference.render(splats, camera, settings).pixels
    assert np.abs(renderer.render(splats, camera, settings).pixels / right.max() - right / right.max()).max() < 1e-5

"""Compute shaders of a graphics card's shape draw the pictures of a processor's shape."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import moderngl
import numpy as np
import pytest

import splatgl as sg
from splatgl.gl import layers as layering
from splatgl.gl import sheet_tiles, tiles
from splatgl.gl.shader import SHAPES, choose_shape, compose, declared_switches
from splatgl.planning import bricks as bricking
from splatgl.planning.bricks import Bricks, bricks_of
from splatgl.splat.settings import BLENDS, Settings
from tests.helpers.boxes import noise as label_noise
from tests.helpers.boxes import splats_of
from tests.helpers.bricks import cameras, noise
from tests.helpers.meshes import knots
from tests.helpers.noise import GRIDS
from tests.helpers.splatting import SPLATS

pytestmark = pytest.mark.compute
# no pixel ends early: what lies behind a pixel that ends differs by the cutoff
WHOLE = Settings(occlusion="off", antialias="off")
# sums are added up in another order; layers round colours of pieces to 16 bits, and extremes are coloured by steps
SAME, ROUNDED = 1e-6, 1e-5
RAMP = sg.Transfer([(0.45, 0), (0.6, 0.8)], colormap="hot", shading=True)
# splats composited one by one
SINGLY = SPLATS.replace(technique="tiles", occlusion="off")
QUADS = SINGLY.replace(technique="quads")
Draw = Callable[[sg.Renderer], np.ndarray]


def volume(grid: str = "cubes") -> sg.Volume:
    return sg.Volume(noise(np.random.default_rng(5), (13, 12, 14)), **GRIDS[grid])


def values(view: str = "outside", grid: str = "cubes", transfer: sg.Transfer = RAMP, **change: object) -> Draw:
    """Draws a volume whose values are classified after reconstruction. change: of the settings."""
    scene = volume(grid)
    settings = WHOLE.replace(**change)
    kind = "post-all" if settings.shows_value else "auto"
    splats = sg.extract(scene, transfer, classification=kind)
    return lambda renderer: renderer.render(splats, views(scene)[view], settings, verify_bound=False).pixels


def classified(view: str = "outside", base: Settings = WHOLE, **change: object) -> Draw:
    """Draws a volume that is classified before reconstruction."""
    scene = volume()
    splats = sg.extract(scene, RAMP, classification="pre")
    settings = base.replace(**change)
    return lambda renderer: renderer.render(splats, views(scene)[view], settings, verify_bound=False).pixels


def views(scene: sg.Volume) -> dict[str, sg.Camera]:
    return cameras(scene) | {"far": sg.Camera.orbit(scene, 30, 20, size=(9, 10), zoom=0.5)}


def masked() -> Draw:
    scene = volume()
    splats = sg.extract(scene.masked(scene.samples > 0.5), RAMP)
    return lambda renderer: renderer.render(splats, cameras(scene)["outside"], WHOLE, verify_bound=False).pixels


def labels(**change: object) -> Draw:
    scene = label_noise(np.random.default_rng(7), "3:1")
    settings = WHOLE.replace(**change)
    return lambda renderer: renderer.render(splats_of(scene), cameras(scene)["outside"], settings).pixels


def layers(meshes: bool = False, boxes: bool = False) -> Draw:
    both = [sg.Layer(volume(grid), RAMP) for grid in ("cubes", "1:2:5")[: 1 if meshes and not boxes else 2]]
    if boxes:
        scene = label_noise(np.random.default_rng(7), "cubes")
        both[1] = sg.Layer(scene, sg.default_transfer(scene))
    drawn = sg.Scene(both, meshes=knots(volume()) if meshes else [])
    return lambda renderer: renderer.render(drawn, cameras(volume())["outside"], WHOLE).pixels


def in_bricks(view: str = "outside", bands: int = 1, **change: object) -> Draw:
    settings, scene = WHOLE.replace(**change), volume()
    found = bricks_of(scene, RAMP, settings)
    assert found is not None
    bricks = Bricks.of(scene, found.post, 7)
    return lambda renderer: renderer.render_bricks(bricks, views(scene)[view], settings, bands=bands).pixels


def moving(classification: str = "auto", **change: object) -> Draw:
    scene = volume()
    splats, motion = sg.extract(scene, RAMP, classification=classification), sg.Motion(spin=(0, 0, 9))
    settings = WHOLE.replace(**change)
    return lambda renderer: renderer.render(splats, cameras(scene)["outside"], settings, motion).pixels


KINDS: dict[str, Callable[[], Draw]] = {
    "values": values,
    "inside": lambda: values("inside"),
    "parallel": lambda: values("parallel", "sheared"),
    "beside, long voxels": lambda: values("beside", "1:2:5"),
    "antialiased": lambda: values("outside", antialias="paper"),
    "unlit": lambda: values(transfer=sg.Transfer(RAMP.points, colormap="hot", shading=False)),
    "weighted": lambda: values(transfer=sg.Transfer(RAMP.points, gradient=[(0.0, 0.5), (0.2, 1.0)])),
    "four sheets": lambda: values(sheets=4, steps=3),
    "two sheets": lambda: values(sheets=2, steps=1),
    "fine": lambda: values(tolerance=1e-6),
    **{blend: lambda blend=blend: values(blend=blend) for blend in BLENDS if blend != "composite"},  # type: ignore[misc]
    "light": lambda: values(light="glossy"),
    "iso-surfaces": lambda: values(transfer=sg.Transfer(RAMP.points, iso=[(0.5, "red", 0.5), (0.7, "", 0.4)])),
    "cues": lambda: values(ambient_occlusion=0.6, shadows=0.7),
    "clip": lambda: values(clip=((0.3, 0.9, 0.2, 7.0),)),
    "mask": masked,
    "classified before": classified,
    "classified before, xray": lambda: classified(blend="xray"),
    **{
        f"splat by splat, {blend}": lambda blend=blend: classified(base=SINGLY, blend=blend)  # type: ignore[misc]
        for blend in ("composite", "xray", "mip")
    },
    "splat by splat, from inside": lambda: classified("inside", SINGLY),
    "splat by splat, far": lambda: classified("far", SINGLY),
    "splat by splat, far, opacity": lambda: classified("far", SINGLY, attenuation="opacity"),
    "labels": labels,
    "labels, xray": lambda: labels(blend="xray"),
    "layers": layers,
    "layers of labels": lambda: layers(boxes=True),
    "meshes": lambda: layers(meshes=True),
    "meshes in layers": lambda: layers(meshes=True, boxes=True),
    "bricks": in_bricks,
    "bricks from inside": lambda: in_bricks("inside", bands=2),
    "bricks, mean": lambda: in_bricks(blend="mean"),
    "motion": lambda: moving(moments=3),
    "streaks": lambda: moving("pre", compositing="splats"),
    "quads of sheets": lambda: values(technique="quads"),
    **{
        f"quads, {view}, {align}": lambda view=view, align=align: classified(  # type: ignore[misc]
            view, QUADS, align=align, antialias="paper"
        )
        for view, align in (("outside", "exact"), ("far", "hybrid"), ("inside", "exact"), ("beside", "ray"))
    },
    "quads, parallel": lambda: classified("parallel", QUADS),
    "quads, table": lambda: classified("beside", QUADS, footprint="table"),
}


@pytest.mark.turns(3)
@pytest.mark.few(1)
@pytest.mark.parametrize("kind", KINDS)
def test_shapes_draw_the_same(
    kind: str, processor: sg.Renderer, card: sg.Renderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A picture of every kind, whose sides are no multiples of a tile's."""
    monkeypatch.setattr(bricking, "BATCH", 200)
    draw = KINDS[kind]()
    right, drawn = draw(processor), draw(card)
    assert processor.passes.device.programs.shape != card.passes.device.programs.shape
    assert right.max() > 0.2
    most = (
        ROUNDED
        if "layers" in kind or "quads" in kind or kind in ("mip", "attenuated-mip", "parallel", "cues")
        else SAME
    )
    assert np.abs(drawn - right).max() < most * max(float(right.max()), 1.0)


@pytest.mark.few(1)
@pytest.mark.parametrize(
    "draw", [values, lambda: values(blend="mip"), lambda: layers(), lambda: classified(base=SINGLY)]
)
def test_portions_draw_the_same(
    draw: Callable[[], Draw], processor: sg.Renderer, card: sg.Renderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Lists that go on in other dispatches."""
    drawing = draw()
    right = drawing(processor)
    monkeypatch.setattr(tiles, "MOST", 300)
    # pieces of layers end with a portion
    assert np.abs(drawing(card) - right).max() < 10 * ROUNDED


@pytest.mark.few(1)
@pytest.mark.parametrize("kind", ["values", "mip", "bricks", "layers"])
def test_small_storage_blocks_draw_the_same(
    kind: str, processor: sg.Renderer, card: sg.Renderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Open sheets are bound a few tiles at a time, and bricks drawn in bands; layers have little room."""
    draw = KINDS[kind]()
    right = draw(processor)
    monkeypatch.setattr(tiles, "MOST", 300)
    monkeypatch.setattr(sheet_tiles, "most_block", lambda ctx: 3 * sheet_tiles.RING_BYTES)
    monkeypatch.setattr(sheet_tiles, "MOST_TILES", 14)
    monkeypatch.setattr(layering, "most_block", lambda ctx: 2**17)
    # pieces of layers end with a portion
    assert np.abs(draw(card) - right).max() < 10 * ROUNDED


def test_shaders_of_a_card_keep_to_what_every_device_has() -> None:
    """At most 7 storage blocks, and 16 KB of shared memory, with all features together."""
    for name in ("sheet_draw.comp", "tile_draw.comp", "box_draw.comp", "layers_over.comp"):
        on: dict[str, str | int | bool] = dict.fromkeys(
            ("CARRIED", "LAYERED", "NEAR", "LIMITED", "CLIPPED", "MASKED"), 1
        )
        on |= {"SKY": 1, "SHADOWS": 1, "ANTIALIAS": 1, "CUBIC": 0, "ALIGN": "ALIGN_EXACT", "SHEETS": 4, "STEPS": 3}
        switches = on | SHAPES["card"].switches
        declared = declared_switches(name)
        text = compose(name, {switch: value for switch, value in switches.items() if switch in declared}).source
        assert 1 <= len(re.findall(r"^layout\(std430, binding = \d+\)", text, re.M)) <= 7
        vectors = [count for line in re.findall(r"^shared vec4 .*;", text, re.M) for count in re.findall(r"\[", line)]
        assert 16 * 64 * len(vectors) + 64 <= 16_384


@pytest.mark.few(2)
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(
    "kind", ["values", "inside", "splat by splat, composite", "labels", "layers", "meshes", "bricks"]
)
def test_memory_of_a_device_holds_anything_at_first(
    kind: str, shape: str, processor: sg.Renderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Software clears its memory, cards do not."""
    monkeypatch.setattr(bricking, "BATCH", 200)
    draw = KINDS[kind]()
    right = draw(processor)
    original = moderngl.Context.buffer
    # NVIDIA's driver loses writes after it
    monkeypatch.delattr(moderngl.Buffer, "clear")

    def dirty(self: moderngl.Context, data: Any = None, **options: Any) -> moderngl.Buffer:
        buffer = original(self, data, **options)
        if data is None:
            buffer.write(b"\xff" * buffer.size)
        return buffer

    monkeypatch.setattr(moderngl.Context, "buffer", dirty)
    with sg.Renderer(shape=shape) as other:
        for limit in (2**20, 300):
            monkeypatch.setattr(tiles, "MOST", limit)
            assert np.abs(draw(other) - right).max() < 10 * ROUNDED


def test_a_pixel_that_ends_hides_no_more_than_it_may(processor: sg.Renderer, card: sg.Renderer) -> None:
    scene = volume()
    splats = sg.extract(scene, sg.Transfer([(0.45, 0), (0.6, 1.0)], unit=0.2))
    camera, settings = cameras(scene)["outside"], WHOLE.replace(occlusion="auto")
    cutoff = card.plan(splats, camera, settings).hiding.cutoff
    whole = processor.render(splats, camera, WHOLE).pixels
    assert 0 < cutoff < 1e-3
    assert 0 < np.abs(card.render(splats, camera, settings).pixels - whole).max() < cutoff + SAME


def test_the_device_or_a_name_chooses_the_shape(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SPLATGL_SHAPE", raising=False)
    assert choose_shape(software=True) == SHAPES["processor"]
    assert choose_shape(software=False) == SHAPES["card"]
    monkeypatch.setenv("SPLATGL_SHAPE", "card")
    assert choose_shape(software=True) == SHAPES["card"]
    assert choose_shape(True, "processor") == SHAPES["processor"]
    monkeypatch.setenv("SPLATGL_SHAPE", "warp")
    with pytest.raises(
        sg.InputError, match=r"^shape of compute shaders \(SPLATGL_SHAPE\): expected processor \| card, got warp$"
    ):
        choose_shape(software=True)

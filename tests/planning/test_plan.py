"""What a plan leaves out, forced on, changes the picture by no more than the plan says: mostly not at all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import splatgl as sg
from splatgl.planning.culling import PixelWindow
from splatgl.planning.plan import Plan
from splatgl.planning.technique import OcclusionCulling
from tests.helpers.noise import noise, views
from tests.helpers.splatting import SPLATS

# float32's last digits, where another way computes the same
ROUNDING = 2e-5


# and where tiles have their colours in 16 bits and opacities by polynomials, or not
TILED = 5e-5


def forced(name: str, chosen: Plan, camera: sg.Camera) -> tuple[Plan, Plan, float]:
    """(the plan as it is or next to it, the plan with the feature on, how much may change)."""
    quads = chosen.with_choices(technique="quads")
    tiled = TILED if chosen.program.technique == "tiles" else 0.0
    return {
        "antialiasing": (chosen, chosen.with_choices(antialias=True), tiled),
        "antialiasing, quads": (quads, quads.with_choices(antialias=True), 0.0),
        "attenuation": (chosen, chosen.with_choices(antialias=True, attenuation="fill"), tiled),
        "half lines": (chosen, chosen.with_choices(half_line=True), tiled),
        "half lines, quads": (quads, quads.with_choices(half_line=True), 0.0),
        "non-cubic voxels": (chosen, chosen.with_choices(cubic=False), ROUNDING),
        "quads": (chosen, quads, ROUNDING + tiled + chosen.hiding.cutoff),
        # other tiles end at other splats
        "rows beyond the window": (
            chosen,
            replace(chosen, window=PixelWindow(0, 0, *camera.size)),
            chosen.hiding.cutoff if tiled else 0.0,
        ),
        "hidden splats": (chosen, replace(chosen, hiding=OcclusionCulling()), chosen.hiding.cutoff),
    }[name]


FEATURES = (
    *("antialiasing", "antialiasing, quads", "attenuation", "half lines", "half lines, quads"),
    *("non-cubic voxels", "quads", "rows beyond the window", "hidden splats"),
)


@pytest.mark.few(2)
@pytest.mark.parametrize("name", FEATURES)
@pytest.mark.parametrize("size", [12, 40])
def test_forced_on(renderer: sg.Renderer, name: str, size: int) -> None:
    splats = noise(size=size, opacity=0.9)
    camera = views(splats)["fitted"].resized((180, 135))
    chosen = renderer.plan(splats, camera, SPLATS.replace(technique="tiles"))
    assert not chosen.program.seen.antialias and not chosen.program.seen.half_line and chosen.program.seen.cubic
    without, with_it, change = forced(name, chosen, camera)
    drawn = renderer.passes.draw(splats, without)
    assert drawn.max() > 0.1
    assert np.abs(renderer.passes.draw(splats, with_it) - drawn).max() <= change


def test_order_is_left_out_of_sums(renderer: sg.Renderer) -> None:
    splats = noise()
    camera = views(splats)["fitted"]
    for blend in ("xray", "mip"):
        chosen = renderer.plan(splats, camera, SPLATS.replace(blend=blend))
        assert any(note.startswith("ordering left out") for note in chosen.notes)
        renderer.passes.draw(splats, chosen)
        drawn = renderer.passes.device.splats.of(splats).textured
        assert drawn is not None and not drawn.orders.kept
        renderer.passes.device.splats.release()


def test_every_note_says_what_it_changes(renderer: sg.Renderer) -> None:
    """A line for everything that is left out: what, why, and what it does to the picture."""
    splats = noise()
    for camera in views(splats).values():
        for blend in ("composite", "xray", "mip"):
            for note in renderer.plan(splats, camera, SPLATS.replace(blend=blend)).notes:
                assert " left out: " in note
                assert any(word in note for word in ("picture", "rounding", "perpendicular", "eye", "pixels")), note

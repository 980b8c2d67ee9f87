"""What is computed of splats is kept no longer than they live, and is not taken for what was computed of others."""

from __future__ import annotations

import gc
from dataclasses import replace
from weakref import ref

import numpy as np
import pytest

import splatgl as sg
from splatgl import reference
from splatgl.geometry.clipping import check_planes, clip_splats
from splatgl.planning.culling import clip_behind_eye
from splatgl.splat.splats import IdentityKey
from tests.helpers.noise import noise, views

CUED = sg.Settings(classification="pre", shading="on", light="matte", ambient_occlusion=0.8, shadows=0.7)

# arrays of which one has the number of one that was freed
MOST = 10_000


def behind(splats: sg.Splats, share: float) -> sg.Camera:
    """A parallel view whose eye lies where so much of the splats' depth is behind it."""
    x = splats.corners[:, 0]
    eye = splats.corners.mean(axis=0)
    eye[0] = x.min() + share * np.ptp(x)
    return sg.Camera.orthographic(eye, eye + np.array([1.0, 0, 0]), (0, 0, 1), 9.0, (14, 11))


def uses(splats: sg.Splats, renderer: sg.Renderer) -> None:
    """What keeps something of splats: cuts and views of some and of all, order, bounds, light, pictures."""
    low = splats.corners.min(axis=0)[2]
    for place in (low + 1.5, low - 1):
        cut = check_planes([(0, 0, 1, place)])
        clip_splats(splats, cut)
        renderer.render(splats, views(splats)["fitted"], sg.Settings(clip=cut))
    for share in (0.5, 0.01):
        clip_behind_eye(splats, behind(splats, share))
        renderer.render(splats, behind(splats, share))
    reference.render(splats, views(splats)["fitted"], CUED)
    for technique in ("quads", "tiles"):
        renderer.render(splats, views(splats)["fitted"], CUED.replace(technique=technique))


def test_parts_that_are_all_are_the_splats() -> None:
    splats = noise("cubes", size=7)
    low = splats.corners.min(axis=0)[2]
    assert (
        clip_splats(splats, check_planes([(0, 0, 1, low - 1)]))
        is splats
        is clip_behind_eye(splats, behind(splats, 0.01))
    )
    cut, camera = check_planes([(0, 0, 1, low + 1.5)]), behind(splats, 0.5)
    assert 0 < len(clip_splats(splats, cut)) < len(splats) and 0 < len(clip_behind_eye(splats, camera)) < len(splats)
    assert clip_splats(splats, cut) is clip_splats(splats, cut) and clip_behind_eye(splats, camera) is clip_behind_eye(
        splats, camera
    )


@pytest.mark.long
@pytest.mark.parametrize("grid", ["cubes", "sheared"])
def test_splats_are_freed_with_their_last_picture(grid: str, renderer: sg.Renderer) -> None:
    splats = noise(grid, size=7)
    uses(splats, renderer)
    alive = ref(splats)
    del splats
    renderer.free()
    gc.collect()
    assert alive() is None


def test_light_of_what_is_gone_is_not_taken_for_that_of_what_came() -> None:
    """The second of two casters is freed: its numbers may be given to what comes after it."""
    first, camera = noise("cubes", size=7), views(noise("cubes", size=7))["fitted"]

    def key(records: np.ndarray) -> tuple[object, ...]:
        cues = sg.plan(first, camera, CUED).resolved.cues
        assert cues is not None
        return replace(cues, casters=(*cues.casters, (replace(first, records=records), ()))).key

    records = first.records.copy()
    before, number = key(records), id(records)
    assert before == key(records)
    del records
    came = [first.records.copy()]
    while id(came[-1]) != number and len(came) < MOST:
        came.append(first.records.copy())
    assert before != key(came[-1])


def test_same() -> None:
    one, other = noise("cubes", size=7), noise("cubes", size=7)
    assert IdentityKey(one) == IdentityKey(one) != IdentityKey(other) and hash(IdentityKey(one)) == hash(
        IdentityKey(one)
    )
    gone, again = IdentityKey(one), IdentityKey(one)
    del one
    gc.collect()
    assert gone != again

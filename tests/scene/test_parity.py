"""Every door to a scene draws the same picture: random scene files, opened by all front ends."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from splatgl.errors import InputError
from tests.helpers.doors import BASES, DOORS, SLOW, Door, Draw, Drawn, files_of
from tests.helpers.random_scenes import (
    Draft,
    Source,
    amounts,
    channels,
    labels,
    make_plain_scene,
    make_scene,
    points,
    to_toml,
    traits,
    vectors,
    write_mesh,
)

QUICK, ALL = 20, 320
SEEDS = [seed if seed < QUICK else pytest.param(seed, marks=pytest.mark.long) for seed in range(ALL)]
# scenes that are also compared as files: those whose pixels take little time in float64 are quick
CHEAP = (0, 2, 3)
FILES = [seed if seed in CHEAP else pytest.param(seed, marks=pytest.mark.long) for seed in range(24)]


def octahedron(draft: Draft) -> Source:
    return draft.sources[write_mesh(draft)]


CUT = {"scissors": ["0.3,0.3 0.8,0.3 0.5,0.9:keep"]}
UNCUT = {"clip": ["x>0.4"], "uncut": "1,5"}
# scenes that doors once drew in other ways: options, and what makes their sources
CASES: dict[str, tuple[dict[str, Any], tuple[Callable[[Draft], Source], ...]]] = {
    "the planes of a clip and a crop": ({"clip": ["y<0.6"], "crop": "2:8,:,:"}, (amounts,)),
    "scissors through one volume": (CUT, (amounts,)),
    "scissors through layers of other frames": (CUT, (amounts, labels, amounts, amounts)),
    "a part of labels left whole": (UNCUT, (labels,)),
    "a part left whole under annotations": (
        {**UNCUT, "annotate": ["scale"], "camera": {"size": [72, 64]}},
        (labels,),
    ),
    "channels under annotations": (
        {"load": {"channel": "all"}, "annotate": ["scale"], "camera": {"size": [72, 64]}},
        (channels,),
    ),
    "display values of 8 bits": ({"settings": {"target": "rgba8", "background": "#808080"}}, (amounts,)),
    "labels of 8 bits": ({"settings": {"target": "rgba8"}}, (labels,)),
    "a part of a layer left whole": ({"layer": UNCUT}, (amounts, labels)),
}
# the least scene with a trait that a door refuses
LEAST: dict[str, tuple[dict[str, Any], tuple[Callable[[Draft], Source], ...]]] = {
    "threshold": ({"threshold": 0.1}, (amounts,)),
    "scissors": (CUT, (amounts,)),
    "uncut": (UNCUT, (labels,)),
    "opacity": ({"opacity": 0.5}, (amounts,)),
    "title": ({"title": "a"}, (amounts,)),
    "visible": ({"visible": False}, (amounts, octahedron)),
    "a volume of mesh": ({}, (octahedron, amounts)),
    "surfaces": ({"surfaces": 0.5}, (labels,)),
    "layer.surfaces": ({"layer": {"surfaces": 0.5}}, (amounts, labels)),
    "slices": ({"slices": ["z=50%"], "camera": {"size": [72, 64]}}, (amounts,)),
    "layer": ({}, (amounts, amounts)),
    "mesh": ({}, (amounts, octahedron)),
    "slice_planes": ({"slice_planes": ["z=50%"]}, (amounts,)),
    "a volume of channels": ({"load": {"channel": "all"}}, (channels,)),
    "vectors.streamlines": ({"vectors": {"streamlines": 4}}, (vectors,)),
    "vectors.arrows": ({"vectors": {"arrows": 4}}, (vectors,)),
    "settings.ambient_occlusion": ({"settings": {"ambient_occlusion": 0.5}}, (amounts,)),
    "settings.shadows": ({"settings": {"shadows": 0.5, "light": "matte"}}, (amounts,)),
}
EVERY = {**DOORS, **SLOW}
REFUSED = [(name, trait) for name, door in EVERY.items() for trait in door.refuses]


def attempt(draft: Draft, draw: Draw) -> Drawn | str:
    """The picture, or the message of the error, without the folder."""
    try:
        return draw(draft)
    except InputError as error:
        return str(error).replace(f"{draft.folder}/", "")


def explain(
    draft: Draft, name: str, door: Door, drawn: Drawn | str, base: Drawn | str, picture: Drawn | str
) -> str | None:
    """What is wrong with a picture, or with a message; None: nothing. picture: by the scene file."""
    has = traits(draft)
    if isinstance(drawn, str):
        known = [message for trait, message in door.refuses.items() if trait in has]
        same = plain(drawn) in (plain(text) for text in (base, picture) if isinstance(text, str))
        return None if same or any(re.search(message, drawn) for message in known) else f"{name} refuses: {drawn}"
    if (
        isinstance(base, str)
        and door.is_open
        and re.search("expected (layers with an opacity|voxels with an opacity|visible voxels).*got none", base)
    ):
        return None if (drawn.pixels == drawn.pixels[0, 0]).all() else f"{name} shows what is hidden"
    if isinstance(base, str):
        return f"{name} draws what is refused: {base}"
    if drawn.pixels.shape != base.pixels.shape:
        return f"{name} draws {drawn.pixels.shape}, not {base.pixels.shape}"
    if np.array_equal(drawn.pixels, base.pixels):
        return None
    return f"{name} differs by {np.abs(drawn.pixels - base.pixels).max():.3g}"


def plain(message: str) -> str:
    """A message in the words of every door: options and volumes by their names alone."""
    words = message.removeprefix("scene.toml: ").replace("--", "").replace("=", " ")
    return re.sub(r"^(\w+)\.(nrrd|npy|nii\.gz|nii|zarr|ply): ", r"\1: ", words)


def failures(draft: Draft, doors: dict[str, Door]) -> list[str]:
    """What is wrong with the pictures of a scene by some doors."""
    picture = cache(lambda draw: attempt(draft, draw))
    has, found = traits(draft), list[str | None]()
    for name, door in doors.items():
        if has & set(door.lacks):
            continue
        is_same = door.base in ("bare", "steady") and "annotate" not in has
        base = BASES["picture" if is_same else door.base]
        found.append(explain(draft, name, door, picture(door.draw), picture(base), picture(BASES["picture"])))
    return [text for text in found if text]


@pytest.mark.turns(10)
@pytest.mark.parametrize("seed", SEEDS)
def test_all_doors_draw_a_random_scene_alike(seed: int, tmp_path: Path) -> None:
    draft = make_scene(tmp_path, seed)
    wrong = failures(draft, DOORS)
    assert not wrong, "\n".join([*wrong, f"seed {seed}:", to_toml(draft.table)])


@pytest.mark.parametrize("seed", FILES)
def test_doors_write_the_same_bytes(seed: int, tmp_path: Path) -> None:
    draft = make_scene(tmp_path, seed)
    try:
        found = files_of(draft)
    except InputError:
        # the other test compares what the doors say
        pytest.skip("nothing is drawn")
    assert len(set(found.values())) == 1, f"seed {seed}:\n{to_toml(draft.table)}"


@pytest.mark.parametrize("name", CASES)
def test_all_doors_draw_alike(name: str, tmp_path: Path) -> None:
    options, makes = CASES[name]
    draft = make_plain_scene(tmp_path, options, *makes)
    assert isinstance(attempt(draft, BASES["picture"]), Drawn)
    assert not failures(draft, DOORS), to_toml(draft.table)


@pytest.mark.parametrize(("name", "trait"), REFUSED)
def test_a_door_says_what_it_does_not_draw(name: str, trait: str, tmp_path: Path) -> None:
    options, makes = LEAST[trait]
    draft = make_plain_scene(tmp_path, options, *makes)
    assert trait in traits(draft) and isinstance(attempt(draft, BASES["picture"]), Drawn)
    with pytest.raises(InputError, match=EVERY[name].refuses[trait]):
        EVERY[name].draw(draft)


def test_all_doors_refuse_alike(tmp_path: Path) -> None:
    """What a later layer lacks, before what the blend does not draw of the first."""
    options = {"settings": {"blend": "attenuated-mip"}, "layer": {"mask": ["missing.nrrd"]}}
    draft = make_plain_scene(tmp_path, options, points, amounts)
    assert "missing.nrrd" in str(attempt(draft, BASES["picture"]))
    assert not failures(draft, {name: DOORS[name] for name in ("command", "window", "saved", "notebook")})


@pytest.mark.long
@pytest.mark.parametrize("name", SLOW)
def test_doors_of_other_processes_draw_alike(name: str, tmp_path: Path) -> None:
    draft = make_plain_scene(tmp_path, {"clip": ["y<0.6"], "camera": {"azimuth": 70.0}}, amounts)
    assert not failures(draft, {name: SLOW[name]})

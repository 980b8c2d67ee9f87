"""What techniques refuse is told; and programs that are left compile: of each pair of choices, and many of more."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import splatgl as sg
from splatgl.gl.features import FEATURES
from splatgl.gl.program import build, build_compute, splat_switches
from splatgl.gl.shader import declared_switches
from splatgl.planning.plan import Program
from splatgl.splat.motion_blur import MOTIONS
from splatgl.splat.settings import BLENDS, choices
from tests.helpers.covering import covering
from tests.helpers.noise import GRIDS as PLACED
from tests.helpers.noise import noise
from tests.helpers.splatting import SPLATS

# what a program depends on
COMPILED = ("blend", "align", "attenuation", "footprint", "shading")
GRIDS = ("cubes", "sheared")


def cameras_of(splats: sg.Splats) -> list[sg.Camera]:
    fitted = sg.Camera.orbit(splats, size=(32, 32))
    middle = splats.corners.mean(axis=0)
    inside = sg.Camera.look_at(middle, middle + np.array([1.0, 0.3, 0.2]), (0, 0, 1), 60, (32, 32))
    far = sg.Camera.orbit(splats, size=(32, 32), zoom=1 / 16)
    return [fitted, inside, far, fitted.parallel(splats), far.parallel(splats)]


def programs() -> set[Program]:
    """All that plans compile of the values of every two settings, the others as they are by default, and of every
    256th combination of all.
    """
    names = (*COMPILED, "tolerance", "table_bits")
    values = {**{name: choices()[name] for name in COMPILED}, "tolerance": (1 / 255, 1e-6), "table_bits": (32, 8)}
    # the others take values
    values["blend"] = tuple(name for name in BLENDS if not sg.Settings(blend=name).needs_values)
    every, *pairs = (
        [tuple(zip(chosen, each, strict=True)) for each in itertools.product(*(values[name] for name in chosen))]
        for chosen in (names, *itertools.combinations(names, 2))
    )
    wanted = {*every[::256], *itertools.chain(*pairs)}
    moves = sg.Motion(spin=(0, 0, 5))
    found = set()
    for grid in GRIDS:
        splats = noise(grid, size=4, opacity=0.5)
        for camera, change in itertools.product(cameras_of(splats), wanted):
            settings = SPLATS.replace(**dict(change))
            found |= {sg.plan(splats, camera, settings, tiles=tiles).program for tiles in (True, None)}
            if settings.align == "auto":
                for motion in MOTIONS:
                    found.add(sg.plan(splats, camera, settings.replace(motion=motion), moves).program)
    return found


def of_sheets() -> set[Program]:
    """All that plans of sheets compile, classified before or after."""
    found = set()
    transfer = sg.Transfer([(0.3, 0), (1, 0.5)], shading=True)
    for grid in GRIDS:
        volume = sg.Volume(np.random.default_rng(3).random((4, 4, 4)), **PLACED[grid])
        for how in ("pre", "post-all"):
            splats = sg.extract(volume, transfer, classification=how)
            changes = itertools.product((2, 3, 4), (1 / 255, 1e-6), ("on", "off"), ("auto", "optical-depth"))
            cameras = cameras_of(splats)
            for count, tolerance, shading, attenuation in changes:
                settings = SPLATS.replace(
                    classification="auto", compositing="sheets", sheets=count, tolerance=tolerance
                )
                settings = settings.replace(shading=shading, attenuation=attenuation)
                joined = splats.post is not None and shading == "off" and attenuation == "auto"
                found |= {
                    sg.plan(splats, camera, settings.replace(blend=name), tiles=tiles).program
                    for name in BLENDS
                    if name == "composite" or (joined and sg.Settings(blend=name).shows_value)
                    for camera in cameras
                    for tiles in (True, None)
                }
    return found


def distinct(found: set[Program]) -> set[tuple[object, ...]]:
    """(stages, *switches) of all that is compiled."""
    keys: set[tuple[object, ...]] = set()
    for program in found:
        switches = splat_switches(program)
        parts = []
        if program.technique == "tiles":
            parts = [("tile_project.frag", "ORDERED"), ("tile_project.frag", "CULLED")]
            kinds = [("sheet_draw.comp", "CARRIED"), ("sheet_sort.comp", "COUNTING"), ("sheet_sort.comp", "CLUSTERED")]
            parts += kinds if program.appearance.sheets else [("tile_draw.comp", "CARRIED")]
        elif program.appearance.sheets:
            parts = [("sheet_close.frag", "SHEETS")]
            parts += [("sheet_show.frag", "SHEETS")] * program.appearance.shows_value
        for name, more in parts:
            read = {**switches, more: switches.get(more, True)}
            keys.add((name, *((s, read[s]) for s in sorted(declared_switches(name) & read.keys()))))
        if program.technique != "tiles":
            declared = declared_switches("splat.vert") | declared_switches("splat.frag")
            keys.add(("splat", *sorted((name, value) for name, value in switches.items() if name in declared)))
    return keys


def compiles(renderer: sg.Renderer, keys: set[tuple[object, ...]]) -> None:
    for name, *switches in sorted(keys, key=str):
        if name == "splat":
            build(renderer.ctx, "splat.vert", "splat.frag", dict(switches)).release()
        elif str(name).endswith(".frag"):
            build(renderer.ctx, "whole.vert", name, dict(switches)).release()
        else:
            build_compute(renderer.ctx, name, dict(switches)).release()


# the cheapest stage that reads a feature, and its other switches
STAGES: dict[str, tuple[str, dict[str, str | int]]] = {
    **{
        name: ("sheet_close.frag", {"SHEETS": 2, "STEPS": 1, "SHADING": 1})
        for name in ("WEIGHTED", "REGIONS", "CLIPPED", "MASKED", "ISO")
    },
    **{name: ("sheet_close.frag", {"SHEETS": 2, "STEPS": 1}) for name in ("LIGHT", "SKY", "SHADOWS")},
    "PACKED": ("tile_project.frag", {"SHEETS": 2, "STEPS": 1}),
    "BOXES": ("splat.frag", {}),
}


def test_every_feature_compiles_and_only_it_is_read(renderer: sg.Renderer) -> None:
    """Also of no program: uniforms and fields of a feature that is off."""
    assert set(STAGES) == {feature.switch for feature in FEATURES}
    volume = sg.Volume(np.random.default_rng(3).random((6, 6, 6)))
    settings = sg.Settings(clip=((1.0, 0.0, 0.0, 2.0),), light="glossy", ambient_occlusion=0.5, shadows=0.5)
    transfer = sg.Transfer([(0.3, 0), (1, 0.5)], gradient=((0.0, 0.0), (0.3, 1.0)), regions=["box:0,1,0,1"])
    splats = sg.extract(volume.masked(volume.samples > 0.4), transfer)
    plan = sg.plan(splats, cameras_of(splats)[0], settings, tiles=True)
    on = {feature.switch for feature in FEATURES if feature.is_on(plan.program)}
    assert on >= {"WEIGHTED", "REGIONS", "CLIPPED", "MASKED", "LIGHT", "SKY", "SHADOWS"}
    for feature in FEATURES:
        name, others = STAGES[feature.switch]
        vertex = "splat.vert" if name == "splat.frag" else "whole.vert"
        members = []
        for value in (0, 1):
            program = build(renderer.ctx, vertex, name, {**others, feature.switch: value})
            members.append(set(program))
            program.release()
        if feature.switch in on:
            uniforms, fields = feature.uniforms(splats, plan), feature.fields(splats, plan)
            read = {*uniforms, *(sampler for sampler, field in fields.items() if field is not None)}
            assert not read & members[0] and (not read or read & members[1])
            assert (members[1] - members[0]) - {"Frame", "Style"} <= read or not read


@pytest.mark.long
def test_programs_of_any_choices_compile(renderer: sg.Renderer) -> None:
    """Those in which each two values of switches meet, and every 32nd of the others."""
    keys = sorted(distinct(programs()), key=str)
    some = {*covering(keys), *keys[::32]}
    print(f"{len(some)} of {len(keys)} programs")
    assert len(keys) > 300 and len(some) > 60
    compiles(renderer, some)


@pytest.mark.long
def test_programs_of_sheets_compile(renderer: sg.Renderer) -> None:
    """As above, of thousands, of which every shader is one."""
    keys = sorted(distinct(of_sheets()), key=str)
    some = {*covering(keys), *keys[::512]}
    stages = {name for name, *_ in some}
    print(f"{len(some)} of {len(keys)} programs")
    quads = {"splat", "sheet_close.frag", "sheet_show.frag"}
    assert stages == quads | {"tile_project.frag", "sheet_draw.comp", "sheet_sort.comp"}
    compiles(renderer, some)

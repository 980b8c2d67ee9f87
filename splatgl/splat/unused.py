"""Notes on settings that do not change a picture: `NEEDS` has a row for each, with what it needs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from splatgl.options import no_effect
from splatgl.splat.kernels import FREE
from splatgl.splat.plan import Plan
from splatgl.splat.settings import Settings

# settings of splats, which meshes alone do not need
OF_SPLATS = (
    *("mip_attenuation", "kernel", "classification", "compositing", "sheets", "steps", "samples", "align", "z_s"),
    *("attenuation", "footprint", "table_size", "table_bits", "target", "technique", "order", "occlusion"),
    "ambient_occlusion",
)


@dataclass(frozen=True)
class Need:
    """What settings need in order to change a picture. names: of the settings. is_met: whether the plan of a layer
    uses them, and meshes, if there are some. why: the reason if no layer does.
    """

    names: tuple[str, ...]
    is_met: Callable[[Plan, Settings, bool], bool]
    why: str


def is_lit(plan: Plan) -> bool:
    """Whether light changes with the direction of surfaces; points have none."""
    splats, look = plan.splats, plan.program.look
    has_normals = splats.post is not None or splats.labels is not None or bool(splats.records["normal"].any())
    return look.iso == "lit" or (look.shading and has_normals)


NEEDS = (
    Need(OF_SPLATS, lambda plan, settings, meshes: len(plan.splats) > 0, "only meshes are drawn"),
    Need(
        ("samples",),
        lambda plan, settings, meshes: settings.antialias == "supersample",
        "antialias is not supersample",
    ),
    Need(
        ("z_s",),
        lambda plan, settings, meshes: plan.program.align == "hybrid",
        "align is not hybrid, or the view is parallel",
    ),
    Need(
        ("align",),
        lambda plan, settings, meshes: plan.program.align == settings.align,
        "in a parallel view all alignments are the same",
    ),
    Need(
        ("mip_attenuation",),
        lambda plan, settings, meshes: settings.blend == "attenuated-mip",
        "blend is not attenuated-mip",
    ),
    Need(
        ("table_size",),
        lambda plan, settings, meshes: plan.program.footprint in ("table", "radial"),
        "footprints are no table",
    ),
    Need(
        ("kernel",),
        lambda plan, settings, meshes: settings.kernel in (plan.kernel.name, FREE),
        "voxels of labels are drawn as boxes",
    ),
    Need(
        ("shading",),
        lambda plan, settings, meshes: settings.shading == "off" or is_lit(plan) or meshes,
        "there are no surfaces",
    ),
    Need(
        ("light", "light_from", "ambient", "diffuse", "specular"),
        lambda plan, settings, meshes: (
            is_lit(plan) or plan.resolved.cues is not None or (meshes and settings.shading != "off")
        ),
        "nothing is shaded",
    ),
    Need(
        ("ambient_occlusion",),
        lambda plan, settings, meshes: plan.program.look.sky,
        "no matter is drawn in blend composite",
    ),
    Need(
        ("shadows",),
        lambda plan, settings, meshes: plan.program.look.shadows or meshes,
        "shadows are of blend composite, and of a light beside the eye",
    ),
    Need(
        ("compositing",),
        lambda plan, settings, meshes: (settings.compositing == "sheets") == (plan.resolved.sheets is not None),
        "these splats composite one by one",
    ),
    Need(("sheets",), lambda plan, settings, meshes: plan.program.look.sheets > 0, "splats composite one by one"),
    Need(
        ("steps",),
        lambda plan, settings, meshes: plan.program.look.steps > 0,
        "values are classified before reconstruction",
    ),
    Need(
        ("attenuation",),
        lambda plan, settings, meshes: settings.attenuation in ("opacity", plan.program.look.attenuation),
        "no splat is widened beyond z_k",
    ),
    Need(("order",), lambda plan, settings, meshes: plan.program.look.blend.ordered, "the blend has no order"),
    Need(
        ("occlusion",),
        lambda plan, settings, meshes: plan.program.look.blend.ordered and plan.program.technique == "tiles",
        "only tiles of blend composite skip hidden splats",
    ),
)
# settings of moving pictures; moments are the default of an earlier version
OF_MOTION = ("motion", "moments", "shutter")


def unused_settings(
    plans: Sequence[Plan], settings: Settings, has_meshes: bool = False, is_moving: bool = False
) -> tuple[str, ...]:
    """Notes on the settings that are given and change nothing, a note for each reason. plans: of the layers."""
    given, notes = dict(settings.given), list[str]()
    if not is_moving:
        still = [name for name in OF_MOTION if name in given and given[name] != "moments"]
        notes += no_effect(still, "nothing moves")
    for need in NEEDS:
        names = [name for name in need.names if name in given]
        if names and not any(need.is_met(plan, settings, has_meshes) for plan in plans):
            notes += no_effect(names, need.why)
            given = {name: value for name, value in given.items() if name not in names}
    return tuple(notes)

"""Notes on settings that do not change a picture: `NEEDS` has a row for each, with what it needs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from splatgl.options import no_effect
from splatgl.planning.plan import Plan
from splatgl.planning.resolve import Appearance
from splatgl.splat.kernels import FREE
from splatgl.splat.settings import Settings

# settings of splats, which meshes alone do not need
OF_SPLATS = (
    *("mip_attenuation", "kernel", "classification", "compositing", "sheets", "steps", "samples", "align", "z_s"),
    *("attenuation", "footprint", "table_size", "table_bits", "target", "technique", "order", "occlusion"),
    *("blur_width", "ambient_occlusion"),
)
LIGHT = ("light", "light_from", "ambient", "diffuse", "specular")
# settings of moving pictures; moments are the default of an earlier version, paper of `Settings.paper`
OF_MOTION = ("motion", "moments", "shutter")


@dataclass(frozen=True)
class Use:
    """A layer's plan, the settings as they were given, and whether meshes are drawn, too."""

    plan: Plan
    given: Settings
    meshes: bool

    @property
    def look(self) -> Appearance:
        """The appearance of the splats."""
        return self.plan.program.look

    @property
    def is_lit(self) -> bool:
        """Whether light changes with the direction of surfaces; points have none."""
        splats = self.plan.splats
        has_normals = splats.post is not None or splats.labels is not None or bool(splats.records["normal"].any())
        return self.look.iso == "lit" or (self.look.shading and has_normals)

    @property
    def shows_light(self) -> bool:
        """Whether the picture depends on the light."""
        return self.is_lit or self.plan.resolved.cues is not None or (self.meshes and self.given.shading != "off")

    @property
    def skips_hidden(self) -> bool:
        """Whether hidden splats are skipped, unless the settings say otherwise."""
        return self.look.hides and self.plan.program.technique == "tiles"


# settings, whether the plan of a layer uses them, and the reason if no layer does
NEEDS: tuple[tuple[tuple[str, ...], Callable[[Use], bool], str], ...] = (
    (OF_SPLATS, lambda use: len(use.plan.splats) > 0, "only meshes are drawn"),
    (("samples",), lambda use: use.given.antialias == "supersample", "antialias is not supersample"),
    (("z_s",), lambda use: use.plan.program.align == "hybrid", "align is not hybrid, or the view is parallel"),
    (
        ("align",),
        lambda use: use.plan.program.align == use.given.align,
        "in a parallel view all alignments are the same",
    ),
    (("mip_attenuation",), lambda use: use.look.join == "attenuated", "blend is not attenuated-mip"),
    (("table_size",), lambda use: use.plan.program.footprint in ("table", "radial"), "footprints are no table"),
    (("kernel",), lambda use: use.given.kernel in (use.plan.kernel.name, FREE), "voxels of labels are drawn as boxes"),
    (("shading",), lambda use: use.given.shading == "off" or use.is_lit or use.meshes, "there are no surfaces"),
    (LIGHT, lambda use: use.shows_light, "nothing is shaded"),
    (("ambient_occlusion",), lambda use: use.look.sky, "no matter is drawn in blend composite"),
    (
        ("shadows",),
        lambda use: use.look.shadows or use.meshes,
        "shadows are of blend composite, and of a light beside the eye",
    ),
    (
        ("compositing",),
        lambda use: (use.given.compositing == "sheets") == (use.plan.resolved.sheets is not None),
        "these splats composite one by one",
    ),
    (("sheets",), lambda use: use.look.sheets > 0, "splats composite one by one"),
    (("steps",), lambda use: use.look.steps > 0, "values are classified before reconstruction"),
    (
        ("attenuation",),
        lambda use: use.given.attenuation in ("opacity", use.look.attenuation),
        "only splats of blend composite beyond z_k are weakened",
    ),
    (
        ("blur_width",),
        lambda use: (
            use.given.antialias == "paper" and (use.plan.view.antialias or use.plan.resolved.is_fine(use.plan.splats))
        ),
        "antialias is not paper, or every splat is nearer than z_k",
    ),
    (("target",), lambda use: use.given.target in ("auto", use.plan.target), "sums of optical depth exceed 8 bits"),
    (("order",), lambda use: use.look.hides, "the blend has no order"),
    (("occlusion",), lambda use: use.skips_hidden, "only tiles of blend composite skip hidden splats"),
)


def unused_settings(
    plans: Sequence[Plan], settings: Settings, has_meshes: bool = False, is_moving: bool = False
) -> tuple[str, ...]:
    """Notes on the settings that are given and change nothing, a note for each reason. plans: of the layers."""
    given, notes = dict(settings.given), list[str]()
    if not is_moving:
        still = [name for name in OF_MOTION if name in given and given[name] not in ("moments", "paper")]
        notes += no_effect(still, "nothing moves")
    for names, is_used, why in NEEDS:
        listed = [name for name in names if name in given]
        if listed and not any(is_used(Use(plan, settings, has_meshes)) for plan in plans):
            notes += no_effect(listed, why)
            given = {name: value for name, value in given.items() if name not in listed}
    return tuple(notes)

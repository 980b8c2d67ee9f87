"""The plan of a picture, and notes on settings that do not change it.

`program` holds the enums and booleans that select shader text and GL state, and is the key of the
program cache; the rest is numbers for uniforms, so that a moving camera compiles nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

from splatgl.coercion import public
from splatgl.errors import expected
from splatgl.geometry.camera import Camera
from splatgl.geometry.view import GridView
from splatgl.options import no_effect
from splatgl.planning.culling import PixelWindow, clip_behind_eye, eye_is_near, screen_bounds
from splatgl.planning.resolve import Appearance, Resolved, blur_form, select_splats, select_with_notes
from splatgl.planning.technique import (
    MOST_DOUBLINGS,
    SHARE,
    OcclusionCulling,
    TechniqueRequest,
    TileSupport,
    alignment,
    choose_footprint,
    choose_technique,
    depth_batches,
    exp_doublings,
)
from splatgl.splat.kernels import BOX, FREE, Kernel, has_negative
from splatgl.splat.motion import Exposure, Motion, count_moments
from splatgl.splat.motion_blur import MOTIONS
from splatgl.splat.settings import Settings
from splatgl.splat.splats import Splats, is_points
from splatgl.transfer.regions import describe_regions


@dataclass(frozen=True)
class FootprintTable:
    """A footprint's table: its kernel's name, kind, size and bits."""

    kernel: str
    kind: str
    size: int
    bits: int


@dataclass(frozen=True)
class MotionBlur:
    """Motion blur of a picture. settings: with the form of streaks. camera: in the middle of the
    exposure. exposure: of streaks, else None. moments: number of pictures whose mean it is, else 0.
    """

    settings: Settings
    camera: Camera
    exposure: Exposure | None = None
    moments: int = 0

    @classmethod
    def of(
        cls, splats: Splats, camera: Camera, settings: Settings, motion: Motion | None, notes: list[str]
    ) -> MotionBlur:
        """Resolves the blur of the settings; adds notes."""
        exposure, is_off = Exposure.of(camera, settings.shutter, motion), settings.motion == "off"
        is_off = is_off and (settings.moments or 1) == 1
        if is_off and motion is not None and not motion.still:
            notes.append("motion blur left out: the setting motion is off (changes the picture)")
        elif exposure is None and not is_off:
            notes.append("motion blur left out: nothing moves, the picture is the same")
        if is_off or exposure is None or motion is None:
            return cls(settings, camera)
        form = blur_form(splats, settings)
        if form == "moments":
            splats = select_splats(splats, settings, True, camera)
            count = settings.moments or count_moments(splats, camera, motion, settings.shutter)
            if settings.motion in MOTIONS:
                notes.append(
                    f"motion {settings.motion} left out: no streaks in blend {settings.blend}, subframes "
                    f"are averaged instead"
                )
            notes.append(f"motion blur: the mean of pictures at {count} times, shutter {settings.shutter:g}°")
            return cls(settings, exposure.middle, None, count)
        drawn = f"motion blur {form}, shutter {settings.shutter:g}°, on quads"
        notes.append(f"{drawn}; the error bound refers to straight streaks")
        notes.append(
            f"streaks are straight: they deviate from curved paths by up to {exposure.bend(splats):.2g} pixels"
        )
        count = settings.moments or 1
        if count > 1:
            notes.append(f"the mean of {count} pictures, each with streaks over its part of the paths")
        return cls(settings.replace(motion=form), exposure.middle, exposure, count if count > 1 else 0)


@dataclass(frozen=True, eq=False)
class ResolvedLayer:
    """Splats of a picture, and their resolved settings, with all notes. splats: those that are drawn. front: those in
    front of the eye; with streaks all. settings: as they were given. blurred: motion blur. why_before: why voxels are
    classified before reconstruction, None: values are after it.
    """

    splats: Splats
    front: Splats
    resolved: Resolved
    settings: Settings
    blurred: MotionBlur
    why_before: str | None = None

    @classmethod
    def of(cls, splats: Splats, camera: Camera, settings: Settings, motion: Motion | None = None) -> ResolvedLayer:
        """Resolves the settings. motion: of the scene since the previous frame."""
        notes = list[str]()
        blurred = MotionBlur.of(splats, camera, settings, motion, notes)
        how, camera, moving = blurred.settings, blurred.camera, blurred.exposure is not None
        selected, why = select_with_notes(splats, how, moving, camera, notes)
        front = selected if moving else clip_behind_eye(selected, camera)
        resolved = Resolved.of(front, camera, how, moving)
        return cls(selected, front, replace(resolved, notes=(*notes, *resolved.notes)), settings, blurred, why)


# texels along an axis: as in the paper, and for an error of 1e−5 of a radial table
TABLE_SIZES = {"table": 256, "radial": 1024, "polynomial": 1, "single": 1, "box": 1}


@dataclass(frozen=True)
class ViewTraits:
    """View properties. antialias: whether any voxel is widened. cubic: whether voxels are cubes.

    half_line: whether the eye may be inside a kernel.
    """

    perspective: bool
    antialias: bool
    cubic: bool
    half_line: bool


@dataclass(frozen=True)
class Program:
    """Compile-time choices, the key of the program cache.

    footprint: its source, table, radial, polynomial, single (polynomial) or box. kernel: whose polynomials are compiled
    in. motion: form of streaks. flow: whether splats have individual velocities. points: whether positions are no
    voxel centres; see splats.py. exp_doublings: see optics.glsl.
    """

    technique: str
    appearance: Appearance
    seen: ViewTraits
    align: str
    footprint: str
    kernel: str = ""
    motion: str = "off"
    flow: bool = False
    points: bool = False
    exp_doublings: int = MOST_DOUBLINGS

    @property
    def runs(self) -> bool:
        """Whether opacities depend on the run lengths of occupied voxels around splats."""
        return self.appearance.attenuation == "fill" and (self.seen.antialias or self.motion != "off")

    @property
    def boxes(self) -> bool:
        """Whether splats are boxes of voxels."""
        return self.footprint == "box"

    @property
    def bent(self) -> bool:
        """Whether a footprint is more than a quadratic form; see tiles.glsl."""
        return self.seen.antialias and self.align == "exact"

    @property
    def packed(self) -> bool:
        """Whether tiles store gradient components in 17 bits, finer than a single polynomial's weights."""
        return self.technique == "tiles" and self.appearance.steps > 0 and self.footprint == "single" and not self.bent


@dataclass(frozen=True)
class Plan:
    """The plan of a picture. order: back-to-front or front-to-back. notes: omitted steps with reasons, a line each.

    z_s: depth where `hybrid` switches, world units. window: the pixels, or samples, that splats reach. splats: those
    that are drawn. settings: as they were given. exposure: that of streaks. moments: pictures that it is the mean of,
    planned for the middle of the exposure; 0: none.
    """

    program: Program
    resolved: Resolved
    lookup: FootprintTable
    order: str
    target: str
    z_s: float
    window: PixelWindow
    hiding: OcclusionCulling
    notes: tuple[str, ...]
    splats: Splats
    settings: Settings
    exposure: Exposure | None = None
    moments: int = 0

    @property
    def kernel(self) -> Kernel:
        """The reconstruction kernel."""
        return self.resolved.kernel

    @property
    def samples(self) -> int:
        """Samples along each side of a pixel."""
        return self.resolved.samples

    @property
    def view(self) -> GridView:
        """The view of the grid at sample resolution."""
        return self.resolved.view

    @property
    def antialias(self) -> str:
        """A description of the antialiasing."""
        most = f"{self.samples}×{self.samples} samples a pixel"
        spared = "at edges, one elsewhere" if self.resolved.allowed and self.program.technique == "tiles" else ""
        ways = [f"{most} {spared}".strip()] if self.resolved.averaged else []
        ways += ["voxels widened beyond z_k"] if self.view.antialias else []
        return " and ".join(ways) or "off"

    @property
    def key(self) -> Hashable:
        """Cache key: for the same splats and camera, plans with equal keys draw the same picture."""
        r = self.resolved
        drawn = (
            r.samples,
            r.averaged,
            r.allowed,
            r.background,
            self.lookup,
            self.order,
            self.target,
            self.z_s,
            self.window,
            self.hiding,
            None if r.clip is None else (r.clip.normal.tobytes(), r.clip.place.tobytes()),
            None if r.cues is None else r.cues.key,
        )
        return self.program, drawn, self.exposure, self.moments

    @property
    def table(self) -> str:
        """A description of the footprint table."""
        kind, size = self.lookup.kind, self.lookup.size
        if size == 1:
            return {"polynomial": "polynomials", "single": "a single polynomial", "box": "exact lengths"}[kind]
        name, sides = ("table", f"{size}×{size}") if kind == "table" else ("radial table", str(size))
        return f"{name} {sides} at {self.lookup.bits} bits"

    def with_choices(self, **choices: Any) -> Plan:
        """This plan with changed fields of `program`, its look or its view traits."""
        mine, appearance, props = ({f.name for f in fields(part)} for part in (Program, Appearance, ViewTraits))
        assert choices.keys() <= mine | appearance | props
        program = replace(
            self.program,
            appearance=replace(
                self.program.appearance, **{name: choices[name] for name in appearance & choices.keys()}
            ),
            seen=replace(self.program.seen, **{name: choices[name] for name in props & choices.keys()}),
            **{name: choices[name] for name in mine & choices.keys()},
        )
        tiles = program.technique == "tiles"
        kind = "radial" if program.footprint in ("polynomial", "single") and not tiles else program.footprint
        lookup = replace(self.lookup, kind=kind, size=TABLE_SIZES[kind]) if kind != program.footprint else self.lookup
        if program.technique == "quads" and program.motion != "off":
            program = replace(program, technique="streaks")
        program = replace(program, footprint=kind)
        return replace(self, program=program, lookup=lookup, hiding=self.hiding if tiles else OcclusionCulling())

    def explain(self) -> str:
        """A description of the plan, one line per decision."""
        p, resolved = self.program, self.resolved
        lines = [
            f"blend {p.appearance.blend}, {'perspective' if p.seen.perspective else 'orthographic'}, target "
            f"{self.target}",
            f"footprint {self.kernel.name}, {self.table}",
            f"align {p.align}" + (f", switch to grid-aligned at z_s = {self.z_s:.6g}" if p.align == "hybrid" else ""),
            f"antialias {self.antialias}, z_k = {resolved.z_k:.6g}, "
            f"splats from depth {resolved.depths[0]:.6g} to {resolved.depths[1]:.6g}",
        ]
        if resolved.sheets is not None:
            lines.append(resolved.sheets.explain())
        if p.appearance.regions and self.splats.post is not None:
            lines.append(describe_regions(self.splats.post.transfer.regions))
        if p.appearance.hides:
            lines.append(f"attenuation {p.appearance.attenuation}, {self.order}")
        rows = f"rows {self.window.y} to {self.window.y + self.window.height}"
        lines.append(f"{p.technique}, read back from {rows}: nothing reaches the others")
        if self.hiding.cutoff:
            light = f"less than {self.hiding.cutoff:.2g} of the light"
            lines.append(f"tiles behind {light} end, which changes no pixel by more")
        return "\n".join([*lines, *self.notes])


@public
def plan(
    splats: Splats | Any,
    camera: Camera | Any,
    settings: Settings | Any | None = None,
    motion: Motion | None = None,
    tiles: TileSupport = False,
) -> Plan:
    """The plan of a picture, in which no setting is `auto`. motion: of the scene since the previous frame. tiles:
    whether the renderer prefers them; "sheets": for these alone; None if unsupported.
    """
    if not (tiles is None or isinstance(tiles, bool) or (isinstance(tiles, str) and tiles == "sheets")):
        raise expected("tiles", "True, False, sheets or None", repr(tiles)[:80])
    return plan_layer(ResolvedLayer.of(splats, camera, settings or Settings(), motion), tiles)


def plan_layer(layer: ResolvedLayer, tiles: TileSupport) -> Plan:
    """The plan of a picture whose settings are resolved. tiles: as of `plan`."""
    splats, resolved, settings, exposure = layer.front, layer.resolved, layer.blurred.settings, layer.blurred.exposure
    shape, view, appearance, notes = resolved.kernel, resolved.view, resolved.appearance, list(resolved.notes)
    align, z_s = alignment(splats, view, settings, notes)
    half_line = resolved.boxes or _half_line(splats, view, align, exposure, notes)
    # without splats no technique can refuse
    request = TechniqueRequest(settings, exposure is not None, tiles, resolved.sheets is not None, resolved.boxes)
    kind = choose_technique(request, notes) if len(splats) else "quads"
    read = "box" if resolved.boxes else choose_footprint(kind, shape, settings, appearance.steps > 0)
    bounds = screen_bounds(splats.corners_in_grid(), view)
    # sheets sort all splats at a time, and take the exponential itself: other opacities compile nothing
    whole = resolved.sheets is not None or resolved.boxes
    hiding = OcclusionCulling()
    if kind == "tiles" and appearance.hides and settings.occlusion != "off":
        cutoff = SHARE * settings.tolerance / max(splats.brightest, 1.0)
        hiding = OcclusionCulling(depth_batches(splats, view, bounds, whole), cutoff)
    program = Program(
        technique=kind,
        appearance=appearance,
        seen=ViewTraits(view.perspective, view.antialias, splats.grid.cubic, half_line),
        align=align,
        footprint=read,
        kernel=shape.name if read in ("polynomial", "single") else "",
        motion=settings.motion if exposure else "off",
        flow=exposure is not None and exposure.flow is not None,
        points=is_points(splats.records.dtype),
        exp_doublings=MOST_DOUBLINGS
        if whole or kind != "tiles"
        else exp_doublings(splats, shape, appearance.attenuation),
    )
    return Plan(
        program,
        resolved,
        FootprintTable(shape.name, read, settings.table_size or TABLE_SIZES[read], settings.table_bits),
        _order(settings, kind, resolved.sheets is not None, notes),
        _target(settings),
        z_s,
        # a streak may reach any pixel
        PixelWindow(0, 0, *view.size) if exposure else bounds.window,
        hiding,
        tuple(notes),
        layer.splats,
        layer.settings,
        exposure,
        layer.blurred.moments,
    )


def _half_line(splats: Splats, view: GridView, align: str, exposure: Exposure | None, notes: list[str]) -> bool:
    """Whether the eye may be inside a kernel, or a kernel may cross the eye's plane."""
    if align != "exact":
        return False
    near = eye_is_near(splats, view, exposure)
    if near and view.kernel is not BOX and has_negative(view.kernel.name):
        what = f"kernel {view.kernel.name}, which has negative values"
        raise expected(what, "an eye outside of all kernels", "one inside", "move it away")
    if not near:
        notes.append("half lines left out: the eye is in no kernel; the picture is the same")
    return near


def _order(settings: Settings, kind: str, sheets: bool, notes: list[str]) -> str:
    if not sheets and not settings.hides:
        notes.append(f"ordering left out: {settings.blend} is the same in any order, but for float32's rounding")
    if settings.order != "auto":
        return settings.order
    return "front-to-back" if kind == "tiles" or sheets else "back-to-front"


def _target(settings: Settings) -> str:
    """The format of the framebuffer; sums exceed 8 bits."""
    is_float = settings.target == "auto" or (settings.target == "rgba8" and settings.is_sum)
    return "rgba32f" if is_float else settings.target


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
class SettingsUse:
    """A layer's plan, the settings as they were given, and whether meshes are drawn, too."""

    plan: Plan
    given: Settings
    meshes: bool

    @property
    def appearance(self) -> Appearance:
        """The appearance of the splats."""
        return self.plan.program.appearance

    @property
    def is_lit(self) -> bool:
        """Whether light changes with the direction of surfaces; points have none."""
        splats = self.plan.splats
        has_normals = splats.post is not None or splats.labels is not None or bool(splats.records["normal"].any())
        return self.appearance.iso == "lit" or (self.appearance.shading and has_normals)

    @property
    def shows_light(self) -> bool:
        """Whether the picture depends on the light."""
        return self.is_lit or self.plan.resolved.cues is not None or (self.meshes and self.given.shading != "off")

    @property
    def skips_hidden(self) -> bool:
        """Whether hidden splats are skipped, unless the settings say otherwise."""
        return self.appearance.hides and self.plan.program.technique == "tiles"


# settings, whether the plan of a layer uses them, and the reason if no layer does
NEEDS: tuple[tuple[tuple[str, ...], Callable[[SettingsUse], bool], str], ...] = (
    (OF_SPLATS, lambda use: len(use.plan.splats) > 0, "only meshes are rendered"),
    (("samples",), lambda use: use.given.antialias == "supersample", "antialias is not supersample"),
    (("z_s",), lambda use: use.plan.program.align == "hybrid", "align is not hybrid, or the view is parallel"),
    (
        ("align",),
        lambda use: use.plan.program.align == use.given.align,
        "in a parallel view all alignments are the same",
    ),
    (("mip_attenuation",), lambda use: use.appearance.join == "attenuated", "blend is not attenuated-mip"),
    (("table_size",), lambda use: use.plan.program.footprint in ("table", "radial"), "footprints are no table"),
    (
        ("kernel",),
        lambda use: use.given.kernel in (use.plan.kernel.name, FREE),
        "voxels of labels are rendered as boxes",
    ),
    (("shading",), lambda use: use.given.shading == "off" or use.is_lit or use.meshes, "there are no surfaces"),
    (LIGHT, lambda use: use.shows_light, "nothing is shaded"),
    (("ambient_occlusion",), lambda use: use.appearance.sky, "nothing is rendered in blend composite"),
    (
        ("shadows",),
        lambda use: use.appearance.shadows or use.meshes,
        "shadows need blend composite, and a light that is not at the camera",
    ),
    (
        ("compositing",),
        lambda use: (use.given.compositing == "sheets") == (use.plan.resolved.sheets is not None),
        "these splats composite one by one",
    ),
    (("sheets",), lambda use: use.appearance.sheets > 0, "splats composite one by one"),
    (("steps",), lambda use: use.appearance.steps > 0, "values are classified before reconstruction"),
    (
        ("attenuation",),
        lambda use: use.given.attenuation in ("opacity", use.appearance.attenuation),
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
    (("order",), lambda use: use.appearance.hides, "the blend has no order"),
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
        if listed and not any(is_used(SettingsUse(plan, settings, has_meshes)) for plan in plans):
            notes += no_effect(listed, why)
            given = {name: value for name, value in given.items() if name not in listed}
    return tuple(notes)

"""`Plan`: what one picture needs, decided from what was asked, the splats and the camera.

`program` holds the enums and booleans that choose shader text and GL state, and is the key of the
program cache; everything else is a number for a uniform, so that a moving camera compiles nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from splatgl.splat.ahead import ahead
from splatgl.splat.alignment import alignment
from splatgl.splat.camera import Camera
from splatgl.splat.kernel import Kernel, kernel
from splatgl.splat.motion import Exposure, Motion
from splatgl.splat.near import Near, eye_is_near, widened
from splatgl.splat.occlusion import SHARE, around, closing
from splatgl.splat.primitive import footprint, primitive
from splatgl.splat.resolve import Resolved
from splatgl.splat.rows import Splats
from splatgl.splat.settings import Settings
from splatgl.splat.sprites import Reach, Window, reach
from splatgl.splat.tiling import HALVINGS, halvings, portions

# texels along an axis: the paper's, and what brings a radial table's error to 1e−5
TABLE_SIZES = {"table": 256, "radial": 1024, "polynomial": 1}
# largest sprite, pixels, where no renderer says its own: that of software OpenGL
SPRITE_LIMIT = 255.0
# pixels along a viewport's sides that every OpenGL of today draws, where no renderer says its own
VIEWPORT = 16384
# the largest point, pixels; whether tiles are preferred, None: there are none; the largest viewport, pixels
Device = tuple[float, bool | None, int]


@dataclass(frozen=True)
class Program:
    """What is compiled in or set as GL state. kernel: whose polynomials are compiled in. halvings: see optics.glsl."""

    blend: str
    align: str
    perspective: bool
    antialias: bool
    cubic: bool
    shading: bool
    attenuation: str
    order: str
    target: str
    footprint: str = "table"
    half_line: bool = False
    primitive: str = "quad"
    hiding: bool = False
    motion: str = "off"
    flow: bool = False
    kernel: str = ""
    halvings: int = HALVINGS


@dataclass(frozen=True)
class Plan:
    """What is drawn. Depths are in world units. `notes`: what was left out, and why, a line each.

    window: the pixels, or samples, that splats reach. pad: how far beyond the picture's edge a sprite may be centred.
    parts: in how many parts it is drawn; between two, pixels that less than `passing` of the light passes are closed.
    around: how many tiles beyond its own a sprite may reach. exposure: of a blurred picture.
    near: which splats are quads all the same, where others are sprites. half_line: whether the eye may be in one.
    beyond, unsure: from which depths on antialiasing widens voxels; see widening.py.
    """

    program: Program
    kernel: Kernel
    table_size: int
    table_bits: int
    samples: int
    z_k: float
    z_s: float
    nearest: float
    farthest: float
    window: Window
    pad: int
    parts: int
    around: int
    passing: float
    background: tuple[float, float, float] | None
    tolerance: float
    notes: tuple[str, ...]
    exposure: Exposure | None = None
    near: Near | None = None
    half_line: bool = False
    beyond: tuple[float, float] = (np.inf, np.inf)
    unsure: float = 0.0

    @property
    def table(self) -> str:
        """The footprint table in words."""
        if self.program.footprint == "polynomial":
            return "polynomials"
        size = f"{self.table_size}×{self.table_size}" if self.program.footprint == "table" else str(self.table_size)
        name = "table" if self.program.footprint == "table" else "radial table"
        return f"{name} {size} at {self.table_bits} bits"

    def forced(self, **choices: Any) -> Plan:
        """This plan with choices of `program` made otherwise; half lines need quads, quads near the eye need them."""
        if choices.get("primitive") == "quad":
            choices = {"half_line": self.half_line, **choices}
        program = replace(self.program, **choices)
        if program.half_line:
            program = replace(program, primitive="quad")
        sprite, quad = program.primitive == "sprite", program.primitive == "quad"
        parts = self.parts if sprite == (self.program.primitive == "sprite") and not quad else 1
        program = replace(program, hiding=program.hiding and sprite)
        return replace(self, program=program, pad=self.pad * (not quad), parts=parts, near=None if quad else self.near)

    @property
    def nearest_quads(self) -> Plan:
        """How the splats near the eye are drawn where the others are sprites."""
        return self.forced(primitive="quad")

    def explain(self) -> str:
        """The plan in words, a line a decision."""
        p = self.program
        lines = [
            f"blend {p.blend}, {'perspective' if p.perspective else 'orthographic'}, target {p.target}",
            f"footprint {self.kernel.name}, {self.table}",
            f"align {p.align}" + (f", switch to grid-aligned at z_s = {self.z_s:.6g}" if p.align == "hybrid" else ""),
            f"antialias {'on' if p.antialias else 'off'}, z_k = {self.z_k:.6g}, "
            f"splats from depth {self.nearest:.6g} to {self.farthest:.6g}",
        ]
        if p.blend == "composite":
            lines.append(f"attenuation {p.attenuation}, {p.order}")
        w = self.window
        nearer = ", quads for the nearest planes" if self.near else ""
        rows = f"rows {w.y} to {w.y + w.height}"
        lines.append(f"{p.primitive}s{nearer}, read back from {rows}: nothing reaches the others")
        if p.primitive == "tile" and self.passing:
            lines.append(f"tiles behind less than {self.passing:.2g} of the light end, which changes no pixel by more")
        elif self.parts > 1:
            what = "splats" if p.hiding else "fragments"
            light = f"behind less than {self.passing:.2g} of the light"
            lines.append(f"drawn in {self.parts} parts; {what} {light} are left out, which changes no pixel by more")
        if self.samples > 1:
            lines.append(f"supersampled {self.samples}×{self.samples}")
        return "\n".join([*lines, *self.notes])


def plan(
    splats: Splats,
    camera: Camera,
    settings: Settings | None = None,
    sprite_limit: float = SPRITE_LIMIT,
    motion: Motion | None = None,
    tiles: bool | None = False,
    viewport: int = VIEWPORT,
) -> Plan:
    """The plan for one picture; everything that stands on `auto` is decided here.

    sprite_limit: the largest point that OpenGL draws, pixels. motion: how the scene comes to where it is.
    tiles: whether the renderer prefers them to sprites; None if it has none. viewport: its largest side, pixels.
    """
    settings = settings or Settings()
    notes: list[str] = []
    settings, exposure = _exposed(splats, camera, settings, motion, notes)
    if exposure is None:
        splats = ahead(splats, camera)
    return _planned(splats, exposure or camera, settings, (sprite_limit, tiles, viewport), notes)


def _planned(
    splats: Splats, seen: Camera | Exposure, settings: Settings, device: Device, notes: list[str]
) -> Plan:
    """The plan for a still, or for an exposure."""
    exposure, camera = (seen, seen.middle) if isinstance(seen, Exposure) else (None, seen)
    resolved = Resolved.of(splats, camera, settings, moving=exposure is not None)
    fine, shape = resolved.camera, resolved.kernel

    notes += resolved.antialias_notes
    align, z_s = alignment(splats, fine, settings, notes)
    half_line = _half_line(splats, camera, (align, shape), exposure, notes)
    kind, parted, covered = _primitive(splats, fine, settings, (align, half_line), device, notes)
    number, hiding, closes = _closing(splats, fine, covered, settings, (kind, parted is None), notes)
    shaped = footprint((align, kind), shape, settings)
    notes += resolved.shading_notes
    program = Program(
        blend=resolved.blend,
        align=align,
        perspective=camera.perspective,
        antialias=resolved.antialias,
        cubic=splats.grid.cubic,
        shading=resolved.shading,
        attenuation=resolved.attenuation,
        order=_order(settings, number > 1 or parted is not None or kind == "tile", notes),
        target="rgba32f" if settings.target == "auto" else settings.target,
        footprint=shaped,
        half_line=half_line and kind == "quad",
        primitive=kind,
        hiding=hiding,
        motion=settings.motion if exposure else "off",
        flow=exposure is not None and exposure.flow is not None,
        kernel=shape.name if shaped == "polynomial" else "",
        halvings=halvings(splats, shape, settings) if kind == "tile" else HALVINGS,
    )
    return Plan(
        program,
        shape,
        settings.table_size or TABLE_SIZES[program.footprint],
        settings.table_bits,
        resolved.samples,
        resolved.z_k,
        z_s,
        resolved.nearest,
        resolved.farthest,
        # a streak may reach any pixel
        Window(0, 0, *fine.size) if exposure else covered.window,
        covered.pad if kind != "quad" else 0,
        number,
        int(around(covered)) if hiding else 0,
        SHARE * settings.tolerance / max(splats.brightest, 1.0) if closes else 0.0,
        resolved.background,
        settings.tolerance,
        tuple(notes),
        exposure,
        parted,
        half_line,
        resolved.beyond,
        resolved.unsure,
    )


def _exposed(
    splats: Splats, camera: Camera, settings: Settings, motion: Motion | None, notes: list[str]
) -> tuple[Settings, Exposure | None]:
    """The exposure, None for a still, and the settings that it leaves: streaks are exact, on quads."""
    found = Exposure.of(camera, settings, motion)
    if settings.motion == "off":
        if motion is not None and not motion.still:
            notes.append("motion blur left out: the setting motion is off; the picture would be another")
        return settings, None
    if found is None:
        notes.append("motion blur left out: nothing moves; the picture is the same")
        return settings, None
    if settings.blend == "mip":
        notes.append("motion blur left out: the mean of maxima is no maximum of streaks; the picture would be another")
        return settings, None
    if settings.align not in ("auto", "exact"):
        notes.append(f"align {settings.align} left out: streaks are exact")
    drawn = f"motion blur {settings.motion}, shutter {settings.shutter:g}°, on quads"
    notes.append(f"{drawn}; its error bound is to straight streaks")
    notes.append(f"streaks are straight: where paths bend most they are off by {found.bend(splats):.2g} pixels")
    return settings.but(align="exact", primitive="quad"), found


def _half_line(
    splats: Splats, camera: Camera, fit: tuple[str, Kernel], exposure: Exposure | None, notes: list[str]
) -> bool:
    """Only if the eye may be in a kernel. fit: alignment and kernel."""
    align, shape = fit
    near = align == "exact" and eye_is_near(splats, camera, shape.radius, exposure)
    if align == "exact" and not near:
        notes.append("half lines left out: the eye is in no kernel; the picture is the same")
    return near


def _primitive(
    splats: Splats,
    camera: Camera,
    settings: Settings,
    fit: tuple[str, bool],
    device: Device,
    notes: list[str],
) -> tuple[str, Near | None, Reach]:
    """Tiles, sprites or quads, which splats are quads all the same, and what sprites cover."""
    covered = reach(splats, camera, kernel(settings.kernel).radius)
    kind, why, parted = primitive(splats, camera, settings, fit, covered, device)
    if why and settings.primitive != "quad":
        left_out = "tiles" if kind == "tile" else "sprites"
        notes.append(f"{left_out} left out{', but behind the nearest planes' if parted else ''}: {why}")
    return kind, parted, widened(covered, parted)


def _closing(
    splats: Splats, camera: Camera, covered: Reach, settings: Settings, how: tuple[str, bool], notes: list[str]
) -> tuple[int, bool, bool]:
    """How many parts, whether hidden splats are mapped, and pixels closed. how: the primitive, and whether of all."""
    kind, whole = how
    if settings.blend != "composite" or settings.occlusion == "off" or settings.order == "back-to-front":
        return 1, False, False
    if kind == "tile":
        return portions(splats, camera, covered), False, True
    if kind == "quad" or not whole:
        return 1, False, False
    number, hiding = closing(splats, camera, covered)
    if number == 1:
        notes.append("occlusion left out: closing pixels would cost more than it saves; the picture is the right one")
    return number, hiding, number > 1


def _order(settings: Settings, nearest_first: bool, notes: list[str]) -> str:
    if settings.blend != "composite":
        notes.append(f"ordering left out: {settings.blend} is the same in any order, but for float32's rounding")
    if settings.order != "auto":
        return settings.order
    return "front-to-back" if nearest_first else "back-to-front"

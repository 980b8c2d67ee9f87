"""`Plan`: what one picture needs, decided from what was asked, the splats and the camera.

`program` holds the enums and booleans that choose shader text and GL state, and is the key of the
program cache; everything else is a number for a uniform, so that a moving camera compiles nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from splatgl.data.errors import expected
from splatgl.splat.camera import Camera
from splatgl.splat.footprint import switch_depth
from splatgl.splat.kernel import Kernel, kernel
from splatgl.splat.rows import Splats
from splatgl.splat.settings import Settings

# nearest depth drawn, in voxels: a perspective quad nearer than that would overflow its clip coordinates
NEAR = 1e-3
# texels along an axis: the paper's, and what brings a radial table's error to 1e−5
TABLE_SIZES = {"table": 256, "radial": 1024}
RADIAL_BITS = 32
# the eye is near where a kernel is nearer than this many radii: √1.1, as shaders/exact.glsl has it, and some
NEAR_RADII = 1.06
# one level of an 8-bit picture
LEVELS = 255.0
# the volume's reach, for z_s, is rounded up to powers of this: a moving camera seldom needs a new z_s
REACH_STEP = 1.1


@dataclass(frozen=True)
class Program:
    """The choices that are compiled in or set as GL state."""

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


@dataclass(frozen=True)
class Plan:
    """What is drawn. Depths are in world units. `notes`: what was left out, and why, a line each."""

    program: Program
    kernel: Kernel
    table_size: int
    table_bits: int
    samples: int
    z_k: float
    z_s: float
    nearest: float
    farthest: float
    background: tuple[float, float, float] | None
    tolerance: float
    notes: tuple[str, ...]

    @property
    def table(self) -> str:
        """The footprint table in words."""
        size = f"{self.table_size}×{self.table_size}" if self.program.footprint == "table" else str(self.table_size)
        name = "table" if self.program.footprint == "table" else "radial table"
        return f"{name} {size} at {self.table_bits} bits"

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
        if self.samples > 1:
            lines.append(f"supersampled {self.samples}×{self.samples}")
        return "\n".join([*lines, *self.notes])


def plan(splats: Splats, camera: Camera, settings: Settings | None = None) -> Plan:
    """The plan for one picture; everything that stands on `auto` is decided here."""
    settings = settings or Settings()
    notes: list[str] = []
    shape = kernel(settings.kernel)
    samples = settings.samples if settings.antialias == "supersample" else 1
    fine = camera.resized((camera.size[0] * samples, camera.size[1] * samples))
    nearest, farthest = depth_range(splats, camera)
    z_k = fine.z_k(_smallest_scale(splats))

    # antialiasing only if a splat lies beyond z_k
    antialias = settings.antialias != "off" and farthest >= z_k
    if settings.antialias != "off" and not antialias:
        notes.append(f"antialiasing left out: every splat is nearer than z_k = {z_k:.6g}; the picture is the same")
    shading = settings.shading == "on" or (
        settings.shading == "auto" and splats.shaded and settings.blend == "composite"
    )
    if settings.shading == "auto" and splats.shaded and not shading:
        notes.append(f"shading left out: {settings.blend} shows values, not surfaces")
    align, z_s = _alignment(splats, fine, settings, notes)
    # measured over walls, edges, threads, dots, fog and real volumes: fill is the nearest to supersampling
    attenuation = "fill" if settings.attenuation == "auto" else settings.attenuation
    footprint = _footprint(align, settings)
    half_line = align == "exact" and _eye_is_near(splats, camera, shape.radius)
    if align == "exact" and not half_line:
        notes.append("half lines left out: the eye is in no kernel")
    program = Program(
        blend=settings.blend,
        align=align,
        perspective=camera.perspective,
        antialias=antialias,
        cubic=splats.grid.cubic,
        shading=shading,
        # the forms differ in composite alone, and alike before z_k
        attenuation=attenuation if settings.blend == "composite" and antialias else "optical-depth",
        order=settings.order,
        target="rgba32f" if settings.target == "auto" else settings.target,
        footprint=footprint,
        half_line=half_line,
    )
    if settings.blend != "composite":
        notes.append(f"ordering left out: {settings.blend} is the same in any order")
    return Plan(
        program,
        shape,
        settings.table_size or TABLE_SIZES[footprint],
        settings.table_bits,
        samples,
        z_k,
        z_s,
        nearest,
        farthest,
        settings.background,
        settings.tolerance,
        tuple(notes),
    )


def depth_range(splats: Splats, camera: Camera) -> tuple[float, float]:
    """Smallest and largest depth, world units, of the box of all splats."""
    depth = camera.eye_from_points(splats.corners)[:, 2]
    return float(depth.min()), float(depth.max())


def _smallest_scale(splats: Splats) -> float:
    """The smallest width of a voxel from any side: the first to fall below a pixel."""
    return float(np.linalg.svd(splats.grid.world_from_index, compute_uv=False)[-1])


def _alignment(splats: Splats, camera: Camera, settings: Settings, notes: list[str]) -> tuple[str, float]:
    """(align, z_s). `auto` never picks grid: it loses path length, and the sum of many splats shows it."""
    if not camera.perspective:
        if settings.align != "grid":
            notes.append("rotation left out: in an orthographic view every ray is perpendicular to the image")
        return "grid", 0.0
    if settings.align == "a" and not splats.grid.cubic:
        raise expected("align a", "cubic voxels", "others", "use exact, b1 or ray")
    if settings.align != "hybrid":
        return ("exact" if settings.align == "auto" else settings.align), 0.0
    if settings.z_s is not None:
        return "hybrid", settings.z_s
    z_k = camera.z_k(splats.grid.mean_spacing)
    return "hybrid", z_k * _switch(splats, camera, settings)


def _footprint(align: str, settings: Settings) -> str:
    """`auto`: the paper's table for its quads, the finer radial one where a table's 0.04 level would show."""
    exact = align == "exact" or settings.align in ("auto", "exact")
    kind = settings.footprint
    if kind == "auto":
        kind = "radial" if exact and settings.table_bits == RADIAL_BITS else "table"
    if kind == "radial" and settings.table_bits != RADIAL_BITS:
        raise expected("table_bits", f"{RADIAL_BITS} for a radial table", settings.table_bits, "use footprint table")
    return kind


def _eye_is_near(splats: Splats, camera: Camera, radius: float) -> bool:
    """Whether the eye may lie inside a kernel: within NEAR_RADII of the box of all centres."""
    low, high = splats.index_bounds
    eye = splats.grid.index_from_world(camera.eye)
    return bool(np.linalg.norm(eye - np.clip(eye, low, high)) < NEAR_RADII * radius)


def _switch(splats: Splats, camera: Camera, settings: Settings) -> float:
    """z_s/z_k from the tolerance; the volume's reach from the view axis, rounded up, is its edge."""
    spacing = splats.grid.mean_spacing
    corners = camera.eye_from_points(splats.corners) / spacing
    reach = max(float(np.hypot(corners[:, 0], corners[:, 1]).max()), 1.0)
    rounded = REACH_STEP ** np.ceil(np.log(reach) / np.log(REACH_STEP))
    width, height = camera.size
    half_angle = float(np.arctan(camera.extent / 2 * max(width / height, 1.0)))
    return _cached_switch(settings.kernel, half_angle, max(width, height), float(rounded), settings.tolerance * LEVELS)


@lru_cache(maxsize=256)
def _cached_switch(name: str, half_angle: float, pixels: int, reach: float, levels: float) -> float:
    return switch_depth(kernel(name), half_angle, pixels, reach, levels)

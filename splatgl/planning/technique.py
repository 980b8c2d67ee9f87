"""Techniques: quads, tiles and streaks, their limits, and the alignment of footprints.

A tile of pixels has one column for each SIMD lane of a software renderer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import numpy as np

from splatgl.errors import expected
from splatgl.geometry.view import GridView
from splatgl.planning.culling import ScreenBounds
from splatgl.planning.resolve import has_radial_footprints, why_not_front_to_back
from splatgl.splat.footprint import switch_depth
from splatgl.splat.kernels import Kernel, kernel, polynomials
from splatgl.splat.settings import Settings, choices
from splatgl.splat.splats import Splats

# one level of an 8-bit picture
LEVELS = 255.0
# the volume's extent is rounded up to powers of this, so that a moving camera seldom changes z_s
REACH_STEP = 1.1


def alignment(splats: Splats, view: GridView, settings: Settings, notes: list[str]) -> tuple[str, float]:
    """(align, z_s). `auto` never picks grid: it loses path length, visible in the sum of many splats."""
    if not view.perspective:
        if settings.align != "grid":
            notes.append("rotation left out: in an orthographic view every ray is perpendicular to the image")
        return "grid", 0.0
    if settings.align != "hybrid":
        return ("exact" if settings.align == "auto" else settings.align), 0.0
    if settings.z_s is not None:
        return "hybrid", settings.z_s
    z_k = splats.grid.mean_spacing / view.filter_pitch
    return "hybrid", z_k * _switch(splats, view, settings)


def _switch(splats: Splats, view: GridView, settings: Settings) -> float:
    """z_s/z_k from the tolerance, at the volume's extent from the view axis, rounded up."""
    reach = max(float(np.hypot(*view.box(splats)[:2]).max()), 1.0)
    rounded = REACH_STEP ** np.ceil(np.log(reach) / np.log(REACH_STEP))
    half_angle = float(np.arctan(view.edge.max()))
    return _cached_switch(
        view.kernel.name, half_angle, max(view.size) / view.blur, float(rounded), settings.tolerance * LEVELS
    )


@lru_cache(maxsize=256)
def _cached_switch(name: str, half_angle: float, pixels: float, reach: float, levels: float) -> float:
    return switch_depth(kernel(name), half_angle, pixels, reach, levels)


# transmittance at termination, as a share of the tolerance. sRGB is 13 times as steep at black as on average, so at
# the default tolerance this is one level there too; 3/4 is only 5 % faster
SHARE = 1 / 13
# mean optical depth over the window from which on a volume is solid
SOLID = 20.0
# nearer batches are smaller: batch i of n ends at (i/n)^GROWTH of the splats
GROWTH = 1.5


@dataclass(frozen=True)
class OcclusionCulling:
    """depth_batches: number per picture; splats behind terminated tiles are skipped. cutoff: transmittance below which
    a tile terminates; 0: never.
    """

    depth_batches: int = 1
    cutoff: float = 0.0


def is_solid(splats: Splats, view: GridView, bounds: ScreenBounds) -> bool:
    """Whether the splats' mean optical depth over the window hides most of them."""
    area = bounds.window.width * bounds.window.height
    pixel = view.pitch * bounds.mean_depth if view.perspective else view.pitch
    return area > 0 and splats.total_depth / (area * pixel**2) >= SOLID


def batch_starts(count: int, number: int) -> list[int]:
    """Starts of `number` batches of `count` splats, and the end."""
    return [int(count * (n / number) ** GROWTH) for n in range(number)] + [count]


# polynomials have an error of 4e−5 of the footprint: accurate enough from this tolerance on
POLYNOMIAL_TOLERANCE = 1e-3
# a single polynomial for weights of values has an error of 4e−4, less where mass is small
SINGLE_TOLERANCE = 3e-3


# what a renderer draws in tiles: whether it prefers them; "sheets": these alone; None: nothing
TileSupport = bool | Literal["sheets"] | None


@dataclass(frozen=True)
class TechniqueRequest:
    """Settings and motion of a picture. tiles: what the renderer draws in them. sheets: whether splats add up within
    sheets. boxes: whether splats are boxes of voxels.
    """

    settings: Settings
    moving: bool
    tiles: TileSupport
    sheets: bool = False
    boxes: bool = False


def _why_not_quads(request: TechniqueRequest) -> str | None:
    if request.moving:
        return "motion"
    return why_not_front_to_back(request.settings) if request.sheets else None


def _why_not_streaks(request: TechniqueRequest) -> str | None:
    if not request.moving:
        return "a still"
    if request.sheets:
        return "sheets"
    if request.settings.shows_value:
        return "blends of one value per ray"
    return None


def _why_not_tiles(request: TechniqueRequest) -> str | None:
    if request.moving:
        return "motion"
    if request.tiles is None or (request.tiles == "sheets" and not request.sheets):
        return "an OpenGL without compute shaders, older than 4.3"
    return why_not_front_to_back(request.settings)


# by technique, the reason why it cannot draw a picture; None if it can
TECHNIQUES: dict[str, Callable[[TechniqueRequest], str | None]] = {
    "tiles": _why_not_tiles,
    "streaks": _why_not_streaks,
    "quads": _why_not_quads,
}


def choose_technique(request: TechniqueRequest, notes: list[str]) -> str:
    """The requested technique; for auto, tiles if preferred or for sheets or boxes, and possible, else quads. Raises
    InputError if none is possible.
    """
    wanted = "streaks" if request.moving else request.settings.technique
    if wanted != "auto":
        why = TECHNIQUES[wanted](request)
        if why:
            raise expected(f"technique {wanted}", f"what {wanted} can draw", why, "use auto")
        return wanted
    why = _why_not_tiles(request)
    if (request.tiles or request.sheets or request.boxes) and not why:
        return "tiles"
    refused = _why_not_quads(request)
    if refused:
        raise expected("sheets", "what quads can draw", refused, "composite splats, classified before reconstruction")
    if request.tiles:
        notes.append(f"tiles left out: {why}; quads are used")
    return "quads"


def choose_footprint(drawn: str, shape: Kernel, settings: Settings, means: bool = False) -> str:
    """The source of footprints. drawn: the technique. means: whether footprints weight values.

    `auto`: a radial table; for tiles, where lookups are slow, polynomials if they are accurate enough.
    """
    if not has_radial_footprints(settings):
        return "table"
    quick = drawn == "tiles" and settings.table_size is None and settings.tolerance >= POLYNOMIAL_TOLERANCE
    if not quick or polynomials(shape.name) is None:
        return "radial"
    return "single" if means and settings.tolerance >= SINGLE_TOLERANCE else "polynomial"


def table_of_unsupported() -> list[tuple[str, ...]]:
    """Table of unsupported settings by technique, a row for each setting value that any technique does not support."""
    rows = []
    for name, values in choices().items():
        for value in values:
            if name in ("technique", "motion"):
                continue
            change: dict[str, Any] = {name: value}
            settings = Settings().replace(**change)
            post = settings.classification == "post" or settings.needs_values
            sheets = post or settings.compositing == "sheets"
            reasons = [
                why(TechniqueRequest(settings, name_ == "streaks", True, sheets)) for name_, why in TECHNIQUES.items()
            ]
            if any(reasons):
                rows.append((f"{name} {value}", *(f"no: {why}" if why else "yes" for why in reasons)))
    return rows


# pixels along a tile's sides: tiles.glsl's COLUMNS and ROWS
COLUMNS, ROWS = 8, 8
# maximum number of pixels per band: the cursors, one per tile and run of splats, take as much memory as the pixels
MOST_PIXELS = 2**24
# solid volumes of more than MANY splats are drawn in BATCHES depth batches
MANY, BATCHES = 1_000_000, 6
# the same for sheets, which take longer, and whose open ones are stored between batches
MANY_IN_SHEETS, SHEET_BATCHES = 200_000, 3
# maximum number of splats placed at a time: one texel each in three to seven textures
MOST = 2**20
# maximum number of halvings of an optical depth before its polynomial: an opacity over 1 − 2⁻³² counts as 1
MOST_DOUBLINGS = 5
# gain of a slanted footprint over a frontal one, with a margin
SLANTED = 1.5


def depth_batches(splats: Splats, view: GridView, bounds: ScreenBounds, sheets: bool) -> int:
    """Number of depth batches: several for solid volumes, most of whose splats are behind terminated tiles. sheets:
    whether splats add up within sheets.
    """
    many, batches = (MANY_IN_SHEETS, SHEET_BATCHES) if sheets else (MANY, BATCHES)
    return batches if len(splats) >= many and is_solid(splats, view, bounds) else 1


def exp_doublings(splats: Splats, shape: Kernel, attenuation: str) -> int:
    """Number of halvings that bring the largest depth, in powers of two, to at most 1, the polynomial's domain."""
    if attenuation == "opacity":
        # the unstretched splat's depth, at any slant
        return MOST_DOUBLINGS
    longest = float(np.linalg.norm(splats.grid.world_from_index / splats.grid.mean_spacing, ord=2))
    deepest = splats.deepest * float(shape.footprint(np.zeros(()))) * longest * SLANTED / np.log(2.0)
    return int(np.clip(np.ceil(np.log2(max(deepest, 1e-30))), 0, MOST_DOUBLINGS))

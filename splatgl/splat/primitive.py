"""Whether splats are gathered by tiles, drawn as sprites, or as quads, if only those near the eye; and from what their
footprints are read.
"""

from __future__ import annotations

import numpy as np

from splatgl.data.errors import expected
from splatgl.splat.camera import Camera
from splatgl.splat.kernel import Kernel, kernel, polynomials
from splatgl.splat.near import Near, near
from splatgl.splat.order import order_for
from splatgl.splat.rows import MOST_KEPT, Splats
from splatgl.splat.settings import Settings
from splatgl.splat.sprites import Reach
from splatgl.splat.tiling import LIMIT, tiled

# polynomials are off by 4e−5 of the footprint: exact enough from this tolerance on
POLYNOMIAL_TOLERANCE = 1e-3
# bits of a radial table's texels: the only ones it has
RADIAL_BITS = 32


def primitive(
    splats: Splats,
    camera: Camera,
    settings: Settings,
    fit: tuple[str, bool],
    covered: Reach,
    device: tuple[float, bool | None, int],
) -> tuple[str, str, Near | None]:
    """tile, sprite or quad; why quads, "" otherwise; and how splats are parted, where only the nearest must be quads.

    fit: the alignment, and whether the eye may be in a kernel. device: the limit of OpenGL's points, pixels; whether
    the renderer prefers tiles to sprites, None if it has none; and its largest viewport, pixels.
    """
    if not len(splats):
        return "quad", "there are no splats", None
    limit, tiles, viewport = device
    kind = "tile" if tiled(splats, camera, settings, covered, tiles) else "sprite"
    limit = LIMIT if kind == "tile" else limit
    most_pad = viewport // 2 if kind == "tile" else (viewport - max(camera.size)) // 2
    why = _why_not(settings, fit, covered, limit) or _too_wide(covered, most_pad)
    if kind == "sprite" and len(splats) > MOST_KEPT:
        why = why or f"more than {MOST_KEPT:,} splats"
    if why and settings.primitive == kind:
        raise expected(f"primitive {kind}", "footprints by distance, away from the eye", why, "use auto")
    parts = by_distance(fit[0], settings) and camera.perspective and settings.order != "back-to-front" and len(splats)
    parted = None
    if why and parts and settings.primitive != "quad":
        parted = near(splats, camera, order_for(splats, camera), kernel(settings.kernel).radius, limit)
    if parted and (parted.reach.pad > most_pad or (kind == "sprite" and len(splats) > MOST_KEPT)):
        parted = None
    return kind if not why or parted else "quad", why, parted


def by_distance(align: str, settings: Settings) -> bool:
    """Whether footprints depend on the distance alone; a parallel view's grid is exact, if it was not asked for."""
    exact = align == "exact" or (align == "grid" and settings.align in ("auto", "exact"))
    return exact and settings.footprint != "table" and settings.table_bits == RADIAL_BITS


def _why_not(settings: Settings, fit: tuple[str, bool], covered: Reach, limit: float) -> str:
    align, half_line = fit
    if settings.primitive == "quad":
        return "quads were asked for"
    if not by_distance(align, settings):
        return "footprints from a table are drawn on quads"
    if half_line or not np.isfinite(covered.largest):
        return "the eye is near splats"
    if 2 * covered.largest + 1 > limit:
        return f"the nearest splats are larger than {limit:.0f} pixels"
    return ""


def _too_wide(covered: Reach, most_pad: int) -> str:
    """Sprites centred beyond the edges need a viewport that is wider than the picture."""
    return f"the picture and {covered.pad} pixels around it exceed the viewport" if covered.pad > most_pad else ""


def footprint(drawn: tuple[str, str], shape: Kernel, settings: Settings) -> str:
    """What a footprint is read from. drawn: alignment and primitive.

    `auto`: the paper's table for its quads, the finer radial one where a table's 0.04 level would show, and polynomials
    for tiles, whose time a look-up is much of, where that is exact enough.
    """
    exact = drawn[0] == "exact" or settings.align in ("auto", "exact")
    fitted = polynomials(shape.name) is not None
    kind = settings.footprint
    if kind == "auto":
        kind = "radial" if exact and settings.table_bits == RADIAL_BITS else "table"
        quick = fitted and settings.table_size is None and settings.tolerance >= POLYNOMIAL_TOLERANCE
        if kind == "radial" and drawn[1] == "tile" and quick:
            kind = "polynomial"
    if kind != "table" and settings.table_bits != RADIAL_BITS:
        raise expected("table_bits", f"{RADIAL_BITS} for a footprint by distance", settings.table_bits, "use table")
    if kind == "polynomial" and not fitted:
        raise expected("footprint polynomial", "a kernel of two pieces", shape.name, "use auto")
    return kind

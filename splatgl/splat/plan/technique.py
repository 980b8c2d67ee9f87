"""Techniques, their limits, and the choice of technique and footprint source."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from splatgl.errors import expected
from splatgl.splat.kernel.kernels import Kernel, polynomials
from splatgl.splat.plan.blend_mode import BLENDS
from splatgl.splat.plan.settings import Settings, choices
from splatgl.splat.plan.suited import by_distance, nearest_first

# polynomials have an error of 4e−5 of the footprint: accurate enough from this tolerance on
POLYNOMIAL_TOLERANCE = 1e-3
# a single one for weights of values has an error of 4e−4, small where mass is small
SINGLE_TOLERANCE = 3e-3


@dataclass(frozen=True)
class Asked:
    """Settings and motion of a picture. tiles: whether the renderer prefers them; None: unsupported.

    sheets: whether splats add up within sheets. boxes: whether they are boxes of voxels.
    """

    settings: Settings
    moving: bool
    tiles: bool | None
    sheets: bool = False
    boxes: bool = False


def _refuses_quads(asked: Asked) -> str | None:
    if asked.moving:
        return "motion"
    return nearest_first(asked.settings) if asked.sheets else None


def _refuses_streaks(asked: Asked) -> str | None:
    if not asked.moving:
        return "a still"
    if asked.sheets:
        return "sheets"
    if BLENDS[asked.settings.blend].join == "max":
        return "the mean of maxima is no maximum of streaks"
    return None


def _refuses_tiles(asked: Asked) -> str | None:
    if asked.moving:
        return "motion"
    if asked.tiles is None:
        return "an OpenGL without compute shaders, older than 4.3"
    return nearest_first(asked.settings)


# why each can't draw a picture, None if it can
TECHNIQUES: dict[str, Callable[[Asked], str | None]] = {
    "tiles": _refuses_tiles,
    "streaks": _refuses_streaks,
    "quads": _refuses_quads,
}


def technique(asked: Asked, notes: list[str]) -> str:
    """The requested technique; else tiles, if preferred or for sheets or boxes, and able; or quads. InputError if none
    can.
    """
    wanted = "streaks" if asked.moving else asked.settings.technique
    if wanted != "auto":
        why = TECHNIQUES[wanted](asked)
        if why:
            raise expected(f"technique {wanted}", f"what {wanted} can draw", why, "use auto")
        return wanted
    why = _refuses_tiles(asked)
    if (asked.tiles or asked.sheets or asked.boxes) and not why:
        return "tiles"
    refused = _refuses_quads(asked)
    if refused:
        raise expected("sheets", "what quads can draw", refused, "composite splats, classified before reconstruction")
    if asked.tiles:
        notes.append(f"tiles left out: {why}; quads are drawn")
    return "quads"


def footprint(drawn: str, shape: Kernel, settings: Settings, means: bool = False) -> str:
    """The source of footprints. drawn: the technique. means: whether they weigh values.

    `auto`: the paper's table for its quads, the finer radial one where a table's error of 0.04 level matters, and
    polynomials for tiles, where lookups are slow, if accurate enough.
    """
    if not by_distance(settings):
        return "table"
    quick = drawn == "tiles" and settings.table_size is None and settings.tolerance >= POLYNOMIAL_TOLERANCE
    if not quick or polynomials(shape.name) is None:
        return "radial"
    return "single" if means and settings.tolerance >= SINGLE_TOLERANCE else "polynomial"


def combinations() -> list[tuple[str, ...]]:
    """Table of refusals by technique, a row for each setting value that any technique refuses."""
    found = []
    for name, values in choices().items():
        for value in values:
            if name in ("technique", "motion"):
                continue
            settings = Settings().but(**{name: value})
            post = settings.classification == "post" or BLENDS[settings.blend].post_only
            sheets = post or settings.compositing == "sheets"
            reasons = [why(Asked(settings, each == "streaks", True, sheets)) for each, why in TECHNIQUES.items()]
            if any(reasons):
                found.append((f"{name} {value}", *(f"no: {why}" if why else "yes" for why in reasons)))
    return found

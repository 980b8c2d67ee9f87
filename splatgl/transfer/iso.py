"""Iso-surfaces: values at which the reconstructed field is drawn as a surface, of a colour and an opacity."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from splatgl.data.color import srgb_of_name
from splatgl.errors import expected
from splatgl.options import is_number

# most iso-surfaces of a volume: shaders keep an array of them
MOST_ISO = 8
# by this share of the range of values a surface lies above its value, so that even matter of exactly this value is
# below it, whatever its last digits are
ABOVE = 2.0**-20
# thickness of a surface among the matter of other layers, in sheets
THIN = 1e-4
FORM = "VALUE[:COLOUR[:OPACITY]]"


class Iso(NamedTuple):
    """A surface at a value. color: "#rrggbb"; "": the transfer function's colour of the value. opacity: from 0 to 1, of
    each crossing.
    """

    value: float
    color: str = ""
    opacity: float = 1.0


def read_iso(text: str) -> Iso:
    """The surface of VALUE[:COLOUR[:OPACITY]]; an empty colour is the transfer function's. Raises ValueError."""
    value, _, rest = text.partition(":")
    color, _, opacity = rest.partition(":")
    return _checked((float(value), color, float(opacity or 1.0)))


def check_iso(value: Any) -> tuple[Iso, ...]:
    """The surfaces, ascending, of a value, a text, (value, colour, opacity), or a sequence of these. Raises ValueError
    or TypeError for anything else, and InputError for too many or equal ones.
    """
    one = isinstance(value, str) or is_number(value)
    one = one or (len(value) > 1 and is_number(value[0]) and isinstance(value[1], str))
    surfaces = sorted(_checked(surface) for surface in ([value] if one else value))
    if len(surfaces) > MOST_ISO:
        raise expected("iso", f"at most {MOST_ISO} surfaces", len(surfaces))
    for first, second in pairwise(surfaces):
        if first.value == second.value:
            raise expected("iso", "surfaces of different values", f"{first.value:g} twice")
    return tuple(surfaces)


def _checked(surface: Any) -> Iso:
    if isinstance(surface, str):
        return read_iso(surface)
    value, color, opacity = Iso(surface) if is_number(surface) else Iso(*surface)
    if not (is_number(value) and math.isfinite(value) and is_number(opacity) and 0 <= opacity <= 1):
        raise ValueError
    return Iso(float(value), "#{:02x}{:02x}{:02x}".format(*srgb_of_name(color)) if color else "", float(opacity))


def crossed_depth(values: np.ndarray, depths: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Optical depths [N] of the surfaces, of `values` [n] and `depths` [n], between values `first` and `last` [N]."""
    crossed = (first[:, None] > values) != (last[:, None] > values)
    return np.asarray((crossed * depths).sum(axis=1))


def spline_crossings(q: np.ndarray) -> np.ndarray:
    """Places [2, N], ascending, from 0 to 1, where q₀(1−u)² + 2q₁u(1−u) + q₂u², of q [3, N], passes 0; infinite if
    there are none. Float64 twin of `crossings` in iso_surfaces.glsl.
    """
    begins, ends = q[0] > 0, q[2] > 0
    q0, q1, q2 = np.where(begins, q, -q)
    root = np.sqrt(np.maximum(q1 * q1 - q0 * q2, 0.0))
    tiny = 1e-30
    with np.errstate(divide="ignore", invalid="ignore"):
        once = np.where(q1 >= 0, (q1 + root + tiny) / (q1 + root - q2 + tiny), q0 / (q0 + root - q1))
        first, second = q0 / (q0 - q1 + root), (root - q1) / (root - q1 + q2)
    is_once, is_twice = begins != ends, (begins == ends) & (q1 < 0) & (root > 0)
    return np.stack([np.select([is_once, is_twice], [once, first], np.inf), np.where(is_twice, second, np.inf)])

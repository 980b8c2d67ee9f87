"""Grids as files state them: affine matrices into spacing and direction, and names of units of length."""

from __future__ import annotations

import numpy as np

from splatgl.data.volume import Triple
from splatgl.errors import expected

METRES = {"nm": 1e-9, "um": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0, "km": 1e3, "in": 0.0254, "Å": 1e-10}
"""Metres per unit of length, by the short name used in `Volume.unit`."""

_SPELLINGS = {
    "nm": ("nanometer", "nanometre"),
    "um": ("µm", "μm", "micron", "microns", "micrometer", "micrometre", r"\u00b5m"),
    "mm": ("millimeter", "millimetre"),
    "cm": ("centimeter", "centimetre"),
    "m": ("meter", "metre"),
    "km": ("kilometer", "kilometre"),
    "in": ("inch",),
    "Å": ("angstrom", "ångström"),
    "": ("unknown", "none", "pixel", "pixels", "voxel", "?", "???"),
}
_SHORT = {spelling: short for short, spellings in _SPELLINGS.items() for spelling in spellings}


# of pure numbers, and of what is not known
NO_UNITS = ("1", "none", "unknown", "dimensionless", "unitless", "n/a", "us")


def unit_name(text: str) -> str:
    """The short name of a unit of length ("millimeter" → "mm"), "" for none; unknown names are kept."""
    text = text.strip()
    return _SHORT.get(text.lower(), text)


def stated(unit: object) -> str:
    """The unit of values that a file states, "" for none: a short text, and no pure number."""
    text = str(unit or "").strip()
    return text if 0 < len(text) <= 24 and text.lower() not in NO_UNITS and text.isprintable() else ""


def triple(values: object, what: str) -> Triple:
    """Three floats (x, y, z). Raises InputError for any other number of them."""
    numbers = np.asarray(values, dtype=np.float64).ravel()
    if numbers.size != 3:
        raise expected(what, "three numbers (x, y, z)", numbers.tolist())
    return float(numbers[0]), float(numbers[1]), float(numbers[2])


def axes_of(matrix: np.ndarray, what: str) -> tuple[Triple, np.ndarray]:
    """Spacing and direction [3, 3] of world-from-index [3, 3], whose columns are the steps along x, y, z."""
    spacing = np.linalg.norm(matrix, axis=0)
    if not np.isfinite(spacing).all() or spacing.min() <= 0:
        raise expected(what, "a finite step along each axis", matrix.tolist())
    return triple(spacing, what), matrix / spacing

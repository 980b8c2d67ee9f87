"""Amounts and numbers: names of what simulations compute, and whether values are whole numbers, as labels are."""

from __future__ import annotations

import re

import numpy as np

from splatgl.data.volume import Hints

# anywhere in a name, and whole words
PARTS = (
    *("density", "temperature", "pressure", "velocity", "vorticity", "speed", "entropy", "enstrophy", "energy"),
    *("helicity", "concentration", "salinity", "humidity", "viscosity", "divergence", "streamfunction", "turbulence"),
)
WORDS = ("rho", "temp", "vel", "mach", "wind", "flow", "flux", "theta", "phi", "qcriterion")
# names of arrays are what a program calls its variables
LETTERS = ("u", "v", "w", "p", "t")
FIELD = "field"


def is_field(name: str, array: bool = False) -> bool:
    """Whether a name is that of a field of a simulation. array: of one array in a file, not of a file."""
    lower = name.lower()
    words = re.split(r"[^a-z]+", lower)
    named = any(part in lower for part in PARTS) or any(word in WORDS for word in words)
    return named or (array and lower in LETTERS)


def is_whole(values: np.ndarray) -> bool:
    """Whether all finite values are whole numbers."""
    if values.dtype.kind != "f":
        return True
    finite = values[np.isfinite(values)]
    return bool((finite == np.rint(finite)).all())


def hints_of(array: str, vectors: bool) -> Hints:
    """What a file's array says of how it is drawn. vectors: the samples are lengths of vectors."""
    return Hints(preset=FIELD) if vectors or is_field(array, array=True) else Hints()

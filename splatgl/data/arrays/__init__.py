"""`volume_of`: a volume from an array or image of another library, which is told by the module of its type.

No library is imported here that `x` does not come from. Samples are views where the library permits, and stay on disk
where they are there.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from importlib import import_module
from typing import Any

from splatgl.data.volume import Triple, Volume
from splatgl.errors import expected

# root module of a type, or of one of its bases → its function in this folder; others are arrays
_SOURCES = {
    "xarray": "labelled.of_xarray",
    "SimpleITK": "medical.of_simpleitk",
    "nibabel": "medical.of_nibabel",
    "napari": "layers.of_napari",
    "vtkmodules": "vtk_images.of_vtk",
}


@dataclass(frozen=True)
class ArrayOptions:
    """Options beside an array; those that are None come from `x`, if it knows them.

    spacing, origin: (x, y, z) in world units. unit: of length. array: name or number, where x holds several. values:
    "labels" or "amounts", what samples are.
    """

    spacing: Triple | None = None
    origin: Triple | None = None
    unit: str | None = None
    name: str | None = None
    array: str | int | None = None
    values: str | None = None

    @property
    def given(self) -> dict[str, Any]:
        """The fields of `Volume` among them that are not None."""
        named = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in ("array", "values")}
        return {name: value for name, value in named.items() if value is not None}

    def no_array(self, what: str) -> None:
        """InputError if `array` was given for what holds one."""
        if self.array is not None:
            raise expected("array", f"none, as {what} holds one", repr(self.array), "leave it out")


def volume_of(x: Any, **options: Any) -> Volume:
    """The volume in `x`, with the options of `ArrayOptions`; see `Volume.of`."""
    unknown = sorted(set(options) - {f.name for f in fields(ArrayOptions)})
    if unknown:
        raise expected("options", f"some of {', '.join(f.name for f in fields(ArrayOptions))}", ", ".join(unknown))
    asked = ArrayOptions(**options)
    found = x if isinstance(x, Volume) else _source(x)(x, asked)
    # an array that does not know its spacing does not know that of its levels
    levels = {"coarser": ()} if asked.spacing is not None or asked.origin is not None else {}
    found = replace(found, **asked.given, **levels)
    if asked.values not in (None, "labels", "amounts"):
        raise expected("values", "labels or amounts", repr(asked.values))
    return found if asked.values is None else found.of_values(asked.values)


def _source(x: Any) -> Any:
    """The function that makes volumes of what is like `x`."""
    for base in type(x).__mro__:
        place = _SOURCES.get(base.__module__.partition(".")[0])
        if place is not None:
            module, name = place.split(".")
            return getattr(import_module(f"{__name__}.{module}"), name)
    from splatgl.data.arrays.plain import of_array

    return of_array

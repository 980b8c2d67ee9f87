"""`import splatgl.integrations.xarray` adds `splatgl` to DataArrays of xarray: `field.splatgl.render()`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from splatgl.errors import import_extra

if TYPE_CHECKING:
    from splatgl.data.image import Image
    from splatgl.data.volume import Volume

_library = import_extra("xarray", "DataArrays", "xarray", "arrays")


@_library.register_dataarray_accessor("splatgl")
class SplatglAccessor:
    """Pictures, and the volume, of a DataArray."""

    def __init__(self, array: Any) -> None:
        self._array = array

    def volume(self, **options: Any) -> Volume:
        """The volume of the array; options as of `Volume.of`."""
        from splatgl.data.volume import Volume

        return Volume.of(self._array, **options)

    def render(self, *given: Any, **options: Any) -> Image:
        """A picture of the array; further arguments as of `splatgl.render`."""
        from splatgl.scene.api import render

        return render(self._array, *given, **options)

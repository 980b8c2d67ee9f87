"""What annotations need to know of a volume: its box, units and names, without its samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from splatgl.data.mesh import Mesh
from splatgl.data.volume import Volume


@dataclass(frozen=True)
class Scale:
    """A colour map and the values at its ends, and what they are of."""

    colormap: str
    low: float
    high: float
    label: str

    @classmethod
    def of(cls, meshes: Sequence[Mesh]) -> tuple[Scale, ...]:
        """Those of meshes whose values are seen, each once."""
        shown = [each for each in meshes if each.mapped and each.opacity > 0]
        return tuple(dict.fromkeys(cls(each.colormap, *each.ranged, each.quantity or each.name) for each in shown))


@dataclass(frozen=True, eq=False)
class Subject:
    """corners [8, 3]: of the box, world units; center [3]. colored: whether voxels have their own colours.

    value_unit: name of the values' unit. scales: of meshes. empty: whether voxels show nothing, as those that a mesh
    alone stands on.
    """

    corners: np.ndarray
    center: np.ndarray
    unit: str
    name: str
    frame: str | None
    colored: bool
    value_unit: str = ""
    scales: tuple[Scale, ...] = ()
    empty: bool = False

    @classmethod
    def of(cls, volume: Volume) -> Subject:
        """That of a volume."""
        colored = volume.color is not None
        return cls(volume.corners, volume.center, volume.unit, volume.name, volume.frame, colored, volume.value_unit)

    @property
    def value_name(self) -> str:
        """What a colour bar is called: the volume's name, and the unit of its values."""
        return f"{self.name}, {self.value_unit}" if self.name and self.value_unit else self.name or self.value_unit

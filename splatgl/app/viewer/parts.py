"""`Look`: how one layer, channel or volume of the window is seen, as a value; and meshes dressed in their colours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from splatgl.data.mesh import Mesh
from splatgl.scene.meshes import MeshFile
from splatgl.splat.transfer import OPAQUE, Transfer


@dataclass(frozen=True)
class Look:
    """base: a transfer function; extinction: a factor on it; opacity: a factor on its opacities. threshold: as of
    `extract`.
    """

    base: Transfer
    threshold: float = 0.0
    extinction: float = 1.0
    opacity: float = 1.0
    visible: bool = True

    @property
    def given(self) -> Transfer:
        """The transfer function with the extinction in it, as a saved scene states it."""
        if self.extinction == 1.0:
            return self.base
        return replace(self.base, points=tuple((v, stronger(a, self.extinction)) for v, a in self.base.points))

    @property
    def transfer(self) -> Transfer:
        """The transfer function that is drawn."""
        return self.given.weakened(self.opacity)

    @property
    def table(self) -> dict[str, Any]:
        """The transfer function as a scene file has it."""
        given = self.given
        return {f.name: getattr(given, f.name) for f in fields(Transfer) if getattr(given, f.name) is not None}

    def of_unit(self, unit: float) -> Look:
        """With opacities of that length, where none is stated."""
        return self if self.base.unit is not None else replace(self, base=replace(self.base, unit=unit))


def stronger(opacity: float, factor: float) -> float:
    """The opacity for `factor` times the extinction; 1 stays 1."""
    return opacity if opacity >= OPAQUE else float(-np.expm1(factor * np.log1p(-opacity)))


def bare(surface: MeshFile) -> MeshFile:
    """What is read of a mesh, whatever its look."""
    return replace(surface, color="", opacity=1.0, visible=True)


def read(surfaces: Sequence[MeshFile]) -> dict[MeshFile, Mesh]:
    """The meshes, by `bare`. Raises InputError as `MeshFile.open`."""
    return {each: each.open() for each in dict.fromkeys(map(bare, surfaces))}


def dressed(surfaces: Sequence[MeshFile], found: Mapping[MeshFile, Mesh]) -> tuple[Mesh, ...]:
    """Those that are to be seen, in their colours and opacities, as `MeshFile.open` reads them."""
    shown = [each for each in surfaces if each.visible and bare(each) in found]
    return tuple(_looking(each, found[bare(each)]) for each in shown)


def _looking(surface: MeshFile, mesh: Mesh) -> Mesh:
    made = surface.dressed(mesh)
    # which take as long as a frame, and do not depend on colours
    vars(made)["normals"] = mesh.normals
    return made

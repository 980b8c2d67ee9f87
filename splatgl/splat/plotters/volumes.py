"""Volumes of a renderer of VTK as layers: samples, grid, transfer function and planes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from splatgl.data.affine import axes_of, triple
from splatgl.data.arrays import ArrayOptions
from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.integrations.vtk.image_data import chosen, of_components, of_vtk
from splatgl.splat.clipping import Plane
from splatgl.splat.plotters.properties import transfer_of
from splatgl.splat.scene import Layer
from splatgl.splat.transfer import Transfer

# VTK's numbers of ways to choose samples by the name or number of an array, and of the part that is cropped
BY_NAME, SUBVOLUME = (3, 4), 0x2000
# colours and an opacity
COMPONENTS = 4
# of masks of mappers: what is not 0 is seen
BINARY = 0


def layers_of(prop: Any) -> Iterator[Layer]:
    """The layers of a vtkVolume, one for each independent component of its samples, or of those of a vtkMultiVolume.

    Raises InputError for other data than even grids, and for what splatgl has no like of.
    """
    mapper = prop.GetMapper()
    if not prop.IsA("vtkMultiVolume"):
        yield from _layers(mapper, 0, prop)
        return
    for port in range(mapper.GetNumberOfInputPorts()):
        if mapper.GetNumberOfInputConnections(port):
            yield from _layers(mapper, port, prop.GetVolume(port))


def _layers(mapper: Any, port: int, prop: Any) -> Iterator[Layer]:
    """Those of the input of a mapper's port, with the look and the place of a vtkVolume."""
    looks = prop.GetProperty()
    source = mapper.GetInputAlgorithm(port, 0)
    if source is not None:
        source.Update()
    data = mapper.GetInputDataObject(port, 0)
    asked = ArrayOptions(array=mapper.GetArrayName() or None) if mapper.GetScalarMode() in BY_NAME else ArrayOptions()
    if not data.IsA("vtkImageData"):
        of_vtk(data, asked)
    array, in_cells = chosen(data, asked)
    matrix = matrix_of(prop)
    planes = (*clip_planes(mapper), *_cropping(mapper, matrix))
    parts = [_masked(_placed(part, matrix), mapper) for part in of_components(data, array, in_cells)]
    if len(parts) > 1 and not looks.GetIndependentComponents():
        parts = [_colored(parts)]
    for number, part in enumerate(parts):
        is_mean = blend_of(mapper) == "mean"
        transfer = transfer_of(looks, number, float(np.mean(part.spacing)), is_mean)
        if part.color is not None:
            transfer = replace(transfer, colormap="gray", window=None)
        if is_mean:
            part, transfer = _averaged(part, transfer)
        weight = float(looks.GetComponentWeight(number)) if len(parts) > 1 else 1.0
        yield Layer(part, transfer, float(np.clip(weight, 0.0, 1.0)), clip=planes)


def _averaged(volume: Volume, transfer: Transfer) -> tuple[Volume, Transfer]:
    """What VTK averages along a ray, values times their opacities, and shows in their colour wherever the volume is."""
    values = np.asarray(volume.samples[:])
    samples = (values * transfer.opacity(values)).astype(np.float32)
    low, high = transfer.window or (transfer.points[0][0], transfer.points[-1][0])
    look = replace(transfer, points=((low, 1.0), (high, 1.0)), gradient=(), shading=False)
    return replace(volume, samples=samples), look


def _masked(volume: Volume, mapper: Any) -> Volume:
    """A volume by the mask of its mapper, if that has one. Raises InputError for one of labels, and of another size."""
    mask = mapper.GetMaskInput() if mapper.IsA("vtkGPUVolumeRayCastMapper") else None
    if mask is None:
        return volume
    array, in_cells = chosen(mask, ArrayOptions())
    (found,) = of_components(mask, array, in_cells)
    if mapper.GetMaskType() != BINARY or found.shape != volume.shape:
        told = "one of labels" if mapper.GetMaskType() != BINARY else f"one of {found.shape}"
        raise expected(
            "mask", f"a binary one of {volume.shape} voxels", told, "SetMaskInput(None), and mask the volume"
        )
    return volume.masked(np.asarray(found.samples))


def matrix_of(prop: Any) -> np.ndarray:
    """World-from-data [4, 4] of a vtkProp3D. Raises InputError for a perspective."""
    prop.ComputeMatrix()
    held = prop.GetMatrix()
    found = np.array([[held.GetElement(row, column) for column in range(4)] for row in range(4)])
    if not np.allclose(found[3], (0, 0, 0, 1)):
        raise expected("matrix", "an affine one", found[3].tolist())
    return found


def clip_planes(mapper: Any) -> list[Plane]:
    """The clipping planes of a mapper, world units: VTK keeps the side that their normals point to."""
    held = mapper.GetClippingPlanes()
    found = [] if held is None else [_plane(held.GetItem(number)) for number in range(held.GetNumberOfItems())]
    return found


def _plane(plane: Any) -> Plane:
    """n and d of a vtkPlane, which may have a transform of its own."""
    value = plane.FunctionValue
    start = value((0.0, 0.0, 0.0))
    return *(float(value(axis) - start) for axis in np.eye(3).tolist()), float(-start)  # type: ignore[return-value]


def _cropping(mapper: Any, matrix: np.ndarray) -> list[Plane]:
    """The planes of the box that a mapper crops to, along the axes of its data. Raises InputError for other regions."""
    if not mapper.GetCropping():
        return []
    if mapper.GetCroppingRegionFlags() != SUBVOLUME:
        raise expected("cropping", "the box between the planes", "other regions", "SetCroppingRegionFlagsToSubVolume()")
    inverse, found = np.linalg.inv(matrix), []
    for number, place in enumerate(mapper.GetCroppingRegionPlanes()):
        side = -1.0 if number % 2 else 1.0
        x, y, z, start = (side * inverse[number // 2]).tolist()
        found.append((x, y, z, side * place - start))
    return found


def _placed(volume: Volume, matrix: np.ndarray) -> Volume:
    """The volume in the world of its actor."""
    if np.array_equal(matrix, np.eye(4)):
        return volume
    spacing, direction = axes_of(matrix[:3, :3] @ volume.world_from_index, "the actor's matrix")
    origin = triple(matrix[:3, :3] @ np.array(volume.origin) + matrix[:3, 3], "the actor's matrix")
    return replace(volume, spacing=spacing, origin=origin, direction=direction)


def _colored(parts: list[Volume]) -> Volume:
    """A volume of colours and opacities. Raises InputError for others that depend on each other."""
    if len(parts) != COMPONENTS or parts[0].samples.dtype != np.uint8:
        got = f"{len(parts)} of {parts[0].samples.dtype}"
        raise expected("volume", "one component, independent ones, or four of uint8 for RGBA", got)
    return replace(parts[3], color=np.stack([part.samples for part in parts[:3]], axis=-1))


def blend_of(mapper: Any) -> str:
    """The blend of a volume mapper. Raises InputError for those that splatgl has no like of."""
    names = ("composite", "mip", "minip", "mean")
    mode = int(mapper.GetBlendMode())
    if not 0 <= mode < len(names):
        told = {4: "additive", 5: "isosurface", 6: "slice"}.get(mode, str(mode))
        raise expected("blend mode", "composite, maximum, minimum or average", told, "set another")
    return names[mode]

"""Converts transfer functions and clipping planes to VTK and back."""

from __future__ import annotations

from typing import Any

import numpy as np

from splatgl.data.color import srgb_from_linear
from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.geometry.clipping import Plane
from splatgl.integrations import color_nodes, opacity_nodes
from splatgl.splat.lighting import LightModel
from splatgl.transfer.transfer import Nodes, Transfer

# samples of functions that are not piecewise linear, and maximum number of control colours
SAMPLES, COLORS = 1024, 256
# distance between the two nodes of a step, over the value range; tolerance of opacity for nodes on a line
STEP, ON_LINE = 1e-6, 1e-9
# VTK's midpoint of piecewise linear nodes: value, result, midpoint, sharpness
MIDDLE = 0.5
# half of the distance between labels, and slightly less
HALF, WITHIN = 0.5, 0.49
# VTK's linear interpolation of a volume property
LINEAR = 1


def transfer_of(prop: Any, index: int, spacing: float, is_whole: bool = False) -> Transfer:
    """Transfer function of a component of a vtkVolumeProperty. spacing: mean spacing of its volume, world units.
    is_whole: whether it includes the colours of transparent values.

    Raises InputError for transfer functions of two variables.
    """
    if prop.GetTransferFunctionMode():
        raise expected("volume", "a transfer function of one variable", "one of two", "set a scalar opacity")
    points = nodes_of(prop.GetScalarOpacity(index))
    window, colors = _colors(prop, index, (-np.inf, np.inf) if is_whole else _support(points))
    return Transfer(
        points,
        colors,
        window,
        unit=float(prop.GetScalarOpacityUnitDistance(index)),
        gradient=_gradient(prop, index, spacing),
        shading=bool(prop.GetShade(index)),
    )


def nodes_of(function: Any) -> Nodes:
    """Nodes of a vtkPiecewiseFunction, clipped to 0 to 1; functions that are not piecewise linear are sampled."""
    rows = _rows(function, 4)
    if not len(rows):
        return ((0.0, 0.0),)
    places, shares = rows[:, 0], np.clip(rows[:, 1], 0.0, 1.0)
    if not (rows[:, 2:] == (MIDDLE, 0.0)).all() or _is_logarithmic(function):
        places = np.union1d(places, np.linspace(places[0], places[-1], SAMPLES))
        shares = np.clip([function.GetValue(place) for place in places.tolist()], 0.0, 1.0)
    nodes = opacity_nodes(*_without_collinear(places, shares))
    # without clamping, opacity is 0 beyond the ends
    return nodes if function.GetClamping() else ((nodes[0][0], 0.0), *nodes, (nodes[-1][0], 0.0))


def _rows(function: Any, length: int) -> np.ndarray:
    """Nodes of a VTK function [N, length]; a node has `length` numbers."""
    nodes = np.zeros((function.GetSize(), length))
    for number in range(len(nodes)):
        row = [0.0] * length
        function.GetNodeValue(number, row)
        nodes[number] = row
    return nodes


def _is_logarithmic(function: Any) -> bool:
    return bool(getattr(function, "GetUseLogScale", bool)())


def _without_collinear(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The nodes without those on a line between their neighbours."""
    width = x[2:] - x[:-2]
    across = y[:-2] + (y[2:] - y[:-2]) * (x[1:-1] - x[:-2]) / np.where(width > 0, width, 1.0)
    needed = np.ones(len(x), bool)
    needed[1:-1] = (width <= 0) | (np.abs(across - y[1:-1]) > ON_LINE)
    return x[needed], y[needed]


def _support(points: Nodes) -> tuple[float, float]:
    """Interval of values with opacity; infinite where opacity continues beyond the nodes."""
    opaque = [number for number, (_, share) in enumerate(points) if share > 0]
    if not opaque:
        return -np.inf, np.inf
    low = points[opaque[0] - 1][0] if opaque[0] else -np.inf
    high = points[opaque[-1] + 1][0] if opaque[-1] + 1 < len(points) else np.inf
    return low, high


def _colors(prop: Any, index: int, support: tuple[float, float]) -> tuple[tuple[float, float] | None, str]:
    """Window and colour map of the visible values; VTK's colours are sRGB."""
    gray = prop.GetColorChannels(index) == 1
    function = prop.GetGrayTransferFunction(index) if gray else prop.GetRGBTransferFunction(index)
    low, high = function.GetRange()
    low, high = max(low, min(support[0], high)), min(high, max(support[1], low))
    rows = _rows(function, 4 if gray else 6)
    linear = (rows[:, -2:] == (MIDDLE, 0.0)).all() and not _is_logarithmic(function)
    plain = linear and (gray or (function.GetColorSpace() == 0 and not function.GetScale()))
    inside = rows[(rows[:, 0] > low) & (rows[:, 0] < high), 0]
    places = np.concatenate([[low], inside, [high]]) if plain else np.linspace(low, high, COLORS)
    if len(places) > COLORS:
        places = np.linspace(low, high, COLORS)
    rgb = [(function.GetValue(place),) * 3 if gray else function.GetColor(place) for place in places.tolist()]
    return color_nodes(places, np.array(rgb))


def _gradient(prop: Any, index: int, spacing: float) -> Nodes:
    """Weights of gradients; VTK's gradients are per mean spacing."""
    if prop.GetDisableGradientOpacity(index) or not prop.HasGradientOpacity(index):
        return ()
    nodes = nodes_of(prop.GetGradientOpacity(index))
    return () if all(weight == 1 for _, weight in nodes) else tuple((size / spacing, share) for size, share in nodes)


def property_of(volume: Volume, transfer: Transfer, light: LightModel, lit: bool) -> Any:
    """vtkVolumeProperty of a transfer function. lit: whether it is shaded."""
    from vtkmodules.vtkCommonDataModel import vtkPiecewiseFunction
    from vtkmodules.vtkRenderingCore import vtkColorTransferFunction, vtkVolumeProperty

    if transfer.regions:
        raise expected("transfer function", "points alone for VTK", "regions over gradients", "leave the regions out")
    opacity, color, prop = vtkPiecewiseFunction(), vtkColorTransferFunction(), vtkVolumeProperty()
    for value, share in opacity_nodes(*_opacity_samples(transfer)):
        opacity.AddPoint(value, share)
    places, colors = _color_samples(transfer)
    for value, shade in zip(places.tolist(), srgb_from_linear(colors).tolist(), strict=True):
        color.AddRGBPoint(value, *shade)
    spacing = float(np.mean(volume.spacing))
    prop.SetScalarOpacity(opacity)
    prop.SetColor(color)
    prop.SetScalarOpacityUnitDistance(transfer.length(volume))
    if transfer.gradient:
        weights = vtkPiecewiseFunction()
        for size, weight in transfer.gradient:
            weights.AddPoint(size * spacing, weight)
        prop.SetGradientOpacity(weights)
    prop.SetInterpolationType(0 if transfer.labels else LINEAR)
    prop.SetShade(lit)
    prop.SetAmbient(light.ambient)
    prop.SetDiffuse(light.diffuse)
    prop.SetSpecular(light.specular)
    prop.SetSpecularPower(2.0**light.sharpness)
    return prop


def _color_samples(transfer: Transfer) -> tuple[np.ndarray, np.ndarray]:
    """Distinct values and linear colours [N, 3], linear in between."""
    if transfer.labels:
        numbers = np.array([number for number, _, _ in transfer.labels], float)
        return (numbers[:, None] + (-WITHIN, WITHIN)).ravel(), np.repeat(transfer.color(numbers), 2, axis=0)
    low, high = transfer.color_range
    places = np.unique((np.geomspace if transfer.logarithmic else np.linspace)(low, high, COLORS))
    return places, transfer.color(places)


def _opacity_samples(transfer: Transfer) -> tuple[np.ndarray, np.ndarray]:
    """Distinct values and opacities, linear in between."""
    if transfer.labels:
        numbers, _, shares = zip(*transfer.labels, strict=True)
        places = np.add.outer(numbers, (-HALF, -WITHIN, WITHIN, HALF))
        return places.ravel(), np.multiply.outer(shares, (0.0, 1.0, 1.0, 0.0)).ravel()
    values = transfer.bends
    ends = np.array([value for value, _ in transfer.points])
    steps = np.unique(ends[:-1][np.diff(ends) == 0])
    width = max(float(np.ptp(values)), float(np.abs(values).max()), STEP) * STEP
    before = [next(share for value, share in transfer.points if value == step) for step in steps]
    opacities = np.append(transfer.opacity(values), before)
    places, first = np.unique(np.append(values, steps - width), return_index=True)
    return places, opacities[first]


def matrix_of(prop: Any) -> np.ndarray:
    """World-from-data matrix [4, 4] of a vtkProp3D. Raises InputError for a perspective."""
    prop.ComputeMatrix()
    matrix = np.reshape(prop.GetMatrix().GetData(), (4, 4))
    if not np.allclose(matrix[3], (0, 0, 0, 1)):
        raise expected("matrix", "an affine one", matrix[3].tolist())
    return matrix


def clip_planes(mapper: Any) -> list[Plane]:
    """Clipping planes of a mapper, world units; VTK keeps the side that the normals point to."""
    planes: list[Plane] = []
    collection = mapper.GetClippingPlanes()
    for number in range(collection.GetNumberOfItems() if collection is not None else 0):
        # the values of the function include its own transform
        value = collection.GetItem(number).FunctionValue
        start = value((0.0, 0.0, 0.0))
        x, y, z = (float(value(axis) - start) for axis in np.eye(3).tolist())
        planes.append((x, y, z, float(-start)))
    return planes


def vtk_plane(plane: Plane) -> Any:
    """vtkPlane of a clipping plane."""
    from vtkmodules.vtkCommonDataModel import vtkPlane

    converted, normal = vtkPlane(), np.array(plane[:3])
    converted.SetNormal(*plane[:3])
    converted.SetOrigin(*(plane[3] * normal / (normal @ normal)).tolist())
    return converted

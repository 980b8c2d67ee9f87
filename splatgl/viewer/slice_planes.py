"""Planes of the window's slices, also turned ones, and the layers that they show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from splatgl.data.mesh import Mesh
from splatgl.data.volume import Triple, Volume
from splatgl.geometry.slices import (
    Slice,
    SliceLayer,
    SlicePainter,
    SlicePlane,
    SlicePosition,
    grid_normals,
    parse_slices,
    plane_through,
)
from splatgl.planning.scene import Layer, Scene
from splatgl.scene.meshes import is_mesh
from splatgl.transfer.presets import slice_colors
from splatgl.viewer.trackball import rotation

if TYPE_CHECKING:
    from splatgl.viewer.layer_splats import LayerSplats
    from splatgl.viewer.state import LayerStyle, Slices, State


Turn = tuple[float, ...]

# a rotation that is none, row by row
STRAIGHT: Turn = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
# difference of normals that is rounding of texts
SAME = 1e-9


def turned(turn: Turn, about: np.ndarray, degrees: float) -> Turn:
    """The rotation followed by one about a vector [3]."""
    return _rotation(rotation(about, float(np.radians(degrees))) @ np.array(turn).reshape(3, 3))


def _rotation(matrix: np.ndarray) -> Turn:
    """The nearest rotation; exactly none where it is nearly none."""
    left, _, right = np.linalg.svd(matrix)
    near = left @ right
    return STRAIGHT if np.abs(near - np.eye(3)).max() < SAME else tuple(near.ravel().tolist())


def normals(slices: Slices, volume: Volume) -> np.ndarray:
    """Unit vectors [3, 3] across the slices of the grid's x, y and z, in rows."""
    return np.asarray(grid_normals(volume) @ np.array(slices.turn).reshape(3, 3).T)


def middle(slices: Slices, volume: Volume) -> np.ndarray:
    """World point [3] that all slices contain: a voxel's middle, unless they are turned."""
    if slices.turn == STRAIGHT:
        index = np.array(slices.index(volume), np.float64)
    else:
        index = np.array(slices.place) * volume.shape[::-1] - 0.5
    return np.asarray(volume.world_from_index @ index + np.asarray(volume.origin))


def planes(slices: Slices, volume: Volume, up: np.ndarray) -> tuple[SlicePlane, ...]:
    """The slices across the grid's x, y and z, turned."""
    return _planes(slices, volume, tuple(up.tolist()))


@lru_cache(maxsize=2)
def _planes(slices: Slices, volume: Volume, up: tuple[float, ...]) -> tuple[SlicePlane, ...]:
    point, upwards = middle(slices, volume), np.array(up)
    return tuple(plane_through(volume, point, normal, upwards, grid=True) for normal in normals(slices, volume))


def texts(slices: Slices, volume: Volume) -> tuple[str, ...]:
    """The slices as texts of a scene file."""
    if slices.turn == STRAIGHT:
        return tuple(f"{name}={index}" for name, index in zip("xyz", slices.index(volume), strict=True))
    point = middle(slices, volume).tolist()
    return tuple(str(Slice((point, normal)).where) for normal in normals(slices, volume).tolist())


def slices_of(slices: Slices, given: Sequence[str], volume: Volume) -> Slices:
    """The slices that have these texts, which then follow them; else as they are."""
    wheres = [SlicePosition.of(Slice(text).place) for text in given]
    if [where.name for where in wheres] == [*"xyz"]:
        index = [where.numbers[0] if len(where.numbers) == 1 else None for where in wheres]
        made = slices if None in index else slices.at([float(place or 0.0) for place in index], volume)
    elif len(wheres) == 3 and all(where.point == wheres[0].point != () for where in wheres):
        place = np.linalg.solve(volume.world_from_index, np.array(wheres[0].point) - np.asarray(volume.origin))
        turn = _rotation((np.linalg.inv(grid_normals(volume)) @ np.array([where.normal for where in wheres])).T)
        made = replace(slices, turn=turn, place=shares(place, volume))
    else:
        return slices
    return replace(made, in_space=True) if _are_alike(texts(made, volume), given, volume) else slices


def _are_alike(some: Sequence[str], others: Sequence[str], volume: Volume) -> bool:
    """Whether texts say the same planes, but for rounding, and all are opaque."""
    if any(Slice(text).opacity < 1 for text in others):
        return False
    pairs = zip(*(parse_slices([Slice(text).place for text in texts], volume) for texts in (some, others)), strict=True)
    size = float(np.ptp(volume.corners, axis=0).max())
    return all(
        abs(a.normal @ b.normal) > 1 - SAME and abs((a.point - b.point) @ a.normal) < SAME * size for a, b in pairs
    )


def with_turn(slices: Slices, turn: Turn, volume: Volume) -> Slices:
    """The slices turned about the point that they contain."""
    placed = slices.at(slices.index(volume), volume) if slices.turn == STRAIGHT else slices
    return replace(placed, turn=turn)


def with_slices(state: State, slices: Slices, volume: Volume) -> State:
    """The state with other slices; those in space follow them."""
    in_space = texts(slices, volume) if slices.in_space else state.slice_planes
    return replace(state, slices=slices, slice_planes=in_space)


@lru_cache(maxsize=1)
def slice_meshes(looks: tuple[SliceLayer, ...], slice_planes: tuple[str, ...]) -> tuple[Mesh, ...]:
    """The planes in space of layers, as `splatgl render` draws them; the latest are cached."""
    if not slice_planes:
        return ()
    return tuple(Scene([Layer(*look) for look in looks], slices=slice_planes).meshes)


def shares(index: np.ndarray, volume: Volume) -> Triple:
    """An index (x, y, z) as shares of the volume's box, within it: slices through its corners would have no area."""
    sizes = np.array(volume.shape[::-1])
    x, y, z = ((np.clip(index, -0.49, sizes - 0.51) + 0.5) / sizes).tolist()
    return x, y, z


def layer_looks(pool: Mapping[int, LayerSplats], styles: Sequence[LayerStyle]) -> tuple[SliceLayer, ...]:
    """Returns the layers that slices show: those in visible styles with voxels; the first if there are none. pool:
    layers by the numbers that styles name.
    """
    pairs = [(pool[style.number], style) for style in styles if style.number in pool]
    seen = [
        (layer, style)
        for layer, style in pairs
        if style.is_shown and layer.volume.points is None and not is_mesh(layer.scene.volume)
    ]
    return tuple(SliceLayer(layer.volume, style.stated, style.opacity) for layer, style in seen or pairs[:1])


@lru_cache(maxsize=2)
def layer_painter(layers: tuple[SliceLayer, ...], colored: bool, only: bool = False, fill: float = 1.0) -> SlicePainter:
    """The painter of slices of layers, as of `splatgl render --slice`. colored: else the first is grey, by its window,
    unless it has segments or the layers add up. only: whether it is the scene's first layer alone, by its own window.
    fill: as of `SlicePainter`.
    """
    if not only:
        layers = tuple(layer._replace(transfer=slice_colors(layer.volume, layer.transfer)) for layer in layers)
    first, adds = layers[0], not only and all(layer.glows for layer in layers)
    if not (colored or first.nearest or adds):
        layers = first._replace(transfer=replace(first.transfer, colormap="gray")), *layers[1:]
    return SlicePainter(layers, fill)

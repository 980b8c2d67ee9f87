"""The layers of a scene as quantised splats on one grid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from splatgl.data.volume import Volume, triple
from splatgl.errors import expected
from splatgl.geometry.grid import Grid
from splatgl.geometry.resample import Raster, sample_raster
from splatgl.planning.resolve import select_splats
from splatgl.planning.scene import Layer, Scene
from splatgl.scene.draw import SubjectView
from splatgl.scene.open_scene import OpenScene
from splatgl.splat.quantized import CLASSES, JoinedMatter, Matter, QuantizedLayer
from splatgl.splat.settings import Settings
from splatgl.splat.splats import Splats, is_points

# most voxels of a grid to which layers on other grids are resampled, and of the level of a volume with coarser ones
MOST_VOXELS = 2**27
# note on what is no splat
LEFT_OUT = "meshes, streamlines and slices are left out: .glb holds meshes and streamlines"
# headroom for shares of a layer whose splats have colours of their own
HEADROOM = 8.0

LayerSplats = tuple[Splats, Layer | None]


def join_layers(scene: OpenScene | SubjectView, settings: Settings, most: int, notes: list[str]) -> JoinedMatter:
    """The splats of a scene, classified before reconstruction, at most `most`. Adds notes. Raises InputError for
    iso-surfaces and for a scene without visible voxels.
    """
    layers = [layer for layer in _layers(scene, settings, notes) if len(layer[0])]
    if not layers:
        if isinstance(scene, OpenScene) and LEFT_OUT not in notes:
            raise scene.nothing_visible()
        fix = LEFT_OUT if LEFT_OUT in notes else "change the points, the threshold or the cuts"
        raise expected("scene", "visible voxels or points", "none", fix)
    base = max((splats for splats, _ in layers), key=_rank)
    for number, (splats, layer) in enumerate(layers):
        if layer is not None and not is_points(splats.records.dtype) and not _is_aligned(splats.grid, base.grid):
            notes.append(f"layer {splats.name} is resampled to the grid of {base.name}")
            layers[number] = _resampled(layer, base.grid, settings)
    layers = [layer for layer in layers if len(layer[0])]
    low = np.floor(np.min([_in_cells(splats, base.grid).min(axis=0) for splats, _ in layers], axis=0))
    moved = replace(base.grid, origin=base.grid.world_from_index @ low + base.grid.origin)
    return JoinedMatter.of([_matter(*layer, base.grid, low) for layer in layers], moved, most)


def _rank(splats: Splats) -> tuple[bool, float]:
    """The layer of the most cells has the grid of all; points have it without voxels."""
    return not is_points(splats.records.dtype), float(np.ptp(splats.index_bounds, axis=0).prod())


def layers_of(scene: OpenScene | SubjectView) -> Scene | Splats:
    """The layers and meshes of a scene, or splats alone."""
    return scene.scene if isinstance(scene, OpenScene) else scene.subject


def _layers(scene: OpenScene | SubjectView, settings: Settings, notes: list[str]) -> list[LayerSplats]:
    """The splats of the layers, without clipped ones."""
    if isinstance(scene, OpenScene):
        levels = (scene.volume, *scene.volume.coarser)
        level = next((x for x in levels if x.count <= MOST_VOXELS), levels[-1])
        if level is not scene.volume:
            notes.append(f"voxels of the level of {'×'.join(map(str, level.shape[::-1]))}")
            scene = replace(scene, volume=level)
    subject = layers_of(scene)
    if isinstance(subject, Splats):
        return [(select_splats(subject, settings, False), None)]
    if any(layer.seen.iso for layer in subject.shown):
        raise expected("iso", "no iso-surfaces among splats", "some", "write them as .glb")
    if isinstance(scene, OpenScene) and scene.file.slices:
        raise expected("slices", "a volume without slices", "some", "splatgl render draws them")
    if subject.meshes:
        notes.append(LEFT_OUT)
    return [
        (select_splats(splats, replace(settings, clip=(*settings.clip, *planes)), False), layer)
        for splats, planes, layer in zip(subject.splats(settings), subject.planes, subject.shown, strict=True)
    ]


def _is_aligned(one: Grid, two: Grid) -> bool:
    """Whether the voxels of one grid are voxels of another."""
    turn = np.linalg.solve(two.world_from_index, one.world_from_index)
    shift = two.index_from_world(one.origin)
    return bool(np.allclose(turn, np.eye(3), atol=1e-6) and np.allclose(shift, np.rint(shift), atol=1e-3))


def _in_cells(splats: Splats, grid: Grid) -> np.ndarray:
    """Positions [N, 3] in cells of a grid."""
    if _is_aligned(splats.grid, grid):
        return np.asarray(splats.positions + np.rint(grid.index_from_world(splats.grid.origin)))
    return grid.index_from_world(splats.positions @ splats.grid.world_from_index.T + splats.grid.origin)


def _resampled(layer: Layer, grid: Grid, settings: Settings) -> tuple[Splats, Layer]:
    """A layer in voxels of a grid."""
    volume, own, spacing = layer.volume, Grid.of(layer.volume), np.linalg.norm(grid.world_from_index, axis=0)
    corners = grid.index_from_world(volume.corners)
    low, high = np.floor(corners.min(axis=0)).astype(int), np.ceil(corners.max(axis=0)).astype(int)
    width, height, depth = (int(count) for count in high - low + 1)
    if width * height * depth > MOST_VOXELS:
        this, got = f"at most {MOST_VOXELS:,} voxels of the finest layer", f"{width * height * depth:,}"
        raise expected(f"layer {volume.name}", this, got)
    samples = np.full((depth, height, width), np.nan, np.float32)
    turn = np.linalg.solve(own.world_from_index, grid.world_from_index)
    for z in range(depth):
        start = own.index_from_world(grid.world_from_index @ (low + np.array([0, 0, z])) + grid.origin)
        raster = Raster(start, turn[:, 0], turn[:, 1], (width, height))
        values, known = sample_raster(volume, raster, nearest=bool(layer.seen.labels))
        samples[z][known] = values[known]
    origin = triple(grid.world_from_index @ low + grid.origin, "origin")
    part = Volume(samples, triple(spacing, "spacing"), origin, grid.world_from_index / spacing, name=volume.name)
    seen = Layer(part, layer.seen.on(volume), threshold=layer.threshold)
    return Scene([seen]).splats(settings)[0], seen


def _matter(splats: Splats, layer: Layer | None, grid: Grid, low: np.ndarray) -> Matter:
    """The matter of a layer's splats, in cells of a grid from `low` on."""
    described, values = _described(splats, layer)
    normal = splats.records["normal"].astype(np.float32) * splats.shaded
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    # of points of another size
    ratio = splats.grid.mean_spacing / grid.mean_spacing
    size = np.full(len(splats), np.clip(np.rint(np.log2(ratio)), 0, 7), np.uint8)
    factor = ratio**2 / 4.0 ** size[0]
    described = replace(described, table=described.table * np.array([1, 1, 1, factor]))
    position, depth = _in_cells(splats, grid) - low, splats.depths.astype(np.float64) * factor
    joinable = not is_points(splats.records.dtype)
    return Matter(described, position, depth, splats.colors, normal, values, size, joinable)


def _described(splats: Splats, layer: Layer | None) -> tuple[QuantizedLayer, np.ndarray | None]:
    """The table of a layer, and the values [N] of its splats; None if they have colours of their own."""
    if (
        layer is None
        or is_points(splats.records.dtype)
        or layer.volume.points is not None
        or layer.volume.color is not None
        or layer.seen.labels
        or layer.seen.regions
    ):
        table = np.zeros((CLASSES, 4))
        table[:, 3] = max(float(splats.depths.max()), 1e-30) / HEADROOM
        return QuantizedLayer(splats.name, table, own=True), None
    transfer, samples = layer.seen, np.asarray(layer.volume.samples)
    x, y, z = splats.records["position"].T
    values = samples[z, y, x].astype(np.float64)
    low, highest = float(values.min()), float(values.max())
    high = highest if highest > low else low + max(abs(low), 1.0) * 1e-3
    if samples.dtype.kind in "ui" and highest - low < CLASSES:
        # entries are whole values
        high = low + CLASSES - 1
    at = np.linspace(low, high, CLASSES)
    depth = transfer.extinction(transfer.largest_opacity(at), splats.unit / splats.grid.mean_spacing)
    table = np.concatenate([transfer.color(at), depth[:, None]], axis=1)
    span = max(transfer.color_range[0], low), min(transfer.color_range[1], highest)
    return QuantizedLayer(splats.name, table, low, high, span=span), values

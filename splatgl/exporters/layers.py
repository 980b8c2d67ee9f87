"""The layers of a scene as quantised splats on one grid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.geometry.grid import Grid
from splatgl.geometry.resample import sample_places
from splatgl.planning.resolve import select_splats
from splatgl.planning.scene import Layer, Scene
from splatgl.scene.draw import SubjectView
from splatgl.scene.open_scene import OpenScene
from splatgl.splat.quantized import CLASSES, Matter, QuantizedLayer, QuantizedSplats
from splatgl.splat.settings import Settings
from splatgl.splat.splats import Splats, is_points

# most voxels of a grid to which layers on other grids are resampled, and of the level of a volume with coarser ones
MOST_VOXELS = 2**27
# headroom for shares of a layer whose splats have colours of their own
HEADROOM = 8.0


def quantize(
    scene: OpenScene | SubjectView, settings: Settings, most: int, bits: int, notes: list[str]
) -> QuantizedSplats:
    """The splats of a scene, classified before reconstruction, at most `most`; bits: of values. Adds notes. Raises
    InputError for iso-surfaces and for a scene without visible voxels.
    """
    layers = _layers(scene, settings, notes)
    layers = [(splats, layer) for splats, layer in layers if len(splats)]
    if not layers:
        raise expected("page", "visible voxels or points", "none")
    voxels = [splats for splats, _ in layers if not is_points(splats.records.dtype)] or [splats for splats, _ in layers]
    base = max(voxels, key=lambda splats: float(np.ptp(splats.index_bounds, axis=0).prod()))
    grid, others = base.grid, list[tuple[Splats, Layer | None]]()
    for splats, layer in layers:
        if not is_points(splats.records.dtype) and layer is not None and not _is_aligned(splats.grid, grid):
            notes.append(f"layer {splats.name} is resampled to the grid of {base.name}")
            others.append(_resampled(layer, grid, settings))
        else:
            others.append((splats, layer))
    low = np.min([_in_cells(splats, grid).min(axis=0) for splats, _ in others if len(splats)], axis=0)
    low = np.floor(low)
    matters = [_matter(splats, layer, grid, low) for splats, layer in others]
    moved = Grid(grid.world_from_index, grid.world_from_index @ low + grid.origin)
    return QuantizedSplats.of(matters, moved, most, bits)


def _layers(scene: OpenScene | SubjectView, settings: Settings, notes: list[str]) -> list[tuple[Splats, Layer | None]]:
    """The splats of the layers, without clipped ones."""
    if isinstance(scene, OpenScene):
        levels = (scene.volume, *scene.volume.coarser)
        level = next((x for x in levels if x.count <= MOST_VOXELS), levels[-1])
        if level is not scene.volume:
            notes.append(f"voxels of the level of {'×'.join(map(str, level.shape[::-1]))}")
            scene = replace(scene, volume=level)
        subject: Splats | Scene = scene.scene
    else:
        subject = scene.subject
    if isinstance(subject, Splats):
        return [(select_splats(subject, settings, False), None)]
    if subject.meshes:
        notes.append("meshes and slices are not in the page")
    pairs = zip(subject.splats(settings), subject.planes, subject.shown, strict=True)
    return [
        (select_splats(splats, replace(settings, clip=(*settings.clip, *planes)), False), layer)
        for splats, planes, layer in pairs
    ]


def _is_aligned(one: Grid, two: Grid) -> bool:
    """Whether the voxels of one grid are voxels of another."""
    turn = np.linalg.solve(two.world_from_index, one.world_from_index)
    shift = two.index_from_world(one.origin)
    return bool(np.allclose(turn, np.eye(3), atol=1e-6) and np.allclose(shift, np.rint(shift), atol=1e-3))


def _in_cells(splats: Splats, grid: Grid) -> np.ndarray:
    """Positions [N, 3] in cells of a grid."""
    if splats.grid is grid:
        return splats.positions.astype(np.float64)
    return grid.index_from_world(splats.positions @ splats.grid.world_from_index.T + splats.grid.origin)


def _resampled(layer: Layer, grid: Grid, settings: Settings) -> tuple[Splats, Layer]:
    """A layer in voxels of a grid."""
    volume = layer.volume
    corners = grid.index_from_world(volume.corners)
    low, high = np.floor(corners.min(axis=0)).astype(int), np.ceil(corners.max(axis=0)).astype(int)
    shape = (high - low + 1)[::-1]
    if np.prod(shape.astype(float)) > MOST_VOXELS:
        raise expected(
            f"layer {volume.name}", f"at most {MOST_VOXELS:,} voxels of the finest layer", f"{np.prod(shape):,}"
        )
    samples = np.full(shape, np.nan, np.float32)
    y, x = np.mgrid[0 : shape[1], 0 : shape[2]]
    for z in range(shape[0]):
        places = np.stack([x.ravel(), y.ravel(), np.full(x.size, z)], axis=1) + low
        world = places @ grid.world_from_index.T + grid.origin
        own = Grid.of(volume).index_from_world(world)
        values, known = sample_places(volume, own, nearest=bool(layer.seen.labels))
        samples[z].reshape(-1)[known] = values[known]
    spacing = np.linalg.norm(grid.world_from_index, axis=0)
    origin = grid.world_from_index @ low + grid.origin
    part = Volume(samples, tuple(spacing), tuple(origin), grid.world_from_index / spacing, name=volume.name)
    seen = Layer(part, layer.seen.on(volume), threshold=layer.threshold)
    return Scene([seen]).splats(settings)[0], seen


def _matter(splats: Splats, layer: Layer | None, grid: Grid, low: np.ndarray) -> Matter:
    """The matter of a layer's splats, in cells of a grid from `low` on."""
    described, values = _described(splats, layer)
    if _is_aligned(splats.grid, grid):
        return Matter.of(described, splats, np.rint(grid.index_from_world(splats.grid.origin)) - low, values)
    # points of another size
    ratio = splats.grid.mean_spacing / grid.mean_spacing
    size = int(np.clip(np.rint(np.log2(ratio)), 0, 7))
    matter = Matter.of(described, splats, np.zeros(3), values)
    places, depth = _in_cells(splats, grid) - low, matter.depth * ratio**2 / 4.0**size
    table = described.table * np.array([1, 1, 1, ratio**2 / 4.0**size])
    sizes = np.full(len(splats), size, np.uint8)
    return replace(matter, layer=replace(described, table=table), position=places, depth=depth, size=sizes)


def _described(splats: Splats, layer: Layer | None) -> tuple[QuantizedLayer, np.ndarray | None]:
    """The table of a layer, and the values [N] of its splats; None if they have colours of their own."""
    transfer, volume = (None, None) if layer is None else (layer.seen, layer.volume)
    depths = splats.depths.astype(np.float64)
    plain = transfer is not None and volume is not None and volume.points is None and volume.color is None
    if (
        transfer is None
        or volume is None
        or not plain
        or transfer.labels
        or transfer.regions
        or is_points(splats.records.dtype)
    ):
        table = np.zeros((CLASSES, 4))
        table[:, 3] = max(float(depths.max(initial=0.0)), 1e-30) / HEADROOM
        return QuantizedLayer(splats.name, table, own=True), None
    x, y, z = splats.records["position"].T
    values = np.asarray(volume.samples)[z, y, x].astype(np.float64)
    low, high = float(values.min()), float(values.max())
    if np.asarray(volume.samples).dtype.kind in "ui" and high - low < CLASSES:
        # entries are whole values
        high = low + CLASSES - 1
    high = high if high > low else low + max(abs(low), 1.0) * 1e-3
    at = np.linspace(low, high, CLASSES)
    depth = transfer.extinction(transfer.largest_opacity(at), splats.unit / splats.grid.mean_spacing)
    table = np.concatenate([transfer.color(at), depth[:, None]], axis=1)
    span = transfer.color_range
    return QuantizedLayer(
        splats.name, table, low, high, span=(max(span[0], low), min(span[1], float(values.max())))
    ), values

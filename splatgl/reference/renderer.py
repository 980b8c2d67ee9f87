"""Draws the reference picture in float64.

It uses blend, kernel, antialias, attenuation, shading, order and background, and ignores the settings of
approximations: align, footprint, target, tolerance. Slow and exact: the ground truth for other images.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from splatgl.coercion import public
from splatgl.data.image import Image
from splatgl.geometry.camera import Camera
from splatgl.planning.bricks import Bricks
from splatgl.planning.culling import back_to_front, clip_behind_eye, order_for
from splatgl.planning.resolve import Appearance, Resolved, attenuation_form, voxel_kernel
from splatgl.planning.scene import ResolvedScene, Scene, join_pictures, resolve_scene
from splatgl.reference.blend import ADD, Accumulator, mean_weights, over_background, pixel_means, pixels
from splatgl.reference.layers import BoxScene, LayerScene, SurfaceScene
from splatgl.reference.rays import (
    EWA,
    SQUARE,
    FootprintRow,
    PixelBoxes,
    Pixels,
    may_reach,
    pair_values,
    pixel_boxes,
    reached_squares,
    run_boxes,
    splats_may_reach,
)
from splatgl.reference.sheets import SheetScene
from splatgl.splat.extract_values import post_splats
from splatgl.splat.kernels import tabulate
from splatgl.splat.lighting import LightModel, apply_light
from splatgl.splat.settings import Settings
from splatgl.splat.splats import Splats, in_parts, record_type

# samples per band: their indices fit into 16 bits, which sort fast
BAND = 1 << 16
# samples of scattered pixels that are drawn together
TOGETHER = 1 << 9

Progress = Callable[[Iterator[tuple[int, int]], int], Iterator[tuple[int, int]]]


@public
def render(
    splats: Scene | Splats | Any,
    camera: Camera | Any,
    settings: Settings | Any | None = None,
    row: str = "row1",
    progress: Progress | None = None,
) -> Image:
    """The exact image of `Renderer.render`, float64 [H, W, 4], linear premultiplied, row 0 at the top.

    row: "row1" (correct) or an approximation of Table 1, "row2" … "row5": row4 is `align="ray"`, row5 `align="grid"`;
    rows 2 and 3 exist for cubic voxels only; or "ewa", EWA splatting, of Gaussians. progress wraps the iteration over
    bands of the image (bands, count).
    Raises InputError for an unknown row.  [M98 Table 1]
    """
    started = time.perf_counter()
    settings = settings or Settings()
    drawings, info = _prepare(_resolve_row(splats, camera, settings, row), row)
    pictures = [draw_bands(*drawing, progress) for drawing in drawings]
    picture = pictures[0] if len(pictures) == 1 else join_pictures(pictures, settings)
    return Image(picture, {**info, "seconds": round(time.perf_counter() - started, 6)})


def render_pixels(scene: ResolvedScene, wanted: np.ndarray) -> np.ndarray:
    """Some pixels of the image, float64 [P, 4]: to check other images of many splats. wanted [P]: row-major indices."""
    drawings, _ = _prepare(scene, wanted=wanted)
    parts = [_draw_pixels(*drawing, wanted) for drawing in drawings]
    return parts[0] if len(parts) == 1 else join_pictures(parts, scene.settings)


def _resolve_row(subject: Splats | Scene, camera: Camera, settings: Settings, row: str) -> ResolvedScene:
    """`resolve_scene` for a row of `render`, which classifies the voxels of a single layer."""
    if row == "row1" or len(subject.drawn(settings)) > 1 or subject.surfaces(settings):
        return resolve_scene(subject, camera, settings)
    voxels = settings.replace(classification="pre", compositing="splats", kernel=voxel_kernel(settings))
    scene = replace(resolve_scene(subject, camera, voxels), settings=settings)
    if row != EWA:
        return scene
    # its filter widens voxels before z_k, too
    (layer,), filtered = scene.layers, settings.antialias != "off"
    appearance = replace(layer.resolved.appearance, attenuation=attenuation_form(settings, filtered))
    resolved = replace(layer.resolved, appearance=appearance, view=replace(layer.resolved.view, antialias=filtered))
    return replace(scene, layers=(replace(layer, resolved=resolved),))


def _prepare(
    scene: ResolvedScene, row: str = "row1", wanted: np.ndarray | None = None
) -> tuple[list[tuple[Drawing, Resolved]], dict[str, object]]:
    """The drawing of the picture; in blends without an order, one of each layer, without background. And the picture's
    info. wanted: the only pixels that are drawn; None: all.
    """
    layers = [(layer.front, layer.resolved) for layer in scene.layers]
    first, resolved = layers[0]
    row = row if scene.is_single else "row1"
    info: dict[str, object] = {**resolved.info(first, scene.camera), "row": row, "renderer": "float64 reference"}
    if not scene.is_single:
        names, count = [splats.name for splats, _ in layers], sum(len(splats) for splats, _ in layers)
        ground = scene.settings.ground
        info |= {"background": None if ground is None else list(ground), "layers": names, "splats": count}
    near = [(_select_reaching(splats, one, wanted), one) for splats, one in layers]
    if scene.is_single or scene.is_joined:
        return [(_scene(splats, one, row), one) for splats, one in near], info
    shown = [layer for layer in near if len(layer[0])] or near[:1] if wanted is not None else near
    scenes = [BoxScene(*layer) if layer[1].boxes else SheetScene(*layer) for layer in shown]
    drawn = LayerScene(scenes) if len(scenes) > 1 else scenes[0]
    if not scene.meshes:
        return [(drawn, resolved)], info
    light, settings = None, scene.settings
    if settings.shading != "off":
        light = LightModel.of(settings.light, settings.light_from, settings.shadows > 0, settings.strengths)
    return [(SurfaceScene(drawn, scene.meshes, resolved.camera, light), resolved)], info


def draw_bands(scene: Drawing, resolved: Resolved, progress: Progress | None = None) -> np.ndarray:
    """Draws the picture in bands of rows: float64 [H, W, 4]."""
    fine = resolved.camera
    # all samples of a pixel are in the same band
    height = max(1, scene.band_height() // resolved.samples) * resolved.samples
    bands = [(top, min(top + height, fine.size[1])) for top in range(0, fine.size[1], height)]
    remaining = progress(iter(bands), len(bands)) if progress else bands
    rows = (np.arange(top * fine.size[0], end * fine.size[0]) for top, end in remaining)
    drawn = [scene.part(Pixels.of(fine.size, index)) for index in rows]
    samples = np.concatenate(drawn).reshape(fine.size[1], fine.size[0], 4)
    return over_background(pixel_means(samples, resolved.samples) if resolved.averaged else samples, resolved)


def _select_reaching(splats: Splats, resolved: Resolved, wanted: np.ndarray | None) -> Splats:
    """Splats that may reach wanted pixels; None: all."""
    if wanted is None:
        return splats
    some = splats_may_reach(splats, resolved.view, _samples_of(wanted, resolved)[0])
    return splats.part(some, among_all=resolved.appearance.attenuation == "fill")


def render_pixels_of(bricks: Bricks, camera: Camera, settings: Settings, wanted: np.ndarray) -> np.ndarray:
    """`render_pixels` for a volume in bricks; extracts only bricks that may reach a pixel."""
    resolved = Resolved.of(bricks.whole, camera, settings)
    fine, _ = _samples_of(wanted, resolved)
    half = (bricks.high - 1 - bricks.low) / 2
    around = float(np.linalg.norm(half, axis=1).max())
    parts = [np.zeros(0, record_type(bricks.volume.shape, post=True))]

    def is_near(low: np.ndarray, high: np.ndarray) -> np.ndarray:
        half = (high - low) / 2
        return may_reach(low + half, resolved.view, fine, float(np.linalg.norm(half, axis=1).max()))

    for brick in np.flatnonzero(may_reach(bricks.low + half, resolved.view, fine, around)).tolist():
        records = bricks.records(brick, bricks.shown(brick, is_near))
        parts.append(records[may_reach(records["position"], resolved.view, fine)])
    records = np.concatenate(parts)
    records = records[np.lexsort(records["position"].T)]
    splats = clip_behind_eye(post_splats(bricks.volume, bricks.post, records), camera)
    return _draw_pixels(_scene(splats, resolved, "row1"), resolved, wanted)


def reachable(scene: ResolvedScene) -> np.ndarray:
    """bool [H, W]: pixels that splats may reach; all of them with meshes. The others show the background alone."""
    if scene.meshes:
        return np.ones(scene.camera.size[::-1], bool)
    return np.any([_reachable(run_boxes(layer.front), layer.resolved) for layer in scene.layers], axis=0)


def reachable_of(bricks: Bricks, camera: Camera, settings: Settings) -> np.ndarray:
    """bool [H, W]: pixels that splats of a volume in bricks may reach."""
    half = (bricks.high - 1 - bricks.low) / 2
    return _reachable(np.concatenate([bricks.low + half, half], axis=1), Resolved.of(bricks.whole, camera, settings))


def _reachable(boxes: np.ndarray, resolved: Resolved) -> np.ndarray:
    """bool [H, W]: pixels of whose samples, with those beside for means, splats in boxes [N, 6] may reach one."""
    k = resolved.samples
    squares = reached_squares(boxes[:, :3], resolved.view, np.linalg.norm(boxes[:, 3:], axis=1))
    for axis in (0, 1):
        for _ in range(k // (2 * SQUARE) + 1):
            padded = np.pad(squares, [(1, 1) if n == axis else (0, 0) for n in (0, 1)])
            squares = np.any([np.take(padded, n + np.arange(squares.shape[axis]), axis) for n in range(3)], axis=0)
    rows, columns = ((np.arange(side // k) * k + k // 2) // SQUARE for side in resolved.camera.size[::-1])
    return squares[rows[:, None], columns]


def _samples_of(wanted: np.ndarray, resolved: Resolved) -> tuple[Pixels, np.ndarray]:
    """The samples that pixels [P] need, and int [P, n, n]: which are each pixel's; those beyond the picture repeat
    those at its edge. n: samples along an axis, with one more on each side for means.
    """
    k, size = resolved.samples, resolved.camera.size
    if not resolved.averaged:
        return Pixels.of(size, wanted), np.arange(len(wanted))[:, None, None]
    row, column = np.divmod(wanted, size[0] // k)
    rows, columns = (
        np.clip(start[:, None] * k + np.arange(-1, k + 1), 0, most - 1)
        for start, most in ((row, size[1]), (column, size[0]))
    )
    index, place = np.unique(rows[:, :, None] * size[0] + columns[:, None], return_inverse=True)
    return Pixels.of(size, index), place.reshape(len(wanted), k + 2, k + 2)


def _draw_pixels(scene: Drawing, resolved: Resolved, wanted: np.ndarray) -> np.ndarray:
    """Draws some pixels of the picture of a scene, float64 [P, 4]: averages samples and adds the background."""
    fine, place = _samples_of(wanted, resolved)
    index = fine.index
    parts = in_parts(len(fine), TOGETHER, lambda some: scene.part(Pixels.of(fine.size, index[some])))
    samples = np.concatenate([np.zeros((0, 4)), *parts])[place]
    weights = mean_weights(resolved.samples) if resolved.averaged else np.ones(1)
    return over_background(np.einsum("i,pijc,j->pc", weights, samples, weights), resolved)


def _scene(splats: Splats, resolved: Resolved, row: str) -> Drawing:
    if resolved.boxes:
        return BoxScene(splats, resolved)
    if resolved.sheets is not None:
        return SheetScene(splats, resolved)
    view = replace(resolved.view, kernel=tabulate(resolved.kernel.name))
    voxel = view.voxels(splats.positions)
    footprints = FootprintRow.of(view, row, voxel, splats.grid)
    return SplatScene.of(splats, resolved, footprints, pixel_boxes(view, footprints.name, voxel, resolved.camera))


@dataclass(frozen=True, eq=False)
class SplatScene:
    """Data shared by all pixels of a picture of splats that composite one by one: footprints, their boxes of pixels,
    and order, colour, depth and coverage (the remaining share of opacity) of all splats.
    """

    row: FootprintRow
    boxes: PixelBoxes
    camera: Camera
    appearance: Appearance
    order: np.ndarray
    color: np.ndarray
    depth: np.ndarray
    coverage: np.ndarray

    @classmethod
    def of(cls, splats: Splats, resolved: Resolved, row: FootprintRow, boxes: PixelBoxes) -> SplatScene:
        """The scene of splats with footprints `row`."""
        appearance, camera = resolved.appearance, resolved.camera
        order = np.arange(len(splats))
        if len(splats) and appearance.hides:
            order = back_to_front(splats, order_for(splats, camera))[::-1]
        color = apply_light(splats.colors.astype(np.float64), splats, camera, row.voxel, resolved)
        depth = row.attenuate_depth(splats, appearance.attenuation)
        if appearance.join == "max":
            # opacity over the transfer function's reference length
            depth = -np.expm1(-depth * splats.unit / splats.grid.mean_spacing)
        coverage = row.coverage() if appearance.attenuation == "opacity" else np.ones(len(splats))
        return cls(row, boxes, camera, appearance, order, color, depth, coverage)

    def band_height(self) -> int:
        """Rows of pixels drawn together."""
        return max(1, BAND // self.camera.size[0])

    def part(self, wanted: Pixels) -> np.ndarray:
        """Wanted pixels of the picture, float64 [P, 4]."""
        gathered = Accumulator.empty(len(wanted))
        for s, pixel, integral in pair_values(self.row, self.boxes, self.order, wanted, self.camera):
            if not len(s):
                continue
            value = integral.value / integral.peak if self.appearance.join == "max" else integral.value
            ADD[self.appearance.join](gathered, pixel, self.depth[s] * value, self.color[s], self.coverage[s])
        return pixels(gathered, self.appearance)


Drawing = SplatScene | SheetScene | BoxScene | LayerScene | SurfaceScene

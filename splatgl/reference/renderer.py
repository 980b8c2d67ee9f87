"""Draws the reference picture in float64.

It uses blend, kernel, antialias, attenuation, shading, order and background, and ignores the settings of
approximations: align, footprint, target, tolerance. Slow and exact: the ground truth for other images.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from splatgl.data.image import Image
from splatgl.data.mesh import Mesh
from splatgl.reference.blend import ADD, Band, Part, over_background, pixel_means, pixels
from splatgl.reference.label_boxes import BoxScene
from splatgl.reference.layers import LayerScene, SurfaceScene, layers_of, resolve_layer
from splatgl.reference.rays import Boxes, Row, Values, may_reach, pair_values, pixel_boxes
from splatgl.reference.sheets import SheetScene
from splatgl.splat.bricks import Bricks
from splatgl.splat.camera import Camera
from splatgl.splat.culling import Window, clip_behind_eye
from splatgl.splat.extract_values import post_splats
from splatgl.splat.footprint import fill_depth
from splatgl.splat.kernels import tabulate
from splatgl.splat.lighting import Light, apply_light
from splatgl.splat.ordering import back_to_front, order_for
from splatgl.splat.resolve import PRE_KERNEL, Resolved, select_splats
from splatgl.splat.scene import Scene, join_pictures, with_shared_casters
from splatgl.splat.settings import BLENDS, Settings
from splatgl.splat.splats import Splats, record_type
from splatgl.splat.view import GridView

# samples per band: their indices fit into 16 bits, which sort fast
BAND = 1 << 16

Progress = Callable[[Iterator[tuple[int, int]], int], Iterator[tuple[int, int]]]


def render(
    splats: Splats | Scene,
    camera: Camera,
    settings: Settings | None = None,
    row: str = "row1",
    progress: Progress | None = None,
) -> Image:
    """The exact image of `Renderer.render`, float64 [H, W, 4], linear premultiplied, row 0 at the top.

    row: "row1" (correct) or an approximation of Table 1, "row2" … "row5": row4 is `align="ray"`, row5 `align="grid"`;
    rows 2 and 3 exist for cubic voxels only. progress wraps the iteration over bands of the image (bands, count).
    Raises InputError for an unknown row.  [M98 Table 1]
    """
    started = time.perf_counter()
    settings = settings or Settings()
    if isinstance(splats, Scene):
        drawn, meshes = layers_of(splats, camera, settings), splats.surfaces(settings)
        if len(drawn) > 1 or meshes:
            return _render_layers(drawn, camera, settings, progress, meshes)
        splats, settings = drawn[0]
    if row != "row1":
        kernel = settings.kernel if settings.kernel != "auto" else PRE_KERNEL
        settings = settings.but(classification="pre", compositing="splats", kernel=kernel)
    splats = clip_behind_eye(select_splats(splats, settings, moving=False), camera)
    resolved = Resolved.of(splats, camera, settings)
    picture = _draw_bands(_scene(splats, resolved, row), resolved, progress)
    return Image(picture, _provenance(splats, camera, resolved, row, time.perf_counter() - started))


def _render_layers(
    layers: Sequence[tuple[Splats, Settings]],
    camera: Camera,
    settings: Settings,
    progress: Progress | None,
    meshes: Sequence[Mesh],
) -> Image:
    """`render` for several layers."""
    started = time.perf_counter()
    if BLENDS[settings.blend].ordered:
        resolved = with_shared_casters(
            [resolve_layer(splats, camera, layer_settings) for splats, layer_settings in layers], layers
        )
        scene = _layer_scene(
            [(splats, layer) for (splats, _), layer in zip(layers, resolved, strict=True)], settings, meshes
        )
        picture, first = _draw_bands(scene, resolved[0], progress), resolved[0]
    else:
        alone = [(layer, layer_settings.but(background=None)) for layer, layer_settings in layers]
        picture = join_pictures(
            [render(layer, camera, layer_settings, progress=progress).pixels for layer, layer_settings in alone],
            settings,
        )
        first = Resolved.of(layers[0][0], camera, settings)
    info = _provenance(layers[0][0], camera, first, "row1", time.perf_counter() - started)
    splats = [layer for layer, _ in layers]
    return Image(picture, {**info, "layers": [layer.name for layer in splats], "splats": sum(map(len, splats))})


def _draw_bands(
    scene: _Scene | SheetScene | BoxScene | LayerScene | SurfaceScene, resolved: Resolved, progress: Progress | None
) -> np.ndarray:
    """Draws the picture in bands of rows: float64 [H, W, 4]."""
    fine = resolved.camera
    # all samples of a pixel are in the same band
    height = max(1, scene.band_height() // resolved.samples) * resolved.samples
    bands = [(top, min(top + height, fine.size[1])) for top in range(0, fine.size[1], height)]
    remaining = progress(iter(bands), len(bands)) if progress else bands
    drawn = [scene.part(Window(0, top, fine.size[0], end - top)) for top, end in remaining]
    return _mean(np.concatenate(drawn), resolved)


def render_windows(
    splats: Splats | Scene, camera: Camera, settings: Settings, windows: Sequence[Window]
) -> list[np.ndarray]:
    """Windows of pixels of the image, float64 [h, w, 4]: to check other images of many splats."""
    if isinstance(splats, Scene):
        drawn, meshes = layers_of(splats, camera, settings), splats.surfaces(settings)
        if len(drawn) > 1 or meshes:
            return _layer_windows(drawn, camera, settings, windows, meshes)
        splats, settings = drawn[0]
    splats = clip_behind_eye(select_splats(splats, settings, moving=False), camera)
    resolved = Resolved.of(splats, camera, settings)
    return _windows(_scene(_select_reaching(splats, resolved, windows), resolved, "row1"), resolved, windows)


def _layer_windows(
    layers: Sequence[tuple[Splats, Settings]],
    camera: Camera,
    settings: Settings,
    windows: Sequence[Window],
    meshes: Sequence[Mesh],
) -> list[np.ndarray]:
    """`render_windows` for several layers."""
    if not BLENDS[settings.blend].ordered:
        alone = [(splats, layer_settings.but(background=None)) for splats, layer_settings in layers]
        parts = [render_windows(splats, camera, layer_settings, windows) for splats, layer_settings in alone]
        return [join_pictures(part, settings) for part in zip(*parts, strict=True)]
    resolved = with_shared_casters(
        [resolve_layer(splats, camera, layer_settings) for splats, layer_settings in layers], layers
    )
    near = [_select_reaching(splats, layer, windows) for (splats, _), layer in zip(layers, resolved, strict=True)]
    pairs = list(zip(near, resolved, strict=True))
    some = [pair for pair in pairs if len(pair[0])] or pairs[:1]
    return _windows(_layer_scene(some, settings, meshes), resolved[0], windows)


def _layer_scene(
    layers: Sequence[tuple[Splats, Resolved]], settings: Settings, meshes: Sequence[Mesh]
) -> SheetScene | BoxScene | LayerScene | SurfaceScene:
    """Scene of layers and meshes."""
    scenes = [BoxScene(*layer) if layer[1].boxes else sheet_scene(*layer) for layer in layers]
    scene = LayerScene(scenes) if len(scenes) > 1 else scenes[0]
    if not meshes:
        return scene
    light = None if settings.shading == "off" else Light.of(settings.light, settings.light_from, settings.shadows > 0)
    return SurfaceScene(scene, meshes, layers[0][1].camera, light)


def _select_reaching(splats: Splats, resolved: Resolved, windows: Sequence[Window]) -> Splats:
    """Splats that may reach windows of pixels."""
    some = may_reach(splats.records["position"], resolved.view, _sample_windows(windows, resolved))
    return splats.part(some, among_all=resolved.look.attenuation == "fill")


def render_windows_of(
    bricks: Bricks, camera: Camera, settings: Settings, windows: Sequence[Window]
) -> list[np.ndarray]:
    """`render_windows` for a volume in bricks; extracts only bricks that may reach a window."""
    resolved = Resolved.of(bricks.whole, camera, settings)
    fine = _sample_windows(windows, resolved)
    half = (bricks.high - 1 - bricks.low) / 2
    around = float(np.linalg.norm(half, axis=1).max())
    parts = [np.zeros(0, record_type(bricks.volume.shape, post=True))]
    for brick in np.flatnonzero(may_reach(bricks.low + half, resolved.view, fine, around)).tolist():
        records = bricks.records(brick)
        parts.append(records[may_reach(records["position"], resolved.view, fine)])
    records = np.concatenate(parts)
    records = records[np.lexsort(records["position"].T)]
    splats = clip_behind_eye(post_splats(bricks.volume, bricks.post, records), camera)
    return _windows(_scene(splats, resolved, "row1"), resolved, windows)


def _sample_windows(windows: Sequence[Window], resolved: Resolved) -> list[Window]:
    """The windows in samples, if several samples are averaged, else in pixels."""
    return [_samples(window, resolved) for window in windows] if resolved.averaged else list(windows)


def _windows(
    scene: _Scene | SheetScene | BoxScene | LayerScene | SurfaceScene, resolved: Resolved, windows: Sequence[Window]
) -> list[np.ndarray]:
    """Draws windows of the picture of a scene, averages samples and adds the background."""
    fine, k = _sample_windows(windows, resolved), resolved.samples
    parts = scene.parts(fine) if isinstance(scene, SheetScene) else [scene.part(window) for window in fine]
    if not resolved.averaged:
        return [_mean(part, resolved) for part in parts]
    pictures = []
    for window, near, drawn in zip(windows, fine, parts, strict=True):
        left, top = (window.x - 1) * k, (window.y - 1) * k
        right, bottom = left + (window.width + 2) * k, top + (window.height + 2) * k
        beyond = ((near.y - top, bottom - near.y - near.height), (near.x - left, right - near.x - near.width), (0, 0))
        pictures.append(_mean(np.pad(drawn, beyond, mode="edge"), resolved)[1:-1, 1:-1])
    return pictures


def _samples(window: Window, resolved: Resolved) -> Window:
    """The samples of a window's pixels, and one more on each side for their means."""
    k, (width, height) = resolved.samples, resolved.camera.size
    left, top = max(window.x * k - 1, 0), max(window.y * k - 1, 0)
    right, bottom = (window.x + window.width) * k + 1, (window.y + window.height) * k + 1
    return Window(left, top, min(right, width) - left, min(bottom, height) - top)


def _scene(splats: Splats, resolved: Resolved, row: str) -> _Scene | SheetScene | BoxScene:
    if resolved.boxes:
        return BoxScene(splats, resolved)
    return _Scene(splats, resolved, row) if resolved.sheets is None else sheet_scene(splats, resolved)


class _Scene:
    """Data shared by all windows: positions, boxes, order and colours of all splats."""

    def __init__(self, splats: Splats, resolved: Resolved, row: str) -> None:
        blend, camera = resolved.look.blend, resolved.camera
        self.camera, self.blend = camera, blend
        view = replace(resolved.view, kernel=tabulate(resolved.kernel.name))
        voxel = view.voxels(splats.positions)
        self.row = Row.of(view, row, voxel, splats.grid)
        self.boxes: Boxes = pixel_boxes(view, self.row.name, voxel, camera)
        self.order = np.arange(len(splats))
        if len(splats) and blend.ordered:
            self.order = back_to_front(splats, order_for(splats, camera))[::-1]
        self.color = splats.colors.astype(np.float64)
        self.color = apply_light(self.color, splats, camera, voxel, resolved)
        depth = splats.records["optical_depth"].astype(np.float64)
        # opacity over the transfer function's reference length
        self.depth = -np.expm1(-depth * splats.unit / splats.grid.mean_spacing) if blend.peak else depth
        self.coverage = self.row.coverage() if resolved.look.attenuation == "opacity" else np.ones(len(splats))
        if resolved.look.attenuation == "fill":
            self.depth = attenuate_depth(splats, view, voxel, self.row.coverage())

    def band_height(self) -> int:
        """Rows of pixels drawn together."""
        return max(1, BAND // self.camera.size[0])

    def part(self, window: Window) -> np.ndarray:
        """A window of the picture, float64 [h, w, 4]."""
        gathered = Band.empty(window.height * window.width)
        for pairs in pair_values(self.row, self.boxes, self.order, window, self.camera):
            if len(pairs.splat):
                ADD[self.blend.join](gathered, self._part(pairs))
        return pixels(gathered, self.blend).reshape(window.height, window.width, 4)

    def _part(self, pairs: Values) -> Part:
        value = pairs.integral.value
        if self.blend.peak:
            value = value / pairs.integral.peak
        splat = pairs.splat
        return Part(pairs.pixel, self.depth[splat] * value, self.color[splat], self.coverage[splat])


def sheet_scene(splats: Splats, resolved: Resolved) -> SheetScene:
    """Scene of splats that add up within sheets."""
    if splats.post is not None:
        return SheetScene(splats, resolved, None)
    depth = splats.records["optical_depth"].astype(np.float64)
    if resolved.look.attenuation == "fill":
        view = resolved.view
        voxel = view.voxels(splats.positions)
        depth = attenuate_depth(splats, view, voxel, view.coverage(voxel[2]))
    return SheetScene(splats, resolved, depth)


def attenuate_depth(splats: Splats, view: GridView, voxel: np.ndarray, coverage: np.ndarray) -> np.ndarray:
    """Optical depths [N] of voxels [3, N], attenuated by the share of their pixel that their matter fills."""
    ray = voxel if view.perspective else np.array([[0.0], [0.0], [1.0]])
    length = np.sqrt((ray * ray).sum(axis=0))
    along = np.linalg.inv(view.eye_from_index) @ (ray / np.where(length > 0, length, 1.0))
    widths = np.linalg.norm(view.eye_from_index, axis=0)
    depth = splats.records["optical_depth"].astype(np.float64)
    pixel = np.where(view.is_widened(voxel[2]), view.pixel_side(voxel[2]), 0.0)
    return fill_depth(depth, along, widths, pixel, coverage, splats.runs)


def _mean(samples: np.ndarray, resolved: Resolved) -> np.ndarray:
    """Pixels: means of samples, over the background."""
    return over_background(pixel_means(samples, resolved.samples) if resolved.averaged else samples, resolved)


def _provenance(splats: Splats, camera: Camera, resolved: Resolved, row: str, seconds: float) -> dict[str, object]:
    return {
        "scene": splats.name,
        "splats": len(splats),
        "size": list(camera.size),
        "projection": "perspective" if camera.perspective else "orthographic",
        "eye": [float(x) for x in camera.eye],
        "forward": [float(x) for x in camera.forward],
        "blend": resolved.look.blend.name,
        "kernel": resolved.kernel.name,
        "row": row,
        "antialias": resolved.view.antialias,
        "samples": resolved.samples,
        "averaged": resolved.averaged,
        "classification": "post" if resolved.look.steps else "pre",
        "sheets": resolved.look.sheets,
        "steps": resolved.look.steps,
        "attenuation": resolved.look.attenuation,
        "shading": resolved.look.shading,
        "background": None if resolved.background is None else list(resolved.background),
        "renderer": "float64 reference",
        "seconds": round(seconds, 6),
    }

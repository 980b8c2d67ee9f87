"""Chooses levels of detail, and draws volumes that exceed memory.

Means of values lose structures thinner than a voxel, and are classified differently. So a coarser level is drawn only
if it is accurate in boxes of this volume, with this transfer function and camera.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from splatgl.data.color import linear_from_srgb
from splatgl.data.image import Image
from splatgl.data.volume import Volume, zyx_index
from splatgl.errors import expected
from splatgl.fileio import PROCESS, budget, byte_count, format_bytes, held_within_budget, within
from splatgl.geometry.camera import Camera
from splatgl.geometry.grid import Grid
from splatgl.gl.renderer import Renderer
from splatgl.planning.bricks import EACH, Bricks, excess_bricks, spread_places
from splatgl.planning.plan import MotionBlur
from splatgl.planning.resolve import check_blur_supported, extract_for_settings
from splatgl.planning.scene import ResolvedScene, ScenePlan
from splatgl.readers import load
from splatgl.splat.motion import Motion, Supersampling
from splatgl.splat.settings import COMBINE, Settings
from splatgl.splat.splats import Splats
from splatgl.transfer.transfer import Transfer

# boxes to compare; places, and bytes of the finest level, to search for them, as many are empty and losses are rare
BOXES, PLACES, MOST_READ = 8, 512, 1 << 28
# bytes, beside the process and the voxels of a box, to read, draw and compare boxes
BOXES_DRAWN = 120 << 20
# coarse voxels along a side of a box, and the least and most fine voxels
COARSE_SIDE, FINE_SIDES = 8, (32, 128)
# values that are classified at a time
AT_ONCE = 1 << 16
# samples along a pixel of the reference, and pixels around a box
SAMPLES, MARGIN = 8, 4
# factor by which the error of a coarser level may be larger: few boxes do not measure it better
SLACK = 1.05


@dataclass(frozen=True, eq=False)
class DetailLevel:
    """The level for a picture. number: 0 is the finest.

    off: RMSE of the levels that were tried, by number, to the finest level, supersampled, in `boxes` boxes. allowed:
    largest RMSE of a coarser level.
    """

    number: int
    volume: Volume
    off: dict[int, float]
    allowed: float
    boxes: int

    @property
    def info(self) -> dict[str, object]:
        """Provenance: the number, the RMSE to the finest level (None: not measured), and the number of boxes."""
        return {"level": self.number, "level_rmse": self.off.get(self.number), "level_boxes": self.boxes}

    def __str__(self) -> str:
        """The measurement in one line."""
        tried = ", ".join(f"level {number} by {off:.2g}" for number, off in sorted(self.off.items()))
        size = "×".join(map(str, self.volume.shape[::-1]))
        if not self.boxes:
            return f"level {self.number}, {size}"
        return f"level {self.number}, {size}: in {self.boxes} boxes off by RMSE: {tried}; allowed {self.allowed:.2g}"


def choose_level(
    volume: Volume, transfer: Transfer, camera: Camera, settings: Settings, renderer: Renderer | None = None
) -> DetailLevel:
    """Chooses the coarsest level whose voxels are finer than a pixel everywhere [M98 Eq. 3], and whose error in boxes
    is at most that of the finest level with these settings, or the tolerance. Errors are to the finest level,
    supersampled. renderer: an open one; None: opens one. Raises InputError if the memory budget holds no box.
    """
    finest = DetailLevel(0, single_level(volume, 0), {}, 0.0, 0)
    coarsest = coarsest_fine_level(volume, camera)
    if coarsest == 0:
        return finest
    side, _ = _box_size(volume, coarsest)
    held = held_within_budget(byte_count(volume.shape, volume.samples.dtype))
    least = PROCESS + BOXES_DRAWN + held + EACH * int(side.prod())
    if least > (most := budget()):
        this, fix = f"at least {format_bytes(least)} to choose a level", "give more --memory, or a --level"
        raise expected("memory", this, format_bytes(most), fix)
    if renderer is None:
        with Renderer() as opened:
            return choose_level(volume, transfer, camera, settings, opened)
    boxes = list(_boxes(volume, coarsest, transfer, camera, settings, renderer))
    if not boxes:
        return finest
    fine = replace(finest, boxes=len(boxes))
    # the tolerance of sums is relative to the brightest pixel
    one = max(settings.brightest(box.right.pixels) for box in boxes)
    own = _rmse([(box.image, box.right) for box in boxes])
    off, allowed = {0: own}, max(SLACK * own, settings.tolerance * one)
    for number in range(coarsest, 0, -1):
        chosen = single_level(volume, number)
        drawn = [_drawn(_cut(chosen, *box.ends), transfer, box.camera, settings, renderer) for box in boxes]
        off[number] = _rmse([(image, box.right) for image, box in zip(drawn, boxes, strict=True)])
        if off[number] <= allowed:
            return DetailLevel(number, chosen, off, allowed, len(boxes))
    return replace(fine, off=off, allowed=allowed)


def single_level(volume: Volume, number: int) -> Volume:
    """One level of a multiscale volume."""
    if number == 0:
        return replace(volume, coarser=())
    return replace(volume.coarser[number - 1], name=volume.name, hints=volume.hints, frame=volume.frame)


def coarsest_fine_level(volume: Volume, camera: Camera) -> int:
    """The coarsest level whose voxels are at most a pixel wide at the nearest depth of the volume; 0: the finest."""
    nearest = float(camera.eye_from_points(volume.corners)[:, 2].min())
    pixel = float(camera.pixel_pitch(max(nearest, 0.0)))
    fine = [max(level.spacing) <= pixel for level in volume.coarser]
    return fine.index(False) if False in fine else len(fine)


@dataclass(frozen=True, eq=False)
class _Box:
    """A box of the volume: its ends in world units, a camera, and pictures with the settings and supersampled."""

    ends: tuple[np.ndarray, np.ndarray]
    camera: Camera
    image: Image
    right: Image


def _boxes(
    volume: Volume, coarsest: int, transfer: Transfer, camera: Camera, settings: Settings, renderer: Renderer
) -> Iterator[_Box]:
    """Up to BOXES boxes that are not empty, those that the coarsest level changes most first."""
    found = 0
    for first, last in changed_boxes(volume, coarsest, transfer, camera, settings):
        part = volume.part(zyx_index(first), zyx_index(last))
        near = _toward(camera, part)
        if near is None:
            continue
        image = _drawn(part, transfer, near, settings, renderer)
        if image.pixels.any():
            right = _drawn(part, transfer, near, replace(settings, antialias="supersample", samples=SAMPLES), renderer)
            yield _Box(_ends(volume, first, last), near, image, right)
            found += 1
            if found == BOXES:
                return


def changed_boxes(volume: Volume, coarsest: int, transfer: Transfer, camera: Camera, settings: Settings) -> np.ndarray:
    """int64 [n, 2, 3]: ends (x, y, z) of boxes of whole coarse voxels, of the whole volume or of PLACES distributed
    over it; those whose flat picture differs most at the level `coarsest` come first.
    """
    size, level = np.array(volume.shape[::-1]), single_level(volume, coarsest)
    side, step = _box_size(volume, coarsest)
    most = MOST_READ // (int(side.prod()) * volume.samples.dtype.itemsize)
    lows = _places(size, side, step, min(max(most, BOXES), PLACES))
    boxes = np.stack([lows, lows + side], axis=1)
    axis = int(np.abs(camera.forward @ volume.direction).argmax())
    changes = []
    for first, last in boxes:
        parts = volume.part(zyx_index(first), zyx_index(last)), _cut(level, *_ends(volume, first, last))
        changes.append(_change(*(flat_picture(part, transfer, settings, axis) for part in parts)))
    return boxes[np.argsort(changes, kind="stable")[::-1]]


def _box_size(volume: Volume, coarsest: int) -> tuple[np.ndarray, np.ndarray]:
    """int64 [3] (x, y, z): voxels along the sides of the boxes, and of the finest level in one of the coarsest."""
    step = np.maximum(np.rint(np.array(volume.coarser[coarsest - 1].spacing) / volume.spacing).astype(np.int64), 1)
    side = np.maximum(np.clip(COARSE_SIDE * step, *FINE_SIDES) // step, 1) * step
    return np.minimum(side, volume.shape[::-1]), step


def _places(size: np.ndarray, side: np.ndarray, step: np.ndarray, most: int) -> np.ndarray:
    """int64 [n, 3]: first voxels (x, y, z) of the boxes that tile the volume, or of `most` that are distributed."""
    count = -(-size // side)
    if count.prod() > most:
        return np.unique(spread_places(size - side, most) // step * step, axis=0)
    return np.minimum(np.indices(count).reshape(3, -1).T * side, (size - side) // step * step)


def _ends(volume: Volume, first: np.ndarray, last: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The ends of the voxels first ≤ (x, y, z) < last, world units."""
    low, high = np.stack([first - 0.5, last - 0.5]) @ volume.world_from_index.T + volume.origin
    return low, high


def flat_picture(part: Volume, transfer: Transfer, settings: Settings, axis: int) -> np.ndarray:
    """[h, w, 4]: linear premultiplied picture of a volume along an axis of its grid, a column of voxels a pixel, for
    comparison with other levels: without shading and interpolation. axis: 0 is x.
    """
    at = 2 - axis
    values = np.moveaxis(np.asarray(part.samples, np.float64), at, 0)
    if settings.shows_value:
        join = settings.join
        value = np.mean(values, axis=0) if join == "mean" else COMBINE[join].reduce(values, axis=0)
        alpha = transfer.largest_opacity(value)[..., None]
        return np.concatenate([transfer.color(value) * alpha, alpha], axis=2)
    sizes = np.moveaxis(_magnitude(part), at, 0) if transfer.needs_gradients else np.zeros_like(values)
    colors = None if part.color is None else np.moveaxis(part.color, at, 0)
    surfaces, length = transfer.surface_matter(), part.spacing[axis] / transfer.length(part)
    picture, passed = np.zeros((*values.shape[1:], 4)), np.ones((*values.shape[1:], 1))
    layers = max(AT_ONCE // values[0].size, 1)
    for n in range(0, len(values), layers):
        some, before = values[n : n + layers], values[np.maximum(np.arange(n, min(n + layers, len(values))) - 1, 0)]
        opacity, color = transfer.classify(some.ravel(), sizes[n : n + layers].ravel())
        if colors is not None:
            color = linear_from_srgb(colors[n : n + layers] / 255)
        own = transfer.extinction(opacity, 1.0).reshape(*some.shape, 1) * length
        matter = np.concatenate([color.reshape(*some.shape, 3), np.ones_like(own)], axis=3) * own
        for surface, behind in zip(transfer.iso, surfaces, strict=True):
            matter += ((some > surface.value) != (before > surface.value))[..., None] * behind
        depth = matter[..., 3:]
        if not settings.is_sum:
            until = np.cumsum(depth, axis=0)
            matter *= passed * np.exp(depth - until) * -np.expm1(-depth) / np.where(depth > 0, depth, 1.0)
            passed = passed * np.exp(-until[-1])
        picture += matter.sum(axis=0)
    return picture


def _magnitude(part: Volume) -> np.ndarray:
    """[D, H, W]: magnitudes of the gradients of the samples, per world length along the axes of the grid."""
    values, squares = np.asarray(part.samples, np.float64), np.zeros(part.shape)
    for at, side in enumerate(part.spacing[::-1]):
        if values.shape[at] > 1:
            squares += np.gradient(values, side, axis=at) ** 2
    return np.sqrt(squares)


def _change(fine: np.ndarray, coarse: np.ndarray) -> float:
    """RMS difference of two pictures [h, w, 4], the larger one by its means over the pixels of the smaller one; -1 if
    both are empty.
    """
    if not (fine.any() or coarse.any()):
        return -1.0
    for axis, count in enumerate(coarse.shape[:2]):
        starts = np.arange(count) * fine.shape[axis] // count
        shape = [-1 if n == axis else 1 for n in range(3)]
        pixels = np.diff(np.append(starts, fine.shape[axis])).reshape(shape)
        fine = np.add.reduceat(fine, starts, axis=axis) / pixels
    return float(np.sqrt(((fine - coarse) ** 2).mean()))


def _toward(camera: Camera, part: Volume) -> Camera | None:
    """The camera of a small picture of a part, with the same pixel size; None if a corner lies behind the eye."""
    pitch, away = camera.extent / camera.size[1], part.center - camera.eye
    middle = camera.eye_from_points(part.center)
    if middle[2] <= 0:
        return None
    if camera.perspective:
        up = -camera.eye_from_world[1]
        if abs(away @ up) > 0.99 * np.linalg.norm(away):
            up = camera.forward
        near = Camera.look_at(camera.eye, part.center, up, size=(1, 1))
    else:
        eye = camera.eye + camera.eye_from_world[:2].T @ middle[:2]
        near = replace(camera, eye=eye)
    corners = near.eye_from_points(part.corners)
    if corners[:, 2].min() <= 0:
        return None
    widest = np.abs(corners[:, :2] / corners[:, 2:] if camera.perspective else corners[:, :2]).max()
    side = 2 * (int(np.ceil(widest / pitch)) + MARGIN)
    return replace(near, size=(side, side), extent=pitch * side)


def _cut(volume: Volume, low: np.ndarray, high: np.ndarray) -> Volume:
    """The voxels of a volume between two points, world units."""
    ends = Grid.of(volume).index_from_world(np.stack([low, high])) + 0.5
    first, last = np.clip(np.rint(np.sort(ends, axis=0)), 0, volume.shape[::-1]).astype(np.int64)
    first = np.minimum(first, np.array(volume.shape[::-1]) - 1)
    return volume.part(zyx_index(first), zyx_index(np.maximum(last, first + 1)))


def _drawn(part: Volume, transfer: Transfer, camera: Camera, settings: Settings, renderer: Renderer) -> Image:
    splats = extract_for_settings(part, transfer, settings)
    if not len(splats):
        return Image(np.zeros((*camera.size[::-1], 4), np.float32), {})
    return renderer.render(splats, camera, settings, verify_bound=False)


def _rmse(pairs: list[tuple[Image, Image]]) -> float:
    """RMSE over the pixels that are not empty in one of a pair."""
    off = [(a.pixels - b.pixels)[(a.pixels.any(axis=2)) | (b.pixels.any(axis=2))] for a, b in pairs]
    return float(np.sqrt((np.concatenate(off) ** 2).mean()))


# called with the number of bricks done, and of all
Progress = Callable[[int, int], None]


def render_slabs(
    source: Volume | str | Path,
    transfer: Transfer,
    camera: Camera,
    settings: Settings | None = None,
    memory: int | None = None,
    progress: Progress | None = None,
    renderer: Renderer | None = None,
) -> Image:
    """Like `splatgl.distributed.render.render_slabs`, without workers. renderer: an open one; None: opens one."""
    settings = settings or Settings()
    with within(memory), nullcontext(renderer) if renderer else Renderer() as drawing:
        volume = source if isinstance(source, Volume) else load(source)
        level = choose_level(volume, transfer, camera, settings, drawing)
        excess = excess_bricks(level.volume, transfer, settings, camera)
        info = {**level.info, "bricks": 0}
        if excess is None:
            image = drawing.render(extract_for_settings(level.volume, transfer, settings), camera, settings)
            return Image(image.pixels, {**image.info, **info})
        bricks, bands = excess[0].fitted(camera, settings, budget())
        image = drawing.render_bricks(bricks, camera, settings, progress, bands=bands)
        return Image(image.pixels, {**info, **image.info})


def render_moving_bricks(
    renderer: Renderer, bricks: Bricks, camera: Camera, settings: Settings, motion: Motion | None, bands: int = 1
) -> Image:
    """Draws a volume in bricks while the camera or the volume moves: the mean of moments, as `Renderer.render` draws
    moving splats, and planned in the middle of the exposure; without motion a sharp picture. Raises InputError for
    streaks and for a flow.
    """

    def draw(_: Splats, view: Camera, requested: Settings) -> Image:
        return renderer.render_bricks(bricks, view, requested, bands=bands)

    if motion is None:
        return draw(bricks.probes, camera, settings)
    check_blur_supported("in bricks", settings, motion.flow is not None)
    notes, sharp = list[str](), replace(settings, motion="off", moments=None)
    blurred = MotionBlur.of(bricks.probes, camera, settings, motion, notes)
    if blurred.moments:
        mean = Supersampling(draw, motion, settings.shutter, blurred.moments)(bricks.probes, camera, sharp)
        image = Image(mean.pixels.astype(np.float32), {**mean.info, "motion": "moments"})
    else:
        image = draw(bricks.probes, camera, sharp)
    chosen = renderer.plan_bricks(bricks, blurred.camera, sharp)
    chosen = replace(chosen, moments=blurred.moments, notes=(*notes, *chosen.notes))
    return replace(image, plan=ScenePlan((chosen,), ResolvedScene((), camera, sharp)))

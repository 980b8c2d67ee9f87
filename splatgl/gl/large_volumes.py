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

from splatgl.data.image import Image
from splatgl.data.volume import Volume, zyx_index
from splatgl.fileio import budget
from splatgl.gl.renderer import Renderer
from splatgl.readers import load
from splatgl.splat.bricks import Bricks, bricks_of, excess_need, spread_places
from splatgl.splat.camera import Camera
from splatgl.splat.grid import Grid
from splatgl.splat.motion import Moments, Motion
from splatgl.splat.plan import Blurred
from splatgl.splat.resolve import check_blur_supported, extract_for_settings
from splatgl.splat.settings import BLENDS, Settings
from splatgl.splat.splats import Splats
from splatgl.splat.transfer import Transfer

# boxes to compare; places, and bytes of the finest level, to search for them, as many are empty and losses are rare
BOXES, PLACES, MOST_READ = 8, 128, 1 << 28
# coarse voxels along a side of a box, and the least and most fine voxels
COARSE_SIDE, FINE_SIDES = 8, (32, 128)
# samples along a pixel of the reference, and pixels around a box
SAMPLES, MARGIN = 8, 4
# factor by which the error of a coarser level may be larger: few boxes do not measure it better
SLACK = 1.05


@dataclass(frozen=True, eq=False)
class Level:
    """The level for a picture. number: 0 is the finest. transfer: opacities refer to the spacing of the finest level.

    off: RMSE of the levels that were tried, by number, to the finest level, supersampled, in `boxes` boxes. allowed:
    largest RMSE of a coarser level.
    """

    number: int
    volume: Volume
    transfer: Transfer
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
) -> Level:
    """Chooses the coarsest level whose voxels are finer than a pixel everywhere [M98 Eq. 3], and whose error in boxes
    is at most that of the finest level with these settings, or the tolerance. Errors are to the finest level,
    supersampled. renderer: an open one; None: opens one.
    """
    finest = Level(0, single_level(volume, 0), transfer, {}, 0.0, 0)
    coarsest = coarsest_fine_level(volume, camera)
    if coarsest == 0:
        return finest
    if renderer is None:
        with Renderer() as opened:
            return choose_level(volume, transfer, camera, settings, opened)
    # opacities refer to the finest voxels
    spacing = Grid.of(volume).mean_spacing
    transfer = replace(transfer, unit=transfer.unit or spacing)
    boxes = list(_boxes(volume, coarsest, transfer, camera, settings, renderer))
    if not boxes:
        return finest
    fine = replace(finest, transfer=transfer, boxes=len(boxes))
    # the tolerance of sums is relative to the brightest pixel
    one = max(float(box.right.pixels.max()) for box in boxes) if BLENDS[settings.blend].unbounded else 1.0
    own = _rmse([(box.image, box.right) for box in boxes])
    off, allowed = {0: own}, max(SLACK * own, settings.tolerance * one)
    for number in range(coarsest, 0, -1):
        chosen = single_level(volume, number)
        drawn = [_drawn(_cut(chosen, *box.ends), transfer, box.camera, settings, renderer) for box in boxes]
        off[number] = _rmse([(image, box.right) for image, box in zip(drawn, boxes, strict=True)])
        if off[number] <= allowed:
            return Level(number, chosen, transfer, off, allowed, len(boxes))
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
    """Up to BOXES boxes of whole coarse voxels that are not empty: of places distributed over the volume, those whose
    opacity the means over coarse voxels lose most of.
    """
    size, sides = np.array(volume.shape[::-1]), np.array(volume.coarser[coarsest - 1].spacing) / volume.spacing
    step = np.maximum(np.rint(sides).astype(np.int64), 1)
    side = np.minimum(np.maximum(np.clip(COARSE_SIDE * step, *FINE_SIDES) // step, 1) * step, size)
    most, found = MOST_READ // (int(side.prod()) * volume.samples.dtype.itemsize), 0
    lows = np.unique(spread_places(size - side, min(max(most, BOXES), PLACES)) // step * step, axis=0)
    lost = [_lost(volume.part(zyx_index(low), zyx_index(low + side)), step, transfer) for low in lows]
    for low in lows[np.argsort(lost)[::-1]]:
        part = volume.part(zyx_index(low), zyx_index(low + side))
        ends = np.stack([low - 0.5, low + side - 0.5]) @ volume.world_from_index.T + volume.origin
        near = _toward(camera, part)
        if near is None:
            continue
        image = _drawn(part, transfer, near, settings, renderer)
        if image.pixels.any():
            right = _drawn(part, transfer, near, replace(settings, antialias="supersample", samples=SAMPLES), renderer)
            yield _Box((ends[0], ends[1]), near, image, right)
            found += 1
            if found == BOXES:
                return


def _lost(part: Volume, step: np.ndarray, transfer: Transfer) -> float:
    """RMS difference of the opacity of means over `step` voxels (x, y, z) to the mean opacity; -1 if all is clear."""
    samples = np.nan_to_num(np.asarray(part.samples, np.float64))
    opacity = transfer.largest_opacity(samples)
    if not opacity.any():
        return -1.0
    apart = transfer.largest_opacity(_means(samples, step)) - _means(opacity, step)
    return float(np.sqrt((apart**2).mean()))


def _means(samples: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Means of samples [D, H, W] over boxes of `step` (x, y, z); the last boxes may be smaller."""
    for axis, size in enumerate(step[::-1].tolist()):
        starts = np.arange(0, samples.shape[axis], size)
        count = np.diff(np.append(starts, samples.shape[axis]))
        sums = np.add.reduceat(samples, starts, axis=axis)
        samples = sums / count.reshape([-1 if n == axis else 1 for n in range(3)])
    return samples


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
    volume = source if isinstance(source, Volume) else load(source)
    most = budget() if memory is None else memory
    with nullcontext(renderer) if renderer else Renderer() as drawing:
        level = choose_level(volume, transfer, camera, settings, drawing)
        bricks = bricks_of(level.volume, level.transfer, settings)
        need = excess_need(bricks, camera.size, most) if bricks else None
        info = {**level.info, "bricks": 0}
        if bricks is None or need is None:
            image = drawing.render(extract_for_settings(level.volume, level.transfer, settings), camera, settings)
            return Image(image.pixels, {**image.info, **info})
        bricks = bricks.limited(most)
        image = drawing.render_bricks(bricks, camera, settings, progress, bands=need.bands(bricks, most))
        return Image(image.pixels, {**info, **image.info}).with_notes(need.notes(bricks, most))


def render_moving_bricks(
    renderer: Renderer, bricks: Bricks, camera: Camera, settings: Settings, motion: Motion | None, bands: int = 1
) -> Image:
    """Draws a volume in bricks while the camera or the volume moves: the mean of moments, as `Renderer.render` draws
    moving splats; without motion a sharp picture. Raises InputError for streaks and for a flow.
    """
    if motion is None:
        return renderer.render_bricks(bricks, camera, settings, bands=bands)
    check_blur_supported("in bricks", settings, motion.flow is not None)
    sharp = replace(settings, motion="off", moments=None)

    def draw(_: Splats, view: Camera, requested: Settings) -> Image:
        return renderer.render_bricks(bricks, view, requested, bands=bands)

    blurred = Blurred.of(bricks.probes, camera, settings, motion, [])
    if not blurred.moments:
        return draw(bricks.probes, camera, sharp)
    mean = Moments(draw, motion, settings.shutter, blurred.moments)(bricks.probes, camera, sharp)
    return Image(mean.pixels.astype(np.float32), {**mean.info, "motion": "moments"})

"""Metrics of aliasing in images, and of flicker between frames.

Pixels represent at most half a cycle per pixel; finer detail aliases into coarser patterns. The same image at four
samples a pixel, with splats as wide as in the original, measures the amount.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from splatgl.data.image import Image
from splatgl.geometry.camera import Camera
from splatgl.geometry.grid import Grid
from splatgl.planning.culling import order_for
from splatgl.splat.kernels import kernel
from splatgl.splat.motion import Draw
from splatgl.splat.motion_blur import line_area
from splatgl.splat.settings import Settings
from splatgl.splat.splats import Splats, as_points

# samples a pixel, along each axis
TIMES = 4
# width of the analysis window's soft edge, in pixels: the window's own energy beyond half a cycle a pixel is
# e^(−2π²σ²/4) = 1e−9
SOFT = 2.0
# the line at z_k separates regions blurred by LINE pixels, where the region beyond exceeds LINE_SEEN
LINE, LINE_SEEN = 1.0, 0.3
# kernel spectra: maximum frequency in cycles a pixel, points along each axis, and depth bins
FASTEST, POINTS, DEPTHS = 4.0, 401, 40
# minimum alpha of a pixel that shows matter
VISIBLE_ALPHA = 0.5


def finer(draw: Draw, splats: Splats, camera: Camera, settings: Settings) -> np.ndarray:
    """float64 [TIMES·H, TIMES·W, 4]: the image at more samples a pixel, with the original pixels' antialiasing.

    A ray offset from a pixel's centre equals a ray through the centre of an oppositely sheared scene: the image is
    drawn TIMES² times, with the scene sheared by fractions of a pixel.
    """
    width, height = camera.size
    fine = np.zeros((height, TIMES, width, TIMES, 4))
    offsets = (np.arange(TIMES) + 0.5) / TIMES - 0.5
    for j, down in enumerate(offsets):
        for i, across in enumerate(offsets):
            sheared, view = _shear(splats, camera, across, down)
            fine[:, j, :, i] = draw(sheared, view, settings).pixels
    return fine.reshape(height * TIMES, width * TIMES, 4)


def _shear(splats: Splats, camera: Camera, across: float, down: float) -> tuple[Splats, Camera]:
    """Splats and camera sheared so that pixel centres show points offset by `across` and `down` pixels."""
    pitch = camera.extent / camera.size[1]
    offset = np.array([across, down]) * pitch
    if not camera.perspective:
        return splats, replace(camera, eye=camera.eye + offset @ camera.eye_from_world[:2])
    shear = np.eye(3)
    shear[:2, 2] = -offset
    slant = camera.eye_from_world.T @ shear @ camera.eye_from_world
    grid = splats.grid
    slanted = Grid(slant @ grid.world_from_index, slant @ (grid.origin - camera.eye) + camera.eye)
    return splats.in_cells(grid=slanted), camera


@dataclass(frozen=True, eq=False)
class Reach:
    """Pixels that show matter beyond z_k. depth [H, W]: of visible matter, world units, infinite for none; z_k:
    depth at which a voxel is a pixel wide.
    """

    depth: np.ndarray
    z_k: float

    @classmethod
    def of(cls, draw: Draw, splats: Splats, camera: Camera) -> Reach:
        """Reach of an image with depth as its colour."""
        depth = camera.eye_from_points(world(splats))[:, 2]
        far = float(np.abs(depth).max(initial=0.0)) or 1.0
        records = as_points(splats.records)
        records["color"] = (depth / far)[:, None]
        records["normal"] = 0
        painted = splats.in_cells(records=records)
        # no antialiasing, so that near and far do not mix
        pixels = draw(painted, camera, Settings(antialias="off", shading="off")).pixels.astype(np.float64)
        visible = pixels[..., 3] > VISIBLE_ALPHA
        depths = np.where(visible, pixels[..., 0] / np.where(visible, pixels[..., 3], 1.0) * far, np.inf)
        return cls(depths, camera.z_k(splats.grid.smallest_spacing))

    @property
    def beyond(self) -> np.ndarray:
        """Pixels that show matter beyond z_k, bool [H, W]."""
        return np.asarray((self.depth >= self.z_k) & (self.depth < np.inf))

    @property
    def before(self) -> np.ndarray:
        """Pixels that show matter before z_k, bool [H, W]."""
        return np.asarray(self.depth < self.z_k)

    def line(self, times: int = 1) -> np.ndarray:
        """Line where visible matter crosses z_k, bool [times·H, times·W]: a sample wide, smoothed over voxel steps."""
        large = [np.kron(part, np.ones((times, times))) for part in (self.before, self.beyond)]
        before, beyond = (soft(part.astype(np.float64), LINE * times) for part in large)
        nearer = before > beyond
        edge = np.pad(nearer, 1, mode="edge")
        beside = edge[:-2, 1:-1] | edge[2:, 1:-1] | edge[1:-1, :-2] | edge[1:-1, 2:]
        return np.asarray(beside & ~nearer & (beyond > LINE_SEEN))

    def window(self) -> np.ndarray:
        """float64 [TIMES·H, TIMES·W]: 1 well beyond z_k, 0 elsewhere, with a smooth transition."""
        inner = soft(self.beyond.astype(np.float64), SOFT) > 0.98
        return soft(np.kron(inner.astype(np.float64), np.ones((TIMES, TIMES))), SOFT * TIMES)


def world(splats: Splats) -> np.ndarray:
    """World positions of splats, [N, 3]."""
    places = splats.positions.astype(np.float64) @ splats.grid.world_from_index.T
    return np.asarray(places + splats.grid.origin)


def share_beyond(splats: Splats, camera: Camera) -> float:
    """Fraction of the splats beyond z_k."""
    depth = camera.eye_from_points(world(splats))[:, 2]
    return float((depth >= camera.z_k(splats.grid.smallest_spacing)).mean()) if len(splats) else 0.0


def aliasing_energy(fine: np.ndarray, window: np.ndarray) -> float:
    """Mean square, over the window, of the colours' content above half a cycle a pixel along either axis.

    fine [TIMES·H, TIMES·W, 4]: `finer`; window: `Reach.window`. Per sample and channel, linear light.
    """
    total = float((window * window).sum())
    if not total > 0:
        return 0.0
    down, across = (np.abs(np.fft.fftfreq(n)) * TIMES for n in window.shape)
    fast = np.maximum(down[:, None], across[None]) > 0.5
    energy = 0.0
    for channel in range(3):
        values = fine[..., channel]
        mean = float((values * window).sum() / window.sum())
        spectrum = np.fft.fft2((values - mean) * window)
        energy += float((np.abs(spectrum[fast]) ** 2).sum())
    return energy / window.size / total / 3


def noise_ratio(splats: Splats, camera: Camera, name: str) -> float:
    """Ratio of aliasing energy with and without antialiasing, for randomly coloured splats, from the kernel's spectrum.

    Beyond z_k a footprint is m = z_v/z_k times as wide as its splat: its spectrum is m times narrower.
    For m close to 1 the kernel's energy above half a cycle a pixel remains.
    For equal voxels at the splats' depths; X-ray blending.
    """
    shape = kernel(name)
    across = np.linspace(0.0, shape.radius, POINTS)
    line = line_area(shape, across)
    cycles = np.linspace(0.0, FASTEST, POINTS)
    # projection-slice theorem: a slice of the 2-D spectrum is the spectrum of the line areas
    spectrum = np.trapezoid(line * np.cos(2 * np.pi * cycles[:, None] * across), across, axis=1)
    place = np.linspace(-FASTEST, FASTEST, POINTS)
    radius = np.hypot(place[:, None], place)
    fast = np.maximum(np.abs(place[:, None]), np.abs(place)) > 0.5

    depth = camera.eye_from_points(world(splats))[:, 2] / camera.z_k(splats.grid.smallest_spacing)
    count, edges = np.histogram(depth, DEPTHS, (1.0, max(float(depth.max(initial=1.0)), 1 + 1e-3)))
    if not count.any():
        return 1.0
    wide = (edges[1:] + edges[:-1]) / 2
    left = np.array([(np.interp(radius / m, cycles, spectrum)[fast] ** 2).sum() for m in (1.0, *wide)])
    # a voxel covers 1/m² pixels, both without and with antialiasing
    weight = count / wide**4
    return float(weight @ left[1:] / weight.sum() / left[0])


def mean_square(image: Image | np.ndarray, right: Image | np.ndarray, where: np.ndarray) -> float:
    """Mean squared difference of the colours over the pixels `where`, linear premultiplied."""
    first, second = (p.pixels if isinstance(p, Image) else p for p in (image, right))
    return float(((first - second)[where][..., :3] ** 2).mean()) if where.any() else 0.0


def soft(shape: np.ndarray, sigma: float) -> np.ndarray:
    """Gaussian blur; pixels outside of the image count as 0."""
    margin = int(np.ceil(4 * sigma))
    wide = np.pad(shape, margin)
    down, across = np.fft.fftfreq(wide.shape[0])[:, None], np.fft.rfftfreq(wide.shape[1])
    blur = np.exp(-2 * (np.pi * sigma) ** 2 * (down**2 + across**2))
    soft = np.fft.irfft2(np.fft.rfft2(wide) * blur, wide.shape)
    return np.asarray(np.clip(soft[margin:-margin, margin:-margin], 0.0, 1.0))


def differing_before(draw: Draw, splats: Splats, camera: Camera, settings: Settings) -> tuple[int, int]:
    """(changed, total) number of pixels that show nothing beyond z_k; changed: by antialiasing."""
    z_k = camera.z_k(splats.grid.smallest_spacing)
    beyond = camera.eye_from_points(world(splats))[:, 2] >= z_k
    reached = draw(splats.part(beyond), camera, settings.replace(antialias="paper", blend="xray")).pixels[..., 3] > 0
    off, on = (draw(splats, camera, settings.replace(antialias=name)).pixels for name in ("off", "paper"))
    changed = (off != on).any(axis=-1) & ~reached
    return int(changed.sum()), int((~reached).sum())


# degrees between the two frames compared for popping
CLOSE = 0.01
# search step for changes of the drawing order over a rotation, degrees, and number of bisections
SEARCH, HALVINGS = 1.0, 14


def strip(draw: Draw, splats: Splats, cameras: Iterable[Camera], settings: Settings) -> np.ndarray:
    """float64 [H/2, frames, 4]: the upper half of each frame's middle column, side by side.

    Only two columns are rendered; they match the middle ones of any wider image.
    """
    columns = []
    for camera in cameras:
        narrow = replace(camera, size=(2, camera.size[1]))
        columns.append(draw(splats, narrow, settings).pixels[: camera.size[1] // 2, 1].astype(np.float64))
    return np.stack(columns, axis=1)


def flicker(frames: np.ndarray) -> float:
    """Variance of the colour differences between consecutive frames [rows, frames, 4]."""
    return float(np.diff(frames[..., :3], axis=1).var())


@dataclass(frozen=True)
class Pop:
    """A change of the drawing order. angle: rotation in degrees. change: largest pixel difference between two
    frames 0.01° apart around it; usual: the same 0.1° before, without a change.
    """

    angle: float
    change: float
    usual: float


def popping(
    draw: Draw, splats: Splats, camera: Callable[[float], Camera], settings: Settings, turn: float = 360.0
) -> list[Pop]:
    """All changes of the slicing axis as a camera rotates by that many degrees."""
    pops = []
    last = order_for(splats, camera(0.0)).axis
    for step in range(round(turn / SEARCH)):
        low, high = step * SEARCH, (step + 1) * SEARCH
        axis = order_for(splats, camera(high)).axis
        if axis == last:
            continue
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            if order_for(splats, camera(middle)).axis == last:
                low = middle
            else:
                high = middle
        angle = (low + high) / 2
        changes = [_change(draw, splats, camera, settings, at) for at in (angle, angle - 10 * CLOSE)]
        pops.append(Pop(angle, *changes))
        last = axis
    return pops


def _change(draw: Draw, splats: Splats, camera: Callable[[float], Camera], settings: Settings, at: float) -> float:
    first, second = (draw(splats, camera(at + side * CLOSE / 2), settings).pixels for side in (-1, 1))
    return float(np.abs(second - first).max())

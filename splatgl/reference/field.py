"""The volume rendering integral in float64: of the field of values, classified then, and of the kernels' field.

Extinction σ(x) = Σ σ_i h and σ c(x) = Σ σ_i c_i h are summed at points along each ray, so that overlapping kernels mix
before they occlude: the difference from `reference.render` is the error of splatting itself.

The field is the kernels' normalised sum, trilinear interpolation, or a formula, of all samples, not only of those that
extraction keeps. Its difference from a picture by sheets is the error of sheets.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, cast

import numpy as np

from splatgl.data.image import Image
from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.geometry.camera import Camera
from splatgl.geometry.clipping import FACE, Clip
from splatgl.geometry.grid import Grid, dilate, trilinear
from splatgl.geometry.mask_field import MaskField
from splatgl.geometry.view import GridView
from splatgl.planning.ambient_occlusion import LightVolume
from splatgl.planning.culling import clip_behind_eye
from splatgl.planning.resolve import Resolved, kernel_name, select_splats
from splatgl.reference.blend import classify_values, join_attenuated, join_values, joined_value, over_background
from splatgl.reference.rays import Rays, box_ends, index_rays, pixel_slopes
from splatgl.reference.sheets import weight_extinction
from splatgl.splat.extract_values import field_slopes, gradients, select_needed, with_slopes
from splatgl.splat.kernels import Kernel
from splatgl.splat.kernels import kernel as kernel_named
from splatgl.splat.lighting import LIGHTS, Light, apply_light, surface_light
from splatgl.splat.prefilter import prefilter
from splatgl.splat.settings import Blend, Settings
from splatgl.splat.splats import Splats
from splatgl.transfer.preintegration import ClassIntegral, ValueClassifier, surface_levels
from splatgl.transfer.regions import mean_matter
from splatgl.transfer.transfer import Transfer

# maximum number of cells in the lookup table of the splats' box, 4 bytes each
MAX_CELLS = 1 << 27
# neighbours along each axis: both kernels reach at most 2 cells
NEIGHBOURS = np.arange(-1, 3)
# rays and points per batch: the 64 neighbours of each point stay in the cache
KERNEL_RAYS, KERNEL_POINTS = 1 << 16, 1 << 11
# maximum leap through empty space, cells
LEAP = 12
# settings for splats that are classified before reconstruction
BEFORE: dict[str, Any] = {"classification": "pre", "compositing": "splats"}
# opaque optical depth: exp(−40) is below float64's rounding of 1
OPAQUE = 40.0


@dataclass(frozen=True, eq=False)
class KernelField:
    """Splats on their lattice. cell int32 [X+4, Y+4, Z+4]: index of the splat there, or of the last, empty entry.

    low [3]: the cell of entry (2, 2, 2). depth [N+1]: extinction · s̄; emitted [N+1, 3]: extinction · s̄ · colour.
    free uint8 [X+4, Y+4, Z+4]: distance in cells to a cell whose neighbours contain a splat, at most LEAP.
    """

    kernel: Kernel
    cell: np.ndarray
    low: np.ndarray
    depth: np.ndarray
    emitted: np.ndarray
    free: np.ndarray

    @classmethod
    def of(cls, splats: Splats, kernel: Kernel, color: np.ndarray) -> KernelField:
        """Builds the field. InputError for splats off a lattice."""
        places = splats.positions.astype(np.float64)
        cells = np.rint(places).astype(np.int64)
        low, high = splats.index_bounds.astype(np.int64)
        shape = high - low + 5
        if shape.prod() > MAX_CELLS:
            raise expected("splats", f"a box of at most {MAX_CELLS} cells", int(shape.prod()), "use a smaller volume")
        table = np.full(shape, len(places), np.int32)
        entries = tuple((cells - low + 2).T)
        table[entries] = np.arange(len(places))
        if (cells != places).any() or np.count_nonzero(table < len(places)) < len(places):
            raise expected("splats", "at most one at each point of a lattice", "others", "use an extracted volume")
        depth = np.append(splats.records["optical_depth"].astype(np.float64), 0.0)
        emitted = depth[:, None] * np.concatenate([color, np.zeros((1, 3))])
        return cls(kernel, table, low, depth, emitted, distances(_within_reach(table < len(places))))

    def cells(self, places: np.ndarray) -> np.ndarray:
        """[3, P]: table indices of grid positions [3, P], rounded down."""
        entries = np.floor(places).astype(np.int64) - (self.low - 2)[:, None]
        return np.clip(entries, 0, np.array(self.cell.shape)[:, None] - 1)

    def at(self, places: np.ndarray) -> np.ndarray:
        """[P, 4]: σ s̄ c and σ s̄ at grid positions [3, P]."""
        total = np.empty((places.shape[1], 4))
        for first in range(0, len(total), KERNEL_POINTS):
            some = slice(first, first + KERNEL_POINTS)
            total[some] = self._sums(places[:, some])
        return total

    def _sums(self, places: np.ndarray) -> np.ndarray:
        count = places.shape[1]
        flat, squares = np.zeros((count, 1), np.int64), []
        for place, size, low in zip(places, self.cell.shape, self.low, strict=True):
            first = np.floor(place)
            cell = np.clip((first - low + 2).astype(np.int64)[:, None] + NEIGHBOURS, 0, size - 1)
            flat = (flat[:, :, None] * size + cell[:, None, :]).reshape(count, -1)
            squares.append((((place - first)[:, None] - NEIGHBOURS) ** 2).ravel())
        entries = self.cell.ravel()[flat.ravel()]
        held = np.flatnonzero(entries < len(self.depth) - 1)
        point, x, y, z = held >> 6, (held >> 4) & 3, (held >> 2) & 3, held & 3
        square = squares[0][4 * point + x] + squares[1][4 * point + y] + squares[2][4 * point + z]
        near = np.flatnonzero(square < self.kernel.radius**2)
        point, splat, weight = point[near], entries[held[near]], self.kernel.value(np.sqrt(square[near]))
        terms = (*self.emitted.T, self.depth)
        return np.stack([np.bincount(point, weight * term[splat], count) for term in terms], axis=-1)


def distances(near: np.ndarray) -> np.ndarray:
    """uint8: Chebyshev distance in cells to the nearest True cell of `near`, at most LEAP."""
    free = np.where(near, 0, LEAP).astype(np.uint8)
    for away in range(1, LEAP):
        wider = dilate(near)
        free[wider & ~near] = away
        near = wider
    return free


def _within_reach(held: np.ndarray) -> np.ndarray:
    """bool: cells whose NEIGHBOURS contain an occupied cell."""
    for axis in range(held.ndim):
        near = dilate(held, (axis,))
        np.moveaxis(near, axis, 0)[:-2] |= np.moveaxis(held, axis, 0)[2:]
        held = near
    return held


def ray_integral(
    splats: Splats, camera: Camera, settings: Settings | None = None, steps_per_voxel: int = 8, samples: int = 1
) -> Image:
    """The composite image of the reconstructed field, float64 [H, W, 4], without antialiasing.

    Midpoint rule in slabs of 1/steps_per_voxel of a grid step; its error is proportional to their square.
    samples × samples rays a pixel. Kernel, shading and background are the settings'. A slab near splats
    costs 1 to 5 µs, empty or occluded ones almost nothing. Raises InputError for other blend modes and splats off
    their lattice.
    """
    started = time.perf_counter()
    settings = (settings or Settings()).but(**BEFORE)
    splats = select_splats(splats, settings, moving=False)
    pixels = np.arange(camera.size[0] * camera.size[1])
    drawn = ray_integral_at(splats, camera, pixels, settings, steps_per_voxel, samples)
    seconds = round(time.perf_counter() - started, 6)
    name = kernel_name(splats, settings)
    info = {"scene": splats.name, "kernel": name, "steps_per_voxel": steps_per_voxel, "samples": samples}
    metadata = {**info, "blend": "composite", "renderer": "float64 ray integral", "seconds": seconds}
    return Image(drawn.reshape(camera.size[1], camera.size[0], 4), metadata)


def ray_integral_at(
    splats: Splats,
    camera: Camera,
    pixels: np.ndarray,
    settings: Settings | None = None,
    steps_per_voxel: int = 8,
    samples: int = 1,
) -> np.ndarray:
    """float64 [P, 4]: pixels [P] of `ray_integral`, numbered row by row from the top."""
    settings = (settings or Settings()).but(**BEFORE)
    settings.require_composite("ray integral")
    check_counts(steps_per_voxel, samples)
    fine = camera.resized((camera.size[0] * samples, camera.size[1] * samples))
    splats = clip_behind_eye(select_splats(splats, settings, moving=False), camera)
    view = GridView.of(splats.grid, fine, kernel_named(kernel_name(splats, settings)), antialias=False)
    voxel = view.voxels(splats.positions)
    resolved = Resolved.of(splats, camera, settings)
    color = apply_light(splats.colors.astype(np.float64), splats, camera, voxel, resolved)
    field = KernelField.of(splats, view.kernel, color)
    rays = samples_of(pixels, camera.size[0], samples)
    groups = np.split(rays, range(KERNEL_RAYS, len(rays), KERNEL_RAYS))
    drawn = np.concatenate([_march_kernels(field, view, fine, group, steps_per_voxel) for group in groups])
    return over_background(drawn.reshape(len(pixels), -1, 4).mean(axis=1), resolved)


def check_counts(steps_per_voxel: int, samples: int) -> None:
    """Raises InputError for numbers of slabs and samples below 1."""
    for name, count in (("steps_per_voxel", steps_per_voxel), ("samples", samples)):
        if count < 1:
            raise expected(name, "a number of at least 1", count)


def samples_of(pixels: np.ndarray, width: int, samples: int) -> np.ndarray:
    """Indices of the samples × samples samples of pixels [P], pixel by pixel. width: of the picture, in pixels."""
    y, x = np.divmod(pixels, width)
    row, column = np.divmod(np.arange(samples**2), samples)
    return np.asarray(((y[:, None] * samples + row) * (width * samples) + x[:, None] * samples + column).ravel())


def _march_kernels(field: KernelField, view: GridView, camera: Camera, pixel: np.ndarray, steps: int) -> np.ndarray:
    """float64 [P, 4]: the integral along the rays of pixels, in slabs of equal length per ray."""
    start, direction, _ = index_rays(view, pixel_slopes(pixel, camera, view.pitch))
    near, far = _clip_to_box(field, start, direction, view)
    speed = np.sqrt((direction * direction).sum(axis=0))
    slabs = np.ceil(np.maximum(far - near, 0.0) * speed * steps).astype(np.int64)
    step = np.maximum(far - near, 0.0) / np.maximum(slabs, 1)
    # arc length of a slab in mean spacings, and its maximum extent along an axis in cells
    length = step * np.sqrt(((view.eye_from_index @ direction) ** 2).sum(axis=0))
    across = step * np.abs(direction).max(axis=0)
    # colour, then optical depth
    light = np.zeros((len(pixel), 4))
    slab = np.zeros(len(pixel), np.int64)
    on = np.flatnonzero(slabs)
    while len(on):
        places = start[:, on] + direction[:, on] * (near[on] + (slab[on] + 0.5) * step[on])
        free = field.free[tuple(field.cells(places))]
        some = np.flatnonzero(free == 0)
        _add(light, on[some], field.at(places[:, some]), length)
        # the next `free` cells are empty; the first of them may end immediately
        slab[on] += np.maximum(np.ceil((free.astype(np.int64) - 1) / across[on]), 1).astype(np.int64)
        on = on[(slab[on] < slabs[on]) & (light[on, 3] < OPAQUE)]
    light[:, 3] = -np.expm1(-light[:, 3])
    return light


def _add(light: np.ndarray, rays: np.ndarray, sums: np.ndarray, length: np.ndarray) -> None:
    """Adds a slab to the light of rays. sums: the field's, at its middle. Matter in front attenuates its emission."""
    full = np.flatnonzero(sums[:, 3] > 0)
    rays, sums = rays[full], sums[full]
    depth = sums[:, 3] * length[rays]
    passed = np.exp(-light[rays, 3]) * -np.expm1(-depth) / sums[:, 3]
    light[rays, :3] += passed[:, None] * sums[:, :3]
    light[rays, 3] += depth


def _clip_to_box(
    field: KernelField, start: np.ndarray, direction: np.ndarray, view: GridView
) -> tuple[np.ndarray, np.ndarray]:
    """Entry and exit of each ray for the kernels' bounding box; orthographic rays extend both ways."""
    radius = field.kernel.radius
    low = field.low[:, None] - radius
    high = field.low[:, None] + np.array(field.cell.shape)[:, None] - 5 + radius
    first, last = box_ends(start, direction, low, high)
    first = np.maximum(first, 0.0) if view.perspective else first
    missed = ~(last > first)
    return np.where(missed, 0.0, first), np.where(missed, 0.0, last)


# rays and points per batch
RAYS, POINTS = 1 << 14, 1 << 10
# reach of a point's neighbourhood, in voxels
REACH = 2
# steps per voxel through the field of kept values
STEPS = 4
# share of a step up to which its crossing belongs to it; 1: it has none
BEFORE_END = 1 - 1e-12

# value [P] and world gradient [P, 3] at grid positions [3, P]
Field = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def kernel_field(volume: Volume, shape: Kernel, post: ValueClassifier) -> Field:
    """The kernels' normalised sums of coefficients and gradients of all finite samples; NaN beyond their reach."""
    u = _values(volume, post)
    c = prefilter(u, shape)
    terms = _terms(volume, u, c, post, kernel=shape)

    return partial(_kernel_mean, shape, post, partial(_look_up_terms, terms))


def _kernel_mean(
    shape: Kernel, post: ValueClassifier, taken: Callable[[np.ndarray], np.ndarray], places: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Value and gradient at places [3, P]; taken: returns 1, coefficient and world gradient [16, P, 5] of cells."""
    sums = np.zeros((places.shape[1], 5))
    first = np.floor(places).astype(np.int64)
    # a plane of 16 of the 64 cells at a time
    for plane in range(4):
        cell = first[:, None] + np.array([(plane - 1, j - 1, k - 1) for j, k in np.ndindex(4, 4)]).T[..., None]
        weight = shape.value(np.linalg.norm(places[:, None] - cell, axis=0))
        sums += np.einsum("cp,cpn->pn", weight, taken(cell))
    mean = sums[:, 1:] / np.where(sums[:, :1] > 0, sums[:, :1], 1.0)
    return np.where(sums[:, 0] > 0, post.value(mean[:, 0]), np.nan), mean[:, 1:] * post.span


def trilinear_field(volume: Volume, post: ValueClassifier) -> Field:
    """Trilinear interpolation of samples and of their central differences, as in ray casters."""
    u = _values(volume, post)
    terms = _terms(volume, u, u, post)[REACH:-REACH, REACH:-REACH, REACH:-REACH]

    def at(places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        sums = trilinear(terms, places.T)
        return post.value(sums[:, 1]), sums[:, 2:] * post.span

    return at


def _values(volume: Volume, post: ValueClassifier) -> np.ndarray:
    """Record values of all samples; NaN where one is not finite."""
    samples = np.asarray(volume.samples)
    return post.relative(np.where(np.isfinite(samples), samples, np.nan))


def _terms(
    volume: Volume, u: np.ndarray, c: np.ndarray, post: ValueClassifier, kernel: Kernel | None = None
) -> np.ndarray:
    """[D + 4, H + 4, W + 4, 5]: 1, coefficient and world gradient of each sample; 0 beyond, and where not finite.
    kernel: None: gradients are central differences.
    """
    z, y, x = (index.ravel() for index in np.indices(u.shape))
    world = np.linalg.inv(volume.world_from_index)
    around = post.around if post.faced and kernel else None
    gradient = gradients(u, x, y, z, 4 if kernel else 2, around) @ world
    if kernel and not post.faced:
        gradient = with_slopes(gradient, field_slopes(u, kernel, world).ravel())
    terms = np.column_stack([np.ones(u.size), c.ravel(), gradient])
    terms = np.where(np.isfinite(u).ravel()[:, None], terms, 0.0).reshape(*u.shape, 5)
    return np.pad(terms, ((REACH, REACH),) * 3 + ((0, 0),))


def _look_up_terms(terms: np.ndarray, cell: np.ndarray) -> np.ndarray:
    """The terms […, 5] of cells [3, …] (x, y, z)."""
    x, y, z = (np.clip(index + REACH, 0, size - 1) for index, size in zip(cell, terms.shape[2::-1], strict=True))
    return np.asarray(terms[z, y, x])


@dataclass(frozen=True, eq=False)
class Marched:
    """A field and its appearance. free uint8 [D, H, W]: distance in voxels to a voxel that opaque points need, at most
    LEAP. spacing: mean spacing, unit: reference length of opacities, both in world units. span: range of values over
    which the transfer function varies. classified: integral of the transfer function, to classify a step by all values
    that it passes, so that no spike is missed; None: by the value in its middle. mip_attenuation: per `unit`. surfaces:
    values and matter of iso-surfaces; iso_lit: whether they are lit.
    """

    field: Field
    transfer: Transfer
    free: np.ndarray
    spacing: float
    unit: float
    light_by: Light | None
    shines: np.ndarray | None = None
    cues: LightVolume | None = None
    shading: bool = True
    mask: MaskField | None = None
    span: float = 1.0
    classified: ClassIntegral | None = None
    mip_attenuation: float = 0.0
    surfaces: tuple[np.ndarray, np.ndarray] = (np.zeros(0), np.zeros((0, 4)))
    iso_lit: bool = True

    def kept(self, places: np.ndarray) -> np.ndarray:
        """bool [P]: whether the mask keeps grid positions [3, P]."""
        return np.ones(places.shape[1], bool) if self.mask is None else self.mask.at(places) >= 0

    def classes(self, places: np.ndarray, half: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """[P, 4], [P, 3]: colour and extinction per mean spacing, and gradients, of steps around grid positions [3, P].
        half [3, P]: offset from there to a step's ends.
        """
        if self.classified is None:
            value, gradient = self.field(places)
            opacity, color = self.transfer.classify(value, np.linalg.norm(gradient, axis=1))
            extinction = self.transfer.extinction(opacity, self.unit)
            return np.column_stack([color, extinction * self.spacing]), gradient
        middle, gradient = self.field(places)
        known, matter, regions = np.isfinite(middle), np.zeros((len(middle), 4)), np.zeros((len(middle), 4))
        size = np.linalg.norm(gradient, axis=1)
        center = np.where(known, middle, 0.0)
        for end in (places - half, places + half):
            value, slope = self.field(end)
            # beyond the field, the value in the middle
            value = np.where(known & np.isfinite(value), value, center)
            matter += self.classified.mean(center, value) / 2
            ends = np.stack([center, size]), np.stack([value, np.linalg.norm(slope, axis=1)])
            regions += mean_matter(self.transfer.regions, *ends) / 2
        scale = weight_extinction(matter[:, 3], self.transfer.weight(size)) / np.where(
            matter[:, 3] > 0, matter[:, 3], 1
        )
        matter = (matter * scale[:, None] + regions) * known[:, None]
        color = matter[:, :3] / np.where(matter[:, 3:] > 0, matter[:, 3:], 1.0)
        return np.column_stack([color, matter[:, 3] * (self.spacing / self.unit)]), gradient

    def light(self, places: np.ndarray, half: np.ndarray, toward: np.ndarray, face: np.ndarray | None) -> np.ndarray:
        """[P, 4]: shaded colour, and extinction per mean spacing, of steps around grid positions [3, P]. half [3, P]:
        offset to their ends; toward [P, 3]: rays, world axes. face [P, 3]: normals that replace the field's unless 0.
        """
        result = np.empty((places.shape[1], 4))
        for first in range(0, len(result), POINTS):
            some = slice(first, first + POINTS)
            result[some], gradient = self.classes(places[:, some], half[:, some])
            result[some] *= self.kept(places[:, some])[:, None]
            if self.light_by is not None:
                if face is not None:
                    cut = face[some]
                    gradient = np.where((cut != 0).any(axis=1, keepdims=True), cut, gradient)
                factor, highlight = self._shade(places[:, some], gradient * self.shading, toward[some])
                if self.mask is not None and self.shading:
                    normal = self.mask.normals(places[:, some])
                    share = self.mask.face_share(gradient * (self.spacing / self.span), normal, self.span)
                    on_face = self._shade(places[:, some], normal, toward[some])
                    factor, highlight = (
                        a * (1 - share) + b * share for a, b in zip((factor, highlight), on_face, strict=True)
                    )
                result[some, :3] = result[some, :3] * factor[:, None] + highlight[:, None]
        return result

    def crossed(
        self, places: np.ndarray, half: np.ndarray, toward: np.ndarray
    ) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yields the shares [P] of steps around grid positions [3, P] before an iso-surface, ascending and 1 if there
        is none, and the light [P, 4] of the surface: emission and optical depth. half, toward: as of `light`.
        """
        values, matter = self.surfaces
        ends = [self.field(places + side * half)[0] for side in ((-1.0, 1.0) if len(values) else ())]
        share = np.ones((len(values), places.shape[1]))
        for number, value in enumerate(values):
            is_crossed = (ends[0] > value) != (ends[1] > value)
            is_crossed &= np.isfinite(ends[0]) & np.isfinite(ends[1])
            rise = np.where(is_crossed, ends[1] - ends[0], 1.0)
            share[number] = np.where(is_crossed, np.clip((value - ends[0]) / rise, 0.0, BEFORE_END), 1.0)
        for number in np.argsort(share, axis=0):
            part = np.take_along_axis(share, number[None], axis=0)[0]
            light, some = np.zeros((len(part), 4)), np.flatnonzero(part < 1)
            at = places[:, some] + half[:, some] * (2 * part[some] - 1)
            light[some] = matter[number[some]] * self.kept(at)[:, None]
            if self.light_by is not None:
                factor, highlight = self._shade(at, self.field(at)[1] * self.iso_lit, toward[some])
                light[some, :3] = light[some, :3] * factor[:, None] + light[some, 3:] * highlight[:, None]
            yield part, light

    def _shade(self, places: np.ndarray, normal: np.ndarray, toward: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Factors of colours [P] and highlights [P] of surfaces with normals [P, 3]."""
        assert self.light_by is not None
        reached = self.cues.light_shares(places.T, normal, toward) if self.cues else None
        return surface_light(normal, toward, self.light_by, self.shines, reached)


# the picture of rays of a field, by so many steps a voxel
March = Callable[[Marched, Rays, int], np.ndarray]


@dataclass(frozen=True, eq=False)
class PixelRays:
    """samples × samples rays in each pixel of a picture, clipped to the box of `shape` voxels. camera: with one pixel
    for each ray.
    """

    view: GridView
    camera: Camera
    samples: int
    shape: tuple[int, int, int]
    clip: Clip | None = None

    @classmethod
    def of(
        cls, grid: Grid, camera: Camera, samples: int, shape: tuple[int, int, int], clip: Clip | None = None
    ) -> PixelRays:
        """The rays of a camera's picture, without further antialiasing."""
        fine = camera.resized((camera.size[0] * samples, camera.size[1] * samples))
        return cls(GridView.of(grid, fine, kernel_named("b-spline"), antialias=False), fine, samples, shape, clip)

    def means(self, marched: Marched, pixels: np.ndarray, steps: int, settings: Settings) -> np.ndarray:
        """float64 [P, 4]: means over pixels [P], numbered row by row from the top."""
        rays = samples_of(pixels, self.camera.size[0] // self.samples, self.samples)
        one, several = partial(_one_value, settings.join), partial(_march, settings.is_sum)
        march: March = one if settings.shows_value else several
        march = _attenuated_maximum if settings.join == "attenuated" else march
        groups = np.split(rays, range(RAYS, len(rays), RAYS))
        cut = [Rays.of(self.view, self.camera, self.shape, group, self.clip) for group in groups]
        drawn = [march(marched, rays, steps) for rays in cut]
        return np.asarray(np.concatenate(drawn).reshape(len(pixels), -1, 4).mean(axis=1))


def field_integral(
    volume: Volume,
    transfer: Transfer,
    camera: Camera,
    field: Field | str = "b-spline",
    steps_per_voxel: int = 8,
    samples: int = 1,
    blend: str | Settings = "composite",
) -> Image:
    """Picture of a field, float64 [H, W, 4], without antialiasing.

    field: "trilinear", a kernel's name, or a function from grid positions [3, P] to values [P] and world gradients
    [P, 3]. Midpoint rule, steps of 1/steps_per_voxel in index space; samples × samples rays a
    pixel. Rays are clipped to the volume's box. Composites are shaded as the transfer function says. blend: a name, or
    settings, of which only it and mip_attenuation count. Raises InputError for numbers below 1 and unknown blends.
    """
    started = time.perf_counter()
    check_counts(steps_per_voxel, samples)
    look = blend if isinstance(blend, Settings) else Settings(blend=cast(Blend, blend))
    name = field if isinstance(field, str) else "formula"
    shape = kernel_named("b-spline" if name in ("trilinear", "formula") else name)
    post = ValueClassifier.of(transfer, shape.name, volume.shape[::-1])
    if isinstance(field, str):
        field = trilinear_field(volume, post) if name == "trilinear" else kernel_field(volume, shape, post)
    grid = Grid.of(volume)
    free = np.zeros(volume.shape, np.uint8)
    if name != "formula":
        free = distances(dilate(select_needed(_values(volume, post), 2, post.wanted)[0]))
    shading = transfer.shading and look.hides
    gaps = np.argwhere(~np.isfinite(np.asarray(volume.samples)))[:, ::-1]
    marched = Marched(
        field,
        transfer,
        free,
        grid.mean_spacing,
        transfer.length(volume),
        LIGHTS["head"] if shading else None,
        mask=MaskField.with_gaps(volume, gaps),
        span=post.span,
        mip_attenuation=look.mip_attenuation,
        surfaces=(surface_levels(transfer, post.span), transfer.surface_matter()),
    )
    width, height = camera.size
    rays = PixelRays.of(grid, camera, samples, post.shape)
    drawn = rays.means(marched, np.arange(width * height), steps_per_voxel, look)
    picture = drawn.reshape(height, width, 4)
    seconds = round(time.perf_counter() - started, 6)
    info = {"scene": volume.name, "field": name, "steps_per_voxel": steps_per_voxel, "samples": samples}
    return Image(picture, {**info, "blend": look.blend, "renderer": "float64 field integral", "seconds": seconds})


def kept_field_integral(
    splats: Splats, camera: Camera, pixels: np.ndarray, samples: int = 1, settings: Settings | None = None
) -> np.ndarray:
    """float64 [P, 4]: `field_integral` of the values that extraction kept, at pixels [P], row by row from the top.

    Blend, shading and background are the settings'.
    """
    settings = settings or Settings()
    post, records = splats.post, splats.records
    assert post is not None
    x, y, z = np.rint(records["position"]).astype(np.int64).T
    occupied = np.zeros(post.shape[::-1], bool)
    occupied[z, y, x] = True
    # the entry after the last stands for dropped voxels
    entry = np.full(tuple(size + 2 * REACH for size in occupied.shape), len(records), np.int32)
    entry[z + REACH, y + REACH, x + REACH] = np.arange(len(records), dtype=np.int32)
    terms = np.column_stack([np.ones(len(records)), records["value"], records["gradient"] / splats.grid.mean_spacing])
    terms = np.concatenate([terms, np.zeros((1, 5))])
    field = partial(_kernel_mean, kernel_named(post.kernel), post, lambda cell: terms[_look_up_terms(entry, cell)])
    free = distances(dilate(occupied))
    resolved = Resolved.of(clip_behind_eye(splats, camera), camera, settings)
    look, cues = resolved.look, resolved.cues
    marched = Marched(
        field,
        post.transfer,
        free,
        splats.grid.mean_spacing,
        splats.unit,
        look.light if look.shading or look.iso == "lit" or cues else None,
        look.light.within(camera),
        cues,
        look.shading,
        resolved.mask,
        post.span,
        post.integral,
        settings.mip_attenuation,
        (surface_levels(post.transfer, post.span), post.surfaces[1]),
        iso_lit=look.iso == "lit",
    )
    rays = PixelRays.of(splats.grid, camera, samples, post.shape, resolved.clip)
    drawn = rays.means(marched, pixels, STEPS, settings)
    return over_background(drawn, resolved)


def _steps(rays: Rays, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """The number of slabs of each ray, and their thickness in index space."""
    slabs = np.ceil((rays.far - rays.near) * steps).astype(np.int64)
    return slabs, (rays.far - rays.near) / np.maximum(slabs, 1)


def _all_slabs(slabs: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
    """Yields the number of a slab and at most POINTS rays that have it, slab by slab."""
    for slab in range(slabs.max(initial=0)):
        on = np.flatnonzero(slab < slabs)
        yield from ((slab, some) for some in np.split(on, range(POINTS, len(on), POINTS)))


def _one_value(join: str, marched: Marched, rays: Rays, steps: int) -> np.ndarray:
    """float64 [P, 4]: the classified maxima, minima or means of rays; 0 for rays without a finite value."""
    slabs, step = _steps(rays, steps)
    light = np.zeros((len(slabs), 4))
    for slab, some in _all_slabs(slabs):
        places = rays.start[:, some] + rays.direction[:, some] * (rays.near[some] + (slab + 0.5) * step[some])
        value, _ = marched.field(places)
        length = np.where(np.isfinite(value) & marched.kept(places), step[some], 0.0)
        light[some] = join_values(light[some], np.nan_to_num(value), length, join)
    return classify_values(marched.transfer, joined_value(light, join))


def _attenuated_maximum(marched: Marched, rays: Rays, steps: int) -> np.ndarray:
    """float64 [P, 4]: the classified attenuated maxima of rays; 0 for rays without a finite value."""
    slabs, step = _steps(rays, steps)
    light = np.zeros((len(slabs), 4))
    low, high = marched.transfer.color_range
    width = high - low or marched.span
    depth = marched.mip_attenuation * marched.spacing / marched.unit * step * rays.stretch
    for slab, some in _all_slabs(slabs):
        ends = rays.near[some] + (slab + np.array([[0.0], [0.5], [1.0]])) * step[some]
        places = rays.start[:, None, some] + rays.direction[:, None, some] * ends
        values = marched.field(places.reshape(3, -1))[0].reshape(3, -1)
        length = np.where(np.isfinite(values[1]) & marched.kept(places[:, 1]), step[some], 0.0)
        # beyond the field, the value in the middle
        shares = (np.nan_to_num(np.where(np.isfinite(values), values, values[1])) - low) / width
        light[some] = join_attenuated(light[some], np.clip(shares, 0.0, 1.0), length, depth[some])
    return classify_values(marched.transfer, low + width * joined_value(light, "attenuated"))


def _march(sums: bool, marched: Marched, rays: Rays, steps: int) -> np.ndarray:
    """float64 [P, 4]: the integrals along rays; sums: plain sums of extinction and of extinction times colour."""
    slabs, step = _steps(rays, steps)
    length = step * rays.stretch
    light, depth = np.zeros((len(slabs), 3)), np.zeros(len(slabs))
    slab, on = np.zeros(len(slabs), np.int64), np.flatnonzero(slabs)
    last = np.array(marched.free.shape[::-1])[:, None] - 1
    while len(on):
        places = rays.start[:, on] + rays.direction[:, on] * (rays.near[on] + (slab[on] + 0.5) * step[on])
        x, y, z = np.clip(np.rint(places), 0, last).astype(np.int64)
        free = marched.free[z, y, x]
        some = np.flatnonzero(free == 0)
        face = rays.face
        if face is not None:
            near = np.asarray((slab[on[some]] + 0.5) * step[on[some]] < FACE)
            face = np.where(near[:, None], face[on[some]], 0.0)
        half = rays.direction[:, on[some]] * (step[on[some]] / 2)
        matter = marched.light(places[:, some], half, rays.toward[on[some]], face)
        through, before = matter[:, 3] * length[on[some]], np.zeros(len(some))

        def add(color: np.ndarray, through: np.ndarray, some: np.ndarray) -> None:
            passed = through if sums else np.exp(-depth[some]) * -np.expm1(-through)
            light[some] += passed[:, None] * color
            depth[some] += through

        for share, surface in marched.crossed(places[:, some], half, rays.toward[on[some]]):
            add(matter[:, :3], through * (share - before), on[some])
            add(surface[:, :3] / np.where(surface[:, 3:] > 0, surface[:, 3:], 1.0), surface[:, 3], on[some])
            before = share
        add(matter[:, :3], through * (1 - before), on[some])
        slab[on] += np.maximum(np.ceil((free.astype(np.int64) - 1) / step[on]), 1).astype(np.int64)
        on = on[(slab[on] < slabs[on]) & (sums | (depth[on] < OPAQUE))]
    return np.column_stack([light, depth if sums else -np.expm1(-depth)])

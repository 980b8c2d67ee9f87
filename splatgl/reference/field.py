"""Pictures of fields in float64, by the walk along rays: of values, which are classified then, and of kernels.

Extinction σ(x) = Σ σ_i h and σ c(x) = Σ σ_i c_i h are summed at points along each ray, so that overlapping kernels mix
before they occlude: the difference from `reference.render` is the error of splatting itself.

The field of values is the kernels' normalised sum, trilinear interpolation, or a formula, of all samples, not only of
those that extraction keeps. Its difference from a picture by sheets is the error of sheets.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from splatgl.data.image import Image
from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.geometry.camera import Camera
from splatgl.geometry.clipping import FACE
from splatgl.geometry.grid import Grid, dilate, trilinear
from splatgl.geometry.mask_field import MaskField
from splatgl.geometry.view import GridView
from splatgl.planning.ambient_occlusion import LightVolume
from splatgl.planning.culling import clip_behind_eye
from splatgl.planning.resolve import Resolved, kernel_name, select_splats
from splatgl.reference.blend import classify_values, join_attenuated, join_values, joined_value, over_background
from splatgl.reference.march import CurrentExtreme, LatticeTerms, NearCells, SlabRays, walk
from splatgl.reference.rays import Bounds, Rays, pixel_slopes
from splatgl.reference.sheets import mean_classes, mix_light
from splatgl.splat.extract_values import field_slopes, gradients, select_needed, with_slopes
from splatgl.splat.kernels import Kernel
from splatgl.splat.kernels import kernel as kernel_named
from splatgl.splat.lighting import LIGHTS, LightModel, apply_light, surface_light
from splatgl.splat.prefilter import prefilter
from splatgl.splat.settings import Blend, Settings
from splatgl.splat.splats import Splats
from splatgl.transfer.preintegration import ValueClassifier, surface_levels
from splatgl.transfer.transfer import Transfer

# maximum number of cells in the box of splats, 4 bytes each
MAX_CELLS = 1 << 27
# settings for splats that are classified before reconstruction
BEFORE: dict[str, Any] = {"classification": "pre", "compositing": "splats"}
# opaque optical depth: exp(−40) is below float64's rounding of 1
OPAQUE = 40.0
# rays per batch
RAYS = 1 << 14
# steps per voxel through the field of kept values
STEPS = 4
# share of a step up to which its crossing belongs to it; 1: it has none
BEFORE_END = 1 - 1e-12

# value [P] and world gradient [P, 3] at grid positions [3, P]
Field = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


# colour and optical depth [S, P, 4] of the pieces, front to back, of slabs [P] of rays [P] with middles at depths [P]
Slabs = Callable[[SlabRays, np.ndarray, np.ndarray], np.ndarray]


def composite(matter: Slabs, rays: SlabRays, is_sum: bool) -> np.ndarray:
    """Light [P, 4]: the integrals along rays; is_sum: plain sums of extinction and of extinction times colour."""
    light = np.zeros((len(rays.far), 4))

    def visit(some: np.ndarray, ends: np.ndarray) -> np.ndarray:
        middle = ends[:-1] + 0.5
        slab, ray = np.nonzero((middle < rays.far[some]) & rays.cells.at(rays.places(middle, some)))
        if not len(ray):
            return np.ones(len(some), bool)
        parts = matter(rays, middle[slab, ray], some[ray])
        of_slabs = np.zeros((len(middle), len(parts), len(some), 4))
        of_slabs[slab, :, ray] = parts.swapaxes(0, 1)
        pieces = of_slabs.reshape(-1, len(some), 4)
        # optical depths before each piece, and after the last
        depth = np.cumsum(np.concatenate([light[None, some, 3], pieces[..., 3]]), axis=0)
        share = pieces[..., 3] if is_sum else np.exp(-depth[:-1]) * -np.expm1(-pieces[..., 3])
        colors = np.concatenate([light[None, some, :3], share[..., None] * pieces[..., :3]])
        light[some] = np.column_stack([np.cumsum(colors, axis=0)[-1], depth[-1]])
        return is_sum | (depth[-1] < OPAQUE)

    walk([rays], visit)
    light[:, 3] = light[:, 3] if is_sum else -np.expm1(-light[:, 3])
    return light


def join(matter: FieldMatter, rays: SlabRays, settings: Settings) -> np.ndarray:
    """Light [P, 4]: the classified maxima, also attenuated ones, minima or means of rays; 0 for those without a finite
    value.
    """
    count, transfer = len(rays.far), matter.post.transfer
    light, is_attenuated = np.zeros((count, 4)), settings.join == "attenuated"
    low, high = transfer.color_range
    width = high - low or matter.post.span
    depth = settings.mip_attenuation * matter.spacing / matter.unit * rays.length
    shares = np.array([0.0, 0.5, 1.0] if is_attenuated else [0.5])[:, None]

    def visit(some: np.ndarray, ends: np.ndarray) -> np.ndarray:
        for slab in ends[:-1]:
            at = rays.places(slab + shares, some)
            values = matter.field(at.reshape(3, -1))[0].reshape(len(shares), -1)
            middle = len(shares) // 2
            has = np.isfinite(values[middle]) & matter.kept(at[:, middle]) & (slab < rays.far[some])
            length = np.where(has, rays.thickness[some], 0.0)
            if is_attenuated:
                # beyond the field, the value in the middle
                part = (np.nan_to_num(np.where(np.isfinite(values), values, values[1])) - low) / width
                light[some] = join_attenuated(light[some], np.clip(part, 0.0, 1.0), length, depth[some])
            else:
                light[some] = join_values(light[some], np.nan_to_num(values[0]), length, settings.join)
        return np.ones(len(some), bool)

    walk([rays], visit, CurrentExtreme(light[:, 0], 0.0))
    value = joined_value(light, settings.join)
    return classify_values(transfer, low + width * value if is_attenuated else value)


def pixel_means(
    draw: Callable[[Rays], np.ndarray], grid: Grid, bounds: Bounds, camera: Camera, pixels: np.ndarray, samples: int
) -> np.ndarray:
    """float64 [P, 4]: means over samples × samples rays in each of pixels [P], numbered row by row from the top. draw:
    returns the light [N, 4] of rays.
    """
    width, height = camera.size
    fine = camera.resized((width * samples, height * samples))
    view = GridView.of(grid, fine, kernel_named("b-spline"), antialias=False)
    y, x = np.divmod(pixels, width)
    row, column = np.divmod(np.arange(samples**2), samples)
    number = ((y[:, None] * samples + row) * (width * samples) + x[:, None] * samples + column).ravel()
    groups = np.split(number, range(RAYS, len(number), RAYS))
    drawn = [draw(Rays.of(view, fine, bounds, pixel_slopes(group, fine, view.pitch))) for group in groups]
    return np.asarray(np.concatenate(drawn).reshape(len(pixels), -1, 4).mean(axis=1))


def ray_integral(
    splats: Splats, camera: Camera, settings: Settings | None = None, steps_per_voxel: int = 8, samples: int = 1
) -> Image:
    """The composite image of the reconstructed field, float64 [H, W, 4], without antialiasing.

    Midpoint rule in slabs of 1/steps_per_voxel of a grid step; its error is proportional to their square.
    samples × samples rays a pixel. Kernel, shading and background are the settings'. A slab near splats
    costs 1 to 5 µs, empty or occluded ones almost nothing. Raises InputError for other blend modes and splats off
    their lattice.
    """
    width, height = camera.size
    drawn = ray_integral_at(splats, camera, np.arange(width * height), settings, steps_per_voxel, samples)
    return Image(drawn.reshape(height, width, 4), {"blend": "composite", "renderer": "float64 ray integral"})


def ray_integral_at(
    splats: Splats,
    camera: Camera,
    pixels: np.ndarray,
    settings: Settings | None = None,
    steps_per_voxel: int = 8,
    samples: int = 1,
) -> np.ndarray:
    """float64 [P, 4]: pixels [P] of `ray_integral`, numbered row by row from the top."""
    settings = (settings or Settings()).replace(**BEFORE)
    settings.require_composite("ray integral")
    _check_counts(steps_per_voxel, samples)
    splats = clip_behind_eye(select_splats(splats, settings, moving=False), camera)
    kernel, resolved = kernel_named(kernel_name(splats, settings)), Resolved.of(splats, camera, settings)
    voxel = GridView.of(splats.grid, camera, kernel, antialias=False).voxels(splats.positions)
    color = apply_light(splats.colors.astype(np.float64), splats, camera, voxel, resolved)
    cells = _lattice(splats, kernel, color)
    near = NearCells(dilate(dilate(cells.held)), cells.low)

    def matter(rays: SlabRays, slab: np.ndarray, ray: np.ndarray) -> np.ndarray:
        *emitted, extinction = cells.sums(rays.places(slab, ray))
        colors = np.stack(emitted) / np.where(extinction > 0, extinction, 1.0)
        return np.stack([*colors, extinction * rays.length[ray]], axis=-1)[None]

    low, high = splats.index_bounds + np.array([[-kernel.radius], [kernel.radius]])
    # kernels before the plane of parallel rays are whole
    bounds = Bounds(low, high, first=0.0 if camera.perspective else -np.inf)

    def draw(rays: Rays) -> np.ndarray:
        return composite(matter, SlabRays.of(rays, near, steps_per_voxel), False)

    return over_background(pixel_means(draw, splats.grid, bounds, camera, pixels, samples), resolved)


def _check_counts(steps_per_voxel: int, samples: int) -> None:
    """Raises InputError for numbers of slabs and samples below 1."""
    for name, count in (("steps_per_voxel", steps_per_voxel), ("samples", samples)):
        if count < 1:
            raise expected(name, "a number of at least 1", count)


def _lattice(splats: Splats, kernel: Kernel, color: np.ndarray) -> LatticeTerms:
    """Extinction · s̄ · colour, and extinction · s̄. InputError for splats off a lattice."""
    low, high = splats.index_bounds.astype(np.int64)
    if (count := int((high - low + 1).prod())) > MAX_CELLS:
        raise expected("splats", f"a box of at most {MAX_CELLS} cells", count, "use a smaller volume")
    depth = splats.records["optical_depth"].astype(np.float64)
    cells = LatticeTerms(splats.positions, [*(color * depth[:, None]).T, depth], kernel, is_exact=True)
    if (splats.positions != np.rint(splats.positions)).any() or np.count_nonzero(cells.held) < len(splats):
        raise expected("splats", "at most one at each point of a lattice", "others", "use an extracted volume")
    return cells


def kernel_field(volume: Volume, shape: Kernel, post: ValueClassifier) -> Field:
    """The kernels' normalised sums of coefficients and gradients of all finite samples; NaN beyond their reach."""
    u = _values(volume, post)
    terms, finite = _terms(volume, u, prefilter(u, shape), post, shape), np.isfinite(u)
    return _kernel_mean(LatticeTerms(np.argwhere(finite)[:, ::-1], [*terms[finite].T], shape, is_exact=True), post)


def _kernel_mean(cells: LatticeTerms, post: ValueClassifier) -> Field:
    """The normalised sums of mass, record value and world gradient of cells."""

    def at(places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        mass, *sums = cells.sums(places)
        mean = np.stack(sums, axis=-1) / np.where(mass > 0, mass, 1.0)[:, None]
        return np.where(mass > 0, post.value(mean[:, 0]), np.nan), mean[:, 1:] * post.span

    return at


def trilinear_field(volume: Volume, post: ValueClassifier) -> Field:
    """Trilinear interpolation of samples and of their central differences, as in ray casters."""
    u = _values(volume, post)
    terms = _terms(volume, u, u, post)

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
    """[D, H, W, 5]: 1, coefficient and world gradient of each sample; 0 where not finite. kernel: None: gradients are
    central differences.
    """
    z, y, x = (index.ravel() for index in np.indices(u.shape))
    world = np.linalg.inv(volume.world_from_index)
    around = post.around if post.faced and kernel else None
    gradient = gradients(u, x, y, z, 4 if kernel else 2, around) @ world
    if kernel and not post.faced:
        gradient = with_slopes(gradient, field_slopes(u, kernel, world).ravel())
    terms = np.column_stack([np.ones(u.size), c.ravel(), gradient])
    return np.where(np.isfinite(u).ravel()[:, None], terms, 0.0).reshape(*u.shape, 5)


@dataclass(frozen=True, eq=False)
class FieldMatter:
    """A field and its appearance. spacing: mean spacing, unit: reference length of opacities, both in world units.
    by_steps: whether a step is classified by all values that it passes, so that no spike is missed; else by the value
    in its middle. iso_lit: whether iso-surfaces are lit.
    """

    field: Field
    post: ValueClassifier
    spacing: float
    unit: float
    light_by: LightModel | None
    mask: MaskField | None
    by_steps: bool = False
    shading: bool = True
    iso_lit: bool = True
    shines: np.ndarray | None = None
    cues: LightVolume | None = None

    def draw(self, rays: SlabRays, settings: Settings) -> np.ndarray:
        """Light [P, 4] of rays in the blend of the settings."""
        if settings.shows_value:
            return join(self, rays, settings)
        return composite(self.slabs, rays, settings.is_sum)

    def kept(self, places: np.ndarray) -> np.ndarray:
        """bool [P]: whether the mask keeps grid positions [3, P]."""
        return np.ones(places.shape[1], bool) if self.mask is None else self.mask.at(places) >= 0

    def classes(self, places: np.ndarray, half: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """[P, 4], [P, 3]: colour and extinction per mean spacing, and gradients, of steps around grid positions [3, P].
        half [3, P]: offset from there to a step's ends.
        """
        (middle, gradient), transfer = self.field(places), self.post.transfer
        size = np.linalg.norm(gradient, axis=1)
        if not self.by_steps:
            opacity, color = transfer.classify(middle, size)
            return np.column_stack([color, transfer.extinction(opacity, self.unit) * self.spacing]), gradient
        known = np.isfinite(middle)
        center = np.where(known, middle, 0.0)

        def state(at: np.ndarray) -> np.ndarray:
            value, slope = self.field(at)
            # beyond the field, the value in the middle
            return np.stack([np.where(known & np.isfinite(value), value, center), np.linalg.norm(slope, axis=1)])

        states = state(places - half), np.stack([center, size]), state(places + half)
        matter = mean_classes(self.post.integral, transfer, states, size) * known[:, None]
        color = matter[:, :3] / np.where(matter[:, 3:] > 0, matter[:, 3:], 1.0)
        return np.column_stack([color, matter[:, 3] * (self.spacing / self.unit)]), gradient

    def slabs(self, rays: SlabRays, slab: np.ndarray, ray: np.ndarray) -> np.ndarray:
        """Pieces as of `Slabs`: the matter before, between and behind iso-surfaces, and these."""
        places, toward = rays.places(slab, ray), rays.rays.toward[ray]
        half = rays.rays.direction[:, ray] * (rays.thickness[ray] / 2)
        matter, gradient = self.classes(places, half)
        color, through = matter[:, :3], matter[:, 3] * self.kept(places) * rays.length[ray]
        if self.light_by is not None:
            if rays.rays.face is not None:
                face = rays.rays.face[ray]
                is_cut = (slab * rays.thickness[ray] < FACE) & (face != 0).any(axis=1)
                gradient = np.where(is_cut[:, None], face, gradient)
            factor, highlight = self._shade(places, gradient * self.shading, toward)
            if self.mask is not None and self.shading:
                normal = self.mask.normals(places)
                share = self.mask.face_share(gradient * (self.spacing / self.post.span), normal, self.post.span)
                factor, highlight = mix_light((factor, highlight), self._shade(places, normal, toward), share)
            color = color * factor[:, None] + highlight[:, None]
        pieces, before = [], np.zeros(len(ray))
        for share, surface in self._surfaces(places, half, toward):
            pieces += [np.column_stack([color, through * (share - before)]), surface]
            before = share
        return np.stack([*pieces, np.column_stack([color, through * (1 - before)])])

    def _surfaces(
        self, places: np.ndarray, half: np.ndarray, toward: np.ndarray
    ) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yields the shares [P] of steps around grid positions [3, P] before an iso-surface, ascending and 1 if there
        is none, and colour and optical depth [P, 4] of the surface. half [3, P]: offset to a step's ends; toward
        [P, 3]: rays, world axes.
        """
        values, matter = surface_levels(self.post.transfer, self.post.span), self.post.surfaces[1]
        ends = [self.field(places + side * half)[0] for side in ((-1.0, 1.0) if len(values) else ())]
        share = np.ones((len(values), places.shape[1]))
        for number, value in enumerate(values):
            is_crossed = (ends[0] > value) != (ends[1] > value)
            is_crossed &= np.isfinite(ends[0]) & np.isfinite(ends[1])
            rise = np.where(is_crossed, ends[1] - ends[0], 1.0)
            share[number] = np.where(is_crossed, np.clip((value - ends[0]) / rise, 0.0, BEFORE_END), 1.0)
        for number in np.argsort(share, axis=0):
            part = np.take_along_axis(share, number[None], axis=0)[0]
            surface, some = np.zeros((len(part), 4)), np.flatnonzero(part < 1)
            at = places[:, some] + half[:, some] * (2 * part[some] - 1)
            light = matter[number[some]]
            color = light[:, :3] / np.where(light[:, 3:] > 0, light[:, 3:], 1.0)
            if self.light_by is not None:
                factor, highlight = self._shade(at, self.field(at)[1] * self.iso_lit, toward[some])
                color = color * factor[:, None] + highlight[:, None]
            surface[some] = np.column_stack([color, light[:, 3] * self.kept(at)])
            yield part, surface

    def _shade(self, places: np.ndarray, normal: np.ndarray, toward: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Factors of colours [P] and highlights [P] of surfaces with normals [P, 3]."""
        assert self.light_by is not None
        reached = self.cues.light_shares(places.T, normal, toward) if self.cues else None
        return surface_light(normal, toward, self.light_by, self.shines, reached)


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
    _check_counts(steps_per_voxel, samples)
    appearance = blend if isinstance(blend, Settings) else Settings(blend=cast(Blend, blend))
    name = field if isinstance(field, str) else "formula"
    shape = kernel_named("b-spline" if name in ("trilinear", "formula") else name)
    post = ValueClassifier.of(transfer, shape.name, volume.shape[::-1])
    near = np.ones(volume.shape, bool)
    if isinstance(field, str):
        field = trilinear_field(volume, post) if name == "trilinear" else kernel_field(volume, shape, post)
        near = dilate(select_needed(_values(volume, post), 2, post.wanted)[0])
    grid, lit = Grid.of(volume), LIGHTS["head"] if transfer.shading and appearance.hides else None
    mask = MaskField.with_gaps(volume, np.argwhere(~np.isfinite(np.asarray(volume.samples)))[:, ::-1])
    matter = FieldMatter(field, post, grid.mean_spacing, transfer.length(volume), lit, mask)

    def draw(rays: Rays) -> np.ndarray:
        return matter.draw(SlabRays.of(rays, NearCells(near, np.zeros(3, np.int64)), steps_per_voxel), appearance)

    width, height = camera.size
    drawn = pixel_means(draw, grid, Bounds.of_voxels(post.shape), camera, np.arange(width * height), samples)
    return Image(drawn.reshape(height, width, 4), {"blend": appearance.blend, "renderer": "float64 field integral"})


def kept_field_integral(
    splats: Splats, camera: Camera, pixels: np.ndarray, samples: int = 1, settings: Settings | None = None
) -> np.ndarray:
    """float64 [P, 4]: `field_integral` of the values that extraction kept, at pixels [P], row by row from the top.

    Blend, shading and background are the settings'.
    """
    settings, post, records = settings or Settings(), splats.post, splats.records
    assert post is not None
    spacing = splats.grid.mean_spacing
    terms = [1.0, records["value"], *records["gradient"].T / spacing]
    cells = LatticeTerms(records["position"], terms, kernel_named(post.kernel), is_exact=True)
    near = NearCells(dilate(cells.held), cells.low)
    resolved = Resolved.of(clip_behind_eye(splats, camera), camera, settings)
    appearance, cues = resolved.appearance, resolved.cues
    matter = FieldMatter(
        _kernel_mean(cells, post),
        post,
        spacing,
        splats.unit,
        appearance.light if appearance.shading or appearance.iso == "lit" or cues else None,
        resolved.mask,
        by_steps=True,
        shading=appearance.shading,
        iso_lit=appearance.iso == "lit",
        shines=appearance.light.within(camera),
        cues=cues,
    )

    def draw(rays: Rays) -> np.ndarray:
        return matter.draw(SlabRays.of(rays, near, STEPS), settings)

    bounds = Bounds.of_voxels(post.shape, resolved.clip)
    return over_background(pixel_means(draw, splats.grid, bounds, camera, pixels, samples), resolved)

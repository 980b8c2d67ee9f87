"""A second truth, without splats: the volume rendering integral of the field that the kernels reconstruct.

Extinction σ(x) = Σ σ_i h and σ c(x) = Σ σ_i c_i h are summed at points along each ray, so that what overlaps
is mixed before it occludes: the difference to `reference.render` is the error of splatting itself.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from splatgl.data.errors import expected
from splatgl.data.image import Image
from splatgl.splat.affine import View
from splatgl.splat.camera import Camera
from splatgl.splat.kernel import Kernel
from splatgl.splat.kernel import kernel as kernel_named
from splatgl.splat.plan import plan
from splatgl.splat.rows import Splats
from splatgl.splat.settings import Settings
from splatgl.truth.reference import head_light

# cells of the box of all splats that are looked up in one table, 4 bytes each
MAX_CELLS = 1 << 27
# neighbours along each axis: both kernels reach at most 2 cells
NEIGHBOURS = np.arange(-1, 3)
# rays marched at once: 64 neighbours of each stay under 100 MB
RAYS = 1 << 13


@dataclass(frozen=True, eq=False)
class Field:
    """Splats on their lattice. cell int32 [X+4, Y+4, Z+4]: the splat there, or the last, which is nothing.

    low [3]: the cell of entry (2, 2, 2). depth [N+1]: extinction · s̄; color [N+1, 3].
    """

    kernel: Kernel
    cell: np.ndarray
    low: np.ndarray
    depth: np.ndarray
    color: np.ndarray

    @classmethod
    def of(cls, splats: Splats, kernel: Kernel, color: np.ndarray, seen: np.ndarray) -> Field:
        """The field of the splats that are `seen` [N]; InputError if they don't lie on a lattice."""
        places = splats.records["position"].astype(np.float64)
        cells = np.rint(places).astype(np.int64)
        low, high = splats.index_bounds.astype(np.int64)
        if (cells != places).any() or len(np.unique(cells @ [1, 1 << 21, 1 << 42])) < len(cells):
            raise expected("splats", "one at most at each point of a lattice", "others", "take an extracted volume")
        shape = high - low + 5
        if shape.prod() > MAX_CELLS:
            raise expected("splats", f"a box of at most {MAX_CELLS} cells", int(shape.prod()), "take a smaller volume")
        table = np.full(shape, len(places), np.int32)
        table[tuple((cells[seen] - low + 2).T)] = np.flatnonzero(seen)
        depth = np.append(splats.records["optical_depth"].astype(np.float64), 0.0)
        return cls(kernel, table, low, depth, np.concatenate([color, np.zeros((1, 3))]))

    def at(self, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(σ s̄ [P], σ s̄ c [P, 3]) at grid places [P]."""
        flat, square = np.zeros((len(x), 1), np.int64), np.zeros((len(x), 1))
        for place, low, count in zip((x, y, z), self.low, self.cell.shape, strict=True):
            first = np.floor(place)
            cell = np.clip((first - low + 2).astype(np.int64)[:, None] + NEIGHBOURS, 0, count - 1)
            offset = (place - first)[:, None] - NEIGHBOURS
            flat = (flat[:, :, None] * count + cell[:, None, :]).reshape(len(x), -1)
            square = (square[:, :, None] + (offset * offset)[:, None, :]).reshape(len(x), -1)
        found = self.cell.ravel()[flat]
        weight = self.depth[found] * self.kernel.value(np.sqrt(square))
        return weight.sum(axis=1), np.einsum("pn,pnc->pc", weight, self.color[found])


def ray_integral(
    splats: Splats,
    camera: Camera,
    settings: Settings | None = None,
    steps_per_voxel: int = 8,
    samples: int = 1,
) -> Image:
    """The composite picture of the reconstructed field, float64 [H, W, 4], without antialiasing.

    The midpoint rule in slabs of 1/steps_per_voxel of a grid step; its error goes with their square.
    samples × samples rays a pixel. Kernel, shading and background are the settings'. For small pictures:
    a ray costs about 10 µs a slab. Raises InputError for other blend modes and splats off their lattice.
    """
    started = time.perf_counter()
    settings = settings or Settings()
    if settings.blend != "composite":
        raise expected("blend", "composite, whose integral this is", settings.blend)
    for name, count in (("steps_per_voxel", steps_per_voxel), ("samples", samples)):
        if count < 1:
            raise expected(name, "a number of at least 1", count)
    fine = camera.resized((camera.size[0] * samples, camera.size[1] * samples))
    view = View.of(splats.grid, fine, kernel_named(settings.kernel), antialias=False)
    voxel = view.voxels(splats.records["position"])
    color = splats.records["color"].astype(np.float64)
    if plan(splats, camera, settings.but(align="ray")).program.shading:
        color *= head_light(splats, camera, voxel)[:, None]
    # in parallel views voxels behind the eye's plane are absent, the others whole
    seen = np.full(len(splats), True) if camera.perspective else voxel[2] >= 0
    field = Field.of(splats, view.kernel, color, seen)

    groups = np.split(np.arange(fine.size[0] * fine.size[1]), range(RAYS, fine.size[0] * fine.size[1], RAYS))
    drawn = np.concatenate([_march(field, view, fine, group, steps_per_voxel) for group in groups])
    picture = drawn.reshape(camera.size[1], samples, camera.size[0], samples, 4).mean(axis=(1, 3))
    if settings.background is not None:
        picture = picture + (1 - picture[..., 3:]) * np.array([*settings.background, 1.0])
    seconds = round(time.perf_counter() - started, 6)
    info = {"scene": splats.name, "kernel": settings.kernel, "steps_per_voxel": steps_per_voxel, "samples": samples}
    return Image(picture, {**info, "blend": "composite", "renderer": "float64 ray integral", "seconds": seconds})


def _march(field: Field, view: View, camera: Camera, pixel: np.ndarray, steps: int) -> np.ndarray:
    """float64 [P, 4]: the integral along the rays of those pixels, in slabs of equal length for each."""
    start, direction = _rays(view, camera, pixel)
    near, far = _through_box(field, start, direction, view)
    speed = np.sqrt((direction * direction).sum(axis=0))
    slabs = np.ceil(np.maximum(far - near, 0.0) * speed * steps).astype(np.int64)
    step = np.maximum(far - near, 0.0) / np.maximum(slabs, 1)
    # arc length of a slab in mean spacings
    length = step * np.sqrt(((view.eye_from_index @ direction) ** 2).sum(axis=0))
    depth, color = np.zeros(len(pixel)), np.zeros((len(pixel), 3))
    for n in range(int(slabs.max(initial=0))):
        on = np.flatnonzero(slabs > n)
        t = near[on] + (n + 0.5) * step[on]
        extinction, emitted = field.at(*(start[:, on] + direction[:, on] * t))
        full = np.flatnonzero(extinction > 0)
        on, extinction, emitted = on[full], extinction[full], emitted[full]
        slab = extinction * length[on]
        color[on] += (np.exp(-depth[on]) * -np.expm1(-slab) / extinction)[:, None] * emitted
        depth[on] += slab
    return np.concatenate([color, -np.expm1(-depth)[:, None]], axis=1)


def _rays(view: View, camera: Camera, pixel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Starts and directions [3, P] in grid indices; the parameter is depth in mean spacings."""
    row, column = np.divmod(pixel, camera.size[0])
    across = (column + 0.5 - camera.size[0] / 2) * view.pitch
    down = (row + 0.5 - camera.size[1] / 2) * view.pitch
    zero, one = np.zeros(len(pixel)), np.ones(len(pixel))
    at, along = (zero, zero, zero), (across, down, one)
    if not camera.perspective:
        at, along = (across, down, zero), (zero, zero, one)
    eye = view.eye_index[:, None]
    return view.index_from_eye @ np.stack(at) + eye, view.index_from_eye @ np.stack(along)


def _through_box(field: Field, start: np.ndarray, direction: np.ndarray, view: View) -> tuple[np.ndarray, np.ndarray]:
    """Where each ray enters and leaves the box that the kernels reach; an orthographic one is endless."""
    radius = field.kernel.radius
    low = field.low[:, None] - radius
    high = field.low[:, None] + np.array(field.cell.shape)[:, None] - 5 + radius
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack([(low - start) / direction, (high - start) / direction])
    inside = (start >= low) & (start <= high)
    # along an axis that a ray does not move in, it is within always or never
    still = direction == 0
    first = np.where(still, np.where(inside, -np.inf, np.inf), ends.min(axis=0)).max(axis=0)
    last = np.where(still, np.where(inside, np.inf, -np.inf), ends.max(axis=0)).min(axis=0)
    first = np.maximum(first, 0.0) if view.perspective else first
    missed = ~(last > first)
    return np.where(missed, 0.0, first), np.where(missed, 0.0, last)

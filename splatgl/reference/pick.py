"""`pick`: the point of a scene under a pixel, by one ray in float64, without splats."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from splatgl.data.volume import Triple, Volume
from splatgl.errors import expected
from splatgl.reference.layers import crossings
from splatgl.reference.rays import Pixels, Rays
from splatgl.splat.camera import Camera
from splatgl.splat.clipping import Clip, Plane
from splatgl.splat.grid import Grid, trilinear
from splatgl.splat.iso import crossed_depth
from splatgl.splat.kernels import kernel
from splatgl.splat.mask_field import MaskField
from splatgl.splat.preintegration import ClassIntegral
from splatgl.splat.scene import Layer, Scene
from splatgl.splat.settings import Settings
from splatgl.splat.transfer import Transfer
from splatgl.splat.view import GridView

# parts of a ray per smallest voxel, and maximum number of parts; divisions of the decisive part
STEPS, MOST, PARTS = 4, 1 << 20, 64
# share of a part between whose ends values are evaluated: samples beyond may be missing
WITHIN = 1 - 1e-9
# least number of cells of a transfer function's integral
LEAST_CELLS = 1 << 12
# optical depth at which half of the light is absorbed
HALF = float(np.log(2))
# optical depth of an opaque surface
OPAQUE = 50.0
# relative distance within which two crossings of a mesh are one
SAME = 1e-9
MODES = ("first", "max")


@dataclass(frozen=True)
class Picked:
    """A point of a volume. place: world units; index: grid position (x, y, z); value: interpolated linearly; of labels,
    that of the voxel. distance: from the eye, or from its plane, world units. name: of the volume; layer: its number in
    the scene.

    mesh: number of the mesh, if the point is on one; then `name` is the mesh's, `layer` is -1, index and value are NaN.
    """

    place: Triple
    index: Triple
    value: float
    distance: float
    name: str
    layer: int
    mesh: int | None = None


def pick(
    x: Volume | Scene,
    camera: Camera,
    pixel: Sequence[int],
    transfer: Transfer | None = None,
    mode: str = "first",
    attenuation: float = 0.0,
) -> Picked | None:
    """The point under the centre of a pixel (column, row), row 0 on top; None if nothing is visible there.

    mode "first": where half of the light is absorbed, or half of the ray's total absorption; "max": the largest value,
    of an attenuated MIP the one that is shown. attenuation: its strength, per reference length.
    Among layers, the one that absorbs most there. transfer: of a volume; None: its default one. Clip planes of a scene
    apply. Meshes absorb their opacity, and rays end at opaque ones; gradient weights are ignored. Raises InputError for
    a pixel outside the picture, for clouds of points, and for volumes that are read in parts.
    """
    if mode not in MODES:
        raise expected("mode", " or ".join(MODES), repr(mode))
    scene = Scene([Layer(x, transfer)]) if isinstance(x, Volume) else x
    scene.require_voxels("pick")
    number, cut = _pixel_number(pixel, camera), zip(scene.shown, scene.planes, strict=True)
    rays = [_Ray.of(layer, planes, camera, number) for layer, planes in cut]
    surfaces = _surfaces(scene, camera, number)
    ends = np.array([ray.ends for ray in rays if ray.ends[1] > ray.ends[0]])
    if not len(ends):
        return _first_mesh(surfaces, scene, camera, number)
    near, far = float(ends[:, 0].min()), float(ends[:, 1].max())
    count = min(int(np.ceil((far - near) / min(ray.step for ray in rays))), MOST)
    # parts end at the ends of layers, at faces of labels, and at planes of samples, between which values have no kinks
    faces = [ray.faces(near, far) for ray in rays]
    ends = np.unique(np.concatenate([np.linspace(near, far, count + 1), ends.ravel(), *faces]))
    along, lengths = (ends[:-1] + ends[1:]) / 2, np.diff(ends)
    matter = [ray.seen(ends) for ray in rays]
    if mode == "max":
        end = next((surface.distance for surface in surfaces if surface.depth >= OPAQUE), np.inf)
        values = np.array([np.where(inside & (along < end), v, -np.inf) for v, _, inside in matter])
        return _largest(rays, ends, values, attenuation) or _first_mesh(surfaces, scene, camera, number)
    extinctions = np.array([extinction for _, extinction, _ in matter])
    depths = extinctions.sum(axis=0) * lengths
    # insert surfaces between the parts of the ray
    before = np.searchsorted(along, [surface.distance for surface in surfaces])
    depth = np.cumsum(np.insert(depths, before, [surface.depth for surface in surfaces]))
    if not depth[-1] > 0:
        return None
    enough = min(HALF, depth[-1] / 2)
    place = int(np.searchsorted(depth, enough))
    at = before + np.arange(len(surfaces))
    if place in at:
        return _pick_mesh(surfaces[int(np.searchsorted(at, place))], scene, camera, number)
    left = depth[place] - enough
    place -= int((at < place).sum())
    layer = int(extinctions[:, place].argmax())
    if rays[layer].layer.seen.labels:
        exact = ends[place + 1] - lengths[place] * left / depths[place]
        return rays[layer].pick_at(exact, layer, matter[layer][0][place])
    # the point within the part where the layer has absorbed half of its share
    ends = np.linspace(ends[place], ends[place + 1], PARTS + 1)
    depth = np.cumsum(rays[layer].seen(ends)[1])
    part = int(np.searchsorted(depth, depth[-1] / 2))
    return rays[layer].pick_at(float(ends[part] + ends[part + 1]) / 2, layer)


def pick_options(settings: Settings) -> dict[str, Any]:
    """The mode and the attenuation of `pick` that suit a picture's blend."""
    is_attenuated = settings.blend == "attenuated-mip"
    mode = "max" if is_attenuated or settings.blend == "mip" else "first"
    return {"mode": mode, "attenuation": settings.mip_attenuation if is_attenuated else 0.0}


def _largest(rays: list[_Ray], ends: np.ndarray, values: np.ndarray, attenuation: float) -> Picked | None:
    """The point of the largest of values [layers, N] of the parts between distances [N + 1], once they are attenuated;
    None if none is finite.
    """
    seen = values
    if attenuation:
        both = zip(rays, values, strict=True)
        seen = np.array([ray.attenuated(values_, np.diff(ends), attenuation) for ray, values_ in both])
    layer, place = divmod(int(seen.argmax()), values.shape[1])
    if not np.isfinite(values[layer, place]):
        return None
    first = np.nan_to_num(rays[layer].within(ends[place : place + 2])[0], nan=-np.inf) >= values[layer, place]
    return rays[layer].pick_at(float(ends[place if first else place + 1]), layer, values[layer, place])


@dataclass(frozen=True)
class _Surface:
    """Crossing of a ray and a mesh: number of the mesh, distance, and optical depth of its opacity."""

    mesh: int
    distance: float
    depth: float


def _surfaces(scene: Scene, camera: Camera, pixel: int) -> list[_Surface]:
    """Crossings of a pixel's ray with meshes, nearest first."""
    wanted, surfaces = Pixels.of(camera.size, np.array([pixel])), list[_Surface]()
    for number, mesh in enumerate(scene.meshes):
        crossed = crossings([mesh], camera, wanted, None)
        depth = min(-float(np.log1p(-mesh.opacity)), OPAQUE) if mesh.opacity < 1 else OPAQUE
        # a ray through an edge crosses two triangles at one distance
        distances = np.sort(crossed.distance[0][np.isfinite(crossed.distance[0])])
        distances = distances[np.diff(distances, prepend=-np.inf) > SAME * np.abs(distances)]
        surfaces += [_Surface(number, float(at), depth) for at in distances]
    return sorted(surfaces, key=lambda surface: surface.distance)


def _first_mesh(surfaces: list[_Surface], scene: Scene, camera: Camera, pixel: int) -> Picked | None:
    """Point of the surface where half of the light, or of the total absorption, is absorbed; None without surfaces."""
    if not surfaces:
        return None
    depth = np.cumsum([surface.depth for surface in surfaces])
    return _pick_mesh(surfaces[int(np.searchsorted(depth, min(HALF, depth[-1] / 2)))], scene, camera, pixel)


def _pick_mesh(surface: _Surface, scene: Scene, camera: Camera, pixel: int) -> Picked:
    row, column = divmod(pixel, camera.size[0])
    across, down = (slopes[place] for slopes, place in zip(camera.slopes(), (column, row), strict=True))
    if camera.perspective:
        ray = np.array([across, down, 1.0])
        point = ray / np.linalg.norm(ray) * surface.distance
    else:
        point = np.array([across, down, surface.distance])
    nothing = (np.nan,) * 3
    place = _triple(point @ camera.eye_from_world + camera.eye)
    return Picked(place, nothing, np.nan, surface.distance, scene.meshes[surface.mesh].name, -1, surface.mesh)


def _pixel_number(pixel: Any, camera: Camera) -> int:
    """A pixel's number, row by row."""
    width, height = camera.size
    try:
        column, row = (int(number) for number in pixel)
    except (TypeError, ValueError):
        column = row = -1
    if not (0 <= column < width and 0 <= row < height):
        raise expected("pixel", f"a column and a row within {width}×{height}", repr(pixel)[:80])
    return row * width + column


@dataclass(frozen=True, eq=False)
class _Ray:
    """A ray through a layer's grid. start, direction [3]: grid indices, per world unit; ends: distances at which it
    enters and leaves the layer; step: length of a part.
    """

    layer: Layer
    start: np.ndarray
    direction: np.ndarray
    ends: tuple[float, float]
    step: float

    @classmethod
    def of(cls, layer: Layer, planes: tuple[Plane, ...], camera: Camera, pixel: int) -> _Ray:
        volume = layer.volume
        if not isinstance(volume.samples, np.ndarray):
            raise expected(volume.name or "volume", "samples in memory or mapped", "some that are read in parts")
        grid = Grid.of(volume)
        view = GridView.of(grid, camera, kernel("b-spline"), antialias=False)
        rays = Rays.of(view, camera, volume.shape[::-1], np.array([pixel]), Clip.of(planes, grid))
        world = float(rays.stretch[0]) * grid.mean_spacing
        ends = float(rays.near[0]) * world, float(rays.far[0]) * world
        return cls(layer, rays.start[:, 0], rays.direction[:, 0] / world, ends, grid.smallest_spacing / STEPS)

    def faces(self, near: float, far: float) -> np.ndarray:
        """Distances from near to far at which the ray crosses faces of labels' voxels, or planes of samples."""
        shape, half = self.layer.volume.shape[::-1], 0.5 if self.layer.seen.labels else 0.0
        with np.errstate(divide="ignore", invalid="ignore"):
            crossed = [
                (np.arange(n + 1) - half - i) / d for n, i, d in zip(shape, self.start, self.direction, strict=True)
            ]
        distances = np.concatenate(crossed)
        return np.asarray(distances[(distances > near) & (distances < far)])

    def within(self, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values at both ends of the parts between distances [N + 1]; for labels, of the parts' middles."""
        middle, half = (ends[:-1] + ends[1:]) / 2, np.diff(ends) * (WITHIN / 2)
        places = (middle,) * 2 if self.layer.seen.labels else (middle - half, middle + half)
        first, last = (self._values(self.start[:, None] + self.direction[:, None] * place) for place in places)
        return first, last

    def seen(self, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Largest values, mean extinctions per world length over all values passed, and whether they are inside, of the
        parts between distances [N + 1].
        """
        middle, look = (ends[:-1] + ends[1:]) / 2, self.layer.seen
        first, last = self.within(ends)
        inside = (middle >= self.ends[0]) & (middle <= self.ends[1]) & np.isfinite(first) & np.isfinite(last)
        mask = MaskField.of(self.layer.volume)
        if mask is not None:
            places = self.start[:, None] + self.direction[:, None] * middle
            inside &= mask.keeps(places.T) if look.labels else mask.at(places) >= 0
        unit = look.unit or Grid.of(self.layer.volume).mean_spacing
        value, extinction = np.fmax(first, last), np.zeros(len(middle))
        first, last = first[inside], last[inside]
        low, high = min(first.min(initial=np.inf), last.min(initial=np.inf)), value[inside].max(initial=-np.inf)
        if look.labels or not low < high:
            extinction[inside] = look.extinction(look.opacity(first), unit)
        else:
            extinction[inside] = ClassIntegral.of(look, low, high, LEAST_CELLS).mean(first, last)[:, 3] / unit
        if look.iso:
            levels = np.array([surface.value for surface in look.iso])
            crossed = crossed_depth(levels, look.surface_matter()[:, 3], first, last)
            extinction[inside] += crossed / np.diff(ends)[inside]
        return value, extinction, inside

    def attenuated(self, values: np.ndarray, lengths: np.ndarray, strength: float) -> np.ndarray:
        """Shares of the colours' window at the values [N] of parts, attenuated by those before them; −∞ without one."""
        look = self.layer.seen
        low, high = look.color_range
        known = np.isfinite(values)
        shares = np.clip((np.where(known, values, low) - low) / ((high - low) or 1.0), 0.0, 1.0)
        depth = shares * lengths * strength / (look.unit or Grid.of(self.layer.volume).mean_spacing)
        return np.where(known, shares * np.exp(depth - np.cumsum(depth)), -np.inf)

    def _values(self, places: np.ndarray) -> np.ndarray:
        """Values at grid positions [3, N], linear between samples; for labels, of the nearest voxel."""
        samples = self.layer.volume.samples
        if not self.layer.seen.labels:
            return trilinear(samples[..., None], places.T)[:, 0]
        last = np.array(samples.shape[::-1])[:, None] - 1
        x, y, z = np.rint(np.clip(places, 0, last)).astype(np.int64)
        return np.asarray(samples[z, y, x], np.float64)

    def pick_at(self, distance: float, number: int, value: float | None = None) -> Picked:
        """The point at a distance. value: if known already."""
        volume = self.layer.volume
        index = self.start + self.direction * distance
        value = float(self._values(index[:, None])[0] if value is None else value)
        world = volume.world_from_index @ index + np.asarray(volume.origin)
        return Picked(_triple(world), _triple(index), value, float(distance), volume.name, number)


def _triple(numbers: np.ndarray) -> Triple:
    x, y, z = (float(number) for number in numbers)
    return x, y, z

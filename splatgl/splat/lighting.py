"""Light models, the shading of voxels, and the normals that light labels.

Normals are gradients of the smoothed opacity of all labels: where two labels touch there is no surface. Their length is
their certainty, relative to the opacity: faint and opaque labels are lit alike, and voxels deep inside are not lit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import TYPE_CHECKING

import numpy as np

from splatgl.data.volume import Slab, Volume
from splatgl.errors import expected
from splatgl.geometry.camera import Camera
from splatgl.geometry.grid import trilinear
from splatgl.geometry.mask_field import ONE, ZERO
from splatgl.splat.splats import Splats

if TYPE_CHECKING:
    from splatgl.planning.resolve import Resolved


# ambient and diffuse shares of the head light
AMBIENT, DIFFUSE = 0.3, 0.7
# sharpness of highlights, and by how much the sum of shares may exceed 1
SHARPNESS, ROUNDING = 5, 1e-9
# degrees to the right of the eye and above it of a light from above left
ABOVE_LEFT = (-35.0, 35.0)


@dataclass(frozen=True)
class LightModel:
    """Shares of ambient, diffuse and specular light, together at most 1; the highlight is a cosine to the power of
    2^sharpness (Blinn 1977).

    side, above: degrees to the right of the eye and above it; the light is at the eye if both are 0.
    """

    ambient: float = AMBIENT
    diffuse: float = DIFFUSE
    specular: float = 0.0
    sharpness: int = 0
    side: float = 0.0
    above: float = 0.0

    @classmethod
    def of(
        cls,
        name: str,
        place: tuple[float, float] | None = None,
        shadows: bool = False,
        strengths: Sequence[float | None] = (None, None, None),
    ) -> LightModel:
        """The named light, moved to `place` (side, above) if given. shadows: moves a light at the eye, whose shadows
        are invisible, to above left unless `place` is given. strengths: ambient, diffuse and specular, see
        `with_strengths`.
        """
        light = LIGHTS[name].with_strengths(strengths)
        if place is None and shadows and light.direction is None:
            place = ABOVE_LEFT
        return light if place is None else replace(light, side=place[0], above=place[1])

    def with_strengths(self, strengths: Sequence[float | None]) -> LightModel:
        """The light with other shares of ambient, diffuse and specular light; None: its own, less where the sum would
        exceed 1. Raises InputError if the given shares alone do.
        """
        own = (self.ambient, self.diffuse, self.specular)
        given = sum(share for share in strengths if share is not None)
        if given > 1 + ROUNDING:
            raise expected("ambient, diffuse and specular", "a sum of at most 1", f"{given:.4g}", "lower one of them")
        rest = sum(share for share, new in zip(own, strengths, strict=True) if new is None)
        factor = min((1 - given) / rest, 1.0) if rest > 0 else 1.0
        shares = [max(share * factor, 0.0) if new is None else new for share, new in zip(own, strengths, strict=True)]
        sharpness = self.sharpness or (SHARPNESS if strengths[2] else 0)
        return replace(self, ambient=shares[0], diffuse=shares[1], specular=shares[2], sharpness=sharpness)

    @property
    def plain(self) -> bool:
        """Whether the light is at the eye and without highlights."""
        return self.specular == 0 and self.direction is None

    @property
    def direction(self) -> np.ndarray | None:
        """Direction of the light, a unit vector [3] in eye axes; None: along each ray."""
        if self.side == 0 and self.above == 0:
            return None
        side, above = np.radians([self.side, self.above])
        return np.array([-np.sin(side) * np.cos(above), np.sin(above), np.cos(side) * np.cos(above)])

    def within(self, camera: Camera) -> np.ndarray | None:
        """Direction of the light, world axes; None: along each ray."""
        return None if self.direction is None else self.direction @ camera.eye_from_world


# matte: from above left, as in print; glossy: likewise, with highlights; flat: shows colours more than shapes
LIGHTS = {
    "head": LightModel(),
    "matte": LightModel(0.25, 0.75, side=ABOVE_LEFT[0], above=ABOVE_LEFT[1]),
    "glossy": LightModel(0.2, 0.55, 0.25, SHARPNESS, side=ABOVE_LEFT[0], above=ABOVE_LEFT[1]),
    "flat": LightModel(0.7, 0.3),
}


def check_place(place: object) -> tuple[float, float]:
    """Checks a light's degrees to the right and above. Raises InputError unless these are two numbers up to 360."""
    numbers = list(place) if isinstance(place, Sequence | np.ndarray) and not isinstance(place, str) else []
    plain = all(isinstance(number, Real) and not isinstance(number, bool) for number in numbers)
    if len(numbers) != 2 or not plain or not all(abs(number) <= 360 for number in numbers):
        raise expected("light_from", "degrees to the right of the eye and above it, up to 360", repr(place)[:80])
    side, above = (float(number) for number in numbers)
    return side, above


def surface_light(
    normal: np.ndarray,
    toward: np.ndarray,
    light: LightModel,
    direction: np.ndarray | None,
    reached: tuple[np.ndarray, np.ndarray] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Factors of colours [P] and highlights [P] of surfaces with normals [P, 3]; 1 and 0 without a normal.

    toward [P, 3]: unit vectors along rays. direction: of the light, in the same axes; None: along each ray. reached:
    shares [P] of ambient and of direct light that reach the surface; None: all. Normals are turned to the visible side.
    Float64 twin of `shaders/light.glsl`.
    """
    size = np.linalg.norm(normal, axis=1)
    n = normal / np.where(size > 0, size, 1.0)[:, None]
    facing = (n * toward).sum(axis=1)
    cosine = half = np.minimum(np.abs(facing), 1.0)
    if direction is not None:
        n = n * np.where(facing < 0, -1.0, 1.0)[:, None]
        cosine = np.clip(n @ direction, 0.0, 1.0)
        between = toward + direction
        length = np.linalg.norm(between, axis=1)
        half = np.clip((n * between).sum(axis=1) / np.where(length > 0, length, 1.0), 0.0, 1.0)
    sky, direct = reached if reached is not None else (np.ones(len(size)), np.ones(len(size)))
    unshaded = 1.0 - light.ambient * (1.0 - sky) - (1.0 - light.ambient) * (1.0 - direct)
    factor = np.where(size > 0, light.ambient * sky + light.diffuse * cosine * direct, unshaded)
    highlight = np.where(size > 0, light.specular * half ** (2.0**light.sharpness) * direct, 0.0)
    return factor, highlight


def apply_light(color: np.ndarray, splats: Splats, camera: Camera, voxel: np.ndarray, resolved: Resolved) -> np.ndarray:
    """Colours [N, 3] of voxels [3, N] (eye axes), shaded by their normals and by the light that reaches them.

    Float64 twin of `shone` in `shaders/splat_setup.glsl`.
    """
    light, cues = resolved.appearance.light, resolved.cues
    if not resolved.appearance.shading and cues is None:
        return color
    normal = splats.records["normal"].astype(np.float64) * resolved.appearance.shading
    towards = voxel.T if camera.perspective else np.broadcast_to([0.0, 0.0, 1.0], normal.shape)
    far = np.linalg.norm(towards, axis=1)
    # a voxel at the eye has no direction to it: use the view direction
    towards = np.where(far[:, None] > 0, towards / np.where(far > 0, far, 1.0)[:, None], [0.0, 0.0, 1.0])
    reached = None
    if cues is not None:
        reached = cues.light_shares(splats.positions.astype(np.float64), normal, towards @ camera.eye_from_world)
    factor, highlight = surface_light(normal @ camera.eye_from_world.T, towards, light, light.direction, reached)
    return np.asarray(color * factor[:, None] + highlight[:, None])


# sums of two neighbours along each axis: a binomial of 1.6 voxels' deviation; and reach of normals, in voxels
SUMS = 10
HALO = SUMS // 2 + 1
# gradient over smoothed opacity from which on a normal is certain: half of the ratio at a plane face
SURE = 0.24
# maximum number of normals, 128 MB; larger volumes have one for every `step` voxels along each axis
MOST_NORMALS = 2**25
# maximum number along an axis, the least size of OpenGL's textures
LONGEST = 2048


@dataclass(frozen=True, eq=False)
class LabelNormals:
    """faced uint8 [d, h, w, 4]: 0, and normals towards matter, world axes, of lengths from 0 to 1, coded as in
    MaskField; of every `step`-th voxel from `low` (x, y, z) on.
    """

    faced: np.ndarray
    low: tuple[int, int, int]
    step: int

    @classmethod
    def empty(cls, volume: Volume) -> LabelNormals:
        """Zero normals of a volume, to which slabs are added."""
        step = int(np.ceil(max((volume.count / MOST_NORMALS) ** (1 / 3), max(volume.shape) / LONGEST)))
        shape = [-(-size // step) for size in volume.shape]
        normals = np.zeros((*shape, 4), np.uint8)
        normals[..., 1:] = ZERO
        return cls(normals, (0, 0, 0), step)

    def add(self, volume: Volume, slab: Slab, opacity: np.ndarray) -> None:
        """Adds the normals of a slab. opacity float32: of all its samples, including HALO planes on each side within
        the volume.
        """
        # only within HALO of opaque voxels; at indices that `step` divides
        opaque = opacity > 0
        if not opaque.any():
            return
        places = [np.flatnonzero(opaque.any(axis=tuple({0, 1, 2} - {axis}))) for axis in range(3)]
        first = np.array([slab.start - slab.before, 0, 0])
        low = np.maximum(first + [place[0] for place in places] - HALO, [slab.start, 0, 0])
        high = np.minimum(first + [place[-1] + 1 + HALO for place in places], [slab.stop, *volume.shape[1:]])
        low = -(-low // self.step) * self.step
        if (low >= high).any():
            return
        smooth = _smooth(_padded_part(opacity, low - HALO - first, high + HALO - first))
        inner = slice(1, -1, self.step)
        middle = smooth[inner, inner, inner]
        gradient = np.empty((*middle.shape, 3), np.float32)
        for axis in range(3):
            below, above = ([inner] * 3 for _ in range(2))
            below[axis], above[axis] = slice(None, -2, self.step), slice(2, None, self.step)
            gradient[..., 2 - axis] = smooth[tuple(above)] - smooth[tuple(below)]
        sure = np.minimum(_length(gradient) / (2 * SURE * np.maximum(middle[..., None], np.float32(1e-6))), 1.0)
        world = gradient @ np.linalg.inv(volume.world_from_index).astype(np.float32)
        normal = world / np.maximum(_length(world), np.float32(1e-30)) * sure
        z, y, x = (slice(a, a + size) for a, size in zip((low // self.step).tolist(), middle.shape, strict=True))
        self.faced[z, y, x, 1:] = np.rint(normal * ONE + ZERO)

    def crop(self, low: np.ndarray, high: np.ndarray) -> LabelNormals:
        """The normals around voxels from `low` to `high` (x, y, z)."""
        size = np.array(self.faced.shape[2::-1])
        first = np.clip(low // self.step - 1, 0, size - 1)
        last = np.clip(-(-high // self.step) + 2, 1, size)
        (x, y, z), (right, bottom, back) = first.tolist(), last.tolist()
        part = np.ascontiguousarray(self.faced[z:back, y:bottom, x:right])
        return replace(self, faced=part, low=(x * self.step, y * self.step, z * self.step))

    def of_voxels(self, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        """[N, 3]: normals of voxels, or of the nearest voxel with one."""
        last = np.array(self.faced.shape[:3]) - 1
        cells = [
            np.minimum((index + self.step // 2) // self.step, most) for index, most in zip((z, y, x), last, strict=True)
        ]
        return (self.faced[tuple(cells)][:, 1:].astype(np.float32) - ZERO) / ONE

    def at(self, places: np.ndarray) -> np.ndarray:
        """[P, 3]: normals at grid positions [P, 3], linear between voxels; clamped at the ends."""
        return np.asarray((trilinear(self.faced[..., 1:], (places - np.array(self.low)) / self.step) - ZERO) / ONE)


def _padded_part(opacity: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The part low ≤ (z, y, x) < high, 0 beyond the ends."""
    part = np.zeros(high - low, np.float32)
    first, last = np.maximum(low, 0), np.minimum(high, opacity.shape)
    inside = tuple(slice(a, b) for a, b in zip(first - low, last - low, strict=True))
    part[inside] = opacity[tuple(slice(a, b) for a, b in zip(first, last, strict=True))]
    return part


def _smooth(values: np.ndarray) -> np.ndarray:
    """SUMS sums of neighbours along each axis, shorter by as many, over what these make of 1."""
    for axis in range(3):
        lower, upper = ([slice(None)] * 3 for _ in range(2))
        lower[axis], upper[axis] = slice(None, -1), slice(1, None)
        for _ in range(SUMS):
            values = values[tuple(lower)] + values[tuple(upper)]
        values *= np.float32(0.5**SUMS)
    return values


def _length(vectors: np.ndarray) -> np.ndarray:
    return np.sqrt(np.einsum("...i,...i->...", vectors, vectors))[..., None]

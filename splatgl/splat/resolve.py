"""`Resolved`: what the settings mean for one picture, however it is drawn.

`plan` adds what a technique of OpenGL needs; the float64 truths draw from this alone.
"""

from __future__ import annotations

from dataclasses import dataclass

from splatgl.splat.affine import View
from splatgl.splat.camera import Camera
from splatgl.splat.kernel import Kernel, kernel
from splatgl.splat.rows import Splats
from splatgl.splat.settings import Settings
from splatgl.splat.widening import widening


@dataclass(frozen=True)
class Resolved:
    """The settings' meaning for one picture; nothing stands on `auto`. Depths are in world units.

    camera: of samples × samples a pixel. z_k: depth at which the smallest voxel is one sample wide [M98 Eq. 3].
    nearest, farthest: depths of the box of all splats. antialias: whether any splat is widened. attenuation: opacity,
    optical-depth or fill. beyond, unsure: from which depths, in mean spacings, voxels are widened; see widening.py.
    background: linear RGB, None: transparent. antialias_notes, shading_notes: what was left out, and why, a line each.
    """

    blend: str
    kernel: Kernel
    samples: int
    camera: Camera
    z_k: float
    nearest: float
    farthest: float
    antialias: bool
    attenuation: str
    shading: bool
    beyond: tuple[float, float]
    unsure: float
    background: tuple[float, float, float] | None
    antialias_notes: tuple[str, ...] = ()
    shading_notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, splats: Splats, camera: Camera, settings: Settings, moving: bool = False) -> Resolved:
        """For those splats, seen by that camera. moving: whether motion blurs the picture.

        In a parallel view, still splats must be those that `ahead` leaves.
        """
        shape = kernel(settings.kernel)
        samples = settings.samples if settings.antialias == "supersample" else 1
        fine = camera.resized((camera.size[0] * samples, camera.size[1] * samples))
        nearest, farthest = depth_range(splats, camera)
        z_k = fine.z_k(splats.grid.smallest_spacing)
        antialias, antialias_notes = _antialias(settings, z_k, farthest)
        shading, shading_notes = _shading(splats, settings)
        widened = widening(splats, View.of(splats.grid, fine, shape, antialias))
        return cls(
            blend=settings.blend,
            kernel=shape,
            samples=samples,
            camera=fine,
            z_k=z_k,
            nearest=nearest,
            farthest=farthest,
            antialias=antialias,
            attenuation=_attenuation(settings, antialias or moving),
            shading=shading,
            beyond=widened.beyond,
            unsure=widened.unsure,
            background=settings.background,
            antialias_notes=antialias_notes,
            shading_notes=shading_notes,
        )


def depth_range(splats: Splats, camera: Camera) -> tuple[float, float]:
    """Smallest and largest depth, world units, of the box of all splats."""
    depth = camera.eye_from_points(splats.corners)[:, 2]
    return float(depth.min()), float(depth.max())


def _antialias(settings: Settings, z_k: float, farthest: float) -> tuple[bool, tuple[str, ...]]:
    """Only if a splat lies beyond z_k; with notes."""
    if settings.antialias == "off" or farthest >= z_k:
        return settings.antialias != "off", ()
    return False, (f"antialiasing left out: every splat is nearer than z_k = {z_k:.6g}; the picture is the same",)


def _shading(splats: Splats, settings: Settings) -> tuple[bool, tuple[str, ...]]:
    """As the transfer function says where the settings don't; with notes."""
    if settings.shading != "auto":
        return settings.shading == "on", ()
    if not splats.shaded or settings.blend == "composite":
        return splats.shaded, ()
    return False, (f"shading left out: {settings.blend} shows values, not surfaces; the picture would be another",)


def _attenuation(settings: Settings, weakened: bool) -> str:
    """The forms differ in composite alone, and are alike before z_k where nothing moves. Measured over walls, edges,
    threads, dots, fog and real volumes, fill is the nearest to supersampling.
    """
    if settings.blend != "composite" or not weakened:
        return "optical-depth"
    return "fill" if settings.attenuation == "auto" else settings.attenuation

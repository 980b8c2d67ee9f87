"""`Resolved`: the settings resolved for one picture, independent of the technique.

`plan` adds the choices for OpenGL; the float64 references use this alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from splatgl.splat.extraction.splats import Splats
from splatgl.splat.kernel.kernels import Kernel, kernel
from splatgl.splat.plan.blend_mode import BLENDS, BlendMode
from splatgl.splat.plan.settings import Settings
from splatgl.splat.view.camera import Camera, check_reach
from splatgl.splat.view.view import View
from splatgl.splat.view.widening import widening


@dataclass(frozen=True)
class Look:
    """Appearance of splats. attenuation: opacity, optical-depth or fill. shading: whether lit from the eye."""

    blend: BlendMode
    attenuation: str
    shading: bool


@dataclass(frozen=True)
class Resolved:
    """The settings resolved for one picture, without `auto`. Depths are in world units.

    view: at samples × samples a pixel; whether any splat is widened, and beyond which depths. camera: likewise.
    z_k: depth at which the smallest voxel is one sample wide [M98 Eq. 3]. depths: of the box of all splats, nearest and
    farthest. unsure: see widening.py. background: linear RGB, None: transparent. notes: omitted steps with reasons, a
    line each.
    """

    look: Look
    samples: int
    camera: Camera
    view: View
    z_k: float
    depths: tuple[float, float]
    unsure: float
    background: tuple[float, float, float] | None
    tolerance: float
    notes: tuple[str, ...] = ()

    @property
    def kernel(self) -> Kernel:
        """The view's kernel."""
        return self.view.kernel

    @classmethod
    def of(cls, splats: Splats, camera: Camera, settings: Settings, moving: bool = False) -> Resolved:
        """Resolves the settings for splats and camera. moving: whether the picture is motion-blurred.

        In a parallel view, still splats must be the result of `ahead`.
        """
        samples = settings.samples if settings.antialias == "supersample" else 1
        fine = camera.resized((camera.size[0] * samples, camera.size[1] * samples))
        if len(splats):
            check_reach(splats.corners, camera, splats.grid.mean_spacing)
        depths = depth_range(splats, camera)
        z_k = fine.z_k(splats.grid.smallest_spacing)
        antialias, antialias_notes = _antialias(settings, z_k, depths[1])
        shading, shading_notes = _shading(splats, settings)
        view = View.of(splats.grid, fine, kernel(settings.kernel), antialias)
        widened = widening(splats, view)
        return cls(
            look=Look(BLENDS[settings.blend], _attenuation(settings, antialias or moving), shading),
            samples=samples,
            camera=fine,
            view=replace(view, beyond=widened.beyond),
            z_k=z_k,
            depths=depths,
            unsure=widened.unsure,
            background=settings.background,
            tolerance=settings.tolerance,
            notes=antialias_notes + shading_notes,
        )


def depth_range(splats: Splats, camera: Camera) -> tuple[float, float]:
    """Smallest and largest depth, world units, of the box of all splats."""
    depth = camera.eye_from_points(splats.corners)[:, 2]
    return float(depth.min()), float(depth.max())


def _antialias(settings: Settings, z_k: float, farthest: float) -> tuple[bool, tuple[str, ...]]:
    """Whether antialiasing is on and a splat lies beyond z_k; with notes."""
    if settings.antialias == "off" or farthest >= z_k:
        return settings.antialias != "off", ()
    return False, (f"antialiasing left out: every splat is nearer than z_k = {z_k:.6g}; the picture is the same",)


def _shading(splats: Splats, settings: Settings) -> tuple[bool, tuple[str, ...]]:
    """Whether splats are shaded, by the settings, else by the transfer function; with notes."""
    if settings.shading != "auto":
        return settings.shading == "on", ()
    if not splats.shaded or BLENDS[settings.blend].ordered:
        return splats.shaded, ()
    return False, (f"shading left out: {settings.blend} shows values, not surfaces; the picture would be another",)


def _attenuation(settings: Settings, weakened: bool) -> str:
    """The attenuation form. Forms differ only in composite, and before z_k only under motion. Measured over walls,
    edges, threads, dots, fog and real volumes, fill is the nearest to supersampling.
    """
    if not BLENDS[settings.blend].ordered or not weakened:
        return "optical-depth"
    return "fill" if settings.attenuation == "auto" else settings.attenuation

"""`Resolved`: the settings resolved for one picture, independent of the technique.

`plan` adds the choices for OpenGL; the float64 references use this alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from splatgl.errors import InputError, expected
from splatgl.splat.classification.shading import LIGHTS, Light
from splatgl.splat.cues.cues import Cues
from splatgl.splat.extraction.splats import MOST_KEPT, Splats
from splatgl.splat.kernel.kernels import BOX, Kernel, kernel
from splatgl.splat.plan.blend_mode import BLENDS, BlendMode
from splatgl.splat.plan.settings import Settings
from splatgl.splat.plan.suited import as_boxes, one_by_one
from splatgl.splat.sheets.sheets import MOST_SHEETS, Sheets
from splatgl.splat.view.camera import Camera, check_reach
from splatgl.splat.view.clip import Clip
from splatgl.splat.view.mask import MaskField
from splatgl.splat.view.view import View
from splatgl.splat.view.widening import widening

# kinds of antialiasing whose pixels are means of samples
AVERAGED = ("auto", "supersample")
# samples along each axis from these tolerances on; and at most: beyond, voxels are widened besides
SAMPLES = ((0.05, 1), (1e-3, 2), (0.0, 3))
MOST_SAMPLES = 4
# most samples along a side of the picture, which OpenGL can draw into, and in all of it, 1 GiB
MOST_SIDE, MOST_AREA = 16384, 2**26
# kernel of splats that are classified before
PRE_KERNEL = "crawfis-max"
# sheets that share a splat, and parts of a sheet, from these tolerances on
SHEETS = ((0.03, 2, 1), (0.005, 2, 2), (3e-3, 3, 2), (0.0, 3, 3))
# such parts in blends of one value, at whose ends and middles extremes are looked for
ONE_VALUE_STEPS = 2
# weight of the differences across a pixel's edges in its mean (Euler–Maclaurin)
END_CORRECTION = 1 / 24


@dataclass(frozen=True)
class Look:
    """Appearance of splats. attenuation: opacity, optical-depth or fill. shading: whether lit from the eye.

    sheets: sheets that share a splat; 0: splats composite one by one. steps: parts of a sheet, each classified
    once; 0: splats are classified before. weighted: whether gradients weigh opacities classified there. clipped:
    whether planes cut rays. masked: whether a mask does. light: of what is shaded. sky, shadows: whether matter keeps
    ambient and direct light off.
    """

    blend: BlendMode
    attenuation: str
    shading: bool
    sheets: int = 0
    steps: int = 0
    weighted: bool = False
    clipped: bool = False
    masked: bool = False
    light: Light = LIGHTS["head"]
    sky: bool = False
    shadows: bool = False


@dataclass(frozen=True)
class Resolved:
    """The settings resolved for one picture, without `auto`. Depths are in world units.

    averaged: whether pixels are means of samples with the end correction of resolve.frag.
    view: at samples × samples a pixel; whether any splat is widened, and beyond which depths. camera: likewise.
    z_k: depth at which the smallest voxel is one sample wide [M98 Eq. 3]. depths: of the box of all splats, nearest and
    farthest. unsure: see widening.py. background: linear RGB, None: transparent. notes: omitted steps with reasons, a
    line each. sheets: None: splats composite one by one. clip: the planes that cut rays; None: no ray is cut.
    mask: what cuts them besides; None: nothing. cues: what light reaches matter; None: all of it.
    """

    look: Look
    samples: int
    averaged: bool
    camera: Camera
    view: View
    z_k: float
    depths: tuple[float, float]
    unsure: float
    background: tuple[float, float, float] | None
    tolerance: float
    notes: tuple[str, ...] = ()
    sheets: Sheets | None = None
    clip: Clip | None = None
    mask: MaskField | None = None
    cues: Cues | None = None

    @property
    def kernel(self) -> Kernel:
        """The view's kernel."""
        return self.view.kernel

    @property
    def boxes(self) -> bool:
        """Whether splats are boxes of voxels, which rays cross one by one, in the order of cells."""
        return self.kernel is BOX

    @classmethod
    def of(cls, splats: Splats, camera: Camera, settings: Settings, moving: bool = False) -> Resolved:
        """Resolves the settings for splats and camera. moving: whether the picture is motion-blurred.

        In a parallel view, still splats must be the result of `ahead`.
        """
        depths = depth_range(splats, camera)
        pixel = float(camera.pixel_pitch(depths[1])) / splats.grid.smallest_spacing
        samples, samples_notes = _samples(settings, pixel, camera.size)
        fine = camera.resized((camera.size[0] * samples, camera.size[1] * samples))
        if len(splats):
            check_reach(splats.corners, camera, splats.grid.mean_spacing)
        z_k = fine.z_k(splats.grid.smallest_spacing)
        boxes = as_boxes(splats, settings, moving)
        antialias, antialias_notes = (False, ()) if boxes else _antialias(settings, z_k, depths[1])
        shading, shading_notes = _shading(splats, settings)
        shape = BOX if boxes else kernel(kernel_name(splats, settings))
        view = View.of(splats.grid, fine, shape, antialias)
        widened = widening(splats, view)
        sheets, sheets_notes = _sheets(splats, settings, view, moving)
        # widened weights of means need no attenuation
        after = sheets is not None and sheets.steps > 0
        attenuation = "optical-depth" if after else _attenuation(settings, antialias or moving)
        clip = Clip.of(settings.clip, splats.grid) if after or boxes else None
        mask = splats.mask if after else None
        look = Look(BLENDS[settings.blend], attenuation, shading, clipped=clip is not None, masked=mask is not None)
        light = Light.of(settings.light, settings.light_from, settings.shadows > 0)
        cues, cues_notes = _cues(splats, camera, settings, light)
        if cues is not None:
            look = replace(look, sky=cues.occlusion > 0, shadows=cues.light is not None)
        look = replace(look, light=light)
        if sheets:
            weighted = splats.post is not None and bool(splats.post.transfer.gradient) and not look.blend.one_value
            look = replace(look, sheets=sheets.count, steps=sheets.steps, weighted=weighted)
        return cls(
            look=look,
            samples=samples,
            averaged=settings.antialias in AVERAGED,
            camera=fine,
            view=replace(view, beyond=widened.beyond),
            z_k=z_k,
            depths=depths,
            unsure=widened.unsure,
            background=settings.background,
            tolerance=settings.tolerance,
            notes=samples_notes + antialias_notes + shading_notes + cues_notes + sheets_notes,
            sheets=sheets,
            clip=clip,
            mask=mask,
            cues=cues,
        )


def kernel_name(splats: Splats, settings: Settings) -> str:
    """The kernel that reconstructs; InputError if values were extracted for another."""
    if splats.post is None:
        return settings.kernel if settings.kernel != "auto" else PRE_KERNEL
    if settings.kernel not in ("auto", splats.post.kernel):
        raise expected("kernel", f"auto or {splats.post.kernel}", settings.kernel, "extract the volume for that kernel")
    return splats.post.kernel


def _sheets(splats: Splats, settings: Settings, view: View, moving: bool) -> tuple[Sheets | None, tuple[str, ...]]:
    """The sheets of a picture, None if splats composite one by one; with notes. InputError for what can't be drawn."""
    _check_classification(splats, settings, moving)
    post = splats.post is not None
    if view.kernel is BOX:
        return None, ()
    why = None if settings.compositing == "sheets" else one_by_one(settings, moving)
    if not post and (why or moving or not BLENDS[settings.blend].ordered):
        left = why and settings.compositing == "auto" and BLENDS[settings.blend].ordered
        return None, (f"sheets left out: {why} takes splats one by one; the picture would be another",) if left else ()
    if settings.attenuation == "opacity":
        raise expected("attenuation", "optical-depth or fill, which add up within sheets", "opacity")
    count, steps = next((count, steps) for tolerance, count, steps in SHEETS if settings.tolerance >= tolerance)
    if BLENDS[settings.blend].one_value:
        steps = ONE_VALUE_STEPS
    sheets = Sheets.of(view.kernel, settings.sheets or count, (settings.steps or steps) if post else 0)
    first, last = sheets.range(splats, view)
    if last - first < MOST_SHEETS and len(splats) <= MOST_KEPT:
        return sheets, ()
    many = f"at most {MOST_SHEETS:,} sheets and {MOST_KEPT:,} splats"
    if post:
        raise expected("splats", many, f"{last - first + 1:,} and {len(splats):,}", "take a part of the volume")
    return None, (f"sheets left out: they take {many}; the picture would be another",)


def _check_classification(splats: Splats, settings: Settings, moving: bool) -> None:
    """InputError for what splats that are classified before or after reconstruction can't draw."""
    post, blend = splats.post, BLENDS[settings.blend]
    if settings.classification not in ("auto", "post" if post else "pre"):
        raise InputError(
            f"classification {settings.classification}: the splats were extracted to be classified "
            f"{'after' if post else 'before'} reconstruction; extract them with that classification"
        )
    if blend.post_only if post is None else blend.one_value and not post.every:
        raise InputError(
            f"blend {blend.name} takes all voxels, classified after reconstruction: "
            'render with --classification post, extract with classification="post-all"'
        )
    if post and moving:
        raise InputError(
            "streaks take splats that are classified before reconstruction: extract them so, or use motion auto"
        )
    if post and blend.one_value and settings.shading == "on":
        raise expected("shading", f"auto or off, as {blend.name} shows values, not surfaces", "on")


def depth_range(splats: Splats, camera: Camera) -> tuple[float, float]:
    """Smallest and largest depth, world units, of the box of all splats."""
    depth = camera.eye_from_points(splats.corners)[:, 2]
    return float(depth.min()), float(depth.max())


def _samples(settings: Settings, pixel: float, size: tuple[int, int]) -> tuple[int, tuple[str, ...]]:
    """Samples along each axis of a pixel, and notes. pixel: its width in smallest voxels at the farthest splat."""
    if settings.antialias != "auto":
        return (settings.samples if settings.antialias == "supersample" else 1), ()
    least = next(k for tolerance, k in SAMPLES if settings.tolerance >= tolerance)
    wanted = int(np.clip(np.ceil(pixel), least, MOST_SAMPLES))
    fits = max(1, min(MOST_SIDE // max(size), int(np.sqrt(MOST_AREA / (size[0] * size[1])))))
    if wanted <= fits:
        return wanted, ()
    return fits, (f"{wanted}×{wanted} samples a pixel left out: the picture is too large; its edges alias more",)


def _antialias(settings: Settings, z_k: float, farthest: float) -> tuple[bool, tuple[str, ...]]:
    """Whether voxels are widened beyond z_k, and one lies there; with notes."""
    if settings.antialias == "off" or farthest >= z_k:
        return settings.antialias != "off", ()
    why = f"every splat is nearer than z_k = {z_k:.6g}; the picture is the same"
    return False, (f"widening of voxels left out: {why}",)


def _shading(splats: Splats, settings: Settings) -> tuple[bool, tuple[str, ...]]:
    """Whether splats are shaded, by the settings, else by the transfer function; with notes."""
    if settings.shading != "auto":
        return settings.shading == "on", ()
    if not splats.shaded or BLENDS[settings.blend].ordered:
        return splats.shaded, ()
    return False, (f"shading left out: {settings.blend} shows values, not surfaces; the picture would be another",)


def _cues(splats: Splats, camera: Camera, settings: Settings, light: Light) -> tuple[Cues | None, tuple[str, ...]]:
    """What light reaches matter, None if all; with notes."""
    asked = [name for name in ("ambient_occlusion", "shadows") if getattr(settings, name) > 0]
    if not asked or not len(splats):
        return None, ()
    if not BLENDS[settings.blend].ordered:
        why = f"{settings.blend} shows values, not surfaces; the picture would be another"
        return None, (f"{' and '.join(asked).replace('_', ' ')} left out: {why}",)
    shines = light.within(camera) if settings.shadows > 0 else None
    notes = ("shadows left out: those of a light at the eye are not seen",) * (settings.shadows > 0 and shines is None)
    if not settings.ambient_occlusion and shines is None:
        return None, notes
    casters = ((splats, settings.clip),)
    toward = None if shines is None else -shines
    return Cues(casters, splats.grid, settings.ambient_occlusion, settings.shadows, toward), notes


def _attenuation(settings: Settings, weakened: bool) -> str:
    """The attenuation form. Forms differ only in composite, and before z_k only under motion. Measured over walls,
    edges, threads, dots, fog and real volumes, fill is the nearest to supersampling.
    """
    if not BLENDS[settings.blend].ordered or not weakened:
        return "optical-depth"
    return "fill" if settings.attenuation == "auto" else settings.attenuation

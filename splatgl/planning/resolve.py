"""`Resolved`: the settings of a picture without `auto`, and the splats that they need.

`plan` adds the choices for OpenGL; the float64 references use this alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from splatgl.data.color import srgb_from_linear
from splatgl.data.volume import Volume
from splatgl.errors import InputError, expected
from splatgl.geometry.camera import Camera, check_reach
from splatgl.geometry.clipping import Clip, clip_splats
from splatgl.geometry.mask_field import MaskField
from splatgl.geometry.view import GridView, widening
from splatgl.options import LIMITED
from splatgl.planning.ambient_occlusion import LightVolume
from splatgl.splat.extract import POST_KERNEL, Progress, SplatSource, extract, why_only_pre
from splatgl.splat.hidden_interior import LEFT_OUT, TOLERANCE
from splatgl.splat.kernels import BOX, FREE, Kernel, has_negative, kernel
from splatgl.splat.lighting import LIGHTS, LightModel
from splatgl.splat.motion_blur import MOTIONS
from splatgl.splat.settings import AVERAGED, Blend, Blending, Motions, Settings
from splatgl.splat.sheets import MOST_SHEETS, Sheets
from splatgl.splat.splats import MOST_KEPT, Splats
from splatgl.transfer.preintegration import ValueClassifier
from splatgl.transfer.transfer import Transfer

# samples along each axis of pixels that may take one instead; share of the tolerance that its end correction may reach;
# and the width of these pixels, in voxels: most tiles of wider ones have edges
SPARED, SPARED_SHARE, SPARED_PIXEL = 2, 0.25, 0.6
# tolerances, and samples along each axis for them; beyond the most samples voxels are widened too
SAMPLES = ((0.05, 1), (1e-3, 2), (0.0, 3))
MOST_SAMPLES = 4
# most samples along a side of the picture (OpenGL's limit), and in the whole picture (1 GiB)
MOST_SIDE, MOST_AREA = 16384, 2**26
# kernel of splats that are classified before reconstruction
PRE_KERNEL = "crawfis-max"
# tolerances, sheets that share a splat, and parts of a sheet for them
SHEETS = ((0.03, 2, 1), (0.005, 2, 2), (3e-3, 3, 2), (0.0, 3, 3))
# parts of a sheet in blends of one value, which sample extremes at the ends and middles of parts
ONE_VALUE_STEPS = 2
# weight of the differences across a pixel's edges in its mean (Euler–Maclaurin)
END_CORRECTION = 1 / 24


@dataclass(frozen=True)
class Appearance(Blending):
    """Appearance of splats. attenuation: opacity, optical-depth or fill. shading: whether splats are lit.

    sheets: sheets that share a splat; 0: splats composite one by one. steps: parts of a sheet, each classified
    once; 0: splats are classified before reconstruction. weighted: whether gradients weigh opacities of steps. regions:
    whether there is matter in regions of value and gradient. clipped, masked: whether planes or a mask clip rays. iso:
    "lit" or "flat" iso-surfaces, "": none. light: of shaded splats. sky, shadows: whether matter occludes
    ambient and direct light.
    """

    blend: Blend
    attenuation: str
    shading: bool
    sheets: int = 0
    steps: int = 0
    weighted: bool = False
    regions: bool = False
    clipped: bool = False
    masked: bool = False
    iso: str = ""
    light: LightModel = LIGHTS["head"]
    sky: bool = False
    shadows: bool = False


@dataclass(frozen=True)
class Resolved:
    """The settings resolved for one picture, without `auto`. Depths are in world units.

    averaged: whether pixels are means of samples with the end correction of resolve.frag. allowed: largest end
    correction of one sample with which a tile takes no more; 0: all take samples × samples. camera, view: at samples ×
    samples a pixel. z_k: depth at which the smallest voxel is as wide as the low-pass, by default one sample
    [M98 Eq. 3]. depths: nearest and farthest depth of the box of all splats. unsure: see view.py. background: linear
    RGB; None: transparent. notes: omitted steps with reasons, a line each. sheets: None: splats composite one by one.
    clip, mask: planes and mask that clip rays. cues: light that reaches matter; None: all light. mip_attenuation: per
    reference length. display: whether display values are mixed.
    """

    appearance: Appearance
    samples: int
    averaged: bool
    camera: Camera
    view: GridView
    z_k: float
    depths: tuple[float, float]
    unsure: float
    background: tuple[float, float, float] | None
    tolerance: float
    notes: tuple[str, ...] = ()
    sheets: Sheets | None = None
    clip: Clip | None = None
    mask: MaskField | None = None
    cues: LightVolume | None = None
    allowed: float = 0.0
    mip_attenuation: float = 0.0
    display: bool = False

    @property
    def behind(self) -> tuple[float, ...] | None:
        """The background in the light that is mixed; None if it is transparent, and of sums."""
        if self.background is None or self.appearance.is_sum:
            return None
        return tuple(srgb_from_linear(np.array(self.background)).tolist()) if self.display else self.background

    @property
    def kernel(self) -> Kernel:
        """The view's kernel."""
        return self.view.kernel

    def is_fine(self, splats: Splats) -> bool:
        """Whether voxels of the farthest splats are narrower than a sample."""
        return self.depths[1] > self.camera.z_k(splats.grid.smallest_spacing)

    @property
    def boxes(self) -> bool:
        """Whether splats are boxes of voxels, composited one by one in the order of cells."""
        return self.kernel is BOX

    def info(self, splats: Splats, camera: Camera) -> dict[str, object]:
        """The scene, view and settings of a picture, as plain values that the text of a PNG can store."""
        return {
            "scene": splats.name,
            "splats": len(splats),
            "size": list(camera.size),
            "projection": "perspective" if camera.perspective else "orthographic",
            "eye": camera.eye.tolist(),
            **dict(zip(("right", "down", "forward"), camera.eye_from_world.tolist(), strict=True)),
            "extent": camera.extent,
            "blend": self.appearance.blend,
            "kernel": self.kernel.name,
            "antialias": self.view.antialias,
            "samples": self.samples,
            "averaged": self.averaged,
            "aliased": not self.averaged and (not self.view.antialias or self.view.blur < 1) and self.is_fine(splats),
            "classification": "post" if self.appearance.steps else "pre",
            "sheets": self.appearance.sheets,
            "steps": self.appearance.steps,
            "attenuation": self.appearance.attenuation,
            "shading": self.appearance.shading,
            "background": None if self.background is None else list(self.background),
        }

    @classmethod
    def of(cls, splats: Splats, camera: Camera, settings: Settings, moving: bool = False) -> Resolved:
        """Resolves the settings for splats and camera. moving: whether the picture is motion-blurred.

        In a parallel view, still splats must be the result of `clip_behind_eye`.
        """
        depths, notes = depth_range(splats, camera), list[str]()
        samples = samples_per_pixel(splats, camera, settings, notes)
        fine = camera.resized((camera.size[0] * samples, camera.size[1] * samples))
        if len(splats):
            check_reach(splats.corners, camera, splats.grid.mean_spacing)
        z_k = fine.z_k(splats.grid.smallest_spacing / settings.filter_width)
        boxes = draws_boxes(splats, settings, moving)
        antialias, lit = not boxes and _antialias(settings, z_k, depths[1], notes), _shading(splats, settings, notes)
        light = LightModel.of(settings.light, settings.light_from, settings.shadows > 0, settings.strengths)
        cues = _cues(splats, camera, settings, light, notes)
        shape = BOX if boxes else kernel(kernel_name(splats, settings))
        if shape is not BOX and has_negative(shape.name):
            _check_sum(shape.name, splats, settings, moving)
        view = GridView.of(splats.grid, fine, shape, antialias, settings.filter_width)
        beyond, unsure = widening(splats, view)
        sheets = _sheets(splats, settings, view, moving, notes)
        # widened weights of means need no attenuation
        after = sheets is not None and sheets.steps > 0
        clip, mask = (Clip.of(settings.clip, splats.grid) if after or boxes else None), (splats.mask if after else None)
        appearance = Appearance(
            settings.blend,
            attenuation="optical-depth" if after else attenuation_form(settings, antialias or moving),
            shading=lit,
            sheets=sheets.count if sheets else 0,
            steps=sheets.steps if sheets else 0,
            weighted=splats.post is not None and bool(splats.post.transfer.gradient) and not settings.shows_value,
            regions=splats.post is not None and bool(splats.post.transfer.regions),
            clipped=clip is not None,
            masked=mask is not None,
            iso=_iso_light(splats, settings),
            light=light,
            sky=cues is not None and cues.occlusion > 0,
            shadows=cues is not None and cues.light is not None,
        )
        return cls(
            appearance=appearance,
            samples=samples,
            averaged=settings.antialias in AVERAGED,
            camera=fine,
            view=replace(view, beyond=beyond),
            z_k=z_k,
            depths=depths,
            unsure=unsure,
            background=settings.ground,
            tolerance=settings.tolerance,
            notes=tuple(notes),
            sheets=sheets,
            clip=clip,
            mask=mask,
            cues=cues,
            allowed=_allowed(splats, camera, settings, samples) if after and settings.hides and not antialias else 0.0,
            mip_attenuation=settings.mip_attenuation,
            display=splats.display,
        )


def voxel_kernel(settings: Settings) -> str:
    """The kernel of voxels that are classified before reconstruction. One without limits is of values alone."""
    return PRE_KERNEL if settings.kernel in ("auto", FREE) else settings.kernel


def kernel_name(splats: Splats, settings: Settings) -> str:
    """The kernel that reconstructs; InputError if values were extracted for another."""
    if splats.post is None:
        return voxel_kernel(settings)
    if settings.kernel not in ("auto", splats.post.kernel):
        raise expected("kernel", f"auto or {splats.post.kernel}", settings.kernel, "extract the volume for that kernel")
    return splats.post.kernel


def _check_sum(name: str, splats: Splats, settings: Settings, moving: bool) -> None:
    """Raises InputError for pictures that a kernel cannot draw which has negative values: 1 − exp(−τ) of a splat
    whose τ is negative is no opacity, means of values may divide by 0, and streaks have no negative energy.
    """
    this = "blend xray of still voxels classified before, where depths add up"
    how = ", classified after" * (splats.post is not None) + ", motion blur" * moving
    if not settings.is_sum or how:
        got = f"blend {settings.blend}{how}"
        raise expected(f"kernel {name}, which has negative values", this, got, "b-spline is sharp without that")


def _sheets(splats: Splats, settings: Settings, view: GridView, moving: bool, notes: list[str]) -> Sheets | None:
    """The sheets of a picture; None if splats composite one by one. Raises InputError for settings that sheets do not
    support.
    """
    _check_classification(splats, settings, moving)
    post = splats.post is not None
    if view.kernel is BOX:
        return None
    why = None if settings.compositing == "sheets" else why_per_splat(settings, moving)
    if not post and (why or moving or not settings.hides):
        if why and settings.compositing == "auto" and settings.hides:
            notes.append(f"sheets left out: {why} needs compositing of single splats (changes the picture)")
        return None
    if settings.attenuation == "opacity":
        raise expected("attenuation", "optical-depth or fill, which add up within sheets", "opacity")
    count, steps = next((count, steps) for tolerance, count, steps in SHEETS if settings.tolerance >= tolerance)
    if settings.shows_value:
        steps = ONE_VALUE_STEPS
    sheets = Sheets.of(view.kernel, settings.sheets or count, (settings.steps or steps) if post else 0)
    first, last = sheets.range(splats, view)
    if last - first < MOST_SHEETS and len(splats) <= MOST_KEPT:
        return sheets
    many = f"at most {MOST_SHEETS:,} sheets and {MOST_KEPT:,} splats"
    if post:
        raise expected("splats", many, f"{last - first + 1:,} and {len(splats):,}", "take a part of the volume")
    notes.append(f"sheets left out: they take {many} {LIMITED}")
    return None


def _check_classification(splats: Splats, settings: Settings, moving: bool) -> None:
    post, shows_value = splats.post, settings.shows_value
    if settings.classification not in ("auto", "post" if post else "pre"):
        raise InputError(
            f"classification {settings.classification}: the splats were extracted to be classified "
            f"{'after' if post else 'before'} reconstruction; extract them with that classification"
        )
    if post is not None and shows_value and post.transfer.regions:
        raise expected("blend", "composite or xray with regions over gradients", settings.blend, "state points instead")
    if settings.needs_values if post is None else shows_value and not holds_blend(post, settings):
        raise InputError(
            f"blend {settings.blend} takes all voxels, classified after reconstruction: "
            'render with --classification post, extract with classification="post-all"'
        )
    if post and moving:
        raise InputError(
            "streaks take splats that are classified before reconstruction: extract them so, or use motion auto"
        )
    if post and post.transfer.iso and not settings.hides:
        raise expected("blend", "composite, as there are iso-surfaces", settings.blend)
    if post and shows_value and settings.shading == "on":
        raise expected("shading", f"auto or off, as {settings.blend} shows values, not surfaces", "on")


def depth_range(splats: Splats, camera: Camera) -> tuple[float, float]:
    """Smallest and largest depth, world units, of the box of all splats."""
    depth = camera.eye_from_points(splats.corners)[:, 2]
    return float(depth.min()), float(depth.max())


def farthest_pixel(splats: Splats, camera: Camera) -> float:
    """Width of a pixel in smallest voxels at the farthest splat."""
    _, farthest = depth_range(splats, camera)
    return float(camera.pixel_pitch(farthest)) / splats.grid.smallest_spacing


def samples_per_pixel(splats: Splats, camera: Camera, settings: Settings, notes: list[str] | None = None) -> int:
    """Samples along each axis of a pixel. camera: of the picture."""
    if settings.antialias != "auto":
        return settings.samples if settings.antialias == "supersample" else 1
    least = next(k for tolerance, k in SAMPLES if settings.tolerance >= tolerance)
    wanted, size = int(np.clip(np.ceil(farthest_pixel(splats, camera)), least, MOST_SAMPLES)), camera.size
    fits = max(1, min(MOST_SIDE // max(size), int(np.sqrt(MOST_AREA / (size[0] * size[1])))))
    if wanted > fits and notes is not None:
        notes.append(
            f"{wanted}×{wanted} samples a pixel left out: the picture is too large, its edges alias more {LIMITED}"
        )
    return min(wanted, fits)


def _allowed(splats: Splats, camera: Camera, settings: Settings, samples: int) -> float:
    """Largest end correction of one sample with which a tile of pixels takes no more. camera: of the picture."""
    # rims of surfaces that planes cut may lie between the samples of like pixels
    has_rims = bool(settings.clip) and splats.post is not None and bool(splats.post.transfer.iso)
    spared = settings.antialias == "auto" and samples == SPARED and not has_rims
    return SPARED_SHARE * settings.tolerance if spared and farthest_pixel(splats, camera) <= SPARED_PIXEL else 0.0


def _antialias(settings: Settings, z_k: float, farthest: float, notes: list[str]) -> bool:
    """Whether any voxel is widened, as one lies beyond z_k."""
    if settings.antialias != "off" and not farthest >= z_k:
        why = f"every splat is nearer than z_k = {z_k:.6g}; the picture is the same"
        notes.append(f"widening of voxels left out: {why}")
        return False
    return settings.antialias != "off"


def _shading(splats: Splats, settings: Settings, notes: list[str]) -> bool:
    """Whether splats are shaded, by the settings or the transfer function."""
    if settings.shading != "auto":
        return settings.shading == "on"
    if splats.shaded and not settings.hides:
        notes.append(f"shading left out: {settings.blend} shows values, not surfaces (changes the picture)")
        return False
    return splats.shaded


def _iso_light(splats: Splats, settings: Settings) -> str:
    """How iso-surfaces are lit, see Appearance."""
    if splats.post is None or not splats.post.transfer.iso:
        return ""
    return "flat" if settings.shading == "off" else "lit"


def _cues(
    splats: Splats, camera: Camera, settings: Settings, light: LightModel, notes: list[str]
) -> LightVolume | None:
    """Shadowing and ambient occlusion of the splats; None: unattenuated light."""
    names = [name for name in ("ambient_occlusion", "shadows") if getattr(settings, name) > 0]
    if not names or not len(splats):
        return None
    if not settings.hides:
        why = f"{settings.blend} shows values, not surfaces (changes the picture)"
        notes.append(f"{' and '.join(names).replace('_', ' ')} left out: {why}")
        return None
    toward = None
    if settings.shadows > 0:
        direction = light.within(camera)
        if direction is None:
            notes.append("shadows left out: the light is at the camera")
        else:
            toward = -direction
    if not settings.ambient_occlusion and toward is None:
        return None
    casters = ((splats, settings.clip),)
    return LightVolume(casters, splats.grid, settings.ambient_occlusion, settings.shadows, toward)


def attenuation_form(settings: Settings, weakened: bool) -> str:
    """The form of attenuation. Forms differ only in composite, and before z_k only under motion. fill is the closest to
    supersampling, measured on walls, edges, threads, dots, fog and real volumes.
    """
    if not settings.hides or not weakened:
        return "optical-depth"
    return "fill" if settings.attenuation == "auto" else settings.attenuation


# bits of a radial table's texels
RADIAL_BITS = 32


def has_radial_footprints(settings: Settings) -> bool:
    """Whether footprints depend only on the distance of a ray from the voxel."""
    return not _why_table(settings)


def _why_table(settings: Settings) -> str:
    """The setting with which footprints are a table over two axes; "": none."""
    if settings.align not in ("auto", "exact"):
        return f"align {settings.align}"
    if settings.footprint == "table":
        return "footprint table"
    return f"table_bits {settings.table_bits}" if settings.table_bits != RADIAL_BITS else ""


def why_not_front_to_back(settings: Settings) -> str | None:
    """The setting that prevents float32, front-to-back order or radial footprints; None if there is none."""
    if settings.target not in ("auto", "rgba32f"):
        return f"target {settings.target}"
    if settings.hides and settings.order == "back-to-front":
        return "order back-to-front"
    return _why_table(settings) or None


def has_streaks(settings: Settings) -> bool:
    """Whether the settings request streaks; blends of one value have none."""
    return settings.motion in MOTIONS and not settings.shows_value


def draws_boxes(splats: Splats, settings: Settings, moving: bool) -> bool:
    """Whether splats are voxels of labels, drawn as boxes unless the settings request footprints of a kernel.

    moving: whether the picture has streaks.
    """
    plain = settings.kernel in ("auto", FREE) and settings.attenuation != "opacity" and settings.antialias != "paper"
    return splats.labels is not None and plain and has_radial_footprints(settings) and not moving


def blur_form(splats: Splats, settings: Settings) -> Motions:
    """The form of motion blur: moments, off or a form of streaks.

    Streaks are exact for sums; in other blends the mean of moments has a smaller error in the same time. Values
    classified after reconstruction, and boxes of labels, have no streaks.
    """
    if settings.motion == "auto":
        if not settings.is_sum:
            return "moments"
        selected = select_splats(splats, settings, moving=True)
        return "exact" if selected.post is None and not draws_boxes(selected, settings, False) else "moments"
    if settings.motion == "off":
        return "moments" if (settings.moments or 1) > 1 else "off"
    return settings.motion if has_streaks(settings) else "moments"


def why_per_splat(settings: Settings, moving: bool) -> str | None:
    """The setting that needs splats classified before reconstruction and composited one by one; None: sheets do.

    moving: whether the picture is motion-blurred.
    """
    if moving and has_streaks(settings):
        return f"motion {settings.motion}"
    for name, value in (("compositing", "splats"), ("attenuation", "opacity")):
        if getattr(settings, name) == value:
            return f"{name} {value}"
    if settings.kernel != "auto" and has_negative(settings.kernel):
        return f"kernel {settings.kernel}, which has negative values,"
    return why_not_front_to_back(settings)


def holds_blend(post: ValueClassifier, settings: Settings) -> bool:
    """Whether the voxels that were kept serve a blend of one value."""
    return post.every or (post.largest and settings.shows_value and settings.join == "max")


def extraction_kind(settings: Settings, moving: bool, why: str | None, voxels: int) -> tuple[str, str]:
    """Classification and kernel of `extract` for a picture with these settings.

    why: reason for `pre`, see `why_only_pre`. voxels: number of voxels of the volume.
    """
    how: str = settings.classification
    if how == "auto":
        # of maxima, only few voxels may be kept
        too_many = settings.shows_value and settings.join != "max" and voxels > MOST_KEPT
        is_pre = why or why_per_splat(settings, moving) or too_many
        how = "pre" if is_pre and not settings.needs_values else "post"
    if how == "pre":
        return how, ""
    if settings.shows_value:
        how = "post-max" if settings.join == "max" else "post-all"
    return how, settings.kernel if settings.kernel != "auto" else POST_KERNEL


def extract_for_settings(
    volume: Volume,
    transfer: Transfer,
    settings: Settings,
    threshold: float = 0.0,
    progress: Progress | None = None,
    moving: bool = False,
) -> Splats:
    """Extracts the splats of a volume for a picture with these settings; other settings re-extract on demand, except
    after motion blur.

    Raises InputError as `extract`.
    """
    how, kernel = extraction_kind(settings, moving, why_only_pre(volume, transfer, threshold), volume.count)
    if settings.classification == "auto" and how == "post":
        # extract() falls back to voxels if there are too many values
        return extract(volume, transfer, threshold, progress=progress, kernel=kernel)
    splats = extract(volume, transfer, threshold, progress=progress, classification=how, kernel=kernel)
    if settings.classification != "auto":
        return splats
    source = SplatSource(volume, transfer, threshold)
    if how == "post-max" and len(splats) > MOST_KEPT:
        splats = source.made[how, kernel, 0] = source.splats("pre", "")
    return splats if moving else replace(splats, source=source)


def select_splats(splats: Splats, settings: Settings, moving: bool, camera: Camera | None = None) -> Splats:
    """Selects the splats for a picture with these settings, without clipped voxels: the given ones if they fit or have
    no source, else splats that are extracted from their source; in display values if those are mixed.

    moving: whether the picture is motion-blurred. camera: of the picture, which may need no hidden interiors; None:
    selects all splats.
    """
    selected = _classified(splats, settings, moving, camera)
    clipped = clip_splats(selected, settings.clip, draws_boxes(selected, settings, moving))
    return clipped.of_display if settings.mixes_display and not clipped.display else clipped


def _classified(splats: Splats, settings: Settings, moving: bool, camera: Camera | None) -> Splats:
    source, post = splats.source, splats.post
    if source is None:
        return splats
    how, kernel = extraction_kind(settings, moving, source.only_pre, source.volume.count)
    if post is None:
        serves = (how == "pre" and not splats.skipped_interior) or (
            how == "post" and source.many and settings.classification == "auto"
        )
    else:
        serves = (
            how != "pre"
            and post.kernel == kernel
            and ((how == "post" and not post.largest) or holds_blend(post, settings))
        )
    if serves and splats.skipped_interior:
        reach = reach_outside(splats, settings, camera)
        if 0 < reach <= splats.skipped_interior and (post is not None or kernel == POST_KERNEL):
            return splats
        if settings.classification != "auto":
            return source.splats(how, kernel)
        return source.splats("pre", "") if source.many and not reach else source.splats(how, kernel, reach)
    return splats if serves else source.splats(how, kernel)


# most voxels in the width of a pixel for which hidden interiors are found
MOST_WIDER = 64.0
# distance of the eye from splats, in voxels, up to which sheets are planes around it, which reach behind the eye
AROUND_EYE = 8.0


def reach_outside(splats: Splats, settings: Settings, camera: Camera | None) -> int:
    """Cells, a power of two, that kernels reach in a picture from outside; 0 if it may show, or light by, matter that
    hollow splats lack; see hidden_interior.py.
    """
    cut = settings.clip or settings.ambient_occlusion > 0 or settings.shadows > 0
    exact = settings.occlusion == "off" or settings.tolerance < TOLERANCE
    if camera is None or cut or exact or not settings.hides or not len(splats):
        return 0
    if camera.perspective:
        eye = splats.grid.index_from_world(camera.eye)
        if np.linalg.norm(eye - np.clip(eye, *splats.index_bounds)) < AROUND_EYE:
            return 0
    elif depth_range(splats, camera)[0] < 0:
        return 0
    if settings.antialias == "off":
        return 1
    # kernels are as much wider as a pixel is wider than a voxel
    width = farthest_pixel(splats, camera) * settings.filter_width
    wider = max(width / samples_per_pixel(splats, camera, settings), 1.0)
    return 2 ** math.ceil(math.log2(wider)) if wider <= MOST_WIDER else 0


def select_with_notes(
    splats: Splats, settings: Settings, moving: bool, camera: Camera, notes: list[str]
) -> tuple[Splats, str | None]:
    """The splats of `select_splats`, and the reason why they are classified before reconstruction, None if they are
    values. Adds notes on why `auto` classifies voxels instead of reconstructed values, or leaves some out, if it does.
    """
    selected = select_splats(splats, settings, moving, camera)
    if selected.skipped_interior:
        notes.append(LEFT_OUT)
    if selected.post is not None:
        return selected, None
    if splats.source is None or settings.classification != "auto":
        return selected, "classification pre"
    why = splats.source.only_pre or why_per_splat(settings, moving) or f"more than {MOST_KEPT:,} values"
    how = LIMITED if why.startswith(("more than", "values from")) else "(changes the picture)"
    notes.append(f"classification after reconstruction left out: {why} {how}")
    return selected, why


def check_blur_supported(what: str, settings: Settings, flow: bool) -> None:
    """Raises InputError for streaks and flows, which layers and bricks do not support. what: names them."""
    if has_streaks(settings):
        raise expected(f"motion {what}", "the mean of moments", f"motion {settings.motion}")
    if flow:
        raise expected(f"motion {what}", "a camera that moves, or all of the scene", "a flow")

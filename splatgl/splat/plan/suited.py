"""Which splats a picture takes: how they are classified, and whether they composite one by one or in sheets."""

from __future__ import annotations

from dataclasses import replace

from splatgl.data.volume import Volume
from splatgl.splat.classification.transfer import Transfer
from splatgl.splat.extraction.extract import POST_KERNEL, Progress, Source, extract, only_pre
from splatgl.splat.extraction.splats import MOST_KEPT, Splats
from splatgl.splat.motion.blur import MOTIONS
from splatgl.splat.plan.blend_mode import BLENDS
from splatgl.splat.plan.settings import Settings
from splatgl.splat.view.clip import clipped

# bits of a radial table's texels
RADIAL_BITS = 32


def by_distance(settings: Settings) -> bool:
    """Whether footprints depend on the distance alone."""
    exact = settings.align in ("auto", "exact")
    return exact and settings.footprint != "table" and settings.table_bits == RADIAL_BITS


def nearest_first(settings: Settings) -> str | None:
    """Why a picture can't be drawn in float32, nearest first, with footprints by the distance; None if it can."""
    if settings.target not in ("auto", "rgba32f"):
        return f"target {settings.target}"
    if BLENDS[settings.blend].ordered and settings.order == "back-to-front":
        return "order back-to-front"
    return None if by_distance(settings) else "footprints from a table"


def streaked(settings: Settings) -> bool:
    """Whether the settings ask for streaks, where there are any: extreme values along a ray have none."""
    return settings.motion in MOTIONS and not BLENDS[settings.blend].one_value


def as_boxes(splats: Splats, settings: Settings, moving: bool) -> bool:
    """Whether splats are voxels of labels that are drawn as boxes: unless the settings ask for footprints of a kernel.

    moving: whether the picture is of streaks.
    """
    plain = settings.kernel == "auto" and settings.attenuation != "opacity" and settings.antialias != "paper"
    return splats.labels is not None and plain and by_distance(settings) and not moving


def blur(splats: Splats, settings: Settings) -> str:
    """How a moving picture of these splats is blurred: moments, off or a form of streaks.

    For sums streaks are exact; where matter hides matter, the mean of moments has less error in the same time, and
    values classified after reconstruction, and boxes of labels, have no streaks.
    """
    if settings.motion == "auto":
        before = suited(splats, settings, moving=True)
        sums = BLENDS[settings.blend].unbounded and before.post is None and not as_boxes(before, settings, False)
        return "exact" if sums else "moments"
    if settings.motion == "off":
        return "moments" if (settings.moments or 1) > 1 else "off"
    return settings.motion if streaked(settings) else "moments"


def one_by_one(settings: Settings, moving: bool) -> str | None:
    """What takes splats that composite one by one, classified before; None if sheets serve.

    moving: whether the picture is motion-blurred.
    """
    if moving and streaked(settings):
        return f"motion {settings.motion}"
    for name, value in (("compositing", "splats"), ("attenuation", "opacity")):
        if getattr(settings, name) == value:
            return f"{name} {value}"
    return nearest_first(settings)


def kind(settings: Settings, moving: bool, why: str | None, voxels: int) -> tuple[str, str]:
    """Classification and kernel of `extract` for a picture with these settings.

    why: what takes splats classified before, see `only_pre`. voxels: of the volume.
    """
    blend, how = BLENDS[settings.blend], settings.classification
    if how == "auto":
        hindered = why or one_by_one(settings, moving) or (blend.one_value and voxels > MOST_KEPT)
        how = "pre" if hindered and not blend.post_only else "post"
    if how == "pre":
        return how, ""
    return "post-all" if blend.one_value else how, settings.kernel if settings.kernel != "auto" else POST_KERNEL


def extracted(
    volume: Volume,
    transfer: Transfer,
    settings: Settings,
    threshold: float = 0.0,
    progress: Progress | None = None,
    moving: bool = False,
) -> Splats:
    """The splats of a volume for a picture with these settings; for others too, unless they are for motion blur.

    Raises InputError as `extract`.
    """
    how, kernel = kind(settings, moving, only_pre(volume, transfer, threshold), volume.count)
    if settings.classification == "auto" and how == "post":
        # or voxels, if values are too many
        return extract(volume, transfer, threshold, progress=progress, kernel=kernel)
    found = extract(volume, transfer, threshold, progress=progress, classification=how, kernel=kernel)
    if settings.classification != "auto" or moving:
        return found
    return replace(found, source=Source(volume, transfer, threshold))


def suited(splats: Splats, settings: Settings, moving: bool) -> Splats:
    """The splats of the same volume that a picture with these settings takes; these, if they serve or know no volume.
    Voxels that planes cut off are left out.

    moving: whether the picture is motion-blurred.
    """
    found = _classified(splats, settings, moving)
    return clipped(found, settings.clip, as_boxes(found, settings, moving))


def _classified(splats: Splats, settings: Settings, moving: bool) -> Splats:
    source, post = splats.source, splats.post
    if source is None:
        return splats
    how, kernel = kind(settings, moving, source.only_pre, source.volume.count)
    if post is None:
        serves = how == "pre" or (how == "post" and source.many and settings.classification == "auto")
    else:
        serves = how != "pre" and post.kernel == kernel and (how == "post" or post.every)
    return splats if serves else source.splats(how, kernel)


def classified_before(splats: Splats, settings: Settings, moving: bool) -> str | None:
    """What takes voxels that are classified before, for a picture with these settings; None if it takes values."""
    if suited(splats, settings, moving).post is not None:
        return None
    source = splats.source
    if source is None or settings.classification != "auto":
        return "classification pre"
    return source.only_pre or one_by_one(settings, moving) or f"more than {MOST_KEPT:,} values"


def values_left_out(splats: Splats, settings: Settings, moving: bool) -> list[str]:
    """A note on why `auto` classifies voxels instead of reconstructed values, if it does."""
    if splats.source is None or settings.classification != "auto":
        return []
    why = classified_before(splats, settings, moving)
    return [f"classification after reconstruction left out: {why}; the picture would be another"] if why else []

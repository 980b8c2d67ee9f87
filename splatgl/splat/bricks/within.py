"""Whether a picture's splats fit into a budget of memory, or its volume is drawn in bricks."""

from __future__ import annotations

from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.splat.bricks.bricks import Bricks
from splatgl.splat.bricks.estimate import Need, need
from splatgl.splat.classification.post import PostClassified
from splatgl.splat.classification.transfer import Transfer
from splatgl.splat.extraction.extract import POST_KERNEL, only_pre
from splatgl.splat.extraction.splats import MOST_KEPT
from splatgl.splat.plan.blend_mode import BLENDS
from splatgl.splat.plan.settings import Settings
from splatgl.splat.plan.suited import one_by_one


def bricks_of(volume: Volume, transfer: Transfer, settings: Settings) -> Bricks | None:
    """The volume in bricks for a picture with these settings; None if it takes voxels classified before."""
    if settings.classification == "pre" or only_pre(volume, transfer, 0.0) or one_by_one(settings, moving=False):
        return None
    kernel = settings.kernel if settings.kernel != "auto" else POST_KERNEL
    every = BLENDS[settings.blend].one_value
    return Bricks.of(volume, PostClassified.of(transfer, kernel, volume.shape[::-1], every))


def required_bricks(volume: Volume, transfer: Transfer, settings: Settings) -> Bricks:
    """The volume in bricks. InputError for a picture that takes voxels classified before, with what takes them."""
    found = bricks_of(volume, transfer, settings)
    if found is None:
        why = only_pre(volume, transfer, 0.0) or one_by_one(settings, moving=False) or "classification pre"
        raise expected("a picture in parts", "values classified after reconstruction", why, "draw it whole, alone")
    return found


def fits(bricks: Bricks, size: tuple[int, int], memory: int) -> Need | None:
    """None if all splats of a picture of that size (width, height) fit into that many bytes and the GPU; else what they
    need. InputError for no bytes.
    """
    if memory <= 0:
        raise expected("memory", "a positive number of bytes", memory)
    # samples are at most 2 × 2 where voxels are not narrower than pixels
    wanted = need(bricks, 4 * size[0] * size[1], memory)
    return None if wanted.bytes <= memory and wanted.most <= MOST_KEPT else wanted

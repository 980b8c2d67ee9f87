"""Pictures of one volume from many cameras, by the workers of a Dask client."""

from __future__ import annotations

import uuid
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from splatgl.data.image import Image
from splatgl.distributed.cluster import spread
from splatgl.distributed.worker import Drawing, Subject, kept, renderer
from splatgl.readers import load
from splatgl.splat.camera import Camera
from splatgl.splat.motion import Motion
from splatgl.splat.resolve import extracted
from splatgl.splat.settings import Settings
from splatgl.splat.transfer import Transfer

if TYPE_CHECKING:
    from distributed import Client


def render_frames(
    source: str | Path,
    transfer: Transfer,
    cameras: Sequence[Camera],
    client: Client,
    settings: Settings | None = None,
    motions: Sequence[Motion] | None = None,
    drawing: Drawing | None = None,
) -> Iterator[tuple[int, Image]]:
    """(n, the image of camera n), as they are done. Each worker opens the file itself, and extracts its splats once.

    motions: of the scene since the previous frame, of each camera. drawing: how workers open OpenGL. Raises InputError
    for what a worker can't read or draw, and of a frame whose worker died three times, once all others are done.
    """
    path = Path(source).resolve() if Path(source).exists() else source
    subject = Subject(uuid.uuid4().hex, partial(load, path), transfer, settings or Settings(), drawing or Drawing())
    moved = motions if motions is not None else [None] * len(cameras)
    items = ((f"frame {n}", (subject, n, *both)) for n, both in enumerate(zip(cameras, moved, strict=True)))
    for _, found in spread(client, _frame, items):
        yield found


def _frame(subject: Subject, number: int, camera: Camera, motion: Motion | None) -> tuple[int, Image]:
    """On a worker: one picture."""
    splats = kept(
        subject.key,
        lambda: extracted(subject.open(), subject.transfer, subject.settings, moving=motion is not None),
    )
    return number, renderer(subject.drawing).render(splats, camera, subject.settings, motion)

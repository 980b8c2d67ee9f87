"""Pictures by several processes and machines, through Dask: see README.md here."""

from splatgl.distributed.cluster import connected
from splatgl.distributed.frames import render_frames
from splatgl.distributed.parts import over
from splatgl.distributed.slabs import render_slabs
from splatgl.distributed.worker import Drawing, release

__all__ = ["Drawing", "connected", "over", "release", "render_frames", "render_slabs"]

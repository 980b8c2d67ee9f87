"""Pictures by several processes and machines, through Dask."""

from splatgl.distributed.cluster import connected
from splatgl.distributed.render import over, render_frames, render_slabs
from splatgl.distributed.worker import Drawing, release

__all__ = ["Drawing", "connected", "over", "release", "render_frames", "render_slabs"]

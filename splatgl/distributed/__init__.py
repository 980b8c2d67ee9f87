"""Pictures by several processes and machines, through Dask."""

from splatgl.distributed.render import over, render_frames, render_slabs
from splatgl.distributed.workers import Drawing, connected, release

__all__ = ["Drawing", "connected", "over", "release", "render_frames", "render_slabs"]

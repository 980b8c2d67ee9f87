"""Pictures by several processes and machines, through Dask: `render_frames`, `render_slabs`, `over`."""

"""Error bounds of rendered pictures."""

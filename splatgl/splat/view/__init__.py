"""A grid as a camera sees it, and which splats that shows."""

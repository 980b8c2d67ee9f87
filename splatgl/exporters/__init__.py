"""Scenes written for other programs: pages for browsers, and splats and meshes for other viewers."""

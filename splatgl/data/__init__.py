"""Volumes, masks, meshes, images and built-in scenes."""

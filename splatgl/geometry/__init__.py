"""Geometry: cameras, grids, planes, masks and slices."""

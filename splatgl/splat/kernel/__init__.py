"""Reconstruction kernels, their footprints and tables."""

"""Extraction, kernels, integrals, views and plans of splats; float64 numpy, no OpenGL."""

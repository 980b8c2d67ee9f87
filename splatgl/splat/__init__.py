"""Room 2, splat: extraction, kernels, integrals, views and plans of splats; numpy in float64, no GL."""

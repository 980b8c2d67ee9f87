"""Room 2, splat: what a splat is, which there are, and how each is seen; numpy in float64, no GL."""

"""A splat's line integral along a ray: exact, by Table 1 of the paper, and by further approximations."""

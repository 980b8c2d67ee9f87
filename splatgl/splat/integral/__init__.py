"""What one splat contributes along one ray: exact, by Table 1 of the paper, and by forms beyond it."""

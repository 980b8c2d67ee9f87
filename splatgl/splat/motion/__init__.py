"""Motion during the exposure, and motion-blurred splats (streaks)."""

"""What moves while the shutter is open, and its streaks."""

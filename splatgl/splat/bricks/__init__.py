"""Volumes larger than memory: bricks, what they need, and where their opaque samples are."""

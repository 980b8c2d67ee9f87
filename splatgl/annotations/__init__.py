"""Annotations over a picture: scale bar, colour bar, axes, directions, box with ticks, title and time."""

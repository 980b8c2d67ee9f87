"""Frames and movies of turning volumes, keyframes and series in time."""

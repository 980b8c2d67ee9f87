"""Several volumes in one picture."""

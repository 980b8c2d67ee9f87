"""From a volume to splats, their rows and their order."""

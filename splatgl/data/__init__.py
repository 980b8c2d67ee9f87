"""Input and output: volumes, their readers, and images."""

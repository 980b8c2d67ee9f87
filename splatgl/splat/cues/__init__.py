"""What light reaches matter: a coarse grid of extinction, the sky that its cells see, and shadows."""

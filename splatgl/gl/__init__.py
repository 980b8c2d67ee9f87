"""The only package that calls OpenGL; draws a plan."""

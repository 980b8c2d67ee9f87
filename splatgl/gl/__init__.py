"""Room 3, gl: the only package that calls OpenGL; draws a plan."""

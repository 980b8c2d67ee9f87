"""Room 3, gl: the only room that talks to OpenGL; draws what a plan says."""

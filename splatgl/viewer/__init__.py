"""Interactive viewer: logic that needs no window, and a thin GLFW layer on top."""

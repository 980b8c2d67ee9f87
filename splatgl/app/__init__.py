"""Room 5, app: the command line and what it needs; thin, outside the render call."""

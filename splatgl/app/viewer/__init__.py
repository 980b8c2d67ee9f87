"""The window: what it shows and does, in parts that need no window, and a thin layer that has one."""

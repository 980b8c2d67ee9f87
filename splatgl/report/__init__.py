"""Error against run time of the methods, for a scene and a machine.

`methods` is the registry, `sweep` draws, times and measures errors, `diagram` and `page` present them.
"""

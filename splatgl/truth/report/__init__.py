"""Error against run time of the methods, for a scene and a machine.

`methods` is the registry, `sweep` draws and times, `errors` measures against `truths`, `front` finds the Pareto
front, and `diagram`, `markdown` and `page` present it.
"""

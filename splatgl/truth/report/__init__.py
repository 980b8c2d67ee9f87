"""Error against run time: what accuracy costs, for a scene and a machine.

`methods` is the registry, `sweep` draws and times, `errors` measures against `truths`, `front` says what is worth its
time, and `diagram`, `markdown` and `page` show it.
"""

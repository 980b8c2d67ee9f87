"""Error against run time of the methods, for a scene and a machine.

`methods` is the registry, `sweep` draws and times, `ground_truth` measures errors, `pareto` finds the Pareto front, and
`diagram` and `export` present it.
"""

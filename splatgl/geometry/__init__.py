"""Where things are: cameras, grids, planes, masks and slices."""

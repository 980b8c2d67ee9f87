"""Camera views of a grid, and culling of splats."""

"""A reconstruction kernel of one's own, by pieces of cubic polynomials of the distance in voxels."""

import splatgl as sg

# the cubic B-spline by distance: 2/3 − r² + r³/2 up to 1, (2 − r)³/6 up to 2
pieces = ((2 / 3, 0.0, -1.0, 0.5), (4 / 3, -2.0, 1.0, -1 / 6))
sg.register_kernel(sg.PiecewiseCubic("radial-b-spline", (1.0, 2.0), pieces))

image = sg.render(sg.scenes.ball(16), kernel="radial-b-spline", classification="pre", size=300)
image.save("out.png")
print(f"drawn with {image.info['kernel']}, error at most {image.info['error_bound']:.2g}")

"""Cells for a notebook (`# %%` as VS Code and Jupytext read them): load, look, change, keep, save."""

# %%
import numpy as np

import splatgl as sg

z, y, x = np.indices((40, 48, 56)) - 20.0
array = np.exp(-(x * x + y * y + z * z) / 90)  # or sg.load("head.nii.gz")

# %% a view that the mouse turns (extra notebook); without a display an image
view = sg.show(array, spacing=(1, 1, 1.5), azimuth=60, size=(320, 240))
view

# %% other opacities and colours
image = sg.render(array, points=[(0.2, 0), (0.8, 0.2)], colormap="viridis", size=(320, 240), background="white")
image

# %% a page that turns without a kernel, which a saved notebook keeps
page = sg.export(array, spacing=(1, 1, 1.5), azimuth=60, size=(320, 240), splats=50_000)
page

# %% samples as shown for other libraries, linear light for sums, and a file
samples, light = image.srgb, image.pixels
image.save("out.png")

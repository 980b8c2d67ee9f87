"""A volume in bricks within a limit of memory; files that are chunked or can be mapped are read in parts."""

import numpy as np

import splatgl as sg

# a file of 96³ samples stands for one of 2000³: .npy, .raw, OME-Zarr, HDF5, TIFF …
z, y, x = np.indices((96, 96, 96), np.float32) - 47.5
np.save("large.npy", np.exp(-(x * x + y * y + z * z) / 900))

image = sg.render("large.npy", memory="2GiB", azimuth=30, size=200)
image.save("out.png")
print(f"{image.info.get('bricks', 0)} bricks (0: drawn whole), level {image.info.get('level', 0)}")

"""A segmentation: voxel by voxel, as smooth surfaces, and one segment of it next to the volume."""

import numpy as np

import splatgl as sg

z, y, x = np.indices((32, 32, 32)) - 15.5
body = np.exp(-(x * x + y * y + z * z) / 150).astype(np.float32)
labels = np.where(x * x + y * y + z * z < 150, 1 + (x > 3), 0).astype(np.uint8)
names = (sg.Label(1, "liver", "#b5654a"), sg.Label(2, "tumour", "#f2d16b"))
segments = sg.Volume(labels, labels=names)

sg.render(segments, azimuth=30, size=320).save("out-voxels.png")
sg.render(segments, surfaces=0.5, azimuth=30, size=320).save("out-surfaces.png")
sg.render(body, labels=segments, only_labels={2: 0.8}, azimuth=30, size=320).save("out-body.png")

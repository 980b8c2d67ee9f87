"""A NumPy array as a volume: samples [z, y, x] with their spacing, and how wrong the picture is."""

import numpy as np

import splatgl as sg

z, y, x = np.indices((24, 48, 48)).astype(np.float32)
density = np.exp(-((x - 23.5) ** 2 + (y - 23.5) ** 2 + (2 * (z - 11.5)) ** 2) / 200)

# spacing along x, y and z; "mm" names the unit that scale bars and picks use
image = sg.render(density, spacing=(1, 1, 2), unit="mm", annotate=["scale", "colorbar"], size=320)
image.save("out.png")
print(image.accuracy)

"""Several views of one volume, which is extracted once, side by side."""

import numpy as np
from PIL import Image

import splatgl as sg

volume = sg.scenes.letter_f()
splats = sg.extract(volume, sg.default_transfer(volume))
with sg.Renderer() as renderer:
    cameras = [sg.Camera.orbit(volume, azimuth, 20, size=(200, 200)) for azimuth in (0, 60, 120, 180)]
    images = [renderer.render(splats, camera, sg.Settings(background="white")) for camera in cameras]

Image.fromarray(np.concatenate([np.asarray(image.to_pil().convert("RGB")) for image in images], axis=1)).save("out.png")

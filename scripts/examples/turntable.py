"""A volume that turns, with motion blur: numbered pictures in a folder: turntable.py VOLUME FOLDER FRAMES."""

from __future__ import annotations

import sys
from pathlib import Path

import splatgl as sg


def main(source: str, folder: str, frames: str) -> None:
    """Each picture is blurred over half of the step from the one before."""
    volume = sg.load(source)
    splats = sg.extract(volume, sg.default_transfer(volume))
    Path(folder).mkdir(parents=True, exist_ok=True)
    step = 360 / int(frames)
    before = sg.Camera.orbit(volume, azimuth=-step, elevation=15, size=(320, 320))
    with sg.Renderer() as renderer:
        for n in range(int(frames)):
            camera = sg.Camera.orbit(volume, azimuth=n * step, elevation=15, size=(320, 320))
            image = renderer.render(splats, camera, motion=sg.Motion(camera=before))
            image.save(Path(folder) / f"{n:04}.png")
            before = camera


if __name__ == "__main__":
    main(*sys.argv[1:4])

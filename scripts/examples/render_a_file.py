"""A picture of any volume file, and how wrong it is: render_a_file.py VOLUME PNG."""

from __future__ import annotations

import sys

import splatgl as sg


def main(source: str, target: str) -> None:
    """Draws with defaults: the transfer function from the histogram, a camera that fits."""
    volume = sg.load(source)
    splats = sg.extract(volume, sg.default_transfer(volume))
    camera = sg.Camera.orbit(volume, azimuth=30, elevation=20, size=(512, 512))
    with sg.Renderer() as renderer:
        image = renderer.render(splats, camera, sg.Settings(background="white"))
    image.save(target)
    print(f"{len(splats):,} splats; {image.accuracy}")


if __name__ == "__main__":
    main(*sys.argv[1:3])

"""Draws a volume in bricks within a limit of memory: large_volume.py VOLUME PNG MEMORY, such as 2GiB."""

from __future__ import annotations

import sys

import splatgl as sg


def main(source: str, target: str, memory: str) -> None:
    """Files that can be mapped or are chunked (.npy, .raw, OME-Zarr, HDF5) are read brick by brick."""
    volume = sg.load(source)
    camera = sg.Camera.orbit(volume, azimuth=30, elevation=20, size=(320, 320))
    settings = sg.Settings(background=(1, 1, 1))
    image = sg.render_slabs(source, sg.default_transfer(volume), camera, settings, memory=memory)
    image.save(target)
    print(f"{image.info['bricks']} bricks (0: drawn whole), level {image.info['level']}")


if __name__ == "__main__":
    main(*sys.argv[1:4])

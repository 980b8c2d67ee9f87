"""Draws the frames of an orbit with Dask workers: dask_frames.py VOLUME FOLDER FRAMES WORKERS."""

from __future__ import annotations

import sys
from pathlib import Path

import splatgl as sg


def main(source: str, folder: str, frames: str, workers: str) -> None:
    """Frames arrive in any order; `distributed.Client("tcp://…")` takes the place of `connected`."""
    Path(folder).mkdir(parents=True, exist_ok=True)
    volume = sg.load(source)
    transfer = sg.default_transfer(volume)
    cameras = [sg.Camera.orbit(volume, azimuth=360 * n / int(frames), size=(160, 160)) for n in range(int(frames))]
    with sg.distributed.connected(int(workers), None) as client:
        for n, image in sg.distributed.render_frames(source, transfer, cameras, client):
            image.save(Path(folder) / f"{n:04}.png")


if __name__ == "__main__":
    main(*sys.argv[1:5])

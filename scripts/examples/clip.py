"""Opens a volume with a plane, and keeps only the voxels of a mask: clip.py VOLUME OPEN.png MASKED.png."""

from __future__ import annotations

import sys

import splatgl as sg


def main(source: str, opened: str, masked: str) -> None:
    """Conditions are fractions of the box, or world coordinates with a unit (z<=20mm)."""
    volume = sg.load(source)
    view = {"azimuth": 30, "elevation": 30, "size": (320, 320), "background": "white"}
    sg.render(volume, clip="x+y>0.9", **view).save(opened)
    inside = volume.samples > volume.samples.mean()
    sg.render(volume.masked(inside), **view).save(masked)


if __name__ == "__main__":
    main(*sys.argv[1:4])

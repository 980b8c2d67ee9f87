"""Writes a movie of a turning volume: movie.py VOLUME MOVIE.gif FRAMES."""

from __future__ import annotations

import sys

from PIL import Image

import splatgl as sg


def main(source: str, target: str, frames: str) -> None:
    """`splatgl animate` does the same, and writes .mp4 and .webm with the extra video."""
    volume = sg.load(source)
    angles = [360 * n / int(frames) for n in range(int(frames))]
    images = [sg.render(volume, azimuth=a, size=(240, 240), background="black").to_pil() for a in angles]
    pictures = [image.convert("RGB").quantize(128, dither=Image.Dither.NONE) for image in images]
    pictures[0].save(target, save_all=True, append_images=pictures[1:], duration=40, loop=0)


if __name__ == "__main__":
    main(*sys.argv[1:4])

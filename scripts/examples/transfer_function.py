"""Draws one volume by a preset, by points of its own, and over logarithms: transfer_function.py PNG."""

from __future__ import annotations

import sys

import numpy as np
from PIL import Image

import splatgl as sg


def main(target: str) -> None:
    """The three pictures side by side."""
    volume = sg.scenes.ball(16)
    transfers = (
        sg.preset("surface", volume),
        sg.Transfer(points=[(0.1, 0.0), (0.3, 0.3), (0.5, 0.0), (0.9, 0.5)], colormap="viridis", window=(0, 1)),
        sg.Transfer(points=[(0.01, 0.0), (1, 0.4)], colormap="hot", scale="log"),
    )
    pictures = [sg.render(volume, transfer, size=(200, 200), background="white").to_pil() for transfer in transfers]
    Image.fromarray(np.concatenate([picture.convert("RGB") for picture in pictures], axis=1)).save(target)


if __name__ == "__main__":
    main(sys.argv[1])

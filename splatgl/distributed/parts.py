"""Parts of a picture, each of what lies between two sheets, and joining them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from splatgl.data.image import Image
from splatgl.errors import expected


@dataclass(frozen=True, eq=False)
class Part:
    """Samples of a picture of `size` (width, height), float32 [h, w, 4], from x, y on; beyond them nothing is seen.

    splats: whose first sheet is in the part.
    """

    pixels: np.ndarray
    x: int
    y: int
    size: tuple[int, int]
    splats: int

    @classmethod
    def of(cls, pixels: np.ndarray, splats: int) -> Part:
        """The window in which something is seen."""
        height, width, _ = pixels.shape
        some = (pixels != 0).any(axis=-1)
        rows, columns = np.flatnonzero(some.any(axis=1)), np.flatnonzero(some.any(axis=0))
        if not len(rows):
            return cls(pixels[:0, :0], 0, 0, (width, height), splats)
        y, x = int(rows[0]), int(columns[0])
        window = np.ascontiguousarray(pixels[y : rows[-1] + 1, x : columns[-1] + 1])
        return cls(window, x, y, (width, height), splats)

    def within(self, x: int, y: int, width: int, height: int) -> np.ndarray:
        """The samples of a window that holds this one's."""
        found = np.zeros((height, width, 4), np.float32)
        h, w, _ = self.pixels.shape
        found[self.y - y : self.y - y + h, self.x - x : self.x - x + w] = self.pixels
        return found

    @property
    def whole(self) -> np.ndarray:
        """The samples of the picture."""
        return self.within(0, 0, *self.size)


def join(how: str, near: Part, far: Part) -> Part:
    """Both parts. how: a blend's `join`."""
    splats = near.splats + far.splats
    if not near.pixels.size or not far.pixels.size:
        found = near if near.pixels.size else far
        return Part(found.pixels, found.x, found.y, found.size, splats)
    left, top = min(near.x, far.x), min(near.y, far.y)
    right = max(part.x + part.pixels.shape[1] for part in (near, far))
    bottom = max(part.y + part.pixels.shape[0] for part in (near, far))
    box = left, top, right - left, bottom - top
    return Part(joined(how, near.within(*box), far.within(*box)), left, top, near.size, splats)


def joined(how: str, near: np.ndarray, far: np.ndarray) -> np.ndarray:
    """Samples [h, w, 4] of both parts.

    over, sum: light, premultiplied. max, min, mean: a value, its sum by length if mean, and the length.
    """
    if how == "over":
        return near + (1 - near[..., 3:]) * far
    if how == "sum":
        return near + far
    one, other = near[..., 0], far[..., 0]
    both = one + other if how == "mean" else np.minimum(one, other) if how == "min" else np.maximum(one, other)
    value = np.where(near[..., 1] <= 0, other, np.where(far[..., 1] <= 0, one, both))
    rest = np.zeros_like(value)
    return np.stack([value, near[..., 1] + far[..., 1], rest, rest], axis=-1)


def over(near: Image, far: Image) -> Image:
    """The image `near` in front of `far`, both linear and premultiplied; with the info of `near`.

    Raises InputError for images of different sizes.
    """
    if near.pixels.shape != far.pixels.shape:
        raise expected("far", f"an image of {near.pixels.shape[1]}×{near.pixels.shape[0]}", far.pixels.shape[1::-1])
    return Image(joined("over", near.pixels, far.pixels), near.info)

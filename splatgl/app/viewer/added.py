"""What the window adds to a picture that is saved: a measured distance, the lines of slices, and these beside it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from splatgl.annotations.canvas import BLACK, WHITE, Layer
from splatgl.app.viewer.marking import of_ruler
from splatgl.app.viewer.slicing import outlines
from splatgl.data.color import linear_from_srgb
from splatgl.data.image import Image
from splatgl.gl.screen import Sprite, Stroke

if TYPE_CHECKING:
    from splatgl.app.viewer.viewer import Viewer

# opacity of the rim around lines, as on the screen
RIM = 0.6


def as_seen(viewer: Viewer, image: Image) -> Image:
    """The picture with what the window shows over it and beside it, but for handles and the value under the cursor."""
    state, content, scale = viewer.state, viewer.content, viewer.window.scale
    lines, labels = of_ruler(state.ruler, content, state.pose.camera, scale)
    image = with_marks(image, (*lines, *outlines(state.slices, content.volume, state.pose.camera, scale)), labels)
    beside = viewer.slicing.picture()
    return image if beside is None else with_slices(image, beside)


def with_marks(image: Image, strokes: Sequence[Stroke], sprites: Sequence[Sprite]) -> Image:
    """A picture under marks, in the order in which the window draws them."""
    if not strokes and not sprites:
        return image
    layer = Layer(np.zeros_like(image.pixels), WHITE)
    for sprite in sprites:
        left, top = (round(each) for each in sprite.place[:2])
        layer.stamp(as_dark(sprite.pixels[..., 3] / 255), linear_from_srgb(sprite.pixels[..., :3] / 255), (left, top))
    for stroke in strokes:
        ends, alpha = np.array([[*stroke.start, *stroke.stop]]), stroke.color[3]
        red, green, blue = linear_from_srgb(np.array(stroke.color[:3])).tolist()
        layer.segments(ends, BLACK, float(as_dark(RIM * alpha)), stroke.width + stroke.rim)
        layer.segments(ends, (red, green, blue), alpha, stroke.width)
    under = (1 - layer.pixels[..., 3:]) * image.pixels
    return Image(under + _one(image) * layer.pixels, image.info)


def as_dark(alpha: np.ndarray | float) -> np.ndarray:
    """The opacity that darkens linear light as much as alpha darkens the screen's values."""
    return np.asarray(1 - linear_from_srgb(1 - np.asarray(alpha)), np.float32)


def with_slices(image: Image, beside: np.ndarray) -> Image:
    """A picture with the slices at its right, as the window shows them: uint8 [H, w, 3], sRGB."""
    height = image.pixels.shape[0]
    # a window that is being resized may be of another height by now
    beside = np.pad(beside[:height], ((0, max(height - len(beside), 0)), (0, 0), (0, 0)))
    light = np.ones((*beside.shape[:2], 4), np.float32)
    light[..., :3] = linear_from_srgb(beside / 255)
    return Image(np.concatenate([image.pixels, _one(image) * light], axis=1), image.info)


def _one(image: Image) -> np.float32:
    """The light that is saved as white: an X-ray is saved relative to its brightest."""
    return np.float32((float(image.pixels.max()) or 1.0) if image.info["blend"] == "xray" else 1.0)

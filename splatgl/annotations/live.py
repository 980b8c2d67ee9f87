"""`LiveOverlay`: annotations of an interactive view, drawn for each frame in a few milliseconds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from splatgl.annotations.annotate import check, compose, draw_behind
from splatgl.annotations.canvas import BLACK, AnnotationView, Canvas, Subject, Touched, ink_on
from splatgl.data.color import Color, srgb_from_linear
from splatgl.geometry.camera import Camera
from splatgl.transfer.transfer import Transfer

# entries of the table from linear light to sRGB: only the darkest few 8-bit steps are missed
STEPS = 4096
SRGB = np.round(srgb_from_linear(np.arange(STEPS + 1) / STEPS) * 255).astype(np.uint8)


class LiveOverlay:
    """Draws overlays; reuses buffers, text and colour bars of earlier frames."""

    def __init__(self) -> None:
        self.layer: Canvas | None = None
        self.pixels = np.zeros((0, 0, 4), np.uint8)
        self.notes: tuple[str, ...] = ()

    def draw(
        self,
        subject: Subject,
        transfer: Transfer,
        camera: Camera,
        annotate: Sequence[str],
        ground: Color = BLACK,
        blend: str = "composite",
    ) -> np.ndarray:
        """uint8 [H, W, 4], sRGB with straight alpha, of the camera's size; valid until the next call.

        annotate: names as of `annotated`. ground: linear RGB behind the image, for the colour of text. Sets `notes`,
        the reasons for omissions. Edges behind the box are dashed; X-rays have no colour bar. Raises InputError for
        unknown names.
        """
        names, layer = check(annotate), self._cleared(camera.size, ground)
        view = AnnotationView(subject, transfer, camera, blend)
        draw_behind(layer, view, names)
        compose(layer, view, names)
        self.notes = tuple(layer.notes)
        for part in layer.touched:
            _encode(layer.pixels, self.pixels, part)
        return self.pixels

    def _cleared(self, size: tuple[int, int], ground: Color) -> Canvas:
        """Empty canvas of that size."""
        ink = ink_on(np.asarray(ground))
        if self.layer is None or self.layer.size != size:
            self.layer = Canvas(np.zeros((size[1], size[0], 4), np.float32), ink)
            self.pixels = np.zeros((size[1], size[0], 4), np.uint8)
            return self.layer
        for part in self.layer.touched:
            for buffer in (self.layer.pixels, self.pixels):
                if isinstance(part, np.ndarray):
                    buffer.reshape(-1, 4)[part] = 0
                else:
                    rect = part[0] if isinstance(part, tuple) else part
                    buffer[rect.top : rect.bottom, rect.left : rect.right] = 0
        self.layer = Canvas(self.layer.pixels, ink, scratch=self.layer.scratch)
        return self.layer


def _encode(linear: np.ndarray, coded: np.ndarray, part: Touched) -> None:
    """Converts a changed part to sRGB."""
    if isinstance(part, np.ndarray):
        coded.reshape(-1, 4)[part] = _srgb(linear.reshape(-1, 4)[part])
        return
    rect, patch = part if isinstance(part, tuple) else (part, None)
    place = (slice(rect.top, rect.bottom), slice(rect.left, rect.right))
    coded[place] = _srgb(linear[place]) if patch is None else _srgb_of_patch(_Patch(patch))


@dataclass(frozen=True)
class _Patch:
    """A patch, hashed by its identity: texts and bars are cached arrays."""

    pixels: np.ndarray = field(compare=False)
    number: int = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "number", id(self.pixels))


@lru_cache(maxsize=256)
def _srgb_of_patch(patch: _Patch) -> np.ndarray:
    return _srgb(patch.pixels)


def _srgb(linear: np.ndarray) -> np.ndarray:
    """uint8 sRGB with straight alpha of linear, premultiplied pixels [..., 4]."""
    alpha = linear[..., 3:]
    straight = linear[..., :3] * (STEPS / np.maximum(alpha, 1e-6))
    shades = SRGB[np.minimum(straight + 0.5, STEPS).astype(np.int16)]
    return np.concatenate([shades, (alpha * 255 + 0.5).astype(np.uint8)], axis=-1)
